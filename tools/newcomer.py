"""Time a newcomer's path: a fresh clone, ``make run`` in it, the first verdict.

    python tools/newcomer.py [--limit 180] [--no-cache]

Prints the seconds of each step, the processor's time, and the longest time without a line of progress. The exit status
is 1 where no verdict came or the limit is exceeded. Compilation takes the cores that are free: what a busy machine says
of seconds is worth little, and the time of the processor more.
"""

from __future__ import annotations

import argparse
import os
import re
import resource
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# What make prints when a step begins.
STEPS = (
    ("compiling", re.compile(r"^Compiling the kernels")),
    ("installing", re.compile(r"^Installing bumpstop")),
    ("evaluating", re.compile(r"bumpstop evaluate ")),
)
VERDICT = re.compile(r"^ *(?:NOT )?ACCEPTABLE", re.MULTILINE)


@dataclass
class Walk:
    """What a newcomer waited for.

    Attributes:
        seconds: of each step, by name [s].
        silence: longest time between two lines of output of ``make run`` [s].
        processor: user and system time of all that ran [s].
        text: output of ``make run``.
        status: its exit status.
    """

    seconds: dict[str, float] = field(default_factory=dict)
    silence: float = 0.0
    processor: float = 0.0
    text: str = ""
    status: int = 0

    @property
    def total(self) -> float:
        """From nothing to the verdict [s]."""
        return sum(self.seconds.values())


def walk(source: Path, folder: Path, *, cache: bool = True) -> Walk:
    """Clone a repository and run its first example.

    Args:
        source: the repository; what is committed counts.
        folder: empty, for the clone.
        cache: whether pip may take packages that it has downloaded before.
    """
    kept = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV", "MAKEFLAGS")}
    environment = kept | {"PIP_DISABLE_PIP_VERSION_CHECK": "1"} | ({} if cache else {"PIP_NO_CACHE_DIR": "1"})
    found, begin = Walk(), time.perf_counter()
    used = _processor()
    clone = ["git", "clone", "--quiet", source.as_uri(), str(folder / "clone")]
    subprocess.run(clone, check=True, env=environment)
    step, since = "environment", time.perf_counter()
    found.seconds["clone"] = since - begin
    heard = since
    with subprocess.Popen(
        ["make", "run"],
        cwd=folder / "clone",
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    ) as running:
        assert running.stdout is not None
        for line in running.stdout:
            now = time.perf_counter()
            found.silence, heard = max(found.silence, now - heard), now
            found.text += line
            print(f"{now - begin:6.1f} s  {line.rstrip()}", flush=True)
            for name, pattern in STEPS:
                if name not in found.seconds and name != step and pattern.search(line):
                    found.seconds[step], step, since = now - since, name, now
    found.status = running.returncode
    found.seconds[step] = time.perf_counter() - since
    found.processor = _processor() - used
    return found


def _processor() -> float:
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def main(arguments: list[str] | None = None) -> int:
    """Walk the path in a temporary folder and print what it took; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--limit", type=float, default=180.0, help="seconds from nothing to the verdict")
    parser.add_argument("--no-cache", action="store_true", help="download every package anew")
    parser.add_argument("--source", type=Path, default=ROOT, help="the repository")
    options = parser.parse_args(arguments)
    with tempfile.TemporaryDirectory(prefix="newcomer-") as folder:
        found = walk(options.source.resolve(), Path(folder), cache=not options.no_cache)
    print()
    for name, seconds in found.seconds.items():
        print(f"{name:12} {seconds:7.1f} s")
    print(f"{'total':12} {found.total:7.1f} s, at most {options.limit:g} s")
    print(f"{'processor':12} {found.processor:7.1f} s; longest without a line of progress: {found.silence:.1f} s")
    if found.status or not VERDICT.search(found.text):
        print(f"no verdict: make run ended with exit status {found.status}")
        return 1
    return int(found.total > options.limit)


if __name__ == "__main__":
    sys.exit(main())
