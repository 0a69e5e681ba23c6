"""The comparison: forces and alarms that were planted, order of the methods, what is rejected."""

from __future__ import annotations

import json
import os
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.benchmark import (
    DetectorBenchmark,
    DirectResidual,
    MomentumObserver,
    PlantedRuns,
    compare_detectors,
    compare_on_recording,
    compare_signals,
    planted_runs,
    signals_of_residual,
)
from cli.support import run

SHARED = Path(os.environ.get("BUMPSTOP_SHARED", Path(__file__).resolve().parents[3] / "shared"))
UR10 = SHARED / "data" / "ur10_ros2" / "ur10_exciting_trajectory.db3"


@pytest.fixture(scope="module")
def found() -> DetectorBenchmark:
    return compare_detectors(bs.Robot.load("ur5e"), hours=0.34, contacts=57)


def test_fewer_alarms_cost_newtons(found: DetectorBenchmark) -> None:
    frame = found.to_frame()
    for _, rows in frame.group_by("method"):
        by_rate = rows.sort("per_hour")
        assert np.all(np.diff(by_rate["median_N"].to_numpy()) <= 0)
        assert np.all(np.diff(by_rate["undetected"].to_numpy()) <= 0)
    assert found.contacts == 57
    at = found.at(100.0)
    assert at["direct residual (bumpstop)"].median_N < at["momentum observer"].median_N
    assert at["fixed torque threshold"].median_N > 2 * at["momentum observer"].median_N


def test_planted_alarms_and_forces_are_found() -> None:
    """White noise without a model: the threshold at a rate and the force over it follow from the noise alone."""
    rng, dt, rows = np.random.default_rng(0), 0.004, 15_000
    still = rng.normal(size=(20, rows, 1))
    force, onsets = np.zeros((2, rows)), []
    for row in (0, 1):
        for begin in range(1000, 14_000, 1000):
            force[row, begin : begin + 62] = np.minimum(0.5 * np.arange(62), 25)
            onsets.append((row, begin))
    hit = rng.normal(size=(2, rows, 1)) + force[:, :, None]
    truth = PlantedRuns(dt, hit, hit, force, np.array(onsets, dtype=float))
    free, seen = (signals_of_residual(one, one, dt) for one in (still, hit))
    result = compare_signals(free, seen, truth, [DirectResidual()], "noise")
    (at,) = [point for point in result.points if point.per_hour == 300]
    # 300 alarms an hour in blocks of half a second: 1 in 24 blocks of 125 samples, a threshold of 3.4 sd. A slope of
    # half a standard deviation a sample, with noise, passes it between 1 and 3.4.
    assert 1.0 < at.median_N < 3.4
    assert at.undetected == 0
    assert result.hours == pytest.approx(10 * (rows - 250) * dt / 3600)


def test_an_alarm_that_stands_already_detects_nothing() -> None:
    dt, rows = 0.004, 15_000
    still = np.random.default_rng(1).normal(size=(20, rows, 1))
    force = np.zeros((1, rows))
    force[0, 5000:5062] = np.arange(62)
    hit = force[:, :, None] + 50.0
    truth = PlantedRuns(dt, hit, hit, force, np.array([[0.0, 5000.0]]))
    free, seen = (signals_of_residual(one, one, dt) for one in (still, hit))
    points = compare_signals(free, seen, truth, [DirectResidual()], "standing").points
    assert {point.undetected for point in points} == {1.0}


def test_planted_contacts_are_the_torque_of_their_force() -> None:
    robot = bs.Robot.load("ur5e")
    free, hit = (planted_runs(robot, 1, 10.0, stiffness_N_m=k, seed=2) for k in (0.0, 20_000.0))
    run_of, begin = hit.onsets[0].astype(int)
    row = begin + 40
    jacobian = robot.jacobian(hit.q[run_of, row])[:3]
    added = hit.torque[run_of, row] - free.torque[run_of, row]
    force, *_ = np.linalg.lstsq(jacobian.T, added, rcond=None)
    assert np.linalg.norm(force) == pytest.approx(hit.contact_force[run_of, row], rel=0.3)
    assert 1 < hit.contact_force.max() <= 150


def test_what_the_command_writes(tmp_path: Path, found: DetectorBenchmark, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bumpstop.benchmark.compare_detectors", lambda *_, **__: found)
    assert run("benchmark", "detectors").out == f"{found}\n"
    done = run("benchmark", "detectors", "--json", "--out", tmp_path / "out")
    assert (done.status, done.err) == (0, "")
    assert {"about", "hours", "contacts", "points"} == set(json.loads(done.out))
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"curves.svg", "curves.png", "points.csv"}
    assert "mathdefault" not in (tmp_path / "out" / "curves.svg").read_text()
    axes = found.plot()
    axes.figure.canvas.draw()
    legend = axes.get_legend()
    assert legend is not None
    covered = legend.get_window_extent()
    for line in axes.lines:
        assert not any(covered.contains(*place) for place in axes.transData.transform(line.get_xydata())), line


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--hours", "0.1"), "error: --hours: is 0.1; wanted 0.33 to 100"),
        (("--contacts", "2"), "error: --contacts: is 2; wanted 10 to 100000"),
        (("--stiffness", "nan"), "error: --stiffness: "),
        (("--seed", "-1"), "error: --seed: is -1; wanted zero or more"),
        (("--cutoff", "5"), "error: --cutoff: has no meaning without --recording"),
        (("--robot", "ur99"), "error: robot: there is no built-in robot"),
    ],
)
def test_options_that_cannot_be_used(options: tuple[str, ...], message: str) -> None:
    done = run("benchmark", "detectors", *options)
    assert done.status == 2
    assert done.err.startswith(message)


def test_a_urdf_with_several_ends_takes_a_tip(tmp_path: Path) -> None:
    """The refusal named the tips that there are, and none could be given."""
    bs.model.write_urdf(bs.Robot.load("ur5e"), tmp_path / "arm.urdf")
    text = (tmp_path / "arm.urdf").read_text(encoding="utf-8")
    eye = '<link name="eye"/><joint name="e" type="fixed"><parent link="wrist_3_link"/><child link="eye"/></joint>'
    (tmp_path / "arm.urdf").write_text(text.replace("</robot>", f"{eye}</robot>"), encoding="utf-8")
    named = ("benchmark", "detectors", "--robot", tmp_path / "arm.urdf", "--hours", "0.1")
    assert "--tip: is missing" in run(*named).err
    assert "--hours: is 0.1" in run(*named, "--base", "base_link", "--tip", "flange").err


def test_a_recording_that_is_too_short() -> None:
    t = np.arange(0, 10, 0.01)
    q = np.zeros((t.size, 6))
    with pytest.raises(bs.InputError, match=r"lasts 9\.99 s; wanted 26\.5 s"):
        compare_on_recording(bs.Recording(t=t, q=q, tau=q), bs.Robot.load("ur5e"))


@pytest.mark.skipif(not UR10.exists(), reason=f"{UR10} is absent: set BUMPSTOP_SHARED")
def test_a_real_recording() -> None:
    robot = bs.Robot.load("ur10")
    log = bs.Recording.load(UR10, robot=robot)
    result = compare_on_recording(log, robot, cutoff_hz=8, methods=[MomentumObserver()])
    (point,) = result.points
    assert point.per_hour == 300
    assert 5 < point.median_N < 100
