"""An output whose slow work is done in a thread, so that no sample waits for a disk."""

from __future__ import annotations

import math
import threading
import time
from abc import ABC, abstractmethod
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bumpstop.live.output import CollisionAlarm, DataLoss, MonitorTick, taken

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.live.source import SourceEvent


@dataclass(frozen=True, slots=True)
class Status:
    """The state at a time at which nothing need have been told.

    Attributes:
        last: what said it.
        now_s: ``time.monotonic()`` [s].
    """

    last: MonitorTick | DataLoss
    now_s: float


Told = CollisionAlarm | MonitorTick | DataLoss | Status | tuple["SourceEvent", float]

_PERIOD_S = 0.1
_STATUS_S = 1.0
_SET_S = 0.01  # a clock that is off by more has been set; by less, the two clocks were read apart
_MAX_WAITING = 60_000  # a minute at 1 kHz, for a disk that hangs
_MAX_ENDING_S = 10.0  # then what hangs is left behind


class WallClock:
    """The clock on the wall beside ``time.monotonic()``: somebody, or a network, may set it while a monitor runs."""

    def __init__(self) -> None:
        self._ahead = time.time() - time.monotonic()

    def at(self, monotonic_s: float) -> float:
        """What it shows, as it is set now, at a time of ``time.monotonic()``: seconds since 1970."""
        ahead = time.time() - time.monotonic()
        if abs(ahead - self._ahead) > _SET_S:
            self._ahead = ahead
        return self._ahead + monotonic_s


class BackgroundOutput(ABC):
    """Hands what it is told to :meth:`write` in a thread, ten times a second.

    A subclass gives ``what`` it is, for sentences, and the methods :meth:`write` and :meth:`finish`. An ``OSError`` of
    theirs is told once until writing works again, and what was to be written is counted as lost. So is what a thread
    that hangs does not take: ``max_waiting`` things wait for it, and ``max_ending_s`` is how long the end does [s].
    """

    what = "output"
    max_waiting, max_ending_s = _MAX_WAITING, _MAX_ENDING_S

    def __init__(self) -> None:
        self._waiting: deque[Told] = deque()
        self._ending = threading.Event()
        self._problems: deque[str] = deque()
        self._failing, self._dropped = False, 0
        self._last: MonitorTick | DataLoss | None = None
        self._next_status = -math.inf
        self.lost = self.pending = 0
        self.wrote = False
        self._thread: threading.Thread | None = threading.Thread(target=self._run, name=self.what, daemon=True)

    def start(self) -> None:
        """Begin to write; called at the end of a subclass's construction."""
        assert self._thread is not None
        self._thread.start()

    def alarm(self, alarm: CollisionAlarm) -> None:
        """Wait to be written."""
        self._push(alarm)

    def tick(self, tick: MonitorTick) -> None:
        """Wait to be written."""
        self._last = tick
        self._push(tick)

    def data_loss(self, loss: DataLoss) -> None:
        """Wait to be written."""
        self._last = loss
        self._push(loss)

    def source_event(self, event: SourceEvent, received_s: float) -> None:
        """Wait to be written."""
        self._push((event, received_s))

    def _push(self, told: Told) -> None:
        if len(self._waiting) >= self.max_waiting:
            self._dropped += 1
            return
        self._waiting.append(told)

    def flush(self, now_s: float) -> None:
        """Tell the state once a second, whether samples come or not; the thread writes by itself."""
        if self._last is not None and now_s >= self._next_status:
            self._next_status = now_s + _STATUS_S
            self._push(Status(self._last, now_s))

    def problems(self) -> list[str]:
        """What has failed since the last call."""
        return taken(self._problems)

    def close(self) -> None:
        """Write what waits, and end; what hangs is not waited for."""
        if self._thread is None:
            return
        self._ending.set()
        self._thread.join(self.max_ending_s)
        if self._thread.is_alive():
            lost = self.lost + self._dropped + self.pending + len(self._waiting)
            self._problems.append(f"{self.what} takes nothing: {lost} lines or messages were lost")
        self._thread = None

    @abstractmethod
    def write(self, batch: Sequence[Told]) -> None:
        """Write what was told, so that a process that is killed has it.

        ``pending`` is how much is lost if this fails, and ``wrote`` that something was written, where none is pending.
        """

    @abstractmethod
    def finish(self) -> None:
        """Nothing more will be told."""

    def _run(self) -> None:
        while not self._ending.wait(_PERIOD_S):
            self._write_waiting()
        self._write_waiting()
        try:
            self.finish()
        except OSError as error:
            if not self._failing:
                self._problems.append(f"{self.what} cannot be finished ({error.strerror or error})")
        if self.lost:
            self._problems.append(f"{self.what}: {self.lost} lines or messages were lost")

    def _write_waiting(self) -> None:
        batch: list[Told] = []
        while self._waiting:
            batch.append(self._waiting.popleft())
        dropped, self._dropped = self._dropped, 0
        self.lost += dropped
        if dropped:
            self._problems.append(f"{self.what} is too slow: {dropped} lines or messages were left out")
        self.pending, self.wrote = 0, False
        try:
            self.write(batch)
        except OSError as error:
            self.lost += self.pending
            if not self._failing:
                self._problems.append(f"{self.what} cannot be written ({error.strerror or error}); monitoring goes on")
            self._failing = True
        else:
            if self._failing and (self.pending or self.wrote):
                self._failing = False
                self._problems.append(f"{self.what} can be written again")
