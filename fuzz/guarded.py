"""What the process costs in which Parquet, Excel and MATLAB files are read: the fuzzer's own limits do not see it."""

from __future__ import annotations

import os
from pathlib import Path

from bumpstop.recording.formats import reader_process

_TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")


class GuardedReader:
    """The reader's process, where the target has one."""

    def __init__(self) -> None:
        self._pid, self._seconds, self._memory = 0, 0.0, 0
        self.used()

    def used(self) -> tuple[float, int]:
        """Time of the processor [s] since it was asked last, and memory [bytes] on top of what it had then.

        Both are zero where there is no such process, where it has been started since, and where it has ended.
        """
        process = reader_process._READER.process
        if process is None:
            self._pid = 0
            return 0.0, 0
        try:
            here = Path(f"/proc/{process.pid}")
            times = (here / "stat").read_text(encoding="ascii").rpartition(")")[2].split()
            status = dict(line.split(":", 1) for line in (here / "status").read_text("ascii").splitlines())
            (here / "clear_refs").write_text("5", encoding="ascii")  # the greatest memory begins anew
        except OSError:
            self._pid = 0
            return 0.0, 0
        seconds = (int(times[11]) + int(times[12])) / _TICKS_PER_SECOND
        greatest, memory = (1024 * int(status[key].split()[0]) for key in ("VmHWM", "VmRSS"))
        since = (seconds - self._seconds, greatest - self._memory) if process.pid == self._pid else (0.0, 0)
        self._pid, self._seconds, self._memory = process.pid, seconds, memory
        return since
