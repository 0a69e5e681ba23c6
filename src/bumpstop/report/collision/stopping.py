"""The page of ``bumpstop stopping``."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError
from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, bullets, element, paragraph, table
from bumpstop.report.picture import EVENT, FAINT, INK, LAW, LIMIT, Picture, axes
from bumpstop.report.section import Part
from bumpstop.terminal import counted, in_percent, number

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from bumpstop.collision.stopping import StoppingFit

# One line and one colour for each law, told apart in grey as well.
_LINES = {
    "constant_time": ("-", LAW),
    "constant": ("--", LIMIT),
    "ramp": ("-.", EVENT),
    "power": (":", FAINT),
}


class LawPart(Part):
    """Which law, how well each fits, and the numbers by joint."""

    title = "How the arm slows down"
    anchor = "law"

    def __init__(self, fit: StoppingFit) -> None:
        self._fit = fit

    def content(self) -> list[Html]:
        """The comparison of the laws, and the numbers of the one chosen."""
        fit = self._fit
        rows = [
            (
                ("→ " if name == fit.law else "") + name,
                one.law.formula,
                in_percent(one.median_error, 2),
                in_percent(one.worst_error, 2),
            )
            for name, one in fit.fits.items()
        ]
        return [
            paragraph(
                "Each law is fitted to the distances of every joint, with one scale for each combination of payload "
                "and extension. Errors are those of rows left out of the fit: measured over predicted distance, "
                "minus 1. Of laws that do equally well the one with the fewest numbers counts."
            ),
            table(("law", "distance", "median error", "worst"), rows, caption="Laws of slowing down", numbers=True),
            table(*fit.numbers_by_joint(), caption=f"Numbers of {fit.law}, and the exponent", numbers=True),
            *([bullets(fit.notes)] if fit.notes else []),
        ]

    def pictures(self) -> list[Picture]:
        """One for each joint."""
        return [self._picture(k) for k in range(len(self._fit.table.joints))]

    def _picture(self, k: int) -> Picture:
        fit, stops = self._fit, self._fit.table
        (angle, to_angle), (rate, to_rate) = stops.distance_unit, stops.speed_unit
        name = stops.joint_name(k)

        def draw(figure: Figure) -> None:
            panel = axes(figure)
            known = stops.known[:, k]
            fastest = float(stops.speed[known, k].max())
            v = np.linspace(1e-3, 1.05, 200) * fastest
            for law, one in fit.fits.items():
                mean = np.exp(np.log(one.scale[k]).mean())
                style, colour = _LINES[law]
                curve = one.law.distance(v, np.full_like(v, mean), one.shape[k])
                wide = 2.2 if law == fit.law else 1.1
                panel.plot(v * to_rate, curve * to_angle, style, color=colour, linewidth=wide, label=law)
            panel.plot(
                stops.speed[known, k] * to_rate, stops.distance[known, k] * to_angle, "o", color=INK, markersize=3.5
            )
            panel.set_xlim(left=0)
            panel.set_ylim(bottom=0)
            panel.set_xlabel(f"speed at the beginning of the stop [{rate}]")
            panel.set_ylabel(f"distance [{angle}]")
            panel.set_title(name)
            panel.legend(loc="upper left", fontsize=8)

        alt = f"Stopping distance of {name} over speed: rows of the table as dots, fitted laws as lines."
        caption = f"{name}: rows of the table, and the laws at the mean scale. The bold line is {fit.law}."
        return Picture(f"stopping_{stops.joints[k]}", alt, caption, draw)


class ReactionPart(Part):
    """What a scenario takes of it."""

    title = "For a scenario"
    anchor = "reaction"

    def __init__(self, fit: StoppingFit) -> None:
        self._fit = fit

    def content(self) -> list[Html]:
        """The table ``[reaction]``, or why there is none."""
        try:
            text = self._fit.reaction_toml
        except InputError as error:
            return [paragraph(f"There is none: {error}.")]
        return [
            paragraph("The numbers cover every row: no joint of the table stops farther than they say."),
            element("pre", text),
        ]


class RowsPart(Part):
    """The distances, beside those of the fitted law."""

    title = "The table"
    anchor = "rows"

    def __init__(self, fit: StoppingFit) -> None:
        self._fit = fit

    def content(self) -> list[Html]:
        """One row for each of the table's."""
        fit, stops = self._fit, self._fit.table
        (angle, to_angle), (rate, to_rate) = stops.distance_unit, stops.speed_unit
        errors = fit.fits[fit.law].errors
        unit = "kg" if stops.payload_unit == "kg" else "%"
        headings = ["row", f"payload, {unit}", "extension, %", f"speed, {rate}"]
        for k in range(len(stops.joints)):
            headings += [f"{stops.joint_name(k)}, {angle}", "error"]
        rows = []
        for i, row in enumerate(stops.row):
            payload = stops.payload[i] * (1 if unit == "kg" else 100)
            cells = [str(row), number(payload), number(100 * stops.extension[i])]
            speeds = [number(v * to_rate) for v in stops.speed[i]]
            # One where all joints have it; else one for each, also where some have the same.
            cells.append(speeds[0] if len(set(speeds)) == 1 else " ".join(speeds))
            for k in range(len(stops.joints)):
                cells += [number(stops.distance[i, k] * to_angle), in_percent(errors[i, k], 2)]
            rows.append(cells)
        caption = f"Distances of {stops.source}, and their leave-one-out errors with {fit.law}"
        return [table(headings, rows, caption=caption, numbers=True)]


def write_stopping(fit: StoppingFit, folder: Path) -> Path:
    """Write ``report.html`` and its figures; returns the page's path.

    Raises:
        InputError: the folder cannot be written.
    """
    parts: list[Part] = [LawPart(fit), ReactionPart(fit), RowsPart(fit)]
    about = f"{counted(len(fit.table.row), 'row')} of {fit.table.source}"
    return write_document(Document("Stopping distances", "bumpstop: stopping", "stopping", parts, about), folder)
