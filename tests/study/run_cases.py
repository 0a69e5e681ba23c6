"""A study that is cheap, and random in a way that shows any disorder."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import polars as pl

from bumpstop.study import Study


@dataclass(frozen=True)
class Squares(Study):
    """Squares of drawn numbers; cheap, and random in a way that shows any disorder."""

    name: ClassVar[str] = "squares"
    title: ClassVar[str] = "squares"
    seed: int = 0
    count: int = 7
    factors: tuple[float, ...] = (1.0, 2.0)

    @property
    def shards(self) -> int:
        return self.count

    def shard(self, number: int) -> pl.DataFrame:
        rng = np.random.Generator(np.random.Philox(key=self.seed, counter=[0, 0, 0, number]))
        x = rng.normal(size=5)
        return pl.DataFrame({"shard": np.full(5, number), "x": x, "square": x**2})

    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:
        return {"sum": float(rows["square"].sum()), "nothing": float("nan")}

    def lines(self, summary: Mapping[str, Any]) -> list[str]:
        return [f"sum {summary['sum']:.6f}", "done"]
