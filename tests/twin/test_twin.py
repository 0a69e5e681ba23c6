"""The slow twin against what is known without it: closed forms, numpy, and the reference figures."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from twin import (
    Joint,
    TwinRuns,
    TwinSettings,
    build,
    forward_kinematics,
    half_normal_offsets,
    jacobian,
    pseudo_inverse,
    simulate,
    simulate_seeded,
    tick_count,
    trace,
)

EPS = np.finfo(np.float64).eps

# Yaskawa Motoman SIA5D, from its public URDF: origins in the parent joint's frame, all rotations zero.
SIA5D = tuple(
    Joint("revolute", origin_m, axis)
    for origin_m, axis in (
        ((0, 0, 0.310), (0, 0, 1)),
        ((0, 0, 0), (0, 1, 0)),
        ((0, 0, 0.270), (0, 0, 1)),
        ((0.085, 0, 0), (0, -1, 0)),
        ((0.270, 0, 0.060), (-1, 0, 0)),
        ((0, 0, 0), (0, -1, 0)),
        ((0.134, 0, 0), (-1, 0, 0)),
    )
)
THRESHOLDS_NM = np.array([20.0, 10, 20, 20, 20, 20, 20])


def sia5d(velocity_m_s, **changes) -> TwinSettings:
    """The tool points straight down, joint 7 does not move."""
    settings = TwinSettings(
        joints=SIA5D,
        tip_m=(0.011, 0, 0),
        held_joints=(6,),
        start_position=np.radians([0, 30, 0, -20, 0, -40, 0]),
        velocity_m_s=velocity_m_s,
        thresholds_Nm=THRESHOLDS_NM,
        noise_sd_Nm=THRESHOLDS_NM / 5.5,
        max_acceleration=4.5,
    )
    return replace(settings, **changes)


# A single slide along x: everything about it can be worked out on paper.
SPEED = 0.1
ACCELERATION = 2.0
SUBSTEP = 0.001 / 5


def slide(**changes) -> TwinSettings:
    settings = TwinSettings(
        joints=(Joint("prismatic", (0, 0, 0), (1, 0, 0)),),
        start_position=(0.3,),
        velocity_m_s=(SPEED, 0, 0),
        task="position",
        duration_s=0.5,
        stiffness_N_m=1000.0,
        thresholds_Nm=1.0,
        max_acceleration=ACCELERATION,
    )
    return replace(settings, **changes)


def travel_after_reaction(substeps: int) -> float:
    """How far the slide has gone since it began to reverse: its speed falls by a h a sub-step, down to -v."""
    turning = round(2 * SPEED / (ACCELERATION * SUBSTEP))
    m = min(substeps, turning)
    return SUBSTEP * (SPEED * m - ACCELERATION * SUBSTEP * m * (m + 1) / 2 - SPEED * (substeps - m))


def random_chain(rng: np.random.Generator, joints: int) -> TwinSettings:
    """A serial chain with both kinds of joint and rotated origins."""

    def rotation() -> np.ndarray:
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        return q * np.sign(np.linalg.det(q))

    return TwinSettings(
        joints=[
            Joint(
                "prismatic" if rng.random() < 0.3 else "revolute",
                rng.normal(size=3),
                rng.normal(size=3),
                rotation(),
            )
            for _ in range(joints)
        ],
        tip_m=rng.normal(size=3),
        start_position=rng.normal(size=joints),
        velocity_m_s=(0.1, 0, 0),
        thresholds_Nm=1.0,
        max_acceleration=1.0,
    )


def homogeneous(rotation: np.ndarray, translation: np.ndarray) -> np.ndarray:
    transform = np.eye(4)
    transform[:3, :3] = rotation
    transform[:3, 3] = translation
    return transform


def skew(u: np.ndarray) -> np.ndarray:
    return np.array([[0, -u[2], u[1]], [u[2], 0, -u[0]], [-u[1], u[0], 0]])


# --- Kinematics ---------------------------------------------------------------------------------------------


def test_tip_of_the_sia5d_is_where_its_drawings_say():
    settings = sia5d((0, 0, -0.05))
    _, zero_pose = forward_kinematics(settings, np.zeros(7))
    assert zero_pose == pytest.approx([0.500, 0, 0.640], abs=1e-12)
    rotation, tip = forward_kinematics(settings, settings.start_position)
    assert tip - [0, 0, 0.310] == pytest.approx([0.428, 0, -0.122], abs=5e-4)
    assert rotation[:, 0] == pytest.approx([0, 0, -1], abs=1e-12)  # the tool axis


@pytest.mark.parametrize("seed", range(5))
def test_forward_kinematics_is_the_product_of_homogeneous_transforms(seed):
    rng = np.random.default_rng(seed)
    settings = random_chain(rng, joints=8)
    q = rng.normal(size=8)
    point = rng.normal(size=3)
    transform = np.eye(4)
    for link, joint in enumerate(settings.joints):
        axis = np.asarray(joint.axis) / np.linalg.norm(joint.axis)
        transform = transform @ homogeneous(joint.origin_rotation, joint.origin_m)
        if joint.kind == "prismatic":
            transform = transform @ homogeneous(np.eye(3), q[link] * axis)
        else:
            # Rotation from its eigenvectors' point of view: along the axis, across it, and out of that plane.
            along = np.outer(axis, axis)
            turned = along + math.cos(q[link]) * (np.eye(3) - along) + math.sin(q[link]) * skew(axis)
            transform = transform @ homogeneous(turned, np.zeros(3))
        rotation, place = forward_kinematics(settings, q, link, point)
        np.testing.assert_allclose(rotation, transform[:3, :3], atol=100 * EPS)
        np.testing.assert_allclose(place, (transform @ [*point, 1])[:3], atol=1000 * EPS)
    np.testing.assert_allclose(
        forward_kinematics(settings, q)[1], (transform @ [*settings.tip_m, 1])[:3], atol=1000 * EPS
    )


@pytest.mark.parametrize("link", [None, 3, 0])
def test_jacobian_is_the_derivative_of_the_kinematics(link):
    rng = np.random.default_rng(7)
    settings = random_chain(rng, joints=7)
    q = rng.normal(size=7)
    point = rng.normal(size=3)
    found = jacobian(settings, q, link, point)
    # Central differences: truncation ~ h^2, rounding ~ EPS / h, both near 1e-10 for lengths near 10.
    h = 1e-5
    rotation, _ = forward_kinematics(settings, q, link, point)
    for j in range(7):
        ahead, behind = q.copy(), q.copy()
        ahead[j] += h
        behind[j] -= h
        rotation_ahead, place_ahead = forward_kinematics(settings, ahead, link, point)
        rotation_behind, place_behind = forward_kinematics(settings, behind, link, point)
        spin = (rotation_ahead - rotation_behind) / (2 * h) @ rotation.T
        np.testing.assert_allclose(found[:3, j], (place_ahead - place_behind) / (2 * h), atol=1e-8)
        np.testing.assert_allclose(skew(found[3:, j]), spin, atol=1e-8)
    if link is not None:
        assert np.all(found[:, link + 1 :] == 0)


# --- Pseudo-inverse -----------------------------------------------------------------------------------------


def matrix_with(singular_values, rows: int, columns: int, rng: np.random.Generator) -> np.ndarray:
    count = len(singular_values)
    u = np.linalg.qr(rng.normal(size=(rows, count)))[0]
    v = np.linalg.qr(rng.normal(size=(columns, count)))[0]
    return u * singular_values @ v.T


@pytest.mark.parametrize("shape", [(6, 6), (6, 7), (3, 7), (6, 4), (3, 1), (1, 1), (3, 16)])
def test_pseudo_inverse_of_random_matrices_is_numpys(shape):
    rng = np.random.default_rng(shape)
    for _ in range(20):
        a = rng.normal(size=shape)
        expected = np.linalg.pinv(a, rcond=1e-7)
        # A backward-stable inverse is off by a few units in the last place times the condition number.
        error = 100 * EPS * np.linalg.cond(a) * np.linalg.norm(expected, 2)
        np.testing.assert_allclose(pseudo_inverse(a), expected, rtol=0, atol=error)


@pytest.mark.parametrize("shape", [(6, 6), (6, 7), (7, 6)])
@pytest.mark.parametrize("smallest", [1e-3, 1.1e-7, 0.9e-7, 1e-12, 0.0])
def test_pseudo_inverse_drops_singular_values_below_the_tolerance(shape, smallest):
    rng = np.random.default_rng(3)
    values = np.array([4.0, 2, 1, 0.5, 0.25, 4.0 * smallest])  # relative to the largest
    kept = values[values > 1e-7 * values.max()]
    assert len(kept) == (6 if smallest > 1e-7 else 5)
    for _ in range(10):
        a = matrix_with(values, *shape, rng)
        expected = np.linalg.pinv(a, rcond=1e-7)
        error = 100 * EPS * (kept.max() / kept.min()) / kept.min()
        np.testing.assert_allclose(pseudo_inverse(a, 1e-7), expected, rtol=0, atol=error)


def test_pseudo_inverse_of_zero_is_zero():
    assert np.all(pseudo_inverse(np.zeros((6, 7))) == 0)


@pytest.mark.parametrize("smallest", [1.0, 1e-3, 0.0])
def test_damped_pseudo_inverse_is_its_definition(smallest):
    rng = np.random.default_rng(4)
    damping = 0.05
    a = matrix_with(np.array([4.0, 2, 1, 0.5, 0.25, smallest]), 6, 7, rng)
    expected = a.T @ np.linalg.inv(a @ a.T + damping**2 * np.eye(6))
    np.testing.assert_allclose(pseudo_inverse(a, damping=damping), expected, atol=1e-10)


# --- One slide, worked out on paper -------------------------------------------------------------------------

# The surface is met at 10.35 mm and the threshold is 1 N, so s must pass 11.35 mm. At tick k the slide has
# made 4k + 1 steps of 0.1 mm: tick 28 sees s = 11.3 mm, too little; tick 29 sees s = 11.7 mm and 1.35 N.
OFFSET = 0.01035
TICK = 29
TRAVEL_AT_TICK = 0.0117


def test_slide_is_detected_at_the_tick_and_force_worked_out_by_hand():
    runs = simulate(slide(), [OFFSET])
    assert runs.detected[0]
    assert not runs.false_alarm[0]
    assert runs.detection_tick[0] == TICK
    assert runs.detection_time_s[0] == pytest.approx(0.117, abs=1e-12)
    assert runs.force_at_detection_N[0] == pytest.approx(1.35, abs=1e-9)
    assert runs.residual_at_detection_Nm[0, 0] == pytest.approx(1.35, abs=1e-9)
    assert runs.trigger_mask[0] == 1
    assert runs.contact_start_s[0] == pytest.approx(OFFSET / SPEED, abs=1e-12)


def test_slide_stops_after_the_sum_of_its_falling_speeds():
    # 250 sub-steps to a standstill, just 50 steps. v^2 / 2a would be 2.5 mm; each sub-step moves at the speed
    # that it ends with, so the sum is h (250 v - a h 250 251 / 2) = 2.49 mm.
    stopping = travel_after_reaction(250)
    assert stopping == pytest.approx(2.49e-3, abs=1e-12)
    peak = 1000 * (TRAVEL_AT_TICK + stopping - OFFSET)
    for reaction in ("reverse", "stop"):
        runs = simulate(slide(reaction=reaction), [OFFSET])
        assert runs.max_force_N[0] == pytest.approx(peak, abs=1e-9)
        assert runs.max_force_axis_N[0] == pytest.approx([peak, 0, 0], abs=1e-9)
        assert runs.max_compression_m[0] == pytest.approx(peak / 1000, abs=1e-12)
        assert runs.max_travel_m[0] == pytest.approx(TRAVEL_AT_TICK + stopping, abs=1e-12)
    assert runs.force_at_end_N[0] == pytest.approx(peak, abs=1e-9)  # it stands there


def test_slide_moves_as_worked_out_at_every_step():
    run = trace(slide(), OFFSET)
    reaction_step = 4 * TICK  # the tick's own step is the last undisturbed one
    for i, s in enumerate(run.travel_m):
        if i <= reaction_step:
            expected = SPEED * (i + 1) * 0.001
        else:
            expected = TRAVEL_AT_TICK + travel_after_reaction(5 * (i - reaction_step))
        assert s == pytest.approx(expected, abs=1e-12)
        assert run.force_N[i] == pytest.approx(1000 * max(0, expected - OFFSET), abs=1e-9)
    # 50 ms and one and a half times v / a later no further step begins.
    assert len(run.time_s) == reaction_step + 1 + 126
    assert run.time_s[-1] == run.run.end_time_s[0] == pytest.approx(0.243)


def test_contact_ends_where_the_returning_slide_crosses_the_surface():
    settings = slide(thresholds_Nm=10.0)
    # Tick 51 at 20.5 mm is the first past 20.35 mm. The slide needs longer to come back than the run lasts.
    steps = np.arange(0, 400)
    travel = np.array([0.0205 + travel_after_reaction(5 * n) for n in steps])
    after = int(np.argmax((travel < OFFSET) & (steps > 0)))
    share = (travel[after - 1] - OFFSET) / (travel[after - 1] - travel[after])
    expected = 0.205 + 0.001 * (after - 1 + share)

    plain = simulate(settings, [OFFSET])
    patient = simulate(replace(settings, run_until_free=True), [OFFSET])
    assert plain.detection_tick[0] == 51
    assert plain.end_time_s[0] < expected
    assert np.isnan(plain.contact_end_s[0])
    assert patient.contact_end_s[0] == pytest.approx(expected, abs=1e-11)
    assert patient.contact_duration_s[0] == pytest.approx(expected - OFFSET / SPEED, abs=1e-11)
    # Waiting changes nothing else.
    assert_same_runs(replace(patient, contact_end_s=plain.contact_end_s), plain)


def test_an_arm_that_starts_inside_the_surface_is_in_contact_from_the_start():
    runs = simulate(slide(), [-0.0003])
    assert runs.contact_start_s[0] == 0
    assert runs.detection_tick[0] == 2  # s = 0.9 mm
    assert runs.force_at_detection_N[0] == pytest.approx(1.2, abs=1e-9)


def test_latency_lets_the_slide_go_on_at_full_speed():
    prompt = simulate(slide(), [OFFSET])
    late = simulate(slide(latency_steps=7), [OFFSET])
    assert late.detection_tick == prompt.detection_tick
    assert late.max_force_N - prompt.max_force_N == pytest.approx(1000 * SPEED * 0.007, abs=1e-9)
    assert late.end_time_s - prompt.end_time_s == pytest.approx(0.007, abs=1e-12)


def test_slide_from_rest_gathers_speed():
    run = trace(slide(start="rest", thresholds_Nm=np.inf), np.inf)
    substeps = 5 * np.arange(1, 51)  # 250 until full speed
    np.testing.assert_allclose(run.travel_m[:50], ACCELERATION * SUBSTEP**2 * substeps * (substeps + 1) / 2, atol=1e-13)
    np.testing.assert_allclose(run.velocity[49:, 0], SPEED, rtol=1e-12)


def test_without_detection_the_run_lasts_for_its_duration():
    settings = slide(thresholds_Nm=np.inf)
    runs = simulate(settings, [OFFSET])
    assert not runs.detected[0]
    assert runs.detection_tick[0] == -1
    assert runs.end_time_s[0] == pytest.approx(0.5)
    assert runs.max_force_N[0] == 0  # maxima are only taken from a detection on
    assert runs.force_at_end_N[0] == pytest.approx(1000 * (0.05 - OFFSET), abs=1e-9)
    assert tick_count(settings) == 125  # ticks at 1, 5, ..., 497 ms
    assert tick_count(replace(settings, duration_s=0.497)) == 125
    assert tick_count(replace(settings, duration_s=0.496)) == 124


# --- Noise, thresholds, arming ------------------------------------------------------------------------------


def test_noise_decides_tick_and_joint():
    settings = sia5d((0, 0, -0.05), duration_s=0.1)
    ticks = tick_count(settings)
    noise = np.zeros((4, ticks, 7))
    noise[0, 3] = [0, -10.5, 20.5, 0, 0, 19.9, 0]
    noise[1, 24, 6] = 20.1  # the held joint feels too
    noise[2, 5, 0] = 19.9
    noise[3, 0, 1] = -99
    runs = simulate(settings, np.full(4, 1.0), noise)
    assert runs.detection_tick.tolist() == [3, 24, -1, 0]
    assert runs.trigger_mask.tolist() == [0b110, 0b1000000, 0, 0b10]
    assert runs.triggered(2).tolist() == [True, False, False, False]
    assert runs.false_alarm.tolist() == [True, True, False, True]
    np.testing.assert_array_equal(runs.noise_at_detection_Nm[0], noise[0, 3])
    np.testing.assert_array_equal(runs.residual_at_detection_Nm[0], noise[0, 3])
    assert np.all(np.isnan(runs.residual_at_detection_Nm[2]))
    assert runs.max_force_N.tolist() == [0, 0, 0, 0]


def test_noise_adds_to_the_contact_torque():
    # 0.95 N come from the spring at tick 28 (s = 11.3 mm); noise of 0.06 Nm makes the difference.
    noise = np.zeros((2, tick_count(slide()), 1))
    noise[0, 28] = 0.06
    noise[1, 28] = -0.06
    runs = simulate(slide(), [OFFSET, OFFSET], noise)
    assert runs.detection_tick.tolist() == [28, 29]
    assert runs.force_at_detection_N[0] == pytest.approx(0.95, abs=1e-9)
    assert runs.residual_at_detection_Nm[0, 0] == pytest.approx(1.01, abs=1e-9)


def test_ticks_before_the_arming_delay_are_not_checked():
    noise = np.full((1, tick_count(slide()), 1), 2.0)
    for delay_s, tick in ((0.0, 0), (0.001, 0), (0.0011, 1), (0.005, 1), (0.1, 25), (0.6, -1)):
        runs = simulate(slide(arming_delay_s=delay_s), [np.inf], noise)
        assert runs.detection_tick[0] == tick


def test_false_alarm_just_before_contact_still_reaches_the_surface():
    noise = np.zeros((1, tick_count(slide()), 1))
    noise[0, 20] = -2.0  # s = 8.1 mm, of the 2.49 mm to stop 2.25 mm are left
    runs = simulate(slide(), [OFFSET], noise)
    assert runs.false_alarm[0]
    assert runs.force_at_detection_N[0] == 0
    assert runs.max_force_N[0] == pytest.approx(1000 * (0.0081 + 0.00249 - OFFSET), abs=1e-9)


def test_a_seeded_run_depends_on_nothing_but_its_seed_number_and_offset():
    settings = sia5d((0, 0, -0.1))
    offsets = half_normal_offsets(settings, 6, np.random.default_rng(1))
    runs = simulate_seeded(settings, offsets, seed=5)
    assert_same_runs(simulate_seeded(settings, offsets, seed=5), runs)
    fewer = simulate_seeded(settings, offsets[:3], seed=5)
    np.testing.assert_array_equal(fewer.max_force_N, runs.max_force_N[:3])
    other = simulate_seeded(settings, offsets, seed=6)
    assert not np.any(other.noise_at_detection_Nm == runs.noise_at_detection_Nm)


def test_seeded_noise_has_the_mean_and_spread_asked_for():
    # Every first tick is a detection, so 1000 runs show 1000 draws of each joint.
    settings = sia5d((0, 0, -0.05), thresholds_Nm=1e-12, noise_sd_Nm=np.arange(1.0, 8), noise_mean_Nm=np.arange(7.0))
    drawn = simulate_seeded(settings, np.full(1000, np.inf), seed=1).noise_at_detection_Nm
    sd = np.arange(1.0, 8)
    assert np.all(np.abs(drawn.mean(axis=0) - np.arange(7)) < 4.5 * sd / math.sqrt(1000))
    assert np.all(np.abs(drawn.std(axis=0) / sd - 1) < 4.5 / math.sqrt(2 * 1000))


# --- Several joints -----------------------------------------------------------------------------------------


def gantry(velocity_m_s, **changes) -> TwinSettings:
    """Three slides along x, y, z."""
    settings = TwinSettings(
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


# --- Walls across the axes ----------------------------------------------------------------------------------


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
        # The source's deflection counts the distance from the wall on either side.
        assert runs.max_deflection_m[0] == pytest.approx(0.00372 + offset, abs=1e-12)
    assert plane.max_force_N[0] == 0
    assert honest.max_force_N[0] == 0
    assert mirrored.max_force_N[0] == pytest.approx(1000 * (0.00372 + offset), abs=1e-9)


# --- The run-length slip ------------------------------------------------------------------------------------


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


# --- The reference figures ----------------------------------------------------------------------------------

# Straight down, 10 000 runs a row of another transcription of the source's simulator. Speed (mm/s); peak
# force (N): mean, sd, median, 95 %, 99 %; mean force at detection (N); shares of runs over the three limits.
HAND = (75_000.0, (135.0, 60.0, 120.0))  # N/m; N: force limit, pressure limit on 1 cm2, on 2 cm2
LOWER_ARM = (40_000.0, (160.0, 50.0, 100.0))
REFERENCE_ROWS = [
    (HAND, 10, 25.28, 3.48, 25.48, 30.71, 32.53, 23.30, (0.0000, 0.0000, 0.0000)),
    (HAND, 25, 39.45, 4.47, 39.56, 46.70, 49.11, 26.80, (0.0000, 0.0000, 0.0000)),
    (HAND, 50, 81.51, 6.06, 81.50, 91.40, 95.17, 30.77, (0.0000, 1.0000, 0.0000)),
    (HAND, 75, 148.43, 7.92, 148.34, 161.43, 165.40, 34.67, (0.9623, 1.0000, 1.0000)),
    (HAND, 100, 239.73, 9.93, 239.57, 255.94, 260.34, 38.37, (1.0000, 1.0000, 1.0000)),
    (LOWER_ARM, 10, 22.64, 3.04, 22.84, 27.25, 28.94, 21.59, (0.0000, 0.0000, 0.0000)),
    (LOWER_ARM, 25, 30.95, 3.75, 31.12, 36.88, 38.96, 24.21, (0.0000, 0.0000, 0.0000)),
    (LOWER_ARM, 50, 54.19, 4.67, 54.27, 61.66, 64.51, 27.15, (0.0000, 0.8127, 0.0000)),
    (LOWER_ARM, 75, 89.94, 5.44, 89.93, 98.82, 102.00, 29.31, (0.0000, 1.0000, 0.0282)),
    (LOWER_ARM, 100, 138.61, 6.34, 138.60, 149.01, 152.80, 31.30, (0.0001, 1.0000, 1.0000)),
]
RUNS = 300
REFERENCE_RUNS = 10_000
Z = 4.5  # standard errors allowed: 7e-6 for each of some hundred comparisons to fail by chance


@pytest.mark.parametrize(
    ("body", "speed_mm_s", "mean", "sd", "median", "p95", "p99", "at_detection", "shares_over"),
    REFERENCE_ROWS,
)
def test_reference_rows(body, speed_mm_s, mean, sd, median, p95, p99, at_detection, shares_over):
    stiffness, limits = body
    settings = sia5d((0, 0, -speed_mm_s / 1000), stiffness_N_m=stiffness)
    offsets = half_normal_offsets(settings, RUNS, np.random.default_rng(speed_mm_s))
    runs = simulate_seeded(settings, offsets, seed=speed_mm_s)
    force = runs.max_force_N
    assert runs.detected.all()

    # Both sides are samples; the reference is rounded to 0.01 N.
    both = math.sqrt(1 / RUNS + 1 / REFERENCE_RUNS)
    rounding = 0.005
    assert force.mean() == pytest.approx(mean, abs=Z * sd * both + rounding)
    assert force.std() == pytest.approx(sd, abs=Z * sd * both / math.sqrt(2) + rounding)
    felt = runs.force_at_detection_N
    assert felt.mean() == pytest.approx(at_detection, abs=Z * felt.std() * both + rounding)

    # A quantile is right when its share of the runs lies above it. Shares are binomial, also near 0 and 1,
    # where the normal approximation is too narrow by a run or two.
    levels = [(median, 0.5), (p95, 0.05), (p99, 0.01), *zip(limits, shares_over, strict=True)]
    for level, share in levels:
        allowed = Z * math.sqrt(share * (1 - share)) * both + 3 / RUNS
        assert np.mean(force > level) == pytest.approx(share, abs=allowed)


def test_lateral_motion_is_felt_by_joints_1_and_3():
    # About equally often by either, by both at once in 15 % of runs at 10 mm/s.
    settings = sia5d((0, 0.010, 0))
    offsets = half_normal_offsets(settings, RUNS, np.random.default_rng(6))
    runs = simulate_seeded(settings, offsets, seed=6)
    first, third = runs.triggered(0), runs.triggered(2)
    assert np.mean(first | third) > 0.97
    assert np.mean(first & third) == pytest.approx(0.15, abs=Z * math.sqrt(0.15 * 0.85 / RUNS) + 0.005)
    assert np.mean(first) == pytest.approx(np.mean(third), abs=0.15)


# --- The wrapper --------------------------------------------------------------------------------------------


def test_build_is_done_once_for_the_same_source_and_flags(tmp_path):
    first = build(flags=["-O0", "-std=c++20", "-shared", "-fPIC"], cache_dir=tmp_path)
    stamp = first.stat().st_mtime_ns
    assert build(flags=["-O0", "-std=c++20", "-shared", "-fPIC"], cache_dir=tmp_path) == first
    assert first.stat().st_mtime_ns == stamp
    with pytest.raises(RuntimeError, match="could not compile"):
        build(flags=["-std=c++20", "-DNAN=", "-include", "no/such/header"], cache_dir=tmp_path)
    assert list(tmp_path.iterdir()) == [first]


@pytest.mark.parametrize(
    ("changes", "word"),
    [
        ({"held_joints": (7,)}, "held_joints"),
        ({"start_position": (0, 0)}, "start_position"),
        ({"thresholds_Nm": (1, 2)}, "thresholds_Nm"),
        ({"max_acceleration": 0.0}, "max_acceleration"),
        ({"stiffness_N_m": 0.0}, "stiffness_N_m"),
        ({"contact_link": 7}, "link"),
        ({"per_axis_walls": True, "contact_link": 3}, "per_axis_walls"),
    ],
)
def test_impossible_settings_are_refused(changes, word):
    with pytest.raises(ValueError, match=word):
        simulate(sia5d((0, 0, -0.05), **changes), [0.0])


def test_arrays_of_the_wrong_shape_are_refused():
    settings = sia5d((0, 0, -0.05), duration_s=0.1)
    with pytest.raises(ValueError, match="ticks"):
        simulate(settings, [0.0], np.zeros((1, tick_count(settings) - 1, 7)))
    with pytest.raises(ValueError, match="noise"):
        simulate(settings, [0.0], np.zeros((2, tick_count(settings), 7)))
    with pytest.raises(ValueError, match="offsets"):
        simulate(settings, [[0.0, 0.0, 0.0]])


def assert_same_runs(found: TwinRuns, expected: TwinRuns, tolerance: float = 0.0) -> None:
    for name, values in vars(expected).items():
        np.testing.assert_allclose(getattr(found, name), values, rtol=0, atol=tolerance, err_msg=name)
