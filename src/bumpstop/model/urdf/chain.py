"""From the tree of a URDF to a robot: the chain between two links, with everything fixed to it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError, near_matches
from bumpstop.model.inertia import LinkInertia, matrix3, merged, vector3
from bumpstop.model.joint import Frame, Joint
from bumpstop.model.serial_chain import SerialChain
from bumpstop.model.urdf.drives import with_drives
from bumpstop.model.urdf.limit_doubts import limit_doubts
from bumpstop.model.urdf.reader import OTHER_KINDS, UrdfJoint, UrdfTree, read_urdf

Chain = TypeVar("Chain", bound=SerialChain)

_GRIPPER_WORDS = ("finger", "gripper", "knuckle", "jaw")
_UPRIGHT = 1e-6  # of the cosine between two directions that are both up
_CONTROLLER_BASE = "base"  # its link in files of ROS-Industrial's custom
_SAME = 1e-6  # of lengths [m] and of directions
_MAX_FINGER_TRAVEL = 0.15  # [m]: no axis of an arm is as short


@dataclass(frozen=True)
class _Body:
    """Links that are fixed to each other.

    Attributes:
        placed: position [m] and orientation of every link in the frame of the first, by name.
        leaving: the joints that move other links against this body.
    """

    placed: dict[str, tuple[FloatArray, FloatArray]]
    leaving: list[UrdfJoint] = field(default_factory=list)


def chain_from_urdf(
    path: Path, base: str | None, tip: str | None, *, make: Callable[..., Chain], strict_inertia: bool = False
) -> Chain:
    """Read the chain from ``base`` to ``tip``; ``make`` takes its fields. As :meth:`bumpstop.model.Robot.from_urdf`."""
    for key, name in (("base", base), ("tip", tip)):
        if name is not None and not isinstance(name, str):
            raise InputError(key, f"{name!r} is no name", "wanted text")
    tree = read_urdf(path)
    warnings: list[str] = []
    if base is not None and base not in tree.links:
        raise InputError("base", f"{path.name} has no link {base!r}", near_matches(base, tree.links))
    chosen, base = base is not None, base if base is not None else _default_base(tree, tip)
    first, place, turn = _start(tree, base, tip)
    tip = tip if tip is not None else _default_tip(tree, first)
    path_down = _path(tree, first, tip)
    chain = [joint for joint in path_down if joint.kind != "fixed"]
    if not chain:
        raise InputError("tip", f"nothing moves between {base!r} and {tip!r} of {path.name}", "give another link")
    for joint in chain:
        where = f"{path}: joint {joint.name!r}"
        if joint.fault is not None:
            raise joint.fault
        if joint.kind in OTHER_KINDS:
            raise InputError(where, f"is {joint.kind}", "wanted revolute, continuous, prismatic and fixed joints only")
        if joint.mimics is not None:
            raise InputError(where, f"follows joint {joint.mimics!r} (mimic)", "wanted joints that move on their own")
    if len(chain) > _native.max_joints:
        raise InputError(str(path), f"{len(chain)} joints move {tip!r}", f"wanted at most {_native.max_joints}")
    bodies = [_body(tree, first, place, turn), *(_body(tree, joint.child) for joint in chain)]
    warnings += _faults(tree, bodies, path_down)
    of_masses = _doubts(tree, bodies, strict=strict_inertia)
    warnings += of_masses
    base_joints = _base_joints(tree, base)
    if base_joints:
        named = ", ".join(map(repr, base_joints))
        warnings.append(f"Moves {base!r} itself and is taken to stand still: {named}.")
    warnings += limit_doubts(path_down)
    warnings += _left_out(tree, bodies, chain)
    warnings += _gripper_joints(tree, chain)
    warnings += _turned_base(tree, base)
    if not chosen:
        warnings += _controller_base(bodies[0], base)
    joints, frames = [], []
    for number, (joint, before, body) in enumerate(zip(chain, bodies, bodies[1:], strict=False)):
        origin, rotation = before.placed[joint.parent]
        joints.append(
            Joint(
                name=joint.name,
                link=joint.child,
                kind="prismatic" if joint.kind == "prismatic" else "revolute",
                origin=vector3(origin + rotation @ np.asarray(joint.origin)),
                rotation=matrix3(rotation @ np.asarray(joint.rotation)),
                axis=joint.axis,
                lower=joint.lower,
                upper=joint.upper,
                velocity=joint.velocity,
                inertia=_inertia(tree, body),
            )
        )
        frames += [
            Frame(name=name, link=number, origin=vector3(place), rotation=matrix3(turn))
            for name, (place, turn) in body.placed.items()
            if name not in (joint.child, tip)
        ]
    place, turn = bodies[-1].placed[tip]
    without = [repr(joint.link) for joint in joints if joint.inertia is None]
    if without:
        of_masses.append(f"{path.name} has no inertia for {', '.join(without)}.")
        warnings.append(of_masses[-1])
    robot = make(
        name=tree.name,
        joints=tuple(joints),
        tip_name=tip,
        tip_origin=vector3(place),
        tip_rotation=matrix3(turn),
        frames=tuple(frames),
        title=tree.name,
        source=f"the URDF file {path.name}",
        warnings=tuple(warnings),
        mass_warnings=tuple(of_masses),
        inertia_status="unknown" if without else "unverified",
        inertia_source="" if without else f"the URDF file {path.name}",
        base_joints=base_joints,
        other_joints=tuple(joint.name for joint in _beside(bodies, chain)),
    )
    robot = replace(
        robot,
        warnings=(*robot.warnings, *robot.length_doubts, *robot.inertia_doubts),
        mass_warnings=(*robot.mass_warnings, *robot.inertia_doubts),
    )
    return with_drives(robot, [joint.effort for joint in chain], [joint.rotor_inertia for joint in chain], path.name)


def _default_base(tree: UrdfTree, tip: str | None) -> str:
    """The root: that above the tip, or the only one there is."""
    if tip in tree.links:
        link = tip
        while link in tree.above:
            link = tree.above[link].parent
        return link
    if len(tree.roots) > 1:
        names = ", ".join(repr(name) for name in tree.roots[:5])
        problem = f"has {len(tree.roots)} links without a parent: {names}"
        raise InputError(str(tree.path), problem, "wanted one root, or give base")
    return tree.roots[0]


def _faults(tree: UrdfTree, bodies: list[_Body], path: list[UrdfJoint]) -> list[str]:
    """Raise what is wrong with the chain; one warning for all that is wrong beside it, where nothing is asked of it."""
    moving = {name for body in bodies[1:] for name in body.placed}
    needed = {joint.name for joint in path} | {tree.above[name].name for name in moving}
    beside = []
    for link in tree.links.values():
        if link.fault is not None and link.name in moving:
            raise link.fault
        if link.fault is not None:
            beside.append(link.fault)
    for joint in tree.above.values():
        if joint.fault is not None and joint.name in needed:
            raise joint.fault
        if joint.fault is not None:
            beside.append(joint.fault)
    if not beside:
        return []
    first, more = str(beside[0]), len(beside) - 1
    others = f" ({more} more {'fault' if more == 1 else 'faults'} of this kind)" if more else ""
    return [f"Beside the chain, the file has a fault that is passed over: {first}{others}."]


def _doubts(tree: UrdfTree, bodies: list[_Body], *, strict: bool) -> list[str]:
    """Inertias of the chain that no body can have, refused if ``strict``, else warnings; and parts that lack a mass."""
    found, weightless = [], []
    for link in (tree.links[name] for body in bodies[1:] for name in body.placed):
        if link.doubt and strict:
            where = f"{tree.path}: link {link.name!r} inertia"
            raise InputError(where, link.doubt, "wanted the inertia of a body that can exist")
        if link.doubt:
            found.append(f"Link {link.name!r} of {tree.path.name}: its inertia {link.doubt}.")
    for body in bodies[1:]:
        links = [tree.links[name] for name in body.placed] if _inertia(tree, body) is not None else []
        weightless += [repr(link.name) for link in links if link.has_shape and not (link.inertia and link.inertia.mass)]
    if weightless:
        parts = ", ".join(weightless[:5]) + (", ..." if len(weightless) > 5 else "")
        found.append(f"{tree.path.name} has a shape and no mass for {parts}: what it weighs is left out.")
    return found


def _gripper_joints(tree: UrdfTree, chain: list[UrdfJoint]) -> list[str]:
    """Joints at the end of the chain that look like those of a gripper: they count as joints of the arm."""
    found: list[UrdfJoint] = []
    for joint in reversed(chain[1:]):
        if not looks_like_gripper(joint):
            break
        found.insert(0, joint)
    if not found:
        return []
    names = ", ".join(repr(joint.name) for joint in found)
    what = (
        "which looks like a gripper's joint: it counts as a joint"
        if len(found) == 1
        else ("which look like joints of a gripper: they count as joints")
    )
    return [f"The chain ends with {names}, {what} of the arm. Give tip = {found[0].parent!r} to leave the gripper out."]


def looks_like_gripper(joint: UrdfJoint) -> bool:
    """Whether a joint moves a finger: by its name, by following another joint, or by a travel of a few centimetres."""
    words = f"{joint.name} {joint.child}".casefold()
    named = any(word in words for word in _GRIPPER_WORDS)
    return (
        named
        or joint.mimics is not None
        or (joint.kind == "prismatic" and joint.upper - joint.lower < _MAX_FINGER_TRAVEL)
    )


def _default_tip(tree: UrdfTree, base: str) -> str:
    """The last link of the only chain of moving joints. Links fixed beside it are part of its links."""
    link = base
    while True:
        body = _body(tree, link)
        if not body.leaving:
            ends = [name for name in body.placed if not tree.below[name]]
            break
        if len(body.leaving) > 1:
            ends = _leaves(tree, base)
            break
        link = body.leaving[0].child
    if len(ends) == 1:
        return ends[0]
    written = ", ".join(repr(end) for end in ends[:12]) + (", ..." if len(ends) > 12 else "")
    valid = f"give one of {written}"
    if len(body.leaving) > 1 and all(looks_like_gripper(joint) for joint in body.leaving):
        fingers = ", ".join(repr(joint.name) for joint in body.leaving)
        valid = f"give {body.leaving[0].parent!r} to end the chain before the gripper ({fingers}), or one of {written}"
    raise InputError("tip", f"is missing, and {tree.path.name} has {len(ends)} ends", valid)


def _leaves(tree: UrdfTree, base: str) -> list[str]:
    found, ahead = [], [base]
    while ahead:
        name = ahead.pop()
        if not tree.below[name]:
            found.append(name)
        ahead.extend(joint.child for joint in reversed(tree.below[name]))
    return found


def _path(tree: UrdfTree, base: str, tip: str) -> list[UrdfJoint]:
    """The joints from ``base`` to ``tip``."""
    if tip not in tree.links:
        raise InputError("tip", f"{tree.path.name} has no link {tip!r}", near_matches(tip, tree.links))
    joints: list[UrdfJoint] = []
    name = tip
    while name != base:
        if name not in tree.above:
            raise InputError("tip", f"{tip!r} is not below {base!r} in {tree.path.name}", "give another tip or base")
        joints.append(tree.above[name])
        name = joints[-1].parent
    return joints[::-1]


def _start(tree: UrdfTree, base: str, tip: str | None) -> tuple[str, FloatArray, FloatArray]:
    """The link from which the chain goes down, and its position [m] and orientation in the frame of the base.

    It is the base itself, or where the arm is not below that, the topmost link that the base is fixed to: the frame
    that a controller calls its base is often a link of its own, with nothing below it.
    """
    origin, rotation = np.zeros(3), np.eye(3)
    if tip is None and _body(tree, base).leaving:
        return base, origin, rotation
    link = tip
    while link is not None and link != base:
        link = tree.above[link].parent if link in tree.above else None
    if link is not None:
        return base, origin, rotation
    link = base
    while link in tree.above and tree.above[link].kind == "fixed":
        joint = tree.above[link]
        if joint.fault is not None:
            raise joint.fault
        rotation = rotation @ np.asarray(joint.rotation).T
        origin, link = origin - rotation @ np.asarray(joint.origin), joint.parent
    return link, origin, rotation


def _body(tree: UrdfTree, first: str, origin: FloatArray | None = None, rotation: FloatArray | None = None) -> _Body:
    """A link and everything fixed below it, in a frame in which the link has a place [m] and an orientation."""
    body = _Body({first: (np.zeros(3) if origin is None else origin, np.eye(3) if rotation is None else rotation)})
    ahead = [first]
    while ahead:
        name = ahead.pop()
        origin, rotation = body.placed[name]
        for joint in tree.below[name]:
            if joint.kind != "fixed":
                body.leaving.append(joint)
                continue
            body.placed[joint.child] = (
                origin + rotation @ np.asarray(joint.origin),
                rotation @ np.asarray(joint.rotation),
            )
            ahead.append(joint.child)
    return body


def _inertia(tree: UrdfTree, body: _Body) -> LinkInertia | None:
    """Of all links of the body, in the frame of the first; None where the file has none of them.

    None, too, where the first has a shape and no inertia: what is fixed to it, as a pad, does not tell what it weighs.
    """
    first = tree.links[next(iter(body.placed))]
    if first.inertia is None and first.has_shape:
        return None
    parts = []
    for name, (origin, rotation) in body.placed.items():
        inertia = tree.links[name].inertia
        if inertia is not None:
            parts.append(inertia.moved(origin, rotation))
    return merged(parts) if parts else None


def _base_joints(tree: UrdfTree, base: str) -> tuple[str, ...]:
    """Names of the joints above the base that move it."""
    moving: list[str] = []
    link = base
    while link in tree.above:
        joint = tree.above[link]
        if joint.kind != "fixed":
            moving.insert(0, joint.name)
        link = joint.parent
    return tuple(moving)


def _turned_base(tree: UrdfTree, base: str) -> list[str]:
    """A warning where z of the base is not that of the root, which is up by the custom of such files."""
    link, turn = base, np.eye(3)
    while link in tree.above:
        joint = tree.above[link]
        turn, link = np.asarray(joint.rotation) @ turn, joint.parent
    if turn[2, 2] > 1 - _UPRIGHT:
        return []
    where = f"-z of {base!r}, which the file turns against {link!r}"
    return [f"Gravity, unless it is given, is taken along {where}; base={link!r} keeps it."]


def _controller_base(body: _Body, base: str) -> list[str]:
    """A warning where the file has another frame in which, by the custom of ROS-Industrial, the controller counts."""
    if _CONTROLLER_BASE not in body.placed:
        return []
    origin, rotation = body.placed[_CONTROLLER_BASE]
    turned = not np.allclose(rotation, np.eye(3), atol=_SAME)
    if not turned and np.allclose(origin, 0, atol=_SAME):
        return []
    what, how = ("Velocities, normals and a", "turned") if turned else ("A", "shifted")
    return [
        f"{what} program's poses are taken in {base!r}, against which {_CONTROLLER_BASE!r} is {how}, by custom the "
        f"controller's frame: base={_CONTROLLER_BASE!r} takes that, base={base!r} keeps this."
    ]


def _beside(bodies: list[_Body], chain: list[UrdfJoint]) -> list[UrdfJoint]:
    """Joints that move something on the arm beside the chain; what stands on the base does not move with the arm."""
    used = {joint.name for joint in chain}
    return [joint for body in bodies[1:] for joint in body.leaving if joint.name not in used]


def _left_out(tree: UrdfTree, bodies: list[_Body], chain: list[UrdfJoint]) -> list[str]:
    """One warning for every joint that moves something beside the chain."""
    found = []
    for joint in _beside(bodies, chain):
        names, ahead = [], [joint.child]
        while ahead:
            names.append(ahead.pop())
            ahead.extend(below.child for below in tree.below[names[-1]])
        parts = [tree.links[name].inertia for name in names]
        mass = sum(part.mass for part in parts if part is not None)
        found.append(
            f"Beside the chain, joint {joint.name!r} moves {names[0]!r}: left out, with {mass:.4g} kg in "
            f"{len(names)} {'link' if len(names) == 1 else 'links'}."
        )
    return found
