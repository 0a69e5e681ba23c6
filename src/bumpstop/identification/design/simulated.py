"""Recordings that an arm with a known joint model would have made, to rehearse a plan and to test what finds models."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.model import inverse_dynamics, with_rotors
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.recording import Recording

if TYPE_CHECKING:
    from bumpstop.identification.design.timed_path import TimedPath
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot

_ROUNDS = 100
_ROUNDING = 1e-12
_MAX_DOUBLINGS = 60


@dataclass(frozen=True, kw_only=True)
class SensorNoise:
    """What the simulated drives and encoders add.

    Attributes:
        current_sd: of the measured current, independent from sample to sample [current].
        friction_sd: of friction from stroke to stroke: a slow noise with a memory of ``friction_memory_s`` [current].
        friction_memory_s: correlation time of that [s].
        position_sd: of the measured position [rad].
        lost: share of samples that never arrive.
        jitter: of the sampling times, standard deviation as a share of the interval.
    """

    current_sd: float = 0.0
    friction_sd: float = 0.0
    friction_memory_s: float = 2.0
    position_sd: float = 0.0
    lost: float = 0.0
    jitter: float = 0.0


def simulated_recording(
    robot: Robot,
    model: JointTorqueModel,
    path: TimedPath,
    *,
    rate_hz: float = 250.0,
    noise: SensorNoise | None = None,
    seed: int = 0,
    gravity: tuple[float, float, float] = STANDARD_GRAVITY,
) -> Recording:
    """Positions and motor currents along a path, as the joint model turned round gives them.

    The arm follows the path exactly. Torques are those of Newton and Euler; reflected inertia is the model's, rotors of
    the robot are left out. The current of every sample is found by regula falsi on the model itself.

    Args:
        robot: with inertia; loaded as it shall be.
        model: of its joints, one for each.
        path: what it does.
        rate_hz: of the samples.
        noise: what is added; default: nothing.
        seed: of the noise.
        gravity: acceleration of free fall in the base frame [m/s2].

    Raises:
        InputError: a model of another number of joints.
    """
    if len(model.joints) != robot.dof:
        raise InputError("model", f"has {len(model.joints)} joints", f"{robot.name} has {robot.dof}")
    noise = noise or SensorNoise()
    rng = np.random.default_rng(seed)
    t = np.arange(0.0, path.duration, 1 / rate_hz)
    t = t + np.clip(rng.normal(size=t.size) * noise.jitter, -0.45, 0.45) / rate_hz
    t = t[rng.random(t.size) >= noise.lost]
    q, qd, qdd = path.at(np.clip(t, 0.0, path.duration))
    current = currents(model, inverse_dynamics(with_rotors(robot, 0.0), q, qd, qdd, gravity=gravity), qd, qdd)
    current += noise.current_sd * rng.normal(size=current.shape)
    current += noise.friction_sd * np.sign(qd) * _slow(rng, t, robot.dof, noise.friction_memory_s)
    q = q + noise.position_sd * rng.normal(size=q.shape)
    names = tuple(joint.name for joint in robot.joints)
    return Recording(t=t, q=q, current=current, joint_names=names, robot=robot.name, source="simulated")


def currents(model: JointTorqueModel, tau: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
    """Motor currents (N, n) with which a model gives these torques; rows follow each other in time.

    Raises:
        InputError: a torque that no current gives.
    """
    reach = np.ones(tau.shape)
    for _ in range(_MAX_DOUBLINGS):
        short = (model.torque(reach, qd, qdd) < tau) | (model.torque(-reach, qd, qdd) > tau)
        if not short.any():
            break
        reach = np.where(short, 2 * reach, reach)
    else:
        joint = int(np.argwhere(short)[0][1])
        raise InputError("model", f"joint {joint + 1} gives no torque of {float(np.abs(tau[:, joint]).max()):.3g}")
    low, high = -reach, reach
    under, over = model.torque(low, qd, qdd) - tau, model.torque(high, qd, qdd) - tau
    kept = np.zeros(tau.shape)  # which end stayed last time
    for _ in range(_ROUNDS):
        # Regula falsi, the weight of an end that stays twice halved (Illinois).
        spread = over - under
        middle = np.where(spread > 0, (low * over - high * under) / np.where(spread > 0, spread, 1.0), low)
        value = model.torque(middle, qd, qdd) - tau
        if float(np.abs(value).max()) < _ROUNDING * max(1.0, float(np.abs(tau).max())):
            break
        below = value < 0
        over = np.where(below, np.where(kept > 0, over / 2, over), value)
        under = np.where(below, value, np.where(kept < 0, under / 2, under))
        low, high, kept = np.where(below, middle, low), np.where(below, high, middle), np.where(below, 1.0, -1.0)
    return middle


def _slow(rng: np.random.Generator, t: FloatArray, joints: int, memory_s: float) -> FloatArray:
    """Noise of standard deviation 1 that forgets within ``memory_s`` (N, joints)."""
    from scipy.signal import lfilter

    keep = float(np.exp(-float(np.median(np.diff(t))) / memory_s))
    white = rng.normal(size=(t.size, joints))
    white[1:] *= np.sqrt(1 - keep * keep)
    slow: FloatArray = lfilter([1.0], [1.0, -keep], white, axis=0)
    return slow
