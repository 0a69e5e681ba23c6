"""What is said where a scenario's numbers are taken for known, and the scenario says that they are not."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario


def as_given(scenario: Scenario) -> list[str]:
    """A sentence where ``[uncertainty]`` is left out; none where the scenario has no such table."""
    inputs = len(scenario.uncertainty)
    if not inputs:
        return []
    return [
        f"This is the scenario as given: that {inputs} of its numbers are uncertain ([uncertainty]) is left out. See "
        "bumpstop.evaluate_uncertain, or bumpstop evaluate."
    ]
