"""Says beside a verdict that the next one is being computed, where that takes long."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING

from bumpstop.view.latest import LatestWins

if TYPE_CHECKING:
    from collections.abc import Callable

# Most verdicts are there in a tenth of it: a notice that comes and goes with every one of them would flicker.
_PATIENCE_S = 0.5


class LateNotice:
    """Tells when a result is late.

    Args:
        say: told True when a change has waited for half a second, and False when its result is there.
    """

    def __init__(self, say: Callable[[bool], None]) -> None:
        self._say = say
        self._lock = threading.Lock()
        self._since: float | None = None
        self._said = False
        self._worker: LatestWins[None] = LatestWins(self._watch, "bumpstop-view-late")

    @property
    def alive(self) -> bool:
        """Its thread has not ended yet."""
        return self._worker.alive

    def close(self) -> None:
        """Say nothing more."""
        self._worker.close()

    def begin(self) -> None:
        """Something waits for a result from now on, if nothing has waited before."""
        with self._lock:
            self._since = self._since or time.monotonic()
        self._worker.submit(None)

    def end(self, *, more: bool) -> None:
        """A result is there.

        Args:
            more: another change waits for its own.
        """
        with self._lock:
            self._since = time.monotonic() if more else None
            if self._said:
                self._said = False
                self._say(False)
        if more:
            self._worker.submit(None)

    def _watch(self, _: None) -> None:
        with self._lock:
            since = self._since
        if since is None or self._worker.newer_within(max(0.0, since + _PATIENCE_S - time.monotonic())):
            return
        with self._lock:
            if self._since == since and not self._said:
                self._said = True
                self._say(True)
