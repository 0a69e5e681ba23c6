"""Arms that move without contact: rows of times, positions, rates, accelerations and torques."""

from __future__ import annotations

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.model import Robot, inverse_dynamics
from bumpstop.recording import Recording

UR5E = Robot.load("ur5e")
DT = 0.002
# Rows until the window of 70 ms is full.
FILLING = 35


def moving(robot: Robot, rows: int = 1000, dt: float = DT, seed: int = 1, pace: float = 1) -> tuple[FloatArray, ...]:
    """Times, positions, rates, accelerations and torques of a smooth motion without contact."""
    rng = np.random.default_rng(seed)
    t = dt * np.arange(rows)
    rate, phase = pace * rng.uniform(1, 3, robot.dof), rng.uniform(0, 6, robot.dof)
    angle = t[:, None] * rate + phase
    q, qd, qdd = 0.4 * np.sin(angle), 0.4 * rate * np.cos(angle), -0.4 * rate**2 * np.sin(angle)
    return t, q, qd, qdd, inverse_dynamics(robot, q, qd, qdd)


def parabola(robot: Robot, rows: int = 500, dt: float = DT) -> tuple[FloatArray, ...]:
    """Constant accelerations, which a causal fit of degree 2 differentiates without error."""
    t = dt * np.arange(rows)
    qdd = np.ones((rows, 1)) * np.linspace(0.1, 0.4, robot.dof)
    q, qd = 0.2 + qdd * t[:, None] ** 2 / 2, qdd * t[:, None]
    return t, q, qd, qdd, inverse_dynamics(robot, q, qd, qdd)


def live(rows: FloatArray, seed: int = 7) -> FloatArray:
    """The rows of a sensor that is alive: no value is the one before to the last bit."""
    return rows + 1e-13 * np.random.default_rng(seed).normal(size=rows.shape) * (1 + np.abs(rows))


def free_motion() -> Recording:
    """A UR5e without contact at 250 Hz for 40 s, with rates; its torques have 0.5 Nm of noise."""
    t = 0.004 * np.arange(10_000)
    phase = 0.3 * t[:, None] + np.arange(6)
    q, qd, qdd = np.sin(phase), 0.3 * np.cos(phase), -0.09 * np.sin(phase)
    tau = inverse_dynamics(UR5E, q, qd, qdd) + np.random.default_rng(1).normal(0, 0.5, q.shape)
    return Recording(t=t, q=q, qd=qd, tau=tau)
