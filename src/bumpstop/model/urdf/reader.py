"""URDF files: from XML to a plain tree of links and joints, everything in it checked.

Read are the links with their inertia and their meshes' names, the joints, and what is told of their motors. Of other
elements only those whose name is nearly one of these are refused: a misspelt ``inertial`` must not lose a mass.

A file holds more than the arm that is asked for: an antenna on the base, a second arm. So a link or a joint that is
wrong in itself keeps its fault, and whoever needs that link or joint raises it. What is wrong with the tree is raised
here.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError, near_matches
from bumpstop.model.inertia import LinkInertia, Matrix3, Vector3, vector3
from bumpstop.model.urdf.drives import armature, effort_limit, transmission_rotors
from bumpstop.model.urdf.xml_elements import (
    check_attributes,
    check_elements,
    children,
    cut,
    largest_angle,
    local,
    name_of,
    needed,
    numbers,
    only,
    origin_of,
    parse,
    refuse_xacro,
)

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

MAX_LINKS = 10_000
# Exporters write five digits of a component: lengths are then off by up to 0.9e-5.
_UNIT_TOLERANCE = 1e-5

_TURNING = ("revolute", "continuous")
_KINDS = (*_TURNING, "prismatic", "fixed")
# Known to URDF; such a joint is refused where it lies in the chain, and left out beside it.
OTHER_KINDS = ("planar", "floating")

_TENSOR = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
_OF_ROBOT = ("link", "joint", "material", "gazebo", "transmission")
_OF_LINK = ("inertial", "visual", "collision")
_OF_INERTIAL = ("origin", "mass", "inertia")
_OF_JOINT = ("origin", "parent", "child", "axis", "limit", "mimic", "dynamics", "calibration", "safety_controller")
_USED_LIMITS = ("lower", "upper", "velocity")
_OF_LIMIT = (*_USED_LIMITS, "effort", "acceleration", "deceleration", "jerk")


@dataclass(frozen=True, kw_only=True)
class UrdfLink:
    """A link as the file has it.

    Attributes:
        name: of the link.
        inertia: in the link's frame, or None where the file has none.
        doubt: why no body can have that inertia; empty: one can.
        has_shape: it has visual or collision geometry, and so is no mere frame.
        meshes: file names of that geometry, as written.
        fault: what is wrong with it, or None.
    """

    name: str
    inertia: LinkInertia | None = None
    doubt: str = ""
    has_shape: bool = False
    meshes: tuple[str, ...] = ()
    fault: InputError | None = None


@dataclass(frozen=True, kw_only=True)
class UrdfJoint:
    """A joint as the file has it.

    Attributes:
        name: of the joint.
        kind: revolute, continuous, prismatic, fixed, planar or floating.
        parent, child: names of the links it joins.
        origin: position of the child's frame in the parent's [m].
        rotation: its orientation there, as rows of a rotation matrix.
        largest_angle: of the three that the file gives for it [rad].
        axis: unit vector in the joint's frame.
        lower, upper: limits [rad or m]; infinite for continuous joints.
        velocity: largest speed [rad/s or m/s].
        effort: largest torque or force [Nm or N]; infinite: none told.
        rotor_inertia: of the motor, reflected to the joint [kg m2 or kg]; nan: none told.
        mimics: name of the joint it follows, or None.
        fault: what is wrong with it, or None; all but its name and its links then mean nothing.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Vector3 = (0.0, 0.0, 0.0)
    rotation: Matrix3 = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
    largest_angle: float = 0.0
    axis: Vector3 = (1.0, 0.0, 0.0)
    lower: float = -math.inf
    upper: float = math.inf
    velocity: float = math.inf
    effort: float = math.inf
    rotor_inertia: float = math.nan
    mimics: str | None = None
    fault: InputError | None = None


@dataclass(frozen=True, kw_only=True)
class UrdfTree:
    """A checked file: every link below exactly one joint, but for roots.

    Attributes:
        path: of the file.
        name: of the robot.
        roots: names of the links without a joint above them: one, or the file holds several robots.
        links: by name.
        above: the joint above each link, by the link's name.
        below: the joints below each link, by the link's name, in the file's order.
    """

    path: Path
    name: str
    roots: tuple[str, ...]
    links: dict[str, UrdfLink]
    above: dict[str, UrdfJoint]
    below: dict[str, list[UrdfJoint]]


def read_urdf(path: Path) -> UrdfTree:
    """Read and check a URDF file.

    Args:
        path: of the file.

    Raises:
        InputError: the file cannot be read, is too large, no XML or no sound URDF; names what is wrong and where.
    """
    root = parse(path)
    where = str(path)
    if local(root) != "robot":
        raise InputError(where, f"begins with <{cut(local(root))}>", "wanted a URDF file, which begins with <robot>")
    refuse_xacro(root, where)
    name = name_of(root, "name", where)
    check_elements(root, _OF_ROBOT, where)
    links: dict[str, UrdfLink] = {}
    for element in children(root, "link"):
        link = _link(element, where)
        if link.name in links:
            raise InputError(f"{where}: link {link.name!r}", "occurs twice", "wanted every link once")
        links[link.name] = link
        if len(links) > MAX_LINKS:
            raise InputError(where, f"has more than {MAX_LINKS} links", "wanted fewer")
    if not links:
        raise InputError(where, "has no links", "wanted links and joints")
    joints: dict[str, UrdfJoint] = {}
    rotors = transmission_rotors(root)
    for element in children(root, "joint"):
        joint = _joint(element, where, links)
        if joint.name in joints:
            raise InputError(f"{where}: joint {joint.name!r}", "occurs twice", "wanted every joint once")
        joints[joint.name] = replace(joint, rotor_inertia=rotors.get(joint.name, joint.rotor_inertia))
    for joint in joints.values():
        if joint.mimics is not None and joint.mimics not in joints:
            near = near_matches(joint.mimics, joints)
            fault = InputError(f"{where}: joint {joint.name!r} mimic", f"there is no joint {joint.mimics!r}", near)
            joints[joint.name] = replace(joint, fault=fault)
    above, below = _tree(joints.values(), links, where)
    return UrdfTree(
        path=path,
        name=name,
        roots=_roots(links, above, below, where),
        links=links,
        above=above,
        below=below,
    )


# --- Links and joints -----------------------------------------------------------------------------------------------


def _link(element: Element, path: str) -> UrdfLink:
    name = name_of(element, "name", path)
    where = f"{path}: link {name!r}"
    inertia, doubt, fault = None, "", None
    try:
        check_elements(element, _OF_LINK, where)
        inertial = only(element, "inertial", where)
        if inertial is not None:
            inertia, doubt = _inertia(inertial, where)
    except InputError as error:
        fault = error
    shapes = [shape for tag in ("visual", "collision") for shape in children(element, tag)]
    meshes = [mesh.get("filename", "") for shape in shapes for mesh in shape.iter() if local(mesh) == "mesh"]
    return UrdfLink(name=name, inertia=inertia, doubt=doubt, has_shape=bool(shapes), meshes=tuple(meshes), fault=fault)


def _inertia(inertial: Element, where: str) -> tuple[LinkInertia, str]:
    """Inertia in the link's frame, and why no body can have it (empty: one can)."""
    check_elements(inertial, _OF_INERTIAL, f"{where} inertial")
    mass_element, tensor_element = (needed(inertial, tag, f"{where} inertial") for tag in ("mass", "inertia"))
    check_attributes(mass_element, ("value",), f"{where} mass")
    check_attributes(tensor_element, _TENSOR, f"{where} inertia")
    (mass,) = numbers(mass_element, "value", 1, "kg", where)
    xx, yy, zz, xy, xz, yz = (numbers(tensor_element, key, 1, "kg m2", where)[0] for key in _TENSOR)
    center, rotation = origin_of(inertial, f"{where} inertial")
    try:
        inertia = LinkInertia(mass=mass, tensor=((xx, xy, xz), (xy, yy, yz), (xz, yz, zz)))
    except InputError as error:
        field = {"tensor": "inertia"}.get(error.field, error.field)
        raise InputError(f"{where} {field}", error.problem, error.valid) from None
    doubt = ""
    if inertia.breaks_triangle:
        moments = ", ".join(f"{moment:.3g}" for moment in np.linalg.eigvalsh(np.asarray(inertia.tensor)))
        doubt = f"breaks the triangle inequality (principal moments {moments} kg m2)"
    elif mass == 0 and any((xx, yy, zz)):
        doubt = "turns, but has no mass"
    return inertia.moved(center, rotation), doubt


def _joint(element: Element, path: str, links: dict[str, UrdfLink]) -> UrdfJoint:
    name = name_of(element, "name", path)
    where = f"{path}: joint {name!r}"
    kind = name_of(element, "type", where)
    ends = {}
    for tag in ("parent", "child"):
        end = needed(element, tag, where)
        check_attributes(end, ("link",), f"{where} {tag}")
        ends[tag] = name_of(end, "link", where)
        if ends[tag] not in links:
            raise InputError(f"{where} {tag}", f"there is no link {ends[tag]!r}", near_matches(ends[tag], links))
    try:
        return _motion(element, UrdfJoint(name=name, kind=kind, parent=ends["parent"], child=ends["child"]), where)
    except InputError as error:
        return UrdfJoint(name=name, kind=kind, parent=ends["parent"], child=ends["child"], fault=error)


def _motion(element: Element, joint: UrdfJoint, where: str) -> UrdfJoint:
    """The joint with all that the file says of how its links move against each other."""
    kind = joint.kind
    if kind not in (*_KINDS, *OTHER_KINDS):
        raise InputError(f"{where} type", f"{cut(kind)!r} is no kind of joint", near_matches(kind, _KINDS))
    check_elements(element, _OF_JOINT, where)
    origin, rotation = origin_of(element, where)
    mimic = only(element, "mimic", where)
    lower, upper, velocity = _limits(element, kind, where)
    return replace(
        joint,
        origin=origin,
        rotation=rotation,
        largest_angle=largest_angle(element),
        # Fixed joints carry axes that mean nothing, often zero; those of planar ones are of no use here.
        axis=_axis(element, where) if kind in (*_TURNING, "prismatic") else (1.0, 0.0, 0.0),
        lower=lower,
        upper=upper,
        velocity=velocity,
        effort=effort_limit(only(element, "limit", where)),
        rotor_inertia=armature(element),
        mimics=None if mimic is None else name_of(mimic, "joint", f"{where} mimic"),
    )


def _axis(joint: Element, where: str) -> Vector3:
    element = only(joint, "axis", where)
    if element is None:
        return 1.0, 0.0, 0.0  # URDF's default
    check_attributes(element, ("xyz",), f"{where} axis")
    axis = np.array(numbers(element, "xyz", 3, "", where))
    length = float(np.linalg.norm(axis))
    if length == 0:
        raise InputError(f"{where} axis", "is zero", "wanted a unit vector")
    if abs(length - 1) > _UNIT_TOLERANCE:
        unit = " ".join(f"{value:.9g}" for value in axis / length)
        raise InputError(f"{where} axis", f"{cut(element.get('xyz', ''))!r} has length {length:.6g}", f"wanted {unit}")
    return vector3(axis / length)


def _limits(joint: Element, kind: str, where: str) -> tuple[float, float, float]:
    """Lower and upper limit and largest speed; infinite where the kind has none."""
    lower, upper, velocity = -math.inf, math.inf, math.inf
    element = only(joint, "limit", where)
    if kind not in (*_TURNING, "prismatic"):
        return lower, upper, velocity
    bounded = kind != "continuous"
    if element is None:
        if bounded:
            raise InputError(f"{where} limit", "is missing", "wanted <limit> with lower, upper and velocity")
        return lower, upper, velocity
    check_attributes(element, _OF_LIMIT, f"{where} limit")
    # The others are of no use here, and exporters write what they like: 3.4028235e+38 for no limit, "inf", nothing.
    found = {key: numbers(element, key, 1, "", where)[0] for key in _USED_LIMITS if key in element.attrib}
    if bounded:
        for key in _USED_LIMITS:
            if key not in found:
                raise InputError(f"{where} limit", f"has no {key}", "wanted lower, upper and velocity")
        lower, upper = found["lower"], found["upper"]
        if not lower < upper:
            wanted = "wanted lower below upper" + ('; "continuous" joints have neither' if kind == "revolute" else "")
            raise InputError(f"{where} limit", f"lower {lower:g} is not below upper {upper:g}", wanted)
    velocity = found.get("velocity", math.inf)
    if not velocity > 0:
        raise InputError(f"{where} limit", f"velocity is {velocity:g}", "wanted a positive limit")
    return lower, upper, velocity


# --- The tree -------------------------------------------------------------------------------------------------------


def _tree(
    joints: Iterable[UrdfJoint], links: dict[str, UrdfLink], where: str
) -> tuple[dict[str, UrdfJoint], dict[str, list[UrdfJoint]]]:
    above: dict[str, UrdfJoint] = {}
    below: dict[str, list[UrdfJoint]] = {name: [] for name in links}
    for joint in joints:
        if joint.child in above:
            both = f"has two parents: joints {above[joint.child].name!r} and {joint.name!r} move it"
            raise InputError(f"{where}: link {joint.child!r}", both, "wanted a tree")
        above[joint.child] = joint
        below[joint.parent].append(joint)
    return above, below


def _roots(
    links: dict[str, UrdfLink], above: dict[str, UrdfJoint], below: dict[str, list[UrdfJoint]], where: str
) -> tuple[str, ...]:
    roots = [name for name in links if name not in above]
    reached: set[str] = set()
    ahead = list(roots)
    while ahead:
        name = ahead.pop()
        reached.add(name)
        ahead.extend(joint.child for joint in below[name])
    if len(reached) < len(links):
        # Every link outside has a joint above it, so climbing from any of them ends in a loop.
        name, seen = next(name for name in links if name not in reached), set()
        while name not in seen:
            seen.add(name)
            name = above[name].parent
        raise InputError(
            f"{where}: joint {above[name].name!r}", f"closes a loop through link {name!r}", "wanted a tree"
        )
    return tuple(roots)
