"""Arms of several joints, contact on any link, walls across the axes, and the run-length slip."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from reference import (
    Joint,
    ReferenceSettings,
    forward_kinematics,
    half_normal_offsets,
    jacobian,
    simulate,
    simulate_seeded,
    tick_count,
    trace,
)
from reference.cases import SPEED, THRESHOLDS_NM, assert_same_runs, sia5d


def gantry(velocity_m_s, **changes) -> ReferenceSettings:
    """Three slides along x, y, z."""
    settings = ReferenceSettings(
        joints=[Joint("prismatic", (0, 0, 0), axis) for axis in np.eye(3)],
        start_position=(0, 0, 0),
        velocity_m_s=velocity_m_s,
        task="position",
        duration_s=1.0,
        stiffness_N_m=1000.0,
        thresholds_Nm=1.0,
        max_acceleration=2.0,
    )
    return replace(settings, **changes)


def test_the_slowest_joint_sets_the_ratio_for_all():
    settings = gantry((0.1, 0.1, 0), max_acceleration=(2.0, 1.0, 5.0), reaction="stop")
    run = trace(settings, 0.01)
    np.testing.assert_allclose(run.position[:, 0], run.position[:, 1], atol=1e-15)  # a straight line
    falling = np.diff(run.velocity[:, 0])
    assert falling.min() == pytest.approx(-1.0 * 0.001, rel=1e-9)


def test_the_run_goes_on_until_the_fastest_joint_could_have_stopped():
    runs = simulate(gantry((0.05, -0.1, 0.02), max_acceleration=(1.0, 2.0, 0.5)), [0.01])
    # 50 ms and one and a half times 0.1 / 2 s; a step that begins just then is the last.
    assert runs.end_time_s[0] - runs.detection_time_s[0] == pytest.approx(0.050 + 0.075 + 0.001)


def test_speed_limit_scales_all_joints():
    run = trace(gantry((0.1, -0.05, 0), max_speed=(0.04, np.inf, np.inf), thresholds_Nm=np.inf), np.inf)
    np.testing.assert_allclose(run.velocity, [[0.04, -0.02, 0]] * len(run.time_s), rtol=1e-12)


def test_redundant_arms_move_with_the_smallest_rates():
    settings = sia5d((0.02, 0.03, -0.05), held_joints=(), thresholds_Nm=np.inf, duration_s=0.02)
    run = trace(settings, np.inf)
    wanted = [0.02, 0.03, -0.05, 0, 0, 0]
    before = np.vstack([settings.start_position, run.position[:-1]])
    for q, qd in zip(before, run.velocity, strict=True):
        # The velocities belong to the last sub-step's start, 0.8 ms after the step's.
        expected = np.linalg.pinv(jacobian(settings, q + 0.0008 * qd)) @ wanted
        np.testing.assert_allclose(qd, expected, atol=1e-7)


def test_motion_follows_the_straight_line_with_its_orientation():
    settings = sia5d((0, 0.03, -0.04), thresholds_Nm=np.inf, duration_s=0.5)
    run = trace(settings, np.inf)
    rotation, start = forward_kinematics(settings, settings.start_position)
    line = start + np.outer(run.time_s, settings.velocity_m_s)
    # First-order integration at 0.2 ms of a path of 25 mm: errors of second order in joint steps of 2e-5 rad.
    np.testing.assert_allclose(run.point_m, line, atol=2e-6)
    np.testing.assert_allclose(forward_kinematics(settings, run.position[-1])[0], rotation, atol=5e-6)
    assert np.all(run.position[:, 6] == 0)


def test_lateral_deceleration_depends_on_holding_joint_7():
    # 0.8 m/s^2 with joint 7 held, 1.8 m/s^2 with it free.
    for held, expected in (((6,), 0.8), ((), 1.8)):
        settings = sia5d((0, 0.05, 0), held_joints=held, noise_sd_Nm=0)
        run = trace(settings, 0.0)
        before = round(run.run.detection_time_s[0] / 0.001) - 1
        speed = [jacobian(settings, run.position[i])[1] @ run.velocity[i] for i in (before, before + 10)]
        assert (speed[0] - speed[1]) / 0.010 == pytest.approx(expected, abs=0.05)


def test_a_surface_may_stand_askew_to_the_motion():
    settings = gantry((0.1, 0, -0.05), normal=(0, 0, -2), thresholds_Nm=np.inf)
    run = trace(settings, 0.01)
    np.testing.assert_allclose(run.travel_m, 0.05 * run.time_s, atol=1e-14)
    np.testing.assert_allclose(run.contact_torque_Nm[-1], [0, 0, -1000 * (0.05 - 0.01)], atol=1e-9)
    assert run.run.contact_start_s[0] == pytest.approx(0.2)


def test_contact_on_another_link():
    # A point of the forearm: joints 5 to 7 do not move it, and it is not going straight.
    link, point = 3, (0.2, 0.0, 0.05)
    settings = sia5d((0, 0, -0.1), contact_link=link, contact_point_m=point, noise_sd_Nm=0)
    run = trace(settings, 0.002)
    linear = jacobian(settings, settings.start_position, link, point)[:3]
    task = jacobian(settings, settings.start_position)[:, :6]
    direction = linear[:, :6] @ np.linalg.solve(task, [0, 0, -0.1, 0, 0, 0])
    np.testing.assert_allclose(run.normal, direction / np.linalg.norm(direction), atol=1e-12)
    for i in (0, 30, len(run.time_s) - 1):
        _, place = forward_kinematics(settings, run.position[i], link, point)
        np.testing.assert_allclose(run.point_m[i], place, atol=1e-13)
        s = (place - run.start_point_m) @ run.normal
        assert run.travel_m[i] == pytest.approx(s, abs=1e-13)
        torque = jacobian(settings, run.position[i], link, point)[:3].T @ run.normal * run.force_N[i]
        np.testing.assert_allclose(run.contact_torque_Nm[i], torque, atol=1e-9)
    assert np.all(run.contact_torque_Nm[:, 4:] == 0)
    assert run.run.detected[0]


def test_a_contact_point_that_does_not_move_needs_a_normal():
    settings = sia5d((0, 0, -0.1), contact_link=0)
    with pytest.raises(ValueError, match="normal"):
        simulate(settings, [0.0])
    assert not simulate(replace(settings, normal=(0, 0, 2), duration_s=0.05), [0.01]).detected[0]


def test_trace_tells_the_same_story_as_simulate():
    settings = sia5d((0, 0, -0.075))
    rng = np.random.default_rng(2)
    noise = rng.normal(size=(1, tick_count(settings), 7)) * THRESHOLDS_NM / 5.5
    runs = simulate(settings, [0.004], noise)
    run = trace(settings, 0.004, noise[0])
    assert_same_runs(run.run, runs)
    tick = runs.detection_tick[0]
    assert run.force_N[4 * tick :].max() == runs.max_force_N[0]
    np.testing.assert_array_equal(run.residual_Nm[4 * tick], runs.residual_at_detection_Nm[0])
    np.testing.assert_array_equal(run.residual_Nm[0], run.contact_torque_Nm[0] + noise[0, 0])
    assert np.all(np.isnan(run.residual_Nm[1:4]))


@pytest.mark.parametrize("axis", [1, 2])
def test_walls_equal_the_plane_for_motion_along_one_axis(axis):
    # Stopping instead of reversing, so that the mirrored walls are never reached.
    velocity = np.zeros(3)
    velocity[axis] = 0.05
    for direction in (1, -1):
        plane = sia5d(direction * velocity, reaction="stop")
        walls = replace(plane, per_axis_walls=True)
        offset = half_normal_offsets(plane, 5, np.random.default_rng(axis))
        noise = np.random.default_rng(axis).normal(size=(5, tick_count(plane), 7)) * THRESHOLDS_NM / 5.5
        # The walls' force is positive whichever way the arm moves. Towards minus that turns the contact
        # torque around, and the noise has to be turned with it to give the same detections.
        expected = simulate(plane, offset, noise)
        found = simulate(walls, np.repeat(offset[:, np.newaxis], 3, axis=1), direction * noise)
        turned_back = replace(
            found,
            residual_at_detection_Nm=direction * found.residual_at_detection_Nm,
            noise_at_detection_Nm=direction * found.noise_at_detection_Nm,
        )
        assert expected.detected.all()
        # Equal but for rounding, which in a force is stiffness times that of a position: 75 kN/m x 1e-15 m.
        assert_same_runs(turned_back, expected, tolerance=1e-9)


def test_each_wall_pushes_for_itself_and_always_positively():
    settings = gantry((0.1, -0.05, 0), per_axis_walls=True, reaction="stop", thresholds_Nm=(5.0, np.inf, 5.0))
    run = trace(settings, (0.01, 0.002, 0.0))
    # The first tick past x = 15 mm is number 38, after 153 steps: (15.3, -7.65) mm.
    step = 4 * 38
    assert run.run.detection_tick[0] == 38
    np.testing.assert_allclose(run.contact_torque_Nm[step], [5.3, 5.65, 0], atol=1e-9)
    assert run.force_N[step] == pytest.approx(math.hypot(5.3, 5.65), abs=1e-9)
    # x falls from 0.1 m/s at 2 m/s^2, y half as fast: a straight line of 2.49 mm by 1.245 mm more.
    np.testing.assert_allclose(run.run.max_force_axis_N[0], [7.79, 6.895, 0], atol=1e-9)
    np.testing.assert_allclose(run.run.max_deflection_axis_m[0], [7.79e-3, 6.895e-3, 0], atol=1e-12)


def test_mirrored_walls_hit_an_arm_that_reverses_past_its_start():
    # A false alarm at once: from s = 0.1 mm the slide goes 1.24 mm further, short of the surface at 2 mm.
    # After 250 sub-steps it moves back at full speed, 0.02 mm behind the place of the alarm. The run has 88
    # steps more than the tick's own, that is 190 such sub-steps of 0.02 mm: it ends at s = -3.72 mm.
    settings = gantry((SPEED, 0, 0), per_axis_walls=True, max_acceleration=4.0)
    offset = 0.002
    noise = np.zeros((1, tick_count(settings), 3))
    noise[0, 0, 0] = 2.0
    mirrored = simulate(settings, [[offset, 0, 0]], noise)
    honest = simulate(replace(settings, mirrored_walls=False), [[offset, 0, 0]], noise)
    plane = simulate(replace(settings, per_axis_walls=False), [offset], noise)
    for runs in (mirrored, honest, plane):
        assert runs.detection_tick[0] == 0
        assert runs.end_time_s[0] == pytest.approx(0.089)
        # Schroeder's deflection counts the distance from the wall on either side.
        assert runs.max_deflection_m[0] == pytest.approx(0.00372 + offset, abs=1e-12)
    assert plane.max_force_N[0] == 0
    assert honest.max_force_N[0] == 0
    assert mirrored.max_force_N[0] == pytest.approx(1000 * (0.00372 + offset), abs=1e-9)


def test_run_length_slip_only_ever_shortens():
    rng = np.random.default_rng(8)
    shorter = 0
    for _ in range(10):
        direction = rng.normal(size=3)
        plain = sia5d(0.05 * direction / np.linalg.norm(direction))
        offsets = half_normal_offsets(plain, 2, rng)
        honest = simulate_seeded(plain, offsets, seed=4)
        slipped = simulate_seeded(replace(plain, run_length_slip=True), offsets, seed=4)
        np.testing.assert_array_equal(slipped.detection_tick, honest.detection_tick)
        assert np.all(slipped.end_time_s <= honest.end_time_s)
        assert np.all(slipped.end_time_s >= slipped.detection_time_s)
        assert np.all(slipped.max_force_N <= honest.max_force_N)
        shorter += np.count_nonzero(slipped.end_time_s < honest.end_time_s)
    assert shorter > 0
