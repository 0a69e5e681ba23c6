"""How the cost of a campaign grows with distributions and workers."""

from __future__ import annotations

import os
import re
import resource
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from statistics import median

import numpy as np
import polars as pl

from bumpstop.campaign import Campaign, load_campaign
from bumpstop.shards import ResultFolder, Workers
from bumpstop.shards.run import complete
from validation.campaign.cell import Cell
from validation.findings import Findings

TITLE = "What campaigns cost"
_SHARDS = 1000


class TimedCampaign(Campaign):
    """A campaign that counts the time of the processor that its distributions take; the rest is overhead."""

    def distributions(self, setup: int, motions: range) -> pl.DataFrame:
        """As of any campaign."""
        begin = time.process_time()
        try:
            return super().distributions(setup, motions)
        finally:
            _SPENT.append(time.process_time() - begin)


_SPENT: list[float] = []


def compare(findings: Findings, *, quick: bool) -> None:
    """Overhead of a shard and memory over a thousand shards, then two workers against one."""
    with tempfile.TemporaryDirectory(prefix="bumpstop-scale-") as name:
        folder = Path(name)
        _many_shards(findings, folder, shards=50 if quick else _SHARDS)
        _throughput(findings, folder, pairs=1 if quick else 3, poses=40 if quick else 2000)


def _many_shards(findings: Findings, folder: Path, *, shards: int) -> None:
    """Small shards of one process: what each costs besides its distributions, and what memory they leave."""
    cell = Cell(folder, poses=max(1, shards // 8), shard_s=0.004)
    made = load_campaign(cell.file)
    campaign = TimedCampaign(**{field.name: getattr(made, field.name) for field in fields(made)})
    store = ResultFolder(folder / "many", campaign)
    found: list[tuple[int, float]] = []
    _SPENT.clear()
    begin = time.process_time()
    store.open(campaign)
    _, account = complete(campaign, store, Workers(), progress=lambda done, total: found.append((done, _resident_mb())))
    overhead = (time.process_time() - begin - sum(_SPENT)) / account.shards
    findings.check(
        "overhead is below 2 % of a shard of ten seconds, its file, checksum and the joining of rows included",
        overhead < 0.02 * 10,
        f"{1e3 * overhead:.2f} ms of the processor, {overhead / 10:.4%} of ten seconds; {account.shards} shards",
    )
    tenth = max(1, len(found) // 10)
    early, late = median(mb for _, mb in found[tenth : 2 * tenth]), median(mb for _, mb in found[-tenth:])
    findings.check(
        f"memory is flat over {account.shards} shards",
        late - early < 20,
        f"{early:.0f} MB in the second tenth, {late:.0f} MB in the last, {_peak_mb():.0f} MB at most, joining included",
    )
    each = sum(_SPENT) / account.rows
    findings.figures["seconds_per_distribution"] = each
    days = [[n, 1e3 * each, each * 1e9 / n / 86400] for n in (1, 10, 100, 1000)]
    headings = ["Workers", "ms a distribution", "Days"]
    findings.table("What 10^9 distributions take, from the measured time of one", headings, ["d", ".3g", ".3g"], days)
    findings.say(f"A distribution took {1e3 * each:.3f} ms of the processor in the mean of {account.rows}.")
    findings.progress(f"{1e3 * each:.3f} ms a distribution, {account.size / account.rows:.0f} bytes a row in shards")


@dataclass(frozen=True)
class Timing:
    """How long a campaign took with some workers.

    Attributes:
        whole: start of the processes and joining included [s].
        steady: from a tenth of the shards to nine tenths, the same ones whoever computes them [s].
        spent: what the workers took for all shards, added up [s].
    """

    whole: float
    steady: float
    spent: float

    def told(self, workers: int) -> str:
        """Steady and whole time, and the share of the whole that workers spent on shards."""
        return f"{self.steady:.2f} of {self.whole:.2f} s, {self.spent / (workers * self.whole):.1%} of it on shards"


def _throughput(findings: Findings, folder: Path, *, pairs: int, poses: int) -> None:
    """Paired runs, one after the other, so that both meet the same neighbours."""
    cell = Cell(folder, poses=poses, shard_s=0.2)
    steady, whole, dearer = [], [], []
    for pair in range(pairs):
        of = {n: _timed(cell, folder / f"{pair}-{n}", n) for n in ((1, 2) if pair % 2 else (2, 1))}
        steady.append(of[1].steady / of[2].steady)
        whole.append(of[1].whole / of[2].whole)
        dearer.append(of[2].spent / of[1].spent)
        findings.progress(
            f"pair {pair + 1}: one {of[1].told(1)}; two {of[2].told(2)}; ratio {steady[-1]:.3f}, whole {whole[-1]:.3f}"
        )
    findings.check(
        "two workers have at least 1.9 times the throughput of one",
        median(steady) >= 1.9,
        f"median {median(steady):.3f} of {pairs} pairs, {min(steady):.3f} to {max(steady):.3f}; "
        f"with start and joining {median(whole):.3f}; a shard takes {median(dearer):.3f} times as long beside another; "
        f"load of the machine {os.getloadavg()[0]:.1f} on {os.cpu_count()} cores",
    )


def _timed(cell: Cell, out: Path, workers: int) -> Timing:
    campaign = load_campaign(cell.file)
    store = ResultFolder(out, campaign)
    store.open(campaign)
    reached: list[tuple[float, float]] = []
    begin = time.perf_counter()
    _, account = complete(
        campaign,
        store,
        Workers(processes=workers),
        progress=lambda done, total: reached.append((done / total, time.perf_counter() - begin)),
    )
    whole = time.perf_counter() - begin
    done, when = zip(*reached, strict=True)
    first, last = np.interp([0.1, 0.9], done, when)
    return Timing(whole, float(last - first), account.seconds)


def _resident_mb() -> float:
    (kb,) = _numbers("VmRSS")
    return kb / 1e3


def _numbers(name: str) -> Iterator[float]:
    text = Path("/proc/self/status").read_text(encoding="ascii")
    yield from (float(found) for found in re.findall(rf"^{name}:\s+(\d+)", text, re.MULTILINE))


def _peak_mb() -> float:
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
