"""Verdicts: a force distribution against the limits of the body it hits."""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any, Literal

from bumpstop.collision.probability_text import (
    MIN_PERCENT,
    accepted_percent,
    apart,
    none_of,
    percent,
    small_percent,
    within,
)
from bumpstop.collision.verdict.alarm_rate import alarm_rate

if TYPE_CHECKING:
    from bumpstop.collision.outcome import CollisionOutcome
    from bumpstop.collision.scenario.scenario_tables import VerdictTable
    from bumpstop.contact import ContactLimits


@dataclass(frozen=True, kw_only=True)
class Verdict:
    """Whether a collision stays under the limits often enough.

    Attributes:
        limits: what it is judged by, or None where no body was named.
        transient: what the first phase of clamped contact is judged by, where it is judged in two; ``limits`` then hold
            for what comes after.
        p_over_force, p_over_pressure: probability that the peak passes its limit; collisions never detected count
            as over where their force has no bound. None where there is no limit.
        false_alarm_probability, accepted_probability, max_false_alarm: as found, and as accepted.
        false_alarms_per_hour: of free motion.
        nothing_hit: why most cases touch nothing, so that there is no verdict; empty where they do.
        reason: one sentence.
    """

    limits: ContactLimits | None
    transient: ContactLimits | None = None
    p_over_force: float | None
    p_over_pressure: float | None
    false_alarm_probability: float
    accepted_probability: float
    max_false_alarm: float
    false_alarms_per_hour: float
    nothing_hit: str = ""
    reason: str

    @property
    def false_alarm_ok(self) -> bool:
        """Alarms before contact are no more probable than accepted."""
        return self.false_alarm_probability <= self.max_false_alarm

    @property
    def acceptable(self) -> bool | None:
        """Force, pressure and false alarms are all within what is accepted; None without limits or inconclusive."""
        return ACCEPTABLE[self.conclusion]

    @property
    def conclusion(self) -> Conclusion:
        """The verdict in a word. Where most cases touch nothing, what is not over a limit was not put to the test."""
        if self.p_over_force is None:
            return "no_limits"
        if self.fails_by:
            return "not_acceptable"
        return "inconclusive" if self.nothing_hit else "acceptable"

    @property
    def fails_by(self) -> tuple[str, ...]:
        """What is not within what is accepted, of ``"force"``, ``"pressure"`` and ``"false_alarm"``."""
        over = {"force": self.p_over_force, "pressure": self.p_over_pressure}
        limits = tuple(name for name, p in over.items() if p is not None and not p <= self.accepted_probability)
        return limits if self.false_alarm_ok else (*limits, "false_alarm")

    def to_json(self) -> dict[str, Any]:
        """The ``verdict`` object of ``bumpstop evaluate --json``."""
        limits = self.limits
        result: dict[str, Any] = {
            "acceptable": self.acceptable,
            "conclusion": self.conclusion,
            "reason": self.reason,
            "limit_force_N": limits.force_N if limits else None,
            "limit_pressure_N_cm2": limits.pressure_N_cm2 if limits else None,
            "p_over_force": self.p_over_force,
            "p_over_pressure": self.p_over_pressure,
            "false_alarm_ok": self.false_alarm_ok,
            "false_alarms_per_hour": self.false_alarms_per_hour,
            "accepted_probability": self.accepted_probability,
            "max_false_alarm": self.max_false_alarm,
        }
        if limits:
            result |= {
                "limit_table": limits.table,
                "limit_kind": "quasi_static" if limits.kind == "clamped" else "transient",
                "limit_force_source": limits.force_source,
                "limit_force_status": limits.force_status,
                "limit_pressure_area": limits.pressure_area,
                "limit_pressure_source": limits.pressure_source,
                "limit_pressure_status": limits.pressure_status,
            }
        if self.transient:
            result |= {
                "limit_kind": "two_phase",
                "limit_transient_force_N": self.transient.force_N,
                "limit_transient_pressure_N_cm2": self.transient.pressure_N_cm2,
            }
        return result


Conclusion = Literal["acceptable", "not_acceptable", "inconclusive", "no_limits"]
ACCEPTABLE: dict[Conclusion, bool | None] = {
    "acceptable": True,
    "not_acceptable": False,
    "inconclusive": None,
    "no_limits": None,
}


def in_json(conclusion: Conclusion, reason: str) -> dict[str, Any]:
    """What a ``verdict`` object says of a verdict at a stated confidence, in the place of that of the central case."""
    return {"acceptable": ACCEPTABLE[conclusion], "conclusion": conclusion, "reason": reason}


def judge(result: CollisionOutcome, over: tuple[float, float | None] | None, nothing_hit: str) -> Verdict:
    """Judge peak force and pressure of a collision by the limits of its body region, where one is named.

    Args:
        result: of the collision.
        over: probabilities of passing force and pressure limits in either phase, where contact has two; else None.
        nothing_hit: why most cases touch nothing; empty where they do.
    """
    settings, problem = result.scenario.verdict, result.problem
    limits = problem.limits
    because = result.unbounded_because if result.undetected_probability > 0 else None
    # One never detected whose force is known has that force all the same: no failure by itself.
    undetected = (0.0, "") if because is None else (result.undetected_probability, because)
    p_force = p_pressure = None
    if limits is not None and over is not None:
        p_force, p_pressure = over
    elif limits is not None:
        p_force = result.peak_force.exceedance(limits.force_N)
        if limits.pressure_N_cm2 is not None:
            p_pressure = result.pressure.exceedance(limits.pressure_N_cm2)
    words = _Words(settings, result.samples)
    faults = words.faults(
        limits, problem.transient_limits, (p_force, p_pressure), result.false_alarm_probability, undetected
    )
    reason = faults or nothing_hit or words.within(limits, p_force, p_pressure)
    if limits is None:
        reason = "No body region is named, so there is no limit to judge by."
    return Verdict(
        limits=limits,
        transient=problem.transient_limits,
        p_over_force=p_force,
        p_over_pressure=p_pressure,
        false_alarm_probability=result.false_alarm_probability,
        accepted_probability=settings.accepted_probability,
        max_false_alarm=settings.max_false_alarm,
        false_alarms_per_hour=alarm_rate(problem).per_hour,
        nothing_hit=nothing_hit,
        reason=reason,
    )


class _Words:
    """The sentence that gives the reason."""

    def __init__(self, settings: VerdictTable, runs: int | None) -> None:
        self._settings, self._runs = settings, runs
        # Where what is accepted is itself next to nothing, figures must be told apart there.
        tiny = min(settings.accepted_probability, settings.max_false_alarm) < MIN_PERCENT
        self._text = small_percent if tiny else percent

    def _said(self, p: float, accepted: float) -> str:
        if self._runs is not None and not p > 0:
            return none_of(self._runs, self._text)
        return apart(p, accepted, partial(self._text, integrated=self._runs is None))

    def faults(
        self,
        limits: ContactLimits | None,
        transient: ContactLimits | None,
        over: tuple[float | None, float | None],
        false_alarm: float,
        undetected: tuple[float, str],
    ) -> str:
        """What is not within what is accepted; empty where all is."""
        if limits is None:
            return ""
        for judge_of in (limits, transient):
            if judge_of is not None and not judge_of.permitted:
                return judge_of.reason
        settings = self._settings
        said = partial(self._said, accepted=settings.accepted_probability)
        force, pressure = f"{limits.force_N:g} N", f"{limits.pressure_N_cm2 or 0:g} N/cm²"
        if transient is not None:
            force = _in_either_phase(f"{transient.force_N:g} N", force)
            pressure = _in_either_phase(f"{transient.pressure_N_cm2 or 0:g} N/cm²", pressure)
        p_force, p_pressure = over
        missed, because = undetected
        faults = []

        def listed(over: float | None) -> bool:
            """Whether a limit is exceeded too often even without the undetected collisions."""
            if over is None or not over > settings.accepted_probability:
                return False
            return not missed > settings.accepted_probability or over - missed > settings.accepted_probability

        if listed(p_force):
            assert p_force is not None
            faults.append(f"the peak force exceeds {force} with probability {said(p_force)}")
        if listed(p_pressure):
            assert p_pressure is not None
            faults.append(f"the pressure exceeds {pressure} with probability {said(p_pressure)}")
        accepted = (
            f", more than the accepted {accepted_percent(settings.accepted_probability)}"
            if faults or missed > settings.accepted_probability
            else ""
        )
        if missed > settings.accepted_probability:
            faults.append(f"{said(missed)} of collisions are not detected {because} and count as over every limit")
        if false_alarm > settings.max_false_alarm:
            told = self._said(false_alarm, settings.max_false_alarm)
            faults.append(
                f"a false alarm comes before contact with probability {told} (accepted: "
                f"{accepted_percent(settings.max_false_alarm)})"
            )
        if not faults:
            return ""
        sentence = " and ".join(faults[:2]) + accepted
        if len(faults) > 2:
            sentence += "; also " + " and ".join(faults[2:])
        return sentence[0].upper() + sentence[1:] + "."

    def within(self, limits: ContactLimits | None, p_force: float | None, p_pressure: float | None) -> str:
        """How far the worst figure is from being too much."""
        if limits is None or p_force is None:
            return ""
        worst, accepted = max(p_force, p_pressure or 0.0), self._settings.accepted_probability
        what = "Peak force or pressure exceeds" if p_pressure is not None else "The peak force exceeds"
        return (
            f"{what} the limits for {limits.label} with probability {self._said(worst, accepted)}, "
            f"{within(worst, accepted, self._runs)}."
        )


def _in_either_phase(first: str, later: str) -> str:
    """The limits of both phases of contact, or the one that they share."""
    return later if first == later else f"{first} at first or {later} later"
