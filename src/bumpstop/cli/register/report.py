"""``bumpstop report``: the dossier of a cell."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bumpstop.cli.collision.evaluate import MAX_THREADS, Sampled, SampleSeed, change, whole
from bumpstop.cli.completion import complete_setting
from bumpstop.cli.register.evaluate import EXIT_STATUS, evaluate_paths, print_table
from bumpstop.errors import InputError

_MAX_LETTERS = 120


def command(
    register: Annotated[
        list[Path],
        typer.Argument(
            metavar="REGISTER...", help="Registers (TOML, CSV), or scenario files (TOML).", show_default=False
        ),
    ],
    cell: Annotated[str, typer.Option(metavar="TEXT", help="The cell that is judged.", show_default=False)],
    author: Annotated[str, typer.Option(metavar="TEXT", help="Who answers for the dossier.", show_default=False)],
    revision: Annotated[str, typer.Option(metavar="TEXT", help="Of the dossier.", show_default=False)],
    out: Annotated[Path, typer.Option("--out", "-o", help="Write report.html there.", show_default=False)],
    shots: Annotated[
        list[Path] | None,
        typer.Option("--shots", metavar="CSV", help="Shots of a force gauge, planned and measured; may be repeated."),
    ] = None,
    sampled: Sampled = None,
    seed: SampleSeed = 0,
    threads: Annotated[
        int,
        typer.Option(
            parser=whole(1, MAX_THREADS), metavar="NUMBER", help="Situations at once; they do not change the result."
        ),
    ] = 2,
    changes: Annotated[
        list[str] | None,
        typer.Option(
            "--set", metavar="KEY=VALUE", autocompletion=complete_setting, help="Replace a key of every situation."
        ),
    ] = None,
) -> int:
    """Write the dossier of a cell: every contact situation with verdict, inputs, assumptions and measurements.

    Exit status: 0 all pass, 3 one fails, 4 one is inconclusive, 2 bad input.
    """
    from bumpstop.register.measured import judge_by_shots
    from bumpstop.register.shots import load_shots
    from bumpstop.report.register.dossier import DossierHead, write_dossier

    for option, text in (("--cell", cell), ("--author", author), ("--revision", revision)):
        if not (0 < len(text.strip()) <= _MAX_LETTERS and text.isprintable()):
            raise InputError(option, f"{text[:40]!r} cannot be used", f"wanted 1 to {_MAX_LETTERS} letters on one line")
    changed = dict(change(text) for text in changes or [])
    files = shots or []
    result = evaluate_paths(register, changed, samples=sampled, seed=seed, threads=threads, out=out, more=files)
    found = [shot for path in files for shot in load_shots(path, result.register.situations)]
    head = DossierHead(cell=cell.strip(), author=author.strip(), revision=revision.strip())
    result = judge_by_shots(result, found)
    page = write_dossier(result, out, head, found, files)
    print_table(result)
    typer.echo(f"report: {page}")
    return EXIT_STATUS[result.outcome]
