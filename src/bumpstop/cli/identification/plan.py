"""``bumpstop plan``: motions that let an arm show its parameters."""

from __future__ import annotations

import json
import math
import re
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.command_group import group
from bumpstop.cli.completion import complete_robot
from bumpstop.cli.folders import check_folder, check_inputs, check_own, writing
from bumpstop.cli.option_names import as_options
from bumpstop.errors import InputError
from bumpstop.output_files import write_bytes
from bumpstop.text_files import list_items

if TYPE_CHECKING:
    from bumpstop.identification.design.plan import IdentificationPlan
    from bumpstop.identification.design.timed_path import TimedPath
    from bumpstop.model import Robot

app = group("Plan motions that let an arm show its parameters.")

RobotName = Annotated[
    str,
    typer.Option(
        help="A built-in name, or the path of a URDF file.", show_default=False, autocompletion=complete_robot
    ),
]
Base = Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")]
Tip = Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")]
Folder = Annotated[Path | None, typer.Option("--out", "-o", help="Write plan and trajectories into this folder.")]
Floor = Annotated[str, typer.Option(help="Height of the floor in the base frame [m], or none.")]
Radius = Annotated[float, typer.Option(help="Radius of the links' capsules [m].")]
Rate = Annotated[float, typer.Option(help="Rows a second of the CSV files [Hz].")]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
_RATES = (1.0, 2000.0)
# Fields of the settings that are called as their options are, and one that is not.
_OF_BOTH = ("acceleration", "floor", "radius")
_OF_PROTOCOL = ("repeats", "holds", "hold_s", "min_torque", "gravity", "load_kg")
_OF_SERIES = ("period_s", "harmonics", "periods", "rounds", "seed")
_OPTIONS = {field: f"--{field.replace('_', '-')}" for field in (*_OF_BOTH, *_OF_PROTOCOL, *_OF_SERIES)}
_OPTIONS["ramp_repeats"] = "--ramps"
_OPTIONS["speed_shares"] = "--speeds"


@app.command("identification")
def identification(
    robot: RobotName,
    out: Folder = None,
    speeds: Annotated[
        str, typer.Option(metavar="LIST", help="Percent of each joint's largest speed; no motion is faster.")
    ] = "10,20,30,40,50,60,70,80,90,100",
    repeats: Annotated[int, typer.Option(help="Strokes at every speed, there and back.")] = 15,
    ramps: Annotated[int, typer.Option(help="Strokes at every acceleration, there and back.")] = 3,
    holds: Annotated[int, typer.Option(help="Holds from either side; 0: no hold test.")] = 5,
    hold_s: Annotated[float, typer.Option(help="Length of a hold [s].")] = 50.0,
    acceleration: Annotated[float, typer.Option(help="Peak of every ramp [rad/s2].")] = 4.5,
    floor: Floor = "0",
    radius: Radius = 0.08,
    min_torque: Annotated[float, typer.Option(help="Wanted of gravity at both ends of a stroke [Nm].")] = 0.5,
    gravity: Annotated[
        str, typer.Option(metavar="LIST", help="Acceleration of free fall in the base frame [m/s2].")
    ] = "0,0,-9.80665",
    load_kg: Annotated[float, typer.Option(help="Known mass fixed to the tip [kg].")] = 0.0,
    load_m: Annotated[str, typer.Option(metavar="LIST", help="Where, in the tip's frame [m].")] = "0,0,0",
    rate: Rate = 50.0,
    base: Base = None,
    tip: Tip = None,
    as_json: AsJson = False,
) -> None:
    """Plan Schroeder's protocol: strokes through zero gravity torque, ramps, holds; one trajectory a joint."""
    from bumpstop.identification.design.plan import ProtocolSettings, plan_identification
    from bumpstop.identification.design.plan_file import KIND, save_plan

    check_folder(out)
    check_inputs(out, [robot], "plan.toml", "joint_*.csv", "joint_*.json")
    if out is not None:
        # A plan of measurements has a file of this name, too.
        check_own(out / "plan.toml", lambda _, data: data.get("kind") == KIND, "give another folder")
    arm, named = named_robot(robot, base, tip)
    if load_kg == 0 and any(_three("--load-m", load_m)):
        raise InputError("--load-m", "has no effect without --load-kg", "give both, or neither")
    check_rate(rate)
    with as_options(_OPTIONS):
        settings = ProtocolSettings(
            speed_shares=tuple(_share("--speeds", percent) for percent in _numbers("--speeds", speeds)),
            repeats=repeats,
            ramp_repeats=ramps,
            holds=holds,
            hold_s=hold_s,
            acceleration=acceleration,
            floor=_floor(floor),
            radius=radius,
            min_torque=min_torque,
            gravity=_three("--gravity", gravity),
            load_kg=load_kg,
            load_m=_three("--load-m", load_m),
        )
        plan = plan_identification(arm, settings)
    if not plan.experiments:
        raise _nothing_to_plan(plan)
    files, removed = ["plan.toml"], list[str]()
    with writing(out):
        seconds = []
        for experiment in plan.experiments:
            path = plan.path(experiment)
            seconds.append(path.duration)
            if out is not None:
                files += write_path(out, f"joint_{experiment.joint + 1}", path, arm, rate)
        if out is not None:
            removed = _remove_others(out, files)
            save_plan(plan, out / "plan.toml", robot=named)
    if as_json:
        answer = _as_json(plan, seconds, files if out is not None else [], removed)
        typer.echo(json.dumps(answer, allow_nan=False, indent=2))
        return
    _print(plan, seconds)
    if out is not None:
        typer.echo(f"plan: {out / 'plan.toml'}, trajectories beside it as .csv and .json")
        if removed:
            typer.echo(f"removed, as they are of another plan: {', '.join(removed)}")


def named_robot(name: str, base: str | None, tip: str | None) -> tuple[Robot, dict[str, str]]:
    """A robot, and how files of identification name it."""
    from bumpstop.cli.identification.arm_recordings import built_in_or_path
    from bumpstop.cli.robots import load_robot

    arm = load_robot(name, base, tip)
    named = {"robot": built_in_or_path(name)}
    named |= {key: value for key, value in (("base", base), ("tip", tip)) if value is not None}
    return arm, named


def check_rate(rate: float) -> None:
    """Refuse a rate that no controller has."""
    if not _RATES[0] <= rate <= _RATES[1]:
        raise InputError("--rate", f"is {rate:g}", f"wanted {_RATES[0]:g} to {_RATES[1]:g} rows a second")


def write_path(folder: Path, name: str, path: TimedPath, arm: Robot, rate: float) -> list[str]:
    """Write a motion as CSV and as JointTrajectory; the names of the files."""
    from bumpstop.identification.design.trajectory_files import joint_trajectory, trajectory_csv

    write_bytes(folder / f"{name}.csv", trajectory_csv(path, rate).encode("utf-8"))
    names = [joint.name for joint in arm.joints]
    write_bytes(folder / f"{name}.json", joint_trajectory(path, names).encode("utf-8"))
    return [f"{name}.csv", f"{name}.json"]


def _remove_others(folder: Path, files: list[str]) -> list[str]:
    """Remove the trajectories of a former plan that the new one does not have; returns their names."""
    if not (folder / "plan.toml").exists():
        return []
    found = [path for path in folder.iterdir() if re.fullmatch(r"joint_[1-9][0-9]*\.(csv|json)", path.name)]
    others = sorted(path for path in found if path.name not in files)
    for path in others:
        path.unlink()
    return [path.name for path in others]


def _nothing_to_plan(plan: IdentificationPlan) -> InputError:
    """Of a plan without an experiment: why each joint has none."""
    joints: dict[str, list[str]] = {}
    for lost in plan.unobservable:
        joints.setdefault(lost.reason, []).append(lost.name)
    why = "; ".join(f"{', '.join(names)}: {reason}" for reason, names in joints.items())
    remedies = dict.fromkeys(lost.remedy for lost in plan.unobservable)
    return InputError("plan", f"no joint of {plan.robot.name} is left for it ({why})", f"try {'; or '.join(remedies)}")


def _share(option: str, percent: float, least: float = 0.0) -> float:
    if not (0 < percent <= 100 and percent >= least):
        wanted = f"{least:g} to 100" if least else "above 0, at most 100"
        raise InputError(option, f"{percent:g} % cannot be used", f"wanted {wanted}")
    return percent / 100


def _floor(text: str) -> float | None:
    return None if text == "none" else _numbers("--floor", text, 1)[0]


def _three(option: str, text: str) -> tuple[float, float, float]:
    x, y, z = _numbers(option, text, 3)
    return x, y, z


def _numbers(option: str, text: str, count: int | None = None) -> list[float]:
    try:
        found = [float(part) for part in list_items(text)]
    except ValueError:
        found = []
    if not found or not all(map(math.isfinite, found)) or (count is not None and len(found) != count):
        wanted = "numbers, separated by commas" if count is None else f"{count} of them, separated by commas"
        raise InputError(option, f"{text!r} cannot be used", f"wanted {wanted}" if count != 1 else "wanted a number")
    return found


def _as_json(plan: IdentificationPlan, seconds: list[float], files: list[str], removed: list[str]) -> dict[str, Any]:
    joints = [
        {
            "joint": one.joint + 1,
            "name": one.name,
            "pose": one.pose.tolist(),
            "stroke_rad": [one.low, one.high],
            "gravity_torque_Nm": [one.torque_low, one.torque_high],
            "clearance_m": one.clearance if math.isfinite(one.clearance) else None,
            "speeds_rad_s": list(one.speeds),
            "too_fast": list(one.too_fast),
            "hold_joint": None if one.hold_joint is None else one.hold_joint + 1,
            "duration_s": duration,
        }
        for one, duration in zip(plan.experiments, seconds, strict=True)
    ]
    unobservable = [
        {"joint": lost.joint + 1, "name": lost.name, "reason": lost.reason, "remedy": lost.remedy}
        for lost in plan.unobservable
    ]
    return {
        "robot": plan.robot.name,
        "joints": joints,
        "unobservable": unobservable,
        "files": files,
        "removed": removed,
    }


def _print(plan: IdentificationPlan, seconds: list[float]) -> None:
    from rich.console import Console
    from rich.table import Table

    console = Console(highlight=False, markup=False, soft_wrap=True, width=max(Console().width, 120))
    arm = plan.robot
    minutes = sum(seconds) / 60
    length = f"{minutes:.1f} min" if minutes < 10 else f"{minutes:.0f} min"
    typer.echo(f"{arm.title or arm.name}: {len(plan.experiments)} of {arm.dof} joints, {length}")
    table = Table(box=None, pad_edge=False)
    for heading in ("", "joint", "stroke, deg", "gravity, Nm", "deg/s", "clear, mm", "held while", "min"):
        table.add_column(heading, justify="left" if heading == "joint" else "right", no_wrap=True)
    for one, duration in zip(plan.experiments, seconds, strict=True):
        table.add_row(
            str(one.joint + 1),
            one.name,
            f"{math.degrees(one.low):.0f} to {math.degrees(one.high):.0f}",
            f"{one.torque_low:.3g} to {one.torque_high:.3g}",
            f"{math.degrees(one.speeds[0]):.3g} to {math.degrees(one.speeds[-1]):.3g}",
            f"{1e3 * one.clearance:.0f}" if math.isfinite(one.clearance) else "-",
            "-" if one.hold_joint is None else f"{one.hold_joint + 1} swings",
            f"{duration / 60:.1f}",
        )
    console.print(table)
    for one in plan.experiments:
        if one.too_fast:
            shares = ", ".join(f"{100 * share:.0f}" for share in one.too_fast)
            typer.echo(f"{one.name}: no room to reach {shares} % of its speed at {plan.settings.acceleration:g} rad/s2")
    for lost in plan.unobservable:
        typer.echo(
            f"{lost.name}: its current-to-torque model is not identifiable, as {lost.reason}; remedy: {lost.remedy}"
        )
    typer.echo("Links are capsules here, tools and cables are not known: try every trajectory slowly first.")


@app.command("excitation")
def excitation(
    robot: RobotName,
    out: Folder = None,
    period_s: Annotated[float, typer.Option(help="Period of the series [s].")] = 10.0,
    harmonics: Annotated[int, typer.Option(help="Harmonics of every joint.")] = 5,
    periods: Annotated[int, typer.Option(help="Periods that are run.")] = 3,
    acceleration: Annotated[float, typer.Option(help="Most of every joint [rad/s2].")] = 4.5,
    speed_percent: Annotated[float, typer.Option(help="Percent of each joint's largest speed.")] = 60.0,
    floor: Floor = "0",
    radius: Radius = 0.08,
    rounds: Annotated[int, typer.Option(help="Changes the search tries.")] = 300,
    seed: Annotated[int, typer.Option(help="Seed of the search.")] = 0,
    rate: Rate = 50.0,
    base: Base = None,
    tip: Tip = None,
    as_json: AsJson = False,
) -> None:
    """Plan a Fourier series of all joints that makes their inertia visible, inside limits and clear of the floor."""
    from bumpstop.arrays import finite_or_none
    from bumpstop.cli.progress import progress
    from bumpstop.identification.design.excitation import ExcitationSettings, plan_excitation
    from bumpstop.identification.dynamics.dynamics_verdict import ILL_CONDITIONED

    check_folder(out)
    check_inputs(out, [robot], "excitation.csv", "excitation.json")
    arm, _ = named_robot(robot, base, tip)
    check_rate(rate)
    with as_options(_OPTIONS), progress("searching") as report:
        settings = ExcitationSettings(
            period_s=period_s,
            harmonics=harmonics,
            periods=periods,
            acceleration=acceleration,
            speed_share=_share("--speed-percent", speed_percent, least=1.0),
            floor=_floor(floor),
            radius=radius,
            rounds=rounds,
            seed=seed,
        )
        found = plan_excitation(arm, settings, progress=report)
    files: list[str] = []
    if out is not None:
        with writing(out):
            files = write_path(out, "excitation", found.path(), arm, rate)
    if as_json:
        answer = {
            "robot": arm.name,
            "condition_number": finite_or_none(found.condition),
            "condition_number_of_random_start": finite_or_none(found.start_condition),
            "base_parameters": found.parameters,
            "clearance_m": found.clearance if math.isfinite(found.clearance) else None,
            "duration_s": periods * period_s,
            "middle": found.middle.tolist(),
            "sine": found.sine.tolist(),
            "cosine": found.cosine.tolist(),
            "files": files,
        }
        typer.echo(json.dumps(answer, allow_nan=False, indent=2))
        return
    typer.echo(f"{arm.title or arm.name}: {found.parameters} base parameters, {periods} periods of {period_s:g} s")
    if math.isfinite(found.condition):
        begun = f"the search began with a random motion of {found.start_condition:.3g}"
        typer.echo(f"condition number {found.condition:.3g}; {begun}")
        if found.condition > ILL_CONDITIONED:
            typer.echo(
                f"warning: above {ILL_CONDITIONED:g} a motion hardly tells parameters apart, and identify warns of its "
                "fit; below 100 is good. A longer --period-s, more --rounds, --speed-percent or --acceleration help"
            )
    else:
        typer.echo("condition number infinite: the motion does not tell the base parameters apart, try a larger one")
    if math.isfinite(found.clearance):
        typer.echo(f"clear of floor and arm by {1e3 * found.clearance:.0f} mm, links as capsules")
    typer.echo("Links are capsules here, tools and cables are not known: try it slowly first.")
    if out is not None:
        typer.echo(f"trajectory: {out / 'excitation.csv'} and {out / 'excitation.json'}")
