"""The monitor judges as the detector does, and names whatever is wrong with the stream of samples."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from bumpstop.detection import Detector, DetectorSettings, Thresholds, save_detector
from bumpstop.detection.detection_run import STATES
from bumpstop.errors import InputError
from bumpstop.live import JointSample, MonitorTick, SourceEvent, SourceEventKind
from bumpstop.live.loaded_detector import LoadedDetector
from bumpstop.live.monitor import Monitor, MonitorSettings
from bumpstop.live.sources.names import SourceOptions, source_of
from bumpstop.live.summary import MonitorSummary
from bumpstop.live.unit_check import UnitCheck
from bumpstop.live.view import alarm_line
from bumpstop.recording import Recording
from detection.moving_arms import UR5E
from live.cases import DT, FILLING, NAMES, THRESHOLD_NM, Heard, N, ScriptedSource, at, loaded, motion, samples

K = SourceEventKind


def watch(
    folder: Path, script: list[JointSample | SourceEvent | None], settings: MonitorSettings | None = None
) -> tuple[MonitorSummary, Heard]:
    heard = Heard()
    made = Monitor(loaded(folder), ScriptedSource(script), [heard], settings or MonitorSettings(stop_after_s=0.1))
    return made.run(), heard


def test_it_says_what_the_detector_says_over_the_recording(tmp_path: Path) -> None:
    """Residuals, states and events of a run over the same rows, to the last digit, with an alarm that ends."""
    log = motion(500, push_Nm=25.0, at=250, until=300)
    settings = DetectorSettings(period_s=DT, window_s=0.02)
    run = Detector(UR5E, None, np.full(N, THRESHOLD_NM), settings).run(log)
    summary, heard = watch(tmp_path, list(samples(log)))
    np.testing.assert_array_equal(heard.residual(), run.residual)
    assert [tick.state for tick in heard.ticks] == [STATES[state] for state in run.state]
    assert "alarm" in {tick.state for tick in heard.ticks}
    assert [alarm.event.t for alarm in heard.alarms] == [event.t for event in run.events]
    assert heard.alarms[0].event.joints == (1,)
    np.testing.assert_array_equal(heard.alarms[0].event.force, run.events[0].force)
    assert (summary.alarms, summary.judged, summary.status) == (1, 500 - FILLING, 3)
    assert summary.found == {}


def test_an_alarm_that_stands_for_good_is_the_only_one(tmp_path: Path) -> None:
    log, again = motion(600, push_Nm=25.0, at=250, until=300), motion(600, push_Nm=25.0, at=400, until=450)
    assert log.tau is not None
    assert again.tau is not None
    log.tau[400:450] = again.tau[400:450]
    settings = DetectorSettings(period_s=DT, window_s=0.02)
    run = Detector(UR5E, None, np.full(N, THRESHOLD_NM), settings).run(log, rearm_s=math.inf)
    assert len(run.events) == 1
    for rearm_s, alarms in ((math.inf, 1), (0.5, 2)):
        summary, heard = watch(tmp_path, list(samples(log)), MonitorSettings(rearm_s=rearm_s))
        assert (summary.alarms, heard.alarms[0].event.t) == (alarms, run.events[0].t)


def test_the_largest_share_is_of_the_whole_threshold(tmp_path: Path) -> None:
    thresholds = Thresholds(np.full(N, THRESHOLD_NM), speed=np.full(N, 50.0))
    settings = DetectorSettings(period_s=DT, window_s=0.02)
    save_detector(Detector(UR5E, None, thresholds, settings), tmp_path / "fast.detector")
    heard = Heard()
    script = samples(motion(300, push_Nm=25.0, at=150, until=200))
    summary = Monitor(LoadedDetector.load(tmp_path / "fast.detector"), ScriptedSource(script), [heard]).run()
    limit = np.array([tick.threshold for tick in heard.ticks])[FILLING:]
    assert limit.max() > 1.5 * THRESHOLD_NM
    np.testing.assert_array_equal(summary.largest_share, (np.abs(heard.residual()[FILLING:]) / limit).max(axis=0))


LAST = UR5E.joints[-1].link


@pytest.mark.parametrize(
    ("link", "point", "named"),
    [
        (None, (0.0, 0.0, 0.0), UR5E.tip_name),
        (UR5E.tip_name, (0.0, 0.0, 0.0), UR5E.tip_name),
        (None, (0.0, 0.0, 0.1), f"point {' '.join(f'{x:g}' for x in UR5E.frame(None, (0, 0, 0.1))[1])} m of {LAST}"),
        ("forearm_link", (0.0, 0.0, 0.0), "forearm_link"),
        ("forearm_link", (0.0, -0.02, 0.05), "point 0 -0.02 0.05 m of forearm_link"),
        (LAST, (0.01, 0.0, 0.0), f"point 0.01 0 0 m of {LAST}"),
    ],
)
def test_an_alarm_names_the_place_of_its_force_as_the_detector_does(
    tmp_path: Path, link: str | None, point: tuple[float, float, float], named: str
) -> None:
    log = motion(300, push_Nm=25.0, at=150, until=200)
    settings = DetectorSettings(period_s=DT, window_s=0.02, link=link, point=point)
    run = Detector(UR5E, None, np.full(N, THRESHOLD_NM), settings).run(log)
    detector, heard = loaded(tmp_path, link=link, point=point), Heard()
    Monitor(detector, ScriptedSource(samples(log)), [heard]).run()
    place = run.force_at.partition(" along")[0]
    assert place == f"at {named}"
    assert f" N {place} along 0 0 -1" in alarm_line(heard.alarms[0], detector)


def test_joints_are_chosen_from_a_bag_by_name(tmp_path: Path) -> None:
    log = motion(300, push_Nm=25.0, at=150, until=200)
    assert log.tau is not None
    # A gripper's finger, and the arm's joints backwards.
    q, tau = (np.insert(values[:, ::-1], 0, 0.1, axis=1) for values in (log.q, log.tau))
    replace(log, q=q, qd=None, tau=tau, joint_names=("finger", *NAMES[::-1])).save(tmp_path / "hand.mcap")
    heard = Heard()
    with source_of(str(tmp_path / "hand.mcap"), loaded(tmp_path), SourceOptions(speed=math.inf)) as source:
        Monitor(loaded(tmp_path), source, [heard], MonitorSettings(speed=math.inf)).run()
    np.testing.assert_array_equal(heard.ticks[200].sample.position_rad, log.q[200])
    assert [alarm.event.joints for alarm in heard.alarms] == [(1,)]
    replace(log, joint_names=("finger", *NAMES[1:])).save(tmp_path / "other.mcap")
    with pytest.raises(InputError, match="no joint is called 'shoulder_pan_joint'"):
        source_of(str(tmp_path / "other.mcap"), loaded(tmp_path))


def test_names_of_a_column_file_say_which_joint_is_which(tmp_path: Path) -> None:
    """As for `detect`: of a bag they are the names in the robot's order, of other files names for the columns."""
    log, crossed = motion(50), (NAMES[1], NAMES[0], *NAMES[2:])
    log.save(tmp_path / "log.mcap")
    replace(log, joint_names=crossed).save(tmp_path / "log.parquet")
    own = ['time = { column = "t" }']
    for quantity, stem in (("position", "q"), ("torque", "tau")):
        own.append(f"{quantity} = {{ columns = [{', '.join(repr(f'{stem}_{j + 1}') for j in range(N))}] }}")
    names = f"joint_names = {list(crossed)}"
    files = {"bag.toml": [names], "own.toml": own, "names.toml": [*own, names]}
    for name, lines in files.items():
        (tmp_path / name).write_text("\n".join(lines))
    for recording, columns in (("log.mcap", "bag.toml"), ("log.parquet", "own.toml"), ("log.parquet", "names.toml")):
        read = Recording.load(tmp_path / recording, robot=UR5E, columns=tmp_path / columns)
        options = SourceOptions(speed=math.inf, columns=tmp_path / columns)
        with source_of(str(tmp_path / recording), loaded(tmp_path), options) as source:
            sample = source.read(0.0)
        assert isinstance(sample, JointSample)
        np.testing.assert_array_equal(sample.position_rad, read.q[0])
        np.testing.assert_array_equal(sample.position_rad, log.q[0, [1, 0, *range(2, N)]])
    replace(log, joint_names=tuple(f"panda_{name}" for name in NAMES)).save(tmp_path / "panda.parquet")
    with pytest.raises(InputError, match="has a joint 'panda_shoulder_pan_joint'"):
        source_of(str(tmp_path / "panda.parquet"), loaded(tmp_path), SourceOptions(columns=tmp_path / "own.toml"))


def nan(s: list[JointSample]) -> list[JointSample]:
    return [*s[:200], at(s[200], torque_Nm=np.full(N, math.nan)), *s[201:]]


def later(s: list[JointSample], by: float) -> list[JointSample]:
    return [at(one, stamp_s=one.stamp_s + by) for one in s]


def faster(s: list[JointSample], first: int, last: int) -> list[JointSample]:
    """The same motion every millisecond."""
    t = np.array([one.stamp_s for one in s])
    columns = [np.array([getattr(one, name) for one in s]) for name in ("position_rad", "torque_Nm")]
    fine = np.arange(t[first], t[last] - 1e-9, 1e-3)
    q, tau = (CubicSpline(t, column)(fine) for column in columns)
    return [at(s[0], stamp_s=float(fine[i]), position_rad=q[i], torque_Nm=tau[i]) for i in range(fine.size)]


Change = Callable[[list[JointSample]], list[JointSample | SourceEvent | None]]
FAULTS: dict[str, tuple[Change, dict[K, int], int]] = {
    # what becomes of the samples; what is found; samples without data beyond those at the beginning, at least
    "repeated": (lambda s: [*s[:200], s[199], *s[200:]], {K.REPEATED: 1}, 1),
    "older": (lambda s: [*s[:200], s[150], *s[200:]], {K.WENT_BACK: 1}, 1),
    "damaged": (nan, {K.DAMAGED: 1, K.LOST: 0}, 1),
    "no time": (lambda s: [*s[:200], at(s[200], stamp_s=math.nan), *s[200:]], {K.DAMAGED: 1}, 1),
    "five lost": (lambda s: [*s[:200], *s[206:]], {K.LOST: 6}, FILLING),
    "counted": (
        lambda s: [at(one, sequence=i) for i, one in enumerate(s) if i not in (200, 201)],
        {K.LOST: 2},
        0,
    ),
    # A count that jumps, or stands, says nothing: the times do.
    "counted from elsewhere": (
        lambda s: [at(one, sequence=i + 1001 * (i > 205)) for i, one in enumerate(s) if not 200 <= i <= 205],
        {K.LOST: 6},
        FILLING,
    ),
    "not counted up": (
        lambda s: [at(one, sequence=0) for i, one in enumerate(s) if i not in (200, 201)],
        {K.LOST: 2},
        0,
    ),
    "counts again": (
        lambda s: [*[at(one, sequence=i + 5000) for i, one in enumerate(s[:200])],
                   *[at(one, sequence=i) for i, one in enumerate(s[200:])]],
        {K.RESTARTED: 1},
        FILLING,
    ),
    "clock begins again": (lambda s: [*later(s[:200], 50.0), *s[200:]], {K.RESTARTED: 1}, FILLING),
    # A detector that is given a time long ahead behind the first of the two has no data until that time has come.
    "clock begins twice": (
        lambda s: [*later(s[:199], 100.0), at(s[199], stamp_s=s[199].stamp_s + 50.0), *s[200:]],
        {K.RESTARTED: 2},
        FILLING,
    ),
    "clock a little back": (lambda s: [*later(s[:200], 0.5), *s[200:]], {K.WENT_BACK: 9, K.RESTARTED: 1}, FILLING + 9),
    "clock jumps ahead": (lambda s: [*s[:200], *later(s[200:], 3600.0)], {K.JUMPED_AHEAD: 1}, FILLING),
    "another arm": (
        lambda s: [*s[:200], at(s[200], position_rad=np.zeros(7)), *s[200:]],
        {K.FOREIGN: 1},
        1,
    ),
    "other signal": (
        lambda s: [*s[:200], at(s[200], torque_Nm=None, current_A=np.ones(N)), *s[200:]],
        {K.FOREIGN: 1},
        1,
    ),
    "flood": (lambda s: [*s[:200], *faster(s, 200, 260), *s[260:]], {K.FLOODED: 240}, 231),
    # Half of them, each told as one that lacks its neighbour.
    "half the rate": (lambda s: s[::2], {K.LOST: 249, K.WRONG_RATE: 1}, 0),
    "source says so": (
        lambda s: [*s[:200], SourceEvent(K.RESTARTED, "connected again"), *s[200:]],
        {K.RESTARTED: 1},
        FILLING,
    ),
    "silence": (lambda s: [*s[:200], None, None, None, *later(s[200:], 0.1)], {K.STOPPED: 1}, FILLING),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_what_is_wrong_with_the_stream_is_named(tmp_path: Path, name: str) -> None:
    """Each fault is found and told; the arm is not watched meanwhile, and is again afterwards."""
    change, wanted, without = FAULTS[name]
    log = motion(500)
    script = change(samples(log))
    summary, heard = watch(tmp_path, script)
    for kind, count in wanted.items():
        found = summary.found.get(str(kind), 0)
        assert found == count, (name, summary.found)
    # A busy machine may hold the monitor itself up.
    others = {"lagging"} | ({"lost"} if "again" in name else set())
    assert set(summary.found) <= {str(kind) for kind in wanted} | others
    told = {kind for kind, count in wanted.items() if count}
    assert told <= set(heard.kinds())
    missing = sum(summary.no_data.values()) + summary.dropped
    assert missing >= FILLING + without
    assert summary.judged + missing == summary.samples == sum(isinstance(one, JointSample) for one in script)
    # No fault of the stream looks like a collision, and the arm is watched again at the end.
    assert summary.alarms == 0
    assert summary.active_at_end
    assert heard.ticks[-1].state == "monitoring"
    for tick in heard.ticks:
        assert np.isnan(tick.residual).all() == (tick.state == "no_data")
        assert tick.stop == (tick.state in ("no_data", "alarm"))


def test_a_source_that_never_gives_a_sample_is_no_quiet_arm(tmp_path: Path) -> None:
    summary, heard = watch(tmp_path, [None, None, None, None])
    assert heard.kinds()[0] is K.STOPPED
    assert (summary.status, summary.active_at_end, summary.judged) == (4, False, 0)
    assert summary.lines()[-1].startswith("NOT MONITORED")


@pytest.mark.parametrize("first", ["source", "monitor"])
def test_one_silence_is_one(tmp_path: Path, first: str) -> None:
    """The source may say that its connection ended before the monitor misses samples, or long after."""
    log = samples(motion(300))
    gone, silence = SourceEvent(K.STOPPED, "the connection ended"), [None, None, None]
    between = [gone, *silence] if first == "source" else [*silence, gone]
    again = [SourceEvent(K.RESTARTED, "connected again"), *later(log[200:], 0.15)]
    summary, heard = watch(tmp_path, [*log[:200], *between, *again])
    assert summary.found == {"stopped": 1, "restarted": 1}
    assert summary.silent_s > 0.1
    assert heard.kinds().count(K.STARTED) == 2
    assert summary.active_at_end


def test_outputs_know_that_a_monitor_has_ended(tmp_path: Path) -> None:
    """Its last state is none of later, whoever ends it; the summary says what it was."""
    script = [*samples(motion(100)), None, None, None, None]
    summary, heard = watch(tmp_path, script, MonitorSettings(stop_after_s=5.0, duration_s=0.15))
    assert [(loss.state, loss.fault, loss.stop) for loss in heard.losses] == [("no_data", "ended", True)]
    assert summary.active_at_end


def test_outputs_know_the_end_whatever_ends_the_monitor(tmp_path: Path) -> None:
    class Broken(Heard):
        def tick(self, tick: MonitorTick) -> None:
            raise RuntimeError("broken")

    heard = Heard()
    monitor = Monitor(loaded(tmp_path), ScriptedSource(samples(motion(50))), [heard, Broken()])
    with pytest.raises(RuntimeError, match="broken"):
        monitor.run()
    assert [loss.fault for loss in heard.losses] == ["ended"]


def test_a_source_of_another_rate_is_refused(tmp_path: Path) -> None:
    """As `bumpstop detect` refuses a recording, wherever the rate is known before samples come."""
    log = motion(300)
    assert log.tau is not None
    half = replace(log, t=log.t[::2], q=log.q[::2], qd=None, tau=log.tau[::2])
    half.save(tmp_path / "half.parquet")
    made_for = "the detector is made for one every 0.004 s"
    with pytest.raises(InputError, match=rf"SOURCE: '.*half.parquet' gives a sample every 0.008 s; {made_for}"):
        source_of(str(tmp_path / "half.parquet"), loaded(tmp_path))
    for frequency, period in ((125, 0.008), (500, 0.002)):
        with pytest.raises(InputError, match=rf"gives a sample every {period} s; {made_for}"):
            source_of(f"rtde://10.0.0.2?frequency={frequency}", loaded(tmp_path))
    assert source_of("rtde://10.0.0.2?frequency=260", loaded(tmp_path)).name == "rtde://10.0.0.2:30004"
    fast = Detector(UR5E, None, np.full(N, THRESHOLD_NM), DetectorSettings(period_s=0.001, window_s=0.02))
    save_detector(fast, tmp_path / "fast.detector")
    with pytest.raises(InputError, match=r"gives a sample every 0.002 s; the detector is made for one every 0.001 s"):
        source_of("rtde://10.0.0.2", LoadedDetector.load(tmp_path / "fast.detector"))


def test_currents_for_torques_are_recognised(tmp_path: Path) -> None:
    """The signal follows the prediction at a tenth of its size; the right one says nothing."""
    log = motion(1200)
    assert log.tau is not None
    right, _ = watch(tmp_path, list(samples(log)))
    assert "wrong_unit" not in right.found
    wrong = [at(one, torque_Nm=0.1 * log.tau[i]) for i, one in enumerate(samples(log))]
    summary, heard = watch(tmp_path, list(wrong))
    assert summary.found["wrong_unit"] == 1
    text = next(event.text for event in heard.events if event.kind is K.WRONG_UNIT)
    assert "shoulder_lift" in text
    assert "0.1" in text


def test_any_stream_is_judged_told_or_dropped(tmp_path: Path) -> None:
    """Random damage of every kind, 25 streams: no exception, every sample is counted once, every loss of data told."""
    draw = np.random.default_rng(5)
    log = motion(300)
    base = samples(log)
    assert log.tau is not None
    for _ in range(25):
        script: list[JointSample | SourceEvent | None] = []
        shift = 0.0
        for i, one in enumerate(base):
            kind = draw.integers(0, 60)
            sample = at(one, stamp_s=one.stamp_s + shift, sequence=None if draw.random() < 0.5 else i)
            if kind == 0:
                continue
            if kind == 1:
                shift += float(draw.choice([-200.0, -0.3, -0.01, 0.3, 1e5, 1e17]))
            elif kind == 2:
                sample = at(sample, stamp_s=float(draw.choice([math.nan, math.inf, -math.inf, -1e300, 1e300])))
            elif kind == 3:
                bad = sample.position_rad.copy()
                bad[draw.integers(N)] = draw.choice([math.nan, math.inf, 1e308, -1e308])
                sample = at(sample, position_rad=bad)
            elif kind == 4:
                sample = at(sample, torque_Nm=draw.choice([1e308, -1e308, math.nan]) * np.ones(N))
            elif kind == 5:
                sample = at(sample, position_rad=np.zeros(int(draw.integers(0, 9))))
            elif kind == 6:
                sample = at(sample, torque_Nm=None)
            elif kind == 7:
                sample = at(sample, sequence=int(draw.integers(-(2**62), 2**62)))
            elif kind == 8:
                script += [sample] * int(draw.integers(1, 30))
            elif kind == 9:
                script.append(SourceEvent(K(draw.choice([K.RESTARTED, K.DAMAGED, K.STOPPED])), "says the source", 3))
            script.append(sample)
        summary, heard = watch(
            tmp_path, script, MonitorSettings(stop_after_s=100.0, speed=float(draw.choice([1.0, math.inf])))
        )
        count = sum(isinstance(one, JointSample) for one in script)
        assert summary.samples == count == len(heard.ticks)
        assert summary.judged + sum(summary.no_data.values()) + summary.dropped == count
        states = [tick.state for tick in heard.ticks]
        # Data are lost only where something was found or the detector says its fault.
        for before, after, tick in zip(states, states[1:], heard.ticks[1:], strict=False):
            if before != "no_data" and after == "no_data":
                assert tick.fault != "none"
        for a, b in itertools.pairwise(heard.ticks):
            assert (a.state == "no_data") == bool(np.isnan(a.residual).any())
            assert b.stop or b.state in ("monitoring", "arming")


def test_torques_for_currents_are_recognised_where_residuals_stay_high(tmp_path: Path) -> None:
    """Of currents no prediction is known: two joints beyond five thresholds for two seconds are told, once."""
    check = UnitCheck(replace(loaded(tmp_path), takes_current=True))
    quiet, high, one = np.zeros(N), np.zeros(N), np.zeros(N)
    high[[1, 2]], one[1] = 6 * THRESHOLD_NM, 60 * THRESHOLD_NM

    def told(residual: np.ndarray, begin: float) -> list[str]:
        found = [check.look(begin + DT * i, np.ones(N), residual) for i in range(1200)]
        return [text for text in found if text]

    assert told(quiet, 0.0) == []
    assert told(one, 10.0) == []
    (text,) = told(high, 20.0)
    assert "shoulder_lift_joint, elbow_joint" in text
    assert told(quiet, 30.0) == []
    assert len(told(high, 40.0)) == 1
