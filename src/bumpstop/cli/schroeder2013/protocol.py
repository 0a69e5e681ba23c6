"""``bumpstop identify --protocol``: table 2.2 from recordings of a plan."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from bumpstop.arrays import finite_or_none
from bumpstop.cli.folders import writing
from bumpstop.cli.identification.fit_options import FIT_FILES
from bumpstop.cli.identification.fit_verdict import exit_status, print_reading, print_verdict
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bumpstop.identification import FitVerdict
    from bumpstop.joint.parameters import Parameter
    from bumpstop.model import Robot
    from bumpstop.recording import Recording
    from bumpstop.reproduction.schroeder2013.fit_comparison import FitComparison, JointComparison
    from bumpstop.reproduction.schroeder2013.protocol import ProtocolFit

SHOWN = ("A", "B", "D", "F", "coulomb", "viscous", "load", "hysteresis", "inertia")


def identify_by_protocol(
    plan_file: Path, load: Callable[[Robot], Sequence[Recording]], robot: str, out: Path | None, as_json: bool
) -> int:
    """Read plan and recordings, fit, print, and write model and report where asked.

    ``load`` reads the recordings of the plan's robot.
    """
    from bumpstop.cli.progress import progress
    from bumpstop.identification.design.plan_file import load_plan
    from bumpstop.reproduction.schroeder2013.fit_comparison import compare_fits
    from bumpstop.reproduction.schroeder2013.protocol import identify_protocol
    from bumpstop.reproduction.schroeder2013.protocol_verdict import judge_protocol

    plan = load_plan(plan_file)
    if robot not in (plan.robot.name, str(plan_file)) and Path(robot).stem != plan.robot.name:
        raise InputError("--robot", f"{robot!r} is not the plan's", f"{plan_file} is for {plan.robot.name}")
    logs = load(plan.robot)
    with progress("identifying") as report:
        fit = identify_protocol(plan, logs, progress=report)
    with progress("fitting all motion") as report:
        beside = compare_fits(fit, logs, progress=report)
    verdict = judge_protocol(fit, beside, logs)
    if out is not None:
        _write(fit, beside, verdict, out)
    if as_json:
        found = {"verdict": verdict.to_json()} | protocol_json(fit, beside, logs)
        typer.echo(json.dumps(found, allow_nan=False, indent=2))
        return exit_status(verdict)
    print_verdict(verdict)
    print_protocol(fit)
    print_beside(beside)
    print_reading(logs)
    if out is not None and out.suffix != ".toml":
        typer.echo(f"report: {out / 'report.html'}")
    if out is not None:
        model_file = out if out.suffix == ".toml" else out / FIT_FILES["protocol"]
        typer.echo(f"model: {model_file}")
    return exit_status(verdict)


def _write(fit: ProtocolFit, beside: FitComparison, verdict: FitVerdict, out: Path) -> None:
    model = replace(fit.model(), verdict=verdict.status)
    if out.suffix == ".toml":
        model.save(out)
        return
    with writing(out):
        model.save(out / FIT_FILES["protocol"])
    from bumpstop.reproduction.schroeder2013.protocol_page import write_protocol_report

    write_protocol_report(fit, out, beside, verdict)


def protocol_json(fit: ProtocolFit, beside: FitComparison, logs: Sequence[Recording]) -> dict[str, Any]:
    """Table 2.2 for programs, the general fit beside it; joints that were not identified have no parameters."""
    found = {joint.experiment.joint: joint for joint in fit.joints}
    other = {pair.protocol.experiment.joint: pair for pair in beside.joints}
    lost = {one.joint: one.reason for one in fit.plan.unobservable} | dict(fit.missing)
    joints = []
    for number, joint in enumerate(fit.plan.robot.joints):
        one = found.get(number)
        entry: dict[str, Any] = {"name": joint.name, "observable": one is not None}
        if one is None:
            entry |= {"parameters": {}, "reason": lost.get(number, "not in the plan")}
        else:
            entry |= {
                "parameters": {name: _parameter(value) for name, value in one.parameters.items()},
                "map": one.map,
                "friction": one.friction.law,
                "friction_held_out_A": {name: finite_or_none(error) for name, error in one.friction_held_out.items()},
                "held_out_rmse_Nm": one.held_out,
                "friction_sd": one.friction_sd,
                "strokes": len(one.strokes),
                "r2": one.r2,
                "rmse_Nm": one.rmse,
                "notes": list(one.notes),
                "general": _general(other.get(number)),
            }
        joints.append(entry)
    dropped = sum(log.report.rows_dropped for log in logs)
    general = {
        "cutoff_hz": beside.cutoff_hz if beside.joints else None,
        "rows_used": beside.rows_used,
        "why_not": beside.why_not or None,
    }
    return {"joints": joints, "filter": {}, "general": general, "rows_used": fit.rows, "rows_dropped": dropped}


def _general(pair: JointComparison | None) -> dict[str, Any] | None:
    """One joint of the general fit, and how far the protocol's parameters are from its own."""
    if pair is None:
        return None
    own = pair.general.parameters
    return {
        "map": own.map,
        "friction": own.friction,
        "parameters": {name: _parameter(value) for name, value in own.parameters.items()},
        "unobservable": dict(pair.general.unobservable),
        "protocol_less_general_in_standard_errors": {
            name: pair.difference(name) for name in SHOWN if name in pair.protocol.parameters
        },
    }


def _parameter(value: Parameter | None) -> dict[str, float | None] | None:
    return None if value is None else {"value": value.value, "standard_error": value.standard_error}


def print_protocol(fit: ProtocolFit) -> None:
    """Table 2.2."""
    from rich.console import Console
    from rich.table import Table

    table = Table(box=None, pad_edge=False)
    names = shown(fit)
    for heading in ("joint", *names, "friction sd", "map", "R2", "rmse, Nm"):
        table.add_column(heading, justify="left" if heading in ("joint", "map") else "right", no_wrap=True)
    for joint in fit.joints:
        cells = [_cell(joint.parameters.get(name)) for name in names]
        table.add_row(
            joint.experiment.name, *cells, f"{joint.friction_sd:.3g}", joint.map, f"{joint.r2:.4f}", f"{joint.rmse:.3g}"
        )
    console = Console(highlight=False, markup=False, soft_wrap=True, width=max(Console().width, 240))
    console.print(table)
    for joint in fit.joints:
        errors = ", ".join(f"{law} {error:.3g}" for law, error in joint.friction_held_out.items())
        if len(joint.friction_held_out) > 1:
            typer.echo(
                f"{joint.experiment.name}: friction {joint.friction.law}, by currents of other strokes: {errors}"
            )
        for note in joint.notes:
            typer.echo(f"{joint.experiment.name}: {note}")
    for number, why in fit.missing:
        typer.echo(f"{fit.plan.robot.joints[number].name}: not identified: {why}")
    for lost in fit.plan.unobservable:
        typer.echo(
            f"{lost.name}: its current-to-torque model is not identifiable, as {lost.reason}; remedy: {lost.remedy}"
        )


def shown(fit: ProtocolFit) -> tuple[str, ...]:
    """Parameters that a joint of the fit has, in the order of the table: laws of friction differ in theirs."""
    return tuple(name for name in SHOWN if any(name in joint.parameters for joint in fit.joints))


def print_beside(beside: FitComparison) -> None:
    """The general fit's parameters, and in brackets how far the protocol's are from them."""
    from rich.console import Console
    from rich.table import Table

    if beside.why_not:
        typer.echo(f"no general fit beside it: {beside.why_not}")
    if not beside.joints:
        return
    table = Table(box=None, pad_edge=False)
    names = tuple(name for name in SHOWN if any(name in pair.protocol.parameters for pair in beside.joints))
    for heading in ("joint", *names, "map"):
        table.add_column(heading, justify="left" if heading in ("joint", "map") else "right", no_wrap=True)
    for pair in beside.joints:
        cells = []
        for name in names:
            difference = pair.difference(name)
            cells.append(_cell(pair.pair(name)[1]) + ("" if difference is None else f" ({difference:+.1f})"))
        table.add_row(pair.general.name, *cells, pair.general.parameters.map)
    console = Console(highlight=False, markup=False, soft_wrap=True, width=max(Console().width, 240))
    console.print(
        f"general fit of all {beside.rows_used} rows, filtered at {beside.cutoff_hz:g} Hz; in brackets protocol less "
        "general, in combined standard errors"
    )
    console.print(table)
    for pair in beside.joints:
        for name, reason in pair.general.unobservable.items():
            typer.echo(f"{pair.general.name}: {name} is not seen by the general fit: {reason}")


def _cell(value: Parameter | None) -> str:
    if value is None:
        return "-"
    error = "" if value.standard_error is None else f" +- {value.standard_error:.2g}"
    return f"{value.value:.4g}{error}"
