"""Serial chains: joints with names, limits and masses, and where points of the links are."""

from __future__ import annotations

import reprlib
from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_float_array, as_rows
from bumpstop.errors import InputError, near_matches
from bumpstop.model.drive_train.entry import DriveTrainEntry, check_entries
from bumpstop.model.inertia import Matrix3, Vector3
from bumpstop.model.inertia_doubts import inertia_doubts
from bumpstop.model.joint import IDENTITY, Frame, Joint, check_name, check_rotation
from bumpstop.model.length_doubts import length_doubts
from bumpstop.model.reach import reach

# Of a point from the frame of its link, along each axis: farther than any arm, near enough that no product overflows.
MAX_POINT_M = 100.0
# A joint no farther beyond its limit than this stands on it, as `limit_rounding` of the kernels [rad or m].
LIMIT_ROUNDING = 1e-9

InertiaStatus = Literal["published", "unverified", "assumed", "unknown"]


def checked_point(point: Any, field: str = "point") -> FloatArray:
    """A point in the frame of a link, shape (3,) [m].

    Raises:
        InputError: it is none, or too far away for any arm.
    """
    given = as_float_array(point, field, (3,))
    if (np.abs(given) > MAX_POINT_M).any():
        said = ",".join(f"{x:.6g}" for x in given)
        raise InputError(field, f"is {said}", f"wanted from -{MAX_POINT_M:g} to {MAX_POINT_M:g} m along each axis")
    return given


@dataclass(frozen=True, kw_only=True, repr=False)
class SerialChain:
    """A robot without what is read or assumed for it; :class:`bumpstop.model.Robot` says what the fields are."""

    name: str
    joints: tuple[Joint, ...]
    tip_name: str = "tool0"
    tip_origin: Vector3 = (0.0, 0.0, 0.0)
    tip_rotation: Matrix3 = IDENTITY
    frames: tuple[Frame, ...] = ()
    title: str = ""
    source: str = ""
    note: str = ""
    warnings: tuple[str, ...] = ()
    mass_warnings: tuple[str, ...] = ()
    payload_kg: float | None = None
    inertia_status: InertiaStatus = "unknown"
    inertia_source: str = ""
    drive_train_entries: tuple[DriveTrainEntry, ...] = ()
    base_joints: tuple[str, ...] = ()
    other_joints: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        check_name(self.name, "name")
        check_name(self.tip_name, "tip name")
        if not 1 <= len(self.joints) <= _native.max_joints:
            raise InputError("joints", f"{len(self.joints)} of them", f"wanted 1 to {_native.max_joints}")
        for what, names in (
            ("joint", [j.name for j in self.joints]),
            ("link", [*(j.link for j in self.joints), *(frame.name for frame in self.frames)]),
        ):
            twice = {name for name in names if names.count(name) > 1}
            if twice:
                raise InputError(f"{what} names", f"{sorted(twice)[0]!r} occurs twice")
        as_float_array(self.tip_origin, "tip_origin", (3,))
        check_rotation(self.tip_rotation, "tip_rotation")
        for frame in self.frames:
            if not 0 <= frame.link < self.dof:
                raise InputError(
                    f"frame {frame.name!r} link", f"{frame.link} is no link", f"wanted 0 to {self.dof - 1}"
                )
        self._check_tip_name()
        if self.inertia_status not in get_args(InertiaStatus):
            valid = "valid: " + ", ".join(get_args(InertiaStatus))
            raise InputError("inertia_status", f"{self.inertia_status!r} is none", valid)
        if self.inertia_status != "unknown":
            for joint in self.joints:
                if joint.inertia is None:
                    problem = f'is missing, and inertia_status is "{self.inertia_status}"'
                    raise InputError(f"joint {joint.name!r} inertia", problem, 'give it, or inertia_status = "unknown"')
        check_entries(self.drive_train_entries, self.dof)

    def __repr__(self) -> str:
        """Its name and its joints': their figures would fill a screen."""
        joints = ", ".join(joint.name for joint in self.joints)
        return f"{type(self).__name__}({self.name!r}, {self.dof} joints: {joints})"

    def __getstate__(self) -> dict[str, Any]:
        """To be pickled or copied: what it was made of, without what the kernels keep of it."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    def _check_tip_name(self) -> None:
        """Of two frames with one name the second could never be named. The tip may be the last link itself."""
        in_place = tuple(self.tip_origin) == (0.0, 0.0, 0.0) and self._tip_is_straight
        others = [*(joint.link for joint in self.joints), *(frame.name for frame in self.frames)]
        if self.tip_name in others and not (in_place and self.tip_name == self.joints[-1].link):
            raise InputError("tip name", f"{self.tip_name!r} is the name of a link, too", "give the tip another name")

    @property
    def _tip_is_straight(self) -> bool:
        return bool((np.asarray(self.tip_rotation) == np.eye(3)).all())

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @cached_property
    def _tip(self) -> Frame:
        return Frame(name=self.tip_name, link=self.dof - 1, origin=self.tip_origin, rotation=self.tip_rotation)

    @cached_property
    def chain(self) -> Any:
        """The chain in the kernels' computing form, its axes of length one to the last digit."""
        axes = np.array([joint.axis for joint in self.joints], dtype=np.float64)
        return _native.Chain(
            prismatic=[joint.kind == "prismatic" for joint in self.joints],
            origin=np.array([joint.origin for joint in self.joints], dtype=np.float64),
            rotation=np.array([joint.rotation for joint in self.joints], dtype=np.float64),
            axis=axes / np.linalg.norm(axes, axis=1, keepdims=True),
        )

    @cached_property
    def dynamics(self) -> Any:
        """The chain with its inertia in the kernels' form; every link must have one."""
        unknown = [joint.link for joint in self.joints if joint.inertia is None]
        if unknown:
            raise InputError("robot", f"{self.name}: no inertia of link {unknown[0]!r} is known", "dynamics needs it")
        links = [joint.inertia.kernel(joint.rotor_inertia) for joint in self.joints if joint.inertia is not None]
        return _native.Dynamics(self.chain, links)

    @property
    def span(self) -> float:
        """Length of the chain stretched out from its first joint to the tip [m]: no pose reaches farther from there.

        Prismatic joints count with their longest travel; infinite where that has no limit.
        """
        offsets = [joint.origin for joint in self.joints[1:]] + [self.tip_origin]
        travel = (max(abs(joint.lower), abs(joint.upper)) for joint in self.joints if joint.kind == "prismatic")
        return float(sum(np.linalg.norm(offset) for offset in offsets) + sum(travel))

    @cached_property
    def reach(self) -> float:
        """Farthest the tip gets from the axis of joint 1 within the joints' limits [m].

        Where joint 1 slides: from where it stands. Infinite where a joint slides without a limit. A search finds it,
        with the same value every time, which may fall short by some 1e-4 of it.
        """
        return reach(self.joints, lambda q: self.pose(q)[:, :3, 3])

    @cached_property
    def turning_reach(self) -> float:
        """As :attr:`reach`, with joints that slide held: how large the arm is on whatever rail [m]."""
        if all(joint.kind == "revolute" for joint in self.joints):
            return self.reach
        return reach(self.joints, lambda q: self.pose(q)[:, :3, 3], slides=False)

    @cached_property
    def inertia_doubts(self) -> tuple[str, ...]:
        """Why the inertia is probably a placeholder; empty where it is published, or plausible for an arm.

        See :func:`bumpstop.model.inertia_doubts.inertia_doubts`.
        """
        if self.inertia_status == "published" or all(joint.inertia is None for joint in self.joints):
            return ()
        return inertia_doubts(self.name, self.joints, self.reach, self.turning_reach)

    @cached_property
    def length_doubts(self) -> tuple[str, ...]:
        """Why the lengths are probably not in metres; empty where they are plausible for an arm.

        See :func:`bumpstop.model.length_doubts.length_doubts`.
        """
        return length_doubts(self.name, self.joints, self.tip_name, self.tip_origin)

    @property
    def doubts(self) -> tuple[str, ...]:
        """What is doubted of it, or left out, and counts wherever it moves: its warnings but for masses and drives."""
        told = (warning for warning in self.warnings if warning not in self.mass_warnings)
        return tuple(dict.fromkeys((*told, *self.length_doubts)))

    @property
    def inertia_objection(self) -> str:
        """Why no verdict may rest on its masses, in a sentence; empty: nothing is against it.

        It is a link without inertia, or what :attr:`inertia_doubts` finds. That nothing is found does not say that the
        inertia was measured (:attr:`inertia_status`).
        """
        without = [joint.link for joint in self.joints if joint.inertia is None]
        if without:
            names = ", ".join(repr(name) for name in without[:5])
            return f"The inertia of {self.name} is not known: no mass of {names}."
        # By lengths in another unit every mass is too small or too large.
        return " ".join((*self.length_doubts, *self.inertia_doubts)) if self.inertia_doubts else ""

    @property
    def lower(self) -> FloatArray:
        """Lower joint limits (dof,) [rad or m]."""
        return np.array([joint.lower for joint in self.joints])

    @property
    def upper(self) -> FloatArray:
        """Upper joint limits (dof,) [rad or m]."""
        return np.array([joint.upper for joint in self.joints])

    def beyond_limits(self, q: FloatArray) -> npt.NDArray[np.bool_]:
        """Which joints of poses (..., dof) [rad or m] are outside their limits, by more than rounding (..., dof)."""
        return np.asarray(~((q >= self.lower - LIMIT_ROUNDING) & (q <= self.upper + LIMIT_ROUNDING)))

    @property
    def velocity(self) -> FloatArray:
        """Largest joint speeds (dof,) [rad/s or m/s]."""
        return np.array([joint.velocity for joint in self.joints])

    def frame(
        self, link: str | None, point: Sequence[float] | npt.ArrayLike = (0.0, 0.0, 0.0)
    ) -> tuple[int, FloatArray]:
        """Find a link by name and put a point into its frame.

        Args:
            link: name of a link, of a frame fixed to one, or of the tip, or None for the tip.
            point: in that frame [m], shape (3,).

        Returns:
            The link's number (0 is moved by the first joint) and the point in that link's frame [m].
        """
        number, offset, _ = self._place(link, point)
        return number, offset

    def _place(self, link: str | None, point: Any) -> tuple[int, FloatArray, FloatArray | None]:
        """Link number, point in the link's frame, and how the named frame is turned there (None: it is not)."""
        offset = checked_point(point)
        names = [joint.link for joint in self.joints]
        if link is not None and not isinstance(link, str):
            # An array compares item by item.
            near = near_matches(str(link), [*names, *(frame.name for frame in self.frames), self.tip_name])
            raise InputError("link", f"{self.name} has no link {reprlib.repr(link)}", near)
        if link is None or link == self.tip_name:
            frame = self._tip
        elif link in names:
            return names.index(link), offset, None
        else:
            fixed = {frame.name: frame for frame in self.frames}
            if link not in fixed:
                near = near_matches(str(link), [*names, *fixed, self.tip_name])
                raise InputError("link", f"{self.name} has no link {link!r}", near)
            frame = fixed[link]
        rotation = np.asarray(frame.rotation, dtype=np.float64)
        if (rotation == np.eye(3)).all():
            return frame.link, offset + np.asarray(frame.origin), None
        return frame.link, np.asarray(frame.origin) + rotation @ offset, rotation

    def pose(
        self,
        q: npt.ArrayLike,
        link: str | None = None,
        point: Sequence[float] | npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> FloatArray:
        """Homogeneous transform X_BL of a link's frame, moved to a point of it, in the base frame B.

        Args:
            q: joint positions, (dof,) or (N, dof) [rad or m].
            link: name of a link or frame; default: the tip.
            point: in the link's frame [m].

        Returns:
            (4, 4) or (N, 4, 4); translations in m.
        """
        number, offset, rotation = self._place(link, point)
        poses = self._batched(q, self.chain.poses, number, offset)
        if rotation is not None:
            poses[..., :3, :3] = poses[..., :3, :3] @ rotation
        return poses

    def jacobian(
        self,
        q: npt.ArrayLike,
        link: str | None = None,
        point: Sequence[float] | npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> FloatArray:
        """Geometric Jacobian of a point of a link, in the base frame.

        Args:
            q: joint positions, (dof,) or (N, dof) [rad or m].
            link: name of a link or frame; default: the tip.
            point: in the link's frame [m].

        Returns:
            (6, dof) or (N, 6, dof): rows 0..2 give the point's velocity [m/s per rad/s or m/s], rows 3..5 the
            link's angular velocity [rad/s per rad/s or m/s].
        """
        number, offset, _ = self._place(link, point)
        return self._batched(q, self.chain.jacobians, number, offset)

    def _batched(self, q: npt.ArrayLike, function: Any, number: int, offset: FloatArray) -> FloatArray:
        rows, single = as_rows(q, "q", self.dof)
        result: FloatArray = function(rows, number, np.ascontiguousarray(offset))
        return result[0] if single else result
