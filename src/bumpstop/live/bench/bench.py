"""The plant in real time: every sample goes out when it is due, and an answer turns the motion."""

from __future__ import annotations

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.live.source import stop_time

if TYPE_CHECKING:
    from bumpstop.live.bench.link import BenchLink, LinkAnswer
    from bumpstop.plant import Command, Plant, PlantReaction, PlantRun, Sample


@dataclass(frozen=True, eq=False, kw_only=True)
class BenchRun:
    """One motion of the bench.

    Attributes:
        run: of the plant.
        begin_s: time of the motion's begin by the bench's clock [s].
        answer: the first that came, or None.
        answered_by: address of the link that it came by; empty without.
        answered_s: time of the motion at the sample at which the plant saw the answer [s], or None.
        published: when each sample went out: its time in the motion, ``time.monotonic()`` (N, 2) [s].
        slipped_s: how much longer than its own time the motion took, as the plant computed too slowly [s].
    """

    run: PlantRun
    begin_s: float
    answer: LinkAnswer | None
    answered_by: str
    answered_s: float | None
    published: np.ndarray[tuple[int, int], np.dtype[np.float64]]
    slipped_s: float

    def round_trip(self) -> tuple[float, float] | None:
        """Time of the motion of the last sample that went out before the answer came, and the time between [s]."""
        if self.answer is None:
            return None
        before = np.flatnonzero(self.published[:, 1] <= self.answer.received_s)
        if not before.size:
            return None
        t, sent = self.published[before[-1]]
        return float(t), float(self.answer.received_s - sent)


class PlantBench:
    """A plant that moves in real time before a monitor.

    The plant looks for an answer at every sample, as a controller does at every cycle, and begins to react
    ``reaction.latency_s`` after it. Where it computes too slowly its clock waits. Between two motions its clock goes
    on, and by so much at least that detectors see a gap: the arm does not move from where one ended to where the next
    begins.

    Args:
        plant: to move.
        links: to monitors.
        reaction: what an answer makes of the motion; the answer says whether it stops or reverses.
        pace: seconds of the plant for a second of the clock; infinite: as fast as it goes.

    Attributes:
        clock_s: time of the bench: where the next motion begins [s].
    """

    def __init__(self, plant: Plant, links: Sequence[BenchLink], reaction: PlantReaction, pace: float = 1.0) -> None:
        self.plant, self._links, self._reaction, self._pace = plant, tuple(links), reaction, pace
        self.clock_s = 0.0
        self._rests_since: float | None = None

    def wait_for_client(self, timeout_s: float) -> bool:
        """Whether somebody reads the samples of any link, within the time [s]."""
        end = time.monotonic() + timeout_s
        while True:
            if any(link.wait_for_client(0.0) for link in self._links):
                return True
            if time.monotonic() >= end:
                return False
            time.sleep(0.005)

    def run(self, command: Command) -> BenchRun:
        """Move once.

        Raises:
            InputError: as :meth:`~bumpstop.plant.Plant.run`.
        """
        for link in self._links:
            link.answer()  # one that came before the motion means another
        answers: list[tuple[LinkAnswer, str, float]] = []
        published: list[tuple[float, float]] = []
        origin: float | None = None
        slipped = 0.0

        def watch(sample: Sample) -> PlantReaction | None:
            nonlocal origin, slipped
            if origin is None:
                self._go_on()
                origin = time.monotonic() - sample.t / self._pace
            wait = origin + sample.t / self._pace + slipped - time.monotonic()
            if wait > 0:
                time.sleep(wait)
            else:
                # It never hurries: a monitor has a whole period for its answer, as before a robot.
                slipped -= wait
            found = None
            if not answers:
                for link in self._links:
                    if (found := link.answer()) is not None:
                        answers.append((found, link.address, sample.t))
                        break
            # Before: an answer may come while this publishes.
            published.append((sample.t, time.monotonic()))
            for link in self._links:
                link.publish(sample, self.clock_s + sample.t)
            return None if found is None else replace(self._reaction, kind=found.kind)

        run = self.plant.run(command, on_sample=watch, to_end=True)
        begin = self.clock_s
        self.clock_s += float(run.trace.t[-1])
        self._rests_since = published[-1][1] if published else time.monotonic()
        answer, address, at = answers[0] if answers else (None, "", None)
        return BenchRun(
            run=run,
            begin_s=begin,
            answer=answer,
            answered_by=address,
            answered_s=at,
            published=np.array(published).reshape(-1, 2),
            slipped_s=slipped,
        )

    def _go_on(self) -> None:
        """Count the time between two motions."""
        if self._rests_since is not None:
            passed = (time.monotonic() - self._rests_since) * (self._pace if math.isfinite(self._pace) else 1.0)
            self.clock_s += max(passed, stop_time(1 / self.plant.sensors.rate_hz))

    def close(self) -> None:
        """Close all links."""
        for link in self._links:
            link.close()
