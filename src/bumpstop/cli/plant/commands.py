"""``bumpstop plant``: experiments on an arm in MuJoCo, and a test bench for monitors."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.command_group import group
from bumpstop.cli.folders import check_folder, check_inputs
from bumpstop.cli.identification.arm_recordings import model_files
from bumpstop.cli.option_names import as_options
from bumpstop.cli.plant.serve import serve
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.plant import Experiment, PlantRun

app = group("Experiment on an arm in MuJoCo: recordings, with the truth behind them.")


@app.callback()
def _plant() -> None:
    """Experiment on an arm in MuJoCo: recordings, with the truth behind them."""


app.command("serve")(serve)


@app.command("run")
def run(
    experiment: Annotated[Path, typer.Argument(help="Experiment file (TOML).", show_default=False)],
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write the files into this folder.")] = None,
    picture: Annotated[
        Path | None, typer.Option(help="Draw the moment of the greatest force into this file, .png.")
    ] = None,
    video: Annotated[Path | None, typer.Option(help="Draw the run into this file, .gif.")] = None,
    seed: Annotated[int | None, typer.Option(help="In place of the experiment's.")] = None,
    plan: Annotated[
        Path | None, typer.Option(help="Run a plan's trajectories: plan.toml, or the folder that holds it.")
    ] = None,
    joint: Annotated[list[int] | None, typer.Option(help="Of the plan; may be given many times. Default: all.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Run an experiment and write recording.parquet, truth.toml and trace.parquet."""
    from bumpstop.plant.experiment import Experiment
    from bumpstop.plant.picture import checked_ending
    from bumpstop.plant.run import RECORDING, TRACE, TRUTH

    for path, option, ending in ((picture, "--picture", ".png"), (video, "--video", ".gif")):
        if path is not None:
            checked_ending(path, option, ending)
    check_folder(out)
    found = Experiment.load(experiment)
    plan_file = None if plan is None else plan / "plan.toml" if plan.is_dir() else plan
    read = [experiment, *found.files(), *model_files(plan_file)]
    for path, option in ((picture, "--picture"), (video, "--video")):
        check_inputs(path, read, option=option)
    written = (RECORDING, TRUTH, TRACE)
    check_inputs(out, read, *(written if plan is None else (f"joint_*/{name}" for name in written)))
    if seed is not None:
        with as_options({"seed": "--seed"}):
            found = Experiment.from_dict(found.model_dump(exclude_unset=True) | {"seed": seed}, found.folder)
    if plan_file is not None:
        if picture is not None or video is not None:
            raise InputError("--picture" if picture is not None else "--video", "has no meaning with --plan")
        _simulate_protocol(found, plan_file, joint or [], out, as_json)
        return
    if joint:
        raise InputError("--joint", "has no meaning without --plan")
    plant, command = found.prepare()
    done = found.run_on(plant, command)
    files = [str(path) for path in done.save(out)] if out is not None else []
    if picture is not None or video is not None:
        from bumpstop.plant import picture as drawing

        for path, draw in ((picture, drawing.picture), (video, drawing.video)):
            if path is not None:
                path.parent.mkdir(parents=True, exist_ok=True)
                draw(plant, done, path)
                files.append(str(path))
    if as_json:
        typer.echo(json.dumps(_as_json(done, files), allow_nan=False, indent=2))
        return
    log = done.recording
    typer.echo(f"{log.robot}: {log.duration:.3f} s, {len(log.t)} samples at {log.rate_hz:.0f} Hz, {done.lost} lost")
    peaks = (done.truth["run"][key] for key in ("peak_force_N", "peak_measured_force_N"))
    for thing, peak, measured in zip(done.truth["object"], *peaks, strict=True):
        series = thing.get("series_stiffness_N_m")
        words = "never touched" if series is None else f"peak {peak:.1f} N, {series:.0f} N/m with the arm in series"
        free = f", free with {thing['body_mass_kg']:g} kg" if "body_mass_kg" in thing else ""
        if "spring_N_m" in thing:
            free = f" on {thing['body_mass_kg']:g} kg on a spring of {thing['spring_N_m']:g} N/m"
            words = words.replace("peak", f"shows {measured:.1f} N, peak", 1)
        typer.echo(f"{thing['name']}: {thing['stiffness_N_m']:g} N/m ({thing['status']}){free}, {words}")
    if done.reaction_time is not None:
        typer.echo(f"reaction after {done.reaction_time:.3f} s")
    for note in done.notes:
        typer.echo(f"note: {note}")
    for name in files:
        typer.echo(f"wrote {name}")


def _simulate_protocol(found: Experiment, plan_file: Path, joints: list[int], out: Path | None, as_json: bool) -> None:
    """Run the trajectories of a plan; every joint's files go into a folder of its own."""
    from bumpstop.cli.progress import progress
    from bumpstop.identification.design.plan_file import load_plan
    from bumpstop.reproduction.schroeder2013.simulate_protocol import planned_experiments, simulate_protocol

    plan = load_plan(plan_file)
    count = len(planned_experiments(plan, joints))
    rows = []
    with progress("running") as report:
        for done, (one, run) in enumerate(simulate_protocol(found, plan, joints)):
            written = [] if out is None else [str(path) for path in run.save(out / f"joint_{one.joint + 1}")]
            rows.append((one, run, written))
            report((done + 1) / count)
    if as_json:
        runs = [_as_json(run, written) | {"joint": one.joint + 1, "name": one.name} for one, run, written in rows]
        typer.echo(json.dumps({"plan": str(plan_file), "runs": runs}, allow_nan=False, indent=2))
        return
    for one, run, written in rows:
        log = run.recording
        words = f"{log.duration:.1f} s, {len(log.t)} samples at {log.rate_hz:.0f} Hz, {run.lost} lost"
        typer.echo(f"joint {one.joint + 1}, {one.name}: {words}")
        for name in written[:1]:
            typer.echo(f"wrote {name}, truth and trace beside it")
    for note in dict.fromkeys(note for _, run, _ in rows for note in run.notes):
        typer.echo(f"note: {note}")


def _as_json(run: PlantRun, written: list[str]) -> dict[str, Any]:
    log = run.recording
    return {
        "robot": log.robot,
        "duration_s": log.duration,
        "rate_hz": log.rate_hz,
        "samples": len(log.t),
        "lost": run.lost,
        "seed": run.truth["seed"],
        "reaction_s": run.reaction_time,
        "objects": [
            {
                "name": thing["name"],
                "stiffness_N_m": thing["stiffness_N_m"],
                "series_stiffness_N_m": _finite(thing.get("series_stiffness_N_m")),
                "peak_force_N": peak,
            }
            for thing, peak in zip(run.truth["object"], run.truth["run"]["peak_force_N"], strict=True)
        ],
        "files": written,
        "notes": list(run.notes),
    }


def _finite(value: float | None) -> float | None:
    return value if value is not None and math.isfinite(value) else None
