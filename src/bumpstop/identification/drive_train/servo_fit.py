"""Bandwidth and position gain of the joints' servos, from what the controller asked for and what the joints did."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.drive_train.joint_values import JointValues, judged
from bumpstop.identification.segments.drive_samples import split_at_gaps
from bumpstop.identification.segments.motion import MIN_ROWS, UniformGrid, lowpass
from bumpstop.identification.segments.torque_samples import STILL
from bumpstop.identification.statistics.robust_fit import robust_fit
from bumpstop.model import mass_matrix, with_rotors

if TYPE_CHECKING:
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Rates and accelerations of the reference are looked at below this [Hz].
_SLOW_HZ = 30.0
_SIGN_SPEED = 0.002  # over which friction turns where the search begins [rad/s or m/s]
_LEFT_AT_START = 0.1  # of a segment, until what it began with has died away
_MAX_LEFT_S = 1.0
# Where the search begins: velocity loops [rad/s] and position gains as shares of them.
_BANDWIDTHS = np.geomspace(5.0, 1000.0, 12)
_SHARES = np.geomspace(0.02, 2.0, 7)
_LOWEST, _HIGHEST = math.log(0.5), math.log(1e4)
_STEP = 1e-4  # of the parameters, for derivatives
_STEPS_PER_S = 500.0  # of the simulation, steps a second at least
_MIN_EXPLAINED = 0.5
_MAX_ROWS = 6_000  # of a segment: its first ones
# Bandwidth, feedforward and friction make a curved valley: most searches take 20 to 70 steps.
_MAX_SEARCH = 100


@dataclass(frozen=True, eq=False)
class ServoFit:
    """Servos that recordings show.

    Attributes:
        bandwidth: of the velocity loop w_v [rad/s].
        position_gain: w_p [1/s].
        feedforward: share of the acceleration that is fed forward; known to better than 0.15 where it is told.
        explained: (dof,) share of the variance of the servo error that the fit explains; nan: none was looked for.
    """

    bandwidth: JointValues
    position_gain: JointValues
    feedforward: JointValues
    explained: FloatArray


def identify_servo(recordings: Sequence[Recording], robot: Robot) -> ServoFit:
    """Fit a cascade of position and velocity control to the servo error e = q - q_ref of every joint.

    With rigid gears, the motors' equation of a drive train says

        e'' + w_v e' + w_v w_p e = -(1 - f) u - c Sgn(q') - d q_ref' - b

    with u the acceleration that the reference asks of the joint (with what other joints' accelerations ask of it, where
    the robot's inertia is known), f what is fed forward, and friction and an offset that are found beside it. e is
    simulated, with friction that holds the joint at reversals, and fitted under Huber's loss, so that noise of encoders
    does not bias it. What moves e is friction at reversals and acceleration that is not fed forward: a servo that makes
    no error shows nothing.

    Args:
        recordings: with ``q_ref``; one or more.
        robot: whose servos they are.

    Raises:
        InputError: no recording has a reference, or they are of another robot or too short.
    """
    logs = [log for log in recordings if log.q_ref is not None]
    if not logs:
        raise InputError("recording", "has no reference", "wanted q_ref_1 .., positions that the controller asked for")
    parts = []
    for log in logs:
        log.check_robot(robot)
        parts += [_Segment.of(log, rows, robot) for rows in split_at_gaps(log.t) if rows.stop - rows.start >= MIN_ROWS]
    if not parts:
        raise InputError("recording", "is too short", f"wanted at least {MIN_ROWS} rows without a gap")
    dof = robot.dof
    found = np.full((4, dof), np.nan)
    errors = np.full((3, dof), np.inf)
    reasons = [""] * dof
    for j in range(dof):
        if max(float(np.ptp(part.q_ref[:, j])) for part in parts) < STILL:
            reasons[j] = "it hardly moves"
            continue
        measured = np.concatenate([part.error[part.rows, j] for part in parts])
        if not measured.std() > 1e-9:
            reasons[j] = "it makes no error"
            continue
        fit = robust_fit(
            lambda x, j=j: _with_derivatives(parts, j, x),  # type: ignore[misc]
            measured,
            _start(parts, j, measured),
            np.array([_LOWEST, _LOWEST, -np.inf, 0.0, -np.inf, -np.inf]),
            np.array([_HIGHEST, _HIGHEST, *[np.inf] * 4]),
            most=_MAX_SEARCH,
        )
        w_v, w_p = math.exp(fit.values[0]), math.exp(fit.values[1])
        explained = 1 - float(fit.residual.var() / measured.var())
        found[:, j] = w_v, w_p, 1 - fit.values[2], explained
        errors[:, j] = w_v * fit.standard_errors[0], w_p * fit.standard_errors[1], fit.standard_errors[2]
        nyquist = math.pi * min(part.rate_hz for part in parts)
        if not fit.converged:
            reasons[j] = f"the search did not settle in {_MAX_SEARCH} steps"
        elif explained < _MIN_EXPLAINED:
            reasons[j] = f"a cascade explains {100 * max(explained, 0):.0f} % of its error only"
        elif w_v > nyquist:
            reasons[j] = f"its bandwidth is beyond half the sample rate, {nyquist:.3g} rad/s"
    feedforward = np.clip(found[2], 0.0, 1.0)
    vague = [
        reason or ("" if errors[2, j] < 0.15 else "its acceleration error is not seen")
        for j, reason in enumerate(reasons)
    ]
    told = np.array([not reason for reason in vague])
    return ServoFit(
        bandwidth=judged(found[0], errors[0], reasons),
        position_gain=judged(found[1], errors[1], reasons),
        feedforward=JointValues(np.where(told, feedforward, np.nan), np.where(told, errors[2], np.inf), tuple(vague)),
        explained=found[3],
    )


@dataclass(frozen=True, eq=False)
class _Segment:
    """A segment between gaps on an even grid (M, n)."""

    rate_hz: float
    q_ref: FloatArray
    error: FloatArray
    rate_ref: FloatArray
    asked: FloatArray  # acceleration, with what those of other joints ask
    rows: slice  # that count

    @classmethod
    def of(cls, log: Recording, rows: slice, robot: Robot) -> _Segment:
        assert log.q_ref is not None
        grid = UniformGrid.of(log.t[rows])
        limit = slice(0, _MAX_ROWS)
        q, q_ref = grid.columns(log.q[rows], limit), grid.columns(log.q_ref[rows], limit)
        step = 1 / grid.rate_hz
        rate_ref = np.gradient(lowpass(q_ref, grid.rate_hz, _SLOW_HZ), step, axis=0)
        asked = np.gradient(rate_ref, step, axis=0)
        if not robot.inertia_objection:
            matrix = mass_matrix(with_rotors(robot, robot.drive_train.rotor_inertia), q_ref)
            asked = np.einsum("nij,nj->ni", matrix, asked) / np.einsum("nii->ni", matrix)
        left = int(min(_MAX_LEFT_S * grid.rate_hz, _LEFT_AT_START * len(q)))
        return cls(grid.rate_hz, q_ref, q - q_ref, rate_ref, asked, slice(left, len(q)))


def _start(parts: Sequence[_Segment], j: int, measured: FloatArray) -> FloatArray:
    """The best of a grid of bandwidths and gains by a linear filter, in which friction turns with the reference."""
    from scipy.signal import cont2discrete, lfilter

    best, least = np.zeros(6), math.inf
    for w_v in _BANDWIDTHS:
        for share in _SHARES:
            answers = []
            for part in parts:
                system = ([-1.0], [1.0, w_v, w_v * w_v * share])
                numerator, denominator, _ = cont2discrete(system, 1 / part.rate_hz, method="foh")
                turning = np.tanh(part.rate_ref[:, j] / _SIGN_SPEED)
                inputs = np.stack([part.asked[:, j], turning, part.rate_ref[:, j], np.ones_like(turning)])
                answers.append(lfilter(np.ravel(numerator), denominator, inputs, axis=1)[:, part.rows].T)
            basis = np.concatenate(answers)
            shares, *_ = np.linalg.lstsq(basis, measured, rcond=None)
            left = float(np.abs(measured - basis @ shares).sum())
            if left < least:
                shares[1] = max(shares[1], 0.0)
                best, least = np.array([math.log(w_v), math.log(w_v * share), *shares]), left
    return best


def _with_derivatives(parts: Sequence[_Segment], j: int, x: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Servo errors (rows,) and their derivatives (rows, 6), by central differences of simulations side by side."""
    steps = np.array([_STEP, _STEP, *(_STEP * np.maximum(np.abs(x[2:]), 1e-2))])
    tried = np.concatenate([x[None], x + np.diag(steps), x - np.diag(steps)])
    tried[:, 3] = np.maximum(tried[:, 3], 0.0)
    found = np.concatenate([_simulated(part, j, tried)[part.rows] for part in parts])
    return found[:, 0], (found[:, 1:7] - found[:, 7:]) / (tried[1:7] - tried[7:])[range(6), range(6)]


def _simulated(part: _Segment, j: int, x: FloatArray) -> FloatArray:
    """Servo error (M, k) by k sets of parameters: the trapezoidal rule, with friction that can hold the joint.

    Within a step the rate v of the joint solves K v + h c Sgn(v) = S, Sgn set-valued at rest, in closed form.
    """
    w_v, w_p = np.exp(x[:, 0]), np.exp(x[:, 1])
    asked, coulomb, viscous, offset = x[:, 2], x[:, 3], x[:, 4], x[:, 5]
    count = max(1, math.ceil(_STEPS_PER_S / part.rate_hz))
    h = 1 / (part.rate_hz * count)
    stiff = w_v * w_p
    ahead, behind = 1 + h / 2 * w_v + h * h / 4 * stiff, 1 - h / 2 * w_v - h * h / 4 * stiff
    held = h * coulomb
    rate_ref, u = part.rate_ref[:, j], part.asked[:, j]
    found = np.empty((len(u), len(x)))
    e, de = np.full(len(x), part.error[0, j]), np.zeros(len(x))
    found[0] = e
    for row in range(1, len(u)):
        for sub in range(count):
            middle, end = (sub + 0.5) / count, (sub + 1) / count
            speed = rate_ref[row - 1] + end * (rate_ref[row] - rate_ref[row - 1])
            at = u[row - 1] + middle * (u[row] - u[row - 1])
            push = behind * de - h * (stiff * e + asked * at + viscous * speed + offset) + ahead * speed
            v = np.sign(push) * np.maximum(np.abs(push) - held, 0.0) / ahead
            next_de = v - speed
            e = e + h / 2 * (de + next_de)
            de = next_de
        found[row] = e
    return found
