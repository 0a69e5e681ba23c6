"""Arms on walls and ceilings, payloads of known mass or beside fitted dynamics."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import (
    DynamicsFit,
    identify_dynamics,
    identify_gains,
    identify_payload,
    with_payload,
)
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from cli.support import run
from identification.drives import fourier

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
    free, given = identify_payload(log, robot), identify_payload(log, robot, mass=MASS)
    assert (given.parameters["m"].value, given.standard_errors["m"]) == (MASS, 0.0)
    assert given.center is not None
    assert given.center_errors is not None
    assert free.center_errors is not None
    assert np.abs(np.subtract(given.center, CENTER)).max() < 4 * max(given.center_errors) < 0.02
    assert given.center_errors[2] <= free.center_errors[2]


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
