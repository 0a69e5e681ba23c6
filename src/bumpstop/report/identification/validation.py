"""The page of ``bumpstop validate``, and what the page of ``bumpstop identify`` shares with it."""

from __future__ import annotations

from abc import abstractmethod
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.identification.comparison import mean_told, rest_words
from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, paragraph, table
from bumpstop.report.picture import AREA, EVENT, FAINT, LAW, LIMIT, Picture, axes, stack
from bumpstop.report.section import Part
from bumpstop.terminal import counted, number

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bumpstop.arrays import FloatArray
    from bumpstop.identification.comparison import Comparison
    from bumpstop.identification.validation import ContactComparison

_MAX_POINTS = 1500  # more cannot be told apart at a figure's width


class ScoresPart(Part):
    """Table 3.1."""

    title = "Error by joint"
    anchor = "scores"

    def __init__(self, comparison: Comparison, where: str) -> None:
        self._comparison, self._where = comparison, where

    def content(self) -> list[Html]:
        """How to read it, and one row for each joint."""
        rows = [
            (
                score.name,
                *(
                    "rests" if score.rests else f"{x:.4f}" if np.isfinite(x) else "none"
                    for x in (score.r2, score.r2_raw)
                ),
                *(number(x) for x in (mean_told(score), score.sd, score.rmse)),
                unit,
            )
            for score, unit in zip(self._comparison.scores(), self._comparison.units, strict=True)
        ]
        return [
            paragraph(
                f"Predicted minus measured, {self._where} (as Schroeder's table 3.1). R2 is the share of the variance "
                f"that is predicted, both filtered at {self._comparison.filter_hz:g} Hz without delay; beside it "
                "without the filter. Mean, standard deviation and root mean square are of the unfiltered error."
                + (f" {words[0].upper()}{words[1:]}." if (words := rest_words(self._comparison.scores())) else "")
            ),
            table(
                ("joint", "R2", "R2 unfiltered", "mean", "sd", "rmse", "unit"),
                rows,
                caption="Error by joint",
                numbers=True,
            ),
        ]


class _JointsPart(Part):
    """A figure of each joint, and how to read them."""

    text = ""

    def __init__(self, comparison: Comparison) -> None:
        self._comparison = comparison

    def content(self) -> list[Html]:
        """How to read the figures."""
        return [paragraph(self.text)]

    def pictures(self) -> list[Picture]:
        """One for each joint."""
        return [self._picture(j, name) for j, name in enumerate(self._comparison.names)]

    @abstractmethod
    def _picture(self, j: int, name: str) -> Picture:
        """That of joint j, which has this name."""


class OverTimePart(_JointsPart):
    """Measured and predicted over time, with the error, the speed and the acceleration (as figures 3.4 to 3.8)."""

    title = "Measured and predicted"
    anchor = "over-time"
    text = (
        "Upper panel: measured (thin) and predicted (dashed). Below it: predicted minus measured, the joint's speed "
        "and its acceleration. Errors that follow the acceleration point to inertia, errors that follow the sign of "
        "the speed to friction."
    )

    def _picture(self, j: int, name: str) -> Picture:
        found = self._comparison
        unit = found.units[j]

        def draw(figure: Figure) -> None:
            upper, middle, speed, lower = stack(figure, [2.0, 1.0, 0.8, 0.8], left=0.75)
            t = found.t
            upper.plot(*decimate(t, found.measured[:, j]), color=FAINT, linewidth=0.9, label="measured")
            upper.plot(*decimate(t, found.predicted[:, j]), color=LAW, linewidth=1.2, linestyle="--", label="predicted")
            upper.set_ylabel(unit)
            upper.set_title(name)
            upper.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
            middle.axhline(0, color=FAINT, linewidth=0.6)
            middle.plot(*decimate(t, found.error[:, j]), color=LIMIT, linewidth=0.8)
            middle.set_ylabel(f"error, {unit}")
            for panel, motion, way in (
                (speed, found.qd, f"{_way(unit)}/s"),
                (lower, found.qdd, f"{_way(unit)}/s2"),
            ):
                panel.axhline(0, color=FAINT, linewidth=0.6)
                panel.plot(*decimate(t, motion[:, j]), color=EVENT, linewidth=0.8)
                panel.set_ylabel(way)
            lower.set_xlabel("time [s]")

        caption = f"{name} over time."
        alt = f"Measured and predicted {unit} of joint {name} over time, their difference, speed and acceleration."
        return Picture(f"over_time_{j + 1}", alt, caption, draw, height=5.0)


class HistogramPart(_JointsPart):
    """How errors are distributed (as figure 3.9)."""

    title = "Distribution of the error"
    anchor = "histogram"
    text = (
        "The dashed line is a normal distribution with the error's mean and standard deviation. Thresholds of "
        "a detector must hold where the bars reach farther than it."
    )

    def _picture(self, j: int, name: str) -> Picture:
        error, unit = self._comparison.error[:, j], self._comparison.units[j]

        def draw(figure: Figure) -> None:
            panel = axes(figure, left=0.75)
            counts, edges = np.histogram(error, bins=60, density=True)
            panel.bar(edges[:-1], counts, np.diff(edges), align="edge", color=AREA)
            mean, sd = float(error.mean()), max(float(error.std()), 1e-12)
            x = np.linspace(edges[0], edges[-1], 300)
            normal = np.exp(-(((x - mean) / sd) ** 2) / 2) / (sd * np.sqrt(2 * np.pi))
            panel.plot(x, normal, color=LAW, linestyle="--", linewidth=1.3)
            panel.set_yscale("log")
            panel.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
            panel.set_ylim(max(1e-4 * float(normal.max()), 1e-12), 3 * max(float(counts.max()), float(normal.max())))
            panel.set_xlabel(f"predicted minus measured [{unit}]")
            panel.set_ylabel(f"density [1/{unit}]")
            panel.set_title(name)

        alt = f"Histogram of the error of joint {name} on a logarithmic scale, beside a normal distribution."
        return Picture(f"error_{j + 1}", alt, f"{name}: how its error is distributed.", draw, height=2.6)


class WherePart(_JointsPart):
    """Error against speed and acceleration: where the model is weak."""

    title = "Where the model is weak"
    anchor = "where"
    text = (
        "Mean error (dots) and one standard deviation to either side (bars), by the joint's own speed and "
        "acceleration. Bins with fewer than 20 rows are left out. A step at zero speed is friction, a slope "
        "over acceleration is inertia that the model lacks."
    )

    def _picture(self, j: int, name: str) -> Picture:
        found = self._comparison
        unit = found.units[j]
        way = _way(unit)

        def draw(figure: Figure) -> None:
            width, height = figure.get_size_inches()
            panels: list[Axes] = []
            for k, (binned, label) in enumerate(
                ((found.by_speed(j), f"speed [{way}/s]"), (found.by_acceleration(j), f"acceleration [{way}/s2]"))
            ):
                box = ((0.72 + 2.15 * k) / width, 0.48 / height, 1.95 / width, 1 - 0.8 / height)
                panel = figure.add_axes(box, sharey=panels[0] if panels else None)
                panels.append(panel)
                panel.axhline(0, color=FAINT, linewidth=0.6)
                middle = binned.edges.mean(axis=1)
                half = (binned.edges[:, 1] - binned.edges[:, 0]) / 2
                panel.errorbar(
                    middle, binned.mean, yerr=binned.sd, xerr=half, fmt="o", color=LAW, ecolor=FAINT, markersize=3,
                    linewidth=0.9,
                )  # fmt: skip
                panel.set_xlabel(label)
            panels[0].set_ylabel(f"error [{unit}]")
            panels[0].set_title(name)
            panels[1].tick_params(labelleft=False)

        alt = f"Mean and standard deviation of the error of joint {name} by speed and by acceleration."
        return Picture(
            f"error_where_{j + 1}", alt, f"{name}: its error by speed and by acceleration.", draw, height=2.6
        )


class ContactPart(Part):
    """Section 3.2: a measured contact force beside the estimated one."""

    title = "Contact force"
    anchor = "contact"

    def __init__(self, contact: ContactComparison | None, names: Sequence[str], units: Sequence[str]) -> None:
        self._contact, self._names, self._units = contact, names, units

    def applies(self) -> bool:
        """Where a force was measured."""
        return self._contact is not None

    def content(self) -> list[Html]:
        """What was compared, and where it says nothing."""
        found = self._contact
        assert found is not None
        error = found.error[found.judged]
        size = (
            f"Its error is {number(float(np.abs(error).mean()))} N on average and at most "
            f"{number(float(np.abs(error).max()))} N."
            if error.size
            else "No row can be judged."
        )
        return [
            paragraph(
                f"The force that the torque of {self._names[found.joint]} says, if it has the direction of the "
                f"measured one (eqs 3.3 to 3.8). {size} The formula divides by the torque that the measured force has "
                f"at that joint: where this is below {number(found.min_torque)} {self._units[found.joint]} it is "
                f"noise, and {counted(found.not_judged, 'row', 'is')} not judged."
            )
        ]

    def pictures(self) -> list[Picture]:
        """Force, torque and error over time (as figures 3.11 to 3.17)."""
        found = self._contact
        assert found is not None

        def draw(figure: Figure) -> None:
            force, torque, error = stack(figure, [1.5, 1.5, 1.0], left=0.75)
            force.plot(*decimate(found.t, found.force), color=FAINT, linewidth=1.2, label="measured")
            force.plot(found.t, found.estimated, color=LAW, linewidth=1.0, linestyle="--", label="estimated")
            force.set_ylabel("force [N]")
            force.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.1)
            torque.plot(*decimate(found.t, found.torque_expected), color=FAINT, linewidth=1.2)
            torque.plot(*decimate(found.t, found.torque_estimated), color=LAW, linewidth=1.0, linestyle="--")
            for sign in (-1, 1):
                torque.axhline(sign * found.min_torque, color=LIMIT, linestyle=":", linewidth=0.9)
            torque.set_ylabel(f"torque [{self._units[found.joint]}]")
            error.axhline(0, color=FAINT, linewidth=0.6)
            error.plot(found.t, found.error, color=LIMIT, linewidth=0.9)
            error.set_ylabel("error [N]")
            error.set_xlabel("time [s]")

        name = self._names[found.joint]
        caption = f"Contact force and torque by {name}. Dotted: torque below which a row is not judged."
        alt = "Measured and estimated contact force, contact torque of one joint, and force error over time."
        return [Picture("contact", alt, caption, draw, height=4.4)]


class SelectionPart(Part):
    """Models that were tried, by their error on data they were not fitted to."""

    title = "Model selection"
    anchor = "selection"

    def __init__(self, tried: Mapping[str, float], chosen: str, what: str, label: str) -> None:
        self._tried, self._chosen, self._what, self._label = dict(tried), chosen, what, label

    def applies(self) -> bool:
        """Where there was a choice."""
        return len(self._tried) > 1

    def content(self) -> list[Html]:
        """What was chosen and how."""
        return [paragraph(f"{self._what} Chosen: {self._chosen} (filled).")]

    def pictures(self) -> list[Picture]:
        """Held-out error of each."""

        def draw(figure: Figure) -> None:
            panel = axes(figure, left=1.1, bottom=0.5)
            names = list(self._tried)
            colours = [LAW if name == self._chosen else "white" for name in names]
            panel.barh(names, list(self._tried.values()), color=colours, edgecolor=LAW)
            panel.invert_yaxis()
            panel.set_xlabel(self._label)

        alt = "; ".join(f"{name}: {number(value)}" for name, value in self._tried.items())
        return [Picture("selection", alt, self._label, draw, height=0.9 + 0.24 * len(self._tried))]


def write_validation_report(
    comparison: Comparison,
    folder: Path,
    *,
    title: str,
    where: str,
    contact: ContactComparison | None = None,
    selection: Part | None = None,
    parts: Sequence[Part] = (),
    closing: Sequence[Part] = (),
) -> Path:
    """Write ``report.html`` and its figures; returns the page's path.

    Args:
        comparison: what was predicted and measured.
        folder: made where it is missing.
        title: of the page.
        where: on which rows, in words.
        contact: section 3.2, or None.
        selection: how the model was chosen, or None.
        parts: further ones, shown first.
        closing: further ones, shown last.

    Raises:
        InputError: the folder cannot be written.
    """
    everything: list[Part] = [
        *parts,
        ScoresPart(comparison, where),
        OverTimePart(comparison),
        HistogramPart(comparison),
        WherePart(comparison),
        ContactPart(contact, comparison.names, comparison.units),
        *([selection] if selection is not None else []),
        *closing,
    ]
    return write_document(Document(title, "bumpstop: a model and a recording", "model", everything), folder)


def decimate(t: FloatArray, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """A line that looks the same: lowest and highest value of each of many stretches."""
    if t.size <= 2 * _MAX_POINTS:
        return t, x
    begins = np.linspace(0, t.size, _MAX_POINTS + 1).astype(np.int64)[:-1]
    ends = np.stack([np.minimum.reduceat(x, begins), np.maximum.reduceat(x, begins)], axis=1)
    return np.repeat(t[begins], 2), ends.ravel()


def first_few(count: int, most: int) -> np.ndarray:
    """Numbers of at most ``most`` of ``count`` rows, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).astype(np.int64))


def _way(unit: str) -> str:
    """The unit of a joint's way, of that of its torque."""
    return "m" if unit == "N" else "rad"
