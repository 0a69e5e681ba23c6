"""The band-pass channel of residuals: what the detector's band-pass makes of them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.detection.settings import DetectorSettings

if TYPE_CHECKING:
    from bumpstop.detection.tuning.residual_file import ResidualSeries

_ANY = 1e300  # a threshold that nothing reaches: the channel is computed where some joint has one


def band_pass_channel(series: ResidualSeries, settings: DetectorSettings | None = None) -> FloatArray:
    """(N, dof) of the band-pass channel, begun anew behind gaps [Nm or N].

    Args:
        series: residuals.
        settings: of the detector, for its band; default: its defaults.
    """
    given = settings or DetectorSettings()
    decision = _native.AlarmSettings()
    law = decision.thresholds
    law.constant = law.rest_speed = law.fast = [_ANY] * _native.max_joints
    decision.low_hz, decision.high_hz = given.low_hz, given.high_hz
    anew = np.zeros(series.t.size)
    anew[[rows.start for rows in series.segments()]] = 1.0
    nothing = np.zeros_like(series.rows)
    fast: FloatArray = _native.run_alarm_logic(decision, series.t, series.rows, nothing, nothing, anew, 0.0)[0]
    return fast
