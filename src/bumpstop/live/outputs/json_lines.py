"""Everything that is not a sample as JSON lines: what the monitor watches, states, alarms, the source and the end."""

from __future__ import annotations

import json
import time
from typing import IO, TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import finite_or_none
from bumpstop.errors import InputError
from bumpstop.live.output import CollisionAlarm, DataLoss, MonitorTick
from bumpstop.live.outputs.background import BackgroundOutput, Status, WallClock
from bumpstop.text_files import as_path

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from bumpstop.live.loaded_detector import LoadedDetector
    from bumpstop.live.outputs.background import Told
    from bumpstop.live.source import SourceEvent


class JsonLines(BackgroundOutput):
    """Appends a line for the start, every change of the state, alarm and event of the source, a status every second.

    Times: ``time_s`` is that of the clock on the wall, seconds since 1970; ``stamp_s`` that of the source.

    Args:
        path: of the file; lines are appended to what is there.
        detector: of the monitor.

    Raises:
        InputError: the file cannot be written.
    """

    def __init__(self, path: str | os.PathLike[str], detector: LoadedDetector) -> None:
        self._path = as_path(path, "--jsonl")
        self.what = f"--jsonl {self._path}"
        super().__init__()
        self._joints = detector.joints
        self._wall = WallClock()
        self._state = ("", "")
        self._file: IO[bytes] | None = None
        self._torn = False
        try:
            self._open()
        except OSError as error:
            raise InputError("--jsonl", f"{str(self._path)!r} cannot be written ({error.strerror})") from None
        begins = {
            "kind": "start",
            "time_s": time.time(),
            "robot": detector.robot,
            "joints": list(detector.joints),
            "period_s": detector.period_s,
            "thresholds_Nm": _finite(detector.thresholds),
        }
        self._ready = [begins]
        self.start()

    def _open(self) -> None:
        """Append; behind a line that a killed process left unfinished a new one begins."""
        self._file = self._path.open("ab", buffering=0)
        if self._path.stat().st_size:
            with self._path.open("rb") as before:
                before.seek(-1, 2)
                self._torn = before.read(1) != b"\n"

    def write(self, batch: Sequence[Told]) -> None:
        """Lines of what was told."""
        lines, self._ready = self._ready, []
        for told in batch:
            if isinstance(told, CollisionAlarm):
                lines.append(self._of_alarm(told))
            elif isinstance(told, Status):
                lines.append(self._status(told))
            elif isinstance(told, tuple):
                lines.append(self._of_event(*told))
            elif (told.state, told.fault) != self._state:
                self._state = told.state, told.fault
                lines.append(self._line("state", told, told.received_s))
        self._append(lines)

    def finish(self) -> None:
        """A line that says so."""
        self._append([{"kind": "end", "time_s": time.time(), "lost": self.lost}])
        if self._file is not None:
            self._file.close()

    def _append(self, lines: list[dict[str, Any]]) -> None:
        if not lines:
            return
        self.pending = len(lines)
        if self._file is None:
            self._open()
        assert self._file is not None
        text = "".join(json.dumps(line, allow_nan=False) + "\n" for line in lines).encode()
        data = (b"\n" if self._torn else b"") + text
        written = self._file.write(data)
        # Of a full disk the beginning may fit: what comes next must not be taken for the rest of that line.
        self._torn = written < len(data)
        if self._torn:
            raise OSError(28, "No space left on device")

    def _of_alarm(self, alarm: CollisionAlarm) -> dict[str, Any]:
        more = {"stamp_s": alarm.stamp_s, "number": alarm.number, "latency_s": alarm.latency_s}
        return (
            {"kind": "alarm", "time_s": self._wall.at(alarm.tick.sample.received_s)}
            | more
            | alarm_json(alarm, self._joints)
        )

    def _status(self, status: Status) -> dict[str, Any]:
        last = status.last
        residual = last.residual if isinstance(last, MonitorTick) else np.full(len(self._joints), np.nan)
        return self._line("status", last, status.now_s) | {"residual_Nm": _finite(residual)}

    def _line(self, kind: str, told: MonitorTick | DataLoss, now_s: float) -> dict[str, Any]:
        return {
            "kind": kind,
            "time_s": self._wall.at(now_s),
            "stamp_s": finite_or_none(told.stamp_s),
            "state": told.state,
            "fault": told.fault,
            "stop": told.stop,
        }

    def _of_event(self, event: SourceEvent, received_s: float) -> dict[str, Any]:
        return {
            "kind": "source",
            "time_s": self._wall.at(received_s),
            "event": str(event.kind),
            "text": event.text,
            "count": event.count,
        }


def alarm_json(alarm: CollisionAlarm, names: Sequence[str]) -> dict[str, Any]:
    """An alarm's joints, by name, and what it says of the contact."""
    event = alarm.event
    found = event.to_json()
    joints = sorted({*event.joints, *event.fast_joints})
    kept = (
        "residual_Nm",
        "threshold_Nm",
        "force_N",
        "force_interval_N",
        "best_force_N",
        "best_force_sd_N",
        "link",
        "possible_links",
        "payload_change_kg",
    )
    more: dict[str, Any] = {
        "fast_joints": [names[j] for j in event.fast_joints],
        "fast_Nm": _finite(alarm.fast),
        "fast_threshold_Nm": _finite(alarm.fast_threshold),
    }
    return {"joints": [names[j] for j in joints]} | {key: found[key] for key in kept if key in found} | more


def _finite(values: Any) -> list[float | None]:
    return [float(x) if np.isfinite(x) else None for x in values]
