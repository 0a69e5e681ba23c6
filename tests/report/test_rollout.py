"""Rollouts: a run followed in time is the run that was sampled."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.figure import Figure

import bumpstop as bs
from bumpstop import _native
from bumpstop.report.collision.force_over_time import ForceOverTimeSection
from bumpstop.report.collision.rollout import Rollouts
from collision.cases import FREE, OUTLASTING
from report.cases import evaluate

REPOSITORY = Path(__file__).resolve().parents[2]
FREE_HAND = {"contact.kind": "free", "contact.limits": "ts15066"}


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"reaction.latency_s": 0.007},
        {"reaction.kind": "stop", "detector.noise_mean_Nm": [1.0, -2.0, 0, 0, 0, 0, 0]},
    ],
)
def test_rollout_is_the_sampled_run(changes):
    result = evaluate(changes, samples=400)
    problem, curve, runs = result.problem, result.curve, result.runs
    rollouts = Rollouts(result)
    for run in (0, 17, int(np.argmax(runs["peak_force"]))):
        rollout = rollouts.rollout(run)
        tick = runs["tick"][run]
        # Peaks are interpolated between nodes where that is exact to 1e-9 m.
        assert rollout.peak_force == pytest.approx(runs["peak_force"][run], abs=2e-9 * problem.stiffness)
        # The reaction joins the line without a jump: no acceleration beyond a few m/s2 anywhere.
        assert np.abs(np.diff(rollout.distance, 2)).max() < 5e-6
        assert rollout.residual[-1] == pytest.approx(runs["residual"][run, rollout.joint], abs=1e-9)
        assert rollout.threshold == problem.thresholds[rollout.joint]
        assert abs(rollout.residual[-1]) > rollout.threshold
        assert (np.abs(rollout.residual[:-1]) <= rollout.threshold).all()
        assert runs["triggers"][run] >> rollout.joint & 1
        assert rollout.tick_time.size == tick + 1
        at_detection = np.interp(rollout.detection, rollout.time, rollout.force)
        assert at_detection == pytest.approx(runs["force_at_detection"][run], abs=1e-6)
        delay = curve.tick_time[tick] - np.interp(runs["offset"][run], curve.distance, step_times(result))
        assert rollout.detection == pytest.approx(delay, abs=1e-9)
        assert rollout.reaction == pytest.approx(rollout.detection + problem.latency_steps * 1e-3)
        noise = _native.standard_noise(0, run, 1, tick + 1, 7)[0, :, rollout.joint]
        expected = noise * problem.noise_sd[rollout.joint] + problem.noise_mean[rollout.joint]
        np.testing.assert_allclose(rollout.residual - rollout.contact_torque, expected, atol=1e-12)


def step_times(result):
    return np.arange(result.curve.distance.size) * result.scenario.simulation.step_s


def test_chosen_runs_are_near_their_quantiles():
    result = evaluate()
    rollouts = Rollouts(result)
    for p in (0.5, 0.99):
        assert rollouts.nearest(p).peak_force == pytest.approx(result.peak_force.quantile(p), abs=0.5)


def test_a_trajectory_shows_runs_near_the_quantiles_that_have_a_bound():
    """Runs never detected lie beyond every quantile of the distribution, whatever their force."""
    result = bs.evaluate(bs.load_scenario(REPOSITORY / "examples" / "06_pick_and_place_trajectory.toml"))
    assert result.undetected_probability > 0.05
    rollout = Rollouts(result).nearest(0.5)
    assert rollout.detection is not None
    assert rollout.peak_force == pytest.approx(result.peak_force.quantile(0.5), rel=0.01)


def test_free_contact_is_drawn_until_the_body_has_got_away():
    """250 mm/s: contact lasts pi sqrt(m / K) = 8.9 ms, the reaction a quarter of a second."""
    result = evaluate({**FREE_HAND, "motion.velocity_mm_s": [0, 0, -250]})
    for picture in ForceOverTimeSection(result).pictures():
        figure = Figure()
        picture.draw(figure)
        assert 8 < figure.axes[0].get_xlim()[1] < 30  # ms
    undetected = evaluate({**FREE_HAND, "detector.thresholds_Nm": [math.inf] * 7})
    picture = ForceOverTimeSection(undetected).pictures()[0]
    # v sqrt(m K) = 0.05 sqrt(0.6 75000)
    assert "Never detected: the body gets away from 10.61 N." in picture.caption


def test_an_undetected_quantile_shows_an_undetected_run():
    result = evaluate({"motion.duration_s": 0.12})
    rollout = Rollouts(result).nearest(0.99)
    assert rollout.detection is None
    assert rollout.reaction is None
    assert rollout.touch == 0
    assert rollout.peak_force > 0


def test_the_compression_scale_is_the_body_s_without_its_padding():
    result = evaluate({"contact.padding_N_m": 20000.0})
    figure = Figure()
    ForceOverTimeSection(result).pictures()[0].draw(figure)
    force = figure.axes[0]
    (scale,) = force.child_axes
    figure.draw_without_rendering()
    assert scale.get_ylim()[1] == pytest.approx(force.get_ylim()[1] / 75000 * 1e3)


def test_a_body_that_gets_away_from_a_stopped_arm_is_drawn_until_it_has():
    changes = {
        "contact.kind": "free", "contact.body_mass_kg": 60.0, "contact.stiffness_N_m": 8000.0, "reaction.kind": "stop"
    }  # fmt: skip
    result = evaluate(changes, samples=60)
    for picture in ForceOverTimeSection(result).pictures():
        figure = Figure()
        picture.draw(figure)
        y = np.asarray(figure.axes[0].lines[0].get_ydata())
        assert y.max() > 10
        assert y[-1] == 0


@pytest.mark.parametrize("name", ["fast, detected while it rises", "latency, stop", "light, mostly detected"])
def test_single_runs_in_the_report_are_those_of_the_kernels(name: str) -> None:
    result = bs.evaluate(FREE[name], samples=60, seed=8)
    assert result.runs is not None
    rollouts = Rollouts(result)
    for run in range(0, 60, 7):
        rollout, peak = rollouts.rollout(run), result.runs["peak_force"][run]
        # The distribution's reactions are interpolated to 1e-8 m. Drawn are times less than 0.02 rad apart: 5e-5 of the
        # height.
        slack = 1e-8 * result.problem.stiffness
        assert peak * (1 - 5e-5) - slack <= rollout.force.max() <= peak + slack
        assert rollout.peak_force == peak
        tick = int(result.runs["tick"][run])
        if tick >= 0:
            residual = result.runs["residual"][run][rollout.joint]
            assert rollout.residual[-1] == pytest.approx(residual, abs=1e-9)


@pytest.mark.parametrize("latency", [0.0, 0.03, 0.06])
@pytest.mark.parametrize("free", [{}, {"contact.kind": "free", "contact.body_mass_kg": 8.0}], ids=["clamped", "free"])
def test_single_runs_of_an_elastic_arm_along_a_trajectory(latency: float, free: dict[str, Any]) -> None:
    """The kernels end a path where detection is certain; here it is known to the end of the motion."""
    changes = {"arm.model": "elastic", "reaction.latency_s": latency, "arm.acceleration_feedforward": 0.5, **free}
    result = bs.evaluate(
        bs.load_scenario(REPOSITORY / "examples" / "06_pick_and_place_trajectory.toml", changes), samples=60, seed=3
    )
    assert result.runs is not None
    rollouts = Rollouts(result)
    for run in range(0, 60, 3):
        rollout, tick = rollouts.rollout(run), int(result.runs["tick"][run])
        assert rollout.force.max() == pytest.approx(result.runs["peak_force"][run], rel=2e-3)
        # The lever of the tick after the contact, not that of contact itself.
        if tick >= 0:
            assert rollout.residual[-1] == pytest.approx(result.runs["residual"][run][rollout.joint], abs=0.02)


@pytest.mark.parametrize("name", list(OUTLASTING))
def test_single_runs_in_the_report_end_when_the_body_has_got_away(name: str) -> None:
    result = bs.evaluate(OUTLASTING[name], samples=60, seed=3)
    assert result.runs is not None
    rollouts = Rollouts(result)
    for run in range(0, 60, 4):
        rollout, lasts = rollouts.rollout(run), float(result.runs["duration"][run])
        assert rollout.force[-1] == 0
        pressed = rollout.time[rollout.force > 0]
        assert (pressed.size == 0) == (lasts < 1e-3)
        if pressed.size:
            assert rollout.touch == 0
            assert pressed[-1] == pytest.approx(lasts, abs=1.1e-3)


def test_an_undetected_run_stands_for_a_quantile_where_the_arm_comes_to_rest():
    """Joint 2 has 0.3 degrees left, the body is a millimetre away, and nobody detects."""
    result = evaluate(
        {
            "pose_deg": [0, 109.7, 0, -20, 0, -40, 0],
            "motion.velocity_mm_s": [0, 0, -30],
            "detector.thresholds_Nm": [600.0] * 7,
            "contact.offset_law": "uniform",
            "contact.offset_sd_s": None,
            "detector.feedback_period_s": 0.04,
        }
    )
    assert result.curve.end == "joint_limit"
    bad = Rollouts(result).nearest(0.999)
    assert bad.detection is None
    assert bad.peak_force == pytest.approx(result.peak_force.quantile(0.999), rel=2e-3)


@pytest.mark.parametrize("residual", ["direct", "observer"])
def test_a_motion_that_ends_before_the_first_control_cycle_is_drawn(residual):
    """Joint 2 stands at its limit and would have to go on: the arm brakes, and nobody has looked."""
    at_limit = {"pose_deg": [0, 109.9999999, 0, -20, 0, -40, 0], "motion.velocity_mm_s": [0, 0, -30]}
    result = evaluate(at_limit | {"detector.residual": residual})
    assert result.curve.ticks == 0
    bad = Rollouts(result).nearest(0.99)
    assert bad.detection is None
    assert bad.residual.size == bad.tick_time.size == 0
    for picture in ForceOverTimeSection(result).pictures():
        picture.draw(Figure())
