"""A quantile of many small cells needs no second copy of them: those of a very soft body have a hundred megabytes."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

pytestmark = pytest.mark.skipif(not Path("/proc/self/status").exists(), reason="asks Linux what memory it took")

# Forces between 0.1 and 0.1001 N: half of what is below the greatest holds nearly all of them, again and again.
_WORK = """
import re
from pathlib import Path
import numpy as np
from bumpstop import _native
from bumpstop.view.freed_memory import trim_freed_memory
def most():
    return int(re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1e3
count = 500_000
low = 0.1 + 1e-4 * np.arange(count) / count
mass = np.full(count, 1 / count)
cells = _native.CellMixture(low, low + 1e-10, mass, low[:1], mass[:1])
trim_freed_memory()
Path("/proc/self/clear_refs").write_text("5")  # from now on
before = most()
print(repr(cells.upper_quantile(0.25)), most() - before)
"""


def test_a_quantile_takes_little_memory() -> None:
    run = subprocess.run([sys.executable, "-c", _WORK], capture_output=True, text=True, timeout=120, check=True)
    quantile, taken_MB = map(float, run.stdout.split())
    assert quantile == pytest.approx(0.100075, abs=1e-9)
    # All cells have 12 MB.
    assert taken_MB < 4
