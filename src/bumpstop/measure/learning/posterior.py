"""What shots say of the parameters: a sample of the posterior by adaptive importance sampling."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from collections.abc import Callable

    import numpy.typing as npt

    from bumpstop.arrays import FloatArray
    from bumpstop.measure.learning.peak_force_ensemble import Surfaces

# Degrees of freedom of the errors of shots: one bad shot costs little (Lange, Little and Taylor 1989).
_ERROR_DOF = 4.0
# Of the proposals, whose tails must be heavier than the posterior's.
_PROPOSAL_DOF = 5.0
_DRAWS = 4000
_MIN_SHARE = 0.25  # of the draws that count effectively, before the likelihood is tempered less
_MAX_ROUNDS = 30
# Of the sample that is kept.
_KEPT = 2000


@dataclass(frozen=True)
class ErrorModel:
    """How far a measured peak force may be off what the model expects, as standard deviations of its logarithm.

    Attributes:
        gauge: of one shot, by gauge and cell; the shots themselves correct it.
        gauge_spread: of the logarithm of that figure before anything is measured.
        model: of the model, alike in all shots of one condition.
    """

    gauge: float = 0.03
    gauge_spread: float = 0.5
    model: float = 0.02


@dataclass(frozen=True, eq=False)
class Posterior:
    """Equally probable points of the parameters after the shots.

    Attributes:
        z: (draws, parameters).
        gauge_error: standard deviation of a shot's logarithm (draws,) [1].
        effective: number of draws that count effectively, before they were resampled.
        shot_weight: how far each shot counts: 1 where it agrees, near 0 where it is far off (shots,).
        shot_residual: logarithm of measured over expected peak force (shots,).
    """

    z: FloatArray
    gauge_error: FloatArray
    effective: float
    shot_weight: FloatArray
    shot_residual: FloatArray

    @property
    def mean(self) -> FloatArray:
        """Of the parameters (parameters,)."""
        return np.asarray(self.z.mean(axis=0))

    @property
    def covariance(self) -> FloatArray:
        """Of the parameters (parameters, parameters)."""
        return np.atleast_2d(np.cov(self.z, rowvar=False))

    @property
    def sd(self) -> FloatArray:
        """Of each parameter (parameters,); 1 before anything is measured."""
        return np.asarray(self.z.std(axis=0))


def sample_posterior(
    surfaces: Surfaces,
    condition: npt.NDArray[np.int64],
    log_force: FloatArray,
    errors: ErrorModel,
    *,
    parameters: int,
    seed: int = 0,
) -> Posterior:
    """Sample the parameters given the shots.

    Before the shots each parameter is a standard normal number. The logarithm of a measured force differs from the
    expected one by Student's t of four degrees of freedom, whose variance adds the scatter of shots, the gauge's error,
    the error of the polynomials and the model's. That of the model is alike in the n shots of one condition, so it
    counts n times in each. The likelihood is tempered until the proposals, t distributions of the weighted draws' mean
    and covariance, have found it.

    Args:
        surfaces: of the conditions.
        condition: of each shot (shots,).
        log_force: measured (shots,) [log N].
        errors: how far shots are off.
        parameters: how many.
        seed: of the draws.
    """
    random = np.random.default_rng(seed)
    shared = np.bincount(condition, minlength=surfaces.log_sd.size)[condition] if condition.size else np.zeros(0)
    variance = surfaces.log_sd[condition] ** 2 + shared * (errors.model**2 + surfaces.error[condition] ** 2)

    def residual(x: FloatArray) -> FloatArray:
        return np.asarray(log_force - surfaces(x[:, :-1])[:, condition])

    def scale2(x: FloatArray) -> FloatArray:
        gauge = errors.gauge * np.exp(errors.gauge_spread * x[:, -1])
        return np.asarray(variance + gauge[:, None] ** 2)

    def log_likelihood(x: FloatArray) -> FloatArray:
        at = scale2(x)
        terms = -0.5 * (_ERROR_DOF + 1) * np.log1p(residual(x) ** 2 / (_ERROR_DOF * at)) - 0.5 * np.log(at)
        return np.asarray(terms.sum(axis=1))

    x, weights = _adaptive_importance(log_likelihood, parameters + 1, random)
    effective = 1.0 / float((weights**2).sum())
    kept = x[_systematic(weights, _KEPT, random)]
    left, at = residual(kept), scale2(kept)
    return Posterior(
        z=kept[:, :-1],
        gauge_error=errors.gauge * np.exp(errors.gauge_spread * kept[:, -1]),
        effective=effective,
        shot_weight=((_ERROR_DOF + 1) / (_ERROR_DOF + left**2 / at)).mean(axis=0),
        shot_residual=left.mean(axis=0),
    )


def _adaptive_importance(
    log_likelihood: Callable[[FloatArray], FloatArray], size: int, random: np.random.Generator
) -> tuple[FloatArray, FloatArray]:
    """Draws and weights adding up to one (Cappe, Guillin, Marin and Robert 2004, with tempering)."""
    mean, covariance = np.zeros(size), np.eye(size)
    power = 0.0
    for _ in range(_MAX_ROUNDS):
        x, log_proposal = _student(mean, covariance, random)
        base = -0.5 * (x**2).sum(axis=1) - log_proposal
        likelihood = log_likelihood(x)
        finished = power >= 1.0
        power = _next_power(base, likelihood, power)
        weights = _normalised(base + power * likelihood)
        if finished and power >= 1.0 and 1.0 / (weights**2).sum() >= _MIN_SHARE * len(x):
            break
        mean = weights @ x
        away = x - mean
        covariance = (away * weights[:, None]).T @ away + 1e-9 * np.eye(size)
    return x, weights


def _next_power(base: FloatArray, likelihood: FloatArray, low: float) -> float:
    """Greatest power of the likelihood, up to 1, at which enough draws count; not below what was reached."""

    def enough(power: float) -> bool:
        weights = _normalised(base + power * likelihood)
        return 1.0 / float((weights**2).sum()) >= _MIN_SHARE * len(base)

    if enough(1.0):
        return 1.0
    high = 1.0
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if enough(middle) else (low, middle)
    return low


def _student(mean: FloatArray, covariance: FloatArray, random: np.random.Generator) -> tuple[FloatArray, FloatArray]:
    """Draws of a multivariate t about a mean, and the logarithms of their density but for a constant."""
    n = mean.size
    factor = np.linalg.cholesky(covariance)
    normal = random.standard_normal((_DRAWS, n))
    shrink = np.sqrt(random.chisquare(_PROPOSAL_DOF, _DRAWS) / _PROPOSAL_DOF)
    standard = normal / shrink[:, None]
    density = -0.5 * (_PROPOSAL_DOF + n) * np.log1p((standard**2).sum(axis=1) / _PROPOSAL_DOF)
    return mean + standard @ factor.T, density


def _normalised(log_weights: FloatArray) -> FloatArray:
    weights = np.exp(log_weights - log_weights.max())
    return np.asarray(weights / weights.sum())


def _systematic(weights: FloatArray, count: int, random: np.random.Generator) -> npt.NDArray[np.int64]:
    places = (random.random() + np.arange(count)) / count
    return np.minimum(np.searchsorted(np.cumsum(weights), places), len(weights) - 1)


def interval(values: FloatArray, confidence: float = 0.95) -> tuple[float, float]:
    """Central interval of a sample."""
    tail = (1 - confidence) / 2
    low, high = np.quantile(values, [tail, 1 - tail])
    return float(low), float(high)


def expected_forces(z: FloatArray, surfaces: Surfaces, model_error: float, seed: int = 0) -> FloatArray:
    """Peak forces before any shot, of the mean logarithm of a condition's, draw by draw (draws, conditions) [N]."""
    random = np.random.default_rng(seed)
    logs = surfaces(z)
    sd = np.sqrt(surfaces.error**2 + model_error**2)
    return np.asarray(np.exp(logs + sd * random.standard_normal(logs.shape)))


def forces_after(
    posterior: Posterior,
    surfaces: Surfaces,
    condition: npt.NDArray[np.int64],
    log_force: FloatArray,
    errors: ErrorModel,
    seed: int = 0,
) -> FloatArray:
    """Peak forces after the shots, of the mean logarithm of a condition's, draw by draw (draws, conditions) [N].

    What the model and the polynomials are off at a condition is alike in all its shots, so these tell it: given the
    parameters it is normal, with shots weighted as Student's t weights them.
    """
    random = np.random.default_rng(seed)
    logs = surfaces(posterior.z)
    noise = surfaces.log_sd**2 + posterior.gauge_error[:, None] ** 2
    precision = np.broadcast_to(1 / (surfaces.error**2 + errors.model**2), logs.shape).copy()
    pull = np.zeros_like(logs)
    for shot, c in enumerate(condition):
        weight = posterior.shot_weight[shot] / noise[:, c]
        precision[:, c] += weight
        pull[:, c] += weight * (log_force[shot] - logs[:, c])
    own = pull / precision + random.standard_normal(logs.shape) / np.sqrt(precision)
    return np.asarray(np.exp(logs + own))


def single_shots(forces: FloatArray, surfaces: Surfaces, gauge_error: FloatArray | float, seed: int = 1) -> FloatArray:
    """What single shots of them show on a gauge (draws, conditions) [N]."""
    random = np.random.default_rng(seed)
    error = np.broadcast_to(np.asarray(gauge_error, dtype=np.float64), (len(forces),))
    sd = np.sqrt(surfaces.log_sd**2 + error[:, None] ** 2)
    return np.asarray(forces * np.exp(sd * random.standard_normal(forces.shape)))
