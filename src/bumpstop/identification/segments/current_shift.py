"""A shift in time between the motion of a recording and its currents or torques."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.dynamics.regressor import inertial_regressor
from bumpstop.identification.segments.motion import UniformGrid, lowpass
from bumpstop.model.dynamics import STANDARD_GRAVITY

if TYPE_CHECKING:
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Motion and currents are compared below this frequency [Hz], on so many rows in one piece, at shifts up to this [s].
_CUTOFF_HZ, _ROWS, _MAX_S = 5.0, 2500, 0.3
_STEPS = 60  # shifts to either side
# A shift is told from this size on, where it leaves no more than this share of what is left of the currents without it;
# where it leaves as little as the second share, no fit can be used.
_MIN_S, _MIN_STEPS, _WORTH, _MUCH = 0.02, 1.2, 0.93, 0.75
_EXPLAINED = 0.7  # share of the variance
_MIN_ROWS = 200
# A joint tells of shifts where the filtered recording holds so many independent values for each column of its fit: with
# fewer the columns explain a shift as well as what is none. So many of the moving joints must.
_VALUES, _MOST = 3.0, 0.5
_LEAST = 1e-9  # share that counts as nothing left
_NONE = (0.0, 1.0)
_MOVES = 0.01  # [rad or m]


def tell_shifts(
    recordings: Sequence[Recording],
    robot: Robot,
    quantity: str,
    faults: list[str],
    warnings: list[str],
    *,
    gravity: tuple[float, float, float] = STANDARD_GRAVITY,
) -> None:
    """Add a sentence on every recording whose currents or torques are shifted against its motion.

    Args:
        recordings: of this robot.
        robot: its chain; inertia it may have is not used.
        quantity: ``"current"`` or ``"tau"``.
        faults: what makes a fit not usable; shifts that matter much are added.
        warnings: other shifts are added.
        gravity: acceleration of free fall in the base frame [m/s2].
    """
    for log in recordings:
        effort = getattr(log, quantity)
        if effort is None:
            continue
        shift, left = shift_of(log, robot, effort, gravity=gravity)
        if shift == 0:
            continue
        what = {"current": "currents", "tau": "torques"}[quantity]
        how = "lag behind" if shift > 0 else "run ahead of"
        where = f"{log.source}: " if log.source else ""
        (faults if left < _MUCH else warnings).append(
            f"{where}the {what} {how} the motion by {1e3 * abs(shift):.3g} ms: do both have one clock and one filter?"
        )


def shift_of(
    recording: Recording,
    robot: Robot,
    effort: FloatArray,
    *,
    gravity: tuple[float, float, float] = STANDARD_GRAVITY,
) -> tuple[float, float]:
    """Time [s] by which the motors' effort (N, n) lags behind the motion, and the share of what is left that it leaves.

    Each joint's effort, shifted, is fitted by the columns of the joint's own torque, inertia, gravity and friction with
    parameters of its own. The shift at which the least is left of all moving joints is the recording's; 0 and 1 where
    it is not worth a word, where the recording is too short to tell, and where one joint alone has it: a clock or a
    filter shifts all, and friction that no column has looks like a shift.
    """
    part = _busiest_part(recording)
    t, effort = recording.t[part], effort[part]
    try:
        grid = UniformGrid.of(t)
    except InputError:
        return _NONE
    every = max(1, round(grid.rate_hz / (8 * _CUTOFF_HZ)))
    cutoff = min(_CUTOFF_HZ, 0.15 * grid.rate_hz)
    edge = int(np.ceil((_MAX_S + 1 / cutoff) * grid.rate_hz))
    rows = np.arange(edge, grid.t.size - edge, every)
    if rows.size < _MIN_ROWS:
        return _NONE
    q = lowpass(grid.columns(recording.q[part]), grid.rate_hz, cutoff)
    x = lowpass(grid.columns(effort), grid.rate_hz, cutoff)
    qd = np.gradient(q, 1 / grid.rate_hz, axis=0)
    qdd = np.gradient(qd, 1 / grid.rate_hz, axis=0)
    inertial = inertial_regressor(robot, q[rows], qd[rows], qdd[rows], gravity)
    shifts = np.linspace(-_MAX_S, _MAX_S, 2 * _STEPS + 1)
    values = 2 * cutoff * rows.size * every / grid.rate_hz  # independent ones of each signal
    told: list[FloatArray] = []
    moving = 0
    for j in range(robot.dof):
        if np.ptp(q[rows, j]) < _MOVES or np.ptp(x[rows, j]) == 0:
            continue
        speed = qd[rows, j]
        scale = max(0.03 * float(np.sqrt(np.mean(speed**2))), 1e-4)
        own = np.column_stack([np.tanh(speed / scale), speed, qdd[rows, j], np.ones(rows.size)])
        # The sign passes the filter that the current has passed.
        own[:, 0] = lowpass(np.tanh(qd[:, j] / scale), grid.rate_hz, cutoff)[rows]
        moving += 1
        basis = _basis(np.column_stack([inertial[:, j], own]))
        if values < _VALUES * basis.shape[1]:
            continue
        shifted = np.stack([np.interp(grid.t[rows] + shift, grid.t, x[:, j]) for shift in shifts], axis=1)
        whole = ((shifted - shifted.mean(axis=0)) ** 2).sum(axis=0)
        rest = (shifted**2).sum(axis=0) - ((basis.T @ shifted) ** 2).sum(axis=0)
        told.append(np.maximum(rest / np.maximum(whole, 1e-300), _LEAST))
    if not told or len(told) < _MOST * moving:
        return _NONE
    # Each joint counts by its own noise: the likelihood of normal errors of unknown size.
    left: FloatArray = np.exp(np.mean(np.log(told), axis=0))
    # What is hardly explained at any shift says nothing of one.
    if np.mean(told, axis=0).min() > _EXPLAINED:
        return _NONE
    best, middle = int(np.argmin(left)), _STEPS
    shift = float(shifts[best])
    if abs(shift) < max(_MIN_S, _MIN_STEPS * recording.dt) or left[best] > _WORTH * left[middle]:
        return _NONE
    # Without the joint that speaks for it most it is to be worth a word, too.
    each = np.log([one[best] / one[middle] for one in told])
    if len(told) > 1 and (each.sum() - each.min()) / (len(told) - 1) > np.log(_WORTH):
        return _NONE
    return shift, float(left[best] / left[middle])


def _busiest_part(recording: Recording) -> slice:
    """Of a long recording the rows in one piece in which the arm moves most: they are enough, and filtered quickly."""
    count = int((_ROWS / (8 * _CUTOFF_HZ) + 2 * (_MAX_S + 1 / _CUTOFF_HZ)) / recording.dt)
    if recording.t.size <= count:
        return slice(0, recording.t.size)
    every = max(1, recording.t.size // 20_000)
    way = np.abs(np.diff(recording.q[::every], axis=0)).sum(axis=1)
    whole = np.concatenate([[0.0], np.cumsum(way)])
    length = count // every
    starts = np.arange(0, max(1, whole.size - length), max(1, length // 4))
    begin = every * int(starts[np.argmax(whole[np.minimum(starts + length, whole.size - 1)] - whole[starts])])
    return slice(begin, min(begin + count, recording.t.size))


def _basis(columns: FloatArray) -> FloatArray:
    """Orthonormal columns (N, k) that span those which are told apart."""
    length = np.linalg.norm(columns, axis=0)
    scaled = columns[:, length > 1e-9 * length.max()] / length[length > 1e-9 * length.max()]
    left, size, _ = np.linalg.svd(scaled, full_matrices=False)
    basis: FloatArray = left[:, size > 1e-4 * size[0]]
    return basis
