"""The steps of Schroeder's fit, one joint at a time: friction by stroke, the map, hysteresis.

Schroeder 2013, section 2.4. Two things differ. Current is fitted to torque and not torque to current: the noise is on
the current, and as a regressor it would flatten the curve. And eq 2.29 is fitted to all strokes at once, each with a
constant C of its own, where Schroeder (2013) averaged the curves of single strokes.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.drive.drive_model import inverse_map
from bumpstop.joint.parameters import Parameter

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.reproduction.schroeder2013.constant_velocity import Segment

# Of a stroke, to compare maps by; a stroke has more rows than that.
_PIECES = 10
_NEWTON = 30  # steps; a few are enough where the map is far from level


def widened(variance: float, freedom: float) -> float:
    """Standard error of which 1.96 make a 95 % interval, from a variance with so many degrees of freedom."""
    from scipy.stats import norm, t

    return float(np.sqrt(max(variance, 0.0)) * t.ppf(0.975, max(freedom, 1.0)) / norm.ppf(0.975))


def cluster_covariance(columns: FloatArray, residual: FloatArray, begins: np.ndarray) -> tuple[FloatArray, FloatArray]:
    """Covariance of a least-squares solution whose residuals are correlated within clusters of rows.

    The jackknife's sandwich (CR3: R. M. Bell and D. F. McCaffrey 2002): the scores of each cluster are enlarged by what
    the fit bent towards it. Degrees of freedom are Satterthwaite's for clusters that count by their share in each
    parameter's variance, less one for each parameter beside it.

    Args:
        columns: (N, k) derivatives of the prediction.
        residual: (N,).
        begins: first row of each cluster, from 0 (G,).

    Returns:
        Covariance (k, k) and degrees of freedom (k,).
    """
    k, count = columns.shape[1], len(begins)
    inverse = np.linalg.pinv(columns.T @ columns)
    scores = np.add.reduceat(columns * residual[:, None], begins, axis=0)
    ends = np.append(begins[1:], len(residual))
    grams = np.stack([columns[a:b].T @ columns[a:b] for a, b in zip(begins, ends, strict=True)])
    kept = np.eye(k) - grams @ inverse
    # A parameter that one cluster alone shows cannot be left without it.
    enlarged = np.stack([np.linalg.lstsq(own, score, rcond=1e-6)[0] for own, score in zip(kept, scores, strict=True)])
    covariance = inverse @ (enlarged.T @ enlarged) @ inverse * (count - 1) / count
    shares = np.einsum("ij,gjk,ki->gi", inverse, grams, inverse)
    freedom = shares.sum(axis=0) ** 2 / np.maximum((shares**2).sum(axis=0), 1e-300) - k
    return covariance, np.maximum(freedom, 1.0)


@dataclass(frozen=True, eq=False)
class StrokeFit:
    """Eq 2.25 fitted to one stroke.

    Attributes:
        speed: mean, with its sign [rad/s].
        friction: the current at which the torque is zero (eq 2.26), with the sign of the motion [current].
        A, B: of this stroke's curve.
    """

    speed: float
    friction: float
    A: float
    B: float


def joint_torque(kind: str, A: float, B: float, current: FloatArray, sign: FloatArray | float) -> FloatArray:
    """Torque of joint currents (N,): the odd map, or eq 2.29."""
    bend = np.sign(current) if kind == "odd" else -np.broadcast_to(sign, current.shape)
    torque: FloatArray = B * current + A * bend * current**2
    return torque


def fit_stroke(kind: str, segment: Segment) -> StrokeFit:
    """Eqs 2.25 and 2.26 of one stroke: its curve, and the current that friction takes."""
    from scipy.optimize import least_squares

    sign = 1.0 if segment.speed > 0 else -1.0
    torque, current = segment.torque, segment.current
    big = float(np.abs(torque).max())
    line, *_ = np.linalg.lstsq(np.column_stack([np.ones_like(torque), torque / big]), current, rcond=None)
    unit = abs(float(line[1])) or 1.0
    x, y = torque / big, current / unit

    def residual(p: FloatArray) -> FloatArray:
        return np.asarray(p[0] + inverse_map(kind, p[2], p[1], x, sign)[0] - y)

    def derivative(p: FloatArray) -> FloatArray:
        i, slope, square = inverse_map(kind, p[2], p[1], x, sign)
        return np.column_stack([np.ones_like(x), -i / slope, -square / slope])

    start = np.array([line[0] / unit, 1.0, 0.0])
    found = least_squares(residual, start, derivative, method="lm", max_nfev=60).x
    A, B = float(found[2] * big / unit**2), float(found[1] * big / unit)
    return StrokeFit(float(segment.qd.mean()), float(found[0] * unit), A, B)


@dataclass(frozen=True, eq=False)
class MapFit:
    """Eq 2.29 fitted to the joint currents of all strokes.

    Attributes:
        kind: ``"odd"`` or ``"load_dependent"``.
        A, B: with standard errors.
        covariance: of A and B (2, 2).
        constants: C of every stroke, as a current; left out afterwards, as Schroeder (2013) does.
        reach: lowest and highest joint current.
        freedom: degrees of freedom of the covariance, the less of both.
    """

    kind: str
    A: Parameter
    B: Parameter
    covariance: FloatArray
    constants: FloatArray
    reach: tuple[float, float]
    freedom: float

    @property
    def monotone(self) -> bool:
        """Whether torque rises with current over all of its range."""
        bend = self.A.value if self.kind == "odd" else -abs(self.A.value)
        return self.B.value > 0 and self.B.value + 2 * bend * max(map(abs, self.reach)) > 0


def fit_map(kind: str, segments: Sequence[Segment], joint_currents: Sequence[FloatArray]) -> MapFit:
    """Eq 2.29 for all strokes together; every stroke weighs the same and has a constant of its own.

    Standard errors hold for residuals correlated within strokes (clusters), and are widened by Student's quantile.
    """
    from scipy.optimize import least_squares

    lengths = np.array([part.t.size for part in segments])
    begins = np.concatenate([[0], np.cumsum(lengths)[:-1]])
    number = np.repeat(np.arange(len(segments)), lengths)
    sign = np.sign([part.speed for part in segments])[number]
    torque = np.concatenate([part.torque for part in segments])
    current = np.concatenate(list(joint_currents))
    weight = np.sqrt(1 / lengths)[number]
    big, unit = float(np.abs(torque).max()), float(np.abs(current).max())
    x, y = torque / big, current / unit

    def own(values: FloatArray) -> FloatArray:
        """Less the mean of its stroke."""
        mean = np.add.reduceat(values, begins, axis=0) / (lengths if values.ndim == 1 else lengths[:, None])
        return np.asarray(values - mean[number])

    def residual(p: FloatArray) -> FloatArray:
        return weight * own(inverse_map(kind, p[1], p[0], x, sign)[0] - y)

    def derivative(p: FloatArray) -> FloatArray:
        i, slope, square = inverse_map(kind, p[1], p[0], x, sign)
        return weight[:, None] * own(np.column_stack([-i / slope, -square / slope]))

    rise = float((own(x) * own(y) * weight**2).sum())
    start = np.array([float((own(x) ** 2 * weight**2).sum()) / rise if rise else 1.0, 0.0])
    found = least_squares(residual, start, derivative, method="lm", max_nfev=100)
    covariance, freedom = cluster_covariance(derivative(found.x), found.fun, begins)
    to_units = np.diag([big / unit, big / unit**2])
    covariance = to_units @ covariance @ to_units
    b, a = found.x @ to_units
    left = y - inverse_map(kind, found.x[1], found.x[0], x, sign)[0]
    return MapFit(
        kind=kind,
        A=Parameter(float(a), widened(covariance[1, 1], freedom[1])),
        B=Parameter(float(b), widened(covariance[0, 0], freedom[0])),
        covariance=covariance[::-1, ::-1],
        constants=unit * np.add.reduceat(left, begins) / lengths,
        reach=(float(current.min()), float(current.max())),
        freedom=float(freedom.min()),
    )


def held_out(kind: str, segments: Sequence[Segment], joint_currents: Sequence[FloatArray]) -> FloatArray:
    """Mean square error of each stroke (strokes,) [Nm2], predicted from every second pair, without constants.

    The current of a torque is predicted, as the noise is on the current: predicting torque from it would favour the
    flatter map. Tenths of a stroke are compared, where the noise of single samples has averaged out; the error is told
    as a torque, by the slope of the straight map, one and the same for every kind. NaN: too few strokes.
    """
    torque, current = np.concatenate([part.torque for part in segments]), np.concatenate(list(joint_currents))
    slope = float((torque**2).sum()) / float((torque * current).sum())
    errors = np.full(len(segments), np.nan)
    for half in (0, 1):
        # Neighbours are there and back at one speed: pairs stay together.
        known = [k for k in range(len(segments)) if k // 2 % 2 == half]
        other = [k for k in range(len(segments)) if k // 2 % 2 != half]
        if len(known) < 2 or not other:
            return np.full(len(segments), np.nan)
        found = fit_map(kind, [segments[k] for k in known], [joint_currents[k] for k in known])
        for k in other:
            sign = float(np.sign(segments[k].speed))
            expected = inverse_map(kind, found.A.value, found.B.value, segments[k].torque, sign)[0]
            left = joint_currents[k] - expected
            begins = np.arange(_PIECES) * left.size // _PIECES
            mean = np.add.reduceat(left, begins) / np.diff(begins, append=left.size)
            errors[k] = float((mean**2).mean()) * slope**2
    return errors


def fit_hysteresis(found: MapFit, holds: Sequence[Segment]) -> tuple[Parameter, list[float]] | None:
    """Eq 2.31: T_H from holds reached from both sides, and the value of every hold [Nm].

    What does not change with the side, an error of the predicted torque, drops out. None: a side is missing. The
    standard error is that of whole holds and of the map; few holds widen it by Student's quantile, with Welch and
    Satterthwaite's degrees of freedom.
    """
    sides: dict[float, list[float]] = {1.0: [], -1.0: []}
    values, slopes = [], []
    for hold in holds:
        value = _held_torque(found, hold)
        bend = np.sign(hold.current) if found.kind == "odd" else -hold.speed
        slopes.append((hold.speed, float((bend * hold.current**2).mean()), float(hold.current.mean())))
        sides[hold.speed].append(value)
        values.append(hold.speed * value)
    if not sides[1.0] or not sides[-1.0]:
        return None
    means = {side: float(np.mean(own)) for side, own in sides.items()}
    value = (means[1.0] - means[-1.0]) / 2
    if min(len(own) for own in sides.values()) < 2:
        return Parameter(value, None), values
    shares = [float(np.var(own, ddof=1)) / len(own) / 4 for own in sides.values()]
    squares = sum(share**2 / (len(own) - 1) for share, own in zip(shares, sides.values(), strict=True))
    gradient = np.zeros(2)
    for side in (1.0, -1.0):
        gradient += side * np.mean([own[1:] for own in slopes if own[0] == side], axis=0) / 2
    by_map = float(gradient @ found.covariance @ gradient)
    if by_map > 0:
        shares.append(by_map)
        squares += by_map**2 / found.freedom
    freedom = sum(shares) ** 2 / squares if squares > 0 else np.inf
    return Parameter(value, widened(sum(shares), freedom)), values


def _held_torque(found: MapFit, hold: Segment) -> float:
    """Torque by which the map explains the mean current of a hold, beyond the predicted one [Nm].

    It is the mean of the current that is compared: the map of single currents would turn their noise into torque.
    """
    mean, beyond = float(hold.current.mean()), 0.0
    for _ in range(_NEWTON):
        current, slope, _ = inverse_map(found.kind, found.A.value, found.B.value, hold.torque + beyond, hold.speed)
        step = (mean - float(current.mean())) / float((1 / slope).mean())
        beyond += step
        if abs(step) < 1e-10 * (1.0 + abs(beyond)):
            break
    return beyond
