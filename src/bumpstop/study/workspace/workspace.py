"""Workspace: poses and directions all over an arm's reach, each with its whole law."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar, Literal

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.study.answer_warnings import AnswerWarnings, line_through, warnings_of
from bumpstop.study.capsules import max_link_radius, self_collision
from bumpstop.study.directions import DirectionSampling, draw_directions, spread_directions
from bumpstop.study.joint_ranges import joint_ranges
from bumpstop.study.study import Study
from bumpstop.study.workspace import predictors
from bumpstop.study.workspace.workspace_summary import summarise, summary_lines, worst_risk

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import polars as pl

    from bumpstop.collision import BatchResult, CollisionProblem

# Small enough for a bar that moves and for two threads to end together, large enough for the batch's lanes.
SHARD_ROWS = 250
MAX_ROWS = 100_000_000
QUANTILES = {"p50_N": 0.5, "p95_N": 0.95, "p99_N": 0.99, "p999_N": 0.999}
_BINS = 30
# Times the force limit: bins that reach a pressure limit farther away would show little of the forces.
_FAR = 4.0
# Rounds of drawing again before a radius is called too large.
_MAX_ROUNDS = 1000


@dataclass(frozen=True)
class WorkspaceStudy(Study):
    """One integrated distribution for each pose and direction.

    Attributes:
        poses: number of random poses; 0 with a grid.
        grid: values of each moving joint, at the middles of equal cells; 0 with random poses.
        grid_directions: directions at each pose of the grid.
        directions: how directions are drawn.
        speed_sd_mm_s: spread of the speed about the scenario's; normal, drawn again where not above 0.
        joint_limits: ``"respect"``: a limit ends the motion. ``"ignore"``: the arm moves on, as in Schroeder (2013).
            Poses lie inside the limits either way.
        velocity_limits: ``"respect"``: where a joint would turn faster than it can, all rates are scaled down and the
            tip gets slower. ``"ignore"``: the tip keeps its speed, as in Schroeder (2013).
        link_radius_mm: of the links as capsules; poses in which two touch are drawn again, or left out of a grid.
            0: self-collision is not looked for.
        predict: peak forces predicted from the pose stand beside every distribution, for its direction and for the
            worst one.
        seed: of what is drawn.
    """

    name: ClassVar[str] = "workspace"
    title: ClassVar[str] = "workspace"
    batch_size: ClassVar[int] = 12  # lanes that are done find another pose longer

    poses: int = 0
    grid: int = 0
    grid_directions: int = 1
    directions: DirectionSampling = "sphere"
    speed_sd_mm_s: float = 0.0
    joint_limits: Literal["respect", "ignore"] = "respect"
    velocity_limits: Literal["respect", "ignore"] = "respect"
    link_radius_mm: float = 0.0
    predict: bool = False
    seed: int = 0

    def __post_init__(self) -> None:
        if self.scenario.motion.kind != "line":
            raise InputError("motion.kind", "a workspace study moves along straight lines", "wanted 'line'")
        if not self.poses and not self.grid:
            raise InputError("--poses", "is missing", "give it or --grid, for example --poses 1000")
        if self.poses and self.grid:
            raise InputError("--grid", "has no meaning with --poses", "give one of them")
        if self.poses and self.grid_directions != 1:
            raise InputError("--grid-directions", "has no meaning without --grid", "leave it out")
        if self.grid and self.speed_sd_mm_s:
            raise InputError("--speed-sd", "has no meaning with --grid, where nothing is drawn", "leave it out")
        if self.grid and self.seed:
            raise InputError("--seed", "has no meaning with --grid, where nothing is drawn", "leave it out")
        if not 0 <= self.speed_sd_mm_s < math.inf:
            raise InputError("--speed-sd", f"{self.speed_sd_mm_s:g} cannot be used", "wanted 0 mm/s or more")
        if not 0 <= self.link_radius_mm < math.inf:
            raise InputError("--link-radius", f"{self.link_radius_mm:g} cannot be used", "wanted 0 mm or more")
        if self.speed_sd_mm_s > self._speed:
            problem = f"{self.speed_sd_mm_s:g} mm/s is more than the speed of {self._speed:g} mm/s"
            raise InputError("--speed-sd", problem, "wanted less, or most speeds would be drawn again")
        if self.drawn > MAX_ROWS:
            raise InputError("--grid", f"{self.drawn} distributions are too many", f"wanted at most {MAX_ROWS}")
        if self.predict:
            predictors.check(self._problem)
        # Everything a shard would refuse, it refuses here, before any work.
        _ = self._ranges
        if self.scenario.verdict.clamped_limit == "two_phase":
            problem = "'two_phase' has two limits at once"
            raise InputError("verdict.clamped_limit", problem, "wanted 'quasi_static' for a workspace")
        self._laws(self._problem.q[None], np.array([[*self._own * self._speed / 1e3]]))
        max_radius = 1e3 * max_link_radius(self._problem.robot, self._problem.q)
        if self.link_radius_mm > max_radius:
            problem = f"at {self.link_radius_mm:g} mm all links are neighbours, and none could touch"
            raise InputError("--link-radius", problem, f"wanted at most {max_radius:.3g} mm")

    @property
    def drawn(self) -> int:
        """Rows there would be without self-collision."""
        return self.poses or self.grid ** len(self._ranges) * self.grid_directions

    @property
    def shards(self) -> int:  # noqa: D102
        return math.ceil(self.drawn / SHARD_ROWS)

    def shard(self, number: int) -> pl.DataFrame:  # noqa: D102
        return self.shard_batch([number])[0]

    def shard_batch(self, numbers: Sequence[int]) -> list[pl.DataFrame]:  # noqa: D102
        cases = [self._cases(number) for number in numbers]
        q, velocity, redrawn = (np.concatenate(columns) for columns in zip(*cases, strict=True))
        rows = _table(self._columns(q, velocity, redrawn))
        ends = np.cumsum([len(q) for q, *_ in cases])
        return [rows[end - len(q) : end] for end, (q, *_) in zip(ends.tolist(), cases, strict=True)]

    def shard_columns(self, number: int) -> dict[str, np.ndarray]:
        """The columns of a shard as arrays (rows,), and ``p_over_edges`` (rows, edges)."""
        return self._columns(*self._cases(number))

    def _cases(self, number: int) -> tuple[FloatArray, FloatArray, Any]:
        """Poses and velocities of a shard, and how many poses were drawn in vain before each."""
        first = number * SHARD_ROWS
        count = min(SHARD_ROWS, self.drawn - first)
        if self.grid:
            q, direction = self._gridded(np.arange(first, first + count))
            speed, redrawn = np.full(len(q), self._speed), np.zeros(len(q), dtype=np.int64)
        else:
            # A counter of its own for every shard: nothing depends on what was drawn before.
            rng = np.random.Generator(np.random.Philox(key=self.seed, counter=[0, 0, 0, number]))
            q, redrawn = self._drawn(count, rng)
            direction = draw_directions(self.directions, self._own, count, rng)
            speed = self._speeds(count, rng)
        return q, direction * speed[:, None] / 1e3, redrawn

    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:  # noqa: D102
        accepted = self.scenario.verdict.accepted_probability
        discarded = int(rows["redrawn"].sum()) if self.poses else self.drawn - rows.height
        return {
            "study": self.name,
            **summarise(rows, self.edges, self.force_limits, accepted, predicted=self.predict),
            "self_collisions": {"looked_for": self.link_radius_mm > 0, "poses_discarded": discarded},
        }

    def answer_warnings(self, rows: pl.DataFrame, summary: Mapping[str, Any]) -> list[AnswerWarnings]:  # noqa: D102
        bounded = rows.filter(rows["p999_N"].is_finite())
        within = bounded.filter(worst_risk(bounded) <= self.scenario.verdict.accepted_probability)
        # One that comes close to its limits: a finer step would be the first to take it beyond.
        row = (within if within.height else bounded).sort("p999_N").tail(1).to_dicts()
        return [self._warned(found) for found in row]

    def _warned(self, row: Mapping[str, Any]) -> AnswerWarnings:
        q = np.array([row[f"q_{j + 1}"] for j in range(self._problem.robot.dof)])
        velocity = np.array([row[f"velocity_{axis}_m_s"] for axis in "xyz"])
        found = warnings_of(lambda: line_through(self.scenario, q, velocity))
        tip = ", ".join(f"{row[f'tip_{axis}_m']:.3g}" for axis in "xyz")
        return AnswerWarnings(f"the distribution at {row['p999_N']:.4g} N (p99.9), tip at {tip} m", found)

    def lines(self, summary: Mapping[str, Any]) -> list[str]:  # noqa: D102
        return summary_lines(summary)

    # --- What is drawn ------------------------------------------------------------------------------------------

    @cached_property
    def _problem(self) -> CollisionProblem:
        from bumpstop.collision import CollisionProblem

        problem = CollisionProblem.from_scenario(self.scenario)
        free: dict[str, Any] = {}
        if self.joint_limits == "ignore":
            free |= {"lower": -math.inf, "upper": math.inf}
        if self.velocity_limits == "ignore":
            free |= {"velocity": math.inf}
        if not free:
            return problem
        joints = tuple(replace(joint, **free) for joint in problem.robot.joints)
        return replace(problem, robot=replace(problem.robot, joints=joints))

    @cached_property
    def _ranges(self) -> list[tuple[int, float, float]]:
        """Moving joints with the range they are drawn from, inside the robot's own limits whatever is ignored."""
        from bumpstop.collision import CollisionProblem

        return joint_ranges(CollisionProblem.from_scenario(self.scenario))

    @property
    def _speed(self) -> float:
        assert self.scenario.motion.velocity_mm_s is not None
        return math.hypot(*self.scenario.motion.velocity_mm_s)

    @property
    def _own(self) -> FloatArray:
        return np.array(self.scenario.motion.velocity_mm_s) / self._speed

    def _drawn(self, count: int, rng: np.random.Generator) -> tuple[FloatArray, Any]:
        """Random poses, and how many were drawn in vain before each."""
        low, high = (np.array([each[side] for each in self._ranges]) for side in (1, 2))
        joints = [j for j, *_ in self._ranges]
        q = np.tile(self._problem.q, (count, 1))
        redrawn = np.zeros(count, dtype=np.int64)
        wanted = np.arange(count)
        for _ in range(_MAX_ROUNDS):
            q[wanted[:, None], joints] = rng.uniform(low, high, size=(wanted.size, low.size))
            wanted = wanted[self._touches(q[wanted])]
            if not wanted.size:
                return q, redrawn
            redrawn[wanted] += 1
        problem = f"at {self.link_radius_mm:g} mm the arm hits itself in nearly every pose"
        raise InputError("--link-radius", problem, "wanted thinner links")

    def _gridded(self, rows: Any) -> tuple[FloatArray, FloatArray]:
        directions = spread_directions(self.directions, self._own, self.grid_directions)
        q = np.tile(self._problem.q, (len(rows), 1))
        rest = rows // self.grid_directions
        for j, low, high in reversed(self._ranges):
            q[:, j] = low + (high - low) * (rest % self.grid + 0.5) / self.grid
            rest //= self.grid
        kept = ~self._touches(q)
        return q[kept], directions[rows % self.grid_directions][kept]

    def _touches(self, q: FloatArray) -> Any:
        if not self.link_radius_mm:
            return np.zeros(len(q), dtype=np.bool_)
        return self_collision(self._problem.robot, q, self.link_radius_mm / 1e3)

    def _speeds(self, count: int, rng: np.random.Generator) -> FloatArray:
        speed = np.full(count, self._speed)
        if self.speed_sd_mm_s:
            wanted = np.arange(count)
            while wanted.size:
                speed[wanted] = rng.normal(self._speed, self.speed_sd_mm_s, wanted.size)
                wanted = wanted[speed[wanted] <= 0]
        return speed

    # --- What is found ------------------------------------------------------------------------------------------

    @property
    def force_limits(self) -> list[float]:
        """Peak forces of the body's force and pressure limit [N]; none without a body, one without a pressure limit."""
        limits, contact = self._problem.limits, self.scenario.contact
        if limits is None:
            return []
        if limits.pressure_N_cm2 is None:
            return [limits.force_N]
        return [limits.force_N, limits.force_at_pressure_limit_N(contact.area_cm2, contact.peak_factor)]

    @property
    def edges(self) -> FloatArray:
        """Of the bins of the force distribution [N]: thirty of a round width, to a good twice the force limit.

        They reach beyond a pressure limit that is not much more.
        """
        first, *further = self.force_limits or [135.0]
        reached = max([first, *(limit for limit in further if limit < _FAR * first)])
        span = max(2.2 * first, reached)
        size = 10.0 ** math.floor(math.log10(span / _BINS))
        widths = [size * step for step in (1, 2, 5, 10) if size * step * _BINS > reached]
        width = min(widths, key=lambda w: abs(math.log(w * _BINS / span)))
        return np.asarray(np.arange(_BINS + 1) * width, dtype=np.float64)

    def _laws(self, q: FloatArray, velocity: FloatArray) -> BatchResult:
        from bumpstop.collision import evaluate_batch

        limits = [*self.edges, *self.force_limits]
        return evaluate_batch(self._problem, q, velocity, probabilities=list(QUANTILES.values()), limits_N=limits)

    def _columns(self, q: FloatArray, velocity: FloatArray, redrawn: Any) -> dict[str, np.ndarray]:
        robot = self._problem.robot
        n = len(q)
        columns: dict[str, np.ndarray] = {f"q_{j + 1}": q[:, j] for j in range(robot.dof)}
        columns |= {f"velocity_{axis}_m_s": velocity[:, i] for i, axis in enumerate("xyz")}
        tip = robot.pose(q)[:, :3, 3] if n else np.empty((0, 3))
        columns |= {f"tip_{axis}_m": tip[:, i] for i, axis in enumerate("xyz")}
        laws = self._laws(q, velocity)
        columns |= {"mean_N": laws.mean, "sd_N": laws.sd}
        columns |= {name: laws.quantile[:, i] for i, name in enumerate(QUANTILES)}
        over = laws.exceedance[:, self.edges.size :]
        for i, name in enumerate(("p_over_force", "p_over_pressure")):
            columns[name] = over[:, i] if i < over.shape[1] else np.full(n, np.nan)
        columns["false_alarm"] = laws.false_alarm_probability
        columns["undetected"] = laws.undetected_probability
        columns["no_contact"] = laws.no_contact_probability
        columns |= {f"trigger_{j + 1}": laws.trigger_joint_probability[:, j] for j in range(robot.dof)}
        columns["end"] = laws.end
        columns |= self._sensitivity(q)
        if self.predict:
            columns |= predictors.predicted_columns(self._problem, q, velocity)
        return columns | {"redrawn": redrawn, "p_over_edges": laws.exceedance[:, : self.edges.size]}

    def _sensitivity(self, q: FloatArray) -> dict[str, FloatArray]:
        """Condition number and smallest singular value at the start, of the joints that move.

        Three rows: of the tip's translation, in one unit. Six rows: with rotation, as in Schroeder (2013); they depend
        on the unit of length.
        """
        robot = self._problem.robot
        moving = [j for j, *_ in self._ranges]
        link, point = robot.frame(None)
        found = {}
        for angular, ending in ((False, ""), (True, "_six_rows")):
            values = _native.singular_values_of_columns(
                robot.chain, np.ascontiguousarray(q), link, point, moving, angular
            )[:, : len(moving)]
            with np.errstate(divide="ignore"):
                found[f"condition_number{ending}"] = values[:, 0] / values[:, -1]
            found[f"smallest_singular_value{ending}"] = values[:, -1]
        return found


def _table(columns: Mapping[str, np.ndarray]) -> pl.DataFrame:
    import polars as pl

    def series(name: str, column: np.ndarray) -> pl.Series:
        if column.dtype.kind == "U":
            return pl.Series(name, column.tolist(), dtype=pl.String)
        found = pl.Series(name, np.ascontiguousarray(column))
        return found.arr.to_list() if column.ndim == 2 else found

    # A series at a time: half the cost of a dictionary of arrays.
    return pl.DataFrame([series(name, column) for name, column in columns.items()])
