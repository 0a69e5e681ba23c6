"""Rows that dynamics are fitted to and compared on: filtered motion and torque, stretch by stretch."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.drive_rows import stretches_of
from bumpstop.identification.motion import EvenMotion, even_grid, even_motion, lowpass, onto
from bumpstop.identification.payload_fit import payload_torque

if TYPE_CHECKING:
    from bumpstop.identification.payload import Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# A stretch is used when it has so many rows and lasts so many periods of the cut-off.
_LEAST_ROWS, _LEAST_PERIODS = 50, 5.0


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
    ) -> TorqueRows:
        """Filter motions at a cut-off, and put torques beside them.

        Args:
            recordings: with torques, or with currents where ``gains`` or ``currents`` are given.
            robot: the chain.
            cutoff_hz: of the zero-phase filter.
            payloads: what each recording carried; default: nothing.
            gains: (n,) torque per current of each motor [Nm/A or N/A], for recordings without torque.
            currents: take the currents as they are, whatever else is recorded.

        Raises:
            InputError: no torque, other joints, no stretch that is long enough, another number of payloads.
        """
        if payloads and len(payloads) != len(recordings):
            raise InputError("payloads", f"{len(payloads)} for {len(recordings)} recordings", "wanted one for each")
        parts, rates, recorded, left, seams = [], [], [], 0, 0
        for number, recording in enumerate(recordings):
            if recording.dof != robot.dof:
                raise InputError("recording", f"has {recording.dof} joints", f"{robot.name} has {robot.dof}")
            torque = _current_of(recording) if currents else _torque_of(recording, gains)
            whole = stretches_of(recording.t)
            seams += len(whole)
            for rows in whole:
                t = recording.t[rows]
                if t.size < _LEAST_ROWS or (len(whole) > 1 and t[-1] - t[0] < _LEAST_PERIODS / cutoff_hz):
                    left += t.size
                    continue
                qd = None if recording.qd is None else recording.qd[rows]
                motion = even_motion(t, recording.q[rows], qd, cutoff_hz)
                carried = np.zeros_like(motion.q)
                payload = payloads[number] if payloads else None
                if payload is not None:
                    carried = payload_torque(robot, payload, motion)
                grid, rate = even_grid(t)
                every = onto(grid, t, torque[rows])
                stride = round(rate / motion.rate_hz)
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
            tuple(recorded),
            currents,
        )

    def filtered(self, x: FloatArray, cutoff_hz: float) -> FloatArray:
        """Columns (N, ...) after the zero-phase filter, each stretch for itself."""
        parts = [lowpass(x[rows], rate, cutoff_hz) for rows, rate in zip(self.stretches, self.rate_hz, strict=True)]
        return parts[0] if len(parts) == 1 else np.concatenate(parts)

    def torque_below(self, cutoff_hz: float) -> FloatArray:
        """Recorded torque (N, n) after the zero-phase filter, which it passes at the recorded rate.

        Thinned out first, what lies above half the thinner rate would come back as noise below it.
        """
        return np.concatenate([lowpass(x, rate, cutoff_hz)[::stride] for x, rate, stride in self.recorded])


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
