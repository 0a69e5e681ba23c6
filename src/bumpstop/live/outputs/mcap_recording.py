"""The monitor's MCAP recording: residuals, thresholds, states, alarms and joint states, file after file."""

from __future__ import annotations

import math
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.errors import InputError
from bumpstop.live.output import CollisionAlarm, DataLoss, MonitorTick
from bumpstop.live.outputs.background import BackgroundOutput, Status, WallClock
from bumpstop.live.outputs.mcap_writer import PART, McapFile, import_mcap, mend
from bumpstop.live.outputs.ros_messages import RosMessages, usable_rows
from bumpstop.text_files import as_path

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from bumpstop.live.loaded_detector import LoadedDetector
    from bumpstop.live.outputs.background import Told

_CHUNK_S = 0.4
_AGAIN_S = 1.0  # thresholds are written when they change, and so often
_RETRY_S = 5.0


class McapRecording(BackgroundOutput):
    """Files ``NAME_0001.mcap``, ``NAME_0002.mcap``, ...: a new one every so often, and after every start.

    A killed process loses half a second at most: what it left is mended at the next start, as a file of its own.

    Args:
        path: ``NAME.mcap``.
        detector: of the monitor.
        rotate_s: a new file after so long [s]; infinite: one file.

    Raises:
        InputError: the files cannot be written, another monitor writes them, or mcap is not installed.
    """

    def __init__(self, path: str | os.PathLike[str], detector: LoadedDetector, *, rotate_s: float = 600.0) -> None:
        import_mcap()
        self._path = as_path(path, "--mcap")
        if self._path.suffix != ".mcap":
            raise InputError("--mcap", f"is {str(self._path)!r}", "wanted a name that ends in .mcap")
        if not rotate_s > 0:
            raise InputError("--rotate-s", f"is {rotate_s:g}", "wanted more than zero")
        self.what = f"--mcap {self._path}"
        super().__init__()
        self._detector, self._rotate = detector, rotate_s
        self._wall = WallClock()
        self._threshold: Any = None
        self._state = ("", "")
        self._next_threshold = -math.inf
        self._messages = RosMessages(detector.joints)
        self.mended: list[str] = []
        self.files: list[Path] = []
        self._file: McapFile | None = None
        self._unwritten = 0
        self._retry = 0.0
        try:
            self._mend()
            self._begin()
        except OSError as error:
            raise InputError("--mcap", f"{str(self._path)!r} cannot be written ({error.strerror or error})") from None
        self.start()

    def _mend(self) -> None:
        for part in sorted(self._path.parent.glob(f"{_escaped(self._path.stem)}_[0-9]*.mcap{PART}")):
            if mend(part):
                self.mended.append(str(part).removesuffix(PART))

    def _begin(self) -> None:
        self._file = McapFile(self._next_path(), self._messages)
        self._end = time.monotonic() + self._rotate
        self._next_chunk = time.monotonic() + _CHUNK_S
        self._threshold, self._state = None, ("", "")

    def _next_path(self) -> Path:
        stem = self._path.stem
        pattern = re.compile(re.escape(stem) + r"_(\d+)\.mcap(" + re.escape(PART) + ")?")
        taken = [int(found[1]) for one in self._path.parent.iterdir() if (found := pattern.fullmatch(one.name))]
        return self._path.with_name(f"{stem}_{max(taken, default=0) + 1:04d}.mcap")

    def write(self, batch: Sequence[Told]) -> None:
        """Messages of what was told; half a second of them at most is not yet in the file."""
        now = time.monotonic()
        self.pending = len(batch) + self._unwritten
        if self._file is None:
            if now < self._retry:
                self._unwritten = 0
                raise OSError(28, "No space left on device")
            self._retry = now + _RETRY_S
            self._begin()
        file = self._file
        assert file is not None
        try:
            self._add_ticks(file, [told for told in batch if isinstance(told, MonitorTick)])
            for told in batch:
                if isinstance(told, CollisionAlarm):
                    time_ns = self._nanoseconds(told.tick.received_s)
                    file.add("/bumpstop/alarm", time_ns, self._messages.alarm(told))
                elif isinstance(told, tuple):
                    event, received = told
                    file.add("/bumpstop/source", self._nanoseconds(received), self._messages.source_event(event))
                elif isinstance(told, Status):
                    self._add_state(file, told.last, told.now_s)
                elif (told.state, told.fault) != self._state:
                    self._add_state(file, told, told.received_s)
            self._unwritten = self.pending
            if now >= self._next_chunk or self._ending.is_set():
                self._next_chunk = now + _CHUNK_S
                file.end_chunk()
                self._unwritten = 0
            if now >= self._end:
                self._complete()
                self._begin()
        except OSError:
            self._unwritten = 0
            self._file = None
            self._retry = now + _RETRY_S
            file.abandon()
            raise

    def finish(self) -> None:
        """Complete the last file."""
        if self._file is not None:
            self._complete()

    def _complete(self) -> None:
        assert self._file is not None
        file, self._file = self._file, None
        file.complete()
        if file.messages:
            self.files.append(file.path)

    def _nanoseconds(self, received_s: float) -> int:
        return round(self._wall.at(received_s) * 1e9)

    def _add_ticks(self, file: McapFile, ticks: Sequence[MonitorTick]) -> None:
        """Residuals of all, thresholds of those in which they change, and samples of this robot's joints."""
        if not ticks:
            return
        at = [self._nanoseconds(tick.received_s) for tick in ticks]
        stamps = np.array([tick.stamp_s for tick in ticks])
        bodies = self._messages.efforts(stamps, np.array([tick.residual for tick in ticks]))
        for time_ns, body in zip(at, bodies, strict=True):
            file.add("/bumpstop/residual", time_ns, body)
        for tick, time_ns in zip(ticks, at, strict=True):
            received = tick.received_s
            if received >= self._next_threshold or not np.array_equal(tick.threshold, self._threshold):
                self._threshold, self._next_threshold = tick.threshold, received + _AGAIN_S
                stamp = np.array([tick.stamp_s])
                file.add("/bumpstop/threshold", time_ns, self._messages.efforts(stamp, tick.threshold[None])[0])
        self._add_joint_states(file, ticks)

    def _add_state(self, file: McapFile, told: MonitorTick | DataLoss, now_s: float) -> None:
        self._state = told.state, told.fault
        file.add("/bumpstop/state", self._nanoseconds(now_s), self._messages.state(told))

    def _add_joint_states(self, file: McapFile, ticks: Sequence[MonitorTick]) -> None:
        """Samples as ROS 2 has them; the effort is what the detector takes."""
        n, current = self._detector.dof, self._detector.takes_current
        samples = [tick.sample for tick in usable_rows(ticks, n, current=current)]
        if not samples:
            return
        rates = [one.velocity_rad_s for one in samples]
        # A source has rates or has none; where one lacks them, none of its neighbours is written with them.
        known = [rate for rate in rates if rate is not None and np.shape(rate) == (n,)]
        velocity = np.array(known) if len(known) == len(samples) else None
        effort = np.array([one.current_A if current else one.torque_Nm for one in samples], dtype=np.float64)
        position = np.array([one.position_rad for one in samples])
        stamps = np.array([one.stamp_s for one in samples])
        for one, body in zip(samples, self._messages.joint_states(stamps, position, velocity, effort), strict=True):
            file.add("/joint_states", self._nanoseconds(one.received_s), body)


def _escaped(stem: str) -> str:
    return re.sub(r"([*?[])", r"[\1]", stem)
