"""Excitation: limits by sampling, the condition number by another route, and what it is good for."""

from __future__ import annotations

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.identification.design.excitation import Excitation, ExcitationSettings, base_columns, plan_excitation
from bumpstop.identification.dynamics.regressor import inertial_regressor
from bumpstop.study.speed.trajectory.retiming import retime
from cli.support import run, strict_json

GRAVITY = (0.0, 0.0, -9.80665)
SETTINGS = ExcitationSettings(rounds=120, seed=3, speed_share=0.5, acceleration=3.0)


@pytest.fixture(scope="module")
def found() -> Excitation:
    return plan_excitation(bs.Robot.load("ur5e"), SETTINGS)


def test_limits_floor_and_rest(found: Excitation) -> None:
    robot = found.robot
    t = np.arange(0.0, 10.0, 0.002)
    q, qd, qdd = found.at(t)
    assert ((q > robot.lower) & (q < robot.upper)).all()
    assert (np.abs(qd) < 0.5 * robot.velocity).all()
    assert np.abs(qdd).max() < 3.0
    for joint in robot.joints[2:]:
        assert robot.pose(q[::10], joint.link)[:, 2, 3].min() > 0.08
    # At rest where it begins, and periodic.
    assert max(np.abs(qd[0]).max(), np.abs(qdd[0]).max()) < 1e-12
    np.testing.assert_allclose(found.at(np.array([0.0, 10.0]))[0][0], found.at(np.array([10.0]))[0][0], atol=1e-12)
    # Speeds and accelerations are those of the positions.
    assert np.abs(np.diff(q, axis=0) / 0.002 - (qd[1:] + qd[:-1]) / 2).max() < 1e-4
    assert np.abs(np.diff(qd, axis=0) / 0.002 - (qdd[1:] + qdd[:-1]) / 2).max() < 1e-3


@pytest.mark.parametrize(
    "limits",
    [{"acceleration": 0.3}, {"speed_share": 0.02, "acceleration": 50.0}, {"speed_share": 1.0, "period_s": 200.0}],
    ids=["acceleration", "speed", "position"],
)
@pytest.mark.parametrize("seed", range(3))
def test_every_joint_comes_as_near_as_all_others_to_the_limit_that_binds_it(
    limits: dict[str, float], seed: int
) -> None:
    """Accelerations, speeds and positions, to either side: whatever is drawn is made as large as they allow."""
    robot = bs.Robot.load("panda")
    motion = plan_excitation(robot, ExcitationSettings(rounds=0, seed=seed, floor=None, radius=0.0, **limits))
    period, share = motion.settings.period_s, motion.settings.speed_share
    q, qd, qdd = motion.at(np.linspace(0.0, period, 4001))
    swing, margin = q - motion.middle, np.radians(5)
    used = np.maximum.reduce(
        [
            swing.max(axis=0) / (np.minimum(robot.upper, np.pi) - margin - motion.middle),
            -swing.min(axis=0) / (motion.middle - np.maximum(robot.lower, -np.pi) - margin),
            np.abs(qd).max(axis=0) / (share * robot.velocity),
            np.abs(qdd).max(axis=0) / motion.settings.acceleration,
        ]
    )
    assert used.max() < 1
    np.testing.assert_allclose(used, used.max(), rtol=0.01)


def test_condition_number_by_singular_values(found: Excitation) -> None:
    """Of a finer sampling than the search's: the same to a fifth, and far below that of the random start."""
    q, qd, qdd = found.at(np.linspace(0, 10, 400, endpoint=False))
    columns = base_columns(found.robot, GRAVITY)
    assert len(columns) == found.parameters == 36
    matrix = inertial_regressor(found.robot, q, qd, qdd, GRAVITY)[:, :, columns].reshape(-1, 36)
    values = np.linalg.svd(matrix / np.linalg.norm(matrix, axis=0), compute_uv=False)
    assert values[0] / values[-1] == pytest.approx(found.condition, rel=0.2)
    assert found.condition < 0.5 * found.start_condition


def test_the_same_seed_gives_the_same_motion() -> None:
    settings = ExcitationSettings(rounds=5, seed=4)
    one, other = (plan_excitation(bs.Robot.load("ur5e"), settings) for _ in range(2))
    assert (one.sine == other.sine).all()
    assert (one.middle == other.middle).all()


def test_it_shows_inertia_better_than_the_random_start(found: Excitation) -> None:
    """Standard errors of base parameters from torques with a noise of 1 Nm, by the normal equations."""
    start = ExcitationSettings(rounds=0, seed=3, speed_share=0.5, acceleration=3.0)
    random = plan_excitation(bs.Robot.load("ur5e"), start)

    def errors(motion: Excitation) -> np.ndarray:
        q, qd, qdd = motion.at(np.linspace(0, 10, 200, endpoint=False))
        columns = base_columns(motion.robot, GRAVITY)
        matrix = inertial_regressor(motion.robot, q, qd, qdd, GRAVITY)[:, :, columns].reshape(-1, len(columns))
        return np.sqrt(np.diag(np.linalg.inv(matrix.T @ matrix)))

    assert random.condition == pytest.approx(found.start_condition)
    assert np.median(errors(found) / errors(random)) < 0.8


def test_no_room_is_said() -> None:
    with pytest.raises(bs.InputError, match="no motion is clear"):
        plan_excitation(bs.Robot.load("ur5e"), ExcitationSettings(floor=3.0))
    with pytest.raises(bs.InputError, match="harmonics"):
        ExcitationSettings(harmonics=1)


def test_the_written_motion_rests_at_both_ends_and_can_be_slowed(found: Excitation) -> None:
    path = found.path(50.0)
    assert not path.qd[[0, -1]].any()
    assert not path.qdd[[0, -1]].any()
    half = np.full(len(path.t), 0.5)
    slow = retime(Trajectory(path.t, path.q, path.qd), half, found.robot.velocity, np.full(found.robot.dof, 4.5))
    # At half the pace throughout, but for the time to gather it.
    assert 2 * path.duration <= slow.time[-1] < 2.1 * path.duration + 2


def test_a_motion_that_shows_nothing_is_told() -> None:
    """Its condition number is infinite, for which JSON has no number."""
    still = ("--harmonics", 2, "--rounds", 0, "--period-s", 1, "--acceleration", 0.01)
    done = run("plan", "excitation", "--robot", "ur5e", *still, "--json")
    assert done.status == 0, done.err
    said = strict_json(done.out)
    assert said["condition_number"] is None
    assert said["condition_number_of_random_start"] is None
    told = run("plan", "excitation", "--robot", "ur5e", *still).out
    assert "condition number infinite: the motion does not tell the base parameters apart" in told
