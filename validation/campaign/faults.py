"""Campaigns whose workers, clients, disks and files fail."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import tempfile
from collections.abc import Callable
from pathlib import Path

from validation.campaign.cell import (
    PACKAGE,
    Cell,
    cluster,
    finish,
    flip,
    is_running,
    parts,
    result,
    wait_for,
    workers_of,
)
from validation.findings import Findings

TITLE = "Faults that campaigns survive"
# What a fault leaves: how the run ended, what it said, and how many shards were computed again.
Outcome = tuple[str, bool]

_CLOCK = """
import random, time
_time, _random = time.time, random.Random()
time.time = lambda: _time() + _random.uniform(-1e7, 1e7)
"""


def compare(findings: Findings, *, quick: bool) -> None:
    """Every fault some times; the joined rows must be those of an undisturbed run, byte by byte."""
    times = 1 if quick else 3
    findings.say(
        "A campaign of 640 distributions in 32 shards, on two processes. Each fault strikes while it runs, at another "
        "place each time, or damages what it has left. Then the campaign is resumed. A row passes where rows, summary "
        "and manifest are byte for byte those of an undisturbed run, every time, and the fault was survived or named."
    )
    with tempfile.TemporaryDirectory(prefix="bumpstop-faults-") as name:
        folder = Path(name)
        cell = Cell(folder)
        status, printed = cell.run("run", cell.file, "--out", folder / "whole")
        findings.check("an undisturbed run ends", status == 0, printed.splitlines()[0] if status == 0 else printed)
        wanted = result(folder / "whole")
        rows = []
        for what, fault in FAULTS.items():
            same = named = 0
            said = ""
            for trial in range(times):
                out = folder / f"{fault.__name__}-{trial}"
                said, was_named = fault(cell, out, random.Random(trial))
                named += was_named
                same += (out / "manifest.json").is_file() and result(out) == wanted
            rows.append([what, times, named, same, said])
            findings.check(what, same == named == times, f"{same} of {times} identical, {named} named: {said}")
        findings.table(
            "Faults",
            ["Fault", "Times", "Named or survived", "Identical", "What it said"],
            ["", "d", "d", "d", ""],
            rows,
        )


def _interrupted(cell: Cell, out: Path, rng: random.Random, *options: object) -> subprocess.Popen[str]:
    """A run with some shards done."""
    process = cell.start("run", cell.file, "--out", out, *options)
    count = rng.randint(1, 12)
    wait_for(lambda: len(parts(out)) >= count or process.poll() is not None, "no shard is done")
    return process


def _resume(cell: Cell, out: Path) -> tuple[bool, str]:
    status, printed = cell.run("resume", out)
    return status == 0, printed


def _line(printed: str, word: str) -> str:
    """The line that names a fault, without paths."""
    found = next((line for line in printed.splitlines() if word in line), "")
    words = [part.rpartition("/")[2] if "/bumpstop-" in part else part for part in found.split(" ")]
    return " ".join(words)[:160]


def worker_killed(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """One of two processes is killed: the run goes on."""
    process = _interrupted(cell, out, rng)
    for worker in workers_of(process.pid)[:1]:
        os.kill(worker, signal.SIGKILL)
    status, printed = finish(process)
    return "the run went on with new workers" if status == 0 else _line(printed, "error"), status == 0


def client_killed(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """The command is killed: its processes end, and the campaign is resumed."""
    process = _interrupted(cell, out, rng)
    workers = workers_of(process.pid)
    process.kill()
    process.communicate()
    wait_for(lambda: not any(map(is_running, workers)), "workers go on without their client")
    good, _ = _resume(cell, out)
    return "its workers ended; resumed", good


def scheduler_killed(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """The scheduler of a cluster is killed: the client says so."""
    with cluster(2, cell.folder) as (address, scheduler, _):
        process = _interrupted(cell, out, rng, "--cluster", address)
        scheduler.kill()
        status, printed = finish(process)
    good, _ = _resume(cell, out)
    told = status == 0 or (status == 2 and "is lost" in printed)
    return _line(printed, "error: "), good and told and "Traceback" not in printed


def cluster_worker_killed(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """One of two workers of a cluster is killed: the run goes on."""
    with cluster(2, cell.folder) as (address, _, workers):
        process = _interrupted(cell, out, rng, "--cluster", address)
        workers[0].kill()
        status, printed = finish(process)
    return "the other worker took its shards" if status == 0 else _line(printed, "error"), status == 0


def disk_full(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """A file system of some pages, which then gets room; where none may be mounted, a limit of the size of files."""
    out.mkdir()
    size = f"{rng.choice((48, 96, 144))}k"
    if subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "none", out], capture_output=True).returncode:
        return "no file system can be mounted here", False
    try:
        status, printed = cell.run("run", cell.file, "--out", out)
        half = [path for path in out.rglob(".*") if path.is_file()]
        subprocess.run(["mount", "-o", "remount,size=64m", out], check=True)
        good, _ = _resume(cell, out)
        kept = {path.relative_to(out): path.read_bytes() for path in out.rglob("*") if path.is_file()}
    finally:
        subprocess.run(["umount", out], check=True)
    for path, content in kept.items():
        (out / path).parent.mkdir(exist_ok=True)
        (out / path).write_bytes(content)
    return _line(printed, "error"), good and status == 2 and "No space left" in printed and not half


def part_unreadable(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """A shard is there and cannot be read."""
    process = _interrupted(cell, out, rng)
    process.kill()
    process.communicate()
    part = rng.choice(parts(out))
    part.unlink()
    part.symlink_to(part.name)  # a link to itself: root, too, cannot read it
    good, printed = _resume(cell, out)
    return _line(printed, "damaged"), good and f"{part.name}' cannot be read" in printed


def part_flipped(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """A bit of a shard is flipped."""
    process = _interrupted(cell, out, rng)
    process.kill()
    process.communicate()
    part = rng.choice(parts(out))
    flip(part, rng.random())
    good, printed = _resume(cell, out)
    return _line(printed, "damaged"), good and f"{part.name}' is damaged" in printed


def rows_flipped(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """A bit of the joined rows is flipped."""
    cell.run("run", cell.file, "--out", out)
    flip(out / "rows" / "00000.parquet", rng.random())
    checked, _ = cell.run("status", out, "--check")
    good, printed = _resume(cell, out)
    return _line(printed, "damaged"), good and checked == 3 and "00000.parquet' is damaged" in printed


def manifest_flipped(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """A bit of the manifest is flipped."""
    cell.run("run", cell.file, "--out", out)
    flip(out / "manifest.json", rng.random())
    checked, listed = cell.run("status", out, "--check")
    good, printed = _resume(cell, out)
    return _line(printed, "damaged"), good and checked in (
        2,
        3,
    ) and "damaged" in listed and "damaged" in printed


def two_clients(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """A second command begins in the same folder, while the first is held up: it could have ended before."""
    process = _interrupted(cell, out, rng)
    process.send_signal(signal.SIGSTOP)
    second, printed = cell.run("run", cell.file, "--out", out)
    process.send_signal(signal.SIGCONT)
    first, _ = finish(process)
    return _line(printed, "error"), first == 0 and second == 2 and "in use" in printed


def clock_jumps(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """Every reading of the clock is another day's, in client and workers; files get dates of any year."""
    place = cell.folder / "clock"
    place.mkdir(exist_ok=True)
    (place / "sitecustomize.py").write_text(_CLOCK, encoding="utf-8")
    source = os.environ.get("PYTHONPATH", "")
    clock = {"PYTHONPATH": f"{place}{os.pathsep}{PACKAGE}{os.pathsep}{source}"}
    process = cell.start("run", cell.file, "--out", out, environment=clock)
    wait_for(lambda: len(parts(out)) >= rng.randint(1, 6) or process.poll() is not None, "no shard is done")
    process.kill()
    process.communicate()
    for part in parts(out):
        os.utime(part, (rng.uniform(0, 4e9), rng.uniform(0, 4e9)))
    status, _ = cell.run("resume", out, environment=clock)
    return "nothing depends on it", status == 0


def other_cuts(cell: Cell, out: Path, rng: random.Random) -> Outcome:
    """Shares of three, in any order, on one and four processes, then joined."""
    shares = [1, 2, 3]
    rng.shuffle(shares)
    for k in shares:
        cell.run("run", cell.file, "--out", out, "--shard", f"{k}/3", "--workers", rng.choice((1, 4)))
    status, _ = cell.run("merge", out)
    return "shares joined", status == 0


FAULTS: dict[str, Callable[[Cell, Path, random.Random], Outcome]] = {
    "kill -9 of a worker": worker_killed,
    "kill -9 of the client": client_killed,
    "kill -9 of the scheduler of a cluster": scheduler_killed,
    "kill -9 of a worker of a cluster": cluster_worker_killed,
    "disk full": disk_full,
    "a shard that cannot be read": part_unreadable,
    "a flipped bit in a shard": part_flipped,
    "a flipped bit in joined rows": rows_flipped,
    "a flipped bit in the manifest": manifest_flipped,
    "two clients on one folder": two_clients,
    "a clock that jumps": clock_jumps,
    "no fault: three shares in any order, one or four processes": other_cuts,
}
