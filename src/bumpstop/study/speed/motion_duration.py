"""How long a motion at another speed is followed."""

from __future__ import annotations

from typing import TYPE_CHECKING

from bumpstop.collision.problem import MAX_STEPS
from bumpstop.collision.retreats import longest_motion_s

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario


def duration_s(scenario: Scenario, factor: float) -> float:
    """Horizon at ``factor`` times the scenario's speed [s]: a slower arm goes as far, if it can be followed so long.

    What an arm at full speed detects within the scenario's motion, a slow one may not: the safe speeds of some bodies
    would have no lower end.
    """
    own, longest = scenario.motion.duration_s, MAX_STEPS * scenario.simulation.step_s
    return max(own, min(own / min(1.0, factor), longest, longest_motion_s(scenario)))
