"""``bumpstop identify`` and ``validate`` of dynamics: from joint torques, or from currents with their gains."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from bumpstop.arrays import finite_or_none
from bumpstop.cli.folders import writing
from bumpstop.cli.identification.arm_recordings import carried_of, fit_notes, known_of
from bumpstop.cli.identification.consistent_inertia import inertias_json, print_inertias
from bumpstop.cli.identification.fit_options import FIT_FILES
from bumpstop.cli.identification.fit_verdict import exit_status, print_reading, print_verdict
from bumpstop.cli.identification.model_report import dynamics_report
from bumpstop.cli.identification.parameters import parameters_json
from bumpstop.cli.identification.score_table import print_scores
from bumpstop.cli.option_names import as_options
from bumpstop.cli.progress import progress
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bumpstop.identification import DynamicsFit, JointScore, Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording


def identify_dynamics_of(
    logs: Sequence[Recording],
    arm: Robot,
    *,
    named: dict[str, str],
    groups: Sequence[Sequence[tuple[int, float]]],
    carried: Sequence[Payload | None],
    known: Sequence[str] | None,
    cutoff_hz: float | None,
    gravity: tuple[float, float, float] | None,
    consistent: bool,
    out: Path | None,
    as_json: bool,
) -> int:
    """Fit dynamics, with the gains of the drives where only currents were recorded; write and print what was found."""
    from bumpstop.identification import consistent_inertias, identify_dynamics, identify_gains, judge_dynamics
    from bumpstop.model.dynamics import STANDARD_GRAVITY

    falls = STANDARD_GRAVITY if gravity is None else gravity

    if any(log.tau is None for log in logs) and all(log.current is not None for log in logs):
        if groups:
            raise InputError("--shared-motor", "is for torques", "currents are taken joint by joint")
        gains = _known_gains(known)
        with progress("fitting"):
            fit = identify_gains(logs, arm, payloads=carried, known=gains, cutoff_hz=cutoff_hz, gravity=falls)
    else:
        if known:
            raise InputError("--known", "is for drives, and torques were recorded", "leave it out")
        with as_options({"couplings": "--shared-motor"}), progress("fitting"):
            fit = identify_dynamics(logs, arm, cutoff_hz=cutoff_hz, couplings=groups, payloads=carried, gravity=falls)
    bodies = None
    if consistent:
        with progress("fitting consistent inertias"):
            bodies = consistent_inertias(logs, fit, payloads=carried)
    # Those of the page, too: of many rows the fit took blocks.
    rows = fit.model.rows(logs, payloads=carried) if fit.fitted is None else fit.fitted
    comparison = fit.model.compare_rows(rows)
    scores = comparison.scores()
    verdict = judge_dynamics(fit, logs)
    model_file = out if out is None or out.suffix == ".toml" else out / FIT_FILES["dynamics"]
    urdf = None if model_file is None or bodies is None else model_file.with_suffix(".urdf")
    if model_file is not None and out is not None:
        # Before the page: whatever fails there, a long fit is not lost.
        with writing(out if model_file != out else None):
            replace(fit, source=named, model=replace(fit.model, verdict=verdict.status)).save(model_file)
            if urdf is not None and bodies is not None:
                bodies.save(urdf)
        if model_file != out:
            dynamics_report(
                fit,
                comparison,
                logs,
                out,
                where="on the rows of the fit",
                contact_joint=None,
                bodies=bodies,
                payloads=carried,
                verdict=verdict,
            )
    if as_json:
        found = {"verdict": verdict.to_json()} | _identified(fit, scores, logs)
        found |= {} if bodies is None else {"consistent": inertias_json(bodies)}
        typer.echo(json.dumps(found, allow_nan=False, indent=2))
        return exit_status(verdict)
    print_verdict(verdict)
    _print_scores(scores, fit.model.cutoff_hz, "on the rows of the fit")
    typer.echo(str(fit))
    if bodies is not None:
        print_inertias(bodies)
    print_reading(logs)
    if model_file is not None:
        typer.echo(f"model: {model_file}")
        if urdf is not None:
            typer.echo(f"inertias: {urdf}")
        if model_file != out:
            typer.echo(f"report: {model_file.parent / 'report.html'}")
    return exit_status(verdict)


def validate_dynamics(
    model: Path,
    load: Callable[[Robot], list[Recording]],
    *,
    payload: Sequence[str] | None,
    contact_joint: int | None,
    filter_hz: float | None,
    out: Path | None,
    as_json: bool,
) -> int:
    """Compare predicted with recorded torques.

    ``load`` reads the recordings of the model's robot.
    """
    from bumpstop.identification import DynamicsFit, judge_predictions
    from bumpstop.identification.dynamics.dynamics_fit import left_out_notes

    fit = DynamicsFit.load(model)
    logs = load(fit.model.robot)
    carried = carried_of(payload, len(logs))
    with progress("comparing"):
        rows = fit.model.rows(logs, payloads=carried)
        comparison = fit.model.compare_rows(rows, filter_hz=filter_hz)
        scores = comparison.scores()
        verdict = judge_predictions(fit, rows, scores, filter_hz or fit.model.cutoff_hz, logs)
    where = f"on {logs[0].source}" if len(logs) == 1 else f"on {len(logs)} recordings"
    notes = [*fit.model.robot.doubts, *fit_notes(model, logs)]
    contact = ""
    if out is not None:
        contact = dynamics_report(
            fit,
            comparison,
            logs,
            out,
            where=where,
            contact_joint=contact_joint,
            payloads=carried,
            verdict=verdict,
        )
    if as_json:
        joints = [_score_json(score) for score in scores]
        left = {"rows_left": rows.rows_left, "rows_beside_gaps": rows.rows_beside_gaps}
        found = {"verdict": verdict.to_json(), "joints": joints} | left | {"notes": notes}
        typer.echo(json.dumps(found, allow_nan=False, indent=2))
        return exit_status(verdict)
    print_verdict(verdict)
    _print_scores(scores, filter_hz or fit.model.cutoff_hz, where)
    for note in left_out_notes(rows.rows_left, rows.rows_beside_gaps, fit.model.cutoff_hz):
        typer.echo(note)
    if contact:
        typer.echo(contact)
    print_reading(logs)
    for note in notes:
        typer.echo(f"note: {note}")
    if out is not None:
        typer.echo(f"report: {out / 'report.html'}")
    return exit_status(verdict)


def _identified(fit: DynamicsFit, scores: tuple[JointScore, ...], logs: Sequence[Recording]) -> dict[str, Any]:
    found = parameters_json(fit)
    joints = []
    for j, score in enumerate(scores, start=1):
        own = {
            what: found[f"{what}_{j}"] for what in ("coulomb", "viscous", "rotor", "offset") if f"{what}_{j}" in found
        }
        if fit.model.gains is not None:
            own["B"] = found[f"gain_{j}"]
        joints.append(
            {
                "name": score.name,
                "observable": bool(own) and not score.free_gain,
                "parameters": own,
                "r2": finite_or_none(score.r2),
                "rmse_Nm": None if score.free_gain else score.rmse,
            }
        )
    base = [{"name": name} | found[name.split()[0]] for name in fit.names]
    return {
        "joints": joints,
        "base_parameters": base,
        "filter": {"cutoff_hz": fit.model.cutoff_hz, "held_out": {f"{k:g}": v for k, v in fit.held_out.items()}},
        "not_visible": list(fit.unobservable),
        "hardly_moved": list(fit.still),
        "rows_used": fit.rows_used,
        "rows_whole": fit.rows_whole,
        "rows_left": fit.rows_left,
        "rows_beside_gaps": fit.rows_beside_gaps,
        "rows_at_ends": fit.rows_at_ends,
        "rows_at_rest": [] if fit.rows_at_rest is None else [int(rows) for rows in fit.rows_at_rest],
        "rows_dropped": sum(log.report.rows_dropped for log in logs),
        "notes": list(fit.model.robot.doubts),
    }


def _score_json(score: JointScore) -> dict[str, Any]:
    shares = {
        "r2": finite_or_none(score.r2),
        "r2_raw": finite_or_none(score.r2_raw),
        "rest_share": score.rest_share,
    }
    return {"name": score.name, **shares, "mean": score.mean, "sd": score.sd, "rmse": score.rmse, "unit": score.unit}


def _known_gains(given: Sequence[str] | None) -> dict[str, float]:
    found = {}
    for joint, parameters in known_of(given).items():
        for name, value in parameters.items():
            if name != "B":
                raise InputError(
                    "--known", f"{joint}.{name} is no gain", "beside dynamics a gain can be known: JOINT.B"
                )
            found[joint] = value
    return found


def _print_scores(scores: Sequence[JointScore], cutoff_hz: float, where: str) -> None:
    title = f"predicted torque {where}, compared at {cutoff_hz:g} Hz, errors unfiltered"
    print_scores(title, [score.name for score in scores], scores)
    if hidden := [score.name for score in scores if score.free_gain]:
        typer.echo(f"note: R2 of {', '.join(hidden)} is that up to a free gain, errors are of the current [A]")
