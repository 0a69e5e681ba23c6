"""The verdict on a fit on the terminal, first of all, and what reading its recordings found."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import typer

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.identification import FitVerdict
    from bumpstop.recording import Recording

NOT_USABLE = 3


def print_verdict(verdict: FitVerdict) -> None:
    """One line, and a line for every reason."""
    typer.echo(str(verdict))


def exit_status(verdict: FitVerdict) -> int:
    """0, or 3 where the fit is not usable."""
    return 0 if verdict.usable else NOT_USABLE


@contextmanager
def with_faults(logs: Sequence[Recording]) -> Iterator[None]:
    """Where a fit is refused, say what its recordings contradict themselves in, or what their times look like.

    That may be why.
    """
    from bumpstop.identification.fit_verdict import reading_faults

    try:
        yield
    except InputError as error:
        faults = [*reading_faults(logs), *(note.rstrip(".") for log in logs for note in log.report.time_doubts)]
        if not faults:
            raise
        raise InputError(error.field, f"{error.problem} ({'; '.join(faults)})", error.valid) from None


def print_reading(logs: Sequence[Recording]) -> None:
    """Print :func:`reading_lines`."""
    for line in reading_lines(logs):
        typer.echo(line)


def reading_lines(logs: Sequence[Recording]) -> list[str]:
    """The part of recordings that was used, rows that were dropped from them, and the notes on them."""
    lines = []
    for log in logs:
        where = f"{log.source}: " if log.source else ""
        if log.cut_from is not None:
            own = f", {log.t[0]:.6g} to {log.t[-1]:.6g} s of its own time" if log.cut_from != 0 else ""
            begin, end = log.t[0] - log.cut_from, log.t[-1] - log.cut_from
            lines.append(f"part: {where}{begin:.6g} to {end:.6g} s from its beginning{own}")
        if log.report.rows_dropped:
            counts = ", ".join(f"{reason} {count}" for reason, count in log.report.counts.items())
            lines.append(f"bad rows: {where}{log.report.rows_dropped} of {log.report.rows_read} dropped ({counts})")
        lines += [f"note: {where}{note}" for note in log.report.notes]
    return lines
