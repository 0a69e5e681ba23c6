"""Rows of segments together with the rows beside them that a filter reaches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.segments.motion import UniformMotion, lowpass, lowpass_reach


@dataclass(frozen=True, eq=False)
class PaddedSegments:
    """Segments one after another, each with margins that go through a filter with it and are then cut off.

    N are the rows of the segments, M those of segments and margins. A segment that ends where its recording does has
    no margin there, and the filter ends with it.

    Attributes:
        motion: (M, n) of all; its rate is that of the first segment.
        carried: (M, n) of the torque, what declared payloads make [Nm or N].
        segments: rows of each, of M, margins included.
        kept: rows of each, of M, without margins.
        rate_hz: rows a second of each.
    """

    motion: UniformMotion
    carried: FloatArray
    segments: tuple[slice, ...]
    kept: tuple[slice, ...]
    rate_hz: tuple[float, ...]

    @cached_property
    def unpadded(self) -> bool:
        """There are no margins: M is N."""
        return self.segments == self.kept

    def within(self, x: FloatArray) -> FloatArray:
        """The N rows of segments out of M."""
        return x if self.unpadded else np.concatenate([x[rows] for rows in self.kept])

    def filtered(self, x: FloatArray, cutoff_hz: float) -> FloatArray:
        """Rows (N, ...) of segments out of columns (M, ...) after the zero-phase filter, each segment for itself."""
        flat = x.reshape(x.shape[0], -1)
        # Most columns act on few joints: what is zero stays so.
        acting = np.flatnonzero(flat.any(axis=0))
        result = np.zeros((sum(rows.stop - rows.start for rows in self.kept), flat.shape[1]))
        start = 0
        for whole, rows, rate in zip(self.segments, self.kept, self.rate_hz, strict=True):
            own = slice(start, start + rows.stop - rows.start)
            smooth = lowpass(flat[whole, acting], rate, cutoff_hz)
            result[own, acting] = smooth[rows.start - whole.start : rows.stop - whole.start]
            start = own.stop
        return result.reshape(-1, *x.shape[1:])

    def edges(self, within: Sequence[int]) -> list[int]:
        """Edges between parts of the N rows, as edges of M: a margin goes with the row of its segment beside it."""
        starts = np.cumsum([0, *(rows.stop - rows.start for rows in self.kept)])
        found = []
        for edge in within:
            place = int(np.searchsorted(starts, edge, "right")) - 1
            if place == len(self.kept):
                found.append(self.motion.t.size)
            elif edge == starts[place]:
                found.append(self.segments[place].start)
            else:
                found.append(self.kept[place].start + edge - int(starts[place]))
        return found

    def trimmed(self, cutoff_hz: float) -> PaddedSegments:
        """The same with no more of the margins than a filter at this cut-off reaches."""
        if self.unpadded:
            return self
        reaches = [lowpass_reach(rate, cutoff_hz) for rate in self.rate_hz]
        parts = [
            slice(max(whole.start, rows.start - reach), min(whole.stop, rows.stop + reach))
            for whole, rows, reach in zip(self.segments, self.kept, reaches, strict=True)
        ]
        ends = np.cumsum([0, *(part.stop - part.start for part in parts)]).tolist()
        kept = [
            slice(end + rows.start - part.start, end + rows.stop - part.start)
            for end, rows, part in zip(ends, self.kept, parts, strict=False)
        ]
        places = np.concatenate([np.arange(part.start, part.stop) for part in parts])
        segments = tuple(slice(a, b) for a, b in pairwise(ends))
        return PaddedSegments(self.motion.part(places), self.carried[places], segments, tuple(kept), self.rate_hz)
