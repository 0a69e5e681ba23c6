"""Rows that dynamics are fitted to and compared on: filtered motion and torque, segment by segment."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import combinations, pairwise
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.payload.tip_parameters import payload_torque
from bumpstop.identification.segments.covariance_blocks import Segment, blocks_of_segments
from bumpstop.identification.segments.drive_samples import split_at_gaps
from bumpstop.identification.segments.motion import (
    MIN_ROWS,
    UniformGrid,
    UniformMotion,
    interpolate_to,
    lowpass,
    lowpass_reach,
    resample,
)
from bumpstop.identification.segments.padded_segments import PaddedSegments
from bumpstop.identification.segments.rest import resting, used_rows
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.recording.checks.checks import gaps_of
from bumpstop.terminal import counted

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.identification.payload.payload import Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# A segment is used when it has so many rows and lasts so many periods of the cut-off.
_MIN_PERIODS = 5.0
_MIN_KEPT = 16  # behind the filter, as torques pass another
# Beside a gap, and where a recording begins or ends, the filter has one side of the motion only to go by: so many
# periods of the cut-off are left out, at the ends no more than a share of the segment.
_SEAM_PERIODS, _MAX_AT_END = 1.0, 0.05
# A joint that moves less far stands still [rad or m]: encoders make some of it, and no planned motion is so small.
STILL = 0.01
_SAME_TIME = 1e-3  # of a period


class RecordedTorque(NamedTuple):
    """Torque of a segment and its margins, unfiltered and not thinned out.

    Attributes:
        torque: (K, n) on the even grid at the recorded rate [Nm or N]; currents [A] where these are rows of currents.
        rate_hz: rows a second.
        stride: of how many rows one is kept.
        kept: of these kept rows those of the segment itself.
    """

    torque: FloatArray
    rate_hz: float
    stride: int
    kept: slice


@dataclass(frozen=True, eq=False)
class TorqueSamples:
    """Segments of recordings one after another. Filters never reach from one into the next.

    Of a long recording blocks stand for the whole, each a segment of its own. Beside a block lie margins, as far as the
    filters reach that it is made for: these go through them with it and are cut off behind, so that filtered or not its
    rows are those of the whole recording.

    Attributes:
        reach: motion and carried torque of segments and margins.
        recorded: torque of each segment.
        rows_left: recorded rows in segments too short to use.
        rows_beside_gaps: recorded rows of the others that are left out within a period of the cut-off of a gap.
        rows_at_ends: recorded rows left out where recordings begin and end.
        rows_whole: rows that the filter leaves of all segments; more than N where blocks stand for them.
        rests: (N, n) rows at which each joint rests.
        currents: these are rows of motor currents.
    """

    reach: PaddedSegments
    recorded: tuple[RecordedTorque, ...]
    rows_left: int
    rows_beside_gaps: int
    rows_at_ends: int
    rows_whole: int
    rests: npt.NDArray[np.bool_]
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
        filters_hz: Sequence[float] = (),
        rate_hz: float | None = None,
        trim_s: float | None = None,
        ends: bool = False,
        gravity: tuple[float, float, float] = STANDARD_GRAVITY,
    ) -> TorqueSamples:
        """Filter motions at a cut-off, and put torques beside them.

        No more rows are kept than the filter leaves something to say in. Where that is more than ``limit``, blocks
        spread evenly over the time are kept. Every recording has one, or more by its length. Beside a gap one period of
        the cut-off is left out: the filter knows only one side of the motion there. So it is where a recording begins
        and ends, but no more than a twentieth of it: a fit would take what the filter makes there for the arm's. A
        comparison keeps these rows.

        Args:
            recordings: with torques, or with currents where ``gains`` or ``currents`` are given.
            robot: the chain.
            cutoff_hz: of the zero-phase filter.
            payloads: what each recording carried; default: nothing.
            gains: (n,) torque per current of each motor [Nm/A or N/A], for recordings without torque.
            currents: take the currents as they are, whatever else is recorded.
            limit: rows that are enough; no more than twice as many are kept. None: all.
            filters_hz: cut-offs of the filters that rows of blocks are to pass as the whole would; through others they
                pass with what margins they have.
            rate_hz: rows a second to keep, at least; default: ten a period of the cut-off.
            trim_s: left out at the ends and beside gaps; default: one period of the cut-off. With ``rate_hz`` the rows
                are the same ones whatever the cut-off.
            ends: keep the rows where recordings begin and end.
            gravity: acceleration of free fall in the base frame [m/s2].

        Raises:
            InputError: no torque, other joints, no segment that is long enough, another number of payloads.
        """
        if not 0 < cutoff_hz < math.inf:
            raise InputError("cutoff_hz", f"is {cutoff_hz}", "wanted a frequency above 0 [Hz]")
        if payloads and len(payloads) != len(recordings):
            raise InputError("payloads", f"{len(payloads)} for {len(recordings)} recordings", "wanted one for each")
        usable: list[Segment] = []
        torques = []
        left = beside_gaps = at_ends = seams = 0
        trim = _SEAM_PERIODS / cutoff_hz if trim_s is None else trim_s
        for number, recording in enumerate(recordings):
            recording.check_robot(robot)
            torques.append(_current_of(recording) if currents else _torque_of(recording, gains))
            whole = split_at_gaps(recording.t)
            seams += len(whole)
            for rows in whole:
                t = recording.t[rows]
                if t.size < MIN_ROWS or (len(whole) > 1 and t[-1] - t[0] < _MIN_PERIODS * trim):
                    left += t.size
                    continue
                segment, lost, cut = _segment(number, rows, recording.t, cutoff_hz, rate_hz, trim, ends)
                usable.append(segment)
                beside_gaps += lost
                at_ends += cut
        if not usable:
            problem = (
                counted(left, "row") if seams == 1 else f"{counted(left, 'row')} in {seams} segments too short to use"
            )
            raise InputError(
                "recording",
                problem,
                f"wanted at least {MIN_ROWS} and {_MIN_PERIODS * trim:.3g} s without a gap",
            )
        motions, carried, segments, kept, recorded, rests = [], [], [], [], [], []
        start = 0
        for segment, own in blocks_of_segments(usable, limit):
            if own.stop - own.start < _MIN_KEPT:
                span = recordings[segment.recording].t[segment.rows]
                problem = f"{cutoff_hz:g} Hz leaves {own.stop - own.start} rows of {span[-1] - span[0]:.3g} s to fit to"
                raise InputError("cutoff_hz", problem, f"wanted at least {_MIN_KEPT}: a higher one")
            recording = recordings[segment.recording]
            around = _with_margins(segment, own, filters_hz)
            qd = None if recording.qd is None else recording.qd[segment.rows]
            own_motion = segment.grid.motion(recording.q[segment.rows], qd, cutoff_hz, around, segment.stride)
            motions.append(replace(own_motion, gravity=gravity))
            payload = payloads[segment.recording] if payloads else None
            held = np.zeros_like(motions[-1].q) if payload is None else payload_torque(robot, payload, motions[-1])
            carried.append(held)
            every = slice(around.start * segment.stride, around.stop * segment.stride)
            torque = segment.grid.columns(torques[segment.recording][segment.rows], every)
            inside = slice(own.start - around.start, own.stop - around.start)
            still = resting(segment.grid.columns(recording.q[segment.rows], every), segment.grid.rate_hz)
            rests.append(still[:: segment.stride][inside])
            recorded.append(RecordedTorque(torque, segment.grid.rate_hz, segment.stride, inside))
            segments.append(slice(start, start + motions[-1].t.size))
            kept.append(slice(start + inside.start, start + inside.stop))
            start = segments[-1].stop
        columns = [np.concatenate([getattr(motion, name) for motion in motions]) for name in ("t", "q", "qd", "qdd")]
        rates = tuple(motion.rate_hz for motion in motions)
        motion = UniformMotion(columns[0], columns[1], columns[2], columns[3], rates[0], gravity)
        reach = PaddedSegments(motion, np.concatenate(carried), tuple(segments), tuple(kept), rates)
        rows_whole = sum(segment.size for segment in usable)
        return cls(reach, tuple(recorded), left, beside_gaps, at_ends, rows_whole, np.concatenate(rests), currents)

    @property
    def rate_hz(self) -> tuple[float, ...]:
        """Rows a second of each segment."""
        return self.reach.rate_hz

    @cached_property
    def segments(self) -> tuple[slice, ...]:
        """Rows of each segment, without margins."""
        ends = np.cumsum([0, *(rows.stop - rows.start for rows in self.reach.kept)]).tolist()
        return tuple(slice(a, b) for a, b in pairwise(ends))

    @cached_property
    def motion(self) -> UniformMotion:
        """(N, n) of all segments; its times are those of the recordings, its rate that of the first."""
        motion, within = self.reach.motion, self.reach.within
        t, q, qd, qdd = (within(x) for x in (motion.t, motion.q, motion.qd, motion.qdd))
        return UniformMotion(t, q, qd, qdd, motion.rate_hz, motion.gravity)

    @cached_property
    def used(self) -> npt.NDArray[np.bool_]:
        """(N, n) rows that each joint is fitted to: those at which it moves, or all where it hardly ever does."""
        return used_rows(self.rests)

    @cached_property
    def torque(self) -> FloatArray:
        """(N, n) recorded, unfiltered [Nm or N]; currents [A] where these are rows of currents."""
        return np.concatenate([own.torque[:: own.stride][own.kept] for own in self.recorded])

    @cached_property
    def carried(self) -> FloatArray:
        """(N, n) of the torque, what declared payloads make [Nm or N]."""
        return self.reach.within(self.reach.carried)

    def torque_below(self, cutoff_hz: float) -> FloatArray:
        """Recorded torque (N, n) after the zero-phase filter, which it passes at the recorded rate.

        Thinned out first, what lies above half the thinner rate would come back as noise below it.
        """
        return np.concatenate(
            [lowpass(own.torque, own.rate_hz, cutoff_hz)[:: own.stride][own.kept] for own in self.recorded]
        )


def _segment(
    number: int, rows: slice, t: FloatArray, cutoff_hz: float, rate_hz: float | None, trim_s: float, ends: bool
) -> tuple[Segment, int, int]:
    """A part of a recording, and how many of its recorded rows are left out beside gaps and at its ends."""
    own = t[rows]
    grid = UniformGrid.of(own)
    stride = grid.stride(cutoff_hz) if rate_hz is None else max(1, int(grid.rate_hz / rate_hz * (1 + 1e-6)))
    times = grid.t[::stride]
    at_end = 0.0 if ends else min(trim_s, _MAX_AT_END * float(own[-1] - own[0]))
    before, behind = rows.start > 0, rows.stop < t.size  # gaps
    first = float(own[0]) + (trim_s if before else at_end)
    last = float(own[-1]) - (trim_s if behind else at_end)
    start = int(np.searchsorted(times, first))
    # Up to and with the last row.
    stop = int(np.searchsorted(times, last + 0.5 * stride / grid.rate_hz))
    sides = (before, int((own < first).sum())), (behind, int((own > last).sum()))
    lost, cut = (sum(count for gap, count in sides if gap is wanted) for wanted in (True, False))
    return Segment(number, rows, grid, stride, slice(start, max(start, stop))), lost, cut


def _with_margins(segment: Segment, own: slice, filters_hz: Sequence[float]) -> slice:
    """Kept rows of a block and of its margins, as far as there are any."""
    count = segment.grid.t[:: segment.stride].size
    if own == segment.used:
        return slice(0, count)
    # Columns pass a filter at the rate that is kept, recorded torques at theirs.
    margin = max(
        (
            max(
                lowpass_reach(segment.rate_hz, cutoff),
                math.ceil(lowpass_reach(segment.grid.rate_hz, cutoff) / segment.stride),
            )
            for cutoff in filters_hz
        ),
        default=0,
    )
    return slice(max(0, own.start - margin), min(count, own.stop + margin))


def recorded_motion(
    recording: Recording, cutoff_hz: float, gains: FloatArray | None = None
) -> tuple[UniformMotion, FloatArray]:
    """The filtered motion of a whole recording, and its torques (N, n) at the same times; straight across gaps."""
    torque = _torque_of(recording, gains)
    motion = resample(recording.t, recording.q, recording.qd, cutoff_hz)
    return motion, interpolate_to(motion.t, recording.t, torque)


def near_gaps(t: FloatArray, recorded: FloatArray, beside_s: float) -> np.ndarray:
    """Grid times inside a gap of the recorded times, where what stands there was made up by interpolation, or near one.

    Near: within ``beside_s`` [s] of a gap across which no filter of an identification reaches.
    """
    found = np.zeros(t.size, dtype=bool)
    # The grid's times are rounded otherwise than those of the rows that they stand for.
    same = _SAME_TIME * float(np.median(np.diff(recorded)))
    for start, length in gaps_of(recorded):
        found |= (t > start + same) & (t < start + length - same)
    parts = split_at_gaps(recorded)
    for one, other in pairwise(parts):
        found |= (t > recorded[one.stop - 1] - beside_s) & (t < recorded[other.start] + beside_s)
    return found


def near_ends(motion: UniformMotion, beside_s: float) -> npt.NDArray[np.bool_]:
    """Grid times within ``beside_s`` [s] of an end of the recording at which the arm does not rest.

    The filter continues the positions there by turning them over, and so has no acceleration at the end.
    """
    t, moves = motion.t, ~resting(motion.q, motion.rate_hz).all(axis=1)
    begin, end = t < t[0] + beside_s, t > t[-1] - beside_s
    found: npt.NDArray[np.bool_] = (begin & (begin & moves).any()) | (end & (end & moves).any())
    return found


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


def joints_at_rest(recordings: Sequence[Recording], robot: Robot) -> tuple[str, ...]:
    """Names of the joints that hardly move: what their own motion would show is noise of their encoders.

    Raises:
        InputError: no joint moves, or a recording is not of this robot.
    """
    for recording in recordings:
        recording.check_robot(robot)
    low = np.min([recording.q.min(axis=0) for recording in recordings], axis=0)
    high = np.max([recording.q.max(axis=0) for recording in recordings], axis=0)
    still = high - low < STILL
    if still.all():
        problem = f"no joint moves by as much as {STILL:g} rad or m"
        raise InputError("recording", problem, "wanted a motion: an arm at rest shows no dynamics")
    return tuple(joint.name for joint, rests in zip(robot.joints, still, strict=True) if rests)


def as_list(recordings: Recording | Sequence[Recording]) -> list[Recording]:
    """One or more recordings as a list.

    Raises:
        InputError: none at all, or one twice.
    """
    logs = list(recordings) if isinstance(recordings, Sequence) else [recordings]
    if not logs:
        raise InputError("recordings", "there are none", "wanted one or more")
    for (i, one), (k, other) in combinations(enumerate(logs, 1), 2):
        if all(_same(getattr(one, name), getattr(other, name)) for name in ("t", "q", "tau", "current")):
            # Its rows would count as twice as many, and standard errors would be too small.
            problem = f"{one.source or f'number {i}'} and {other.source or f'number {k}'} are the same"
            raise InputError("recordings", problem, "give each recording once")
    return logs


def _same(one: FloatArray | None, other: FloatArray | None) -> bool:
    return one is other or (one is not None and other is not None and np.array_equal(one, other))
