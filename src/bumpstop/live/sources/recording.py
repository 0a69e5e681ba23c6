"""A recording as a source: in real time, faster, or as fast as it can be read."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Iterator
from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.live.sample import JointSample
from bumpstop.live.source import Source, SourceEvent, SourceEventKind

if TYPE_CHECKING:
    from bumpstop.recording import Recording
    from bumpstop.recording.read_report import ReadReport

# What reading leaves out that has a name of its own in a stream; the rest is damaged.
_KINDS = {"doubled time": SourceEventKind.REPEATED, "time runs backwards": SourceEventKind.WENT_BACK}


class RecordingSource(Source):
    """Plays a recording: what its reading has left out, then each row when it is due.

    Args:
        recording: with currents or torques.
        speed: seconds of the recording in a second; infinite: every row at once when it is asked for.
        name: as the user wrote it.
        notes: what is to be told before the first row.
    """

    def __init__(
        self, recording: Recording, speed: float = 1.0, name: str = "recording", notes: tuple[str, ...] = ()
    ) -> None:
        if not speed > 0:
            raise InputError("--speed", f"is {speed}", "wanted more than zero, or max")
        self._recording, self._speed, self._name, self.notes = recording, speed, name, notes
        self._row, self._begin = 0, 0.0
        self._left_out: deque[SourceEvent] = deque()

    @property
    def name(self) -> str:
        """As the user wrote it."""
        return self._name

    def open(self) -> None:
        """Begin at the first row."""
        self._row, self._begin = 0, time.monotonic()
        self._left_out = deque(_left_out(self._recording.report))

    def read(self, timeout_s: float) -> JointSample | SourceEvent | None:
        """The next row when it is due, then ``ENDED``; None: it is not due within the time [s]."""
        if self._left_out:
            return self._left_out.popleft()
        log, row = self._recording, self._row
        if row >= log.t.size:
            return SourceEvent(SourceEventKind.ENDED, "the recording is at its end")
        now = time.monotonic()
        if math.isfinite(self._speed):
            due = self._begin + (log.t[row] - log.t[0]) / self._speed
            if due > now:
                time.sleep(min(due - now, timeout_s))
                now = time.monotonic()
                if due > now:
                    return None
        self._row += 1
        return JointSample(
            stamp_s=float(log.t[row]),
            received_s=now,
            position_rad=log.q[row],
            velocity_rad_s=None if log.qd is None else log.qd[row],
            current_A=None if log.current is None else log.current[row],
            torque_Nm=None if log.tau is None else log.tau[row],
        )

    def close(self) -> None:
        """Nothing is open."""


def _left_out(report: ReadReport) -> Iterator[SourceEvent]:
    """What the file holds and no sample comes of."""
    if report.other_joints:
        text = f"a message of the file has other joints, of {report.rows_read + report.other_joints} in all"
        yield SourceEvent(SourceEventKind.FOREIGN, text, report.other_joints)
    for reason, count in report.counts.items():
        text = f"a {report.numbered} of the file is left out, {reason}, of {report.rows_read} in all"
        yield SourceEvent(_KINDS.get(reason, SourceEventKind.DAMAGED), text, count)
