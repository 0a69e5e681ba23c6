"""The part of a page that shows speed limits: safe speeds along a trajectory, or over the workspace."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.report.markup import Html, paragraph, table
from bumpstop.report.picture import AREA, EVENT, FAINT, LAW, LIMIT, Picture, axes
from bumpstop.report.section import Part
from bumpstop.study.answer_warnings import FAILS_WITH_FINER_STEPS
from bumpstop.terminal import no_more_than

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.figure import Figure

# Quarters of the poses, slowest first: colour and marker.
_GROUPS = ((LIMIT, "v"), ("#E69F00", "s"), (AREA, "D"), (LAW, "o"))
_COUNTED = {
    "risk": "the integrated distribution",
    "joint_rates": "joints that turn more than on a straight line",
    "max_speed": "the highest speed looked at",
    "nothing_safe": "no speed is safe",
    "singularity": "the trajectory's own force distribution near a singularity, where no straight line can be followed",
}


class TrajectorySpeedLimitsPart(Part):
    """Speed and its limit over the waypoints, before and after slowing down."""

    title = "Safe speed along the trajectory"
    anchor = "trajectory"

    def __init__(self, rows: pl.DataFrame, summary: dict[str, Any], retimed: Any = None) -> None:
        self._rows, self._summary, self._retimed = rows, summary, retimed

    def content(self) -> list[Html]:
        """The verdicts of both motions, what re-timing costs, and what limits how many waypoints."""
        found, rows = self._summary, self._rows
        between = found["moments_between"]
        text = (
            f"{found['over']} of {found['waypoints']} waypoints are passed faster than is safe"
            + (f", and so are {found['over_between']} of {between} moments between them" if between else "")
            + ". The lowest limit is "
            f"{no_more_than(found['lowest_limit_mm_s'])} mm/s, at waypoint {found['lowest_at_waypoint']} "
            f"({found['lowest_at_s']:.4g} s)."
        )
        counts = [
            (what, str((rows["limited_by"] == name).sum()))
            for name, what in _COUNTED.items()
            if (rows["limited_by"] == name).any()
        ]
        return [
            table(("motion", "duration", "verdict", "because"), _judged(found), caption="Verdicts of evaluate"),
            paragraph(text),
            *(
                [paragraph(f"Speeds among these are {FAILS_WITH_FINER_STEPS}.")]
                if found["fails_with_finer_steps"]
                else []
            ),
            paragraph(f"A limit holds in these directions: {found['directions']}."),
            table(("limited by", "moments" if between else "waypoints"), counts, caption="What limits the speed"),
        ]

    def pictures(self) -> list[Picture]:
        """Speed and limit over time."""
        return [
            Picture(
                "speed_limits",
                "Speed of the tip and its safe limit over the time of the trajectory.",
                "Speed of the tip as programmed, the highest safe speed, and the speed after slowing down, at the "
                "waypoints and moments between them that were looked at.",
                self._draw,
            )
        ]

    def _draw(self, figure: Figure) -> None:
        plot, rows = axes(figure), self._rows
        t, speed, limit = (rows[name].to_numpy() for name in ("t_s", "speed_mm_s", "limit_mm_s"))
        plot.fill_between(t, speed, limit, where=speed > limit, color=LIMIT, alpha=0.25, hatch="///", linewidth=0)
        plot.plot(t, limit, color=LIMIT, linestyle="--", label="highest safe speed")
        plot.plot(t, speed, color=LAW, label="as programmed")
        if self._retimed is not None:
            plot.plot(t, self._retimed, color=EVENT, linestyle=":", linewidth=2.4, label="slowed down")
        top = max(float(speed.max()), float(np.median(limit)))
        plot.set(
            xlabel="time as programmed [s]", ylabel="speed of the tip [mm/s]", ylim=(0, 1.35 * top), xlim=(t[0], t[-1])
        )
        plot.legend(
            loc="upper right",
            ncols=3,
            fontsize=8,
            frameon=True,
            facecolor="white",
            edgecolor="none",
        )


def _judged(found: dict[str, Any]) -> list[tuple[str, str, str, str]]:
    """Durations and verdicts, as given and slowed down."""

    def row(name: str, seconds: float, verdict: dict[str, Any]) -> tuple[str, str, str, str]:
        word = {True: "acceptable", False: "not acceptable", None: "no verdict"}[verdict["acceptable"]]
        return name, f"{seconds:.4g} s", word, verdict["reason"]

    rows = [row("as given", found["duration_s"], found["verdict"])]
    if found["retimed_duration_s"] is None:
        return [*rows, ("slowed down", "-", "-", f"There is none: {found['not_retimed_because']}.")]
    return [*rows, row("slowed down", found["retimed_duration_s"], found["retimed_verdict"])]


# Less is not worth a sentence.
_WORTH_A_WORD = 1.01


class SuggestionPart(Part):
    """Undetectable force at other joint positions with the same pose of the tool."""

    title = "Joint positions that detect smaller forces"
    anchor = "suggestions"

    def __init__(self, rows: pl.DataFrame, suggestions: pl.DataFrame) -> None:
        self._t = rows["t_s"].to_numpy()
        self._undetectable, self._gain = (suggestions[name].to_numpy() for name in ("undetectable_N", "gain"))

    def content(self) -> list[Html]:
        """How much is to be gained, and where."""
        worth = int((self._gain >= _WORTH_A_WORD).sum())
        text = (
            "The same pose of the tool can be held by other joint positions, and some of them detect smaller "
            f"forces. At {worth} of {len(self._gain)} waypoints the largest undetectable force is at least "
            f"{100 * _WORTH_A_WORD - 100:.0f} % smaller. "
        )
        if worth:
            at = int(np.argmax(self._gain))
            text += (
                f"The largest gain is at waypoint {at + 1}: {self._undetectable[at]:.4g} N instead of "
                f"{self._gain[at] * self._undetectable[at]:.4g} N."
            )
        return [paragraph(text), paragraph("The joint positions are in suggestions.parquet, a row for each waypoint.")]

    def pictures(self) -> list[Picture]:
        """Undetectable force over time, as programmed and as suggested."""
        return [
            Picture(
                "suggestions",
                "Largest undetectable force at the waypoints, as programmed and with the joint positions suggested.",
                "Largest undetectable force along the motion, as programmed and with the joint positions suggested.",
                self._draw,
            )
        ]

    def _draw(self, figure: Figure) -> None:
        plot = axes(figure)
        before = self._gain * self._undetectable
        plot.plot(self._t, before, color=LAW, label="as programmed")
        plot.plot(self._t, self._undetectable, color=EVENT, linestyle=":", linewidth=2.4, label="as suggested")
        finite = before[np.isfinite(before)]
        top = float(finite.max()) if finite.size else 1.0
        plot.set(
            xlabel="time as programmed [s]",
            ylabel="undetectable force [N]",
            ylim=(0, 1.3 * top),
            xlim=(self._t[0], self._t[-1]),
        )
        plot.legend(loc="upper right", ncols=2, fontsize=8, frameon=True, facecolor="white", edgecolor="none")


class WorkspaceSpeedLimitsPart(Part):
    """Safe speeds of random poses over their place."""

    title = "Safe speed over the workspace"
    anchor = "workspace"

    def __init__(self, rows: pl.DataFrame, summary: dict[str, Any]) -> None:
        self._rows, self._summary = rows, summary

    def content(self) -> list[Html]:
        """Quantiles, and poses without a safe speed."""
        found = self._summary
        from bumpstop.study.speed.workspace_speed_limits import safe_poses

        words = safe_poses(found)
        return [
            paragraph(f"{words[0].upper()}{words[1:]}."),
            paragraph(f"A speed is safe in these directions: {found['directions']}."),
        ]

    def pictures(self) -> list[Picture]:
        """Seen from the side: distance from the axis of the first joint, and height."""
        return [
            Picture(
                "speed_map",
                "Safe speed of random poses over distance from the base axis and height.",
                "Highest safe speed, by the place of the tip: distance from the vertical axis through the base, and "
                "height. Every colour is a quarter of the poses that have one.",
                self._draw,
                height=4.2,
            )
        ]

    def _draw(self, figure: Figure) -> None:
        plot, rows = axes(figure, right=1.7), self._rows
        radius = np.hypot(rows["tip_x_m"].to_numpy(), rows["tip_y_m"].to_numpy())
        height, limit = rows["tip_z_m"].to_numpy(), rows["limit_mm_s"].to_numpy()
        none = limit == 0
        if (~none).any():
            edges = np.quantile(limit[~none], [0.25, 0.5, 0.75])
            group = np.where(none, -1, np.searchsorted(edges, limit))
            for i, (colour, marker) in enumerate(_GROUPS):
                inside = group == i
                if inside.any():
                    label = f"{limit[inside].min():.3g} to {limit[inside].max():.3g} mm/s"
                    plot.plot(
                        radius[inside], height[inside], marker, color=colour, markersize=5, linestyle="", label=label
                    )
        if none.any():
            plot.plot(radius[none], height[none], "x", color=FAINT, markersize=4, label="no speed is safe")
        figure.legend(loc="center right", fontsize=8.5, title="highest safe speed")
        plot.set(xlabel="distance from the base axis [m]", ylabel="height [m]", aspect="equal")
        plot.grid(color=AREA, alpha=0.2)
