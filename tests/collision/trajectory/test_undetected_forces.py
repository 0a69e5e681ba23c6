"""What drives press with on a trajectory that nothing stops."""

from __future__ import annotations

import contextlib
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.trajectory.undetected import undetected_forces
from bumpstop.study.speed.trajectory.onset_shares import onset_shares
from collision.trajectory_cases import trajectory_motion, write_csv

POSE = np.radians([0.0, -60, 90, -120, -90, 0])
BODY = {"body": "thigh_knee", "limits": "ts15066", "area_cm2": 10.0}
# Wrists that hold little more than themselves, and the torques of motors before their gears.
WEAK, MOTORS = [330.0, 330.0, 150.0, 4.0, 4.0, 4.0], [3.3, 3.3, 1.5, 0.56, 0.56, 0.56]


def forth(folder: Path, *, rows: int = 31, onset: float | str = "uniform", **changes: dict[str, Any]) -> bs.Scenario:
    """An elastic arm that feels nothing on a motion from rest to rest, or on its first rows."""
    t = np.linspace(0.0, 1.5, 31)
    share = (t / t[-1]) ** 2 * (3 - 2 * t / t[-1])
    q = POSE + np.outer(share, [0.2, 0.4, -0.3, 0.1, 0.1, 0.0])
    write_csv(folder / "path.csv", t[:rows], q[:rows])
    data: dict[str, Any] = {
        "robot": "ur10e",
        "motion": trajectory_motion(contact_onset_s=onset),
        "contact": BODY,
        "arm": {"model": "elastic"},
        "detector": {"thresholds_Nm": [1e4] * 6, "noise_sd_Nm": 3.0},
        "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 5.0},
    }
    return bs.Scenario.from_dict({key: value | changes.get(key, {}) if isinstance(value, dict) else value
                                  for key, value in data.items()}, folder)  # fmt: skip


@contextlib.contextmanager
def unknown_drives() -> Iterator[None]:
    """Built-in arms of which elastic ones can be had all have known torque limits."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bumpstop.collision.trajectory.undetected.knows_torque_limits", lambda problem: False)
        yield


def test_a_line_and_its_trajectory_are_pressed_alike(tmp_path: Path) -> None:
    motion = {"velocity_mm_s": [0, 0, -20.0], "duration_s": 0.3}
    line = forth(tmp_path).to_dict() | {"pose_deg": np.degrees(POSE).tolist(), "motion": motion}
    line["contact"] = BODY | {"offset_law": "fixed", "offset_mm": 0.0}
    wanted = bs.evaluate(bs.Scenario.from_dict(line)).pressing_limit
    assert wanted is not None
    robot, t = bs.Robot.load("ur10e"), np.linspace(0.0, 0.3, 31)
    rates = np.linalg.pinv(robot.jacobian(POSE)) @ [0, 0, -0.02, 0, 0, 0]
    case = forth(tmp_path, onset=0.0)
    write_csv(tmp_path / "path.csv", t, POSE + t[:, None] * rates)
    found = bs.evaluate(case).pressing_limit
    assert found is not None
    assert found.joint == wanted.joint
    assert found.static_force == pytest.approx(wanted.static_force, rel=0.01)
    assert found.peak_force == pytest.approx(wanted.peak_force, rel=0.01)


@pytest.mark.parametrize("samples", [None, 400])
def test_drives_bound_what_a_path_would_give(samples: int | None, tmp_path: Path) -> None:
    strong = bs.evaluate(forth(tmp_path, arm={"torque_limit_Nm": 1e5}), samples=samples)
    weak = bs.evaluate(forth(tmp_path, arm={"torque_limit_Nm": WEAK}), samples=samples)
    assert strong.undetected_probability == weak.undetected_probability == pytest.approx(1.0)
    assert strong.pressing_limit is not None
    assert weak.pressing_limit is not None
    # The force of the path alone is as without any limit.
    with unknown_drives():
        unknown = bs.evaluate(forth(tmp_path), samples=samples)
    assert unknown.pressing_limit is None
    greatest = unknown.peak_force.quantile(0.999)
    assert strong.peak_force.quantile(0.999) == greatest
    # Limits that cannot hold the arm bound nothing.
    light = bs.evaluate(forth(tmp_path, arm={"torque_limit_Nm": MOTORS}), samples=samples)
    assert light.pressing_limit is None
    assert light.peak_force.quantile(0.999) == greatest
    assert any("cannot hold its own weight" in warning for warning in light.warnings)
    limit = weak.pressing_limit.peak_force
    assert limit < 0.8 * greatest
    assert weak.peak_force.quantile(0.999) <= limit
    assert 0 < weak.peak_force.exceedance(0.9 * limit) < strong.peak_force.exceedance(0.9 * limit)
    assert weak.undetected_over(0.9 * limit) == pytest.approx(weak.peak_force.exceedance(0.9 * limit), abs=1e-9)
    assert any("drives press with" in note for note in weak.notes)


@pytest.mark.parametrize("samples", [None, 400])
def test_an_arm_that_moves_on_at_the_end_presses_with_all_it_has(samples: int | None, tmp_path: Path) -> None:
    known = bs.evaluate(forth(tmp_path, rows=18, arm={"torque_limit_Nm": 200.0}), samples=samples)
    with unknown_drives():
        unknown = bs.evaluate(forth(tmp_path, rows=18), samples=samples)
    assert unknown.unbounded_because is not None
    assert math.isinf(unknown.peak_force.quantile(0.999))
    assert known.unbounded_because is None
    assert known.pressing_limit is not None
    assert known.peak_force.quantile(1 - 1e-9) == pytest.approx(known.pressing_limit.peak_force, rel=0.01)
    # At the end of the file the path has hardly touched the body, and the arm presses all the same.
    assert known.peak_force.quantile(1e-3) > 0.5 * known.pressing_limit.peak_force
    median = known.peak_force.quantile(0.5)
    assert known.undetected_over(median) == pytest.approx(known.peak_force.exceedance(median), abs=1e-9)
    assert "not detected" not in known.verdict.reason


def test_it_is_the_greatest_of_the_poses_in_contact(tmp_path: Path) -> None:
    """Pose by pose with NumPy alone."""
    case = forth(tmp_path)
    problem = bs.CollisionProblem.from_scenario(case)
    trajectory, robot = problem.trajectory, problem.robot
    assert trajectory is not None
    for begin in (0.2, 0.9, 1.45):
        velocity = robot.jacobian(trajectory.at(begin))[:3] @ trajectory.at(begin, 1)
        normal = velocity / np.linalg.norm(velocity)
        forces = []
        for t in np.linspace(begin, trajectory.duration, 700):
            q, qd = trajectory.at(t), trajectory.at(t, 1)
            beyond = (robot.pose(q)[:3, 3] - robot.pose(trajectory.at(begin))[:3, 3]) @ normal
            if t > begin and not beyond > 0:
                continue
            lever = np.abs(normal @ robot.jacobian(q)[:3])
            held = problem.drive_train.torque_limit + np.abs(bs.model.gravity_torque(robot, q))
            static = (held / np.maximum(lever, 1e-300)).min()
            inertia = bs.model.mass_matrix(robot, q) + np.diag(problem.drive_train.rotor_inertia)
            forces.append(static + math.sqrt(static**2 + qd @ inertia @ qd * problem.stiffness))
        found = undetected_forces(problem, np.array([begin]), normal[None])
        assert found.most[0] == pytest.approx(max(forces), rel=1e-3)


@pytest.mark.parametrize("rows", [31, 18])
def test_speed_limits_count_it(rows: int, tmp_path: Path) -> None:
    begin, found = 0.6, []
    for torque in (WEAK, 200.0, MOTORS):
        case = forth(tmp_path, rows=rows, onset=begin, arm={"torque_limit_Nm": torque})
        problem = bs.CollisionProblem.from_scenario(case)
        assert problem.limits is not None
        share = onset_shares(problem, np.array([begin])).exceeded_with(0.5)[0]
        expected = bs.evaluate(case).peak_force.quantile(0.5) / problem.limits.allowed_force_N(10.0)
        assert share == pytest.approx(expected, rel=1e-6)
        found.append(share)
    assert found[0] < 0.9 * found[1]
    # Where the arm moves on, limits that cannot hold it leave no bound.
    assert math.isinf(found[2]) is (rows == 18)
