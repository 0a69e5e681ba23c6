"""Peak forces of planned shots at many points of the parameters."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError
from bumpstop.measure.learning.response_surface import ResponseSurface, normal_points, quadratic_terms
from bumpstop.measure.parameters import Parameters
from bumpstop.measure.peak_force_model import shot_force
from bumpstop.measure.planning.measured_situation import MeasuredSituation

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision.scenario.scenario import Scenario

# Of the logarithm of a peak force: surfaces of a kinked function are not told to be better.
_MIN_ERROR = 0.005
# A fit has at least so many effective points for each term.
_POINTS_PER_TERM = 2.5
_WIDEN = 1.5
# A condition whose shots are never detected at more of the points is of no use.
_MIN_DETECTED = 0.9


@dataclass(frozen=True, eq=False)
class Condition:
    """What a shot repeats: one situation at one speed.

    Attributes:
        situation: where.
        speed_mm_s: of the tip, of a trajectory that of the contact point at the gauge [mm/s].
        scenario: the measurement, with every key of a parameter spelt out.
    """

    situation: MeasuredSituation
    speed_mm_s: float
    scenario: Scenario

    @property
    def speed_share(self) -> float:
        """Of a trajectory's own speed, of which its scenario says nothing; 1 of a line."""
        return 1.0 if self.situation.onset_s is None else self.speed_mm_s / self.situation.speed_mm_s

    @classmethod
    def of(cls, situation: MeasuredSituation, speed_mm_s: float, parameters: Parameters) -> Condition:
        """Of a situation at a speed [mm/s]."""
        return cls(situation, speed_mm_s, parameters.with_nominal(situation.at_speed(speed_mm_s)))

    @property
    def own_speed(self) -> bool:
        """Whether it is the speed of the situation itself."""
        return math.isclose(self.speed_mm_s, self.situation.speed_mm_s, rel_tol=1e-6)


@dataclass(frozen=True, eq=False)
class PeakForceEnsemble:
    """Exact peak forces of conditions at points of the parameters.

    Attributes:
        parameters: what varies.
        conditions: the columns.
        z: points (points, parameters), standard normal numbers before anything is measured.
        log_mean: mean logarithm of the peak force (points, conditions) [log N]; NaN where shots are not detected.
        log_sd: standard deviation of the logarithm among shots (points, conditions) [1].
        own_error: of each condition, by joints and pads that are off each by itself (conditions,) [1].
    """

    parameters: Parameters
    conditions: tuple[Condition, ...]
    z: FloatArray
    log_mean: FloatArray
    log_sd: FloatArray
    own_error: FloatArray

    @classmethod
    def of(
        cls,
        parameters: Parameters,
        conditions: Sequence[Condition],
        *,
        points: int,
        seed: int = 0,
        progress: Callable[[float], None] | None = None,
    ) -> PeakForceEnsemble:
        """At well-spread points, the first being what the scenarios say.

        Args:
            parameters: what varies.
            conditions: at least one.
            points: how many.
            seed: of the points.
            progress: told the share that is done.
        """
        z = np.concatenate([np.zeros((1, len(parameters))), normal_points(points - 1, len(parameters), seed)])
        own = np.array([_own_error(parameters, condition) for condition in conditions])
        return cls(parameters, tuple(conditions), z, *cls._at(parameters, tuple(conditions), z, progress), own)

    @staticmethod
    def _at(
        parameters: Parameters,
        conditions: tuple[Condition, ...],
        z: FloatArray,
        progress: Callable[[float], None] | None = None,
    ) -> tuple[FloatArray, FloatArray]:
        mean, sd = np.full((len(z), len(conditions)), np.nan), np.full((len(z), len(conditions)), np.nan)
        for i, point in enumerate(z):
            for c, condition in enumerate(conditions):
                mean[i, c], sd[i, c] = _log_force(parameters.at(condition.scenario, point), condition.speed_share)
            if progress is not None:
                progress((i + 1) / len(z))
        return mean, sd

    def with_points(self, z: FloatArray, progress: Callable[[float], None] | None = None) -> PeakForceEnsemble:
        """The same with more points (points, parameters)."""
        mean, sd = self._at(self.parameters, self.conditions, z, progress)
        return replace(
            self,
            z=np.concatenate([self.z, z]),
            log_mean=np.concatenate([self.log_mean, mean]),
            log_sd=np.concatenate([self.log_sd, sd]),
        )

    def detected(self) -> FloatArray:
        """Share of the points at which shots of a condition are detected (conditions,)."""
        return np.asarray(np.isfinite(self.log_mean).mean(axis=0))

    def where_detected(self) -> tuple[PeakForceEnsemble, tuple[Condition, ...]]:
        """Without conditions whose shots may be never detected, and these."""
        usable = (self.detected() >= _MIN_DETECTED) & np.isfinite(self.log_mean[0])
        keep, left = np.flatnonzero(usable), np.flatnonzero(~usable)
        if not keep.size:
            raise InputError(
                "detector.thresholds_Nm",
                "no shot would be detected for certain",
                "lower thresholds, higher speeds or other places",
            )
        kept = PeakForceEnsemble(
            self.parameters,
            tuple(self.conditions[c] for c in keep),
            self.z,
            self.log_mean[:, keep],
            self.log_sd[:, keep],
            self.own_error[keep],
        )
        return kept, tuple(self.conditions[c] for c in left)

    def left_out(self, unseen: Sequence[Condition]) -> list[str]:
        """A sentence for each of its conditions that :meth:`where_detected` leaves out."""
        detected = dict(zip(self.conditions, self.detected().tolist(), strict=True))
        return [
            f"{each.situation.name} at {each.speed_mm_s:.4g} mm/s is left out: in {100 * (1 - detected[each]):.3g} % "
            "of the cases within the assumed spread the arm never detects the gauge and would press on."
            for each in unseen
        ]

    def surfaces(self, mean: FloatArray | None = None, covariance: FloatArray | None = None) -> Surfaces:
        """Polynomials about where the parameters are believed to be.

        Args:
            mean: of the belief (parameters,); None: before anything is measured.
            covariance: of it (parameters, parameters).
        """
        weights = np.ones(len(self.z))
        if mean is not None and covariance is not None:
            weights = self._weights(mean, covariance)
        found = np.isfinite(self.log_mean)
        terms = quadratic_terms(self.z[:1]).shape[1]
        coefficients = np.empty((terms, len(self.conditions)))
        error, sd = np.empty(len(self.conditions)), np.empty(len(self.conditions))
        # Conditions whose shots are detected at the same points are fitted in one go.
        for rows in np.unique(found, axis=1).T:
            alike = (found == rows[:, None]).all(axis=0)
            fitted = ResponseSurface.fit(self.z[rows], self.log_mean[np.ix_(rows, alike)], weights[rows])
            coefficients[:, alike], error[alike] = fitted.coefficients, np.maximum(_MIN_ERROR, fitted.error)
            sd[alike] = np.average(self.log_sd[np.ix_(rows, alike)], axis=0, weights=weights[rows])
        return Surfaces(ResponseSurface(coefficients, error), sd, self.own_error)

    def _weights(self, mean: FloatArray, covariance: FloatArray) -> FloatArray:
        """Of the points, by the belief: widened until enough of them count."""
        n = self.z.shape[1]
        wanted = min(_POINTS_PER_TERM * (1 + n + n * (n + 1) / 2), 0.5 * len(self.z))
        away = self.z - mean
        spread = 2.0 * covariance
        while True:
            distance = np.einsum("ij,jk,ik->i", away, np.linalg.inv(spread + 1e-6 * np.eye(n)), away)
            weights = np.exp(-0.5 * (distance - distance.min()))
            if weights.sum() ** 2 / (weights**2).sum() >= wanted:
                return np.asarray(weights)
            spread = _WIDEN * spread + 0.01 * np.eye(n)


@dataclass(frozen=True, eq=False)
class Surfaces:
    """Mean logarithms of the peak forces over the parameters, and how far shots and polynomials are off them.

    Attributes:
        surface: one column for each condition [log N].
        log_sd: of shots (conditions,) [1].
        own_error: of each condition, see :class:`PeakForceEnsemble` (conditions,) [1].
    """

    surface: ResponseSurface
    log_sd: FloatArray
    own_error: FloatArray | float = 0.0

    @property
    def error(self) -> FloatArray:
        """Of the polynomials, and of each condition by itself (conditions,) [1]."""
        return np.asarray(np.hypot(self.surface.error, self.own_error))

    def __call__(self, z: FloatArray) -> FloatArray:
        """Mean logarithm of the peak force (points, conditions)."""
        return self.surface(z)


def _own_error(parameters: Parameters, condition: Condition) -> float:
    """How far joints and pads that are off each by itself put the logarithm of a condition's peak force [1]."""
    ends = [
        [_log_force(each, condition.speed_share)[0] for each in parameters.apart(condition.scenario, z)]
        for z in (-1.0, 1.0)
    ]
    # Where an arm no longer detects the gauge the other points tell enough.
    return math.sqrt(float(np.nansum((np.subtract(ends[1], ends[0]) / 2) ** 2)))


def _log_force(scenario: Scenario, speed: float) -> tuple[float, float]:
    try:
        found = shot_force(scenario, speed=speed)
    except InputError as error:
        if error.field != "detector.thresholds_Nm":
            raise
        return math.nan, math.nan
    return found.log_mean, found.log_sd
