"""``bumpstop measure``: from a plan of shots to a calibrated scenario."""

from __future__ import annotations

import typer

from bumpstop.cli.command_group import CommandGroup
from bumpstop.cli.measure.calibrate import calibrate
from bumpstop.cli.measure.plan import plan
from bumpstop.cli.measure.read import read

app = typer.Typer(
    cls=CommandGroup,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
    no_args_is_help=False,
    help="Plan measurements with a gauge, read its recordings, learn from them.",
)
app.command("plan")(plan)
app.command("read")(read)
app.command("calibrate")(calibrate)
