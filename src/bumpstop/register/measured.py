"""What measured peaks and pressures say of the verdicts of a register: measurement decides."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np

from bumpstop.collision import evaluate
from bumpstop.collision.probability_text import accepted_percent
from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.errors import InputError
from bumpstop.register.evaluation import RegisterResult, worst_first
from bumpstop.register.shots import Shot
from bumpstop.terminal import as_written, in_percent, number

if TYPE_CHECKING:
    from bumpstop.register.evaluation import SituationResult

_SAME_SPEED = 1 + 1e-3
# Where a shot's speed is farther from that of the motion, its band may be that of the motion by mistake.
_SPEED_TOLERANCE = 0.05
# A peak below this share of the least that was predicted is hardly a reading in N of that contact.
_MIN_SHARE = 1 / 3
# The same of the median, where there is no band.
_MIN_SHARE_OF_MEDIAN = 1 / 5
# A band with ends farther apart than this holds every reading, and judges none.
_WIDEST = 10.0

Finding = Literal[
    "over_limit",
    "unusable",
    "unread",
    "no_peak",
    "speed",
    "low_reading",
    "above",
    "other",
    "not_computed",
    "below",
    "in_band",
    "no_band",
    "not_measured",
]
_WORDS: dict[Finding, str] = {
    "over_limit": "above the limit",
    "unusable": "recording cannot be relied on",
    "unread": "recording not read",
    "no_peak": "no peak force",
    "speed": "speed? the band is of another",
    "low_reading": "far below: reading or unit?",
    "above": "above",
    "other": "prediction of another contact?",
    "not_computed": "cannot be computed",
    "below": "below",
    "in_band": "in the band",
    "no_band": "",
    "not_measured": "not measured yet",
}
# What is computed for the situation itself is no more than this times what its gauge is predicted to show, unless the
# gauge's spring is far softer than the body.
_SAME_CONTACT = 2.0
# So many shots of one situation that all lie above their predictions are hardly chance.
_SEVERAL = 3
# What changes a verdict, the gravest first.
_GRAVE: tuple[Finding, ...] = (
    *("over_limit", "unusable", "unread", "no_peak", "speed", "low_reading", "above", "other"),
    "not_computed",
)


@dataclass(frozen=True)
class JudgedShot:
    """A shot beside its prediction.

    Attributes:
        shot: what was measured.
        finding: what it says.
        reason: why the verdict may not hold, in a sentence; empty: nothing is against it.
        excess: how far it is beyond what it should be; the largest of several shots is the worst.
    """

    shot: Shot
    finding: Finding
    reason: str = ""
    excess: float = 0.0

    @property
    def words(self) -> str:
        """The finding as pages write it."""
        return _WORDS[self.finding]


@dataclass(frozen=True)
class _Expected:
    """The peak force at the speed of a shot.

    Attributes:
        median: of it [N]; NaN: it cannot be computed.
        most: quantile of the accepted probability [N]; NaN likewise.
        problem: why it cannot be computed.
    """

    median: float
    most: float
    problem: str = ""


_Expectation = Callable[["SituationResult", float], _Expected]


def judge_by_shots(result: RegisterResult, shots: Sequence[Shot]) -> RegisterResult:
    """The results with the shots taken into account, worst first.

    A situation fails where a shot that is no faster than its motion measured more than the force limit, or at least as
    much, and where after the first half second it pressed with more than the limit of what lasts; and where it measured
    more than the pressure limit of the same phase, if the table has one. One that would pass is inconclusive where a
    shot measured more than the band of its prediction, or without a band more than the quantile of the accepted
    probability at its speed: the prediction is too low. So it is where a shot measured less than a third of the band's
    lower end (without a band, a fifth of the median), where its band is that of the motion and its speed is another,
    where its prediction is less than half of what is computed, where it was made and has no peak that can be relied on,
    and where what it should measure cannot be computed: such a shot shows nothing. What does not change the verdict
    stands beside it as a warning, and so does that several shots all lie above their predictions.
    Shots never make a verdict better.
    """
    judged: dict[str, list[JudgedShot]] = {}
    for one in judged_shots(result, shots):
        judged.setdefault(one.shot.situation, []).append(one)
    results = [_judge(one, judged.get(one.situation.name, [])) for one in result.results]
    return RegisterResult(result.register, worst_first(results))


def judged_shots(result: RegisterResult, shots: Sequence[Shot]) -> tuple[JudgedShot, ...]:
    """Every shot beside its prediction, in the order given."""
    by_name = {one.situation.name: one for one in result.results}
    known: dict[tuple[str, float], _Expected] = {}

    def expected(situation: SituationResult, speed_mm_s: float) -> _Expected:
        key = (situation.situation.name, speed_mm_s)
        if key not in known:
            known[key] = _expected(situation, speed_mm_s)
        return known[key]

    def judged(shot: Shot) -> JudgedShot:
        return _judged(shot, by_name[shot.situation], expected)

    return tuple(judged(shot) for shot in shots)


def _judge(result: SituationResult, shots: Sequence[JudgedShot]) -> SituationResult:
    result = replace(result, warnings=(*result.warnings, *_bias(result, [one.shot for one in shots])))
    reasons = {}
    for finding in _GRAVE:
        found = [one for one in shots if one.finding == finding]
        if found:
            reasons[finding] = max(found, key=lambda one: one.excess).reason
    if not reasons:
        return result
    gravest, *others = reasons.values()
    outcome = result.outcome
    if "over_limit" in reasons and outcome != "fail":
        return replace(result, outcome="fail", reason=gravest, warnings=(*result.warnings, *others))
    if outcome == "pass":
        return replace(result, outcome="inconclusive", reason=gravest, warnings=(*result.warnings, *others))
    return replace(result, warnings=(*result.warnings, *reasons.values()))


def _bias(result: SituationResult, shots: Sequence[Shot]) -> list[str]:
    """A warning where a verdict of point values rests on a prediction that all shots exceed."""
    ratios = [one.measured_N / one.predicted_N for one in shots if one.measured and one.predicted_N > 0]
    if result.confidence is not None or len(ratios) < _SEVERAL or min(ratios) <= 1:
        return []
    above = in_percent(float(np.median(ratios)) - 1, 2)
    return [
        f"All {len(ratios)} measured shots lie above their predictions, by {above} in the middle: the scenario "
        "computes too little force. Run bumpstop measure calibrate, and file the dossier of its register."
    ]


def _judged(shot: Shot, result: SituationResult, expected: _Expectation) -> JudgedShot:
    limit, speed, measured = _force_limit(result), _speed_mm_s(result), shot.measured_N
    told = f"Shot {shot.shot} at {shot.speed_mm_s:g} mm/s"
    pressed = f"{told} pressed with {as_written(shot.lasting_N)} N after the first {FIRST_PHASE_S:g} s"
    if shot.without_peak:
        measured = shot.lower_bound_N
        told += "" if math.isnan(measured) else f" measured at least {as_written(measured)} N"
    elif not shot.measured:
        return JudgedShot(shot, "not_measured")
    else:
        told += f" measured {as_written(measured)} N"
    if shot.speed_mm_s <= speed * _SAME_SPEED:
        if measured > limit:
            reason = f"{told}, above the limit of {as_written(limit)} N."
            return JudgedShot(shot, "over_limit", reason, _use(measured, limit))
        if shot.lasting_N > (limit := _lasting_limit(result)):
            reason = f"{pressed}, above the limit of {as_written(limit)} N."
            return JudgedShot(shot, "over_limit", reason, _use(shot.lasting_N, limit))
        if (over := _judged_by_pressure(shot, result)) is not None:
            return over
    if shot.without_peak:
        return _judged_without_peak(shot, told)
    if shot.in_band is None or shot.high_N > _WIDEST * shot.low_N:
        return _judged_without_band(shot, result, (told, pressed), expected(result, shot.speed_mm_s))
    # Only a band that may be that of another speed is compared with what is computed.
    here = expected(result, shot.speed_mm_s) if _may_be_band_of_motion(shot, result) else None
    if here is not None and math.isnan(here.median):
        return _not_computed(shot, told, here)
    band = f"{as_written(shot.low_N)} to {as_written(shot.high_N)} N"
    if here is not None and not shot.low_N <= here.median <= shot.high_N:
        reason = f"{told}, and its band of {band} is that of {speed:.4g} mm/s, the speed of the motion: speed or row?"
        return JudgedShot(shot, "speed", reason, abs(math.log(max(shot.speed_mm_s, 1e-9) / speed)))
    if measured < _MIN_SHARE * shot.low_N:
        reason = f"{told}, below a third of the predicted {band}: reading or unit?"
        return JudgedShot(shot, "low_reading", reason, shot.low_N - measured)
    highest = _highest(shot)
    if highest > shot.high_N:
        reason = f"{told if measured >= highest else pressed}, above the predicted {band}: the prediction is too low."
        return JudgedShot(shot, "above", reason, highest / max(shot.high_N, 1e-9))
    if reason := _of_another_contact(shot, result, expected):
        return JudgedShot(shot, "other", reason)
    return JudgedShot(shot, "in_band" if shot.in_band else "below")


def _judged_by_pressure(shot: Shot, result: SituationResult) -> JudgedShot | None:
    """What a pressure above the limit of its phase says; None: there is none. One that was cut off says as much."""
    limits = result.verdict.limits
    phases = (result.verdict.transient or limits, ""), (limits, f" after the first {FIRST_PHASE_S:g} s")
    for pressure, (of_phase, when) in zip(shot.pressures_N_cm2, phases, strict=True):
        limit = None if of_phase is None else of_phase.pressure_N_cm2
        if limit is not None and pressure > limit:
            reason = (
                f"Shot {shot.shot} at {shot.speed_mm_s:g} mm/s measured a pressure of {as_written(pressure)} N/cm²"
                f"{when}, above the limit of {as_written(limit)} N/cm²."
            )
            return JudgedShot(shot, "over_limit", reason, _use(pressure, limit))
    return None


def _use(measured: float, limit: float) -> float:
    """Forces and pressures in one measure: the share of the limit that was used."""
    return measured / max(limit, 1e-9)


def _of_another_contact(shot: Shot, result: SituationResult, expected: _Expectation) -> str:
    """Why a shot that agrees with its prediction shows nothing of the situation; empty: it does."""
    if not math.isfinite(_speed_mm_s(result)):
        return ""  # what is computed of a trajectory is of its own speed
    computed = expected(result, shot.speed_mm_s).median
    known = math.isfinite(shot.predicted_N)
    predicted = shot.predicted_N if known else shot.high_N
    if not _SAME_CONTACT * predicted < computed < math.inf:
        return ""
    return (
        f"Shot {shot.shot} at {shot.speed_mm_s:g} mm/s has a prediction of {'' if known else 'up to '}"
        f"{as_written(predicted)} N, and {number(computed)} N are computed at this speed: is it of this situation, its "
        "body region and speed?"
    )


def _highest(shot: Shot) -> float:
    """The greatest force of the whole contact, which predictions are of [N]."""
    return float(np.fmax(shot.measured_N, shot.lasting_N))


def _judged_without_peak(shot: Shot, told: str) -> JudgedShot:
    if shot.recording and not shot.unusable_recording and math.isnan(shot.lower_bound_N):
        reason = (
            f"{told} has a recording, {shot.recording!r}, that was not read: fill in its peak, or run bumpstop measure "
            "calibrate and give its shots.csv."
        )
        return JudgedShot(shot, "unread", reason)
    if not shot.unusable_recording and math.isnan(shot.lower_bound_N):
        return JudgedShot(shot, "no_peak", f"{told} has no peak force: fill it in, or repeat the shot.")
    of = f" {shot.unusable_recording!r}" if shot.unusable_recording else ""
    reason = f"{told}: its recording{of} cannot be relied on, repeat the shot."
    return JudgedShot(shot, "unusable", reason, 0.0 if math.isnan(shot.lower_bound_N) else shot.lower_bound_N)


def _judged_without_band(shot: Shot, result: SituationResult, words: tuple[str, str], here: _Expected) -> JudgedShot:
    told, pressed = words
    # NaN is above nothing and below nothing, and would let any peak pass.
    if math.isnan(here.median) or math.isnan(here.most):
        return _not_computed(shot, told, here)
    highest = _highest(shot)
    if highest > here.most:
        accepted = accepted_percent(result.verdict.accepted_probability)
        said = told if shot.measured_N >= highest else pressed
        most = number(here.most, highest)
        reason = f"{said}, above the {most} N that {accepted} should exceed: the prediction is too low."
        return JudgedShot(shot, "above", reason, highest / max(here.most, 1e-9))
    if shot.measured_N < _MIN_SHARE_OF_MEDIAN * here.median < math.inf:
        reason = f"{told}, below a fifth of the computed median of {number(here.median)} N: reading or unit?"
        return JudgedShot(shot, "low_reading", reason, here.median - shot.measured_N)
    return JudgedShot(shot, "no_band")


def _not_computed(shot: Shot, told: str, here: _Expected) -> JudgedShot:
    because = f" ({here.problem})" if here.problem else ""
    reason = f"{told}, and what it should measure cannot be computed at this speed{because}."
    return JudgedShot(shot, "not_computed", reason, shot.measured_N)


def _may_be_band_of_motion(shot: Shot, result: SituationResult) -> bool:
    """Whether the band holds what is computed at the motion's own speed, and the shot's is another.

    Plans have shots at other speeds than the motion's, each with the band of its speed.
    """
    speed, own = _speed_mm_s(result), result.peak_force["p50"]
    if not math.isfinite(speed) or abs(shot.speed_mm_s - speed) <= _SPEED_TOLERANCE * speed:
        return False
    return shot.low_N <= own <= shot.high_N


def _expected(result: SituationResult, speed_mm_s: float) -> _Expected:
    """Of a line at that speed, of a trajectory as it is."""
    scenario = result.situation.scenario.without_uncertainty()
    velocity = scenario.motion.velocity_mm_s
    try:
        if velocity is not None:
            along = np.array(velocity) / math.hypot(*velocity)
            scenario = scenario.with_values({"motion.velocity_mm_s": (speed_mm_s * along).tolist()})
        force = evaluate(scenario).peak_force
    except InputError as error:
        return _Expected(math.nan, math.nan, f"{error.field} {error.problem}")
    return _Expected(force.quantile(0.5), force.quantile(1 - result.verdict.accepted_probability))


def _force_limit(result: SituationResult) -> float:
    """Of the first instant of contact [N]; infinite without limits."""
    limits = result.verdict.transient or result.verdict.limits
    return math.inf if limits is None else limits.force_N


def _lasting_limit(result: SituationResult) -> float:
    """Of what lasts beyond the first phase [N]; infinite without limits."""
    limits = result.verdict.limits
    return math.inf if limits is None else limits.force_N


def _speed_mm_s(result: SituationResult) -> float:
    """Of the tip along its line [mm/s]; of a trajectory every shot counts."""
    velocity = result.situation.scenario.motion.velocity_mm_s
    return math.inf if velocity is None else math.hypot(*velocity)
