"""Motions given as joint trajectories: positions over time, with what lies between the rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision.trajectory.piecewise_cubic import PiecewiseCubic
from bumpstop.collision.trajectory.trajectory_file import FIELD, Rows, read_rows, refusal
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from bumpstop.collision.scenario.scenario import Scenario
    from bumpstop.model import Robot

# A longer motion is more than one: the time to compute grows with the square of its length.
_MAX_STEPS = 120_000
# Between rows a cubic may pass a limit by rounding, or where a row lies on it by what the file's digits leave [rad].
_ROUNDING = 1e-6
# No number of a file may be greater [s, rad or m, and per s]: a clock counts from 1970, a joint without limits turns.
_MAX_VALUE = 1e12


class JointLimitError(InputError):
    """A motion passes a limit of a joint.

    Attributes:
        passed: when, which and by how much, without the rows of a file.
    """

    passed = ""

    @classmethod
    def at(cls, t: float, what: str, limit: str, *, place: str, advice: str = "") -> JointLimitError:
        """At a time [s], and at a place of a file; ``advice`` is for who can change that file."""
        error = cls(FIELD, f"{place}: {what}", limit + advice)
        error.passed = f"at t = {t:.4g} s {what}; {limit}"
        return error


@dataclass(frozen=True, eq=False)
class Trajectory:
    """A joint trajectory.

    With velocities the rows are joined by cubic Hermite splines, which have position and velocity of every row. Without
    them by the cubic spline through the positions, whose acceleration is continuous (end condition: not-a-knot).

    Attributes:
        time: of the rows (rows,), from 0 on, ascending [s].
        position: (rows, dof) [rad or m].
        velocity: (rows, dof) [rad/s or m/s], or None.
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray | None = None

    @property
    def duration(self) -> float:
        """From the first row to the last [s]."""
        return float(self.time[-1])

    @cached_property
    def stops_short(self) -> bool:
        """Whether it ends while the arm still moves.

        The last row is no place of rest: a joint is faster there than a hundredth of the greatest speed of all.
        """
        rates = np.abs(self.at(np.linspace(0, self.duration, 500), 1))
        return bool((rates[-1] > 0.01 * rates.max()).any())

    @cached_property
    def _spline(self) -> PiecewiseCubic:
        if self.velocity is not None:
            return PiecewiseCubic.hermite(self.time, self.position, self.velocity)
        return PiecewiseCubic.spline(self.time, self.position)

    def at(self, t: float | FloatArray, derivative: int = 0) -> FloatArray:
        """Joint positions at times of the trajectory, or their derivatives.

        Args:
            t: scalar or (N,), 0 to :attr:`duration` [s].
            derivative: 0: position [rad or m], 1: rate, 2: acceleration.

        Returns:
            (dof,) or (N, dof).
        """
        return self._spline(t, derivative)

    def part(self, begin: float, end: float, speed: float = 1.0) -> Trajectory:
        """The motion between two times, at a share of its speed; its cubics are the same.

        Args:
            begin: of it, from 0 on [s].
            end: of it, at most :attr:`duration` [s].
            speed: 1 is that of the trajectory; the times of the part are longer by 1 / speed.
        """
        inner = self.time[(self.time > begin) & (self.time < end)]
        time = np.concatenate([[begin], inner, [end]])
        # A cubic is known by position and rate at both ends.
        return Trajectory((time - begin) / speed, self.at(time), speed * self.at(time, 1))

    def extremes(self, derivative: int) -> tuple[FloatArray, FloatArray]:
        """Where joint positions or rates are greatest and least between every two rows.

        Args:
            derivative: 0: of the positions, 1: of the rates.

        Returns:
            Times since the earlier row [s] and values there [rad or m, or per s], each (rows - 1, places, dof): both
            ends, and the places between them where the derivative is zero.
        """
        cubic = self._spline.c
        length = np.diff(self.time)[:, None]
        inside = _zero_rates(cubic) if derivative == 0 else [_vertex(3 * cubic[0], 2 * cubic[1])]
        places = [np.zeros(cubic.shape[1:]), np.broadcast_to(length, cubic.shape[1:])]
        at = np.stack([*places, *(np.clip(np.nan_to_num(x), 0.0, length) for x in inside)], axis=1)
        c3, c2, c1, c0 = (c[:, None] for c in cubic)
        if derivative == 0:
            return at, c0 + at * (c1 + at * (c2 + at * c3))
        return at, c1 + at * (2 * c2 + at * 3 * c3)

    @property
    def coefficients(self) -> FloatArray:
        """Of the cubics: (rows - 1, 4, dof), highest power of the time since the row first."""
        return np.ascontiguousarray(self._spline.c.transpose(1, 0, 2))


def _vertex(square: FloatArray, linear: FloatArray) -> FloatArray:
    """Where parabolas turn; not finite where there is no such place."""
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        return -linear / (2 * square)


def _zero_rates(cubic: FloatArray) -> list[FloatArray]:
    """The two places where cubics (4, ...) turn; not finite where there is none."""
    a, half, c = 3 * cubic[0], cubic[1], cubic[2]
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        # The sum has terms of one sign, so that nothing cancels.
        sum_ = -(half + np.copysign(np.sqrt(half**2 - a * c), half))
        return [sum_ / a, c / sum_]


def load_motion(path: Path, robot: Robot, step: float = 1e-3) -> Trajectory:
    """Read and check a trajectory file.

    Args:
        path: of the file.
        robot: whose joints it moves.
        step: of which it has 1 to 120 000 [s].

    Raises:
        InputError: the file cannot be used, or the motion passes a limit of the robot; names file, row and column.
    """
    return checked_motion(path, read_rows(path, robot), robot, step)


def checked_motion(path: Path, rows: Rows, robot: Robot, step: float = 1e-3) -> Trajectory:
    """The trajectory of rows, however they were read; arguments, result and errors as above."""
    _check_rows(path, rows, robot)
    trajectory = Trajectory(rows.time - rows.time[0], rows.position, rows.velocity)
    if not step <= trajectory.duration <= _MAX_STEPS * step:
        raise refusal(
            path,
            f"the motion takes {trajectory.duration:.6g} s",
            f"wanted {step:g} to {_MAX_STEPS * step:g} s, 1 to {_MAX_STEPS} simulation steps",
        )
    _check_between(path, rows, trajectory, robot)
    return trajectory


def load_trajectory(scenario: Scenario, robot: Robot) -> Trajectory:
    """Read and check the trajectory of a scenario.

    Raises:
        InputError: the file cannot be used, or the motion passes a limit of the robot; names file, row and column.
    """
    motion = scenario.motion
    assert motion.file is not None
    trajectory = load_motion(scenario.folder / motion.file, robot, scenario.simulation.step_s)
    time = motion.contact_onset_s
    if time != "uniform" and not time < trajectory.duration:
        raise InputError(
            "motion.contact_onset_s",
            f"{time:g} s is not in the motion",
            f"wanted less than {trajectory.duration:.6g} s",
        )
    return trajectory


def _check_rows(path: Path, rows: Rows, robot: Robot) -> None:
    if len(rows.time) < 2:
        raise refusal(path, f"has {len(rows.time)} {rows.row}s", "wanted at least 2")
    for values, names in (
        (rows.time[:, None], ["t"]),
        (rows.position, rows.position_names),
        (rows.velocity, rows.velocity_names),
    ):
        if values is None:
            continue
        bad = np.argwhere(~np.isfinite(values))
        if len(bad):
            i, j = bad[0]
            raise refusal(
                path, f"{rows.row} {i + 1}, column {names[j]}: {values[i, j]} cannot be used", "wanted a finite number"
            )
        bad = np.argwhere(np.abs(values) > _MAX_VALUE)
        if len(bad):
            i, j = bad[0]
            raise refusal(
                path,
                f"{rows.row} {i + 1}, column {names[j]}: {values[i, j]:g} cannot be used",
                f"wanted {-_MAX_VALUE:g} to {_MAX_VALUE:g}",
            )
    late = np.flatnonzero(np.diff(rows.time) <= 0)
    if late.size:
        i = int(late[0]) + 1
        raise refusal(
            path,
            f"{rows.row} {i + 1}, column t: {rows.time[i]:.9g} s is not after {rows.time[i - 1]:.9g} s",
            "wanted times that increase",
        )
    outside = np.argwhere((rows.position < robot.lower - _ROUNDING) | (rows.position > robot.upper + _ROUNDING))
    if len(outside):
        i, j = (int(x) for x in outside[0])
        raise JointLimitError.at(
            float(rows.time[i] - rows.time[0]),
            f"joint {j + 1} at {rows.position[i, j]:.6g} is outside its limits",
            f"valid: {robot.lower[j]:g} to {robot.upper[j]:g} {_unit(robot, j)}",
            place=f"{path}: {rows.row} {i + 1}, column {rows.position_names[j]}",
        )


def _check_between(path: Path, rows: Rows, trajectory: Trajectory, robot: Robot) -> None:
    """Limits on the whole way: the curve between two rows may pass what the rows keep."""
    at, rate = trajectory.extremes(1)
    over = np.argwhere((np.abs(rate) > robot.velocity * (1 + _ROUNDING)).any(axis=1))
    if len(over):
        i, j = (int(x) for x in over[0])
        worst = int(np.argmax(np.abs(rate[i, :, j])))
        fastest, limit = float(np.abs(rate[i, worst, j])), float(robot.velocity[j])
        digits = next(count for count in range(4, 18) if f"{fastest:.{count}g}" != f"{limit:.{count}g}")
        raise JointLimitError.at(
            float(trajectory.time[i] + at[i, worst, j]),
            f"joint {j + 1} moves at {fastest:.{digits}g} {_unit(robot, j)}/s",
            f"its limit is {limit:.{digits}g} {_unit(robot, j)}/s",
            place=f"{path}: {_between(rows, i, at[i, worst, j])}, column {rows.position_names[j]}",
        )
    at, position = trajectory.extremes(0)
    beyond = np.maximum(robot.lower - position, position - robot.upper)
    outside = np.argwhere((beyond > _ROUNDING).any(axis=1))
    if len(outside):
        i, j = (int(x) for x in outside[0])
        worst = int(np.argmax(beyond[i, :, j]))
        raise JointLimitError.at(
            float(trajectory.time[i] + at[i, worst, j]),
            f"the curve through the rows takes joint {j + 1} to {position[i, worst, j]:.6g}, outside its limits",
            f"valid: {robot.lower[j]:g} to {robot.upper[j]:g} {_unit(robot, j)}",
            place=f"{path}: {_between(rows, i, at[i, worst, j])}, column {rows.position_names[j]}",
            advice="; give more rows there",
        )


def _between(rows: Rows, piece: int, since: float) -> str:
    t = rows.time[piece] + since
    return f"between {rows.row}s {piece + 1} and {piece + 2} (t = {t:.4g} s)"


def _unit(robot: Robot, j: int) -> str:
    return "rad" if robot.joints[j].kind == "revolute" else "m"


def point_motion(
    trajectory: Trajectory, robot: Robot, place: tuple[int, FloatArray], t: FloatArray
) -> tuple[FloatArray, npt.NDArray[np.float64]]:
    """How the contact point moves at times of the trajectory.

    Args:
        trajectory: of the arm.
        robot: the arm.
        place: number of the link, from 0, and the point in its frame [m].
        t: (N,) [s].

    Returns:
        Velocity of the point, base frame (N, 3) [m/s], and J_v, its Jacobian (N, 3, dof).
    """
    link, point = place
    jacobian: FloatArray = robot.chain.jacobians(np.ascontiguousarray(trajectory.at(t)), link, point)[:, :3]
    return np.einsum("nij,nj->ni", jacobian, trajectory.at(t, 1)), jacobian


def point_places(trajectory: Trajectory, robot: Robot, place: tuple[int, FloatArray], t: FloatArray) -> FloatArray:
    """Where the contact point is at times of the trajectory (N,) [s]: base frame (N, 3) [m]. Arguments as above."""
    link, point = place
    poses: FloatArray = robot.chain.poses(np.ascontiguousarray(trajectory.at(t)), link, point)
    return poses[:, :3, 3]
