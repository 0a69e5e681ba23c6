"""What an MJCF file, the format of MuJoCo, says of motors: the ``armature`` of joints."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError
from bumpstop.model.drive_train.entry import DriveTrainEntry, entry_of_some
from bumpstop.model.robot import Robot
from bumpstop.model.urdf.xml_elements import children, cut, local, numbers, parse

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_MAIN = "main"  # the class of what names none, and of the topmost defaults
# One figure in so many joints or more is a placeholder.
_MIN_EQUAL = 3


def rotors_of_mjcf(path: Path, robot: Robot) -> DriveTrainEntry:
    """Rotor inertia reflected to the joints [kg m2, kg where a joint slides].

    Classes of defaults count as in MuJoCo (a joint's own attribute, its class, the nearest ``childclass``, the topmost
    defaults). Files that an ``<include>`` names are not read.

    Args:
        path: of the file.
        robot: whose joints it must name, or whose names end with its names (``panda_joint1`` and ``joint1``).

    Returns:
        Its status is ``"unverified"`` where every joint has an armature of its own, else ``"assumed"``: joints without
        one keep the robot's.

    Raises:
        InputError: the file cannot be read, is no MJCF, or no joint of the robot has an armature in it.
    """
    root = parse(path, "an MJCF file")
    if local(root) != "mujoco":
        raise InputError(str(path), f"has <{cut(local(root))}> at its root", "wanted an MJCF file, with <mujoco>")
    found = _armatures(root, _classes(root, str(path)), str(path))
    known = np.array([_of_joint(joint.name, found) for joint in robot.joints])
    told = known[~np.isnan(known)]
    if told.size == 0:
        included = "; <include> is not followed" if any(local(element) == "include" for element in root.iter()) else ""
        names = ", ".join(joint.name for joint in robot.joints)
        problem = f"has no armature of a joint of {robot.name}{included}"
        raise InputError(str(path), problem, f"wanted armature of joints {names}")
    source, own = f"armature in the MJCF file {path.name}", robot.drive_train
    entry = entry_of_some("rotor_inertia", known, own.rotor_inertia, source, own.source["rotor_inertia"])
    if told.size >= _MIN_EQUAL and bool((told == told[0]).all()):
        same = f"{entry.source} (one figure for all joints: a placeholder)"
        return DriveTrainEntry(quantity=entry.quantity, values=entry.values, status="assumed", source=same)
    return entry


def _classes(root: Element, file: str) -> dict[str, float]:
    """The armature of every class of defaults; a class begins with what the one around it has by then.

    Sections count in the order of the file: one that comes later goes on with the classes of those before it.
    """
    classes = {_MAIN: 0.0}
    waiting = [(default, _MAIN, _MAIN) for default in children(root, "default")]
    while waiting:
        default, unnamed, around = waiting.pop(0)
        name = default.get("class", unnamed)
        value = classes.get(name, classes[around])
        for joint in children(default, "joint"):
            value = _armature(joint, value, f"{file}, class {cut(name)!r}")
        classes[name] = value
        waiting[:0] = [(child, "", name) for child in children(default, "default")]
    return classes


def _armatures(root: Element, classes: dict[str, float], file: str) -> dict[str, float]:
    """The armature of every joint that has one, by its name."""
    found = {}
    waiting = [(body, _MAIN) for body in children(root, "worldbody")]
    while waiting:
        body, around = waiting.pop()
        around = body.get("childclass", around)
        for joint in children(body, "joint"):
            name = joint.get("name", "")
            value = _armature(joint, classes.get(joint.get("class", around), 0.0), f"{file}, joint {cut(name)!r}")
            if value > 0:
                found[name] = value
        waiting += [(child, around) for child in body if local(child) in ("body", "frame")]
    return found


def _armature(joint: Element, inherited: float, where: str) -> float:
    if "armature" not in joint.attrib:
        return inherited
    [value] = numbers(joint, "armature", 1, "kg m2", where)
    if value < 0:
        raise InputError(f"{where} armature", f"is {value:g}", "wanted a number not below 0")
    return value


def _of_joint(name: str, found: dict[str, float]) -> float:
    if name in found:
        return found[name]
    ending = [value for other, value in found.items() if other and name.endswith(f"_{other}")]
    return ending[0] if len(ending) == 1 else math.nan
