"""``bumpstop score`` of recordings in which the detector had no data, and of clocks that count from long ago."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop.detection import load_labels, score
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from cli.support import run, strict_json
from detection.moving_arms import UR5E

ARM = ("--robot", "ur5e", "--thresholds", "20,20,20,9,9,9")


def pushed(path: Path, no_data_until_s: float = 0.0, start_s: float = 0.0) -> Path:
    """Two seconds with a push from 1.5 s on; before, the elbow may be beyond its limits: no data there."""
    t = 0.004 * np.arange(501)
    q = 0.2 + 0.3 * t[:, None] * np.ones(6)
    tau = inverse_dynamics(UR5E, q, np.full_like(q, 0.3), 0 * q)
    tau[375:400, 1] += 30
    q[t < no_data_until_s, 2] += 10
    Recording(t=start_s + t, q=q, tau=tau).save(path)
    return path


def scored(tmp_path: Path, *given: object) -> dict[str, Any]:
    labels = tmp_path / "labels.csv"
    labels.write_text("start_s,end_s\n0.4,0.6\n1.5,1.6\n")
    done = run("score", *given, "--labels", labels, "--json")
    found = strict_json(done.out)
    assert done.status == (0 if found["active"] else 3), done.err
    return found


@pytest.mark.parametrize(("no_data_until_s", "missed"), [(0.0, 1), (1.0, 1), (2.5, 2), (1.999, 2)])
def test_a_recording_scores_as_its_events_do_also_where_the_detector_had_no_data(
    no_data_until_s: float, missed: int, tmp_path: Path
) -> None:
    log, events = pushed(tmp_path / "log.parquet", no_data_until_s), tmp_path / "events.json"
    events.write_text(run("detect", log, *ARM, "--json").out)
    found, wanted = scored(tmp_path, log, *ARM), scored(tmp_path, events)
    assert (found["missed"], found["missed_without_data"]) == (missed, missed if no_data_until_s else 0)
    counted = set(wanted) - {"notes"}
    assert {key: found[key] for key in counted} == {key: wanted[key] for key in counted}
    if no_data_until_s < 1.5:
        (here,) = (row for row in found["roc"] if row["factor"] == 1)
        assert {key: here[key] for key in ("detected", "missed", "false_alarms_per_hour")} == {
            key: found[key] for key in ("detected", "missed", "false_alarms_per_hour")
        }
    else:
        assert "roc" not in found
        (note,) = (note for note in found["notes"] if "Other thresholds" in note)
        # A single last row where the elbow is elsewhere is garbage, and is dropped.
        rows = 501 if no_data_until_s > 2 else 500
        assert f"no data in {rows} of {rows} rows" in note
        assert any("elbow_joint: at 10.2, beyond its limits" in note for note in found["notes"])


def test_no_event_is_false_while_the_detector_arms(tmp_path: Path) -> None:
    log, events = pushed(tmp_path / "log.parquet"), tmp_path / "events.json"
    given = ("--arming-delay", "0.5")
    events.write_text(run("detect", log, *ARM, *given, "--json").out)
    assert strict_json(events.read_text())["arming_s"] == pytest.approx(0.5, abs=0.02)
    found, wanted, always = (scored(tmp_path, *each) for each in ((log, *ARM, *given), (events,), (log, *ARM)))
    assert found["hours"] == wanted["hours"]
    # Up to the first label and its tolerance, but for the first rows, which have no rates yet.
    assert 3600 * (always["hours"] - found["hours"]) == pytest.approx(0.35 - always["no_data_s"], abs=0.02)
    (here,) = (row for row in found["roc"] if row["factor"] == 1)
    assert here["false_alarms_per_hour"] == found["false_alarms_per_hour"]


def test_a_score_shows_itself_as_the_terminal_does(tmp_path: Path) -> None:
    log, labels, events = pushed(tmp_path / "log.parquet"), tmp_path / "labels.csv", tmp_path / "events.json"
    labels.write_text("start_s,end_s\n0.4,0.6\n1.5,1.6\n")
    events.write_text(run("detect", log, *ARM, "--json").out)
    found = score([1.5], load_labels(labels), (0.0, 2.0))
    assert "detected 1 of 2; missed 1" in str(found)
    assert "  missed: 0.4 to 0.6 s" in str(found)
    done = run("score", events, "--labels", labels)
    assert str(found).splitlines()[0] == done.out.splitlines()[0]


def test_times_of_a_clock_that_counts_from_long_ago_are_told_to_their_digits(tmp_path: Path) -> None:
    start_s = 1_700_000_000.0
    log, labels, out = pushed(tmp_path / "log.parquet", start_s=start_s), tmp_path / "labels.csv", tmp_path / "out"
    labels.write_text("start_s,end_s\n1700000000.4,1700000000.6\n")
    done = run("score", log, *ARM, "--labels", labels, "--out", out)
    assert "false alarm at 1700000001.5 s\n" in done.out
    assert "missed: 1700000000.4 to 1700000000.6 s\n" in done.out
    assert "1700000000.4 s" in (out / "report.html").read_text()
    labels.write_text("start_s,end_s\n1700000000.4,1700000000.6\n1700000000.5,1700000000.7\n")
    refused = run("score", log, *ARM, "--labels", labels)
    assert "the contact at 1700000000.5 s begins before that at 1700000000.4 s ends" in refused.err


def test_forces_of_a_sensor_at_detection(tmp_path: Path) -> None:
    """A sensor with an offset shows a contact that grows by 100 N a second; the joint's threshold is passed halfway."""
    t = 0.004 * np.arange(1001)
    q = 0.2 + 0.1 * t[:, None] * np.ones(6)
    tau = inverse_dynamics(UR5E, q, np.full_like(q, 0.1), 0 * q)
    wrench = np.tile([1.0, -2.0, 12.0, 0, 0, 0], (t.size, 1))
    for begin, grows in ((1.5, 80.0), (3.0, 20.0)):
        rows = (t >= begin) & (t < begin + 0.5)
        tau[rows, 1] += grows * (t[rows] - begin)
        wrench[rows, 2] += 100.0 * (t[rows] - begin)
    log, labels, out = tmp_path / "log.parquet", tmp_path / "labels.csv", tmp_path / "out"
    Recording(t=t, q=q, tau=tau, wrench=wrench).save(log)
    labels.write_text("start_s,end_s\n1.5,2.0\n3.0,3.5\n")
    done = run("score", log, *ARM, "--labels", labels, "--json", "--out", out)
    assert done.status == 0, done.err
    forces = strict_json(done.out)["forces"]
    # 20 Nm are there after a quarter of a second: 25 N.
    assert forces["at_detection_N"]["p50"] == pytest.approx(25.0, abs=1.0)
    assert forces["contacts"][0]["largest_N"] == pytest.approx(49.6, abs=0.5)
    assert forces["contacts"][1]["at_detection_N"] is None
    assert forces["largest_missed_N"] == pytest.approx(49.6, abs=0.5)
    told = run("score", log, *ARM, "--labels", labels).out
    assert "force at detection, N: mean 25" in told
    assert "largest force of a missed contact: 49.6 N" in told
    assert "force at detection, N" in (out / "report.html").read_text()
    Recording(t=t, q=q, tau=tau).save(log)
    assert "forces" not in strict_json(run("score", log, *ARM, "--labels", labels, "--json").out)


def test_an_inactive_detector_is_said_before_anything_else(tmp_path: Path) -> None:
    log, labels, events = pushed(tmp_path / "log.parquet", 2.5), tmp_path / "labels.csv", tmp_path / "events.json"
    labels.write_text("start_s,end_s\n1.5,1.6\n")
    events.write_text(run("detect", log, *ARM, "--json").out)
    for given in ((log, *ARM, "--out", tmp_path / "page"), (events,)):
        status, said, _ = run("score", *given, "--labels", labels)
        assert status == 3
        assert said.startswith("INACTIVE all the time (")
        assert "detected 0 of 1" in said
    page = (tmp_path / "page" / "report.html").read_text()
    assert "detector inactive: 0 of 1 contacts detected" in page
    assert page.index("INACTIVE all the time") < page.index("0 detected, 1 missed")
    watching = pushed(tmp_path / "seen.parquet")
    active = run("score", watching, *ARM, "--labels", labels)
    assert (active.status, "INACTIVE" in active.out) == (0, False)


@pytest.mark.parametrize(
    ("times", "active"),
    [
        ({"no_data": [[0, 9]]}, False),
        ({"no_data": [[-1, 4], [3, 10]]}, False),
        ({"no_data": [[0, 4]], "arming": [[4, 9]]}, False),
        ({"no_data": [[0, 4], [5, 9]]}, True),
        ({"no_data": []}, True),
    ],
)
def test_events_without_data_all_the_time_are_no_clean_score(
    tmp_path: Path, times: dict[str, list[list[float]]], active: bool
) -> None:
    labels, events = tmp_path / "labels.csv", tmp_path / "events.json"
    labels.write_text("start_s,end_s\n1.5,1.6\n")
    events.write_text(json.dumps({"events": [], "start_s": 0, "end_s": 9, **times}))
    told = run("score", events, "--labels", labels)
    assert told.status == (0 if active else 3)
    assert told.out.startswith("INACTIVE all the time (as the file of events says)") is not active
    assert strict_json(run("score", events, "--labels", labels, "--json").out)["active"] is active


def test_thresholds_that_monitor_no_joint_are_no_clean_score(tmp_path: Path) -> None:
    """As detect has it: no false alarm means nothing then, of events, residuals or a recording."""
    log, labels, events = pushed(tmp_path / "log.parquet"), tmp_path / "labels.csv", tmp_path / "events.json"
    labels.write_text("start_s,end_s\n1.5,1.6\n")
    unmonitored = ("--thresholds", "inf,inf,inf,inf,inf,inf")
    detected = run("detect", log, *ARM[:2], *unmonitored, "--json", "--out", tmp_path)
    events.write_text(detected.out)
    assert (detected.status, strict_json(detected.out)["active"]) == (3, False)
    residuals = tmp_path / "residuals.parquet"
    for given in ((events,), (residuals, *unmonitored), (log, *ARM[:2], *unmonitored)):
        told = run("score", *given, "--labels", labels)
        assert told.status == 3, given
        assert told.out.startswith("INACTIVE all the time ("), given
        assert strict_json(run("score", *given, "--labels", labels, "--json").out)["active"] is False
    told = run("score", residuals, "--thresholds", "20,inf,inf,inf,inf,inf", "--labels", labels, "--json")
    assert (told.status, strict_json(told.out)["active"]) == (0, True)


def test_the_page_has_the_settings_in_full(tmp_path: Path) -> None:
    log, labels = pushed(tmp_path / "log.parquet"), tmp_path / "labels.csv"
    labels.write_text("start_s,end_s\n1.5,1.6\n")
    done = run("score", log, *ARM, "--late", 0.4, "--window", 0.05, "--labels", labels, "--out", tmp_path / "page")
    assert done.status == 0, done.err
    page = (tmp_path / "page" / "report.html").read_text()
    for said in ("late, s", ">0.4<", "window_s", ">0.05<", "observer_gain_1_s", "20,20,20,9,9,9", "Made by"):
        assert said in page, said
    assert "Detections</h2>" in page
    # Settings read as in a file, not as in Python.
    for said in (">not given<", ">false<", ">[0, 0, -1]<"):
        assert said in page, said
    assert ">None<" not in page
    assert "DetectedCollisions" not in page
    # One push of a little more than the thresholds: found at them and at half of them, which share a label.
    drawn = (tmp_path / "page" / "roc.svg").read_text()
    assert ">Detections against false alarms<" in drawn
    assert re.findall(r">(x [^<]*)<", drawn) == ["x 0.5, x 1", "x 2"]


def test_residuals_alone_say_what_of_the_thresholds_they_leave_out(tmp_path: Path) -> None:
    """They hold no motion and no band-passed channel, so only what is constant can be compared."""
    log = pushed(tmp_path / "log.parquet")
    assert run("detect", log, *ARM, "--out", tmp_path).status == 0
    files = {}
    for name, more in (("constant", ""), ("whole", f"per_speed_Nm_s = {[90] * 6}\nfast_Nm = {[5] * 6}\n")):
        files[name] = tmp_path / f"{name}.toml"
        files[name].write_text(f"thresholds_Nm = [20, 20, 20, 9, 9, 9]\n{more}")
    residuals = (tmp_path / "residuals.parquet", "--thresholds")
    constant, whole = (scored(tmp_path, *residuals, files[name]) for name in ("constant", "whole"))
    assert constant["notes"] == []
    (note,) = whole.pop("notes")
    assert "left out: speed, fast." in note
    assert whole == {key: value for key, value in constant.items() if key != "notes"}
    recorded = scored(tmp_path, log, "--robot", "ur5e", "--thresholds", files["whole"])
    assert recorded["detected"] != constant["detected"] or recorded["events"] != constant["events"]
