"""``bumpstop recording``: look at a recording of an arm, or write it in another format."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.cli.command_group import group
from bumpstop.cli.completion import complete_robot
from bumpstop.cli.detection.residual_source import Base, Tip
from bumpstop.cli.folders import check_inputs
from bumpstop.cli.identification.arm_recordings import recording_files
from bumpstop.cli.picture_files import check_picture, save_picture
from bumpstop.cli.robots import load_robot
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from bumpstop.model import Robot
    from bumpstop.recording import Recording

app = group("Look at a recording of an arm, or write it in another format.")

File = Annotated[Path, typer.Argument(help="CSV, Parquet, Excel, MATLAB, or a ROS 2 bag.", show_default=False)]
ColumnFile = Annotated[Path | None, typer.Option("--columns", help="Column file (TOML): which columns hold what.")]
RobotName = Annotated[
    str | None,
    typer.Option("--robot", help="A built-in name, or the path of a URDF file.", autocompletion=complete_robot),
]
Topic = Annotated[str | None, typer.Option("--topic", help="Topic of a bag that has several with joint states.")]
MaxBad = Annotated[
    float, typer.Option("--max-bad", metavar="SHARE", help="Share of bad rows up to which they are dropped.")
]
_MAX_GAPS = 5
_MAX_WIDTH = 160  # of the table: a figure cut short says nothing, a long line wraps


@app.command("info")
def info(
    file: File,
    columns: ColumnFile = None,
    robot: RobotName = None,
    base: Base = None,
    tip: Tip = None,
    topic: Topic = None,
    max_bad: MaxBad = 0.01,
    picture: Annotated[Path | None, typer.Option(help="Draw it into this file, .png or .svg.")] = None,
) -> None:
    """Print rates, gaps, bad rows and ranges, and the limits touched where a robot is given."""
    from rich.console import Console

    check_picture(picture, "run.svg", [*recording_files([file], columns), robot])
    arm = _robot(robot, base, tip)
    found = _load(file, columns, arm, topic, max_bad)
    if picture is not None:
        _draw(found, arm, picture)
    width = max(Console().width, _MAX_WIDTH)
    _print(found, arm, Console(highlight=False, markup=False, soft_wrap=True, width=width))
    if picture is not None:
        typer.echo(f"picture: {picture}")


@app.command("convert")
def convert(
    file: File,
    out: Annotated[Path, typer.Argument(help="Where to write it: .parquet, .csv or .mcap.", show_default=False)],
    columns: ColumnFile = None,
    robot: RobotName = None,
    base: Base = None,
    tip: Tip = None,
    topic: Topic = None,
    max_bad: MaxBad = 0.01,
) -> None:
    """Write a recording as Parquet, CSV, or MCAP with sensor_msgs/msg/JointState. Bad rows are left out."""
    from bumpstop.recording.formats.writing import holds_current_as_effort, left_out

    check_inputs(out, [*recording_files([file], columns), robot], option="OUT")
    found = _load(file, columns, _robot(robot, base, tip), topic, max_bad)
    found.save(out)
    dropped = found.report.rows_dropped
    typer.echo(f"recording: {out}, {found.t.size} rows" + (f", {dropped} bad ones left out" if dropped else ""))
    missing = left_out(found, out)
    if missing:
        typer.echo(f"not written, as {out.suffix} has no place for it: {', '.join(missing)}")
    if holds_current_as_effort(found, out):
        typer.echo('its effort is the motor current: to read it as such, give a column file with effort = "current"')
    for line in _told(found):
        typer.echo(line)


def _robot(name: str | None, base: str | None, tip: str | None) -> Robot | None:
    if name is not None:
        return load_robot(name, base, tip)
    for option, value in (("--base", base), ("--tip", tip)):
        if value is not None:
            raise InputError(option, "has no meaning without --robot", "give the path of a URDF")
    return None


def _load(file: Path, columns: Path | None, robot: Robot | None, topic: str | None, max_bad: float) -> Recording:
    from bumpstop.recording import Recording

    try:
        return Recording.load(file, columns=columns, max_bad=max_bad, robot=robot, topic=topic)
    except InputError as error:
        if error.field in ("topic", "max_bad", "columns"):
            raise InputError(f"--{error.field.replace('_', '-')}", error.problem, error.valid) from None
        raise


def _print(recording: Recording, robot: Robot | None, console: Console) -> None:
    import numpy as np

    report = recording.report
    arm = f", {recording.robot}" if recording.robot else ""
    joints = "joint" if recording.dof == 1 else "joints"
    console.print(f"{recording.source}: {recording.t.size} rows, {recording.dof} {joints}{arm}")
    steps = 1e3 * np.diff(recording.t)
    begin, end = (_seconds(t, recording) for t in (recording.t[0], recording.t[-1]))
    console.print(
        f"time: {begin} to {end} s ({recording.duration:.4g} s), median rate "
        f"{recording.rate_hz:.4g} Hz, intervals {steps.min():.4g} to {steps.max():.4g} ms"
    )
    if recording.t[0] != 0:
        console.print(
            f"--from and --until count from its beginning: 0 to {recording.duration:.4g} s are {begin} to {end} s here"
        )
    _print_table(recording, robot, console)
    if recording.wrench is not None:
        force, torque = (np.linalg.norm(recording.wrench[:, part], axis=1).max() for part in (slice(3), slice(3, 6)))
        console.print(f"wrench: up to {force:.4g} N and {torque:.4g} Nm")
    longest = sorted(report.gaps, key=lambda gap: -gap[1])[:_MAX_GAPS]
    places = ", ".join(f"{1e3 * length:.4g} ms at {_seconds(start, recording)} s" for start, length in longest)
    where = f": {places}" if places else ""
    console.print(f"gaps: {len(report.gaps)}{where}" + (" ..." if len(report.gaps) > _MAX_GAPS else ""))
    console.print(f"bad rows: {report.rows_dropped} of {report.rows_read}" + _counts(report.counts))
    for row, reason in report.dropped:
        console.print(f"  {report.numbered} {row}: {reason}")
    if report.rows_dropped > len(report.dropped):
        console.print(f"  and {report.rows_dropped - len(report.dropped)} more")
    for line in _told(recording):
        console.print(line)


def _told(recording: Recording) -> list[str]:
    """What the reader changed, and what contradicts itself or is unusual, a line each."""
    report = recording.report
    lines = [f"repaired rows: {report.repaired} (angles turned back by whole turns)"] if report.repaired else []
    lines += [f"fault: {fault}" for fault in report.faults]
    for name, (moved_from, moved_to) in report.base_motion.items():
        where = f"from {_seconds(moved_from, recording)} to {_seconds(moved_to, recording)} s"
        lines.append(f"fault: {name} moves the base, which is taken to stand still, {where}")
    return lines + [f"note: {note}" for note in report.notes]


def _seconds(t: float, recording: Recording) -> str:
    """A time of a recording [s], with the decimals of four digits of its duration."""
    decimals = max(0, 3 - math.floor(math.log10(max(recording.duration, 1e-9))))
    text = f"{t:.{decimals}f}"
    return text.rstrip("0").rstrip(".") if "." in text else text


def _counts(counts: Mapping[str, int]) -> str:
    return f" ({', '.join(f'{reason} {count}' for reason, count in counts.items())})" if counts else ""


def _print_table(recording: Recording, robot: Robot | None, console: Console) -> None:
    from rich.table import Table

    from bumpstop.recording import by_quantity, limits_touched

    shown = {heading: value for heading, value in by_quantity(recording, robot).items() if value is not None}
    touched = {} if robot is None else limits_touched(recording, robot)
    table = Table(box=None, pad_edge=False)
    for heading in ("", "joint", *shown, *(f"at {name} limit" for name in touched)):
        table.add_column(heading, justify="left" if heading == "joint" else "right", no_wrap=True)
    for j in range(recording.dof):
        ranges = (f"{value[:, j].min():.4g} to {value[:, j].max():.4g}" for value in shown.values())
        name = recording.joint_names[j] if recording.joint_names else "-"
        table.add_row(str(j + 1), name, *ranges, *(str(count[j]) for count in touched.values()))
    console.print(table)
    if touched:
        rows = sum(int(count.sum()) for count in touched.values())
        console.print("limits touched: " + (f"{rows} times; rows by joint above" if rows else "none"))


def _draw(recording: Recording, robot: Robot | None, path: Path) -> None:
    from bumpstop.report.identification.recording import recording_picture

    save_picture(recording_picture(recording, robot), path)
