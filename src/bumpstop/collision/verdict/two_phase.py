"""Clamped contact judged in two phases: a transient limit at first, the quasi-static one for what lasts."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.collision.arm.pressing_limit import undetected_force
from bumpstop.collision.distribution.contact_distribution import ContactDistribution
from bumpstop.collision.distribution.contact_duration import ReleaseTimes, exact_cells
from bumpstop.collision.distribution.distribution import Distribution, SampledDistribution
from bumpstop.collision.distribution.mixture import MixtureDistribution
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision.curve import StoppingCurve
    from bumpstop.collision.problem import CollisionProblem

# How long the transient limit holds after contact: ISO/TS 15066, 5.5.5.3, through the facts of the limit table [s].
FIRST_PHASE_S = _native.transient_phase_s
# Into how many parts a cell is cut that holds the limit: far out, its probability falls by a multiple across it.
_PARTS_AT_LIMIT = 32


def phase_shares(
    problem: CollisionProblem,
    curve: StoppingCurve,
    collisions: dict[str, npt.NDArray[Any]] | _native.CollisionDistribution,
    per_newton: tuple[float, float],
) -> tuple[Distribution, float]:
    """Of a distribution on a line; see :meth:`bumpstop.CollisionResult.phase_shares`.

    Args:
        problem: of the collision.
        curve: of the collision.
        collisions: runs of a sampled result by the name of their figures, or the compiled integrated distribution.
        per_newton: share of its limit that a newton takes, in the first phase and after it.
    """
    first, later = per_newton
    if problem.gives_way:
        return _shares_that_give_way(problem, curve, collisions, per_newton), 1.0
    stiffness = problem.stiffness

    def share(spans: ReleaseTimes, tick: int, offset: FloatArray) -> FloatArray:
        early, late = spans.phases(tick, offset.ravel(), FIRST_PHASE_S)
        return (stiffness * np.maximum(early * first, late * later)).reshape(offset.shape)

    line = curve.line
    if isinstance(collisions, dict):
        tick, offset = collisions["tick"], collisions["offset"]
        if curve.end in ("joint_limit", "singularity"):
            # Bodies that the arm reaches only while it brakes at the end of its line.
            braking = (tick < 0) & (offset >= curve.distance.max()) & (collisions["peak_force"] > 0)
            tick = np.where(braking, line.ticks, tick)
        detected = tick >= 0
        values = np.zeros(int(detected.sum()))
        ticks = np.unique(tick[detected])
        if ticks.size:
            own = {int(k): np.flatnonzero(tick[detected] == k) for k in ticks}
            offsets = offset[detected]
            least = np.array([offsets[own[int(k)]].min() for k in ticks])
            spans = ReleaseTimes(problem, line, ticks, least)
            for k, runs in own.items():
                values[runs] = share(spans, k, offsets[runs])
        return SampledDistribution(values), float(detected.mean())
    parts: list[tuple[FloatArray, ...]] = [(np.zeros(0),) * 5]
    for cells in exact_cells(problem, line, collisions):
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


def _shares_that_give_way(
    problem: CollisionProblem,
    curve: StoppingCurve,
    collisions: dict[str, npt.NDArray[Any]] | _native.CollisionDistribution,
    per_newton: tuple[float, float],
) -> Distribution:
    """Of all collisions. Of those never detected the force lasts, without a bound where it has none."""
    if isinstance(collisions, dict):
        return SampledDistribution(greater_share(collisions["peak_force"], collisions["lasting_force"], per_newton))
    first, later = per_newton
    _need_higher_transient_limit(per_newton)
    quantity = _native.ContactQuantity.peak_force

    def never() -> float | None:
        force = undetected_force(problem, curve)
        return None if force is None else force * later

    return ContactDistribution.of(collisions, quantity, never, _native.PhaseShares(first, later))


def greater_share(peak: FloatArray, lasting: FloatArray, per_newton: tuple[float, float]) -> FloatArray:
    """The greater share of two limits that collisions (N,) use in which arm or body give way.

    The peak of all times stands for that of the first phase: where what lasts is greater, its limit, which is not the
    higher one, decides.

    Args:
        peak: greatest force of each [N].
        lasting: greatest force after the first phase [N].
        per_newton: as of :func:`phase_shares`.

    Raises:
        InputError: the limit for what lasts is above the transient one.
    """
    _need_higher_transient_limit(per_newton)
    return np.maximum(peak * per_newton[0], lasting * per_newton[1])


def _need_higher_transient_limit(per_newton: tuple[float, float]) -> None:
    if per_newton[1] < per_newton[0]:
        raise InputError(
            "verdict.clamped_limit",
            "'two_phase' needs a limit for what lasts that is not above the transient one, where arm or body give way",
            "valid: 'quasi_static'",
        )


def _between(ends: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Least and greatest value in the cells between neighbouring ends (pieces, cells)."""
    return np.minimum(ends[:, 1:], ends[:, :-1]), np.maximum(ends[:, 1:], ends[:, :-1])
