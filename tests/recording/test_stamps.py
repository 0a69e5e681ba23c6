"""Logs that a PC stamped: read as even at a stated rate, noted, or refused with the option that helps."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.arrays import FloatArray
from bumpstop.detection import Detector, residual_record
from bumpstop.model import Robot
from bumpstop.recording import Recording
from bumpstop.recording.checks.stamps import even_times, mean_period, stamped_by_a_pc
from detection.moving_arms import moving

UR5E = Robot.load("ur5e")
PERIOD = 0.004


def late(t: FloatArray, kind: str, seed: int = 1) -> FloatArray:
    """Stamps of samples at t: some milliseconds later, in bursts, or in whole milliseconds."""
    rng = np.random.default_rng(seed)
    if kind == "jitter":
        return t + rng.gamma(1.0, 0.0012, t.size)
    if kind == "bursts":
        return np.ceil(t / 0.016) * 0.016 + 1e-5 * (np.arange(t.size) % 5)
    return np.floor(1e3 * (t + rng.gamma(1.0, 0.002, t.size))) / 1e3


@pytest.mark.parametrize("kind", ["jitter", "bursts", "milliseconds"])
@pytest.mark.parametrize("lost", [False, True])
def test_even_times_are_those_of_the_samples(kind: str, lost: bool) -> None:
    # Its clock is not the PC's; beside polls at a fourth of its rate it would seem to lose a row whenever they cross.
    drift = 1.0 if kind == "bursts" else 1.0007
    t = 17.0 + PERIOD * drift * np.arange(8000)
    keep = np.ones(t.size, dtype=bool)
    if lost:
        keep[[1000, 2500]] = False
        keep[4000:4300] = False
    found, notes = even_times(late(t, kind)[keep], 250.0)
    shift = found - t[keep]
    # But for a shortest delay that nobody knows, and for rows in bursts in which others were lost.
    off = np.abs(shift - np.median(shift)) > 0.001
    assert off.sum() <= (12 if kind == "bursts" and lost else 0)
    steps = np.diff(found) / PERIOD
    # In bursts what was lost may seem to be so in two parts.
    assert np.count_nonzero(steps > 1.5) in (((3, 4, 5, 6) if kind == "bursts" else (3,)) if lost else (0,))
    assert np.abs(steps[steps < 1.5] - drift).max() < 2e-4
    assert f"{302 if lost else 0} rows were lost" in notes[0]


@pytest.mark.parametrize("seed", range(3))
def test_many_lost_rows_among_jitter_shift_no_others(seed: int) -> None:
    """The lowest stamps to come rise in small steps before a lost row, which together are one period."""
    rng = np.random.default_rng(seed)
    t = PERIOD * np.arange(8000)
    keep = rng.random(t.size) > 0.01
    found, notes = even_times(late(t, "jitter", seed)[keep], 250.0)
    shift = found - t[keep]
    # Rows beside a lost one may be taken for those behind it, where theirs come late.
    assert np.mean(np.abs(shift - np.median(shift)) > 0.5 * PERIOD) < 0.01
    told = re.search(r"(\d+) rows were lost", notes[0])
    assert told is not None
    assert int(told[1]) == pytest.approx(np.count_nonzero(~keep), abs=2)


def test_garbage_stamps_move_no_row() -> None:
    t = PERIOD * np.arange(3000)
    stamps = late(t, "jitter")
    clean, _ = even_times(stamps, 250.0)
    stamps[[5, 700, 701, 2000]] = math.nan, -1e9, math.inf, 1e12
    found, _ = even_times(stamps, 250.0)
    np.testing.assert_allclose(found, clean, atol=1e-4)


def test_rates_that_the_stamps_contradict_are_refused() -> None:
    stamps = late(PERIOD * np.arange(2000), "jitter")
    with pytest.raises(bs.InputError, match=r"rate_hz: is 125; by their stamps the rows came at 250 Hz"):
        even_times(stamps, 125.0)
    for rate in (0.0, -1.0, math.nan, 1e6):
        with pytest.raises(bs.InputError, match="rate_hz: "):
            even_times(stamps, rate)
    assert mean_period(stamps) == pytest.approx(PERIOD, rel=1e-3)


def log(kind: str = "") -> Recording:
    t, q, _, _, tau = moving(UR5E, 4000, PERIOD, pace=0.3)
    tau = tau + 0.2 * np.random.default_rng(2).normal(size=tau.shape)
    if not kind:
        return Recording(t=t, q=q, tau=tau)
    stamps = late(t, kind)
    return Recording(t=np.maximum.accumulate(stamps) + 1e-7 * np.arange(t.size), q=q, tau=tau)


def test_a_stated_rate_leaves_what_the_samples_had(tmp_path: Path) -> None:
    path = tmp_path / "log.parquet"
    log("jitter").save(path)
    spread = [
        residual_record(one, UR5E, None).rows.std(axis=0).max()
        for one in (log(), Recording.load(path, rate_hz=250.0), log("jitter"))
    ]
    assert spread[1] == pytest.approx(spread[0], rel=1e-3)
    assert spread[2] > 3 * spread[0]
    assert "as even, at 250 Hz as stated" in Recording.load(path, rate_hz=250.0).report.notes[-1]


def test_stamps_of_one_millisecond_each_keep_their_rows(tmp_path: Path) -> None:
    """Stamps that are the same are no rows to drop where the rate is known."""
    whole = log()
    stamps = np.floor(1e3 * whole.t / 16) * 16 / 1e3
    path = tmp_path / "log.csv"
    rows = np.column_stack([stamps, whole.q, whole.tau])
    names = ["t", *(f"q_{j}" for j in range(1, 7)), *(f"tau_{j}" for j in range(1, 7))]
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.17g")
    # A clock as coarse as this is named before single rows are, and so is what helps.
    with pytest.raises(bs.InputError, match=r"3000 of 4000 rows have the time of another.*rate_hz"):
        Recording.load(path)
    found = Recording.load(path, rate_hz=250.0)
    assert found.t.size == whole.t.size
    np.testing.assert_allclose(np.diff(found.t), PERIOD, rtol=2e-3)


def test_a_detector_notes_stamps_of_a_pc_or_refuses_them() -> None:
    assert stamped_by_a_pc(log()) == ""
    doubt = stamped_by_a_pc(log("jitter"))
    assert doubt.startswith("Times look stamped by a PC")
    assert "--rate 250" in doubt
    assert doubt in Detector(UR5E, None, [50.0] * 6).run(log("jitter")).notes
    with pytest.raises(bs.InputError, match=r"stamped by a PC\?; state the rate .* --rate 2"):
        Detector(UR5E, None, [50.0] * 6).run(log("bursts"))


@pytest.mark.parametrize("apart", [1e-4, 1e-5])
def test_bursts_are_not_taken_for_another_unit(apart: float, tmp_path: Path) -> None:
    """Five rows at once every 40 ms, as a PC writes them, make speeds of degrees, or of times in seconds."""
    whole = log()
    rows = np.arange(whole.t.size)
    stamps = 0.04 * (rows // 5) + apart * (rows % 5)
    path = tmp_path / "log.csv"
    names = ["t", *(f"q_{j}" for j in range(1, 7))]
    np.savetxt(path, np.column_stack([stamps, 5 * whole.q]), delimiter=",", header=",".join(names), comments="")
    with pytest.raises(bs.InputError, match=r"stamped by a PC\?; state the rate .* --rate 12[45] of tune, detect and"):
        Recording.load(path, robot=UR5E)
    assert Recording.load(path, robot=UR5E, rate_hz=125.0).t.size == rows.size
    assert not any("seconds" in note for note in Recording.load(path).report.notes)
    # Degrees are none at any times.
    np.savetxt(path, np.column_stack([stamps, np.degrees(whole.q)]), delimiter=",", header=",".join(names), comments="")
    with pytest.raises(bs.InputError, match="degrees taken for radians"):
        Recording.load(path, robot=UR5E)


def test_samples_that_are_uneven_themselves_are_left_as_they_are() -> None:
    """Taken when they say: a loop that is late, with rows that are lost."""
    rng = np.random.default_rng(4)
    t = PERIOD * np.arange(4000) + rng.uniform(0, 0.002, 4000)
    t = t[rng.random(t.size) > 0.03]
    angle = 0.3 * t[:, None] + np.arange(6)
    taken = Recording(t=t, q=np.sin(angle), tau=np.zeros((t.size, 6)))
    assert stamped_by_a_pc(taken) == ""
    still = replace(taken, q=np.full((t.size, 6), 0.2))
    assert stamped_by_a_pc(still) == ""


def test_stamps_that_fall_on_one_another_ask_for_the_rate(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    t = np.maximum.accumulate(np.round(PERIOD * np.arange(3000) + rng.uniform(0, 0.006, 3000), 6))
    path = tmp_path / "late.csv"
    rows = np.column_stack([t, np.sin(t)[:, None] * np.ones(6), np.cos(t)[:, None] * np.ones(6)])
    names = [*(f"q_{j}" for j in range(1, 7)), *(f"tau_{j}" for j in range(1, 7))]
    np.savetxt(path, rows, delimiter=",", header=",".join(["t", *names]), comments="")
    told = r"are bad .*doubled time.*--max-bad\); rows sampled evenly .*--rate of tune, detect and score, or"
    with pytest.raises(bs.InputError, match=told):
        Recording.load(path)
    assert Recording.load(path, rate_hz=250.0).t.size == t.size
