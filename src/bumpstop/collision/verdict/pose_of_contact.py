"""Whether an elastic arm, linear about the pose at the median offset, hits bodies elsewhere on its line harder."""

from __future__ import annotations

import math
from statistics import NormalDist
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.verdict.finer_steps import JudgedForce
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from bumpstop.arrays import FloatArray
    from bumpstop.collision.outcome import CollisionOutcome
    from bumpstop.collision.scenario.scenario import Scenario
    from bumpstop.collision.verdict.verdict import Verdict

# Of the bodies that are hit, one in twenty is nearer than the near place, and one in twenty farther than the far one.
_NEAR, _FAR = 0.05, 0.95
# A lever that changes by less than this share of its length is that of the same pose. Where in a control cycle contact
# begins changes a force by the other share.
_LEVER, _RISE = 0.01, 0.03
_SWAPPED = ", and NOT ACCEPTABLE there"


def pose_of_contact(
    result: CollisionOutcome, verdict: Verdict, evaluate: Callable[[Scenario], JudgedForce]
) -> list[str]:
    """Compare the distribution with that of bodies at one place, near or far; where that hits harder, say how much.

    The lever a = J' n and the masses are those of one pose of the line. It is known how they change along it.
    """
    problem = result.problem
    if not problem.elastic or problem.trajectory is not None or problem.offset_kind != "half_normal":
        return []
    scale, normal = problem.offset_size, NormalDist()
    hit = 2 * normal.cdf(float(result.curve.distance.max()) / scale) - 1
    if not hit > 0.5:  # the median offset is beyond the line, and most cases touch nothing
        return []
    middle = scale * normal.inv_cdf(0.75)
    own = _lever(result, middle)
    p = 1 - result.scenario.verdict.accepted_probability
    said = result.peak_force.quantile(p)
    if not math.isfinite(said):
        p = 0.5
        said = result.peak_force.quantile(p)
    notes = []
    for share, which in ((_NEAR, "nearer"), (_FAR, "farther")):
        place = scale * normal.inv_cdf((1 + share * hit) / 2)
        if not np.linalg.norm(_lever(result, place) - own) > _LEVER * np.linalg.norm(own):
            continue
        try:
            there = evaluate(
                result.scenario.with_values({"contact.offset_law": "fixed", "contact.offset_mm": 1e3 * place})
            )
        except InputError:  # an end of the line that no body there reaches
            continue
        force = there.peak_force.quantile(p)
        # Without a bound it is because the line ends, not because of the pose.
        if not (1 + _RISE) * said < force < math.inf:
            continue
        swapped = _SWAPPED if verdict.acceptable is True and there.verdict.acceptable is False else ""
        notes.append(
            f"The elastic arm is that of one pose, {1e3 * middle:.3g} mm along the line. Where contact begins after "
            f"{1e3 * place:.4g} mm the peak force (p{100 * p:.6g}) is {force:.4g} N, not {said:.4g} N{swapped}; one "
            f'body in twenty is {which}. Judge such places with contact.offset_law = "fixed" and contact.offset_mm.'
        )
    return notes


def fails_elsewhere(warnings: Iterable[str]) -> bool:
    """Whether one of a result's warnings says that contact elsewhere on the line is NOT ACCEPTABLE."""
    return any(_SWAPPED in warning for warning in warnings)


def _lever(result: CollisionOutcome, distance: float) -> FloatArray:
    """Torque per newton (dof,) at the first tick at which the contact point is so far."""
    curve = result.curve
    tick = min(int(np.searchsorted(np.maximum.accumulate(curve.tick_distance), distance)), curve.ticks - 1)
    lever: FloatArray = curve.torque_per_newton[tick]
    return lever
