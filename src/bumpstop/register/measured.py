"""What measured peaks say of the verdicts of a register: measurement decides."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

from bumpstop.register.evaluation import RegisterResult, worst_first
from bumpstop.register.shots import Shot

if TYPE_CHECKING:
    from bumpstop.register.evaluation import SituationResult

_SAME_SPEED = 1 + 1e-3


def judge_by_shots(result: RegisterResult, shots: Sequence[Shot]) -> RegisterResult:
    """The results with the shots taken into account, worst first.

    A situation fails where a shot that is no faster than its motion measured more than the force limit. One that would
    pass is inconclusive where a shot measured more than the band of its prediction: the prediction is too low. Shots
    never make a verdict better.
    """
    by_name: dict[str, list[Shot]] = {}
    for shot in shots:
        if shot.measured:
            by_name.setdefault(shot.situation, []).append(shot)
    judged = [_judge(one, by_name.get(one.situation.name, [])) for one in result.results]
    return RegisterResult(result.register, worst_first(judged))


def _judge(result: SituationResult, shots: Sequence[Shot]) -> SituationResult:
    if not shots:
        return result
    limit, speed = _force_limit(result), _speed_mm_s(result)
    over = [shot for shot in shots if shot.measured_N > limit and shot.speed_mm_s <= speed * _SAME_SPEED]
    if over:
        worst = max(over, key=lambda shot: shot.measured_N)
        reason = f"{_shot(worst)} measured {worst.measured_N:.4g} N, above the limit of {limit:g} N."
        return result if result.outcome == "fail" else replace(result, outcome="fail", reason=reason)
    above = [shot for shot in shots if shot.in_band is False and shot.measured_N > shot.high_N]
    if above and result.outcome == "pass":
        worst = max(above, key=lambda shot: shot.measured_N / max(shot.high_N, 1e-9))
        reason = (
            f"{_shot(worst)} measured {worst.measured_N:.4g} N, above the predicted {worst.low_N:.4g} to "
            f"{worst.high_N:.4g} N: the prediction is too low."
        )
        return replace(result, outcome="inconclusive", reason=reason)
    return result


def _shot(shot: Shot) -> str:
    return f"Shot {shot.shot} at {shot.speed_mm_s:g} mm/s"


def _force_limit(result: SituationResult) -> float:
    """Of the first instant of contact [N]; infinite without limits."""
    limits = result.verdict.transient or result.verdict.limits
    return math.inf if limits is None else limits.force_N


def _speed_mm_s(result: SituationResult) -> float:
    """Of the tip along its line [mm/s]; of a trajectory every shot counts."""
    velocity = result.situation.scenario.motion.velocity_mm_s
    return math.inf if velocity is None else math.hypot(*velocity)
