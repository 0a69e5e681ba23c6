"""Joint motions made of moves, strokes and rests, with continuous position, speed and acceleration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from bumpstop.arrays import FloatArray

# Peaks of the fifth-degree move from rest to rest, for a unit distance in a unit time.
_PEAK_SPEED, _PEAK_ACCELERATION = 1.875, 10 / np.sqrt(3)
# Peak over mean acceleration of a smooth ramp (3 s^2 - 2 s^3) between two speeds.
RAMP_PEAK = 1.5


@dataclass(frozen=True, eq=False)
class TimedPath:
    """Waypoints joined by polynomials of fifth degree, which have position, speed and acceleration of both ends.

    A ROS joint trajectory controller joins waypoints with accelerations in the same way.

    Attributes:
        t: (P,) from 0 on, increasing [s].
        q, qd, qdd: (P, n) [rad or m, and per second].
    """

    t: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray

    @property
    def duration(self) -> float:
        """From the first waypoint to the last [s]."""
        return float(self.t[-1])

    def at(self, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Positions, speeds and accelerations (N, n) at times (N,) of the path."""
        k = np.clip(np.searchsorted(self.t, t, side="right") - 1, 0, len(self.t) - 2)
        h = (self.t[k + 1] - self.t[k])[:, None]
        s = (t - self.t[k])[:, None] / h
        p0, p1 = self.q[k], self.q[k + 1]
        v0, v1 = self.qd[k] * h, self.qd[k + 1] * h
        a0, a1 = self.qdd[k] * h * h, self.qdd[k + 1] * h * h
        c3 = 10 * (p1 - p0) - 6 * v0 - 4 * v1 - 1.5 * a0 + 0.5 * a1
        c4 = -15 * (p1 - p0) + 8 * v0 + 7 * v1 + 1.5 * a0 - a1
        c5 = 6 * (p1 - p0) - 3 * (v0 + v1) - 0.5 * (a0 - a1)
        q = p0 + s * (v0 + s * (a0 / 2 + s * (c3 + s * (c4 + s * c5))))
        qd = (v0 + s * (a0 + s * (3 * c3 + s * (4 * c4 + s * 5 * c5)))) / h
        qdd = (a0 + s * (6 * c3 + s * (12 * c4 + s * 20 * c5))) / (h * h)
        return q, qd, qdd

    def sampled(self, rate_hz: float) -> TimedPath:
        """The same path with waypoints at an even rate; the last interval may be shorter."""
        t = np.arange(0.0, self.duration, 1 / rate_hz)
        if self.duration - t[-1] < 1e-6:
            t = t[:-1]
        t = np.append(t, self.duration)
        return TimedPath(t, *self.at(t))


class PathBuilder:
    """Puts a :class:`TimedPath` together, piece by piece, every piece from rest to rest."""

    def __init__(self, start: FloatArray) -> None:
        self._t, self._q, self._qd = [0.0], [np.array(start, dtype=np.float64)], [np.zeros(len(start))]

    @property
    def q(self) -> FloatArray:
        """Where the path stands (n,)."""
        return self._q[-1]

    @property
    def duration(self) -> float:
        """So far [s]."""
        return self._t[-1]

    def build(self) -> TimedPath:
        """The path so far; every waypoint has no acceleration."""
        q = np.array(self._q)
        return TimedPath(np.array(self._t), q, np.array(self._qd), np.zeros_like(q))

    def rest(self, seconds: float) -> None:
        """Stand still."""
        self._add(seconds, self.q, np.zeros_like(self.q))

    def move_to(self, q: FloatArray, speed: FloatArray, acceleration: float) -> None:
        """All joints together, straight in joint space, within speeds (n,) and an acceleration."""
        distance = np.abs(np.asarray(q) - self.q)
        if distance.max() < 1e-9:
            return
        seconds = max(
            float((_PEAK_SPEED * distance / speed).max()),
            float(np.sqrt(_PEAK_ACCELERATION * distance.max() / acceleration)),
        )
        self._add(seconds, np.array(q, dtype=np.float64), np.zeros_like(self.q))

    def stroke(self, joint: int, to: float, speed: float, acceleration: float) -> None:
        """One joint at constant speed between two smooth ramps; slower where the way is too short for the ramps.

        Args:
            joint: which one, from 0.
            to: its position at the end.
            speed: of the segment between the ramps, positive.
            acceleration: peak of the ramps.
        """
        way = to - self.q[joint]
        if abs(way) < 1e-9:
            return
        speed = min(speed, top_speed(abs(way), acceleration, 0.0))
        ramp = RAMP_PEAK * speed / acceleration
        cruise = abs(way) / speed - ramp
        sign = 1.0 if way > 0 else -1.0
        velocity = np.zeros_like(self.q)
        velocity[joint] = sign * speed
        for seconds, part, end in (
            (ramp, sign * speed * ramp / 2, velocity),
            (cruise, sign * speed * cruise, velocity),
            (ramp, to, np.zeros_like(velocity)),
        ):
            if seconds < 1e-6:
                continue
            q = self.q.copy()
            q[joint] = part if end is not velocity else q[joint] + part
            self._add(seconds, q, end)

    def _add(self, seconds: float, q: FloatArray, qd: FloatArray) -> None:
        self._t.append(self._t[-1] + seconds)
        self._q.append(q)
        self._qd.append(qd)


def top_speed(way: float, acceleration: float, constant_share: float) -> float:
    """The fastest stroke of this length whose constant speed lasts for a share of the way, by peak acceleration."""
    return float(np.sqrt((1 - constant_share) * way * acceleration / RAMP_PEAK))
