"""Thresholds that joints share alike, intervals that hold on other runs, and moments that rule a threshold."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection import ResidualSeries, tune
from bumpstop.detection.band_pass_channel import band_pass_channel
from detection.tuning_cases import achieved, residuals
from detection.tuning_runs import KINDS, runs


def test_joints_of_other_tails_alarm_as_often_as_each_other() -> None:
    """Slow, heavy-tailed and spiky residuals: none takes the alarms of all, and none hides behind its largest one."""
    others = runs(1, 40.0, 999)
    for seed in (2,):
        (one,) = runs(1, 15.0, seed)
        tuning = tune(one, 60.0)
        theta = tuning.thresholds()
        # Equal quantiles: before, one joint's was 0.55 of its largest residual, and another's 1.3 of its.
        of_largest = theta / np.abs(one.rows).max(axis=0)
        assert of_largest.max() / of_largest.min() < 1.75
        alone = [sum(achieved(_only(part, j), theta[[j]], 50) for part in others) * 1.5 for j in range(len(KINDS))]
        # Wanted: ten each. A level off by a tenth is a rate off by a factor of three.
        assert max(alone) <= 45
        assert min(alone) >= 2
        assert sum(alone) <= 120


def test_all_joints_together_alarm_at_the_wanted_rate() -> None:
    """Six joints that are alike share sixty alarms; each alone would be given all of them else."""
    (one,) = runs(1, 30.0, 5, kinds=("normal",) * 6)
    tuning = tune(one, 60.0)
    theta = tuning.thresholds()
    # Joints that have nothing in common need no factor beyond their own shares: with all sixty each it would be 1.13.
    assert tuning.tail.level_of(60.0) == pytest.approx(1.0, abs=0.05)
    others = runs(4, 30.0, 77, kinds=("normal",) * 6)
    both = sum(achieved(part, theta, 20) for part in others) / 2
    assert both == pytest.approx(60, rel=0.35)
    alone = [sum(achieved(_only(part, j), theta[[j]], 20) for part in others) / 2 for j in range(6)]
    assert max(alone) < 25


def _only(series: ResidualSeries, joint: int) -> ResidualSeries:
    return ResidualSeries(series.t, series.rows[:, [joint]])


@pytest.mark.parametrize(("count", "spread"), [(2, 0.04), (4, 0.1)])
def test_intervals_hold_on_runs_of_other_days(count: int, spread: float) -> None:
    """Every run is a few percent louder or quieter as a whole, as on a colder day."""
    above = below = 0
    for seed in range(8):
        several = runs(count + 4, 3.0, 100 * count + seed, spread=spread, kinds=KINDS[:4])
        tuning = tune(several[:count], 60.0)
        low, high = tuning.per_hour_interval()
        theta = tuning.thresholds()
        rate = sum(achieved(part, theta, tuning.cluster_rows) for part in several[count:]) / (4 * 3 / 60)
        above += rate > high
        below += rate < low
        assert low < 60 < high
        assert tuning.to_json()["runs"] == count
    # Of eight with 2.5 % each at either side, two or more once in sixty times.
    assert above <= 1
    assert below <= 1


def test_runs_that_differ_widen_the_interval_and_a_single_one_says_what_it_cannot_know() -> None:
    alike, apart = (runs(6, 4.0, 3, spread=spread) for spread in (0.0, 0.2))
    narrow, wide = tune(alike, 60.0), tune(apart, 60.0)
    assert wide.per_hour_interval()[1] > 2 * narrow.per_hour_interval()[1]
    assert wide.spread.sd == pytest.approx(0.2, rel=0.5)
    assert narrow.spread.sd < 0.06
    assert any("From recording to recording residuals differ by" in note for note in wide.notes)
    assert not any("One recording" in note for note in wide.notes)
    assert any(
        "One recording: the interval holds for more of the same run only" in note for note in tune(alike[0]).notes
    )
    # The ends of the thresholds' interval are as far apart as those of the rate say.
    low, high = wide.thresholds_interval()
    assert (low < wide.thresholds()).all()
    assert (wide.thresholds() < high).all()


def test_one_moment_that_rules_a_threshold_is_told() -> None:
    """An abrupt start: joint, recording, time, and what helps."""
    quiet = runs(1, 4.0, 11, kinds=("normal",) * 3)[0]
    rows = quiet.rows.copy()
    rows[20:40, 1] += 60.0
    other = runs(1, 4.0, 12, kinds=("normal",) * 3)[0]
    jerky = ResidualSeries(quiet.t + 5.0, rows, "jerky.csv")
    tuning = tune([jerky, other], 60.0)
    (note,) = [note for note in tuning.notes if "rule" in note]
    assert "joint 2 has 6" in note
    assert "s of jerky.csv" in note
    assert "after its first row" in note
    assert "--trim-start" in note
    clean = tune([other, ResidualSeries(jerky.t[100:], jerky.rows[100:], "rest")], 60.0)
    assert not any("rule" in note for note in clean.notes)
    assert tuning.thresholds()[1] > 1.25 * clean.thresholds()[1]


def test_ends_of_several_recordings_are_told_together() -> None:
    """Without one of them the others rule as much."""
    several = []
    for number, one in enumerate(runs(3, 3.0, 21, kinds=("normal",) * 3)):
        rows = one.rows.copy()
        rows[-15:, 2] -= 80.0 + 5 * number
        several.append(ResidualSeries(one.t, rows, f"log {number}"))
    notes = [note for note in tune(several, 60.0).notes if "rule" in note]
    (note,) = notes
    assert note.startswith("The ends of recordings rule the thresholds: joint 3 has ")
    assert "--trim-end" in note


def test_the_fast_channel_is_tuned_for_its_share_of_the_alarms() -> None:
    one, *others = runs(4, 15.0, 33, kinds=("normal", "slow", "heavy"))
    tuning = tune(one, 60.0, terms=("fast",))
    law = tuning.all_thresholds()
    assert law.fast is not None
    assert np.isfinite(law.fast).all()
    # A slow error is none of the band-pass channel.
    assert law.fast[1] < 0.5 * law.constant[1]
    slow = sum(achieved(part, law.constant, 50) for part in others) / 0.75
    fast = sum(achieved(ResidualSeries(part.t, band_pass_channel(part)), law.fast, 50) for part in others) / 0.75
    both = sum(
        achieved(
            ResidualSeries(part.t, np.hstack([part.rows, band_pass_channel(part)])),
            np.concatenate([law.constant, law.fast]),
            tuning.cluster_rows,
        )
        for part in others
    )
    low, high = tuning.per_hour_interval()
    assert low <= both / 0.75 <= high
    assert 10 <= slow <= 80
    assert 10 <= fast <= 80
    assert np.isinf(tune(one, 60.0).all_thresholds().fast).all()  # type: ignore[arg-type]


def test_thresholds_grow_with_what_residuals_grow_with() -> None:
    one, others = (_growing(seed) for seed in (1, 2))
    flat, grown = tune(one, 60.0), tune(one, 60.0, terms=("speed", "acceleration"))
    law = grown.all_thresholds()
    assert law.speed is not None
    assert law.acceleration is not None
    # Planted: 1 + 4 |qd| of joint 1, 2 + 0.5 |qdd| of joint 2.
    assert law.speed[0] / law.constant[0] == pytest.approx(4.0, rel=0.25)
    assert law.acceleration[1] / law.constant[1] == pytest.approx(0.25, rel=0.3)
    assert law.speed[1] * 1.5 < 0.2 * law.constant[1]
    # At rest a quarter of the flat threshold will do, at the same rate of alarms.
    assert law.constant[0] < 0.5 * flat.thresholds()[0]
    assert one.qd is not None
    assert others.qd is not None
    assert others.qdd is not None
    theta = law.constant + law.speed * np.abs(others.qd) + law.acceleration * np.abs(others.qdd)
    count = achieved(ResidualSeries(others.t, others.rows / theta), np.ones(2), grown.cluster_rows)
    low, high = grown.per_hour_interval()
    assert low / 2 <= count / 0.5 <= 2 * high
    with pytest.raises(bs.InputError, match="terms: noise 1 does not hold the speed of the joints"):
        tune(residuals(0.02, 1), 60.0, terms=("speed",))
    with pytest.raises(bs.InputError, match="terms: 'fats' is none; did you mean 'fast'"):
        tune(residuals(0.02, 1), 60.0, terms=("fats",))  # type: ignore[arg-type]


def _growing(seed: int) -> ResidualSeries:
    """Half an hour of two joints whose noise grows, one with its speed, one with its acceleration."""
    noise = residuals(0.5, seed, degrees=None, joints=2)
    t = noise.t
    qd = 1.5 * np.stack([np.sin(0.7 * t), np.sin(0.9 * t)], axis=1)
    qdd = np.gradient(qd, t, axis=0) * 4
    sizes = np.stack([1 + 4 * np.abs(qd[:, 0]), 2 + 0.5 * np.abs(qdd[:, 1])], axis=1)
    return ResidualSeries(t, noise.rows * sizes, noise.source, qd, qdd)


def test_a_rate_beyond_the_peaks_is_refused_with_terms_too() -> None:
    with pytest.raises(bs.InputError, match=r"per_hour: .* cannot be tuned for"):
        tune(runs(1, 2.0, 1), 1e6, terms=("fast",))
    assert math.isfinite(tune(runs(1, 2.0, 1), terms=("fast",)).target)


@pytest.mark.parametrize("count", [2, 4, 9])
def test_contacts_in_a_recording_are_told_together(count: int) -> None:
    """Without one of them the others rule as much: two pushes raised a threshold from 7.7 to 47.7 Nm without a word."""
    quiet, free = runs(2, 4.0, 11, kinds=("normal",) * 3)
    rows = quiet.rows.copy()
    starts = np.linspace(3000, 21_000, count).astype(int)
    for number, start in enumerate(starts):
        rows[start : start + 40, 1] += 40.0 + 5 * number
    pushed = ResidualSeries(quiet.t, rows, "pushed.csv")
    for recordings in (pushed, [pushed, free]):
        tuning, clean = tune(recordings, 60.0), tune(quiet, 60.0)
        (note,) = [note for note in tuning.notes if "rule" in note]
        assert note.startswith(f"{count} moments rule the thresholds together: joint 2 has up to")
        assert "contacts" in note
        assert "s of pushed.csv; without them the threshold would be" in note
        listed = note.partition(" at ")[2].partition(" s of")[0].split(", ")
        np.testing.assert_allclose([float(t) for t in listed], (starts + 20) / 100, atol=0.21)
        assert tuning.thresholds()[1] > 2 * clean.thresholds()[1]


@pytest.mark.parametrize("seed", range(6))
def test_no_moments_are_told_of_recordings_without_contacts(seed: int) -> None:
    """Normal, slow, heavy and spiky joints."""
    assert not [note for note in tune(runs(1 + seed % 2, 6.0, 100 + seed)).notes if "together" in note]


def test_notes_of_a_threshold_have_its_unit() -> None:
    """Those of a joint that slides are newtons."""
    quiet = runs(1, 4.0, 11, kinds=("normal",) * 2)[0]
    rows = quiet.rows.copy()
    rows[9000:9020] += 60.0
    for units, unit in (((), "Nm"), (("N", "N"), "N")):
        notes = tune(ResidualSeries(quiet.t, rows, "one.csv"), 60.0, units=units).notes
        (note,) = [note for note in notes if "rule" in note]
        assert re.search(rf" has \d+\.\d {unit} at .* would be \S+ {unit} instead of \S+ {unit}\.", note), note
        biased = tune(ResidualSeries(quiet.t, quiet.rows + 9.0, "biased.csv"), 60.0, units=units).notes
        assert any(re.search(rf"mean of \S+ {unit}, much of its threshold of \S+ {unit}:", note) for note in biased)
