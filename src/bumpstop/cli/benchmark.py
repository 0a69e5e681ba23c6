"""``bumpstop benchmark``: bumpstop's methods beside those of the literature."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from bumpstop.cli.command_group import group
from bumpstop.cli.completion import complete_robot
from bumpstop.errors import InputError, where_else

app = group("Compare detectors of collisions on contacts that are known.")


@app.callback()
def benchmark() -> None:
    """Compare detectors of collisions on contacts that are known."""


@app.command("detectors")
def detectors(
    robot: Annotated[
        str, typer.Option(help="A built-in name, or the path of a URDF file.", autocompletion=complete_robot)
    ] = "ur5e",
    base: Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")] = None,
    tip: Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")] = None,
    hours: Annotated[float, typer.Option(help="Of free motion; half of it counts false alarms.")] = 1.0,
    contacts: Annotated[int, typer.Option(metavar="NUMBER", help="At least so many.")] = 200,
    stiffness: Annotated[float, typer.Option(help="Of the body [N/m].")] = 20000.0,
    seed: Annotated[int, typer.Option(metavar="NUMBER", help="Seed of motion and noise.")] = 0,
    recording: Annotated[
        Path | None,
        typer.Option(help="A recording of free motion with joint torques: pushes are added to it.", show_default=False),
    ] = None,
    columns: Annotated[Path | None, typer.Option(help="Column file of the recording (TOML).")] = None,
    cutoff: Annotated[
        float | None, typer.Option(help="Of the identification [Hz].", show_default="the best of eight")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Write curves.svg, curves.png and points.csv there.")
    ] = None,
) -> None:
    """Compare seven detectors: false alarms an hour against newtons at detection."""
    from bumpstop.benchmark import compare_detectors, compare_on_recording
    from bumpstop.cli.folders import check_inputs
    from bumpstop.cli.identification.arm_recordings import recording_files
    from bumpstop.cli.option_names import as_options
    from bumpstop.cli.progress import progress
    from bumpstop.cli.robots import load_robot
    from bumpstop.recording import Recording

    read = [] if recording is None else recording_files([recording], columns)
    check_inputs(out, [robot, *read], "curves.svg", "curves.png", "points.csv")
    arm = load_robot(robot, base, tip)
    if recording is None and (columns is not None or cutoff is not None):
        raise InputError("--columns" if columns is not None else "--cutoff", "has no meaning without --recording")
    if seed < 0:
        raise InputError("--seed", f"is {seed}", "wanted zero or more")
    names = {"hours": "--hours", "contacts": "--contacts", "stiffness_N_m": "--stiffness", "recording": "--recording"}
    with progress("comparing"), as_options(names):
        if recording is None:
            found = compare_detectors(arm, hours=hours, contacts=contacts, stiffness_N_m=stiffness, seed=seed)
        else:
            found = compare_on_recording(Recording.load(recording, columns=columns, robot=arm), arm, cutoff_hz=cutoff)
    if out is not None:
        _write(found, out)
    if as_json:
        typer.echo(json.dumps(found.to_json(), allow_nan=False, indent=2))
        return
    typer.echo(str(found))
    if out is not None:
        typer.echo(f"curves: {out / 'curves.svg'}")


def _write(found: object, out: Path) -> None:
    from matplotlib.figure import Figure

    from bumpstop import output_files
    from bumpstop.benchmark import DetectorBenchmark

    assert isinstance(found, DetectorBenchmark)
    figure = Figure(figsize=(7, 4.5), layout="constrained")
    found.plot(figure.add_subplot())
    try:
        out.mkdir(parents=True, exist_ok=True)
        for ending in ("svg", "png"):
            with output_files.replacing(out / f"curves.{ending}") as waiting:
                metadata = {"Date": None} if ending == "svg" else None
                figure.savefig(waiting, format=ending, dpi=120, metadata=metadata)
        output_files.write_csv(out / "points.csv", found.to_frame())
    except OSError as error:
        raise InputError(
            "--out", f"{str(out)!r} cannot be written ({error.strerror or error})", where_else(error)
        ) from None
