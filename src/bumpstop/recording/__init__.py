"""Recordings of real arms: read, checked, written."""

from bumpstop.recording.columns import Columns, Coupling, Quantity
from bumpstop.recording.limits import limits_touched
from bumpstop.recording.quantities import by_quantity
from bumpstop.recording.read_report import ReadReport
from bumpstop.recording.recording import Recording

__all__ = ["Columns", "Coupling", "Quantity", "ReadReport", "Recording", "by_quantity", "limits_touched"]
