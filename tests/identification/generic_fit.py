"""Generic least squares of an arm's torques, and parts of real recordings to compare it with ours on."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, sosfiltfilt

import bumpstop as bs
from bumpstop.arrays import FloatArray
from bumpstop.identification.dynamics.regressor import inertial_regressor
from bumpstop.identification.segments.rest import MIN_MOVING, resting
from bumpstop.recording import Recording
from identification.recorded import FILES, SHARED, TX40_COLUMNS

# Frequency that predicted and measured torques are compared at, and joints that share a motor.
COMPARED_HZ = {"ur10": 8.0, "panda": 4.0, "tx40": 20.0, "ur3e": 5.0}
MOTORS: dict[str, list[list[tuple[int, float]]]] = {"tx40": [[(4, 1.0), (5, 1.0)]]}
# Of a UR3e only currents are recorded: times what its controller goes by they are torques [Nm/A].
_UR3E_GAINS = np.array([10.36, 10.88, 7.70, 3.56, 3.16, 3.37])
_GRAVITY = (0.0, 0.0, -9.80665)
_SMALL = 1e-8  # singular values of the regressor, of the largest, that count as zero


def arm_and_recording(name: str) -> tuple[bs.Robot, Recording] | None:
    """A real arm and its recording with torques; None: it is not beside the repository."""
    path = SHARED / FILES.get(name, "ur3e_rtde/fig9.xlsx")
    if not path.exists():
        return None
    if name == "tx40":
        robot = bs.Robot.from_urdf(SHARED / "staubli_tx40" / "tx40_mdh_modified.urdf")
        return robot, Recording.load(path, columns=TX40_COLUMNS, robot=robot).between(0.0, 7.4)
    robot = bs.Robot.load(name)
    log = Recording.load(path)
    if log.tau is None:
        assert log.current is not None
        log = replace(log, tau=log.current * _UR3E_GAINS, current=None)
    return robot, log


def splits(log: Recording) -> Iterator[tuple[str, list[Recording], Recording]]:
    """Parts to fit to, one or two files, and a part that the fit does not see."""
    begin, length = float(log.t[0]), float(log.t[-1] - log.t[0])

    def part(a: float, b: float) -> Recording:
        return log.between(begin + a * length, begin + b * length)

    yield "first quarter", [part(0.25, 1)], part(0, 0.25)
    yield "second quarter", [part(0, 0.25), part(0.5, 1)], part(0.25, 0.5)
    yield "third quarter", [part(0, 0.5), part(0.75, 1)], part(0.5, 0.75)
    yield "last quarter", [part(0, 0.75)], part(0.75, 1)
    yield "first half", [part(0.5, 1)], part(0, 0.5)
    yield "last half", [part(0, 0.5)], part(0.5, 1)
    yield "last third", [part(0, 0.667)], part(0.667, 1)


def unsettled_splits(log: Recording) -> Iterator[tuple[str, list[Recording], Recording]]:
    """Other parts, on which no rule of the fit was settled: fifths and thirds, as :func:`splits` gives them."""
    begin, length = float(log.t[0]), float(log.t[-1] - log.t[0])
    fifths = [(f"{name} fifth", k / 5, (k + 1) / 5) for k, name in enumerate(("first", "second", "third", "fourth"))]
    for name, a, b in [*fifths, ("last fifth", 0.8, 1.0), ("first third", 0.0, 1 / 3), ("middle third", 1 / 3, 2 / 3)]:
        sides = [(0.0, a), (b, 1.0)]
        fitted = [log.between(begin + c * length, begin + d * length) for c, d in sides if c < d]
        yield name, fitted, log.between(begin + a * length, begin + b * length)


def generic_r2(
    robot: bs.Robot, fitted: Sequence[Recording], unseen: Recording, cutoff_hz: float, name: str = ""
) -> FloatArray:
    """R2 (n,) on a part that is not fitted, at the rows where each joint moves, of the fit that any textbook has.

    Inertial parameters, Coulomb friction by the sign of the speed, viscous friction, rotors and offsets; motion,
    columns and torques pass one zero-phase filter; one solution of smallest norm, joints not weighed.
    """
    groups = [*([(j, 1.0)] for j in range(robot.dof)), *MOTORS.get(name, [])]
    parts = [_filtered(robot, log, cutoff_hz, groups) for log in fitted]
    matrix = np.concatenate([columns for columns, *_ in parts])
    wanted = np.concatenate([torque for _, torque, _ in parts])
    values = np.linalg.lstsq(matrix.reshape(-1, matrix.shape[2]), wanted.ravel(), rcond=_SMALL)[0]
    columns, measured, moves = _filtered(robot, unseen, cutoff_hz, groups)
    predicted = columns @ values
    found = np.full(robot.dof, np.nan)
    for j in range(robot.dof):
        own = moves[:, j]
        if own.mean() >= MIN_MOVING:
            error, about = predicted[own, j] - measured[own, j], measured[own, j] - measured[own, j].mean()
            found[j] = 1 - (error**2).sum() / (about**2).sum()
    return found


def _filtered(
    robot: bs.Robot, log: Recording, cutoff_hz: float, groups: Sequence[Sequence[tuple[int, float]]]
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Columns (N, n, p) and torques (N, n) of a recording behind the filter, and where each joint moves (N, n)."""
    step = float(np.median(np.diff(log.t)))
    grid = np.arange(log.t[0], log.t[-1] + 0.5 * step, step)

    def even(x: FloatArray) -> FloatArray:
        return np.stack([np.interp(grid, log.t, column) for column in x.T], axis=1)

    assert log.tau is not None
    recorded = even(log.q)
    q = _smooth(recorded, 1 / step, cutoff_hz)
    qd = np.gradient(q, step, axis=0) if log.qd is None else _smooth(even(log.qd), 1 / step, cutoff_hz)
    qdd = np.gradient(qd, step, axis=0)
    # Twenty rows a period of the cut-off: what is left behind the filter needs no more.
    stride = max(1, int(1 / (step * 20 * cutoff_hz)))
    kept = slice(None, None, stride)
    torque = _smooth(even(log.tau), 1 / step, cutoff_hz)[kept]
    q, qd, qdd = q[kept], qd[kept], qdd[kept]
    blocks = [inertial_regressor(robot, q, qd, qdd, _GRAVITY)]
    for group in groups:
        speed = np.sum([share * qd[:, j] for j, share in group], axis=0)
        acceleration = np.sum([share * qdd[:, j] for j, share in group], axis=0)
        shapes = [np.sign(speed), speed, acceleration, *([np.ones_like(speed)] if len(group) == 1 else [])]
        block = np.zeros((len(q), robot.dof, len(shapes)))
        for k, shape in enumerate(shapes):
            for j, share in group:
                block[:, j, k] = share * shape
        blocks.append(block)
    columns = _smooth(np.concatenate(blocks, axis=2), 1 / (step * stride), cutoff_hz)
    return columns, torque, ~resting(recorded, 1 / step)[kept]


def _smooth(x: FloatArray, rate_hz: float, cutoff_hz: float) -> FloatArray:
    """Fourth-order Butterworth forward and backward, continued beyond the ends for six periods of the cut-off."""
    sections = butter(4, cutoff_hz, fs=rate_hz, output="sos")
    return np.asarray(sosfiltfilt(sections, x, axis=0, padlen=min(len(x) - 1, int(6 * rate_hz / cutoff_hz))))
