"""Whether an acceptable verdict hangs on the model of the arm."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bumpstop.collision.result import CollisionResult


def other_arm_fails(result: CollisionResult) -> str:
    """What the other model of the arm comes to where it is not acceptable, in a sentence; empty where it is."""
    other = result.other_arm
    if other is None or other.verdict.acceptable is True:
        return ""
    found = "exceeds the limits" if other.verdict.acceptable is False else "cannot be judged"
    models, reason = (one.scenario.arm.model for one in (other, result)), other.verdict.reason
    return f"The {' arm in the place of the '.join(models)} one {found}: {reason[:1].lower()}{reason[1:]}"


def said_beside(result: CollisionResult) -> tuple[str, ...]:
    """The warnings of a collision, and that the other model of the arm is not acceptable where this one is."""
    other = other_arm_fails(result) if result.verdict.acceptable else ""
    return (*result.warnings, other) if other else result.warnings
