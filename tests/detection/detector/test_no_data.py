"""The detector without valid samples, and parts that do not belong together."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection import Detector, DetectorSettings, Thresholds
from bumpstop.detection.detection_run import FAULTS
from bumpstop.joint import JointTorqueModel
from bumpstop.model import Robot
from bumpstop.recording import Recording
from detection.moving_arms import DT, FILLING, UR5E, moving

SIA5D = Robot.load("sia5d")


@pytest.mark.parametrize(
    ("fault", "spoil"),
    [
        ("not_finite", lambda t, q, tau: q.__setitem__((100, 2), np.nan)),
        ("not_finite", lambda t, q, tau: tau.__setitem__((100, 2), np.inf)),
        ("not_finite", lambda t, q, tau: t.__setitem__(100, np.nan)),
        ("repeated", lambda t, q, tau: t.__setitem__(100, t[99])),
        ("out_of_order", lambda t, q, tau: t.__setitem__(100, t[90])),
        ("outside_limits", lambda t, q, tau: q.__setitem__((100, 1), 7.0)),
        ("impossible_jump", lambda t, q, tau: q.__setitem__((100, 1), q[100, 1] + 0.5)),
        ("impossible_signal", lambda t, q, tau: tau.__setitem__((100, 1), 501.0)),
        ("gap", lambda t, q, tau: t.__setitem__(slice(100, None), t[100:] + 1)),
    ],
)
def test_a_bad_sample_is_told_and_makes_no_spike(fault: str, spoil: object) -> None:
    t, q, _, _, tau = moving(UR5E, 300)
    clean = Detector(UR5E, None, [100.0] * 6).run_rows(t, q, tau)
    spoil(t, q, tau)  # type: ignore[operator]
    given_settings = DetectorSettings(largest_signal=(500.0,) * 6)
    run = Detector(UR5E, None, [100.0] * 6, given_settings).run_rows(t, q, tau)
    assert FAULTS[run.fault[100]] == fault
    assert run.no_data[100]
    assert run.stop[100]
    assert np.isnan(run.residual[100]).all()
    lost = FILLING if fault == "gap" else 1
    assert run.no_data[FILLING:].sum() == lost
    assert not run.no_data[100 + lost :].any()
    # One sample less in the window: off by what a sample of delay makes of the motion.
    worst = np.nanmax(np.abs(run.residual[100 + FILLING + 1 :] - clean.residual[100 + FILLING + 1 :]))
    assert worst < 1e-6
    assert run.events == ()
    assert np.nanmax(np.abs(run.residual[101 : 101 + FILLING] - clean.residual[101 : 101 + FILLING]), initial=0) < 3


@pytest.mark.parametrize("first", [0, 150])
def test_a_rate_that_no_joint_has_is_not_believed_at_a_beginning_either(first: int) -> None:
    """The row a recording begins with, and that behind a gap: no position before it says how far the joint went."""
    t, q, qd, _, tau = moving(UR5E, 300)
    t[150:] += 1.0
    given_settings = DetectorSettings(measured_rates=True)
    clean = Detector(UR5E, None, [30.0] * 6, given_settings).run_rows(t, q, tau, qd=qd)
    assert clean.events == ()
    qd[first, 1] = 50.0
    run = Detector(UR5E, None, [30.0] * 6, given_settings).run_rows(t, q, tau, qd=qd)
    assert FAULTS[run.fault[first]] == "impossible_jump"
    assert run.events == ()
    # The row after it is the first that counts.
    assert run.no_data.sum() == clean.no_data.sum() + 1


def test_rows_without_a_time_of_their_own_leave_the_others_theirs() -> None:
    """How long it had no data is a number, and one that JSON has, whatever times rows came with."""
    t, q, _, _, tau = moving(UR5E, 300)
    clean = Detector(UR5E, None, [50.0] * 6).run_rows(t, q, tau)
    spoilt = t.copy()
    spoilt[[0, 100, 150, 200, 299]] = math.nan, math.nan, math.inf, t[20], -math.inf
    run = Detector(UR5E, None, [50.0] * 6).run_rows(spoilt, q, tau)
    assert run.no_data[[100, 150, 200]].all()
    # The first time is that of the second row; the intervals that end in judged rows count whole.
    assert run.no_data_s == pytest.approx(clean.no_data_s)
    found = json.loads(json.dumps(run.to_json(), allow_nan=False))
    assert (found["start_s"], found["end_s"]) == (t[1], t[298])
    assert all(t[1] <= a <= b <= t[298] for a, b in found["no_data"])


def test_grace_delays_the_request_to_stop() -> None:
    t, q, _, _, tau = moving(UR5E, 200)
    tau[100:110] = np.nan
    run = Detector(UR5E, None, [100.0] * 6, DetectorSettings(max_no_data_s=3.5 * DT)).run_rows(t, q, tau)
    assert run.no_data[100:110].all()
    assert not run.stop[100:103].any()
    assert run.stop[103:110].all()
    assert not run.stop[110 + FILLING :].any()


def test_parts_of_different_arms_are_refused() -> None:
    model = JointTorqueModel.load("sia5d")
    with pytest.raises(bs.InputError, match="is for a joint 'joint_s', which ur5e has not"):
        Detector(UR5E, model, [10.0] * 6)
    with pytest.raises(bs.InputError, match="has no joint 'joint_t', which is monitored"):
        Detector(SIA5D, model, [10.0] * 7)
    with pytest.raises(bs.InputError, match="thresholds: 5 of them; the robot has 6 joints"):
        Detector(UR5E, None, [10.0] * 5)
    t, q, _, _, tau = moving(UR5E, 200)
    detector = Detector(SIA5D, model, [10.0] * 6 + [math.inf])
    with pytest.raises(bs.InputError, match="has no current"):
        detector.run(Recording(t=t, q=np.zeros((200, 7)), tau=np.zeros((200, 7))))
    with pytest.raises(bs.InputError, match="has 6 joints; sia5d has 7"):
        detector.run(Recording(t=t, q=q, tau=tau))
    with pytest.raises(bs.InputError, match="t: has no rows"):
        Detector(UR5E, None, [10.0] * 6).run_rows([], np.zeros((0, 6)), np.zeros((0, 6)))
    with pytest.raises(bs.InputError, match="direction: has length 2; wanted a unit vector"):
        Detector(UR5E, None, [10.0] * 6).smallest_force(q[0], (0.0, 0.0, 2.0))
    with pytest.raises(bs.InputError, match=r"q: .*\(6,\)"):
        Detector(UR5E, None, [10.0] * 6).smallest_force(q[:2], (0.0, 0.0, 1.0))
    for made in (
        Detector(UR5E, None, [10.0] * 6, DetectorSettings(period_s=0.004)),
        Detector(UR5E, None, Thresholds(np.full(6, 10.0), period_s=0.004)),
    ):
        with pytest.raises(bs.InputError, match=r"has a row every 0\.002 s"):
            made.run(Recording(t=t, q=q, tau=tau))
    # Joints count from 1, and have their names where the robot is known.
    with pytest.raises(bs.InputError, match=r"thresholds_Nm\[2\]: is 0; wanted"):
        Thresholds(np.array([1.0, 0.0]))
    with pytest.raises(bs.InputError, match=r"per_speed_Nm_s\[1\]: is nan"):
        Thresholds(np.array([1.0, 2.0]), speed=np.array([math.nan, 0.0]))
    with pytest.raises(bs.InputError, match=r"thresholds_Nm\[3\]: is 0 for elbow_joint; wanted"):
        Detector(UR5E, None, [10.0, 10.0, 0.0, 10.0, 10.0, 10.0])
    with pytest.raises(bs.InputError, match=r"thresholds_Nm\[1\]: is -3 for shoulder_pan_joint"):
        Thresholds.parse("-3,2", [joint.name for joint in UR5E.joints])
    with pytest.raises(bs.InputError, match="'direkt' is no kind of residual; did you mean 'direct'"):
        DetectorSettings(residual="direkt")  # type: ignore[arg-type]
    for window in (math.nan, math.inf, 0.0, -0.07, 11.0, "0.07", True):
        with pytest.raises(bs.InputError, match=r"^window_s: "):
            DetectorSettings(window_s=window)  # type: ignore[arg-type]
    for period in (-0.004, math.nan, math.inf):
        with pytest.raises(bs.InputError, match=r"^period_s: is "):
            Detector(UR5E, None, [10.0] * 6).kernel(period)


def test_threshold_files(tmp_path: Path) -> None:
    made = Thresholds(np.array([1.0, math.inf]), speed=np.array([0.5, 0]), model_errors=2.0, period_s=0.004)
    path = tmp_path / "limits.toml"
    made.save(path)
    again = Thresholds.parse(str(path))
    for name in ("constant", "speed", "acceleration", "rest", "fast", "model_errors", "period_s"):
        np.testing.assert_array_equal(getattr(again, name), getattr(made, name))
    np.testing.assert_array_equal(Thresholds.parse("1,2.5,inf").constant, [1, 2.5, math.inf])
    path.write_bytes(b"\xef\xbb\xbf" + path.read_bytes())
    np.testing.assert_array_equal(Thresholds.load(path).constant, made.constant)
    for text, message in (
        ("thresholds_Nm = [1, -1]", r"thresholds_Nm\[2\]: is -1"),
        ("thresholds_Nm = 3", "wanted a list"),
        ("threshold = [1]", "has no key 'thresholds_Nm'"),
        ("thresholds_Nm = [1]\nfast = [1]", "'fast' is no key; did you mean 'fast_Nm'"),
        ("thresholds_Nm = [", "is not valid TOML"),
    ):
        path.write_text(text, encoding="utf-8")
        with pytest.raises(bs.InputError, match=message):
            Thresholds.load(path)
    with pytest.raises(bs.InputError, match="cannot be read"):
        Thresholds.parse("1,2,x")
