"""One joint's map, friction, hysteresis and reflected inertia, and what its motion cannot show."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.comparison import share_predicted
from bumpstop.identification.drive.drive_model import DriveModel, JointMotion
from bumpstop.identification.drive.error_sources import (
    GainByModel,
    error_of_choice,
    errors_of_inertia,
    weights_of,
)
from bumpstop.identification.drive.observability import SURE_GAIN, DriveObservability, assess, bounds, starting_values
from bumpstop.identification.segments.drive_samples import DriveSamples
from bumpstop.identification.statistics.independent_columns import condition_of
from bumpstop.identification.statistics.robust_fit import HUBER, RobustFit, at_bound, gauss_newton_step, robust_fit
from bumpstop.joint.friction_law import OF_FRICTION
from bumpstop.joint.parameters import COMMON, OF_MAP, JointParameters, Parameter
from bumpstop.terminal import in_percent

if TYPE_CHECKING:
    from bumpstop.model import Robot

_FOLDS = 5
# Rows that maps and laws are chosen on; of more, blocks spread over the time.
_ENOUGH_TO_CHOOSE = 8_000
# The simplest candidate within this factor of the least held-out error is taken.
_AS_GOOD = 1.002
# Simplest first.
_MAPS, _FRICTIONS = ("linear", "odd", "load_dependent"), ("power", "stribeck", "load_dependent")


@dataclass(frozen=True, kw_only=True)
class Candidate:
    """A map and a friction law that were tried.

    Attributes:
        map, friction: which.
        held_out: root mean square error on held-out fifths of the time [A, filtered]; None: refused.
        refused: why it cannot be used; or empty.
        gain: that it came to, on the samples that models are chosen on; None: there is none, or it is no map at all. A
            model that is refused since the motion does not tell its parameters apart has one: it may still be true.
        weight: of its gain among those of all candidates, 0 to 1.
    """

    map: str
    friction: str
    held_out: float | None
    refused: str = ""
    gain: GainByModel | None = None
    weight: float = 0.0


@dataclass(frozen=True, kw_only=True, eq=False)
class JointFit:
    """How a joint was fitted.

    Attributes:
        name: of the joint.
        observable: whether the motion shows how much torque a current makes. If not, B is unknown.
        parameters: of the joint torque model.
        unobservable: parameters that the motion cannot show, with the reason and what was put in their place.
        warnings: the same as sentences, and what else is doubtful.
        candidates: maps and friction laws that were tried.
        measured, predicted: (N,) motor currents, filtered alike, at all rows [A].
        torque: (N,) Newton-Euler torque at these rows [Nm or N].
        estimated: (N,) torque that the model makes of the measured current; NaN where B is unknown.
        qd, qdd: (N,) at these rows.
        r2: share of the filtered current's variance that is predicted; NaN: it does not vary.
        rmse: root mean square of measured less predicted, filtered [A].
        independent: number of residuals that count as independent.
        near_reversals: rows that the fit leaves out: the joint turns round there, and friction with it in its own way.
        condition: condition number of the columns of the fit, each brought to length one.
        gain_errors: standard errors of B by what makes them: ``noise``, ``model`` (the choice of map and friction) and
            ``inertia``; that of B is their hypotenuse. Empty where the gain is not fitted.
        braking: standard errors by which friction, before it is held at zero, is above zero; negative: it drives.
    """

    name: str
    observable: bool
    parameters: JointParameters
    unobservable: Mapping[str, str]
    warnings: tuple[str, ...]
    candidates: tuple[Candidate, ...]
    measured: FloatArray
    predicted: FloatArray
    torque: FloatArray
    estimated: FloatArray
    qd: FloatArray
    qdd: FloatArray
    r2: float
    rmse: float
    independent: float
    near_reversals: int = 0
    condition: float = math.inf
    gain_errors: Mapping[str, float] = field(default_factory=dict)
    braking: float = 0.0

    @property
    def residual(self) -> FloatArray:
        """Measured less predicted current (N,), filtered [A]."""
        return self.measured - self.predicted


@dataclass(frozen=True, eq=False)
class _Task:
    """The rows of one joint, how predictions are filtered to be compared, and at which rows they are."""

    rows: DriveSamples
    motion: JointMotion
    current: FloatArray
    fitted: npt.NDArray[np.bool_]

    @classmethod
    def of(cls, rows: DriveSamples, j: int, observability: DriveObservability) -> _Task:
        current = rows.filtered(rows.current[:, j : j + 1])[:, 0]
        fitted = observability.fitted_rows(rows, j)
        return cls(rows, rows.joint(j, observability.rest_speed), current, fitted)

    @cached_property
    def measured(self) -> FloatArray:
        return self.current[self.fitted]

    def model(self, law: DriveModel, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        current, columns = law.current(values, self.motion)
        both = self.rows.filtered(np.column_stack([current, columns]))[self.fitted]
        return both[:, 0], both[:, 1:]

    def predicted(self, law: DriveModel, values: FloatArray) -> FloatArray:
        """Current at all rows."""
        return self.rows.filtered(law.current(values, self.motion)[0][:, None])[:, 0]

    def fit(
        self, law: DriveModel, start: Mapping[str, float], observability: DriveObservability, **options: Any
    ) -> RobustFit:
        low, high = bounds(law.names, observability)
        values = np.array([start[name] for name in law.names])
        return robust_fit(lambda x: self.model(law, x), self.measured, values, low, high, **options)

    def left_out(self, law: DriveModel, fit: RobustFit, observability: DriveObservability) -> float:
        """Root mean square error on fifths of the time, each predicted from the other four.

        Their fit is one Gauss-Newton step away from that to all five, so near that a second would change nothing.
        """
        low, high = bounds(law.names, observability)
        held = at_bound(fit.columns, fit.residual, fit.values, low, high)
        error = np.empty_like(self.measured)
        for part in np.array_split(np.arange(self.measured.size), _FOLDS):
            others = np.ones(self.measured.size, dtype=bool)
            others[part] = False
            step = gauss_newton_step(fit.columns[others], fit.residual[others], HUBER * fit.scale, 0.0, held)
            values = np.clip(fit.values + step, low, high)
            error[part] = (self.measured - self.model(law, values)[0])[part]
        return float(np.sqrt((error**2).mean()))


@dataclass(frozen=True, kw_only=True)
class JointFitSettings:
    """What the fit of a joint is asked for, as for ``identify_joint_model``.

    Attributes:
        rest_speed: below which the joint rests [rad/s or m/s].
        maps, frictions: to choose from.
        known: parameters that are not fitted, by name.
    """

    rest_speed: float
    maps: tuple[str, ...]
    frictions: tuple[str, ...]
    known: Mapping[str, float]


def fit_joint(rows: DriveSamples, j: int, arm: Robot, settings: JointFitSettings, changes: FloatArray) -> JointFit:
    """Fit joint ``j`` (from 0) of ``arm``.

    ``changes``: (N, c) of the joint's torque by one standard deviation of the inertia, as :func:`inertia_changes`.
    """
    joint, rest_speed, known = arm.joints[j], settings.rest_speed, settings.known
    observability = assess(rows, j, arm, rest_speed, known)
    task = _Task.of(rows, j, observability)
    unobservable = dict(observability.unobservable)
    fixed = {**observability.fixed, **known}
    if known.get("stribeck") == 0:  # then its speed counts for nothing: Coulomb and viscous friction alone
        fixed.setdefault("stribeck_speed", rest_speed)
    start = starting_values(observability, fixed)
    candidates: list[Candidate] = []
    if observability.gain_unobservable:
        kind, friction = "unknown_gain", "power"
    else:
        few = _Task.of(rows.spread(_ENOUGH_TO_CHOOSE), j, observability)
        kind, friction, near = _choose(few, settings, observability, fixed, start, candidates)
        start |= near
    while True:
        law = DriveModel.of(kind, friction, rest_speed, fixed, hysteresis=observability.hysteresis)
        fit = task.fit(law, start, observability)
        more = observability.ambiguous(law, fit)
        gainless = None if more else observability.without_gain(law, fit)
        if gainless is not None:
            observability, kind, friction = gainless, "unknown_gain", "power"
            unobservable, fixed = dict(observability.unobservable), {**observability.fixed, **known}
            start = starting_values(observability, fixed)
            continue
        if not more:
            try:
                errors, gain_errors = _errors(law, fit, task, changes, candidates)
                parameters = _parameters(joint.name, law, fit.values, errors, known, observability, task)
                break
            except InputError:
                if "A" not in law.names:
                    raise
                # No other map was left to choose: this one holds as far as a line does.
                more = {"A": (0.0, f"the {kind} map that fits best does not rise all the way, A is fixed at 0")}
        for name, (value, reason) in more.items():
            fixed[name], unobservable[name] = value, reason
    predicted = task.predicted(law, fit.values)
    estimated = _estimated(parameters, task)
    warnings = [f"{name} is not identifiable: {reason}" for name, reason in unobservable.items()]
    gain = parameters.parameters["B"]
    if gain is not None and gain_errors and gain_errors["inertia"] > SURE_GAIN * gain.value:
        warnings.append(
            f"B rests on the inertia that the robot came with: its standard error is "
            f"{in_percent(gain_errors['inertia'] / gain.value)} where that is as uncertain as stated"
        )
    if not fit.converged:
        warnings.append("the fit did not settle; its figures are doubtful")
    return JointFit(
        name=joint.name,
        observable=not observability.gain_unobservable,
        parameters=parameters,
        unobservable=unobservable,
        warnings=tuple(warnings),
        candidates=tuple(candidates),
        measured=task.current,
        predicted=predicted,
        torque=task.motion.torque,
        estimated=estimated,
        qd=task.motion.qd,
        qdd=task.motion.qdd,
        r2=share_predicted(task.current, predicted),
        rmse=float(np.sqrt(((task.current - predicted) ** 2).mean())),
        near_reversals=int(np.count_nonzero(~task.fitted)),
        independent=fit.independent,
        condition=condition_of(fit.columns),
        gain_errors=gain_errors,
        braking=observability.braking,
    )


def _errors(
    law: DriveModel, fit: RobustFit, task: _Task, changes: FloatArray, candidates: list[Candidate]
) -> tuple[FloatArray, dict[str, float]]:
    """Standard errors (k,) of a fit by noise, inertia and choice of the model, and the parts of that of B."""
    of_inertia = errors_of_inertia(law, fit, task.motion, changes, task.rows, task.fitted)
    errors = np.hypot(fit.standard_errors, of_inertia)
    if "B" not in law.names:
        return errors, {}
    place = law.names.index("B")
    able = [number for number, candidate in enumerate(candidates) if candidate.gain is not None]
    gains = [gain for candidate in candidates if (gain := candidate.gain) is not None]
    of_choice = 0.0
    if gains:
        weights = weights_of(gains, fit.independent)
        for number, weight in zip(able, weights.tolist(), strict=True):
            candidates[number] = replace(candidates[number], weight=weight)
        tried = [(candidates[number].map, candidates[number].friction) for number in able]
        chosen = (law.map, law.friction)
        if chosen in tried:
            of_choice = error_of_choice(gains, tried.index(chosen), weights)
    errors[place] = math.hypot(errors[place], of_choice)
    noise = float(fit.standard_errors[place])
    return errors, {"noise": noise, "model": of_choice, "inertia": float(of_inertia[place])}


def _choose(
    task: _Task,
    settings: JointFitSettings,
    observability: DriveObservability,
    fixed: Mapping[str, float],
    start: Mapping[str, float],
    candidates: list[Candidate],
) -> tuple[str, str, dict[str, float]]:
    """The friction law with the simplest map, the map with that law, and the law once more with that map.

    By held-out error; and the values found. Where the simplest map bends too little, a law may have made up for it.
    """
    bends = "A" in fixed_parameters(fixed)
    kinds = [kind for kind in _MAPS if kind in settings.maps and not (bends and kind == "linear")]
    laws = [law for law in _FRICTIONS if law in settings.frictions]
    if observability.single_speed or observability.static:
        laws = [law for law in laws if law == "power"] or laws[:1]

    near: dict[tuple[str, str], dict[str, float]] = {}

    def tried(kind: str, friction: str) -> Candidate:
        law = DriveModel.of(kind, friction, settings.rest_speed, fixed, hysteresis=observability.hysteresis)
        fit = task.fit(law, {**start, **near.get((kinds[0], friction), {})}, observability)
        near[kind, friction] = dict(zip(law.names, fit.values.tolist(), strict=True))
        refused, gain = observability.refused(law, fit), None
        held_out = task.left_out(law, fit, observability)
        if "B" in law.names:
            place = law.names.index("B")
            gain = GainByModel(float(fit.values[place]), float(fit.standard_errors[place]), held_out)
        try:
            _parameters("joint", law, fit.values, fit.standard_errors, {}, observability, task)
        except InputError as error:
            refused, gain = refused or error.problem, None
        held = None if refused else held_out
        return Candidate(map=kind, friction=friction, held_out=held, refused=refused, gain=gain)

    candidates += [tried(kinds[0], friction) for friction in laws]
    friction = _best(candidates, "friction") or laws[0]
    candidates += [tried(kind, friction) for kind in kinds[1:]]
    kind = _best([candidate for candidate in candidates if candidate.friction == friction], "map") or kinds[0]
    if kind != kinds[0]:
        candidates += [tried(kind, other) for other in laws if other != friction]
        with_map = {candidate.friction: candidate for candidate in candidates if candidate.map == kind}
        friction = _best([with_map[law] for law in laws], "friction")
    return kind, friction, near[kind, friction]


def fixed_parameters(fixed: Mapping[str, float]) -> set[str]:
    """Names of parameters that are not fitted and not zero."""
    return {name for name, value in fixed.items() if value != 0}


def _best(candidates: list[Candidate], what: str) -> str:
    errors = [(candidate.held_out, getattr(candidate, what)) for candidate in candidates]
    able = [(error, name) for error, name in errors if error is not None]
    if not able:
        return ""
    least = min(error for error, _ in able)
    return str(next(name for error, name in able if error <= _AS_GOOD * least))


def _parameters(
    name: str,
    law: DriveModel,
    found: FloatArray,
    standard_errors: FloatArray,
    known: Mapping[str, float],
    observability: DriveObservability,
    task: _Task,
) -> JointParameters:
    """The fit as a joint of a model, which refuses a map that is not monotone over the currents of the fit."""
    values = {**law.fixed, **dict(zip(law.names, found.tolist(), strict=True))}
    errors = dict(zip(law.names, standard_errors.tolist(), strict=True))
    unknown_gain = law.map == "unknown_gain"
    kind = "linear" if unknown_gain else law.map
    parameters: dict[str, Parameter | None] = {}
    for own in (*OF_MAP[kind], *OF_FRICTION[law.friction], *COMMON):
        if own in known:
            parameters[own] = Parameter(known[own])
        elif own in errors:
            parameters[own] = Parameter(values[own], errors[own])
        elif own in COMMON or (own == "B" and unknown_gain):
            parameters[own] = None
        else:
            parameters[own] = Parameter(values[own])
    return JointParameters(
        name=name,
        map=kind,  # type: ignore[arg-type]
        friction=law.friction,  # type: ignore[arg-type]
        parameters=parameters,
        current_range=None if unknown_gain else _current_range(law, found, task),
        speed_range=observability.speed_range,
        rest_speed=law.rest_speed,
    )


def _current_range(law: DriveModel, found: FloatArray, task: _Task) -> tuple[float, float] | None:
    """Range of the joint current over the rows of the fit."""
    values = {**law.fixed, **dict(zip(law.names, found.tolist(), strict=True))}
    still = DriveModel(law.map, "power", (), {**values, "D": 0.0, "F": 0.0}, law.rest_speed)
    current = still.current(np.empty(0), task.motion)[0]
    low, high = float(current.min()), float(current.max())
    return (low, high) if low < high else None


def _estimated(parameters: JointParameters, task: _Task) -> FloatArray:
    from bumpstop.joint.model import JointTorqueModel

    model = JointTorqueModel(robot="arm", created_from="a recording", unit="A", joints=(parameters,))
    parts = []
    for rows in task.rows.segments:
        motion = task.motion.rows(rows)
        parts.append(model.torque(task.current[rows, None], motion.qd[:, None], motion.qdd[:, None])[:, 0])
    return np.concatenate(parts)
