"""Robots: serial chains with names, limits and where their figures come from."""

from __future__ import annotations

import math
import tomllib
from dataclasses import dataclass
from functools import cached_property, lru_cache
from importlib import resources
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.errors import InputError, near_matches
from bumpstop.kernels import core
from bumpstop.model.inertia import LinkInertia, Vector3

if TYPE_CHECKING:
    from collections.abc import Sequence

JointKind = Literal["revolute", "prismatic"]
_IDENTITY: tuple[Vector3, Vector3, Vector3] = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


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
    rotation: tuple[Vector3, Vector3, Vector3] = _IDENTITY
    axis: Vector3 = (0.0, 0.0, 1.0)
    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    inertia: LinkInertia | None = None
    rotor_inertia: float = 0.0

    def __post_init__(self) -> None:
        where = f"joint {self.name!r}"
        if self.kind not in ("revolute", "prismatic"):
            raise InputError(f"{where} kind", f"{self.kind!r} is no kind of joint", "valid: revolute, prismatic")
        as_float_array(self.origin, f"{where} origin", (3,))
        axis = as_float_array(self.axis, f"{where} axis", (3,))
        if abs(float(np.linalg.norm(axis)) - 1) > 1e-9:
            raise InputError(
                f"{where} axis", f"{self.axis} has length {np.linalg.norm(axis):.6g}", "wanted a unit vector"
            )
        rotation = as_float_array(self.rotation, f"{where} rotation", (3, 3))
        if np.abs(rotation @ rotation.T - np.eye(3)).max() > 1e-9 or np.linalg.det(rotation) < 0:
            raise InputError(f"{where} rotation", "is not a rotation matrix")
        if not self.lower < self.upper:
            raise InputError(f"{where} limits", f"lower {self.lower} is not below upper {self.upper}")
        if not self.velocity > 0:
            raise InputError(f"{where} velocity", f"{self.velocity} is not a positive limit")
        if not (math.isfinite(self.rotor_inertia) and self.rotor_inertia >= 0):
            raise InputError(f"{where} rotor_inertia", f"is {self.rotor_inertia}", "wanted zero or more")


@dataclass(frozen=True, kw_only=True)
class Robot:
    """A serial chain of one to sixteen joints. Immutable.

    Attributes:
        name: short name, as scenarios use it.
        joints: from the base to the tip.
        tip_name: name of the tip frame.
        tip_origin: its position in the frame of the last link [m].
        title, source, note: what it is, where its figures come from, what is uncertain about them.
        payload_kg: rated payload, or None.
    """

    name: str
    joints: tuple[Joint, ...]
    tip_name: str = "tool0"
    tip_origin: Vector3 = (0.0, 0.0, 0.0)
    title: str = ""
    source: str = ""
    note: str = ""
    payload_kg: float | None = None

    def __post_init__(self) -> None:
        if not 1 <= len(self.joints) <= core.max_joints:
            raise InputError("joints", f"{len(self.joints)} of them", f"wanted 1 to {core.max_joints}")
        for what, names in (
            ("joint", [j.name for j in self.joints]),
            ("link", [j.link for j in self.joints]),
        ):
            twice = {name for name in names if names.count(name) > 1}
            if twice:
                raise InputError(f"{what} names", f"{sorted(twice)[0]!r} occurs twice")
        as_float_array(self.tip_origin, "tip_origin", (3,))

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @cached_property
    def chain(self) -> Any:
        """The chain in the kernels' computing form."""
        return core.Chain(
            prismatic=[joint.kind == "prismatic" for joint in self.joints],
            origin=np.array([joint.origin for joint in self.joints], dtype=np.float64),
            rotation=np.array([joint.rotation for joint in self.joints], dtype=np.float64),
            axis=np.array([joint.axis for joint in self.joints], dtype=np.float64),
        )

    @property
    def span(self) -> float:
        """Length of the chain stretched out from its first joint to the tip [m]: no pose reaches farther from there.

        Prismatic joints count with their longest travel; infinite where that has no limit.
        """
        offsets = [joint.origin for joint in self.joints[1:]] + [self.tip_origin]
        travel = (max(abs(joint.lower), abs(joint.upper)) for joint in self.joints if joint.kind == "prismatic")
        return float(sum(np.linalg.norm(offset) for offset in offsets) + sum(travel))

    @property
    def lower(self) -> FloatArray:
        """Lower joint limits (dof,) [rad or m]."""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> FloatArray:
        """Upper joint limits (dof,) [rad or m]."""
        return np.array([joint.upper for joint in self.joints])

    @property
    def velocity(self) -> FloatArray:
        """Largest joint speeds (dof,) [rad/s or m/s]."""
        return np.array([joint.velocity for joint in self.joints])

    def frame(
        self, link: str | None, point: Sequence[float] | npt.ArrayLike = (0.0, 0.0, 0.0)
    ) -> tuple[int, FloatArray]:
        """Find a link by name and put a point into its frame.

        Args:
            link: name of a link, or of the tip, or None for the tip.
            point: in that frame [m], shape (3,).

        Returns:
            The link's number (0 is moved by the first joint) and the point in that link's frame [m].
        """
        offset = as_float_array(point, "point", (3,))
        if link is None or link == self.tip_name:
            return self.dof - 1, offset + np.asarray(self.tip_origin)
        names = [joint.link for joint in self.joints]
        if link not in names:
            raise InputError("link", f"{self.name} has no link {link!r}", near_matches(link, [*names, self.tip_name]))
        return names.index(link), offset

    def pose(
        self,
        q: npt.ArrayLike,
        link: str | None = None,
        point: Sequence[float] | npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> FloatArray:
        """Homogeneous transform X_BL of a link's frame, moved to a point of it, in the base frame B.

        Args:
            q: joint positions, (dof,) or (N, dof) [rad or m].
            link: name of a link; default: the tip.
            point: in the link's frame [m].

        Returns:
            (4, 4) or (N, 4, 4); translations in m.
        """
        return self._batched(q, self.chain.poses, link, point)

    def jacobian(
        self,
        q: npt.ArrayLike,
        link: str | None = None,
        point: Sequence[float] | npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> FloatArray:
        """Geometric Jacobian of a point of a link, in the base frame.

        Args:
            q: joint positions, (dof,) or (N, dof) [rad or m].
            link: name of a link; default: the tip.
            point: in the link's frame [m].

        Returns:
            (6, dof) or (N, 6, dof): rows 0..2 give the point's velocity [m/s per rad/s or m/s], rows 3..5 the
            link's angular velocity [rad/s per rad/s or m/s].
        """
        return self._batched(q, self.chain.jacobians, link, point)

    def _batched(self, q: npt.ArrayLike, function: Any, link: str | None, point: Any) -> FloatArray:
        number, offset = self.frame(link, point)
        try:
            single = np.ndim(q) == 1
        except ValueError:  # rows of different lengths, refused by the same door as everything else
            single = False
        rows = as_float_array(q, "q", (self.dof,))[None] if single else as_float_array(q, "q", (None, self.dof))
        result: FloatArray = function(rows, number, np.ascontiguousarray(offset))
        return result[0] if single else result

    @classmethod
    def load(cls, name: str) -> Robot:
        """Load a built-in robot by name.

        Raises:
            InputError: there is none of that name; near matches are offered.
        """
        if name not in robots():
            raise InputError("robot", f"there is no built-in robot {name!r}", near_matches(name, robots()))
        return _load_builtin(name)


def robots() -> tuple[str, ...]:
    """Names of the built-in robots."""
    folder = resources.files("bumpstop.model") / "data"
    return tuple(sorted(Path(entry.name).stem for entry in folder.iterdir() if entry.name.endswith(".toml")))


@lru_cache
def _load_builtin(name: str) -> Robot:
    text = (resources.files("bumpstop.model") / "data" / f"{name}.toml").read_text(encoding="utf-8")
    return robot_from_dict(tomllib.loads(text))


def robot_from_dict(data: dict[str, Any]) -> Robot:
    """Build a robot from the contents of a robot file (see docs/model.md for its keys)."""
    return Robot(
        name=data["name"],
        title=data.get("title", ""),
        source=data.get("source", ""),
        note=data.get("note", ""),
        payload_kg=data.get("payload_kg"),
        tip_name=data["tip"]["name"],
        tip_origin=_vector(data["tip"]["origin_m"]),
        joints=tuple(_joint_from_dict(joint) for joint in data["joint"]),
    )


def _joint_from_dict(joint: dict[str, Any]) -> Joint:
    kind: JointKind = joint.get("kind", "revolute")
    if kind == "prismatic":
        lower, upper, velocity = (float(joint[key]) for key in ("lower_m", "upper_m", "velocity_m_s"))
    else:
        lower, upper, velocity = (math.radians(joint[key]) for key in ("lower_deg", "upper_deg", "velocity_deg_s"))
    rotation = rotation_from_rpy(*(math.radians(angle) for angle in joint.get("rpy_deg", (0.0, 0.0, 0.0))))
    return Joint(
        name=joint["name"],
        link=joint["link"],
        kind=kind,
        origin=_vector(joint["origin_m"]),
        rotation=(_vector(rotation[0]), _vector(rotation[1]), _vector(rotation[2])),
        axis=_vector(joint["axis"]),
        lower=lower,
        upper=upper,
        velocity=velocity,
    )


def _vector(values: Any) -> Vector3:
    x, y, z = (float(value) for value in values)
    return x, y, z
