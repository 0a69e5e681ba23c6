"""Which joints of a robot the six of a controller are; the others travel in its registers."""

from __future__ import annotations

from collections.abc import Sequence

from bumpstop.errors import InputError

# A controller has six joints, all of which turn. Those of an axis beside it, such as a rail, travel in general-purpose
# registers, of which 24 to 47 belong to clients of this protocol: position of the first in 24, its signal in 25, the
# second in 26 and 27, ...
CONTROLLER_JOINTS = 6
FIRST_REGISTER, LAST_REGISTER = 24, 47
MAX_JOINTS = CONTROLLER_JOINTS + (LAST_REGISTER + 1 - FIRST_REGISTER) // 2
DEFAULT_AXES = tuple(range(1, CONTROLLER_JOINTS + 1))


def read_axes(text: str) -> tuple[int, ...]:
    """Numbers of joints as they stand in an address: ``2,3,4,5,6,7``.

    Raises:
        InputError: something there is no whole number.
    """
    try:
        return tuple(int(part) for part in text.split(","))
    except ValueError:
        raise InputError("axes", f"is {text!r}", "wanted six numbers of joints, such as 2,3,4,5,6,7") from None


def joint_order(joints: int, axes: Sequence[int]) -> list[int]:
    """Joints in the order in which they travel: those of the controller, then those in registers.

    Args:
        joints: of the robot.
        axes: (6,) which of them, from 1, the controller's are, from its base to its wrist.

    Returns:
        (n,) places of the joints, from 0.

    Raises:
        InputError: fewer joints than a controller has, more than its registers hold, or axes that are not six rising
            numbers of joints.
    """
    if not CONTROLLER_JOINTS <= joints <= MAX_JOINTS:
        problem = f"a controller of Universal Robots has six joints, the robot has {joints}"
        valid = f"wanted {CONTROLLER_JOINTS} to {MAX_JOINTS}, those beyond 6 in output_double_register_24 .."
        raise InputError("rtde", problem, valid)
    known = sorted(set(axes) & set(range(1, joints + 1)))
    if list(axes) != known or len(known) != CONTROLLER_JOINTS:
        raise InputError("axes", f"is {','.join(map(str, axes))}", f"wanted six rising numbers from 1 to {joints}")
    return [axis - 1 for axis in axes] + [j for j in range(joints) if j + 1 not in axes]


def check_turning(axes: Sequence[int], names: Sequence[str], slides: Sequence[bool]) -> None:
    """Refuse joints of a controller that slide, as none of its six does.

    Args:
        axes: (6,) joints, from 1, that the controller's are.
        names: (n,) of the robot's joints.
        slides: (n,) whether they slide.

    Raises:
        InputError: one of the six slides.
    """
    for axis in axes:
        if slides[axis - 1]:
            problem = f"joint {axis}, {names[axis - 1]}, slides, and all six of a controller turn"
            raise InputError("axes", problem, "wanted the joints that turn, such as 2,3,4,5,6,7")
