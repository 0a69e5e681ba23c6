"""Warnings beside the answers of studies and requirements: those of one evaluation of each answer."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bumpstop.errors import InputError
from bumpstop.study.speed.motion_duration import duration_s
from bumpstop.study.variable import Variable

if TYPE_CHECKING:
    from collections.abc import Callable, Collection, Iterable, Sequence

    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Scenario

FAILS_WITH_FINER_STEPS = "NOT ACCEPTABLE with finer simulation steps"
# Sentences that differ by these alone say the same.
_FIGURE = re.compile(r"\d[\d.]*(e[+-]?\d+)?")


class AnswerWarnings(NamedTuple):
    """What is said beside one answer.

    Attributes:
        answer: which one, in a few words.
        warnings: of its evaluation.
    """

    answer: str
    warnings: Sequence[str]


def warnings_of(scenario_of: Callable[[], Scenario]) -> tuple[str, ...]:
    """What ``bumpstop evaluate`` says beside the verdict of an answer: its warnings, and that the other arm fails.

    Args:
        scenario_of: makes the scenario of the answer. What no scenario can say, or none can compute, has no warnings.
    """
    from bumpstop.collision import evaluate
    from bumpstop.collision.arm.other_arm_verdict import said_beside

    try:
        return said_beside(evaluate(scenario_of()))
    except InputError:
        return ()


def line_through(scenario: Scenario, q: FloatArray, velocity: FloatArray) -> Scenario:
    """The scenario of a straight line, through another pose and at another velocity.

    Args:
        scenario: of a straight line.
        q: pose (dof,) [rad or m].
        velocity: of the tip, base frame (3,) [m/s]; a slower line is followed as far.
    """
    factor = float(np.linalg.norm(velocity)) / Variable("motion.speed").value(scenario) * 1e3
    return through_pose(scenario, q, velocity).with_values({"motion.duration_s": duration_s(scenario, factor)})


def through_pose(scenario: Scenario, q: FloatArray, velocity: FloatArray) -> Scenario:
    """As :func:`line_through`, but it ends when the scenario's line does."""
    pose = {"pose_deg": None, "pose_rad": q.tolist()}
    return scenario.with_values(pose | {"motion.velocity_mm_s": (1e3 * velocity).tolist()})


def told_once(found: Iterable[AnswerWarnings], known: Collection[str] = ()) -> list[str]:
    """Every sentence once, with the first answer that it is beside; those that differ by figures are one.

    Args:
        found: in the order in which they are told.
        known: sentences that are told anyway.
    """
    first: dict[str, tuple[str, str]] = {}
    count: dict[str, int] = {}
    for answer, warnings in found:
        for warning in warnings:
            if warning in known:
                continue
            kind = _FIGURE.sub("#", warning)
            first.setdefault(kind, (answer, warning))
            count[kind] = count.get(kind, 0) + 1
    return [f"{answer}{_others(count[kind] - 1)}: {warning}" for kind, (answer, warning) in first.items()]


def _others(count: int) -> str:
    return "" if count == 0 else " and one more answer" if count == 1 else f" and {count} more answers"
