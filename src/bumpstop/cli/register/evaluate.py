"""``bumpstop evaluate`` of registers and of several scenarios: one table, one page, one JSON object."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

if TYPE_CHECKING:
    from bumpstop.register import RegisterResult

EXIT_STATUS = {"pass": 0, "fail": 3, "inconclusive": 4}


def evaluate_many(
    paths: Sequence[Path],
    changes: Mapping[str, Any],
    *,
    samples: int | None,
    seed: int,
    threads: int,
    as_json: bool,
    out: Path | None,
) -> int:
    """Evaluate, write and print; returns the exit status of the worst situation."""
    result = evaluate_paths(paths, changes, samples=samples, seed=seed, threads=threads, out=out)
    page = None
    if out is not None:
        from bumpstop.report.register.page import write_register

        page = write_register(result, out)
    if as_json:
        typer.echo(json.dumps(result.to_json(), allow_nan=False, indent=2))
    else:
        print_table(result)
        if page is not None:
            typer.echo(f"report: {page}")
    return EXIT_STATUS[result.outcome]


def evaluate_paths(
    paths: Sequence[Path],
    changes: Mapping[str, Any],
    *,
    samples: int | None,
    seed: int,
    threads: int,
    out: Path | None,
    more: Sequence[Path] = (),
) -> RegisterResult:
    """Read and evaluate; the folder for the page, which is made of ``more`` files, is checked before that."""
    from bumpstop.cli.folders import check_folder, check_inputs, check_no_job
    from bumpstop.cli.progress import progress
    from bumpstop.register import evaluate_register, load_register

    check_folder(out)
    check_no_job(out)
    register = load_register(*paths, changes=changes)
    check_inputs(out, [*register.checksums, *more], "report.html")
    with progress("evaluating") as share:
        return evaluate_register(register, samples=samples, seed=seed, threads=threads, progress=share)


def print_table(result: RegisterResult) -> None:
    """Situations, worst first, with the reason of each; below them every warning once, however many it is of."""
    from rich.table import Table
    from rich.text import Text

    from bumpstop.collision.probability_text import decimal
    from bumpstop.register.outcome import OUTCOME_WORDS
    from bumpstop.terminal import counted, terminal

    console = terminal()
    numbers = {text: n for n, text in enumerate(dict.fromkeys(w for one in result.results for w in one.warnings), 1)}
    styles = {"pass": "bold black on bright_cyan", "fail": "bold white on red", "inconclusive": "bold black on yellow"}
    table = Table(box=None, pad_edge=False)
    for heading in ("", "situation", "use", "P(over)", "reason"):
        number = heading in ("use", "P(over)")
        table.add_column(heading, justify="right" if number else "left", overflow="fold")
    for one in result.results:
        p = one.p_over
        marks = [f"Warning {', '.join(str(numbers[text]) for text in one.warnings)}."] if one.warnings else []
        table.add_row(
            Text(f" {OUTCOME_WORDS[one.outcome]} ", style=styles[one.outcome]),
            one.situation.name,
            one.use_text,
            "-" if math.isnan(p) else decimal(p, integrated=one.method == "exact"),
            " ".join([one.reason, *marks]),
        )
    console.print(table)
    for text, n in numbers.items():
        of = counted(sum(text in one.warnings for one in result.results), "situation")
        console.print(f"warning {n}, of {of}: {text}")
    counts = ", ".join(f"{count} {OUTCOME_WORDS[outcome]}" for outcome, count in result.counts.items() if count)
    console.print(f"{counts}; use: of the limit, by the quantile of the accepted probability")
    console.print(
        "P(over): of exceeding a limit in one contact. This is an engineering estimate, not a certified safety "
        "function; measurement decides.",
        style="dim",
    )
