"""``bumpstop sensitivity``: what it prints, found by other means, and what it refuses."""

from __future__ import annotations

import json
import math

import numpy as np
import pytest
from scipy.optimize import linprog

import bumpstop as bs
from bumpstop.arrays import FloatArray
from bumpstop.detection import undetectable_forces
from cli.support import run, strict_json


def test_sensitivity() -> None:
    pose = "0,30,0,-20,0,-40,0"
    given = ("sia5d", "--pose-deg", pose, "--thresholds", "20,10,20,20,20,20,20")
    found = strict_json(run("sensitivity", *given, "--json").out)
    q = np.radians([0, 30, 0, -20, 0, -40, 0])
    wanted = undetectable_forces(bs.Robot.load("sia5d"), q, [20, 10, 20, 20, 20, 20, 20])
    assert found["largest_force_N"] == pytest.approx(float(wanted.largest), rel=1e-12)
    # From anywhere between the thresholds: twice as much.
    assert found["worst_case_force_along_N"] == pytest.approx(2 * found["force_along_N"], rel=1e-12)
    growing = strict_json(run("sensitivity", *given, "--stiffness", 75000, "--speed-mm-s", 50, "--json").out)
    # Each joint's torque grows by its own lever: as a force it is K v dt for all.
    assert growing["worst_case_force_along_N"] - found["worst_case_force_along_N"] == pytest.approx(15, rel=1e-9)
    # The threshold that must be reached is moved out, that on the other side is not.
    noisy = strict_json(run("sensitivity", *given, "--noise-sd", 3, "--z", 5, "--json").out)
    shares = [
        theta / abs(joint["torque_per_newton_Nm_N"])
        for theta, joint in zip((35, 55), noisy["joints"][1::2], strict=False)
    ]
    assert noisy["worst_case_force_along_N"] == pytest.approx(min(shares), rel=1e-12)
    assert noisy["worst_case_force_along_N"] > noisy["force_along_N"]
    straight = run("sensitivity", "iiwa14", "--pose-deg", "0,0,0,0,0,0,0", "--thresholds", "20,20,20,20,20,20,20")
    assert straight.status == 0, straight.err
    assert "along (0, 0, -1): unbounded;" in straight.out
    assert "not detectable at all: along (0, 0, 1)" in straight.out
    json.loads(json.dumps(found, allow_nan=False))


@pytest.mark.parametrize(
    ("name", "pose", "thresholds"),
    [
        ("sia5d", [12, 30, -25, -20, 40, -40, 5], [20, 10, 17, 20, math.inf, 20, 13]),
        ("ur10e", [10, -80, 110, -120, -90, 20], [40, 40, math.inf, 12, 12, 12]),
        # Two joints monitored: a direction is left that none feels.
        ("ur10e", [10, -80, 110, -120, -90, 20], [math.inf, 40, 30, math.inf, math.inf, math.inf]),
    ],
)
def test_sensitivity_is_what_linear_programmes_and_levers_say(
    name: str, pose: list[float], thresholds: list[float]
) -> None:
    rng = np.random.default_rng(7)
    robot, dof, z = bs.Robot.load(name), len(pose), 1.5
    mean, sd = rng.uniform(-4, 4, dof), rng.uniform(0, 3, dof)
    point, way = np.array([0.05, -0.1, 0.12]), np.array([1.0, -2.0, -0.5])
    options = {
        "pose-deg": pose, "thresholds": thresholds, "direction": way, "point-m": point, "noise-mean": mean,
        "noise-sd": sd,
    }  # fmt: skip
    written = [f"--{key}={','.join(repr(float(value)) for value in values)}" for key, values in options.items()]
    found = strict_json(run("sensitivity", name, *written, "--z", z, "--json").out)

    def place(q: FloatArray) -> FloatArray:
        X_BL = np.asarray(robot.pose(q))
        return np.asarray(X_BL[:3, :3] @ point + X_BL[:3, 3])

    # Levers by moving each joint a little to either side.
    q, step = np.radians(pose), 1e-6
    levers = np.array([(place(q + step * e) - place(q - step * e)) / (2 * step) for e in np.eye(dof)])
    theta = np.array(thresholds)
    monitored = np.isfinite(theta)
    faces = np.vstack([levers[monitored], -levers[monitored]])
    bounds = np.concatenate([(theta + z * sd - mean)[monitored], (theta + z * sd + mean)[monitored]])

    along = (faces @ (way / np.linalg.norm(way)))[:, None]
    assert found["force_along_N"] == pytest.approx(-linprog([-1.0], along, bounds, bounds=(None, None)).fun, rel=1e-6)
    if monitored.sum() < 3:
        assert found["largest_force_N"] is None
        (undetectable,) = found["null_space"]
        np.testing.assert_allclose(faces @ undetectable, 0, atol=1e-8)
        return
    # The farthest point is a corner: from each of many directions on to the corner farthest in that of the last.
    largest = 0.0
    for direction in rng.normal(size=(60, 3)):
        u, length = direction / np.linalg.norm(direction), 0.0
        while True:
            corner = linprog(-u, faces, bounds, bounds=(None, None)).x
            if np.linalg.norm(corner) <= length * (1 + 1e-12):
                break
            length = float(np.linalg.norm(corner))
            u = corner / length
        largest = max(largest, length)
    assert found["largest_force_N"] == pytest.approx(largest, rel=1e-6)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("sia5d", "--pose-deg", "0,0", "--thresholds", "20"), "--pose-deg: '0,0' cannot be used"),
        (
            ("sia5d", "--pose-deg", "0,0,0,0,0,181,0", "--thresholds", "1,1,1,1,1,1,1"),
            "--pose-deg: joint 6 at 181 is outside its limits; valid: -110 to 110 deg",
        ),
        (("sia5", "--pose-deg", "0", "--thresholds", "20"), "did you mean 'sia5d'"),
        (
            ("ur5e", "--pose-deg", "0,0,0,0,0,0", "--thresholds", "9,9,9,9,9,9", "--direction", "0,0,0"),
            "--direction: has no length",
        ),
        (
            ("ur5e", "--pose-deg", "0,0,0,0,0,0", "--thresholds", "9,9,9,9,9,9", "--point-m", "0,-101,0"),
            "--point-m: is 0,-101,0; wanted from -100 to 100 m along each axis",
        ),
        *(
            (("ur5e", "--pose-deg", "0,0,0,0,0,0", "--thresholds", "9,9,9,9,9,9", option, "2"), words)
            for option, words in (
                ("--z", "--z: has no effect without --noise-sd; give both, or neither"),
                ("--noise-sd", "--noise-sd: has no effect without --z"),
                ("--stiffness", "--stiffness: has no effect without --speed-mm-s"),
                ("--speed-mm-s", "--speed-mm-s: has no effect without --stiffness"),
                ("--period", "--period: has no effect without --stiffness and --speed-mm-s"),
            )
        ),
        (
            ("ur5e", "--pose-deg", "0,0,0,0,0,0", "--thresholds", "9,9,9,9,9,9", "--z", "nan"),
            "--z: is nan",
        ),
    ],
)
def test_refusals(arguments: tuple[str, ...], message: str) -> None:
    done = run("sensitivity", *arguments)
    assert (done.status, done.out) == (2, "")
    assert done.err.startswith("error: ")
    assert message in done.err
    assert done.err.count("\n") == 1
