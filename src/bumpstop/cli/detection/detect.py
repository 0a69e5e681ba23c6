"""``bumpstop detect`` and ``bumpstop detector``: collisions in a recording, and the detector of a control loop."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.collision.evaluate import NOT_ACCEPTABLE
from bumpstop.cli.detection.residual_source import (
    DETECTOR_OPTIONS,
    Arming,
    ResidualSource,
    Watcher,
    takes_residual_source,
    thresholds_of,
)
from bumpstop.cli.folders import check_folder, check_inputs, writing
from bumpstop.cli.identification.fit_verdict import with_faults
from bumpstop.cli.option_names import as_options
from bumpstop.cli.progress import progress
from bumpstop.errors import InputError
from bumpstop.output_files import write_bytes
from bumpstop.terminal import terminal

if TYPE_CHECKING:
    from bumpstop.detection import DetectionRun, DetectorSettings, Thresholds
    from bumpstop.model import Robot

Limits = Annotated[
    str,
    typer.Option(
        "--thresholds", metavar="LIST|FILE", help="Thresholds [Nm]: 20,10,inf, or a file.", show_default=False
    ),
]
PayloadChange = Annotated[
    float, typer.Option("--payload-change", help="Look for an undeclared mass of at least this [kg]; 0: do not.")
]
Direction = Annotated[
    str, typer.Option("--direction", metavar="LIST", help="In which the force of an alarm is given, base frame.")
]
At = Annotated[str | None, typer.Option("--link", help="Link the force is given at.", show_default="the tip")]
Where = Annotated[str, typer.Option("--point-m", metavar="LIST", help="Where, in that link's frame.")]


@takes_residual_source
def detect(
    recording: Annotated[Path, typer.Argument(help="Recording with currents or joint torques.", show_default=False)],
    thresholds: Limits,
    *,
    residual_source: ResidualSource,
    arming_delay: Arming = 0.0,
    payload_change: PayloadChange = 0.0,
    direction: Direction = "0,0,-1",
    link: At = None,
    point_m: Where = "0,0,0",
    undetectable_force: Annotated[
        float | None,
        typer.Option("--undetectable-force", help="Report poses where more than this could stay undetected [N]."),
    ] = None,
    stiction: Annotated[
        str | None,
        typer.Option(
            metavar="LIST", help="What friction holds of a standing joint [Nm], one or all.", show_default="the model's"
        ),
    ] = None,
    rearm: Annotated[float, typer.Option(help="An alarm ends once all was quiet for so long [s].")] = 0.5,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write report.html, figures, events and residuals into it.")
    ] = None,
) -> int:
    """Run a collision detector over a recording: alarms, and when it had no data."""
    import numpy as np

    from bumpstop.cli.detection.sensitivity import stiction_of
    from bumpstop.detection import detect as run_detector
    from bumpstop.detection import undetectable_stretches
    from bumpstop.detection.loop.unknown_gains import force_thresholds
    from bumpstop.detection.standing import hidden_torques
    from bumpstop.identification.fit_verdict import as_sentences, reading_faults

    check_folder(out)
    read = [*residual_source.files_with(recording), thresholds]
    check_inputs(out, read, "report.html", "events.json", "residuals.parquet")
    given, arm = residual_source.parts
    law = thresholds_of(thresholds, arm)
    settings = _settings(residual_source, law, arming_delay, payload_change, link, point_m, direction)
    if stiction is not None:
        settings = replace(settings, stiction=stiction_of(stiction, arm.dof))
    log = residual_source.recording(recording)
    with with_faults([log]), as_options(DETECTOR_OPTIONS), progress("running the detector"):
        run = run_detector(log, arm, given, law, settings, rearm_s=rearm)
    run = replace(run, notes=(*run.notes, *as_sentences(reading_faults([log]))))
    stretches = None
    if undetectable_force is not None:
        if not 0 < undetectable_force < math.inf:
            raise InputError("--undetectable-force", f"is {undetectable_force}", "wanted more than zero")
        assert law.rest is not None
        counted, _ = force_thresholds(arm, given, law.constant)
        hidden = hidden_torques(arm, given, settings, log.q)
        counted[np.isnan(hidden)] = math.inf
        hidden = np.nan_to_num(hidden) + law.rest
        if law.motion_note:
            run = replace(run, notes=(*run.notes, law.motion_note))
        stretches = undetectable_stretches(
            arm, log.t, log.q, counted, undetectable_force, link=link, point=settings.point, dead_zone=hidden
        )
    more = {
        "rows_dropped": log.report.rows_dropped,
        "undetectable_poses": None if stretches is None else [one.to_json() for one in stretches],
    }
    text = json.dumps(run.to_json() | more, allow_nan=False, indent=2)
    if out is not None:
        _write(run, arm, text, out, {"recording": str(recording), "thresholds": thresholds}, recording.name)
    status = NOT_ACCEPTABLE if run.inactive else 0
    if as_json:
        typer.echo(text)
        return status
    run.show(terminal())
    for one in stretches or ():
        typer.echo(
            f"from {one.start_s:.4f} to {one.end_s:.4f} s up to {one.largest_N:.4g} N could stay undetected"
            if math.isfinite(one.largest_N)
            else f"from {one.start_s:.4f} to {one.end_s:.4f} s any force could stay undetected in some direction"
        )
    if stretches == ():
        typer.echo(f"at no time could more than {undetectable_force:g} N stay undetected")
    if log.report.rows_dropped:
        typer.echo(f"rows dropped while reading: {log.report.rows_dropped} of {log.report.rows_read}")
    if out is not None:
        missing = ", no residuals.parquet: the detector had no data all the time" if run.no_data.all() else ""
        typer.echo(f"report: {out / 'report.html'}{missing}")
    return status


@takes_residual_source
def detector(
    file: Annotated[Path, typer.Argument(help="Where to write it.", show_default=False)],
    thresholds: Limits,
    period: Annotated[
        float | None,
        typer.Option(help="Between the samples of the loop [s].", show_default="what the thresholds were found at"),
    ] = None,
    *,
    residual_source: Watcher,
    arming_delay: Arming = 0.0,
    payload_change: PayloadChange = 0.0,
    direction: Direction = "0,0,-1",
    link: At = None,
    point_m: Where = "0,0,0",
) -> None:
    """Write robot, joint model and thresholds as one file for the control loop (detector_description.hpp)."""
    from bumpstop.detection import Detector, save_detector
    from bumpstop.detection.detector import window_notes
    from bumpstop.detection.settings import settings_text
    from bumpstop.identification import DynamicsModel

    check_inputs(file, [*residual_source.files, thresholds], option="FILE")
    given, arm = residual_source.parts
    law = thresholds_of(thresholds, arm)
    # A loop cannot look ahead.
    causal = {"causal": True} if isinstance(given, DynamicsModel) else {}
    settings = _settings(residual_source, law, arming_delay, payload_change, link, point_m, direction, **causal)
    with as_options(DETECTOR_OPTIONS):
        if period is not None or law.period_s is not None:
            settings = replace(settings, period_s=law.period_s if period is None else period)
        made = Detector(arm, given, law, settings)
    if settings.period_s is None:
        raise InputError("--period", "is missing", "the thresholds do not say at what rate they were found")
    save_detector(made, file)
    typer.echo(f"detector: {file}")
    summary = made.summary(settings.period_s)
    typer.echo(f"settings: {settings_text(summary)}")
    differs = law.differences(settings)
    for note in differs:
        typer.echo(f"warning: {note}", err=True)
    for note in (*(note for note in made.notes if note not in differs), *window_notes(settings, settings.period_s)):
        typer.echo(f"note: {note}")


def _settings(
    residual_source: Watcher,
    law: Thresholds,
    arming_delay: float,
    payload_change: float,
    link: str | None,
    point_m: str,
    direction: str,
    **more: Any,
) -> DetectorSettings:
    """Of options that ``detect`` and ``detector`` have in common; ``more``: settings that have none."""
    from bumpstop.cli.detection.sensitivity import three, unit

    return residual_source.settings_for(
        law,
        arming_delay_s=arming_delay,
        payload_change_kg=payload_change,
        link=link,
        point=three(point_m, "--point-m"),
        direction=unit(direction, "--direction"),
        **more,
    )


def _write(run: DetectionRun, arm: Robot, events: str, folder: Path, asked: dict[str, str], name: str) -> None:
    from bumpstop.report.detection.events import write_events

    write_events(run, arm, folder, asked=asked, name=name)
    with writing(folder):
        write_bytes(folder / "events.json", f"{events}\n".encode())
        # Those of an earlier run are none of this one.
        (folder / "residuals.parquet").unlink(missing_ok=True)
        if not run.no_data.all():
            run.save_residuals(folder / "residuals.parquet")
