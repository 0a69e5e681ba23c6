"""The first stretch of many straight motions: enough to foretell a collision without tracing it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Problem


@dataclass(frozen=True, eq=False)
class Arms:
    """Many poses and velocities of one scenario's arm.

    Attributes:
        problem: says all else.
        q: (N, dof) [rad or m].
        velocity: of the tip, base frame (N, 3) [m/s].
    """

    problem: Problem
    q: FloatArray
    velocity: FloatArray

    def rates(self, q: FloatArray) -> FloatArray:
        """Least-norm joint rates that move the tip with ``velocity`` from ``q`` (N, dof) [rad/s or m/s].

        The controller's own: scaled down as a whole where one would pass its velocity limit. Not finite where the pose
        is singular and motion.damping is 0.
        """
        rates = self.unlimited_rates(q)
        over = (np.abs(rates) / self.problem.robot.velocity).max(axis=1)
        return np.asarray(rates / np.maximum(1.0, over)[:, None])

    def unlimited_rates(self, q: FloatArray) -> FloatArray:
        """The same without velocity limits (N, dof)."""
        problem, robot = self.problem, self.problem.robot
        motion = problem.scenario.motion
        free = [j for j in range(robot.dof) if j not in problem.held]
        link, point = robot.frame(None)
        jacobian = robot.chain.jacobians(np.ascontiguousarray(q), link, point)[:, :, free]
        wanted = np.zeros((len(q), 6))
        wanted[:, :3] = self.velocity
        if motion.task == "position":
            jacobian, wanted = jacobian[:, :3], wanted[:, :3]
        gram = jacobian @ jacobian.transpose(0, 2, 1) + motion.damping**2 * np.eye(jacobian.shape[1])
        rates = np.zeros_like(q)
        if jacobian.shape[1] == jacobian.shape[2] and motion.damping == 0:
            rates[:, free] = _solve(jacobian, wanted)
        else:
            rates[:, free] = np.einsum("nij,ni->nj", jacobian, _solve(gram, wanted))
        return rates

    def limited(self, rate: FloatArray, wanted: FloatArray, time: FloatArray) -> FloatArray:
        """Rates (N, dof) as near to those wanted as joints come in a time (N, 1) [s], all by one share."""
        change = np.where(np.isfinite(wanted), wanted - rate, 0.0)
        with np.errstate(divide="ignore", invalid="ignore"):
            over = (np.abs(change) / self.problem.joint_acceleration).max(axis=1)[:, None] / time
        return np.asarray(rate + change / np.maximum(1.0, over))

    def point(self, q: FloatArray) -> FloatArray:
        """Contact point, base frame (N, 3) [m]."""
        link, point = self.problem.contact_point
        return np.asarray(self.problem.robot.chain.poses(np.ascontiguousarray(q), link, point)[:, :3, 3])

    def linear_jacobian(self, q: FloatArray) -> FloatArray:
        """J_v of the contact point, base frame (N, 3, dof)."""
        link, point = self.problem.contact_point
        return np.asarray(self.problem.robot.chain.jacobians(np.ascontiguousarray(q), link, point)[:, :3])


def _solve(matrix: FloatArray, target: FloatArray) -> FloatArray:
    """Solutions (N, rows); not finite where a matrix is singular."""
    try:
        return np.asarray(np.linalg.solve(matrix, target[..., None])[..., 0])
    except np.linalg.LinAlgError:
        whole = np.abs(np.linalg.det(matrix)) > 0
        out = np.full_like(target, np.nan)
        out[whole] = np.linalg.solve(matrix[whole], target[whole][..., None])[..., 0]
        return out


@dataclass(frozen=True, eq=False)
class ShortPath:
    """A stretch of ``length`` seconds of every motion, known at M + 1 moments that follow each other evenly.

    Between them distance and torque lie on the parabola through the three nearest moments, positions on the cubic that
    has position and rate of both ends.

    Attributes:
        length: of the stretch (N,) [s].
        q, qd: (M + 1, N, dof).
        distance: of the contact point along the normal (M + 1, N) [m].
        torque: a = J_v' n, (M + 1, N, dof) [Nm/N or 1].
        speed: of the contact point along the normal (M + 1, N) [m/s].
        normal: (N, 3).
    """

    arms: Arms
    length: FloatArray
    q: FloatArray
    qd: FloatArray
    distance: FloatArray
    torque: FloatArray
    speed: FloatArray
    normal: FloatArray

    @classmethod
    def of(cls, arms: Arms, normal: FloatArray, length: FloatArray, steps: int) -> ShortPath:
        """Follow the motions by so many steps of the midpoint rule, an even number."""
        step = length[:, None] / steps
        first = arms.rates(arms.q)
        q = [arms.q]
        qd = [np.zeros_like(first) if arms.problem.scenario.motion.start == "rest" else first]
        for _ in range(steps):
            # The line is left where a joint cannot follow: rates change no faster than the limits allow.
            middle = arms.limited(qd[-1], arms.rates(q[-1] + step / 2 * qd[-1]), step / 2)
            q.append(q[-1] + step * middle)
            qd.append(arms.limited(qd[-1], arms.rates(q[-1]), step))
        start = arms.point(arms.q)
        jacobians = [arms.linear_jacobian(p) for p in q]
        torque = np.stack([np.einsum("nij,ni->nj", jacobian, normal) for jacobian in jacobians])
        rates = np.stack(qd)
        return cls(
            arms=arms,
            length=length,
            q=np.stack(q),
            qd=rates,
            distance=np.stack([((arms.point(p) - start) * normal).sum(axis=1) for p in q]),
            torque=torque,
            speed=np.einsum("mnj,mnj->mn", torque, rates),
            normal=normal,
        )

    @property
    def steps(self) -> int:
        """M."""
        return len(self.q) - 1

    @property
    def turned(self) -> FloatArray:
        """Greatest change of the joint rates on the way, in shares of those at the start (N,)."""
        change = np.linalg.norm(self.qd - self.qd[0], axis=2).max(axis=0)
        with np.errstate(divide="ignore", invalid="ignore"):
            share = change / np.linalg.norm(self.qd[0], axis=1)
        return np.where(np.isfinite(share), share, np.inf)

    @property
    def fastest(self) -> FloatArray:
        """Greatest speed of the contact point along the normal (N,) [m/s]."""
        shares = np.tile(np.linspace(0, 1, 4 * self.steps + 1), (len(self.length), 1))
        return np.asarray(self._parabola(self.speed, shares).max(axis=1))

    @property
    def off_speed(self) -> FloatArray:
        """How far the velocity of the tip comes from the one asked for, in shares of that (N,)."""
        asked = self.arms.velocity
        link, point = self.arms.problem.robot.frame(None)
        chain = self.arms.problem.robot.chain
        worst = np.zeros(len(asked))
        for q, qd in zip(self.q, self.qd, strict=True):
            moves = np.einsum("nij,nj->ni", chain.jacobians(np.ascontiguousarray(q), link, point)[:, :3], qd)
            worst = np.maximum(worst, np.linalg.norm(moves - asked, axis=1))
        return np.asarray(np.nan_to_num(worst, nan=np.inf) / np.linalg.norm(asked, axis=1))

    def _parabola(self, table: FloatArray, share: FloatArray) -> FloatArray:
        """Values of a table (M + 1, N, ...) at shares (N, G) of the stretch: (N, G, ...)."""
        x = np.clip(share, 0, 1) * self.steps
        first = 2 * np.minimum(np.nan_to_num(x) // 2, self.steps // 2 - 1).astype(np.int64)
        rows = np.arange(x.shape[0])[:, None]
        y0, y1, y2 = (table[first + i, rows] for i in range(3))
        x = ((x - first) / 2).reshape(x.shape + (1,) * (y0.ndim - 2))
        return np.asarray(y0 + x * (4 * y1 - 3 * y0 - y2) + x**2 * (2 * y0 + 2 * y2 - 4 * y1))

    def torque_at(self, share: FloatArray) -> FloatArray:
        """A at shares (N, G) of the stretch, level beyond it: (N, G, dof)."""
        return self._parabola(self.torque, share)

    def share_at(self, distance: FloatArray) -> FloatArray:
        """The share of the stretch after which the contact point is that far (N, G), 0 to 1."""
        x = np.clip(distance / np.maximum(self.distance[-1][:, None], 1e-12), 0, 1)
        for _ in range(3):
            # Newton's method; the speed is the slope.
            slope = self._parabola(self.speed, x) * self.length[:, None]
            step = (self._parabola(self.distance, x) - distance) / np.where(slope > 0, slope, np.inf)
            x = np.clip(x - step, 0, 1)
        return np.asarray(x)

    def time_of(self, distance: FloatArray) -> FloatArray:
        """When the contact point is that far (N,) [s], at most the length of the stretch."""
        return np.asarray(self.share_at(distance[:, None])[:, 0] * self.length)

    def speed_at(self, distance: FloatArray) -> FloatArray:
        """Speed of the contact point along the normal (N,) [m/s] when it is that far."""
        return self._parabola(self.speed, self.share_at(distance[:, None]))[:, 0]

    def rates_at(self, time: FloatArray) -> FloatArray:
        """Joint rates (N, dof) at a time (N,) [s] of the stretch."""
        return self._parabola(self.qd, (time / self.length)[:, None])[:, 0]

    def position_at(self, time: FloatArray) -> FloatArray:
        """Joint positions (N, dof) at a time (N,) [s] of the stretch."""
        x = np.clip(time / self.length, 0, 1) * self.steps
        first = np.minimum(np.nan_to_num(x).astype(np.int64), self.steps - 1)
        rows, step = np.arange(len(time)), (self.length / self.steps)[:, None]
        q0, q1 = self.q[first, rows], self.q[first + 1, rows]
        d0, d1 = self.qd[first, rows] * step, self.qd[first + 1, rows] * step
        y = (x - first)[:, None]
        return np.asarray(q0 + y * d0 + y**2 * (3 * (q1 - q0) - 2 * d0 - d1) + y**3 * (2 * (q0 - q1) + d0 + d1))
