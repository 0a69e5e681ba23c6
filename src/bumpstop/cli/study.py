"""``bumpstop study``: many laws with a question."""

from __future__ import annotations

import contextlib
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from bumpstop.cli.evaluate import MOST_THREADS, change, whole

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.collision import Scenario
    from bumpstop.report.section import Part
    from bumpstop.study import Study

app = typer.Typer(
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=False,
    help="Ask many laws a question: what makes collisions harmless, for whom, and where.",
)

ScenarioFile = Annotated[Path, typer.Argument(help="Scenario file (TOML).", show_default=False)]
AsJson = Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")]
Out = Annotated[
    Path | None,
    typer.Option(help="Write report.html, figures, rows, summary and settings there; taken up again."),
]
Changes = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="KEY=VALUE", help="Replace a key, e.g. --set contact.body=lower_arm_wrist."),
]
Threads = Annotated[
    int, typer.Option(parser=whole(1, MOST_THREADS), metavar="NUMBER", help="Threads; they do not change the result.")
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
    lines: Callable[[dict[str, Any]], Sequence[str]],
) -> None:
    """Run a study, write its files and print what it found.

    Args:
        study: what is run.
        out: folder for its files, or None.
        as_json: print the summary as JSON and nothing else on stdout.
        threads: of this process.
        report: title of the page, its parts and its notes, from rows and summary.
        lines: what a person reads on the terminal, from the summary.
    """
    from bumpstop.study import plain, run

    command = " ".join(["bumpstop", *sys.argv[1:]]) if Path(sys.argv[0]).name == "bumpstop" else ""
    begin = time.perf_counter()
    with _progress(study.title) as progress:
        rows, summary = run(study, out, threads=threads, progress=progress, command=command)
    seconds = time.perf_counter() - begin
    page = None
    if out is not None:
        from bumpstop.report.study import write_study_report

        title, parts, notes = report(rows, summary)
        page = write_study_report(study, title, parts, out, notes=notes, command=command)
    if as_json:
        typer.echo(json.dumps(plain(summary) | {"seconds": round(seconds, 3)}, allow_nan=False, indent=2))
        return
    for line in lines(summary):
        typer.echo(line)
    typer.echo(f"{rows.height} rows in {seconds:.1f} s")
    if page is not None:
        typer.echo(f"report: {page}")


@contextlib.contextmanager
def _progress(title: str) -> Iterator[Callable[[int, int], None] | None]:
    """A bar on stderr, where that is a terminal."""
    if not sys.stderr.isatty():
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(title, total=None)
        yield lambda done, total: bar.update(task, completed=done, total=total)
