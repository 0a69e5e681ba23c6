"""Distributions of many small cells: a quantile needs no second copy of them, and of very many a histogram is kept."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from bumpstop import _native

# Forces between 0.1 and 0.1001 N: half of what is below the greatest holds nearly all of them, again and again.
_WORK = """
import re
from pathlib import Path
import numpy as np
from bumpstop import _native
from bumpstop.view.freed_memory import trim_freed_memory
def most():
    return int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1e3
count = 250_000
low = 0.1 + 1e-4 * np.arange(count) / count
mass = np.full(count, 1 / count)
cells = _native.CellMixture(low, low + 1e-10, mass, low[:1], mass[:1])
trim_freed_memory()
Path("/proc/self/clear_refs").write_text("5")  # from now on
before = most()
print(repr(cells.upper_quantile(0.25)), most() - before)
"""


@pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux what memory it took")
def test_a_quantile_takes_little_memory() -> None:
    run = subprocess.run([sys.executable, "-c", _WORK], capture_output=True, text=True, timeout=120, check=True)
    quantile, taken_MB = map(float, run.stdout.split())
    assert quantile == pytest.approx(0.100075, abs=1e-9)
    # All cells have 6 MB.
    assert taken_MB < 2


@pytest.mark.parametrize("widest", [1e-7, 1e-4, 3.0])
def test_a_histogram_takes_the_place_of_very_many(widest: float) -> None:
    # Forces about 130 N, in the order of control cycles; no force for some; some unbounded.
    rng, count = np.random.default_rng(3), 600_000
    low = np.concatenate([[0.0], np.sort(rng.gamma(9.0, 4.0, count)) + 94, [np.inf]])
    high = low + np.concatenate([[0.0], rng.uniform(0, widest, count), [0.0]])
    mass = np.concatenate([[0.2 * count], rng.exponential(size=count), [7e-6 * count]])
    mass /= mass.sum()
    cells = _native.CellMixture(low, high, mass, low[:-1], mass[:-1])

    def above(x: float) -> float:
        # What of a cell lies beyond; a point as a whole or not at all.
        width = np.maximum(high[1:-1] - low[1:-1], 1e-300)
        return float(mass[-1] + mass[0] * (x < 0) + mass[1:-1] @ np.clip((high[1:-1] - x) / width, 0, 1))

    bin_width = (high[-2] - 0.0) / 2**16
    assert cells.above(0.0) == pytest.approx(1 - mass[0], rel=1e-12)
    for x in rng.uniform(94, 220, 40):
        # Exact at the ends of a bin, and so between what is beyond them.
        assert above(x + bin_width) <= cells.above(x) * (1 + 1e-9) <= above(x - bin_width) * (1 + 2e-9)
    for p in (0.5, 1e-2, 1e-4, 1e-5):
        assert above(cells.upper_quantile(p) + bin_width) <= p <= above(cells.upper_quantile(p) - bin_width)
    mean = np.average(low[:-1], weights=mass[:-1])
    sd = np.sqrt(np.average((low[:-1] - mean) ** 2, weights=mass[:-1]))
    assert (cells.mean, cells.sd) == pytest.approx((mean, sd), rel=1e-12)
