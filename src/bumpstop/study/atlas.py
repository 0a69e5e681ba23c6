"""Atlas: the highest safe speed at every waypoint of a trajectory, or all over the workspace."""

from __future__ import annotations

import math
from abc import abstractmethod
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision import Problem, Scenario, evaluate_batch
from bumpstop.errors import InputError
from bumpstop.study.arms import Arms
from bumpstop.study.between_waypoints import cut_at_summits, cut_by_turn
from bumpstop.study.directions import STANDS, cone_directions, directions_of
from bumpstop.study.joint_ranges import joint_ranges
from bumpstop.study.pace import deepest, greatest_pace, least_of_ranges
from bumpstop.study.risk import allowed_force
from bumpstop.study.speed_limit import CLOSE, SLOWEST, SpeedLimits, foretold_speed, speed_limits, stop_gain
from bumpstop.study.study import Study, check_risk

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.collision.trajectory import Trajectory

SHARD_ROWS = 250
MOST_POSES = 10_000_000
# Directions tried for the worst one: on the rim of a cone beside its axis, and all over the sphere.
_RIM, _SPHERE = 12, 48
# The trajectory turns its joints more than a straight line would, if by this much.
_TURNS_MORE = 1.02


@dataclass(frozen=True)
class Atlas(Study):
    """What both atlases share.

    Attributes:
        cap_mm_s: no tip speed above it is looked at.
        cone_deg: half angle of a cone of directions about the motion's own; the worst direction counts.
    """

    name: ClassVar[str] = "atlas"
    title: ClassVar[str] = "atlas"

    cap_mm_s: float = 1000.0
    cone_deg: float = 0.0

    def _check(self) -> None:
        if not 1 <= self.cap_mm_s <= 1e4:
            raise InputError("--cap", f"{self.cap_mm_s:g} mm/s cannot be used", "wanted 1 to 10000")
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
                raise InputError(key, f"{found!r} is not available in an atlas", f"wanted {wanted!r}")
        if self._line_problem.residuals is not None:
            raise InputError("detector.residuals", "have no exact law", "give detector.noise_sd_Nm")

    @property
    @abstractmethod
    def _line(self) -> Scenario:
        """The scenario of a straight line that all rows share; its pose and velocity are replaced."""

    @cached_property
    def _line_problem(self) -> Problem:
        return Problem.from_scenario(self._line)

    def _in_cone(
        self, q: FloatArray, own: FloatArray, angle: float, count: int, cap: FloatArray
    ) -> tuple[FloatArray, SpeedLimits]:
        """The worst of directions (N, 3) in a cone about ``own``, and highest safe speeds there.

        The formula guesses which it is. Exact laws of all directions at the speed found decide: where one passes what
        is accepted the search goes on in it, until none does.
        """
        directions = cone_directions(own, angle, count)
        if len(directions) == 1:
            return own, speed_limits(self._line, q, own, cap)
        direction = self._foretold_worst(q, directions)
        found = speed_limits(self._line, q, direction, cap)
        open_ = np.flatnonzero(found.speed > 0)
        laws, limit = found.laws, allowed_force(self._line_problem)
        while open_.size:
            velocity = np.concatenate([each[open_] * found.speed[open_, None] for each in directions])
            poses = np.tile(q[open_], (len(directions), 1))
            over = evaluate_batch(self._line, poses, velocity, limits_N=[limit]).exceedance[:, 0]
            laws += len(over)
            # Without a law, as at a singularity, no speed is safe either.
            over = np.nan_to_num(over, nan=np.inf).reshape(len(directions), -1)
            fails = over.max(axis=0) > self.scenario.verdict.risk
            worst, open_ = over.argmax(axis=0)[fails], open_[fails]
            if not open_.size:
                break
            direction[open_] = np.stack(directions)[worst, open_]
            # A little slower in any case, so that rounding at the very limit cannot go on for ever.
            slower = speed_limits(self._line, q[open_], direction[open_], (1 - 0.1 * CLOSE) * found.speed[open_])
            laws += slower.laws
            found.speed[open_], found.risk[open_] = slower.speed, slower.risk
            found.by[open_] = np.where(slower.speed > 0, "law", "none")
            open_ = open_[slower.speed > 0]
        return direction, replace(found, laws=laws)

    def _foretold_worst(self, q: FloatArray, directions: list[FloatArray]) -> FloatArray:
        """The direction whose foretold safe speed is the lowest (N, 3)."""
        problem = self._line_problem
        best = np.full(len(q), np.inf)
        worst = directions[0].copy()
        for around in directions:
            arms = Arms(problem, q, around)
            with np.errstate(invalid="ignore", over="ignore"):
                gain = stop_gain(problem, arms.unlimited_rates(q))
            torque = np.einsum("nij,ni->nj", arms.linear_jacobian(q), around)
            accepted = self.scenario.verdict.risk
            speed = np.nan_to_num(foretold_speed(problem, torque, gain, allowed_force(problem), accepted))
            lower = speed < best
            best[lower], worst[lower] = speed[lower], around[lower]
        return worst

    def _columns(self, q: FloatArray, direction: FloatArray, found: SpeedLimits) -> dict[str, Any]:
        problem = self._line_problem
        torque = np.einsum("nij,ni->nj", Arms(problem, q, direction).linear_jacobian(q), direction)
        with np.errstate(divide="ignore"):
            unnoticed = (problem.thresholds / np.abs(torque)).min(axis=1)
        tip = problem.robot.pose(q)[:, :3, 3]
        return {
            **{f"q_{j + 1}": q[:, j] for j in range(q.shape[1])},
            **{f"tip_{axis}_m": tip[:, i] for i, axis in enumerate("xyz")},
            **{f"direction_{axis}": direction[:, i] for i, axis in enumerate("xyz")},
            "limit_mm_s": 1e3 * found.speed,
            "risk": found.risk,
            "by": found.by,
            "unnoticed_N": unnoticed,
        }


@dataclass(frozen=True)
class TrajectoryAtlas(Atlas):
    """A row for every waypoint: the tool moves on a straight line through it, in the direction it moves there.

    Where waypoints are far apart there are rows for moments between them too. Rows at which the tip stands still take
    the direction of the nearest one at which it moves. Where the trajectory turns a joint faster, for the speed of its
    tip, than a straight line asks for, the formula with the trajectory's own rates limits the speed too.

    A limit holds for as far as a collision that begins at its row can take: an arm that speeds up right behind a place
    where it feels little hits as hard as one that is too fast there.
    """

    def __post_init__(self) -> None:
        if self.scenario.motion.kind != "trajectory":
            raise InputError("motion.kind", "'line' has no waypoints", "wanted 'trajectory', or --poses")
        if self.problem.robot.dof < 3:
            problem = f"{self.problem.robot.name} has {self.problem.robot.dof} joints, which follow no straight line"
            raise InputError("robot", problem, "an atlas needs an arm of 3 or more")
        self._check()

    @cached_property
    def problem(self) -> Problem:
        """The trajectory's own."""
        return Problem.from_scenario(self.scenario)

    @property
    def given(self) -> Trajectory:
        """What is followed, as the file has it."""
        trajectory = self.problem.trajectory
        assert trajectory is not None
        return trajectory

    @cached_property
    def _coarse(self) -> Trajectory:
        """The same with rows between waypoints that are far apart, by how far joints turn."""
        return cut_by_turn(self.given)

    @cached_property
    def trajectory(self) -> Trajectory:
        """The same with a row for every moment looked at."""
        return cut_at_summits(self._coarse, self._nearness)

    @cached_property
    def _waypoint(self) -> npt.NDArray[np.int64]:
        """Number of the waypoint at or before every row, from 0."""
        return np.searchsorted(self.given.time, self.trajectory.time, side="right") - 1

    @cached_property
    def _line(self) -> Scenario:
        data = self.scenario.to_dict()
        robot, rows = self.problem.robot, self._coarse
        data["motion"] = {"velocity_mm_s": [0.0, 0.0, 100.0], "task": "pose" if robot.dof >= 6 else "position"}
        # A row that is not singular, to check the scenario at: the one that feels a push best.
        row = int(np.linalg.svd(robot.jacobian(rows.position), compute_uv=False)[:, -1].argmax())
        data["pose_rad"] = rows.position[row].tolist()
        data["motion"]["velocity_mm_s"] = (100 * directions_of(self._tip(rows.time))[row]).tolist()
        return Scenario.from_dict(data, self.scenario.folder)

    def _tip(self, t: FloatArray) -> FloatArray:
        """Velocity of the tip (N, 3) [m/s]."""
        from bumpstop.collision.trajectory import point_motion

        robot = self.problem.robot
        return point_motion(self.given, robot, robot.frame(None), t)[0]

    @cached_property
    def tip_velocity(self) -> FloatArray:
        """Of the tip at every row (rows, 3) [m/s]."""
        return self._tip(self.trajectory.time)

    @cached_property
    def direction(self) -> FloatArray:
        """Unit vectors (rows, 3)."""
        return directions_of(self.tip_velocity)

    def _nearness(self, t: FloatArray) -> FloatArray:
        """Speed of the tip over what the formula allows (N,), at times of the trajectory (N,) [s]."""
        problem, q, velocity = self._line_problem, self.given.at(t), self._tip(t)
        speed = np.linalg.norm(velocity, axis=1)
        # Where the tip stands any direction will do: it is at no limit.
        own = np.where(speed[:, None] > STANDS, velocity / np.maximum(speed, STANDS)[:, None], [1.0, 0.0, 0.0])
        arms = Arms(problem, q, own)
        torque = np.einsum("nij,ni->nj", arms.linear_jacobian(q), own)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            gain = np.fmax(stop_gain(problem, arms.unlimited_rates(q)), stop_gain(problem, self.given.at(t, 1)) / speed)
        gain = np.nan_to_num(gain, posinf=1e9)
        allowed = foretold_speed(problem, torque, gain, allowed_force(problem), self.scenario.verdict.risk)
        return np.asarray(speed / np.maximum(allowed, SLOWEST))

    @cached_property
    def _travelled(self) -> FloatArray:
        """Way of the contact point to every row (rows,) [m]."""
        from bumpstop.collision.trajectory import point_motion

        time = self.trajectory.time
        velocity = point_motion(self.given, self.problem.robot, self.problem.contact_point, time)[0]
        speed = np.linalg.norm(velocity, axis=1)
        return np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time)))

    @cached_property
    def _speed(self) -> FloatArray:
        """Of the tip at every row (rows,) [m/s]."""
        return np.asarray(np.linalg.norm(self.tip_velocity, axis=1))

    @cached_property
    def _fastest(self) -> FloatArray:
        """Of the tip from every row on, for as far as a collision that begins there can go (rows,) [m/s]."""
        way = self._travelled
        last = np.searchsorted(way, way + deepest(self._line_problem), side="right") - 1
        return -least_of_ranges(-self._speed, np.arange(len(way)), last)

    @cached_property
    def _at_singularity(self) -> npt.NDArray[np.bool_]:
        """Rows (rows,) beside a singularity that the trajectory passes: no straight line through it can be followed."""
        position = self.trajectory.position
        passes = Arms(self._line_problem, position, self.direction).passes_singularity(position)
        return np.asarray(np.append(passes, False) | np.append(False, passes))

    @property
    def shards(self) -> int:  # noqa: D102
        return math.ceil(len(self.trajectory.time) / SHARD_ROWS)

    def shard(self, number: int) -> pl.DataFrame:  # noqa: D102
        import polars as pl

        rows = np.arange(number * SHARD_ROWS, min((number + 1) * SHARD_ROWS, len(self.trajectory.time)))
        q, own = self.trajectory.position[rows], self.direction[rows]
        cap = np.full(len(rows), self.cap_mm_s / 1e3)
        direction, found = self._in_cone(q, own, math.radians(self.cone_deg), _RIM, cap)
        found = self._turning(rows, own, found).none_at(self._at_singularity[rows], "singularity")
        speed = self._speed[rows]
        fastest = np.where((found.by == "turning") | (speed <= STANDS), speed, self._fastest[rows])
        return pl.DataFrame(
            {
                "waypoint": self._waypoint[rows] + 1,
                "between": self.trajectory.time[rows] != self.given.time[self._waypoint[rows]],
                "t_s": self.trajectory.time[rows],
                "speed_mm_s": 1e3 * speed,
                **self._columns(q, direction, found),
                "over": fastest > found.speed * (1 + 1e-9),
            }
        )

    def _turning(self, rows: Any, own: FloatArray, found: SpeedLimits) -> SpeedLimits:
        """Lower the limits where the trajectory turns its joints more than straight lines do."""
        problem, q = self._line_problem, self.trajectory.position[rows]
        speed = np.linalg.norm(self.tip_velocity[rows], axis=1)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            gain = stop_gain(problem, self.trajectory.at(self.trajectory.time[rows], 1)) / speed
            straight = stop_gain(problem, Arms(problem, q, own).unlimited_rates(q))
        torque = np.einsum("nij,ni->nj", Arms(problem, q, own).linear_jacobian(q), own)
        more = (speed > STANDS) & ~(gain <= _TURNS_MORE * straight)
        allowed = foretold_speed(
            problem, torque, np.where(more, gain, 0.0), allowed_force(problem), self.scenario.verdict.risk
        )
        lower = more & (allowed < found.speed)
        return SpeedLimits(
            np.where(lower, allowed, found.speed),
            np.where(lower, np.nan, found.risk),
            np.where(lower, "turning", found.by),
            found.laws,
        )

    def pace(self, rows: pl.DataFrame) -> FloatArray:
        """Greatest pace at every row, 0 to 1, with which the whole trajectory keeps to the limits of its rows.

        All 1 where it keeps to them as it is.
        """
        if not rows["over"].any():
            return np.ones(rows.height)
        return greatest_pace(self._line_problem, self.trajectory, self._travelled, self.direction, rows)

    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:  # noqa: D102
        least = rows["limit_mm_s"].arg_min()
        assert least is not None
        return {
            "study": self.name,
            "waypoints": int((~rows["between"]).sum()),
            "over": int((rows["over"] & ~rows["between"]).sum()),
            "moments_between": int(rows["between"].sum()),
            "over_between": int((rows["over"] & rows["between"]).sum()),
            "none_safe": int((rows["limit_mm_s"] == 0).sum()),
            "lowest_limit_mm_s": rows["limit_mm_s"][least],
            "lowest_at_waypoint": rows["waypoint"][least],
            "lowest_at_s": rows["t_s"][least],
            "duration_s": self.trajectory.duration,
            "acceptable": not bool(rows["over"].any()),
            "law": "exact",
        }


@dataclass(frozen=True)
class WorkspaceAtlas(Atlas):
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
        if not 1 <= self.poses <= MOST_POSES:
            raise InputError("--poses", f"{self.poses} cannot be used", f"wanted 1 to {MOST_POSES}")
        self._check()
        joint_ranges(self._line_problem)

    @cached_property
    def _line(self) -> Scenario:
        return self.scenario

    @property
    def shards(self) -> int:  # noqa: D102
        return math.ceil(self.poses / SHARD_ROWS)

    def shard(self, number: int) -> pl.DataFrame:  # noqa: D102
        import polars as pl

        count = min(SHARD_ROWS, self.poses - number * SHARD_ROWS)
        problem = self._line_problem
        rng = np.random.Generator(np.random.Philox(key=self.seed, counter=[0, 0, 0, number]))
        low, high = problem.q.copy(), problem.q.copy()
        for j, *ends in joint_ranges(problem):
            low[j], high[j] = ends
        q = rng.uniform(low, high, (count, problem.robot.dof))
        own = np.tile(problem.velocity / np.linalg.norm(problem.velocity), (count, 1))
        cap = np.full(count, self.cap_mm_s / 1e3)
        direction, found = self._in_cone(q, own, math.radians(self.cone_deg), _SPHERE, cap)
        first = number * SHARD_ROWS
        return pl.DataFrame({"pose": np.arange(first, first + count) + 1, **self._columns(q, direction, found)})

    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:  # noqa: D102
        limit = rows["limit_mm_s"]
        return {
            "study": self.name,
            "poses": rows.height,
            "none_safe": int((limit == 0).sum()),
            "at_cap": int((rows["by"] == "cap").sum()),
            **{f"limit_p{int(100 * p):02d}_mm_s": limit.quantile(p, "linear") for p in (0.05, 0.25, 0.5, 0.75, 0.95)},
            "law": "exact",
        }
