"""What events are worth beside labels, as a person reads it on a terminal."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bumpstop.detection.durations import hours_in_words
from bumpstop.detection.scoring.labels import time_text

if TYPE_CHECKING:
    from bumpstop.detection.scoring.scoring import Score


def score_text(found: Score) -> str:
    """What ``bumpstop score`` prints of one set of events, without a line's end."""
    lines: list[str] = []
    data = found.to_json()
    low, high = found.false_alarms_per_hour_interval()
    dark = f" ({data['missed_without_data']} without data)" if data["missed_without_data"] else ""
    lines.append(f"detected {found.detected} of {len(found.labels)}; missed {found.missed}{dark}")
    lines.append(
        f"false alarms: {found.false_alarms.size} in {hours_in_words(found.hours)} without contact, "
        f"95 % interval {low:.3g} to {high:.3g} an hour; no data for {found.no_data_s:.4g} s"
    )
    if found.detected:
        delays = ", ".join(f"{key} {1e3 * value:.4g}" for key, value in data["delay_s"].items())
        lines.append(f"delay, ms: {delays}")
    if found.forces is not None:
        forces = data["forces"]
        told = {key: "-" if value is None else f"{value:.4g}" for key, value in forces["at_detection_N"].items()}
        lines.append(f"force at detection, N: {', '.join(f'{key} {value}' for key, value in told.items())}")
        if forces["largest_missed_N"] is not None:
            lines.append(f"largest force of a missed contact: {forces['largest_missed_N']:.4g} N")
    for start in data["false_alarm_times_s"][:20]:
        lines.append(f"  false alarm at {time_text(start)} s")
    for label, late in zip(found.labels, found.delay_s, strict=True):
        if math.isnan(late):
            lines.append(f"  missed: {time_text(label.start_s)} to {time_text(label.end_s)} s {label.kind}".rstrip())
    if found.repeated:
        lines.append(f"{found.repeated} more events inside labels that were detected before")
    if found.outside:
        lines.append(f"{found.outside} labels lie outside the recording and are left out")
    return "\n".join(lines)
