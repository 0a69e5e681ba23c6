"""Margins of blocks: which rows belong to what, and what is left of them."""

from __future__ import annotations

from itertools import pairwise

import numpy as np

from bumpstop.identification.segments.motion import REACH_SHARE, UniformMotion, lowpass, lowpass_reach
from bumpstop.identification.segments.padded_segments import PaddedSegments

RATE = 10.0
# Of a signal of 1000 rows: its beginning, which has no margin before it, then two blocks with margins.
BLOCKS, MARGINS = ((0, 150), (400, 520), (700, 800)), ((0, 100), (90, 60), (100, 100))
SIGNAL = np.random.default_rng(2).normal(size=(1000, 3)).cumsum(axis=0)


def made() -> PaddedSegments:
    """Three blocks of the signal, which stands for positions and for what is carried."""
    pieces, segments, kept, start = [], [], [], 0
    for (first, last), (before, after) in zip(BLOCKS, MARGINS, strict=True):
        pieces.append(np.arange(first - before, last + after))
        segments.append(slice(start, start + pieces[-1].size))
        kept.append(slice(start + before, start + before + last - first))
        start = segments[-1].stop
    places = np.concatenate(pieces)
    x = SIGNAL[places]
    motion = UniformMotion(places / RATE, x, x, x, RATE)
    return PaddedSegments(motion, x, tuple(segments), tuple(kept), (RATE,) * 3)


def test_margins_go_through_the_filter_and_are_cut_off() -> None:
    """Blocks out of the whole signal's filter beside those of the margins', trimmed to the filter or not."""
    reach = made()
    own = np.concatenate([SIGNAL[first:last] for first, last in BLOCKS])
    assert np.array_equal(reach.within(reach.carried), own)
    assert not reach.unpadded
    smooth = lowpass(SIGNAL, RATE, 2.0)
    wanted = np.concatenate([smooth[first:last] for first, last in BLOCKS])
    narrow = reach.trimmed(2.0)
    margin = lowpass_reach(RATE, 2.0)
    assert margin < 60
    assert narrow.motion.t.size == own.shape[0] + 5 * margin
    for some in (reach, narrow):
        filtered = some.filtered(some.carried, 2.0)
        np.testing.assert_allclose(filtered, wanted, rtol=0, atol=REACH_SHARE * np.ptp(SIGNAL))
        columns = np.stack([some.carried, 0 * some.carried], axis=2)  # one of them does nothing
        assert np.array_equal(some.filtered(columns, 2.0), np.stack([filtered, 0 * filtered], axis=2))
    # Without margins every block has ends of its own, which count far above the margins' share.
    unpadded = narrow.trimmed(100.0)
    assert unpadded.unpadded
    assert np.array_equal(unpadded.within(unpadded.carried), own)
    assert np.abs(unpadded.filtered(unpadded.carried, 2.0) - wanted).max() > 1e-3 * np.ptp(SIGNAL)


def test_parts_take_their_margins_with_them() -> None:
    """Every row of a margin is in the part of the row of its block that it lies beside."""
    reach = made()
    count = sum(last - first for first, last in BLOCKS)
    for parts in (1, 4, 7):
        edges = np.linspace(0, count, parts + 1).astype(int).tolist()
        around = np.full(reach.motion.t.size, -1)
        within = np.full(count, -1)
        for part, ((a, b), (wide_a, wide_b)) in enumerate(
            zip(pairwise(edges), pairwise(reach.edges(edges)), strict=True)
        ):
            within[a:b], around[wide_a:wide_b] = part, part
        assert np.array_equal(reach.within(around), within)
        for whole, rows in zip(reach.segments, reach.kept, strict=True):
            assert (around[whole.start : rows.start] == around[rows.start]).all()
            assert (around[rows.stop : whole.stop] == around[rows.stop - 1]).all()
    # An edge where a block ends parts the margins of both.
    assert reach.edges([0, 150, 270, count]) == [0, 250, 250 + 270, reach.motion.t.size]
