"""What measured shots say of a cell: parameters with their spread, peak forces elsewhere, the next best shot."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.errors import InputError
from bumpstop.measure.learning.peak_force_ensemble import Condition, PeakForceEnsemble, Surfaces
from bumpstop.measure.learning.posterior import (
    ErrorModel,
    Posterior,
    expected_forces,
    forces_after,
    interval,
    sample_posterior,
    single_shots,
)
from bumpstop.measure.learning.reading_doubts import far_from_told, reading_doubts
from bumpstop.measure.learning.shots import BadShot, MeasuredShot, is_of
from bumpstop.measure.parameters import LATENCY, Parameters
from bumpstop.measure.planning.design import Belief
from bumpstop.measure.planning.plan import target_weights
from bumpstop.terminal import in_percent

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray

_STRANGE = 0.34  # share of shots outside their central 95 %, of few shots
# A parameter is shown by the shots where they narrow it by at least this.
_SHOWN = 0.7
# Shots that count less than this are named.
_BAD_WEIGHT = 0.35
# Points about the posterior at which the peak forces are computed once more, and rounds of it.
_REFINED, _ROUNDS = 64, 2
# Draws of the posterior at which the polynomials are checked.
_CHECKED = 16
# Fewer draws that count effectively make quantiles that are not to be trusted.
_MIN_EFFECTIVE = 400.0


@dataclass(frozen=True)
class FoundParameter:
    """One parameter after the shots.

    Attributes:
        key: dotted key of the scenarios.
        label: in words.
        kind: ``"factor"`` on what the scenarios say, or ``"shift"`` added to it.
        median, low, high: of the factor [1] or the shift [unit of the key], with the central 95 %.
        sd: of the logarithm of the factor, or of the shift.
        sd_before: the same before anything was measured.
        shown: whether the shots tell it by itself; else it stays assumed, and moves with the others only.
    """

    key: str
    label: str
    kind: str
    median: float
    low: float
    high: float
    sd: float
    sd_before: float
    shown: bool

    def to_json(self) -> dict[str, Any]:
        """By name."""
        return dict(self.__dict__)


@dataclass(frozen=True)
class CalibratedForce:
    """Peak force of one situation at one speed after the shots, as its gauge would show it.

    Attributes:
        situation: name.
        speed_mm_s: of the tip [mm/s].
        shots: how many were measured there.
        before_N: median and central 95 % of the expected peak force before the shots [N].
        expected_N: the same after them.
        single_N: central 95 % of single shots, with their scatter and the gauge's error [N].
        limit_N: force limit of the body region; NaN where there is none.
    """

    situation: str
    speed_mm_s: float
    shots: int
    before_N: tuple[float, float, float]
    expected_N: tuple[float, float, float]
    single_N: tuple[float, float]
    limit_N: float

    def to_json(self) -> dict[str, Any]:
        """By name; a limit that is none is None."""
        found: dict[str, Any] = {
            name: list(value) if isinstance(value, tuple) else value for name, value in self.__dict__.items()
        }
        return found | {"limit_N": self.limit_N if math.isfinite(self.limit_N) else None}


@dataclass(frozen=True)
class NextShot:
    """The shot that is expected to narrow the peak forces of all situations most.

    Attributes:
        situation: name.
        speed_mm_s: of the tip [mm/s].
        spread_now, spread_after: root mean square over the situations of the standard deviation of the logarithm of the
            peak force [1].
    """

    situation: str
    speed_mm_s: float
    spread_now: float
    spread_after: float

    def to_json(self) -> dict[str, Any]:
        """By name."""
        return dict(self.__dict__)


@dataclass(frozen=True, eq=False)
class Calibration:
    """Parameters of a cell after measured shots.

    Attributes:
        parameters: what was varied.
        found: each of them after the shots.
        posterior: the sample.
        ensemble: peak forces that were computed.
        surfaces: polynomials of them about the posterior.
        shots: measured.
        bad_shots: those of them that do not fit the others.
        forces: of every situation and speed.
        next_shot: the best one to take now.
        notes: what a reader should know.
        warnings: why the figures are hardly those of the cell.
    """

    parameters: Parameters
    found: tuple[FoundParameter, ...]
    posterior: Posterior
    ensemble: PeakForceEnsemble
    surfaces: Surfaces
    shots: tuple[MeasuredShot, ...]
    bad_shots: tuple[BadShot, ...]
    forces: tuple[CalibratedForce, ...]
    next_shot: NextShot
    notes: tuple[str, ...]
    warnings: tuple[str, ...] = ()

    @property
    def shown(self) -> tuple[FoundParameter, ...]:
        """Parameters that the shots tell."""
        return tuple(each for each in self.found if each.shown)

    @property
    def assumed(self) -> tuple[FoundParameter, ...]:
        """Parameters that stay as assumed."""
        return tuple(each for each in self.found if not each.shown)

    def to_json(self) -> dict[str, Any]:
        """What ``bumpstop measure calibrate --json`` prints."""
        error = self.posterior.gauge_error
        return {
            "parameters": [each.to_json() for each in self.found],
            "gauge_error": {"median": float(np.median(error)), "interval": list(interval(error))},
            "shots": len(self.shots),
            "bad_shots": [each.to_json() for each in self.bad_shots],
            "forces": [each.to_json() for each in self.forces],
            "next_shot": self.next_shot.to_json(),
            "effective_draws": self.posterior.effective,
            "warnings": list(self.warnings),
            "notes": list(self.notes),
        }


def calibrate(
    ensemble: PeakForceEnsemble,
    shots: Sequence[MeasuredShot],
    *,
    errors: ErrorModel | None = None,
    refine: int = _REFINED,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> Calibration:
    """Learn from measured shots.

    Args:
        ensemble: of the conditions of the shots and of all others that are asked for.
        shots: at least one.
        errors: how far shots may be off; None: :class:`ErrorModel`.
        refine: points about the posterior at which peak forces are computed in each of two rounds; 0: none.
        seed: of the draws.
        progress: told the share of these points that is done.

    Raises:
        InputError: there is no shot, or one of a condition that the ensemble does not have.
    """
    errors = ErrorModel() if errors is None else errors
    if not shots:
        raise InputError("measured_peak_force_N", "no shot is measured", "fill in one row at least")
    columns = np.array([_column(ensemble, shot) for shot in shots], dtype=np.int64)
    measured = np.log([shot.force_N for shot in shots])
    prior = ensemble.surfaces()
    count = len(ensemble.parameters)
    posterior = sample_posterior(prior, columns, measured, errors, parameters=count, seed=seed)
    surfaces = prior
    for number in range(_ROUNDS):
        if refine:
            points = _spread_draws(posterior, refine, seed + number)
            ensemble = ensemble.with_points(points, _part(progress, number))
        surfaces = ensemble.surfaces(posterior.mean, posterior.covariance)
        posterior = sample_posterior(surfaces, columns, measured, errors, parameters=count, seed=seed + 1 + number)
    found = tuple(_found(ensemble.parameters, i, posterior) for i in range(count))
    after = forces_after(posterior, surfaces, columns, measured, errors, seed)
    bad = tuple(
        BadShot(shot, float(np.exp(left)))
        for shot, weight, left in zip(shots, posterior.shot_weight, posterior.shot_residual, strict=True)
        if weight < _BAD_WEIGHT
    )
    forces = _forces(ensemble, prior, surfaces, posterior, columns, after, errors, seed)
    return Calibration(
        parameters=ensemble.parameters,
        found=found,
        posterior=posterior,
        ensemble=ensemble,
        surfaces=surfaces,
        shots=tuple(shots),
        bad_shots=bad,
        forces=forces,
        next_shot=_next_shot(ensemble, surfaces, posterior, after, errors),
        warnings=reading_doubts(
            [forces[column].before_N for column in columns],
            shots,
            ensemble.conditions,
            next(((each.median, each.high) for each in found if each.key == LATENCY), (0.0, 0.0)),
            (errors.gauge, float(np.median(posterior.gauge_error))),
        )
        or far_from_told([each.label for each in found], posterior.mean, posterior.sd),
        notes=(*_notes(found, bad, posterior, surfaces, columns), *_force_notes(forces, shots, ensemble.conditions)),
    )


def _part(progress: Callable[[float], None] | None, number: int) -> Callable[[float], None] | None:
    return None if progress is None else lambda share: progress((number + share) / _ROUNDS)


def _column(ensemble: PeakForceEnsemble, shot: MeasuredShot) -> int:
    for c, condition in enumerate(ensemble.conditions):
        if is_of(condition.situation.name, condition.speed_mm_s, shot):
            return c
    raise InputError(
        f"shot {shot.number}",
        f"{shot.situation!r} at {shot.speed_mm_s:g} mm/s is not among the conditions",
        "give its situation and speed to the ensemble",
    )


def _spread_draws(posterior: Posterior, count: int, seed: int) -> FloatArray:
    """Draws about the posterior, wider than it, that polynomials can be fitted to."""
    random = np.random.default_rng(seed)
    chosen = posterior.z[random.choice(len(posterior.z), count, replace=False)]
    return np.asarray(posterior.mean + 1.5 * (chosen - posterior.mean))


def _found(parameters: Parameters, index: int, posterior: Posterior) -> FoundParameter:
    parameter = parameters.each[index]
    z = posterior.z[:, index]
    values = parameter.sd * z if parameter.kind == "shift" else np.exp(parameter.sd * z)
    low, high = interval(values)
    sd = float(parameter.sd * z.std())
    return FoundParameter(
        key=parameter.key,
        label=parameter.label,
        kind=parameter.kind,
        median=float(np.median(values)),
        low=low,
        high=high,
        sd=sd,
        sd_before=parameter.sd,
        shown=sd < _SHOWN * parameter.sd,
    )


def _forces(
    ensemble: PeakForceEnsemble,
    prior: Surfaces,
    surfaces: Surfaces,
    posterior: Posterior,
    columns: npt.NDArray[np.int64],
    after: FloatArray,
    errors: ErrorModel,
    seed: int,
) -> tuple[CalibratedForce, ...]:
    random = np.random.default_rng(seed)
    before = expected_forces(random.standard_normal(posterior.z.shape), prior, errors.model, seed)
    single = single_shots(after, surfaces, posterior.gauge_error, seed)
    found = []
    for c, condition in enumerate(ensemble.conditions):
        found.append(
            CalibratedForce(
                situation=condition.situation.name,
                speed_mm_s=condition.speed_mm_s,
                shots=int((columns == c).sum()),
                before_N=(float(np.median(before[:, c])), *interval(before[:, c])),
                expected_N=(float(np.median(after[:, c])), *interval(after[:, c])),
                single_N=interval(single[:, c]),
                limit_N=condition.situation.limit_N,
            )
        )
    return tuple(found)


def _next_shot(
    ensemble: PeakForceEnsemble,
    surfaces: Surfaces,
    posterior: Posterior,
    after: FloatArray,
    errors: ErrorModel,
) -> NextShot:
    error = float(np.median(posterior.gauge_error))
    weights = target_weights(ensemble)
    belief = Belief(np.log(after), surfaces, errors, weights, error, with_own_errors=True)
    now = belief.spread
    best = int(np.argmax(belief.gains()))
    belief.shoot(best)
    condition = ensemble.conditions[best]
    return NextShot(condition.situation.name, condition.speed_mm_s, now, belief.spread)


def _notes(
    found: Sequence[FoundParameter],
    bad: Sequence[BadShot],
    posterior: Posterior,
    surfaces: Surfaces,
    columns: npt.NDArray[np.int64],
) -> list[str]:
    notes = []
    assumed = [each.label for each in found if not each.shown]
    if assumed:
        notes.append(
            f"By themselves the shots do not tell: {', '.join(assumed)}. That stays assumed, about the values which, "
            "with the others, give the measured forces."
        )
    notes += map(str, bad)
    if posterior.effective < _MIN_EFFECTIVE:
        notes.append(f"Only {posterior.effective:.0f} draws count effectively: quantiles are uncertain.")
    error = float(surfaces.surface.error[np.unique(columns)].max())
    if error > 0.03:
        notes.append(
            f"Between computed points the peak forces are known to {in_percent(error, 2)}, which is in the spread."
        )
    return notes


def _force_notes(
    forces: Sequence[CalibratedForce], shots: Sequence[MeasuredShot], conditions: Sequence[Condition]
) -> list[str]:
    """What was measured beyond a limit, or beyond what the shots should show even now."""
    notes = []
    for force, condition in zip(forces, conditions, strict=True):
        where = f"{force.situation} at {force.speed_mm_s:.4g} mm/s"
        of = [shot for shot in shots if is_of(force.situation, force.speed_mm_s, shot)]
        here = [shot.force_N for shot in of]
        limit = condition.situation.lasting_limit_N
        pressed = [shot.lasting_N for shot in of if shot.lasting_N > limit]
        if pressed:
            notes.append(
                f"{where}: {len(pressed)} of {len(of)} shots press with more than the limit of {limit:.4g} N after the "
                f"first {FIRST_PHASE_S:g} s, up to {max(pressed):.4g} N."
            )
        over = sum(shot > force.limit_N for shot in here)
        if over:
            notes.append(
                f"{where}: {over} of {len(here)} shots exceed the limit of {force.limit_N:.4g} N, "
                f"up to {max(here):.4g} N."
            )
        low, high = force.single_N
        strange = sum(not low <= shot <= high for shot in here)
        if strange > _STRANGE * len(here):
            notes.append(
                f"{where}: {strange} of {len(here)} shots are outside what single shots should show even now "
                f"({low:.4g} to {high:.4g} N): what is wrong is not among the parameters, or their spread is too small."
            )
    return notes
