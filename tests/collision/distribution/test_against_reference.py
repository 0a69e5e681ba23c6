"""Both distributions against the reference simulator, which simulates every collision step by step with code of its
own."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

import bumpstop as bs
from bumpstop import _native
from collision.cases import VARIED, control_group, reference_settings
from reference import half_normal_offsets, simulate, simulate_seeded, tick_count, trace

# The reference simulator takes a fraction of a second a hundred runs; what needs 10^6 runs is in the validation.
RUNS = 40


@pytest.mark.parametrize("name", list(VARIED))
def test_run_by_run(name: str) -> None:
    """With the same offsets and the same noise every single collision comes out the same."""
    scenario = VARIED[name]
    problem = bs.CollisionProblem.from_scenario(scenario)
    settings = reference_settings(scenario)
    result = bs.evaluate(scenario, samples=RUNS, seed=5)
    assert result.runs is not None
    offset, tick = result.runs["offset"], result.runs["tick"]
    # Enough for the slowest detection; the reference simulator's motion is cut to it, to spare the noise of ticks
    # nobody reaches.
    ticks = int(tick.max()) + 2
    settings = replace(settings, duration_s=ticks * settings.period_steps * settings.step_s)
    noise = _native.standard_noise(5, 0, RUNS, ticks, problem.robot.dof) * problem.noise_sd + problem.noise_mean
    detected = tick >= 0
    runs = simulate(settings, offset[detected], noise[detected])
    np.testing.assert_array_equal(runs.detection_tick, tick[detected])
    np.testing.assert_array_equal(runs.trigger_mask, result.runs["triggers"][detected])
    np.testing.assert_allclose(runs.noise_at_detection_Nm, result.runs["noise"][detected], rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(runs.residual_at_detection_Nm, result.runs["residual"][detected], rtol=1e-8, atol=1e-6)
    # 1e-9 m of the stopping curve, as newtons of this body.
    tolerance = 1e-9 * problem.stiffness
    np.testing.assert_allclose(runs.max_force_N, result.runs["peak_force"][detected], atol=tolerance)
    np.testing.assert_allclose(runs.force_at_detection_N, result.runs["force_at_detection"][detected], atol=tolerance)


@pytest.mark.parametrize("name", list(VARIED))
def test_path_and_torques(name: str) -> None:
    """Leaps of many sub-steps land where the sub-steps do."""
    assert_same_path(VARIED[name])


@pytest.mark.parametrize("latency_s", [0, 0.001, 0.002, 0.011])
def test_leaps_keep_acceleration_limits(latency_s: float) -> None:
    """Near a singularity the line soon asks for more than the joints' accelerations, as smoothly as for less. The
    latency says how short leaps are, and short ones follow the line however hard it is."""
    assert_same_path(
        control_group(
            pose_deg=[-2.96, 11.705, -133.871, 87.197, -79.669, -11.633, 0],
            motion__velocity_mm_s=[10.17, -14.52, -19.14],
            reaction__kind="stop",
            reaction__latency_s=latency_s,
        )
    )


def test_reactions_come_forward_again_beside_a_singularity() -> None:
    """The point swings back behind where it was and then farther forward than it ever came, in the time that the
    reference simulator follows it."""
    scenario = bs.Scenario.from_dict(
        {
            "robot": "panda",
            "pose_rad": [-1.7521, 0.5671, -1.9873, -0.4124, -0.9738, 2.5927, -0.019],
            "motion": {"velocity_mm_s": [-230, -53, 204], "duration_s": 0.7},
            "contact": {"stiffness_N_m": 30000.0},
            "detector": {"thresholds_Nm": [1e6] * 7, "noise_sd_Nm": 1.0, "feedback_period_s": 0.008},
            "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 23.5, "latency_s": 0.024},
            "simulation": {"step_s": 0.002, "substeps": 7},
        }
    )
    curve = bs.stopping_curve(bs.CollisionProblem.from_scenario(scenario), whole=True)
    settings = reference_settings(scenario)
    ticks = range(50, 80)
    noise = np.zeros((len(ticks), tick_count(settings), 7))
    noise[np.arange(len(ticks)), ticks] = 1e9
    runs = simulate(settings, np.full(len(ticks), math.inf), noise)
    np.testing.assert_array_equal(runs.detection_tick, ticks)
    # What the singularity makes of roundings is less than 1e-6 m; ours may be followed longer.
    assert (curve.max_distance[ticks] - runs.max_travel_m).min() > -1e-6


def assert_same_path(scenario: bs.Scenario) -> None:
    curve = bs.stopping_curve(bs.CollisionProblem.from_scenario(scenario))
    settings = reference_settings(
        scenario, thresholds_Nm=np.full(len(reference_settings(scenario).thresholds_Nm), math.inf)
    )
    steps = curve.distance.size - 1
    path = trace(replace(settings, duration_s=steps * settings.step_s), math.inf)
    # The reference simulator's first entry is the end of its first step or the start: align by length.
    travel = np.asarray(path.travel_m)
    ours = curve.distance[1:] if travel.size == steps else curve.distance[: travel.size]
    np.testing.assert_allclose(ours, travel, atol=1e-9)
    np.testing.assert_allclose(curve.normal, path.normal, atol=1e-12)


def test_statistics_of_noise_drawn_by_the_reference_simulator_itself() -> None:
    scenario = control_group(motion__velocity_mm_s=[0, 0, -75])
    rng = np.random.default_rng(8)
    settings = reference_settings(scenario, noise_sd_Nm=bs.CollisionProblem.from_scenario(scenario).noise_sd)
    runs = simulate_seeded(settings, half_normal_offsets(settings, 400, rng), seed=3)
    result = bs.evaluate(scenario)
    assert runs.max_force_N.mean() == pytest.approx(
        result.peak_force.mean, abs=4 * result.peak_force.sd / math.sqrt(400)
    )


def test_one_plane_is_the_walls_where_the_motion_is_along_an_axis_and_differs_where_it_is_oblique() -> None:
    """Schroeder's three walls bend the force of an oblique motion; one plane is the physical model."""
    for velocity, same in (([0, 0, -50], True), ([40, 0, -50], False)):
        scenario = control_group(motion__velocity_mm_s=velocity, detector__noise_sd_Nm=0.0)
        settings = reference_settings(scenario)
        plane = simulate(settings, np.array([2e-3]), None)
        direction = np.abs(np.array(velocity)) / np.linalg.norm(velocity)
        # A wall across every axis, where the plane's contact point lies; none across an axis without motion.
        walls = np.where(direction > 0, 2e-3 * direction, 1.0)[None]
        literal = simulate(replace(settings, per_axis_walls=True), walls, None)
        ours = bs.evaluate(
            scenario.with_values({"contact.offset_law": "fixed", "contact.offset_mm": 2.0})
        ).peak_force.quantile(0.5)
        assert plane.max_force_N[0] == pytest.approx(ours, rel=1e-6)
        assert (literal.max_force_N[0] == pytest.approx(ours, rel=1e-6)) == same
