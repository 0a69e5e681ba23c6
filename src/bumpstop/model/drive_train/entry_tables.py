"""Drive trains in TOML, in files of their own and in those of robots: read strictly, written with all digits."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from bumpstop.errors import InputError, near_matches
from bumpstop.model.drive_train.entry import QUANTITIES, DriveTrainEntry, check_status, checked_values
from bumpstop.model.serial_chain import SerialChain
from bumpstop.text_files import to_toml

FORMAT_VERSION = 1
# The unit of the values is in their key, as everywhere in files; what slides has m for rad and N for Nm.
_VALUES = {
    "rotor_inertia": "values_kg_m2",
    "gear_stiffness": "values_Nm_rad",
    "gear_damping": "values",
    "servo_bandwidth": "values_rad_s",
    "servo_position_gain": "values_per_s",
    "torque_limit": "values_Nm",
    "acceleration_feedforward": "values",
}


def entries_to_toml(entries: Sequence[DriveTrainEntry], robot: SerialChain) -> str:
    """The text of a drive train file of a robot."""
    data: dict[str, Any] = {
        "format_version": FORMAT_VERSION,
        "robot": robot.name,
        "joints": [joint.name for joint in robot.joints],
    }
    for entry in entries:
        data[entry.quantity] = {
            _VALUES[entry.quantity]: list(entry.values),
            "status": entry.status,
            "source": entry.source,
        }
    return to_toml(data)


def entries_from_table(data: Any, dof: int, where: str = "drive_train.") -> tuple[DriveTrainEntry, ...]:
    """Read ``[drive_train]`` of a robot file: a table for each quantity.

    Args:
        data: the table.
        dof: number of joints.
        where: what errors begin with.

    Raises:
        InputError: a key is unknown, missing or has a value that cannot be used.
    """
    if not isinstance(data, Mapping):
        raise InputError(where.rstrip("."), f"{data!r} is not a table", f"wanted [{where}rotor_inertia] and the like")
    for key in data:
        if key not in QUANTITIES:
            raise InputError(f"{where}{key}", "is no quantity of a drive train", near_matches(str(key), QUANTITIES))
    return tuple(_entry(data[name], name, dof, f"{where}{name}") for name in QUANTITIES if name in data)


def _entry(data: Any, name: str, dof: int, where: str) -> DriveTrainEntry:
    values, keys = _VALUES[name], (_VALUES[name], "status", "source")
    if not isinstance(data, Mapping):
        raise InputError(where, f"{data!r} is not a table", f"wanted {', '.join(keys)}")
    for key in data:
        if key not in keys:
            raise InputError(f"{where}.{key}", "is not a key of it", near_matches(str(key), keys))
    for key in keys:
        if key not in data:
            raise InputError(f"{where}.{key}", "is missing", f"wanted {', '.join(keys)}")
    check_status(data["status"], f"{where}.status")
    source = data["source"]
    if not isinstance(source, str) or not source.strip():
        raise InputError(f"{where}.source", f"{source!r} cannot be used", "wanted text: where the figures come from")
    numbers = checked_values(data[values], name, f"{where}.{values}", dof)
    return DriveTrainEntry(quantity=name, values=tuple(numbers.tolist()), status=data["status"], source=source)
