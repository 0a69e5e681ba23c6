"""Random URDF files, ways to spoil them, and an independent look at what was read from one."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import numpy.typing as npt

from bumpstop.errors import InputError
from bumpstop.model import Robot
from bumpstop.model.inertia import vector3

Floats = npt.NDArray[np.float64]
# An index below the given number.
Choose = Callable[[int], int]

ARM = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <link name="upper">
    <inertial>
      <origin xyz="0 0 0.1" rpy="0.1 0 0"/>
      <mass value="4"/>
      <inertia ixx="0.03" iyy="0.03" izz="0.01" ixy="0" ixz="0.001" iyz="0"/>
    </inertial>
    <visual><geometry><mesh filename="package://arm/upper.stl"/></geometry></visual>
  </link>
  <link name="slide">
    <inertial>
      <mass value="2.5"/>
      <inertia ixx="0.02" iyy="0.02" izz="0.02" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="wrist"/>
  <link name="camera">
    <inertial>
      <origin xyz="0.01 0 0"/>
      <mass value="0.3"/>
      <inertia ixx="0.0001" iyy="0.0001" izz="0.0001" ixy="0" ixz="0" iyz="0"/>
    </inertial>
  </link>
  <link name="tool"/>
  <joint name="turn" type="revolute">
    <origin xyz="0 0 0.4" rpy="0 0.3 0"/>
    <parent link="base"/>
    <child link="upper"/>
    <axis xyz="0 1 0"/>
    <limit lower="-2" upper="2.5" velocity="3" effort="50"/>
  </joint>
  <joint name="push" type="prismatic">
    <origin xyz="0 0 0.35"/>
    <parent link="upper"/>
    <child link="slide"/>
    <axis xyz="0 0 1"/>
    <limit lower="0" upper="0.5" velocity="1" effort="50"/>
  </joint>
  <joint name="roll" type="continuous">
    <origin xyz="0.1 0 0.2"/>
    <parent link="slide"/>
    <child link="wrist"/>
    <axis xyz="0.6 0 0.8"/>
  </joint>
  <joint name="mount" type="fixed">
    <origin xyz="0 0.05 0" rpy="0 0 1.5"/>
    <parent link="slide"/>
    <child link="camera"/>
  </joint>
  <joint name="flange" type="fixed">
    <origin xyz="0 0 0.1" rpy="1.57 0 0.2"/>
    <parent link="wrist"/>
    <child link="tool"/>
  </joint>
</robot>
"""


# --- Sound files ----------------------------------------------------------------------------------------------------


def _words(values: npt.ArrayLike) -> str:
    return " ".join(repr(float(value)) for value in np.atleast_1d(np.asarray(values)))


def random_urdf(rng: np.random.Generator, *, side_joints: bool = False) -> str:
    """A chain of 1 to 7 moving joints with fixed links in and beside it; its tip is called ``tip``."""
    robot = ElementTree.Element("robot", name="random")
    parts: list[ElementTree.Element] = []
    count = 0

    def link(name: str) -> str:
        element = ElementTree.Element("link", name=name)
        if rng.random() < 0.8:
            inertial = ElementTree.SubElement(element, "inertial")
            rpy = _words(rng.uniform(-3, 3, 3))
            ElementTree.SubElement(inertial, "origin", xyz=_words(rng.uniform(-0.2, 0.2, 3)), rpy=rpy)
            ElementTree.SubElement(inertial, "mass", value=_words(rng.uniform(0.1, 5)))
            # Points in space have moments that some body can have.
            points = rng.normal(size=(6, 3)) * 0.1
            tensor = sum((p @ p) * np.eye(3) - np.outer(p, p) for p in points)
            keys = {"ixx": (0, 0), "iyy": (1, 1), "izz": (2, 2), "ixy": (0, 1), "ixz": (0, 2), "iyz": (1, 2)}
            ElementTree.SubElement(inertial, "inertia", {key: _words(tensor[place]) for key, place in keys.items()})
        parts.append(element)
        return name

    def joint(parent: str, child: str, kind: str) -> None:
        element = ElementTree.Element("joint", name=f"{parent}-{child}", type=kind)
        ElementTree.SubElement(
            element, "origin", xyz=_words(rng.uniform(-0.5, 0.5, 3)), rpy=_words(rng.uniform(-3, 3, 3))
        )
        ElementTree.SubElement(element, "parent", link=parent)
        ElementTree.SubElement(element, "child", link=child)
        if kind != "fixed":
            axis = rng.normal(size=3)
            ElementTree.SubElement(element, "axis", xyz=_words(axis / np.linalg.norm(axis)))
            low, high = rng.uniform(-3, 0), rng.uniform(0.1, 3)
            ElementTree.SubElement(
                element,
                "limit",
                lower=_words(low),
                upper=_words(high),
                velocity=_words(rng.uniform(0.5, 3)),
                effort="1",
            )
        parts.append(element)

    def grow(parent: str, kind: str, name: str | None = None) -> str:
        nonlocal count
        count += 1
        child = link(name or f"l{count}")
        joint(parent, child, kind)
        return child

    here = link("base")
    for _ in range(int(rng.integers(1, 8))):
        for _ in range(int(rng.integers(0, 3))):
            here = grow(here, "fixed")
        here = grow(here, str(rng.choice(["revolute", "revolute", "prismatic", "continuous"])))
        beside = here
        for _ in range(int(rng.integers(0, 3))):
            beside = grow(beside, "fixed")
        if side_joints and rng.random() < 0.3:
            grow(beside, "revolute")
    grow(here, "fixed", "tip")
    for index in rng.permutation(len(parts)):
        robot.append(parts[index])
    return ElementTree.tostring(robot, encoding="unicode")


# --- Spoilt files ---------------------------------------------------------------------------------------------------

ODD = (
    *("nan", "inf", "-inf", "1e400", "-1", "0", "1e-320", "", " ", "0 0 0", "1 2", "1 2 3 4", "0 0 nan", "0,1,0"),
    *("1_0", "0x10", "\N{ARABIC-INDIC DIGIT ONE}", "${pi}", "$(find x)", "base", "upper", "wrist", "tool", "turn"),
    *("roll", "revolute", "continuous", "prismatic", "fixed", "planar", "floating", "spherical", "x" * 300, "0 0 2"),
)
TAGS = ("link", "joint", "origin", "axis", "limit", "limits", "mimic", "inertial", "inertia", "mass", "parent", "child")
JUNK = (
    "<",
    ">",
    "&",
    '"',
    "<a>",
    "</link>",
    "<link/>",
    "&lol;",
    "\x00",
    "\ufeff",
    "<!--",
    "-->",
    "<![CDATA[",
    "]]>",
    "'",
)


def spoilt(text: str, choose: Choose) -> str:
    """The file with one to four changes: of its tree mostly, of its text sometimes."""
    root = ElementTree.fromstring(text)
    for _ in range(1 + choose(4)):
        _change(root, choose)
    text = ElementTree.tostring(root, encoding="unicode")
    if choose(4) == 0:
        first = choose(len(text))
        last = first + (0, 0, 1, 5, 40, 400)[choose(6)]
        text = text[:first] + ("", *JUNK)[choose(len(JUNK) + 1)] + text[last:]
    return text


def _change(root: ElementTree.Element, choose: Choose) -> None:
    elements = list(root.iter())
    one = elements[choose(len(elements))]
    other = elements[choose(len(elements))]
    kind = choose(8)
    if kind == 0 and len(one):  # loses a part
        one.remove(list(one)[choose(len(one))])
    elif kind == 1:  # a part twice, or where it does not belong
        other.append(copy.deepcopy(one))
    elif kind == 2:
        one.tag = TAGS[choose(len(TAGS))]
    elif one.attrib:
        keys = list(one.attrib)
        key = keys[choose(len(keys))]
        if kind == 3:
            del one.attrib[key]
        elif kind == 4 and key in other.attrib:  # names that exist: loops, two parents, duplicates
            one.set(key, other.attrib[key])
        elif kind == 5:
            one.set(key + "x", one.attrib.pop(key))
        else:
            one.set(key, ODD[choose(len(ODD))])


def survives(text: str, folder: Path) -> bool:
    """Whether the file is read. If so it is sound; if not, the refusal is a short sentence."""
    path = folder / "spoilt.urdf"
    path.write_bytes(text.encode("utf-8", "surrogatepass"))
    refusal = ""
    try:
        arm = Robot.from_urdf(path)
    except InputError as error:
        refusal = str(error)
    if refusal:
        assert len(refusal) < 2000
        return False
    check(text, arm)
    return True


# --- An independent look --------------------------------------------------------------------------------------------


def _transform(element: ElementTree.Element) -> Floats:
    x = np.eye(4)
    origin = element.find("origin")
    if origin is not None:
        x[:3, 3] = [float(word) for word in origin.get("xyz", "0 0 0").split()]
        for angle, (a, b) in zip(origin.get("rpy", "0 0 0").split(), ((1, 2), (2, 0), (0, 1)), strict=True):
            turn = np.eye(3)
            turn[a, a] = turn[b, b] = math.cos(float(angle))
            turn[b, a] = math.sin(float(angle))
            turn[a, b] = -turn[b, a]
            x[:3, :3] = turn @ x[:3, :3]
    return x


def check(text: str, robot: Robot) -> None:
    """Assert that the file is sound by another reading of it, and that the robot is what it says.

    The tree is judged by counting, poses by products of matrices from the tip down, masses by groups.
    """
    root = ElementTree.fromstring(text)
    links = {link.get("name"): link for link in root.findall("link")}
    joints = {joint.get("name"): joint for joint in root.findall("joint")}
    assert len(links) == len(root.findall("link"))
    assert len(joints) == len(root.findall("joint"))
    assert len(joints) == len(links) - 1
    group = {name: name for name in links}
    whole = {name: name for name in links}
    above = {}
    for joint in joints.values():
        parent, child = (joint.find(end).get("link") for end in ("parent", "child"))  # type: ignore[union-attr]
        assert child not in above
        above[child] = (parent, joint)
        for sets in (whole, group) if joint.get("type") == "fixed" else (whole,):
            kept, gone = sets[parent], sets[child]
            for name in links:
                sets[name] = kept if sets[name] == gone else sets[name]
    assert len(set(whole.values())) == 1
    q = np.clip(np.linspace(-0.7, 0.9, robot.dof), robot.lower, robot.upper)
    position = dict(zip((joint.name for joint in robot.joints), q, strict=True))
    pose, name, moving = np.eye(4), robot.tip_name, []
    scale = 1 + float(np.abs(q).max())  # joints beside the chain may be damaged: they are not looked at
    while name in above:
        parent, joint = above[name]
        motion = np.eye(4)
        kind = joint.get("type")
        if kind != "fixed":
            assert kind in ("revolute", "continuous", "prismatic")
            assert joint.find("mimic") is None
            element = joint.find("axis")
            axis = np.array([float(word) for word in (element.get("xyz") if element is not None else "1 0 0").split()])
            assert abs(np.linalg.norm(axis) - 1) < 2e-6
            value = position[joint.get("name")]
            if kind == "prismatic":
                motion[:3, 3] = axis * value
            else:
                x, y, z = axis
                k = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
                motion[:3, :3] = np.eye(3) + math.sin(value) * k + (1 - math.cos(value)) * (k @ k)
            ours = next(other for other in robot.joints if other.name == joint.get("name"))
            if kind != "continuous":
                limit = joint.find("limit")
                assert float(limit.get("lower")) == ours.lower < ours.upper == float(limit.get("upper"))
            moving.append(ours.name)
            masses = [
                float(links[other].find("inertial/mass").get("value"))
                for other in links
                if group[other] == group[name] and links[other].find("inertial") is not None
            ]
            assert (ours.inertia is None) == (not masses)
            if ours.inertia is not None:
                assert min(masses) >= 0
                assert math.isclose(ours.inertia.mass, sum(masses), rel_tol=1e-12)
        origin = _transform(joint)
        scale += float(np.abs(origin[:3, 3]).max())
        pose = origin @ motion @ pose
        name = parent
    assert moving[::-1] == [joint.name for joint in robot.joints]
    np.testing.assert_allclose(robot.pose(q), pose, rtol=0, atol=1e-5 * scale)
    assert np.isfinite(robot.jacobian(q)).all()


def read(text: str | bytes, folder: Path, *arguments: Any, **options: Any) -> Robot:
    """The robot of a file with this text."""
    path = folder / "arm.urdf"
    path.write_bytes(text if isinstance(text, bytes) else text.encode())
    return Robot.from_urdf(path, *arguments, **options)


def changed(*replacements: tuple[str, str]) -> str:
    """The text of ``ARM`` with replacements, each of something that stands in it."""
    text = ARM
    for old, new in replacements:
        assert old in text, old
        text = text.replace(old, new, 1)
    return text


def scaled(robot: Robot, factor: float) -> Robot:
    """The robot with all its lengths times a factor."""
    joints = tuple(replace(joint, origin=vector3(factor * np.array(joint.origin))) for joint in robot.joints)
    return replace(robot, joints=joints, tip_origin=vector3(factor * np.array(robot.tip_origin)))
