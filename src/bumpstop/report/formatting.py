"""How the report writes numbers, probabilities and names: the same everywhere on the page."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from bumpstop.terminal import as_written, number

if TYPE_CHECKING:
    from bumpstop.collision import CollisionResult
    from bumpstop.joint.parameters import Parameter


def quantity(value: float, unit: str, *limits: float | None) -> str:
    """A number with its unit, where it is a number; ``limits`` are those of :func:`bumpstop.terminal.number`."""
    return f"{number(value, *limits)} {unit}" if math.isfinite(value) else number(value)


def in_phases(first: float, later: float, unit: str, text: Callable[[float], str] = as_written) -> str:
    """The two limits of contact that is judged in two phases, or the one that they share; ``text`` of a number."""
    if first == later > 0:
        return f"{text(later)} {unit}"
    return f"{f'{text(first)} {unit}' if first > 0 else 'none'} at first, {text(later)} {unit} later"


def with_error(value: Parameter | None) -> str:
    """A parameter with its standard error, where it has one; ``"unknown"`` where it was not seen."""
    if value is None:
        return "unknown"
    error = "" if value.standard_error is None else f" ± {value.standard_error:.2g}"
    return f"{value.value:.4g}{error}"


def acceptable(forces: dict[str, Any], unjudged: str) -> str:
    """Whether a scenario is acceptable at thresholds that were tuned, and what is not; ``unjudged`` without limits."""
    if forces["acceptable"] is None:
        # With a limit there is something to judge by, but nothing that was hit.
        return unjudged if forces["limit"] is None else "inconclusive"
    return "yes" if forces["acceptable"] else "no: " + ", ".join(forces["fails_by"]).replace("false_alarm", "alarms")


def percentile(name: str) -> str:
    """``p999`` as a person writes it: ``p99.9``."""
    return {"p999": "p99.9"}.get(name, name)


def arm(result: CollisionResult) -> str:
    """What the arm is called."""
    robot = result.problem.robot
    return robot.title or robot.name


def method_words(result: CollisionResult) -> str:
    """How the distribution was computed."""
    if result.kind == "exact":
        return "integrated distribution (no sampling)"
    return f"sampled distribution: {result.samples} collisions, seed {result.seed}"
