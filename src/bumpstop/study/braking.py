"""How far an arm still goes once it brakes: along a straight line in joint space, or followed in a few steps."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.study.short_path import Arms, ShortPath

# Steps until standstill by which a reversing arm is followed; half as many tell how good they are.
_STEPS = 8
# Places on the straight line of an arm that stops.
_PLACES = 17


@dataclass(frozen=True, eq=False)
class Stopping:
    """Travel along the normal from a tick to the farthest point of the reaction to it.

    Attributes:
        travel: expected (N,) [m].
        most: never less than it, but for what two numbers of steps have in common (N,) [m].
        bent: how much the rates of a straight motion change while the arm brakes, in shares of themselves (N,).
    """

    travel: FloatArray
    most: FloatArray
    bent: FloatArray


def stopping(path: ShortPath, time: FloatArray, latency: float) -> Stopping:
    """Foretell the reactions to ticks.

    Args:
        path: the motions.
        time: of the ticks (N,) [s].
        latency: of the reaction [s].
    """
    arms = path.arms
    q, qd = path.position_at(time + latency), path.rates_at(time + latency)
    before = ((arms.point(q) - arms.point(path.position_at(time))) * path.normal).sum(axis=1)
    stop = (np.abs(qd) / arms.problem.joint_acceleration).max(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        last = arms.rates(q + qd * stop[:, None] / 2)
        bent = np.linalg.norm(last - qd, axis=1) / np.linalg.norm(qd, axis=1)
    follow = _reversing if arms.problem.scenario.reaction.kind == "reverse" else _stopping
    travel, most = follow(arms, path.normal, q, qd)
    return Stopping(before + travel, before + most, np.where(np.isfinite(bent), bent, np.inf))


def _stopping(arms: Arms, normal: FloatArray, q: FloatArray, qd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Expected and greatest overrun of arms that stop: rates fall in one proportion, so q + qd x is all they reach."""
    begin, h = arms.point(q), _substep(arms)
    time = (np.abs(qd) / arms.problem.joint_acceleration).max(axis=1)
    # Rates fall by equal parts in every sub-step and positions follow the new rates, so the controller ends short of
    # time / 2, where an arm that brakes evenly ends.
    parts = time / h
    whole = np.floor(parts)
    with np.errstate(divide="ignore", invalid="ignore"):
        reach = np.where(whole > 0, h * (whole - whole * (whole + 1) / (2 * parts)), 0.0)

    def way(x: FloatArray) -> FloatArray:
        return np.asarray(((arms.point(q + qd * x[:, None]) - begin) * normal).sum(axis=1))

    along = np.stack([way(share * time / 2) for share in np.linspace(0, 1, _PLACES)])
    # Between two places a curve rises above both by at most an eighth of its second difference.
    above = np.abs(np.diff(along, n=2, axis=0)).max(axis=0) / 8
    inside = np.where((np.linspace(0, time / 2, _PLACES) <= reach), along, 0.0).max(axis=0)
    return np.maximum(way(reach), inside), np.maximum(0.0, along.max(axis=0) + above)


def _reversing(arms: Arms, normal: FloatArray, q: FloatArray, qd: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Expected and greatest overrun of arms that reverse: the reversed rates are resolved anew all the time."""
    rough, fine = (_followed(arms, normal, q, qd, steps) for steps in (_STEPS // 2, _STEPS))
    first = np.einsum("nij,nj,ni->n", arms.linear_jacobian(q), qd, normal)
    # The positions follow the new rates of a sub-step, not their mean over it.
    return np.maximum(0.0, fine - first * _substep(arms) / 2), np.maximum(rough, fine) + np.abs(fine - rough)


def _followed(arms: Arms, normal: FloatArray, q: FloatArray, qd: FloatArray, steps: int) -> FloatArray:
    """Overrun of arms that reverse without sub-steps (N,) [m], by so many steps of the midpoint rule to standstill."""
    begin, limit = arms.point(q), arms.problem.joint_acceleration
    step = ((np.abs(qd) / limit).max(axis=1) / steps)[:, None]

    def change(at: FloatArray, rate: FloatArray) -> FloatArray:
        wanted = -arms.rates(at) - rate
        wanted = np.where(np.isfinite(wanted), wanted, 0.0)
        return np.asarray(wanted / np.maximum((np.abs(wanted) / limit).max(axis=1)[:, None], step))

    def speed_of(at: FloatArray, rate: FloatArray) -> FloatArray:
        return np.asarray(np.einsum("nij,nj,ni->n", arms.linear_jacobian(at), rate, normal))

    speed = speed_of(q, qd)
    farthest, reached = np.zeros(len(q)), np.zeros(len(q))
    for _ in range(2 * steps):
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
    return farthest


def _substep(arms: Arms) -> float:
    simulation = arms.problem.scenario.simulation
    return simulation.step_s / simulation.substeps
