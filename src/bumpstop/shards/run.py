"""Working through the shards of a job."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, TypeVar

from bumpstop.display import CURVE, LIMIT, Displayed
from bumpstop.errors import InputError
from bumpstop.shards.result_folder import DamagedError, ResultFolder
from bumpstop.shards.sharded_job import ShardedJob
from bumpstop.shards.storage import Location
from bumpstop.shards.workers import Receipt, Workers

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes

Progress = Callable[[int, int], None]
"""Called with the shards done and all shards, first before any work."""
Job = TypeVar("Job", bound=ShardedJob)


@dataclass(frozen=True, eq=False)
class JobResult(Displayed, Generic[Job]):
    """What a job found. ``rows, summary = run(job)`` unpacks it.

    Attributes:
        study: the job.
        rows: of all shards, in order.
        summary: what the rows say, the object of ``--json``.
    """

    study: Job
    rows: pl.DataFrame
    summary: dict[str, Any]

    def __iter__(self) -> Iterator[Any]:
        return iter((self.rows, self.summary))

    def __str__(self) -> str:
        """What the command prints."""
        return self.study.text(self.summary)

    def to_frame(self) -> pl.DataFrame:
        """The rows, as a data frame."""
        return self.rows

    def _draw(self, axes: Axes) -> None:
        """Draw peak force against the first varied key, or how the first force or speed of the rows is distributed."""
        if "kind" in self.rows.columns and "p99_N" in self.rows.columns:
            sweep = self.rows.filter(self.rows["kind"] == "sweep")
            key = sweep["key"][0]
            points = sweep.filter(sweep["key"] == key).sort("value")
            axes.plot(points["value"].to_numpy(), points["mean_N"].to_numpy(), color=CURVE, label="mean")
            axes.plot(points["value"].to_numpy(), points["p99_N"].to_numpy(), "--", color=LIMIT, label="99 %")
            axes.set(xlabel=key, ylabel="peak force, N", ylim=(0, None))
            axes.legend()
            return
        column = next(name for ending in ("_N", "_mm_s") for name in self.rows.columns if name.endswith(ending))
        values = self.rows[column].drop_nulls().to_numpy()
        axes.ecdf(values[values < float("inf")], color=CURVE)
        axes.set(xlabel=column, ylabel="share of rows below")


@dataclass
class Account:
    """What a run did.

    Attributes:
        shards: computed.
        rows: of them.
        size: bytes of their files.
        seconds: that workers spent on them, added up.
        damaged: files that were not what had been written, and what was wrong with each.
    """

    shards: int = 0
    rows: int = 0
    size: int = 0
    seconds: float = 0.0
    damaged: list[str] = field(default_factory=list)

    def add(self, receipts: list[Receipt]) -> None:
        """Count shards that are done."""
        self.shards += len(receipts)
        self.rows += sum(receipt.rows for receipt in receipts)
        self.size += sum(receipt.size for receipt in receipts)
        self.seconds += sum(receipt.seconds for receipt in receipts)


def run(
    job: Job,
    folder: Location | None = None,
    *,
    threads: int = 1,
    progress: Progress | None = None,
    command: str = "",
) -> JobResult[Job]:
    """Compute the shards of a job that are not done yet, on threads, and join them.

    Rows and summary do not depend on ``threads``, nor on where an earlier run was interrupted.

    Args:
        job: the question.
        folder: where shards are kept as they are done, and resumed; None keeps nothing.
        threads: of this process.
        progress: told how far the job is.
        command: kept in the folder's settings.

    Raises:
        InputError: the folder holds another job, is in use or cannot be written, a file in it is damaged, or a shard
            cannot be computed.
    """
    import polars as pl

    workers = Workers(threads=threads)
    if folder is None:
        kept: dict[int, pl.DataFrame] = {}

        def keep(receipts: list[Receipt]) -> None:
            kept.update({each.number: each.kept for each in receipts if each.kept is not None})
            told(len(kept))

        def told(count: int) -> None:
            if progress is not None:
                progress(count, job.shards)

        told(0)
        workers.compute(job, None, list(groups_of(list(range(job.shards)), job.batch_size, threads)), keep)
        rows = pl.concat([kept[number] for number in range(job.shards)])
        return JobResult(job, rows, job.summarise([rows]))
    store = ResultFolder(folder, job)
    store.open(job, command)
    volumes: list[pl.DataFrame] = []

    def summarise(found: Iterator[pl.DataFrame]) -> dict[str, Any]:
        volumes.extend(found)
        return job.summarise(volumes)

    with store.storage.lock(None):
        compute_missing(job, store, workers, progress=progress)
        summary = store.finish(summarise)
    return JobResult(job, pl.concat(volumes), summary)


def compute_missing(
    job: ShardedJob,
    store: ResultFolder,
    workers: Workers,
    *,
    share: tuple[int, int] = (1, 1),
    progress: Progress | None = None,
) -> Account:
    """Compute the shards that the folder lacks.

    Args:
        job: whose.
        store: its folder, opened and locked.
        workers: who compute.
        share: (k, n) takes the k-th of n equal shares of all shards, counted from 1.
        progress: told the shards of the share that are done, and all of it.

    Raises:
        InputError: a shard cannot be computed or kept; what is done stays.
    """
    k, n = share
    wanted = range(k - 1, job.shards, n)
    done = store.done()
    missing = [number for number in wanted if number not in done]
    account = Account()

    def told() -> None:
        if progress is not None:
            progress(len(wanted) - len(missing) + account.shards, len(wanted))

    def keep(receipts: list[Receipt]) -> None:
        account.add(receipts)
        told()

    told()
    try:
        workers.compute(job, store, list(groups_of(missing, job.batch_size, workers.count)), keep)
    except InputError:
        # Other shares, or workers elsewhere, may compute in the folder although none of their shards is there yet.
        if n == 1 and not workers.cluster:
            store.discard()
        raise
    return account


def complete(
    job: ShardedJob, store: ResultFolder, workers: Workers, *, progress: Progress | None = None
) -> tuple[dict[str, Any], Account]:
    """Compute what is missing and join it; what is damaged is removed, named in the account, and computed again.

    Returns:
        The summary, and what was done.

    Raises:
        InputError: a shard cannot be computed or kept, or what was computed again is damaged again.
    """
    total, dropped = Account(), set[str]()
    while True:
        try:
            part = compute_missing(job, store, workers, progress=progress)
            total.shards, total.rows = total.shards + part.shards, total.rows + part.rows
            total.size, total.seconds = total.size + part.size, total.seconds + part.seconds
            return store.finish(job.summarise), total
        except DamagedError as damaged:
            if damaged.name in dropped:
                problem = f"{damaged.problem}, although it was written anew"
                raise InputError("--out", problem, "give another folder") from None
            dropped.add(damaged.name)
            total.damaged.append(damaged.problem)
            store.drop(damaged)


def groups_of(shards: list[int], most: int, workers: int) -> Iterator[list[int]]:
    """Shards that are computed in one go: many at first, ever fewer in the end, so that all workers end together."""
    first = 0
    while first < len(shards):
        size = max(1, min(most, (len(shards) - first) // (3 * workers)))
        yield shards[first : first + size]
        first += size
