"""Probabilities of high forces that few drawn collisions reach, by importance sampling of the noise."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_number, as_whole_number
from bumpstop.collision import CollisionProblem, stopping_curve
from bumpstop.collision.curve import AT_REST
from bumpstop.collision.distribution.noise import contact_residual
from bumpstop.collision.scenario.scenario import as_scenario
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision import Scenario, StoppingCurve
    from bumpstop.detection import ResidualRecord

# What remains of a run that has almost certainly been detected adds nothing more.
_NEGLIGIBLE_WEIGHT = 1e-30
# Runs at once, and sweeps of the search for their most probable noise.
_CHUNK, _SWEEPS = 1000, 12
_FORGOTTEN = 1e-3  # share of the noise
# Runs with measured noise, each of which looks at all blocks of the record.
_MAX_MEASURED_RUNS = 400
# Rows of a record at once.
_MAX_STARTS = 200_000


@dataclass(frozen=True)
class RareProbability:
    """An estimate without bias.

    Attributes:
        probability: P(peak force > force).
        standard_error: of the estimate.
        runs: that were drawn.
    """

    probability: float
    standard_error: float
    runs: int

    @property
    def relative_error(self) -> float:
        """Standard error over probability; NaN where it is 0."""
        return self.standard_error / self.probability if self.probability > 0 else math.nan


def rare_exceedance(scenario: Scenario, force: float, *, runs: int = 10_000, seed: int = 0) -> RareProbability:
    """Estimate the probability that the peak force exceeds a force, however small it is.

    The peak exceeds it where the detector stays silent up to some tick. So the noise of every tick is drawn from what
    leaves the detector silent, and the run is weighted by the probability of that (the simulator of Geweke,
    Hajivassiliou and Keane for normal probabilities). Gaps are stratified. Of measured residuals a run looks at every
    block of the record that it could have drawn.

    Args:
        scenario: a rigid arm on a line against a clamped spring, as given: its ``[uncertainty]`` does not count.
        force: peak force [N].
        runs: 100 to 1 000 000; of measured residuals at most 400 are drawn.
        seed: 0 to 2^64 - 1.

    Raises:
        InputError: the scenario is of another kind, which its key names, or an argument is out of its range.
    """
    problem = CollisionProblem.from_scenario(as_scenario(scenario))
    _check_kind(problem)
    level = as_number(force, "force")
    if level < 0:
        raise InputError("force", f"is {level:g}", "wanted a force of 0 N or more")
    count = as_whole_number(runs, "runs", 100, 1_000_000)
    rng = np.random.default_rng(as_whole_number(seed, "seed", 0, 2**64 - 1, "0 to 2^64 - 1"))
    curve = stopping_curve(problem)
    if problem.residuals is not None:
        count = min(count, _MAX_MEASURED_RUNS)
    share = (np.arange(count) + rng.random(count)) / count
    offset = _offset(problem, share)
    if problem.residuals is not None:
        found = _with_measured_noise(problem, curve, problem.residuals, offset, level, rng)
    else:
        found = _with_gaussian_noise(problem, curve, offset, level, rng)
    # Of strata the differences of neighbours show what is left of the variance.
    error = math.sqrt(float((np.diff(found) ** 2).sum()) / (2 * (count - 1)) / count)
    return RareProbability(float(found.mean()), error, count)


def _check_kind(problem: CollisionProblem) -> None:
    contact, known = problem.scenario.contact, "a rigid arm on a line against a clamped spring"
    for key, value, other in (
        ("motion.kind", "trajectory", problem.trajectory is not None),
        ("arm.model", problem.scenario.arm.model, problem.elastic),
        ("contact.kind", contact.kind, problem.gets_away),
        ("contact.gauge_mass_kg", contact.gauge_mass_kg, contact.gauge_mass_kg is not None),
        ("contact.damping_Ns_m", contact.damping_Ns_m, contact.damping_Ns_m > 0),
    ):
        if other:
            text = f"{value!r} is not available: rare collisions are drawn for {known}"
            raise InputError(key, text, "draw it: evaluate with samples")


def _offset(problem: CollisionProblem, share: FloatArray) -> FloatArray:
    """Distance of the body at cumulative probabilities [m]."""
    from scipy.special import ndtri

    size = problem.offset_size
    if problem.offset_kind == "half_normal":
        return np.asarray(size * ndtri(0.5 + 0.5 * share))
    return size * share if problem.offset_kind == "uniform" else np.full(share.shape, size)


def _contact(problem: CollisionProblem, curve: StoppingCurve, offset: FloatArray) -> FloatArray:
    """Contact force at every tick (ticks, runs) [N]."""
    return np.asarray(problem.stiffness * np.maximum(0.0, curve.tick_distance[:, None] - offset))


def _over(problem: CollisionProblem, curve: StoppingCurve, offset: FloatArray, level: float) -> npt.NDArray[np.bool_]:
    """Whether a detection at a tick leaves a peak force above the level (ticks, runs)."""
    peak = problem.stiffness * np.maximum(0.0, curve.max_distance[:, None] - offset)
    return np.asarray(peak > level)


def _undetected_over(
    problem: CollisionProblem, curve: StoppingCurve, offset: FloatArray, level: float
) -> npt.NDArray[np.bool_]:
    """Whether a collision that is never detected counts as above the level (runs,)."""
    # The path goes on for a latency beyond the end of the motion, for the reactions; the motion does not.
    steps = round(problem.scenario.motion.duration_s / problem.scenario.simulation.step_s)
    farthest = float(curve.distance[: steps + 1].max())
    if curve.end not in AT_REST:
        return np.asarray(offset < farthest)
    farthest = max(farthest, float(np.max(curve.line.braking, initial=-math.inf)))
    return np.asarray(problem.stiffness * np.maximum(0.0, farthest - offset) > level)


def _with_gaussian_noise(
    problem: CollisionProblem, curve: StoppingCurve, offset: FloatArray, level: float, rng: np.random.Generator
) -> FloatArray:
    """Weight of each run: its probability of a peak above the level, given what was drawn (runs,)."""
    parts = [
        _GaussianRuns(problem, curve, offset[first : first + _CHUNK], level).weights(rng)
        for first in range(0, offset.size, _CHUNK)
    ]
    return np.concatenate(parts)


class _GaussianRuns:
    """Runs with noise that is white or first-order, of the joints that are monitored."""

    def __init__(self, problem: CollisionProblem, curve: StoppingCurve, offset: FloatArray, level: float) -> None:
        joints = np.isfinite(problem.thresholds)
        threshold, mean = problem.thresholds[joints], problem.noise_mean[joints]
        self._sd = np.maximum(problem.noise_sd[joints], 1e-300)
        self._rho = problem.scenario.detector.noise_correlation
        self._over = _over(problem, curve, offset, level)
        self._undetected = _undetected_over(problem, curve, offset, level)
        self._first_armed = min(problem.first_armed_tick, curve.ticks)
        force, torque = _contact(problem, curve, offset), curve.torque_per_newton[:, joints]
        residual = contact_residual(problem, force[:, :, None] * torque[:, None, :])
        # Noise between which no joint alarms (ticks, runs, joints).
        self._low, self._high = -threshold - mean - residual, threshold - mean - residual
        self._low[: self._first_armed], self._high[: self._first_armed] = -np.inf, np.inf

    def weights(self, rng: np.random.Generator) -> FloatArray:
        """Of each run (runs,)."""
        ticks, runs, joints = self._low.shape
        rho, alive, found = self._rho, np.ones(runs), np.zeros(runs)
        noise, before = np.zeros((runs, joints)), np.zeros((runs, joints))
        shift = self._least_noise() if rho else np.zeros((0, runs, joints))
        for k in range(ticks):
            own = self._sd * math.sqrt(1 - rho * rho) if k else self._sd
            low, high = self._low[k], self._high[k]
            if k >= self._first_armed:
                silent, alarm = _between((low - rho * noise) / own, (high - rho * noise) / own)
                # 1 - prod(1 - alarm) without a difference of two numbers that are nearly one.
                detected = -np.expm1(np.log1p(-np.minimum(alarm, 1 - 1e-16)).sum(axis=1))
                found += np.where(self._over[k], alive * detected, 0.0)
            if not rho:
                alive = alive * np.prod(silent, axis=1) if k >= self._first_armed else alive
            else:
                moved = shift[k] - rho * before
                centre, before = rho * noise + moved, shift[k]
                drawn, mass = _truncated((low - centre) / own, (high - centre) / own, rng)
                # Density of the noise over that of its draw.
                ratio = np.exp(-(moved / own) * (drawn + moved / (2 * own))) * mass
                alive = alive * np.prod(ratio, axis=1)
                noise = centre + own * drawn
            if alive.max() < _NEGLIGIBLE_WEIGHT:
                return found
        return found + np.where(self._undetected, alive, 0.0)

    def _least_noise(self) -> FloatArray:
        """The most probable noise that keeps the detector silent until a detection is too late.

        The design point of reliability theory: the least sum of squared innovations within the bounds, by projected
        Gauss-Seidel sweeps. It need not be exact, as weights make up for it. Shape (ticks, runs, joints).
        """
        rho, ticks = self._rho, len(self._low)
        late = np.where(self._over.any(axis=0), self._over.argmax(axis=0), ticks)
        bound = (np.arange(ticks)[:, None] < late)[..., None]
        low, high = np.where(bound, self._low, -np.inf), np.where(bound, self._high, np.inf)
        noise: FloatArray = np.clip(np.zeros_like(low), low, high)
        bent = np.flatnonzero(noise.any(axis=(1, 2)))
        if not bent.size:
            return noise
        # Noise beyond the correlation time stays at zero.
        first = max(0, int(bent[0]) - math.ceil(math.log(_FORGOTTEN) / math.log(abs(rho))))
        last = int(bent[-1])
        for _ in range(_SWEEPS):
            for k in (*range(first, last + 1), *range(last - 1, first - 1, -1)):
                before = noise[k - 1] if k else 0.0
                wanted = rho * (before + noise[k + 1]) / (1 + rho * rho) if k < last else rho * before
                if k == 0:
                    wanted = rho * noise[1] if last else np.zeros_like(noise[0])
                noise[k] = np.clip(wanted, low[k], high[k])
        for k in range(last + 1, ticks):
            noise[k] = rho * noise[k - 1]
        return noise


def _truncated(low: FloatArray, high: FloatArray, rng: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Standard normal draws between bounds, and the probability between them."""
    from scipy.special import ndtr, ndtri

    # From the smaller tail, where the digits are.
    far = low + high > 0
    a, b = np.where(far, -high, low), np.where(far, -low, high)
    below, mass = ndtr(a), ndtr(b) - ndtr(a)
    drawn = np.clip(ndtri(np.clip(below + rng.random(a.shape) * mass, 1e-300, 1 - 1e-16)), a, b)
    return np.where(far, -drawn, drawn), np.asarray(mass)


def _between(low: FloatArray, high: FloatArray) -> tuple[FloatArray, FloatArray]:
    """P(low <= z <= high) of a standard normal z, and P of all else, both with their digits."""
    from scipy.special import ndtr

    far = low + high > 0
    a, b = np.where(far, -high, low), np.where(far, -low, high)
    return np.asarray(ndtr(b) - ndtr(a)), np.asarray(ndtr(a) + ndtr(-b))


def _with_measured_noise(
    problem: CollisionProblem,
    curve: StoppingCurve,
    record: ResidualRecord,
    offset: FloatArray,
    level: float,
    rng: np.random.Generator,
) -> FloatArray:
    """The same of residuals that are drawn in blocks: every block that a run could draw counts."""
    rows, block = np.asarray(record.rows), record.block_rows
    starts = np.arange(len(rows))
    if starts.size > _MAX_STARTS:
        starts = np.sort(rng.choice(starts, _MAX_STARTS, replace=False))
    monitored = np.isfinite(problem.thresholds)
    rows, threshold = rows[:, monitored], problem.thresholds[monitored]
    torque = curve.torque_per_newton[:, monitored]
    force, over = _contact(problem, curve, offset), _over(problem, curve, offset, level)
    undetected = _undetected_over(problem, curve, offset, level)
    silent_alone = np.asarray((np.abs(rows) <= threshold).all(axis=1))
    found = np.zeros(offset.size)
    for run in range(offset.size):
        place = int(rng.integers(block))
        alive, silent = 1.0, starts
        before = starts.size
        for k, residual in enumerate(contact_residual(problem, force[:, run, None] * torque)):
            at = place % block
            if at == 0:
                silent, before = starts, starts.size
            place += 1
            if k < problem.first_armed_tick:
                continue
            drawn = (silent + at) % len(rows)
            if residual.any():
                ok = np.asarray((np.abs(rows[drawn] + residual) <= threshold).all(axis=1))
            else:
                ok = silent_alone[drawn]
            silent = silent[ok]
            if over[k, run]:
                found[run] += alive * (before - silent.size) / before
            alive *= silent.size / before
            before = silent.size
            if alive == 0:
                break
        found[run] += alive * float(undetected[run])
    return found
