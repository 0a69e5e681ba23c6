"""The page of an effectiveness study."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from bumpstop.collision.probability_text import percent
from bumpstop.report.markup import Html, element, paragraph, table
from bumpstop.report.picture import EVENT, INK, LAW, LIMIT, Picture
from bumpstop.report.section import Part
from bumpstop.terminal import NONE, number

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.figure import Figure

    from bumpstop.study.parameters.effectiveness import EffectivenessStudy

_MARKERS = ("o", "s", "^", "D", "v", "P")
_BOUND_BY = {
    "force": " (f)", "pressure": " (p)", "false_alarm": " (a)", "undetected": " (u)", "singularity": " (s)",
    "untouched": " (n)", "none": " or more",
}  # fmt: skip
_COLORS = (LAW, LIMIT, EVENT, INK)


def pages_of(
    study: EffectivenessStudy, rows: pl.DataFrame, summary: dict[str, Any]
) -> tuple[str, list[Part], Sequence[str]]:
    """Title, parts and notes of the page."""
    parts: list[Part] = [SafeSpeedsPart(study, summary), CollisionsPart(study, summary), TriggersPart(study, rows)]
    notes = [
        "Every body part has the stiffness of its own table; a stiffness of the scenario is not used.",
        "Limits of different tables are never mixed: each body part is judged by its own.",
        f"A safe speed is the highest below which every speed looked at, from 1 to {study.highest_speed_mm_s:g} mm/s, "
        "is acceptable.",
    ]
    return "Who may be hit, how fast", parts, notes


class SafeSpeedsPart(Part):
    """The highest safe speed by body part."""

    title = "Highest safe speed"
    anchor = "safe-speeds"

    def __init__(self, study: EffectivenessStudy, summary: dict[str, Any]) -> None:
        self._study = study
        self._speeds = summary["safe_speeds"]
        self._risk = summary["risk"]
        self._any_fails = any(s["fails_with_finer_steps"] for s in self._speeds)

    def content(self) -> list[Html]:
        """What it means, and one row for each body part."""
        columns = [(d, a) for d in self._study.directions for a in self._study.areas_cm2]
        found = {(s["table"], s["body"], s["direction"], s["area_cm2"]): s for s in self._speeds}
        labels = {(s["table"], s["body"]): s["label"] for s in self._speeds}
        rows = [
            [f"{labels[key]} ({key[0]})", *(_speed(found[(*key, d, a)]) for d, a in columns)]
            for key in self._study.bodies
        ]
        headings = ["body part", *(f"{d}, {a:g} cm²" for d, a in columns)]
        unjudged = {f"{s['label']} ({s['table']})": s["reason"] for s in self._speeds if _unjudged(s)}
        return [
            paragraph(
                f"The highest speed, in mm/s, at which each limit is passed with a probability of at most "
                f"{percent(self._risk)}. In brackets what stands against more: f force, p pressure, a false alarms, "
                "u undetected collisions, s a singularity on the way, n that faster motions hit nothing in most cases."
                + (" † Not acceptable with finer simulation steps: see above." if self._any_fails else "")
            ),
            *(paragraph(f"{label}: {reason}") for label, reason in unjudged.items()),
            table(headings, rows, caption="Highest safe speed [mm/s]", numbers=True),
        ]

    def pictures(self) -> list[Picture]:
        """All of them at a glance."""
        bodies = self._study.bodies
        return [
            Picture(
                "safe_speeds",
                "Highest safe speed of every body part, by direction and contact area.",
                "Highest safe speed by body part. Shape and colour: direction; hollow: smallest area, full: largest. "
                "A cross at the left: no speed is acceptable. No mark: no verdict."
                + (" Pale: not acceptable with finer simulation steps." if self._any_fails else ""),
                self._draw,
                height=1.2 + 0.2 * len(bodies),
            )
        ]

    def _draw(self, figure: Figure) -> None:
        height = figure.get_size_inches()[1]
        panel = figure.add_axes((0.40, 0.5 / height, 0.57, 1 - 1.0 / height))
        places = {key: i for i, key in enumerate(self._study.bodies)}
        areas = self._study.areas_cm2
        crosses: list[tuple[float, int]] = []
        for s in self._speeds:
            d = self._study.directions.index(s["direction"])
            y = places[(s["table"], s["body"])] + 0.12 * (d - (len(self._study.directions) - 1) / 2)
            color, marker = _COLORS[d % len(_COLORS)], _MARKERS[d % len(_MARKERS)]
            if s["area_cm2"] not in (areas[0], areas[-1]) or _unjudged(s):
                continue
            if s["safe_speed_mm_s"] is None:
                crosses.append((y, d))
                continue
            full = s["area_cm2"] == areas[-1]
            look: dict[str, Any] = {
                "fillstyle": "full" if full else "none",
                "alpha": 0.3 if s["fails_with_finer_steps"] else 1.0,
            }
            panel.plot(s["safe_speed_mm_s"], y, marker, color=color, markersize=4.5, **look)
        labels = {(s["table"], s["body"]): s["label"] for s in self._speeds}
        panel.set_yticks(range(len(places)), [f"{labels[key]} ({key[0]})" for key in places], fontsize=7.5)
        panel.set_ylim(len(places) - 0.5, -0.5)
        panel.grid(axis="y", color="#dddddd", linewidth=0.5)
        # Crosses stand before zero, clear of slow speeds, and each direction's in a column of its own.
        fastest = panel.get_xlim()[1]
        for y, d in crosses:
            panel.plot(-0.03 * fastest * (d + 1), y, "x", color=_COLORS[d % len(_COLORS)], markersize=4)
        panel.set_xlim(-0.03 * fastest * (max(d for _, d in crosses) + 2) if crosses else 0, fastest)
        panel.set_xlabel("highest safe speed [mm/s]")
        for d, name in enumerate(self._study.directions):
            panel.plot([], [], _MARKERS[d % len(_MARKERS)], color=_COLORS[d % len(_COLORS)], label=name)
        panel.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=6, handletextpad=0.1)


def _unjudged(found: dict[str, Any]) -> bool:
    """The table has no limit for this contact, or no mass: there is a reason in place of a law."""
    return bool(found["reason"]) and found["binding"] is None


def _speed(found: dict[str, Any]) -> str:
    if _unjudged(found):
        return "no verdict"
    if found["safe_speed_mm_s"] is None:
        return "none"
    fails = " †" if found["fails_with_finer_steps"] else ""
    return f"{found['safe_speed_mm_s']:g}{_BOUND_BY[found['binding']]}{fails}"


class CollisionsPart(Part):
    """Every collision of the study, as one table and one picture."""

    title = "Every collision"
    anchor = "collisions"

    def __init__(self, study: EffectivenessStudy, summary: dict[str, Any]) -> None:
        self._study = study
        self._collisions = summary["collisions"]

    def content(self) -> list[Html]:
        """The table, folded: it is long."""
        headings = ["body part", "direction", "mm/s", "cm²", "mean [N]", "p99 [N]", "P(over force)", "P(over pressure)",
                    "acceptable"]  # fmt: skip
        rows = [
            [
                f"{c['label']} ({c['table']})",
                c["direction"],
                f"{c['speed_mm_s']:g}",
                f"{c['area_cm2']:g}",
                *(NONE if c[name] is None else number(c[name]) for name in ("mean_N", "p99_N")),
                *(
                    NONE if c[name] is None else percent(c[name], integrated=True)
                    for name in ("p_over_force", "p_over_pressure")
                ),
                "no verdict" if c["acceptable"] is None else "yes" if c["acceptable"] else element("strong", "no"),
            ]
            for c in self._collisions
        ]
        shown = table(headings, rows, caption="Distributions and verdicts", numbers=True)
        return [element("details", element("summary", f"All {len(rows)} collisions"), shown)]

    def pictures(self) -> list[Picture]:
        """Verdicts as a chart."""
        return [
            Picture(
                "effectiveness",
                "Verdict of every body part by direction, speed and area.",
                "Probability of exceeding a limit. Empty blue: within the accepted risk; hatched: more; full orange: "
                "in more than half of all collisions; cross: not permitted, or no distribution.",
                self._draw,
                height=1.5 + 0.19 * len(self._study.bodies),
            )
        ]

    def _draw(self, figure: Figure) -> None:
        study = self._study
        height = figure.get_size_inches()[1]
        groups = [(d, a) for d in study.directions for a in study.areas_cm2]
        wide = len(study.speeds_mm_s) + 0.6
        panel = figure.add_axes((0.40, 0.55 / height, 0.59, 1 - 1.15 / height))
        places = {key: i for i, key in enumerate(study.bodies)}
        for c in self._collisions:
            x = groups.index((c["direction"], c["area_cm2"])) * wide + study.speeds_mm_s.index(c["speed_mm_s"])
            y = places[(c["table"], c["body"])]
            if c["acceptable"] is None:
                panel.plot(x, y, "x", color=INK, markersize=4)
                continue
            worst = max(c["p_over_force"] or 0.0, c["p_over_pressure"] or 0.0)
            if c["acceptable"]:
                look: dict[str, Any] = {"facecolor": "white", "edgecolor": LAW}
            elif worst > 0.5:
                look = {"facecolor": LIMIT, "edgecolor": LIMIT}
            else:
                look = {"facecolor": "#f6d5c0", "edgecolor": LIMIT, "hatch": "//////"}
            panel.bar(x, 0.72, 0.76, y - 0.36, linewidth=0.8, **look)
        labels = {(c["table"], c["body"]): c["label"] for c in self._collisions}
        panel.set_yticks(range(len(places)), [f"{labels[key]} ({key[0]})" for key in places], fontsize=7.5)
        panel.set_ylim(len(places) - 0.4, -0.6)
        ticks = [g * wide + i for g in range(len(groups)) for i in range(len(study.speeds_mm_s))]
        panel.set_xticks(ticks, [f"{v:g}" for _ in groups for v in study.speeds_mm_s], fontsize=6.5, rotation=90)
        panel.set_xlabel("speed [mm/s]")
        for g, (d, a) in enumerate(groups):
            middle = g * wide + (len(study.speeds_mm_s) - 1) / 2
            panel.text(middle, -0.75, f"{d}\n{a:g} cm²", ha="center", va="bottom", fontsize=8)
        panel.tick_params(length=0)


class TriggersPart(Part):
    """Which joints detect."""

    title = "Joints that trigger"
    anchor = "triggers"

    def __init__(self, study: EffectivenessStudy, rows: pl.DataFrame) -> None:
        self._study = study
        known = rows.filter((rows["kind"] == "collision") & rows["mean_N"].is_not_null())
        self._rows = known.filter(known["area_cm2"] == study.areas_cm2[0])
        self._names = [name for name in rows.columns if name.startswith("trigger_")]

    def applies(self) -> bool:
        """Some body has a law."""
        return self._rows.height > 0

    def content(self) -> list[Html]:
        """One row for each direction and speed, of the first body part with a law."""
        first = self._rows.row(0, named=True)
        own = self._rows.filter((self._rows["body"] == first["body"]) & (self._rows["table"] == first["table"]))
        rows = [
            [
                f"{row['direction']}, {row['speed_mm_s']:g} mm/s",
                *(percent(row[name], integrated=True) for name in self._names),
                percent(row["several_joints"], integrated=True),
            ]
            for row in own.iter_rows(named=True)
        ]
        headings = ["motion", *(f"joint {name.rpartition('_')[2]}" for name in self._names), "several at once"]
        return [
            paragraph(
                f"Against {first['label']} ({first['table']}), given detection. Joints that fire together count "
                "each, so that a row may sum to more than all."
            ),
            table(headings, rows, caption="Probability that a joint is over its threshold at detection", numbers=True),
        ]
