"""Arms that the reference simulator is tried on."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from reference import Joint, ReferenceRuns, ReferenceSettings

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


def sia5d(velocity_m_s, **changes) -> ReferenceSettings:
    """The tool points straight down, joint 7 does not move."""
    settings = ReferenceSettings(
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


# A single slide along x: everything about it can be computed on paper.
SPEED = 0.1
ACCELERATION = 2.0
SUBSTEP = 0.001 / 5


def slide(**changes) -> ReferenceSettings:
    settings = ReferenceSettings(
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


def random_chain(rng: np.random.Generator, joints: int) -> ReferenceSettings:
    """A serial chain with both kinds of joint and rotated origins."""

    def rotation() -> np.ndarray:
        q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        return q * np.sign(np.linalg.det(q))

    return ReferenceSettings(
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


def assert_same_runs(found: ReferenceRuns, expected: ReferenceRuns, tolerance: float = 0.0) -> None:
    for name, values in vars(expected).items():
        np.testing.assert_allclose(getattr(found, name), values, rtol=0, atol=tolerance, err_msg=name)
