"""Recordings and fits that verdicts are asked of."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np

import bumpstop as bs
from bumpstop.identification import (
    DynamicsFit,
    JointModelFit,
    identify_dynamics,
    identify_joint_model,
)
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from identification.drives import fourier
from identification.drives import planted as with_drives
from identification.test_dynamics_fit import planted


def sweeps(robot: bs.Robot, *, noise: float = 0.5, seed: int = 0) -> Recording:
    """One joint after the other goes up and down, the others stand."""
    rng, rate = np.random.default_rng(seed), 100.0
    base = np.clip(np.array([0.3, -1.2, 1.4, -0.6, 1.1, 0.4, 0.2])[: robot.dof], robot.lower, robot.upper)
    t = np.arange(0, 3.0, 1 / rate)
    parts = []
    for j in range(robot.dof):
        q = np.tile(base, (t.size, 1))
        q[:, j] += 0.4 * (1 - np.cos(2 * np.pi * t / 3)) * np.sin(4 * np.pi * t / 3)
        parts.append(q)
    q = np.concatenate(parts)
    qd = np.gradient(q, 1 / rate, axis=0)
    qdd = np.gradient(qd, 1 / rate, axis=0)
    share = 1 / (1 + np.arange(robot.dof))
    tau = inverse_dynamics(robot, q, qd, qdd) + share * (4 * np.tanh(qd / 0.01) + 2.5 * qd + 0.3 * qdd)
    tau += noise * share * rng.normal(size=tau.shape)
    return Recording(t=np.arange(len(q)) / rate, q=q + 1e-5 * rng.normal(size=q.shape), tau=tau)


@cache
def good() -> tuple[bs.Robot, Recording, DynamicsFit]:
    robot = bs.Robot.load("ur10e")
    log = planted(robot, 1, seconds=15.0)
    return robot, log, identify_dynamics(log, robot, cutoff_hz=6.0)


@cache
def currents_of_known_drives() -> tuple[bs.Robot, Recording]:
    robot = bs.Robot.load("ur5e")
    return robot, with_drives(robot, fourier(robot, 12.0, 94.0, 1), 1)[1]


@cache
def joint_model_fit() -> JointModelFit:
    robot, log = currents_of_known_drives()
    return identify_joint_model(log, robot, cutoff_hz=8.0)


def with_current(log: Recording, joint: int, column: np.ndarray) -> Recording:
    assert log.current is not None
    current = log.current.copy()
    current[:, joint] = column
    return replace(log, current=current)


def shifted(log: Recording, seconds: float) -> Recording:
    """The same motion with torques or currents that come later."""
    later = {
        name: np.stack([np.interp(log.t - seconds, log.t, x) for x in value.T], axis=1)
        for name in ("current", "tau")
        if (value := getattr(log, name)) is not None
    }
    return replace(log, **later)
