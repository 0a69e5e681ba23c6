"""Recordings and trajectory tables as programs: their segments, and the whole with new times."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError
from bumpstop.output_files import write_bytes
from bumpstop.program.trajectories.trajectory_segment import TrajectorySegment, find_segments

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.program.cell import Cell
    from bumpstop.program.segment import Segment
    from bumpstop.recording import Recording
    from bumpstop.recording.read_report import ReadReport

# A recording is thinned to this rate [Hz] and smoothed over so many rows: encoders tremble.
_RATE_HZ, _SMOOTHED = 50.0, 7
_MEDIAN = 0.6745  # of the absolute value of what is normally distributed, in standard deviations


@dataclass(frozen=True, eq=False)
class RecordedProgram:
    """A recording: its segments, and how long it rests between them.

    Attributes:
        time: of the thinned rows [s].
        position: of them (rows, dof).
    """

    language: str
    segments: Sequence[TrajectorySegment]
    time: FloatArray
    position: FloatArray
    notes: Sequence[str]
    not_understood: Sequence[tuple[int, str]] = ()
    moves_unseen: bool = False

    def file_name(self, path: Path) -> str:  # noqa: D102
        return f"{path.stem}.csv"

    def may_be_raised(self, place: object) -> bool:  # noqa: D102
        return True

    def write(self, factors: Mapping[Segment, float], target: Path) -> None:  # noqa: D102
        write_bytes(target, self.written(factors))

    def written(self, factors: Mapping[Segment, float]) -> bytes:
        """Columns t, q_1.., qd_1..: segments with their new times, and the rests between them as long as they were."""
        time: list[float] = []
        position: list[list[float]] = []
        velocity: list[list[float]] = []
        now, last = 0.0, 0
        for segment in self.segments:
            first = segment.rows[0]
            now += float(self.time[first] - self.time[last])
            motion = segment.at(factors.get(segment, 1.0))
            rate = motion.at(motion.time, 1)
            # Where one begins right where the one before it ends, their common row is written once.
            skip = 1 if time and now <= time[-1] else 0
            time += (now + motion.time[skip:]).tolist()
            position += motion.position[skip:].tolist()
            velocity += rate[skip:].tolist()
            now, last = now + motion.duration, segment.rows[1]
        dof = self.position.shape[1]
        names = ["t", *(f"q_{j + 1}" for j in range(dof)), *(f"qd_{j + 1}" for j in range(dof))]
        rows = (",".join(map(repr, (t, *q, *v))) for t, q, v in zip(time, position, velocity, strict=True))
        return ("\n".join([",".join(names), *rows]) + "\n").encode()


def read_recorded(path: Path, cell: Cell, *, columns: Path | None = None, topic: str | None = None) -> RecordedProgram:
    """A recording in any format of ``bumpstop recording``.

    Args:
        path: of the recording.
        cell: whose robot it is of.
        columns: its column file.
        topic: of a bag with several.

    Raises:
        InputError: it cannot be read, is of another arm, or rests all the time.
    """
    from bumpstop.recording import Recording

    recording = Recording.load(path, columns=columns, topic=topic, robot=cell.robot)
    recording.check_robot(cell.robot)
    own_time, report = recording.t - recording.t[0], recording.report
    t, q, noise, notes = _smoothed(own_time, recording.q)
    doubts = [*report.contradictions, *(note.rstrip(".") for note in report.time_doubts)]
    missing = _missing(own_time, recording, float(t[1]))
    robot = cell.robot
    segments = []
    for number, (first, last) in enumerate(find_segments(t, q, None, noise=noise), start=1):
        rows = slice(first, last + 1)
        unseen = [said for begin, end, said in missing if begin < t[last] and end > t[first]]
        segments.append(
            TrajectorySegment(
                f"segment {number}",
                tuple(np.searchsorted(own_time, t[rows] - 1e-9) + 1),
                (first, last),
                robot,
                t[rows],
                q[rows],
                None,
                cell.joint_acceleration,
                dense=True,
                why=next(iter((*doubts, *unseen)), ""),
            )
        )
    if not segments:
        raise InputError(str(path), "rests all the time", "wanted a recording of a motion")
    return RecordedProgram("recording", segments, t, q, [*_said(report, [said for *_, said in missing]), *notes])


def _missing(t: FloatArray, recording: Recording, step: float) -> list[tuple[float, float, str]]:
    """Where rows are missing for more than two steps [s]: from when to when, and what is said of it."""
    gaps = [(begin - recording.t[0], length) for begin, length in recording.report.gaps if length > 2 * step]
    return [
        (begin, begin + length, f"rows are missing for {length:.3g} s after row {int(np.searchsorted(t, begin)) + 1}")
        for begin, length in gaps
    ]


def _said(report: ReadReport, missing: Sequence[str]) -> list[str]:
    dropped = f"{report.rows_dropped} of {report.rows_read} rows were dropped while reading"
    more = [f"{missing[0]}, and at {len(missing) - 1} more places"] if len(missing) > 1 else missing
    return [*([dropped] if report.rows_dropped else []), *more, *report.notes]


def _smoothed(t: FloatArray, q: FloatArray) -> tuple[FloatArray, FloatArray, float, list[str]]:
    """Evenly spaced rows, smoothed, the noise that was in them, and what was done."""
    if len(t) < 4 or not t[-1] > 0:
        raise InputError("program", f"the recording has {len(t)} rows", "wanted four at least")
    rate = min(_RATE_HZ, (len(t) - 1) / float(t[-1]))
    n = max(4, round(float(t[-1]) * rate) + 1)
    even = np.linspace(0.0, float(t[-1]), n)
    resampled = np.column_stack([np.interp(even, t, column) for column in q.T])
    if n < 2 * _SMOOTHED:
        return even, resampled, 0.0, []
    from scipy.signal import savgol_filter

    smooth = np.asarray(savgol_filter(resampled, _SMOOTHED, 3, axis=0))
    moved = float(np.abs(smooth - resampled).max())
    # The median of what was taken away: in a motion it is more than noise.
    noise = float(np.linalg.norm(np.median(np.abs(smooth - resampled), axis=0))) / _MEDIAN
    return even, smooth, noise, [f"rows at {rate:.3g} Hz, smoothed; that moves a joint by {moved:.2g} rad at most"]
