"""``bumpstop identify`` and ``validate`` where motor currents were recorded."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from bumpstop.arrays import finite_or_none
from bumpstop.cli.folders import writing
from bumpstop.cli.identification.arm_recordings import known_of
from bumpstop.cli.identification.fit_options import FIT_FILES
from bumpstop.cli.identification.fit_verdict import exit_status, print_reading, print_verdict
from bumpstop.cli.identification.model_report import joint_model_report
from bumpstop.cli.identification.score_table import print_scores
from bumpstop.cli.progress import progress
from bumpstop.errors import InputError
from bumpstop.terminal import terminal

if TYPE_CHECKING:
    from bumpstop.identification import CurrentComparison, JointFit, JointModelFit, JointScore
    from bumpstop.identification.segments.drive_samples import DriveSamples
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording


def identify_joint(
    logs: Sequence[Recording],
    arms: Sequence[Robot],
    *,
    robot: str,
    known: Sequence[str] | None,
    cutoff_hz: float | None,
    gravity: tuple[float, float, float] | None,
    inertia_uncertainty: float | None,
    out: Path | None,
    as_json: bool,
) -> int:
    """Fit a joint torque model, write it, and print what was found."""
    from bumpstop.identification import compare_currents, identify_joint_model, judge_joint_model
    from bumpstop.identification.drive.error_sources import INERTIA_UNCERTAINTY
    from bumpstop.model.dynamics import STANDARD_GRAVITY

    falls = STANDARD_GRAVITY if gravity is None else gravity
    uncertainty = INERTIA_UNCERTAINTY if inertia_uncertainty is None else inertia_uncertainty
    options = {"cutoff_hz": "--cutoff", "inertia_uncertainty": "--inertia-uncertainty"}
    with progress("fitting") as report:
        try:
            fit = identify_joint_model(
                logs,
                arms,
                cutoff_hz=cutoff_hz,
                known=known_of(known),
                gravity=falls,
                inertia_uncertainty=uncertainty,
                progress=report,
            )
        except InputError as error:
            if error.field.startswith("known."):
                raise InputError("--known " + error.field[6:], error.problem, error.valid) from None
            raise InputError(options.get(error.field, error.field), error.problem, error.valid) from None
    verdict = judge_joint_model(fit, logs)
    model = replace(fit.model, robot=robot, verdict=verdict.status)
    model_file = out if out is None or out.suffix == ".toml" else out / FIT_FILES["joint"]
    if model_file is not None:
        with writing(None if model_file == out else out):
            model.save(model_file)
        if out is not None and model_file != out:
            found = compare_currents(model, logs, arms, cutoff_hz=fit.cutoff_hz, gravity=falls)
            joint_model_report(
                found, arms[0], logs, out, where="on the recordings of the fit", verdict=verdict, fit=fit
            )
    if as_json:
        typer.echo(json.dumps({"verdict": verdict.to_json()} | _identified(fit, logs), allow_nan=False, indent=2))
        return exit_status(verdict)
    print_verdict(verdict)
    fit.show(terminal())
    _print_left(fit.rows)
    print_reading(logs)
    if model_file is not None:
        typer.echo(f"model: {model_file}")
    return exit_status(verdict)


def validate_joint(
    model: JointTorqueModel,
    logs: Sequence[Recording],
    arms: Sequence[Robot],
    *,
    filter_hz: float | None,
    gravity: tuple[float, float, float] | None,
    notes: Sequence[str],
    out: Path | None,
    as_json: bool,
) -> int:
    """Print how well a joint model predicts currents, and torques from them; write a page on the torques.

    ``notes`` are told with those of the comparison.
    """
    from bumpstop.identification import compare_currents, judge_currents

    with progress("comparing"):
        found = compare_currents(model, logs, arms, filter_hz=filter_hz, gravity=gravity)
        found = replace(found, notes=(*found.notes, *notes))
        currents, torques = found.current_scores(), found.torque_scores()
        verdict = judge_currents(found, logs, arms[0])
    if out is not None:
        on = "on " + ", ".join(Path(log.source).name for log in logs)
        joint_model_report(found, arms[0], logs, out, where=on, verdict=verdict)
    if as_json:
        compared = _validated(found, arms[0], currents, torques)
        typer.echo(json.dumps({"verdict": verdict.to_json()} | compared, allow_nan=False, indent=2))
        return exit_status(verdict)
    print_verdict(verdict)
    where = ", ".join(log.source for log in logs)
    at = f"at {found.filter_hz:g} Hz, errors unfiltered"
    _print_scores(found, currents, f"predicted current [{model.unit}] on {where}, compared {at}")
    _print_scores(found, torques, f"torque estimated from current against Newton-Euler, {at}")
    _print_left(found.rows)
    for note in found.notes:
        typer.echo(f"note: {note}")
    print_reading(logs)
    if out is not None:
        typer.echo(f"report: {out / 'report.html'}")
    return exit_status(verdict)


def _print_left(rows: DriveSamples) -> None:
    from bumpstop.terminal import counted

    if rows.rows_left:
        typer.echo(f"note: {counted(rows.rows_left, 'row', 'lies')} in segments between gaps too short to use")
    ends = counted(rows.rows_at_ends, "row")
    typer.echo(f"note: left out within {1 / rows.cutoff_hz:.2g} s of the ends of segments: {ends}")


def _identified(fit: JointModelFit, logs: Sequence[Recording]) -> dict[str, Any]:
    return {
        "kind": "joint_model",
        "joints": [_joint(joint) for joint in fit.joints],
        "filter": {"cutoff_hz": fit.cutoff_hz, "held_out": {f"{k:g}": v for k, v in fit.held_out.items()}},
        "loss": "huber",
        "warnings": list(fit.warnings),
        "rows_used": fit.rows_used,
        "rows_at_ends": fit.rows_at_ends,
        "rows_dropped": fit.rows_left + sum(log.report.rows_dropped for log in logs),
    }


def _joint(joint: JointFit) -> dict[str, Any]:
    own = joint.parameters
    nothing = {"value": None, "standard_error": None}
    return {
        "name": joint.name,
        "observable": joint.observable,
        "map": own.map,
        "friction": own.friction,
        "parameters": {
            name: nothing if found is None else {"value": found.value, "standard_error": found.standard_error}
            for name, found in own.parameters.items()
        },
        "gain_errors": dict(joint.gain_errors),
        "unobservable": dict(joint.unobservable),
        "r2": finite_or_none(joint.r2),
        "rmse_A": joint.rmse,
        "current_range": None if own.current_range is None else list(own.current_range),
        "speed_range": None if own.speed_range is None else list(own.speed_range),
        "rest_speed": own.rest_speed,
        "candidates": [
            {"map": tried.map, "friction": tried.friction, "held_out_A": tried.held_out, "refused": tried.refused}
            for tried in joint.candidates
        ],
    }


def _validated(
    found: CurrentComparison,
    arm: Robot,
    currents: Sequence[JointScore | None],
    torques: Sequence[JointScore | None],
) -> dict[str, Any]:
    from bumpstop.model import unit_of

    joints = []
    for joint, drive, current, torque in zip(arm.joints, found.model.joints, currents, torques, strict=True):
        score = _score(torque, unit_of(joint))
        joints.append({"name": drive.name, **_score(current, found.model.unit), "torque": score})
    left = {"rows_left": found.rows.rows_left, "rows_at_ends": found.rows.rows_at_ends}
    return {"joints": joints, "filter_hz": found.filter_hz, **left, "notes": list(found.notes)}


def _score(score: JointScore | None, unit: str) -> dict[str, Any]:
    names = ("r2", "r2_raw", "rest_share", "mean", "sd", "rmse")
    return {name: None if score is None else finite_or_none(getattr(score, name)) for name in names} | {"unit": unit}


def _print_scores(found: CurrentComparison, scores: Sequence[JointScore | None], title: str) -> None:
    print_scores(title, [joint.name for joint in found.model.joints], scores)
    hidden = [score.name for score in scores if score is not None and score.free_gain]
    if hidden:
        typer.echo(f"note: R2 of {', '.join(hidden)} is that up to a free gain: the gain is not known")
