"""What a monitor writes can be read by others, whatever happens to it."""

from __future__ import annotations

import json
import math
import socket
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bumpstop.detection import Detector, DetectorSettings, Thresholds, save_detector
from bumpstop.errors import InputError
from bumpstop.live.loaded_detector import LoadedDetector
from bumpstop.live.monitor import Monitor, MonitorSettings
from bumpstop.live.outputs.command import CollisionCommand
from bumpstop.live.outputs.json_lines import JsonLines
from bumpstop.live.outputs.mcap_recording import McapRecording
from bumpstop.live.outputs.ros_messages import ALARM, RosMessages
from bumpstop.live.summary import MonitorSummary
from bumpstop.live.view import alarm_line
from bumpstop.recording import Recording
from detection.moving_arms import UR5E
from live.cases import DT, NAMES, Heard, ScriptedSource, at, detector_file, loaded, motion, samples

LOG = motion(500, push_Nm=25.0, at=250, until=300)


def monitored(folder: Path, *outputs: object) -> tuple[MonitorSummary, Heard]:
    heard = Heard()
    script = samples(LOG)
    script[100] = at(script[100], torque_Nm=np.full(6, math.nan))
    made = Monitor(loaded(folder), ScriptedSource(script), [*outputs, heard], MonitorSettings())  # type: ignore[list-item]
    made.run()
    for output in outputs:
        output.close()  # type: ignore[attr-defined]
        made.problems += output.problems()  # type: ignore[attr-defined]
    return made.summary(), heard


def test_json_lines_say_states_alarms_and_the_source(tmp_path: Path) -> None:
    path = tmp_path / "watch.jsonl"
    path.write_text('{"kind": "sta')  # of a monitor that was killed
    _, heard = monitored(tmp_path, JsonLines(path, loaded(tmp_path)))
    torn, *rest = path.read_text().splitlines()
    assert torn == '{"kind": "sta'
    lines = [json.loads(line) for line in rest]
    assert (lines[0]["kind"], lines[-1]["kind"]) == ("start", "end")
    states = [line["state"] for line in lines if line["kind"] == "state"]
    assert states == ["no_data", "monitoring", "no_data", "monitoring", "alarm", "monitoring", "no_data"]
    assert [line["event"] for line in lines if line["kind"] == "source"] == ["started", "damaged", "ended"]
    (alarm,) = [line for line in lines if line["kind"] == "alarm"]
    event = heard.alarms[0].event
    assert alarm["joints"] == [NAMES[1]]
    assert alarm["residual_Nm"] == event.residual.tolist()
    assert alarm["force_N"] == pytest.approx(event.force_along)
    assert abs(alarm["time_s"] - time.time()) < 60


def test_a_clock_that_is_set_while_a_monitor_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A machine without a battery begins years ago, until a network tells it the time: alarms kept that for days."""
    from mcap.reader import make_reader

    lines = JsonLines(tmp_path / "watch.jsonl", loaded(tmp_path))
    recording = McapRecording(tmp_path / "watch.mcap", loaded(tmp_path))
    clock = time.time
    monkeypatch.setattr(time, "time", lambda: clock() + 1e8)
    monitored(tmp_path, lines, recording)
    _, *later = [json.loads(line)["time_s"] for line in (tmp_path / "watch.jsonl").read_text().splitlines()]
    assert max(abs(t - time.time()) for t in later) < 60
    with recording.files[0].open("rb") as file:
        times = [message.log_time for _, _, message in make_reader(file).iter_messages()]
    assert max(abs(1e-9 * t - time.time()) for t in times) < 60


def states_in(path: Path) -> list[tuple[str, str, bool]]:
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        of_state = [one for one in reader.connections if one.topic == "/bumpstop/state"]
        read = [reader.deserialize(raw, one.msgtype) for one, _, raw in reader.messages(of_state)]
    return [(one.name, one.fault, one.stop) for one in read]  # type: ignore[attr-defined]


def test_a_silence_is_no_data_in_every_file(tmp_path: Path) -> None:
    """From the silence on, once a second while it lasts, and at the end; not the last word of before."""
    log = samples(motion(300))
    later = [at(one, stamp_s=one.stamp_s + 1.5) for one in log[150:]]
    lines, recording = (
        JsonLines(tmp_path / "a.jsonl", loaded(tmp_path)),
        McapRecording(tmp_path / "a.mcap", loaded(tmp_path)),
    )
    script = [*log[:150], *[None] * 30, *later]
    Monitor(loaded(tmp_path), ScriptedSource(script), [lines, recording], MonitorSettings()).run()
    lines.close()
    recording.close()
    read = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    filling, monitoring = ("no_data", "filling", True), ("monitoring", "none", False)
    stopped, ended = ("no_data", "stopped", True), ("no_data", "ended", True)
    told = {
        kind: [(line["state"], line["fault"], line["stop"]) for line in read if line["kind"] == kind]
        for kind in ("state", "status")
    }
    assert told["state"] == [filling, monitoring, stopped, filling, monitoring, ended]
    assert stopped in told["status"]
    silent = [line for line in read if line.get("fault") == "stopped"]
    assert {line["stamp_s"] for line in silent} == {None}
    assert silent[-1]["residual_Nm"] == [None] * 6
    in_mcap = states_in(recording.files[0])
    assert [one for k, one in enumerate(in_mcap) if not k or one != in_mcap[k - 1]] == told["state"]
    assert in_mcap.count(stopped) > 1


def test_a_sample_without_a_time_does_not_end_the_lines(tmp_path: Path) -> None:
    script = samples(motion(100))
    script[0] = at(script[0], stamp_s=math.nan)
    lines = JsonLines(tmp_path / "a.jsonl", loaded(tmp_path))
    Monitor(loaded(tmp_path), ScriptedSource(script), [lines]).run()
    lines.close()
    read = [json.loads(line) for line in (tmp_path / "a.jsonl").read_text().splitlines()]
    assert read[-1]["kind"] == "end"
    (damaged,) = [line for line in read if line["kind"] == "state" and line["fault"] == "damaged"]
    assert damaged["stamp_s"] is None


def test_mcap_files_open_in_both_readers_with_what_was_judged(tmp_path: Path) -> None:
    from mcap.reader import make_reader
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    output = McapRecording(tmp_path / "watch.mcap", loaded(tmp_path))
    _, heard = monitored(tmp_path, output)
    (path,) = output.files
    assert path.name == "watch_0001.mcap"
    assert sorted(tmp_path.glob("watch*")) == [path]
    with path.open("rb") as file:
        summary = make_reader(file, validate_crcs=True).get_summary()
    assert summary is not None
    assert summary.statistics is not None
    counts = summary.statistics.channel_message_counts
    found = {channel.topic: counts.get(channel.id, 0) for channel in summary.channels.values()}
    assert (found["/joint_states"], found["/bumpstop/residual"], found["/bumpstop/alarm"]) == (500, 500, 1)
    with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
        read: dict[str, list[object]] = {}
        for connection, _, raw in reader.messages():
            read.setdefault(connection.topic, []).append(reader.deserialize(raw, connection.msgtype))
    residual = np.array([message.effort for message in read["/bumpstop/residual"]])  # type: ignore[attr-defined]
    np.testing.assert_array_equal(residual, heard.residual())
    assert read["/bumpstop/residual"][0].name == list(NAMES)  # type: ignore[attr-defined]
    (alarm,) = read["/bumpstop/alarm"]
    assert (alarm.fast_joints, len(alarm.fast), np.isinf(alarm.fast_threshold).all()) == ([], 6, True)
    assert alarm.joints == [NAMES[1]]  # type: ignore[attr-defined]
    np.testing.assert_array_equal(alarm.best_force, heard.alarms[0].event.force)  # type: ignore[attr-defined]
    np.testing.assert_array_equal(alarm.best_force_sd, heard.alarms[0].event.force_sd)  # type: ignore[attr-defined]
    assert [message.name for message in read["/bumpstop/state"]][:2] == ["no_data", "monitoring"]  # type: ignore[attr-defined]
    # The file is a recording again: what was watched can be looked at once more.
    again = Recording.load(path, topic="/joint_states", max_bad=0.1)
    assert again.tau is not None
    assert again.joint_names == NAMES
    np.testing.assert_array_equal(again.tau[:100], LOG.tau[:100])  # type: ignore[index]


def test_files_are_rotated_and_numbered_on(tmp_path: Path) -> None:
    log, names = samples(motion(250)), []
    for _ in range(2):
        output = McapRecording(tmp_path / "watch.mcap", loaded(tmp_path), rotate_s=0.2)
        script = [*log[:50], *[None] * 5, *log[50:], *[None] * 3]
        Monitor(loaded(tmp_path), ScriptedSource(script), [output]).run()
        output.close()
        assert len(output.files) >= 2
        names += [path.name for path in output.files]
    assert names == [f"watch_{number + 1:04d}.mcap" for number in range(len(names))]
    assert sorted(path.name for path in tmp_path.glob("watch*")) == names


def test_a_source_that_cannot_be_opened_leaves_no_recording(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from bumpstop.cli.main import main

    detector = detector_file(tmp_path)
    before = sorted(tmp_path.iterdir())
    with socket.create_server(("127.0.0.1", 0)) as one:
        free = one.getsockname()[1]
    with pytest.raises(SystemExit) as ended:
        main(["monitor", f"rtde://127.0.0.1:{free}", "--detector", str(detector), "--mcap", str(tmp_path / "a.mcap")])
    assert ended.value.code == 2
    assert "Connection refused" in capsys.readouterr().err
    assert sorted(tmp_path.iterdir()) == before


def test_a_command_gets_the_alarm_and_is_ended_in_time(tmp_path: Path) -> None:
    told, late = tmp_path / "told", tmp_path / "late"
    quick = CollisionCommand(f"sh -c 'printenv BUMPSTOP_ALARM > {told}'", loaded(tmp_path))
    slow = CollisionCommand(f"(sleep 0.6; touch {late}) & sleep 9", loaded(tmp_path), timeout_s=0.2, shell=True)
    begin = time.monotonic()
    summary, heard = monitored(tmp_path, quick, slow)
    assert time.monotonic() - begin < 5
    assert summary.problems == ("--on-collision: killed after 0.2 s, alarm 1",)
    alarm = json.loads(told.read_text())
    assert alarm["best_force_N"] == heard.alarms[0].event.force.tolist()
    assert alarm["best_force_sd_N"] == heard.alarms[0].event.force_sd.tolist()
    time.sleep(0.6)
    assert not late.exists(), "what the command had started was not ended with it"


@pytest.mark.parametrize(
    ("words", "why"),
    [
        ("", "--on-collision: is empty"),
        ("no-such-program now", "there is no program 'no-such-program'"),
        ("echo 'half", "No closing quotation"),
    ],
)
def test_a_command_that_cannot_be_is_refused(tmp_path: Path, words: str, why: str) -> None:
    with pytest.raises(InputError, match=why):
        CollisionCommand(words, loaded(tmp_path))


def test_files_that_cannot_be_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"--mcap: is '.*watch.bag'; wanted a name that ends in .mcap"):
        McapRecording(tmp_path / "watch.bag", loaded(tmp_path))
    with pytest.raises(InputError, match=r"--jsonl: '.*' cannot be written \(No such file or directory\)"):
        JsonLines(tmp_path / "nowhere" / "a.jsonl", loaded(tmp_path))
    output = McapRecording(tmp_path / "watch.mcap", loaded(tmp_path))
    with pytest.raises(InputError, match="is being written"):
        McapRecording(tmp_path / "watch.mcap", loaded(tmp_path))
    output.close()


def test_an_alarm_of_the_band_pass_channel_has_its_numbers(tmp_path: Path) -> None:
    """Not those of the residual, which has no threshold here, or one that it does not reach."""
    log = motion(300, push_Nm=25.0, at=150, until=200)
    fast, none = np.full(6, math.inf), np.full(6, math.inf)
    fast[1] = 5.0
    moving = np.full(6, 2.0)
    for name, law, limit in (
        ("alone", Thresholds(none, fast=fast), 5.0),
        ("beside", Thresholds(np.full(6, 1e3), fast=fast), 5.0),
        ("moving", Thresholds(np.full(6, 1e3), fast=fast, speed=moving), None),
        ("unknown", Thresholds(none, fast=fast, speed=moving), math.nan),
    ):
        path = tmp_path / f"{name}.detector"
        save_detector(Detector(UR5E, None, law, DetectorSettings(period_s=DT, window_s=0.02)), path)
        detector, heard = LoadedDetector.load(path), Heard()
        lines = JsonLines(tmp_path / f"{name}.jsonl", detector)
        Monitor(detector, ScriptedSource(samples(log)), [lines, heard]).run()
        lines.close()
        alarm = heard.alarms[0]
        assert (alarm.event.joints, alarm.event.fast_joints) == ((), (1,))
        if limit is None:
            limit = 5.0 + 2.0 * abs(log.qd[round(alarm.stamp_s / DT), 1])  # type: ignore[index]
        assert alarm.fast_threshold[1] == pytest.approx(limit, rel=0.01, nan_ok=True)
        assert abs(alarm.fast[1]) > (5.0 if math.isnan(limit) else limit)
        told = f" of {alarm.fast_threshold[1]:.3g}" if math.isfinite(limit) else ""
        words = f"{NAMES[1]} {alarm.fast[1]:+.3g}{told} Nm in the band-pass channel; "
        assert words in alarm_line(alarm, detector)
        written = [json.loads(line) for line in (tmp_path / f"{name}.jsonl").read_text().splitlines()]
        line = next(line for line in written if line["kind"] == "alarm")
        assert (line["joints"], line["fast_joints"]) == ([NAMES[1]], [NAMES[1]])
        assert line["fast_Nm"] == alarm.fast.tolist()
        of_joint = line["fast_threshold_Nm"][1]
        assert of_joint is None if math.isnan(limit) else of_joint == alarm.fast_threshold[1]


def test_a_force_that_is_not_known_is_null_and_nan(tmp_path: Path) -> None:
    """Where the joints in front of the point say nothing, the kernels give NaN."""
    _, heard = monitored(tmp_path)
    nowhere = np.full(3, math.nan)
    event = replace(heard.alarms[0].event, force_along_sd=math.inf, force=nowhere, force_sd=nowhere, leftover=math.nan)
    alarm = replace(heard.alarms[0], event=event)
    assert event.to_json()["best_force_N"] is None
    assert "not detectable" in event.cells(["Nm"] * 6)
    detector = loaded(tmp_path)
    assert "no joint shows a force along" in alarm_line(alarm, detector)
    lines = JsonLines(tmp_path / "unknown.jsonl", detector)
    lines.alarm(alarm)
    lines.close()
    written = [json.loads(line) for line in (tmp_path / "unknown.jsonl").read_text().splitlines()]
    (told,) = [line for line in written if line["kind"] == "alarm"]
    assert (told["force_N"], told["best_force_N"], told["best_force_sd_N"]) == (None, None, None)
    messages = RosMessages(NAMES)
    read = messages._store.deserialize_cdr(messages.alarm(alarm), ALARM)
    assert np.isnan([*read.best_force, *read.best_force_sd, read.force]).all()


def test_a_payload_that_nobody_declared_is_told(tmp_path: Path) -> None:
    """As `detect` tells it, once; an alarm behind it has the mass that explains it."""
    log = motion(2500)
    assert log.tau is not None
    lever = np.array([UR5E.jacobian(q)[2] for q in log.q])
    loaded_log = replace(log, tau=log.tau + 3.0 * 9.80665 * lever)
    loaded_log.tau[2000:, 1] += 300.0  # type: ignore[index]
    limits = np.full(6, 200.0)
    settings = DetectorSettings(period_s=DT, window_s=0.02, payload_change_kg=1.0)
    made = Detector(UR5E, None, limits, settings)
    run = made.run(loaded_log)
    save_detector(made, tmp_path / "payload.detector")
    detector, heard = LoadedDetector.load(tmp_path / "payload.detector"), Heard()
    lines = JsonLines(tmp_path / "watch.jsonl", detector)
    summary = Monitor(detector, ScriptedSource(samples(loaded_log)), [lines, heard]).run()
    lines.close()
    rises = int(np.count_nonzero(np.diff(run.payload_changed.astype(int)) > 0))
    assert summary.found["payload_changed"] == rises == 1
    told = [event.text for event in heard.events if event.kind == "payload_changed"]
    assert told == ["the residuals look like a payload of +3 kg that nobody declared"]
    written = [json.loads(line) for line in (tmp_path / "watch.jsonl").read_text().splitlines()]
    assert [line["text"] for line in written if line.get("event") == "payload_changed"] == told
    (kilograms,) = [line["payload_change_kg"] for line in written if line["kind"] == "alarm"]
    assert kilograms == run.events[0].payload_change_kg == pytest.approx(3.0, rel=0.01)
    assert f", explained by a payload of {kilograms:+.3g} kg" in alarm_line(heard.alarms[0], detector)


def test_times_before_zero_are_written(tmp_path: Path) -> None:
    """A recording may begin before its time zero; ROS has seconds with a sign."""
    log = motion(250)
    rows = [at(one, stamp_s=one.stamp_s - 0.5) for one in samples(log)]
    output = McapRecording(tmp_path / "watch.mcap", loaded(tmp_path))
    Monitor(loaded(tmp_path), ScriptedSource(rows), [output]).run()
    output.close()
    again = Recording.load(output.files[0], topic="/joint_states")
    np.testing.assert_allclose(again.t, log.t, atol=2e-9)
