"""Where samples of a running arm come from: one interface of recordings, simulated robots and networks."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import TYPE_CHECKING, Protocol, Self

if TYPE_CHECKING:
    from types import TracebackType

    from bumpstop.live.sample import JointSample


class SourceEventKind(StrEnum):
    """What can happen to a stream of samples."""

    STARTED = "started"  # the first sample, or the first after `stopped`
    STOPPED = "stopped"  # no sample for longer than allowed
    RESTARTED = "restarted"  # the connection was lost and made anew, or the source's clock or count began again
    FLOODED = "flooded"  # samples come faster than the detector's period allows
    REPEATED = "repeated"  # a sample came again
    WENT_BACK = "went_back"  # a sample older than the one before
    JUMPED_AHEAD = "jumped_ahead"  # the source's clock went ahead of the time that passed here
    LAGGING = "lagging"  # samples wait to be read, and are judged late; and the end of that
    LOST = "lost"  # samples are missing
    DAMAGED = "damaged"  # a message that cannot be read, or numbers that are none
    FOREIGN = "foreign"  # a sample of another robot's joints, or another type of message
    WRONG_RATE = "wrong_rate"  # samples come at another rate than the detector is made for
    WRONG_UNIT = "wrong_unit"  # the signal looks like one of another unit
    PAYLOAD_CHANGED = "payload_changed"  # the residuals look like a mass that nobody declared
    ENDED = "ended"  # the source has no more samples: a recording at its end


@dataclass(frozen=True, slots=True)
class SourceEvent:
    """Something that happened to a stream of samples.

    Attributes:
        kind: which of the things that can happen.
        text: what happened, in one sentence for people.
        count: samples or messages it is about.
    """

    kind: SourceEventKind
    text: str
    count: int = 1


def stop_time(period_s: float, speed: float = 1.0) -> float:
    """Without a sample for longer a source has stopped, unless a user says otherwise [s].

    Args:
        period_s: of the detector [s].
        speed: seconds of the source in a second of our clock.
    """
    return max(0.1, 10 * period_s / speed)


class Source(Protocol):
    """A stream of joint samples. Sources tell of themselves; what samples show, the monitor finds (``StreamChecks``).

    A source raises ``InputError`` from :meth:`open` only: no source there, two of them, a port in use, no permission,
    another type of message, another robot's joints. Afterwards everything that goes wrong is an event, and the source
    goes on as long as it can: a lost connection is made anew inside :meth:`read`.

    Attributes:
        notes: what is to be told before the first sample, as of a recording that names another robot.
    """

    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """As the user wrote it: ``rtde://10.0.0.2``."""

    def open(self) -> None:
        """Begin.

        Raises:
            InputError: there is nothing to read from, or not what was asked for.
        """

    def read(self, timeout_s: float) -> JointSample | SourceEvent | None:
        """The next sample or event; None: neither has come within the time [s].

        Samples are given in the order they came, none left out. After ``ENDED`` nothing comes.
        """

    def close(self) -> None:
        """End; may be called twice, and without :meth:`open`."""

    def __enter__(self) -> Self:
        """Open."""
        self.open()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """Close."""
        self.close()
