"""The window of the derivatives is a time: noise and delay do not depend on the rate."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bumpstop import _native
from bumpstop.detection import Detector, DetectorSettings, describe_detector, residual_record
from bumpstop.recording import Recording
from detection.moving_arms import UR5E, live, moving

ENCODER = 2 * math.pi / 2**17


def noise(rate_hz: float, **settings: float) -> float:
    """Spread of the residual that encoders of 17 bit leave of a smooth motion [Nm], of the worst joint."""
    t, q, _, _, tau = moving(UR5E, round(6 * rate_hz), 1 / rate_hz, pace=0.3)
    exact = residual_record(Recording(t=t, q=q, tau=live(tau)), UR5E, None, settings=DetectorSettings(**settings))  # type: ignore[arg-type]
    coarse = np.round(q / ENCODER) * ENCODER
    found = residual_record(Recording(t=t, q=coarse, tau=live(tau)), UR5E, None, settings=DetectorSettings(**settings))  # type: ignore[arg-type]
    return float((found.rows - exact.rows).std(axis=0).max())


def test_a_faster_loop_is_no_noisier() -> None:
    slow, fast, faster = noise(250), noise(1000), noise(4000)
    assert fast < 0.3
    assert faster < fast < slow < 0.6
    # Eight samples at 1 kHz, as the window was: a hundred times as much.
    assert noise(1000, window_s=0.007) > 50 * fast


@pytest.mark.parametrize("rate_hz", [30, 125, 250, 500, 1000, 4000])
def test_samples_of_the_window_are_those_of_the_time(rate_hz: int) -> None:
    period = 1 / rate_hz
    t, q, _, _, tau = moving(UR5E, 800, period, pace=0.1)
    run = Detector(UR5E, None, [1e3] * 6).run_rows(t, q, tau)
    samples = run.settings["window_samples"]
    assert run.no_data_rows() == {"filling": samples - 1}
    assert samples == max(3, 1 + math.floor(0.07 * rate_hz + 0.45))
    assert DetectorSettings().window_samples(period) == samples
    # Nor does a clock that is off by a thousandth change it.
    assert {DetectorSettings().window_samples(period * share) for share in (0.999, 1.001)} == {samples}


def test_windows_that_do_not_fit_are_noted() -> None:
    t, q, _, _, tau = moving(UR5E, 700, 1e-4, pace=0.1)
    run = Detector(UR5E, None, [1e3] * 6).run_rows(t, q, tau)
    assert run.settings["window_samples"] == _native.window_samples(0.07, 1e-4, 2) == 512
    assert "The window is 512 samples, 0.0511 s, at a row every 0.0001 s: not 0.07 s." in run.notes
    t, q, _, _, tau = moving(UR5E, 60, 0.2, pace=0.1)
    run = Detector(UR5E, None, [1e3] * 6).run_rows(t, q, tau)
    assert "The window is 3 samples, 0.4 s, at a row every 0.2 s: not 0.07 s." in run.notes
    t, q, _, _, tau = moving(UR5E, 60, 0.004, pace=0.1)
    assert not [note for note in Detector(UR5E, None, [1e3] * 6).run_rows(t, q, tau).notes if "window" in note]


def test_the_written_detector_has_the_time(tmp_path: Path) -> None:
    made = Detector(UR5E, None, [9.0] * 6, DetectorSettings(period_s=0.001, window_s=0.05))
    assert "\nwindow 0.05\n" in describe_detector(made)
