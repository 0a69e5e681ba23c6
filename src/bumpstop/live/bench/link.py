"""What joins the test bench to a monitor: samples go out, an answer comes back."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, Protocol

if TYPE_CHECKING:
    from bumpstop.plant import Sample


@dataclass(frozen=True)
class LinkAnswer:
    """What a monitor answered.

    Attributes:
        kind: ``"stop"`` or ``"reverse"``.
        received_s: ``time.monotonic()`` when it came [s].
        number: of the alarm, as the monitor counts; 0: it does not say.
    """

    kind: Literal["stop", "reverse"]
    received_s: float
    number: int = 0


class BenchLink(Protocol):
    """One protocol of the test bench."""

    @property
    def address(self) -> str:
        """How a monitor finds it: ``rtde://127.0.0.1:30004``."""

    def wait_for_client(self, timeout_s: float) -> bool:
        """Whether somebody reads the samples, within the time [s]."""

    def publish(self, sample: Sample, stamp_s: float) -> None:
        """Send a sample of the plant, with its time by the bench's clock [s]."""

    def answer(self) -> LinkAnswer | None:
        """The answer that came since the last call; None: none."""

    def close(self) -> None:
        """End; may be called twice."""
