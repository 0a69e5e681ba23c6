"""Rows a joint model is fitted to: motion, Newton-Euler torque and motor current on an even grid."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.drive.drive_model import JointMotion, stiction_share
from bumpstop.identification.segments.motion import MIN_ROWS, UniformGrid, lowpass
from bumpstop.joint.parameters import turned_over
from bumpstop.model.dynamics import STANDARD_GRAVITY

if TYPE_CHECKING:
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# An interval this long [s], and longer than so many median ones, ends a segment: nothing is guessed across it.
_GAP_S, _GAP_STEPS = 0.1, 10.0
# A segment is used when it is at least so many times as long as what is cut off at an end.
_MIN_TRIMS = 5
# What is filtered at a cut-off is kept at this many times its rate.
RATE_PER_CUTOFF = 10.0
# Share of a speed that the filter swings back by, and more.
_SWING_BACK = 0.2
# A recording with more rows than a fit takes is represented by so many blocks.
_BLOCKS = 10


@dataclass(frozen=True, eq=False)
class DriveSamples:
    """Segments of motion one after another, filtered alike.

    Attributes:
        t: (N,) of each row in its own recording [s].
        q, qd, qdd: (N, n) [rad or m, and per second].
        torque: (N, n) Newton-Euler torque without rotors [Nm or N].
        current: (N, n) of the motors, filtered like the motion [A].
        segments: rows of each segment.
        rate_hz: rows a second, of each segment.
        cutoff_hz: of the zero-phase filter.
        rows_recorded: of the recordings that lie in a segment.
        rows_left: of the recordings in segments too short to filter.
        rows_at_ends: of the recordings left out at either end of a segment, where the filter has one side only.
        recordings: number of the recording of each segment, from 0; empty: not known.
    """

    t: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    torque: FloatArray
    current: FloatArray
    segments: tuple[slice, ...]
    rate_hz: tuple[float, ...]
    cutoff_hz: float
    rows_recorded: int
    rows_left: int
    rows_at_ends: int = 0
    recordings: tuple[int, ...] = ()

    def filtered(self, x: FloatArray, cutoff_hz: float | None = None) -> FloatArray:
        """Columns (N, ...) after the zero-phase filter, each segment for itself."""
        cutoff = self.cutoff_hz if cutoff_hz is None else cutoff_hz
        result = np.empty_like(x)
        alike: dict[tuple[int, float], list[int]] = {}
        for rows, rate in zip(self.segments, self.rate_hz, strict=True):
            alike.setdefault((rows.stop - rows.start, rate), []).append(rows.start)
        for (length, rate), starts in alike.items():
            if len(starts) == 1:
                rows = slice(starts[0], starts[0] + length)
                result[rows] = lowpass(x[rows], rate, cutoff)
                continue
            # Side by side in one call: most of the time of short ones would go into preparing it.
            places = np.arange(length)[:, None] + np.array(starts)
            result[places] = lowpass(x[places], rate, cutoff)
        return result

    def spread(self, limit: int) -> DriveSamples:
        """No more than about ``limit`` rows: blocks spread evenly over the time, each a segment of its own."""
        if self.t.size <= limit:
            return self
        length = limit // _BLOCKS
        blocks: list[slice] = []
        rates: list[float] = []
        for rows, rate in zip(self.segments, self.rate_hz, strict=True):
            size = rows.stop - rows.start
            count = min(round(_BLOCKS * size / self.t.size), size // length)
            for start in np.linspace(rows.start, rows.stop - length, count).astype(int).tolist():
                blocks.append(slice(start, start + length))
                rates.append(rate)
        if not blocks:  # many short segments: every so manieth of them
            every = math.ceil(self.t.size / limit)
            blocks, rates = list(self.segments[::every]), list(self.rate_hz[::every])
        ends = np.cumsum([0, *(block.stop - block.start for block in blocks)]).tolist()
        columns: dict[str, Any] = {
            name: np.concatenate([getattr(self, name)[block] for block in blocks])
            for name in ("t", "q", "qd", "qdd", "torque", "current")
        }
        segments = tuple(slice(a, b) for a, b in pairwise(ends))
        return replace(self, **columns, segments=segments, rate_hz=tuple(rates), recordings=())

    def of_joints(self, which: Sequence[int]) -> DriveSamples:
        """The columns of some joints, from 0."""
        if list(which) == list(range(self.q.shape[1])):
            return self
        names = ("q", "qd", "qdd", "torque", "current")
        columns: dict[str, Any] = {name: np.ascontiguousarray(getattr(self, name)[:, which]) for name in names}
        return replace(self, **columns)

    def joint(self, j: int, rest_speed: float) -> JointMotion:
        """What joint ``j`` did.

        A filter without delay swings back where a motion ends. So that this is not taken for the last motion, what is
        slow beside a faster motion within a period of the cut-off sets no hysteresis.
        """
        from scipy.ndimage import maximum_filter1d

        qd = np.ascontiguousarray(self.qd[:, j])
        parts = []
        for rows, rate in zip(self.segments, self.rate_hz, strict=True):
            own = qd[rows]
            fastest = maximum_filter1d(np.abs(own), 2 * math.ceil(rate / self.cutoff_hz) + 1)
            parts.append(stiction_share(own, rest_speed, np.abs(own) > _SWING_BACK * fastest))
        held = np.concatenate(parts)
        return JointMotion(self.torque[:, j], qd, self.qdd[:, j], held)

    def away_from_reversals(self, j: int, rest_speed: float) -> npt.NDArray[np.bool_]:
        """Rows (N,) at which joint ``j`` is fast enough for friction to have turned over, and a period about.

        How friction goes from one sign to the other nobody knows: its column is wrong near a reversal, where the
        acceleration is largest, and a torque that is nearly all acceleration takes the error for its own.
        """
        from scipy.ndimage import maximum_filter1d

        qd = self.qd[:, j]
        away = np.empty(qd.size, dtype=bool)
        for rows, rate in zip(self.segments, self.rate_hz, strict=True):
            own = qd[rows]
            near = np.abs(own) < turned_over(rest_speed)
            near[1:] |= own[1:] * own[:-1] < 0
            away[rows] = ~maximum_filter1d(near, 2 * math.ceil(rate / self.cutoff_hz) + 1)
        return away


def drive_samples(
    recordings: Sequence[Recording],
    robots: Sequence[Robot],
    cutoff_hz: float,
    *,
    every_row: bool = False,
    smooth_current: bool = True,
    trim_s: float | None = None,
    gravity: tuple[float, float, float] = STANDARD_GRAVITY,
) -> DriveSamples:
    """Filter, differentiate and thin out recordings, and compute the torque of their motion.

    Positions (or recorded rates) and currents pass the same zero-phase filter, and no more rows are kept than it leaves
    something to say in: ten a period of the cut-off.

    Args:
        recordings: with currents.
        robots: with inertia, one for each recording, what it carries included; rotors are left out here.
        cutoff_hz: of the filter.
        every_row: keep the recorded rate.
        smooth_current: filter the currents, too.
        trim_s: left out at either end of a segment, where a filter has only one side to go by; default: one period of
            the cut-off.
        gravity: acceleration of free fall in the base frame [m/s2].

    Raises:
        InputError: no currents, another number of joints, too few rows.
    """
    from bumpstop.model import inverse_dynamics, with_rotors

    parts: list[tuple[FloatArray, ...]] = []
    rates: list[float] = []
    recorded = left = at_ends = 0
    trim = 1 / cutoff_hz if trim_s is None else trim_s
    numbers: list[int] = []
    for number, (recording, robot) in enumerate(zip(recordings, robots, strict=True)):
        _check(recording, robot)
        without_rotors = with_rotors(robot, 0.0)
        for rows in split_at_gaps(recording.t):
            span = float(recording.t[rows.stop - 1] - recording.t[rows.start])
            if rows.stop - rows.start < MIN_ROWS or span < _MIN_TRIMS * trim:
                left += rows.stop - rows.start
                continue
            t, motion, current, rate = _segment(recording, rows, cutoff_hz, every_row, smooth_current)
            inside = slice(math.ceil(trim * rate), t.size - math.ceil(trim * rate))
            t, current = t[inside], current[inside]
            motion = (motion[0][inside], motion[1][inside], motion[2][inside])
            torque = inverse_dynamics(without_rotors, *motion, gravity=gravity)
            parts.append((t, *motion, torque, current))
            rates.append(rate)
            numbers.append(number)
            recorded += rows.stop - rows.start
            at_ends += 2 * round(trim / recording.dt)
    if not parts:
        problem = f"has no segment of {MIN_ROWS} rows and {_MIN_TRIMS * trim:.3g} s without a gap"
        raise InputError("recording", problem, "wanted a longer recording")
    ends = np.cumsum([0, *(part[0].size for part in parts)])
    columns = [np.concatenate([part[i] for part in parts]) for i in range(6)] if len(parts) > 1 else list(parts[0])
    segments = tuple(slice(int(a), int(b)) for a, b in pairwise(ends))
    t, q, qd, qdd, torque, current = columns
    return DriveSamples(
        t, q, qd, qdd, torque, current, segments, tuple(rates), cutoff_hz, recorded, left, at_ends, tuple(numbers)
    )


def _check(recording: Recording, robot: Robot) -> None:
    if recording.current is None:
        raise InputError("recording", f"{recording.source or 'it'} has no motor current", "wanted current_1 ..")
    recording.check_robot(robot)


def split_at_gaps(t: FloatArray) -> list[slice]:
    """Rows between gaps: intervals of more than 0.1 s and ten median ones."""
    steps = np.diff(t)
    ends = np.flatnonzero(steps > max(_GAP_S, _GAP_STEPS * float(np.median(steps)))) + 1
    edges = [0, *ends.tolist(), t.size]
    return [slice(a, b) for a, b in pairwise(edges)]


def _segment(
    recording: Recording, rows: slice, cutoff_hz: float, every_row: bool, smooth_current: bool
) -> tuple[FloatArray, tuple[FloatArray, FloatArray, FloatArray], FloatArray, float]:
    assert recording.current is not None
    t = recording.t[rows]
    grid = UniformGrid.of(t)
    rate = grid.rate_hz

    def smooth(x: FloatArray) -> FloatArray:
        return lowpass(grid.columns(x[rows]), rate, cutoff_hz)

    stride = 1 if every_row else max(1, int(rate / (RATE_PER_CUTOFF * cutoff_hz)))
    q = smooth(recording.q)
    velocity = slope(q, rate) if recording.qd is None else smooth(recording.qd)
    acceleration = np.ascontiguousarray(slope(velocity, rate)[::stride])
    current = smooth(recording.current) if smooth_current else grid.columns(recording.current[rows])
    kept = [np.ascontiguousarray(x[::stride]) for x in (q, velocity, current)]
    return grid.t[::stride], (kept[0], kept[1], acceleration), kept[2], rate / stride


def slope(x: FloatArray, rate_hz: float) -> FloatArray:
    """Rate of change of the columns of x (N, n), N at least 5, by fourth-order central differences.

    At a frequency f it falls short by the share (2 pi f / rate)^4 / 30; second-order differences would by a sixth of
    the square. The two rows at either end have lower order.
    """
    change = np.empty_like(x)
    change[2:-2] = (8 * (x[3:-1] - x[1:-3]) - (x[4:] - x[:-4])) * (rate_hz / 12)
    change[:2] = np.gradient(x[:3], 1 / rate_hz, axis=0)[:2]
    change[-2:] = np.gradient(x[-3:], 1 / rate_hz, axis=0)[-2:]
    return change
