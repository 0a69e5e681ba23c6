"""Robots as text that C++ programs read without a library: see include/bumpstop/model/robot_description.hpp."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Iterable

    from bumpstop.model.robot import Robot


def describe(robot: Robot) -> str:
    """The robot's chain, limits and inertia, a line for each [m, rad, kg], with all digits.

    Links whose inertia is not known have no ``inertia`` line. Frames fixed to links and the sources are left out.
    """
    lines = [
        "bumpstop-robot 1",
        "# origin x y z; rotation row by row; limits lower upper speed; inertia: mass, centre of mass, tensor about it",
        "# row by row, rotor inertia at the joint; tip: origin, rotation, name [m, rad, s, kg]",
        f"name {robot.name}",
    ]
    for joint in robot.joints:
        lines += [
            f"joint {joint.kind} {joint.name}",
            f"link {joint.link}",
            f"origin {_numbers(joint.origin)}",
            f"rotation {_numbers(value for row in joint.rotation for value in row)}",
            f"axis {_numbers(joint.axis)}",
            f"limits {_numbers((joint.lower, joint.upper, joint.velocity))}",
        ]
        if joint.inertia is not None:
            tensor = (value for row in joint.inertia.tensor for value in row)
            inertia = [joint.inertia.mass, *joint.inertia.center, *tensor, joint.rotor_inertia]
            lines.append(f"inertia {_numbers(inertia)}")
    tip = [*robot.tip_origin, *(value for row in robot.tip_rotation for value in row)]
    lines += [f"tip {_numbers(tip)} {robot.tip_name}", "end"]
    return "\n".join(lines) + "\n"


def _numbers(values: Iterable[float]) -> str:
    return " ".join(repr(float(value)) for value in values)
