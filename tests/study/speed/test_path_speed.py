"""Trajectories slowed down to their limits, against the distributions of collisions that begin at single moments of
them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest
from scipy.interpolate import CubicHermiteSpline, CubicSpline

import bumpstop as bs
from bumpstop.collision import CollisionProblem, evaluate_batch
from bumpstop.collision.trajectory.trajectory_evaluation import integrate_trajectory
from bumpstop.study import run
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.speed.speed_limit import speed_limits
from bumpstop.study.speed.trajectory import path_speed as path_speed_module
from bumpstop.study.speed.trajectory.path_speed import min_between, sliding_min
from bumpstop.study.speed.trajectory.retiming import retime
from bumpstop.study.speed.trajectory.trajectory_speed_limits import TrajectorySpeedLimits
from bumpstop.study.speed.trajectory.trajectory_writing import write_csv
from study.speed_limit_cases import begin, few_rows, rows_of


def waves(seed: int, folder: Path) -> bs.Scenario:
    """A Panda that winds itself past places where it feels little; thresholds differ from joint to joint."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, 1, 25)
    size, phase, rate = rng.uniform(0.1, 0.5, 7), rng.uniform(0, 6, 7), rng.uniform(2, 5, 7)
    turns = size * (np.sin(rate * t[:, None] + phase) - np.sin(phase)) * np.sin(np.pi * t[:, None] / 2) ** 2
    q = np.radians([0, -20, 0, -120, 0, 110, 30]) + turns
    names = ",".join(["t", *(f"q_{j}" for j in range(1, 8))])
    np.savetxt(folder / "t.csv", np.column_stack([t, q]), delimiter=",", header=names, comments="", fmt="%.17g")
    return bs.Scenario.from_dict(
        {
            "robot": "panda",
            "motion": {"kind": "trajectory", "file": str(folder / "t.csv")},
            "contact": {"body": "upper_arm_elbow", "limits": "ts15066", "area_cm2": 4.0},
            "detector": {
                "thresholds_Nm": [13, 13, 10, 24, 22, 15, 9],
                "noise_sd_Nm": [1.5, 1.5, 1.2, 3, 2.7, 1.8, 1],
            },
            "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 4.5},
        }
    )


def slowed(study: TrajectorySpeedLimits, path_speed: Any, folder: Path) -> tuple[bs.Scenario, Any]:
    """The same scenario on the slowed trajectory, and when it passes the rows."""
    slow = retime(study.trajectory, path_speed, study.problem.robot.velocity, study.problem.joint_acceleration)
    write_csv(folder / "slow.csv", slow)
    return study.scenario.with_values({"motion.file": str(folder / "slow.csv")}), slow.time[slow.waypoint]


def worst_risk(scenario: bs.Scenario, moments: Any) -> float:
    """Of collisions that begin at these moments and are detected."""
    risks = []
    problem = CollisionProblem.from_scenario(scenario)  # once: to read the file takes as long as a distribution
    for moment in moments:
        own = scenario.with_values({"motion.contact_onset_s": float(moment)})
        result = integrate_trajectory(replace(problem, scenario=own), bs.evaluate)
        over = max(result.verdict.p_over_force or 0.0, result.verdict.p_over_pressure or 0.0)
        risks.append(over - result.undetected_probability)
    return max(risks)


def telling(rows: pl.DataFrame) -> Any:
    """Rows at which least is detected, and every twentieth: the first fault of this kind showed at the former."""
    least_detectable = np.argsort(rows["undetectable_N"].to_numpy())[-40:]
    chosen = np.union1d(least_detectable, np.arange(1, len(rows), 20))
    return chosen[(chosen > 0) & (chosen < len(rows) - 1)]


@pytest.mark.parametrize("seed", [62, 78, 197])
def test_an_arm_that_speeds_up_behind_a_place_where_it_feels_little_keeps_its_limit(seed: int, tmp_path: Path) -> None:
    study = TrajectorySpeedLimits(waves(seed, tmp_path))
    rows = rows_of(study)
    scenario, moments = slowed(study, study.path_speed(rows), tmp_path)
    assert worst_risk(scenario, moments[telling(rows)]) <= scenario.verdict.accepted_probability


def test_speeding_up_behind_such_a_place_is_told(tmp_path: Path) -> None:
    """Every row below its own limit is not enough."""
    study = TrajectorySpeedLimits(waves(78, tmp_path))
    rows = rows_of(study)
    own = np.minimum(1.0, 0.85 * rows["limit_mm_s"].to_numpy() / np.maximum(rows["speed_mm_s"].to_numpy(), 1e-3))
    beside = np.pad(own, 1, constant_values=1.0)
    scenario, moments = slowed(study, np.minimum(own, np.minimum(beside[:-2], beside[2:])), tmp_path)
    assert worst_risk(scenario, moments[telling(rows)]) > 0.05
    rows, summary = run(TrajectorySpeedLimits(scenario))
    assert (rows["speed_mm_s"] <= rows["limit_mm_s"]).all()
    assert not summary["acceptable"]


@pytest.mark.parametrize("count", [1, 2, 7, 100])
def test_least_of_ranges_is_that_of_slices(count: int) -> None:
    rng = np.random.default_rng(count)
    values = rng.normal(size=count)
    first, last = np.sort(rng.integers(0, count, (2, 60)), axis=0)
    wanted = [values[a : b + 1].min() for a, b in zip(first, last, strict=True)]
    assert np.array_equal(sliding_min(values, first, last), wanted)


def wander(seed: int, path: Path) -> tuple[TrajectorySpeedLimits, Any]:
    """The speed limits along a few random waypoints, and the cubics through them."""
    rng = np.random.default_rng(seed)
    count = int(rng.integers(3, 8))
    t = np.concatenate([[0.0], np.cumsum(rng.uniform(0.3, 1, count - 1))])
    q = begin() + np.cumsum(rng.normal(0, 0.12, (count, 7)), axis=0)
    qd = np.gradient(q, t, axis=0)
    qd[[0, -1]] = 0
    given = CubicHermiteSpline(t, q, qd) if seed % 3 else CubicSpline(t, q)
    return few_rows(path, t, q, qd if seed % 3 else None), given


def speed_limits_of_slowed(study: TrajectorySpeedLimits, rows: Any, path: Path) -> tuple[Any, TrajectorySpeedLimits]:
    """The slowed trajectory, and the speed limits along what was written of it."""
    slow = retime(
        study.trajectory, study.path_speed(rows), study.problem.robot.velocity, study.problem.joint_acceleration
    )
    write_csv(path, slow)
    return slow, TrajectorySpeedLimits(study.scenario.with_values({"motion.file": str(path)}))


@pytest.mark.parametrize("seed", [0, 1, 3, 4, 6, 9])
def test_slowed_between_few_waypoints_too(seed: int, tmp_path: Path) -> None:
    study, given = wander(seed, tmp_path / "few.csv")
    rows = rows_of(study)
    assert not (rows["limit_mm_s"] == 0).any()
    slow, again = speed_limits_of_slowed(study, rows, tmp_path / "slow.csv")
    # The waypoints of the file are among the rows, bit for bit, and all rows lie on the file's own path.
    assert all((slow.position == each).all(axis=1).any() for each in study.given.position)
    assert np.abs(slow.position - given(slow.path_time)).max() < 1e-12
    some = np.arange(0, len(again.trajectory.time), 16)
    speed = np.linalg.norm(again.tip_velocity[some], axis=1)
    found = speed_limits(again._line, again.trajectory.position[some], again.direction[some], np.full(some.size, 1.0))
    assert (speed <= found.speed).all()


@pytest.mark.parametrize("seed", [4, 41, 58])
def test_slowed_where_the_limit_has_a_corner_between_two_rows(seed: int, tmp_path: Path) -> None:
    """Integrated distributions of straight lines at 3000 moments, most of which no row was near."""
    study, _ = wander(seed, tmp_path / "few.csv")
    _, again = speed_limits_of_slowed(study, rows_of(study), tmp_path / "slow.csv")
    times = np.linspace(0, again.given.duration, 3001)[1:-1]
    velocity = again._tip(times)
    moves = np.linalg.norm(velocity, axis=1) > 2e-3
    limit = allowed_force(again._line_problem)
    laws = evaluate_batch(again._line, again.given.at(times[moves]), velocity[moves], limits_N=[limit])
    assert laws.exceedance.max() <= again.scenario.verdict.accepted_probability


def test_values_that_fall_from_both_sides_meet_in_a_corner() -> None:
    time = np.array([0.0, 0.5, 1.5, 2.0, 3.0])
    corner = 0.2 + 0.4 * np.abs(time - 1.2)
    # The corner itself where it is inside, the lower end elsewhere.
    assert min_between(time, corner) == pytest.approx([0.48, 0.2, 0.32, 0.52])
    # A smooth valley is undercut by little; a cliff by half of what it falls to at most.
    fine = np.linspace(0, 3, 31)
    assert 0.5 - 0.002 < min_between(fine, 0.5 + 0.1 * (fine - 1.15) ** 2).min() < 0.5
    assert min_between(time, np.array([1.0, 0.2, 0.1, 1.0, 1.0]))[1] == 0.05
    assert (min_between(time, np.ones(5)) == 1).all()
    assert min_between(time[:2], np.array([0.3, 0.7])) == 0.3


# Joints that make the arm singular where they are straight: the wrist of a UR, the elbow of an arm without offsets.
@pytest.mark.parametrize(
    ("robot", "pose_deg", "joint"),
    [("ur10e", [0, -80, -100, -90, 0, 0], 4), ("iiwa14", [10, 40, 20, 0, 30, 60, 0], 3)],
)
@pytest.mark.parametrize(("passes", "end"), [(True, 0.5), (False, -0.1)])
def test_a_trajectory_that_passes_a_singularity_goes_by_its_own_distribution_there(
    robot: str, pose_deg: list[float], joint: int, passes: bool, end: float, tmp_path: Path
) -> None:
    q = np.radians(np.tile(pose_deg, (2, 1)))
    q[:, joint] = [-0.7, end]
    q[:, 0] += [0, 0.1]
    study = joint_motion(robot, [0.0, 2.0], q, np.zeros_like(q), tmp_path / "t.csv")
    found = rows_of(study)
    singular = np.flatnonzero(found["limited_by"] == "singularity")
    angle = found[f"q_{joint + 1}"].to_numpy()
    last_before = int((angle < 0).sum()) - 1
    assert singular.tolist() == ([last_before, last_before + 1] if passes else [])
    if robot == "ur10e":  # some and none: a summary judges the motion and slows it down, which takes longest
        assert study.summary(found)["singular"] == singular.size
    for row in found[singular.tolist()].iter_rows(named=True):
        if row["limit_mm_s"] > 0:
            assert row["risk"] <= study.scenario.verdict.accepted_probability


def joint_motion(robot: str, t: Any, q: Any, qd: Any, path: Path, **changes: Any) -> TrajectorySpeedLimits:
    """The speed limits of a motion of an arm's joints against a finger."""
    dof = q.shape[1]
    rows = np.column_stack([t, q] if qd is None else [t, q, qd])
    names = ["t", *(f"{kind}_{j + 1}" for kind in ("q", "qd")[: 1 if qd is None else 2] for j in range(dof))]
    np.savetxt(path, rows, delimiter=",", header=",".join(names), comments="", fmt="%.17g")
    scenario = bs.Scenario.from_dict(
        {
            "robot": robot,
            "motion": {"kind": "trajectory", "file": str(path)},
            "contact": {"body": "hand_finger", "area_cm2": 2.0},
            "detector": {"thresholds_Nm": [8.0] * dof, "noise_sd_Nm": [0.5] * dof},
            "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 10.0},
        }
    )
    return TrajectorySpeedLimits(scenario.with_values(changes))


def test_an_arm_that_is_singular_all_the_way_has_limits_that_say_so(tmp_path: Path) -> None:
    """A UR that turns about its base with a straight wrist: no straight line of the tool can be followed anywhere."""
    t = np.linspace(0, 2, 21)
    share = (1 - np.cos(np.pi * t / 2)) / 2
    q = np.radians([0, -90, 60, 0, 0, 0]) + share[:, None] * np.radians([50, 0, 0, 0, 0, 0])
    changes = {"detector.thresholds_Nm": [15.0] * 6, "contact.body": "lower_arm_wrist"}
    study = joint_motion("ur10e", t, q, None, tmp_path / "t.csv", **changes)
    rows = rows_of(study)
    assert set(rows["limited_by"]) == {"singularity"}
    assert (rows["limit_mm_s"] > 0).all()
    scenario, moments = slowed(study, study.path_speed(rows), tmp_path)
    assert 2 < moments[-1] < 10
    # By the distribution of the slowed motion at single moments of it.
    assert worst_risk(scenario, moments[40:-200:60]) <= scenario.verdict.accepted_probability


@pytest.mark.parametrize(("ramp", "period", "with_rates"), [(0.02, 0.01, True), (0.02, 0.01, False), (0.1, 0.05, True)])
def test_a_motion_that_begins_and_pauses_at_rest_is_slowed_by_no_more_than_its_limits(
    ramp: float, period: float, with_rates: bool, tmp_path: Path
) -> None:
    """A standing arm has next to no speed to take a share of: its share once became a limit for all behind it."""
    move, pause = 1.5, 1.0
    t = np.arange(0, 2 * move + pause + period / 2, period)
    rate = 1 / (move - ramp)

    def along(s: Any) -> tuple[Any, Any]:
        s = np.clip(s, 0, move)
        up, down = 0.5 * rate / ramp * s**2, 1 - 0.5 * rate / ramp * (move - s) ** 2
        way = np.where(s < ramp, up, np.where(s < move - ramp, rate * (s - ramp / 2), down))
        return way, rate * np.clip(np.minimum(s, move - s) / ramp, 0, 1)

    (there, out), (back, home) = along(t), along(t - move - pause)
    turn = np.array([0.5, 0.1, 0, 0.2, 0, 0, 0])
    q = begin() + (there - back)[:, None] * turn
    study = few_rows(tmp_path / "t.csv", t, q, (out - home)[:, None] * turn if with_rates else None)
    study = TrajectorySpeedLimits(study.scenario.with_values({"contact.body": "hand_finger"}))
    rows = rows_of(study)
    path_speed = study.path_speed(rows)
    slow = retime(study.trajectory, path_speed, study.problem.robot.velocity, study.problem.joint_acceleration)
    # As long as at the lowest path speed that its limits ask for where it moves, and what the ramps take at 4.5 rad/s2.
    moves = rows["speed_mm_s"].to_numpy() > 5
    slowest = float((rows["limit_mm_s"].to_numpy()[moves] / rows["speed_mm_s"].to_numpy()[moves]).min())
    assert slow.time[-1] < 2 * move / (0.8 * min(1.0, slowest)) + pause + 1
    # The pause itself is no longer than before, but for its ends.
    still = (t > move + 0.1 * pause) & (t < move + 0.9 * pause)
    first, last = np.searchsorted(study.trajectory.time, t[still][[0, -1]])
    taken = slow.time[slow.waypoint][last] - slow.time[slow.waypoint][first]
    assert taken == pytest.approx(np.ptp(t[still]), rel=0.25)


def test_where_no_path_speed_is_safe_the_place_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A row before it that gets no speed for its sake has a limit of its own."""
    study = TrajectorySpeedLimits(waves(78, tmp_path))
    rows = rows_of(study).with_columns(pl.lit("joint_rates").alias("limited_by"))
    forces = np.where(np.arange(len(rows)) == len(rows) // 2, 1e6, 0.0)
    monkeypatch.setattr(path_speed_module, "undetected_force", lambda *given: forces)
    place = f"at {study.trajectory.time[len(rows) // 2]:.6g} s, where joints turn more than a line asks for"
    assert study.slowed(rows).why.startswith(place)
