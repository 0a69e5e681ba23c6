"""What a reaction makes of an elastic arm's contact, beside the reference simulator, which shares no code with it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision import evaluate_batch
from bumpstop.model import mass_matrix, with_rotors
from collision.contact.elastic_cases import scenario
from reference.elastic_arm import Body, ElasticArm, collide

STEP, OFFSET, STIFFNESS = 1e-3, 1e-3, 1e4
DOWN = np.array([0.0, 0.0, -1.0])
POSE = np.radians([0, -60, 90, -120, -90, 0])


def simulated(result: bs.CollisionResult, share: float) -> float:
    """Peak force of the collision that is detected at one tick, along the reference's path and its reaction."""
    curve = result.curve
    detected = OFFSET / 0.16 + result.detection_delay.mean
    tick = int(np.argmin(np.abs(curve.tick_time - detected)))
    (reaction,) = curve.kernel.reaction_paths([tick], [0.0])  # type: ignore[union-attr]
    begins = round((curve.tick_time[tick] + 0.004) / STEP)
    assert reaction[0] == pytest.approx(curve.distance[begins], abs=1e-9)
    return follow(np.concatenate([curve.distance[:begins], reaction]), OFFSET, share)


def reference_arm(share: float, *, reacts: bool) -> ElasticArm:
    robot, q = bs.Robot.load("ur10e"), POSE
    jacobian, train = robot.jacobian(q), robot.drive_train
    return ElasticArm.of_servo(
        mass_matrix(with_rotors(robot, 0.0), q),
        train.rotor_inertia,
        train.gear_stiffness,
        DOWN @ jacobian[:3],
        gear_damping_ratio=float(train.gear_damping[0]),
        velocity_bandwidth=train.servo_bandwidth,
        position_gain=train.servo_position_gain,
        rates=np.linalg.solve(jacobian, [*DOWN, 0, 0, 0]),
        feedforward=share,
        feeds_motors=reacts,
    )


def follow(path: np.ndarray, offset: float, share: float) -> float:
    """Peak force along a path at whose end the arm stands, and swings on."""
    path = np.append(path, np.full(300, path[-1]))
    arm = reference_arm(share, reacts=True)
    return collide(arm, Body(stiffness=STIFFNESS), path, STEP, offset=offset, tiny=5e-5).peak_force


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_what_is_fed_forward_winds_up_the_gears_first(kind: str, share: float) -> None:
    result = bs.evaluate(
        scenario(
            contact={"stiffness_N_m": STIFFNESS, "offset_law": "fixed", "offset_mm": 1e3 * OFFSET},
            arm={"acceleration_feedforward": share},
            detector={"thresholds_Nm": [3.0] * 6, "noise_sd_Nm": 0.01},
            reaction={"kind": kind, "joint_acceleration_rad_s2": 20, "latency_s": 0.004},
        )
    )
    assert result.peak_force.sd < 1e-6
    # The lever of the pose of contact is that of a millimetre further on.
    assert result.peak_force.mean == pytest.approx(simulated(result, share), rel=2e-3)


@pytest.mark.parametrize("samples", [None, 1])
def test_an_arm_that_speeds_up_lags_before_it_touches(samples: int | None) -> None:
    """It was taken to be on its reference until the touch: 119 N for 172 without feedforward, on 40 N/mm."""
    offset = 5e-3
    result = bs.evaluate(
        scenario(
            motion={"velocity_mm_s": [0, 0, -250], "start": "rest", "duration_s": 1.2},
            contact={"stiffness_N_m": STIFFNESS, "offset_law": "fixed", "offset_mm": 1e3 * offset},
            arm={"acceleration_feedforward": 0.0},
            detector={"thresholds_Nm": [1e3, 60.0, 1e3, 1e3, 1e3, 1e3], "noise_sd_Nm": 1e-3},
            reaction={"kind": "stop", "joint_acceleration_rad_s2": 10, "latency_s": 0.004},
        ),
        samples=samples,
    )
    curve = result.curve
    begins = int(np.argmax(curve.distance > offset))
    touch = (begins - 1 + (offset - curve.distance[begins - 1]) / np.diff(curve.distance)[begins - 1]) * STEP
    tick = int(np.argmin(np.abs(curve.tick_time - touch - result.detection_delay.mean)))
    (reaction,) = curve.kernel.reaction_paths([tick], [0.0])  # type: ignore[union-attr]
    path = np.concatenate([[0.0] * 3, curve.distance[: round((curve.tick_time[tick] + 0.004) / STEP)], reaction])
    assert result.peak_force.mean == pytest.approx(follow(path, offset, 0.0), rel=5e-3)


@pytest.mark.parametrize("samples", [None, 1])
def test_an_arm_that_lags_is_not_detected_before_it_touches(samples: int | None) -> None:
    """Its gears swing while it speeds up: past the place of the body that counted as contact, at no force at all."""
    offset, thresholds = 2e-3, np.array([40.0, 40.0, 30.0, 12.0, 12.0, 12.0])
    result = bs.evaluate(
        scenario(
            motion={"velocity_mm_s": [0, 0, -250], "start": "rest"},
            contact={"stiffness_N_m": STIFFNESS, "offset_law": "fixed", "offset_mm": 1e3 * offset},
            arm={"acceleration_feedforward": 0.0},
            detector={"thresholds_Nm": thresholds.tolist(), "noise_sd_Nm": 1e-6, "feedback_period_s": 2 * STEP},
            reaction={"kind": "stop", "joint_acceleration_rad_s2": 20, "latency_s": 6 * STEP},
        ),
        samples=samples,
    )
    curve = bs.stopping_curve(result.problem, whole=True)
    path = np.concatenate([[0.0] * 3, curve.distance])
    found = collide(reference_arm(0.0, reacts=False), Body(stiffness=STIFFNESS), path, STEP, offset=offset, tiny=5e-5)
    tick = np.array([round(t / STEP) for t in curve.tick_time])
    rows = (tick + 3) * round(STEP / (found.time[1] - found.time[0]))
    touch = found.contacts[0][0] - 3 * STEP
    detected = int(np.argmax((curve.tick_time > touch) & (np.abs(found.residual[rows]) > thresholds).any(axis=1)))
    assert result.force_at_detection.mean == pytest.approx(found.force[rows[detected]], rel=1e-2)
    (reaction,) = curve.kernel.reaction_paths([detected], [0.0])  # type: ignore[union-attr]
    path = np.concatenate([path[: tick[detected] + 9], reaction])
    assert result.peak_force.mean == pytest.approx(follow(path, offset, 0.0), rel=5e-3)


@pytest.mark.parametrize("samples", [None, 1])
@pytest.mark.parametrize("onset", [0.05, 0.2])
def test_it_lags_on_a_trajectory_too(onset: float, samples: int | None, tmp_path: Path) -> None:
    t = np.arange(0, 1.001, 0.02)
    q = np.tile(POSE, (t.size, 1))
    q[:, 0] += 0.35 * (1 - np.cos(np.pi * t)) / 2
    qd = np.zeros_like(q)
    qd[:, 0] = 0.35 * np.pi * np.sin(np.pi * t) / 2
    names = ",".join(["t", *(f"q_{j + 1}" for j in range(6)), *(f"qd_{j + 1}" for j in range(6))])
    np.savetxt(tmp_path / "swing.csv", np.column_stack([t, q, qd]), delimiter=",", header=names, comments="")
    swinging = {
        "robot": "ur10e",
        "motion": {"kind": "trajectory", "file": "swing.csv", "contact_onset_s": onset},
        "contact": {"stiffness_N_m": 4e4, "kind": "free", "body_mass_kg": 4.0},
        "arm": {"model": "elastic", "acceleration_feedforward": 0.0},
        "detector": {"thresholds_Nm": [9e4] * 6, "noise_sd_Nm": 1.0},
        "reaction": {"joint_acceleration_rad_s2": 10},
    }
    result = bs.evaluate(bs.Scenario.from_dict(swinging, tmp_path), samples=samples)
    robot = bs.Robot.load("ur10e")

    def swung(time: np.ndarray) -> np.ndarray:
        return POSE + np.outer(0.35 * (1 - np.cos(np.pi * time)) / 2, np.eye(6)[0])

    pose = swung(np.array([onset]))[0]
    jacobian = robot.jacobian(pose)[:3]
    radius = float(np.linalg.norm(jacobian[:, 0]))
    normal = jacobian[:, 0] / radius
    path = radius * np.sin(swung(STEP * np.arange(1001))[:, 0] - pose[0])
    train = robot.drive_train
    arm = ElasticArm.of_servo(
        mass_matrix(with_rotors(robot, 0.0), pose),
        train.rotor_inertia,
        train.gear_stiffness,
        normal @ jacobian,
        gear_damping_ratio=float(train.gear_damping[0]),
        velocity_bandwidth=train.servo_bandwidth,
        position_gain=train.servo_position_gain,
        rates=np.eye(6)[0] / radius,
        feedforward=0.0,
    )
    wanted = collide(arm, Body(stiffness=4e4, mass=4.0), path, STEP, offset=0.0, tiny=5e-5).peak_force
    assert result.peak_force.mean == pytest.approx(wanted, rel=2e-3)


@pytest.mark.parametrize("offset_mm", [0.2, 5.0])
def test_a_speed_that_is_not_reached_yet_changes_nothing(offset_mm: float) -> None:
    """From rest the arm touches at 63 or 316 mm/s whatever it is to reach; what its gears carry was divided by that."""
    forces = [
        bs.evaluate(
            scenario(
                motion={"velocity_mm_s": [0, 0, -speed], "start": "rest", "duration_s": 1.0},
                contact={"stiffness_N_m": STIFFNESS, "offset_law": "fixed", "offset_mm": offset_mm},
                detector={"thresholds_Nm": [3.0] * 6, "noise_sd_Nm": 0.01},
                reaction={"kind": "stop", "joint_acceleration_rad_s2": 20, "latency_s": 0.0},
            )
        ).peak_force.mean
        for speed in (700.0, 1400.0)
    ]
    assert forces[1] == pytest.approx(forces[0], rel=2e-3)


def test_joints_that_brake_by_themselves_are_noted() -> None:
    notes = {
        category: bs.evaluate(scenario(reaction={"kind": "stop", "stop_category": category})).warnings
        for category in (0, 1)
    }
    assert any("every joint brakes by itself" in note for note in notes[0])
    assert not any("every joint brakes by itself" in note for note in notes[1])


STOP = {"kind": "stop", "joint_acceleration_rad_s2": 20, "latency_s": 0.0}


def beyond(offset: float, **changes: object) -> bs.Scenario:
    """A body at one place."""
    contact = {"stiffness_N_m": STIFFNESS, "offset_law": "fixed", "offset_mm": 1e3 * offset}
    return scenario(contact=contact, reaction=STOP, **changes)


@pytest.mark.parametrize("further_mm", [-0.3, -1e-4, 1e-4, 0.2, 0.6, 3.0])
def test_an_arm_swings_into_bodies_beyond_its_path(further_mm: float) -> None:
    # An alarm at the first tick, long before contact.
    alarm = {"thresholds_Nm": [3.0] * 6, "noise_sd_Nm": 0.01, "noise_mean_Nm": 30.0}
    curve = bs.evaluate(beyond(1e-3, detector=alarm)).curve
    offset = float(curve.max_distance[0]) + 1e-3 * further_mm
    (reaction,) = curve.kernel.reaction_paths([0], [0.0])  # type: ignore[union-attr]
    wanted = follow(np.concatenate([curve.distance[: round(curve.tick_time[0] / STEP)], reaction]), offset, 1.0)
    assert (wanted > 1.0) == (further_mm < 1.0)
    for samples in (None, 4):
        found = bs.evaluate(beyond(offset, detector=alarm), samples=samples)
        assert found.false_alarm_probability == pytest.approx(1.0)
        assert found.peak_force.mean == pytest.approx(wanted, rel=3e-4)


def test_an_arm_swings_into_bodies_beyond_the_end_of_its_motion() -> None:
    silent = scenario(
        motion={"velocity_mm_s": [0, 0, -160], "duration_s": 0.03},
        contact={"offset_law": "half_normal", "offset_sd_s": 0.03, "kind": "free", "body_mass_kg": 4},
        detector={"thresholds_Nm": [1e5] * 6, "noise_sd_Nm": 1.0},
    )
    exact, drawn = bs.evaluate(silent), bs.evaluate(silent, samples=20_000, seed=3)
    batch = bs.evaluate_batch(silent, exact.problem.q[None], exact.problem.velocity[None], limits_N=[1.0, 10.0])
    touched = exact.peak_force.exceedance(0.1)
    assert touched > 1 - exact.no_contact_probability + 0.01, "of those beyond the end, too"
    for force, told in zip((1.0, 10.0), batch.exceedance[0], strict=True):
        p = exact.peak_force.exceedance(force)
        assert told == pytest.approx(p, abs=1e-3)
        assert drawn.peak_force.exceedance(force) == pytest.approx(p, abs=4.5 * np.sqrt(p * (1 - p) / 20_000))
    assert batch.mean[0] == pytest.approx(exact.peak_force.mean, rel=1e-3)
    assert drawn.peak_force.mean == pytest.approx(exact.peak_force.mean, abs=4.5 * exact.peak_force.sd / 20_000**0.5)


def test_a_batch_waits_for_servos_that_lag() -> None:
    """They press on when the reference has turned back and the first oscillation of contact is over."""
    slow = bs.load_scenario("examples/05_ur10e.toml").with_values(
        {
            "arm.model": "elastic",
            "pose_rad": [-2.761814, 1.68678, 5.555151, -1.661901, -5.875429, -4.881009],
            "motion.velocity_mm_s": [0, 0, -60],
        }
    )
    alone = bs.evaluate(slow)
    together = evaluate_batch(slow, [slow.pose_rad], [[0, 0, -0.06]], probabilities=(0.5,))
    assert together.mean[0] == pytest.approx(alone.peak_force.mean, rel=1e-3)
    assert together.quantile[0, 0] == pytest.approx(alone.peak_force.quantile(0.5), rel=1e-3)
