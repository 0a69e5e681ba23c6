"""The masses that the field calls effective: of free joints, with rotors, of one rigid body, of ISO/TS 15066."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from bumpstop.arrays import FloatArray, as_number, as_rows
from bumpstop.errors import InputError, near_matches
from bumpstop.model.dynamics import one_or_all, unit_directions
from bumpstop.model.inertia import LinkInertia

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bumpstop.model.robot import Robot

EffectiveMassDefinition = Literal["mass_matrix", "links", "links_and_rotors", "composite_rigid_body", "ts15066"]

# Of m |c|^2: a moment of inertia below it is what rounding leaves of masses in one line.
_ROUNDING = 1e-13


def with_rotors(robot: Robot, inertia: npt.ArrayLike) -> Robot:
    """The robot with other rotors in its joints.

    Args:
        robot: any.
        inertia: reflected to the joints, one for all or (dof,) [kg m2 or kg]; 0: without rotors.
    """
    rotors = np.broadcast_to(np.asarray(inertia, dtype=np.float64), (robot.dof,)).tolist()
    joints = (replace(joint, rotor_inertia=rotor) for joint, rotor in zip(robot.joints, rotors, strict=True))
    return replace(robot, joints=tuple(joints))


def with_some_inertia(robot: Robot) -> Robot:
    """The robot itself, or with massless links where some inertia is not known: for those who use its geometry only."""
    if all(joint.inertia is not None for joint in robot.joints):
        return robot
    nothing = LinkInertia(mass=0.0)
    joints = tuple(replace(joint, inertia=joint.inertia or nothing) for joint in robot.joints)
    return replace(robot, joints=joints)


def composite_rigid_body_mass(
    robot: Robot,
    q: FloatArray,
    direction: FloatArray,
    link: str | None,
    point: Sequence[float] | npt.ArrayLike,
) -> FloatArray:
    """Mass at a point of the arm if its joints were locked and its base free: 1 / (1/m + (r x n)' Ic^-1 (r x n)).

    m, c and Ic are mass, centre and tensor of all moving links as one rigid body in that pose, r = p - c
    (Wang, Dehio and Kheddar, On Inverse Inertia Matrix and Contact-Force Model for Robotic Manipulators at Normal
    Impacts, IEEE Robotics and Automation Letters 7(2), 2022).

    Args:
        robot: with inertia; rotors count with the links that carry them.
        q: joint positions (N, dof) [rad].
        direction: unit vectors n in B (N, 3).
        link: name of a link; None: the tip.
        point: in the link's frame [m].

    Returns:
        (N,) [kg].
    """
    count = len(q)
    masses, centers, tensors = [], [], []
    for joint in robot.joints:
        inertia = joint.inertia
        if inertia is None:
            raise InputError("robot", f"{robot.name}: no inertia of link {joint.link!r} is known", "dynamics needs it")
        pose = robot.pose(q, joint.link, inertia.center)
        turn = pose[:, :3, :3]
        masses.append(inertia.mass)
        centers.append(pose[:, :3, 3])
        tensors.append(turn @ np.asarray(inertia.tensor) @ np.swapaxes(turn, 1, 2))
    mass = sum(masses)
    if mass == 0:
        raise InputError("robot", f"{robot.name} weighs nothing", "wanted inertia")
    center = sum((m * at for m, at in zip(masses, centers, strict=True)), np.zeros((count, 3))) / mass
    tensor, size = np.zeros((count, 3, 3)), np.zeros(count)
    for m, at, own in zip(masses, centers, tensors, strict=True):
        away = at - center
        square = np.einsum("ni,ni->n", away, away)[:, None, None] * np.eye(3) - away[:, :, None] * away[:, None, :]
        tensor += own + m * square
        size += m * np.einsum("ni,ni->n", at, at)
    moment = np.cross(robot.pose(q, link, point)[:, :3, 3] - center, direction)
    # Of masses in one line the tensor has no inverse: a push that turns it about that line turns nothing.
    principal, axes = np.linalg.eigh(tensor)
    about = np.einsum("nij,ni->nj", axes, moment)
    turns = principal > _ROUNDING * size[:, None]
    turned = np.divide(about**2, principal, out=np.zeros_like(about), where=turns).sum(axis=1)
    return np.asarray(1.0 / (1.0 / mass + turned))


def standard_mass(robot: Robot, payload_kg: float) -> float:
    """Mass of ISO/TS 15066, A.3: half of the moving links and the payload, in every pose and direction [kg].

    Args:
        robot: with inertia.
        payload_kg: with tool and workpiece.
    """
    links = [joint.inertia for joint in robot.joints if joint.inertia is not None]
    if len(links) < robot.dof:
        raise InputError("robot", f"{robot.name}: the mass of some link is not known", "dynamics needs it")
    return sum(link.mass for link in links) / 2 + payload_kg


def effective_mass(
    robot: Robot,
    q: npt.ArrayLike,
    direction: npt.ArrayLike,
    link: str | None = None,
    point: Sequence[float] | npt.ArrayLike = (0.0, 0.0, 0.0),
    *,
    definition: EffectiveMassDefinition = "mass_matrix",
    payload_kg: float = 0.0,
) -> FloatArray:
    """Mass the robot opposes to a push at a point of a link, by one of the definitions of the field.

    =========================  =======================================================================================
    ``"mass_matrix"``          1 / (n' J M^-1 J' n) with :func:`mass_matrix`: free joints, with the rotors that
                               joints have (Khatib 1987, operational space)
    ``"links"``                the same without rotors: what meets a body in the first moment, while gears give
    ``"links_and_rotors"``     the same with the rotors of :attr:`Robot.drive_train`, M + B: while gears are stiff
    ``"composite_rigid_body"`` joints locked, base free: all moving links as one rigid body in that pose (Wang, Dehio
                               and Kheddar 2022)
    ``"ts15066"``              half of the moving links and the payload (ISO/TS 15066:2016, A.3): no pose, no direction
    =========================  =======================================================================================

    Args:
        robot: with inertia.
        q: joint positions, (dof,) or (N, dof) [rad].
        direction: unit vector n in B. (3,), or (N, 3) with a row for each of ``q``.
        link: name of a link; default: the tip.
        point: in the link's frame [m].
        definition: one of the table.
        payload_kg: of ``"ts15066"``, with tool and workpiece. The others take it as part of the last link.

    Returns:
        () or (N,) [kg]; infinite where no joint moves the point along n.

    Raises:
        InputError: a direction that is no unit vector, a motion that moves no mass, or a definition that is none.
    """
    valid = get_args(EffectiveMassDefinition)
    if definition not in valid:
        raise InputError("definition", f"{definition!r} is none", near_matches(str(definition), valid))
    if payload_kg != 0 and definition != "ts15066":
        raise InputError("payload_kg", f"has no meaning with {definition!r}", "put the payload into the robot")
    rows, single = as_rows(q, "q", robot.dof)
    along = unit_directions(direction, len(rows), single)
    if definition == "ts15066":
        payload = as_number(payload_kg, "payload_kg")
        if payload < 0:
            raise InputError("payload_kg", f"is {payload:g}", "wanted zero or more")
        mass = np.full(len(rows), standard_mass(robot, payload))
    elif definition == "composite_rigid_body":
        mass = composite_rigid_body_mass(robot, rows, along, link, point)
    else:
        if definition in ("links", "links_and_rotors"):
            robot = with_rotors(robot, robot.drive_train.rotor_inertia if definition == "links_and_rotors" else 0.0)
        mass = mass_of_free_joints(robot, rows, along, link, point)
    return one_or_all(mass, single)


def mass_of_free_joints(
    robot: Robot,
    q: FloatArray,
    direction: FloatArray,
    link: str | None,
    point: Sequence[float] | npt.ArrayLike,
) -> FloatArray:
    """1 / (n' J M^-1 J' n) with the robot's own mass matrix; arguments as of :func:`composite_rigid_body_mass`."""
    number, offset = robot.frame(link, point)
    mass: FloatArray = robot.dynamics.effective_mass(q, direction, number, np.ascontiguousarray(offset))
    if np.isnan(mass).any():
        raise InputError(
            "robot",
            f"some motion of {robot.name} at q[{int(np.argmax(np.isnan(mass)))}] moves no mass",
            "wanted inertia that every joint moves, or rotors",
        )
    return mass
