"""Drive train files, and the table of a robot file that says the same: read strictly, written with all digits."""

from __future__ import annotations

import os
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError, near_matches
from bumpstop.model.drive_train.drive_train import QUANTITIES, DriveTrain, DriveTrainEntry, check_status, checked_values
from bumpstop.text_files import parse_toml, read_text, to_toml, write_text

if TYPE_CHECKING:
    from bumpstop.model.robot import Robot

FORMAT_VERSION = 1
_HEAD = ("format_version", "robot", "joints")
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


def load_drive_train(path: str | os.PathLike[str], robot: Robot) -> DriveTrain:
    """Read the drive train of a robot from a file (see docs/reference/robot/drive_train.md for its keys).

    Args:
        path: of the file.
        robot: whose joints it must name. What the file leaves out is :attr:`bumpstop.model.Robot.drive_train`'s.

    Raises:
        InputError: the file cannot be read, is of another robot's joints, or has a key or value that cannot be used;
            names the file and the key.
    """
    data = parse_toml(read_text(path, "wanted a drive train file (TOML)"), str(path))
    try:
        found = robot.drive_train
        for entry in _entries_of_file(data, robot):
            found = found.with_values(entry.quantity, entry.values, entry.status, entry.source)
        return found
    except InputError as error:
        raise InputError(f"{path} {error.field}", error.problem, error.valid) from None


def save_drive_train(
    drive_train: DriveTrain, path: str | os.PathLike[str], robot: Robot, *, only: tuple[str, ...] | None = None
) -> None:
    """See :meth:`bumpstop.model.DriveTrain.save`."""
    if drive_train.dof != robot.dof:
        raise InputError("drive_train", f"has {drive_train.dof} joints", f"wanted {robot.dof}, as {robot.name} has")
    for name in only or ():
        if name not in QUANTITIES:
            raise InputError("only", f"{name!r} is no quantity of a drive train", near_matches(name, QUANTITIES))
    write_text(path, drive_train_to_toml(drive_train, robot, only=only))


def drive_train_to_toml(drive_train: DriveTrain, robot: Robot, *, only: tuple[str, ...] | None = None) -> str:
    """The file that :func:`save_drive_train` writes."""
    data: dict[str, Any] = {
        "format_version": FORMAT_VERSION,
        "robot": robot.name,
        "joints": [joint.name for joint in robot.joints],
    }
    for name in QUANTITIES if only is None else only:
        data[name] = {
            _VALUES[name]: getattr(drive_train, name).tolist(),
            "status": drive_train.status[name],
            "source": drive_train.source[name],
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


def _entries_of_file(data: Mapping[str, Any], robot: Robot) -> tuple[DriveTrainEntry, ...]:
    for key in _HEAD:
        if key not in data:
            raise InputError(key, "is missing", "wanted a drive train file")
    version = data["format_version"]
    if type(version) is not int or version != FORMAT_VERSION:
        raise InputError("format_version", f"is {version!r}", f"wanted {FORMAT_VERSION}")
    names = [joint.name for joint in robot.joints]
    if data["joints"] != names:
        raise InputError("joints", f"{data['joints']!r} are not those of {robot.name}", f"wanted {names!r}")
    tables = {key: value for key, value in data.items() if key not in _HEAD}
    for key in tables:
        if key not in QUANTITIES:
            near = near_matches(str(key), (*_HEAD, *QUANTITIES))
            raise InputError(str(key), "is no key of a drive train file", near)
    return entries_from_table(tables, robot.dof, "")


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
