"""The detector is armed from its delay on: at the first tick that is not before it, and not one later."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

import bumpstop as bs
from bumpstop import CollisionProblem, Scenario
from collision.cases import control_group, fixed

PERIOD, STEP = 0.004, 0.001
SD, THRESHOLD = 5.0, 20.0
# What ticks have to do with those before them decides how they are computed.
KINDS: dict[str, dict[str, Any]] = {
    "white": {},
    "correlated": {"detector__noise_correlation": 0.5},
    "observer": {"detector__residual": "observer", "detector__observer_gain_1_s": 200.0},
}


def tick_time(k: int) -> float:
    return k * PERIOD + STEP


# The delay, and the first tick that it lets alarm.
DELAYS = [(tick_time(8), 8), (tick_time(8) - 1e-9, 8), (tick_time(8) + 1e-9, 9), (tick_time(7) + 1e-3, 8), (0.0, 0)]


def sure(delay: float, offset_mm: float, **changes: Any) -> Scenario:
    """Every armed tick alarms for certain, with contact or without."""
    return fixed(
        offset_mm,
        **{
            "detector__noise_sd_Nm": 0.0,
            "detector__noise_mean_Nm": [0, 11, 0, 0, 0, 0, 0],
            "detector__arming_delay_s": delay,
            **changes,
        },
    )


@pytest.mark.parametrize(("delay", "first"), DELAYS)
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("offset_mm", [0.5, 3.0], ids=["after contact", "before contact"])
def test_a_sure_alarm_comes_at_the_first_armed_tick(delay: float, first: int, kind: str, offset_mm: float) -> None:
    """The arm goes 0.2 mm a tick: it has touched the nearer body at tick 3, the farther one at tick 15."""
    scenario = sure(delay, offset_mm, **KINDS[kind])
    result = bs.evaluate(scenario)
    assert result.curve is not None
    touched = math.ceil((offset_mm / 50 - STEP) / PERIOD)
    assert result.false_alarm_probability == (1.0 if first < touched else 0.0)
    if first >= touched:
        force = result.problem.stiffness * (result.curve.tick_distance[first] - offset_mm / 1e3)
        assert result.force_at_detection.mean == pytest.approx(force, rel=1e-9)
        # Nothing after it is computed.
        assert result.curve.end == "all_detected"
        assert len(result.curve.max_distance) == first + 1
    for threads in (1, 2):
        runs = bs.evaluate(scenario, samples=50, threads=threads).runs
        assert runs is not None
        assert set(runs["tick"]) == {first}
    problem = CollisionProblem.from_scenario(scenario)
    batch = bs.evaluate_batch(problem, problem.q[None], problem.velocity[None])
    assert batch.false_alarm_probability[0] == result.false_alarm_probability
    assert batch.mean[0] == pytest.approx(result.peak_force.mean, rel=1e-6)


@pytest.mark.parametrize(("delay", "first"), DELAYS)
def test_every_armed_tick_before_contact_counts_once(delay: float, first: int) -> None:
    """False alarms of white noise: as many chances as there are ticks from the first armed one to contact."""
    scenario = fixed(
        3.0,
        detector__thresholds_Nm=[THRESHOLD] + [math.inf] * 6,
        detector__noise_sd_Nm=SD,
        detector__arming_delay_s=delay,
    )
    ticks = 15 - first
    expected = -math.expm1(ticks * math.log1p(-2 * norm.sf(THRESHOLD / SD)))
    result = bs.evaluate(scenario)
    assert result.false_alarm_probability == pytest.approx(expected, rel=1e-9)
    problem = CollisionProblem.from_scenario(scenario)
    batch = bs.evaluate_batch(problem, problem.q[None], problem.velocity[None])
    assert batch.false_alarm_probability[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize(("delay", "first"), DELAYS)
@pytest.mark.parametrize("offset_law", ["half_normal", "uniform"])
def test_batches_arm_at_the_same_tick(delay: float, first: int, offset_law: str) -> None:
    """Among bodies touched before the detector is armed: a tick more of them would stay undetected by a tick longer."""
    scenario = control_group(
        contact__offset_law=offset_law,
        contact__offset_sd_s=0.02,
        detector__arming_delay_s=delay,
        detector__noise_sd_Nm=2.0,
    )
    problem = CollisionProblem.from_scenario(scenario)
    batch = bs.evaluate_batch(problem, problem.q[None], problem.velocity[None])
    result = bs.evaluate(scenario)
    assert batch.mean[0] == pytest.approx(result.peak_force.mean, rel=1e-6)
    late = bs.evaluate(scenario.with_values({"detector.arming_delay_s": tick_time(first + 1)}))
    if first:
        assert late.peak_force.mean > result.peak_force.mean * (1 + 1e-4)


@pytest.mark.parametrize(("delay", "first"), DELAYS[:3])
def test_on_a_trajectory(delay: float, first: int) -> None:
    example = Path(__file__).parents[3] / "examples" / "06_pick_and_place_trajectory.toml"
    scenario = bs.load_scenario(example)
    dof = len(scenario.detector.thresholds_Nm)
    mean = [2 * value for value in scenario.detector.thresholds_Nm]
    scenario = scenario.with_values(
        {
            "detector.arming_delay_s": delay,
            "detector.noise_sd_Nm": [0.0] * dof,
            "detector.noise_mean_Nm": mean,
            "detector.feedback_period_s": PERIOD,
            "simulation.step_s": STEP,
            "motion.contact_onset_s": 1.0,
        }
    )
    assert bs.evaluate(scenario).false_alarm_probability == 1.0
    runs = bs.evaluate(scenario, samples=20).runs
    assert runs is not None
    assert set(runs["tick"]) == {first}


def test_measured_noise_is_heard_from_the_first_armed_tick_on(tmp_path: Path) -> None:
    import polars as pl

    rows = np.tile([0.0, 11.0, 0, 0, 0, 0, 0], (400, 1))
    t = PERIOD * np.arange(400)
    frame = pl.DataFrame({"t": t} | {f"residual_{j + 1}": rows[:, j] + 1e-3 * np.sin(t + j) for j in range(7)})
    frame.write_parquet(tmp_path / "noise.parquet")
    for delay, first in DELAYS:
        scenario = control_group(detector__arming_delay_s=delay).model_dump(exclude_unset=True)
        del scenario["detector"]["noise_sd_Nm"]
        scenario["detector"]["residuals"] = "noise.parquet"
        runs = bs.evaluate(Scenario.from_dict(scenario, folder=tmp_path), samples=20).runs
        assert runs is not None
        assert set(runs["tick"]) == {first}
