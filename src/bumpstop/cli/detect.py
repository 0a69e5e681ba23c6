"""``bumpstop detect`` and ``bumpstop detector``: collisions in a recording, and the detector of a control loop."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.cli.folders import check_folder, writing
from bumpstop.cli.option_names import as_options
from bumpstop.cli.origin import (
    DETECTOR_OPTIONS,
    GAIN,
    Arming,
    Base,
    Carried,
    Gain,
    Kind,
    ModelFile,
    Origin,
    RobotName,
    Tip,
    load_model,
    refuse_gain,
    takes_origin,
    thresholds_of,
)
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.detection import DetectionRun, DetectorSettings
    from bumpstop.model import Robot

Limits = Annotated[
    str, typer.Option("--thresholds", help="Numbers like 20,10,inf, or a file of thresholds.", show_default=False)
]


@takes_origin
def detect(
    recording: Annotated[Path, typer.Argument(help="Recording with currents or joint torques.", show_default=False)],
    thresholds: Limits,
    *,
    origin: Origin,
    arming_delay: Arming = 0.0,
    payload_change: Annotated[
        float, typer.Option("--payload-change", help="Look for an undeclared mass of at least this [kg]; 0: do not.")
    ] = 0.0,
    direction: Annotated[
        str, typer.Option(metavar="LIST", help="In which the force of an alarm is given, base frame.")
    ] = "0,0,-1",
    link: Annotated[str | None, typer.Option(help="Link the force is given at.", show_default="the tip")] = None,
    point_m: Annotated[str, typer.Option("--point-m", metavar="LIST", help="Where, in that link's frame.")] = "0,0,0",
    blind_force: Annotated[
        float | None,
        typer.Option("--blind-force", help="Tell poses where more than this could go unnoticed [N]."),
    ] = None,
    rearm: Annotated[float, typer.Option(help="An alarm ends once all was quiet for so long [s].")] = 0.5,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    out: Annotated[Path | None, typer.Option("--out", help="Write figures, events and residuals into it.")] = None,
) -> None:
    """Run a collision detector over a recording: alarms, and when it was blind."""
    from bumpstop.cli.sensitivity import three, unit
    from bumpstop.detection import blind_stretches
    from bumpstop.detection import detect as run_detector

    given, arm = origin.parts
    law = thresholds_of(thresholds, arm)
    with as_options(DETECTOR_OPTIONS):
        settings = replace(
            origin.settings,
            arming_delay_s=arming_delay,
            payload_change_kg=payload_change,
            link=link,
            point=three(point_m, "--point-m"),
            direction=unit(direction, "--direction"),
        )
    check_folder(out)
    log = origin.recording(recording)
    with as_options(DETECTOR_OPTIONS):
        run = run_detector(log, arm, given, law, settings, rearm_s=rearm)
    stretches = None
    if blind_force is not None:
        if not 0 < blind_force < math.inf:
            raise InputError("--blind-force", f"is {blind_force}", "wanted more than zero")
        stretches = blind_stretches(arm, log.t, log.q, law.constant, blind_force, link=link, point=settings.point)
    more = {
        "rows_dropped": log.report.rows_dropped,
        "blind_poses": None if stretches is None else [one.to_json() for one in stretches],
    }
    text = json.dumps(run.to_json() | more, allow_nan=False, indent=2)
    if out is not None:
        _write(run, arm, text, out)
    if as_json:
        typer.echo(text)
        return
    _print(run, arm, settings)
    for one in stretches or ():
        typer.echo(
            f"from {one.start_s:.4f} to {one.end_s:.4f} s up to {one.largest_N:.4g} N could go unnoticed"
            if math.isfinite(one.largest_N)
            else f"from {one.start_s:.4f} to {one.end_s:.4f} s any force could go unnoticed in some direction"
        )
    if stretches == ():
        typer.echo(f"at no time could more than {blind_force:g} N go unnoticed")
    if log.report.rows_dropped:
        typer.echo(f"rows dropped while reading: {log.report.rows_dropped} of {log.report.rows_read}")
    if out is not None:
        missing = ", no residuals.parquet: the detector was blind all the time" if run.blind.all() else ""
        typer.echo(f"figures: {out}{missing}")


def detector(
    file: Annotated[Path, typer.Argument(help="Where to write it.", show_default=False)],
    thresholds: Limits,
    period: Annotated[float, typer.Option(help="Between the samples of the loop [s].", show_default=False)],
    model: ModelFile = None,
    robot: RobotName = None,
    residual: Kind = "direct",
    observer_gain: Gain = GAIN,
    arming_delay: Arming = 0.0,
    payload: Carried = 0.0,
    base: Base = None,
    tip: Tip = None,
) -> None:
    """Write robot, joint model and thresholds as one file for the control loop (detector_description.hpp)."""
    from bumpstop.detection import Detector, DetectorSettings, save_detector
    from bumpstop.identification import DynamicsFit

    given, arm = load_model(model, robot, base, tip)
    law = thresholds_of(thresholds, arm)
    if isinstance(given, DynamicsFit):
        raise InputError("--model", "fitted dynamics look ahead and cannot run in a loop", "give a joint model")
    with as_options(DETECTOR_OPTIONS):
        settings = DetectorSettings(
            residual=residual,  # type: ignore[arg-type]
            observer_gain_1_s=observer_gain,
            arming_delay_s=arming_delay,
            payload_kg=payload,
            period_s=period,
        )
    refuse_gain(settings)
    with as_options(DETECTOR_OPTIONS):
        made = Detector(arm, given, law, settings)
    save_detector(made, file)
    typer.echo(f"detector: {file}")
    for note in made.notes:
        typer.echo(f"note: {note}")


def _units(arm: Robot) -> tuple[str, ...]:
    from bumpstop.model import unit_of

    return tuple(unit_of(joint) for joint in arm.joints)


def _print(run: DetectionRun, arm: Robot, settings: DetectorSettings) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False, markup=False, soft_wrap=True)
    seconds = float(run.t[-1] - run.t[0])
    count = len(run.events)
    console.print(f"{count} alarm{'' if count == 1 else 's'} in {seconds:.6g} s, {run.t.size} rows")
    if run.events:
        table = Table(box=None, pad_edge=False)
        for heading in ("t, s", "joints", "residual", "force, N", "likeliest link", "possible links"):
            table.add_column(heading, justify="right" if heading in ("t, s", "force, N") else "left")
        units = _units(arm)
        for event in run.events:
            joints = sorted({*event.joints, *event.fast_joints})
            residuals = ", ".join(f"{event.residual[j]:.3g} {units[j]}" for j in joints)
            table.add_row(
                f"{event.t:.4f}",
                ", ".join(str(j + 1) for j in joints),
                residuals,
                f"{event.force_along:.3g}",
                event.link or "-",
                ", ".join(event.possible_links) or "none",
            )
        console.print(table)
        console.print(
            f"force at {settings.link or arm.tip_name} along {list(settings.direction)}, of the arm on the body"
        )
    why = ", ".join(f"{name} {rows}" for name, rows in run.blind_rows().items())
    console.print(f"blind: {run.blind_s:.4g} s" + (f" ({why})" if why else ""))
    if run.arming_s:
        console.print(f"arming: {run.arming_s:.4g} s; over a threshold meanwhile: {int(run.unseen.sum())} rows")
    if run.late.any():
        console.print(f"late: {int(run.late.sum())} rows came after lost ones")
    if run.payload_changed.any():
        first = float(run.t[int(run.payload_changed.argmax())])
        console.print(f"payload changed: recognised from {first:.4f} s on")
    for note in run.notes:
        console.print(f"note: {note}")


def _write(run: DetectionRun, arm: Robot, events: str, folder: Path) -> None:
    from bumpstop.report.residuals import residual_picture

    names = tuple(joint.name for joint in arm.joints)
    drawn = residual_picture(run, names, _units(arm)).render()
    with writing(folder):
        (folder / "residuals.svg").write_text(drawn.svg, encoding="utf-8")
        (folder / "residuals.png").write_bytes(drawn.png)
        (folder / "events.json").write_text(events + "\n", encoding="utf-8")
        # Those of an earlier run are none of this one.
        (folder / "residuals.parquet").unlink(missing_ok=True)
        if not run.blind.all():
            run.save_residuals(folder / "residuals.parquet")
