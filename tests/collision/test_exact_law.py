"""The exact law by itself: convergence, tails, limits of its cases, and that nothing depends on how it is computed."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path
from typing import Any

import mpmath as mp
import numpy as np
import pytest

import bumpstop as bs
from bumpstop import kernels
from collision.cases import VARIED, control_group, ur10e

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples").glob("*.toml"))


def figures(law: bs.ForceLaw) -> list[float]:
    """All that is printed of a law, in one list."""
    out: list[float] = []
    for quantity in (law.peak_force, law.force_at_detection, law.detection_delay):
        out += [value if value is not None else -1.0 for value in quantity.to_json().values()]
    out += [law.false_alarm_probability, law.undetected_probability, law.several_joints_probability]
    out += [float(p) for p in law.trigger_joint_probability]
    if law.problem.limits is not None:
        out += [law.peak_force.exceedance(law.problem.limits.force_N)]
    return out


# Of trajectories, tests/collision/test_trajectory.py knows what the quadrature can do.
LINES = [path for path in EXAMPLES if "trajectory" not in path.stem]


@pytest.mark.parametrize("path", LINES, ids=[path.stem for path in LINES])
def test_twice_the_quadrature_changes_no_printed_digit(path: Path) -> None:
    scenario = bs.load_scenario(path)
    coarse, fine = bs.evaluate(scenario), bs.evaluate(scenario, refinement=2)
    np.testing.assert_allclose(figures(coarse), figures(fine), rtol=2e-6, atol=1e-12)
    for x in np.linspace(0.5, 1.4, 19) * coarse.peak_force.mean:
        assert f"{coarse.peak_force.exceedance(x):.4f}" == f"{fine.peak_force.exceedance(x):.4f}"


def test_tails_against_forty_digits() -> None:
    """P(peak > x) of a fixed offset down to 1e-40, from the same curve by the formula itself in 40 digits."""
    mp.mp.dps = 40
    scenario = control_group(contact__offset_law="fixed", contact__offset_mm=1.17, motion__velocity_mm_s=[0, 0, -20])
    problem = bs.Problem.from_scenario(scenario)
    law = bs.evaluate(scenario)
    curve = law.curve
    survival, rows = mp.mpf(1), []
    for k in range(curve.ticks):
        force = problem.stiffness * max(0.0, curve.tick_distance[k] - 0.00117)
        silent = mp.mpf(1)
        for j in range(problem.robot.dof):
            m, sd = (
                mp.mpf(float(curve.torque_per_newton[k, j])) * mp.mpf(float(force)),
                mp.mpf(float(problem.noise_sd[j])),
            )
            tau = mp.mpf(float(problem.thresholds[j]))
            silent *= 1 - (mp.erfc((tau - m) / (sd * mp.sqrt(2))) + mp.erfc((tau + m) / (sd * mp.sqrt(2)))) / 2
        rows.append((survival * (1 - silent), problem.stiffness * max(0.0, float(curve.farthest[k]) - 0.00117)))
        survival *= silent
    peaks = sorted(peak for _, peak in rows if peak > 0)
    checked = 0
    for low, high in pairwise(peaks):
        x = (low + high) / 2
        exact = mp.fsum(p for p, peak in rows if peak > x)
        if exact < mp.mpf("1e-40"):
            break
        assert law.peak_force.exceedance(x) - law.undetected_probability == pytest.approx(float(exact), rel=1e-10)
        checked += exact < mp.mpf("1e-7")
    assert checked >= 2


def test_far_tail_joins_the_near_one() -> None:
    law = bs.evaluate(control_group(motion__velocity_mm_s=[0, 0, -75]))
    question = law.problem.detector, law.problem.stiffness, law.problem.offset_kind, law.problem.offset_size
    for x in (150.0, 160.0, 165.0, 170.0):
        assert law.curve.kernel.tail_directly(*question, x) == pytest.approx(law.peak_force.exceedance(x), rel=1e-7)
    tails = [law.peak_force.exceedance(x) for x in np.linspace(170, 260, 40)]
    assert tails == sorted(tails, reverse=True)
    assert 0 < tails[-1] < 1e-30


def test_noise_that_vanishes_tends_to_no_noise() -> None:
    """Without noise the law is that of the offset alone: the peak is a sawtooth of it."""
    none = bs.evaluate(control_group(detector__noise_sd_Nm=0.0))
    for sd, tolerance in ((1e-2, 1e-3), (1e-4, 1e-5)):
        little = bs.evaluate(control_group(detector__noise_sd_Nm=sd))
        assert little.peak_force.mean == pytest.approx(none.peak_force.mean, rel=tolerance)
        assert little.peak_force.quantile(0.9) == pytest.approx(none.peak_force.quantile(0.9), rel=10 * tolerance)
    assert none.false_alarm_probability == 0
    # Force at detection is at least the threshold's: no noise helps.
    curve = none.curve
    needed = 10 / np.abs(curve.torque_per_newton[:, 1]).max()
    assert none.force_at_detection.quantile(1e-6) >= needed * (1 - 1e-6)


def test_probabilities_add_up() -> None:
    for name, scenario in VARIED.items():
        law = bs.evaluate(scenario)
        total = law.kernel.total("peak_force") + law.kernel.harmless + law.undetected_probability
        assert total == pytest.approx(1, abs=1e-9), name
        p = [law.peak_force.exceedance(x) for x in np.linspace(0, 400, 60)]
        assert all(a >= b - 1e-12 for a, b in pairwise(p)), name


def test_lower_thresholds_and_softer_bodies_make_softer_hits() -> None:
    means = [
        bs.evaluate(control_group(detector__thresholds_Nm=[2 * t, t, *[2 * t] * 5])).peak_force.mean
        for t in (8, 10, 14)
    ]
    assert means == sorted(means)
    stiff = [bs.evaluate(control_group(contact__stiffness_N_m=K)).peak_force.mean for K in (5600, 19100, 75000)]
    assert stiff == sorted(stiff)


def test_undetected_without_bound_has_no_mean_and_counts_as_over() -> None:
    law = bs.evaluate(control_group(detector__thresholds_Nm=[1e6] * 7, motion__duration_s=0.05))
    assert law.curve.end == "horizon"
    assert law.undetected_probability > 0.1
    figures = law.peak_force.to_json()
    assert figures["mean"] is None
    assert figures["p999"] is None
    assert law.verdict.acceptable is False
    assert law.verdict.p_over_force == pytest.approx(law.undetected_probability)


@pytest.mark.parametrize("path", EXAMPLES, ids=[path.stem for path in EXAMPLES])
def test_every_instruction_set_gives_the_same_figures(path: Path) -> None:
    script = (
        "import json, sys, bumpstop as bs\n"
        "law = bs.evaluate(bs.load_scenario(sys.argv[1]))\n"
        "runs = bs.evaluate(bs.load_scenario(sys.argv[1]), samples=500, seed=4)\n"
        "print(json.dumps([law.to_json(), runs.to_json()]))"
    )
    found = {}
    for target in kernels.available_targets():
        done = subprocess.run(
            [sys.executable, "-c", script, str(path)],
            env=os.environ | {"BUMPSTOP_TARGET": target},
            capture_output=True,
            text=True,
            check=True,
        )
        found[target] = list(_numbers(json.loads(done.stdout)))
    first, *others = found.values()
    for other in others:
        for (where, scale, value), (there, _, expected) in zip(other, first, strict=True):
            assert where == there
            # Far tails are 1e-12 of what they are, too, but the rounding of 1e-30 is nobody's business.
            assert value == pytest.approx(expected, rel=1e-12, abs=1e-12 * max(1, scale)), where


def _numbers(value: object, where: str = "", scale: float = 0) -> list[tuple[str, float, float]]:
    """Every number with its place and the size of what it comes from: a deviation is a difference of greater values."""
    if isinstance(value, dict):
        mean = value.get("mean") or 0
        items = [(f"{where}.{key}", abs(mean) if key == "sd" else 0, item) for key, item in value.items()]
        return [number for place, size, item in items for number in _numbers(item, place, size)]
    if isinstance(value, list):
        return [number for i, item in enumerate(value) for number in _numbers(item, f"{where}[{i}]")]
    return [(where, scale, float(value))] if isinstance(value, int | float) else []


def test_a_target_this_machine_lacks_is_refused() -> None:
    done = subprocess.run(
        [sys.executable, "-c", "from bumpstop.cli.main import main; main(['robots'])"],
        env=os.environ | {"BUMPSTOP_TARGET": "neon" if "baseline" in kernels.available_targets() else "avx2"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("error: BUMPSTOP_TARGET")


def test_threads_and_seeds() -> None:
    scenario = VARIED["oblique"]
    one, two = (bs.evaluate(scenario, samples=150_000, seed=9, threads=n) for n in (1, 2))
    assert one.runs is not None
    assert two.runs is not None
    for name, values in one.runs.items():
        np.testing.assert_array_equal(values, two.runs[name])
    other = bs.evaluate(scenario, samples=1000, seed=10)
    assert other.runs is not None
    assert not np.array_equal(other.runs["offset"], one.runs["offset"][:1000])
    # A run is itself whatever company it is drawn in.
    few = bs.evaluate(scenario, samples=37, seed=9)
    assert few.runs is not None
    np.testing.assert_array_equal(few.runs["tick"], one.runs["tick"][:37])


@pytest.mark.parametrize("base", [control_group(), ur10e()], ids=["sia5d", "ur10e"])
def test_a_batch_is_its_laws(base: bs.Scenario) -> None:
    problem = bs.Problem.from_scenario(base)
    rng = np.random.default_rng(2)
    q = problem.q + rng.normal(scale=0.15, size=(13, problem.robot.dof))
    velocity = problem.velocity * rng.uniform(0.4, 1.5, size=(13, 1))
    limits = [60.0, 135.0]
    one = bs.evaluate_batch(base, q, velocity, limits_N=limits, threads=1)
    two = bs.evaluate_batch(base, q, velocity, limits_N=limits, threads=2)
    for field in ("mean", "sd", "quantile", "exceedance", "trigger_joint_probability", "undetected_probability"):
        np.testing.assert_array_equal(getattr(one, field), getattr(two, field))
    for i in range(13):
        law = bs.evaluate(
            base.with_values({"pose_rad": q[i].tolist(), "motion.velocity_mm_s": (velocity[i] * 1e3).tolist()})
        )
        assert one.mean[i] == pytest.approx(law.peak_force.mean, rel=1e-8)
        assert one.sd[i] == pytest.approx(law.peak_force.sd, rel=1e-6)
        for column, p in enumerate((0.5, 0.95, 0.99, 0.999)):
            assert one.quantile[i, column] == pytest.approx(law.peak_force.quantile(p), rel=1e-7)
        for column, limit in enumerate(limits):
            assert one.exceedance[i, column] == pytest.approx(law.peak_force.exceedance(limit), abs=1e-7)
        np.testing.assert_allclose(one.trigger_joint_probability[i], law.trigger_joint_probability, atol=1e-8)


@pytest.mark.parametrize("duration_s", [0.198, 0.199, 0.2, 0.201])
@pytest.mark.parametrize("latency_s", [0.0, 0.003])
def test_a_batch_ends_with_its_motion_between_two_ticks(duration_s: float, latency_s: float) -> None:
    """Thresholds nothing reaches: the path ends where the motion does, at a tick (every 4 ms) or between two."""
    scenario = control_group(
        detector__thresholds_Nm=[400] * 7, motion__duration_s=duration_s, reaction__latency_s=latency_s
    )
    problem = bs.Problem.from_scenario(scenario)
    batch = bs.evaluate_batch(scenario, problem.q[None], problem.velocity[None], limits_N=[135.0])
    law = bs.evaluate(scenario)
    assert batch.end[0] == law.curve.end == "horizon"
    assert batch.undetected_probability[0] == pytest.approx(law.undetected_probability, abs=1e-9)
    assert batch.no_contact_probability[0] == pytest.approx(law.no_contact_probability, abs=1e-9)
    assert batch.exceedance[0, 0] == pytest.approx(law.peak_force.exceedance(135.0), abs=1e-7)


def test_batches_refuse_what_they_cannot_use() -> None:
    base = control_group()
    good_q, good_v = np.tile(bs.Problem.from_scenario(base).q, (3, 1)), np.tile([0, 0, -0.05], (3, 1))
    bad_q, bad_v = good_q.copy(), good_v.copy()
    bad_q[1, 1], bad_v[2] = 3.0, 0.0
    with pytest.raises(bs.InputError, match=r"q\[1\]: joint 2"):
        bs.evaluate_batch(base, bad_q, good_v)
    with pytest.raises(bs.InputError, match=r"velocity\[2\]: is zero"):
        bs.evaluate_batch(base, good_q, bad_v)
    for key, value in (("link", "link_t"), ("point_m", [0.0, 0.0, 0.1]), ("normal", [0, 0, -1])):
        with pytest.raises(bs.InputError, match=rf"contact\.{key}: batches are computed for contact at the tip"):
            bs.evaluate_batch(base.with_values({f"contact.{key}": value}), good_q, good_v)
    with pytest.raises(bs.InputError, match="shape"):
        bs.evaluate_batch(base, good_q[:, :6], good_v)
    bad_q[1, 1] = math.nan
    with pytest.raises(bs.InputError, match="nan"):
        bs.evaluate_batch(base, bad_q, good_v)
    with pytest.raises(bs.InputError, match="not real numbers"):
        bs.evaluate_batch(base, good_q.astype(str), good_v)
    # Views, other orders and other float types are the same numbers.
    wide = np.zeros((3, 14))
    wide[:, ::2] = good_q
    expected = bs.evaluate_batch(base, good_q, good_v).mean
    for q in (wide[:, ::2], np.asfortranarray(good_q), good_q.tolist()):
        np.testing.assert_array_equal(bs.evaluate_batch(base, q, good_v).mean, expected)


@pytest.mark.parametrize("offset_sd_s", [1e-4, 1e-3, 4e-3])
def test_offsets_much_nearer_than_a_tick_of_travel(offset_sd_s: float) -> None:
    """The offset's density is resolved where it changes within a panel: against an average over fixed offsets."""
    scenario = control_group(contact__offset_sd_s=offset_sd_s)
    law = bs.evaluate(scenario)
    np.testing.assert_allclose(figures(law), figures(bs.evaluate(scenario, refinement=2)), rtol=1e-9, atol=1e-12)
    node, weight = np.polynomial.legendre.leggauss(60)
    z, weight = 3.5 * (node + 1), 3.5 * weight
    weight = weight * np.exp(-z * z / 2)
    means = [
        bs.evaluate(
            control_group(contact__offset_law="fixed", contact__offset_mm=float(offset_sd_s * 50 * at))
        ).peak_force.mean
        for at in z
    ]
    # The average crosses panels without stopping at their ends, where the law has kinks.
    assert law.peak_force.mean == pytest.approx(float(weight @ means / weight.sum()), rel=1e-4)


def test_probabilities_of_a_motion_that_ends_early_add_up() -> None:
    """Most of the offset's density lies beyond a joint limit, in one wide panel that only a stopping path reaches."""
    scenario = control_group(
        pose_deg=[0, 109.97, 0, -20, 0, -40, 0],
        motion__velocity_mm_s=[0, 0, -30],
        detector__noise_sd_Nm=[8, 4.5, 8, 8, 8, 8, 8],
        contact__offset_sd_s=0.3,
        reaction__latency_s=0.05,
    )
    law = bs.evaluate(scenario)
    assert law.curve.end == "joint_limit"
    kernel = law.kernel
    assert law.no_contact_probability > 0.7
    assert kernel.total("peak_force") + kernel.harmless + kernel.undetected == pytest.approx(1, abs=1e-12)


def test_a_batch_joins_ticks_without_changing_the_law() -> None:
    """Random poses: where the residual grows slowly a batch's panels hold several ticks, a single law's never do."""
    base, robot = control_group(motion__velocity_mm_s=[0, 0, -10]), bs.Robot.load("sia5d")
    rng = np.random.default_rng(5)
    q = rng.uniform(robot.lower, robot.upper, size=(24, 7))
    q[:, 6] = 0
    velocity = rng.normal(size=(24, 3))
    velocity *= 0.01 / np.linalg.norm(velocity, axis=1)[:, None]
    batch = bs.evaluate_batch(base, q, velocity, limits_N=[60.0])
    settings = base.to_dict()
    del settings["pose_deg"]
    compared = 0
    for i in np.flatnonzero((batch.end == "certain_detection") | (batch.end == "joint_limit")):
        settings |= {"pose_rad": q[i].tolist()}
        settings["motion"]["velocity_mm_s"] = (velocity[i] * 1e3).tolist()
        law = bs.evaluate(bs.Scenario.from_dict(settings))
        ours = [batch.mean[i], batch.sd[i], batch.exceedance[i, 0], batch.false_alarm_probability[i]]
        theirs = [law.peak_force.mean, law.peak_force.sd, law.peak_force.exceedance(60.0), law.false_alarm_probability]
        np.testing.assert_allclose(ours, theirs, rtol=1e-7, atol=1e-8)
        np.testing.assert_allclose(batch.trigger_joint_probability[i], law.trigger_joint_probability, atol=1e-6)
        compared += 1
    assert compared > 12


def alone_and_in_a_batch(settings: dict[str, Any]) -> tuple[bs.ForceLaw, bs.BatchLaws]:
    scenario = bs.Scenario.from_dict(settings)
    return bs.evaluate(scenario), bs.evaluate_batch(scenario, [settings["pose_rad"]], [scenario.motion.velocity])


def test_a_batch_knows_who_triggered_what_is_hardly_ever_detected() -> None:
    """The arm retreats from where the body may be: one case in 10^16 alarms, less than the rounding of the others."""
    law, batch = alone_and_in_a_batch(
        {
            "robot": "ur10e",
            "pose_rad": [-0.8663, -0.5933, 3.0781, -1.6499, -0.1456, -2.3106],
            "motion": {"velocity_mm_s": [-331.4, 0, 0], "task": "position", "duration_s": 0.5, "damping": 0.00116},
            "contact": {"stiffness_N_m": 1300.0, "offset_law": "half_normal", "offset_sd_s": 0.0675},
            "detector": {
                "thresholds_Nm": [40.9, 34.2, 11, 56.5, 99.4, 7.87],
                "noise_sd_Nm": [3.84, 3.54, 0.995, 6.51, 8.39, 0.724],
                "feedback_period_s": 0.006,
            },
            "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 4.5},
            "simulation": {"step_s": 0.0005},
        }
    )
    np.testing.assert_allclose(batch.trigger_joint_probability[0], law.trigger_joint_probability, atol=1e-6)


def test_a_batch_feels_no_body_that_the_arm_has_left() -> None:
    """The arm falls back and ends amid the places where the body may be, none of which it is noticed at."""
    law, batch = alone_and_in_a_batch(
        {
            "robot": "iiwa14",
            "pose_rad": [2.625, -0.6187, -2.5761, -0.2897, 0.1435, -0.0004453, -0.3804],
            "motion": {"velocity_mm_s": [358.4, -132.5, 236.6], "duration_s": 2.5},
            "contact": {"stiffness_N_m": 1500.0, "offset_law": "uniform"},
            "detector": {"thresholds_Nm": [100] * 7, "noise_sd_Nm": 0.5, "feedback_period_s": 0.024},
            "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 1.57},
            "simulation": {"step_s": 0.002, "substeps": 7},
        }
    )
    curve, most = law.curve, law.problem.offset_size
    assert curve.end == "joint_limit"
    assert 0.1 * most < curve.distance[-1] < 0.95 * most
    assert batch.mean[0] == pytest.approx(law.peak_force.mean, rel=1e-7)
    assert batch.sd[0] == pytest.approx(law.peak_force.sd, rel=1e-7)


def test_quantiles_of_a_batch_are_passed_as_often_as_asked_for() -> None:
    """Most motions end before contact; what is left steps from the stopping path of one tick to that of the next."""
    settings: dict[str, Any] = {
        "robot": "iiwa14",
        "pose_rad": [-1.04, 0.9162, 2.9004, 1.3075, 1.571, -0.7915, 0.0004],
        "motion": {"velocity_mm_s": [-71.05, 101.69, -71.6], "held_joints": [7], "duration_s": 0.5},
        "contact": {"stiffness_N_m": 19000.0, "offset_law": "uniform"},
        "detector": {
            "thresholds_Nm": [31.3, 7.22, 11.7, 38.9, 2.45, 11.4, 3.75],
            "noise_sd_Nm": [7.15, 0.635, 1.08, 4.65, 0.788, 2.47, 0.338],
            "feedback_period_s": 0.008,
        },
        "reaction": {
            "kind": "reverse",
            "joint_acceleration_rad_s2": [0.406, 0.559, 2.27, 4.66, 0.852, 10.8, 2.31],
            "latency_s": 0.016,
        },
        "simulation": {"step_s": 0.001, "substeps": 3},
    }
    scenario = bs.Scenario.from_dict(settings)
    asked = [0.95, 0.96, 0.97, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9999]

    def laws(probabilities: list[float], limits: list[float]) -> bs.BatchLaws:
        return bs.evaluate_batch(
            scenario, [settings["pose_rad"]], [scenario.motion.velocity], probabilities=probabilities, limits_N=limits
        )

    batch = laws(asked, [])
    forces = batch.quantile[0]
    assert (forces > 0).all()
    np.testing.assert_allclose(laws([0.5], list(forces)).exceedance[0], 1 - np.array(asked), atol=1e-6)
    # What else was asked for, and when, is no matter.
    others = laws([0.97, *reversed(asked), 0.5, 0.97], [10.0, *forces[::2]]).quantile[0]
    np.testing.assert_allclose(others[1:-2][::-1], forces, atol=1e-5 * batch.sd[0])
    np.testing.assert_allclose(others[[0, -1]], forces[2], atol=1e-5 * batch.sd[0])


def test_a_batch_knows_where_a_motion_ends_just_as_a_joint_catches_up() -> None:
    """The horizon lies between two moments that are kept for the reactions, and so does a kink of the path."""
    law, batch = alone_and_in_a_batch(
        {
            "robot": "sia5d",
            "pose_rad": [-0.5552, 0.6117, 1.6488, 0.2127, -2.644, 1.8465, -1.2232],
            "motion": {"velocity_mm_s": [6.192, -15.633, -37.856], "duration_s": 0.05, "start": "rest"},
            "contact": {"stiffness_N_m": 1750.0, "offset_law": "half_normal", "offset_sd_s": 0.0214},
            "detector": {"thresholds_Nm": [40] * 7, "noise_sd_Nm": 4.0, "feedback_period_s": 0.00225},
            "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 4.5, "latency_s": 0.00075},
            "simulation": {"step_s": 0.00025, "substeps": 5},
        }
    )
    assert law.curve.end == "horizon"
    assert batch.no_contact_probability[0] == pytest.approx(law.no_contact_probability, abs=1e-8)
    assert batch.undetected_probability[0] == pytest.approx(law.undetected_probability, abs=1e-8)


def test_a_batch_cuts_its_panels_where_an_arm_that_falls_back_leaves_a_body() -> None:
    """The noise has a mean, so how probable an alarm is has a kink where the force ends."""
    law, batch = alone_and_in_a_batch(
        {
            "robot": "sia5d",
            "pose_rad": [0.6061, 1.166, -0.6799, 0.8206, 0.8312, 1.1096, 0.9532],
            "motion": {"velocity_mm_s": [151.1, 0, 0], "duration_s": 2.5},
            "contact": {"stiffness_N_m": 2680.0, "offset_law": "uniform"},
            "detector": {
                "thresholds_Nm": [9.41, 98.5, 13, 31.4, 4.03, 26.3, 35],
                "noise_sd_Nm": [3.33, 28.3, 1.54, 7.58, 1.35, 2.69, 3.72],
                "noise_mean_Nm": [4.4, 29.6, 8.88, 0.763, 1.63, -18.2, -0.05],
                "feedback_period_s": 0.01,
            },
            "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 4.5},
            "simulation": {"step_s": 0.002},
        }
    )
    assert law.curve.distance[-1] < 0.9 * law.curve.distance.max()
    assert batch.undetected_probability[0] == pytest.approx(law.undetected_probability, abs=2e-8)
    np.testing.assert_allclose(batch.trigger_joint_probability[0], law.trigger_joint_probability, atol=3e-7)


@pytest.mark.parametrize("pose", [76, 87, 219])
def test_rough_stopping_curves_are_those_of_their_reactions(pose: int) -> None:
    """Near singularities, where few ticks can be interpolated: every tick beside its reaction followed step by step."""
    robot = bs.Robot.load("sia5d")
    rng = np.random.default_rng(623)
    q = rng.uniform(robot.lower, robot.upper, size=(400, robot.dof))
    q[:, 6] = 0
    direction = rng.normal(size=(400, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    velocity = direction * rng.normal(0.010, 0.002, size=(400, 1))
    settings = control_group().to_dict()
    del settings["pose_deg"]
    settings |= {"pose_rad": q[pose].tolist()}
    settings["motion"]["velocity_mm_s"] = (velocity[pose] * 1e3).tolist()
    problem = bs.Problem.from_scenario(bs.Scenario.from_dict(settings))
    curve = bs.stopping_curve(problem)
    ticks = list(range(len(curve.farthest)))
    there = [float(curve.kernel.distance[problem.period_steps * k + 1]) for k in ticks]
    farthest = [path.max() for path in curve.kernel.reaction_paths(ticks, there)]
    np.testing.assert_allclose(curve.farthest, farthest, rtol=0, atol=5e-9)
