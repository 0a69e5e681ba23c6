"""``bumpstop new``: a scenario to start from."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bumpstop.cli.completion import complete_robot
from bumpstop.cli.folders import check_file
from bumpstop.errors import InputError


def command(
    robot: Annotated[
        str,
        typer.Argument(
            help="A built-in robot; bumpstop robots lists them.", metavar="[ROBOT]", autocompletion=complete_robot
        ),
    ] = "ur10e",
    out: Annotated[
        Path | None, typer.Option("--out", "-o", metavar="FILE", help="Write it there instead of printing it.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Overwrite a file that exists.")] = False,
) -> None:
    """Write a commented scenario that runs at once, its figures marked that stand for those of your cell."""
    from bumpstop.register.starting_scenario import starting_scenario
    from bumpstop.text_files import write_text

    text = starting_scenario(robot)
    if out is None:
        typer.echo(text, nl=False)
        return
    if out.exists() and not out.is_dir() and not force:
        raise InputError("--out", f"{str(out)!r} exists", "give another file, or --force to overwrite it")
    check_file(out)
    write_text(out, text)
    typer.echo(f"scenario: {out}")
