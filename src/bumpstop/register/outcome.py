"""PASS, FAIL or INCONCLUSIVE: what a register says of a situation, stricter than the verdict of one collision."""

from __future__ import annotations

from typing import TYPE_CHECKING, Literal

from bumpstop.collision.arm.other_arm_verdict import other_arm_fails
from bumpstop.collision.verdict.finer_steps import STEPS_DECIDE, fails_with_finer_steps
from bumpstop.collision.verdict.pose_of_contact import fails_elsewhere
from bumpstop.collision.verdict.verdict_notes import sample_notes
from bumpstop.register.statements import OPEN_STATUSES

if TYPE_CHECKING:
    from bumpstop.collision import CollisionResult
    from bumpstop.register.situation import Situation
    from bumpstop.uncertainty import Judgement

Outcome = Literal["pass", "fail", "inconclusive"]
OUTCOMES: tuple[Outcome, ...] = ("fail", "inconclusive", "pass")
"""Worst first."""
OUTCOME_WORDS: dict[Outcome, str] = {"fail": "FAIL", "inconclusive": "INCONCLUSIVE", "pass": "PASS"}
"""As terminal and pages write them."""
_WORDS: dict[str, Outcome] = {word: outcome for outcome, word in OUTCOME_WORDS.items()}
_CONCLUSIONS: dict[str, Outcome] = {"not_acceptable": "fail", "acceptable": "pass"}


def outcome_of(
    situation: Situation, result: CollisionResult, judgement: Judgement | None = None
) -> tuple[Outcome, str]:
    """The outcome and its reason in a sentence.

    Where inputs are uncertain the judgement at the stated confidence takes the place of the verdict.

    A situation passes where its verdict is acceptable and nothing that was only assumed decides it. It is inconclusive
    where the verdict is, where there is no limit of force or of pressure, where the contact area was not given, where
    sampled collisions are too few, where lengths of the arm are hardly in metres, where the other model of the arm,
    finer steps or another place of contact exceed the limits, and where the register says that a value is assumed or
    unverified, or the scenario that it is assumed.
    """
    verdict = result.verdict
    if judgement is not None:
        found, told = _WORDS[judgement.word], judgement.reason
    else:
        found, told = _CONCLUSIONS.get(verdict.conclusion, "inconclusive"), verdict.reason
    if found != "pass":
        return found, told
    if verdict.conclusion == "not_acceptable":
        return "inconclusive", f"[uncertainty] leaves out the values given, which fail: {_lower(verdict.reason)}"
    reason = _open_question(situation, result)
    return ("inconclusive", reason) if reason else ("pass", told)


def _open_question(situation: Situation, result: CollisionResult) -> str:
    """Why an acceptable verdict does not settle the situation; empty where it does."""
    verdict, scenario = result.verdict, result.scenario
    too_few = sample_notes(result)
    if too_few:
        return too_few[0]
    if verdict.p_over_pressure is None:
        table = verdict.limits.table if verdict.limits else "the table"
        return f"The force is acceptable, but {table} has no pressure limit for this region: pressure is not judged."
    doubts = result.problem.robot.length_doubts
    if doubts:
        return doubts[0]
    if "area_cm2" not in scenario.contact.model_fields_set:
        return "contact.area_cm2 is not given: the pressure rests on an assumed 1 cm²."
    if fails_with_finer_steps(result.warnings):
        return STEPS_DECIDE
    if fails_elsewhere(result.warnings):
        return "Elsewhere on the line the elastic arm exceeds the limits: judge the places of contact one by one."
    question = _arm_question(result)
    if question:
        return question
    open_keys = [
        f"{key} ({statement.status})"
        for key, statement in situation.statements.items()
        if statement.status in OPEN_STATUSES
    ]
    open_keys += [f"{key} (assumed)" for key in scenario.assumed if situation.statement_of(key) is None]
    if open_keys:
        return f"The limits are kept, but on values that nobody has shown: {', '.join(open_keys)}."
    return ""


def _arm_question(result: CollisionResult) -> str:
    """Whether the other model of the arm would exceed the limits, or nobody knows."""
    if fails := other_arm_fails(result):
        return fails
    assumed = [name for name in result.problem.drive_train.assumed if name != "torque_limit"]
    if result.scenario.arm.model == "elastic" and assumed and result.other_arm is None:
        return f"The forces rest on an assumed drive train ({', '.join(assumed).replace('_', ' ')})."
    return ""


def _lower(reason: str) -> str:
    return reason[:1].lower() + reason[1:]
