"""``bumpstop bodies``: what can be hit."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from bumpstop.cli.completion import complete_limits


def bodies(
    limits: Annotated[
        str | None,
        typer.Option(
            help="Only this table: a built-in name or a path.",
            show_default="all built-in",
            autocompletion=complete_limits,
        ),
    ] = None,
    form: Annotated[
        Path | None,
        typer.Option(
            "--form", metavar="FILE", help="Write the empty form of ISO 10218-2:2025, annex M there, and nothing else."
        ),
    ] = None,
) -> None:
    """List body regions with their limits, stiffness and where the figures come from."""
    if form is not None:
        _write_form(form)
        return
    from rich.table import Table

    from bumpstop.contact import LimitTable, builtin_tables
    from bumpstop.terminal import terminal

    console = terminal()
    for name in [limits] if limits is not None else builtin_tables():
        table = LimitTable.load(name, field="--limits")
        rows = Table(box=None, pad_edge=False, title=f"{table.name}: {table.title}", title_justify="left")
        for heading in ("body", "clamped N", "N/cm²", "free N", "N/cm²", "N/mm", "kg", "status"):
            rows.add_column(heading, justify="left" if heading in ("body", "status") else "right")
        for region in table.regions:
            clamped = table.contact_limits(region.name, "clamped")
            free = table.contact_limits(region.name, "free")
            rows.add_row(
                region.name,
                f"{clamped.force_N:g}",
                _figure(clamped.pressure_N_cm2),
                f"{free.force_N:g}" if free.permitted else "none",
                _figure(free.pressure_N_cm2) if free.permitted else "none",
                f"{region.spring_N_mm:g}",
                _figure(region.effective_mass_kg),
                region.status,
            )
        console.print(rows)
        console.print(f"Source: {table.source}. Status: {table.status}.")
        if table.note:
            console.print(table.note)
        console.print("'none': contact of this kind is not permitted there.\n")


def _write_form(path: Path) -> None:
    from bumpstop.cli.folders import check_file
    from bumpstop.contact import form_text, limit_forms
    from bumpstop.errors import InputError
    from bumpstop.text_files import write_text

    check_file(path, "--form")
    if path.exists():
        raise InputError("--form", f"{str(path)!r} exists", "give another file: a filled form is not overwritten")
    write_text(path, form_text(limit_forms()[0]))
    typer.echo(f"form: {path}")


def _figure(value: float | None) -> str:
    return "-" if value is None else f"{value:g}"
