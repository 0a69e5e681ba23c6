"""The same collision with the other model of the arm: neither bounds the other, so both are shown."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

from bumpstop.collision.scenario.arm_table import QUANTITY
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision.problem import CollisionProblem
    from bumpstop.collision.scenario.scenario import Scenario

Result = TypeVar("Result")

# What the elastic arm's force hangs on most: an arm of which these are assumed is not shown unasked.
_DECISIVE = ("rotor_inertia", "gear_stiffness", "servo_bandwidth")


def other_arm(problem: CollisionProblem, evaluate: Callable[[Scenario], Result]) -> Result | None:
    """A rigid arm in the place of an elastic one, or the reverse where the drive train is known; None elsewhere."""
    changes: dict[str, Any] = {"arm.model": "elastic"}
    if problem.elastic:
        changes = {"arm.model": "rigid", "arm.file": None} | {f"arm.{key}": None for key in QUANTITY}
    elif problem.robot.inertia_objection or set(_DECISIVE) & set(problem.drive_train.assumed):
        return None
    try:
        return evaluate(problem.scenario.with_values(changes))
    except InputError:  # what goes with one model alone
        return None
