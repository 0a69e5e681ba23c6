"""Arms on walls and ceilings, payloads of known mass or beside fitted dynamics."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection import Thresholds
from bumpstop.identification import (
    DynamicsFit,
    compare_currents,
    identify_dynamics,
    identify_gains,
    identify_joint_model,
    identify_payload,
    with_payload,
)
from bumpstop.joint import JointTorqueModel
from bumpstop.model import inverse_dynamics, with_rotors
from bumpstop.recording import Recording
from cli.support import run, strict_json
from identification.drives import driven, drives, fourier

MASS, CENTER = 2.5, (0.03, -0.02, 0.09)
CEILING, WALL = (0.0, 0.0, 9.80665), (-9.80665, 0.0, 0.0)
GAIN = 8.0  # Nm/A, of every joint


def hung(
    robot: bs.Robot, seed: int, *, gravity: tuple[float, float, float] = (0.0, 0.0, -9.80665), seconds: float = 16.0
) -> Recording:
    """Torques, and currents of motors of one gain, of an arm with this free fall in its base frame."""
    t, q, qd, qdd = fourier(robot, seconds, 100.0, seed)
    tau = inverse_dynamics(robot, q, qd, qdd, gravity=gravity) + 3.0 * np.sign(qd) + 2.0 * qd + 0.2
    tau += 0.1 * np.random.default_rng(seed).normal(size=tau.shape)
    return Recording(t=t, q=q, qd=qd, tau=tau, current=tau / GAIN)


@pytest.mark.parametrize("gravity", [CEILING, WALL])
def test_dynamics_of_a_mounted_arm(gravity: tuple[float, float, float], tmp_path: Path) -> None:
    """On a wall the first joint shows gravity too; the file keeps the mounting, and another motion is predicted."""
    robot = bs.Robot.load("ur5e")
    fit = identify_dynamics(hung(robot, 1, gravity=gravity), robot, cutoff_hz=6.0, gravity=gravity)
    other = hung(robot, 2, gravity=gravity)
    assert min(score.r2 for score in fit.score(other)) > 0.99
    path = tmp_path / "arm.toml"
    fit.save(path)
    again = DynamicsFit.load(path)
    assert again.model.gravity == gravity
    assert [score.r2 for score in again.score(other)] == [score.r2 for score in fit.score(other)]
    assert ("mx_1" in fit.unobservable) == (gravity == CEILING)
    if gravity == WALL:
        upright = identify_dynamics(hung(robot, 1, gravity=gravity), robot, cutoff_hz=6.0)
        assert min(score.r2 for score in upright.score(other)) < 0.9


def test_gains_of_a_mounted_arm() -> None:
    robot = bs.Robot.load("ur5e")
    known = {robot.joints[1].name: GAIN}
    fit = identify_gains(hung(robot, 1, gravity=WALL), robot, known=known, cutoff_hz=6.0, gravity=WALL)
    assert fit.model.gains is not None
    assert fit.gain_errors is not None
    assert np.abs(fit.model.gains[:3] - GAIN).max() < 4 * fit.gain_errors[:3].max()
    assert fit.model.gravity == WALL


def test_a_payload_of_a_mounted_arm() -> None:
    robot = bs.Robot.load("ur5e")
    log = hung(with_payload(robot, MASS, CENTER), 3, gravity=WALL)
    fit = identify_payload(log, robot, gravity=WALL)
    assert fit.parameters["m"].value == pytest.approx(MASS, rel=0.03)
    assert fit.center == pytest.approx(CENTER, abs=0.01)


def test_a_payload_beside_fitted_dynamics() -> None:
    """An arm whose own inertia is wrong or unknown: dynamics without the payload take its place."""
    robot = bs.Robot.load("ur5e")
    unpadded = identify_dynamics(hung(robot, 1), robot, cutoff_hz=6.0)
    log = hung(with_payload(robot, MASS, CENTER), 3)
    nothing = with_payload(robot, 20.0, (0.0, 0.0, 0.3))  # an inertia that is wrong by as much
    fit = identify_payload(log, nothing, dynamics=unpadded.model)
    assert fit.parameters["m"].value == pytest.approx(MASS, rel=0.03)
    assert fit.center == pytest.approx(CENTER, abs=0.01)


def test_a_known_mass_shows_its_centre() -> None:
    """Its intervals are narrower than without, and hold; the mass is given back without an error."""
    robot = bs.Robot.load("ur5e")
    log = hung(with_payload(robot, MASS, CENTER), 3)
    free, given = (identify_payload(log, robot, mass=mass, inertia_uncertainty=0.0) for mass in (None, MASS))
    assert (given.parameters["m"].value, given.standard_errors["m"]) == (MASS, 0.0)
    assert given.center is not None
    assert given.center_errors is not None
    assert free.center_errors is not None
    assert np.abs(np.subtract(given.center, CENTER)).max() < 4 * max(given.center_errors) < 0.02
    assert given.center_errors[2] <= free.center_errors[2]


def test_a_joint_model_of_a_mounted_arm(tmp_path: Path) -> None:
    """Its file keeps the mounting: predictions, thresholds and detectors of it judge no weight as contact."""
    robot = bs.Robot.load("ur5e")
    motion = fourier(robot, 20.0, 100.0, 1)
    truth = drives(robot, inverse_dynamics(with_rotors(robot, 0.0), *motion[1:]))
    log = driven(robot, motion, truth, 1, gravity=CEILING)
    fit = identify_joint_model(log, robot, gravity=CEILING, cutoff_hz=8.0, rest_speed=0.01, maps=["odd"])
    file, recorded = tmp_path / "joints.toml", tmp_path / "free.parquet"
    fit.save(file)
    assert JointTorqueModel.load(file).gravity == CEILING
    other = driven(robot, fourier(robot, 20.0, 100.0, 2), truth, 2, gravity=CEILING, lost=0.0)
    found = compare_currents(JointTorqueModel.load(file), other, robot)
    assert min(score.r2 for score in found.current_scores()[1:3]) > 0.98
    other.save(recorded)
    tuned = strict_json(run("tune", recorded, "--model", file, "--save", tmp_path / "limits.toml", "--json").out)
    # Upright, the weight of the upper arm alone would ask for a hundred.
    assert max(tuned["thresholds_Nm"]) < 30
    options = ("--model", file, "--thresholds", tmp_path / "limits.toml")
    assert strict_json(run("detect", recorded, *options, "--json").out)["events"] == []
    made = run("detector", tmp_path / "arm.detector", *options)
    assert made.status == 0, made.err
    assert "gravity 0.0 0.0 9.80665" in (tmp_path / "arm.detector").read_text(encoding="utf-8")
    upright = run("detect", recorded, *options, "--gravity", "0,0,-9.80665", "--json")
    assert strict_json(upright.out)["events"]


def test_thresholds_of_an_arm_without_a_model_know_its_mounting(tmp_path: Path) -> None:
    robot, recorded, limits = bs.Robot.load("ur5e"), tmp_path / "free.parquet", tmp_path / "limits.toml"
    replace(hung(robot, 1, gravity=WALL), current=None).save(recorded)
    done = run("tune", recorded, "--robot", "ur5e", "--gravity=-9.80665,0,0", "--save", limits)
    assert done.status == 0, done.err
    assert Thresholds.load(limits).gravity == WALL
    options = (recorded, "--robot", "ur5e", "--thresholds", limits)
    assert strict_json(run("detect", *options, "--json").out)["events"] == []
    upright = strict_json(run("detect", *options, "--gravity=0,0,-9.80665", "--json").out)
    assert upright["events"]
    assert any("gravity" in note and "does not hold" in note for note in upright["notes"])
    limits.write_text("thresholds_Nm = [1, 2]\ngravity = 9.8\n")
    with pytest.raises(bs.InputError, match="gravity"):
        Thresholds.load(limits)


def test_nonsense_is_refused(tmp_path: Path) -> None:
    robot = bs.Robot.load("ur5e")
    log = hung(robot, 1, seconds=6.0)
    with pytest.raises(bs.InputError, match="mass: is -1 kg"):
        identify_payload(log, robot, mass=-1.0)
    path = tmp_path / "log.csv"
    names = ["t", *(f"q_{j}" for j in range(1, 7)), *(f"tau_{j}" for j in range(1, 7))]
    assert log.tau is not None
    table = np.column_stack([log.t, log.q, log.tau])
    np.savetxt(path, table, delimiter=",", header=",".join(names), comments="")
    for options, message in (
        (["--gravity", "0,0,-1"], "--gravity: is 1 m/s2 in all"),
        (["--gravity", "down"], "--gravity: 'down' cannot be used"),
        (["--mass", "2"], "--mass: is for a payload"),
        (["--model", "payload", "--mass", "0"], "--mass: is 0 kg"),
        (["--model", "payload", "--dynamics", "nowhere.toml"], "nowhere.toml"),
    ):
        found = run("identify", path, "--robot", "ur5e", *options)
        assert found.status != 0
        assert message in found.err, (options, found.err)
