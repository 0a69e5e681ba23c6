"""What the speed limits along a trajectory and all over the workspace share."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision import CollisionProblem, Scenario
from bumpstop.errors import InputError
from bumpstop.study.answer_warnings import AnswerWarnings, line_through, warnings_of
from bumpstop.study.pose_batch import PoseBatch
from bumpstop.study.speed.speed_limit import SpeedLimits
from bumpstop.study.speed.worst_direction import searched
from bumpstop.study.study import Study, check_risk

if TYPE_CHECKING:
    from collections.abc import Mapping

    import polars as pl

SHARD_ROWS = 250


@dataclass(frozen=True)
class SpeedMap(Study):
    """Highest safe speeds, one a row.

    Attributes:
        max_speed_mm_s: no tip speed above it is looked at.
        cone_deg: half angle of a cone of directions about the motion's own; the worst direction counts.
    """

    name: ClassVar[str] = "speed_limits"
    title: ClassVar[str] = "speed limits"

    max_speed_mm_s: float = 1000.0
    cone_deg: float = 0.0

    def _check(self) -> None:
        if not 1 <= self.max_speed_mm_s <= 1e4:
            raise InputError("--max-speed", f"{self.max_speed_mm_s:g} mm/s cannot be used", "wanted 1 to 10000")
        if not 0 <= self.cone_deg <= 180:
            raise InputError("--cone", f"{self.cone_deg:g} deg cannot be used", "wanted 0 to 180")
        check_risk(self.scenario)
        limits = self._line_problem.limits
        if limits is None:
            raise InputError("contact.body", "is missing", "a safe speed needs limits: name a body region")
        if not limits.permitted:
            raise InputError("contact.body", f"no speed is safe: {limits.reason}", "name another body region")
        scenario = self.scenario
        for key, found, wanted in (
            ("contact.kind", scenario.contact.kind, "clamped"),
            ("verdict.clamped_limit", scenario.verdict.clamped_limit, "quasi_static"),
        ):
            if found != wanted:
                raise InputError(key, f"{found!r} has no speed limits", f"wanted {wanted!r}")
        if self._line_problem.residuals is not None:
            raise InputError("detector.residuals", "have no integrated distribution", "give detector.noise_sd_Nm")

    @property
    @abstractmethod
    def _line(self) -> Scenario:
        """The scenario of a straight line that all rows share; its pose and velocity are replaced."""

    @cached_property
    def _line_problem(self) -> CollisionProblem:
        return CollisionProblem.from_scenario(self._line)

    @property
    def _searched(self) -> str:
        """In which directions a limit holds."""
        return searched(math.radians(self.cone_deg))

    def _warned(self, rows: pl.DataFrame, place: str) -> list[AnswerWarnings]:
        """Warnings beside the lowest and the highest limit that the risk decides.

        The slowest arm is the one that is told, and steps are coarsest for the fastest.

        Args:
            rows: of the study.
            place: column that numbers them.
        """
        known = rows.filter(rows["limited_by"] == "risk")
        if not known.height:
            known = rows.filter(rows["limited_by"] == "max_speed")
        limit = known["limit_mm_s"]
        ends = dict.fromkeys(row for row in (limit.arg_min(), limit.arg_max()) if row is not None)
        return [self._warned_at(known.row(row, named=True), place) for row in ends]

    def _warned_at(self, row: Mapping[str, Any], place: str) -> AnswerWarnings:
        limit, q = row["limit_mm_s"], [row[f"q_{j + 1}"] for j in range(self._line_problem.robot.dof)]
        velocity = limit / 1e3 * np.array([row[f"direction_{axis}"] for axis in "xyz"])
        found = warnings_of(lambda: line_through(self._line, np.array(q), velocity))
        return AnswerWarnings(f"the limit of {limit:.4g} mm/s at {place} {row[place]}", found)

    def _columns(self, q: FloatArray, direction: FloatArray, found: SpeedLimits) -> dict[str, Any]:
        problem = self._line_problem
        torque = np.einsum("nij,ni->nj", PoseBatch(problem, q, direction).linear_jacobian(q), direction)
        with np.errstate(divide="ignore"):
            undetectable = (problem.thresholds / np.abs(torque)).min(axis=1)
        tip = problem.robot.pose(q)[:, :3, 3]
        return {
            **{f"q_{j + 1}": q[:, j] for j in range(q.shape[1])},
            **{f"tip_{axis}_m": tip[:, i] for i, axis in enumerate("xyz")},
            **{f"direction_{axis}": direction[:, i] for i, axis in enumerate("xyz")},
            "limit_mm_s": 1e3 * found.speed,
            "risk": found.risk,
            "limited_by": found.limited_by,
            "undetectable_N": undetectable,
        }
