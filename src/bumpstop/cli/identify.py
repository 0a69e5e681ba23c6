"""``bumpstop identify`` and ``bumpstop validate``: what recordings say of an arm, and how well it is predicted."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

import typer

from bumpstop.cli.arm_recordings import arm_of, built_in_or_path, carried_of, load_parts, payloads_of
from bumpstop.cli.bodies_found import bodies_json, print_bodies
from bumpstop.cli.model_report import dynamics_report
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.identification import DynamicsFit, JointScore
    from bumpstop.identification import Payload as Carried
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

Files = Annotated[list[Path], typer.Argument(help="Recordings with motor currents or joint torques.")]
Columns = Annotated[Path | None, typer.Option(help="Column file of the recordings (TOML).")]
Begin = Annotated[float | None, typer.Option("--from", help="Begin at this time of each recording [s].")]
Until = Annotated[float | None, typer.Option(help="End at this time of each recording [s].")]
Payload = Annotated[
    list[str] | None, typer.Option(help="What the arm carries: MASS[,X,Y,Z] [kg, m], or NUMBER:... for one recording.")
]
Base = Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")]
Tip = Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")]
Topic = Annotated[str | None, typer.Option(help="Topic of a bag that has several with joint states.")]
MaxBad = Annotated[float, typer.Option(metavar="SHARE", help="Share of bad rows up to which they are dropped.")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]


def identify(
    recordings: Files,
    robot: Annotated[str, typer.Option(help="A built-in name, or the path of a URDF file.", show_default=False)],
    out: Annotated[
        Path | None,
        typer.Option("--out", "-o", help="Write the model there: a .toml, or a folder for it and a report."),
    ] = None,
    columns: Columns = None,
    begin: Begin = None,
    until: Until = None,
    model: Annotated[
        Literal["joint", "dynamics", "payload"] | None,
        typer.Option(
            help="What to fit: joint (from currents), dynamics (from torques; default: what is recorded) or payload."
        ),
    ] = None,
    payload: Payload = None,
    known: Annotated[
        list[str] | None, typer.Option(metavar="JOINT.NAME=VALUE", help="A parameter that is not to be fitted.")
    ] = None,
    cutoff: Annotated[float | None, typer.Option(help="Cut-off of the filter [Hz]; default: the best.")] = None,
    shared_motor: Annotated[
        list[str] | None, typer.Option(help="Joints that share a motor, e.g. 5,6 or 5:1,6:-1.")
    ] = None,
    consistent: Annotated[
        bool, typer.Option("--consistent", help="Of dynamics: also fit inertias that bodies can have, as a URDF.")
    ] = False,
    joint_model: Annotated[
        str | None, typer.Option(help="Of a payload: joint model that turns currents into torques, a name or a path.")
    ] = None,
    second_moments: Annotated[
        bool, typer.Option("--second-moments", help="Of a payload: fit its inertia too, not that of a point.")
    ] = False,
    protocol: Annotated[
        Path | None, typer.Option(help="Plan that was followed: fit step by step as the source.")
    ] = None,
    base: Base = None,
    tip: Tip = None,
    topic: Topic = None,
    max_bad: MaxBad = 0.01,
    as_json: AsJson = False,
) -> None:
    """Find a joint torque model from motor currents, inertia, friction and rotors from joint torques, or a payload."""
    if protocol is not None:
        from bumpstop.cli.protocol import identify_by_protocol

        _refuse("is not for a protocol", "leave it out", consistent, joint_model, second_moments)
        if model is not None:
            raise InputError("--model", "is not for a protocol", "leave it out: it finds a joint model")
        identify_by_protocol(protocol, recordings, robot, columns, out, as_json)
        return
    arm = arm_of(robot, base, tip)
    logs = load_parts(recordings, columns, arm, begin, until, topic, max_bad)
    if model is None:
        model = "joint" if all(log.current is not None and log.tau is None for log in logs) else "dynamics"
    if model == "joint":
        from bumpstop.cli.identify_joint import identify_joint

        if shared_motor:
            raise InputError("--shared-motor", "is for dynamics", "currents are taken joint by joint")
        _refuse("is not for joint models", "leave it out", consistent, joint_model, second_moments)
        arms = payloads_of(payload, arm, len(logs))
        identify_joint(
            logs, arms, robot=built_in_or_path(robot), known=known, cutoff_hz=cutoff, out=out, as_json=as_json
        )
        return
    if known:
        raise InputError("--known", "is for joint models", "leave it out")
    if model == "payload":
        from bumpstop.cli.identify_payload import identify_what_is_carried

        if shared_motor:
            raise InputError("--shared-motor", "is for dynamics", "a payload is fitted to an arm that is known")
        if payload:
            raise InputError("--payload", "is what this fit looks for", "leave it out")
        _refuse("is for dynamics", "leave it out", consistent)
        identify_what_is_carried(
            logs, arm, joint_model=joint_model, inertia=second_moments, cutoff_hz=cutoff, out=out, as_json=as_json
        )
        return
    _refuse("is for a payload", "give --model payload", False, joint_model, second_moments)
    groups = [_group(text, arm.dof) for text in shared_motor or []]
    named = {"robot": built_in_or_path(robot)}
    named |= {key: value for key, value in (("base", base), ("tip", tip)) if value is not None}
    _identify_dynamics(logs, arm, named, groups, carried_of(payload, len(logs)), cutoff, consistent, out, as_json)


def _refuse(
    problem: str, valid: str, consistent: bool, joint_model: str | None = None, second_moments: bool = False
) -> None:
    """Refuse options that belong to another kind of fit."""
    for option, given in (
        ("--consistent", consistent),
        ("--joint-model", joint_model is not None),
        ("--second-moments", second_moments),
    ):
        if given:
            raise InputError(option, problem, valid)


def _identify_dynamics(
    logs: list[Recording],
    arm: Robot,
    named: dict[str, str],
    groups: list[list[tuple[int, float]]],
    carried: list[Carried | None],
    cutoff: float | None,
    consistent: bool,
    out: Path | None,
    as_json: bool,
) -> None:
    from bumpstop.identification import consistent_inertias, identify_dynamics, save_fit
    from bumpstop.model import write_urdf

    fit = identify_dynamics(logs, arm, cutoff_hz=cutoff, couplings=groups, payloads=carried)
    bodies = consistent_inertias(logs, fit, payloads=carried) if consistent else None
    scores = fit.score(logs, payloads=carried)
    model_file = out if out is None or out.suffix == ".toml" else out / "model.toml"
    urdf = None if model_file is None or bodies is None else model_file.with_suffix(".urdf")
    if model_file is not None and out is not None:
        if model_file != out:
            dynamics_report(
                fit,
                logs,
                out,
                where="on the rows of the fit",
                filter_hz=None,
                contact_joint=None,
                bodies=bodies,
                payloads=carried,
            )
        if urdf is not None and bodies is not None:
            write_urdf(bodies.robot, urdf)
        save_fit(fit, model_file, robot=named, created_from=[log.source for log in logs])
    if as_json:
        found = _identified(fit, scores, logs) | ({} if bodies is None else {"consistent": bodies_json(bodies)})
        typer.echo(json.dumps(found, allow_nan=False, indent=2))
        return
    _print_scores(scores, fit.cutoff_hz, "on the rows of the fit")
    if fit.held_out:
        tried = ", ".join(f"{cutoff:g} Hz {100 * share:.3g} %" for cutoff, share in fit.held_out.items())
        typer.echo(f"unexplained on held-out fifths, by cut-off: {tried}")
    typer.echo(f"{len(fit.values)} base parameters from {fit.rows_used} rows")
    if fit.rows_left:
        typer.echo(f"note: {fit.rows_left} rows lie in stretches between gaps too short to use")
    for name, value, error in zip(fit.names, fit.values, fit.standard_errors, strict=True):
        if abs(value) < 2 * error:
            continue
        typer.echo(f"  {value:12.5g} +- {error:.2g}  {name}")
    if fit.unseen:
        typer.echo(f"not visible in this motion: {', '.join(fit.unseen)}")
    if bodies is not None:
        print_bodies(bodies)
    for note in (note for log in logs for note in log.report.notes):
        typer.echo(f"note: {note}")
    if model_file is not None:
        typer.echo(f"model: {model_file}")
        if urdf is not None:
            typer.echo(f"inertias: {urdf}")
        if model_file != out:
            typer.echo(f"report: {model_file.parent / 'report.html'}")


def validate(
    model: Annotated[Path, typer.Argument(help="Model that identify wrote.", show_default=False)],
    recordings: Files,
    robot: Annotated[
        str | None, typer.Option(help="A built-in name, or the path of a URDF file; default: the model's.")
    ] = None,
    columns: Columns = None,
    begin: Begin = None,
    until: Until = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write a report into this folder.")] = None,
    contact_joint: Annotated[
        int | None,
        typer.Option(help="Joint whose torque tells the contact force; default: the one that feels it most."),
    ] = None,
    filter_hz: Annotated[
        float | None, typer.Option("--filter", help="Cut-off at which they are compared [Hz]; default: the model's.")
    ] = None,
    payload: Payload = None,
    base: Base = None,
    tip: Tip = None,
    topic: Topic = None,
    max_bad: MaxBad = 0.01,
    as_json: AsJson = False,
) -> None:
    """Compare what a model predicts with recordings: currents of a joint model, torques of dynamics."""
    from bumpstop.cli.arm_recordings import is_dynamics

    if not is_dynamics(model):
        from bumpstop.cli.identify_joint import validate_joint
        from bumpstop.joint import JointTorqueModel

        if contact_joint is not None:
            raise InputError("--contact-joint", "is for dynamics", "currents are compared without contact")
        drives = JointTorqueModel.load(model)
        arm = arm_of(robot or drives.robot, base, tip)
        logs = load_parts(recordings, columns, arm, begin, until, topic, max_bad)
        arms = payloads_of(payload, arm, len(logs))
        validate_joint(drives, logs, arms, filter_hz=filter_hz, out=out, as_json=as_json)
        return
    from bumpstop.identification import load_fit

    for option, given in (("--robot", robot), ("--base", base), ("--tip", tip)):
        if given:
            raise InputError(option, "is for joint models", "dynamics know their robot")
    fit = load_fit(model)
    logs = load_parts(recordings, columns, fit.robot, begin, until, topic, max_bad)
    carried = carried_of(payload, len(logs))
    scores = fit.score(logs, filter_hz=filter_hz, payloads=carried)
    where = f"on {recordings[0]}" if len(logs) == 1 else f"on {len(logs)} recordings"
    contact = ""
    if out is not None:
        contact = dynamics_report(
            fit, logs, out, where=where, filter_hz=filter_hz, contact_joint=contact_joint, payloads=carried
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
    _print_scores(scores, filter_hz or fit.cutoff_hz, where)
    if contact:
        typer.echo(contact)
    if out is not None:
        typer.echo(f"report: {out / 'report.html'}")


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


def _identified(fit: DynamicsFit, scores: tuple[JointScore, ...], logs: list[Recording]) -> dict[str, Any]:
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
        "rows_left": fit.rows_left,
        "rows_dropped": sum(log.report.rows_dropped for log in logs),
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
