"""From a filled plan to a calibration."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.measure.learning.calibration import Calibration, calibrate
from bumpstop.measure.learning.peak_force_ensemble import Condition, PeakForceEnsemble
from bumpstop.measure.learning.pressure_notes import pressure_notes
from bumpstop.measure.learning.shots import MeasuredShot
from bumpstop.measure.parameters import Parameters
from bumpstop.measure.planning.measured_situation import MeasuredSituation
from bumpstop.measure.reading.gauge_reading import GaugeReading, read_gauge

if TYPE_CHECKING:
    from bumpstop.measure.planning.plan_file import PlanFolder
    from bumpstop.measure.reading.gauge_curve import GaugeFormat

_SAME_SPEED = 1e-3


@dataclass(frozen=True, eq=False)
class PlanCalibration:
    """A calibration with what it was made of.

    Attributes:
        calibration: what the shots say.
        situations: of the plan.
        readings: recordings that were read, by row of the table.
        left_out: sentences about shots that were not used, and situations that are never detected.
    """

    calibration: Calibration
    situations: tuple[MeasuredSituation, ...]
    readings: dict[int, GaugeReading]
    left_out: tuple[str, ...]


def calibrate_plan(
    plan: PlanFolder,
    *,
    form: GaugeFormat | None = None,
    seed: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> PlanCalibration:
    """Learn from the measured shots of a plan.

    A shot counts with its measured peak force; where that is empty and the row names a recording, with the recording's.
    A recording whose peak cannot be relied on is left out, and said to be.

    Args:
        plan: of :func:`load_plan`.
        form: of the recordings.
        seed: of the draws; None: the plan's.
        progress: told the share that is done.

    Raises:
        InputError: nothing is measured, or a situation, a recording or a speed cannot be used.
    """
    shots, readings, left_out = _measured(plan, form)
    if not shots:
        problem = f"no shot can be used. {left_out[0]}" if left_out else "no shot is measured"
        raise InputError("measured_peak_force_N", problem, "fill in one row at least")
    situations = [
        MeasuredSituation.of(name, scenario, plan.devices.get(name), onset_s=plan.onsets.get(name))
        for name, scenario in plan.named
    ]
    parameters = Parameters.of([each.measured for each in situations], plan.spread, fixed=plan.fixed)
    conditions = []
    for situation in situations:
        own = situation.speed_mm_s
        asked = {shot.speed_mm_s for shot in plan.shots if shot.situation == situation.name}
        speeds = [speed for speed in sorted(asked) if abs(speed - own) > _SAME_SPEED * own]
        conditions += [Condition.of(situation, speed, parameters) for speed in (*speeds, own)]
    part = 0.5
    ensemble = PeakForceEnsemble.of(
        parameters,
        conditions,
        points=plan.points,
        seed=plan.seed,
        progress=None if progress is None else lambda share: progress(part * share),
    )
    everywhere = ensemble
    ensemble, unseen = everywhere.where_detected()
    left_out += everywhere.left_out(unseen)
    never = {(each.situation.name, each.speed_mm_s) for each in unseen}
    for shot in shots:
        if any(name == shot.situation and math.isclose(speed, shot.speed_mm_s, rel_tol=1e-3) for name, speed in never):
            raise InputError(
                f"shot {shot.number}",
                f"{shot.situation!r} at {shot.speed_mm_s:g} mm/s is never detected by the scenario's detector",
                "correct detector.thresholds_Nm, or leave the shot out",
            )
    found = calibrate(
        ensemble,
        shots,
        errors=plan.errors,
        seed=plan.seed if seed is None else seed,
        progress=None if progress is None else lambda share: progress(part + (1 - part) * share),
    )
    found = replace(found, notes=(*found.notes, *pressure_notes(plan.shots, readings, conditions)))
    return PlanCalibration(found, tuple(situations), readings, tuple(left_out))


def _measured(
    plan: PlanFolder, form: GaugeFormat | None
) -> tuple[list[MeasuredShot], dict[int, GaugeReading], list[str]]:
    shots: list[MeasuredShot] = []
    readings: dict[int, GaugeReading] = {}
    left_out = []
    for row in plan.shots:
        force, number, lasting = row.measured_N, row.shot or row.row, row.lasting_N
        if math.isnan(force) and row.recording:
            reading = read_gauge(plan.folder / row.recording, form)
            readings[row.row] = reading
            if not reading.usable:
                why = " ".join(fault.text for fault in reading.faults if fault.spoils)
                bound = reading.lower_bound_N
                least = "" if math.isnan(bound) else f" The peak is at least {bound:.4g} N."
                left_out.append(
                    f"Shot {number} is left out, its recording {row.recording!r} cannot be relied on: {why}{least}"
                )
                continue
            force, lasting = reading.peak_N, reading.pressing_N
        if not math.isnan(force):
            shots.append(MeasuredShot(row.situation, row.speed_mm_s, force, number, lasting))
    return shots, readings, left_out
