"""Work of an arm with contacts that are known: recordings made from a model, noise and collisions."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.model import inverse_dynamics

if TYPE_CHECKING:
    from bumpstop.model import Robot

CONTACT_S = 0.25  # how long a contact lasts
WORKS = 10  # motions, repeated: an arm does the same again and again
BETWEEN_S = 3.0  # from one to the next
SLOWING = 0.85  # by how much the arm is slower at a contact than in the mean
MAX_FORCE_N = 150.0  # at which whatever is hit gives way
_FIRST_S = 2.0
_AMPLITUDE = 0.3  # rad or 0.1 m: of each of the two oscillations of a joint
_LEAST_SIZE = 0.3  # a joint counts with at least this share of the largest torque of all: small gears are rough, too
_TORQUE_NOISE = 0.02  # of the largest torque that the work needs of a joint, white
_FRICTION_ERROR = 0.03  # the same: Coulomb friction that the model does not know
_POSITION_NOISE = 1e-6  # rad or m
_REST_SPEED = 0.02  # at which friction turns over [rad/s or m/s]


@dataclass(frozen=True, eq=False)
class PlantedRuns:
    """Recordings with known contacts.

    Attributes:
        dt: between rows [s].
        q: (runs, rows, joints) measured positions [rad or m].
        torque: of the motors, friction taken off as a model knows it, likewise [Nm or N].
        contact_force: (runs, rows) of the tip on a body [N]; 0 without contact.
        onsets: (contacts, 2) run and first row of each contact.
    """

    dt: float
    q: FloatArray
    torque: FloatArray
    contact_force: FloatArray
    onsets: FloatArray


def planted_runs(
    robot: Robot, runs: int, seconds: float, *, stiffness_N_m: float = 0.0, dt: float = 0.004, seed: int = 0
) -> PlantedRuns:
    """Make work of an arm: ten motions that are repeated, fast and slow by turns.

    Every joint swings by two oscillations of random frequency.

    The tip meets a clamped spring every 3 s, for 0.25 s: F = K max(0, n . (p(t) - p(t_c))), 150 N at most, n being the
    way the tip moves at the onset t_c. A position-controlled arm follows its path, so its motors give J' n F more.

    Args:
        robot: with inertia.
        runs: recordings.
        seconds: length of each.
        stiffness_N_m: K of the spring; 0: no contacts.
        dt: between rows [s].
        seed: of motion and noise.
    """
    rows, n = round(seconds / dt), robot.dof
    t: FloatArray = dt * np.arange(rows, dtype=np.float64)
    # Fast between the contacts, slow at them.
    turn = 2 * np.pi / BETWEEN_S
    speed = 1 - SLOWING * np.cos(turn * (t - _FIRST_S))
    way = t - SLOWING / turn * np.sin(turn * (t - _FIRST_S))
    growth = SLOWING * turn * np.sin(turn * (t - _FIRST_S))
    q, torque = np.zeros((runs, rows, n)), np.zeros((runs, rows, n))
    force, onsets = np.zeros((runs, rows)), []
    reach = np.array([_AMPLITUDE if joint.kind == "revolute" else _AMPLITUDE / 3 for joint in robot.joints])
    low, high = (np.clip([getattr(joint, end) for joint in robot.joints], -2.0, 2.0) for end in ("lower", "upper"))
    for run in range(runs):
        rng = np.random.default_rng([seed, run % WORKS])  # the work, whose runs differ by their noise
        centre = rng.uniform(low + 2 * reach, np.maximum(high - 2 * reach, low + 2 * reach))
        omega, phase = 2 * np.pi * rng.uniform(0.1, 0.4, (2, n)), rng.uniform(0, 2 * np.pi, (2, n))
        angle = way[:, None, None] * omega + phase
        position = centre + reach * np.sin(angle).sum(axis=1) / 2
        slope = reach * (omega * np.cos(angle)).sum(axis=1) / 2
        curvature = -reach * (omega**2 * np.sin(angle)).sum(axis=1) / 2
        rate, acceleration = slope * speed[:, None], curvature * speed[:, None] ** 2 + slope * growth[:, None]
        work = inverse_dynamics(robot, position, rate, acceleration)
        if stiffness_N_m > 0:
            added, force[run], begins = _contacts(robot, position, rate, t, stiffness_N_m)
            torque[run] += added
            onsets += [(run, begin) for begin in begins]
        noise = np.random.default_rng([seed, run, int(stiffness_N_m > 0)])
        size = np.abs(work).max(axis=0)
        size = np.maximum(size, _LEAST_SIZE * size.max())
        torque[run] += work + _FRICTION_ERROR * size * np.tanh(rate / _REST_SPEED)
        torque[run] += _TORQUE_NOISE * size * noise.normal(size=(rows, n))
        q[run] = position + _POSITION_NOISE * noise.normal(size=(rows, n))
    return PlantedRuns(dt, q, torque, force, np.array(onsets, dtype=np.float64).reshape(-1, 2))


def _contacts(
    robot: Robot, position: FloatArray, rate: FloatArray, t: FloatArray, stiffness: float
) -> tuple[FloatArray, FloatArray, list[int]]:
    """Torque that contacts add to the motors (rows, joints), force (rows,), and first rows."""
    dt = t[1] - t[0]
    torque, force = np.zeros_like(position), np.zeros(t.size)
    begins = [round(time / dt) for time in np.arange(_FIRST_S, t[-1] - BETWEEN_S / 2, BETWEEN_S)]
    for begin in begins:
        rows = slice(begin, begin + round(CONTACT_S / dt))
        jacobian = robot.jacobian(position[rows])[:, :3]
        velocity = np.einsum("kij,kj->ki", jacobian, rate[rows])
        normal = velocity[0] / np.linalg.norm(velocity[0])
        # The way since the onset, by the trapezium.
        along = velocity @ normal
        way = np.concatenate([[0.0], np.cumsum((along[1:] + along[:-1]) / 2) * dt])
        force[rows] = np.clip(stiffness * way, 0.0, MAX_FORCE_N)
        torque[rows] = np.einsum("kij,i->kj", jacobian, normal) * force[rows, None]
    return torque, force, begins
