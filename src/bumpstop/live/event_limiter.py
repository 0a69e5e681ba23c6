"""Keeps a flood of bad messages from being a flood of events; every message stays counted."""

from __future__ import annotations

from collections.abc import Iterator

from bumpstop.live.source import SourceEvent, SourceEventKind

_PERIOD_S = 1.0


class EventLimiter:
    """Tells the first event of a kind at once, and at most one more a second, with the count of all since."""

    def __init__(self) -> None:
        self._told_s: dict[SourceEventKind, float] = {}
        self._held: dict[SourceEventKind, tuple[str, int]] = {}

    def add(self, kind: SourceEventKind, text: str, now_s: float, count: int = 1) -> SourceEvent | None:
        """The event to tell now; None: it is held and counted.

        Args:
            kind: of the event.
            text: of the event.
            now_s: ``time.monotonic()`` [s].
            count: messages it is about.
        """
        held = self._held.get(kind, ("", 0))[1] + count
        if now_s - self._told_s.get(kind, -2 * _PERIOD_S) < _PERIOD_S:
            self._held[kind] = text, held
            return None
        self._held.pop(kind, None)
        self._told_s[kind] = now_s
        return SourceEvent(kind, text, held)

    def due(self, now_s: float, *, final: bool = False) -> Iterator[SourceEvent]:
        """Held events whose second is over; with ``final`` all of them.

        Args:
            now_s: ``time.monotonic()`` [s].
            final: nothing comes after.
        """
        for kind, (text, count) in list(self._held.items()):
            if final or now_s - self._told_s[kind] >= _PERIOD_S:
                del self._held[kind]
                self._told_s[kind] = now_s
                yield SourceEvent(kind, text, count)
