"""Standard errors by blocks hold the truth as often as they say, also where there are few blocks."""

from __future__ import annotations

import numpy as np

from bumpstop.identification.statistics.clusters import blocks_of, clustered_covariance


def test_intervals_of_few_blocks_hold_the_truth() -> None:
    """8 blocks, one column that speaks in a few of them only: a sandwich of their scores would hold 4 of 5."""
    rng = np.random.default_rng(2)
    rows, trials = 48, 500
    columns = np.column_stack([np.ones(rows), np.linspace(-1, 1, rows), np.exp(-np.linspace(0, 6, rows))])
    held = 0
    for _ in range(trials):
        noise = rng.normal(size=rows)
        found = np.linalg.lstsq(columns, noise, rcond=None)[0]
        residual = noise - columns @ found
        assert 8 <= len(blocks_of(residual, 1)) <= 9
        held += int((np.abs(found) < 1.96 * np.sqrt(np.diag(clustered_covariance(columns, residual, 1)))).sum())
    # 95 %, less three standard errors of as many figures as there are trials: a trial's three share its noise.
    assert 0.92 < held / (3 * trials) < 0.98
