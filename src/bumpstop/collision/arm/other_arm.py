"""The same collision with the other model of the arm: neither bounds the other, so both are shown."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bumpstop.collision.scenario.arm_table import QUANTITY
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision.problem import CollisionProblem
    from bumpstop.collision.result import CollisionResult

# What the elastic arm's force hangs on most: an arm of which these are assumed is not shown unasked.
_DECISIVE = ("rotor_inertia", "gear_stiffness", "servo_bandwidth")


def other_arm(problem: CollisionProblem) -> CollisionResult | None:
    """A rigid arm in the place of an elastic one, or the reverse where the drive train is known; None elsewhere."""
    from bumpstop.collision.evaluation import evaluate

    changes: dict[str, Any] = {"arm.model": "elastic"}
    if problem.elastic:
        changes = {"arm.model": "rigid", "arm.file": None} | {f"arm.{key}": None for key in QUANTITY}
    elif problem.robot.inertia_objection or set(_DECISIVE) & set(problem.drive_train.assumed):
        return None
    try:
        return evaluate(problem.scenario.with_values(changes))
    except InputError:  # what goes with one model alone
        return None


def arm_to_json(result: CollisionResult) -> dict[str, Any]:
    """The object ``arm`` that ``bumpstop evaluate --json`` prints."""
    problem, other, limit = result.problem, result.other_arm, result.pressing_limit
    arm: dict[str, Any] = {"model": problem.scenario.arm.model}
    if problem.elastic:
        arm["status"] = dict(problem.drive_train.status)
        arm["pressing_limit"] = None if limit is None else limit.to_json()
    if other is not None:
        arm["other"] = {
            "model": other.scenario.arm.model,
            "peak_force_N": other.peak_force.to_json(),
            "p_over_force": other.verdict.p_over_force,
            "p_over_pressure": other.verdict.p_over_pressure,
            "conclusion": other.verdict.conclusion,
        }
    return arm
