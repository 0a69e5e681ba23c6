"""Many poses at once: their distributions are those of single poses."""

from __future__ import annotations

import math
import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop import _native
from bumpstop.collision import CollisionProblem
from collision.cases import control_group, ur10e
from collision.random_scenarios import random_scenario

EXAMPLES = Path(__file__).parents[2] / "examples"
# Some collisions are not detected in time: what the drives press with counts.
MISSED: dict[str, Any] = {"motion__duration_s": 0.1, "contact__offset_law": "half_normal", "contact__offset_sd_s": 0.1}


@pytest.mark.parametrize(
    ("base", "tolerance"),
    [
        (control_group(), 1e-6),
        (ur10e(), 1e-6),
        (ur10e(arm__model="elastic"), 1e-3),
        (ur10e(arm__model="elastic", **MISSED), 1e-3),
        (ur10e(arm__model="elastic", **MISSED, arm__torque_limit_Nm=450), 1e-3),
        (control_group(arm__model="elastic"), 1e-3),
        (control_group(arm__model="elastic", reaction__kind="stop"), 1e-3),
        (ur10e(contact__damping_Ns_m=200.0), 1e-5),
        (ur10e(contact__kind="free", contact__body_mass_kg=2.0), 1e-5),
    ],
    ids=[
        "sia5d",
        "ur10e",
        "elastic arm",
        "that misses",
        "with other drives",
        "that bounces",
        "and stops",
        "damped body",
        "free body",
    ],
)
def test_a_batch_is_its_laws(base: bs.Scenario, tolerance: float) -> None:
    """To the promised share of the mean force."""
    problem = bs.CollisionProblem.from_scenario(base)
    rng = np.random.default_rng(2)
    q = problem.q + rng.normal(scale=0.15, size=(13, problem.robot.dof))
    velocity = problem.velocity * rng.uniform(0.4, 1.5, size=(13, 1))
    limits = [60.0, 135.0, 620.0]
    one = bs.evaluate_batch(base, q, velocity, limits_N=limits, threads=1)
    two = bs.evaluate_batch(base, q, velocity, limits_N=limits, threads=2)
    for field in ("mean", "sd", "quantile", "exceedance", "trigger_joint_probability", "undetected_probability"):
        np.testing.assert_array_equal(getattr(one, field), getattr(two, field))
    for i in range(13):
        result = bs.evaluate(
            base.with_values({"pose_rad": q[i].tolist(), "motion.velocity_mm_s": (velocity[i] * 1e3).tolist()})
        )
        off = tolerance * result.peak_force.mean
        assert one.mean[i] == pytest.approx(result.peak_force.mean, abs=off)
        assert one.sd[i] == pytest.approx(result.peak_force.sd, abs=off)
        for column, p in enumerate((0.5, 0.95, 0.99, 0.999)):
            assert one.quantile[i, column] == pytest.approx(result.peak_force.quantile(p), abs=off)
        for column, limit in enumerate(limits):
            assert one.exceedance[i, column] == pytest.approx(result.peak_force.exceedance(limit), abs=tolerance)
        np.testing.assert_allclose(
            one.trigger_joint_probability[i], result.trigger_joint_probability, atol=1e-8 if tolerance < 1e-5 else 1e-5
        )


@pytest.mark.parametrize(
    ("pose", "velocity_mm_s"),
    [
        ([-2.5752, 0.4264, -0.2431, -1.0883, -1.5287, -1.6708, -0.8022], [-236.8, 61.39, 51.52]),
        ([-2.0731, -0.0853, 2.7734, 1.0753, -1.1879, -0.7432, 1.7726], [-141.3, -191.23, -77.23]),
    ],
    ids=["missed where a joint limit ends the line", "a servo that lags behind a retreat"],
)
def test_elastic_arms_far_from_home(pose: list[float], velocity_mm_s: list[float]) -> None:
    """The batch said 1643.6 N of the second, of 1635.1: an arm that had turned back was taken to stand where it was."""
    base = bs.load_scenario(EXAMPLES / "03_upper_arm_downward.toml", {"arm.model": "elastic"})
    batch = bs.evaluate_batch(base, [pose], [[v / 1e3 for v in velocity_mm_s]])
    single = bs.evaluate(base.with_values({"pose_rad": pose, "motion.velocity_mm_s": velocity_mm_s}))
    assert batch.mean[0] == pytest.approx(single.peak_force.mean, rel=1e-3)
    for p, found in zip((0.5, 0.95, 0.99, 0.999), batch.quantile[0], strict=True):
        assert found == pytest.approx(single.peak_force.quantile(p), abs=1e-3 * single.peak_force.mean)
    # Another route, for what both share.
    runs = 5_000
    drawn = bs.evaluate(single.scenario, samples=runs, seed=2).peak_force
    assert single.peak_force.mean == pytest.approx(drawn.mean, abs=4 * drawn.sd / math.sqrt(runs) + 1e-3 * drawn.mean)


RANDOM_LAWS = """
import sys
import numpy as np
import bumpstop as bs
from collision.cases import control_group, ur10e
base = {"sia5d": control_group, "ur10e": ur10e}[sys.argv[1]]()
robot = bs.Robot.load(base.robot)
rng = np.random.default_rng(11)
q = rng.uniform(robot.lower, robot.upper, size=(400, robot.dof))
for joint in base.motion.held_joints:
    q[:, joint - 1] = bs.CollisionProblem.from_scenario(base).q[joint - 1]
distributions = bs.evaluate_batch(base, q, rng.normal(scale=0.006, size=(400, 3)), limits_N=[60.0, 135.0])
np.savez(sys.argv[2], **vars(distributions))
"""


@pytest.mark.parametrize("robot", ["sia5d", "ur10e"])
def test_every_instruction_set_gives_the_same_batches(robot: str, tmp_path: Path) -> None:
    """Anywhere in the arm's reach: to 1e-6 but for a few poses, as reactions near singularities enlarge a rounding."""
    found = {}
    for target in _native.available_targets():
        file = tmp_path / f"{target}.npz"
        tests = str(Path(__file__).resolve().parents[1])
        environment = os.environ | {"BUMPSTOP_TARGET": target, "PYTHONPATH": tests}
        subprocess.run([sys.executable, "-c", RANDOM_LAWS, robot, str(file)], env=environment, check=True)
        found[target] = np.load(file)
    first, *others = found.values()
    assert np.isfinite(first["mean"]).sum() > 300
    scale = np.maximum(1, first["mean"])
    for other in others:
        np.testing.assert_array_equal(other["end"], first["end"])
        apart = np.zeros(len(scale))
        for field in ("mean", "sd", "quantile", "exceedance", "trigger_joint_probability", "undetected_probability"):
            one, two = (found.reshape(len(scale), -1) for found in (first[field], other[field]))
            # A deviation is a difference of greater values.
            size = scale[:, None] if field in ("mean", "sd", "quantile") else 1.0
            with np.errstate(invalid="ignore"):
                difference = np.where((one == two) | ~np.isfinite(one), 0.0, np.abs(one - two) / size)
            apart = np.fmax(apart, difference.max(axis=1))
        assert np.quantile(apart, 0.95) < 1e-8
        assert (apart > 1e-6).mean() < 0.01


@pytest.mark.parametrize("duration_s", [0.198, 0.199, 0.2, 0.201])
@pytest.mark.parametrize("latency_s", [0.0, 0.003])
def test_a_batch_ends_with_its_motion_between_two_ticks(duration_s: float, latency_s: float) -> None:
    """Thresholds nothing reaches: the path ends where the motion does, at a tick (every 4 ms) or between two."""
    scenario = control_group(
        detector__thresholds_Nm=[400] * 7, motion__duration_s=duration_s, reaction__latency_s=latency_s
    )
    problem = bs.CollisionProblem.from_scenario(scenario)
    batch = bs.evaluate_batch(scenario, problem.q[None], problem.velocity[None], limits_N=[135.0])
    result = bs.evaluate(scenario)
    assert batch.end[0] == result.curve.end == "motion_end"
    assert batch.undetected_probability[0] == pytest.approx(result.undetected_probability, abs=1e-9)
    assert batch.no_contact_probability[0] == pytest.approx(result.no_contact_probability, abs=1e-9)
    assert batch.exceedance[0, 0] == pytest.approx(result.peak_force.exceedance(135.0), abs=1e-7)


def test_batches_refuse_what_they_cannot_use() -> None:
    base = control_group()
    good_q, good_v = np.tile(bs.CollisionProblem.from_scenario(base).q, (3, 1)), np.tile([0, 0, -0.05], (3, 1))
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
    with pytest.raises(bs.InputError, match="limits_N: values of type"):
        bs.evaluate_batch(base, good_q, good_v, limits_N="abc")
    # Views, other orders and other float types are the same numbers.
    wide = np.zeros((3, 14))
    wide[:, ::2] = good_q
    expected = bs.evaluate_batch(base, good_q, good_v).mean
    for q in (wide[:, ::2], np.asfortranarray(good_q), good_q.tolist()):
        np.testing.assert_array_equal(bs.evaluate_batch(base, q, good_v).mean, expected)


def test_a_batch_joins_ticks_without_changing_the_law() -> None:
    """Random poses: where the residual grows slowly a batch's panels hold several ticks, a single distribution's never
    do."""
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
    for i in np.flatnonzero((batch.end == "all_detected") | (batch.end == "joint_limit")):
        settings |= {"pose_rad": q[i].tolist()}
        settings["motion"]["velocity_mm_s"] = (velocity[i] * 1e3).tolist()
        result = bs.evaluate(bs.Scenario.from_dict(settings))
        ours = [batch.mean[i], batch.exceedance[i, 0], batch.false_alarm_probability[i]]
        theirs = [result.peak_force.mean, result.peak_force.exceedance(60.0), result.false_alarm_probability]
        np.testing.assert_allclose(ours, theirs, rtol=1e-5, atol=1e-6)
        # Improbable ticks, which a batch knows less well, weigh more here.
        assert batch.sd[i] == pytest.approx(result.peak_force.sd, rel=1e-4)
        np.testing.assert_allclose(batch.trigger_joint_probability[i], result.trigger_joint_probability, atol=1e-6)
        compared += 1
    assert compared > 12


def alone_and_in_a_batch(settings: dict[str, Any]) -> tuple[bs.CollisionResult, bs.BatchResult]:
    scenario = bs.Scenario.from_dict(settings)
    return bs.evaluate(scenario), bs.evaluate_batch(scenario, [settings["pose_rad"]], [scenario.motion.velocity])


def test_a_batch_knows_who_triggered_what_is_hardly_ever_detected() -> None:
    """The arm retreats from where the body may be: one case in 10^16 alarms, less than the rounding of the others."""
    result, batch = alone_and_in_a_batch(
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
    np.testing.assert_allclose(batch.trigger_joint_probability[0], result.trigger_joint_probability, atol=1e-6)


def test_a_batch_feels_no_body_that_the_arm_has_left() -> None:
    """The arm falls back and ends amid the places where the body may be, none of which it is detected at."""
    result, batch = alone_and_in_a_batch(
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
    curve, most = result.curve, result.problem.offset_size
    assert curve.end == "joint_limit"
    assert 0.1 * most < curve.distance[-1] < 0.95 * most
    # The farthest point lies between control cycles, where the batch knows its path to some 1e-8 m.
    assert batch.mean[0] == pytest.approx(result.peak_force.mean, rel=5e-6)
    assert batch.sd[0] == pytest.approx(result.peak_force.sd, rel=5e-6)


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

    def laws(probabilities: list[float], limits: list[float]) -> bs.BatchResult:
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
    """The motion ends between two moments that are kept for the reactions, and so does a kink of the path."""
    result, batch = alone_and_in_a_batch(
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
    assert result.curve.end == "motion_end"
    assert batch.no_contact_probability[0] == pytest.approx(result.no_contact_probability, abs=1e-8)
    assert batch.undetected_probability[0] == pytest.approx(result.undetected_probability, abs=1e-8)


def test_a_batch_cuts_its_panels_where_an_arm_that_falls_back_leaves_a_body() -> None:
    """The noise has a mean, so how probable an alarm is has a kink where the force ends."""
    result, batch = alone_and_in_a_batch(
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
    assert result.curve.distance[-1] < 0.9 * result.curve.distance.max()
    assert batch.undetected_probability[0] == pytest.approx(result.undetected_probability, abs=2e-8)
    np.testing.assert_allclose(batch.trigger_joint_probability[0], result.trigger_joint_probability, atol=3e-7)


def test_a_batch_goes_the_way_of_its_law_at_a_singularity() -> None:
    """From rest beside a singularity: on which side an arm passes it decides between 8 and 254 mm."""
    result, batch = alone_and_in_a_batch(
        {
            "robot": "sia5d",
            "pose_rad": [
                0.9724045996632795,
                -0.5079688956376234,
                -2.5313068354989157,
                1.4425702060696044,
                -1.5690354652802616,
                1.1088766439437916,
                2.8476911722160057,
            ],
            "motion": {
                "velocity_mm_s": [-22.303050401099753, 67.44569046647153, -16.08237045816313],
                "held_joints": [7],
                "duration_s": 0.2,
                "start": "rest",
            },
            "contact": {"stiffness_N_m": 1267.0, "offset_law": "uniform"},
            "detector": {
                "thresholds_Nm": [26.856, 35.1, 46.213, 6.608, 17.547, 3.6675, 18.673],
                "noise_sd_Nm": 1.3292,
                "feedback_period_s": 0.004,
            },
            "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 4.5},
            "simulation": {"step_s": 0.002, "substeps": 7},
        }
    )
    farthest = result.curve.max_distance
    assert farthest[4] > 30 * farthest[5]
    assert batch.mean[0] == pytest.approx(result.peak_force.mean, rel=1e-5)
    assert batch.sd[0] == pytest.approx(result.peak_force.sd, rel=1e-5)


def test_trigger_probabilities_where_detections_alone_are_smooth() -> None:
    """Panels are interpolated only where what triggers them is smooth, too: here joint 1 was 4e-4 off."""
    q, velocity = np.array([1.475, -1.069, 2.602, 1.111, 2.505, 0.676, 0.0]), np.array([0.0445, -0.015, -0.062])
    result = bs.evaluate(
        control_group(pose_deg=np.degrees(q).tolist(), motion__velocity_mm_s=(1e3 * velocity).tolist())
    )
    batch = bs.evaluate_batch(control_group(), [q], [velocity])
    np.testing.assert_allclose(batch.trigger_joint_probability[0], result.trigger_joint_probability, atol=1e-6)


@pytest.mark.parametrize("seed", [17, 38, 83, 216])
def test_joints_that_trigger_next_to_nothing_have_no_share(seed: int, tmp_path: Path) -> None:
    """A batch is interpolated to 1e-6: where less is detected, joints had shares of -29 to -0.07."""
    scenario = random_scenario(seed, tmp_path)
    problem = CollisionProblem.from_scenario(scenario)
    found = bs.evaluate_batch(scenario, problem.q[None], problem.velocity[None])
    assert np.isnan(found.trigger_joint_probability).all()
    assert bs.evaluate(scenario).undetected_probability + found.no_contact_probability[0] > 1 - 1e-6
