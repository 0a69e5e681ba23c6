"""Stretches of recordings between gaps, and the blocks of them that stand for all."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bumpstop.identification.segments.motion import EvenGrid

# Of recordings with more rows than are wanted so many blocks stand for the whole, each of no fewer rows than that.
_BLOCKS, _MIN_BLOCK = 20, 200


@dataclass(frozen=True, eq=False)
class Stretch:
    """A part of a recording between gaps.

    Attributes:
        recording: its number.
        rows: of it.
        grid: even times over them.
        stride: of how many of these one is kept behind the filter.
        used: of the kept ones those that are used: not beside a gap.
    """

    recording: int
    rows: slice
    grid: EvenGrid
    stride: int
    used: slice

    @property
    def size(self) -> int:
        """Rows that are used."""
        return int(self.used.stop - self.used.start)

    @property
    def rate_hz(self) -> float:
        """Kept rows a second."""
        return self.grid.rate_hz / self.stride


def blocks_of_stretches(stretches: list[Stretch], limit: int | None) -> list[tuple[Stretch, slice]]:
    """What is taken of stretches: each with some of its kept rows.

    Args:
        stretches: of all recordings, in their order.
        limit: rows that are enough; no more than twice as many are taken. None: all.
    """
    if limit is None or sum(stretch.size for stretch in stretches) <= limit:
        return [(stretch, stretch.used) for stretch in stretches]
    # Of very many stretches every so manieth, counted from the first of each recording.
    every = math.ceil(sum(min(stretch.size, _MIN_BLOCK) for stretch in stretches) / limit)
    firsts = {stretch.recording: place for place, stretch in reversed(list(enumerate(stretches)))}
    kept = [own for place, own in enumerate(stretches) if (place - firsts[own.recording]) % every == 0]
    total = sum(stretch.size for stretch in kept)
    found: list[tuple[Stretch, slice]] = []
    for stretch in kept:
        own = max(limit * stretch.size / total, _MIN_BLOCK)
        if own >= stretch.size:
            found.append((stretch, stretch.used))
            continue
        count = max(1, min(round(_BLOCKS * stretch.size / total), int(own / _MIN_BLOCK)))
        length = int(own / count)
        room = stretch.size - length
        starts = np.linspace(0, room, count) if count > 1 else np.array([room / 2])
        found += [
            (stretch, slice(start, start + length)) for start in (stretch.used.start + starts.astype(int)).tolist()
        ]
    return found
