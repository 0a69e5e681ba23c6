"""The answer of a register, and its situations, worst first."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

from bumpstop.collision.probability_text import apart, percent
from bumpstop.register.outcome import OUTCOME_WORDS
from bumpstop.report.banner import Sign, banner
from bumpstop.report.markup import Html, element, paragraph, table, whole, whole_figures
from bumpstop.report.picture import AREA, FAINT, INK, LAW, LIMIT, PAPER, Picture, axes
from bumpstop.report.section import Part
from bumpstop.terminal import as_written, number

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from matplotlib.figure import Figure

    from bumpstop.register import RegisterResult, SituationResult
    from bumpstop.register.outcome import Outcome

_SIGNS: dict[Outcome, Sign] = {"pass": "acceptable", "fail": "not-acceptable", "inconclusive": "unjudged"}
_COLOURS: dict[Outcome, tuple[str, str]] = {"fail": (LIMIT, "//"), "inconclusive": (FAINT, ".."), "pass": (AREA, "")}
FIGURE = "use_of_limits"
"""The figure of the page, by the name of its files."""
# Bars for more would be as thin as a line; the table has them all.
MAX_BARS = 40
_MAX_NAME = 34  # letters beside a bar
_LARGEST_BAR = 2.0


class OutcomePart(Part):
    """PASS, FAIL or INCONCLUSIVE for the whole register, and what stands on the head of the page."""

    title = "Verdict"
    anchor = "verdict"

    def __init__(self, result: RegisterResult, head: Mapping[str, str] | None = None) -> None:
        self._result, self._head = result, head or {}

    def content(self) -> list[Html]:
        """The sign, the head, and what the words mean."""
        result = self._result
        counts = ", ".join(f"{count} {OUTCOME_WORDS[outcome]}" for outcome, count in result.counts.items() if count)
        worst = result.results[0]
        reason = f"{_count(len(result.results))}: {counts}. "
        reason += "Closest to a limit" if result.outcome == "pass" else "Worst"
        reason += f": {worst.situation.name}. {worst.reason}"
        found = [banner(_SIGNS[result.outcome], OUTCOME_WORDS[result.outcome], reason)]
        if self._head:
            found.append(table(("", ""), list(self._head.items()), caption="This document"))
        return [
            *found,
            paragraph(
                element("strong", "The calculation supports a preliminary assessment; measurement decides."),
                " bumpstop is an engineering tool: neither it nor this page is a safety function.",
            ),
            paragraph(
                "PASS: force, pressure and false alarms are within what is accepted, and nothing that was only assumed "
                "decides it. FAIL: one of them is not, or a gauge measured more than the force limit. INCONCLUSIVE: "
                "the situation cannot be judged, or something that nobody has shown decides it."
            ),
            paragraph(
                "Probabilities are those of exceeding a limit in one contact. They are not the risk of ISO 12100, "
                "which also takes in how often contact happens and how severe the harm is."
            ),
        ]


class SituationsPart(Part):
    """All situations: verdict with reason, place and motion, and predicted figures."""

    title = "Contact situations"
    anchor = "situations"

    def __init__(self, result: RegisterResult) -> None:
        self._results = result.results

    def content(self) -> list[Html]:
        """Three tables and the remarks of the register, each worst first."""
        results = self._results
        verdicts = [
            (
                r.situation.name,
                element("strong", OUTCOME_WORDS[r.outcome], class_="whole"),
                whole(r.use_text),
                whole(_p_over(r)),
                whole_figures(r.reason),
            )
            for r in results
        ]
        remarks = [(r.situation.name, r.situation.note) for r in results if r.situation.note]
        return [
            paragraph(
                "Use of the limit: the quantile of the accepted probability over its limit, the larger of force and "
                "pressure. Above 100 % a limit is exceeded more often than accepted."
            ),
            table(
                ("situation", "verdict", "use of the limit", "P(over) per contact", "reason"),
                verdicts,
                caption="Verdicts, worst first",
            ),
            table(
                ("situation", "hits", "contact", "place on the robot", "motion", "payload", "how often"),
                [_where(r) for r in results],
                caption="What happens",
            ),
            table(
                ("situation", "p50", "p99", "p99.9", "limit", "p50", "p99", "p99.9", "limit", "false alarm"),
                [_figures(r) for r in results],
                caption="Predicted peak force in N (first four figures) and peak pressure in N/cm² (next four); limit "
                "“none”: there is none, or no contact is permitted",
                numbers=True,
            ),
            *([table(("situation", "remark"), remarks, caption="Remarks of the register")] if remarks else []),
        ]

    def pictures(self) -> list[Picture]:
        """Bars of the worst situations."""
        shown = [r for r in self._results if not math.isnan(r.use)][:MAX_BARS]
        if not shown:
            return []
        more = f" The {MAX_BARS} worst of {len(self._results)}." if len(self._results) > len(shown) == MAX_BARS else ""
        return [
            Picture(
                FIGURE,
                "Use of the limit by situation as bars, worst first, against 100 %.",
                f"Use of the limit by situation, worst first; hatched: not a pass.{more}",
                lambda figure: _draw(figure, shown),
                height=0.9 + 0.22 * len(shown),
            )
        ]


def _count(count: int) -> str:
    return f"{count} contact situation{'' if count == 1 else 's'}"


def _p_over(result: SituationResult) -> str:
    if math.isnan(result.p_over):
        return "none"
    return _probability(result, result.p_over, result.verdict.accepted_probability)


def _false_alarm(result: SituationResult) -> str:
    verdict = result.verdict
    return _probability(result, verdict.false_alarm_probability, verdict.max_false_alarm)


def _probability(result: SituationResult, p: float, accepted: float) -> str:
    integrated = result.method == "exact"
    if not integrated and p <= 0:
        return "in none of the runs"
    return apart(p, accepted, partial(percent, integrated=integrated))


def _where(result: SituationResult) -> tuple[str, ...]:
    situation = result.situation
    contact = situation.scenario.contact
    point = "" if not any(contact.point_m) else f" at [{', '.join(f'{x:g}' for x in contact.point_m)}] m"
    motion = situation.scenario.motion
    velocity = motion.velocity_mm_s
    along = f" along [{', '.join(number(v) for v in velocity)}] mm/s" if velocity is not None else ""
    kind = "clamped (quasi-static)" if contact.kind == "clamped" else "free (transient)"
    payload = "" if situation.payload_kg is None else f"{situation.payload_kg:g} kg"
    return (
        situation.name,
        result.hit,
        kind,
        whole_figures(f"{contact.link or 'tip'}{point}"),
        whole_figures(f"{result.arm} {result.motion}{along}"),
        whole(payload) if payload else "",
        situation.frequency,
    )


def _figures(result: SituationResult) -> list[str]:
    limits, first = result.verdict.limits, result.verdict.transient
    cells = [result.situation.name]
    for values, name in ((result.peak_force, "force_N"), (result.pressure, "pressure_N_cm2")):
        allowed = [getattr(one, name) for one in (first, limits) if one is not None]
        cells += [number(values[q], *allowed) for q in ("p50", "p99", "p999")]
        cells.append(" / ".join("none" if not limit else as_written(limit) for limit in allowed) or "none")
    return [*cells, _false_alarm(result)]


def _draw(figure: Figure, shown: Sequence[SituationResult]) -> None:
    panel = axes(figure, left=2.1, right=0.75, top=0.15)
    for i, result in enumerate(shown):
        colour, hatch = _COLOURS[result.outcome]
        length = min(result.use, _LARGEST_BAR)
        panel.barh(i, 100 * length, color=colour, hatch=hatch, edgecolor=INK, linewidth=0.5, height=0.7)
        place = (100 * length, i)
        panel.annotate(result.use_text, place, (4, 0), textcoords="offset points", va="center", fontsize=8, bbox=PAPER)
    names = [r.situation.name for r in shown]
    short = [name if len(name) <= _MAX_NAME else f"{name[: _MAX_NAME - 1]}…" for name in names]
    panel.set_yticks(range(len(shown)), short, fontsize=8)
    panel.axvline(100, color=LAW, linestyle="--", linewidth=1.4)
    panel.set(
        xlabel="use of the limit [%]",
        xlim=(0, max(110.0, 100 * min(max(r.use for r in shown), _LARGEST_BAR))),
        ylim=(len(shown) - 0.4, -0.6),
    )
