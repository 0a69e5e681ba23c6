"""The page of a campaign."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bumpstop.campaign.campaign_summary import NAMES
from bumpstop.collision.probability_text import percent
from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, bullets, element, paragraph, table
from bumpstop.report.picture import INK, LAW, Picture
from bumpstop.report.section import Part
from bumpstop.report.studies.study import StudyNotesPart
from bumpstop.terminal import NONE, number

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence
    from pathlib import Path

    from matplotlib.figure import Figure

    from bumpstop.campaign import Campaign

# Rows of the table, and lines of the figure, that a page can hold.
_MAX_ROWS = 2000
_MAX_LINES = 8
_PROBABILITIES = ("p_over_force", "p_over_pressure", "undetected")


class SharesPart(Part):
    """What share of the poses is acceptable, by setup and speed."""

    title = "Share of acceptable poses"
    anchor = "shares"

    def __init__(self, summary: Mapping[str, Any]) -> None:
        self._summary = summary
        self._groups: Sequence[Mapping[str, Any]] = summary["groups"]
        self._axes = [name for name in NAMES if len({group[name] for group in self._groups}) > 1]

    def content(self) -> list[Html]:
        """How many there are, and one row for each setup and speed."""
        summary = self._summary
        headings = [*self._axes, "mm/s", "distributions", "acceptable", "mean P(over force)", "mean P(over pressure)",
                    "undetected", "largest p99 [N]"]  # fmt: skip
        rows = [
            [
                *(group[name] for name in self._axes),
                f"{group['speed_mm_s']:g}",
                str(group["distributions"]),
                _count_share(group["acceptable_share"]),
                *(_mean(group[name]) for name in _PROBABILITIES),
                _largest(group),
            ]
            for group in self._groups[:_MAX_ROWS]
        ]
        more = len(self._groups) - len(rows)
        return [
            paragraph(
                f"{summary['distributions']} distributions; {summary['singular_starts']} poses start at a singularity, "
                "have none and are left out. A pose is acceptable where every limit of its body is exceeded with at "
                "most the accepted probability, alarms before contact are no more than accepted, and in half of the "
                "cases or more something is hit. No figure stands for a place of a cell: poses are drawn at random."
            ),
            table(headings, rows, caption="Every setup at every speed", numbers=True),
            *([paragraph(f"{more} more rows are in summary.json.")] if more > 0 else []),
        ]

    def pictures(self) -> list[Picture]:
        """The share over the speed, of the first setups."""
        if len({group["speed_mm_s"] for group in self._groups}) < 2:
            return []
        return [
            Picture(
                "acceptable_share",
                "Share of acceptable poses over the speed.",
                "Share of random poses that are acceptable, by setup"
                + ("." if len(self._lines()) <= _MAX_LINES else f"; the first {_MAX_LINES} of {len(self._lines())}."),
                self._draw,
                height=3.2,
            )
        ]

    def _lines(self) -> dict[tuple[str, ...], list[Mapping[str, Any]]]:
        found: dict[tuple[str, ...], list[Mapping[str, Any]]] = {}
        for group in self._groups:
            found.setdefault(tuple(group[name] for name in NAMES), []).append(group)
        return found

    def _draw(self, figure: Figure) -> None:
        panel = figure.add_axes((0.13, 0.16, 0.47, 0.78))
        places = [NAMES.index(name) for name in self._axes]
        for i, (names, groups) in enumerate(list(self._lines().items())[:_MAX_LINES]):
            known = [group for group in groups if group["acceptable_share"] is not None]
            panel.plot(
                [group["speed_mm_s"] for group in known],
                [100 * group["acceptable_share"] for group in known],
                ("o-", "s--", "^-.", "D:")[i % 4],
                color=LAW if i < _MAX_LINES // 2 else INK,
                markersize=3.5,
                linewidth=1,
                label=", ".join(names[place] for place in places) or "all",
            )
        panel.set_ylim(-2, 102)
        panel.set_xlim(left=0)
        panel.set_xlabel("speed [mm/s]")
        panel.set_ylabel("acceptable [%]")
        panel.legend(loc="upper left", bbox_to_anchor=(1.02, 1.0), fontsize=7.5)


class CampaignSettingsPart(Part):
    """What the campaign varied."""

    title = "Settings"
    anchor = "settings"

    def __init__(self, campaign: Campaign) -> None:
        self._campaign = campaign

    def content(self) -> list[Html]:
        """The axes and the numbers."""
        campaign = self._campaign
        directions = campaign.directions
        rows: list[tuple[Any, Any]] = [
            ("poses", f"{campaign.poses} of each robot, drawn at random inside the limits of its joints"),
            ("directions", f"{directions}, evenly spread" if isinstance(directions, int) else ", ".join(directions)),
            ("speeds [mm/s]", ", ".join(f"{speed:g}" for speed in campaign.speeds_mm_s)),
            ("seed", str(campaign.seed)),
            ("shards", str(campaign.shards)),
        ]
        choices = [
            (axis, choice.name, ", ".join(f"{key} = {value}" for key, value in choice.keys) or NONE)
            for axis in ("robots", "tools", "bodies", "detectors", "arms")
            for choice in getattr(campaign, axis)
        ]
        notes = [
            "bumpstop is an engineering tool, not a certified safety function. A risk assessment and a validation on "
            "the real cell are not replaced by it.",
            "Contact is at the tip, along its motion; noise, thresholds, deceleration and latency are those of the "
            "scenarios.",
        ]
        return [
            table(("setting", "value"), rows, caption="The campaign"),
            table(("axis", "choice", "keys that it changes"), choices, caption="Choices"),
            element("h3", "What is not claimed"),
            bullets(notes),
        ]


def write_campaign_report(campaign: Campaign, summary: Mapping[str, Any], folder: Path) -> Path:
    """Write ``report.html`` of a campaign and its figures; returns the page's path.

    Raises:
        InputError: the folder cannot be written.
    """
    beside = StudyNotesPart(summary.get("notes", ()))
    parts: list[Part] = [beside, SharesPart(summary), CampaignSettingsPart(campaign)]
    return write_document(Document("How hard, all over the cells", "bumpstop campaign", "campaign", parts), folder)


def _count_share(value: float | None) -> str:
    """A share of poses, which are counted: none is none."""
    return NONE if value is None else percent(value)


def _largest(group: Mapping[str, Any]) -> str:
    """The largest p99 of a group, or of how many distributions it is unbounded."""
    if not group["distributions"]:
        return NONE
    if group["largest_p99_N"] is not None:
        return number(group["largest_p99_N"])
    # Another build's summary may not count them.
    return f"unbounded in {group['unbounded_p99']}" if "unbounded_p99" in group else "unbounded"


def _mean(value: float | None) -> str:
    """A mean of probabilities."""
    return NONE if value is None else percent(value, integrated=True)
