"""The page of a workspace study."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision.probability_text import percent
from bumpstop.report.markup import Html, paragraph, table
from bumpstop.report.picture import EVENT, FAINT, INK, LAW, LIMIT, Picture, axes
from bumpstop.report.section import Part
from bumpstop.study.workspace.workspace_summary import MAP_CELLS, mode_text, mostly_hit, worst_risk
from bumpstop.terminal import NONE, correlation, number

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.figure import Figure

    from bumpstop.study.workspace.workspace import WorkspaceStudy

_SLICES = 4
# More dots than this hide each other and make a page of many megabytes.
_MAX_DOTS = 3000


def pages_of(
    study: WorkspaceStudy, rows: pl.DataFrame, summary: dict[str, Any]
) -> tuple[str, list[Part], Sequence[str]]:
    """Title, parts and notes of the page."""
    known = rows.filter(rows["end"] != "singular_start")
    parts: list[Part] = [CountsPart(study, summary)]
    if known.height:
        # The picture first: where it hits how hard.
        parts = [SlicesPart(study, known), *parts, ForcePart(study, summary, known)]
        parts.append(SensitivityPart(study, summary, known))
    directions = {
        "sphere": "Directions are even over the sphere.",
        "polar": "Directions are even in polar angle and azimuth, as in Schroeder (2013): they crowd at the poles.",
        "scenario": "All motions have the scenario's direction.",
    }
    limits = {
        "respect": "A joint limit ends a motion.",
        "ignore": "The arm moves on beyond its joint limits, as Schroeder's simulator did; poses lie inside them.",
    }
    rates = {
        "respect": "Where a joint would turn faster than it can, the arm gets slower.",
        "ignore": "Joints turn as fast as the line asks for, as Schroeder's did, beyond their velocity limits too.",
    }
    damping = study.scenario.motion.damping
    notes = [
        directions[study.directions],
        limits[study.joint_limits],
        rates[study.velocity_limits],
        f"Joint rates are damped near singularities ({damping:g})."
        if damping
        else "Joint rates are exact: a singularity ends a motion.",
        f"Poses in which links of radius {study.link_radius_mm:g} mm touch are left out."
        if study.link_radius_mm
        else "Self-collision is not looked for.",
        "Collisions never detected count as over every limit, unless the arm comes to rest before that.",
    ]
    return "How hard it hits, everywhere", parts, notes


class CountsPart(Part):
    """Shares over the limits, and what no distribution covers."""

    title = "What was found"
    anchor = "found"

    def __init__(self, study: WorkspaceStudy, summary: dict[str, Any]) -> None:
        self._study = study
        self._summary = summary

    def content(self) -> list[Html]:
        """One table, nothing left out."""
        s = self._summary
        rows = [
            ("force distributions", str(s["laws"])),
            ("poses that start at a singularity, without a distribution", str(s["singular_starts"])),
        ]
        if s["self_collisions"]["looked_for"]:
            rows.append(("poses discarded for self-collision", str(s["self_collisions"]["poses_discarded"])))
        if s["laws"]:
            rows.append(("motions that never touch anything, and say nothing about safety", str(s["never_touch"])))
            for name, limit in zip(("force", "pressure"), s["limits"].values(), strict=False):
                rows.append(
                    (f"P(over the {name} limit, {limit:g} N), all poses and directions", _share(s[f"p_over_{name}"]))
                )
                if s["never_touch"]:
                    of_touching = _share(s[f"p_over_{name}_of_touching"])
                    rows.append((f"the same of the {s['laws'] - s['never_touch']} motions that touch", of_touching))
            if s["limits"]:
                rows.append(("the same of the force limit, or nothing is hit",
                             _share(s["p_over_force_or_no_contact"])))  # fmt: skip
                risk = percent(s["accepted_risk"])
                rows.append(
                    (f"poses that exceed a limit with more than the accepted {risk}", str(s["poses_over_risk"]))
                )
            rows += [
                ("P(never detected)", _share(s["undetected"])),
                ("poses more often undetected than not", str(s["poses_more_often_undetected"])),
                ("P(nothing is hit)", _share(s["nothing_hit"])),
                ("P(neither contact nor alarm by the end of the motion)", _share(s["no_contact"])),
                ("P(false alarm before contact)", _share(s["false_alarm"])),
                ("median of the median forces", f"{number(s['median_force_N']['median'])} N"),
                ("poses whose median force is unbounded", str(s["median_force_N"]["unbounded"])),
            ]
        words = {
            "motion_end": "the simulated time",
            "joint_limit": "a joint limit",
            "singularity": "a singularity on the way",
            "all_detected": "detection, which was certain",
            "singular_start": "a singularity at the start",
        }
        rows += [(f"motions ended by {words[end]}", str(count)) for end, count in s["ends"].items()]
        note = [] if s["limits"] else [paragraph("No body region is named, so there is no limit to judge by.")]
        return [*note, table(("", ""), rows, caption="Means over poses, with the standard error of their spread")]


def _part(share: float) -> str:
    return percent(share) if math.isfinite(share) else NONE


def _share(found: dict[str, float] | None) -> str:
    if found is None:
        return NONE
    return f"{percent(found['mean'], integrated=True)} (standard error {percent(found['standard_error'])})"


class ForcePart(Part):
    """The distribution of the peak force, and of the speed it came from."""

    title = "Force distribution"
    anchor = "force"

    def __init__(self, study: WorkspaceStudy, summary: dict[str, Any], known: pl.DataFrame) -> None:
        self._study = study
        self._summary = summary
        components = [known[f"velocity_{axis}_m_s"].to_numpy() for axis in "xyz"]
        self._speed = 1e3 * np.sqrt(sum(v**2 for v in components))

    def content(self) -> list[Html]:
        """The two modes, and why shares differ from Schroeder's."""
        found = self._summary["distribution"]
        collisions, medians = (
            mode_text(found[f"mode_of_{name}_N"], found["edges_N"]) for name in ("collisions", "medians")
        )
        parts = [
            paragraph(
                f"Most common peak force of all collisions: {collisions}; of the poses' medians: {medians}. Cases in "
                "which nothing is hit are left out "
                f"({percent(self._summary['nothing_hit']['mean'], integrated=True)} of all). The last bin holds "
                "everything beyond, undetected collisions among it unless the arm comes to rest before that."
            ),
        ]
        scenario = self._study.scenario
        if (scenario.robot, scenario.contact.limits, scenario.contact.body) == ("sia5d", "bgia2011", "hand_finger"):
            parts.append(
                paragraph(
                    "Schroeder (2013) states less than 9 % over 135 N for a hand. That share hangs on the joint "
                    "acceleration, which Schroeder (2013) reads from a file it does not print, on its distribution of "
                    "directions, and on its inverse with a singular-value tolerance of 1e-7, which moves on where an "
                    "exact motion ends."
                )
            )
        return parts

    def pictures(self) -> list[Picture]:
        """Force (figure 6.9) and, where it varies, speed (figure 6.8)."""
        pictures = [
            Picture(
                "force_distribution",
                "Histogram of the peak force over poses and directions.",
                "Expected share of collisions (line) and share of poses by their median force (bars).",
                self._draw,
            )
        ]
        if self._study.speed_sd_mm_s:
            pictures.append(
                Picture(
                    "speed_distribution",
                    "Histogram of the tip's speed.",
                    "Speed of the tip over the poses.",
                    self._draw_speed,
                )
            )
        return pictures

    def _draw(self, figure: Figure) -> None:
        found = self._summary["distribution"]
        edges = np.asarray(found["edges_N"])
        drawn = np.append(edges, edges[-1] + edges[1])
        panel = axes(figure, right=1.8)
        medians, collisions = np.asarray(found["poses_by_median"]), np.asarray(found["collisions"])
        panel.stairs(100 * medians / medians.sum(), drawn, fill=True, color=LAW, alpha=0.35, label="poses by median")
        panel.stairs(100 * collisions / collisions.sum(), drawn, color=INK, linewidth=1.3, label="collisions")
        for name, limit in zip(("force limit", "pressure limit"), self._summary["limits"].values(), strict=False):
            line, label = "--" if name == "force limit" else ":", f"{name},\n{limit:g} N"
            if limit > edges[-1]:
                panel.plot([], [], linestyle=line, color=LIMIT, label=f"{label}: beyond")
            else:
                panel.axvline(limit, color=LIMIT, linestyle=line, label=label)
        panel.set_xlabel(f"peak force [N], in the last bin {edges[-1]:g} N and more")
        panel.set_ylabel("share [%]")
        panel.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), frameon=False)

    def _draw_speed(self, figure: Figure) -> None:
        panel = axes(figure)
        panel.hist(
            self._speed, bins=30, color=LAW, alpha=0.5, weights=np.full(self._speed.size, 100 / self._speed.size)
        )
        panel.set_xlabel("speed [mm/s]")
        panel.set_ylabel("share of poses [%]")


class SlicesPart(Part):
    """Where in the workspace the unsafe points are."""

    title = "Where it is unsafe"
    anchor = "slices"

    def __init__(self, study: WorkspaceStudy, known: pl.DataFrame) -> None:
        self._study = study
        self._tip = known.select("tip_x_m", "tip_y_m", "tip_z_m").to_numpy()
        self._worst = worst_risk(known)
        self._hits = mostly_hit(known)

    def applies(self) -> bool:
        """There are limits."""
        return not np.isnan(self._worst).all()

    def content(self) -> list[Html]:
        """How to read the slices."""
        text = (
            "Slices of the workspace by the height of the tip at the start, with equally many points each. A point is "
            "a pose with one direction: neighbours may differ because their directions do."
        )
        cut = self._tip.shape[0] > _MAX_DOTS
        more = f" Drawn: the first {_MAX_DOTS} of {self._tip.shape[0]}; all are in the rows." if cut else ""
        return [paragraph(text + more)]

    def pictures(self) -> list[Picture]:
        """One with all slices (figure 6.10)."""
        return [
            Picture(
                "slices",
                "Tip positions in slices of height, marked by the probability of exceeding a limit.",
                "Blue dots: within the accepted risk; green circles: more; orange crosses: over a limit in more than "
                "half of all collisions; grey plus signs: in most cases nothing is hit, no word about safety.",
                self._draw,
                height=5.4,
            )
        ]

    def _draw(self, figure: Figure) -> None:
        tip, worst, hits = self._tip[:_MAX_DOTS], self._worst[:_MAX_DOTS], self._hits[:_MAX_DOTS]
        edges = np.quantile(tip[:, 2], np.linspace(0, 1, _SLICES + 1))
        reach = 1.05 * float(np.abs(tip[:, :2]).max())
        risk = self._study.scenario.verdict.accepted_probability
        panels = figure.subplots(2, 2, sharex=True, sharey=True)
        figure.subplots_adjust(left=0.15, right=0.98, bottom=0.09, top=0.95, hspace=0.2, wspace=0.08)
        looks: tuple[tuple[Any, dict[str, Any]], ...] = (
            ((worst <= risk) & ~hits, {"marker": "+", "s": 12, "color": FAINT, "linewidths": 0.7}),
            ((worst <= risk) & hits, {"marker": ".", "s": 6, "color": LAW, "linewidths": 0}),
            ((worst > risk) & (worst <= 0.5), {"marker": "o", "s": 9, "facecolors": "none", "edgecolors": EVENT,
                                               "linewidths": 0.7}),
            (worst > 0.5, {"marker": "x", "s": 11, "color": LIMIT, "linewidths": 0.9}),
        )  # fmt: skip
        for i, panel in enumerate(panels.flat):
            upper = tip[:, 2] <= edges[i + 1] if i == _SLICES - 1 else tip[:, 2] < edges[i + 1]
            here = (tip[:, 2] >= edges[i]) & upper
            for chosen, look in looks:
                panel.scatter(*tip[here & chosen, :2].T, **look)
            panel.set_title(f"{edges[i]:.2f} to {edges[i + 1]:.2f} m high", fontsize=9)
            panel.set_aspect("equal")
            panel.set_xlim(-reach, reach)
            panel.set_ylim(-reach, reach)
        for panel in panels[1]:
            panel.set_xlabel("x [m]")
        for panel in panels[:, 0]:
            panel.set_ylabel("y [m]")


class SensitivityPart(Part):
    """Force against condition number and smallest singular value."""

    title = "Can the Jacobian predict it?"
    anchor = "sensitivity"

    def __init__(self, study: WorkspaceStudy, summary: dict[str, Any], known: pl.DataFrame) -> None:
        self._study = study
        self._correlation = summary["rank_correlation_with_median_force"]
        self._predictors: dict[str, dict[str, float]] = summary.get("predictors", {})
        self._trusted = summary.get("trusted", 0)
        self._known = known

    def content(self) -> list[Html]:
        """Rank correlations, and which Jacobian."""
        rows = [(name.replace("_", " "), correlation(value)) for name, value in self._correlation.items()]
        return [
            paragraph(
                "Both are of the Jacobian of the joints that move, at the start pose. Three rows are the tip's "
                "translation, in one unit. Six rows mix translation and rotation, as Schroeder (2013) does; they "
                "depend on the unit of length, here metres. A value near 0 predicts nothing, near 1 or -1 the order of "
                "the forces. Neither knows thresholds nor the direction of the contact."
            ),
            table(("of the median force with the", "rank correlation"), rows, caption="Rank correlation", numbers=True),
            *self._predicted(),
        ]

    def _predicted(self) -> list[Html]:
        """How well each predictor tells unsafe poses from safe ones."""
        if not self._predictors:
            return []
        rows = [
            (
                name.replace("_", " "),
                correlation(found["rank_correlation"]),
                _part(found["unsafe_missed"]),
                _part(found["safe_refused"]),
            )
            for name, found in self._predictors.items()
        ]
        return [
            paragraph(
                f"A force predicted from the pose knows thresholds, noise and braking. The formula holds for "
                f"{self._trusted} of {self._known.height} poses; elsewhere it is unbounded and the pose counts as "
                "refused. The worst direction is that of the largest force that stays undetected at the pose. The "
                "bound refuses what it says exceeds a limit; every other predictor is cut where it errs least, with "
                "all distributions known."
            ),
            table(
                ("predictor", "rank correlation", "unsafe poses missed", "safe poses rejected"),
                rows,
                caption="Predictors of unsafe poses",
                numbers=True,
            ),
        ]

    def pictures(self) -> list[Picture]:
        """Two frequency maps (figures 6.12 and 6.13)."""
        about = (
            ("condition_number_six_rows", "condition number, six rows", "condition_map"),
            ("smallest_singular_value_six_rows", "smallest singular value, six rows", "singular_value_map"),
            ("condition_number", "condition number, three rows", "condition_map_three_rows"),
            ("smallest_singular_value", "smallest singular value, three rows [m]", "singular_value_map_three_rows"),
        )
        return [
            Picture(
                name,
                f"Frequency map of the median peak force and the {label}.",
                f"Poses by {label} and median peak force; the numbers are poses. The top row holds everything beyond.",
                lambda figure, column=column, label=label: self._draw(figure, column, label),  # type: ignore[misc]
                height=3.8,
            )
            for column, label, name in about
        ]

    def _draw(self, figure: Figure, column: str, label: str) -> None:
        panel = axes(figure, right=0.25)
        x = self._known[column].to_numpy()
        edges = self._study.edges
        force_edges = np.append(np.linspace(0, edges[-1], MAP_CELLS), np.inf)
        log = column.startswith("condition")
        usable = np.isfinite(x) & (x > 0)
        # Ends at percentiles: a single pose at a singularity would stretch the scale over everything.
        low, high = np.percentile(x[usable], [0.0 if log else 0.5, 98.0])
        # Of a single pose both are one number, and cells need a width.
        ends = np.geomspace(low, max(high, 1.1 * low), MAP_CELLS + 1) if log else np.linspace(0, high, MAP_CELLS + 1)
        placed = np.clip(x, ends[0], ends[-1])
        force = np.minimum(self._known["p50_N"].to_numpy(), 1e300)
        counts = np.histogram2d(placed, force, bins=[ends, force_edges])[0]
        size = max(1.0, float(counts.max()))
        shade = np.sqrt(np.where(counts.T > 0, counts.T, np.nan))
        panel.pcolormesh(
            np.arange(MAP_CELLS + 1), np.arange(MAP_CELLS + 1), shade, cmap="cividis_r", vmin=0,
            vmax=math.sqrt(size),
        )  # fmt: skip
        for i in range(MAP_CELLS):
            for j in range(MAP_CELLS):
                if counts[i, j]:
                    dark = counts[i, j] > 0.35 * size
                    panel.text(i + 0.5, j + 0.5, f"{counts[i, j]:.0f}", ha="center", va="center",
                               fontsize=5.5, color="white" if dark else INK)  # fmt: skip
        shown = range(0, MAP_CELLS + 1, 2)
        panel.set_xticks(list(shown), [f"{float(f'{ends[i]:.2g}'):.7g}" for i in shown])
        panel.set_yticks(list(shown)[:-1], [f"{force_edges[i]:.0f}" for i in list(shown)[:-1]])
        panel.set_xlabel(label)
        panel.set_ylabel("median peak force [N]")
        panel.tick_params(color=FAINT)
