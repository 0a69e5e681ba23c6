"""The residual of fitted dynamics over a whole recording, and the rows in which there is none."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.detection.detection_run import FAULTS
from bumpstop.terminal import counted

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.identification.segments.motion import UniformMotion
    from bumpstop.recording import Recording

_MIN_REPEATS = 4  # of a row that count as frozen, as in sample_validator.hpp


@dataclass(frozen=True, eq=False)
class OfflineResidual:
    """Recorded minus predicted torque by filters that look ahead, on an even grid of N rows.

    Attributes:
        motion: as filtered.
        residual: (N, dof) [Nm or N]; NaN in rows without data.
        in_gap: (N,) rows inside a gap, or within ``beside_s`` of one across which no filter reaches.
        at_end: (N,) rows within ``beside_s`` of an end of the recording at which the arm moves.
        frozen: (N,) rows in which feedback stood still.
        beside_s: a period of the filters' cut-off [s].
    """

    motion: UniformMotion
    residual: FloatArray
    in_gap: npt.NDArray[np.bool_]
    at_end: npt.NDArray[np.bool_]
    frozen: npt.NDArray[np.bool_]
    beside_s: float

    @classmethod
    def of(cls, recording: Recording, model: DynamicsModel, frozen_s: float) -> OfflineResidual:
        """The residual of a recording.

        Args:
            recording: with joint torques, or with currents where the model has gains.
            model: of the dynamics.
            frozen_s: time for which feedback may repeat itself [s].

        Raises:
            InputError: the recording has no torque, is of other joints, or has too few rows.
        """
        # Fits are a tenth of the time that laws take to start, and these need none.
        from bumpstop.identification.segments.torque_samples import near_ends, near_gaps

        repeats = _frozen_rows(recording, frozen_s)
        live = _without(recording, repeats)
        motion, residual = model.residual(live)
        frozen = np.zeros(motion.t.size, dtype=bool)
        for first, last in repeats:
            frozen |= (motion.t > recording.t[first]) & (motion.t <= recording.t[last])
        beside_s = 1 / model.cutoff_hz
        in_gap, at_end = near_gaps(motion.t, live.t, beside_s), near_ends(motion, beside_s)
        residual[in_gap | at_end | frozen] = np.nan
        return cls(motion, residual, in_gap, at_end, frozen, beside_s)

    @property
    def no_data(self) -> npt.NDArray[np.bool_]:
        """(N,) rows in which there is no residual."""
        return np.asarray(self.in_gap | self.at_end | self.frozen)

    @property
    def fault(self) -> npt.NDArray[np.uint8]:
        """(N,) why there is none, by number in :data:`FAULTS`."""
        fault = np.zeros(self.motion.t.size, dtype=np.uint8)
        for rows, name in ((self.at_end, "filling"), (self.in_gap, "gap"), (self.frozen, "frozen")):
            fault[rows] = FAULTS.index(name)
        return fault

    @property
    def notes(self) -> list[str]:
        """What is to be known of its rows."""
        notes = [
            "Fitted dynamics: residuals on an even grid, by filters that look ahead; not what a loop would have seen."
        ]
        if self.at_end.any():
            notes.append(
                "The recording begins or ends in motion: "
                f"{counted(int(np.count_nonzero(self.at_end)), 'row')} within {self.beside_s:.3g} s of an end "
                f"{'is' if self.at_end.sum() == 1 else 'are'} not judged, as the filters know one side of the motion "
                "only there."
            )
        return notes


def _frozen_rows(recording: Recording, frozen_s: float) -> list[tuple[int, int]]:
    """First and last rows of parts in which positions and signals stand still for longer than ``frozen_s``.

    As the loop's guard has it of an arm at rest: at least five rows are the same.
    """
    signals = [one for one in (recording.q, recording.current, recording.tau, recording.qd) if one is not None]
    same = np.all([(np.diff(one, axis=0) == 0).all(axis=1) for one in signals], axis=0)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], same, [False]]).astype(np.int8)))
    return [
        (int(first), int(last))
        for first, last in zip(edges[::2], edges[1::2], strict=True)
        if last - first >= _MIN_REPEATS and recording.t[last] - recording.t[first] > frozen_s
    ]


def _without(recording: Recording, repeats: list[tuple[int, int]]) -> Recording:
    """The recording without what repeats: a moving arm that seems to stand, and then jumps, is no motion to filter."""
    if not repeats:
        return recording
    kept = np.ones(recording.t.size, dtype=bool)
    for first, last in repeats:
        kept[first + 1 : last + 1] = False
    return recording.rows(kept)
