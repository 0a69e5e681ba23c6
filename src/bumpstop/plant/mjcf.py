"""A robot and the objects about it as MJCF, the text that MuJoCo reads; and MuJoCo, where it is installed."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.errors import InputError
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.plant.objects import quoted

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.model import Robot
    from bumpstop.plant.objects import PlantObject

TIP = "tip"
TOOL = "tool"
_LINK_COLOURS = ("0.35 0.45 0.55 1", "0.62 0.66 0.70 1")
# Contacts as stiff as the step lets them be: what gives is the spring of the object (docs/reference/robot/plant.md).
_CONTACT = 'condim="1" solref="0.001 {damping}" solimp="0.9999 0.9999 0.001 0.5 2"'
# Of the critical. The face of a free body has next to no damping of its own and would bounce.
_CLAMPED, _FREE = 1, 2


def import_mujoco() -> Any:
    """The module, or an error that says how to get it."""
    try:
        import mujoco
    except ImportError:
        raise InputError("plant", "mujoco is not installed", "pip install mujoco") from None
    return mujoco


def mjcf(
    robot: Robot,
    *,
    rotor_inertia: Sequence[float] | FloatArray | None = None,
    joint_stiffness: Sequence[float] | FloatArray | None = None,
    joint_damping: Sequence[float] | FloatArray | None = None,
    objects: Sequence[PlantObject] = (),
    gravity: Sequence[float] = STANDARD_GRAVITY,
    step: float = 2e-4,
    contact_link: str | None = None,
    contact_point: Sequence[float] = (0.0, 0.0, 0.0),
    contact_radius: float = 0.01,
) -> str:
    """Write a robot as MJCF.

    Link inertia is exact; capsules between the joints' origins are drawn and touch nothing. What touches the objects is
    one ball about the contact point. Joint limits are not written: the plant's commands are checked instead.

    Args:
        robot: with the inertia of every link.
        rotor_inertia: reflected to the joints (dof,) [kg m2 or kg]; default: the robot's own.
        joint_stiffness: of the gears (dof,) [Nm/rad or N/m]; infinite: rigid. A joint that gives has two coordinates,
            the motor's and the gear's twist ``<joint>:twist``, which add up to the link's.
        joint_damping: of the gears' twist (dof,) [Nm s/rad]; default: none.
        objects: what stands about the robot.
        gravity: acceleration of free fall in the base frame [m/s2].
        step: of the integration [s].
        contact_link: link, frame or tip the ball belongs to; default: the tip.
        contact_point: its centre in that link's frame [m].
        contact_radius: of the ball [m].

    Returns:
        The text. Bodies have the names of links, joints and motors those of joints.

    Raises:
        InputError: the inertia of a link is not known, or one that no body has.
    """
    dof = robot.dof
    rotors = [joint.rotor_inertia for joint in robot.joints] if rotor_inertia is None else list(rotor_inertia)
    stiffness = [np.inf] * dof if joint_stiffness is None else list(joint_stiffness)
    damping = [0.0] * dof if joint_damping is None else list(joint_damping)
    place = robot.frame(contact_link, contact_point)
    lines = [
        f'<mujoco model="{quoted(robot.name)}">',
        '<compiler angle="radian" autolimits="false" inertiafromgeom="false" boundmass="1e-12" boundinertia="1e-14"/>',
        f'<option timestep="{float(step)!r}" gravity="{_numbers(gravity)}" integrator="implicitfast" solver="Newton" '
        'jacobian="dense" tolerance="1e-10"/>',
        '<visual><global offwidth="1280" offheight="960"/><headlight ambient="0.4 0.4 0.4" diffuse="0.5 0.5 0.5"/>'
        '<quality shadowsize="4096"/></visual>',
        '<asset><texture name="sky" type="skybox" builtin="gradient" rgb1="0.92 0.94 0.96" rgb2="0.75 0.80 0.86" '
        'width="64" height="64"/>'
        '<texture name="grid" type="2d" builtin="checker" rgb1="0.86 0.87 0.88" rgb2="0.80 0.81 0.83" width="256" '
        'height="256"/><material name="floor" texture="grid" texrepeat="32 32"/></asset>',
        '<default><geom contype="0" conaffinity="0" mass="0"/></default>',
        "<worldbody>",
        '<light pos="0.8 -1.2 2.5" dir="-0.3 0.45 -1" diffuse="0.5 0.5 0.5"/>',
        '<geom type="plane" size="8 8 0.1" material="floor"/>',
        _capsule((0, 0, 0), robot.joints[0].origin, 0.08, "0.25 0.27 0.30 1"),
    ]
    for j, joint in enumerate(robot.joints):
        inertia = joint.inertia
        if inertia is None:
            raise InputError("robot", f"{robot.name}: no inertia of link {joint.link!r} is known", "the plant needs it")
        _check_inertia(robot.name, joint.link, np.array(inertia.tensor))
        (xx, xy, xz), (_, yy, yz), (_, _, zz) = inertia.tensor
        axis, kind = _numbers(joint.axis), "slide" if joint.kind == "prismatic" else "hinge"
        lines += [
            f'<body name="{quoted(joint.link)}" pos="{_numbers(joint.origin)}" quat="{_quaternion(joint.rotation)}">',
            f'<inertial pos="{_numbers(inertia.center)}" mass="{float(inertia.mass)!r}" '
            f'fullinertia="{_numbers((xx, yy, zz, xy, xz, yz))}"/>',
            f'<joint name="{quoted(joint.name)}" type="{kind}" axis="{axis}" armature="{float(rotors[j])!r}"/>',
        ]
        if np.isfinite(stiffness[j]):
            lines.append(
                f'<joint name="{quoted(joint.name)}:twist" type="{kind}" axis="{axis}" '
                f'stiffness="{float(stiffness[j])!r}" damping="{float(damping[j])!r}"/>'
            )
        end = robot.joints[j + 1].origin if j + 1 < dof else robot.tip_origin
        radius = 0.07 - 0.04 * j / max(1, dof - 1)
        if j == dof - 1:
            radius = min(radius, max(0.01, float(np.linalg.norm(end)) / 2))
        lines.append(_capsule((0, 0, 0), end, radius, _LINK_COLOURS[j % 2]))
        if j == dof - 1:
            # A body of its own, so that a sensor between it and the link measures the force on the tool.
            lines += [
                f'<body name=":{TOOL}" pos="{_numbers(robot.tip_origin)}" quat="{_quaternion(robot.tip_rotation)}">',
                f'<site name="{TIP}"/>',
            ]
            if place[0] == j:
                at = np.asarray(robot.tip_rotation).T @ (place[1] - np.asarray(robot.tip_origin))
                lines.append(_ball(at, contact_radius))
            lines.append("</body>")
        elif place[0] == j:
            lines.append(_ball(place[1], contact_radius))
    lines += ["</body>"] * dof
    for thing in objects:
        lines += thing.mjcf(contact_radius)
    lines += ["</worldbody>", "<actuator>"]
    lines += [f'<general name="{quoted(joint.name)}" joint="{quoted(joint.name)}"/>' for joint in robot.joints]
    lines += ["</actuator>", "<sensor>", f'<force site="{TIP}"/>', f'<torque site="{TIP}"/>', "</sensor>", "<contact>"]
    for thing in objects:
        contact = _CONTACT.format(damping=_CLAMPED if thing.body_mass is None else _FREE)
        lines.append(f'<pair geom1=":{TOOL}" geom2="{quoted(thing.geom)}" {contact}/>')
    return "\n".join([*lines, "</contact>", "</mujoco>"]) + "\n"


def _check_inertia(robot: str, link: str, tensor: FloatArray) -> None:
    """MuJoCo refuses what no distribution of mass has; say which link it is."""
    a, b, c = np.sort(np.linalg.eigvalsh(tensor))
    if a + b < c * (1 - 1e-9):
        raise InputError(
            "robot",
            f"{robot}: link {link!r} has principal moments of inertia {a:.4g}, {b:.4g} and {c:.4g} kg m2",
            "no body has one greater than the sum of the others",
        )


def _ball(center: Iterable[float], radius: float) -> str:
    size = float(radius)
    return f'<geom name=":{TOOL}" type="sphere" pos="{_numbers(center)}" size="{size!r}" rgba="0.90 0.62 0 1"/>'


def _capsule(begin: Iterable[float], end: Iterable[float], radius: float, colour: str) -> str:
    a, b = np.array([*begin], dtype=float), np.array([*end], dtype=float)
    length = float(np.linalg.norm(b - a))
    if length < 1e-3:
        return f'<geom type="sphere" size="{float(radius)!r}" rgba="{colour}"/>'
    # The round end stops where the next joint is.
    b = a + (b - a) * max(0.1, 1 - radius / length)
    return f'<geom type="capsule" fromto="{_numbers((*a, *b))}" size="{float(radius)!r}" rgba="{colour}"/>'


def _quaternion(rotation: Sequence[Sequence[float]]) -> str:
    """W x y z of a rotation matrix, by the largest of the four, which keeps all digits."""
    R = np.asarray(rotation, dtype=np.float64)
    squares = np.array(
        [
            1 + R[0, 0] + R[1, 1] + R[2, 2],
            1 + R[0, 0] - R[1, 1] - R[2, 2],
            1 - R[0, 0] + R[1, 1] - R[2, 2],
            1 - R[0, 0] - R[1, 1] + R[2, 2],
        ]
    )
    largest = int(np.argmax(squares))
    skew = (R[2, 1] - R[1, 2], R[0, 2] - R[2, 0], R[1, 0] - R[0, 1])
    sums = {(1, 2): R[0, 1] + R[1, 0], (1, 3): R[0, 2] + R[2, 0], (2, 3): R[1, 2] + R[2, 1]}
    q = np.empty(4)
    q[largest] = squares[largest]
    for i in range(4):
        if i == largest:
            continue
        pair = (min(i, largest), max(i, largest))
        q[i] = skew[pair[1] - 1] if pair[0] == 0 else sums[pair]
    return _numbers(q / np.linalg.norm(q))


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
