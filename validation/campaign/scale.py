"""How the cost of a campaign grows with distributions and workers."""

from __future__ import annotations

import os
import re
import resource
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from statistics import median

from bumpstop.campaign import load_campaign
from bumpstop.shards import ResultFolder, Workers
from bumpstop.shards.run import Account, complete
from validation.campaign.cell import Cell
from validation.findings import Findings

TITLE = "What campaigns cost"
_SHARDS = 1000


def compare(findings: Findings, *, quick: bool) -> None:
    """Two workers against one, overhead of a shard, memory over a thousand shards."""
    with tempfile.TemporaryDirectory(prefix="bumpstop-scale-") as name:
        folder = Path(name)
        _throughput(findings, folder, pairs=1 if quick else 5, poses=40 if quick else 800)
        _memory(findings, folder, shards=50 if quick else _SHARDS)


def _throughput(findings: Findings, folder: Path, *, pairs: int, poses: int) -> None:
    """Paired runs, one after the other, so that both meet the same neighbours."""
    cell = Cell(folder, poses=poses, shard_s=1.0 if poses > 100 else 0.1)
    ratios, overheads, seconds, shards, shard_s = [], [], [], 0, 0.0
    for pair in range(pairs):
        found = {}
        for workers in (1, 2) if pair % 2 else (2, 1):
            account, found[workers] = _run(cell, folder / f"{pair}-{workers}", workers)
            if workers == 1:
                overheads.append((found[1] - account.seconds) / found[1])
                seconds.append(account.seconds / account.rows)
                shards, shard_s = account.shards, account.seconds / account.shards
        ratios.append(found[1] / found[2])
        findings.progress(f"pair {pair + 1}: ratio {ratios[-1]:.3f}, overhead {100 * overheads[-1]:.2f} %")
    load = os.getloadavg()[0]
    findings.check(
        "two workers have at least 1.9 times the throughput of one",
        median(ratios) >= 1.9,
        f"median {median(ratios):.3f} of {pairs} pairs, {min(ratios):.3f} to {max(ratios):.3f}; load {load:.1f}",
    )
    each = median(overheads)
    findings.check(
        "overhead is below 2 % of a run of one worker, its start and the joining of rows included",
        each < 0.02,
        f"median {100 * each:.2f} % of {shards} shards of {shard_s:.2f} s",
    )
    findings.figures["seconds_per_distribution"] = median(seconds)
    findings.table(
        "What 10^9 distributions take, from the measured time of one",
        ["Workers", "Days"],
        ["d", ".3g"],
        [[n, median(seconds) * 1e9 / n / 86400] for n in (1, 10, 100, 1000)],
    )


def _run(cell: Cell, out: Path, workers: int) -> tuple[Account, float]:
    campaign = load_campaign(cell.file)
    store = ResultFolder(out, campaign)
    store.open(campaign)
    begin = time.perf_counter()
    _, account = complete(campaign, store, Workers(processes=workers))
    return account, time.perf_counter() - begin


def _memory(findings: Findings, folder: Path, *, shards: int) -> None:
    """Resident memory of client and worker, which are one process here, over many shards, and while they are joined."""
    cell = Cell(folder, poses=max(1, shards // 32), shard_s=0.001 * 16 * 2)
    campaign = load_campaign(cell.file)
    store = ResultFolder(folder / "many", campaign)
    store.open(campaign)
    found: list[tuple[int, float]] = []
    complete(campaign, store, Workers(), progress=lambda done, total: found.append((done, _resident_mb())))
    tenth = max(1, len(found) // 10)
    early, late = median(mb for _, mb in found[tenth : 2 * tenth]), median(mb for _, mb in found[-tenth:])
    findings.check(
        f"memory is flat over {campaign.shards} shards",
        late - early < 20,
        f"{early:.0f} MB in the second tenth, {late:.0f} MB in the last, {_peak_mb():.0f} MB at most, joining included",
    )


def _resident_mb() -> float:
    (kb,) = _numbers("VmRSS")
    return kb / 1e3


def _numbers(name: str) -> Iterator[float]:
    text = Path("/proc/self/status").read_text(encoding="ascii")
    yield from (float(found) for found in re.findall(rf"^{name}:\s+(\d+)", text, re.MULTILINE))


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
