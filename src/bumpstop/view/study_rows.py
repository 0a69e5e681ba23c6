"""The rows of a study, shard by shard, for as long as somebody waits for them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Callable

    import polars as pl

    from bumpstop.study import TrajectorySpeedLimits


def study_rows(
    study: TrajectorySpeedLimits, stopped: Callable[[], bool], progress: Callable[[float], None] = lambda share: None
) -> pl.DataFrame | None:
    """All rows; None where nobody waits.

    Args:
        study: to be computed.
        stopped: asked before every shard.
        progress: told the share that is done.

    Raises:
        InputError: a shard cannot be computed.
    """
    import polars as pl

    shards = []
    for shard in range(study.shards):
        if stopped():
            return None
        shards.append(study.shard(shard))
        progress((shard + 1) / study.shards)
    return pl.concat(shards)
