"""The page of a calibration: what measured shots say of a cell."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, bullets, element, paragraph, table
from bumpstop.report.picture import FAINT, INK, LAW, LIMIT, Picture, axes
from bumpstop.report.print_style import print_style
from bumpstop.report.section import Part
from bumpstop.terminal import counted, in_percent, number

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from bumpstop.measure.learning.calibration import CalibratedForce, FoundParameter
    from bumpstop.measure.learning.plan_calibration import PlanCalibration

_MANY = 60


def value_words(found: FoundParameter) -> str:
    """Median and central 95 % of a parameter, and whether it is still assumed."""
    assumed = "" if found.shown else ", still assumed"
    if found.kind == "shift":
        return f"{1e3 * found.median:+.3g} ms [{1e3 * found.low:+.3g}, {1e3 * found.high:+.3g}]{assumed}"
    return f"x {found.median:.3g} [{found.low:.3g}, {found.high:.3g}]{assumed}"


class ForcesPart(Part):
    """Peak forces before and after, beside what was measured."""

    title = "Peak forces"
    anchor = "forces"

    def __init__(self, made: PlanCalibration) -> None:
        self._made = made

    def content(self) -> list[Html]:
        """One row for each situation and speed."""
        made = self._made.calibration
        rows = [
            (
                each.situation,
                number(each.speed_mm_s),
                str(each.shots),
                _interval(each.before_N),
                _interval(each.expected_N),
                f"{number(each.single_N[0])} to {number(each.single_N[1])}",
                number(each.limit_N),
            )
            for each in made.forces
        ]
        headings = (
            *("situation", "speed, mm/s", "shots", "before, N", "expected, N", "single shots, N"),
            "force limit, N",
        )
        best = made.next_shot
        return [
            paragraph(
                "Medians with central 95 % intervals, on the gauge. Expected is the mean of shots at that place and "
                "speed, measured there or not; a single shot scatters about it."
            ),
            table(headings, rows, caption="Peak forces before and after the shots", numbers=True),
            paragraph(
                f"Next best shot: {best.situation} at {number(best.speed_mm_s)} mm/s. It is expected to bring the "
                f"spread of all situations from {in_percent(best.spread_now, 2)} to {in_percent(best.spread_after, 2)}."
            ),
        ]

    def pictures(self) -> list[Picture]:
        """Intervals by situation with the shots."""
        made = self._made.calibration
        forces = made.forces
        if len(forces) > _MANY:
            return []

        def draw(figure: Figure) -> None:
            panel = axes(figure, left=1.7)
            for i, each in enumerate(forces):
                panel.plot(each.before_N[1:], [i, i], color=FAINT, linewidth=1.2)
                panel.plot(each.expected_N[1:], [i, i], color=LAW, linewidth=6, alpha=0.35, solid_capstyle="butt")
                panel.plot([each.expected_N[0]], [i], "|", color=LAW, markersize=10)
                measured = [shot.force_N for shot in made.shots if _of(each, shot.situation, shot.speed_mm_s)]
                panel.plot(measured, [i] * len(measured), ".", color=INK, markersize=4)
                if math.isfinite(each.limit_N):
                    panel.plot([each.limit_N], [i], "D", color=LIMIT, markersize=4)
            labels = [f"{each.situation[:16]} {number(each.speed_mm_s)}" for each in forces]
            panel.set_yticks(range(len(forces)), labels)
            panel.set_ylim(len(forces) - 0.5, -0.5)
            panel.set_xlim(left=0)
            panel.set_xlabel("peak force on the gauge [N]")
            panel.set_title("Before and after the shots")

        caption = (
            "Thin: the 95 % interval before the shots; wide: after them; dots: shots; diamonds: force limits. Names "
            "end in the speed in mm/s."
        )
        alt = "Intervals of peak forces by situation and speed, with measured shots and limits."
        return [Picture("calibrated_forces", alt, caption, draw, height=max(2.2, 0.9 + 0.24 * len(forces)))]


class ParametersPart(Part):
    """What the shots tell of the cell."""

    title = "What the shots tell"
    anchor = "parameters"

    def __init__(self, made: PlanCalibration) -> None:
        self._made = made

    def content(self) -> list[Html]:
        """One row for each parameter."""
        made = self._made.calibration
        rows = [
            (
                each.label,
                element("code", each.key),
                value_words(each),
                f"{100 * (1 - each.sd / each.sd_before):.0f} %" if each.shown else "",
            )
            for each in made.found
        ]
        error = made.posterior.gauge_error
        low, high = np.quantile(error, (0.025, 0.975))
        notes = [*made.warnings, *self._made.left_out, *made.notes]
        return [
            paragraph(
                "Factors on what the scenarios say, and times added to it: medians with central 95 % intervals. The "
                "last column is by how much the shots narrow them. What they do not tell alone "
                "stays assumed, about the value that goes with the others."
            ),
            table(("", "key", "after the shots", "narrowed by"), rows, caption="Parameters of the cell"),
            paragraph(
                f"A single shot is off by {in_percent(float(np.median(error)), 2)} [{in_percent(low, 2)}, "
                f"{in_percent(high, 2)}] beyond its own scatter. "
                f"Posterior sample: {made.posterior.effective:.0f} draws count effectively."
            ),
            *([bullets(notes)] if notes else []),
        ]


def _of(force: CalibratedForce, situation: str, speed: float) -> bool:
    return force.situation == situation and math.isclose(force.speed_mm_s, speed, rel_tol=1e-3)


def _interval(values: tuple[float, float, float]) -> str:
    return f"{number(values[0])} [{number(values[1])}, {number(values[2])}]"


def write_calibration(made: PlanCalibration, folder: Path) -> Path:
    """Write ``report.html`` and its figures; returns the page's path.

    Raises:
        InputError: the folder cannot be written.
    """
    parts: list[Part] = [ForcesPart(made), ParametersPart(made)]
    shots = made.calibration.shots
    hit = len({shot.situation for shot in shots})
    about = f"{counted(len(shots), 'shot')} in {hit} of {counted(len(made.situations), 'situation')}"
    title = "Calibration by measured forces"
    style = print_style(f"{title}, {about}")
    return write_document(Document(title, "bumpstop: measure", "bumpstop measure", parts, about, style), folder)
