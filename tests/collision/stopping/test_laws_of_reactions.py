"""Laws of slowing down in reactions: against the reference simulator, and against what they must be in the limit."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop import _native
from collision.cases import control_group, reference_settings, ur10e
from reference import simulate

RUNS = 30
LAWS: dict[str, dict[str, Any]] = {
    "constant time": {"reaction__deceleration": "constant_time", "reaction__stopping_time_s": 0.15},
    "constant time, quick": {"reaction__deceleration": "constant_time", "reaction__stopping_time_s": 0.0137},
    "ramp": {"reaction__deceleration": "ramp", "reaction__ramp_time_s": 0.04},
    "ramp longer than the stop": {"reaction__deceleration": "ramp", "reaction__ramp_time_s": 0.5},
    "ramp with dead time": {
        "reaction__deceleration": "ramp",
        "reaction__ramp_time_s": 0.021,
        "reaction__dead_time_s": 0.013,
    },
}
BRAKES = {
    "brakes": {"reaction__stop_category": 0},
    "brakes that bite late": {"reaction__stop_category": 0} | LAWS["ramp"],
}
ARMS: dict[str, dict[str, Any]] = {
    "hand below": {},
    "fast and soft": {
        "motion__velocity_mm_s": [60, -100, -120],
        "contact__stiffness_N_m": 12000,
        "contact__body": "upper_arm_elbow",
    },
    "seven joints, elbow hit": {
        "motion__held_joints": [],
        "motion__velocity_mm_s": [0, 120, 0],
        "contact__link": "link_u",
        "contact__point_m": [0.1, 0.0, 0.05],
        "contact__stiffness_N_m": 30000,
    },
    "from rest": {"motion__start": "rest", "contact__offset_law": "fixed", "contact__offset_mm": 3.3},
    "limits by joint, one sub-step": {
        "reaction__joint_acceleration_rad_s2": [4.5, 2.0, 9.0, 3.0, 5.0, 2.5, 4.5],
        "simulation__substeps": 1,
        "motion__velocity_mm_s": [20, 30, -60],
    },
    "coarse steps, latency": {
        "simulation__step_s": 0.004,
        "simulation__substeps": 2,
        "reaction__latency_s": 0.011,
        "detector__feedback_period_s": 0.008,
    },
    "ends at a joint limit": {
        "pose_deg": [0, 109.7, 0, -20, 0, -40, 0],
        "motion__velocity_mm_s": [0, 0, -30],
        "detector__noise_sd_Nm": 3.0,
    },
}


def assert_as_reference(scenario: bs.Scenario) -> None:
    """With the same offsets and noise every collision comes out the same."""
    problem = bs.CollisionProblem.from_scenario(scenario)
    law = bs.evaluate(scenario, samples=RUNS, seed=5)
    assert law.runs is not None
    tick = law.runs["tick"]
    noise = _native.standard_noise(5, 0, RUNS, int(tick.max()) + 2, problem.robot.dof)
    noise = noise * problem.noise_sd + problem.noise_mean
    detected = tick >= 0
    assert detected.sum() > 2
    ticks = int(tick.max()) + 2
    settings = reference_settings(scenario, duration_s=ticks * problem.period_steps * scenario.simulation.step_s)
    runs = simulate(settings, law.runs["offset"][detected], noise[detected])
    np.testing.assert_array_equal(runs.detection_tick, tick[detected])
    np.testing.assert_allclose(runs.max_force_N, law.runs["peak_force"][detected], atol=1e-9 * problem.stiffness)


@pytest.mark.parametrize(
    ("law", "arm"),
    [
        (law, arm)
        for law in LAWS
        for arm in ARMS
        if law in ("constant time", "ramp") or arm in ("hand below", "from rest")
    ],
)
@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_every_run_is_that_of_the_reference_simulator(law: str, kind: str, arm: str) -> None:
    assert_as_reference(control_group(**ARMS[arm] | LAWS[law] | {"reaction__kind": kind}))


@pytest.mark.parametrize("arm", ARMS)
@pytest.mark.parametrize("law", BRAKES)
def test_joints_that_brake_by_themselves(law: str, arm: str) -> None:
    assert_as_reference(control_group(**ARMS[arm] | BRAKES[law] | {"reaction__kind": "stop"}))


@pytest.mark.parametrize("kind", ["stop", "reverse"])
@pytest.mark.parametrize("law", LAWS)
def test_integrated_and_drawn_agree(law: str, kind: str) -> None:
    scenario = ur10e(**LAWS[law] | {"reaction__kind": kind})
    integrated, drawn = bs.evaluate(scenario), bs.evaluate(scenario, samples=200_000, seed=3)
    assert integrated.peak_force.mean == pytest.approx(
        drawn.peak_force.mean, abs=4 * drawn.peak_force.sd / 200_000**0.5
    )
    for p in (0.5, 0.99):
        limit = integrated.peak_force.quantile(p)
        assert drawn.peak_force.exceedance(limit) == pytest.approx(1 - p, abs=4 * (p * (1 - p) / 200_000) ** 0.5)


def max_distance(scenario: bs.Scenario) -> np.ndarray:
    return bs.stopping_curve(bs.CollisionProblem.from_scenario(scenario), whole=True).max_distance


@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_a_brake_that_bites_at_once_has_constant_deceleration(kind: str) -> None:
    plain = control_group(reaction__kind=kind, motion__duration_s=0.4)
    at_once = plain.with_values({"reaction.deceleration": "ramp", "reaction.ramp_time_s": 0.0})
    np.testing.assert_array_equal(max_distance(at_once), max_distance(plain))
    # Shorter than half a sub-step, so that the first one has the whole limit, but by the other way through the code.
    soon = plain.with_values({"reaction.deceleration": "ramp", "reaction.ramp_time_s": 1e-4})
    np.testing.assert_allclose(max_distance(soon), max_distance(plain), rtol=0, atol=1e-12)


def test_constant_time_is_constant_deceleration_by_what_it_takes() -> None:
    """Where rates do not change on the way, a_j = |qd_j| / T for every joint stops in T."""
    plain = control_group(reaction__kind="stop", motion__duration_s=0.02, motion__velocity_mm_s=[0, 0, -50])
    problem = bs.CollisionProblem.from_scenario(plain)
    rate = np.abs(problem.start.qd)
    limits = np.maximum(rate / 0.2, 0.1)  # joints that nearly stand never decide
    timed = plain.with_values({"reaction.deceleration": "constant_time", "reaction.stopping_time_s": 0.2})
    limited = plain.with_values({"reaction.joint_acceleration_rad_s2": limits.tolist()})
    first = max_distance(timed)[0], max_distance(limited)[0]
    assert first[0] == pytest.approx(first[1], rel=2e-3)


@pytest.mark.parametrize("stop_s", [0.05, 0.3])
def test_the_distance_of_constant_time_is_half_of_speed_by_time(stop_s: float) -> None:
    """v T / 2, less half a sub-step, which begins with its new rates."""
    scenario = control_group(
        reaction__kind="stop",
        reaction__deceleration="constant_time",
        reaction__stopping_time_s=stop_s,
        motion__velocity_mm_s=[0, 0, -20],
        motion__duration_s=0.05,
    )
    problem = bs.CollisionProblem.from_scenario(scenario)
    curve = bs.stopping_curve(problem, whole=True)
    overtravel = curve.max_distance - curve.tick_distance
    assert overtravel == pytest.approx(0.02 * (stop_s - 0.0002) / 2, rel=2e-3)


@pytest.mark.parametrize("key", ["reaction.stopping_time_s", "reaction.ramp_time_s", "reaction.dead_time_s"])
def test_a_later_stop_is_never_less_conservative(key: str) -> None:
    law = {"reaction.stopping_time_s": "constant_time", "reaction.ramp_time_s": "ramp"}.get(key, "constant")
    scenario = control_group(motion__velocity_mm_s=[0, 0, -75])
    forces = [
        bs.evaluate(scenario.with_values({"reaction.deceleration": law, key: value})).peak_force.quantile(0.99)
        for value in (0.004, 0.02, 0.1, 0.3)
    ]
    assert np.all(np.diff(forces) > 0)


@pytest.mark.parametrize("law", ["constant time", "ramp", "ramp with dead time"])
def test_batches_know_the_law(law: str) -> None:
    scenario = ur10e(**LAWS[law])
    problem = bs.CollisionProblem.from_scenario(scenario)
    batch = bs.evaluate_batch(scenario, problem.q[None], problem.velocity[None])
    single = bs.evaluate(scenario)
    assert batch.mean[0] == pytest.approx(single.peak_force.mean, rel=1e-5)


def trajectory(folder: Path, **reaction: Any) -> bs.Scenario:
    root = Path(__file__).resolve().parents[3]
    scenario = bs.load_scenario(root / "examples" / "06_pick_and_place_trajectory.toml")
    return scenario.with_values({f"reaction.{key}": value for key, value in reaction.items()})


def test_along_a_trajectory_the_path_speed_falls_linearly(tmp_path: Path) -> None:
    from bumpstop.collision.trajectory.trajectory_curve import trajectory_kernel

    scenario = trajectory(tmp_path, kind="stop", deceleration="constant_time", stopping_time_s=0.25)
    kernel = trajectory_kernel(bs.CollisionProblem.from_scenario(scenario))
    u = np.asarray(kernel.reaction(200))
    step = scenario.simulation.step_s
    t = step * np.arange(251)
    h = step / scenario.simulation.substeps
    np.testing.assert_allclose(u[:251] - u[0], t - t * (t + h) / 0.5, atol=1e-12)
    assert len(u) == 251


@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_along_a_trajectory_a_ramp_brakes_by_its_share(tmp_path: Path, kind: str) -> None:
    """A short ramp is constant deceleration; a long one goes farther by half of it at full speed."""
    from bumpstop.collision.trajectory.trajectory_curve import trajectory_kernel

    reach = {}
    for ramp in (None, 1e-4, 0.1):
        law = {} if ramp is None else {"deceleration": "ramp", "ramp_time_s": ramp}
        kernel = trajectory_kernel(bs.CollisionProblem.from_scenario(trajectory(tmp_path, kind=kind, **law)))
        reach[ramp] = np.array([np.max(u) - u[0] for u in map(kernel.reaction, range(0, kernel.ticks, 20))])
    np.testing.assert_allclose(reach[1e-4], reach[None], rtol=0, atol=1e-12)
    later = reach[0.1] - reach[None]
    assert (later > -1e-12).all()
    assert 0.04 < later.max() < 0.051


@pytest.mark.parametrize(
    ("changes", "field", "problem"),
    [
        ({"deceleration": "constant_time"}, "reaction.stopping_time_s", "is missing"),
        ({"deceleration": "ramp"}, "reaction.ramp_time_s", "is missing"),
        ({"deceleration": "table"}, "reaction.stopping_table", "is missing"),
        ({"stopping_time_s": 0.3}, "reaction.stopping_time_s", "has no meaning"),
        (
            {"ramp_time_s": 0.3, "deceleration": "constant_time", "stopping_time_s": 1.0},
            "reaction.ramp_time_s",
            "has no",
        ),
        ({"payload_kg": 3.0}, "reaction.payload_kg", "has no meaning"),
        ({"stop_category": 1}, "reaction.stop_category", "takes the power"),
        ({"stop_category": 0}, "reaction.stop_category", "takes the power"),
        (
            {"kind": "stop", "stop_category": 0, "deceleration": "constant_time", "stopping_time_s": 0.3},
            "reaction.stop_category",
            "by brakes alone",
        ),
    ],
)
def test_keys_that_do_not_go_together(changes: dict[str, Any], field: str, problem: str) -> None:
    with pytest.raises(bs.InputError) as refused:
        control_group(**{f"reaction__{key}": value for key, value in changes.items()})
    assert refused.value.field == field
    assert problem in str(refused.value)
