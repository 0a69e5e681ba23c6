"""Distributions of motions given as joint trajectories: against lines, against formulas, against samples."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.trajectory import onset as onset
from bumpstop.collision.trajectory import trajectory_evaluation
from bumpstop.collision.trajectory.trajectory_result import TrajectoryCollisionResult
from collision.cases import control_group
from collision.distribution.test_two_laws import compare
from collision.trajectory_cases import EXAMPLE, gantry, scenario, trajectory_motion, waves, write_csv

# --- Against lines ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["stop", "reverse"])
@pytest.mark.parametrize("latency", [0.0, 0.007])
def test_a_straight_trajectory_is_a_line(kind: str, latency: float, tmp_path: Path) -> None:
    """Along slides path and joints are straight, so nothing but the code differs."""
    gantry(tmp_path)
    velocity, duration, begin = np.array([0.03, -0.02, -0.06]), 0.8, 0.2137
    t = np.array([0.0, 0.3, duration])
    write_csv(tmp_path / "path.csv", t, t[:, None] * velocity)
    reaction = {"kind": kind, "joint_acceleration_rad_s2": [2.0, 1.0, 1.5], "latency_s": latency}
    line = scenario(
        tmp_path,
        {"velocity_mm_s": [float(v) for v in 1e3 * velocity], "task": "position", "duration_s": duration},
        pose_rad=[0.0, 0.0, 0.0],
        contact={
            "stiffness_N_m": 20000,
            "offset_law": "fixed",
            "offset_mm": 1e3 * begin * float(np.linalg.norm(velocity)),
        },
        reaction=reaction,
        detector__noise_sd_Nm=6.0,
    )
    path = scenario(tmp_path, trajectory_motion(contact_onset_s=begin), reaction=reaction, detector__noise_sd_Nm=6.0)
    expected, found = bs.evaluate(line), bs.evaluate(path)
    assert expected.false_alarm_probability > 1e-3
    for name in ("peak_force", "force_at_detection", "detection_delay", "contact_duration"):
        ours, theirs = getattr(found, name), getattr(expected, name)
        assert (ours is None) == (theirs is None)
        if ours is None:
            continue
        tolerance = 2e-3 if name == "contact_duration" else 1e-8  # the line's is read between simulation steps
        assert ours.mean == pytest.approx(theirs.mean, rel=tolerance)
        assert ours.sd == pytest.approx(theirs.sd, rel=10 * tolerance)
        for p in (0.05, 0.5, 0.95, 0.999):
            assert ours.quantile(p) == pytest.approx(theirs.quantile(p), rel=tolerance, abs=1e-9)
    assert found.false_alarm_probability == pytest.approx(expected.false_alarm_probability, rel=1e-9)
    assert found.multi_joint_probability == pytest.approx(expected.multi_joint_probability, rel=1e-9)
    assert found.left_in_contact_probability == expected.left_in_contact_probability == 0
    np.testing.assert_allclose(found.trigger_joint_probability, expected.trigger_joint_probability, rtol=1e-8)


def test_a_turning_arm_along_a_line(tmp_path: Path) -> None:
    """The SIA5D's own line, as rows of a trajectory: the same until it reacts, and nearly the same stop."""
    line = control_group(
        contact__offset_law="fixed", contact__offset_mm=6.3, reaction__kind="stop", motion__duration_s=0.6
    )
    problem = bs.CollisionProblem.from_scenario(line)
    curve = bs.stopping_curve(problem, whole=True)
    free = [j for j in range(7) if j not in problem.held]
    state = np.zeros((curve.ticks + 1, 2, 7))
    state[:, 0] = problem.q
    state[0, 1] = problem.start.qd
    state[1:, :, free] = curve.line.reaction_state
    write_csv(tmp_path / "path.csv", np.append(0.0, curve.tick_time), state[:, 0], state[:, 1])
    data = line.to_dict()
    data["motion"] = trajectory_motion(contact_onset_s=6.3e-3 / curve.approach_speed)
    del data["pose_deg"], data["contact"]["offset_law"], data["contact"]["offset_mm"]
    data["contact"]["normal"] = [float(x) for x in curve.normal]
    expected, found = bs.evaluate(line), bs.evaluate(bs.Scenario.from_dict(data, tmp_path))
    assert found.force_at_detection.mean == pytest.approx(expected.force_at_detection.mean, rel=1e-4)
    assert found.detection_delay.mean == pytest.approx(expected.detection_delay.mean, rel=1e-4)
    assert found.trigger_joint_probability == pytest.approx(expected.trigger_joint_probability, rel=1e-3, abs=1e-9)
    # Along its path or along its joints, the arm stops within some millimetres, which differ little.
    assert found.peak_force.mean == pytest.approx(expected.peak_force.mean, rel=0.02)


# --- The time of contact ------------------------------------------------------------------------------------


def test_uniform_is_the_average_of_fixed_times(tmp_path: Path) -> None:
    t, q = waves(3, 0.24, rows=12, size=0.25)
    write_csv(tmp_path / "path.csv", t, q)
    noisy = {"detector__noise_sd_Nm": 5.0, "robot": "sia5d"}
    result = bs.evaluate(scenario(tmp_path, trajectory_motion(), **noisy))
    times = (np.arange(300) + 0.5) * 0.24 / 300
    fixed = [bs.evaluate(scenario(tmp_path, trajectory_motion(contact_onset_s=float(x)), **noisy)) for x in times]

    def average(figure: Any) -> float:
        return float(np.mean([figure(one) for one in fixed]))

    assert result.false_alarm_probability > 0.01
    assert result.false_alarm_probability == pytest.approx(average(lambda one: one.false_alarm_probability), rel=2e-3)
    assert result.undetected_probability == pytest.approx(average(lambda one: one.undetected_probability), rel=5e-3)
    assert result.peak_force.mean == pytest.approx(average(lambda one: one.peak_force.mean), rel=1e-3)
    for x in np.linspace(0.3, 1.5, 7) * result.peak_force.quantile(0.4):
        assert result.peak_force.exceedance(float(x)) == pytest.approx(
            average(lambda one, x=float(x): one.peak_force.exceedance(x)), abs=4e-3
        )


DETECTORS: dict[str, dict[str, Any]] = {
    "white": {},
    "correlated": {"noise_correlation": 0.6},
    "observer": {"residual": "observer", "observer_gain_1_s": 60.0},
}


@pytest.mark.parametrize("name", list(DETECTORS))
@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_exact_and_sampled_agree(name: str, kind: str, tmp_path: Path) -> None:
    number = list(DETECTORS).index(name)
    t, q = waves(20 + number, 0.7, rows=15, size=0.2)
    write_csv(tmp_path / "path.csv", t, q)
    noise = {"thresholds_Nm": [16.0, 12, 16, 12, 9, 9, 5], "noise_sd_Nm": 3.6, "arming_delay_s": 0.02}
    compare(
        scenario(
            tmp_path,
            trajectory_motion(),
            robot="sia5d",
            detector=noise | DETECTORS[name],
            reaction={"kind": kind, "joint_acceleration_rad_s2": 6.0, "latency_s": 0.004 * number},
        ),
        40_000 if name == "white" else 15_000,
        seed=5,
    )


def test_more_nodes_change_nothing_that_is_printed() -> None:
    result, fine = (bs.evaluate(bs.load_scenario(EXAMPLE), refinement=n) for n in (1, 2))
    for name in ("force_at_detection", "detection_delay"):
        ours, theirs = getattr(result, name).to_json(), getattr(fine, name).to_json()
        for figure, value in ours.items():
            assert value == pytest.approx(theirs[figure], rel=4e-3), (name, figure)
    assert result.peak_force.mean == pytest.approx(fine.peak_force.mean, rel=1e-4)
    assert result.undetected_probability == pytest.approx(fine.undetected_probability, abs=5e-4)


def test_a_point_that_stands_still_meets_nobody(tmp_path: Path) -> None:
    gantry(tmp_path)
    t = np.linspace(0, 1, 101)
    way = np.clip(t - 0.5, 0, None) * 0.1
    rates = np.where(t[:, None] >= 0.5, 0.1, 0.0) * [0, 0, -1.0]
    write_csv(tmp_path / "path.csv", t, way[:, None] * [0, 0, -1.0], rates)
    result = bs.evaluate(scenario(tmp_path, trajectory_motion()))
    assert isinstance(result, TrajectoryCollisionResult)
    assert result.times.still == pytest.approx(0.49, abs=0.015)
    # No node is wasted on it: 250 periods of four, and some more where the motion begins.
    assert result.times.begin.size <= 4 * 265
    assert any("ends while the arm still moves" in note for note in result.notes)
    (note,) = [note for note in result.notes if "does not move toward a body" in note]
    assert f"In {100 * result.times.still:.3g} % of the time" in note
    assert (bs.evaluate(result.scenario, samples=500).runs or {})["onset"].min() > 0.485


@pytest.mark.parametrize("contact_onset_s", ["uniform", 0.11])
def test_quantiles_and_tails_belong_together(contact_onset_s: float | str, tmp_path: Path) -> None:
    t, q = waves(3, 0.24, rows=12, size=0.25)
    write_csv(tmp_path / "path.csv", t, q)
    result = bs.evaluate(scenario(tmp_path, trajectory_motion(contact_onset_s=contact_onset_s), robot="sia5d"))
    for quantity in (result.peak_force, result.pressure, result.force_at_detection, result.detection_delay):
        for p in (1e-9, 0.01, 0.3, 0.5, 0.77, 0.95, 0.999, 1 - 1e-7):
            x = quantity.quantile(p)
            if not math.isfinite(x):
                assert result.undetected_probability > 1 - p
                continue
            assert quantity.exceedance(x) <= (1 - p) * (1 + 1e-6)
            if x > 0:
                assert quantity.exceedance(x * (1 - 1e-6)) >= (1 - p) * (1 - 1e-3) - 1e-6
        edges = np.linspace(0, quantity.quantile(0.5) * 3, 60)
        mass = float((quantity.density(edges) * np.diff(edges)).sum())
        assert mass == pytest.approx(quantity.exceedance(0.0) - quantity.exceedance(edges[-1]), abs=1e-12)


def there_and_back(folder: Path, duration: float = 0.5, way: float = 0.02) -> None:
    """Down and up again along z, fastest at both ends; turns in the middle."""
    gantry(folder)
    t = np.linspace(0, duration, 60)
    z = -way * np.sin(math.pi * t / duration)
    write_csv(folder / "path.csv", t, z[:, None] * [0, 0, 1.0])


def test_an_alarm_after_the_point_turned_back_is_a_detection(tmp_path: Path) -> None:
    there_and_back(tmp_path)
    begin, threshold, sd = 0.1013, 20.0, 6.0
    path = scenario(
        tmp_path,
        trajectory_motion(contact_onset_s=begin),
        contact={"stiffness_N_m": 100},  # hardly detected: most alarms come by themselves, later than contact
        detector={"thresholds_Nm": [threshold] * 3, "noise_sd_Nm": sd},
    )
    exact, drawn = bs.evaluate(path), bs.evaluate(path, samples=20_000, seed=3)
    assert isinstance(exact, TrajectoryCollisionResult)
    quiet = (1 - math.erfc(threshold / sd / math.sqrt(2))) ** 3
    before = int((exact.curve.tick_time <= begin).sum())
    assert exact.curve.tick_distance[exact.curve.tick_time > 0.5 - begin + 0.01].max() < 0, "the body is behind"
    assert exact.false_alarm_probability == pytest.approx(1 - quiet**before, rel=1e-9)
    error = math.sqrt(exact.false_alarm_probability / 20_000)
    assert drawn.false_alarm_probability == pytest.approx(exact.false_alarm_probability, abs=4 * error)
    assert drawn.runs is not None
    late = drawn.runs["detected_after_contact"] & (drawn.runs["force_at_detection"] == 0)
    assert late.mean() > 0.03
    # What was detected is detected by some joint, and no probability is lost.
    assert exact.trigger_joint_probability.sum() - exact.multi_joint_probability == pytest.approx(1, abs=0.02)
    assert exact.force_at_detection.exceedance(0.0) == pytest.approx(
        (drawn.force_at_detection.values > 0).mean(), abs=0.02
    )
    compare(path, 20_000, seed=4)


def test_contact_begins_only_while_the_point_moves_toward_the_body(tmp_path: Path) -> None:
    there_and_back(tmp_path, duration=0.1357)
    result = bs.evaluate(scenario(tmp_path, trajectory_motion(), contact__normal=[0, 0, -1], detector__noise_sd_Nm=5.0))
    assert isinstance(result, TrajectoryCollisionResult)
    assert result.times.still == pytest.approx(0.5, abs=1e-6), "it turns in the middle"
    drawn = bs.evaluate(result.scenario, samples=4000, seed=2)
    assert drawn.runs is not None
    assert drawn.runs["onset"].max() < 0.1357 / 2
    assert drawn.runs["onset"].max() > 0.1357 / 2 * 0.998


def test_where_a_slow_point_turns_round(tmp_path: Path) -> None:
    """Within some milliseconds the normal turns from -z to z by way of x, and only there the first slide feels much."""
    gantry(tmp_path)
    t = np.linspace(0, 0.4, 3)
    way = np.column_stack([3e-4 * t, 0 * t, 0.1 * (t - 0.2021) ** 2])
    rate = np.column_stack([3e-4 + 0 * t, 0 * t, 0.2 * (t - 0.2021)])
    write_csv(tmp_path / "path.csv", t, way, rate)
    path = scenario(
        tmp_path,
        trajectory_motion(),
        contact={"stiffness_N_m": 500_000},
        detector={"thresholds_Nm": [10.0, 10.0, 200.0], "noise_sd_Nm": 1.5},
    )
    result, fine = (bs.evaluate(path, refinement=n) for n in (1, 8))
    assert 1e-3 < fine.trigger_joint_probability[0] < 0.2, "seldom, so that few nodes may all miss it"
    assert result.trigger_joint_probability[0] == pytest.approx(fine.trigger_joint_probability[0], rel=5e-3)


def test_nodes_go_where_the_residual_grows(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also of a motion whose periods alone take most of the nodes there may be."""
    gantry(tmp_path)
    t = np.linspace(0, 1, 200)
    write_csv(tmp_path / "path.csv", t, (0.05 * t**12)[:, None] * [0, 0, -1.0], (0.6 * t**11)[:, None] * [0, 0, -1.0])
    problem = bs.CollisionProblem.from_scenario(scenario(tmp_path, trajectory_motion(), detector__noise_sd_Nm=0.2))
    plenty = onset.onset_quadrature(problem).begin.size
    monkeypatch.setattr(onset, "_MAX_NODES", 1500)
    times = onset.onset_quadrature(problem)
    assert plenty > 3000
    assert 1300 < times.begin.size <= 1500
    width = times.high[3::4] - times.low[::4]
    assert width[-2] < 0.7 * width[1] == pytest.approx(0.7 * 0.004)


@pytest.mark.parametrize("normal", [None, [0, 0, 1]])
def test_a_recording_that_trembles_needs_no_more_nodes_than_it_is_worth(
    normal: list[float] | None, tmp_path: Path
) -> None:
    gantry(tmp_path)
    t = np.arange(0, 4, 0.001)
    way = 1e-6 * np.random.default_rng(4).normal(size=(t.size, 3))
    way[:, 2] += 0.01 * np.clip(t - 3.5, 0, None) ** 2
    write_csv(tmp_path / "path.csv", t, way)
    contact = {"stiffness_N_m": 20000} | ({"normal": normal} if normal else {})
    problem = bs.CollisionProblem.from_scenario(scenario(tmp_path, trajectory_motion(), contact=contact))
    times = onset.onset_quadrature(problem)
    assert times.begin.size < 4 * (3 * 1000 + 2000)


def test_many_contact_times_take_turns(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    t, q = waves(3, 0.24, rows=12, size=0.25)
    write_csv(tmp_path / "path.csv", t, q)
    path = scenario(tmp_path, trajectory_motion(), robot="sia5d")
    together = bs.evaluate(path)
    monkeypatch.setattr(trajectory_evaluation, "_CONTACTS_AT_ONCE", 7)
    assert bs.evaluate(path).to_json() == together.to_json()
    assert isinstance(together, TrajectoryCollisionResult)
    monkeypatch.setattr(trajectory_evaluation, "_MAX_DETECTIONS", together.detections.tick.size)
    bs.evaluate(path)
    monkeypatch.setattr(trajectory_evaluation, "_MAX_DETECTIONS", together.detections.tick.size - 1)
    with pytest.raises(bs.InputError, match="stay undetected for so long") as refused:
        bs.evaluate(path)
    assert refused.value.field == "motion.file"
    assert bs.evaluate(path, samples=10).samples == 10
