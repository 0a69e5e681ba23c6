"""What a calibration says of pressures: those beyond a limit, and those that do not count."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING

from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.measure.learning.shots import is_of
from bumpstop.rounding import to_decimals
from bumpstop.terminal import as_written

if TYPE_CHECKING:
    from bumpstop.measure.learning.peak_force_ensemble import Condition
    from bumpstop.measure.planning.filled_shots import FilledShot
    from bumpstop.measure.reading.gauge_reading import GaugeReading


def pressure_notes(
    shots: Sequence[FilledShot], readings: Mapping[int, GaugeReading], conditions: Iterable[Condition]
) -> list[str]:
    """Sentences about all shots that have a pressure, with a force that can be relied on or without.

    Args:
        shots: rows of a plan.
        readings: of their recordings, by number of the row.
        conditions: situations and speeds.
    """
    filled = [shot.with_reading(readings.get(shot.row)) for shot in shots]
    notes = []
    for condition in conditions:
        situation, speed = condition.situation, condition.speed_mm_s
        here = [shot for shot in filled if is_of(situation.name, speed, shot)]
        for limit, values, when in (
            (situation.pressure_limit_N_cm2, [shot.pressure_N_cm2 for shot in here], ""),
            (
                situation.lasting_pressure_limit_N_cm2,
                [shot.lasting_pressure_N_cm2 for shot in here],
                f" after the first {FIRST_PHASE_S:g} s",
            ),
        ):
            known = [value for value in values if math.isfinite(value)]
            over = [value for value in known if value > limit]
            if over:
                most = as_written(to_decimals(max(over), 2, up=True))
                notes.append(
                    f"{situation.name} at {speed:.4g} mm/s: {len(over)} of {len(known)} shots show more pressure than "
                    f"the limit of {as_written(limit)} N/cm²{when}, up to {most} N/cm²."
                )
    for shot in shots:
        reading = readings.get(shot.row)
        if reading is not None and reading.peak_pressure_N_cm2 > 0 and math.isnan(reading.pressure_N_cm2):
            why = " ".join(fault.text for fault in reading.faults if fault.spoils or fault.name == "wrong_unit")
            notes.append(f"The pressure of shot {shot.shot or shot.row} is left out: {why}")
    return notes
