"""Recordings of real arms: read, checked, written."""

from bumpstop.recording.columns import Columns, Coupling, Quantity
from bumpstop.recording.limits import limits_touched
from bumpstop.recording.read_report import ReadReport
from bumpstop.recording.recording import Recording

__all__ = ["Columns", "Coupling", "Quantity", "ReadReport", "Recording", "limits_touched"]
