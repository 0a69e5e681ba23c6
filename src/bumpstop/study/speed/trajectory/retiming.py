"""The same path in its own time: slowed where a speed limit, a joint speed or a joint acceleration asks for it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision.trajectory.trajectory import Trajectory

# Of the joint limits: constraints hold at the moments of the grid, and what lies between keeps within the rest.
_SHARE = 0.98
# Between two rows of the output a cubic is this near to the path [rad or m].
_PATH = 5e-10
_MAX_PARTS = 1024  # between two waypoints


@dataclass(frozen=True, eq=False)
class Retimed:
    """A trajectory along the same path.

    Attributes:
        time: (rows,) [s], from 0.
        position, velocity, acceleration: (rows, dof). Every waypoint of the original is a row, bit for bit.
        waypoint: number of the row of every original waypoint.
        path_time: of the original at every row [s].
    """

    time: FloatArray
    position: FloatArray
    velocity: FloatArray
    acceleration: FloatArray
    waypoint: npt.NDArray[np.int64]
    path_time: FloatArray


def retime(
    trajectory: Trajectory, path_speed: FloatArray, velocity_limit: FloatArray, acceleration_limit: FloatArray
) -> Retimed:
    """Follow the path of a trajectory as fast as its limits allow, and nowhere faster than the original.

    The path speed lambda = du/dt, u being the original's time, obeys, for the path q(u) with derivatives ' in u,
    |q' lambda| <= velocity_limit and |q'' lambda^2 + q' a| <= acceleration_limit with a = d(lambda^2)/du / 2. In
    x = lambda^2 both are straight lines, so a backward pass finds the greatest x at every moment from which the rest
    can be followed, and a forward pass takes the greatest a that leads there (Pham and Pham, "A new approach to
    time-optimal path parameterization based on reachability analysis", 2018).

    Args:
        trajectory: with its waypoints as near to each other as ``path_speed`` needs them.
        path_speed: greatest lambda at every waypoint (rows,), 0 to 1.
        velocity_limit: of the joints (dof,) [rad/s or m/s].
        acceleration_limit: of the joints (dof,) [rad/s2 or m/s2].

    Raises:
        InputError: a waypoint allows no path speed at all, no path speed keeps the acceleration limits, or waypoints
            are too far apart for rows between them that keep to the path.
    """
    u = trajectory.time
    if (path_speed <= 0).any():
        raise InputError(
            "motion.file", f"the path speed is 0 at {u[int(np.argmax(path_speed <= 0))]:.6g} s", "change the path"
        )
    rate = trajectory.at(u, 1)
    with np.errstate(divide="ignore"):
        joint = (_SHARE * velocity_limit / np.abs(rate)).min(axis=1)
    most = np.minimum(np.minimum(path_speed, 1.0), joint) ** 2
    # A piece of the path has one acceleration of the path speed, and what it means is checked at both of its ends.
    after = trajectory.at(np.nextafter(u[:-1], np.inf), 2)
    before = trajectory.at(np.nextafter(u[1:], -np.inf), 2)
    step, limit = np.diff(u), _SHARE * acceleration_limit
    pieces = _Pieces(rate, after, before, step, limit)
    allowed = most.copy()
    for i in range(len(u) - 2, -1, -1):
        allowed[i] = pieces.max_start(i, float(most[i]), float(allowed[i + 1]))
        if not allowed[i] > 0:
            raise InputError(
                "motion.file", f"no path speed keeps the acceleration limits at {u[i]:.6g} s", "smooth the path"
            )
    x = np.empty_like(allowed)
    x[0] = allowed[0]
    for i in range(len(step)):
        x[i + 1] = min(allowed[i + 1], x[i] + 2 * step[i] * pieces.max_change(i, float(x[i])))
        if not x[i + 1] > 0:
            raise InputError(
                "motion.file", f"no path speed keeps the acceleration limits at {u[i + 1]:.6g} s", "smooth the path"
            )
    return _written(trajectory, x)


# A joint that the path speed accelerates less than this, per unit, is not accelerated by it at all.
_STILL = 1e-200
# Within a piece the square of the path speed falls to no less than this share: an arm that could only just stop at the
# end of a piece would not go on.
_MIN_LEFT = 0.01


class _Pieces:
    """What the acceleration limits leave of the path speed's own acceleration a, piece by piece of the path.

    At both ends of a piece that begins with x joints accelerate by A x + B a, so that |a + (A/B) x| <= limit / |B|.
    """

    def __init__(
        self, rate: FloatArray, after: FloatArray, before: FloatArray, step: FloatArray, limit: FloatArray
    ) -> None:
        """Compute the bounds, two for each joint.

        Args:
            rate: q' at the waypoints (rows, dof).
            after: q'' at the begin of every piece (rows - 1, dof).
            before: q'' at its end (rows - 1, dof).
            step: du of the pieces (rows - 1,) [s].
            limit: greatest accelerations (dof,) [rad/s2 or m/s2].
        """
        bend = np.concatenate([after, before], axis=1)
        reach = np.concatenate([rate[:-1], rate[1:] + 2 * step[:, None] * before], axis=1)
        limits = np.tile(limit, 2)
        moving = np.abs(reach) > _STILL
        divisor = np.where(moving, reach, 1.0)
        self._step = step
        self._room = np.where(moving, limits / np.abs(divisor), np.inf)
        self._drift = np.where(moving, bend / divisor, 0.0)
        with np.errstate(divide="ignore"):
            self._most = np.where(moving, np.inf, limits / np.abs(bend)).min(axis=1)

    def max_change(self, i: int, x: float) -> float:
        """The greatest a of piece i that begins with x."""
        return float((self._room[i] - self._drift[i] * x).min())

    def max_start(self, i: int, most: float, after: float) -> float:
        """The greatest x <= most from which some a keeps all limits and ends at no more than ``after``; 0: none.

        For a given x the a allowed are an interval, whose ends are concave and convex in x: it is empty beyond some
        x, found by halving.
        """
        room, drift, step = self._room[i], self._drift[i], float(self._step[i])

        def feasible(x: float) -> bool:
            if x > self._most[i]:
                return False
            shift = drift * x
            low = max(-float((room + shift).min()), -(1 - _MIN_LEFT) * x / (2 * step))
            high = min(float((room - shift).min()), (after - x) / (2 * step))
            return low <= high + 1e-12 * abs(high)

        if feasible(most):
            return most
        good, bad = 0.0, most
        for _ in range(60):
            middle = 0.5 * (good + bad)
            good, bad = (middle, bad) if feasible(middle) else (good, middle)
        return good


def _written(trajectory: Trajectory, x: FloatArray) -> Retimed:
    """Rows close enough together that cubics between them keep to the path."""
    u, path_speed = trajectory.time, np.sqrt(x)
    step = np.diff(u)
    change = np.diff(x) / (2 * step)
    length = 2 * step / (path_speed[1:] + path_speed[:-1])
    parts = 1
    while True:
        share = np.arange(parts) / parts
        t = (length[:, None] * share).ravel()
        piece = np.repeat(np.arange(len(step)), parts)
        begin = np.concatenate([[0.0], np.cumsum(length)])
        inside = path_speed[piece] * t + change[piece] / 2 * t**2
        moment = np.append(u[piece] + inside, u[-1])
        speed = np.append(path_speed[piece] + change[piece] * t, path_speed[-1])
        moment[::parts] = u
        time = np.append(begin[piece] + t, begin[-1])
        position = trajectory.at(moment)
        position[::parts] = trajectory.position
        velocity = trajectory.at(moment, 1) * speed[:, None]
        strays = _strays(trajectory, time, position, velocity, moment, speed)
        if strays <= _PATH:
            break
        if parts >= _MAX_PARTS:
            problem = f"{parts} rows between two waypoints still stray by {strays:.2g} from the path"
            raise InputError("motion.file", problem, "give waypoints that are closer together")
        parts *= 2
    if not trajectory.stops_short:
        # Where the digits of a file leave a rate, it would be one beside the speeds of a slow motion.
        velocity[-1] = 0.0
    acceleration = trajectory.at(moment, 2) * speed[:, None] ** 2
    acceleration += trajectory.at(moment, 1) * np.append(change[piece], change[-1])[:, None]
    return Retimed(time, position, velocity, acceleration, np.arange(len(u), dtype=np.int64) * parts, moment)


def _strays(
    trajectory: Trajectory,
    time: FloatArray,
    position: FloatArray,
    velocity: FloatArray,
    moment: FloatArray,
    speed: FloatArray,
) -> float:
    """Greatest distance of the cubics through the rows from the path, at the middle of every piece [rad or m]."""
    dt = np.diff(time)[:, None]
    middle = (position[1:] + position[:-1]) / 2 + dt / 8 * (velocity[:-1] - velocity[1:])
    # With a path speed that changes evenly in time the middle of the time lies here.
    on_path = moment[:-1] + dt[:, 0] * (3 * speed[:-1] + speed[1:]) / 8
    return float(np.abs(middle - trajectory.at(on_path)).max())
