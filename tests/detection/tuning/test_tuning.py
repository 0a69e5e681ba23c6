"""Thresholds from residuals: planted tails recovered, rates achieved on noise that was not used, real arms."""

from __future__ import annotations

import math
import os
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

import bumpstop as bs
from bumpstop.detection import ResidualSeries, residual_record, tune
from bumpstop.detection.tuning.extreme_values import PeaksOverThreshold, clusters
from bumpstop.detection.tuning.joint_scales import block_rows, joint_scales
from bumpstop.identification import identify_dynamics
from bumpstop.recording import Recording
from detection.tuning_cases import achieved, residuals

SHARED = Path(os.environ.get("BUMPSTOP_SHARED", Path(__file__).resolve().parents[4] / "shared"))


def test_clusters_by_hand() -> None:
    x = np.array([0, 5, 0, 6, 0, 0, 0, 7, 9, 8, 0, 0, 0, 0, 5.0])
    first, peaks = clusters(x, 4, 3)
    assert first.tolist() == [1, 7, 14]
    assert peaks.tolist() == [6, 9, 5]
    assert clusters(x, 4, 2)[0].tolist() == [1, 3, 7, 14]
    assert clusters(x, 4, 1)[0].tolist() == [1, 3, 7, 8, 9, 14]
    assert clusters(x, 9, 3)[0].size == 0


def test_a_planted_rate_is_recovered_and_extrapolated() -> None:
    """White normal noise: how often it passes a level is known exactly."""
    rng = np.random.default_rng(8)
    rows, period, per_hour = 400_000, 0.01, 0.05
    noise = np.abs(rng.standard_normal(rows))
    tail = PeaksOverThreshold.fit([noise], period)
    truth = stats.norm.isf(per_hour / 3600 * period / 2)
    low, high = tail.level_interval(per_hour)
    assert low < truth < high
    # 18 times beyond the record. Two standard errors of a scale from 200 peaks are 14 %, of two thirds of the square.
    assert tail.level_of(per_hour) == pytest.approx(truth, rel=0.08)
    assert tail.per_hour(tail.level_of(per_hour)) == pytest.approx(per_hour, rel=1e-9)
    np.testing.assert_allclose(tail.peaks, clusters(noise, math.sqrt(tail.level), tail.cluster_rows)[1], rtol=1e-12)


def test_profile_interval_against_likelihood_worked_out_apart() -> None:
    """The ends of the interval are where scipy's own optimum falls by half the chi-square quantile."""
    from scipy.optimize import minimize

    tail = PeaksOverThreshold.fit([np.abs(residuals(0.2, 3).rows[:, 0])], 0.01)
    x = tail.level_of(20.0)
    k, y = tail.excess.size, tail.excess

    def minus(at: np.ndarray, log_rate_there: float | None) -> float:
        shape, log_rate = abs(at[0]), at[1]
        if log_rate_there is None:
            scale = math.exp(at[2])
        else:
            over = log_rate - log_rate_there
            reach = math.expm1(shape * over) / shape if abs(shape) > 1e-9 else over
            if reach <= 0:
                return 1e9
            scale = (x * x - tail.level) / reach
        if (1 + shape * y / scale <= 0).any():
            return 1e9
        fit = stats.genpareto.logpdf(y, shape, scale=scale).sum() + stats.norm.logpdf(shape, 0, 0.3)
        return -(fit + k * log_rate - math.exp(log_rate) * tail.hours)

    options = {"xatol": 1e-8, "fatol": 1e-10, "maxiter": 8000}
    start = [0.05, math.log(tail.rate)]
    best = minimize(minus, [*start, math.log(tail.scale)], args=(None,), method="Nelder-Mead", options=options).fun
    for end in tail.per_hour_interval(x):
        there = minimize(minus, start, args=(math.log(end),), method="Nelder-Mead", options=options).fun
        # The grid of the profile loses some hundredths of the 1.92.
        assert there - best == pytest.approx(stats.chi2.ppf(0.95, 1) / 2, abs=0.1)


@pytest.mark.parametrize("degrees", [None, 5.0])
def test_achieved_rate_lies_in_its_interval(degrees: float | None) -> None:
    """Tuned on six minutes, twelve times; counted on an hour and a half that was not used."""
    others = [residuals(0.5, 900 + k, degrees=degrees) for k in range(3)]
    inside = 0
    for seed in range(12):
        tuning = tune(residuals(0.1, seed, degrees=degrees), 30.0)
        low, high = tuning.per_hour_interval()
        assert low < 30 < high
        count = sum(achieved(part, tuning.thresholds(), tuning.cluster_rows) for part in others)
        inside += low <= count / 1.5 <= high
    # Of twelve with 95 % each fewer than 9 come once in four hundred and fifty times.
    assert inside >= 9


def test_joints_share_the_alarms() -> None:
    series = residuals(0.5, 5, joints=4)
    tuning = tune(series, 30.0)
    alone = [achieved(_only(series, j), tuning.thresholds()[j : j + 1], tuning.cluster_rows) for j in range(4)]
    assert 8 <= sum(alone) <= 30  # wanted: 15, and a little more as joints alarm together
    assert max(alone) <= 12


def test_every_joint_is_asked_for_its_part_of_the_rate() -> None:
    """Tails of unlike joints stand to each other otherwise at another rate, so the rate is not all the same."""
    heavy, normal = residuals(0.2, 6, degrees=3.0, joints=1), residuals(0.2, 7, degrees=None, joints=1)
    series = ResidualSeries(heavy.t, np.hstack([heavy.rows, normal.rows]))
    tuning, sizes = tune(series, 60.0), [np.abs(series.rows)]
    halved, whole = (joint_scales(sizes, block_rows(sizes), passed * 0.2) for passed in (30.0, 60.0))
    assert tuning.shares[0] / tuning.shares[1] == pytest.approx(halved[0] / halved[1], rel=1e-9)
    assert whole[0] / whole[1] != pytest.approx(halved[0] / halved[1], rel=5e-3)


def _only(series: ResidualSeries, joint: int) -> ResidualSeries:
    return ResidualSeries(series.t, series.rows[:, joint : joint + 1])


def test_fewer_alarms_want_higher_thresholds_and_extrapolation_is_flagged() -> None:
    tuning = tune(residuals(0.1, 2), 10.0)
    rates = [0.01, 0.1, 1.0, 10.0, 100.0]
    thresholds = np.array([tuning.thresholds(rate) for rate in rates])
    assert (np.diff(thresholds, axis=0) < 0).all()
    assert tuning.extrapolation() == pytest.approx(1.0, rel=1e-9)
    assert not tuning.to_json()["extrapolated_too_far"]
    far = tune(residuals(0.1, 2), 0.05)
    assert far.extrapolation() == pytest.approx(200, rel=1e-9)
    assert far.to_json()["extrapolated_too_far"]
    assert any("Extrapolated too far" in note and "12 min" in note for note in far.notes)
    # The interval widens with the distance.
    width = [
        math.log(high / low)
        for low, high in (tuning.thresholds_interval(rate) for rate in rates)
        for low, high in [(low[0], high[0])]
    ]
    assert width == sorted(width, reverse=True)


def test_several_recordings_and_gaps() -> None:
    one = residuals(0.2, 4)
    halves = [one.between(0, 360), one.between(360, 720)]
    split, whole = tune(halves, 20.0), tune(one, 20.0)
    np.testing.assert_allclose(split.thresholds(), whole.thresholds(), rtol=0.02)
    # A gap of a day is no time in which there was no alarm.
    late = ResidualSeries(np.where(one.t < 360, one.t, one.t + 86_400), one.rows)
    gapped = tune(late, 20.0)
    np.testing.assert_allclose(gapped.thresholds(), split.thresholds(), rtol=1e-3)
    assert gapped.tail.hours == pytest.approx(0.2, rel=1e-6)
    assert any("1 gap in time" in note for note in gapped.notes)


def test_samples_lost_one_by_one_part_no_alarms() -> None:
    """Two rows in a hundred are missing: a peak that lasts has holes, and is one peak still."""
    one = residuals(0.2, 4, memory=0.97)
    kept = np.random.default_rng(1).random(one.t.size) > 0.02
    whole, holed = tune(one, 20.0), tune(ResidualSeries(one.t[kept], one.rows[kept]), 20.0)
    assert holed.tail.excess.size == pytest.approx(whole.tail.excess.size, rel=0.15)
    np.testing.assert_allclose(holed.thresholds(), whole.thresholds(), rtol=0.05)
    assert not any("gaps" in note for note in holed.notes)


def test_scale_and_unwatched_joints() -> None:
    one = residuals(0.1, 6)
    tuning = tune(one, 20.0)
    tenfold = tune(ResidualSeries(one.t, 10 * one.rows), 20.0)
    np.testing.assert_allclose(tenfold.thresholds(), 10 * tuning.thresholds(), rtol=1e-6)
    some = tune(one, 20.0, joints=[0, 2])
    assert np.isinf(some.thresholds()[1])
    assert some.to_json()["thresholds_Nm"][1] is None
    biased = tune(ResidualSeries(one.t, one.rows + np.array([0, 0, 100])), 20.0)
    assert any("joint 3 has a mean of 100" in note for note in biased.notes)


def test_joints_of_short_recordings_stand_to_each_other_as_their_largest_residuals() -> None:
    """Wherever in the recordings these are."""
    quiet, loud = (residuals(0.0005, seed, memory=0.97) for seed in (0, 100))
    loud = ResidualSeries(loud.t, loud.rows * [3.0, 0.2, 1.0], "loud")
    tuning = tune([quiet, loud], 100.0)
    shares = tuning.shares
    assert any("Too short to tell how joints' tails differ" in note for note in tuning.notes)
    largest = np.abs(np.concatenate([quiet.rows, loud.rows])).max(axis=0)
    assert largest[0] > 1.2 * np.abs(quiet.rows[:, 0]).max()
    assert largest[1] > 1.2 * np.abs(loud.rows[:, 1]).max()
    np.testing.assert_allclose(shares, largest, rtol=1e-12)


def test_refusals() -> None:
    one = residuals(0.02, 1)
    short = residuals(0.001, 1)
    cases: list[tuple[object, dict[str, object], str]] = [
        ([], {}, "there are none"),
        (one, {"per_hour": 0.0}, "per_hour: is 0"),
        (one, {"per_hour": math.nan}, "per_hour: is nan"),
        (one, {"per_hour": 1e9}, "per_hour: .* cannot be tuned for; wanted more than 0 and less than"),
        (one, {"confidence": 1.0}, "confidence: is 1"),
        (one, {"joints": [3]}, "joints: .4. are not all joints; wanted some of 1 to 3"),
        (short.between(0, 0.5), {}, "50 rows; wanted at least 100"),
        (
            ResidualSeries(one.t, one.rows * [1, 0, 1]),
            {"joints": [0, 1]},
            "residual of joint 2: is 0 all the time: its gain",
        ),
        (ResidualSeries(one.t, one.rows * [1, 0, 1] + 3), {"joints": [0, 1]}, "residual of joint 2: never changes"),
        (ResidualSeries(one.t, 0 * one.rows), {}, "residuals: of no joint ever change"),
        ([one, residuals(0.02, 2, joints=4)], {}, "noise 2: has 4 joints; noise 1 has 3"),
        ([one, ResidualSeries(1.02 * one.t, one.rows)], {}, "has a row every 0.0102 s"),
        ([ResidualSeries(1.02 * one.t, one.rows), one], {}, "has a row every 0.01 s"),
    ]
    for series, given, message in cases:
        arguments: dict[str, object] = {"per_hour": 20.0} | given
        with pytest.raises(bs.InputError, match=message):
            tune(series, **arguments)  # type: ignore[arg-type]
    # One slow swing has one peak, however many rows.
    slow = ResidualSeries(np.arange(400) / 100, np.sin(np.arange(400) / 80)[:, None] * [1.0, 2.0, 3.0])
    with pytest.raises(bs.InputError, match="independent peaks"):
        tune(slow, 20.0)


def test_default_rate_is_what_the_recording_carries() -> None:
    short, long = residuals(0.02, 1), residuals(0.4, 2)
    assert tune(short).target == pytest.approx(1 / (10 * 0.02))
    assert tune([short, residuals(0.02, 3)]).target == pytest.approx(1 / (10 * 0.04))
    assert tune(long).target == 1.0
    assert not any("No rate" in note for note in tune(long).notes + tune(short, 10.0).notes)


@pytest.mark.parametrize(
    ("folder", "arm", "cutoff_hz", "beyond"), [("panda_ros2", "panda", 4.0, 1.23), ("ur10_ros2", "ur10", 4.0, 1.08)]
)
def test_real_arms(folder: str, arm: str, cutoff_hz: float, beyond: float) -> None:
    """Model and thresholds from the first half of a recording; the second half must not alarm far above them.

    The default asks for one alarm in ten times what the first half shows, which the model was fitted to.
    What it has not seen comes once, for a row of two joints of the Panda, 22 % above a threshold,
    and for 18 rows of a joint of the UR10 7 % above.
    Ends in motion are not among the rows: until they were left out, thresholds were higher than that.
    """
    place = SHARED / "data" / folder
    if not place.is_dir():
        pytest.skip(f"{place} is not there: set BUMPSTOP_SHARED")
    log = Recording.load(next(path for path in place.rglob("*.db3")))
    middle = float(log.t[0] + log.t[-1]) / 2
    fit = identify_dynamics(log.between(float(log.t[0]), middle), bs.Robot.load(arm), cutoff_hz=cutoff_hz)
    first, second = (
        ResidualSeries(record.t, record.rows)
        for part in (log.between(float(log.t[0]), middle), log.between(middle, float(log.t[-1])))
        for record in (residual_record(part, fit.model.robot, fit.model),)
        if record.t is not None
    )
    tuning = tune(first)
    assert any("No rate was given" in note for note in tuning.notes)
    largest = np.abs(first.rows).max(axis=0)
    assert (tuning.thresholds() <= 1.5 * largest).all()
    assert achieved(second, beyond * tuning.thresholds(), 1) == 0
    assert achieved(first, tuning.thresholds(), 1) == 0
