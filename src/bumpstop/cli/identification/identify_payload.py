"""``bumpstop identify --model payload``: what an arm of known inertia carries."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from bumpstop.cli.folders import writing
from bumpstop.cli.identification.fit_options import FIT_FILES
from bumpstop.cli.identification.fit_verdict import exit_status, print_reading, print_verdict
from bumpstop.cli.identification.parameters import parameters_json
from bumpstop.cli.option_names import as_options
from bumpstop.cli.progress import progress
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification import PayloadFit
    from bumpstop.model import Robot
    from bumpstop.recording import Recording


def identify_what_is_carried(
    logs: Sequence[Recording],
    arm: Robot,
    *,
    joint_model: str | None,
    dynamics: Path | None,
    mass: float | None,
    inertia: bool,
    cutoff_hz: float | None,
    gravity: tuple[float, float, float] | None,
    inertia_uncertainty: float | None,
    out: Path | None,
    as_json: bool,
) -> int:
    """Fit a payload, write it and its page, and print what was found."""
    from bumpstop.identification import DynamicsFit, identify_payload, judge_payload
    from bumpstop.identification.drive.error_sources import INERTIA_UNCERTAINTY
    from bumpstop.joint import JointTorqueModel

    if len(logs) != 1:
        raise InputError("recording", f"{len(logs)} of them", "a payload is fitted to one")
    log = logs[0]
    drives = None
    if joint_model is not None:
        drives = JointTorqueModel.load(joint_model)
    elif log.tau is None and dynamics is None:
        raise InputError("--joint-model", "is missing", "currents become torques by a joint model that identify wrote")
    if dynamics is not None and inertia_uncertainty is not None:
        raise InputError(
            "--inertia-uncertainty", "has no effect with --dynamics, which need no inertia", "give one of them"
        )
    if cutoff_hz is not None and not 0 < cutoff_hz < 0.4 * log.rate_hz:
        raise InputError("--cutoff", f"is {cutoff_hz:g}", f"wanted above 0 and below {0.4 * log.rate_hz:g} Hz")
    of_arm = None if dynamics is None else DynamicsFit.load(dynamics)
    options = {"mass": "--mass", "dynamics": "--dynamics", "model": "--joint-model", "robot": "--robot"}
    options["inertia_uncertainty"] = "--inertia-uncertainty"
    with as_options(options), progress("fitting"):
        found = identify_payload(
            log,
            arm,
            model=drives,
            dynamics=of_arm,
            mass=mass,
            inertia=inertia,
            cutoff_hz=cutoff_hz,
            gravity=gravity,
            inertia_uncertainty=INERTIA_UNCERTAINTY if inertia_uncertainty is None else inertia_uncertainty,
        )
    verdict = judge_payload(found, log, arm)
    model_file = out if out is None or out.suffix == ".toml" else out / FIT_FILES["payload"]
    if model_file is not None and out is not None:
        with writing(None if model_file == out else out):
            replace(found, verdict=verdict.status).save(model_file)
        if model_file != out:
            from bumpstop.report.identification.payload import write_payload_report

            write_payload_report(found, arm, out, source=Path(log.source).name, verdict=verdict)
    if as_json:
        typer.echo(json.dumps({"verdict": verdict.to_json()} | _payload_json(found, log), allow_nan=False, indent=2))
        return exit_status(verdict)
    print_verdict(verdict)
    typer.echo(str(found))
    print_reading([log])
    if model_file is not None:
        typer.echo(f"payload: {model_file}")
        if model_file != out:
            typer.echo(f"report: {model_file.parent / 'report.html'}")
    return exit_status(verdict)


def _payload_json(found: PayloadFit, log: Recording) -> dict[str, Any]:
    center = None
    if found.center is not None and found.center_errors is not None:
        center = {"value": list(found.center), "standard_error": list(found.center_errors)}
    return {
        "kind": "payload",
        "parameters": parameters_json(found),
        "center_m": center,
        "unobservable": list(found.unobservable),
        "joints": [
            {"name": name, "rmse_Nm": float(rmse), "rmse_without_payload_Nm": float(without)}
            for name, rmse, without in zip(found.joints, found.rmse, found.rmse_without, strict=True)
        ],
        "joints_left_out": list(found.joints_left_out),
        "rows_used": found.rows_used,
        "rows_left": found.rows_left,
        "rows_dropped": log.report.rows_dropped,
    }
