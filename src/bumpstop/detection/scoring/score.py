"""What events are worth beside labels: the score, as values, as JSON and as text."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, finite_or_none
from bumpstop.detection.durations import hours_in_words
from bumpstop.detection.scoring.contact_forces import ContactForces
from bumpstop.detection.scoring.labels import Label, time_text

Interval = tuple[float, float]


@dataclass(frozen=True, eq=False)
class Score:
    """Events against labels.

    Attributes:
        labels: contacts inside the time monitored, in order.
        delay_s: (labels,) from a label's start to its first event [s], negative for an event before it; NaN: missed.
        no_data: (labels,) whether the detector had no data during the whole of the label; such a label is missed.
        false_alarms: times of events that belong to no label [s].
        repeated: events after the first of a label; they count as nothing.
        hours: monitored without contact: the time in which an event would be false [h].
        no_data_s: time in which the detector had no data [s].
        outside: labels that lie outside the time monitored and are left out.
        forces: of a sensor at the labels; None: there was none.
    """

    labels: tuple[Label, ...]
    delay_s: FloatArray
    no_data: npt.NDArray[np.bool_]
    false_alarms: FloatArray
    repeated: int
    hours: float
    no_data_s: float
    outside: int
    forces: ContactForces | None = None

    def __str__(self) -> str:
        """What ``bumpstop score`` prints of one set of events, without a line's end."""
        lines: list[str] = []
        data = self.to_json()
        low, high = self.false_alarms_per_hour_interval()
        dark = f" ({data['missed_without_data']} without data)" if data["missed_without_data"] else ""
        lines.append(f"detected {self.detected} of {len(self.labels)}; missed {self.missed}{dark}")
        lines.append(
            f"false alarms: {self.false_alarms.size} in {hours_in_words(self.hours)} without contact, "
            f"95 % interval {low:.3g} to {high:.3g} an hour; no data for {self.no_data_s:.4g} s"
        )
        if self.detected:
            delays = ", ".join(f"{key} {1e3 * value:.4g}" for key, value in data["delay_s"].items())
            lines.append(f"delay, ms: {delays}")
        if self.forces is not None:
            forces = data["forces"]
            told = {key: "-" if value is None else f"{value:.4g}" for key, value in forces["at_detection_N"].items()}
            lines.append(f"force at detection, N: {', '.join(f'{key} {value}' for key, value in told.items())}")
            if forces["largest_missed_N"] is not None:
                lines.append(f"largest force of a missed contact: {forces['largest_missed_N']:.4g} N")
        for start in data["false_alarm_times_s"][:20]:
            lines.append(f"  false alarm at {time_text(start)} s")
        for label, late in zip(self.labels, self.delay_s, strict=True):
            if math.isnan(late):
                lines.append(
                    f"  missed: {time_text(label.start_s)} to {time_text(label.end_s)} s {label.kind}".rstrip()
                )
        if self.repeated:
            events = "event" if self.repeated == 1 else "events"
            lines.append(f"{self.repeated} more {events} inside labels that were detected before")
        if self.outside:
            labels = "1 label lies" if self.outside == 1 else f"{self.outside} labels lie"
            lines.append(f"{labels} outside the recording, left out")
        return "\n".join(lines)

    @property
    def detected(self) -> int:
        """Labels with an event."""
        return int(np.isfinite(self.delay_s).sum())

    @property
    def missed(self) -> int:
        """Labels without one."""
        return len(self.labels) - self.detected

    @property
    def false_alarms_per_hour(self) -> float:
        """Infinite without any time in which there could be one; NaN where there was none either."""
        if self.hours > 0:
            return self.false_alarms.size / self.hours
        return math.inf if self.false_alarms.size else math.nan

    def false_alarms_per_hour_interval(self, confidence: float = 0.95) -> Interval:
        """Exact Poisson interval of the rate."""
        from scipy.stats import chi2

        n, tail = self.false_alarms.size, (1 - confidence) / 2
        if not self.hours > 0:
            return 0.0, math.inf
        low = float(chi2.ppf(tail, 2 * n)) / 2 if n else 0.0
        return low / self.hours, float(chi2.ppf(1 - tail, 2 * n + 2)) / 2 / self.hours

    def to_json(self) -> dict[str, Any]:
        """What ``bumpstop score --json`` prints: no NaN, no infinity."""
        delays = np.sort(self.delay_s[np.isfinite(self.delay_s)])
        delay: dict[str, float | None] = dict.fromkeys(("mean", "p50", "p95", "max"))
        if delays.size:
            # The quantile that is one of the delays: the smallest that so many do not exceed.
            p50, p95 = (float(delays[math.ceil(p * delays.size) - 1]) for p in (0.5, 0.95))
            delay = {"mean": float(delays.mean()), "p50": p50, "p95": p95, "max": float(delays[-1])}
        kinds: dict[str, dict[str, int]] = {}
        for label, late in zip(self.labels, self.delay_s, strict=True):
            count = kinds.setdefault(label.kind or "unnamed", {"detected": 0, "missed": 0})
            count["detected" if math.isfinite(late) else "missed"] += 1
        return {
            "detected": self.detected,
            "missed": self.missed,
            "missed_without_data": int(self.no_data.sum()),
            "false_alarms": int(self.false_alarms.size),
            "false_alarm_times_s": self.false_alarms.tolist(),
            "repeated": self.repeated,
            "hours": self.hours,
            "false_alarms_per_hour": finite_or_none(self.false_alarms_per_hour),
            "false_alarms_per_hour_interval": [finite_or_none(x) for x in self.false_alarms_per_hour_interval()],
            "no_data_s": self.no_data_s,
            "labels_outside": self.outside,
            "delay_s": delay,
            "kinds": kinds,
        } | ({} if self.forces is None else {"forces": self.forces.to_json()})
