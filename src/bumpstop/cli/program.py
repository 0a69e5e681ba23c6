"""``bumpstop program``: a robot program in, the same program with safe speeds out."""

from __future__ import annotations

import json
import math
from glob import escape
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.cli.collision.evaluate import INCONCLUSIVE, NOT_ACCEPTABLE, change
from bumpstop.cli.collision.study import Threads

if TYPE_CHECKING:
    from bumpstop.program.evaluation import ProgramResult, SegmentResult

_STATUS = {"PASS": 0, "FAIL": NOT_ACCEPTABLE, "INCONCLUSIVE": INCONCLUSIVE}
_STYLES = {"PASS": "bold black on bright_cyan", "FAIL": "bold white on red", "INCONCLUSIVE": "bold black on yellow"}


def command(
    program: Annotated[
        Path,
        typer.Argument(
            metavar="FILE",
            help="Program (URScript, KRL, RAPID), trajectory (ROS messages in YAML, JSON or a bag) or recording.",
            show_default=False,
        ),
    ],
    scenario: Annotated[
        list[Path],
        typer.Option(
            metavar="SCENARIO",
            help="The cell: robot, body, detector, reaction, limits (TOML). Several: other bodies, other links.",
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="Write the program with safe speeds, its segments, a summary and a report there."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
    max_speed: Annotated[float, typer.Option(metavar="MM_S", help="No speed of the tip is raised above it.")] = 1000.0,
    only_slower: Annotated[
        bool, typer.Option("--only-slower", help="Lower speeds that are too high, and raise none.")
    ] = False,
    columns: Annotated[Path | None, typer.Option(help="Of a recording: its column file (TOML).")] = None,
    topic: Annotated[str | None, typer.Option(help="Of a recording: topic of a bag that has several.")] = None,
    threads: Threads = 2,
    changes: Annotated[
        list[str] | None,
        typer.Option("--set", metavar="KEY=VALUE", help="Replace a key, e.g. --set contact.body=lower_arm_wrist."),
    ] = None,
) -> int:
    """Judge every segment of a robot program, and write the program with the highest safe speeds.

    Exit status, of the program as given: 0 acceptable, 3 not acceptable, 4 inconclusive, 2 bad input.
    """
    from bumpstop.cli.folders import check_folder, check_inputs, check_no_job, scenario_files
    from bumpstop.cli.identification.arm_recordings import recording_files
    from bumpstop.cli.progress import progress
    from bumpstop.collision import load_scenario
    from bumpstop.program.evaluation import evaluate_program

    check_folder(out)
    check_no_job(out)
    if out is not None:
        from bumpstop.program.writing import check_target

        check_target(program, out)
    checked = [load_scenario(file, dict(change(text) for text in changes or [])) for file in scenario]
    # Of a bag a folder is written, of a recording a CSV file.
    names = (escape(program.name), f"{escape(program.stem)}.csv", f"{escape(program.stem)}/**/*")
    read = [*recording_files([program], columns), *scenario, *scenario_files(checked)]
    check_inputs(out, read, *names, "summary.json", "segments/*", "report.html")
    with progress("judging segments") as share:
        result = evaluate_program(
            program,
            *checked,
            max_speed_mm_s=max_speed,
            faster=not only_slower,
            columns=columns,
            topic=topic,
            threads=threads,
            progress=share,
        )
    files = []
    if out is not None:
        from bumpstop.program.writing import write_program
        from bumpstop.report.program.page import write_program_report

        files = [*write_program(result, program, out), write_program_report(result, program.name, out)]
    if as_json:
        typer.echo(json.dumps(result.to_json(), allow_nan=False, indent=2))
    else:
        _print(result)
        if files:
            typer.echo(f"program: {files[0]}")
            typer.echo(f"report: {files[-1]}")
    return _STATUS[result.present]


def _print(result: ProgramResult) -> None:
    from rich.table import Table
    from rich.text import Text

    from bumpstop.program.evaluation import outcome_word
    from bumpstop.terminal import terminal

    console = terminal()
    table = Table(box=None, pad_edge=False)
    bodies = result.cell.bodies
    several = ["body"] if len(bodies) > 1 else []
    for heading in ("", "line", "segment", "worst at", *several, "force, N", "mm/s", "safe mm/s", "written", "won, s"):
        right = heading in ("force, N", "mm/s", "safe mm/s", "won, s")
        table.add_column(heading, justify="right" if right else "left", no_wrap=heading != "worst at", overflow="fold")
    for one in result.segments:
        word = outcome_word(one.present)
        table.add_row(
            Text(f" {word} ", style=_STYLES[word]),
            _lines(one),
            one.segment.name,
            _place(one),
            *([_body(one)] if several else []),
            _number(one.present.force),
            _number(1e3 * one.present.tool_speed),
            _safe(one),
            outcome_word(one.written),
            _number(one.won_s, "+.2f"),
        )
    console.print(table)
    for one in result.segments:
        for question in one.open_questions:
            first, last = one.segment.lines
            console.print(f"{'line' if first == last else 'lines'} {_lines(one)}, {one.segment.name}: {question}")
    for line, text in result.source.not_understood:
        console.print(f"line {line} is not understood and left as it is: {text[:80]}")
    for note in result.notes:
        console.print(f"note: {note}")
    won = result.won_words
    against = " and ".join(f"{body.scenario.contact.body}, {body.allowed_force:.4g} N allowed" for body in bodies)
    console.print(
        f"{result.source.language} against {against}: {result.present} as given, {result.written_outcome} as written"
        + (f", {won}" if won else "")
    )
    console.print(
        "Each segment with contact at its worst place. This is an engineering estimate, not a certified safety "
        "function; measurement decides.",
        style="dim",
    )


def _lines(one: SegmentResult) -> str:
    first, last = one.segment.lines
    return str(first) if first == last else f"{first}-{last}"


def _place(one: SegmentResult) -> str:
    return ", ".join(f"{1e3 * x:.0f}" for x in one.present.worst_m) or "-"


def _body(one: SegmentResult) -> str:
    cell = one.present.cell
    return "-" if cell is None else str(cell.scenario.contact.body)


def _number(value: float, form: str = ".4g") -> str:
    return "-" if not math.isfinite(value) else format(value, form)


def _safe(one: SegmentResult) -> str:
    return "none" if one.safe_speed_mm_s == 0 else _number(one.safe_speed_mm_s)
