"""``bumpstop robots``: the built-in robots, and everything about one of them or of a URDF file."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.cli.command_group import group
from bumpstop.cli.completion import complete_robot
from bumpstop.cli.folders import check_inputs
from bumpstop.cli.picture_files import check_picture, save_picture
from bumpstop.errors import InputError
from bumpstop.text_files import is_path

if TYPE_CHECKING:
    from rich.console import Console

    from bumpstop.arrays import FloatArray
    from bumpstop.model import Joint, Robot
    from bumpstop.model.inertia import Matrix3

app = group("List the built-in robots, or show one of them or of a URDF file.")

_INERTIA = {
    "published": "published",
    "unverified": "UNVERIFIED: as the file has it; nobody says where the figures come from",
    "assumed": "AN ASSUMPTION, not measured and not published",
    "unknown": "unknown",
}


@app.callback(invoke_without_command=True)
def robots(context: typer.Context) -> None:
    """Without a command: the built-in robots."""
    if context.invoked_subcommand is not None:
        return
    from rich.table import Table

    from bumpstop.model import Robot
    from bumpstop.model import robots as names
    from bumpstop.terminal import terminal

    table = Table(box=None, pad_edge=False)
    for heading in ("robot", "joints", "reach, m", "inertia", "what it is"):
        table.add_column(heading, justify="right" if heading in ("joints", "reach, m") else "left")
    for name in names():
        robot = Robot.load(name)
        what = f"{robot.title}\nfigures from {robot.source}"
        table.add_row(name, str(robot.dof), f"{robot.reach:.2f}", robot.inertia_status, what)
    terminal().print(table)


@app.command("show")
def show(
    robot: Annotated[
        str,
        typer.Argument(
            help="A built-in name, or the path of a URDF file.", show_default=False, autocompletion=complete_robot
        ),
    ],
    base: Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")] = None,
    tip: Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")] = None,
    strict_inertia: Annotated[
        bool, typer.Option("--strict-inertia", help="Refuse an inertia that no body can have, instead of warning.")
    ] = False,
    pose_deg: Annotated[
        str | None,
        typer.Option("--pose-deg", metavar="LIST", help="Joint positions of the effective masses [deg, or m]: 0,30,0."),
    ] = None,
    picture: Annotated[Path | None, typer.Option(help="Draw the chain into this file, .png or .svg.")] = None,
) -> None:
    """Print a robot's chain, limits, inertia, effective masses and drive train, and draw it."""
    from bumpstop.cli.robot_tables import pose_from_text
    from bumpstop.terminal import terminal

    check_picture(picture, "arm.svg", [robot])
    found = load_robot(robot, base, tip, strict_inertia=strict_inertia)
    pose = pose_from_text(found, pose_deg)
    if picture is not None:
        _draw(found, picture)
    _print(found, pose, terminal())
    if picture is not None:
        typer.echo(f"picture: {picture}")


@app.command("export")
def export(
    robot: Annotated[
        str,
        typer.Argument(
            help="A built-in name, or the path of a URDF file.", show_default=False, autocompletion=complete_robot
        ),
    ],
    file: Annotated[Path, typer.Argument(help="Where to write it.", show_default=False)],
    base: Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")] = None,
    tip: Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")] = None,
) -> None:
    """Write a robot as a text that C++ programs read (bumpstop/model/robot_description.hpp)."""
    from bumpstop.model import describe
    from bumpstop.text_files import write_text

    check_inputs(file, [robot], option="FILE")
    write_text(file, describe(load_robot(robot, base, tip)))
    typer.echo(f"robot: {file}")


def load_robot(name: str, base: str | None = None, tip: str | None = None, *, strict_inertia: bool = False) -> Robot:
    """The robot that a command names: a built-in one, or a URDF file."""
    from bumpstop.model import Robot

    if is_path(name):
        try:
            return Robot.from_urdf(name, base, tip, strict_inertia=strict_inertia)
        except InputError as error:
            field = f"--{error.field}" if error.field in ("base", "tip") else error.field
            raise InputError(field, error.problem, error.valid) from None
    for option, value in (("--base", base), ("--tip", tip)):
        if value is not None:
            raise InputError(option, f"has no meaning with the built-in robot {name!r}", "give the path of a URDF")
    return Robot.load(name)


def _print(robot: Robot, pose: FloatArray, console: Console) -> None:
    from rich.table import Table

    from bumpstop.cli.robot_tables import print_drive_train, print_effective_masses

    table = Table(box=None, pad_edge=False)
    for heading in ("", "joint", "link", "origin, mm", "rpy, deg", "axis", "limits, deg", "deg/s", "kg"):
        table.add_column(heading, justify="left" if heading in ("joint", "link") else "right", overflow="fold")
    for number, joint in enumerate(robot.joints, start=1):
        table.add_row(
            str(number),
            joint.name,
            joint.link,
            _row([1e3 * value for value in joint.origin]),
            _row(_angles(joint.rotation)),
            _row(list(joint.axis)),
            *_limits(joint),
            "-" if joint.inertia is None else f"{joint.inertia.mass:.4g}",
        )
    console.print(f"{robot.title or robot.name}: {robot.dof} joints, reach {robot.reach:.4g} m")
    console.print(table)
    angles = _angles(robot.tip_rotation)
    turned = f", rpy {_row(angles)} deg" if any(angles) else ""
    console.print(
        f"tip: {robot.tip_name}, at {_row([1e3 * value for value in robot.tip_origin])} mm of the last link{turned}"
    )
    if robot.frames:
        frames = ", ".join(f"{frame.name} (on {robot.joints[frame.link].link})" for frame in robot.frames)
        console.print(f"fixed to links: {frames}")
    if robot.payload_kg is not None:
        console.print(f"rated payload: {robot.payload_kg:g} kg")
    console.print(f"geometry: {robot.source or 'source not stated'}")
    where = f"; {robot.inertia_source}" if robot.inertia_source else ""
    console.print(f"inertia: {_INERTIA[robot.inertia_status]}{where}")
    print_effective_masses(robot, pose, console)
    print_drive_train(robot, console)
    if robot.note:
        console.print(f"note: {robot.note}")
    for warning in robot.warnings:
        console.print(f"warning: {warning}")


def _row(values: list[float]) -> str:
    return " ".join(f"{round(value, 4) + 0.0:g}" for value in values)


def _angles(rotation: Matrix3) -> list[float]:
    """Roll, pitch and yaw [deg]; where pitch is 90 deg, all of the turn about z is in the roll."""
    (xx, _, _), (yx, yy, yz), (zx, zy, zz) = rotation
    if abs(zx) > 1 - 1e-12:
        roll, yaw = math.atan2(-yz, yy), 0.0
    else:
        roll, yaw = math.atan2(zy, zz), math.atan2(yx, xx)
    return [math.degrees(angle) for angle in (roll, math.atan2(-zx, math.hypot(xx, yx)), yaw)]


def _limits(joint: Joint) -> tuple[str, str]:
    """Position and speed, in degrees as the headings say, or with their own unit."""
    turns = joint.kind == "revolute"
    unit, factor = ("", 180 / math.pi) if turns else (" mm", 1e3)
    speed = f"{factor * joint.velocity:.4g}" + ("" if turns else " mm/s")
    limits = f"{factor * joint.lower:.4g} to {factor * joint.upper:.4g}{unit}"
    return (
        limits if math.isfinite(joint.lower) or math.isfinite(joint.upper) else "no limits",
        speed if math.isfinite(joint.velocity) else "no limit",
    )


def _draw(robot: Robot, path: Path) -> None:
    from bumpstop.report.collision.chain import chain_picture

    save_picture(chain_picture(robot), path)
