"""The distributions of a campaign that come nearest to their limits, for the warnings beside its shares."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    import polars as pl


class NearestRows:
    """By setup, the acceptable row with the greatest bounded p99.9: finer steps would be the first to refuse it.

    Attributes:
        of_setup: the rows by number of the setup; none of a setup without an acceptable one.
    """

    def __init__(self) -> None:
        self.of_setup: dict[int, Mapping[str, Any]] = {}

    def passing(self, volumes: Iterable[pl.DataFrame]) -> Iterator[pl.DataFrame]:
        """Yield the volumes as they are, having looked at each."""
        for rows in volumes:
            self._include(rows)
            yield rows

    def _include(self, rows: pl.DataFrame) -> None:
        within = rows.filter(rows["acceptable"].fill_null(value=False) & rows["p999_N"].is_finite())
        # Of equal forces the first, however the volumes are cut.
        order = ["p999_N", "pose", "direction", "speed_mm_s"]
        last = within.sort(order, descending=[False, True, True, True]).group_by("setup", maintain_order=True).last()
        for row in last.iter_rows(named=True):
            known = self.of_setup.get(row["setup"])
            if known is None or row["p999_N"] > known["p999_N"]:
                self.of_setup[row["setup"]] = row
