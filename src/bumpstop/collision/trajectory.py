"""Motions given as joint trajectories: positions over time, with what lies between the rows."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision.piecewise_cubic import PiecewiseCubic
from bumpstop.collision.trajectory_file import Rows, read_rows, refusal
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

    from bumpstop.collision.scenario import Scenario
    from bumpstop.model import Robot

# A longer motion is more than one: the time to compute grows with the square of its length.
_MOST_STEPS = 120_000
# Between rows a cubic may pass a limit by rounding, or where a row lies on it by what the file's digits leave [rad].
_ROUNDING = 1e-6


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

    @property
    def coefficients(self) -> FloatArray:
        """Of the cubics: (rows - 1, 4, dof), highest power of the time since the row first."""
        return np.ascontiguousarray(self._spline.c.transpose(1, 0, 2))


def load_motion(path: Path, robot: Robot, step: float = 1e-3) -> Trajectory:
    """Read and check a trajectory file.

    Args:
        path: of the file.
        robot: whose joints it moves.
        step: at which it is checked, and of which it has 1 to 120 000 [s].

    Raises:
        InputError: the file cannot be used, or the motion passes a limit of the robot; names file, row and column.
    """
    rows = read_rows(path, robot)
    _check_rows(path, rows, robot)
    trajectory = Trajectory(rows.time - rows.time[0], rows.position, rows.velocity)
    if not step <= trajectory.duration <= _MOST_STEPS * step:
        raise refusal(
            path,
            f"the motion takes {trajectory.duration:.6g} s",
            f"wanted {step:g} to {_MOST_STEPS * step:g} s, 1 to {_MOST_STEPS} simulation steps",
        )
    _check_between(path, rows, trajectory, robot, step)
    return trajectory


def load_trajectory(scenario: Scenario, robot: Robot) -> Trajectory:
    """Read and check the trajectory of a scenario.

    Raises:
        InputError: the file cannot be used, or the motion passes a limit of the robot; names file, row and column.
    """
    motion = scenario.motion
    assert motion.file is not None
    trajectory = load_motion(scenario.folder / motion.file, robot, scenario.simulation.step_s)
    time = motion.contact_time
    if time != "uniform" and not time < trajectory.duration:
        raise InputError(
            "motion.contact_time", f"{time:g} s is not in the motion", f"wanted less than {trajectory.duration:.6g} s"
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
        raise refusal(
            path,
            f"{rows.row} {i + 1}, column {rows.position_names[j]}: joint {j + 1} at {rows.position[i, j]:.6g} is "
            "outside its limits",
            f"valid: {robot.lower[j]:g} to {robot.upper[j]:g} {_unit(robot, j)}",
        )


def _check_between(path: Path, rows: Rows, trajectory: Trajectory, robot: Robot, step: float) -> None:
    """Limits at every simulation step: the curve between two rows may pass what the rows keep."""
    t = np.append(np.arange(0, trajectory.duration, step), trajectory.duration)
    position, rate = trajectory.at(t), trajectory.at(t, 1)
    over = np.argwhere(np.abs(rate) > robot.velocity * (1 + _ROUNDING))
    if len(over):
        i, j = (int(x) for x in over[0])
        raise refusal(
            path,
            f"{_between(rows, trajectory, t[i])}, column {rows.position_names[j]}: joint {j + 1} moves at "
            f"{abs(rate[i, j]):.4g} {_unit(robot, j)}/s",
            f"its limit is {robot.velocity[j]:.4g} {_unit(robot, j)}/s",
        )
    outside = np.argwhere((position < robot.lower - _ROUNDING) | (position > robot.upper + _ROUNDING))
    if len(outside):
        i, j = (int(x) for x in outside[0])
        raise refusal(
            path,
            f"{_between(rows, trajectory, t[i])}, column {rows.position_names[j]}: the curve through the rows takes "
            f"joint {j + 1} to {position[i, j]:.6g}, outside its limits",
            f"valid: {robot.lower[j]:g} to {robot.upper[j]:g} {_unit(robot, j)}; give more rows there",
        )


def _between(rows: Rows, trajectory: Trajectory, t: float) -> str:
    i = int(np.clip(np.searchsorted(trajectory.time, t, side="right"), 1, len(trajectory.time) - 1))
    return f"between {rows.row}s {i} and {i + 1} (t = {t + rows.time[0]:.4g} s)"


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
