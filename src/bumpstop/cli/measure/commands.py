"""``bumpstop measure``: from a plan of shots to a calibrated scenario."""

from __future__ import annotations

from bumpstop.cli.command_group import group
from bumpstop.cli.measure.calibrate import calibrate
from bumpstop.cli.measure.plan import plan
from bumpstop.cli.measure.read import read

app = group("Plan measurements with a gauge, read its recordings, learn from them.")
app.command("plan")(plan)
app.command("read")(read)
app.command("calibrate")(calibrate)
