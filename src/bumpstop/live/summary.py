"""What a monitor has seen, when it ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from bumpstop.arrays import finite_or_none

NEVER_JUDGED, COLLISION, CLEAR = 4, 3, 0


@dataclass(frozen=True, kw_only=True)
class MonitorSummary:
    """Counts and latencies of a monitor's run.

    Attributes:
        duration_s: of the run [s].
        samples: that came.
        judged: samples in which the detector monitored: neither without data nor while it armed itself.
        arming: samples with a residual that was not judged, as a motion had just begun.
        masked_while_arming: of those, over a threshold.
        no_data: samples that the detector was given and could not judge, by fault.
        dropped: samples that it was not given: foreign ones and floods.
        found: samples or messages by what was wrong with them, and how often the source stopped and restarted.
        alarms: collisions.
        silent_s: time without samples, beyond the first of each silence [s].
        latency_ms: p50, p99 and largest, from the receipt of a sample to the detector's word on it, with
            the time that it waited to be read, where that was long [ms].
        alarm_latency_ms: the same from the receipt of a sample to the end of telling its alarm to all outputs [ms].
        largest_share: largest residual by joint, in units of its threshold; 0 where not monitored.
        active_at_end: the arm was watched when the monitor ended: the state was ``monitoring`` or ``alarm``.
        problems: what outputs could not do.
    """

    duration_s: float
    samples: int
    judged: int
    arming: int
    masked_while_arming: int
    no_data: dict[str, int]
    dropped: int
    found: dict[str, int]
    alarms: int
    silent_s: float
    latency_ms: dict[str, float]
    alarm_latency_ms: dict[str, float]
    largest_share: tuple[float, ...]
    active_at_end: bool
    problems: tuple[str, ...]

    @property
    def status(self) -> int:
        """Exit status: 0 no collision, 3 a collision, 4 nothing was ever judged."""
        if self.alarms:
            return COLLISION
        return CLEAR if self.judged else NEVER_JUDGED

    def to_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "duration_s": self.duration_s,
            "samples": self.samples,
            "judged": self.judged,
            "arming": self.arming,
            "masked_while_arming": self.masked_while_arming,
            "no_data": self.no_data,
            "dropped": self.dropped,
            "found": self.found,
            "alarms": self.alarms,
            "silent_s": self.silent_s,
            "latency_ms": {key: finite_or_none(value) for key, value in self.latency_ms.items()},
            "alarm_latency_ms": {key: finite_or_none(value) for key, value in self.alarm_latency_ms.items()},
            "largest_share": list(self.largest_share),
            "active_at_end": self.active_at_end,
            "problems": list(self.problems),
        }

    def lines(self) -> list[str]:
        """For people."""
        rate = self.samples / self.duration_s if self.duration_s > 0 else 0.0
        told = [
            f"{self.samples} samples in {self.duration_s:.1f} s, {rate:.0f} a second: {self.judged} judged, "
            f"{sum(self.no_data.values())} without data, {self.dropped} not usable",
            f"collisions: {self.alarms}",
        ]
        if self.arming:
            told.append(f"arming: {self.arming} samples; over a threshold meanwhile: {self.masked_while_arming}")
        if self.no_data:
            told.append("without data: " + ", ".join(f"{name} {count}" for name, count in self.no_data.items()))
        if self.found:
            told.append("source: " + ", ".join(f"{name} {count}" for name, count in self.found.items()))
        if self.silent_s > 0:
            told.append(f"without samples for {self.silent_s:.3g} s")
        for what, found in (("sample to verdict", self.latency_ms), ("sample to alarm", self.alarm_latency_ms)):
            if math.isfinite(found["p50"]):
                told.append(
                    f"{what}: {found['p50']:.3g} ms in the median, {found['p99']:.3g} ms at p99, "
                    f"{found['largest']:.3g} ms at most"
                )
        told += [f"warning: {problem}" for problem in self.problems]
        if not self.judged:
            why = "no sample could be judged"
            if self.arming:
                why = "in every sample with data the detector was arming"
            told.append(f"NOT MONITORED: {why}")
        return told
