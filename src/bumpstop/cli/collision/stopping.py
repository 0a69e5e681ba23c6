"""``bumpstop stopping``: the law of slowing down that a table of stopping distances obeys."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer

from bumpstop.cli.folders import check_file, check_folder, check_inputs, check_own
from bumpstop.cli.option_names import as_options
from bumpstop.errors import InputError
from bumpstop.terminal import terminal
from bumpstop.text_files import list_items, write_text

_BEGIN = "# Stops of "  # of every file that is written


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
    if out is not None:
        check_own(out if folder is None else folder / "reaction.toml", _is_own)
    check_inputs(file, [table])
    check_inputs(folder, [table], "reaction.toml", "report.html")
    speeds = None if full_speed_deg_s is None else [_number(item) for item in list_items(full_speed_deg_s)]
    with as_options({"deceleration": "--deceleration", "category": "--category"}), _or_as_options(table):
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
    fit.show(terminal())
    for what, path in (("reaction", file), ("report", page)):
        if path is not None:
            typer.echo(f"{what}: {path}")


@contextmanager
def _or_as_options(table: Path) -> Iterator[None]:
    """Say of what a table does not state that an option can, too."""
    try:
        yield
    except InputError as error:
        options = {f"{table}, full_speed_deg_s": "--full-speed-deg-s", f"{table}, reach_mm": "--reach-mm"}
        if error.problem != "is missing" or error.field not in options:
            raise
        raise InputError(error.field, error.problem, f"{error.valid}, or {options[error.field]}") from None


def _is_own(text: str, data: dict[str, Any]) -> bool:
    return text.startswith(_BEGIN) and set(data) == {"reaction"}


def _number(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0 < value < math.inf:
        raise InputError("--full-speed-deg-s", f"{text!r} cannot be used", "wanted numbers above zero")
    return value
