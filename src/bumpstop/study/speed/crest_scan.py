"""Slower speeds that fail where faster ones are safe: crests of the risk over the speed."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.requirement.sampling_ripple import (
    SOME_RISK,
    RippleScan,
    force_may_fall,
    has_ripple,
    nearly_fails,
    slower_speeds,
)
from bumpstop.study.speed.speed_risk import speed_risks
from bumpstop.study.speed.speed_search import CLOSE, MIN_SPEED

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem

# Between speeds of a first scan where the force may fall, in the logarithm.
_COARSE = 0.15
_BETWEEN = 8  # parts of a step beside a peak of the risk


class _Scan(NamedTuple):
    """What was found at some speeds of one row.

    Attributes:
        speed: descending (N,) [m/s].
        over: probability of passing a limit (N,).
        force: that is passed as often as is accepted (N,) [N].
    """

    speed: FloatArray
    over: FloatArray
    force: FloatArray

    def failing(self, accepted: float) -> FloatArray:
        """Speeds with more risk than is accepted; what is not a number fails."""
        return np.asarray(self.speed[~(self.over <= accepted)])

    def joined(self, other: _Scan) -> _Scan:
        """Both, in order."""
        order = np.argsort(-np.concatenate([self.speed, other.speed]))
        return _Scan(*(np.concatenate(pair)[order] for pair in zip(self, other, strict=True)))


class CrestScan:
    """Looks below speeds that are safe for slower ones that are not.

    Args:
        problem: a straight line of the tip; its pose and velocity are replaced.
        q: poses (N, dof) [rad or m].
        direction: unit vectors, base frame (N, 3).
        gain: stopping time of a speed (N,) [s/(m/s)].
        threads: for the integrated distributions.
    """

    def __init__(
        self, problem: CollisionProblem, q: FloatArray, direction: FloatArray, gain: FloatArray, threads: int
    ) -> None:
        self._problem, self._q, self._direction, self._gain, self._threads = problem, q, direction, gain, threads
        self._limit, self._accepted = allowed_force(problem), problem.scenario.verdict.accepted_probability
        self._falls = force_may_fall(problem.scenario)
        self.evaluations = 0

    def highest_safe(self, met: FloatArray, risk: FloatArray) -> FloatArray:
        """Highest speeds (N,) [m/s] below which no crest of the risk passes what is accepted; 0: none.

        Args:
            met: speeds to begin at, safe themselves (N,) [m/s].
            risk: of these (N,); it is brought to the speeds found.
        """
        top, safe = met.copy(), np.zeros_like(met)
        rows = np.flatnonzero(met > 0).tolist()
        while rows:
            scans = self._found({row: self._first_speeds(row, float(top[row])) for row in rows})
            if self._falls:
                between = self._found({row: self._where_it_may_pass(scan) for row, scan in scans.items()})
                scans |= {row: scans[row].joined(more) for row, more in between.items()}
            # A crest may fail at its point alone.
            safe_scans = {row: scan for row, scan in scans.items() if not scan.failing(self._accepted).size}
            peaks = self._found({row: self._about_peaks(scan) for row, scan in safe_scans.items()})
            rows = []
            for row, scan in scans.items():
                failing = peaks.get(row, scan).failing(self._accepted)
                if not failing.size:
                    safe[row], risk[row] = scan.speed[0], scan.over[0]
                    continue
                lower = scan.speed[scan.speed < failing.min()]
                top[row] = lower[0] if lower.size else failing.min() * (1 - CLOSE)
                if top[row] >= MIN_SPEED:
                    rows.append(row)
        return safe

    def _found(self, speeds: dict[int, FloatArray]) -> dict[int, _Scan]:
        """What is found at speeds by row; nothing of rows without any."""
        speeds = {row: some for row, some in speeds.items() if some.size}
        if not speeds:
            return {}
        rows = np.repeat(list(speeds), [some.size for some in speeds.values()])
        speed = np.concatenate(list(speeds.values()))
        self.evaluations += rows.size
        found = speed_risks(self._problem, self._q[rows], self._direction[rows] * speed[:, None], threads=self._threads)
        ends = np.cumsum([some.size for some in speeds.values()])[:-1]
        parts = zip(*(np.split(each, ends) for each in (speed, found.over, found.force)), strict=True)
        return {row: _Scan(*part) for row, part in zip(speeds, parts, strict=True)}

    def _first_speeds(self, row: int, top: float) -> FloatArray:
        """Speeds to look at first, descending from the top [m/s]."""
        speeds = np.array([top])
        if has_ripple(self._problem.scenario):
            ripple = RippleScan.of(self._problem, self._limit, speed=top, start_acceleration=float(1 / self._gain[row]))
            count = math.ceil(-math.log(1 - ripple.share) / min(ripple.apart, 0.9 * CLOSE))
            speeds = top * (1 - ripple.share) ** (np.arange(count + 1) / count)
        if self._falls:
            speeds = np.union1d(speeds, np.maximum(slower_speeds(top, apart=_COARSE), MIN_SPEED))[::-1]
        return np.asarray(speeds)

    def _where_it_may_pass(self, scan: _Scan) -> FloatArray:
        """Speeds between those of a coarse scan, descending, where the force may pass the limit between them.

        As long as it does not fall it grows with the speed.
        """
        speed, force = scan.speed, scan.force
        ratio = speed[:-1] / speed[1:]
        near = np.flatnonzero(nearly_fails(ratio * np.maximum(force[:-1], force[1:]), self._limit))
        pieces = [slower_speeds(float(speed[i]), float(speed[i + 1]))[1:-1] for i in near]
        return np.concatenate([np.empty(0), *pieces])

    def _about_peaks(self, scan: _Scan) -> FloatArray:
        """Speeds between those of a scan on both sides of its peaks, descending."""
        peak = _peaks(scan.over)
        if self._falls:
            peak = peak & (scan.over > SOME_RISK * self._accepted) | _peaks(scan.force) & nearly_fails(
                scan.force, self._limit
            )
        if scan.speed.size < 2:
            return np.empty(0)
        at = np.flatnonzero(peak)
        pieces = np.unique(np.concatenate([np.maximum(at - 1, 0), np.minimum(at, scan.speed.size - 2)]))
        share = np.arange(1, _BETWEEN) / _BETWEEN
        return np.asarray((scan.speed[pieces, None] ** (1 - share) * scan.speed[pieces + 1, None] ** share).ravel())


def _peaks(height: FloatArray) -> npt.NDArray[np.bool_]:
    """Which are the greatest of their neighbourhood (N,)."""
    beside = np.pad(height, 1, constant_values=-1.0)
    return np.asarray((height >= beside[:-2]) & (height >= beside[2:]))
