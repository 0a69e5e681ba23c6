"""The answer, before everything else."""

from __future__ import annotations

import math
from decimal import Decimal
from functools import partial
from typing import TYPE_CHECKING

from bumpstop.collision.probability_text import MIN_PERCENT, accepted_percent, apart, small_percent
from bumpstop.collision.verdict.alarm_rate import alarm_rate
from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.report.banner import Sign, banner
from bumpstop.report.formatting import in_phases, quantity
from bumpstop.report.markup import Html, bullets, element, paragraph, table
from bumpstop.report.section import Section
from bumpstop.terminal import as_written, number

if TYPE_CHECKING:
    from bumpstop.collision import CollisionResult
    from bumpstop.uncertainty import UncertainResult

# Word, and the sign that says the same.
_SIGNS: dict[str, tuple[str, Sign]] = {
    "acceptable": ("Acceptable", "acceptable"),
    "not_acceptable": ("Not acceptable", "not-acceptable"),
    "inconclusive": ("Inconclusive", "unjudged"),
    "no_limits": ("No limits to judge by", "unjudged"),
}


class VerdictSection(Section):
    """Acceptable or not, the reason in a sentence, and the figures that decide."""

    title = "Verdict"
    anchor = "verdict"

    def __init__(self, result: CollisionResult, uncertain: UncertainResult | None = None) -> None:
        super().__init__(result)
        self._uncertain = uncertain

    def content(self) -> list[Html]:
        """Sign, sentence, the table of what was judged, and what the word means."""
        verdict = self._uncertain or self.result.verdict
        word, sign = _SIGNS[verdict.conclusion]
        of = "this collision" if self._uncertain is None else "the central case"
        rows = table(("", of, "limit or accepted", ""), self._rows(), caption="What the verdict rests on")
        beside = []
        if self.result.warnings:
            beside = [element("h3", "Beside this verdict"), bullets(self.result.warnings)]
        return [banner(sign, word, verdict.reason), *beside, rows, *self._both_arms(), paragraph(self._meaning())]

    def _both_arms(self) -> list[Html]:
        """The arm that was judged beside the other one, where both are known."""
        other = self.result.other_arm
        if other is None:
            return []
        rows = [
            (
                f"{one.scenario.arm.model}{' (judged)' if one is self.result else ''}",
                number(one.peak_force.quantile(0.5)),
                number(one.peak_force.quantile(0.99)),
                "" if one.verdict.p_over_force is None else self._percent(one.verdict.p_over_force),
                _SIGNS[one.verdict.conclusion][0],
            )
            for one in (self.result, other)
        ]
        return [
            table(
                ("Arm", "peak force, median [N]", "p99 [N]", "over the force limit", "Verdict"),
                rows,
                caption="A rigid arm and one that gives way: neither is an upper bound of the other",
            )
        ]

    def _rows(self) -> list[tuple[str, str, str, str]]:
        result, verdict, limits, first = (
            self.result,
            self.result.verdict,
            self.result.problem.limits,
            self.result.verdict.transient,
        )
        # The quantile of the accepted probability is what the verdict compares with the limit; p99 may be below it.
        p = 1 - verdict.accepted_probability
        below = 100 - 100 * Decimal(f"{verdict.accepted_probability:.10g}")
        share, name = f"{below.normalize():f} %", f"p{below.normalize():f}"
        rows = [
            _below(f"Peak force that {share} of collisions stay below ({name})", result.peak_force.quantile(p), "N",
                   limits.force_N if limits else None, first.force_N if first else None),
            _below(f"Peak pressure, likewise ({name})", result.pressure.quantile(p), "N/cm²",
                   limits.pressure_N_cm2 if limits else None, first.pressure_N_cm2 if first else None),
        ]  # fmt: skip
        for what, over in (("force", verdict.p_over_force), ("pressure", verdict.p_over_pressure)):
            if over is not None:
                rows.append(
                    self._accepted(f"Probability of exceeding the {what} limit", over, verdict.accepted_probability)
                )
        rows.append(
            self._accepted(
                "Probability of a false alarm before contact",
                verdict.false_alarm_probability,
                verdict.max_false_alarm,
            )
        )
        rows.append(("False alarms in free motion", alarm_rate(result.problem).words, "", ""))
        rows.append(("Probability of no detection", self._percent(result.undetected_probability), "", ""))
        delay = result.detection_delay
        shown = f"{number(1e3 * delay.quantile(0.5))} / {quantity(1e3 * delay.quantile(0.99), 'ms')}"
        rows.append(("Delay from touch to detection, median / p99", shown, "", ""))
        return rows

    def _accepted(self, what: str, p: float, accepted: float) -> tuple[str, str, str, str]:
        judged = "" if math.isnan(p) else "within" if p <= accepted else element("strong", "too high")
        text = partial(small_percent, integrated=self.result.kind == "exact")
        told = apart(p, accepted, text if accepted < MIN_PERCENT else self._percent)
        return what, told, f"at most {accepted_percent(accepted)}", judged

    def _meaning(self) -> str:
        verdict, limits, contact = self.result.verdict, self.result.problem.limits, self.result.scenario.contact
        first = verdict.transient
        if limits is None:
            return (
                "The scenario gives a stiffness but no body region. The forces below hold; whether a person could take "
                "them is not judged."
            )
        meaning = (
            "Acceptable means here: each limit is exceeded with a probability of at most "
            f"{accepted_percent(verdict.accepted_probability)}, and an alarm before contact has a probability "
            f"of at most {accepted_percent(verdict.max_false_alarm)}. "
        )
        if self._uncertain is not None:
            meaning += f"So it is for {100 * self._uncertain.confidence:g} % of the inputs, whatever is assumed. "
        meaning += (
            "Each probability is that of exceeding a limit in one contact. It is not the risk of ISO 12100, which also "
            "weighs how often contact occurs, whether it can be avoided, and the harm. "
        )
        if self.result.problem.body_mass is None:
            because, pressing = self.result.unbounded_because, self.result.pressing_limit
            if pressing is not None:
                at_most = "at most " if self.result.problem.trajectory is not None else ""
                meaning += (
                    f"Collisions that are never detected count {at_most}with the most that the drives press with, "
                    f"{pressing.peak_force:.4g} N ({pressing.static_force:.4g} N without the blow)."
                )
            elif because is None:
                meaning += "Collisions that are never detected count with the greatest force until the arm stands."
            else:
                meaning += f"Collisions that are not detected {because} count as over every limit."
        else:
            meaning += "A body that gets away undetected counts with the force it has met."
        if first is not None:
            meaning += (
                f" In the first {FIRST_PHASE_S:g} s of contact the transient limits hold, after them the quasi-static "
                "ones, and neither may be passed."
            )
        if not limits.permitted or (first is not None and not first.permitted):
            return meaning
        if first is not None:
            at_first, later = (p.allowed_force_N(contact.area_cm2, contact.peak_factor) for p in (first, limits))
            return f"{meaning} On {contact.area_cm2:g} cm² that is {in_phases(at_first, later, 'N', number)}."
        allowed = limits.allowed_force_N(contact.area_cm2, contact.peak_factor)
        governing = limits.governing(contact.area_cm2, contact.peak_factor)
        return (
            f"{meaning} On {contact.area_cm2:g} cm² the {governing} limit is the first to be reached, at "
            f"{number(allowed)} N."
        )


def _below(what: str, value: float, unit: str, limit: float | None, first: float | None) -> tuple[str, str, str, str]:
    if limit is None:
        return what, quantity(value, unit), "no limit", ""
    if first is not None:
        # Between the two the peak alone does not tell.
        judged = "below" if value <= min(limit, first) else element("strong", "above") if value > first else ""
        return what, quantity(value, unit, first, limit), in_phases(first, limit, unit), judged
    allowed = f"{as_written(limit)} {unit}" if limit > 0 else "none permitted"
    return what, quantity(value, unit, limit), allowed, "below" if value <= limit else element("strong", "above")
