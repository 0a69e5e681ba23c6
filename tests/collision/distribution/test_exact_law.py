"""The integrated distribution by itself: convergence, tails, limits of its cases, and that nothing depends on how it is
computed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import mpmath as mp
import numpy as np
import pytest

import bumpstop as bs
from bumpstop import _native
from collision.cases import VARIED, control_group

EXAMPLES = sorted((Path(__file__).resolve().parents[3] / "examples").glob("*.toml"))


def figures(result: bs.CollisionResult) -> list[float]:
    """All that is printed of a distribution, in one list."""
    out: list[float] = []
    for quantity in (result.peak_force, result.force_at_detection, result.detection_delay):
        out += [value if value is not None else -1.0 for value in quantity.to_json().values()]
    out += [result.false_alarm_probability, result.undetected_probability, result.multi_joint_probability]
    out += [float(p) for p in result.trigger_joint_probability]
    if result.problem.limits is not None:
        out += [result.peak_force.exceedance(result.problem.limits.force_N)]
    return out


# Of trajectories, tests/collision/trajectory/test_trajectory.py knows what the quadrature can do.
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
    problem = bs.CollisionProblem.from_scenario(scenario)
    result = bs.evaluate(scenario)
    curve = result.curve
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
        rows.append((survival * (1 - silent), problem.stiffness * max(0.0, float(curve.max_distance[k]) - 0.00117)))
        survival *= silent
    peaks = sorted(peak for _, peak in rows if peak > 0)
    checked = 0
    for low, high in pairwise(peaks):
        x = (low + high) / 2
        exact = mp.fsum(p for p, peak in rows if peak > x)
        if exact < mp.mpf("1e-40"):
            break
        assert result.peak_force.exceedance(x) - result.undetected_probability == pytest.approx(float(exact), rel=1e-10)
        checked += exact < mp.mpf("1e-7")
    assert checked >= 2


def test_far_tail_joins_the_near_one() -> None:
    result = bs.evaluate(control_group(motion__velocity_mm_s=[0, 0, -75]))
    question = result.problem.detector, result.problem.contact
    for x in (150.0, 160.0, 165.0, 170.0):
        assert result.curve.line.tail_without_interpolation(*question, x) == pytest.approx(
            result.peak_force.exceedance(x), rel=1e-7
        )
    tails = [result.peak_force.exceedance(x) for x in np.linspace(170, 260, 40)]
    assert tails == sorted(tails, reverse=True)
    assert 0 < tails[-1] < 1e-30


def test_noise_that_vanishes_tends_to_no_noise() -> None:
    """Without noise the distribution is that of the offset alone: the peak is piecewise linear in it."""
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
        result = bs.evaluate(scenario)
        total = result.integral.total("peak_force") + result.integral.zero_force
        # An arm that comes to rest has a force for what it never detects, too.
        total += 0.0 if result.integral.rests else result.undetected_probability
        assert total == pytest.approx(1, abs=1e-9), name
        p = [result.peak_force.exceedance(x) for x in np.linspace(0, 400, 60)]
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
    result = bs.evaluate(control_group(detector__thresholds_Nm=[1e6] * 7, motion__duration_s=0.05))
    assert result.curve.end == "motion_end"
    assert result.undetected_probability > 0.1
    figures = result.peak_force.to_json()
    assert figures["mean"] is None
    assert figures["p999"] is None
    assert result.verdict.acceptable is False
    assert result.verdict.p_over_force == pytest.approx(result.undetected_probability)


@pytest.fixture(scope="module")
def figures_of_targets() -> list[dict[str, object]]:
    """Figures of every example by its path, once from each set of kernels: a process for each."""
    script = (
        "import json, sys, bumpstop as bs\n"
        "found = {}\n"
        "for path in sys.argv[1:]:\n"
        "    law = bs.evaluate(bs.load_scenario(path))\n"
        "    runs = bs.evaluate(bs.load_scenario(path), samples=500, seed=4)\n"
        "    found[path] = [law.to_json(), runs.to_json()]\n"
        "print(json.dumps(found))"
    )
    return [
        json.loads(
            subprocess.run(
                [sys.executable, "-c", script, *map(str, EXAMPLES)],
                env=os.environ | {"BUMPSTOP_TARGET": target},
                capture_output=True,
                text=True,
                check=True,
            ).stdout
        )
        for target in _native.available_targets()
    ]


@pytest.mark.parametrize("path", EXAMPLES, ids=[path.stem for path in EXAMPLES])
def test_every_instruction_set_gives_the_same_figures(path: Path, figures_of_targets: list[dict[str, object]]) -> None:
    first, *others = (list(_numbers(found[str(path)])) for found in figures_of_targets)
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
        env=os.environ | {"BUMPSTOP_TARGET": "neon" if "baseline" in _native.available_targets() else "avx2"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert done.stderr.startswith("error: BUMPSTOP_TARGET")


def test_threads_and_seeds() -> None:
    scenario = VARIED["oblique"]
    for wrong in ({"threads": 0}, {"refinement": 0}):
        with pytest.raises(bs.InputError, match=f"{next(iter(wrong))}: is 0; wanted a whole number"):
            bs.evaluate(scenario, samples=10, **wrong)
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


@pytest.mark.parametrize("offset_sd_s", [1e-4, 1e-3, 4e-3])
def test_offsets_much_nearer_than_a_tick_of_travel(offset_sd_s: float) -> None:
    """The offset's density is resolved where it changes within a panel: against an average over fixed offsets."""
    scenario = control_group(contact__offset_sd_s=offset_sd_s)
    result = bs.evaluate(scenario)
    np.testing.assert_allclose(figures(result), figures(bs.evaluate(scenario, refinement=2)), rtol=1e-9, atol=1e-12)
    node, weight = np.polynomial.legendre.leggauss(60)
    z, weight = 3.5 * (node + 1), 3.5 * weight
    weight = weight * np.exp(-z * z / 2)
    means = [
        bs.evaluate(
            control_group(contact__offset_law="fixed", contact__offset_mm=float(offset_sd_s * 50 * at))
        ).peak_force.mean
        for at in z
    ]
    # The average crosses panels without stopping at their ends, where the distribution has kinks.
    assert result.peak_force.mean == pytest.approx(float(weight @ means / weight.sum()), rel=1e-4)


def test_probabilities_of_a_motion_that_ends_early_add_up() -> None:
    """Most of the offset's density lies beyond a joint limit, in one wide panel that only a stopping path reaches."""
    scenario = control_group(
        pose_deg=[0, 109.97, 0, -20, 0, -40, 0],
        motion__velocity_mm_s=[0, 0, -30],
        detector__noise_sd_Nm=[8, 4.5, 8, 8, 8, 8, 8],
        contact__offset_sd_s=0.3,
        reaction__latency_s=0.05,
    )
    result = bs.evaluate(scenario)
    assert result.curve.end == "joint_limit"
    kernel = result.integral
    assert result.no_contact_probability > 0.7
    # The arm comes to rest there: what it does not detect has a force.
    assert kernel.rests
    assert kernel.total("peak_force") + kernel.zero_force == pytest.approx(1, abs=1e-12)


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
    assert_max_distance_is_that_of_each_reaction(bs.Scenario.from_dict(settings))


def test_no_leap_passes_over_two_singularities_in_a_row() -> None:
    """Four milliseconds apart, with rates slowed to a velocity limit: the arm looks the same before and after both."""
    assert_max_distance_is_that_of_each_reaction(
        control_group(
            pose_deg=[-3.025, -58.43, -147.015, 56.138, 112.724, 10.634, 0],
            motion__velocity_mm_s=[-5.68, 26.65, 16.98],
        )
    )


def assert_max_distance_is_that_of_each_reaction(scenario: bs.Scenario) -> None:
    problem = bs.CollisionProblem.from_scenario(scenario)
    curve = bs.stopping_curve(problem)
    ticks = list(range(len(curve.max_distance)))
    there = [float(curve.distance[problem.period_steps * k + 1]) for k in ticks]
    expected = [path.max() for path in curve.kernel.reaction_paths(ticks, there)]
    np.testing.assert_allclose(curve.max_distance, expected, rtol=0, atol=5e-9)
