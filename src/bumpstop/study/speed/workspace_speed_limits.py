"""The highest safe speed at random poses all over the workspace."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision import Scenario
from bumpstop.errors import InputError
from bumpstop.study.answer_warnings import FAILS_WITH_FINER_STEPS, AnswerWarnings
from bumpstop.study.joint_ranges import joint_ranges
from bumpstop.study.speed.speed_map import SHARD_ROWS, SpeedMap
from bumpstop.study.speed.worst_direction import worst_directions
from bumpstop.terminal import no_more_than

if TYPE_CHECKING:
    from collections.abc import Mapping

    import polars as pl

# Worst directions take longer than rows of a trajectory; poses are drawn in blocks of SHARD_ROWS.
_SHARD_POSES = 10
MAX_POSES = 10_000_000


@dataclass(frozen=True)
class WorkspaceSpeedLimits(SpeedMap):
    """A row for every random pose: the highest speed that is safe in all directions of a cone, or in every direction.

    Attributes:
        poses: number of them, each joint even between its limits; a joint without limits turns once.
        seed: of the poses.
    """

    poses: int = 1000
    cone_deg: float = 180.0
    seed: int = 0

    def __post_init__(self) -> None:
        if self.scenario.motion.kind != "line":
            raise InputError("--poses", "has no meaning with a trajectory", "leave it out, or give a line")
        if not 1 <= self.poses <= MAX_POSES:
            raise InputError("--poses", f"{self.poses} cannot be used", f"wanted 1 to {MAX_POSES}")
        self._check()
        joint_ranges(self._line_problem)

    @cached_property
    def _line(self) -> Scenario:
        return self.scenario

    @property
    def shards(self) -> int:  # noqa: D102
        return math.ceil(self.poses / _SHARD_POSES)

    def shard(self, number: int) -> pl.DataFrame:  # noqa: D102
        import polars as pl

        first = number * _SHARD_POSES
        count = min(_SHARD_POSES, self.poses - first)
        problem = self._line_problem
        block, begin = divmod(first, SHARD_ROWS)
        rng = np.random.Generator(np.random.Philox(key=self.seed, counter=[0, 0, 0, block]))
        low, high = problem.q.copy(), problem.q.copy()
        for j, *ends in joint_ranges(problem):
            low[j], high[j] = ends
        q = rng.uniform(low, high, (SHARD_ROWS, problem.robot.dof))[begin : begin + count]
        own = np.tile(problem.velocity / np.linalg.norm(problem.velocity), (count, 1))
        max_speed = np.full(count, self.max_speed_mm_s / 1e3)
        worst = worst_directions(problem, q, own, math.radians(self.cone_deg), max_speed)
        direction, found = worst.direction, worst.found
        return pl.DataFrame({"pose": np.arange(first, first + count) + 1, **self._columns(q, direction, found)})

    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:  # noqa: D102
        limit = rows["limit_mm_s"]
        return {
            "study": self.name,
            "poses": rows.height,
            "none_safe": int((rows["limited_by"] == "nothing_safe").sum()),
            "untouched": int((rows["limited_by"] == "untouched").sum()),
            "at_max_speed": int((rows["limited_by"] == "max_speed").sum()),
            "directions": self._searched,
            **{f"limit_p{int(100 * p):02d}_mm_s": limit.quantile(p, "linear") for p in (0.05, 0.25, 0.5, 0.75, 0.95)},
            "law": "exact",
        }

    def answer_warnings(self, rows: pl.DataFrame, summary: Mapping[str, Any]) -> list[AnswerWarnings]:  # noqa: D102
        return self._warned(rows, "pose")

    def lines(self, summary: Mapping[str, Any]) -> list[str]:  # noqa: D102
        return [*safe_poses(summary).split("; "), f"directions: {summary['directions']}"]


def safe_poses(summary: Mapping[str, Any]) -> str:
    """How fast poses are safe, in a sentence's words; of speeds of 0 there is nothing to say."""
    half, twentieth = summary["limit_p50_mm_s"], summary["limit_p95_mm_s"]
    found = [f"in {summary['none_safe']} of {summary['poses']} poses no speed is safe"]
    if summary["untouched"]:
        found.append(f"in {summary['untouched']} most cases hit nothing, which counts as no safe speed")
    if half > 0:
        found.append(
            f"half of all poses are safe up to {no_more_than(half)} mm/s, "
            f"one in twenty up to {no_more_than(twentieth)} mm/s"
        )
    elif twentieth > 0:
        found.append(f"one in twenty is safe up to {no_more_than(twentieth)} mm/s")
    if summary.get("fails_with_finer_steps"):
        found.append(f"speeds among these are {FAILS_WITH_FINER_STEPS}")
    return "; ".join(found)
