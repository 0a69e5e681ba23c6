"""The sheet of a measurement plan, to be printed and filled in."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bumpstop.collision.problem import CollisionProblem
from bumpstop.report.document import Document, write_document
from bumpstop.report.markup import Html, bullets, element, paragraph, table
from bumpstop.report.picture import LAW, LIMIT, Picture, axes
from bumpstop.report.print_style import print_style
from bumpstop.report.section import Part
from bumpstop.terminal import counted, in_percent, number

if TYPE_CHECKING:
    from pathlib import Path

    from matplotlib.figure import Figure

    from bumpstop.measure import MeasurementPlan
    from bumpstop.measure.planning.measured_situation import MeasuredSituation
    from bumpstop.measure.planning.plan import PlannedShot

# Room to write, on paper as well.
_STYLE = """\
#shots table { width: 100%; }
#shots td { white-space: nowrap; }
#shots :is(td, thead th):nth-child(6) { min-width: 4.5rem; }
#shots :is(td, thead th):nth-child(7) { min-width: 8rem; }
"""
_MANY = 60  # situations that a figure can still name


class ShotsPart(Part):
    """Shots in order, with room for what the gauge shows."""

    title = "Shots, in this order"
    anchor = "shots"

    def __init__(self, plan: MeasurementPlan) -> None:
        self._plan = plan

    def content(self) -> list[Html]:
        """The table to fill in."""
        plan = self._plan
        rows = [
            (
                shot.situation,
                str(shot.number),
                _speed(shot, plan.situation(shot.situation)),
                number(shot.predicted_N),
                f"{number(shot.low_N)} to {number(shot.high_N)}",
                "",
                "",
                f"{100 * shot.spread:.2g}",
            )
            for shot in plan.shots
        ]
        headings = ("situation", "shot", "speed, mm/s", "expected, N", "5 % to 95 %, N", "measured, N", "remark")
        return [
            paragraph(
                "Each shot is the one that is expected to narrow the peak forces of all situations most, after those "
                "above it. The last column is the spread that is left then: the standard deviation of the peak force, "
                f"root mean square over the situations. Before any shot it is {in_percent(plan.spread, 2)}. The band "
                "holds nine of ten single shots, over what is assumed of the cell and the noise of detector and gauge."
            ),
            table((*headings, "spread left, %"), rows, caption="Peak forces to measure", numbers=True),
            *([bullets(plan.notes)] if plan.notes else []),
        ]

    def pictures(self) -> list[Picture]:
        """The spread over the shots."""
        plan = self._plan

        def draw(figure: Figure) -> None:
            panel = axes(figure)
            spread = [100 * plan.spread, *(100 * shot.spread for shot in plan.shots)]
            panel.plot(range(len(spread)), spread, "-o", color=LAW, markersize=3)
            panel.set_ylim(bottom=0)
            panel.set_xlim(left=0)
            panel.set_xlabel("shots")
            panel.set_ylabel("spread of the peak force [%]")
            panel.set_title("What the shots are worth")

        caption = "Expected spread of the peak forces of all situations after so many shots of the plan."
        return [Picture("expected_spread", "Expected spread over the number of shots, falling.", caption, draw)]


class PlacesPart(Part):
    """Gauge, place, orientation and approach of every situation."""

    title = "Gauge and place"
    anchor = "places"

    def __init__(self, plan: MeasurementPlan) -> None:
        self._plan = plan

    def content(self) -> list[Html]:
        """Where the gauge stands, how the arm comes to it, and what else to know."""
        plan = self._plan
        places = [
            (
                each.name,
                each.gauge.words,
                "fixed to the ground" if each.clamped else "on a slide, with the mass of the body",
                _vector([1e3 * part for part in each.contact_point], 1),
                _vector(each.normal.tolist(), 3),
            )
            for each in plan.situations
        ]
        motions = [
            (
                each.name,
                "line" if each.onset_s is None else f"trajectory, {each.onset_s:.3f} s after its start",
                _joints(each),
                _vector([1e3 * part for part in each.start_point], 1),
                number(1e3 * each.approach),
            )
            for each in plan.situations
        ]
        notes = [f"{each.name}: {note}" for each in plan.situations for note in each.notes]
        sources = sorted({f"{each.gauge.words}: {each.gauge.status} ({each.gauge.source})" for each in plan.situations})
        return [
            paragraph(
                "All in the base frame of the robot. The pad's face lies across the normal, its middle at the contact "
                "point; the spring yields along the normal. A line begins so far before the gauge that the arm has "
                "its full speed when it touches, and a quarter of that way more. The detector and the reaction are "
                "those of the scenario: they stay on."
            ),
            table(
                ("situation", "gauge", "held", "contact point, mm", "normal"),
                places,
                caption="Where each situation is measured",
            ),
            table(
                (
                    *("situation", "motion", "joint positions at contact, deg or mm"),
                    *("contact point at the start, mm", "way to the gauge, mm"),
                ),
                motions,
                caption="How the arm comes to the gauge",
            ),
            element("h3", "Where the gauges come from"),
            bullets(sources),
            *([element("h3", "Notes"), bullets(notes)] if notes else []),
        ]


class BandsPart(Part):
    """Expected peak forces beside the limits."""

    title = "What is expected"
    anchor = "expected"

    def __init__(self, plan: MeasurementPlan) -> None:
        self._plan = plan

    def content(self) -> list[Html]:
        """What the bands are made of."""
        rows = [
            (element("code", each.key), each.label, f"{each.sd:.3g}" + (" s" if each.kind == "shift" else ""))
            for each in self._plan.parameters.each
        ]
        return [
            paragraph(
                "The line is the median of the integrated distribution with the scenario as it stands. The bar adds "
                "what is assumed of the cell. These standard deviations, of the logarithm or in seconds, are "
                "engineering choices; measured forces replace them."
            ),
            table(("key", "", "standard deviation"), rows, caption="What is assumed of the cell"),
        ]

    def pictures(self) -> list[Picture]:
        """Bars of the situations at their own speeds."""
        plan = self._plan
        chosen = [each for each in plan.situations if any(_own(shot_speed, each) for shot_speed in self._speeds(each))]
        if not chosen or len(chosen) > _MANY:
            return []

        def draw(figure: Figure) -> None:
            panel = axes(figure, left=1.8)
            for i, situation in enumerate(chosen):
                shot = next(s for s in plan.shots if s.situation == situation.name and _own(s.speed_mm_s, situation))
                panel.plot([shot.low_N, shot.high_N], [i, i], color=LAW, linewidth=6, alpha=0.35, solid_capstyle="butt")
                panel.plot([shot.predicted_N], [i], "|", color=LAW, markersize=12)
                if math.isfinite(situation.limit_N):
                    panel.plot([situation.limit_N], [i], "D", color=LIMIT, markersize=5)
            panel.set_yticks(range(len(chosen)), [_short(each.name) for each in chosen])
            panel.set_ylim(len(chosen) - 0.5, -0.5)
            panel.set_xlim(left=0)
            panel.set_xlabel("peak force on the gauge [N]")
            panel.set_title("Expected peak forces")

        caption = "Median and band of the peak force at the speed of each situation; diamonds are force limits."
        alt = "Bars of expected peak forces by situation, with force limits."
        return [Picture("expected_forces", alt, caption, draw, height=max(2.0, 0.9 + 0.28 * len(chosen)))]

    def _speeds(self, situation: MeasuredSituation) -> list[float]:
        return [shot.speed_mm_s for shot in self._plan.shots if shot.situation == situation.name]


def _speed(shot: PlannedShot, situation: MeasuredSituation) -> str:
    """In mm/s; of a trajectory also as percent of its own, which is what a controller is told."""
    share = shot.speed_mm_s / situation.speed_mm_s
    return number(shot.speed_mm_s) + ("" if situation.onset_s is None else f" ({in_percent(share)})")


def _joints(situation: MeasuredSituation) -> str:
    joints = CollisionProblem.from_scenario(situation.measured).robot.joints
    shown = [
        math.degrees(q) if joint.kind == "revolute" else 1e3 * q
        for q, joint in zip(situation.pose.tolist(), joints, strict=True)
    ]
    return _vector(shown, 2)


def _own(speed: float, situation: MeasuredSituation) -> bool:
    return math.isclose(speed, situation.speed_mm_s, rel_tol=1e-6)


def _short(name: str) -> str:
    return name if len(name) <= 22 else f"{name[:19]}..."


def _vector(values: list[float], digits: int) -> str:
    # Minus zero is zero.
    return ", ".join(f"{round(value, digits) + 0.0:.{digits}f}" for value in values)


def write_plan_page(plan: MeasurementPlan, folder: Path) -> Path:
    """Write ``report.html``, the sheet, and its figures; returns the sheet's path.

    Raises:
        InputError: the folder cannot be written.
    """
    parts: list[Part] = [ShotsPart(plan), PlacesPart(plan), BandsPart(plan)]
    shots, situations = counted(len(plan.shots), "shot"), counted(len(plan.situations), "situation")
    about = f"{plan.situations[0].scenario.robot}: {shots} in {situations}"
    style = _STYLE + print_style(f"Measurement plan, {about}")
    document = Document("Measurement plan", "bumpstop: measure", "bumpstop measure", parts, about, style)
    return write_document(document, folder)
