"""Measurement plan and results beside predictions."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.report.markup import Html, element, paragraph, table, whole
from bumpstop.report.section import Part
from bumpstop.terminal import as_written, number

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.register.measured import JudgedShot
    from bumpstop.register.shots import Shot


class MeasurementsPart(Part):
    """Every shot: where, how fast, what was expected and what was measured."""

    title = "Measurement plan and results"
    anchor = "measurements"

    def __init__(self, shots: Sequence[JudgedShot], situations: Sequence[str]) -> None:
        self._judged, self._situations = shots, situations

    def content(self) -> list[Html]:
        """A table of shots, and which situations have none."""
        shots = [one.shot for one in self._judged]
        if not shots:
            return [
                paragraph(
                    "No measurement was given. ",
                    element("strong", "None of the situations above has been confirmed on the cell."),
                )
            ]
        made = [shot for shot in shots if shot.measured]
        lost = sum(shot.without_peak for shot in shots)
        # A band that is of another speed, or may be, tells nothing of a shot.
        unknown = ("speed", "not_computed")
        judged = [
            one.shot.in_band and one.finding not in unknown for one in self._judged if one.shot.in_band is not None
        ]
        missing = [name for name in self._situations if name not in {shot.situation for shot in made}]
        found = [
            paragraph(
                f"{len(shots)} {'shot is' if len(shots) == 1 else 'shots are'} planned, {len(made)} "
                f"{'is' if len(made) == 1 else 'are'} measured. {sum(judged)} of {len(judged)} measured "
                f"{'peak with a band lies' if len(judged) == 1 else 'peaks with a band lie'} in it."
            )
        ]
        if lost:
            words = "shot was made and has" if lost == 1 else "shots were made and have"
            found.append(paragraph(element("strong", f"{lost} {words} no peak that can be relied on.")))
        if missing:
            found.append(paragraph("Without a measured shot: ", ", ".join(missing), "."))
        with_pressure = any(math.isfinite(pressure) for shot in shots for pressure in shot.pressures_N_cm2)
        pressure = ("pressure, N/cm²",) if with_pressure else ()
        headings = ("situation", "shot", "speed, mm/s", "predicted, N", "band, N", "measured, N", *pressure, "")
        rows = [_row(one, with_pressure) for one in self._judged]
        return [*found, table(headings, rows, caption="Shots of the force gauge")]


def _row(judged: JudgedShot, with_pressure: bool) -> tuple[str, ...]:
    shot, word = judged.shot, judged.words
    band = (
        ""
        if math.isnan(shot.low_N) or math.isnan(shot.high_N)
        else f"{as_written(shot.low_N)} to {as_written(shot.high_N)}"
    )
    return (
        shot.situation,
        shot.shot,
        whole(number(shot.speed_mm_s)),
        "" if math.isnan(shot.predicted_N) else whole(number(shot.predicted_N)),
        whole(band) if band else "",
        whole(_measured(shot)),
        *([whole(_pressure(shot))] if with_pressure else []),
        element("strong", word) if judged.reason or judged.finding == "below" else word,
    )


def _measured(shot: Shot) -> str:
    known = []
    if shot.measured:
        known.append(as_written(shot.measured_N))
    elif math.isfinite(shot.lower_bound_N):
        known.append(f"at least {as_written(shot.lower_bound_N)}")
    # What is left below the peak is no news.
    if math.isfinite(shot.lasting_N) and not shot.lasting_N <= shot.measured_N:
        known.append(f"{as_written(shot.lasting_N)} after {FIRST_PHASE_S:g} s")
    return ", ".join(known)


def _pressure(shot: Shot) -> str:
    first, lasting = shot.pressures_N_cm2
    known = [as_written(first)] if math.isfinite(first) else []
    if math.isfinite(lasting) and not lasting <= first:
        known.append(f"{as_written(lasting)} after {FIRST_PHASE_S:g} s")
    return ", ".join(known)
