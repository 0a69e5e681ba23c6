"""Faults planted into sound recordings: garbage goes, contradictions are told, the rest stays."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop import InputError, Robot
from bumpstop.recording import Recording
from cli.support import run
from recording.cases import real

ARM = Robot.load("ur5e")
ROWS = 2000


def sound(rate: float = 125.0, rows: int = ROWS) -> Recording:
    """An arm in motion, with rests, and everything measured; clocks and encoders are none of the best."""
    rng = np.random.default_rng(3)
    t = np.arange(rows) / rate + rng.uniform(-0.1, 0.1, rows) / rate
    u = t - 0.35 * np.sin(2 * np.pi * t / 4) * 4 / (2 * np.pi)
    frequency, phase = 0.6 + 0.15 * np.arange(6), np.arange(6)
    q = 0.8 * np.sin(u[:, None] * frequency + phase) + np.array([0.1, -1.2, 1.3, -0.6, 0.4, 0.2])
    qd = np.gradient(q, t, axis=0)
    current = 2 * np.cos(q) + 0.5 * np.sign(qd) + 0.05 * rng.normal(size=q.shape)
    return Recording(
        t=t, q=q + 1e-5 * rng.normal(size=q.shape), qd=qd + 1e-3 * rng.normal(size=q.shape), current=current
    )


def read(log: Recording, folder: Path, robot: Robot | None = ARM, **changes: Any) -> Recording:
    """What is read back from a file with some of its columns replaced."""
    table = {"t": log.t, "q": log.q, "qd": log.qd, "current": log.current} | changes
    names, columns = [], []
    for stem, value in table.items():
        if value is None:
            continue
        columns.append(value.reshape(log.t.size, -1))
        names += ["t"] if stem == "t" else [f"{stem}_{j + 1}" for j in range(columns[-1].shape[1])]
    path = folder / "run.csv"
    np.savetxt(path, np.hstack(columns), delimiter=",", header=",".join(names), comments="", fmt="%.10g")
    return Recording.load(path, robot=robot)


@pytest.mark.parametrize("robot", [ARM, None])
@pytest.mark.parametrize("rate", [25.0, 125.0, 1000.0])
def test_what_is_sound_stays(robot: Robot | None, rate: float, tmp_path: Path) -> None:
    found = read(sound(rate), tmp_path, robot)
    assert found.t.size == ROWS
    assert found.report.counts == {}
    assert found.report.faults == ()
    assert found.report.notes == ()
    assert found.report.repaired == 0


@pytest.mark.parametrize("robot", [ARM, None])
def test_all_garbage_goes_and_good_rows_stay(robot: Robot | None, tmp_path: Path) -> None:
    """Numbers within all limits, in single rows and in a burst, at the begin and at the end."""
    log, rng = sound(), np.random.default_rng(4)
    rows = np.array([0, 300, 301, 302, 777, 1200, 1500, ROWS - 1])
    q = log.q.copy()
    q[rows] = rng.uniform(-3, 3, (rows.size, 6))
    found = read(log, tmp_path, robot, q=q)
    assert found.report.counts == {"jump": rows.size}
    np.testing.assert_allclose(found.q, np.delete(log.q, rows, axis=0), atol=1e-8)
    assert found.report.faults == ()
    assert [row for row, _ in found.report.dropped] == (rows + 2).tolist()


@pytest.mark.parametrize("where", ["middle", "begin", "end"])
def test_rows_of_zeros_go(where: str, tmp_path: Path) -> None:
    log = sound()
    rows = {"middle": slice(500, 512), "begin": slice(0, 12), "end": slice(ROWS - 12, ROWS)}[where]
    q, qd, current = log.q.copy(), np.array(log.qd), np.array(log.current)
    q[rows], qd[rows], current[rows] = 0, 0, 0
    found = read(log, tmp_path, q=q, qd=qd, current=current)
    assert found.report.counts == {"row of zeros": 12}
    assert found.report.faults == ()
    # Where the half of a file is zeros it is refused, and says why.
    q[: ROWS // 2] = 0
    with pytest.raises(InputError, match=r"rows are bad .*row of zeros"):
        read(log, tmp_path, q=q)


def test_zeros_of_one_quantity_go_while_the_arm_moves(tmp_path: Path) -> None:
    log = sound()
    current, qd = np.array(log.current), np.array(log.qd)
    current[700:705], qd[900:903] = 0, 0
    found = read(log, tmp_path, current=current, qd=qd)
    assert found.report.counts == {"row of zeros": 8}
    assert found.report.dropped[0] == (702, "row of zeros: all current while the arm moves")


def test_an_arm_that_passes_through_zero_is_no_garbage(tmp_path: Path) -> None:
    t = np.arange(1000) / 100
    q = np.sin(t)[:, None] * np.ones(6)
    q[(np.abs(q) < 0.005).all(axis=1)] = 0.0
    q[:200] = 0.0
    q[200:] = np.sin(t[200:, None] - t[200]) * np.ones(6)
    found = read(Recording(t=t, q=q, current=q), tmp_path)
    assert found.report.rows_dropped == 0


def test_spikes_go(tmp_path: Path) -> None:
    log = sound()
    current = np.array(log.current)
    current[400, 2], current[800:802, 4] = 300.0, -150.0
    current[1200:1230, 1] += 8.0  # a contact
    found = read(log, tmp_path, current=current)
    assert found.report.counts == {"spike": 3}
    assert found.report.dropped[0] == (402, "spike: current_3 = 300")


@pytest.mark.parametrize("robot", [ARM, None])
def test_wrapped_angles_are_turned_back_and_counted(robot: Robot | None, tmp_path: Path) -> None:
    log = sound()
    turning = log.q.copy()
    turning[:, 5] = np.linspace(-3, 12, ROWS)
    wrapped = turning.copy()
    wrapped[:, 5] = np.mod(turning[:, 5] + np.pi, 2 * np.pi) - np.pi
    found = read(log, tmp_path, robot, q=wrapped, qd=None)
    np.testing.assert_allclose(found.q, turning, atol=1e-8)
    assert found.report.repaired == int((turning[:, 5] > np.pi).sum())
    (note,) = found.report.notes
    assert note.startswith(f"Angles of joint 6 wrap 2 times; {found.report.repaired} rows")
    assert "repaired rows: " in run("recording", "info", tmp_path / "run.csv").out


def test_a_jump_for_good_is_told(tmp_path: Path) -> None:
    log = sound()
    q = log.q.copy()
    q[1100:, 1] += 0.8
    found = read(log, tmp_path, q=q)
    assert found.t.size == ROWS
    assert any(f"the positions jump at {log.t[1100]:.6g} s" in fault for fault in found.report.faults)
    assert "fault: the positions jump at" in run("recording", "info", tmp_path / "run.csv", "--robot", "ur5e").out


RATES: dict[str, tuple[Any, str]] = {
    "sign": (lambda qd: qd * [1, 1, -1, 1, 1, 1], "joint 3 has the opposite sign"),
    "degrees": (np.degrees, "the rates are degrees per second"),
    "turns a minute": (lambda qd: qd * 30 / np.pi, "the rates are turns per minute"),
    "half as fast": (lambda qd: qd / 2, "all moving joints change 2.* times as fast.*does time run"),
    "late": (lambda qd: np.roll(qd, 6, axis=0), "rates lag behind the positions by 4[89].* ms"),
    "early": (lambda qd: np.roll(qd, -6, axis=0), "rates run ahead of the positions by 4[89].* ms"),
    "another joint's": (lambda qd: qd[:, [1, 0, 2, 3, 4, 5]], "is not that of its positions|opposite sign"),
}


@pytest.mark.parametrize("fault", list(RATES))
def test_rates_beside_differences_of_positions(fault: str, tmp_path: Path) -> None:
    spoil, message = RATES[fault]
    log = sound()
    found = read(log, tmp_path, None, qd=spoil(np.array(log.qd)))
    assert found.t.size == ROWS
    assert any(re.search(message, told) for told in found.report.faults), found.report.faults


@pytest.mark.parametrize("size", [1.0, 0.1])
def test_degrees_are_called_degrees(size: float, tmp_path: Path) -> None:
    """By their speeds, however small the angles are, and by recorded rates where no robot is given."""
    log = sound()
    degrees = np.degrees(size * log.q)
    if size == 1:
        with pytest.raises(InputError, match="degrees taken for radians"):
            read(log, tmp_path, q=degrees, qd=None)
        with pytest.raises(InputError, match=r'they look like deg/s taken for SI; .* unit = "deg/s"'):
            read(log, tmp_path, qd=np.degrees(np.array(log.qd)))
    found = read(log, tmp_path, None, q=degrees, qd=size * np.array(log.qd))
    assert any("the positions are degrees" in fault for fault in found.report.faults), found.report.faults


def test_a_clock_too_coarse_for_its_rows_is_told(tmp_path: Path) -> None:
    log = sound()
    with pytest.raises(InputError, match=r"the time of another.*give rate_hz in place of its column"):
        read(log, tmp_path, t=np.floor(log.t * 10) / 10)


def damaged(log: Recording, rows: np.ndarray, seed: int) -> np.ndarray:
    """The positions of a recording with garbage in some rows: random ones, zeros, and single joints elsewhere."""
    rng = np.random.default_rng(seed)
    q = log.q.copy()
    low, high = q.min(axis=0), q.max(axis=0)
    for k, row in enumerate(rows):
        if k % 3 == 0:
            q[row] = rng.uniform(low - 1, high + 1)
        elif k % 3 == 1:
            q[row] = 0.0
        else:
            q[row, rng.integers(q.shape[1])] += rng.choice([-1, 1]) * rng.uniform(1.0, 2.0)
    return q


@pytest.mark.parametrize("name", ["ur10_ros2/ur10_exciting_trajectory.db3", "panda_ros2/panda_exciting_trajectory.db3"])
def test_faults_planted_into_real_recordings(name: str, tmp_path: Path) -> None:
    log = Recording.load(real(name))
    assert (log.report.counts, log.report.faults, log.report.repaired) == ({}, (), 0)
    rows = np.sort(np.random.default_rng(5).choice(log.t.size, 6, replace=False))
    plain = replace(log, tau=None, current=log.tau)
    found = read(plain, tmp_path, None, q=damaged(log, rows, 6))
    assert found.report.rows_dropped == rows.size, found.report.dropped
    np.testing.assert_allclose(found.t, np.delete(log.t, rows), atol=1e-6)
    assert log.qd is not None
    sign = np.ones(log.dof)
    sign[2] = -1
    faults = read(plain, tmp_path, None, qd=log.qd * sign).report.faults
    assert len(faults) == 1
    assert "opposite sign" in faults[0]
    assert "degrees per second" in read(plain, tmp_path, None, qd=np.degrees(log.qd)).report.faults[0]
