"""The laws of friction that a protocol's strokes can show, and which of them predicts other strokes.

Schroeder's law is eq 2.27, D |qd|^F. Beside it stands Coulomb and viscous friction with a share of the current that
the gears lose under load, as :mod:`bumpstop.joint` has it: sgn(qd) (coulomb + load |i|) + viscous qd.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.drive.drive_model import inverse_map
from bumpstop.joint.parameters import Parameter
from bumpstop.reproduction.schroeder2013.protocol_steps import (
    StrokeFit,
    cluster_covariance,
    fit_map,
    fit_stroke,
    widened,
)

if TYPE_CHECKING:
    from bumpstop.reproduction.schroeder2013.constant_velocity import Segment

LAWS = {"power": ("D", "F"), "load_dependent": ("coulomb", "viscous", "load")}
_MAX_LOAD = 0.6  # share of the current that gears lose
_ROWS = 150  # of a stroke, where the share is looked for
_GROUPS = 5  # of strokes, each left out once for the share's standard error
_PIECES = 10  # of a stroke, to compare by
_MIN_STROKES = 8  # that three figures and their errors take


@dataclass(frozen=True, eq=False)
class FrictionFit:
    """A law of friction through strokes.

    Attributes:
        law: of :data:`LAWS`.
        values: (k,) in the order of the law's names.
        errors: (k,) standard errors, widened by Student's quantile.
        covariance: of the values (k, k).
        sd: of the strokes about the law [current].
        freedom: degrees of freedom of the covariance, the least of all.
    """

    law: str
    values: FloatArray
    errors: FloatArray
    covariance: FloatArray
    sd: float
    freedom: float

    @property
    def parameters(self) -> dict[str, Parameter]:
        """By name, with standard errors."""
        pairs = zip(LAWS[self.law], self.values.tolist(), self.errors.tolist(), strict=True)
        return {name: Parameter(value, error) for name, value, error in pairs}

    def current(self, qd: FloatArray, current: FloatArray, values: FloatArray | None = None) -> FloatArray:
        """Current (N,) that friction takes at rates and measured motor currents (N,); other ``values`` may be tried."""
        own = self.values if values is None else values
        if self.law == "power":
            return np.asarray(np.sign(qd) * own[0] * np.abs(qd) ** own[1])
        return np.asarray(np.sign(qd) * (own[0] + own[2] * np.abs(current)) + own[1] * qd)

    def at_zero_torque(self, speed: FloatArray) -> FloatArray:
        """Current (N,) that friction takes at speeds (N,) above 0 where no torque loads the joint."""
        if self.law == "power":
            return np.asarray(self.values[0] * speed ** self.values[1])
        return np.asarray((self.values[0] + self.values[1] * speed) / (1 - self.values[2]))

    def motor_current(self, joint_current: FloatArray, qd: FloatArray) -> FloatArray:
        """Motor current (N,) of joint currents (N,): what :meth:`current` takes is put on top."""
        if self.law == "power":
            return np.asarray(joint_current + self.current(qd, joint_current))
        base = joint_current + np.sign(qd) * self.values[0] + self.values[1] * qd
        return np.asarray(base / (1 - np.sign(qd) * np.sign(base) * self.values[2]))


def fit_friction(law: str, kind: str, parts: Sequence[Segment]) -> tuple[list[StrokeFit], FrictionFit]:
    """The curve of every stroke, and a law through the currents at which they take no torque.

    Args:
        law: of :data:`LAWS`.
        kind: of the map.
        parts: strokes at constant speed.
    """
    if law == "power":
        strokes = [fit_stroke(kind, part) for part in parts]
        return strokes, power_law(strokes)
    share = _share(kind, parts)
    # Without what goes with the load a stroke's zero is that of Coulomb and viscous friction.
    strokes = [fit_stroke(kind, _unloaded(part, share)) for part in parts]
    found = _straight(strokes, share)
    left = [_share(kind, [part for k, part in enumerate(parts) if k // 2 % _GROUPS != g]) for g in range(_GROUPS)]
    variance = (_GROUPS - 1) / _GROUPS * float(((np.array(left) - np.mean(left)) ** 2).sum())
    covariance = found.covariance.copy()
    covariance[2, 2] = variance
    errors = found.errors.copy()
    errors[2] = widened(variance, _GROUPS - 1)
    # The strokes are told by the currents that were measured.
    told = [replace_friction(stroke, stroke.friction / (1 - share)) for stroke in strokes]
    return told, replace(found, covariance=covariance, errors=errors)


def replace_friction(stroke: StrokeFit, friction: float) -> StrokeFit:
    """The same stroke with another current at zero torque."""
    return StrokeFit(stroke.speed, friction, stroke.A, stroke.B)


def power_law(strokes: Sequence[StrokeFit]) -> FrictionFit:
    """Eq 2.27 through the strokes' friction currents.

    Standard errors by the jackknife's sandwich of single strokes, widened by Student's quantile.
    """
    from scipy.optimize import least_squares

    speed = np.array([abs(stroke.speed) for stroke in strokes])
    taken = np.array([np.sign(stroke.speed) * stroke.friction for stroke in strokes])
    log = np.log(speed)
    positive = taken > 0
    if positive.sum() >= 2 and np.ptp(log[positive]) > 0:
        F, log_d = np.polyfit(log[positive], np.log(taken[positive]), 1)
    else:
        F, log_d = 0.0, np.log(max(float(np.abs(taken).mean()), 1e-12))
    scale = max(float(np.exp(log_d)), 1e-12)

    def residual(p: FloatArray) -> FloatArray:
        return np.asarray(p[0] * np.exp(p[1] * log) - taken / scale)

    def derivative(p: FloatArray) -> FloatArray:
        power = np.exp(p[1] * log)
        return np.column_stack([power, p[0] * power * log])

    bounds = ([0.0, 0.0], [np.inf, 3.0])
    found = least_squares(residual, [1.0, min(max(float(F), 0.0), 3.0)], derivative, bounds=bounds)
    covariance, freedom = cluster_covariance(derivative(found.x), found.fun, np.arange(len(strokes)))
    to_units = np.diag([scale, 1.0])
    covariance = to_units @ covariance @ to_units
    return FrictionFit(
        law="power",
        values=to_units @ found.x,
        errors=_errors(covariance, freedom),
        covariance=covariance,
        sd=float(scale * np.sqrt((found.fun**2).sum() / max(1, len(strokes) - 2))),
        freedom=float(freedom.min()),
    )


def held_out_by_law(law: str, kind: str, parts: Sequence[Segment]) -> FloatArray:
    """Mean square error of each stroke (strokes,) [current2], friction and map fitted to every second pair.

    Motor currents are compared in tenths of a stroke. NaN: too few strokes.
    """
    errors = np.full(len(parts), np.nan)
    for half in (0, 1):
        known = [part for k, part in enumerate(parts) if k // 2 % 2 == half]
        other = [k for k in range(len(parts)) if k // 2 % 2 != half]
        speeds = {round(abs(part.speed), 6) for part in known}
        if len(known) < _MIN_STROKES // 2 or len(speeds) < 2 or not other or not _both_ways(known):
            return np.full(len(parts), np.nan)
        share = 0.0 if law == "power" else _share(kind, known)
        strokes = [fit_stroke(kind, _unloaded(part, share)) for part in known]
        friction = power_law(strokes) if law == "power" else _straight(strokes, share)
        own = [part.current - friction.current(part.qd, part.current) for part in known]
        fitted = fit_map(kind, known, own)
        for k in other:
            part = parts[k]
            sign = float(np.sign(part.speed))
            joint = inverse_map(kind, fitted.A.value, fitted.B.value, part.torque, sign)[0]
            left = part.current - friction.motor_current(joint, part.qd)
            begins = np.arange(_PIECES) * left.size // _PIECES
            mean = np.add.reduceat(left, begins) / np.diff(begins, append=left.size)
            errors[k] = float((mean**2).mean())
    return errors


def _both_ways(parts: Sequence[Segment]) -> bool:
    return len({part.speed > 0 for part in parts}) == 2


def _errors(covariance: FloatArray, freedom: FloatArray) -> FloatArray:
    return np.array([widened(covariance[k, k], freedom[k]) for k in range(len(freedom))])


def _straight(strokes: Sequence[StrokeFit], share: float) -> FrictionFit:
    """Coulomb and viscous friction through currents that the load takes nothing of, neither of them below zero."""
    from scipy.optimize import lsq_linear

    speed = np.array([abs(stroke.speed) for stroke in strokes])
    taken = np.array([np.sign(stroke.speed) * stroke.friction for stroke in strokes])
    columns = np.column_stack([np.ones_like(speed), speed])
    values = np.asarray(lsq_linear(columns, taken, bounds=(0.0, np.inf)).x)
    left = columns @ values - taken
    covariance, freedom = cluster_covariance(columns, left, np.arange(len(strokes)))
    whole = np.zeros((3, 3))
    whole[:2, :2] = covariance
    return FrictionFit(
        law="load_dependent",
        values=np.append(values, share),
        errors=np.append(_errors(covariance, freedom), 0.0),
        covariance=whole,
        sd=float(np.sqrt((left**2).sum() / max(1, len(strokes) - 3))),
        freedom=float(freedom.min()),
    )


def _unloaded(part: Segment, share: float) -> Segment:
    """The stroke without the current that goes with the load."""
    if share == 0:
        return part
    return replace(part, current=part.current - np.sign(part.qd) * share * np.abs(part.current))


def _share(kind: str, parts: Sequence[Segment]) -> float:
    """Share of the current that is lost under load: that with which one map explains the strokes both ways best."""
    from scipy.optimize import minimize_scalar

    few = [_thin(part) for part in parts]

    def left(share: float) -> float:
        own = [_unloaded(part, share).current for part in few]
        fitted = fit_map(kind, few, own)
        error = 0.0
        for part, current, constant in zip(few, own, fitted.constants.tolist(), strict=True):
            sign = float(np.sign(part.speed))
            expected = inverse_map(kind, fitted.A.value, fitted.B.value, part.torque, sign)[0]
            error += float(((current - expected - constant) ** 2).mean())
        return error

    return float(minimize_scalar(left, bounds=(0.0, _MAX_LOAD), method="bounded", options={"xatol": 1e-4}).x)


def _thin(part: Segment) -> Segment:
    every = max(1, part.t.size // _ROWS)
    columns = {name: getattr(part, name)[::every] for name in ("t", "current", "torque", "qd", "qdd")}
    return replace(part, **columns)
