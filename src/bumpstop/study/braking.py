"""How far an arm still goes once it brakes, by formula where its joints hardly turn and in a few steps elsewhere."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.study.short_path import Arms, ShortPath

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray

# Deviation of a reversing arm from a straight line in joint space, over that of one that stops: the reversed rates are
# resolved anew all the time and pull it back. 13/6 - 2 ln 2; docs/study.md derives it.
BENT_BY_REVERSING = 13 / 6 - 2 * np.log(2)
# Rates that change by less than this share while the arm brakes bend its path like a parabola.
LITTLE = 0.02
_STEPS = 8


def stopping_travel(path: ShortPath, time: FloatArray, latency: float) -> tuple[FloatArray, FloatArray]:
    """Travel along the normal from ticks at ``time`` to the farthest point of the reactions to them.

    Args:
        path: the motions.
        time: of the ticks (N,) [s].
        latency: of the reaction [s].

    Returns:
        The travel (N,) [m], and by how much the rates of a straight motion change while the arm brakes, in shares of
        themselves (N,).
    """
    arms = path.arms
    q, qd = path.position_at(time + latency), path.rates_at(time + latency)
    before = ((arms.point(q) - arms.point(path.position_at(time))) * path.normal).sum(axis=1)
    stop = (np.abs(qd) / arms.problem.joint_acceleration).max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        last = arms.rates(q + qd * stop[:, None] / 2)
        bent = np.linalg.norm(last - qd, axis=1) / np.linalg.norm(qd, axis=1)
    bent = np.where(np.isfinite(bent), bent, np.inf)
    travel = _straight(arms, path.normal, q, qd)
    far = np.flatnonzero((bent > LITTLE) & np.isfinite(bent))
    if far.size:
        some = Arms(arms.problem, arms.q[far], arms.velocity[far])
        travel[far] = _stepwise(some, path.normal[far], q[far], qd[far])
    return np.asarray(before + travel), bent


def _straight(arms: Arms, normal: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
    """Overrun of arms that brake on a straight line in joint space (N,) [m]."""
    problem, begin = arms.problem, arms.point(q)
    speed = np.einsum("nij,nj,ni->n", arms.linear_jacobian(q), qd, normal)
    # Rates fall by equal parts in every sub-step, and positions follow the new rates.
    parts = (np.abs(qd) / problem.joint_acceleration).max(axis=1) / _substep(arms)
    whole = np.floor(parts)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(whole > 0, _substep(arms) * (whole - whole * (whole + 1) / (2 * parts)), 0.0)
    bent = []
    for x in (reach / 2, reach):
        moved = ((arms.point(q + qd * x[:, None]) - begin) * normal).sum(axis=1)
        bent.append(moved - speed * x)
    share = BENT_BY_REVERSING if problem.scenario.reaction.kind == "reverse" else 1.0
    c3 = 2 * bent[1] - 8 * bent[0]
    c2 = bent[1] - c3
    along = np.linspace(0, 1, 17)[:, None]
    travel = speed * reach * along + share * (c2 * along**2 + c3 * along**3)
    return np.asarray(np.maximum(0.0, travel.max(axis=0)))


def _stepwise(arms: Arms, normal: FloatArray, q: FloatArray, qd: FloatArray) -> FloatArray:
    """Overrun of arms whose braking is followed in steps of the midpoint rule (N,) [m]."""
    problem, begin = arms.problem, arms.point(q)
    limit, reverse = problem.joint_acceleration, problem.scenario.reaction.kind == "reverse"
    step = ((np.abs(qd) / limit).max(axis=1) / _STEPS)[:, None]

    def change(at: FloatArray, rate: FloatArray) -> FloatArray:
        wanted = -arms.rates(at) - rate if reverse else -rate
        wanted = np.where(np.isfinite(wanted), wanted, 0.0)
        return np.asarray(wanted / np.maximum((np.abs(wanted) / limit).max(axis=1)[:, None], step))

    def speed_of(at: FloatArray, rate: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("nij,nj,ni->n", arms.linear_jacobian(at), rate, normal))

    first = speed = speed_of(q, qd)
    farthest, reached = np.zeros(len(q)), np.zeros(len(q))
    for _ in range(2 * _STEPS):
        half = qd + step / 2 * change(q, qd)
        rate = change(q + step / 2 * qd, half)
        q, qd = q + step * half, qd + step * rate
        here = ((arms.point(q) - begin) * normal).sum(axis=1)
        later = speed_of(q, qd)
        # Where it turns back within a step the top lies above both ends.
        with np.errstate(divide="ignore", invalid="ignore"):
            top = np.where((speed > 0) & (later < 0), reached + step[:, 0] * speed**2 / (speed - later) / 2, here)
        farthest = np.maximum(farthest, np.maximum(here, top))
        reached, speed = here, later
        if (speed <= 0).all():
            break
    # The positions follow the new rates of a sub-step, not their mean over it.
    return np.asarray(np.maximum(0.0, farthest - first * _substep(arms) / 2))


def _substep(arms: Arms) -> float:
    simulation = arms.problem.scenario.simulation
    return simulation.step_s / simulation.substeps
