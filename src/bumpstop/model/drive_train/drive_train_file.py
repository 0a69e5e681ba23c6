"""Drive train files: read strictly."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bumpstop.errors import InputError, near_matches
from bumpstop.model.drive_train.drive_train import DriveTrain
from bumpstop.model.drive_train.entry import QUANTITIES, DriveTrainEntry
from bumpstop.model.drive_train.entry_tables import FORMAT_VERSION, entries_from_table
from bumpstop.model.drive_train.mjcf import rotors_of_mjcf
from bumpstop.model.robot import Robot
from bumpstop.text_files import other_robot, parse_toml, read_text

_HEAD = ("format_version", "robot", "joints")


def load_drive_train(path: str | os.PathLike[str], robot: Robot) -> DriveTrain:
    """Read the drive train of a robot from a file (see docs/reference/robot/drive_train.md for its keys).

    Args:
        path: of the file: TOML; or MJCF (``.xml``), whose ``armature`` of joints is their rotor inertia.
        robot: whose joints it must name. What the file leaves out is :attr:`bumpstop.model.Robot.drive_train`'s.

    Raises:
        InputError: the file cannot be read, is of another robot's joints, or has a key or value that cannot be used;
            names the file and the key.
    """
    found = robot.drive_train
    if Path(path).suffix.lower() == ".xml":
        entry = rotors_of_mjcf(Path(path), robot)
        return found.with_values(entry.quantity, entry.values, entry.status, entry.source)
    data = parse_toml(read_text(path, "wanted a drive train file (TOML)"), str(path))
    try:
        for entry in _entries_of_file(data, robot):
            found = found.with_values(entry.quantity, entry.values, entry.status, entry.source)
        return found
    except InputError as error:
        raise InputError(f"{path} {error.field}", error.problem, error.valid) from None


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
    # Arms of one maker share the names of their joints.
    if other_robot(str(data["robot"]), robot.name):
        raise InputError("robot", f"is {data['robot']!r}, and the arm is {robot.name!r}", "wanted its own drive train")
    tables = {key: value for key, value in data.items() if key not in _HEAD}
    for key in tables:
        if key not in QUANTITIES:
            near = near_matches(str(key), (*_HEAD, *QUANTITIES))
            raise InputError(str(key), "is no key of a drive train file", near)
    return entries_from_table(tables, robot.dof, "")
