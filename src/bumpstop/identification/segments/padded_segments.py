"""Rows of stretches together with the rows beside them that a filter reaches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.segments.motion import EvenMotion, lowpass, lowpass_reach


@dataclass(frozen=True, eq=False)
class Reach:
    """Stretches one after another, each with margins that go through a filter with it and are then cut off.

    N are the rows of the stretches, M those of stretches and margins. A stretch that ends where its recording does has
    no margin there, and the filter ends with it.

    Attributes:
        motion: (M, n) of all; its rate is that of the first stretch.
        carried: (M, n) of the torque, what declared payloads make [Nm or N].
        stretches: rows of each, of M, margins included.
        kept: rows of each, of M, without margins.
        rate_hz: rows a second of each.
    """

    motion: EvenMotion
    carried: FloatArray
    stretches: tuple[slice, ...]
    kept: tuple[slice, ...]
    rate_hz: tuple[float, ...]

    @cached_property
    def bare(self) -> bool:
        """There are no margins: M is N."""
        return self.stretches == self.kept

    def within(self, x: FloatArray) -> FloatArray:
        """The N rows of stretches out of M."""
        return x if self.bare else np.concatenate([x[rows] for rows in self.kept])

    def filtered(self, x: FloatArray, cutoff_hz: float) -> FloatArray:
        """Rows (N, ...) of stretches out of columns (M, ...) after the zero-phase filter, each stretch for itself."""
        flat = x.reshape(x.shape[0], -1)
        # Most columns act on few joints: what is zero stays so.
        acting = np.flatnonzero(flat.any(axis=0))
        result = np.zeros((sum(rows.stop - rows.start for rows in self.kept), flat.shape[1]))
        start = 0
        for whole, rows, rate in zip(self.stretches, self.kept, self.rate_hz, strict=True):
            own = slice(start, start + rows.stop - rows.start)
            smooth = lowpass(flat[whole, acting], rate, cutoff_hz)
            result[own, acting] = smooth[rows.start - whole.start : rows.stop - whole.start]
            start = own.stop
        return result.reshape(-1, *x.shape[1:])

    def edges(self, within: Sequence[int]) -> list[int]:
        """Edges between parts of the N rows, as edges of M: a margin goes with the row of its stretch beside it."""
        starts = np.cumsum([0, *(rows.stop - rows.start for rows in self.kept)])
        found = []
        for edge in within:
            place = int(np.searchsorted(starts, edge, "right")) - 1
            if place == len(self.kept):
                found.append(self.motion.t.size)
            elif edge == starts[place]:
                found.append(self.stretches[place].start)
            else:
                found.append(self.kept[place].start + edge - int(starts[place]))
        return found

    def narrowed(self, cutoff_hz: float) -> Reach:
        """The same with no more of the margins than a filter at this cut-off reaches."""
        if self.bare:
            return self
        reaches = [lowpass_reach(rate, cutoff_hz) for rate in self.rate_hz]
        parts = [
            slice(max(whole.start, rows.start - reach), min(whole.stop, rows.stop + reach))
            for whole, rows, reach in zip(self.stretches, self.kept, reaches, strict=True)
        ]
        ends = np.cumsum([0, *(part.stop - part.start for part in parts)]).tolist()
        kept = [
            slice(end + rows.start - part.start, end + rows.stop - part.start)
            for end, rows, part in zip(ends, self.kept, parts, strict=False)
        ]
        places = np.concatenate([np.arange(part.start, part.stop) for part in parts])
        stretches = tuple(slice(a, b) for a, b in pairwise(ends))
        return Reach(self.motion.part(places), self.carried[places], stretches, tuple(kept), self.rate_hz)
