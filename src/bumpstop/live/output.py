"""Where a monitor tells what it sees: files, commands, networks."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from collections import deque

    from bumpstop.arrays import FloatArray
    from bumpstop.detection import Event
    from bumpstop.live.sample import JointSample
    from bumpstop.live.source import SourceEvent


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MonitorTick:
    """What the detector says of one sample.

    Attributes:
        sample: as it came.
        state: ``"no_data"``, ``"arming"``, ``"monitoring"`` or ``"alarm"``.
        fault: why there is no data; ``"none"`` otherwise.
        alarm: an alarm stands, though a bad sample may hide it from the state.
        stop: the arm must stop.
        residual: (n,) estimated minus predicted motor torque, NaN without data [Nm or N].
        threshold: (n,) of the residual in this tick; infinite: not monitored [Nm or N].
    """

    sample: JointSample
    state: str
    fault: str
    alarm: bool
    stop: bool
    residual: FloatArray
    threshold: FloatArray

    @property
    def stamp_s(self) -> float:
        """Of the sample [s]."""
        return self.sample.stamp_s

    @property
    def received_s(self) -> float:
        """Of the sample [s]."""
        return self.sample.received_s


@dataclass(frozen=True, slots=True, kw_only=True)
class DataLoss:
    """From now on the state is ``"no_data"`` and the arm must stop, though no sample has come that says so.

    Attributes:
        fault: why: ``"stopped"``, ``"restarted"``, or ``"ended"`` of the source or of the monitor.
        alarm: an alarm stands.
        received_s: ``time.monotonic()`` when the monitor knew [s].
    """

    fault: str
    alarm: bool = False
    received_s: float

    @property
    def stamp_s(self) -> float:
        """NaN: no sample says it [s]."""
        return math.nan

    @property
    def state(self) -> str:
        """As of a tick without data."""
        return "no_data"

    @property
    def stop(self) -> bool:
        """The arm must stop."""
        return True


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CollisionAlarm:
    """An alarm of the running arm.

    Attributes:
        stamp_s: of the sample that raised it [s].
        number: from 1, of the alarms of this monitor.
        event: joints, residuals and what they say of the contact: force, direction, link.
        latency_s: from the receipt of the sample to the detector's word, with the time that it waited to be read, where
            that was long [s].
        tick: of the sample that raised it.
        fast: (n,) of the band-pass channel at that sample [Nm or N].
        fast_threshold: (n,) of that channel, with what motion adds; infinite: not monitored there; NaN: not known, as
            the residual itself has no threshold to which the same was added [Nm or N].
    """

    stamp_s: float
    number: int
    event: Event
    latency_s: float
    tick: MonitorTick
    fast: FloatArray
    fast_threshold: FloatArray


class Output(Protocol):
    """Somewhere a monitor tells things. It never raises: what fails, it says in :meth:`problems`, and goes on.

    ``alarm`` comes first of all that is told of a sample, and must be quick; slow work belongs in a thread.
    """

    def alarm(self, alarm: CollisionAlarm) -> None:
        """A collision; told before the tick that raised it."""

    def tick(self, tick: MonitorTick) -> None:
        """A judged sample."""

    def data_loss(self, loss: DataLoss) -> None:
        """No sample comes that could be judged; the next tick says what is then."""

    def source_event(self, event: SourceEvent, received_s: float) -> None:
        """Something happened to the source, at ``time.monotonic()`` = ``received_s``."""

    def flush(self, now_s: float) -> None:
        """Called every tenth of a second or so, with ``time.monotonic()``: write what must not be lost."""

    def problems(self) -> list[str]:
        """Sentences about what has failed since the last call."""

    def close(self) -> None:
        """End; may be called twice."""


def taken(problems: deque[str]) -> list[str]:
    """All that are there, which then are no more; a thread may add others meanwhile."""
    found = []
    while problems:
        found.append(problems.popleft())
    return found
