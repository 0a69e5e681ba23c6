"""Arms that cannot follow their line any farther: they brake, and more latency makes no collision weaker."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from collision.cases import control_group, reference_settings
from reference import simulate, tick_count

# Joint 2 is 10 ms from its limit at 250 mm/s.
NEAR_LIMIT: dict[str, Any] = {
    "pose_deg": [0, 109.5, 0, -20, 0, -40, 0],
    "motion__velocity_mm_s": [0, 0, -250],
    "contact__offset_law": "uniform",
}

# Beside a singularity this arm never goes back.
NEVER_TURNS: dict[str, Any] = {
    "robot": "sia5d",
    "pose_rad": [
        1.1626517719882017, 1.0304149573875554, -0.38000399416909003, 1.0442252804970655, 1.304027774136598,
        0.827760297114783, 0.0,
    ],
    "motion": {
        "velocity_mm_s": [-210.98269585072026, 255.6855384998124, 353.34691738948123],
        "held_joints": [7],
        "duration_s": 0.3,
    },
    "contact": {"stiffness_N_m": 75_000.0},
    "detector": {"thresholds_Nm": [1e6] * 7, "noise_sd_Nm": 1.0, "feedback_period_s": 0.02},
    "reaction": {"joint_acceleration_rad_s2": 12.814053961487861},
}  # fmt: skip


@pytest.mark.parametrize("kind", ["reverse", "stop"])
def test_more_latency_makes_no_collision_weaker_at_a_joint_limit(kind: str) -> None:
    forces, shares = [], []
    for latency in (0, 0.004, 0.008, 0.02, 0.1):
        result = bs.evaluate(control_group(**NEAR_LIMIT, reaction__kind=kind, reaction__latency_s=latency))
        assert result.curve.end == "joint_limit"
        forces.append(result.peak_force.mean)
        shares.append(result.verdict.p_over_force)
        drawn = bs.evaluate(result.scenario, samples=4000, seed=1)
        assert drawn.peak_force.mean == pytest.approx(
            result.peak_force.mean, abs=5 * result.peak_force.sd / math.sqrt(4000)
        )
    assert np.diff(forces).min() > -1e-6
    assert np.diff(np.asarray(shares, dtype=float)).min() > -1e-12
    assert any("brakes at its acceleration limits; no reaction begins" in note for note in result.notes)
    assert any("joint 2 reaches its limit, after" in note for note in result.notes)
    assert "brakes at its acceleration limits; no reaction begins" in " ".join(str(result).split())


@pytest.mark.parametrize("latency", [0.0, 0.012])
def test_an_arm_that_brakes_goes_as_far_as_the_reference_simulator(latency: float) -> None:
    scenario = control_group(**NEAR_LIMIT, reaction__latency_s=latency)
    result = bs.evaluate(scenario)
    curve = result.curve
    robot = result.problem.robot
    settings = replace(reference_settings(scenario), min_position=robot.lower, max_position=robot.upper, duration_s=0.4)
    noise = np.zeros((curve.ticks, tick_count(settings), robot.dof))
    noise[np.arange(curve.ticks), np.arange(curve.ticks)] = 1e9
    travel = []
    for latency_steps in range(settings.latency_steps + 1):  # or sooner
        runs = simulate(replace(settings, latency_steps=latency_steps), np.full(curve.ticks, math.inf), noise)
        np.testing.assert_array_equal(runs.detection_tick, np.arange(curve.ticks))
        travel.append(runs.max_travel_m)
    np.testing.assert_allclose(curve.max_distance, np.max(travel, axis=0), atol=1e-9)
    # Undetected it comes to rest where the reference simulator does.
    undetected = replace(settings, thresholds_Nm=math.inf)
    body = simulate(undetected, np.zeros(1), None)
    assert body.force_at_end_N[0] == pytest.approx(result.problem.stiffness * curve.line.braking[-1], rel=1e-9)


def test_a_body_reached_only_while_the_arm_brakes_is_hit() -> None:
    """Exact, sampled and batch: it stands 2 mm beyond the place where the line ends."""
    reach = bs.evaluate(control_group(**NEAR_LIMIT)).curve.distance.max()
    scenario = control_group(
        **NEAR_LIMIT | {"contact__offset_law": "fixed"}, contact__offset_mm=float(reach) * 1e3 + 2
    )  # fmt: skip
    result = bs.evaluate(scenario)
    force = result.problem.stiffness * (result.curve.line.braking.max() - reach - 2e-3)
    assert force > 100
    assert result.no_contact_probability == pytest.approx(1, abs=1e-6)
    assert result.peak_force.quantile(0.5) == pytest.approx(force, rel=1e-9)
    assert result.verdict.acceptable is False
    assert bs.evaluate(scenario, samples=50, seed=1).peak_force.quantile(0.5) == pytest.approx(force, rel=1e-9)
    batch = bs.evaluate_batch(scenario, result.problem.q[None], result.problem.velocity[None], probabilities=[0.5])
    assert batch.mean[0] == pytest.approx(result.peak_force.mean, rel=1e-6)


@pytest.mark.parametrize(("robot", "limit"), [("sia5d", 4.5), ("ur10e", 10.0), ("panda", 8.0)])
def test_lines_that_end_within_the_latency_turn_no_verdict(robot: str, limit: float) -> None:
    """Random poses close to a limit. A reaction that is not due where the line ends counts as far as the arm brakes."""
    arm, rng = bs.Robot.load(robot), np.random.default_rng(11)
    low, high = np.maximum(arm.lower, -3.1), np.minimum(arm.upper, 3.1)
    q = rng.uniform(low, high, size=(120, arm.dof))
    joint = rng.integers(0, arm.dof, size=len(q))
    rows = np.arange(len(q))
    q[rows, joint] = high[joint] - rng.uniform(0, 0.02, size=len(q))
    velocity = rng.normal(size=(len(q), 3))
    velocity *= 0.25 / np.linalg.norm(velocity, axis=1)[:, None]
    settings = {
        "robot": robot, "pose_rad": q[0].tolist(), "motion": {"velocity_mm_s": (velocity[0] * 1e3).tolist()},
        "contact": {"stiffness_N_m": 75_000.0, "offset_law": "half_normal", "offset_sd_s": 0.02},
        "detector": {"thresholds_Nm": [20.0] * arm.dof, "noise_sd_Nm": 3.0},
        "reaction": {"kind": "stop", "joint_acceleration_rad_s2": limit},
    }  # fmt: skip
    laws = []
    for latency in (0.0, 0.2):
        settings["reaction"] |= {"latency_s": latency}
        laws.append(bs.evaluate_batch(bs.Scenario.from_dict(settings), q, velocity, limits_N=[135.0, 400.0]))
    none, late = laws
    ended = (none.end == "joint_limit") | (none.end == "singularity")
    assert ended.any()
    np.testing.assert_array_equal(none.end, late.end)
    less = none.exceedance - late.exceedance
    assert less[ended].max() < 1e-3


def test_a_reaction_that_never_turns_back_keeps_its_farthest_point() -> None:
    """Left at its longest time, it is as far as all of its steps say: the last of them count."""
    scenario = bs.Scenario.from_dict(NEVER_TURNS)
    curve = bs.stopping_curve(bs.CollisionProblem.from_scenario(scenario), whole=True)
    ticks = list(range(curve.ticks))
    every = [float(path.max()) for path in curve.kernel.reaction_paths(ticks, [-1e9] * len(ticks))]
    np.testing.assert_allclose(np.maximum(every, curve.tick_distance), curve.max_distance, rtol=1e-7)


@pytest.mark.parametrize("latency", [0.008, 0.010, 0.050])
def test_a_reaction_sooner_than_the_latency_counts_where_it_takes_the_arm_farther(latency: float) -> None:
    """Moving away from singularities, arms get farther the sooner they react."""
    arm, rng = bs.Robot.load("ur10e"), np.random.default_rng(1)
    q = rng.uniform(-3, 3, size=(200, arm.dof))
    velocity = rng.normal(size=(len(q), 3))
    velocity *= 0.25 / np.linalg.norm(velocity, axis=1)[:, None]
    settings: dict[str, Any] = {
        "robot": "ur10e", "pose_rad": q[0].tolist(), "motion": {"velocity_mm_s": (velocity[0] * 1e3).tolist()},
        "contact": {"stiffness_N_m": 75_000.0},
        "detector": {"thresholds_Nm": [40, 40, 30, 12, 12, 12], "noise_sd_Nm": [7, 7, 5, 2, 2, 2]},
        "reaction": {"joint_acceleration_rad_s2": 10.0, "latency_s": 0.0},
    }  # fmt: skip
    none = bs.evaluate_batch(bs.Scenario.from_dict(settings), q, velocity, limits_N=[135.0])
    settings["reaction"]["latency_s"] = latency
    late = bs.evaluate_batch(bs.Scenario.from_dict(settings), q, velocity, limits_N=[135.0])
    assert np.nanmax(none.exceedance - late.exceedance) < 1e-4
    assert np.nanmax(none.mean / late.mean) < 1 + 1e-4


# Its reactions reach 8 % farther in one step of a feedback period than in another.
UNEVEN: dict[str, Any] = {
    "robot": "ur10e",
    "pose_rad": [
        -2.3952334764872987, -0.6743852189268953, 0.10378913225245467, -0.43010627343209773, 0.5381511429164725,
        1.474594281211393,
    ],
    "motion": {"velocity_mm_s": [-146.97091437600375, 181.24815073225867, -89.71431426265158]},
    "contact": {"stiffness_N_m": 75_000.0},
    "detector": {"thresholds_Nm": [20.0] * 6, "noise_sd_Nm": 3.6},
    "reaction": {"joint_acceleration_rad_s2": 4.5},
}  # fmt: skip


@pytest.mark.parametrize("case", ["uneven", "near a limit"])
def test_no_latency_is_milder_than_a_shorter_one_whatever_the_feedback_period(case: str) -> None:
    """Every whole step of latency, not only whole feedback periods: what is looked at does not depend on it."""
    scenario = bs.Scenario.from_dict(UNEVEN) if case == "uneven" else control_group(**NEAR_LIMIT)
    latencies = [*range(28), 50, 99, 100, 101]
    late = [scenario.with_values({"reaction.latency_s": 1e-3 * steps}) for steps in latencies]
    results = [bs.evaluate(each) for each in late]
    forces = np.array([[result.peak_force.mean, result.peak_force.quantile(0.999)] for result in results])
    assert (np.diff(forces, axis=0) > -1e-7 * forces[:-1]).all()
    assert forces[-1].min() > forces[0].min()
    problem = results[0].problem
    batches = [bs.evaluate_batch(each, problem.q[None], problem.velocity[None]).mean[0] for each in late[:28:9]]
    np.testing.assert_allclose(batches, forces[:28:9, 0], rtol=1e-5)


@pytest.mark.parametrize(
    "gives", [{"arm__model": "elastic"}, {"contact__kind": "free", "contact__body_mass_kg": 2.0}], ids=["arm", "body"]
)
def test_an_arm_that_brakes_before_the_first_tick_is_followed_to_its_rest(gives: dict[str, Any]) -> None:
    """At its limits it cannot follow the line at all: nothing is detected, in both distributions."""
    scenario = control_group(
        pose_deg=[-180, 30, 0, -20, 110, -40, 0],
        motion__velocity_mm_s=[-191, 60, -196],
        motion__held_joints=[],
        **gives,
    )
    integrated, sampled = bs.evaluate(scenario), bs.evaluate(scenario, samples=2000, seed=1)
    assert integrated.curve.line.ticks == 0
    assert sampled.runs is not None
    assert (sampled.runs["tick"] < 0).all()
    assert sampled.peak_force.mean == pytest.approx(integrated.peak_force.mean, rel=0.05, abs=1e-12)
