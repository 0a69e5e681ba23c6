"""Measurement plans: which shots to take where, what is expected of each, in the order of what they are worth."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import as_whole_number
from bumpstop.collision.evaluation import evaluate
from bumpstop.errors import InputError
from bumpstop.measure.learning.peak_force_ensemble import Condition, PeakForceEnsemble, Surfaces
from bumpstop.measure.learning.posterior import ErrorModel, expected_forces, single_shots
from bumpstop.measure.learning.response_surface import normal_points
from bumpstop.measure.parameters import Parameters
from bumpstop.measure.peak_force_model import shot_force
from bumpstop.measure.planning.design import Belief, greedy_design
from bumpstop.measure.planning.gauge import check_device
from bumpstop.measure.planning.measured_situation import MeasuredSituation, situations_of

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision.scenario.scenario import Scenario

SPEED_SHARES = (0.5, 0.75, 1.0)
REPEATS = 3
SHOTS = 30
POINTS = 128
# Draws from which bands and covariances are taken.
_DRAWS = 2048
BAND = (0.05, 0.95)


@dataclass(frozen=True)
class PlannedShot:
    """One shot of a plan.

    Attributes:
        number: from 1, in the order of the plan.
        situation: name of it.
        speed_mm_s: of the tip [mm/s].
        predicted_N: median peak force of the scenario as it stands [N].
        low_N, high_N: 5 % and 95 % of single shots, over the parameters, the noise and the errors [N].
        distribution_N: 5 % and 95 % of the distribution at the scenario's own values [N].
        spread: of the peak forces of all situations once this shot is known, see :class:`ShotDesign` [1].
    """

    number: int
    situation: str
    speed_mm_s: float
    predicted_N: float
    low_N: float
    high_N: float
    distribution_N: tuple[float, float]
    spread: float


@dataclass(frozen=True, eq=False)
class MeasurementPlan:
    """Shots to take, most instructive first.

    Attributes:
        situations: what is measured.
        parameters: what the shots may tell.
        errors: how far shots may be off.
        shots: in order.
        spread: of the peak forces of all situations before any shot [1].
        seed: of the ensemble.
        points: of the ensemble.
        fixed: keys that are known.
        notes: what a reader should know.
    """

    situations: tuple[MeasuredSituation, ...]
    parameters: Parameters
    errors: ErrorModel
    shots: tuple[PlannedShot, ...]
    spread: float
    seed: int = 0
    points: int = POINTS
    fixed: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    def situation(self, name: str) -> MeasuredSituation:
        """The situation of a name."""
        return next(each for each in self.situations if each.name == name)

    def to_json(self) -> dict[str, Any]:
        """What ``bumpstop measure plan --json`` prints."""
        return {
            "situations": [
                {
                    "name": each.name,
                    "gauge": each.gauge.to_json(),
                    "fixed": each.clamped,
                    "contact_point_mm": (1e3 * each.contact_point).tolist(),
                    "normal": each.normal.tolist(),
                    "joint_positions": each.pose.tolist(),
                    "approach_mm": 1e3 * each.approach,
                    "start_point_mm": (1e3 * each.start_point).tolist(),
                    "contact_onset_s": each.onset_s,
                    "limit_N": each.limit_N if math.isfinite(each.limit_N) else None,
                    "notes": list(each.notes),
                }
                for each in self.situations
            ],
            "parameters": [{"key": each.key, "kind": each.kind, "sd": each.sd} for each in self.parameters.each],
            "shots": [
                {
                    "shot": each.number,
                    "situation": each.situation,
                    "speed_mm_s": each.speed_mm_s,
                    "predicted_peak_force_N": each.predicted_N,
                    "predicted_low_N": each.low_N,
                    "predicted_high_N": each.high_N,
                    "distribution_p5_N": each.distribution_N[0],
                    "distribution_p95_N": each.distribution_N[1],
                    "expected_spread": each.spread,
                }
                for each in self.shots
            ],
            "spread": self.spread,
            "notes": list(self.notes),
        }


def plan_measurements(
    named: Iterable[tuple[str, Scenario]],
    *,
    device: str | None = None,
    speed_shares: Sequence[float] = SPEED_SHARES,
    shots: int | None = None,
    repeats: int = REPEATS,
    spread: Mapping[str, float] | None = None,
    fixed: Sequence[str] = (),
    errors: ErrorModel | None = None,
    points: int = POINTS,
    seed: int = 0,
    progress: Callable[[float], None] | None = None,
) -> MeasurementPlan:
    """Plan the measurement of contact situations.

    Args:
        named: names and scenarios, of one robot.
        device: gauge for all of them; None: that of each body region.
        speed_shares: speeds that are measured, as shares of the situation's.
        shots: how many; None: 30, and at least one for each situation.
        repeats: most shots at one situation and speed.
        spread: of parameters before anything is measured, see :meth:`Parameters.of`.
        fixed: keys that are known, see there.
        errors: how far shots may be off; None: :class:`ErrorModel`.
        points: of the parameters at which peak forces are computed.
        seed: of these points, and of the bands.
        progress: told the share that is done.

    Raises:
        InputError: a situation cannot be measured, no shot would be detected, or an argument is out of range.
    """
    errors = ErrorModel() if errors is None else errors
    as_whole_number(repeats, "repeats", 1, 100)
    as_whole_number(points, "points", 32, 100_000)
    for share in speed_shares:
        if not 0.01 <= share <= 1.0:
            raise InputError("speeds", f"{share:g} cannot be used", "wanted shares of the speed, 0.01 to 1")
    if device is not None:
        check_device(device)
    situations = situations_of(list(named), device)
    parameters = Parameters.of([each.measured for each in situations], spread, fixed=fixed)
    wanted = max(SHOTS, len(situations)) if shots is None else as_whole_number(shots, "shots", 1, 10_000)
    conditions = conditions_of(situations, parameters, speed_shares)
    ensemble = PeakForceEnsemble.of(parameters, conditions, points=points, seed=seed, progress=progress)
    everywhere = ensemble
    ensemble, unseen = everywhere.where_detected()
    notes = everywhere.left_out(unseen)
    surfaces = ensemble.surfaces()
    z = normal_points(_DRAWS, len(parameters), seed + 1)
    belief = Belief(surfaces(z), surfaces, errors, target_weights(ensemble))
    design = greedy_design(
        belief, wanted, repeats=repeats, own_speed=np.array([each.own_speed for each in ensemble.conditions])
    )
    missing = {each.name for each in situations} - {
        ensemble.conditions[c].situation.name for c in design.condition if ensemble.conditions[c].own_speed
    }
    if missing:
        notes.append(
            f"{len(missing)} of {len(situations)} situations are not measured at their own speed: "
            + ", ".join(sorted(missing)[:10])
            + ("." if len(missing) <= 10 else " and others.")
        )
    predicted = _predictions(ensemble, surfaces, errors, z, seed)
    planned = tuple(
        PlannedShot(
            number=number,
            situation=ensemble.conditions[c].situation.name,
            speed_mm_s=ensemble.conditions[c].speed_mm_s,
            predicted_N=predicted[c][0],
            low_N=predicted[c][1],
            high_N=predicted[c][2],
            distribution_N=predicted[c][3],
            spread=float(design.spread[number]),
        )
        for number, c in enumerate(design.condition.tolist(), start=1)
    )
    return MeasurementPlan(
        situations=tuple(situations),
        parameters=parameters,
        errors=errors,
        shots=planned,
        spread=float(design.spread[0]),
        seed=seed,
        points=points,
        fixed=tuple(fixed),
        notes=tuple(notes),
    )


def conditions_of(
    situations: Sequence[MeasuredSituation], parameters: Parameters, speed_shares: Sequence[float]
) -> list[Condition]:
    """Every situation at shares of its speed, its own speed always among them."""
    shares = sorted({*speed_shares, 1.0})
    return [
        Condition.of(situation, share * situation.speed_mm_s, parameters)
        for situation in situations
        for share in shares
    ]


def target_weights(ensemble: PeakForceEnsemble) -> FloatArray:
    """What the variance of each condition's peak force counts (conditions,).

    Only conditions at the speed of their situation count: by the square of the share of the limit that the force takes
    where all have limits, else alike.
    """
    own = np.array([each.own_speed for each in ensemble.conditions], dtype=np.float64)
    limits = np.array([each.situation.limit_N for each in ensemble.conditions])
    if not np.isfinite(limits).all():
        return own
    return np.asarray(own * (np.exp(np.nanmedian(ensemble.log_mean, axis=0)) / limits) ** 2)


def _predictions(
    ensemble: PeakForceEnsemble, surfaces: Surfaces, errors: ErrorModel, z: FloatArray, seed: int
) -> list[tuple[float, float, float, tuple[float, float]]]:
    """Median, low, high and the integrated distribution's 5 % and 95 %, by condition [N]."""
    forces = expected_forces(z, surfaces, errors.model, seed)
    low, high = np.quantile(single_shots(forces, surfaces, errors.gauge, seed + 1), BAND, axis=0)
    found = []
    for c, condition in enumerate(ensemble.conditions):
        if condition.situation.onset_s is not None:
            shot = shot_force(condition.scenario, speed=condition.speed_share)
            p5, p50, p95 = (shot.quantile(p) for p in (BAND[0], 0.5, BAND[1]))
            found.append((p50, min(float(low[c]), p5), max(float(high[c]), p95), (p5, p95)))
            continue
        # The offset of a gauge is any within a feedback period: nobody knows when the next control cycle comes.
        contact = condition.scenario.contact.model_copy(update={"offset_law": "uniform", "offset_mm": None})
        motion = condition.scenario.motion.model_copy(update={"start": "moving"})
        result = evaluate(condition.scenario.model_copy(update={"contact": contact, "motion": motion}))
        p5, p50, p95 = (float(result.peak_force.quantile(p)) for p in (BAND[0], 0.5, BAND[1]))
        found.append((p50, min(float(low[c]), p5), max(float(high[c]), p95), (p5, p95)))
    return found
