"""What stands between the motors of an arm and its links: rotors, gears that are springs, and the servo."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError, near_matches
from bumpstop.model.drive_train.entry import QUANTITIES, DriveTrainEntry, DriveTrainStatus, check_status, checked_values
from bumpstop.model.drive_train.entry_tables import entries_to_toml
from bumpstop.model.serial_chain import SerialChain
from bumpstop.text_files import write_text


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

    def save(self, path: str | os.PathLike[str], robot: SerialChain, *, only: tuple[str, ...] | None = None) -> None:
        """Write a file that :func:`bumpstop.model.load_drive_train` reads.

        Args:
            path: of the file.
            robot: whose drive train it is; its joints are named in the file.
            only: quantities to write; default: all.

        Raises:
            InputError: another number of joints, a quantity that is none, or a file that cannot be written.
        """
        if self.dof != robot.dof:
            raise InputError("drive_train", f"has {self.dof} joints", f"wanted {robot.dof}, as {robot.name} has")
        for name in only or ():
            if name not in QUANTITIES:
                raise InputError("only", f"{name!r} is no quantity of a drive train", near_matches(name, QUANTITIES))
        entries = [self.entry(name) for name in (QUANTITIES if only is None else only)]
        write_text(path, entries_to_toml(entries, robot))

    def entry(self, quantity: str) -> DriveTrainEntry:
        """One quantity with its status and source."""
        return DriveTrainEntry(
            quantity=quantity,
            values=tuple(getattr(self, quantity).tolist()),
            status=self.status[quantity],
            source=self.source[quantity],
        )

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
