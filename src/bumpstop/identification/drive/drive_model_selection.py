"""Cut-off of the filter and speed of rest, chosen by held-out error before the joint models are fitted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.comparison import ROUNDING
from bumpstop.identification.segments.drive_samples import DriveSamples, drive_samples
from bumpstop.joint.parameters import DEFAULT_REST_SPEED

if TYPE_CHECKING:
    from collections.abc import Mapping

    from bumpstop.model import Robot
    from bumpstop.recording import Recording

_CUTOFFS_HZ = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 30.0)
_REST_SPEEDS = (DEFAULT_REST_SPEED, 0.003, 0.03, 0.1)
_FOLDS = 5
_POWER = 0.3
# A cut-off within this factor of the least error is as good. The highest of them rounds friction's reversals least.
_AS_GOOD = 1.005
# Highest cut-off, by the recorded rate: above, accelerations are mostly noise of the positions.
_PER_RATE = 0.15
# Another speed of rest must do so much better than the usual one.
_CLEAR_GAIN = 0.95
# Recorded rows that cut-offs are chosen on: what more would tell is the same.
_ENOUGH = 30_000


@dataclass(frozen=True, eq=False)
class DriveSettings:
    """Settings of a fit.

    Attributes:
        cutoff_hz: of the zero-phase filter [Hz].
        rest_speeds: (n,) [rad/s or m/s].
        held_out: error by the cut-off that was tried.
    """

    cutoff_hz: float
    rest_speeds: tuple[float, ...]
    held_out: Mapping[float, float]


def choose_settings(
    recordings: Sequence[Recording],
    robots: Sequence[Robot],
    cutoff_hz: float | None,
    rest_speed: float | None,
    gravity: tuple[float, float, float],
) -> DriveSettings:
    """Choose what was not given, with linear maps and Coulomb and viscous friction, on held-out fifths of the time."""
    for name, value in (("cutoff_hz", cutoff_hz), ("rest_speed", rest_speed)):
        if value is not None and not 0 < value < np.inf:
            raise InputError(name, f"is {value}", "wanted a number above 0")
    shorter = [_shortened(recording, _ENOUGH // len(recordings)) for recording in recordings]
    held_out: dict[float, float] = {}
    if cutoff_hz is None:
        slowest = min(recording.rate_hz for recording in recordings)
        reference = min(10.0, _PER_RATE * slowest)
        trim = min(1 / _CUTOFFS_HZ[0], 0.05 * min(recording.duration for recording in shorter))
        for candidate in _CUTOFFS_HZ:
            if candidate <= _PER_RATE * slowest:
                rows = drive_samples(
                    shorter, robots, candidate, every_row=True, smooth_current=False, trim_s=trim, gravity=gravity
                )
                speeds = [rest_speed or DEFAULT_REST_SPEED] * robots[0].dof
                errors = [_left_out(rows, j, speeds[j], reference) for j in range(robots[0].dof)]
                held_out[candidate] = float(np.mean(errors))
        if not held_out:
            raise InputError(
                "recording", f"{slowest:.3g} rows a second", f"wanted at least {_CUTOFFS_HZ[0] / _PER_RATE:.3g}"
            )
        least = min(held_out.values())
        cutoff_hz = max(candidate for candidate, error in held_out.items() if error <= _AS_GOOD * least)
    if rest_speed is not None:
        return DriveSettings(cutoff_hz, (rest_speed,) * robots[0].dof, held_out)
    rows = drive_samples(shorter, robots, cutoff_hz, gravity=gravity)
    chosen = []
    for j in range(robots[0].dof):
        errors = [_left_out(rows, j, speed, cutoff_hz) for speed in _REST_SPEEDS]
        best = int(np.argmin(errors))
        chosen.append(_REST_SPEEDS[best if errors[best] < _CLEAR_GAIN * errors[0] else 0])
    return DriveSettings(cutoff_hz, tuple(chosen), held_out)


def linear_columns(rows: DriveSamples, j: int, rest_speed: float) -> FloatArray:
    """Columns (N, 5) of a linear map: torque, acceleration, sign and rate of the motion, share of hysteresis."""
    motion = rows.joint(j, rest_speed)
    sign = np.clip(motion.qd / rest_speed, -1.0, 1.0)
    return np.stack([motion.torque, motion.qdd, sign, motion.qd, motion.held], axis=1)


def _left_out(rows: DriveSamples, j: int, rest_speed: float, cutoff_hz: float) -> float:
    """Share of a joint's current, filtered at ``cutoff_hz``, that fifths leave unexplained by the other four."""
    # A power of the speed beside Coulomb and viscous friction, or a smoother sign would stand in for it.
    columns = linear_columns(rows, j, rest_speed)
    power = columns[:, 2] * np.maximum(np.abs(columns[:, 3]), rest_speed) ** _POWER
    columns = rows.filtered(np.column_stack([columns, power]), cutoff_hz)
    current = rows.filtered(rows.current[:, j : j + 1], cutoff_hz)[:, 0]
    spread = float(current.var())
    if not spread > (ROUNDING * float(np.abs(current).max())) ** 2:
        return 0.0
    columns = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    parts = np.array_split(np.arange(current.size), _FOLDS)
    squares = [columns[part].T @ columns[part] for part in parts]
    sums = [columns[part].T @ current[part] for part in parts]
    left = 0.0
    for part, square, own in zip(parts, squares, sums, strict=True):
        values = np.linalg.lstsq(sum(squares) - square, sum(sums) - own, rcond=1e-10)[0]
        left += float(((current[part] - columns[part] @ values) ** 2).sum())
    return left / (current.size * spread)


def _shortened(recording: Recording, rows: int) -> Recording:
    """The middle of a recording, where it has more rows."""
    if recording.t.size <= rows:
        return recording
    first = (recording.t.size - rows) // 2
    return recording.between(float(recording.t[first]), float(recording.t[first + rows - 1]))
