"""Measuring collisions with a gauge: what to measure, what the gauge said, what it says of the cell."""

from bumpstop.measure.learning.calibration import Calibration
from bumpstop.measure.learning.plan_calibration import calibrate_plan
from bumpstop.measure.learning.shots import MeasuredShot
from bumpstop.measure.planning.gauge import Gauge, gauge_of
from bumpstop.measure.planning.plan import MeasurementPlan, plan_measurements
from bumpstop.measure.planning.plan_file import load_plan, write_plan
from bumpstop.measure.reading.gauge_curve import GaugeFormat
from bumpstop.measure.reading.gauge_reading import GaugeReading, read_gauge

__all__ = [
    "Calibration",
    "Gauge",
    "GaugeFormat",
    "GaugeReading",
    "MeasuredShot",
    "MeasurementPlan",
    "calibrate_plan",
    "gauge_of",
    "load_plan",
    "plan_measurements",
    "read_gauge",
    "write_plan",
]
