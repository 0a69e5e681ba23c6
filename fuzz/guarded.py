"""What the process costs in which Parquet, Excel and MATLAB files are read: the fuzzer's own limits do not see it."""

from __future__ import annotations

import os

from bumpstop.recording.formats import reader_process

_TICKS_PER_SECOND = os.sysconf("SC_CLK_TCK")


class GuardedReader:
    """The reader's process, where the target has one."""

    def __init__(self) -> None:
        self._pid, self._seconds, self._memory = 0, 0.0, 0
        self._files: dict[str, int] = {}
        self.used()

    def used(self) -> tuple[float, int]:
        """Time of the processor [s] since it was asked last, and memory [bytes] on top of what it had then.

        Both are zero where there is no such process, where it has been started since, and where it has ended.
        """
        process = reader_process._READER.process
        pid = 0 if process is None else process.pid
        known = pid == self._pid
        if not known:
            self._open(pid)
        if pid == 0:
            return 0.0, 0
        try:
            times = os.pread(self._files["stat"], 1 << 12, 0).rpartition(b")")[2].split()
            status = os.pread(self._files["status"], 1 << 14, 0)
            os.pwrite(self._files["clear_refs"], b"5", 0)  # the greatest memory begins anew
        except OSError:
            self._open(0)
            return 0.0, 0
        seconds = (int(times[11]) + int(times[12])) / _TICKS_PER_SECOND
        greatest, memory = (1024 * int(status.partition(key)[2].split(None, 1)[0]) for key in (b"VmHWM:", b"VmRSS:"))
        since = (seconds - self._seconds, greatest - self._memory) if known else (0.0, 0)
        self._seconds, self._memory = seconds, memory
        return since

    def _open(self, pid: int) -> None:
        """Keep open what the system says of a process: to open it anew for every file took a tenth of the time."""
        for handle in self._files.values():
            os.close(handle)
        self._pid, self._files = pid, {}
        if pid == 0:
            return
        try:
            for name, how in (("stat", os.O_RDONLY), ("status", os.O_RDONLY), ("clear_refs", os.O_WRONLY)):
                self._files[name] = os.open(f"/proc/{pid}/{name}", how)
        except OSError:
            self._open(0)
