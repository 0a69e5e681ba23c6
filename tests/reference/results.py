"""What the reference simulator answers: runs, or one run step by step. Units and numbering are those of the
settings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True)
class ReferenceRuns:
    """What came out of each run. Maxima are taken from the step of detection on, as in Schroeder (2013).

    Values that do not exist (a detection time without detection) are NaN, the tick is -1.
    """

    detected: npt.NDArray[np.bool_]
    false_alarm: npt.NDArray[np.bool_]  # detected while the contact force was zero
    detection_tick: npt.NDArray[np.int32]
    trigger_mask: npt.NDArray[np.uint32]  # bit j: joint j over its threshold at that tick
    detection_time_s: Floats
    end_time_s: Floats
    force_at_detection_N: Floats
    force_at_end_N: Floats
    max_force_N: Floats
    max_force_axis_N: Floats  # (runs, 3)
    max_compression_m: Floats
    max_deflection_m: Floats  # Schroeder's: distance to the surface, on whichever side of it
    max_deflection_axis_m: Floats  # (runs, 3)
    max_travel_m: Floats  # along the normal, from the start
    contact_start_s: Floats  # interpolated between steps
    contact_end_s: Floats
    residual_at_detection_Nm: Floats  # (runs, joints)
    noise_at_detection_Nm: Floats  # (runs, joints)

    def __len__(self) -> int:
        return len(self.detected)

    @property
    def contact_duration_s(self) -> Floats:
        return self.contact_end_s - self.contact_start_s

    def triggered(self, joint: int) -> npt.NDArray[np.bool_]:
        """Whether a joint was over its threshold at the tick of detection."""
        over: npt.NDArray[np.bool_] = (self.trigger_mask & np.uint32(1 << joint)) != 0
        return over


@dataclass(frozen=True)
class ReferenceTrace:
    """One run, one row per simulation step. `run` is what `simulate` would have said about it."""

    time_s: Floats
    position: Floats  # (steps, joints)
    velocity: Floats  # (steps, joints)
    point_m: Floats  # (steps, 3), the contact point
    travel_m: Floats  # s, along the normal from the start
    force_N: Floats
    contact_torque_Nm: Floats  # (steps, joints), the residual without noise
    residual_Nm: Floats  # (steps, joints), NaN between ticks and where the noise given has ended
    start_point_m: Floats
    normal: Floats
    run: ReferenceRuns
