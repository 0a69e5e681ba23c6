"""What detectors of collisions are made of: momentum, torque and residual of many recordings at once."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.detection import Detector, DetectorSettings, Thresholds
from bumpstop.model import coriolis_torque, gravity_torque, mass_matrix
from bumpstop.signal import causal_derivatives

if TYPE_CHECKING:
    from bumpstop.model import Robot

WINDOW_S = 0.07  # of the fit behind rates and accelerations: the same for all methods
_STEP_S = 1e-4  # along the motion, for the rate of the mass matrix


@dataclass(frozen=True, eq=False)
class Signals:
    """Signals of several recordings at one even rate.

    Attributes:
        dt: between rows [s].
        momentum: p = M(q) qd, (runs, rows, joints) [kg m2/s or kg m/s].
        force: b in dp/dt = b + tau_ext, b = tau + dT/dq - g, likewise [Nm or N].
        direct: torque of the motors minus Newton-Euler torque, likewise [Nm or N].
        torque: of the motors, likewise [Nm or N].
    """

    dt: float
    momentum: FloatArray
    force: FloatArray
    direct: FloatArray
    torque: FloatArray

    @property
    def mean_external_torque(self) -> FloatArray:
        """Mean of tau_ext over the interval before each row, (runs, rows, joints) [Nm or N]; 0 in the first row."""
        mean = np.zeros_like(self.momentum)
        mean[:, 1:] = np.diff(self.momentum, axis=1) / self.dt - self.mean_force[:, 1:]
        return mean

    @property
    def mean_force(self) -> FloatArray:
        """Mean of b over the interval before each row, likewise; 0 in the first row."""
        mean = np.zeros_like(self.force)
        mean[:, 1:] = (self.force[:, 1:] + self.force[:, :-1]) / 2
        return mean


def signals_of_residual(residual: FloatArray, torque: FloatArray, dt: float) -> Signals:
    """Signals of recordings whose residual is known, as from fitted dynamics: all momentum counts as predicted.

    Args:
        residual: minus tau_ext, (runs, rows, joints) [Nm or N].
        torque: of the motors, likewise.
        dt: between rows [s].
    """
    return Signals(dt, np.zeros_like(residual), residual, residual, torque)


def signals_of_motion(robot: Robot, q: FloatArray, torque: FloatArray, dt: float) -> Signals:
    """Signals of recorded positions and torques, with rates from positions as a loop has them.

    Args:
        robot: with inertia.
        q: (runs, rows, joints) [rad or m].
        torque: of the motors, likewise [Nm or N].
        dt: between rows [s].
    """
    runs, rows, joints = q.shape
    t = dt * np.arange(rows)
    window = max(3, min(64, round(WINDOW_S / dt) + 1))
    qd = np.stack([causal_derivatives(t, one, window=window)[0] for one in q])
    positions, rates = q.reshape(-1, joints), qd.reshape(-1, joints)
    mass = mass_matrix(robot, positions)
    momentum = np.einsum("kij,kj->ki", mass, rates)
    ahead, behind = (mass_matrix(robot, positions + side * _STEP_S * rates) for side in (1, -1))
    # dT/dq = (dM/dt) qd - C qd.
    mass_rate = np.einsum("kij,kj->ki", ahead - behind, rates) / (2 * _STEP_S)
    shape = (runs, rows, joints)
    gradient = mass_rate - coriolis_torque(robot, positions, rates)
    force = torque + (gradient - gravity_torque(robot, positions)).reshape(shape)
    return Signals(dt, momentum.reshape(shape), force, direct_residual(robot, q, torque, dt), torque)


def direct_residual(robot: Robot, q: FloatArray, torque: FloatArray, dt: float, settings: str = "direct") -> FloatArray:
    """Residual of bumpstop's own detector, (runs, rows, joints) [Nm or N]; 0 until its window is full.

    Args:
        robot: with inertia.
        q: (runs, rows, joints) [rad or m].
        torque: of the motors, likewise [Nm or N].
        dt: between rows [s].
        settings: ``"direct"`` or ``"observer"``.
    """
    given = DetectorSettings(residual="observer" if settings == "observer" else "direct", window_s=WINDOW_S)
    detector = Detector(robot, None, Thresholds(np.full(robot.dof, 1e9)), given)
    t = dt * np.arange(q.shape[1])
    return np.stack([np.nan_to_num(detector.run_rows(t, *one).residual) for one in zip(q, torque, strict=True)])
