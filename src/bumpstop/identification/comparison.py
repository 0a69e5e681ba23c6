"""Predictions of a model beside a recording: scores by joint, and error by speed and acceleration.

Errors have the sign of Schroeder (2013): predicted minus measured (eq 3.1).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.identification.segments.motion import lowpass
from bumpstop.identification.segments.rest import MIN_MOVING

_MIN_IN_BIN = 20
ROUNDING = 1e-12  # of a filter, as a share of what passes it


@dataclass(frozen=True, kw_only=True)
class JointScore:
    """How well torques of one joint are predicted.

    Attributes:
        name: of the joint.
        r2: share of the torque's variance that is predicted, both filtered alike.
        r2_raw: the same against the unfiltered torque.
        mean, sd, rmse: of the error, predicted minus measured, unfiltered [unit].
        unit: of these errors.
        free_gain: the joint's gain is not known: ``r2`` is that up to a free gain, and errors are of the current.
        rest_share: of the rows at which the joint rests. Friction holds it there with whatever torque it came to stand
            with: ``r2`` and ``r2_raw`` are of the other rows.
    """

    name: str
    r2: float
    r2_raw: float
    mean: float
    sd: float
    rmse: float
    unit: str = "Nm"
    free_gain: bool = False
    rest_share: float = 0.0

    @property
    def rests(self) -> bool:
        """The joint moves in too few rows to be scored: ``r2`` and ``r2_raw`` are NaN."""
        return self.rest_share > 1 - MIN_MOVING


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """What a model predicts for a recording, beside what was measured (table 3.1).

    Attributes:
        names: of the joints.
        units: of the quantity, joint by joint.
        t: (N,) even times [s].
        qd, qdd: (N, n) [rad/s or m/s, and per second].
        measured, predicted: (N, n) [units].
        rate_hz: rows a second.
        filter_hz: cut-off of the zero-phase filter that both pass where they are compared filtered.
        given: scores by joint that were computed elsewhere, where rows are not even; None: they are computed here.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    t: FloatArray
    qd: FloatArray
    qdd: FloatArray
    measured: FloatArray
    predicted: FloatArray
    rate_hz: float
    filter_hz: float
    given: tuple[JointScore, ...] | None = None

    @cached_property
    def error(self) -> FloatArray:
        """Predicted less measured (N, n), eq 3.1."""
        return self.predicted - self.measured

    def scores(self) -> tuple[JointScore, ...]:
        """Table 3.1, with R2 filtered and raw; mean and standard deviation are of the unfiltered error."""
        if self.given is not None:
            return self.given
        smooth = [lowpass(x, self.rate_hz, self.filter_hz) for x in (self.measured, self.predicted)]
        return tuple(
            joint_score(
                name, (self.measured[:, j], self.predicted[:, j]), (smooth[0][:, j], smooth[1][:, j]), self.units[j]
            )
            for j, name in enumerate(self.names)
        )

    def by_speed(self, joint: int, bins: int = 12) -> BinnedError:
        """Error by the joint's own speed [rad/s]."""
        return binned_error(self.qd[:, joint], self.error[:, joint], bins)

    def by_acceleration(self, joint: int, bins: int = 12) -> BinnedError:
        """Error by the joint's own acceleration [rad/s2]."""
        return binned_error(self.qdd[:, joint], self.error[:, joint], bins)


@dataclass(frozen=True, eq=False)
class BinnedError:
    """Error by another quantity; bins with fewer than 20 rows are left out.

    Attributes:
        edges: (k, 2) low and high end of every bin.
        mean, sd: (k,) of the error in it.
        rows: (k,) in it.
    """

    edges: FloatArray
    mean: FloatArray
    sd: FloatArray
    rows: FloatArray


def binned_error(x: FloatArray, error: FloatArray, bins: int) -> BinnedError:
    """Mean and standard deviation of an error in bins of equal width over the middle 99.8 % of ``x`` (N,)."""
    low, high = np.quantile(x, [0.001, 0.999])
    if not high > low:
        return BinnedError(np.array([[low, high]]), error.mean()[None], error.std()[None], np.array([float(x.size)]))
    edges = np.linspace(low, high, bins + 1)
    place = np.digitize(x, edges[1:-1])
    inside = (x >= low) & (x <= high)
    kept = [k for k in range(bins) if (inside & (place == k)).sum() >= _MIN_IN_BIN]
    parts = [error[inside & (place == k)] for k in kept]
    return BinnedError(
        np.array([[edges[k], edges[k + 1]] for k in kept]).reshape(-1, 2),
        np.array([part.mean() for part in parts]),
        np.array([part.std() for part in parts]),
        np.array([float(part.size) for part in parts]),
    )


def joint_score(
    name: str,
    pair: tuple[FloatArray, FloatArray],
    smooth: tuple[FloatArray, FloatArray],
    unit: str,
    *,
    rests: npt.NDArray[np.bool_] | None = None,
    free_gain: bool = False,
) -> JointScore:
    """Score one joint.

    Args:
        name: of the joint.
        pair: measured and predicted (N,) each, unfiltered [unit].
        smooth: the same after the zero-phase filter.
        unit: of both.
        rests: (N,) rows at which the joint rests; default: none.
        free_gain: as in :class:`JointScore`.
    """
    measured, predicted = pair
    error = predicted - measured  # eq 3.1
    share = 0.0 if rests is None else float(rests.mean())
    moves = slice(None) if rests is None or share == 0 else ~rests
    hardly = share > 1 - MIN_MOVING
    return JointScore(
        name=name,
        r2=math.nan if hardly else share_predicted(smooth[0][moves], smooth[1][moves]),
        r2_raw=math.nan if hardly else share_predicted(measured[moves], predicted[moves]),
        mean=float(error.mean()),
        sd=float(error.std()),
        rmse=float(np.sqrt((error**2).mean())),
        unit=unit,
        free_gain=free_gain,
        rest_share=share,
    )


def mean_told(score: JointScore) -> float:
    """Its mean error without the digits that are those of rounding: below the fifth digit of the rmse."""
    if not (math.isfinite(score.mean) and 0 < score.rmse < math.inf):
        return score.mean
    return round(score.mean, 4 - math.floor(math.log10(score.rmse)))


def rest_words(scores: Sequence[JointScore]) -> str:
    """Which joints rest, and in how many rows, that R2 leaves out; empty: none does."""
    shares = [f"{score.name} {100 * score.rest_share:.3g} %" for score in scores if score.rest_share > 0]
    return f"R2 leaves out the rows at which a joint rests: {', '.join(shares)}" if shares else ""


def share_predicted(measured: FloatArray, predicted: FloatArray) -> float:
    """R2: the share of a variance that is predicted; NaN where there is none but rounding."""
    spread = float(((measured - measured.mean()) ** 2).sum())
    rounding = measured.size * (ROUNDING * float(np.abs(measured).max(initial=0.0))) ** 2
    return 1 - float(((measured - predicted) ** 2).sum()) / spread if spread > rounding else math.nan


def one_after_another(t: FloatArray, segments: Sequence[slice]) -> FloatArray:
    """Times (N,) of recordings that follow one another on the page, whatever their clocks say."""
    t = t.copy()
    for before, part in pairwise(segments):
        t[part] += max(0.0, t[before.stop - 1] - t[part.start])
    return t
