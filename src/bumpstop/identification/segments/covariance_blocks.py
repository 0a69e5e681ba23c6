"""Segments of recordings between gaps, and the blocks of them that stand for all."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from bumpstop.identification.segments.motion import UniformGrid

# Of recordings with more rows than are wanted so many blocks stand for the whole, each of no fewer rows than that.
_BLOCKS, _MIN_BLOCK = 20, 200


@dataclass(frozen=True, eq=False)
class Segment:
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
    grid: UniformGrid
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


def blocks_of_segments(segments: list[Segment], limit: int | None) -> list[tuple[Segment, slice]]:
    """What is taken of segments: each with some of its kept rows.

    Args:
        segments: of all recordings, in their order.
        limit: rows that are enough; no more than twice as many are taken. None: all.
    """
    if limit is None or sum(segment.size for segment in segments) <= limit:
        return [(segment, segment.used) for segment in segments]
    # Of very many segments every so manieth, counted from the first of each recording.
    every = math.ceil(sum(min(segment.size, _MIN_BLOCK) for segment in segments) / limit)
    firsts = {segment.recording: place for place, segment in reversed(list(enumerate(segments)))}
    kept = [own for place, own in enumerate(segments) if (place - firsts[own.recording]) % every == 0]
    total = sum(segment.size for segment in kept)
    found: list[tuple[Segment, slice]] = []
    for segment in kept:
        own = max(limit * segment.size / total, _MIN_BLOCK)
        if own >= segment.size:
            found.append((segment, segment.used))
            continue
        count = max(1, min(round(_BLOCKS * segment.size / total), int(own / _MIN_BLOCK)))
        length = int(own / count)
        room = segment.size - length
        starts = np.linspace(0, room, count) if count > 1 else np.array([room / 2])
        found += [
            (segment, slice(start, start + length)) for start in (segment.used.start + starts.astype(int)).tolist()
        ]
    return found
