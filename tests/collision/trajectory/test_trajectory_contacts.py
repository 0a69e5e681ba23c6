"""Contacts of joint trajectories other than clamped ones: free bodies, two phases, measured noise."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop.collision.trajectory.trajectory_curve import trajectory_kernel
from bumpstop.collision.trajectory.trajectory_result import TrajectoryCollisionResult
from collision.distribution.test_two_laws import compare
from collision.trajectory_cases import gantry, scenario, trajectory_motion, waves, write_csv

VELOCITY, DURATION, BEGIN = np.array([0.03, -0.02, -0.06]), 0.8, 0.2137
BODY = {"body": "lower_arm_wrist", "limits": "ts15066", "area_cm2": 2.0}


def straight(folder: Path, **changes: Any) -> tuple[bs.Scenario, bs.Scenario]:
    """The same straight motion as a line and as a trajectory."""
    gantry(folder)
    t = np.array([0.0, 0.3, DURATION])
    write_csv(folder / "path.csv", t, t[:, None] * VELOCITY)
    contact = changes.pop("contact")
    offset = {"offset_law": "fixed", "offset_mm": 1e3 * BEGIN * float(np.linalg.norm(VELOCITY))}
    motion = {"velocity_mm_s": [float(v) for v in 1e3 * VELOCITY], "task": "position", "duration_s": DURATION}
    line = scenario(folder, motion, pose_rad=[0.0, 0.0, 0.0], contact=contact | offset, **changes)
    return line, scenario(folder, trajectory_motion(contact_onset_s=BEGIN), contact=contact, **changes)


@pytest.mark.parametrize("free", [{}, {"kind": "free", "body_mass_kg": 0.6}])
def test_only_the_direction_of_a_normal_counts(free: dict[str, Any], tmp_path: Path) -> None:
    laws: list[list[bs.CollisionResult]] = []
    for length in (1.0, 7.0):
        contact = {"stiffness_N_m": 20000, "normal": [0, 0, -length], **free}
        line, path = straight(tmp_path, contact=contact)
        laws.append(
            [bs.evaluate(case) for case in (line, path, path.with_values({"motion.contact_onset_s": "uniform"}))]
        )
    for one, other in zip(*laws, strict=True):
        for name in ("peak_force", "force_at_detection"):
            for p in (0.05, 0.5, 0.999):
                expected = getattr(one, name).quantile(p)
                assert getattr(other, name).quantile(p) == pytest.approx(expected, rel=1e-12), name


@pytest.mark.parametrize("kind", ["stop", "reverse"])
@pytest.mark.parametrize(("mass", "latency"), [(0.6, 0.0), (30.0, 0.007)])
def test_a_free_body_beside_a_straight_trajectory(kind: str, mass: float, latency: float, tmp_path: Path) -> None:
    line, path = straight(
        tmp_path,
        contact={"stiffness_N_m": 20000, "kind": "free", "body_mass_kg": mass},
        reaction={"kind": kind, "joint_acceleration_rad_s2": [2.0, 1.0, 1.5], "latency_s": latency},
        detector__noise_sd_Nm=6.0,
    )
    expected, found = bs.evaluate(line), bs.evaluate(path)
    assert expected.false_alarm_probability > 1e-3
    for name in ("peak_force", "force_at_detection", "detection_delay", "contact_duration"):
        ours, theirs = getattr(found, name), getattr(expected, name)
        assert ours.mean == pytest.approx(theirs.mean, rel=1e-7), name
        assert ours.sd == pytest.approx(theirs.sd, rel=1e-6, abs=1e-9), name
        for p in (0.05, 0.5, 0.95):
            assert ours.quantile(p) == pytest.approx(theirs.quantile(p), rel=1e-7, abs=1e-9), name
    assert found.undetected_probability == pytest.approx(expected.undetected_probability, rel=1e-9)
    assert found.impact_bounds is not None
    assert expected.impact_bounds is not None
    assert found.impact_bounds.position_driven == pytest.approx(expected.impact_bounds.position_driven, rel=1e-9)
    # Single runs too: noise depends on the run alone, not on the kind of the motion.
    drawn, runs = (bs.evaluate(one, samples=300, seed=4).runs for one in (path, line))
    assert drawn is not None
    assert runs is not None
    np.testing.assert_array_equal(drawn["tick"], runs["tick"])
    np.testing.assert_allclose(drawn["peak_force"], runs["peak_force"], rtol=1e-7, atol=1e-6)


@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_exact_and_sampled_agree_on_free_bodies(kind: str, tmp_path: Path) -> None:
    t, q = waves(31, 0.5, rows=12, size=0.2)
    write_csv(tmp_path / "path.csv", t, q)
    compare(
        scenario(
            tmp_path,
            trajectory_motion(),
            robot="sia5d",
            contact={"stiffness_N_m": 25000, "kind": "free", "body_mass_kg": 8.0},
            detector={"thresholds_Nm": [16.0, 12, 16, 12, 9, 9, 5], "noise_sd_Nm": 3.0},
            reaction={"kind": kind, "joint_acceleration_rad_s2": 6.0, "latency_s": 0.004},
        ),
        4_000,
        seed=6,
    )


@pytest.mark.parametrize(("begin", "duration"), [(0.005, 0.6), (0.05, 0.6)])
def test_an_arm_that_speeds_up_keeps_pushing(begin: float, duration: float, tmp_path: Path) -> None:
    """Along s = jerk t^3 / 6 a body struck slowly is pushed to the end: its own oscillation lasts a tenth of that."""
    gantry(tmp_path, speed=2.0)
    jerk, stiffness, mass = 8.0, 25_000.0, 5.0
    t = np.linspace(0, duration, 2)
    unit = np.array([0, 0, -1.0])
    write_csv(tmp_path / "path.csv", t, (jerk * t**3 / 6)[:, None] * unit, (jerk * t**2 / 2)[:, None] * unit)
    result = bs.evaluate(
        scenario(
            tmp_path,
            trajectory_motion(contact_onset_s=begin),
            contact={"stiffness_N_m": stiffness, "kind": "free", "body_mass_kg": mass},
            detector={"thresholds_Nm": [1e6] * 3, "noise_sd_Nm": 1.0},
        )
    )
    # m x'' = K y and s = x + y: y'' + w^2 y = s'', from rest of the body and the arm's speed at contact.
    w, since = math.sqrt(stiffness / mass), np.linspace(0, duration - begin, 20_001)
    y = (
        jerk * begin**2 / 2 / w * np.sin(w * since)
        + jerk * begin / w**2 * (1 - np.cos(w * since))
        + jerk / w**2 * (since - np.sin(w * since) / w)
    )
    assert y[1:].min() > 0, "they never part on the way"
    assert math.pi / w < 0.1 * duration
    assert result.undetected_probability == pytest.approx(1)
    chords = (w * 1e-3) ** 2 / 10  # between steps of a millisecond the arm goes straight
    assert result.peak_force.mean == pytest.approx(stiffness * y.max(), rel=chords)
    assert result.contact_duration is not None
    assert duration - begin < result.contact_duration.mean < duration - begin + math.pi / w


def test_a_body_touched_between_two_ticks_alone(tmp_path: Path) -> None:
    """Thrown up against it, z = v t - a t^2 / 2: the arm turns back before the next tick."""
    gantry(tmp_path)
    speed, brake, begin, turn = 0.01, 2.0, 0.051, 0.056
    t = np.linspace(0, 0.2, 3)
    way, rate = -brake / 2 * (t - turn) ** 2, -brake * (t - turn)
    unit = np.array([0, 0, 1.0])
    write_csv(tmp_path / "path.csv", t, way[:, None] * unit, rate[:, None] * unit)
    assert rate[0] - brake * begin == pytest.approx(speed)
    stiffness, mass = 40_000.0, 0.4
    path = scenario(
        tmp_path,
        trajectory_motion(contact_onset_s=begin),
        contact={"stiffness_N_m": stiffness, "kind": "free", "body_mass_kg": mass, "normal": [0, 0, 1]},
        detector={"thresholds_Nm": [1e6] * 3, "noise_sd_Nm": 1.0, "feedback_period_s": 0.05},
        simulation={"step_s": 1e-4},
    )
    result, drawn = bs.evaluate(path), bs.evaluate(path, samples=3)
    assert (result.curve.tick_distance <= 0).all()
    assert result.undetected_probability == drawn.undetected_probability == 1
    # y'' + w^2 y = -brake until they part.
    w = math.sqrt(stiffness / mass)
    deepest = math.hypot(speed / w, brake / w**2) - brake / w**2
    for found in (result, drawn):
        assert found.peak_force.mean == pytest.approx(stiffness * deepest, rel=1e-3)
        assert found.contact_duration is not None
        assert found.contact_duration.mean == pytest.approx(2 / w * math.atan(speed * w / brake), rel=1e-2)


def test_two_phases_beside_a_straight_trajectory(tmp_path: Path) -> None:
    for kind, noise in (("stop", 4.0), ("reverse", 6.0)):
        line, path = straight(
            tmp_path,
            contact=BODY | {"area_cm2": 0.3},
            reaction={"kind": kind, "joint_acceleration_rad_s2": [2.0, 1.0, 1.5]},
            detector__noise_sd_Nm=noise,
            verdict={"clamped_limit": "two_phase"},
        )
        expected, found = bs.evaluate(line).verdict, bs.evaluate(path).verdict
        assert found.p_over_force == pytest.approx(expected.p_over_force, rel=1e-6, abs=1e-9)
        assert found.p_over_pressure == pytest.approx(expected.p_over_pressure, rel=1e-6, abs=1e-9)


@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_two_phases_of_a_damped_body_beside_a_straight_trajectory(kind: str, tmp_path: Path) -> None:
    line, path = straight(
        tmp_path,
        contact=BODY | {"area_cm2": 0.3, "damping_Ns_m": 300.0},
        reaction={"kind": kind, "joint_acceleration_rad_s2": [0.2, 0.1, 0.12]},
        detector__noise_sd_Nm=6.0,
        verdict={"clamped_limit": "two_phase"},
    )
    expected, found = bs.evaluate(line), bs.evaluate(path)
    for name in ("p_over_force", "p_over_pressure"):
        wanted = getattr(expected.verdict, name)
        assert getattr(found.verdict, name) == pytest.approx(wanted, rel=1e-4, abs=1e-7), name
    for first, later in ((0.005, 0.01), (1e-9, 0.01)):
        ours, theirs = (result.phase_shares(first, later)[0] for result in (expected, found))
        for p in (0.1, 0.5, 0.9):
            assert theirs.quantile(p) == pytest.approx(ours.quantile(p), rel=1e-3, abs=1e-6), (first, p)


@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_two_phases_of_an_elastic_arm_along_a_trajectory(kind: str, tmp_path: Path) -> None:
    t = np.linspace(0.0, 0.9, 10)
    forward = 0.5 * (t / t[-1]) ** 2 * (3 - 2 * t / t[-1])
    q = np.radians([0.0, -60, 90, -120, -90, 0]) + np.outer(forward, [0.2, 0.4, -0.3, 0.1, 0.1, 0.0])
    write_csv(tmp_path / "path.csv", t, q)
    case = bs.Scenario.from_dict(
        {
            "robot": "ur10e",
            "motion": trajectory_motion(),
            "contact": BODY,
            "arm": {"model": "elastic"},
            "detector": {"thresholds_Nm": [40, 40, 30, 12, 12, 12], "noise_sd_Nm": [7, 7, 5, 2, 2, 2]},
            "reaction": {"kind": kind, "joint_acceleration_rad_s2": 1.5, "latency_s": 0.02},
            "verdict": {"clamped_limit": "two_phase"},
        },
        tmp_path,
    )
    runs = 5000
    integrated, drawn = bs.evaluate(case), bs.evaluate(case, samples=runs, seed=5)
    for name in ("p_over_force", "p_over_pressure"):
        own, sampled = (getattr(each.verdict, name) for each in (integrated, drawn))
        assert sampled == pytest.approx(own, abs=4 * math.sqrt(own * (1 - own) / runs) + 2e-3), name
    for first, later in ((0.005, 0.01), (1e-9, 0.01)):
        ours, theirs = (each.phase_shares(first, later)[0] for each in (integrated, drawn))
        for q_of in (0.3, 0.6, 0.9):
            share = ours.quantile(q_of)
            wide = 4 * math.sqrt(q_of * (1 - q_of) / runs) + 3e-3
            assert theirs.exceedance(share * 1.001) - wide <= 1 - q_of <= theirs.exceedance(share * 0.999) + wide
    # What lasts is less than the peak where the arm goes back, and counts twice as much.
    assert integrated.phase_shares(1e-9, 1.0)[0].quantile(0.6) < integrated.peak_force.quantile(0.6)
    assert (
        integrated.verdict.p_over_force
        != bs.evaluate(case.with_values({"verdict.clamped_limit": "quasi_static"})).verdict.p_over_force
    )


def test_phases_are_read_off_the_force_over_time(tmp_path: Path) -> None:
    t, q = waves(32, 1.4, rows=20, size=0.2)
    write_csv(tmp_path / "path.csv", t, q)
    result = bs.evaluate(
        scenario(
            tmp_path,
            trajectory_motion(),
            robot="sia5d",
            contact=BODY,
            detector={"thresholds_Nm": [16.0, 12, 16, 12, 9, 9, 5], "noise_sd_Nm": 3.6},
            reaction={"kind": "stop", "joint_acceleration_rad_s2": 2.0, "latency_s": 0.3},
            verdict={"clamped_limit": "two_phase"},
        ),
        samples=200,
        seed=1,
    )
    assert isinstance(result, TrajectoryCollisionResult)
    later = 0
    for begin in (0.55, 0.9):
        curve, first = result.curve_at(begin), int(begin / 0.004)
        for tick in range(first - 110, first + 50, 3):
            (deepest,) = result.kernel.phases([tick], np.array([begin]), curve.normal[None], 0.05)
            reacts = tick * result.problem.period_steps + 1 + result.problem.latency_steps
            distance = np.concatenate([curve.distance[:reacts], curve.kernel.reaction_paths([tick], [0.0])[0]])
            place = np.concatenate([np.arange(reacts) * 1e-3, result.kernel.reaction(tick)])  # along the path [s]
            i = int(np.argmax(place > begin))
            if i == 0:
                assert (deepest == 0).all(), "it stops before"
                continue
            touch = i - 1 + (begin - place[i - 1]) / (place[i] - place[i - 1])
            later += touch * 1e-3 > begin + 1e-3
            turn = math.ceil(touch + 50 - 1e-6)
            at_end = np.interp(touch + 50, np.arange(len(distance)), distance)
            early = max(distance[:turn].max(initial=0.0), at_end)
            late = max(distance[turn:].max(initial=0.0), distance[-1], at_end, 0.0)
            np.testing.assert_allclose(deepest, [early, late], rtol=0, atol=1e-12)
    assert later > 3, "an arm that brakes before contact meets it later"
    assert result.verdict.p_over_force is not None


def test_measured_noise_beside_a_straight_trajectory(tmp_path: Path) -> None:
    rng = np.random.default_rng(3)
    rows = rng.normal(scale=5.0, size=(4000, 3))
    frame = {"t": np.arange(4000) * 0.004} | {f"residual_{j + 1}": rows[:, j] for j in range(3)}
    pl.DataFrame(frame).write_parquet(tmp_path / "free.parquet")
    line, path = straight(
        tmp_path,
        contact={"stiffness_N_m": 20000},
        detector={"thresholds_Nm": [20.0] * 3, "residuals": "free.parquet"},
    )
    runs, drawn = (bs.evaluate(one, samples=2000, seed=9).runs for one in (line, path))
    assert runs is not None
    assert drawn is not None
    np.testing.assert_array_equal(drawn["tick"], runs["tick"])
    np.testing.assert_allclose(drawn["residual"], runs["residual"], atol=1e-7)
    np.testing.assert_allclose(drawn["peak_force"], runs["peak_force"], atol=1e-6)


def test_two_masses_are_refused(tmp_path: Path) -> None:
    gantry(tmp_path)
    contact = {"stiffness_N_m": 20000, "kind": "free", "body_mass_kg": 2.0, "arm": "two_mass"}
    with pytest.raises(bs.InputError, match=r"'two_mass' is not available with motion\.kind") as refused:
        scenario(tmp_path, trajectory_motion(), contact=contact)
    assert refused.value.field == "contact.arm"


def test_a_place_passed_before_contact_does_not_touch_a_free_body(tmp_path: Path) -> None:
    """Down, up and down again: the body stands there from the third leg on."""
    gantry(tmp_path)
    t = np.linspace(0, 0.6, 80)
    write_csv(tmp_path / "path.csv", t, (0.02 * np.sin(5 * math.pi * t))[:, None] * [0, 0, -1.0])
    threshold, sd = 20.0, 6.0
    quiet = (1 - math.erfc(threshold / sd / math.sqrt(2))) ** 3
    for begin in np.arange(0.4, 0.48, 0.0013):
        path = scenario(
            tmp_path,
            trajectory_motion(contact_onset_s=float(begin)),
            contact={"stiffness_N_m": 3000, "kind": "free", "body_mass_kg": 0.3, "normal": [0, 0, -1]},
            detector={"thresholds_Nm": [threshold] * 3, "noise_sd_Nm": sd},
        )
        result = bs.evaluate(path)
        before = int((result.curve.tick_time <= begin).sum())
        assert result.false_alarm_probability == pytest.approx(1 - quiet**before, rel=1e-9)
        assert result.no_contact_probability == 0
        assert result.undetected_probability > 0.3
        assert result.contact_duration is not None
        assert result.contact_duration.mean > 0.01, "about half an oscillation"


def test_a_reversing_arm_is_where_its_path_is(tmp_path: Path) -> None:
    """All the way back, between the points of simulation steps: by the robot's own kinematics along the spline."""
    t, q = waves(3, 2.0)
    write_csv(tmp_path / "path.csv", t, q)
    reaction = {"kind": "reverse", "joint_acceleration_rad_s2": 5.0}
    given = scenario(tmp_path, trajectory_motion(contact_onset_s=0.4), robot="sia5d", reaction=reaction)
    problem = bs.CollisionProblem.from_scenario(given)
    kernel, path, normal = trajectory_kernel(problem), problem.trajectory, np.array([0.6, 0.0, -0.8])
    assert path is not None
    origin = problem.robot.pose(path.at(0.4))[:3, 3]
    for tick in (110, 160, 190):
        distance, forward = kernel.reaction_distances(tick, 0.4, normal), kernel.reaction(tick)
        back = forward[-1] - 1e-3 * np.arange(1, len(distance) - len(forward) + 1)
        assert back[-1] <= 0.4
        place = np.concatenate([forward, back])
        along = (problem.robot.pose(path.at(place))[:, :3, 3] - origin) @ normal
        after = place > 0.4
        np.testing.assert_allclose(distance[after], along[after], rtol=0, atol=1e-8)
