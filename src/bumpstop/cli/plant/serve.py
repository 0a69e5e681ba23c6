"""``bumpstop plant serve``: the plant in real time, for a monitor to watch."""

from __future__ import annotations

import json
import math
import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.folders import check_folder, check_inputs
from bumpstop.cli.option_names import as_options
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.live.bench import BenchLink, BenchRun
    from bumpstop.plant import Plant

_MAX_WAIT_S = 0.2


def serve(
    experiment: Annotated[Path, typer.Argument(help="Experiment file (TOML).", show_default=False)],
    rtde: Annotated[
        int | None, typer.Option(help="Serve as a controller of Universal Robots on this port; 0: any free one.")
    ] = None,
    axes: Annotated[
        str | None,
        typer.Option(
            help="With --rtde: joints that the controller's six are, such as 2,3,4,5,6,7 behind a rail.",
            show_default="1,2,3,4,5,6",
        ),
    ] = None,
    dds: Annotated[str | None, typer.Option(help="Publish joint states on this topic of ROS 2.")] = None,
    domain: Annotated[int | None, typer.Option(help="Of DDS. Default: ROS_DOMAIN_ID, else 0.")] = None,
    runs: Annotated[int, typer.Option(help="How often to move; 0: until interrupted.")] = 1,
    pause_s: Annotated[float, typer.Option("--pause-s", help="Between two motions.")] = 1.0,
    pace: Annotated[float, typer.Option(help="Seconds of the plant for a second of the clock.")] = 1.0,
    wait_s: Annotated[
        float | None, typer.Option("--wait-s", help="Give up where no monitor comes within this time.")
    ] = None,
    seed: Annotated[int | None, typer.Option(help="In place of the experiment's.")] = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Write each run into a folder in this one.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Move the plant in real time behind RTDE or DDS on the loopback, and react as a monitor answers."""
    from bumpstop.live.bench import PlantBench
    from bumpstop.plant.experiment import Experiment
    from bumpstop.plant.run import RECORDING, TRACE, TRUTH

    for option, value, least, most in (
        ("--runs", runs, 0, 1_000_000),
        ("--pause-s", pause_s, 0, 3600),
        ("--pace", pace, 0.01, 100),
        ("--wait-s", 0 if wait_s is None else wait_s, 0, 1e6),
        ("--rtde", rtde or 0, 0, 65535),
    ):
        if not least <= value <= most:
            raise InputError(option, f"is {value:g}", f"wanted {least:g} to {most:g}")
    if rtde is None and dds is None:
        raise InputError("--rtde", "and --dds are both missing", "give a port, a topic, or both")
    if axes is not None and rtde is None:
        raise InputError("--axes", "has no meaning without --rtde")
    if domain is not None and dds is None:
        raise InputError("--domain", "has no meaning without --dds")
    if dds is not None:
        from bumpstop.live.dds.participant import domain_of, topic_name

        with as_options({"domain": "--domain", "topic": "--dds"}):
            topic_name(dds)
            domain_of(domain)
    check_folder(out)
    found = Experiment.load(experiment)
    check_inputs(out, [experiment, *found.files()], *(f"run_*/{name}" for name in (RECORDING, TRUTH, TRACE)))
    if seed is not None:
        with as_options({"seed": "--seed"}):
            found = Experiment.from_dict(found.model_dump(exclude_unset=True) | {"seed": seed}, found.folder)
    plant, command = found.prepare()
    links = _links(plant, rtde, axes, dds, domain)
    bench = PlantBench(plant, links, found.reaction_of(plant.robot), pace)
    done: list[dict[str, Any]] = []
    try:
        if not as_json:
            where = ", ".join(link.address for link in links)
            typer.echo(f"{plant.robot.name} at {plant.sensors.rate_hz:g} Hz, {command.duration:.3f} s; {where}")
        if not _somebody_came(bench, math.inf if wait_s is None else wait_s):
            raise InputError("--wait-s", f"no monitor came within {wait_s:g} s", "start one")
        while not runs or len(done) < runs:
            if done:
                time.sleep(pause_s)
            one = bench.run(command)
            written = [] if out is None else [str(path) for path in one.run.save(out / f"run_{len(done) + 1}")]
            done.append(_as_json(one, written))
            if not as_json:
                _print(len(done), one, written)
    except KeyboardInterrupt:
        # It is the end that was asked for; what has been done counts.
        if runs:
            raise
    finally:
        bench.close()
    if as_json:
        typer.echo(json.dumps({"robot": plant.robot.name, "runs": done}, allow_nan=False, indent=2))


def _links(plant: Plant, rtde: int | None, axes: str | None, dds: str | None, domain: int | None) -> list[BenchLink]:
    from bumpstop.live.bench import DdsLink, RtdeLink
    from bumpstop.live.rtde.axes import DEFAULT_AXES, read_axes

    links: list[BenchLink] = []
    if dds is not None:
        links.append(DdsLink(plant, dds, domain=domain))
    if rtde is not None:
        with as_options({"axes": "--axes", "rtde": "--rtde"}):
            links.append(RtdeLink(plant, rtde, DEFAULT_AXES if axes is None else read_axes(axes)))
    return links


def _somebody_came(bench: Any, wait_s: float) -> bool:
    end = time.monotonic() + wait_s
    while not bench.wait_for_client(min(_MAX_WAIT_S, max(0.0, end - time.monotonic()))):
        if time.monotonic() >= end:
            return False
    return True


def _print(number: int, one: BenchRun, written: list[str]) -> None:
    run = one.run
    typer.echo(f"run {number}: {run.recording.duration:.3f} s, {len(one.published)} samples, {run.lost} lost")
    if one.slipped_s:
        typer.echo(f"  the plant computed {one.slipped_s:.3f} s too slowly, and its clock waited")
    for thing, peak in zip(run.truth["object"], run.truth["run"]["peak_force_N"], strict=True):
        typer.echo(f"  {thing['name']}: " + (f"peak {peak:.1f} N" if peak else "never touched"))
    trip = one.round_trip()
    if one.answer is None or trip is None:
        typer.echo("  no answer")
    else:
        when = "" if run.reaction_time is None else f"; reaction after {run.reaction_time:.3f} s"
        words = f"{one.answer.kind} {1e3 * trip[1]:.2f} ms after the sample of {trip[0]:.3f} s"
        typer.echo(f"  answer by {one.answered_by}: {words}{when}")
    for note in run.notes:
        typer.echo(f"  note: {note}")
    for name in written[:1]:
        typer.echo(f"  wrote {name}, truth and trace beside it")


def _as_json(one: BenchRun, written: list[str]) -> dict[str, Any]:
    run, trip = one.run, one.round_trip()
    peaks = zip(run.truth["object"], run.truth["run"]["peak_force_N"], strict=True)
    return {
        "begin_s": one.begin_s,
        "duration_s": run.recording.duration,
        "samples": len(one.published),
        "lost": run.lost,
        "slipped_s": one.slipped_s,
        "objects": [{"name": thing["name"], "peak_force_N": peak} for thing, peak in peaks],
        "answer": None if one.answer is None else one.answer.kind,
        "answered_by": one.answered_by or None,
        "answered_sample_s": None if trip is None else trip[0],
        "answer_after_ms": None if trip is None else 1e3 * trip[1],
        "reaction_s": run.reaction_time,
        "files": written,
        "notes": list(run.notes),
    }
