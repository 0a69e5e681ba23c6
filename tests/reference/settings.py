"""What the reference simulator is asked: an arm, its motion, the contact, the detector and the reaction.

Units are SI (m, rad, s, N, Nm); for a prismatic joint read m for rad and N for Nm. Joints and links are
counted from zero, and link j is the one that joint j moves.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy.typing as npt

IDENTITY = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@dataclass(frozen=True)
class Joint:
    """One joint of a serial chain, described as in a URDF."""

    kind: Literal["revolute", "prismatic"]
    origin_m: Sequence[float]  # in the frame of the link before it
    axis: Sequence[float]  # in the joint's own frame; any length
    origin_rotation: npt.ArrayLike = IDENTITY  # 3 x 3, from the joint's frame to that of the link before it


@dataclass(frozen=True, kw_only=True)
class ReferenceSettings:
    """Arm, motion, contact, detector and reaction of a simulated collision.

    A value that belongs to each joint may be one number for all of them.
    """

    # Arm
    joints: Sequence[Joint]
    tip_m: Sequence[float] = (0.0, 0.0, 0.0)  # in the last link's frame
    held_joints: Sequence[int] = ()  # these do not move

    # Motion
    start_position: Sequence[float]
    velocity_m_s: Sequence[float]  # of the tip
    task: Literal["pose", "position"] = "pose"  # hold the tip's orientation, or let it go
    start: Literal["moving", "rest"] = "moving"
    duration_s: float = 5.0  # a run without detection ends here
    singular_tolerance: float = 1e-7  # singular values below this share of the largest are dropped
    damping: float = 0.0  # lambda of the damped pseudo-inverse (then nothing is dropped); 0 is exact
    max_speed: float | Sequence[float] = math.inf
    min_position: float | Sequence[float] = -math.inf  # a line that would leave this range is given up: the arm brakes
    max_position: float | Sequence[float] = math.inf

    # Contact
    stiffness_N_m: float = 75_000.0
    contact_link: int | None = None  # None: the tip
    contact_point_m: Sequence[float] = (0.0, 0.0, 0.0)  # in that link's frame
    normal: Sequence[float] | None = None  # None: the direction the contact point moves in at the start
    per_axis_walls: bool = False  # three walls across x, y, z instead of one plane
    mirrored_walls: bool = True  # ... each of which is also touched, mirrored, behind the start, as in Schroeder (2013)

    # Detector
    thresholds_Nm: float | Sequence[float]  # inf: that joint is not monitored
    period_steps: int = 4  # simulation steps between two feedback ticks
    arming_delay_s: float = 0.0  # ticks before this time are not checked
    noise_sd_Nm: float | Sequence[float] = 0.0  # for simulate_seeded only
    noise_mean_Nm: float | Sequence[float] = 0.0  # for simulate_seeded only

    # Reaction and simulation
    reaction: Literal["reverse", "stop"] = "reverse"
    max_acceleration: float | Sequence[float]
    latency_steps: int = 0  # 0: the reaction begins in the step after the one of the detection
    deceleration: Literal["limits", "fixed_time", "late_brake"] = "limits"  # of a reaction, or where a line is given up
    uncoordinated: bool = False  # every joint brakes at its own limit, whatever the others do
    stopping_time_s: float = 0.0  # fixed_time: rates fall linearly to zero in it
    brake_time_s: float = 0.0  # late_brake: until the limits are full, from zero linearly
    run_length_slip: bool = False  # Schroeder's signed joint speed in the time simulated after detection
    run_until_free: bool = False  # go on until a reversing arm has left the contact; changes contact_end_s only
    release_limit_s: float = 5.0  # ... but no longer than this
    step_s: float = 0.001
    substeps: int = 5  # controller sub-steps in a simulation step
