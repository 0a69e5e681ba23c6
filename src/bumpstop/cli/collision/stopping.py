"""``bumpstop stopping``: the law of slowing down that a table of stopping distances obeys."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from bumpstop.cli.folders import check_file, check_folder
from bumpstop.cli.option_names import as_options
from bumpstop.errors import InputError
from bumpstop.text_files import list_items, write_text

if TYPE_CHECKING:
    from bumpstop.collision.stopping import StoppingFit


def command(
    table: Annotated[Path, typer.Argument(help="Stopping distances, CSV or TOML.", show_default=False)],
    full_speed_deg_s: Annotated[
        str | None,
        typer.Option(
            "--full-speed-deg-s",
            metavar="LIST",
            help="Full speed of the joints, one or one each, for speeds in percent.",
        ),
    ] = None,
    reach_mm: Annotated[
        float | None, typer.Option("--reach-mm", help="Turn distances of the TCP in mm into angles, at the extension.")
    ] = None,
    category: Annotated[int | None, typer.Option(help="Read the rows of this stop category only.")] = None,
    deceleration: Annotated[
        str | None,
        typer.Option(help="Take this law: constant_time, constant or ramp.", show_default="the one the table obeys"),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            "--out", "-o", help="FILE.toml: write [reaction] there; a folder: report.html, figures and reaction.toml."
        ),
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print one JSON object and nothing else.")] = False,
) -> None:
    """Tell how an arm slows down from a table of stopping distances, and write the [reaction] of a scenario."""
    from bumpstop.collision.stopping import fit_stopping, load_stopping_table

    file = out if out is not None and out.suffix == ".toml" else None
    folder = out if file is None else None
    check_file(file)
    check_folder(folder)
    speeds = None if full_speed_deg_s is None else [_number(item) for item in list_items(full_speed_deg_s)]
    with as_options({"deceleration": "--deceleration", "category": "--category"}):
        stops = load_stopping_table(table, full_speed_deg_s=speeds, reach_mm=reach_mm, category=category)
        fit = fit_stopping(stops, deceleration)
    page = None
    if file is not None:
        write_text(file, fit.reaction_toml)
    if folder is not None:
        from bumpstop.report.collision.stopping import write_stopping

        page = write_stopping(fit, folder)
        try:
            write_text(file := folder / "reaction.toml", fit.reaction_toml)
        except InputError:  # distances of the TCP say no acceleration of a joint
            file = None
    if as_json:
        typer.echo(json.dumps(fit.to_json(), allow_nan=False, indent=2))
        return
    _print(fit)
    for what, path in (("reaction", file), ("report", page)):
        if path is not None:
            typer.echo(f"{what}: {path}")


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise InputError("--full-speed-deg-s", f"{text!r} cannot be used", "wanted numbers above zero")
    return value


def _print(fit: StoppingFit) -> None:
    from rich.console import Console
    from rich.table import Table

    from bumpstop.report.collision.stopping import numbers_by_joint

    console = Console(highlight=False, markup=False)
    one = fit.fits[fit.law]
    console.print(f"{fit.law}: {one.law.formula}", soft_wrap=True)
    laws = Table(box=None, pad_edge=False)
    for heading in ("law", "median error", "worst"):
        laws.add_column(heading, justify="left" if heading == "law" else "right")
    for name, each in fit.fits.items():
        laws.add_row(name, *(f"{100 * error:.2g} %" for error in (each.median_error, each.worst_error)))
    console.print(laws)
    headings, rows = numbers_by_joint(fit)
    numbers = Table(box=None, pad_edge=False)
    for heading in headings:
        numbers.add_column(heading, justify="right" if heading else "left")
    for row in rows:
        numbers.add_row(*row)
    console.print(numbers)
    for note in fit.notes:
        console.print(f"note: {note}", soft_wrap=True)
    try:
        console.print(fit.reaction_toml, end="", soft_wrap=True)
    except InputError as error:
        console.print(f"no [reaction]: {error}", soft_wrap=True)
