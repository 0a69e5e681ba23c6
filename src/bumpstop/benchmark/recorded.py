"""Pushes planted into a recording of a real arm: its noise and its model errors, contacts that are known."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.benchmark.comparison import RATES, DetectorBenchmark, compare_signals
from bumpstop.benchmark.methods import METHODS, Method
from bumpstop.benchmark.planted import BETWEEN_S, CONTACT_S, MAX_FORCE_N, PlantedRuns
from bumpstop.benchmark.signals import signals_of_residual
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

GROWTH_N_S = 500.0  # of a push, downward at the tip
_SHIFTS = 10  # copies of the recording, each pushed at other times
# Half of it must be long enough for one alarm at the highest rate, without its beginning and what filters leave out.
_SHORTEST_S = 2 * (3600 / RATES[-1] + 1.25)


def compare_on_recording(
    recording: Recording, robot: Robot, *, cutoff_hz: float | None = None, methods: Sequence[Method] = METHODS
) -> DetectorBenchmark:
    """Compare detectors on a recording of free motion.

    Dynamics are fitted to its first half, which also sets the proportion of the thresholds; alarms are counted in the
    second. Pushes that grow by 500 N/s are added to copies of the second half, J' f each. The fit filters both ways, so
    the residual is that of an analysis, not of a loop; what differs here is only what each method makes of it.

    Args:
        recording: with joint torque, 26.5 s at least, without contact.
        robot: the arm.
        cutoff_hz: of the identification; None: the best of eight.
        methods: which.

    Raises:
        InputError: too short, without torque, or of another arm.
    """
    from bumpstop.identification import identify_dynamics

    if recording.duration < _SHORTEST_S:
        problem = f"lasts {recording.duration:.3g} s"
        raise InputError("recording", problem, f"wanted {_SHORTEST_S:g} s: half of it counts alarms")
    middle = (recording.t[0] + recording.t[-1]) / 2
    fit = identify_dynamics(recording.between(float(recording.t[0]), float(middle)), robot, cutoff_hz=cutoff_hz)
    motion, residual = fit.model.residual(recording)
    dt = float(np.median(np.diff(motion.t)))
    torque = np.stack([np.interp(motion.t, recording.t, column) for column in _torque(recording).T], axis=1)
    rows = motion.t.size // 2
    first, second = slice(0, rows), slice(motion.t.size - rows, motion.t.size)
    free = signals_of_residual(
        np.stack([residual[first], residual[second]]), np.stack([torque[first], torque[second]]), dt
    )
    pushes = [_pushes(robot, motion.q[second], dt, 1.5 + BETWEEN_S * k / _SHIFTS) for k in range(_SHIFTS)]
    added = np.stack([push[0] for push in pushes])
    truth = PlantedRuns(
        dt,
        np.repeat(motion.q[None, second], _SHIFTS, axis=0),
        torque[second] + added,
        np.stack([push[1] for push in pushes]),
        np.array([(run, begin) for run, push in enumerate(pushes) for begin in push[2]], dtype=np.float64),
    )
    hit = signals_of_residual(residual[second] + added, truth.torque, dt)
    about = f"{robot.title or robot.name}, recorded for {recording.duration:.3g} s, pushes added"
    return compare_signals(free, hit, truth, methods, about)


def _torque(recording: Recording) -> FloatArray:
    if recording.tau is None:
        raise InputError("recording.tau", "is missing", "wanted a recording with joint torques")
    return recording.tau


def _pushes(robot: Robot, q: FloatArray, dt: float, first_s: float) -> tuple[FloatArray, FloatArray, list[int]]:
    """Torque that pushes add to the motors (rows, joints), their force (rows,), and first rows."""
    torque, force, count = np.zeros_like(q), np.zeros(len(q)), max(2, round(CONTACT_S / dt))
    begins = [round(time / dt) for time in np.arange(first_s, (len(q) - count) * dt, BETWEEN_S)]
    for begin in begins:
        rows = slice(begin, begin + count)
        force[rows] = np.minimum(GROWTH_N_S * dt * np.arange(count), MAX_FORCE_N)
        # The arm presses down with f, and its motors give J' f more.
        torque[rows] = -robot.jacobian(q[rows])[:, 2] * force[rows, None]
    return torque, force, begins
