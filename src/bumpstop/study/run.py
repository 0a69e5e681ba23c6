"""Working through the shards of a study."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.display import CURVE, LIMIT, Displayed
from bumpstop.errors import InputError
from bumpstop.study.folder import StudyFolder

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes

    from bumpstop.study.study import Study

Progress = Callable[[int, int], None]
"""Called with the shards done and all shards, first before any work."""


@dataclass(frozen=True, eq=False)
class StudyResult(Displayed):
    """What a study found. ``rows, summary = run(study)`` unpacks it.

    Attributes:
        study: the question.
        rows: of all shards, in order.
        summary: what the rows say, the object of ``--json``.
    """

    study: Study
    rows: pl.DataFrame
    summary: dict[str, Any]

    def __iter__(self) -> Iterator[Any]:
        return iter((self.rows, self.summary))

    def __str__(self) -> str:
        """What ``bumpstop study`` prints."""
        return "\n".join(self.study.lines(self.summary))

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


def run(
    study: Study, folder: Path | None = None, *, threads: int = 1, progress: Progress | None = None, command: str = ""
) -> StudyResult:
    """Compute the shards of a study that are not done yet.

    Rows and summary do not depend on ``threads``, nor on where an earlier run was interrupted.

    Args:
        study: the question.
        folder: where shards are kept as they are done, and resumed; None keeps nothing.
        threads: of this process.
        progress: told how far the study is.
        command: kept in the folder's settings.

    Raises:
        InputError: the folder holds another study or cannot be written, or a shard cannot be computed.
    """
    if threads < 1:
        raise InputError("threads", f"{threads} is too few", "wanted at least 1")
    store = None if folder is None else StudyFolder(folder, study, command)
    kept: dict[int, pl.DataFrame] = {}
    done = store.done() if store is not None else set()
    missing = [number for number in range(study.shards) if number not in done]
    count = len(done)

    def report() -> None:
        if progress is not None:
            progress(count, study.shards)

    def put(number: int, rows: pl.DataFrame) -> None:
        if store is None:
            kept[number] = rows
        else:
            store.put(number, rows)

    def put_all(numbers: list[int], shards: list[pl.DataFrame]) -> None:
        nonlocal count
        for number, rows in zip(numbers, shards, strict=True):
            put(number, rows)
        count += len(numbers)
        report()

    groups = list(_groups(missing, study.batch_size, threads))
    report()
    try:
        if threads == 1:
            for group in groups:
                put_all(group, study.shard_batch(group))
        else:
            pool = ThreadPoolExecutor(threads)
            try:
                running: dict[Future[list[pl.DataFrame]], list[int]] = {
                    pool.submit(study.shard_batch, group): group for group in groups
                }
                while running:
                    for future in wait(running, return_when=FIRST_COMPLETED).done:
                        put_all(running.pop(future), future.result())
            finally:
                # After an interruption nothing new is begun; what is done is kept.
                pool.shutdown(cancel_futures=True)
    except InputError:
        if store is not None:
            store.discard()
        raise
    if store is None:
        import polars as pl

        rows = pl.concat([kept[number] for number in range(study.shards)])
    else:
        rows = store.finish()
    summary = study.summary(rows)
    if store is not None:
        store.write_summary(summary)
    return StudyResult(study, rows, summary)


def _groups(shards: list[int], most: int, threads: int) -> Iterator[list[int]]:
    """Shards that are computed in one go: many at first, ever fewer in the end, so that all threads end together."""
    first = 0
    while first < len(shards):
        size = max(1, min(most, (len(shards) - first) // (3 * threads)))
        yield shards[first : first + size]
        first += size
