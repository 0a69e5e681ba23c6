"""What is said where a scenario's numbers are taken for known: those that it calls uncertain, and doubtful lengths."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario


def doubts_as_given(scenario: Scenario) -> list[str]:
    """As :func:`as_given`, and why lengths of its robot are hardly in metres: for results without a verdict's notes."""
    from bumpstop.collision.scenario.scenario_file import robot_of

    return [*as_given(scenario), *robot_of(scenario).length_doubts]


def as_given(scenario: Scenario) -> list[str]:
    """A sentence where ``[uncertainty]`` is left out; none where the scenario has no such table."""
    inputs = len(scenario.uncertainty)
    if not inputs:
        return []
    return [
        f"This is the scenario as given: that {inputs} of its numbers are uncertain ([uncertainty]) is left out. See "
        "bumpstop.evaluate_uncertain, or bumpstop evaluate."
    ]
