"""How fast a trajectory may be followed where every collision on the way is to keep to the limit of its place."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.errors import InputError
from bumpstop.study.directions import STANDS
from bumpstop.study.pose_batch import PoseBatch
from bumpstop.study.prediction import predicted_speed_limit, stopping_time_per_speed, undetected_force
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.speed.speed_search import CLOSE

if TYPE_CHECKING:
    import polars as pl

    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem
    from bumpstop.collision.trajectory.trajectory import Trajectory


# Rows that the joints reach by turning no farther keep to a row's limit too [rad or m].
_BESIDE = 0.02


def max_penetration_travel(problem: CollisionProblem) -> float:
    """How far an arm goes from contact to the force that is allowed [m]."""
    return allowed_force(problem) / problem.stiffness


def max_path_speed(
    problem: CollisionProblem, trajectory: Trajectory, travelled: FloatArray, direction: FloatArray, rows: pl.DataFrame
) -> FloatArray:
    """Greatest path speed at every row, 0 to 1, at which no collision passes the limit of the row where it begins.

    An arm whose joints contact loads little at one row, and that speeds up right behind it, hits as hard as one that is
    too fast there. So a limit holds for the way on which the force may grow to what is allowed. Where joints turn more
    than a straight line asks for, the undetectable force does, with the rates that the joints have on that way.

    The path speed stays below every limit by as much as the search leaves open, and for some way on both sides of its
    row. It stays below what lies between two rows, whose own limits were not looked for, as far as the rows beside them
    tell. An arm that stands, or is slower than all these limits anyway, keeps its own time: a pause is no longer than
    before.

    Args:
        problem: of the straight lines that speed limits are of.
        trajectory: with a waypoint for every row.
        travelled: way of the contact point to every row (rows,) [m].
        direction: of the tip, unit vectors (rows, 3).
        rows: of the speed limits.

    Raises:
        InputError: what stays undetected at some row leaves no speed there.
    """
    speed = np.maximum(rows["speed_mm_s"].to_numpy() / 1e3, STANDS)
    limit = rows["limit_mm_s"].to_numpy() / 1e3
    share = _least_beside(min_between(trajectory.time, np.minimum(1.0, limit / speed)))
    # Limits in themselves, not shares of a speed that may be next to none: they hold for faster rows behind.
    limit = np.where(share < 1, np.minimum(limit, _least_beside(min_between(trajectory.time, limit))), limit)
    turning = rows["limited_by"].is_in(["joint_rates", "singularity"]).to_numpy()
    here = np.arange(rows.height)
    first = (np.searchsorted(travelled, travelled - max_penetration_travel(problem), side="right") - 1).clip(min=0)
    lowest = sliding_min(np.where(turning, np.inf, limit), first, here)
    torque = np.einsum(
        "nij,ni->nj", PoseBatch(problem, trajectory.position, direction).linear_jacobian(trajectory.position), direction
    )
    undetectable = np.where(
        turning, undetected_force(problem, torque, problem.scenario.verdict.accepted_probability), -1.0
    )
    most = -sliding_min(-undetectable, first, here)
    gain = stopping_time_per_speed(problem, trajectory.at(trajectory.time, 1)) / speed
    turned = np.where(most < 0, np.inf, predicted_speed_limit(problem, most, gain, allowed_force(problem)))
    if (turned <= 0).any():
        # The rows beside it are left no speed either, whatever their own limits are.
        place = f"at {trajectory.time[int(np.argmax(turned <= 0))]:.6g} s, where joints turn more than a line asks for,"
        told = f"{place} the force that may stay undetected is predicted to be over the allowed one: no speed is known"
        raise InputError("motion.file", f"{told} to be safe", "change the path")
    allowed = (1 - CLOSE) * np.minimum(np.minimum(limit, lowest), turned)
    own = np.minimum(np.where(share < 1, (1 - CLOSE) * share, 1.0), allowed / speed)
    turned_yet = np.append(0.0, np.cumsum(np.abs(np.diff(trajectory.position, axis=0)).max(axis=1)))
    first = np.minimum(np.searchsorted(turned_yet, turned_yet - _BESIDE), here - 1).clip(min=0)
    last = np.maximum(np.searchsorted(turned_yet, turned_yet + _BESIDE, side="right") - 1, here + 1)
    last = last.clip(max=here[-1])
    slow_enough = sliding_min(allowed, first, last) / speed
    return np.minimum(own, np.maximum(sliding_min(own, first, last), slow_enough))


def min_between(time: FloatArray, value: FloatArray) -> FloatArray:
    """What values (N,) at times (N,) come down to between each two of them (N - 1,).

    Where they fall from both sides they go on so until they meet, but never by more than half of the lower one: limits
    have corners there, where another joint or tick begins to count. Else it is the lower of the two.
    """
    step = np.diff(time)
    fall = -np.diff(value) / step
    lower = np.minimum(value[:-1], value[1:])
    before, after = np.pad(fall[:-1], (1, 0)), np.pad(-fall[1:], (0, 1))
    falls = (before > 0) & (after > 0)
    before, after = np.where(falls, before, 1.0), np.where(falls, after, 1.0)
    met = (before * value[1:] + after * value[:-1] - before * after * step) / (before + after)
    return np.asarray(np.where(falls, np.clip(met, 0.5 * lower, lower), lower))


def _least_beside(between: FloatArray) -> FloatArray:
    """At every row (N,) the lower of the values between it and its neighbours (N - 1,)."""
    return np.asarray(np.minimum(np.append(between, np.inf), np.append(np.inf, between)))


def sliding_min(values: FloatArray, first: npt.NDArray[np.int64], last: npt.NDArray[np.int64]) -> FloatArray:
    """The least of ``values[first]`` to ``values[last]``, both among them (ranges,).

    By the least of 1, 2, 4, 8 ... neighbours, of which two cover any range.
    """
    level = np.floor(np.log2(last - first + 1)).astype(np.int64)
    found = np.empty(len(first))
    least = values
    for k in range(int(level.max(initial=0)) + 1):
        if k:
            least = np.minimum(least[: -(2 ** (k - 1))], least[2 ** (k - 1) :])
        at = level == k
        found[at] = np.minimum(least[first[at]], least[last[at] - 2**k + 1])
    return found
