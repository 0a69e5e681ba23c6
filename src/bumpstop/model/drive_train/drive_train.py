"""What stands between the motors of an arm and its links: rotors, gears that are springs, and the servo."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.errors import InputError, near_matches

if TYPE_CHECKING:
    from bumpstop.model.robot import Robot

DriveTrainStatus = Literal["published", "identified", "unverified", "assumed"]

# Each quantity and its unit where a joint turns and where it slides.
QUANTITIES: dict[str, tuple[str, str]] = {
    "rotor_inertia": ("kg m2", "kg"),
    "gear_stiffness": ("Nm/rad", "N/m"),
    "gear_damping": ("1", "1"),
    "servo_bandwidth": ("rad/s", "rad/s"),
    "servo_position_gain": ("1/s", "1/s"),
    "torque_limit": ("Nm", "N"),
    "acceleration_feedforward": ("1", "1"),
}
# A gear that is as good as rigid has 1e9 Nm/rad; what is beyond these is a slip of the unit.
_MAX = {"gear_damping": 10.0, "servo_bandwidth": 1e6, "servo_position_gain": 1e6}
_MAX_OF_OTHERS = 1e12


@dataclass(frozen=True, kw_only=True)
class DriveTrainEntry:
    """What is known of one quantity of a robot's drive train.

    Attributes:
        quantity: name of it, one of :class:`DriveTrain`.
        values: one for each joint.
        status: where they come from.
        source: in words.
    """

    quantity: str
    values: tuple[float, ...]
    status: DriveTrainStatus
    source: str

    def __post_init__(self) -> None:
        if self.quantity not in QUANTITIES:
            near = near_matches(str(self.quantity), QUANTITIES)
            raise InputError("quantity", f"{self.quantity!r} is none of a drive train", near)
        checked_values(self.values, self.quantity, self.quantity, len(self.values))
        check_status(self.status, f"{self.quantity} status")


@dataclass(frozen=True, kw_only=True, eq=False)
class DriveTrain:
    """Rotors, gears and servos of an arm, one figure per joint (dof,). A prismatic joint has m for rad and N for Nm.

    With the mass matrix M of the links, the motors' angles reflected to the joints and the joints' own:

        M qdd   = Kg (theta - q) + Dg (theta' - q') + external torque
        B thdd  = -Kg (theta - q) - Dg (theta' - q') - P (theta - theta_r) - D (theta' - theta_r')
        D = w_v (B + diag M),  P = w_p D

    B is :attr:`rotor_inertia`, Kg :attr:`gear_stiffness`, w_v :attr:`servo_bandwidth`, w_p :attr:`servo_position_gain`.
    (Spong 1987, with a cascade of velocity and position control at the motors.)

    Attributes:
        rotor_inertia: of motor and gear, reflected to the joint (times the gear ratio squared) [kg m2 or kg].
        gear_stiffness: between rotor and link, seen at the joint [Nm/rad or N/m].
        gear_damping: of the gear, as a share of the critical damping of rotor and link about it [1].
        servo_bandwidth: of the velocity loop, w_v [rad/s].
        servo_position_gain: of the position loop, w_p: commanded rate per error of position [1/s].
        torque_limit: most that the motor gives at the joint [Nm or N]; infinite: unknown.
        acceleration_feedforward: share of the reference's acceleration torque that the controller feeds forward,
            0 to 1.
        status: of each quantity, by name: ``"published"``, ``"identified"`` (from recordings or pushes of the arm),
            ``"unverified"`` (as a URDF or MJCF has it) or ``"assumed"``. Of joints that differ, the least known.
        source: where each quantity comes from, by name.
    """

    rotor_inertia: FloatArray
    gear_stiffness: FloatArray
    gear_damping: FloatArray
    servo_bandwidth: FloatArray
    servo_position_gain: FloatArray
    torque_limit: FloatArray
    acceleration_feedforward: FloatArray
    status: Mapping[str, DriveTrainStatus] = field(default_factory=dict)
    source: Mapping[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        dof = int(np.size(self.rotor_inertia))
        for name in QUANTITIES:
            values = checked_values(getattr(self, name), name, name, dof)
            values.flags.writeable = False
            object.__setattr__(self, name, values)
        for given, what in ((self.status, "status"), (self.source, "source")):
            for name in given:
                if name not in QUANTITIES:
                    raise InputError(
                        f"{what}[{name!r}]", "is no quantity of a drive train", near_matches(name, QUANTITIES)
                    )
        words = {name: self.status.get(name, "assumed") for name in QUANTITIES}
        for name, word in words.items():
            check_status(word, f"status[{name!r}]")
        object.__setattr__(self, "status", words)
        object.__setattr__(self, "source", {name: str(self.source.get(name, "")) for name in QUANTITIES})

    @property
    def dof(self) -> int:
        """Number of joints."""
        return int(self.rotor_inertia.size)

    @property
    def assumed(self) -> tuple[str, ...]:
        """Names of the quantities that are assumed: vary a result over them."""
        return tuple(name for name in QUANTITIES if self.status[name] == "assumed")

    def with_values(self, quantity: str, values: npt.ArrayLike, status: DriveTrainStatus, source: str) -> DriveTrain:
        """The same drive train with another figure for one quantity.

        Args:
            quantity: name of it.
            values: one for each joint (dof,), or one for all.
            status: where they come from.
            source: in words.

        Raises:
            InputError: there is no such quantity, or a value that cannot be used.
        """
        if quantity not in QUANTITIES:
            raise InputError("quantity", f"{quantity!r} is none of a drive train", near_matches(quantity, QUANTITIES))
        changed: dict[str, Any] = {
            quantity: checked_values(values, quantity, quantity, self.dof),
            "status": {**self.status, quantity: status},
            "source": {**self.source, quantity: source},
        }
        return replace(self, **changed)

    def save(self, path: str | os.PathLike[str], robot: Robot, *, only: tuple[str, ...] | None = None) -> None:
        """Write a file that :func:`bumpstop.model.load_drive_train` reads.

        Args:
            path: of the file.
            robot: whose drive train it is; its joints are named in the file.
            only: quantities to write; default: all.

        Raises:
            InputError: another number of joints, a quantity that is none, or a file that cannot be written.
        """
        from bumpstop.model.drive_train.drive_train_file import save_drive_train

        save_drive_train(self, path, robot, only=only)

    def scaled(self, quantity: str, factor: float) -> DriveTrain:
        """The same drive train with one quantity times a factor, to see how much hangs on it; its status stays."""
        if quantity not in QUANTITIES:
            raise InputError("quantity", f"{quantity!r} is none of a drive train", near_matches(quantity, QUANTITIES))
        return self.with_values(
            quantity, getattr(self, quantity) * factor, self.status[quantity], self.source[quantity]
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, DriveTrain):
            return NotImplemented
        return all(
            bool(np.array_equal(getattr(self, f.name), getattr(other, f.name)))
            if f.name in QUANTITIES
            else getattr(self, f.name) == getattr(other, f.name)
            for f in fields(self)
        )

    __hash__ = None  # type: ignore[assignment]


def checked_values(values: Any, quantity: str, where: str, dof: int) -> FloatArray:
    """The figures of one quantity (dof,), which one number may stand for.

    Args:
        values: one number, or one a joint.
        quantity: name of it.
        where: how errors call it.
        dof: number of joints.

    Raises:
        InputError: another shape, or a value outside of what the quantity can have.
    """
    single = np.ndim(values) == 0 and not isinstance(values, str)
    array = as_float_array([values] * dof if single else values, where, (dof,), finite=False).copy()
    for joint, value in enumerate(array, start=1):
        if quantity == "acceleration_feedforward":
            if not 0 <= value <= 1:
                raise InputError(f"{where}[{joint}]", f"is {value:g}", "wanted 0 to 1")
            continue
        most = _MAX.get(quantity, _MAX_OF_OTHERS)
        if quantity == "torque_limit" and value == math.inf:
            continue
        if not (value > 0 and math.isfinite(value)):
            unknown = ", or inf where it is unknown" if quantity == "torque_limit" else ""
            raise InputError(f"{where}[{joint}]", f"is {value:g}", f"wanted a positive finite number{unknown}")
        if value > most:
            raise InputError(f"{where}[{joint}]", f"is {value:g}", f"wanted at most {most:g}")
    return array


def check_status(word: object, where: str) -> None:
    """Refuse what is no status.

    Raises:
        InputError: it is none.
    """
    if word not in get_args(DriveTrainStatus):
        raise InputError(where, f"{word!r} is none", "valid: " + ", ".join(get_args(DriveTrainStatus)))


def least_known(words: Sequence[DriveTrainStatus]) -> DriveTrainStatus:
    """The status of several figures together: that of the least known of them."""
    order: tuple[DriveTrainStatus, ...] = get_args(DriveTrainStatus)
    return max(words, key=order.index)


def check_entries(robot: Robot) -> None:
    """Refuse entries of a robot that do not fit its joints, or a quantity given twice.

    Raises:
        InputError: names the quantity.
    """
    seen: set[str] = set()
    for entry in robot.drive_train_entries:
        where = f"drive_train.{entry.quantity}"
        if len(entry.values) != robot.dof:
            raise InputError(where, f"has {len(entry.values)} values", f"wanted {robot.dof}, one for each joint")
        if entry.quantity in seen:
            raise InputError(where, "occurs twice", "give it once")
        seen.add(entry.quantity)


def drive_train_of(robot: Robot) -> DriveTrain:
    """See :attr:`bumpstop.model.Robot.drive_train`."""
    from bumpstop.model.drive_train.assumed import assumed_drive_train

    found = assumed_drive_train(robot)
    for entry in robot.drive_train_entries:
        found = found.with_values(entry.quantity, entry.values, entry.status, entry.source)
    rotors = np.array([joint.rotor_inertia for joint in robot.joints])
    if (rotors > 0).any():
        words: list[DriveTrainStatus] = [
            robot.inertia_status if robot.inertia_status in ("published", "unverified") else "assumed"
        ]
        if not (rotors > 0).all():
            words.append(found.status["rotor_inertia"])
        values = np.where(rotors > 0, rotors, found.rotor_inertia)
        source = robot.inertia_source or "rotors of the robot's joints"
        found = found.with_values("rotor_inertia", values, least_known(words), source)
    return found
