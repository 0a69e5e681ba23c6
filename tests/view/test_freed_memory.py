"""Threads that compute scenarios of all sizes do not hold what they have freed."""

from __future__ import annotations

import platform
import subprocess
import sys

import pytest

pytestmark = pytest.mark.skipif(platform.libc_ver()[0] != "glibc", reason="about glibc's areas of memory")

# Eight threads: each frees a large block, then fills 60 MB with smaller ones, and frees all but a crumb that came last.
_WORK = """
import re, sys, threading
from pathlib import Path
import numpy as np
from bumpstop.view.freed_memory import return_freed_memory
if sys.argv[1] == "returned":
    return_freed_memory()
def resident():
    return int(re.search(r"VmRSS:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1e3
crumbs, waiting = [], threading.Event()
def work():
    large = np.ones(3_000_000)
    del large
    blocks = [np.ones(250_000) for _ in range(30)]
    crumbs.append(np.ones(2000))
    del blocks
    done.set()
    waiting.wait(60)
before = resident()
threads = []
for _ in range(8):
    done = threading.Event()
    threads.append(threading.Thread(target=work))
    threads[-1].start()
    done.wait(60)
print(resident() - before)
waiting.set()
"""


@pytest.mark.parametrize(("how", "low", "high"), [("returned", -5.0, 20.0), ("kept", 200.0, 600.0)])
def test_memory_of_threads_is_returned(how: str, low: float, high: float) -> None:
    run = subprocess.run([sys.executable, "-c", _WORK, how], capture_output=True, text=True, timeout=120, check=True)
    assert low < float(run.stdout) < high


# Blocks of half a megabyte between crumbs that stay.
_BETWEEN = """
import re
from pathlib import Path
import numpy as np
from bumpstop.view.freed_memory import return_freed_memory, trim_freed_memory
return_freed_memory()
def resident():
    return int(re.search(r"VmRSS:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]) / 1e3
before = resident()
blocks, crumbs = [], []
for _ in range(120):
    blocks.append(np.ones(60_000))
    crumbs.append(np.ones(2000))
del blocks
print(resident() - before)
trim_freed_memory()
print(resident() - before)
"""


def test_memory_between_blocks_in_use_is_given_back() -> None:
    run = subprocess.run([sys.executable, "-c", _BETWEEN], capture_output=True, text=True, timeout=120, check=True)
    freed, trimmed = map(float, run.stdout.split())
    assert freed > 50
    assert trimmed < 10
