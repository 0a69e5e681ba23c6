"""Whether samples wait to be read: the monitor was stopped, or is too slow, and judges the past."""

from __future__ import annotations

import math

# Shares of the allowed time: from the first on a read shows whether something waits, from the second on it is counted.
_SUSPECT_SHARE, _COUNT_SHARE = 0.25, 0.5


class LagCheck:
    """Compares times of receipt with the stamps of samples, since the last time at which nothing waited to be read.

    A sender whose clock waits, drifts or runs slowly is no lag: nothing waits to be read then.

    Args:
        allowed_s: samples may be read so late [s].
        speed: seconds of the source in a second of our clock; infinite: its samples have no time at which they are due.

    Attributes:
        lag_s: how much later than it could be the last sample was read; 0 up to the half of ``allowed_s`` [s].
        lagging: it was more than ``allowed_s``, and reading has not caught up yet.
        suspected: to be made sure of, before more is read, by a read that does not wait.
    """

    def __init__(self, allowed_s: float, speed: float = 1.0) -> None:
        self._allowed, self._speed = allowed_s, speed
        self.lagging = False
        self.reset()

    def reset(self) -> None:
        """Forget the stream, as before its first sample."""
        self._stamp, self._base, self._empty_s = -math.inf, math.inf, -math.inf
        # What a source has received while it was opened is old without having waited.
        self._begun, self.lag_s, self.suspected = False, 0.0, True

    def nothing_waits(self, now_s: float) -> None:
        """A read has found nothing at ``time.monotonic()`` = ``now_s``."""
        self._empty_s, self._begun, self.suspected = now_s, True, False

    def look(self, stamp_s: float, received_s: float) -> str:
        """What is to be told of the next sample, in one sentence; empty: nothing.

        Args:
            stamp_s: of the sample by the clock of its source [s].
            received_s: ``time.monotonic()`` when it was received [s].
        """
        if math.isinf(self._speed) or not self._begun or not stamp_s > self._stamp:
            self.lag_s = 0.0
            return ""
        self._stamp, offset = stamp_s, received_s - stamp_s / self._speed
        lag = max(0.0, offset - self._base)
        if not math.isinf(self._empty_s):
            # It has come since then.
            lag, self._empty_s = min(lag, max(0.0, received_s - self._empty_s)), -math.inf
        self._base = offset - lag
        self.suspected = lag > _SUSPECT_SHARE * self._allowed
        self.lag_s = lag if lag > _COUNT_SHARE * self._allowed else 0.0
        if not self.lagging and lag > self._allowed:
            self.lagging = True
            return f"samples are judged {lag:.3g} s late: they waited to be read"
        if self.lagging and not self.lag_s:
            self.lagging = False
            return "samples are judged as they come again"
        return ""
