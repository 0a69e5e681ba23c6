"""``bumpstop identify`` and ``bumpstop validate``: what recordings say of an arm, and how well it is predicted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.model_report import dynamics_report
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.identification import DynamicsFit, JointScore
    from bumpstop.recording import Recording

Columns = Annotated[Path | None, typer.Option(help="Column file of the recording (TOML).")]
Begin = Annotated[float | None, typer.Option("--from", help="Begin at this time of the recording [s].")]
Until = Annotated[float | None, typer.Option(help="End at this time of the recording [s].")]


def identify(
    recordings: Annotated[list[Path], typer.Argument(help="Recordings.", show_default=False)],
    robot: Annotated[str, typer.Option(help="A built-in name, or the path of a URDF file.", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the model there: a .toml, or a folder for it and a report."),
    ] = None,
    columns: Columns = None,
    begin: Begin = None,
    until: Until = None,
    cutoff: Annotated[float | None, typer.Option(help="Cut-off of the filter [Hz]; default: the best.")] = None,
    shared_motor: Annotated[
        list[str] | None, typer.Option(help="Joints that share a motor, e.g. 5,6 or 5:1,6:-1.")
    ] = None,
    protocol: Annotated[
        Path | None, typer.Option(help="Plan that was followed: fit step by step as the source.")
    ] = None,
    base: Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")] = None,
    tip: Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Find inertial parameters, friction and rotor inertia of an arm from recorded torques."""
    from bumpstop.identification import identify_dynamics, save_fit
    from bumpstop.model import Robot

    if protocol is not None:
        from bumpstop.cli.protocol import identify_by_protocol

        identify_by_protocol(protocol, recordings, robot, columns, out, as_json)
        return
    if len(recordings) != 1:
        raise InputError("recording", f"{len(recordings)} of them", "dynamics are fitted to one")
    recording = recordings[0]
    is_file = bool(Path(robot).suffix) or "/" in robot
    arm = Robot.from_urdf(robot, base, tip) if is_file else Robot.load(robot)
    log = part_of(recording, columns, arm, begin, until)
    groups = [_group(text, arm.dof) for text in shared_motor or []]
    fit = identify_dynamics(log, arm, cutoff_hz=cutoff, couplings=groups)
    scores = fit.score(log)
    model_file = out if out is None or out.suffix == ".toml" else out / "model.toml"
    if model_file is not None and out is not None:
        if model_file != out:
            dynamics_report(fit, log, out, where="on the rows of the fit", filter_hz=None, contact_joint=None)
        named = {"robot": str(Path(robot).resolve()) if is_file else robot}
        named |= {key: value for key, value in (("base", base), ("tip", tip)) if value is not None}
        save_fit(fit, model_file, robot=named, created_from=[str(recording)])
    if as_json:
        typer.echo(json.dumps(_identified(fit, scores, log), allow_nan=False, indent=2))
        return
    _print_scores(scores, fit.cutoff_hz, "on the rows of the fit")
    if fit.held_out:
        tried = ", ".join(f"{cutoff:g} Hz {100 * share:.3g} %" for cutoff, share in fit.held_out.items())
        typer.echo(f"unexplained on held-out fifths, by cut-off: {tried}")
    typer.echo(f"{len(fit.values)} base parameters from {fit.rows_used} rows")
    for name, value, error in zip(fit.names, fit.values, fit.standard_errors, strict=True):
        if abs(value) < 2 * error:
            continue
        typer.echo(f"  {value:12.5g} +- {error:.2g}  {name}")
    if fit.unseen:
        typer.echo(f"not visible in this motion: {', '.join(fit.unseen)}")
    for note in log.report.notes:
        typer.echo(f"note: {note}")
    if model_file is not None:
        typer.echo(f"model: {model_file}")
        if model_file != out:
            typer.echo(f"report: {model_file.parent / 'report.html'}")


def validate(
    model: Annotated[Path, typer.Argument(help="Model that identify wrote.", show_default=False)],
    recording: Annotated[Path, typer.Argument(help="Recording with joint torques.", show_default=False)],
    columns: Columns = None,
    begin: Begin = None,
    until: Until = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write a report into this folder.")] = None,
    contact_joint: Annotated[
        int | None,
        typer.Option(help="Joint whose torque tells the contact force; default: the one that feels it most."),
    ] = None,
    filter_hz: Annotated[
        float | None, typer.Option("--filter", help="Cut-off at which torques are compared [Hz]; default: the model's.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Compare the torques a model predicts with those of a recording."""
    from bumpstop.identification import load_fit

    fit = load_fit(model)
    log = part_of(recording, columns, fit.robot, begin, until)
    scores = fit.score(log, filter_hz=filter_hz)
    contact = ""
    if out is not None:
        contact = dynamics_report(
            fit, log, out, where=f"on {recording}", filter_hz=filter_hz, contact_joint=contact_joint
        )
    if as_json:
        joints = [
            {
                "name": score.name,
                "r2": score.r2,
                "r2_raw": score.r2_raw,
                "mean": score.mean,
                "sd": score.sd,
                "rmse": score.rmse,
                "unit": unit,
            }
            for score, unit in zip(scores, _units(fit), strict=True)
        ]
        typer.echo(json.dumps({"joints": joints}, allow_nan=False, indent=2))
        return
    _print_scores(scores, filter_hz or fit.cutoff_hz, f"on {recording}")
    if contact:
        typer.echo(contact)
    if out is not None:
        typer.echo(f"report: {out / 'report.html'}")


def part_of(path: Path, columns: Path | None, robot: Any, begin: float | None, until: float | None) -> Recording:
    """A recording, or what lies between two times of it, counted from its beginning [s]."""
    from bumpstop.recording import Recording

    log = Recording.load(path, columns=columns, robot=robot)
    start, end = float(log.t[0]), float(log.t[-1])
    if begin is None and until is None:
        return log
    first = start if begin is None else start + begin
    last = end if until is None else start + until
    if not first < last:
        raise InputError("--from", f"{begin} leaves nothing before {until}", f"valid: 0 to {end - start:.6g} s")
    return log.between(first, last)


def _group(text: str, dof: int) -> list[tuple[int, float]]:
    group = []
    for part in text.split(","):
        number, _, share = part.partition(":")
        try:
            joint, factor = int(number), float(share or 1)
        except ValueError:
            joint, factor = 0, 0.0
        if not 1 <= joint <= dof or factor == 0:
            raise InputError("--shared-motor", f"{text!r} cannot be used", f"for example 5,6; joints are 1 to {dof}")
        group.append((joint - 1, factor))
    return group


def _units(fit: DynamicsFit) -> list[str]:
    return ["N" if joint.kind == "prismatic" else "Nm" for joint in fit.robot.joints]


def _identified(fit: DynamicsFit, scores: tuple[JointScore, ...], log: Recording) -> dict[str, Any]:
    found = {
        name.split()[0]: {"value": float(value), "standard_error": float(error)}
        for name, value, error in zip(fit.names, fit.values, fit.standard_errors, strict=True)
    }
    joints = []
    for j, score in enumerate(scores, start=1):
        own = {
            what: found[f"{what}_{j}"] for what in ("coulomb", "viscous", "rotor", "offset") if f"{what}_{j}" in found
        }
        joints.append(
            {"name": score.name, "observable": bool(own), "parameters": own, "r2": score.r2, "rmse_Nm": score.rmse}
        )
    base = [
        {"name": name, "value": float(value), "standard_error": float(error)}
        for name, value, error in zip(fit.names, fit.values, fit.standard_errors, strict=True)
    ]
    return {
        "joints": joints,
        "base_parameters": base,
        "filter": {"cutoff_hz": fit.cutoff_hz, "held_out": {f"{k:g}": v for k, v in fit.held_out.items()}},
        "not_visible": list(fit.unseen),
        "rows_used": fit.rows_used,
        "rows_dropped": len(log.report.dropped),
    }


def _print_scores(scores: tuple[JointScore, ...], cutoff_hz: float, where: str) -> None:
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    for heading in ("joint", "R2", "R2 unfiltered", "mean error", "sd", "rmse"):
        table.add_column(heading, justify="left" if heading == "joint" else "right")
    for score in scores:
        errors = (score.mean, score.sd, score.rmse)
        table.add_row(score.name, f"{score.r2:.4f}", f"{score.r2_raw:.4f}", *(f"{error:.4g}" for error in errors))
    console = Console(highlight=False, markup=False)
    console.print(f"predicted torque {where}, compared at {cutoff_hz:g} Hz")
    console.print(table)
