"""Ctrl-C is heard while collisions are drawn, not after."""

from __future__ import annotations

import signal
import time
from collections.abc import Iterator
from contextlib import contextmanager
from types import FrameType

import pytest

import bumpstop as bs
from cli.support import REPOSITORY

AFTER_S, PATIENCE_S = 1.0, 4.0


@contextmanager
def interrupted() -> Iterator[None]:
    """Soon, what Ctrl-C does."""

    def interrupt(number: int, frame: FrameType | None) -> None:
        raise KeyboardInterrupt

    before = signal.signal(signal.SIGALRM, interrupt)
    signal.setitimer(signal.ITIMER_REAL, AFTER_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@pytest.mark.parametrize("threads", [1, 2])
@pytest.mark.parametrize(
    ("name", "changes", "samples"),
    [
        # Every tick of these is played: on a fast machine they take twice as long as is waited for here.
        ("01_hand_downward.toml", {"detector.noise_correlation": 0.5}, 2_000_000),
        ("06_pick_and_place_trajectory.toml", {}, 60_000),
    ],
)
def test_an_interruption_is_heard_between_runs(
    name: str, changes: dict[str, float], samples: int, threads: int
) -> None:
    scenario = bs.load_scenario(REPOSITORY / "examples" / name).with_values(changes)
    bs.evaluate(scenario, samples=10)  # what is imported on first use
    begin = time.monotonic()
    with pytest.raises(KeyboardInterrupt), interrupted():
        bs.evaluate(scenario, samples=samples, threads=threads)
    assert time.monotonic() - begin < PATIENCE_S
