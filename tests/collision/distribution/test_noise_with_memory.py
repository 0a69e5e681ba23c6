"""Correlated noise, the observer's filter and resampled residuals: against closed forms and the sampled
distribution."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy import stats

import bumpstop as bs
from bumpstop.collision.distribution.noise import contact_residual, noise_of_run
from bumpstop.detection import DetectorSettings
from bumpstop.detection.tuning.residual_record import ResidualRecord
from bumpstop.signal import correlation_time
from collision.cases import REMEMBERING, control_group, fixed
from collision.distribution.test_exact_law import figures
from collision.distribution.test_two_laws import RUNS, compare


@pytest.mark.parametrize("name", list(REMEMBERING))
def test_within_four_standard_errors(name: str) -> None:
    compare(REMEMBERING[name], RUNS, seed=12)


@pytest.mark.parametrize("kind", ["half_normal", "uniform"])
def test_correlation_zero_is_the_white_law(kind: str) -> None:
    """A correlation that cannot matter goes the long way round, through the densities."""
    white = bs.evaluate(control_group(contact__offset_law=kind))
    carried = bs.evaluate(control_group(contact__offset_law=kind, detector__noise_correlation=1e-18))
    np.testing.assert_allclose(figures(carried), figures(white), rtol=1e-12, atol=1e-12)


def test_far_tails_of_correlated_noise_have_all_digits() -> None:
    white, carried = (bs.evaluate(control_group(detector__noise_correlation=c)).peak_force for c in (0.0, 1e-18))
    forces = np.array([1.3, 1.4, 1.5, 1.6, 1.7, 1.8]) * white.mean
    exact = [white.exceedance(force) for force in forces]
    assert 0 < exact[-1] < 1e-80
    np.testing.assert_allclose([carried.exceedance(force) for force in forces], exact, rtol=1e-9)


@pytest.mark.parametrize("correlation", [0.5, 0.9, 0.99])
def test_correlated_noise_needs_no_narrower_panels_than_white(correlation: float) -> None:
    """The white distribution is 3e-8 off with the same panels."""
    scenario = control_group(detector__noise_correlation=correlation)
    coarse, fine = bs.evaluate(scenario), bs.evaluate(scenario, refinement=2)
    np.testing.assert_allclose(figures(coarse), figures(fine), rtol=1e-7, atol=1e-12)


@pytest.mark.parametrize("correlation", [-0.6, 0.3, 0.9])
def test_detection_tick_by_tick_against_the_multivariate_normal(correlation: float) -> None:
    """One monitored joint and a fixed offset: survival is the mass of a box under a normal distribution of several
    ticks."""
    scenario = control_group(
        contact__offset_law="fixed",
        contact__offset_mm=0.05,
        detector__thresholds_Nm=[math.inf, 10, *[math.inf] * 5],
        detector__noise_sd_Nm=4.0,
        detector__noise_correlation=correlation,
        detector__noise_mean_Nm=[0, 1.5, 0, 0, 0, 0, 0],
    )
    result = bs.evaluate(scenario)
    curve, problem = result.curve, result.problem
    force = problem.stiffness * np.maximum(0, curve.tick_distance - 0.05e-3)
    mean = curve.torque_per_newton[:, 1] * force + 1.5
    survival = [1.0]
    for n in range(1, 5):
        lag = np.abs(np.subtract.outer(np.arange(n), np.arange(n)))
        noise = stats.multivariate_normal(mean[:n], 16.0 * correlation**lag, maxpts=2_000_000, abseps=1e-9, releps=1e-9)
        survival.append(float(noise.cdf(np.full(n, 10.0), lower_limit=np.full(n, -10.0))))
    detected = -np.diff(survival)
    first_in_contact = int(np.argmax(force > 0))
    mass = [2 * result.kernel.coefficients[result.kernel.slots_before + i, 0, 0] for i in range(4 - first_in_contact)]
    np.testing.assert_allclose(mass, detected[first_in_contact:], atol=3e-7)
    assert result.false_alarm_probability == pytest.approx(detected[:first_in_contact].sum(), abs=3e-7)


def test_observer_against_its_step_response() -> None:
    """A step of torque that the motors carry leaves 1 - a^k (1 + a) / 2 of itself k samples later, a = exp(-K T)."""
    problem = bs.CollisionProblem.from_scenario(
        control_group(detector__residual="observer", detector__observer_gain_1_s=40.0)
    )
    torque = np.zeros((60, 7))
    torque[10:] = np.arange(1.0, 8.0)
    residual = contact_residual(problem, torque)
    k, a = np.arange(60) - 9, math.exp(-40.0 * 0.004)
    step = np.where(k > 0, 1 - a ** (k - 1.0) * (1 + a) / 2, 0.0)
    np.testing.assert_allclose(residual, step[:, None] * np.arange(1.0, 8.0), rtol=1e-12, atol=1e-14)


@pytest.mark.parametrize("gain", [2.0, 50.0, 400.0, 1e5])
def test_the_law_sees_what_the_running_detector_sees(gain: float) -> None:
    """A standing arm whose motors hold against a contact that begins, grows and ends: two routes to the residual."""
    scenario = control_group(
        detector__residual="observer",
        detector__observer_gain_1_s=gain,
        simulation__step_s=0.005,
        detector__feedback_period_s=0.01,
    )
    problem = bs.CollisionProblem.from_scenario(scenario)
    ticks = 120
    torque = np.zeros((ticks, 7))
    torque[40:100] = np.outer(np.arange(0.4, 60.4), np.linspace(-1.0, 2.0, 7))
    settings = DetectorSettings(residual="observer", observer_gain_1_s=gain, window_s=0.05, frozen_s=np.inf)
    detector = bs.Detector(problem.robot, None, bs.Thresholds(np.full(7, 1e9)), settings)
    pose = np.tile(problem.q, (ticks, 1))
    holding = bs.model.gravity_torque(problem.robot, pose) + torque
    found = detector.run_rows(0.01 * np.arange(ticks), pose, holding).residual
    np.testing.assert_allclose(contact_residual(problem, torque)[30:], found[30:], atol=1e-9)


@pytest.mark.parametrize("gain", [15.0, 60.0, 400.0])
def test_observer_without_noise_detects_at_the_tick_its_filter_says(gain: float) -> None:
    scenario = fixed(0.4, detector__residual="observer", detector__observer_gain_1_s=gain, detector__noise_sd_Nm=0.0)
    result = bs.evaluate(scenario)
    curve, problem = result.curve, result.problem
    force = problem.stiffness * np.maximum(0, curve.tick_distance - 0.4e-3)
    residual = np.abs(contact_residual(problem, curve.torque_per_newton * force[:, None]))
    tick = int(np.argmax((residual > problem.thresholds).any(axis=1)))
    expected = problem.stiffness * (curve.max_distance[tick] - 0.4e-3)
    assert result.peak_force.mean == pytest.approx(expected, rel=1e-12)
    drawn = bs.evaluate(scenario, samples=3, seed=1)
    assert drawn.runs is not None
    np.testing.assert_array_equal(drawn.runs["tick"], tick)


def narrow_observer(**changes: Any) -> bs.Scenario:
    """An observer that takes several ticks to see what is there, and no noise worth the name."""
    return control_group(
        contact__offset_law="uniform",
        motion__velocity_mm_s=[0, 0, -100],
        detector__residual="observer",
        detector__observer_gain_1_s=20.0,
        detector__feedback_period_s=0.02,
        **changes,
    )


@pytest.mark.parametrize("noise_sd", [0.0, 1e-3])
def test_observer_almost_without_noise_against_every_offset_by_itself(noise_sd: float) -> None:
    """The tick of detection jumps from one to the next where the filtered residual passes the threshold."""
    result = bs.evaluate(narrow_observer(detector__noise_sd_Nm=noise_sd))
    curve, problem = result.curve, result.problem
    offset = (np.arange(1_000_000) + 0.5) / 1_000_000 * problem.offset_size
    kept = math.exp(-20.0 * 0.02)
    residual, before, tick = np.zeros((offset.size, 7)), np.zeros((offset.size, 7)), np.full(offset.size, -1)
    for k, (distance, torque) in enumerate(zip(curve.tick_distance, curve.torque_per_newton, strict=True)):
        force = problem.stiffness * np.maximum(0, distance - offset)
        felt = torque * force[:, None]
        residual = kept * residual + (1 - kept) * (before + felt) / 2
        before = felt
        tick[(tick < 0) & (np.abs(residual) > problem.thresholds).any(axis=1)] = k
    assert np.unique(tick).size > 1
    at_detection = problem.stiffness * (curve.tick_distance[tick] - offset)
    peak = problem.stiffness * (curve.max_distance[tick] - offset)
    assert result.force_at_detection.mean == pytest.approx(at_detection.mean(), rel=2e-5)
    assert result.peak_force.mean == pytest.approx(peak.mean(), rel=1e-5)
    assert result.peak_force.exceedance(400.0) == pytest.approx((peak > 400).mean(), abs=1e-4)


def test_observer_almost_without_noise_of_a_free_body_has_converged() -> None:
    scenario = narrow_observer(detector__noise_sd_Nm=0.0, contact__kind="free", contact__body_mass_kg=60.0)
    coarse, fine = bs.evaluate(scenario), bs.evaluate(scenario, refinement=3)
    assert coarse.undetected_probability == 0
    assert coarse.force_at_detection.mean == pytest.approx(fine.force_at_detection.mean, rel=1e-8)
    assert coarse.peak_force.mean == pytest.approx(fine.peak_force.mean, rel=1e-8)


@pytest.mark.parametrize(
    ("threshold", "correlation", "sd"),
    [
        (1e-3, 0.0, [3.18, 0.39, 3.57, 1.71, 5.97, 0.45, 4.59]),
        (1e-6, 0.6, [3.28, 1.88, 6.08, 4.25, 0.37, 4.82, 0.41]),
    ],
)
def test_detectors_that_always_alarm_have_a_law(threshold: float, correlation: float, sd: list[float]) -> None:
    """Probabilities of seven joints that all but surely alarm are added up, and rounding may take them above one."""
    changes: dict[str, Any] = {"detector__thresholds_Nm": [threshold] * 7, "detector__noise_sd_Nm": sd}
    result = bs.evaluate(fixed(1.0, detector__noise_correlation=correlation, **changes))
    assert result.false_alarm_probability == 1
    silent = 1 - 2 * stats.norm.sf(threshold / np.array(sd))
    np.testing.assert_allclose(1 - result.trigger_joint_probability, silent, rtol=1e-4)


@pytest.mark.parametrize("correlation", [0.0, 0.6])
def test_detectors_that_never_alarm_by_mistake_say_zero_and_not_minus_zero(correlation: float) -> None:
    found = bs.evaluate(fixed(1.0, detector__noise_correlation=correlation, detector__noise_sd_Nm=1e-3))
    assert str(found.false_alarm_probability) == "0.0"


def test_a_faster_observer_hits_more_softly() -> None:
    means = [
        bs.evaluate(control_group(detector__residual="observer", detector__observer_gain_1_s=gain)).peak_force.mean
        for gain in (20.0, 50.0, 200.0, 5000.0)
    ]
    assert means == sorted(means, reverse=True)
    # The fastest sees the mean of two cycles: half a cycle later than the direct residual.
    direct = bs.evaluate(control_group())
    problem = direct.problem
    half_cycle = problem.stiffness * 0.05 * 0.002
    assert means[-1] - direct.peak_force.mean == pytest.approx(half_cycle, rel=0.02)


def record_file(folder: Path, rows: np.ndarray, period: float = 0.004, **other: Any) -> Path:
    path = folder / "free_motion.parquet"
    columns = {"t": np.arange(len(rows)) * period} | {f"residual_{j + 1}": rows[:, j] for j in range(rows.shape[1])}
    pl.DataFrame(columns | other).write_parquet(path)
    return path


def with_record(path: Path, **changes: Any) -> bs.Scenario:
    return control_group(detector__residuals=str(path), **changes)


def correlated_rows(n: int, correlation: float, sd: np.ndarray, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    white = rng.normal(size=(n, sd.size))
    rows = white.copy()
    for k in range(1, n):
        rows[k] = correlation * rows[k - 1] + math.sqrt(1 - correlation**2) * white[k]
    return rows * sd


def test_resampled_gaussian_noise_gives_back_the_gaussian_law(tmp_path: Path) -> None:
    """Planted truth: a long record of correlated Gaussian noise, against the integrated distribution of that noise."""
    sd = np.full(7, 4.0)
    sd[1] = 2.5
    path = record_file(tmp_path, correlated_rows(200_000, 0.8, sd, seed=4))
    drawn = bs.evaluate(with_record(path), samples=100_000, seed=3, threads=2)
    exact = bs.evaluate(control_group(detector__noise_sd_Nm=sd.tolist(), detector__noise_correlation=0.8))
    assert drawn.problem.residuals is not None
    assert 50 < drawn.problem.residuals.block_rows < 130
    # The record itself is one sample of 200 000 rows with a correlation time of nine: errors of both.
    assert drawn.peak_force.mean == pytest.approx(exact.peak_force.mean, rel=3e-3)
    assert drawn.peak_force.sd == pytest.approx(exact.peak_force.sd, rel=2e-2)
    np.testing.assert_allclose(drawn.trigger_joint_probability, exact.trigger_joint_probability, atol=0.01)


@pytest.mark.parametrize("gain", [None, 40.0])
def test_residuals_that_lean_away_from_the_contact_are_followed_until_it_is_noticed(
    tmp_path: Path, gain: float | None
) -> None:
    """A residual that is 9 Nm off hides a contact far longer than the spread of the rows tells."""
    lean = np.array([0, 9.0, 0, 0, 0, 0, 0])
    sd = np.full(7, 0.5)
    soft: dict[str, Any] = {"contact__offset_law": "uniform", "contact__stiffness_N_m": 5600.0}
    if gain is not None:
        soft |= {"detector__residual": "observer", "detector__observer_gain_1_s": gain}
    for sign in (-1, 1):
        rows = sign * lean + correlated_rows(20_000, 0.0, sd, seed=7)
        result = bs.evaluate(with_record(record_file(tmp_path, rows), **soft), samples=20_000, seed=1)
        gauss = bs.evaluate(
            control_group(detector__noise_sd_Nm=list(sd), detector__noise_mean_Nm=list(sign * lean), **soft)
        )
        assert result.undetected_probability == 0
        assert result.peak_force.mean == pytest.approx(gauss.peak_force.mean, rel=0.01)
        assert result.peak_force.quantile(0.99) == pytest.approx(gauss.peak_force.quantile(0.99), rel=0.01)


def test_residuals_that_lean_away_from_the_contact_are_followed_on_a_trajectory(tmp_path: Path) -> None:
    lean, sd = np.array([0, 6.0, 0, -5.0, 0, 0, 0]), np.array([3.0, 1.5, 3.0, 3.0, 3.0, 3.0, 3.0])
    path = record_file(tmp_path, lean + correlated_rows(60_000, 0.0, sd, seed=5))
    example = bs.load_scenario(Path(__file__).parents[3] / "examples" / "06_pick_and_place_trajectory.toml")
    case = example.with_values({"motion.contact_onset_s": 0.7})
    gauss = bs.evaluate(case.with_values({"detector.noise_sd_Nm": list(sd), "detector.noise_mean_Nm": list(lean)}))
    result = bs.evaluate(case.with_values({"detector.residuals": str(path)}), samples=10_000, seed=1)
    assert gauss.undetected_probability < 0.01
    assert result.undetected_probability == pytest.approx(gauss.undetected_probability, abs=0.005)


def test_resampling_keeps_rows_whole_and_in_order(tmp_path: Path) -> None:
    rows = np.random.default_rng(1).normal(size=(500, 7))
    path = record_file(tmp_path, rows)
    problem = bs.CollisionProblem.from_scenario(with_record(path))
    assert problem.residuals is not None
    block = problem.residuals.block_rows
    noise = noise_of_run(problem, 9, 5, 200)
    places = [int(np.flatnonzero((rows == row).all(axis=1))[0]) for row in noise]
    breaks = np.flatnonzero(np.diff(places) % len(rows) != 1) + 1
    assert np.all(np.diff(breaks) % block == 0)
    drawn = bs.evaluate(with_record(path), samples=50, seed=9)
    again = bs.evaluate(with_record(path), samples=50, seed=9, threads=2)
    assert drawn.runs is not None
    assert again.runs is not None
    np.testing.assert_array_equal(drawn.runs["noise"], again.runs["noise"])
    tick = int(drawn.runs["tick"][5])
    np.testing.assert_array_equal(drawn.runs["noise"][5], noise[tick])


@pytest.mark.parametrize("place", [0, 250, 497])
def test_a_burst_counts_alike_wherever_a_recording_begins(place: int, tmp_path: Path) -> None:
    """Blocks began where a whole one was left: of the last rows next to none was drawn, nor of the first."""
    rows = correlated_rows(500, 0.9, np.full(7, 0.5), seed=8)
    rows[250:253, 1] = 11.0
    path = record_file(tmp_path, np.roll(rows, place - 250, axis=0))
    scenario = with_record(path).with_values({"motion.velocity_mm_s": [0, 0, -40]})
    found = bs.evaluate(scenario, samples=20_000, seed=3).false_alarm_probability
    expected = bs.evaluate(
        with_record(record_file(tmp_path, rows)).with_values({"motion.velocity_mm_s": [0, 0, -40]}),
        samples=20_000,
        seed=4,
    ).false_alarm_probability
    assert expected > 0.01
    assert found == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("correlation", [0.0, 0.6, 0.95])
def test_correlation_time_of_a_first_order_series(correlation: float) -> None:
    x = correlated_rows(400_000, correlation, np.ones(1), seed=2)[:, 0]
    assert correlation_time(x) == pytest.approx((1 + correlation) / (1 - correlation), rel=0.1)


def test_a_record_too_short_for_its_memory_says_so() -> None:
    rows = correlated_rows(400, 0.98, np.ones(2), seed=3)
    record = ResidualRecord.from_rows(rows)
    assert record.block_rows <= 40
    assert any("longer recording" in note for note in record.notes)


def test_measured_residuals_are_drawn_by_default_and_have_no_exact_law(tmp_path: Path) -> None:
    path = record_file(tmp_path, correlated_rows(2000, 0.0, np.full(7, 2.0), seed=6))
    result = bs.evaluate(with_record(path), seed=1)
    assert (result.kind, result.samples) == ("sampled", 100_000)
    with pytest.raises(bs.InputError, match="no integrated distribution"):
        bs.integrate(result.problem, result.curve)


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda t: t.drop("residual_3"), "no column 'residual_3'"),
        (lambda t: t.drop("t"), "no column 't'"),
        (lambda t: t.with_columns(residual_8=pl.lit(1.0)), "residual_8"),
        (lambda t: t.with_columns(residual_2=pl.when(pl.col("t") > 1).then(math.nan).otherwise(0.0)), "'residual_2'"),
        (lambda t: t.with_columns(residual_2=pl.lit("much")), "does not hold numbers"),
        (lambda t: t.with_columns(t=pl.col("t") * 1.011), "a row every 0.004044 s"),
        (lambda t: t.with_columns(t=-pl.col("t")), "time does not grow"),
        (lambda t: t.head(20), "20 rows"),
    ],
)
def test_records_that_cannot_be_used(tmp_path: Path, spoil: Any, message: str) -> None:
    path = record_file(tmp_path, np.zeros((1000, 7)))
    spoil(pl.read_parquet(path)).write_parquet(path)
    with pytest.raises(bs.InputError, match=message):
        bs.CollisionProblem.from_scenario(with_record(path))


def test_a_clock_that_differs_by_less_than_a_hundredth_is_that_of_the_feedback(tmp_path: Path) -> None:
    path = record_file(tmp_path, np.zeros((1000, 7)))
    pl.read_parquet(path).with_columns(t=pl.col("t") * 1.009).write_parquet(path)
    bs.CollisionProblem.from_scenario(with_record(path))


def test_files_that_are_no_records(tmp_path: Path) -> None:
    with pytest.raises(bs.InputError, match="is no file"):
        bs.CollisionProblem.from_scenario(with_record(tmp_path / "absent.parquet"))
    damaged = tmp_path / "damaged.parquet"
    damaged.write_bytes(b"PAR1 but not really")
    with pytest.raises(bs.InputError, match="cannot be read"):
        bs.CollisionProblem.from_scenario(with_record(damaged))
