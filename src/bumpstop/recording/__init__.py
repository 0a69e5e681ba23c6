"""Recordings of real arms: read, checked, written."""

from bumpstop.recording.checks.limits import limits_touched
from bumpstop.recording.columns import Columns, Coupling, Quantity
from bumpstop.recording.read_report import ReadReport
from bumpstop.recording.recording import Recording
from bumpstop.recording.summary import by_quantity

__all__ = ["Columns", "Coupling", "Quantity", "ReadReport", "Recording", "by_quantity", "limits_touched"]
