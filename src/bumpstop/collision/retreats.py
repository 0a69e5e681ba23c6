"""How long collisions can be followed whose arm goes back: the retreats from all control cycles are kept."""

from __future__ import annotations

import math
from contextlib import contextmanager
from typing import TYPE_CHECKING

from bumpstop.collision.scenario_values import gives_way
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bumpstop.collision.scenario.scenario import Scenario

# As max_retreat_points of the kernels, less what the motion lasts longer than it is asked to.
_MAX_POINTS = 0.9e8


@contextmanager
def retreats_in_memory() -> Iterator[None]:
    """Refuse by name what the kernels refuse: collisions whose retreats would take gigabytes.

    Raises:
        InputError: they do.
    """
    try:
        yield
    except ValueError:  # std::length_error
        problem = "collisions stay undetected for so long that the retreats from all control cycles need gigabytes"
        valid = "wanted a shorter motion, a longer simulation.step_s, or thresholds that detect them"
        raise InputError("motion.duration_s", problem, valid) from None


def longest_motion_s(scenario: Scenario) -> float:
    """A motion this long can be followed whatever is detected [s]; infinite where no retreats are kept."""
    if scenario.reaction.kind != "reverse" or scenario.contact.kind != "clamped" or not gives_way(scenario):
        return math.inf
    return math.sqrt(_MAX_POINTS * scenario.detector.feedback_period_s * scenario.simulation.step_s)
