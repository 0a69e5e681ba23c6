"""``bumpstop study``: many distributions with a question."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, cast

import typer

from bumpstop.cli.collision.evaluate import MAX_THREADS, change, whole
from bumpstop.cli.command_group import group
from bumpstop.cli.completion import complete_body, complete_setting, complete_variable
from bumpstop.cli.folders import check_inputs, scenario_files, writing
from bumpstop.cli.progress import progress

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.collision import Scenario
    from bumpstop.report.section import Part
    from bumpstop.study import Study

app = group("Compute many force distributions: what lowers the forces, for which body, and where.")

ScenarioFile = Annotated[Path, typer.Argument(help="Scenario file (TOML).", show_default=False)]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Out = Annotated[
    Path | None,
    typer.Option(
        "--out",
        "-o",
        help="Write report.html, figures, rows, summary and settings there; an interrupted study is resumed.",
    ),
]
Changes = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        autocompletion=complete_setting,
        help="Replace a key, e.g. --set contact.body=lower_arm_wrist.",
    ),
]
Threads = Annotated[
    int, typer.Option(parser=whole(1, MAX_THREADS), metavar="NUMBER", help="Threads; they do not change the result.")
]
Seed = Annotated[int, typer.Option(parser=whole(0, 2**64 - 1), metavar="NUMBER", help="Seed of what is drawn.")]


def load(path: Path, changes: list[str] | None) -> Scenario:
    """The scenario of a command, with its ``--set``."""
    from bumpstop.collision import load_scenario

    return load_scenario(path, dict(change(text) for text in changes or []))


def execute(
    study: Study,
    *,
    out: Path | None,
    as_json: bool,
    threads: int,
    report: Callable[[pl.DataFrame, dict[str, Any]], tuple[str, Sequence[Part], Sequence[str]]],
) -> dict[str, Any]:
    """Run a study, write its files and print what it found.

    Args:
        study: what is run.
        out: folder for its files, or None.
        as_json: print the summary as JSON and nothing else on stdout.
        threads: of this process.
        report: title of the page, its parts and its notes, from rows and summary.

    Returns:
        The summary.
    """
    from bumpstop.study import run, to_jsonable
    from bumpstop.text_files import running_command

    # The folder of a study that is resumed holds its settings and rows: it looks after those itself.
    check_inputs(out, scenario_files([study.scenario]), "summary.json", "manifest.json", "report.html")
    begin = time.perf_counter()
    with progress(study.title) as share:
        found = run(
            study, out, threads=threads, progress=lambda done, total: share(done / total), command=running_command()
        )
    seconds = time.perf_counter() - begin
    rows, summary = found.rows, found.summary
    page = None
    if out is not None:
        from bumpstop.report.studies.study import write_study_report

        with writing(out):
            title, parts, notes = report(rows, summary)
        page = write_study_report(study, title, parts, out, beside=summary.get("notes", []), notes=notes)
    if as_json:
        typer.echo(json.dumps(to_jsonable(summary) | {"seconds": round(seconds, 3)}, allow_nan=False, indent=2))
        return summary
    typer.echo(str(found))
    typer.echo(f"{rows.height} rows in {seconds:.1f} s")
    if page is not None:
        typer.echo(f"report: {page}")
    return summary


@app.command("parameters")
def parameters(
    scenario: ScenarioFile,
    vary: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KEY=LOW:HIGH",
            autocompletion=complete_variable,
            help="Vary a key, e.g. --vary motion.speed=10:200; default: Schroeder's.",
        ),
    ] = None,
    pair: Annotated[
        list[str] | None, typer.Option(metavar="KEY,KEY", help="Curves of equal risk over two varied keys.")
    ] = None,
    cost_rate: Annotated[
        list[str] | None,
        typer.Option(
            "--cost", metavar="KEY=COST", help="What one unit of change costs, for the cheapest way to meet the limits."
        ),
    ] = None,
    as_json: AsJson = False,
    out: Out = None,
    threads: Threads = 2,
    changes: Changes = None,
) -> None:
    """Vary one parameter after the other: peak force, fits, derivatives, and the cheapest way to meet the limits."""
    from bumpstop.study.parameters.parameters import ParameterStudy

    study = ParameterStudy.of(load(scenario, changes), vary, pair, cost_rate)

    def report(rows: pl.DataFrame, summary: dict[str, Any]) -> tuple[str, Sequence[Part], Sequence[str]]:
        from bumpstop.report.studies.parameters import pages_of

        return pages_of(study, rows, summary)

    execute(study, out=out, as_json=as_json, threads=threads, report=report)


@app.command("effectiveness")
def effectiveness(
    scenario: ScenarioFile,
    body: Annotated[
        list[str] | None,
        typer.Option(help="A body region of either table; default: all.", autocompletion=complete_body),
    ] = None,
    direction: Annotated[
        list[str] | None, typer.Option(help="down, up, forward, back, left or right; default: down and left.")
    ] = None,
    speed: Annotated[
        list[float] | None, typer.Option(metavar="MM_S", help="A speed; default: 10, 25, 50, 75 and 100 mm/s.")
    ] = None,
    area: Annotated[
        list[float] | None, typer.Option(metavar="CM2", help="A contact area; default: 1 and 2 cm².")
    ] = None,
    highest_speed: Annotated[
        float, typer.Option(metavar="MM_S", help="Speed up to which a safe one is looked for.")
    ] = 250.0,
    as_json: AsJson = False,
    out: Out = None,
    threads: Threads = 2,
    changes: Changes = None,
) -> None:
    """Judge body parts by direction, speed and contact area, and find the highest safe speed of each."""
    from bumpstop.study.parameters.effectiveness import EffectivenessStudy

    study = EffectivenessStudy.of(load(scenario, changes), body, direction, speed, area, highest_speed)

    def report(rows: pl.DataFrame, summary: dict[str, Any]) -> tuple[str, Sequence[Part], Sequence[str]]:
        from bumpstop.report.studies.effectiveness import pages_of

        return pages_of(study, rows, summary)

    execute(study, out=out, as_json=as_json, threads=threads, report=report)


@app.command("workspace")
def workspace(
    scenario: ScenarioFile,
    poses: Annotated[
        int, typer.Option(parser=whole(0, 100_000_000), metavar="NUMBER", help="Number of random poses.")
    ] = 0,
    grid: Annotated[
        int, typer.Option(parser=whole(0, 1000), metavar="NUMBER", help="Instead: values of every moving joint.")
    ] = 0,
    grid_directions: Annotated[
        int, typer.Option(parser=whole(1, 1_000_000), metavar="NUMBER", help="Directions at every pose of the grid.")
    ] = 1,
    directions: Annotated[
        str, typer.Option(help="sphere (even), polar (even polar angle, as Schroeder (2013)) or scenario (its own).")
    ] = "sphere",
    speed_sd: Annotated[float, typer.Option(metavar="MM_S", help="Spread of the speed about the scenario's.")] = 0.0,
    joint_limits: Annotated[
        str, typer.Option(help="respect: they end a motion; ignore: the arm moves on.")
    ] = "respect",
    velocity_limits: Annotated[
        str, typer.Option(help="respect: joints at their limit slow the arm; ignore: the tip keeps its speed.")
    ] = "respect",
    link_radius: Annotated[
        float, typer.Option(metavar="MM", help="Avoid self-collision of links this thick; 0: do not look for it.")
    ] = 0.0,
    predict: Annotated[
        bool, typer.Option("--predict", help="Predict forces from the pose, in its direction and in the worst one.")
    ] = False,
    seed: Seed = 0,
    as_json: AsJson = False,
    out: Out = None,
    threads: Threads = 2,
    changes: Changes = None,
) -> None:
    """Compute force distributions at poses and directions all over the arm's reach."""
    from typing import get_args

    from bumpstop.errors import InputError, near_matches
    from bumpstop.study.directions import DirectionSampling
    from bumpstop.study.workspace.workspace import WorkspaceStudy

    for option, value, valid in (
        ("--directions", directions, get_args(DirectionSampling)),
        ("--joint-limits", joint_limits, ("respect", "ignore")),
        ("--velocity-limits", velocity_limits, ("respect", "ignore")),
    ):
        if value not in valid:
            raise InputError(option, f"{value!r} is unknown", near_matches(value, valid))
    study = WorkspaceStudy(
        load(scenario, changes),
        poses=poses,
        grid=grid,
        grid_directions=grid_directions,
        directions=cast(Any, directions),
        speed_sd_mm_s=speed_sd,
        joint_limits=cast(Any, joint_limits),
        velocity_limits=cast(Any, velocity_limits),
        link_radius_mm=link_radius,
        predict=predict,
        seed=seed,
    )

    def report(rows: pl.DataFrame, summary: dict[str, Any]) -> tuple[str, Sequence[Part], Sequence[str]]:
        from bumpstop.report.studies.workspace import pages_of

        return pages_of(study, rows, summary)

    execute(study, out=out, as_json=as_json, threads=threads, report=report)
