"""What is known of one quantity of a drive train, and which quantities there are."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, get_args

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.errors import InputError, near_matches

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


def entry_of_some(
    quantity: str, known: FloatArray, others: FloatArray, source: str, others_source: str
) -> DriveTrainEntry:
    """What a file tells of a quantity of some joints or all.

    Args:
        quantity: name of it.
        known: one for each joint, nan where the file tells none.
        others: what is taken there, one for each joint.
        source: of what is known, in words.
        others_source: of the others.

    Returns:
        ``"unverified"`` where every joint is told, else ``"assumed"``.
    """
    told = ~np.isnan(known)
    if not told.all():
        numbers = ", ".join(str(number) for number in 1 + np.flatnonzero(told))
        source += f" for joint {numbers}; {others_source} for the others"
    return DriveTrainEntry(
        quantity=quantity,
        values=tuple(np.where(told, known, others).tolist()),
        status="unverified" if told.all() else "assumed",
        source=source,
    )


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


def check_entries(entries: Sequence[DriveTrainEntry], dof: int) -> None:
    """Refuse entries of a robot that do not fit its number of joints, or a quantity given twice.

    Raises:
        InputError: names the quantity.
    """
    seen: set[str] = set()
    for entry in entries:
        where = f"drive_train.{entry.quantity}"
        if len(entry.values) != dof:
            raise InputError(where, f"has {len(entry.values)} values", f"wanted {dof}, one for each joint")
        if entry.quantity in seen:
            raise InputError(where, "occurs twice", "give it once")
        seen.add(entry.quantity)
