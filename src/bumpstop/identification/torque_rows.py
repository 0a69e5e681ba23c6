"""Rows that dynamics are fitted to and compared on: filtered motion and torque, stretch by stretch."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.drive_rows import stretches_of
from bumpstop.identification.motion import EvenMotion, even_grid, even_motion, kept_rate, lowpass, onto
from bumpstop.identification.payload_fit import payload_torque

if TYPE_CHECKING:
    from bumpstop.identification.payload import Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# A stretch is used when it has so many rows and lasts so many periods of the cut-off.
_LEAST_ROWS, _LEAST_PERIODS = 50, 5.0
_LEAST_KEPT = 16  # behind the filter, as torques pass another
# Of recordings with more rows than are wanted so many blocks stand for the whole, each of no fewer rows than that.
_BLOCKS, _LEAST_BLOCK = 20, 200
# What is filtered beyond the ends of a block and then cut off, in periods of the cut-off.
_MARGIN_PERIODS = 2.0
# Beside a gap the arm moves, and the filter has one side only to go by: so many periods of the cut-off are left away.
_SEAM_PERIODS = 1.0


@dataclass(frozen=True, eq=False)
class TorqueRows:
    """Stretches of recordings one after another. Filters never reach from one into the next.

    Attributes:
        motion: (N, n) of all stretches; its times are those of the recordings, its rate that of the first.
        torque: (N, n) recorded, unfiltered [Nm or N]; currents [A] where these are rows of currents.
        carried: (N, n) of that, what declared payloads make [Nm or N].
        stretches: rows of each.
        rate_hz: rows a second of each.
        rows_left: recorded rows in stretches too short to use.
        rows_beside_gaps: recorded rows of the others that are left away within a period of the cut-off of a gap.
        rows_whole: rows that the filter leaves of all stretches; more than N where blocks stand for them.
        recorded: of each stretch the torque on an even grid at the recorded rate, that rate [Hz], and of how many of
            its rows one is kept.
        currents: these are rows of motor currents.
    """

    motion: EvenMotion
    torque: FloatArray
    carried: FloatArray
    stretches: tuple[slice, ...]
    rate_hz: tuple[float, ...]
    rows_left: int
    rows_beside_gaps: int
    rows_whole: int
    recorded: tuple[tuple[FloatArray, float, int], ...]
    currents: bool = False

    @classmethod
    def of(
        cls,
        recordings: Sequence[Recording],
        robot: Robot,
        cutoff_hz: float,
        payloads: Sequence[Payload | None] = (),
        *,
        gains: FloatArray | None = None,
        currents: bool = False,
        limit: int | None = None,
    ) -> TorqueRows:
        """Filter motions at a cut-off, and put torques beside them.

        No more rows are kept than the filter leaves something to say in. Where that is more than ``limit``, blocks
        spread evenly over the time are kept, each a stretch of its own and filtered beyond its ends before it is cut
        out, so that its motion is that of the whole recording. Every recording has one, or more by its length.
        Beside a gap one period of the cut-off is left away: the filter knows only one side of the motion there.

        Args:
            recordings: with torques, or with currents where ``gains`` or ``currents`` are given.
            robot: the chain.
            cutoff_hz: of the zero-phase filter.
            payloads: what each recording carried; default: nothing.
            gains: (n,) torque per current of each motor [Nm/A or N/A], for recordings without torque.
            currents: take the currents as they are, whatever else is recorded.
            limit: rows that are enough; no more than twice as many are kept. None: all.

        Raises:
            InputError: no torque, other joints, no stretch that is long enough, another number of payloads.
        """
        if not 0 < cutoff_hz < math.inf:
            raise InputError("cutoff_hz", f"is {cutoff_hz}", "wanted a frequency above 0 [Hz]")
        if payloads and len(payloads) != len(recordings):
            raise InputError("payloads", f"{len(payloads)} for {len(recordings)} recordings", "wanted one for each")
        parts, rates, recorded, left, beside_gaps, seams = [], [], [], 0, 0, 0
        usable: list[_Stretch] = []
        torques = []
        for number, recording in enumerate(recordings):
            if recording.dof != robot.dof:
                raise InputError("recording", f"has {recording.dof} joints", f"{robot.name} has {robot.dof}")
            torques.append(_current_of(recording) if currents else _torque_of(recording, gains))
            whole = stretches_of(recording.t)
            seams += len(whole)
            for rows in whole:
                t = recording.t[rows]
                if t.size < _LEAST_ROWS or (len(whole) > 1 and t[-1] - t[0] < _LEAST_PERIODS / cutoff_hz):
                    left += t.size
                    continue
                first, last = float(t[0]), float(t[-1])
                first += _SEAM_PERIODS / cutoff_hz if rows.start > 0 else 0.0
                last -= _SEAM_PERIODS / cutoff_hz if rows.stop < recording.t.size else 0.0
                beside_gaps += int((t < first).sum() + (t > last).sum())
                usable.append(_Stretch(number, rows, kept_rate(t, cutoff_hz), first, last))
        chosen, rows_whole = _blocks(recordings, usable, limit)
        for number, rows, span in chosen:
            recording = recordings[number]
            t = recording.t[rows]
            if span is not None:
                margin = _MARGIN_PERIODS / cutoff_hz
                first, last = np.searchsorted(t, [span[0] - margin, span[1] + margin])
                rows = slice(rows.start + int(first), rows.start + int(last))
                t = recording.t[rows]
                if t.size < _LEAST_ROWS:  # most of the stretch is denser than this part of it
                    continue
            qd = None if recording.qd is None else recording.qd[rows]
            motion = even_motion(t, recording.q[rows], qd, cutoff_hz)
            grid, rate = even_grid(t)
            every = onto(grid, t, torques[number][rows])
            stride = round(rate / motion.rate_hz)
            if span is not None:
                first, last = np.searchsorted(motion.t, span).tolist()
                motion = motion.part(slice(first, last))
                every = every[first * stride : last * stride]
            payload = payloads[number] if payloads else None
            carried = np.zeros_like(motion.q) if payload is None else payload_torque(robot, payload, motion)
            if motion.t.size < _LEAST_KEPT:
                problem = f"{cutoff_hz:g} Hz leaves {motion.t.size} rows of {t[-1] - t[0]:.3g} s to fit to"
                raise InputError("cutoff_hz", problem, f"wanted at least {_LEAST_KEPT}: a higher one")
            parts.append((motion, every[::stride], carried))
            rates.append(motion.rate_hz)
            recorded.append((every, rate, stride))
        if not parts:
            problem = f"{left} rows" if seams == 1 else f"{left} rows in {seams} stretches too short to use"
            raise InputError(
                "recording",
                problem,
                f"wanted at least {_LEAST_ROWS} and {_LEAST_PERIODS / cutoff_hz:.3g} s without a gap",
            )
        motions = [part[0] for part in parts]
        joined = [np.concatenate([getattr(motion, name) for motion in motions]) for name in ("t", "q", "qd", "qdd")]
        ends = np.cumsum([0, *(motion.t.size for motion in motions)]).tolist()
        return cls(
            EvenMotion(joined[0], joined[1], joined[2], joined[3], rates[0]),
            np.concatenate([part[1] for part in parts]),
            np.concatenate([part[2] for part in parts]),
            tuple(slice(a, b) for a, b in pairwise(ends)),
            tuple(rates),
            left,
            beside_gaps,
            rows_whole,
            tuple(recorded),
            currents,
        )

    def filtered(self, x: FloatArray, cutoff_hz: float) -> FloatArray:
        """Columns (N, ...) after the zero-phase filter, each stretch for itself."""
        flat = x.reshape(x.shape[0], -1)
        # Most columns act on few joints: what is zero stays so.
        acting = np.flatnonzero(flat.any(axis=0))
        result = np.zeros_like(flat)
        for rows, rate in zip(self.stretches, self.rate_hz, strict=True):
            result[rows, acting] = lowpass(flat[rows, acting], rate, cutoff_hz)
        return result.reshape(x.shape)

    def torque_below(self, cutoff_hz: float) -> FloatArray:
        """Recorded torque (N, n) after the zero-phase filter, which it passes at the recorded rate.

        Thinned out first, what lies above half the thinner rate would come back as noise below it.
        """
        return np.concatenate([lowpass(x, rate, cutoff_hz)[::stride] for x, rate, stride in self.recorded])


class _Stretch(NamedTuple):
    """A part of a recording between gaps.

    Attributes:
        recording: its number.
        rows: of it.
        rate_hz: rows a second behind the filter.
        first, last: times between which its filtered motion is used [s].
    """

    recording: int
    rows: slice
    rate_hz: float
    first: float
    last: float

    @property
    def size(self) -> float:
        """Rows behind the filter."""
        return (self.last - self.first) * self.rate_hz


def _blocks(
    recordings: Sequence[Recording], stretches: list[_Stretch], limit: int | None
) -> tuple[list[tuple[int, slice, tuple[float, float] | None]], int]:
    """What is kept of stretches, and how many rows they have behind the filter.

    Args:
        recordings: all.
        stretches: of all recordings.
        limit: as for :meth:`TorqueRows.of`.

    Returns:
        Number of the recording, rows of a stretch, and the first and last time of a block in it [s]; None: all of it.
    """
    rows_whole = sum(int(stretch.size) + 1 for stretch in stretches)

    def all_of(own: _Stretch) -> tuple[int, slice, tuple[float, float] | None]:
        t = recordings[own.recording].t
        ends = (float(t[own.rows.start]), float(t[own.rows.stop - 1]))
        # Up to and with the last row; a block ends before the first row of the next.
        span = None if (own.first, own.last) == ends else (own.first, own.last + 0.5 / own.rate_hz)
        return own.recording, own.rows, span

    if limit is None or rows_whole <= limit:
        return [all_of(stretch) for stretch in stretches], rows_whole
    # Of very many stretches every so manieth, counted from the first of each recording.
    every = math.ceil(sum(min(stretch.size, _LEAST_BLOCK) for stretch in stretches) / limit)
    firsts = {stretch.recording: place for place, stretch in reversed(list(enumerate(stretches)))}
    kept = [own for place, own in enumerate(stretches) if (place - firsts[own.recording]) % every == 0]
    total = sum(stretch.size for stretch in kept)
    found: list[tuple[int, slice, tuple[float, float] | None]] = []
    for stretch in kept:
        own = max(limit * stretch.size / total, _LEAST_BLOCK)
        if own >= stretch.size:
            found.append(all_of(stretch))
            continue
        count = max(1, min(round(_BLOCKS * stretch.size / total), int(own / _LEAST_BLOCK)))
        length = own / count / stretch.rate_hz
        room = stretch.last - stretch.first - length
        starts = stretch.first + (np.linspace(0, room, count) if count > 1 else np.array([room / 2]))
        found += [(stretch.recording, stretch.rows, (start, start + length)) for start in starts.tolist()]
    return found, rows_whole


def recorded_motion(
    recording: Recording, cutoff_hz: float, gains: FloatArray | None = None
) -> tuple[EvenMotion, FloatArray]:
    """The filtered motion of a whole recording, and its torques (N, n) at the same times; straight across gaps."""
    torque = _torque_of(recording, gains)
    motion = even_motion(recording.t, recording.q, recording.qd, cutoff_hz)
    return motion, onto(motion.t, recording.t, torque)


def _torque_of(recording: Recording, gains: FloatArray | None) -> FloatArray:
    if recording.tau is not None:
        return recording.tau
    if gains is None:
        raise InputError("recording", f"{recording.source or 'it'} has no joint torque", "wanted tau_1 .. tau_n")
    return _current_of(recording) * gains


def _current_of(recording: Recording) -> FloatArray:
    if recording.current is None:
        raise InputError("recording", f"{recording.source or 'it'} has no motor current", "wanted current_1 ..")
    return recording.current


def listed(recordings: Recording | Sequence[Recording]) -> list[Recording]:
    """One or more recordings as a list.

    Raises:
        InputError: none at all.
    """
    logs = list(recordings) if isinstance(recordings, Sequence) else [recordings]
    if not logs:
        raise InputError("recordings", "there are none", "wanted one or more")
    return logs
