"""What a campaign will take, from a measured part of it."""

from __future__ import annotations

import io
import time
from dataclasses import dataclass
from typing import Any

from bumpstop.campaign.campaign import Campaign

# Shards that are measured, evenly spaced, and the share of each.
_MEASURED = 5
_SHARE = 0.1


@dataclass(frozen=True)
class Estimate:
    """What a campaign will take here.

    Attributes:
        distributions: how many.
        shards: how many.
        shard_s: time of a shard on one worker [s].
        workers: that compute at once.
        seconds: of the whole campaign [s].
        part_bytes: of all shards while it runs.
        result_bytes: of the joined rows.
        measured: distributions that were computed for this.
    """

    distributions: int
    shards: int
    shard_s: float
    workers: int
    seconds: float
    part_bytes: float
    result_bytes: float
    measured: int

    def to_json(self) -> dict[str, Any]:
        """The same by name."""
        return dict(self.__dict__)

    def lines(self) -> list[str]:
        """For people."""
        return [
            f"{self.distributions} distributions in {self.shards} shards of about {self.shard_s:.3g} s here",
            f"{_duration(self.seconds)} on {self.workers} workers, by {self.measured} distributions computed now",
            f"{_size(self.part_bytes)} while it runs, {_size(self.result_bytes)} of joined rows",
        ]


def estimate(campaign: Campaign, workers: int = 1) -> Estimate:
    """Measure parts of some shards.

    Args:
        campaign: of which.
        workers: that will compute at once; each is taken to be as fast as this process is alone.
    """
    import polars as pl

    numbering = campaign.numbering
    shards = sorted({round(i * (numbering.shards - 1) / (_MEASURED - 1)) for i in range(_MEASURED)})
    seconds = nominal_s = 0.0
    found = []
    for shard in shards:
        slices = numbering.slices(shard)
        setup, motions = max(slices, key=lambda each: len(each[1]))
        part = motions[: max(1, round(_SHARE * len(motions)))]
        campaign.distributions(setup, part[:1])  # what a worker does once is not counted
        begin = time.perf_counter()
        found.append(campaign.distributions(setup, part))
        seconds += time.perf_counter() - begin
        nominal_s += 1e-6 * numbering.costs[setup] * len(part)
    rows = pl.concat(found)
    stream, joined = io.BytesIO(), io.BytesIO()
    rows.write_ipc_stream(stream)
    rows.write_parquet(joined)
    total_s = seconds / nominal_s * 1e-6 * numbering.motions * sum(numbering.costs)
    each = numbering.distributions / rows.height
    return Estimate(
        distributions=numbering.distributions,
        shards=numbering.shards,
        shard_s=total_s / numbering.shards,
        workers=workers,
        seconds=total_s / min(workers, numbering.shards),
        part_bytes=stream.tell() * each,
        result_bytes=joined.tell() * each,
        measured=rows.height,
    )


def _duration(seconds: float) -> str:
    for unit, size in (("days", 86400.0), ("h", 3600.0), ("min", 60.0)):
        if seconds >= 2 * size:
            return f"{seconds / size:.3g} {unit}"
    return f"{seconds:.3g} s"


def _size(size: float) -> str:
    for unit, each in (("TB", 1e12), ("GB", 1e9), ("MB", 1e6)):
        if size >= each:
            return f"{size / each:.3g} {unit}"
    return f"{size / 1e3:.3g} kB"
