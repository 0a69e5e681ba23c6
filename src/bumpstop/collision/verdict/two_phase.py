"""Clamped contact judged in two phases: a transient limit at first, the quasi-static one for what lasts."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.collision.arm.pressing_limit import undetected_force
from bumpstop.collision.distribution.contact_distribution import ContactDistribution
from bumpstop.collision.distribution.contact_duration import ReleaseTimes, exact_cells
from bumpstop.collision.distribution.distribution import Distribution, SampledDistribution
from bumpstop.collision.distribution.mixture import MixtureDistribution
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision.result import CollisionResult
    from bumpstop.contact import ContactLimits

# How long the transient limit holds after contact: ISO/TS 15066, 5.5.5.3, through the facts of the limit table [s].
FIRST_PHASE_S = _native.transient_phase_s
# Into how many parts a cell is cut that holds the limit: far out, its probability falls by a multiple across it.
_PARTS_AT_LIMIT = 32


@dataclass(frozen=True, eq=False)
class TwoPhaseUse:
    """How far a collision uses its limits: the greater of both phases' share, 1 being the limit itself.

    Attributes:
        force, pressure: distributions of the share, of detected collisions; pressure None without a pressure limit.
        weight: probability of those collisions; all others are counted by who asks.
    """

    force: Distribution
    pressure: Distribution | None
    weight: float

    @classmethod
    def of(cls, result: CollisionResult, transient: ContactLimits, lasting: ContactLimits) -> TwoPhaseUse:
        """Compute the shares of a distribution of clamped contact.

        Args:
            result: exact or sampled.
            transient: limits of the first half second of contact.
            lasting: quasi-static limits, for what comes after.
        """
        contact = result.scenario.contact
        per_newton = contact.peak_factor / contact.area_cm2
        force = result.phase_shares(1 / transient.force_N, 1 / lasting.force_N)
        pressure = None
        if transient.pressure_N_cm2 is not None and lasting.pressure_N_cm2 is not None:
            pressure = result.phase_shares(per_newton / transient.pressure_N_cm2, per_newton / lasting.pressure_N_cm2)
        return cls(force[0], None if pressure is None else pressure[0], force[1])

    def over(self, share: Distribution, undetected: float) -> float:
        """P(some limit is passed), undetected collisions counting as over."""
        return min(1.0, (self.weight * share.exceedance(1.0) if self.weight > 0 else 0.0) + undetected)


def phase_shares(result: CollisionResult, first: float, later: float) -> tuple[Distribution, float]:
    """Of a distribution on a line; see :meth:`bumpstop.CollisionResult.phase_shares`."""
    if result.problem.gives_way:
        return _shares_that_give_way(result, first, later), 1.0
    stiffness = result.problem.stiffness

    def share(spans: ReleaseTimes, tick: int, offset: FloatArray) -> FloatArray:
        early, late = spans.phases(tick, offset.ravel(), FIRST_PHASE_S)
        return (stiffness * np.maximum(early * first, late * later)).reshape(offset.shape)

    line = result.curve.line
    if result.kind == "sampled":
        assert result.runs is not None
        tick, offset = result.runs["tick"], result.runs["offset"]
        if result.curve.end in ("joint_limit", "singularity"):
            # Bodies that the arm reaches only while it brakes at the end of its line.
            braking = (tick < 0) & (offset >= result.curve.distance.max()) & (result.runs["peak_force"] > 0)
            tick = np.where(braking, line.ticks, tick)
        detected = tick >= 0
        values = np.zeros(int(detected.sum()))
        ticks = np.unique(tick[detected])
        if ticks.size:
            own = {int(k): np.flatnonzero(tick[detected] == k) for k in ticks}
            offsets = offset[detected]
            least = np.array([offsets[own[int(k)]].min() for k in ticks])
            spans = ReleaseTimes(result.problem, line, ticks, least)
            for k, runs in own.items():
                values[runs] = share(spans, k, offsets[runs])
        return SampledDistribution(values), float(detected.mean())
    parts: list[tuple[FloatArray, ...]] = [(np.zeros(0),) * 5]
    for cells in exact_cells(result.problem, line, result.integral):
        value = share(cells.spans, cells.tick, cells.node)
        low, high = _between(share(cells.spans, cells.tick, cells.edge))
        at_limit = (low < 1) & (high > 1)
        parts.append((low[~at_limit], high[~at_limit], cells.mass[~at_limit], value.ravel(), cells.node_mass.ravel()))
        if at_limit.any():
            edge, mass = cells.finer(at_limit, _PARTS_AT_LIMIT)
            low, high = _between(share(cells.spans, cells.tick, edge))
            nothing = np.zeros(0)
            parts.append((low.ravel(), high.ravel(), mass.ravel(), nothing, nothing))
    joined = MixtureDistribution.of_cells(*(np.concatenate(arrays) for arrays in zip(*parts, strict=True)))
    return joined, joined.total


def _shares_that_give_way(result: CollisionResult, first: float, later: float) -> Distribution:
    """Of all collisions. Of those never detected the force lasts, without a bound where it has none.

    The peak of all times stands for that of the first phase: where what lasts is greater, its limit, which is not the
    higher one, decides.
    """
    if later < first:
        raise InputError(
            "verdict.clamped_limit",
            "'two_phase' needs a limit for what lasts that is not above the transient one, where arm or body give way",
            "valid: 'quasi_static'",
        )
    if result.runs is not None:
        return SampledDistribution(np.maximum(result.runs["peak_force"] * first, result.runs["lasting_force"] * later))
    quantity = _native.ContactQuantity.peak_force
    never = undetected_force(result.problem, result.curve)
    shares = _native.PhaseShares(first, later)
    return ContactDistribution(
        _native.contact_mixture(result.integral, quantity, None if never is None else never * later, shares)
    )


def _between(ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and greatest value in the cells between neighbouring ends (pieces, cells)."""
    return np.minimum(ends[:, 1:], ends[:, :-1]), np.maximum(ends[:, 1:], ends[:, :-1])
