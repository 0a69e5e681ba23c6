"""Channels that die for a while, or were never alive; samples that are held, and coarse ones, are alive."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bumpstop.recording import Recording
from cli.support import run
from recording.test_plausibility import read, sound


def notes(current: np.ndarray, folder: Path) -> tuple[str, ...]:
    return read(sound(), folder, None, current=current).report.notes


def currents() -> np.ndarray:
    log = sound()
    assert log.current is not None
    return log.current.copy()


@pytest.mark.parametrize("rows", [15, 125, 1000])
def test_a_channel_that_stands_still_for_a_while_is_told(rows: int, tmp_path: Path) -> None:
    current = currents()
    current[700 : 700 + rows, 2] = current[700, 2]
    (note,) = notes(current, tmp_path)
    assert "The current of joint 3 stands at" in note
    assert "nothing was measured there" in note
    begin = float(note.split(" from ")[1].split(" to ")[0])
    end = float(note.split(" to ")[1].split(" s ")[0])
    assert begin == pytest.approx(700 / 125, abs=0.02)
    assert end == pytest.approx((699 + rows) / 125, abs=0.02)


def test_every_time_it_does_so_counts(tmp_path: Path) -> None:
    current = currents()
    for first, joint in ((300, 1), (900, 1), (900, 4)):
        current[first : first + 125, joint] = current[first, joint]
    told = notes(current, tmp_path)
    assert len(told) == 2
    assert "joint 2 stands" in told[0]
    assert "(2 times in all)" in told[0]
    assert "joint 5 stands" in told[1]


def test_a_channel_that_was_never_alive_is_told(tmp_path: Path) -> None:
    current = currents()
    current[:, [1, 3]] = 0.0
    assert notes(current, tmp_path) == ("The current of joint 2, joint 4 is constant while the joint moves.",)


@pytest.mark.parametrize("every", [1, 5, 20])
@pytest.mark.parametrize("step", [0.0, 0.01, 0.1, 1.0])
def test_held_samples_and_coarse_values_are_not_told(every: int, step: float, tmp_path: Path) -> None:
    current = currents()[np.arange(2000) // every * every]
    if step:
        current = np.round(current / step) * step
    assert notes(current, tmp_path) == ()


def test_what_rests_is_not_told(tmp_path: Path) -> None:
    """Without noise a joint at rest has one current all the time."""
    log = sound()
    current, q = currents(), log.q.copy()
    current[500:900], q[500:900] = current[500], q[500]
    current[1200:], q[1200:] = current[1200], q[1200]
    assert read(log, tmp_path, q=q, qd=None, current=current).report.notes == ()


@pytest.mark.parametrize("noise", [0.0, 0.02])
def test_coarse_currents_of_slow_motions_are_not_told(noise: float, tmp_path: Path) -> None:
    """Fast strokes, and a slow one whose current, mostly friction, stays the same for seconds."""
    rng = np.random.default_rng(5)
    t = np.arange(3000) / 125
    rate = np.where((t > 10) & (t < 18), 0.05, 1.5 * np.sin(4 * t))[:, None] * np.array([1.0, 0.8])
    q = np.cumsum(rate, axis=0) / 125
    current = np.round((np.sign(rate) + 0.5 * rate + noise * rng.normal(size=q.shape)) / 0.1) * 0.1
    path = tmp_path / "slow.parquet"
    Recording(t=t, q=q, current=current).save(path)
    assert Recording.load(path).report.notes == ()


def test_a_dead_channel_is_told_by_every_command(tmp_path: Path) -> None:
    torque = currents()
    torque[700:825, 2] = torque[700, 2]
    read(sound(), tmp_path, current=None, qd=None, tau=torque)
    (tmp_path / "labels.csv").write_text("start_s,end_s\n2,3\n", encoding="utf-8")
    file, arm, limits = tmp_path / "run.csv", ("--robot", "ur5e"), ("--thresholds", "400,400,400,400,400,400")
    for command in (
        ("recording", "info", file, *arm),
        ("detect", file, *arm, *limits),
        ("score", file, "--labels", tmp_path / "labels.csv", *arm, *limits),
        ("tune", file, *arm),
    ):
        assert "The torque of elbow_joint stands at" in " ".join(run(*command).out.split())
