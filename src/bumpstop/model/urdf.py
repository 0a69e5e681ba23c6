"""URDF files: from XML to a plain tree of links and joints, everything in it checked.

Read are the links with their inertia and their meshes' names, and the joints. Of other elements only those whose name
is nearly one of these are refused: a misspelt ``inertial`` must not lose a mass.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError, near_matches
from bumpstop.model.inertia import LinkInertia, Matrix3, Vector3, vector3
from bumpstop.model.urdf_xml import (
    check_attributes,
    check_elements,
    children,
    cut,
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

MOST_LINKS = 10_000
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
        meshes: file names of its visual and collision geometry, as written.
    """

    name: str
    inertia: LinkInertia | None = None
    meshes: tuple[str, ...] = ()


@dataclass(frozen=True, kw_only=True)
class UrdfJoint:
    """A joint as the file has it.

    Attributes:
        name: of the joint.
        kind: revolute, continuous, prismatic, fixed, planar or floating.
        parent, child: names of the links it joins.
        origin: position of the child's frame in the parent's [m].
        rotation: its orientation there, as rows of a rotation matrix.
        axis: unit vector in the joint's frame.
        lower, upper: limits [rad or m]; infinite for continuous joints.
        velocity: largest speed [rad/s or m/s].
        mimics: name of the joint it follows, or None.
    """

    name: str
    kind: str
    parent: str
    child: str
    origin: Vector3
    rotation: Matrix3
    axis: Vector3
    lower: float
    upper: float
    velocity: float
    mimics: str | None


@dataclass(frozen=True, kw_only=True)
class UrdfTree:
    """A checked file: one root, every other link below exactly one joint.

    Attributes:
        path: of the file.
        name: of the robot.
        root: name of the link without a joint above it.
        links: by name.
        above: the joint above each link, by the link's name.
        below: the joints below each link, by the link's name, in the file's order.
        warnings: what is doubtful but was accepted.
    """

    path: Path
    name: str
    root: str
    links: dict[str, UrdfLink]
    above: dict[str, UrdfJoint]
    below: dict[str, list[UrdfJoint]]
    warnings: tuple[str, ...]


def read_urdf(path: Path, *, strict_inertia: bool = False) -> UrdfTree:
    """Read and check a URDF file.

    Args:
        path: of the file.
        strict_inertia: refuse an inertia that no body can have, instead of warning.

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
    warnings: list[str] = []
    links: dict[str, UrdfLink] = {}
    for element in children(root, "link"):
        link = _link(element, where, warnings, strict_inertia=strict_inertia)
        if link.name in links:
            raise InputError(f"{where}: link {link.name!r}", "occurs twice", "wanted every link once")
        links[link.name] = link
        if len(links) > MOST_LINKS:
            raise InputError(where, f"has more than {MOST_LINKS} links", "wanted fewer")
    if not links:
        raise InputError(where, "has no links", "wanted links and joints")
    joints: dict[str, UrdfJoint] = {}
    for element in children(root, "joint"):
        joint = _joint(element, where, links)
        if joint.name in joints:
            raise InputError(f"{where}: joint {joint.name!r}", "occurs twice", "wanted every joint once")
        joints[joint.name] = joint
    for joint in joints.values():
        if joint.mimics is not None and joint.mimics not in joints:
            near = near_matches(joint.mimics, joints)
            raise InputError(f"{where}: joint {joint.name!r} mimic", f"there is no joint {joint.mimics!r}", near)
    above, below = _tree(joints.values(), links, where)
    return UrdfTree(
        path=path,
        name=name,
        root=_only_root(links, above, below, where),
        links=links,
        above=above,
        below=below,
        warnings=tuple(warnings),
    )


# --- Links and joints -----------------------------------------------------------------------------------------------


def _link(element: Element, path: str, warnings: list[str], *, strict_inertia: bool) -> UrdfLink:
    name = name_of(element, "name", path)
    where = f"{path}: link {name!r}"
    check_elements(element, _OF_LINK, where)
    inertial = only(element, "inertial", where)
    inertia = None
    if inertial is not None:
        inertia, doubt = _inertia(inertial, where)
        if doubt and strict_inertia:
            raise InputError(f"{where} inertia", doubt, "wanted the inertia of a body that can exist")
        if doubt:
            warnings.append(f"Link {name!r} of {Path(path).name}: its inertia {doubt}.")
    shapes = [shape for tag in ("visual", "collision") for shape in children(element, tag)]
    meshes = [mesh.get("filename", "") for shape in shapes for mesh in shape.iter() if local(mesh) == "mesh"]
    return UrdfLink(name=name, inertia=inertia, meshes=tuple(meshes))


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
    if kind not in (*_KINDS, *OTHER_KINDS):
        raise InputError(f"{where} type", f"{cut(kind)!r} is no kind of joint", near_matches(kind, _KINDS))
    check_elements(element, _OF_JOINT, where)
    ends = {}
    for tag in ("parent", "child"):
        end = needed(element, tag, where)
        check_attributes(end, ("link",), f"{where} {tag}")
        ends[tag] = name_of(end, "link", where)
        if ends[tag] not in links:
            raise InputError(f"{where} {tag}", f"there is no link {ends[tag]!r}", near_matches(ends[tag], links))
    origin, rotation = origin_of(element, where)
    mimic = only(element, "mimic", where)
    lower, upper, velocity = _limits(element, kind, where)
    return UrdfJoint(
        name=name,
        kind=kind,
        parent=ends["parent"],
        child=ends["child"],
        origin=origin,
        rotation=rotation,
        # Fixed joints carry axes that mean nothing, often zero; those of planar ones are of no use here.
        axis=_axis(element, where) if kind in (*_TURNING, "prismatic") else (1.0, 0.0, 0.0),
        lower=lower,
        upper=upper,
        velocity=velocity,
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


def _only_root(
    links: dict[str, UrdfLink], above: dict[str, UrdfJoint], below: dict[str, list[UrdfJoint]], where: str
) -> str:
    roots = [name for name in links if name not in above]
    if len(roots) > 1:
        names = ", ".join(repr(name) for name in roots[:5])
        raise InputError(where, f"has {len(roots)} links without a parent: {names}", "wanted one root")
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
    return roots[0]
