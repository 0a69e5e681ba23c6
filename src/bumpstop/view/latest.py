"""A thread that answers the newest request and forgets those it replaces."""

from __future__ import annotations

import threading
import time
import traceback
from typing import TYPE_CHECKING, Generic, TypeVar

from bumpstop.interruption import asked_while_working

if TYPE_CHECKING:
    from collections.abc import Callable

Request = TypeVar("Request")
# What has begun is let go on for so long, whoever waits: shown a little late, it moves with what the hand does.
_PATIENCE_S = 0.5


class SupersededError(Exception):
    """Another request has come: nobody waits for this."""


class LatestWins(Generic[Request]):
    """Runs a function on the newest request, in a thread of its own.

    A request that has not begun when the next one comes is dropped. One that has begun is given up after half a second,
    where kernels work. What it raises is printed, and the next one is answered all the same.

    Attributes:
        dropped: requests that were replaced before they were answered.
        done: requests that were answered.
    """

    def __init__(self, work: Callable[[Request], None], name: str) -> None:
        self.dropped = 0
        self.done = 0
        self._work = work
        self._waiting: list[Request] = []
        self._closed = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)
        self._thread.start()

    def submit(self, request: Request) -> None:
        """Ask for a request to be answered; one that still waits is dropped."""
        with self._changed:
            self.dropped += len(self._waiting)
            self._waiting = [request]
            self._changed.notify()

    def has_newer(self) -> bool:
        """Another request waits, or nobody wants an answer any more: work that takes long asks this and gives up."""
        with self._changed:
            return self._closed or bool(self._waiting)

    def newer_within(self, seconds: float) -> bool:
        """Wait until another request waits or nobody wants an answer any more, but not longer than this."""
        with self._changed:
            return self._changed.wait_for(lambda: self._closed or bool(self._waiting), seconds)

    def close(self, wait_s: float = 0.0) -> None:
        """Take no more requests; the thread ends after the one that it works on."""
        with self._changed:
            self._closed, self._waiting = True, []
            self._changed.notify()
        if wait_s:
            self._thread.join(wait_s)

    @property
    def alive(self) -> bool:
        """The thread has not ended yet."""
        return self._thread.is_alive()

    def _run(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or bool(self._waiting))
                if self._closed:
                    return
                request = self._waiting.pop()
            patient_until = time.monotonic() + _PATIENCE_S

            def ask(until: float = patient_until) -> None:
                if time.monotonic() > until and self.has_newer():
                    raise SupersededError

            try:
                with asked_while_working(ask):
                    self._work(request)
            except SupersededError:
                self.dropped += 1
                continue
            except Exception:  # a fault of ours: one answer is lost, and the page goes on
                traceback.print_exc()
            self.done += 1
