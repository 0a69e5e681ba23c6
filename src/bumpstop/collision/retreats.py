"""How long collisions can be followed whose arm goes back: the retreats from all control cycles are kept."""

from __future__ import annotations

import math
from contextlib import contextmanager
from typing import TYPE_CHECKING

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bumpstop.collision.scenario.scenario import Scenario

# As max_retreat_points of the kernels, less what the motion lasts longer than it is asked to.
_MAX_POINTS = 0.9e8


@contextmanager
def retreats_in_memory() -> Iterator[None]:
    """Refuse collisions whose retreats take gigabytes by name.

    Raises:
        InputError: the kernels refuse them, or there is no memory.
    """
    try:
        yield
    except MemoryError:
        problem = "collisions stay undetected for so long that the retreats from all control cycles need gigabytes"
        valid = "wanted a shorter motion, a longer simulation.step_s, or thresholds that detect them"
        raise InputError("motion.duration_s", problem, valid) from None


def longest_motion_s(scenario: Scenario) -> float:
    """A motion this long can be followed whatever is detected [s]; infinite where no retreats are kept."""
    contact, step = scenario.contact, scenario.simulation.step_s
    gives_way = scenario.arm.model == "elastic" or contact.gauge_mass_kg is not None or contact.damping_Ns_m > 0
    if scenario.reaction.kind != "reverse" or contact.kind == "free" or not gives_way:
        return math.inf
    return math.sqrt(_MAX_POINTS * scenario.detector.feedback_period_s * step)
