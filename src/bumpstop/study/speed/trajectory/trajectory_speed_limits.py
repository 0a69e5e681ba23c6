"""The highest safe speed at every waypoint of a trajectory."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision import CollisionProblem, Scenario
from bumpstop.collision.scenario.keys import leave_out
from bumpstop.errors import InputError
from bumpstop.study.answer_warnings import FAILS_WITH_FINER_STEPS, AnswerWarnings
from bumpstop.study.directions import STANDS, directions_of, nearest_moving
from bumpstop.study.pose_batch import PoseBatch
from bumpstop.study.prediction import predicted_speed_limit, stopping_time_per_speed, undetected_force
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.speed.speed_limit import SpeedLimits
from bumpstop.study.speed.speed_map import SHARD_ROWS, SpeedMap
from bumpstop.study.speed.speed_search import MIN_SPEED
from bumpstop.study.speed.trajectory.own_motion import own_speeds
from bumpstop.study.speed.trajectory.path_speed import max_path_speed, max_penetration_travel, sliding_min
from bumpstop.study.speed.trajectory.slowing import Judged, Slowing, changes_to, judge_motion, slow_down
from bumpstop.study.speed.trajectory.waypoint_refinement import refine_at_peaks, refine_by_joint_motion
from bumpstop.study.speed.worst_direction import worst_directions
from bumpstop.terminal import no_more_than

if TYPE_CHECKING:
    from collections.abc import Mapping

    import polars as pl

    from bumpstop.collision.trajectory.trajectory import Trajectory

# The trajectory turns its joints more than a straight line would, if by this much; and so much less that no straight
# line says anything about it, as near a singularity.
_TURNS_MORE, _FOLLOWS_NO_LINE = 1.02, 0.2


@dataclass(frozen=True)
class TrajectorySpeedLimits(SpeedMap):
    """A row for every waypoint: the tool moves on a straight line through it, in the direction it moves there.

    Where waypoints are far apart there are rows for moments between them too. Rows at which the tip stands still take
    the direction of the nearest one at which it moves. Where the trajectory turns a joint faster, for the speed of its
    tip, than a straight line asks for, the formula with the trajectory's own rates limits the speed too.

    A limit holds for as far as a collision that begins at its row can take: an arm that speeds up right behind a place
    where contact loads its joints little hits as hard as one that is too fast there.
    """

    def __post_init__(self) -> None:
        if self.scenario.motion.kind != "trajectory":
            raise InputError("motion.kind", "'line' has no waypoints", "wanted 'trajectory', or --poses")
        if self.problem.robot.dof < 3:
            problem = f"{self.problem.robot.name} has {self.problem.robot.dof} joints, which follow no straight line"
            raise InputError("robot", problem, "speed limits need an arm of 3 or more")
        self._check()

    @cached_property
    def problem(self) -> CollisionProblem:
        """The trajectory's own."""
        return CollisionProblem.from_scenario(self.scenario)

    @property
    def given(self) -> Trajectory:
        """What is followed, as the file has it."""
        trajectory = self.problem.trajectory
        assert trajectory is not None
        return trajectory

    @cached_property
    def _coarse(self) -> Trajectory:
        """The same with rows between waypoints that are far apart, by how far joints turn."""
        return refine_by_joint_motion(self.given)

    @cached_property
    def trajectory(self) -> Trajectory:
        """The same with a row for every moment looked at."""
        return refine_at_peaks(self._coarse, self._nearness)

    @cached_property
    def _waypoint(self) -> npt.NDArray[np.int64]:
        """Number of the waypoint at or before every row, from 0."""
        return np.searchsorted(self.given.time, self.trajectory.time, side="right") - 1

    @cached_property
    def _line(self) -> Scenario:
        data = self.scenario.to_dict()
        robot, rows = self.problem.robot, self._coarse
        leave_out(data, ["motion"])
        data["motion"] = {"task": "pose" if robot.dof >= 6 else "position"}
        # The row that is farthest from a singularity.
        row = int(np.linalg.svd(robot.jacobian(rows.position), compute_uv=False)[:, -1].argmax())
        data["pose_rad"] = rows.position[row].tolist()
        data["motion"]["velocity_mm_s"] = (100 * directions_of(self._tip(rows.time))[row]).tolist()
        return Scenario.from_dict(data, self.scenario.folder)

    @cached_property
    def _line_problem(self) -> CollisionProblem:
        # Checked with the trajectory. Whether a straight line can be followed is asked row by row.
        line = self._line
        assert line.pose_rad is not None
        q, velocity = np.array(line.pose_rad), np.array(line.motion.velocity)
        return replace(self.problem, scenario=line, q=q, velocity=velocity, trajectory=None)

    def _tip(self, t: FloatArray) -> FloatArray:
        """Velocity of the tip (N, 3) [m/s]."""
        from bumpstop.collision.trajectory.trajectory import point_motion

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
        arms = PoseBatch(problem, q, own)
        torque = np.einsum("nij,ni->nj", arms.linear_jacobian(q), own)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            straight = stopping_time_per_speed(problem, arms.joint_rates(q))
            gain = np.fmax(straight, stopping_time_per_speed(problem, self.given.at(t, 1)) / speed)
        gain = np.nan_to_num(gain, posinf=1e9)
        undetected = undetected_force(problem, torque, self.scenario.verdict.accepted_probability)
        allowed = predicted_speed_limit(problem, undetected, gain, allowed_force(problem))
        return np.asarray(speed / np.maximum(allowed, MIN_SPEED))

    @cached_property
    def _travelled(self) -> FloatArray:
        """Way of the contact point to every row (rows,) [m]."""
        from bumpstop.collision.trajectory.trajectory import point_motion

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
        last = np.searchsorted(way, way + max_penetration_travel(self._line_problem), side="right") - 1
        return -sliding_min(-self._speed, np.arange(len(way)), last)

    @cached_property
    def _at_singularity(self) -> npt.NDArray[np.bool_]:
        """Rows (rows,) beside a singularity that the trajectory passes: no straight line through it can be followed."""
        position = self.trajectory.position
        passes = PoseBatch(self._line_problem, position, self.direction).passes_singularity(position)
        return np.asarray(np.append(passes, False) | np.append(False, passes))

    @property
    def shards(self) -> int:  # noqa: D102
        return math.ceil(len(self.trajectory.time) / SHARD_ROWS)

    def shard(self, number: int) -> pl.DataFrame:  # noqa: D102
        import polars as pl

        rows = np.arange(number * SHARD_ROWS, min((number + 1) * SHARD_ROWS, len(self.trajectory.time)))
        q, own = self.trajectory.position[rows], self.direction[rows]
        max_speed = np.full(len(rows), self.max_speed_mm_s / 1e3)
        worst = worst_directions(self._line_problem, q, own, math.radians(self.cone_deg), max_speed)
        direction, found = worst.direction, worst.found
        found = self._by_itself(rows, own, self._turning(rows, own, found))
        speed = self._speed[rows]
        fastest = np.where(
            np.isin(found.limited_by, ("joint_rates", "singularity")) | (speed <= STANDS), speed, self._fastest[rows]
        )
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
            gain = stopping_time_per_speed(problem, self.trajectory.at(self.trajectory.time[rows], 1)) / speed
            straight = stopping_time_per_speed(problem, PoseBatch(problem, q, own).joint_rates(q))
        torque = np.einsum("nij,ni->nj", PoseBatch(problem, q, own).linear_jacobian(q), own)
        more = (speed > STANDS) & ~(gain <= _TURNS_MORE * straight)
        undetected = undetected_force(problem, torque, self.scenario.verdict.accepted_probability)
        allowed = predicted_speed_limit(problem, undetected, np.where(more, gain, 0.0), allowed_force(problem))
        lower = more & (allowed < found.speed)
        return replace(
            found,
            speed=np.where(lower, allowed, found.speed),
            risk=np.where(lower, np.nan, found.risk),
            limited_by=np.where(lower, "joint_rates", found.limited_by),
        )

    def _by_itself(self, rows: Any, own: FloatArray, found: SpeedLimits) -> SpeedLimits:
        """The limits by the trajectory's own distribution where it passes a singularity, or comes near to one.

        Its joints go on there as they are told to. A straight line would ask them for ever more speed.
        """
        problem, q, time = self._line_problem, self.trajectory.position[rows], self.trajectory.time
        # Rows at which the tip stands take all of it from the nearest one at which it moves, as their direction.
        moving = nearest_moving(self.tip_velocity)[rows]
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            gain = stopping_time_per_speed(problem, self.trajectory.at(time[moving], 1)) / self._speed[moving]
            straight = stopping_time_per_speed(problem, PoseBatch(problem, q, own).joint_rates(q))
        turning = found.limited_by == "joint_rates"
        apart = self._at_singularity[rows] | (~(gain >= _FOLLOWS_NO_LINE * straight) & (found.speed == 0))
        # Where the formula leaves no speed, the distribution may.
        at = np.flatnonzero(apart | (turning & (found.speed == 0)))
        if not at.size:
            return found
        torque = np.einsum("nij,ni->nj", PoseBatch(problem, q[at], own[at]).linear_jacobian(q[at]), own[at])
        undetected = undetected_force(problem, torque, self.scenario.verdict.accepted_probability)
        guess = np.minimum(
            predicted_speed_limit(problem, undetected, gain[at], allowed_force(problem)), self.max_speed_mm_s / 1e3
        )
        speed, risk = own_speeds(self.problem, time[moving[at]], self._speed[moving[at]], guess)
        # A straight line that is safe faster is no worse a bound.
        better = self._at_singularity[rows][at] | (speed > found.speed[at])
        at, speed, risk = at[better], speed[better], risk[better]
        found.speed[at], found.risk[at] = speed, risk
        limited_by = found.limited_by.astype(object)
        limited_by[at] = np.where(turning[at] & ~apart[at], "joint_rates", "singularity")
        return replace(found, limited_by=limited_by.astype(str))

    def path_speed(self, rows: pl.DataFrame) -> FloatArray:
        """Greatest path speed at every row, 0 to 1, with which the whole trajectory keeps to the limits of its rows.

        All 1 where it keeps to them as it is.
        """
        if not rows["over"].any():
            return np.ones(rows.height)
        return max_path_speed(self._line_problem, self.trajectory, self._travelled, self.direction, rows)

    @cached_property
    def _judged(self) -> Judged:
        """The trajectory as given, by the distribution of all its moments."""
        return judge_motion(self.scenario)

    def slowed(self, rows: pl.DataFrame) -> Slowing:
        """The trajectory slowed down to the limits of its rows, and as its own distribution judges it."""
        kept = self.__dict__.get("_slowed")
        if kept is None or kept[0] is not rows:
            kept = rows, self._slow_down(rows)
            self.__dict__["_slowed"] = kept  # for the summary and for the files
        slowing: Slowing = kept[1]
        return slowing

    def _slow_down(self, rows: pl.DataFrame) -> Slowing:
        if (rows["limit_mm_s"] == 0).any():
            return Slowing(None, "at some places no speed is safe")
        try:
            path_speed = self.path_speed(rows)
        except InputError as error:
            return Slowing(None, error.problem)
        return slow_down(self.problem, self.trajectory, path_speed)

    def summary(self, rows: pl.DataFrame) -> dict[str, Any]:  # noqa: D102
        least = rows["limit_mm_s"].arg_min()
        assert least is not None
        slowing = self.slowed(rows)
        retimed = slowing.retimed
        changes = {} if retimed is None else changes_to(self.scenario, retimed, Path("retimed.csv"))
        return {
            "study": self.name,
            "waypoints": int((~rows["between"]).sum()),
            "over": int((rows["over"] & ~rows["between"]).sum()),
            "moments_between": int(rows["between"].sum()),
            "over_between": int((rows["over"] & rows["between"]).sum()),
            "none_safe": int((rows["limit_mm_s"] == 0).sum()),
            "singular": int((rows["limited_by"] == "singularity").sum()),
            "lowest_limit_mm_s": rows["limit_mm_s"][least],
            "lowest_at_waypoint": rows["waypoint"][least],
            "lowest_at_s": rows["t_s"][least],
            "duration_s": self.trajectory.duration,
            "retimed_duration_s": None if retimed is None else float(retimed.time[-1]),
            "not_retimed_because": slowing.why or None,
            "retimed_contact_onset_s": changes.get("motion.contact_onset_s"),
            "retimed_eased": slowing.eased,
            "directions": self._searched,
            "acceptable": self._judged.acceptable,
            "verdict": self._judged.to_json(),
            "retimed_verdict": None if slowing.judged is None else slowing.judged.to_json(),
            "law": "exact",
        }

    def answer_warnings(self, rows: pl.DataFrame, summary: Mapping[str, Any]) -> list[AnswerWarnings]:  # noqa: D102
        verdicts = {"the trajectory as given": summary["verdict"], "slowed down": summary["retimed_verdict"] or {}}
        return [
            *(AnswerWarnings(which, verdict.get("warnings", ())) for which, verdict in verdicts.items()),
            *self._warned(rows, "waypoint"),
        ]

    def lines(self, summary: Mapping[str, Any]) -> list[str]:  # noqa: D102
        none, places = summary["none_safe"], summary["waypoints"] + summary["moments_between"]
        over, moments, singular = summary["over_between"], summary["moments_between"], summary["singular"]
        lines = [
            f"as given, {summary['duration_s']:.4g} s: {_verdict_words(summary['verdict'])}",
            f"{summary['over']} of {summary['waypoints']} waypoints are passed faster than is safe there",
        ]
        if moments:
            lines.append(f"between them the arm is faster than is safe at {over} of {moments} moments")
        if singular:
            lines.append(
                f"at {singular} of {places} places, at or near a singularity, no straight line can be followed: their "
                "limits come from the trajectory's own force distribution"
            )
        if none:
            lines.append(f"at {none} of {places} places no speed is safe")
        lines.append(
            f"lowest limit: {no_more_than(summary['lowest_limit_mm_s'])} mm/s "
            f"at waypoint {summary['lowest_at_waypoint']} ({summary['lowest_at_s']:.4g} s)"
        )
        if summary.get("fails_with_finer_steps"):
            lines.append(f"speeds among these are {FAILS_WITH_FINER_STEPS}")
        lines.append(f"directions: {summary['directions']}")
        if summary["retimed_duration_s"] is None:
            lines.append(f"there is no slower trajectory: {summary['not_retimed_because']}")
        else:
            lines.append(
                f"slowed down, {summary['retimed_duration_s']:.4g} s instead of {summary['duration_s']:.4g} s: "
                f"{_verdict_words(summary['retimed_verdict'])}"
            )
        onset = summary.get("retimed_contact_onset_s")
        if onset is not None:
            lines.append(
                f"there contact begins at the same place of the path, {onset:.6g} s after the start: "
                "give this motion.contact_onset_s beside the slowed file"
            )
        return lines


def _verdict_words(verdict: dict[str, Any]) -> str:
    """A verdict of the summary in a sentence."""
    word = {True: "ACCEPTABLE", False: "NOT ACCEPTABLE", None: "NO VERDICT"}[verdict["acceptable"]]
    return f"{word}. {verdict['reason']}"
