"""Robots written as URDF, for other programs and for scenarios."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING
from xml.etree import ElementTree as Xml

import numpy as np

from bumpstop.errors import InputError
from bumpstop.text_files import write_text

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.model.inertia import LinkInertia
    from bumpstop.model.joint import Joint
    from bumpstop.model.robot import Robot


def write_urdf(robot: Robot, path: str | Path) -> None:
    """Write the chain of a robot as URDF: joints with limits, links with inertia, the tip and other frames.

    Torque limits are efforts; 0 where they are unknown.

    URDF has no place for the inertia of rotors, nor for what is known of sources: those are left out. A joint without
    limits becomes ``continuous``.

    Raises:
        InputError: a joint has no speed limit or a single position limit, which URDF wants both; or the file cannot be
            written.
    """
    root = Xml.Element("robot", name=robot.name)
    links = {robot.tip_name, *(joint.link for joint in robot.joints), *(frame.name for frame in robot.frames)}
    before = _other_than(links, "base_link")
    Xml.SubElement(root, "link", name=before)
    for joint, limit in zip(robot.joints, robot.drive_train.torque_limit, strict=True):
        link = Xml.SubElement(root, "link", name=joint.link)
        if joint.inertia is not None:
            _inertial(link, joint.inertia)
        _joint(root, joint, before, repr(float(limit)) if math.isfinite(limit) else "0")
        before = joint.link
    last = robot.joints[-1].link
    fixed = [(frame.name, robot.joints[frame.link].link, frame.origin, frame.rotation) for frame in robot.frames]
    # The tip may be the last link itself.
    if robot.tip_name != last:
        fixed.append((robot.tip_name, last, robot.tip_origin, robot.tip_rotation))
    joints = {joint.name for joint in robot.joints}
    for name, parent, origin, rotation in fixed:
        Xml.SubElement(root, "link", name=name)
        own = _other_than(joints, f"{name}_fixed")
        joints.add(own)
        element = Xml.SubElement(root, "joint", name=own, type="fixed")
        _placed(element, parent, name, origin, rotation)
    Xml.indent(root)
    write_text(path, Xml.tostring(root, encoding="unicode") + "\n")


def _other_than(names: set[str], wanted: str) -> str:
    """``wanted``, or with strokes behind it where there is that name already."""
    while wanted in names:
        wanted += "_"
    return wanted


def _joint(root: Xml.Element, joint: Joint, before: str, effort: str) -> None:
    ends = [math.isfinite(joint.lower), math.isfinite(joint.upper)]
    free = joint.kind == "revolute" and not any(ends)
    if not free and not (all(ends) and math.isfinite(joint.velocity)):
        raise InputError(f"joint {joint.name!r} limits", "are not all finite", "URDF wants lower, upper and velocity")
    element = Xml.SubElement(root, "joint", name=joint.name, type="continuous" if free else joint.kind)
    _placed(element, before, joint.link, joint.origin, joint.rotation)
    Xml.SubElement(element, "axis", xyz=_text(joint.axis))
    limit = {} if free else {"lower": repr(float(joint.lower)), "upper": repr(float(joint.upper))}
    if math.isfinite(joint.velocity):
        Xml.SubElement(element, "limit", limit | {"velocity": repr(float(joint.velocity)), "effort": effort})


def _inertial(link: Xml.Element, inertia: LinkInertia) -> None:
    element = Xml.SubElement(link, "inertial")
    Xml.SubElement(element, "origin", xyz=_text(inertia.center), rpy="0 0 0")
    Xml.SubElement(element, "mass", value=repr(float(inertia.mass)))
    tensor = np.asarray(inertia.tensor)
    places = {"ixx": (0, 0), "ixy": (0, 1), "ixz": (0, 2), "iyy": (1, 1), "iyz": (1, 2), "izz": (2, 2)}
    Xml.SubElement(element, "inertia", {name: repr(float(tensor[place])) for name, place in places.items()})


def _placed(element: Xml.Element, parent: str, child: str, origin: npt.ArrayLike, rotation: npt.ArrayLike) -> None:
    Xml.SubElement(element, "parent", link=parent)
    Xml.SubElement(element, "child", link=child)
    Xml.SubElement(element, "origin", xyz=_text(origin), rpy=_text(_rpy(np.asarray(rotation))))


def _rpy(rotation: np.ndarray) -> tuple[float, float, float]:
    """Roll, pitch and yaw [rad] of R = Rz(yaw) Ry(pitch) Rx(roll); at a pitch of a quarter turn roll is zero."""
    level = math.hypot(rotation[0, 0], rotation[1, 0])
    pitch = math.atan2(-rotation[2, 0], level)
    if level < 1e-9:
        return 0.0, pitch, math.atan2(-rotation[0, 1], rotation[1, 1])
    return math.atan2(rotation[2, 1], rotation[2, 2]), pitch, math.atan2(rotation[1, 0], rotation[0, 0])


def _text(values: npt.ArrayLike) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values))
