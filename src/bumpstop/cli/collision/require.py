"""``bumpstop require``: how far one thing may go before a scenario is no longer acceptable."""

from __future__ import annotations

import json
import math
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.collision.evaluate import INCONCLUSIVE, NOT_ACCEPTABLE
from bumpstop.cli.collision.study import AsJson, Changes, ScenarioFile, load
from bumpstop.cli.completion import complete_requirement
from bumpstop.cli.option_names import as_options
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.study.requirement.requirement import Requirement
    from bumpstop.uncertainty.judgement import Judgement

_STATUS = {"PASS": 0, "FAIL": NOT_ACCEPTABLE, "INCONCLUSIVE": INCONCLUSIVE}
_COUNT = 8  # of the second variable's values, where none is given


def require(
    scenario: ScenarioFile,
    vary: Annotated[
        list[str],
        typer.Option(
            metavar="KEY[=LOW:HIGH]",
            autocompletion=complete_requirement,
            help="What is varied, and between which values; a second one makes a trade curve.",
            show_default=False,
        ),
    ],
    risk: Annotated[
        float | None,
        typer.Option(
            metavar="PROBABILITY", help="Accepted; default: verdict.accepted_probability.", show_default=False
        ),
    ] = None,
    as_json: AsJson = False,
    changes: Changes = None,
) -> int:
    """Find the least conservative value that meets the limits; every more conservative value meets them, too.

    Keys: motion.speed, detector.thresholds, detector.feedback_period_s, reaction.joint_acceleration_rad_s2,
    contact.padding. Exit status: 0 found, 3 no value meets the limits or alarms are too probable there, 2 bad input.
    With [uncertainty] the value that was found is judged with it: 3 where it fails, 4 where it is inconclusive.
    """
    from bumpstop.cli.progress import progress
    from bumpstop.study import to_jsonable
    from bumpstop.study.answer_warnings import AnswerWarnings, told_once
    from bumpstop.study.range import Range
    from bumpstop.study.requirement.requirement import require_curve, solve_requirement
    from bumpstop.study.variable import Variable

    checked = load(scenario, changes)
    if len(vary) > 2:
        raise InputError("--vary", f"is given {len(vary)} times", "wanted one variable, or two for a trade curve")
    name, low, high = _ends(vary[0], checked)
    if len(vary) == 1:
        with as_options({"vary": "--vary", "risk": "--risk"}), progress("searching"):
            found = solve_requirement(checked, name, risk=risk, low=low, high=high)
        judged = _judged(checked, found)
        if as_json:
            told = {"uncertainty": _told(judged)} if judged else {}
            typer.echo(json.dumps(to_jsonable(found.to_json() | told), allow_nan=False, indent=2))
        else:
            typer.echo(str(found))
            if name == "detector.thresholds" and found.value is not None:
                typer.echo(f"that is the lowest threshold; by joint {_thresholds(checked, found.value)}")
            if judged:
                typer.echo(f"there, with [uncertainty]: {judged.word}. {judged.reason}")
        if found.value is None or not found.false_alarm_ok:
            return NOT_ACCEPTABLE
        return _STATUS[judged.word] if judged else 0
    if "=" not in vary[1]:
        raise InputError("--vary", f"{vary[1]!r} has no range", f"wanted {vary[1]}=LOW:HIGH")
    against = Range.parse(vary[1], checked, count=_COUNT)
    with progress("searching"):
        rows = require_curve(checked, name, against, risk=risk, low=low, high=high)
    if as_json:
        typer.echo(json.dumps(to_jsonable({"curve": rows}), allow_nan=False, indent=2))
    else:
        _print_curve(rows, Variable(name).label(checked), against.variable.label(checked))
        given = [note for note in rows[0]["notes"] if all(note in row["notes"] for row in rows)]
        beside = [
            AnswerWarnings(f"{row['against']['variable']} = {row['against']['value']:.6g}", row["notes"])
            for row in rows
        ]
        for note in [*given, *told_once(beside, given)]:
            typer.echo(f"note: {note}")
    return 0 if any(row["value"] is not None and row["false_alarm_ok"] for row in rows) else NOT_ACCEPTABLE


def _judged(scenario: Scenario, found: Requirement) -> Judgement | None:
    """Of the value that was found, with what is uncertain; None without a value, or where all is known."""
    if found.value is None or not scenario.uncertainty:
        return None
    from bumpstop.study.variable import Variable
    from bumpstop.uncertainty import Judgement, judge_situation

    there = Variable(found.variable).apply(scenario, found.value)
    try:
        return judge_situation(there.with_values({"verdict.accepted_probability": found.risk}))
    except InputError as error:
        # Figures of [uncertainty] that the value leaves behind: what was found is told all the same.
        return Judgement("INCONCLUSIVE", f"{error}.", math.nan, math.nan, None, 0, "inconclusive")


def _told(judged: Judgement) -> dict[str, Any]:
    return {"word": judged.word, "reason": judged.reason, "confidence": judged.confidence}


def _ends(text: str, scenario: Scenario) -> tuple[str, float | None, float | None]:
    from bumpstop.study.range import Range
    from bumpstop.study.requirement.requirement import check_name
    from bumpstop.study.variable import canonical

    name, given, span = (part.strip() for part in text.partition("="))
    name = canonical(name)
    check_name(name)
    if not given:
        return name, None, None
    if span.count(":") != 1 or span.startswith("["):
        # Which values are looked at between the ends is for the search to say.
        raise InputError("--vary", f"{text!r} is not KEY=LOW:HIGH", f"for example --vary {name}=10:200")
    ends = Range.parse(text, scenario)
    return name, ends.low, ends.high


def _thresholds(scenario: Scenario, lowest: float) -> str:
    from bumpstop.collision.scenario.scenario_file import robot_of
    from bumpstop.model import unit_of
    from bumpstop.study.variable import Variable

    each = Variable("detector.thresholds").changes(scenario, lowest)["detector.thresholds_Nm"]
    unit = unit_of(*robot_of(scenario).joints)
    return ", ".join(f"{threshold:.6g}" for threshold in each) + f" {unit}"


def _print_curve(rows: list[dict[str, Any]], required: str, against: str) -> None:
    from bumpstop.collision.probability_text import percent
    from bumpstop.study.answer_warnings import FAILS_WITH_FINER_STEPS

    typer.echo(f"{against:>36}  {required:>36}  fails by")
    for row in rows:
        value = "no value" if row["value"] is None else f"{row['value']:.4g}"
        alarms = "" if row["false_alarm_ok"] else f"; alarms before contact {percent(row['false_alarm_at_value'])}"
        steps = f"; {FAILS_WITH_FINER_STEPS}" if row["fails_with_finer_steps"] else ""
        typer.echo(f"{row['against']['value']:>36.6g}  {value:>36}  {row['binding']}{alarms}{steps}")
