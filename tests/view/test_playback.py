"""A motion in time: a trajectory is over its limit where the study says so, and a recording without data says that."""

from __future__ import annotations

import re
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.model import Robot
from bumpstop.recording import Recording
from bumpstop.study import TrajectorySpeedLimits
from bumpstop.view.opened import Recorded, open_source
from bumpstop.view.playback import recorded_playback, trajectory_playback
from bumpstop.view.study_rows import study_rows
from view.cases import ROOT

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
    return SimpleNamespace(residual=residual, threshold=np.full((ROWS, ARM.dof), 20.0), events=(), notes=notes)


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


@pytest.mark.parametrize("run", [None, run_without_data(slice(None))])
def test_a_recording_without_any_residual_can_be_played(run: Any) -> None:
    playback = recorded_playback(Recorded(recording(), run), ARM)
    assert playback.words_at(1.0) == f"1.000 s: {'no detector given' if run is None else 'no data'}"
    assert playback.worst == 0
    assert len(re.findall("<polyline", str(playback.chart(0.0)))) == 1


def test_what_is_unusual_of_a_run_stands_on_its_page(tmp_path: Path) -> None:
    recording().save(tmp_path / "moved.parquet")
    opened = open_source(str(tmp_path / "moved.parquet"), watch=lambda *_: run_without_data(slice(20, 30)))
    assert "There was no data." in opened.notes
