"""``bumpstop experiment``: Schroeder's collisions on the plant."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Annotated

import typer

from bumpstop.cli.folders import check_folder, check_no_job
from bumpstop.cli.option_names import as_options
from bumpstop.errors import InputError
from bumpstop.text_files import list_items

# Fields of an experiment by the name that a person gave them here.
_OPTIONS = {field: f"--{field}" for field in ("runs", "seed", "at", "stiffness", "residual", "loss")} | {
    "latency_s": "--latency"
}


def command(
    name: Annotated[str, typer.Argument(help="plexiglas, fiberboard, glass or banana.", show_default=False)],
    runs: Annotated[int, typer.Option(help="Runs at each speed.")] = 10,
    seed: Annotated[int, typer.Option(help="Of the first run at each speed.")] = 0,
    speeds: Annotated[
        str | None,
        typer.Option(metavar="LIST", help="Speeds of the hand [mm/s].", show_default="all of Schroeder (2013)"),
    ] = None,
    at: Annotated[str, typer.Option(help="What is hit: hand, elbow or forearm.")] = "hand",
    stiffness: Annotated[
        float | None, typer.Option(help="Of the object [N/m].", show_default="that of the plant's object")
    ] = None,
    latency: Annotated[float, typer.Option(help="From the sample that alarms to the reaction [s].")] = 0.004,
    residual: Annotated[str, typer.Option(help="direct or observer.")] = "direct",
    without_inertia: Annotated[
        bool,
        typer.Option(
            "--without-inertia", help="Leave the rotors out of the detector's model, as Schroeder (2013) did."
        ),
    ] = False,
    loss: Annotated[float, typer.Option(help="Share of feedback samples that get lost.")] = 0.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write runs, settings and a page into it.")] = None,
) -> None:
    """Run Schroeder's collisions on an arm in MuJoCo, and print them beside its figures."""
    from bumpstop.cli.progress import progress
    from bumpstop.reproduction.schroeder2013.collision_table import CollisionTable
    from bumpstop.reproduction.schroeder2013.collisions import CollisionExperiment

    wanted = _speeds(speeds)
    # Before the runs, which may take minutes.
    check_folder(out)
    check_no_job(out)
    with as_options(_OPTIONS):
        made = CollisionExperiment(
            name=name,
            at=at,  # type: ignore[arg-type]
            stiffness=stiffness,
            latency_s=latency,
            residual=residual,  # type: ignore[arg-type]
            reflected_inertia=not without_inertia,
            loss=loss,
        )
        with progress("running") as report:
            table = CollisionTable.measure(made, runs=runs, seed=seed, speeds_mm_s=wanted, progress=report)
    written = [] if out is None else table.save(out)
    if out is not None:
        from bumpstop.reproduction.schroeder2013.experiment_page import write_experiment

        written.append(write_experiment(table, out))
    if as_json:
        typer.echo(json.dumps(table.to_json() | {"files": [str(path) for path in written]}, allow_nan=False, indent=2))
        return
    thing = made.object()
    typer.echo(f"{name} at the {at}: {thing.stiffness:g} N/m ({thing.status}), {made.residual} residual; {made.table}")
    typer.echo(f"the first threshold is reached at {made.threshold_force():.1f} N")
    typer.echo("          detected  false    at detection, N     bound   peak, N          delay  joints")
    typer.echo("mm/s                alarms   ours Schroeder          N   ours Schroeder       ms")
    for row in table.rows:
        data, source = row.to_json(), row.source
        force, peak = (source.force_N, source.peak_N) if source else (None, None)
        delay = None if data["delay_s"] is None else 1e3 * data["delay_s"]
        joints = " ".join(f"{joint} ({count})" for joint, count in row.joints.items())
        typer.echo(
            f"{row.speed_mm_s:<9g} {len(row.hits):>4}/{len(row.runs):<4} {data['false_alarms']:>5}"
            f" {_number(data['force_at_detection_N'])} {_number(force)}   {row.bound_N:>9.1f}"
            f" {_number(data['peak_force_N'])} {_number(peak)}   {_number(delay)}  {joints}"
            f"{'' if source is None or source.detected else '  Schroeder: false alarm'}"
        )
    for path in written:
        typer.echo(f"wrote {path}")


def _number(value: float | None) -> str:
    return f"{'-':>7}" if value is None else f"{value:>7.1f}"


def _speeds(text: str | None) -> list[float]:
    from bumpstop.reproduction.schroeder2013.collisions import MAX_SPEED, MIN_SPEED

    if text is None:
        return []
    try:
        speeds = [float(part) for part in list_items(text)]
    except ValueError:
        raise InputError("--speeds", f"is {text!r}", "wanted numbers like 25,50") from None
    for speed in speeds:
        if not MIN_SPEED <= speed / 1e3 <= MAX_SPEED:
            raise InputError("--speeds", f"has {speed:g}", f"wanted {1e3 * MIN_SPEED:g} to {1e3 * MAX_SPEED:g} mm/s")
    return speeds
