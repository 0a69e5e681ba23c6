"""What is said where a scenario's numbers are taken for known: uncertain and assumed ones, and doubtful lengths."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario


def doubts_as_given(scenario: Scenario) -> list[str]:
    """As :func:`as_given`, what is assumed, and what is doubted of its robot.

    For results without a verdict's notes.
    """
    from bumpstop.collision.scenario.scenario_file import robot_of

    return [*as_given(scenario), *assumed_values(scenario), *robot_of(scenario).doubts]


def assumed_values(scenario: Scenario) -> list[str]:
    """A sentence on the figures that stand for those of the cell until somebody knows these."""
    assumed = scenario.assumed
    if not assumed:
        return []
    verb = "is" if len(assumed) == 1 else "are"
    return [
        f"{', '.join(assumed)} {verb} ASSUMED, as the scenario says: the verdict holds for these values alone, "
        "whatever the cell has."
    ]


def as_given(scenario: Scenario) -> list[str]:
    """A sentence where ``[uncertainty]`` is left out; none where the scenario has no such table."""
    inputs = len(scenario.uncertainty)
    if not inputs:
        return []
    return [
        f"This is the scenario as given: that {'one' if inputs == 1 else inputs} of its numbers "
        f"{'is' if inputs == 1 else 'are'} uncertain ([uncertainty]) is left out. See bumpstop.evaluate_uncertain, or "
        "bumpstop evaluate."
    ]
