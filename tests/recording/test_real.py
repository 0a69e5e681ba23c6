"""Recordings of real arms; skipped where they are absent."""

from __future__ import annotations

import numpy as np
import pytest

from bumpstop import InputError, Robot
from bumpstop.recording import Recording, limits_touched
from recording.cases import real


def test_tx40() -> None:
    ratio = np.diag([32.0, 32, 45, -48, 45, 32])
    ratio[5, 4] = 32
    six = list(range(1, 7))
    columns = {
        "time": {"rate_hz": 5000},
        "position": {"columns": six},
        "torque": {"columns": six, "side": "motor", "file": "curr_data.csv"},
        "coupling": {"ratio": ratio.tolist(), "offset_rad": [0, -np.pi / 2, np.pi / 2, 0, 0, 0]},
    }
    found = Recording.load(real("staubli_tx40/pos_read_data.csv"), columns=columns)
    assert found.q.shape == (45000, 6)
    assert found.rate_hz == pytest.approx(5000)
    np.testing.assert_allclose(found.q[0], 0, atol=1e-4)  # all motors stand where the joints are at zero
    assert found.tau is not None
    assert found.tau[0, 1] == pytest.approx(32 * -0.76036)
    assert found.tau[0, 4] == pytest.approx(45 * -0.0036467 + 32 * 0.016623)


def test_ur10() -> None:
    robot = Robot.load("ur10")
    found = Recording.load(real("ur10_ros2/ur10_exciting_trajectory.db3"), robot=robot)
    assert found.q.shape == (3441, 6)
    assert found.rate_hz == pytest.approx(125)
    assert found.tau is not None
    assert not any(count.any() for count in limits_touched(found, robot).values())
    # The speeds are those of the positions, but for how finely the clock divides them.
    assert found.qd is not None
    speed = np.gradient(found.q, found.t, axis=0)
    assert np.sqrt(np.mean((speed - found.qd) ** 2)) < 0.05


def test_panda() -> None:
    path = real("panda_ros2/panda_exciting_trajectory.db3")
    robot = Robot.load("panda")
    with pytest.raises(InputError, match="no joint is called 'panda_joint1'"):
        Recording.load(path, robot=robot)
    found = Recording.load(path, robot=robot, columns={"joint_names": [f"fer_joint{j}" for j in range(1, 8)]})
    assert found.q.shape == (727, 7)
    assert found.rate_hz == pytest.approx(30, rel=1e-3)


def test_kr300() -> None:
    columns = {
        "time": {"variable": "rec.time_cont"},
        "position": {"variable": "rec.act_pos_mot_deg", "unit": "deg", "axis": "rows"},
        "velocity": {"variable": "rec.act_vel_mot_deg_per_s", "unit": "deg/s", "axis": "rows"},
        "torque": {"variable": "rec.act_torque_abs_nm", "axis": "rows"},
    }
    found = Recording.load(real("kuka_kr300/run_a.mat"), columns=columns)
    assert found.q.shape == (2501, 6)
    assert found.rate_hz == pytest.approx(250)


def test_ur3e() -> None:
    pytest.importorskip("fastexcel")
    found = Recording.load(real("ur3e_rtde/fig9.xlsx"), robot=Robot.load("ur3e"))
    assert found.q.shape == (888, 6)
    assert found.rate_hz == pytest.approx(25, rel=1e-3)
    assert found.current is not None
    # Nothing touches the arm. Along the base's axes, as the file has them, these are 36, 32 and 2.6 N.
    assert found.wrench is not None
    assert found.wrench[:, :3].std(axis=0).max() < 1.5
    assert found.q_ref is not None
    # The controller's target and the encoder: the servo leaves a few mrad.
    assert 1e-4 < np.abs(found.q_ref - found.q).max() < 0.03
    assert found.report.rows_dropped == 0
