"""A motion in time: a trajectory is over its limit where the study says so, and a recording without data says that."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop.detection.detection_run import STATES
from bumpstop.model import Robot
from bumpstop.recording import Recording
from bumpstop.study import TrajectorySpeedLimits
from bumpstop.view.document import with_keys
from bumpstop.view.opened import Recorded, open_source
from bumpstop.view.page import playback_panel
from bumpstop.view.page.playback_panel import PlaybackPanel
from bumpstop.view.playback import Playback, recorded_playback, trajectory_playback
from bumpstop.view.study_rows import study_rows
from view.cases import ROOT
from view.panels import Host

PICK_AND_PLACE = bs.load_scenario(ROOT / "examples" / "06_pick_and_place_trajectory.toml")
ARM = Robot.load("ur10e")
ROWS = 50


def recording() -> Recording:
    t = 0.1 * np.arange(ROWS)
    q = np.array([0, -1.2, 1.5, -1.8, -1.5, 0]) + 0.1 * np.sin(t)[:, None]
    return Recording(t=t, q=q, joint_names=tuple(joint.name for joint in ARM.joints), robot="ur10e")


def run_without_data(rows: slice) -> Any:
    """A detector's run whose residual is half its threshold, in one row 0.9 of it, and without data in some rows."""
    residual = np.full((ROWS, ARM.dof), 10.0)
    residual[7, 2] = -18.0
    residual[rows] = np.nan
    notes = ("There was no data.",)
    return SimpleNamespace(
        t=recording().t, residual=residual, threshold=np.full((ROWS, ARM.dof), 20.0), events=(), notes=notes,
        state=np.full(ROWS, STATES.index("monitoring")),
    )  # fmt: skip


def test_a_trajectory_is_over_where_its_study_is() -> None:
    """A collision goes on for a while, in which the trajectory may get faster than is safe where it began."""
    playback = trajectory_playback(PICK_AND_PLACE, lambda: False, lambda _: None)
    rows = study_rows(TrajectorySpeedLimits(scenario=PICK_AND_PLACE), lambda: False)
    assert playback is not None
    assert rows is not None
    over = rows["over"].to_numpy()
    assert (over & (playback.value <= playback.limit)).any()
    said = [playback.words_at(t).rpartition(": ")[2] for t in playback.time]
    assert [words.startswith("over") for words in said] == over.tolist()
    assert set(said) == {"within", "over", "over, a collision that begins here gets faster"}
    assert over[playback.worst]


def test_a_recording_without_data_is_not_within_its_thresholds() -> None:
    playback = recorded_playback(Recorded(recording(), run_without_data(slice(20, 30))), ARM)
    assert playback.words_at(2.55) == "2.550 s: no data"
    assert playback.words_at(0.75) == "0.750 s: largest residual over its threshold 0.9, threshold 1: within"
    assert playback.worst == 7
    assert np.isnan(playback.shown_values).sum() == 10
    # A line before and one after, beside the one of the threshold.
    assert len(re.findall("<polyline", str(playback.chart(0.0)))) == 3


def test_an_alarm_of_the_band_pass_channel_is_told() -> None:
    """Its residual is within its threshold then, and that was all that was said."""
    run = run_without_data(slice(20, 30))
    run.state[5:9] = STATES.index("alarm")
    playback = recorded_playback(Recorded(recording(), run), ARM)
    said = [playback.words_at(t).rpartition(": ")[2] for t in playback.time[[4, 5, 8, 9]]]
    assert said == ["within", "within, an alarm stands", "within, an alarm stands", "within"]


def test_a_run_has_rows_of_its_own() -> None:
    """Fitted dynamics fill gaps of a recording: residuals behind them stood at other times, or beyond the end."""
    whole, run = recording(), run_without_data(slice(20, 30))
    run.residual[40, 2] = -30.0
    playback = recorded_playback(Recorded(whole.rows(np.r_[:15, 35:ROWS]), run), ARM)
    assert playback.worst == 40
    assert playback.words_at(4.05) == "4.050 s: largest residual over its threshold 1.5, threshold 1: over"
    assert playback.words_at(2.55) == "2.550 s: no data"
    np.testing.assert_array_equal(playback.time, whole.t)
    np.testing.assert_allclose(playback.pose_at(4.0), whole.q[40])
    assert playback.places.shape == (ROWS, 3)


@pytest.mark.parametrize("run", [None, run_without_data(slice(None))])
def test_a_recording_without_any_residual_can_be_played(run: Any) -> None:
    playback = recorded_playback(Recorded(recording(), run), ARM)
    assert playback.words_at(1.0) == f"1.000 s: {'no detector given' if run is None else 'no data'}"
    assert playback.worst == 0
    assert len(re.findall("<polyline", str(playback.chart(0.0)))) == 1


def test_a_peak_between_the_rows_that_are_drawn_is_drawn() -> None:
    """Of a collision of some rows in a long recording the chart and the way had nothing, and of many alarms fifty."""
    rows, log = 5000, recording()
    t = 0.004 * np.arange(rows)
    share = np.full((rows, ARM.dof), 0.1)
    share[2503, 1], share[2600:2900] = -7.0, np.nan
    alarms = tuple(SimpleNamespace(t=0.1 * k) for k in range(80))
    run: Any = SimpleNamespace(t=t, residual=share, threshold=np.ones((rows, ARM.dof)), events=alarms, notes=(),
                               state=np.full(rows, STATES.index("monitoring")))  # fmt: skip
    long = replace(log, t=t, q=np.repeat(log.q[:1], rows, axis=0))
    playback = recorded_playback(Recorded(long, run), ARM)
    assert np.nanmax(playback.shown_values) == 7.0
    chart = str(playback.chart(0.0))
    lines = [re.findall(r"[-\d.]+,([-\d.]+)", one) for one in re.findall('<polyline points="([^"]*)"', chart)]
    heights = [float(y) for line in lines[:2] for y in line]
    assert min(heights) < 0.5 * max(heights)
    assert chart.count("<circle") == 80


def test_a_recording_of_other_column_names(tmp_path: Path) -> None:
    log, dof = recording(), 6
    names = [f"a{j}" for j in range(dof)]
    table = pl.DataFrame({"clock": log.t} | dict(zip(names, log.q.T, strict=True)))
    table.write_csv(tmp_path / "log.csv")
    columns = tmp_path / "columns.toml"
    columns.write_text(f'time = {{ column = "clock" }}\nposition = {{ columns = {names}, unit = "rad" }}\n')
    opened = open_source(str(tmp_path / "log.csv"), robot="ur10e", columns=columns)
    assert opened.recorded is not None
    np.testing.assert_allclose(opened.recorded.recording.q, log.q)
    with pytest.raises(bs.InputError, match=r"^--columns: has no meaning without a recording"):
        open_source("ur10e", columns=columns)


def test_a_bag_is_read_as_detect_reads_it(tmp_path: Path) -> None:
    """Of an arm whose driver sorts its joints, or has a gripper beside them, ``view`` opened no bag."""
    log = recording()
    order, names = [2, 1, 0, 3, 4, 5], [joint.name for joint in ARM.joints]
    one = replace(log, q=log.q[:, order], qd=None, tau=None, current=None, joint_names=tuple(names[j] for j in order))
    one.save(tmp_path / "sorted.mcap")
    opened = open_source(str(tmp_path / "sorted.mcap"), robot=ARM.name)
    assert opened.recorded is not None
    np.testing.assert_allclose(opened.recorded.recording.q, log.q)


def test_rows_that_no_arm_has_are_dropped_and_counted(tmp_path: Path) -> None:
    """The page did not say so, as ``detect`` does."""
    log = recording()
    t = 0.01 * np.arange(10 * ROWS)
    q = log.q[0] + 0.1 * np.sin(t)[:, None]
    q[50, 1] += 1.0
    replace(log, t=t, q=q, qd=None, tau=None, current=None).save(tmp_path / "log.parquet")
    opened = open_source(str(tmp_path / "log.parquet"), robot=ARM.name)
    assert opened.recorded is not None
    assert opened.recorded.recording.t.size == len(q) - 1
    assert f"1 of {len(q)} rows dropped while reading." in opened.notes


def test_what_is_unusual_of_a_run_stands_on_its_page(tmp_path: Path) -> None:
    recording().save(tmp_path / "moved.parquet")
    opened = open_source(str(tmp_path / "moved.parquet"), watch=lambda *_: run_without_data(slice(20, 30)))
    assert "There was no data." in opened.notes


@pytest.fixture
def moving() -> Iterator[tuple[Any, PlaybackPanel]]:
    """A page of a trajectory, and its panel, which has not begun to compute."""
    host: Any = Host(PICK_AND_PLACE)
    with pytest.MonkeyPatch.context() as patch:
        # What a thread would compute is computed where a test says so.
        patch.setattr(playback_panel, "LatestWins", lambda *_: Worker())
        panel = PlaybackPanel(host)
    yield host, panel
    panel.close()


class Worker:
    """Takes requests, and leaves them."""

    alive = False

    def __init__(self) -> None:
        self.submitted: list[bs.Scenario] = []

    def submit(self, scenario: bs.Scenario) -> None:
        self.submitted.append(scenario)

    def close(self) -> None: ...

    def has_newer(self) -> bool:
        return False


def played(
    monkeypatch: pytest.MonkeyPatch, panel: PlaybackPanel, scenario: bs.Scenario, found: Playback | bs.InputError
) -> None:
    """Have a panel compute a motion of which a test knows the outcome."""

    def compute(*_: Any) -> Playback:
        if isinstance(found, bs.InputError):
            raise found
        return found

    monkeypatch.setattr(playback_panel, "trajectory_playback", compute)
    panel._compute(scenario)


def said(panel: PlaybackPanel) -> str:
    return re.sub("<svg.*</svg>|<[^>]+>", "", panel._says.content)


def test_safe_speeds_of_an_earlier_scenario_are_not_shown(
    monkeypatch: pytest.MonkeyPatch, moving: tuple[Any, PlaybackPanel]
) -> None:
    host, panel = moving
    worker: Any = panel._worker
    playback = recorded_playback(Recorded(recording(), run_without_data(slice(20, 30))), ARM)
    played(monkeypatch, panel, PICK_AND_PLACE, playback)
    assert "within" in said(panel)
    assert host.drawn == ["/way"]
    panel._press("Play")
    other = with_keys(PICK_AND_PLACE, {"contact.area_cm2": 3.0})
    panel.expire(other)
    assert (said(panel), host.drawn) == ("computing ...", [])
    panel._show()
    panel._press("Worst")
    assert said(panel) == "computing ..."
    # What was computed for the scenario before comes too late.
    played(monkeypatch, panel, PICK_AND_PLACE, playback)
    assert (said(panel), host.drawn) == ("computing ...", [])
    panel.follow(other)
    assert worker.submitted == [PICK_AND_PLACE, other]
    played(monkeypatch, panel, other, bs.InputError("contact.body", "has no limit"))
    panel._show()
    assert said(panel) == "contact.body: has no limit"
    # There and back again, before anything was asked for.
    panel.expire(PICK_AND_PLACE)
    panel.expire(other)
    panel.follow(other)
    panel.follow(other)
    assert worker.submitted == [PICK_AND_PLACE, other, other]
    # Whatever happened while it played, it can be played again.
    played(monkeypatch, panel, other, playback)
    assert "within" in said(panel)
    assert panel._player.is_alive()


def test_safe_speeds_are_applied_to_what_they_are_of(
    monkeypatch: pytest.MonkeyPatch, moving: tuple[Any, PlaybackPanel]
) -> None:
    """The scenario may be another one when they are found."""
    host, panel = moving

    def slow(*_: Any) -> Any:
        if meanwhile:
            host.document = host.document.edit(meanwhile)
        return SimpleNamespace(changes={"motion.file": "slowed.csv"}, before_s=3.0, after_s=3.5, file="slowed.csv")

    monkeypatch.setattr(playback_panel, "retimed_scenario", slow)
    meanwhile = {"contact.area_cm2": 3.0}
    panel._slow_down()
    assert host.document.scenario.motion.file == PICK_AND_PLACE.motion.file
    assert "The scenario was changed meanwhile: press again." in panel._times.content
    panel.follow(host.document.scenario)
    assert panel._times.content == ""
    meanwhile = {}
    panel._slow_down()
    assert host.document.scenario.motion.file == "slowed.csv"
    # What it cost stands there as long as the slowed trajectory is on screen.
    panel.follow(host.document.scenario)
    assert "3.5 s at safe speeds" in panel._times.content
    panel.follow(host.document.undo().scenario)
    assert panel._times.content == ""


def test_an_arm_that_is_moved_leaves_its_recording(monkeypatch: pytest.MonkeyPatch) -> None:
    """The picture kept the recording's pose, and scenario and verdict were of another."""
    opened = open_source("ur10e")
    host: Any = Host(opened.scenario)
    host.opened.recorded = Recorded(recording(), run_without_data(slice(20, 30)))
    monkeypatch.setattr(playback_panel, "LatestWins", lambda *_: Worker())
    panel = PlaybackPanel(host)
    panel._compute(opened.scenario)
    panel._time.value = 0.75
    panel._show()
    assert panel.pose == pytest.approx(recording().q[7], abs=0.01)
    pose = panel.pose
    # What does not move the arm leaves it there.
    other = with_keys(opened.scenario, {"contact.area_cm2": 3.0})
    panel.expire(other)
    assert panel.pose is pose
    key = "pose_deg" if other.pose_deg is not None else "pose_rad"
    values = list(getattr(other, key))
    panel.expire(with_keys(other, {key: [values[0] + 0.1, *values[1:]]}))
    assert panel.pose is None
    assert said(panel) == "The arm is where the scenario has it; move the time to see where it was."
    panel._show()
    assert panel.pose is not None
    panel.close()
