"""The masses that the field calls effective: of free joints, with rotors, of one rigid body, of ISO/TS 15066."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Literal, get_args

import numpy as np

from bumpstop.arrays import FloatArray, as_number, as_rows
from bumpstop.errors import InputError, near_matches

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

    from bumpstop.model.robot import Robot

EffectiveMassDefinition = Literal["mass_matrix", "links", "links_and_rotors", "composite_rigid_body", "ts15066"]


def with_rotors(robot: Robot, inertia: npt.ArrayLike) -> Robot:
    """The robot with other rotors in its joints.

    Args:
        robot: any.
        inertia: reflected to the joints, one for all or (dof,) [kg m2 or kg]; 0: without rotors.
    """
    rotors = np.broadcast_to(np.asarray(inertia, dtype=np.float64), (robot.dof,)).tolist()
    joints = (replace(joint, rotor_inertia=rotor) for joint, rotor in zip(robot.joints, rotors, strict=True))
    return replace(robot, joints=tuple(joints))


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
    mass, first = 0.0, np.zeros((count, 3))
    second = np.zeros((count, 3, 3))
    eye = np.eye(3)
    for joint in robot.joints:
        inertia = joint.inertia
        if inertia is None:
            raise InputError("robot", f"{robot.name}: no inertia of link {joint.link!r} is known", "dynamics needs it")
        pose = robot.pose(q, joint.link, inertia.center)
        center, turn = pose[:, :3, 3], pose[:, :3, :3]
        square = np.einsum("ni,ni->n", center, center)[:, None, None] * eye - center[:, :, None] * center[:, None, :]
        second += turn @ np.asarray(inertia.tensor) @ np.swapaxes(turn, 1, 2) + inertia.mass * square
        first += inertia.mass * center
        mass += inertia.mass
    if mass == 0:
        raise InputError("robot", f"{robot.name} weighs nothing", "wanted inertia")
    center = first / mass
    square = np.einsum("ni,ni->n", center, center)[:, None, None] * eye - center[:, :, None] * center[:, None, :]
    tensor = second - mass * square
    moment = np.cross(robot.pose(q, link, point)[:, :3, 3] - center, direction)
    # Of masses in one line the tensor has no inverse: a push that turns it about that line turns nothing.
    turned = np.einsum("ni,nij,nj->n", moment, np.linalg.pinv(tensor, hermitian=True), moment)
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


def mass_by_definition(
    robot: Robot,
    q: npt.ArrayLike,
    direction: npt.ArrayLike,
    link: str | None,
    point: Sequence[float] | npt.ArrayLike,
    definition: EffectiveMassDefinition,
    payload_kg: float,
) -> FloatArray:
    """See :func:`bumpstop.model.effective_mass`, of every definition but that of the mass matrix."""
    from bumpstop.model.dynamics import effective_mass, unit_directions

    valid = get_args(EffectiveMassDefinition)
    if definition not in valid:
        raise InputError("definition", f"{definition!r} is none", near_matches(str(definition), valid))
    if payload_kg != 0 and definition != "ts15066":
        raise InputError("payload_kg", f"has no meaning with {definition!r}", "put the payload into the robot")
    if definition in ("links", "links_and_rotors"):
        rotors = robot.drive_train.rotor_inertia if definition == "links_and_rotors" else 0.0
        return effective_mass(with_rotors(robot, rotors), q, direction, link, point)
    rows, single = as_rows(q, "q", robot.dof)
    along = unit_directions(direction, len(rows), single)
    if definition == "ts15066":
        payload = as_number(payload_kg, "payload_kg")
        if payload < 0:
            raise InputError("payload_kg", f"is {payload:g}", "wanted zero or more")
        mass = np.full(len(rows), standard_mass(robot, payload))
    else:
        mass = composite_rigid_body_mass(robot, rows, along, link, point)
    one: FloatArray = mass[0] if single else mass
    return one
