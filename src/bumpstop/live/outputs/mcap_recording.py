"""The monitor's MCAP recording: residuals, thresholds, states, alarms and joint states, file after file."""

from __future__ import annotations

import json
import math
import re
import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.detection.events import STATES
from bumpstop.errors import InputError
from bumpstop.live.output import CollisionAlarm, MonitorTick
from bumpstop.live.outputs.background import BackgroundOutput
from bumpstop.live.outputs.json_lines import alarm_json
from bumpstop.live.outputs.mcap_writer import JOINT_STATES, PART, McapFile, import_mcap, mend
from bumpstop.recording.formats.joint_state import messages
from bumpstop.text_files import as_path

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    from bumpstop.live.loaded_detector import LoadedDetector
    from bumpstop.live.outputs.background import Told

_CHUNK_S = 0.4
_AGAIN_S = 1.0  # threshold and state are written when they change, and so often
_RETRY_S = 5.0
_MAX_STAMP_S = 2.0**31


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
        self._wall = time.time() - time.monotonic()
        self._threshold: Any = None
        self._state = ""
        self._next_threshold = self._next_state = -math.inf
        self._template = _template(detector.joints)
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
        self._file = McapFile(self._next_path(), self._detector.joints)
        self._end = time.monotonic() + self._rotate
        self._next_chunk = time.monotonic() + _CHUNK_S
        self._threshold, self._state = None, ""

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
            ticks = [told for told in batch if isinstance(told, MonitorTick)]
            self._add_joint_states(file, ticks)
            for told in batch:
                if isinstance(told, MonitorTick):
                    self._add_tick(file, told)
                elif isinstance(told, CollisionAlarm):
                    stamp = {"stamp_s": told.stamp_s, "number": told.number, "latency_s": told.latency_s}
                    found = stamp | alarm_json(told, self._detector.joints)
                    self._add(file, "/bumpstop/alarm", told.tick.sample.received_s, found)
                else:
                    event, received = told
                    found = {"event": str(event.kind), "text": event.text, "count": event.count}
                    self._add(file, "/bumpstop/source", received, found)
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
        self.files.append(file.path)

    def _add(self, file: McapFile, topic: str, received_s: float, found: dict[str, Any]) -> None:
        time_ns = round((self._wall + received_s) * 1e9)
        file.add(topic, time_ns, json.dumps(found, allow_nan=False).encode())

    def _add_tick(self, file: McapFile, tick: MonitorTick) -> None:
        sample, names = tick.sample, self._detector.joints
        stamp = sample.stamp_s if math.isfinite(sample.stamp_s) else 0.0
        at, received = {"stamp_s": stamp}, sample.received_s
        residual = [None] * len(names) if tick.state == "no_data" else tick.residual.tolist()
        self._add(file, "/bumpstop/residual", received, at | {"residual_Nm": dict(zip(names, residual, strict=True))})
        threshold = tick.threshold
        if received >= self._next_threshold or not np.array_equal(threshold, self._threshold):
            self._threshold, self._next_threshold = threshold, received + _AGAIN_S
            values = [x if math.isfinite(x) else None for x in threshold.tolist()]
            found = at | {"threshold_Nm": dict(zip(names, values, strict=True))}
            self._add(file, "/bumpstop/threshold", received, found)
        if received >= self._next_state or tick.state != self._state:
            self._state, self._next_state = tick.state, received + _AGAIN_S
            words = {"state": tick.state, "state_number": STATES.index(tick.state), "fault": tick.fault}
            self._add(file, "/bumpstop/state", received, at | words | {"stop": tick.stop})

    def _add_joint_states(self, file: McapFile, ticks: Sequence[MonitorTick]) -> None:
        """Samples of this robot's joints as ROS 2 has them; the effort is what the detector takes."""
        n, current = self._detector.dof, self._detector.takes_current
        rows = []
        for tick in ticks:
            sample = tick.sample
            effort = sample.current_A if current else sample.torque_Nm
            if np.shape(sample.position_rad) == (n,) and effort is not None and np.shape(effort) == (n,):
                rate = sample.velocity_rad_s
                known = rate is not None and np.shape(rate) == (n,)
                rows.append((sample, rate if known else np.full(n, math.nan), effort))
        if not rows:
            return
        stamps = np.array([sample.stamp_s for sample, _, _ in rows])
        usable = np.isfinite(stamps) & (stamps >= 0) & (stamps < _MAX_STAMP_S)
        times = np.round(np.where(usable, stamps, 0.0) * 1e9).astype(np.int64)
        columns = [np.array(column) for column in zip(*((s.position_rad, v, e) for s, v, e in rows), strict=True)]
        bodies = messages(self._template, times, (columns[0], columns[1], columns[2]))
        for (sample, _, _), body in zip(rows, bodies, strict=True):
            file.add(JOINT_STATES, round((self._wall + sample.received_s) * 1e9), body.tobytes())


def _template(joints: tuple[str, ...]) -> bytes:
    """A joint state of these joints, whose numbers are filled in later."""
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    header = types["std_msgs/msg/Header"](stamp=types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id="")
    kind, nothing = types["sensor_msgs/msg/JointState"], np.zeros(len(joints))
    made = kind(header=header, name=list(joints), position=nothing, velocity=nothing, effort=nothing)
    return bytes(store.serialize_cdr(made, kind.__msgtype__))


def _escaped(stem: str) -> str:
    return re.sub(r"([*?[])", r"[\1]", stem)
