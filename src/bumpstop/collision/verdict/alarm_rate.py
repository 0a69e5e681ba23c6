"""False alarms of a detector in free motion, as a rate: how often an arm stops for nothing."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.detection.durations import hours_in_words

if TYPE_CHECKING:
    from bumpstop.collision.problem import CollisionProblem

_SECONDS_PER_HOUR = 3600.0


@dataclass(frozen=True)
class AlarmRate:
    """False alarms an hour of free motion, the detector armed all the time.

    Attributes:
        per_hour: alarms [1/h].
        kind: ``"gaussian"``: every control cycle by itself, of white Gaussian noise; ``"bound"``: noise that is
            correlated from cycle to cycle alarms in rows of cycles, each counted here; ``"measured"``: counted in the
            residuals.
        recorded_h: length of the measured residuals [h]; infinite where none were measured.
    """

    per_hour: float
    kind: str
    recorded_h: float

    @property
    def words(self) -> str:
        """``0.24 false alarms an hour of free motion``."""
        if self.kind == "measured":
            found = "no false alarm" if self.per_hour == 0 else f"{self.per_hour:.3g} false alarms an hour"
            return f"{found} in {hours_in_words(self.recorded_h)} of measured free motion"
        rate = "fewer than 0.001" if self.per_hour < 1e-3 else f"{self.per_hour:.3g}"
        return f"{'at most ' if self.kind == 'bound' else ''}{rate} false alarms an hour of free motion"


def alarm_rate(problem: CollisionProblem) -> AlarmRate:
    """How often a problem's detector alarms without contact."""
    period = problem.period_steps * problem.scenario.simulation.step_s
    record = problem.residuals
    if record is not None:
        rows = np.asarray(record.rows)
        over: npt.NDArray[np.bool_] = np.any(np.abs(rows) > problem.thresholds, axis=1)
        # An alarm that lasts is one.
        events = int(over[:1].sum() + (over[1:] & ~over[:-1]).sum())
        hours = len(rows) * period / _SECONDS_PER_HOUR
        return AlarmRate(events / hours, "measured", hours)
    alarm, _ = problem.detector.alarm_probability(np.zeros(problem.robot.dof))
    kind = "gaussian" if problem.scenario.detector.noise_correlation == 0 else "bound"
    return AlarmRate(float(alarm) * _SECONDS_PER_HOUR / period, kind, float("inf"))
