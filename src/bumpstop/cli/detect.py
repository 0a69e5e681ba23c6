"""``bumpstop detect`` and ``bumpstop detector``: collisions in a recording, and the detector of a control loop."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.detection import DetectionRun, DetectorSettings
    from bumpstop.identification import DynamicsFit
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot

ModelFile = Annotated[
    str | None,
    typer.Option("--model", help="Joint model (TOML or built-in name), or fitted dynamics; without: recorded torque."),
]
RobotName = Annotated[
    str | None, typer.Option("--robot", help="A built-in name, or the path of a URDF file; default: the model's.")
]
Limits = Annotated[
    str, typer.Option("--thresholds", help="Numbers like 20,10,inf, or a file of thresholds.", show_default=False)
]
Kind = Annotated[str, typer.Option("--residual", help="direct or observer.")]
Gain = Annotated[float, typer.Option("--observer-gain", help="Gain of the observer [1/s].")]
Arming = Annotated[float, typer.Option("--arming-delay", help="Nothing is judged so long after a motion begins [s].")]
Carried = Annotated[float, typer.Option("--payload", help="Mass at the tip that the robot does not include [kg].")]
Base = Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")]
Tip = Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")]


def detect(
    recording: Annotated[Path, typer.Argument(help="Recording with currents or joint torques.", show_default=False)],
    thresholds: Limits,
    model: ModelFile = None,
    robot: RobotName = None,
    columns: Annotated[Path | None, typer.Option(help="Column file of the recording (TOML).")] = None,
    begin: Annotated[float | None, typer.Option("--from", help="Begin at this time of the recording [s].")] = None,
    until: Annotated[float | None, typer.Option(help="End at this time of the recording [s].")] = None,
    residual: Kind = "direct",
    observer_gain: Gain = 50.0,
    arming_delay: Arming = 0.0,
    payload: Carried = 0.0,
    payload_change: Annotated[
        float, typer.Option("--payload-change", help="Look for an undeclared mass of at least this [kg]; 0: do not.")
    ] = 0.0,
    measured_rates: Annotated[
        bool, typer.Option("--measured-rates", help="Take joint speeds from the recording, not from its positions.")
    ] = False,
    rearm: Annotated[float, typer.Option(help="An alarm ends once all was quiet for so long [s].")] = 0.5,
    base: Base = None,
    tip: Tip = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    out: Annotated[Path | None, typer.Option("--out", help="Write figures, events and residuals into it.")] = None,
) -> None:
    """Run a collision detector over a recording: alarms, and when it was blind."""
    from bumpstop.cli.arm_recordings import part_of
    from bumpstop.detection import DetectorSettings, Thresholds
    from bumpstop.detection import detect as run_detector

    given, arm = load_model(model, robot, base, tip)
    law = Thresholds.parse(thresholds, [joint.name for joint in arm.joints])
    settings = DetectorSettings(
        residual=residual,  # type: ignore[arg-type]
        observer_gain_1_s=observer_gain,
        arming_delay_s=arming_delay,
        payload_kg=payload,
        payload_change_kg=payload_change,
        measured_rates=measured_rates,
    )
    log = part_of(recording, columns, arm, begin, until)
    run = run_detector(log, arm, given, law, settings, rearm_s=rearm)
    if out is not None:
        _write(run, arm, out)
    if as_json:
        typer.echo(json.dumps(run.to_json(), allow_nan=False, indent=2))
        return
    _print(run, arm, settings)
    if log.report.rows_dropped:
        typer.echo(f"rows dropped while reading: {log.report.rows_dropped} of {log.report.rows_read}")
    if out is not None:
        typer.echo(f"figures: {out}")


def detector(
    file: Annotated[Path, typer.Argument(help="Where to write it.", show_default=False)],
    thresholds: Limits,
    period: Annotated[float, typer.Option(help="Between the samples of the loop [s].", show_default=False)],
    model: ModelFile = None,
    robot: RobotName = None,
    residual: Kind = "direct",
    observer_gain: Gain = 50.0,
    arming_delay: Arming = 0.0,
    payload: Carried = 0.0,
    base: Base = None,
    tip: Tip = None,
) -> None:
    """Write robot, joint model and thresholds as one file for the control loop (detector_description.hpp)."""
    from bumpstop.detection import Detector, DetectorSettings, Thresholds, save_detector
    from bumpstop.identification import DynamicsFit

    given, arm = load_model(model, robot, base, tip)
    law = Thresholds.parse(thresholds, [joint.name for joint in arm.joints])
    if isinstance(given, DynamicsFit):
        raise InputError("--model", "fitted dynamics look ahead and cannot run in a loop", "give a joint model")
    settings = DetectorSettings(
        residual=residual,  # type: ignore[arg-type]
        observer_gain_1_s=observer_gain,
        arming_delay_s=arming_delay,
        payload_kg=payload,
        period_s=period,
    )
    made = Detector(arm, given, law, settings)
    save_detector(made, file)
    typer.echo(f"detector: {file}")
    for note in made.notes:
        typer.echo(f"note: {note}")


def load_model(
    model: str | None, robot: str | None, base: str | None, tip: str | None
) -> tuple[JointTorqueModel | DynamicsFit | None, Robot]:
    """What ``--model`` and ``--robot`` name; the robot of the model where none is named.

    Raises:
        InputError: neither says which robot, or a file is neither kind of model.
    """
    from bumpstop.identification import load_fit
    from bumpstop.joint import JointTorqueModel

    named = None if robot is None else _robot(robot, base, tip)
    if model is None:
        if named is None:
            raise InputError("--robot", "is missing", "give a robot, or a model that names one")
        return None, named
    if _is_dynamics(model):
        fit = load_fit(model)
        if named is not None and named.dof != fit.robot.dof:
            raise InputError("--robot", f"{named.name} has {named.dof} joints, the model {fit.robot.dof}")
        return fit, fit.robot
    joints = JointTorqueModel.load(model)
    return joints, named if named is not None else _robot(joints.robot, base, tip)


def _is_dynamics(model: str) -> bool:
    import tomllib

    try:
        return tomllib.loads(Path(model).read_text(encoding="utf-8")).get("kind") == "dynamics"
    except (OSError, ValueError, RecursionError):
        return False  # whoever reads it as a joint model says what is wrong


def _robot(name: str, base: str | None, tip: str | None) -> Robot:
    from bumpstop.model import Robot

    return Robot.from_urdf(name, base, tip) if Path(name).suffix or "/" in name else Robot.load(name)


def _units(arm: Robot) -> tuple[str, ...]:
    return tuple("N" if joint.kind == "prismatic" else "Nm" for joint in arm.joints)


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


def _write(run: DetectionRun, arm: Robot, folder: Path) -> None:
    from bumpstop.report.residuals import residual_picture

    names = tuple(joint.name for joint in arm.joints)
    drawn = residual_picture(run, names, _units(arm)).render()
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "residuals.svg").write_text(drawn.svg, encoding="utf-8")
        (folder / "residuals.png").write_bytes(drawn.png)
        text = json.dumps(run.to_json(), allow_nan=False, indent=2)
        (folder / "events.json").write_text(text + "\n", encoding="utf-8")
        run.save_residuals(folder / "residuals.parquet")
    except OSError as error:
        raise InputError(
            "--out", f"{str(folder)!r} cannot be written ({error.strerror or error})", "give another folder"
        ) from None
