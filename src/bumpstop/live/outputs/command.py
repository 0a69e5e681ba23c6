"""A user's command that a collision starts, with a time limit."""

from __future__ import annotations

import json
import os
import shlex
import shutil
import signal
import subprocess
import threading
from collections import deque
from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.live.output import taken
from bumpstop.live.outputs.json_lines import alarm_json

if TYPE_CHECKING:
    from bumpstop.live.loaded_detector import LoadedDetector
    from bumpstop.live.output import CollisionAlarm, DataLoss, MonitorTick
    from bumpstop.live.source import SourceEvent

_AT_END_S = 1.0


class CollisionCommand:
    """Starts a command at every alarm: its words as they are, no shell between, unless one is asked for.

    The alarm is in the environment, ``BUMPSTOP_ALARM`` as JSON, and ``BUMPSTOP_JOINTS``, ``BUMPSTOP_FORCE_N`` and
    ``BUMPSTOP_LINK``. While one runs no other is started. One that runs longer than the limit is killed, with all that
    it has started.

    Args:
        command: as on a command line.
        detector: of the monitor.
        timeout_s: the limit [s].
        shell: let ``/bin/sh`` read it.

    Raises:
        InputError: it is empty, cannot be split into words, or its program is not there.
    """

    def __init__(self, command: str, detector: LoadedDetector, *, timeout_s: float = 5.0, shell: bool = False) -> None:
        self._joints = detector.joints
        if not 0 < timeout_s < float("inf"):
            raise InputError("--command-timeout-s", f"is {timeout_s:g}", "wanted more than zero")
        self._timeout = timeout_s
        if shell:
            self._words = ["/bin/sh", "-c", command]
        else:
            try:
                self._words = shlex.split(command)
            except ValueError as error:
                raise InputError("--on-collision", f"{command!r}: {error}") from None
        if not self._words or not command.strip():
            raise InputError("--on-collision", "is empty", "wanted a command")
        if shutil.which(self._words[0]) is None:
            raise InputError("--on-collision", f"there is no program {self._words[0]!r}", "wanted one on the path")
        self._problems: deque[str] = deque()
        self._thread: threading.Thread | None = None
        self.started = self.skipped = 0

    def alarm(self, alarm: CollisionAlarm) -> None:
        """Start it."""
        if self._thread is not None and self._thread.is_alive():
            self.skipped += 1
            self._problems.append(f"--on-collision: not started for alarm {alarm.number}, the last one still runs")
            return
        self.started += 1
        self._thread = threading.Thread(target=self._run, args=(alarm,), name="on-collision", daemon=True)
        self._thread.start()

    def _run(self, alarm: CollisionAlarm) -> None:
        told = {"number": alarm.number, "stamp_s": alarm.stamp_s} | alarm_json(alarm, self._joints)
        force = told.get("force_N")
        environment = os.environ | {
            "BUMPSTOP_ALARM": json.dumps(told, allow_nan=False),
            "BUMPSTOP_JOINTS": ",".join(told["joints"]),
            "BUMPSTOP_FORCE_N": "" if force is None else f"{force:.6g}",
            "BUMPSTOP_LINK": str(told.get("link") or ""),
        }
        try:
            # A group of its own, so that all of it can be ended; its output must not mix with the monitor's tables.
            process = subprocess.Popen(
                self._words,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                start_new_session=True,
            )
        except OSError as error:
            self._problems.append(f"--on-collision: cannot be started ({error.strerror or error})")
            return
        try:
            status = process.wait(self._timeout)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()
            self._problems.append(f"--on-collision: killed after {self._timeout:g} s, alarm {alarm.number}")
            return
        if status != 0:
            self._problems.append(f"--on-collision: ended with status {status}, alarm {alarm.number}")

    def tick(self, tick: MonitorTick) -> None:
        """Nothing to do."""

    def data_loss(self, loss: DataLoss) -> None:
        """Nothing to do."""

    def source_event(self, event: SourceEvent, received_s: float) -> None:
        """Nothing to do."""

    def flush(self, now_s: float) -> None:
        """Nothing to do."""

    def problems(self) -> list[str]:
        """What has failed since the last call."""
        return taken(self._problems)

    def close(self) -> None:
        """Wait for the one that runs, no longer than its limit."""
        if self._thread is not None:
            self._thread.join(self._timeout + _AT_END_S)
