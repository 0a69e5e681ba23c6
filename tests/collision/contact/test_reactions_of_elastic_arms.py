"""What a reaction makes of an elastic arm's contact, beside the reference simulator, which shares no code with it."""

from __future__ import annotations

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.model import mass_matrix, with_rotors
from collision.contact.elastic_cases import scenario
from reference.elastic_arm import Body, ElasticArm, collide

STEP, OFFSET, STIFFNESS = 1e-3, 1e-3, 1e4
DOWN = np.array([0.0, 0.0, -1.0])


def simulated(result: bs.CollisionResult, share: float) -> float:
    """Peak force of the collision that is detected at one tick, along the reference's path and its reaction."""
    curve, robot = result.curve, bs.Robot.load("ur10e")
    detected = OFFSET / 0.16 + result.detection_delay.mean
    tick = int(np.argmin(np.abs(curve.tick_time - detected)))
    (reaction,) = curve.kernel.reaction_paths([tick], [0.0])  # type: ignore[union-attr]
    begins = round((curve.tick_time[tick] + 0.004) / STEP)
    assert reaction[0] == pytest.approx(curve.distance[begins], abs=1e-9)
    standing = np.full(200, reaction[-1])  # the arm swings on
    path = np.concatenate([curve.distance[:begins], reaction, standing])
    q = np.radians([0, -60, 90, -120, -90, 0])
    jacobian, train = robot.jacobian(q), robot.drive_train
    arm = ElasticArm.of_servo(
        mass_matrix(with_rotors(robot, 0.0), q),
        train.rotor_inertia,
        train.gear_stiffness,
        DOWN @ jacobian[:3],
        gear_damping_ratio=float(train.gear_damping[0]),
        velocity_bandwidth=train.servo_bandwidth,
        position_gain=train.servo_position_gain,
        rates=np.linalg.solve(jacobian, [*DOWN, 0, 0, 0]),
        feedforward=share,
        feeds_motors=True,
    )
    return collide(arm, Body(stiffness=STIFFNESS), path, STEP, offset=OFFSET, tiny=5e-5).peak_force


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
