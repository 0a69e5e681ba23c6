"""The design guide: the cheapest way to meet the limits, given what every change costs."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bumpstop.study.requirement.design_search import CostRate, Design, DesignSearch

if TYPE_CHECKING:
    from bumpstop.collision import Scenario


@dataclass(frozen=True)
class DesignGuide:
    """What the guide found.

    Attributes:
        now: the scenario as it is.
        single_change: the cheapest change of each variable by itself; None where none of its range is enough.
        combined: the cheapest change of all; None where nothing in the ranges is enough.
        reason: why there is none.
    """

    now: Design
    single_change: Mapping[str, Design | None]
    combined: Design | None
    reason: str

    def to_json(self) -> dict[str, Any]:
        """Everything; what does not exist is None."""
        return {
            "now": self.now.to_json(),
            "single_change": {name: design and design.to_json() for name, design in self.single_change.items()},
            "combined": self.combined and self.combined.to_json(),
            "reason": self.reason,
        }


def min_cost(scenario: Scenario, cost_rates: Sequence[CostRate]) -> DesignGuide:
    """Find the changes of least total cost with which the scenario meets its limits and its false-alarm rate.

    Quantised variables are tried at every value on the way to their most conservative one; for each, the rest is a
    smooth problem with a linear cost (sequential quadratic programming, from the present values and from the most
    conservative ones). Every plan is checked by its integrated distribution.

    Args:
        scenario: as it is now; it has limits.
        cost_rates: of the variables that may change.

    Raises:
        InputError: a variable moves out of what the scenario takes, or there are too many quantised values.
    """
    search = DesignSearch(scenario, cost_rates)
    now = search.design(search.start)
    if now.meets:
        now = search.told(now)
        return DesignGuide(now, {}, now, "The scenario meets its limits as it is.")
    single_change = {cost_rate.swept.variable.name: search.single_change(k) for k, cost_rate in enumerate(cost_rates)}
    combined = search.combined([design for design in single_change.values() if design is not None])
    reason = ""
    single_change = {name: design and search.told(search.rounded(design)) for name, design in single_change.items()}
    combined = combined and search.told(search.rounded(search.needed(combined)))
    if combined is None:
        conservative = search.design(search.conservative)
        if conservative.untouched:
            reason = f"No design in these ranges is put to the test. {conservative.untouched}"
        else:
            reason = (
                "No design in these ranges is enough: with the most conservative value of each the force that is "
                f"exceeded with the accepted risk is {math.exp(-conservative.margin):.3g} times what is allowed"
                + (
                    "."
                    if conservative.false_alarm_margin >= 0
                    else ", and false alarms are more frequent than accepted."
                )
            )
    return DesignGuide(now, single_change, combined, reason)


def check_whole_steps(scenario: Scenario, cost_rates: Sequence[CostRate]) -> None:
    """Refuse what :func:`min_cost` would, with too many whole steps to be tried, before a study has worked for long.

    Raises:
        InputError: there are too many quantised values.
    """
    if not any(cost_rate.swept.variable.quantum(scenario) for cost_rate in cost_rates):
        return
    search = DesignSearch(scenario, cost_rates)
    if not search.design(search.start).meets:
        search.combinations()
