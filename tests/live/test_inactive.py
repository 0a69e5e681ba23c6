"""A monitor that could have found nothing says so, and is no quiet arm."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from bumpstop.detection import Detector, DetectorSettings, Thresholds, save_detector
from bumpstop.errors import InputError
from bumpstop.live import JointSample
from bumpstop.live.loaded_detector import LoadedDetector
from bumpstop.live.monitor import Monitor
from detection.moving_arms import UR5E
from live.cases import DT, FILLING, Heard, N, ScriptedSource, at, loaded, motion, samples

NONE = np.full(N, math.inf)
SETTINGS = DetectorSettings(period_s=DT, window_s=0.02)


def test_a_detector_that_monitors_no_joint_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "none.detector"
    save_detector(Detector(UR5E, None, NONE, SETTINGS), path)
    with pytest.raises(InputError, match=r"--detector: .*none.detector.: .*infinite: no joint is monitored"):
        LoadedDetector.load(path)


def test_thresholds_of_the_band_pass_channel_alone_monitor(tmp_path: Path) -> None:
    fast = NONE.copy()
    fast[1] = 5.0
    save_detector(Detector(UR5E, None, Thresholds(NONE, fast=fast), SETTINGS), tmp_path / "fast.detector")
    detector = LoadedDetector.load(tmp_path / "fast.detector")
    assert detector.monitored == (False, True, False, False, False, False)
    script = samples(motion(300, push_Nm=25.0, at=150, until=200))
    summary = Monitor(detector, ScriptedSource(script)).run()
    assert (summary.status, summary.judged) == (3, 300 - FILLING)


def test_arming_is_not_judging(tmp_path: Path) -> None:
    """As `detect` has it: a push while the detector arms is counted as masked, and nothing was monitored."""
    log = motion(300, push_Nm=25.0, at=150, until=200)
    run = Detector(UR5E, None, np.full(N, 10.0), DetectorSettings(period_s=DT, window_s=0.02, arming_delay_s=60.0))
    assert run.run(log).inactive
    heard = Heard()
    detector = loaded(tmp_path, arming_delay_s=60.0)
    summary = Monitor(detector, ScriptedSource(samples(log)), [heard]).run()
    assert {tick.state for tick in heard.ticks} == {"no_data", "arming"}
    assert (summary.status, summary.judged, summary.arming) == (4, 0, 300 - FILLING)
    assert summary.masked_while_arming == int(run.run(log).masked_while_arming.sum()) > 0
    assert not summary.active_at_end
    assert summary.lines()[-1] == "NOT MONITORED: in every sample with data the detector was arming"
    # Armed for the second half: those samples are judged.
    later = Monitor(loaded(tmp_path, arming_delay_s=0.6), ScriptedSource(samples(motion(300)))).run()
    assert later.judged + later.arming == 300 - FILLING
    assert 100 < later.judged < 200
    assert (later.status, later.active_at_end) == (0, True)


def test_a_joint_that_is_not_monitored_needs_no_signal(tmp_path: Path) -> None:
    """NaN there is judged, and no damage; NaN of its position, or of a joint beside it, is."""
    thresholds = np.full(N, 10.0)
    thresholds[5] = math.inf
    save_detector(Detector(UR5E, None, thresholds, SETTINGS), tmp_path / "five.detector")
    detector, rows = LoadedDetector.load(tmp_path / "five.detector"), samples(motion(200))

    def torn(sample: JointSample, joint: int, field: str) -> JointSample:
        values = getattr(sample, field).copy()
        values[joint] = math.nan
        return at(sample, **{field: values})

    whole = Monitor(detector, ScriptedSource([torn(row, 5, "torque_Nm") for row in rows])).run()
    assert (whole.found, whole.judged) == ({}, 200 - FILLING)
    for joint, field in ((4, "torque_Nm"), (5, "position_rad")):
        script = [*rows[:100], torn(rows[100], joint, field), *rows[101:]]
        found = Monitor(detector, ScriptedSource(script)).run()
        assert (found.found, found.no_data["not_finite"]) == ({"damaged": 1}, 1)
