"""Recordings as sources: what their reading leaves out is told, and counted."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
from rosbags.rosbag2 import StoragePlugin

from bumpstop.live.monitor import Monitor, MonitorSettings
from bumpstop.live.sources.names import SourceOptions, source_of
from bumpstop.live.summary import MonitorSummary
from cli.support import run
from live.cases import DT, NAMES, Heard, detector_file, loaded, motion
from recording.test_bags import bag, state


def played(folder: Path, path: Path) -> tuple[MonitorSummary, Heard]:
    detector, heard = loaded(folder), Heard()
    with source_of(str(path), detector, SourceOptions(speed=math.inf)) as source:
        return Monitor(detector, source, [heard], MonitorSettings(speed=math.inf)).run(), heard


def test_messages_of_other_joints_are_told(tmp_path: Path) -> None:
    """A driver that begins again with a prefix before its names; a contact may be there."""
    names = list(NAMES)
    bodies = [state(DT * i, names if i < 100 else [f"arm_{name}" for name in names]) for i in range(300)]
    summary, heard = played(tmp_path, bag(tmp_path, StoragePlugin.MCAP, {"/s": bodies}))
    assert summary.found == {"foreign": 200}
    assert heard.events[0].text == "a message of the file has other joints, of 300 in all"
    assert any(line == "source: foreign 200" for line in summary.lines())


def test_bad_rows_are_told_however_many(tmp_path: Path) -> None:
    """Its own MCAP of a stream with NaN, or with times that came twice or went back, can be played."""
    log = motion(500)
    assert log.tau is not None
    log.tau[100:120, 2] = np.nan
    log.t[200:230] = log.t[199]
    log.t[300:305] = log.t[250]
    log.save(tmp_path / "log.parquet")
    summary, heard = played(tmp_path, tmp_path / "log.parquet")
    assert summary.found["damaged"] == 20
    assert sum(summary.found.get(kind, 0) for kind in ("repeated", "went_back")) == 35
    assert summary.samples == 445
    assert "a row of the file is left out, not a number, of 500 in all" in [event.text for event in heard.events]


def test_a_recording_of_another_arm_with_the_same_joints_is_told(tmp_path: Path) -> None:
    """`detect` says so; the monitor found collisions in it without a word."""
    log, detector = motion(100), detector_file(tmp_path)
    for name, told in (("ur10e", True), ("ur5e", False), ("", False)):
        replace(log, robot=name).save(tmp_path / "log.parquet")
        result = run("monitor", tmp_path / "log.parquet", "--detector", detector, "--speed", "max")
        said = f"note: The file names robot {name!r}, and is read as a recording of 'ur5e': is it the right robot?"
        assert (said in result.err) == told, result.err
