"""Joints with the links they move, and frames fixed to links."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.errors import InputError
from bumpstop.model.inertia import LinkInertia, Matrix3, Vector3

JointKind = Literal["revolute", "prismatic"]
IDENTITY: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> FloatArray:
    """Rotation matrix of fixed-axis roll, pitch and yaw: Rz(yaw) Ry(pitch) Rx(roll), angles in rad."""
    cr, sr, cp, sp, cy, sy = (f(a) for a in (roll, pitch, yaw) for f in (math.cos, math.sin))
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


@dataclass(frozen=True, kw_only=True)
class Joint:
    """One joint and the link it moves, in the manner of URDF.

    Attributes:
        name: of the joint.
        link: name of the link it moves.
        kind: ``"revolute"`` (turns about ``axis``) or ``"prismatic"`` (slides along it).
        origin: position of the joint's frame in the frame of the link before [m].
        rotation: orientation of the joint's frame in the frame of the link before, as rows of a rotation matrix.
        axis: unit vector in the joint's frame.
        lower, upper: limits of the joint position [rad or m].
        velocity: largest joint speed [rad/s or m/s]; infinite: none stated.
        inertia: of the link, or None where it is not known.
        rotor_inertia: of the motor, reflected to the joint (rotor inertia times gear ratio squared) [kg m2 or kg].
    """

    name: str
    link: str
    kind: JointKind = "revolute"
    origin: Vector3 = (0.0, 0.0, 0.0)
    rotation: Matrix3 = IDENTITY
    axis: Vector3 = (0.0, 0.0, 1.0)
    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    inertia: LinkInertia | None = None
    rotor_inertia: float = 0.0

    def __post_init__(self) -> None:
        check_name(self.name, "joint name")
        where = f"joint {self.name!r}"
        check_name(self.link, f"{where} link")
        if self.kind not in ("revolute", "prismatic"):
            raise InputError(f"{where} kind", f"{self.kind!r} is no kind of joint", "valid: revolute, prismatic")
        as_float_array(self.origin, f"{where} origin", (3,))
        axis = as_float_array(self.axis, f"{where} axis", (3,))
        if abs(float(np.linalg.norm(axis)) - 1) > 1e-9:
            raise InputError(
                f"{where} axis", f"{self.axis} has length {np.linalg.norm(axis):.6g}", "wanted a unit vector"
            )
        check_rotation(self.rotation, f"{where} rotation")
        for field in ("lower", "upper", "velocity", "rotor_inertia"):
            as_number(getattr(self, field), f"{where} {field}", finite=False)
        if not self.lower < self.upper:
            raise InputError(f"{where} limits", f"lower {self.lower} is not below upper {self.upper}")
        if not self.velocity > 0:
            raise InputError(f"{where} velocity", f"{self.velocity} is not a positive limit")
        if not (math.isfinite(self.rotor_inertia) and self.rotor_inertia >= 0):
            raise InputError(f"{where} rotor_inertia", f"is {self.rotor_inertia}", "wanted zero or more")


@dataclass(frozen=True, kw_only=True)
class Frame:
    """A named frame fixed to a link, for links of a URDF that are fixed to others.

    Attributes:
        name: as ``contact.link`` may give it.
        link: number of the link it is fixed to (0 is moved by the first joint).
        origin: its position in the frame of that link [m].
        rotation: its orientation there, as rows of a rotation matrix.
    """

    name: str
    link: int
    origin: Vector3 = (0.0, 0.0, 0.0)
    rotation: Matrix3 = IDENTITY

    def __post_init__(self) -> None:
        check_name(self.name, "frame name")
        as_float_array(self.origin, f"frame {self.name!r} origin", (3,))
        check_rotation(self.rotation, f"frame {self.name!r} rotation")


def check_name(name: object, field: str) -> None:
    """Raise an InputError that names ``field`` where a name is none."""
    # Files for C++ programs have a name to the end of its line.
    if not isinstance(name, str) or not name.strip() or len(name.splitlines()) > 1:
        raise InputError(field, f"{name!r} is no name", "wanted text on one line")


def check_rotation(rows: Matrix3, field: str) -> None:
    """Raise an InputError that names ``field`` where rows are no rotation matrix."""
    rotation = as_float_array(rows, field, (3, 3))
    if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-9 or np.linalg.det(rotation) < 0:
        raise InputError(field, "is not a rotation matrix")
