"""Forces that a sensor measured at contacts: when they were detected, and at most."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_float_array, finite_or_none
from bumpstop.detection.scoring.labels import Label

# What the sensor shows without contact, of the tool's weight or its offset, is its median over so long before a
# contact, and so long ahead of the label, which is set by hand [s].
_BEFORE_S, _AHEAD_S = 0.5, 0.05


@dataclass(frozen=True, eq=False)
class ContactForces:
    """Of each label, the size of the force minus what the sensor showed before [N]; NaN: not measured.

    Attributes:
        at_detection: (labels,) at the first event; NaN for a missed one, too.
        largest: (labels,) between the label's start and its end.
    """

    at_detection: FloatArray
    largest: FloatArray

    def to_json(self) -> dict[str, Any]:
        """What ``score`` prints: ``at_detection_N`` and ``largest_missed_N``, and both forces of each contact."""
        found = np.sort(self.at_detection[np.isfinite(self.at_detection)])
        missed = self.largest[np.isnan(self.at_detection) & np.isfinite(self.largest)]
        summary: dict[str, float | None] = dict.fromkeys(("mean", "p50", "p95", "max"))
        if found.size:
            p50, p95 = (float(found[math.ceil(p * found.size) - 1]) for p in (0.5, 0.95))
            summary = {"mean": float(found.mean()), "p50": p50, "p95": p95, "max": float(found[-1])}
        return {
            "at_detection_N": summary,
            "largest_missed_N": float(missed.max()) if missed.size else None,
            "contacts": [
                {"at_detection_N": finite_or_none(detected), "largest_N": finite_or_none(most)}
                for detected, most in zip(self.at_detection, self.largest, strict=True)
            ],
        }


def contact_forces(
    labels: Sequence[Label], delay_s: npt.ArrayLike, t: npt.ArrayLike, wrench: npt.ArrayLike
) -> ContactForces:
    """Forces of a sensor at the contacts of a score.

    The force at detection is that of the last row up to the event.

    Args:
        labels: of the score.
        delay_s: (labels,) of the score; NaN: missed [s].
        t: (N,) of the recording [s].
        wrench: (N, 6) of the sensor, forces first [N, Nm].

    Raises:
        InputError: arrays of other shapes.
    """
    times = as_float_array(t, "t", (None,))
    force = as_float_array(wrench, "wrench", (times.size, 6))[:, :3]
    delays = as_float_array(delay_s, "delay_s", (len(labels),), finite=False)
    now, most = np.full(len(labels), math.nan), np.full(len(labels), math.nan)
    for number, (label, delay) in enumerate(zip(labels, delays, strict=True)):
        first, last = np.searchsorted(times, [label.start_s, math.nextafter(label.end_s, math.inf)])
        begin, end = np.searchsorted(times, [label.start_s - _AHEAD_S - _BEFORE_S, label.start_s - _AHEAD_S])
        if first == last:
            continue
        # A contact at the very beginning has nothing before it: the sensor is taken at its word.
        before = np.median(force[begin:end], axis=0) if end > begin else np.zeros(3)
        most[number] = np.linalg.norm(force[first:last] - before, axis=1).max()
        if math.isfinite(delay):
            row = int(np.searchsorted(times, label.start_s + delay + 1e-9, side="right")) - 1
            now[number] = np.linalg.norm(force[row] - before)
    return ContactForces(now, most)
