"""One joint's map, friction, hysteresis and reflected inertia, and what its motion cannot show."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.drive.drive_model import CurrentLaw, JointMotion
from bumpstop.identification.drive.observability import Sight, bounds, look, starting_values
from bumpstop.identification.segments.drive_samples import DriveRows
from bumpstop.identification.statistics.independent_columns import condition_of
from bumpstop.identification.statistics.robust_fit import HUBER, RobustFit, at_bound, gauss_newton_step, robust_fit
from bumpstop.joint.model import COMMON, OF_FRICTION, OF_MAP, JointParameters, Parameter

if TYPE_CHECKING:
    from bumpstop.model import Robot

_FOLDS = 5
# Rows that maps and laws are chosen on, and that the chosen one is fitted to; of more, blocks spread over the time.
_ENOUGH_TO_CHOOSE, _ENOUGH_TO_FIT = 8_000, 30_000
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
    """

    map: str
    friction: str
    held_out: float | None
    refused: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class JointFit:
    """How a joint was fitted.

    Attributes:
        name: of the joint.
        observable: whether the motion shows how much torque a current makes. If not, B is unknown.
        parameters: of the joint torque model.
        unseen: parameters that the motion cannot show, with the reason and what was put in their place.
        warnings: the same as sentences, and what else is doubtful.
        candidates: maps and friction laws that were tried.
        measured, predicted: (N,) motor currents, filtered alike, at the rows of the fit [A].
        torque: (N,) Newton-Euler torque at these rows [Nm or N].
        estimated: (N,) torque that the model makes of the measured current; NaN where B is unknown.
        qd, qdd: (N,) at these rows.
        r2: share of the filtered current's variance that is predicted.
        rmse: root mean square of measured less predicted, filtered [A].
        independent: number of residuals that count as independent.
        condition: condition number of the columns of the fit, each brought to length one.
    """

    name: str
    observable: bool
    parameters: JointParameters
    unseen: Mapping[str, str]
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
    condition: float = math.inf

    @property
    def residual(self) -> FloatArray:
        """Measured less predicted current (N,), filtered [A]."""
        return self.measured - self.predicted


@dataclass(frozen=True, eq=False)
class _Task:
    """The rows of one joint, and how predictions are filtered to be compared."""

    rows: DriveRows
    motion: JointMotion
    measured: FloatArray

    @classmethod
    def of(cls, rows: DriveRows, j: int, rest_speed: float) -> _Task:
        return cls(rows, rows.joint(j, rest_speed), rows.filtered(rows.current[:, j : j + 1])[:, 0])

    def model(self, law: CurrentLaw, values: FloatArray) -> tuple[FloatArray, FloatArray]:
        current, columns = law.current(values, self.motion)
        both = self.rows.filtered(np.column_stack([current, columns]))
        return both[:, 0], both[:, 1:]

    def fit(self, law: CurrentLaw, start: Mapping[str, float], sight: Sight, **options: Any) -> RobustFit:
        low, high = bounds(law.names, sight)
        values = np.array([start[name] for name in law.names])
        return robust_fit(lambda x: self.model(law, x), self.measured, values, low, high, **options)

    def left_out(self, law: CurrentLaw, fit: RobustFit, sight: Sight) -> float:
        """Root mean square error on fifths of the time, each predicted from the other four.

        Their fit is one Gauss-Newton step away from that to all five, so near that a second would change nothing.
        """
        low, high = bounds(law.names, sight)
        held = at_bound(fit.columns, fit.residual, fit.values, low, high)
        error = np.empty_like(self.measured)
        for part in np.array_split(np.arange(self.measured.size), _FOLDS):
            others = np.ones(self.measured.size, dtype=bool)
            others[part] = False
            step = gauss_newton_step(fit.columns[others], fit.residual[others], HUBER * fit.scale, 0.0, held)
            values = np.clip(fit.values + step, low, high)
            error[part] = (self.measured - self.model(law, values)[0])[part]
        return float(np.sqrt((error**2).mean()))


def fit_joint(
    rows: DriveRows,
    j: int,
    arm: Robot,
    rest_speed: float,
    maps: tuple[str, ...],
    frictions: tuple[str, ...],
    known: Mapping[str, float],
) -> JointFit:
    """Fit joint ``j`` (from 0) of ``arm``; settings as for ``identify_joint_model``."""
    joint = arm.joints[j]
    rows = rows.spread(_ENOUGH_TO_FIT)
    task = _Task.of(rows, j, rest_speed)
    sight = look(rows, j, arm, rest_speed, known)
    unseen = dict(sight.unseen)
    fixed = {**sight.fixed, **known}
    start = starting_values(sight, fixed)
    candidates: list[Candidate] = []
    if sight.blind:
        kind, friction = "blind", "power"
    else:
        kind, friction, near = _choose(
            rows, j, sight, fixed, start, maps, frictions, rest_speed, joint.name, candidates
        )
        start |= near
    while True:
        law = CurrentLaw.of(kind, friction, rest_speed, fixed, hysteresis=sight.hysteresis)
        fit = task.fit(law, start, sight)
        more = sight.unclear(law, fit)
        blinder = None if more else sight.without_gain(law, fit)
        if blinder is not None:
            sight, kind, friction = blinder, "blind", "power"
            unseen, fixed = dict(sight.unseen), {**sight.fixed, **known}
            start = starting_values(sight, fixed)
            continue
        if not more:
            try:
                parameters = _parameters(joint.name, law, fit, known, sight, task)
                break
            except InputError:
                if "A" not in law.names:
                    raise
                # No other map was left to choose: this one holds as far as a line does.
                more = {"A": (0.0, f"the {kind} map that fits best does not rise all the way, A is fixed at 0")}
        for name, (value, reason) in more.items():
            fixed[name], unseen[name] = value, reason
    predicted = task.measured - fit.residual
    estimated = _estimated(parameters, task)
    warnings = [f"{name} is not identifiable: {reason}" for name, reason in unseen.items()]
    if not fit.converged:
        warnings.append("the fit did not settle; its figures are doubtful")
    spread = float(((task.measured - task.measured.mean()) ** 2).sum())
    return JointFit(
        name=joint.name,
        observable=not sight.blind,
        parameters=parameters,
        unseen=unseen,
        warnings=tuple(warnings),
        candidates=tuple(candidates),
        measured=task.measured,
        predicted=predicted,
        torque=task.motion.torque,
        estimated=estimated,
        qd=task.motion.qd,
        qdd=task.motion.qdd,
        r2=1 - float((fit.residual**2).sum()) / spread if spread > 0 else 0.0,
        rmse=float(np.sqrt((fit.residual**2).mean())),
        independent=fit.independent,
        condition=condition_of(fit.columns),
    )


def _choose(
    rows: DriveRows,
    j: int,
    sight: Sight,
    fixed: Mapping[str, float],
    start: Mapping[str, float],
    maps: tuple[str, ...],
    frictions: tuple[str, ...],
    rest_speed: float,
    name: str,
    candidates: list[Candidate],
) -> tuple[str, str, dict[str, float]]:
    """The friction law with the simplest map, the map with that law, and the law once more with that map.

    By held-out error; and the values found. Where the simplest map bends too little, a law may have made up for it.
    """
    task = _Task.of(rows.spread(_ENOUGH_TO_CHOOSE), j, rest_speed)
    kinds = [kind for kind in _MAPS if kind in maps and not ("A" in known_names(fixed) and kind == "linear")]
    laws = [law for law in _FRICTIONS if law in frictions]
    if sight.one_speed or sight.never_moves:
        laws = [law for law in laws if law == "power"] or laws[:1]

    near: dict[tuple[str, str], dict[str, float]] = {}

    def tried(kind: str, friction: str) -> Candidate:
        law = CurrentLaw.of(kind, friction, rest_speed, fixed, hysteresis=sight.hysteresis)
        fit = task.fit(law, {**start, **near.get((kinds[0], friction), {})}, sight)
        near[kind, friction] = dict(zip(law.names, fit.values.tolist(), strict=True))
        refused = sight.refused(law, fit)
        if not refused:
            try:
                _parameters(name, law, fit, {}, sight, task)
            except InputError as error:
                refused = error.problem
        held_out = None if refused else task.left_out(law, fit, sight)
        return Candidate(map=kind, friction=friction, held_out=held_out, refused=refused)

    candidates += [tried(kinds[0], friction) for friction in laws]
    friction = _best(candidates, "friction") or laws[0]
    candidates += [tried(kind, friction) for kind in kinds[1:]]
    kind = _best([candidate for candidate in candidates if candidate.friction == friction], "map") or kinds[0]
    if kind != kinds[0]:
        candidates += [tried(kind, other) for other in laws if other != friction]
        with_map = {candidate.friction: candidate for candidate in candidates if candidate.map == kind}
        friction = _best([with_map[law] for law in laws], "friction")
    return kind, friction, near[kind, friction]


def known_names(fixed: Mapping[str, float]) -> set[str]:
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
    law: CurrentLaw,
    fit: RobustFit,
    known: Mapping[str, float],
    sight: Sight,
    task: _Task,
) -> JointParameters:
    """The fit as a joint of a model, which refuses a map that is not monotone over the currents of the fit."""
    values = {**law.fixed, **dict(zip(law.names, fit.values.tolist(), strict=True))}
    errors = dict(zip(law.names, fit.standard_errors.tolist(), strict=True))
    blind = law.map == "blind"
    kind = "linear" if blind else law.map
    parameters: dict[str, Parameter | None] = {}
    for own in (*OF_MAP[kind], *OF_FRICTION[law.friction], *COMMON):
        if own in known:
            parameters[own] = Parameter(known[own])
        elif own in errors:
            parameters[own] = Parameter(values[own], errors[own])
        elif own in COMMON or (own == "B" and blind):
            parameters[own] = None
        else:
            parameters[own] = Parameter(values[own])
    return JointParameters(
        name=name,
        map=kind,  # type: ignore[arg-type]
        friction=law.friction,  # type: ignore[arg-type]
        parameters=parameters,
        current_range=None if blind else _current_range(law, fit, task),
        speed_range=sight.speed_range,
        rest_speed=law.rest_speed,
    )


def _current_range(law: CurrentLaw, fit: RobustFit, task: _Task) -> tuple[float, float] | None:
    """Range of the joint current over the rows of the fit."""
    values = {**law.fixed, **dict(zip(law.names, fit.values.tolist(), strict=True))}
    still = CurrentLaw(law.map, "power", (), {**values, "D": 0.0, "F": 0.0}, law.rest_speed)
    current = still.current(np.empty(0), task.motion)[0]
    low, high = float(current.min()), float(current.max())
    return (low, high) if low < high else None


def _estimated(parameters: JointParameters, task: _Task) -> FloatArray:
    from bumpstop.joint.model import JointTorqueModel

    model = JointTorqueModel(robot="arm", created_from="a recording", unit="A", joints=(parameters,))
    parts = []
    for rows in task.rows.stretches:
        motion = task.motion.rows(rows)
        parts.append(model.torque(task.measured[rows, None], motion.qd[:, None], motion.qdd[:, None])[:, 0])
    return np.concatenate(parts)
