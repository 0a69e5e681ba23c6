"""Drive trains: what is known of a robot before what is assumed, and what is refused."""

from __future__ import annotations

import math
import pickle
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bumpstop.errors import InputError
from bumpstop.model import DriveTrain, DriveTrainEntry, Joint, LinkInertia, Robot, robots
from bumpstop.model.drive_train.assumed import assumed_drive_train, holding_torque
from bumpstop.model.drive_train.entry import QUANTITIES, least_known
from model.random_chains import random_robot

Floats = npt.NDArray[np.float64]
UR5E = Robot.load("ur5e")


def two_links() -> Robot:
    """Two rods of 1 m with 40 kg and 20 kg, centres half way; 30 kg at the tip."""
    rod = LinkInertia(mass=40.0, center=(0.5, 0, 0), tensor=((0, 0, 0), (0, 0.3, 0), (0, 0, 0.3)))
    joints = (
        Joint(name="a", link="upper", inertia=rod, lower=-3.0, upper=3.0),
        Joint(
            name="b",
            link="lower",
            origin=(1.0, 0, 0),
            inertia=replace(rod, mass=20.0, tensor=((0, 0, 0), (0, 0.1, 0), (0, 0, 0.2))),
            lower=-3.0,
            upper=3.0,
        ),
    )
    return Robot(name="two", joints=joints, tip_origin=(1.0, 0, 0), payload_kg=30.0, inertia_status="assumed")


def test_holding_torque_by_hand() -> None:
    # 40 kg at 0.5 m, 20 kg at 1.5 m, 30 kg at 2 m; 20 kg at 0.5 m, 30 kg at 1 m.
    np.testing.assert_allclose(holding_torque(two_links()), 9.80665 * np.array([20 + 30 + 60, 10 + 30]), rtol=1e-12)
    # A flange at the joint: the payload is 0.3 m off.
    short = replace(two_links(), tip_origin=(0.0, 0, 0))
    np.testing.assert_allclose(holding_torque(short)[1], 9.80665 * (10 + 9), rtol=1e-12)


@pytest.mark.parametrize("name", [name for name in robots() if name != "sia5d"])
def test_holding_torque_against_gravity_and_published_limits(name: str) -> None:
    robot = Robot.load(name)
    limit, holding = robot.drive_train.torque_limit, holding_torque(robot)
    assert ((limit / holding > 0.8) & (limit / holding < 2.6)).all()
    # No pose and no direction of gravity asks for more than masses and payload at the lengths of the links.
    from bumpstop.model import gravity_torque

    rng = np.random.default_rng(3)
    q, g = rng.uniform(robot.lower, robot.upper, (200, robot.dof)), rng.normal(size=(200, 3))
    assert robot.payload_kg is not None
    for row, down in zip(q, g, strict=True):
        down *= 9.80665 / np.linalg.norm(down)
        load = robot.jacobian(row)[:3].T @ (robot.payload_kg * down)
        asked = gravity_torque(robot, row, gravity=down) - load
        assert (np.abs(asked) <= holding * (1 + 1e-12)).all()


def test_the_class_by_hand() -> None:
    robot = two_links()
    torque = holding_torque(robot)
    found = robot.drive_train
    np.testing.assert_allclose(found.rotor_inertia, 0.01 * torque)
    np.testing.assert_allclose(found.gear_stiffness, torque / 0.01)
    for name, value in (("gear_damping", 0.05), ("servo_bandwidth", 100), ("servo_position_gain", 25)):
        np.testing.assert_array_equal(getattr(found, name), [value, value])
    assert np.isinf(found.torque_limit).all()
    assert found.assumed == tuple(QUANTITIES)
    assert all(found.source.values())
    # A torque limit that is known is the rated torque.
    limited = replace(
        robot,
        drive_train_entries=(
            DriveTrainEntry(quantity="torque_limit", values=(500.0, 200.0), status="published", source="sheet"),
        ),
    )
    np.testing.assert_allclose(limited.drive_train.gear_stiffness, [50000, 20000])
    assert "torque_limit" not in limited.drive_train.assumed


def test_what_slides() -> None:
    rail = replace(two_links().joints[0], kind="prismatic")
    robot = replace(two_links(), joints=(rail, two_links().joints[1]))
    found = robot.drive_train
    # Carries 40 + 20 + 30 kg.
    assert found.rotor_inertia[0] == pytest.approx(90.0)
    assert found.gear_stiffness[0] == pytest.approx(90.0 * 9.80665 / 2e-4)
    assert found.rotor_inertia[1] == two_links().drive_train.rotor_inertia[1]
    limit = DriveTrainEntry(quantity="torque_limit", values=(4000.0, 200.0), status="published", source="sheet")
    limited = replace(robot, drive_train_entries=(limit,)).drive_train
    assert limited.rotor_inertia[0] == pytest.approx(90.0), "it moves as much as before"
    assert limited.gear_stiffness[0] == pytest.approx(4000.0 / 2e-4)


def test_the_class_of_an_arm_whose_inertia_is_not_believed() -> None:
    bare = replace(UR5E, joints=tuple(replace(joint, inertia=None) for joint in UR5E.joints), inertia_status="unknown")
    same = LinkInertia(mass=1.0, tensor=((0.1, 0, 0), (0, 0.1, 0), (0, 0, 0.1)))
    placeholders = replace(
        UR5E, joints=tuple(replace(joint, inertia=same) for joint in UR5E.joints), inertia_status="unverified"
    )
    assert placeholders.inertia_doubts
    np.testing.assert_array_equal(holding_torque(bare), holding_torque(placeholders))
    ratio = holding_torque(bare) / holding_torque(UR5E)
    assert ((ratio > 0.6) & (ratio < 1.7)).all(), "a fair guess of the shoulder and not far off at the wrist"


@given(st.integers(0, 2**32 - 1))
def test_every_robot_has_one(seed: int) -> None:
    robot = random_robot(np.random.default_rng(seed))
    found = robot.drive_train
    assert found.dof == robot.dof
    for name in QUANTITIES:
        values = getattr(found, name)
        assert values.shape == (robot.dof,)
        assert (values > 0).all()
        assert name == "torque_limit" or np.isfinite(values).all()


def test_rotors_of_the_joints_count() -> None:
    joints = tuple(replace(joint, rotor_inertia=0.2 + 0.1 * j) for j, joint in enumerate(UR5E.joints))
    robot = replace(UR5E, joints=joints)
    np.testing.assert_allclose(robot.drive_train.rotor_inertia, 0.2 + 0.1 * np.arange(6))
    assert robot.drive_train.status["rotor_inertia"] == "published"
    # Of some joints only: the others' are assumed, and so is the whole.
    robot = replace(UR5E, joints=(joints[0], *UR5E.joints[1:]))
    np.testing.assert_allclose(robot.drive_train.rotor_inertia, [0.2, *UR5E.drive_train.rotor_inertia[1:]])
    assert robot.drive_train.status["rotor_inertia"] == "assumed"
    # They go before what the robot's data say: whoever puts rotors into joints means them.
    panda = Robot.load("panda")
    changed = replace(panda, joints=tuple(replace(joint, rotor_inertia=0.3) for joint in panda.joints))
    np.testing.assert_array_equal(changed.drive_train.rotor_inertia, [0.3] * 7)


def test_values_are_changed_one_quantity_at_a_time() -> None:
    before = UR5E.drive_train
    after = before.with_values("servo_bandwidth", 60.0, "identified", "a step")
    np.testing.assert_array_equal(after.servo_bandwidth, [60.0] * 6)
    assert (after.status["servo_bandwidth"], after.source["servo_bandwidth"]) == ("identified", "a step")
    for name in QUANTITIES:
        if name != "servo_bandwidth":
            np.testing.assert_array_equal(getattr(after, name), getattr(before, name))
            assert (after.status[name], after.source[name]) == (before.status[name], before.source[name])
    half = before.scaled("gear_stiffness", 0.5)
    np.testing.assert_array_equal(half.gear_stiffness, before.gear_stiffness / 2)
    assert half.status == before.status
    assert half != before
    assert half.scaled("gear_stiffness", 2.0) == before
    assert pickle.loads(pickle.dumps(half)) == half
    assert least_known(["published", "identified"]) == "identified"
    assert least_known(["assumed", "published", "unverified"]) == "assumed"
    with pytest.raises(ValueError, match="read-only"):
        before.rotor_inertia[0] = 5


GOOD: dict[str, Any] = {
    **{name: [1.0, 2.0] for name in QUANTITIES},
    "acceleration_feedforward": [0.0, 1.0],
}


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"gear_stiffness": [1.0, 0.0]}, r"^gear_stiffness\[2\]: is 0; wanted a positive finite number$"),
        ({"rotor_inertia": [-1.0, 1.0]}, r"^rotor_inertia\[1\]: is -1; wanted a positive finite number$"),
        ({"servo_bandwidth": [1.0, math.inf]}, r"^servo_bandwidth\[2\]: is inf; wanted a positive finite"),
        ({"servo_position_gain": [math.nan, 1.0]}, r"^servo_position_gain\[1\]: is nan; wanted a positive finite"),
        ({"gear_stiffness": [1.0]}, r"^gear_stiffness: has shape \(1,\); wanted \(2,\)$"),
        ({"gear_damping": [1.0, 50.0]}, r"^gear_damping\[2\]: is 50; wanted at most 10$"),
        ({"torque_limit": [0.0, 1.0]}, r"^torque_limit\[1\]: is 0; wanted a positive finite number, or inf"),
        ({"torque_limit": [math.nan, 1.0]}, r"^torque_limit\[1\]: is nan; wanted a positive"),
        ({"torque_limit": [-math.inf, 1.0]}, r"^torque_limit\[1\]: is -inf; wanted a positive"),
        ({"acceleration_feedforward": [0.5, 1.5]}, r"^acceleration_feedforward\[2\]: is 1.5; wanted 0 to 1$"),
        ({"acceleration_feedforward": [-0.1, 1.0]}, r"^acceleration_feedforward\[1\]: is -0.1; wanted 0 to 1$"),
        ({"acceleration_feedforward": [math.nan, 1.0]}, r"^acceleration_feedforward\[1\]: is nan; wanted 0 to 1$"),
        ({"rotor_inertia": "ab"}, r"^gear_stiffness|^rotor_inertia: "),
        ({"status": {"rotor_inertia": "sure"}}, r"^status\['rotor_inertia'\]: 'sure' is none; valid: published,"),
        ({"status": {"rotor": "assumed"}}, r"^status\['rotor'\]: is no quantity .* did you mean 'rotor_inertia'"),
        ({"source": {"gear": "x"}}, r"^source\['gear'\]: is no quantity of a drive train"),
    ],
)
def test_what_no_drive_train_has_is_refused(change: dict[str, Any], message: str) -> None:
    DriveTrain(**GOOD)
    with pytest.raises(InputError, match=message):
        DriveTrain(**{**GOOD, **change})


def test_entries_that_do_not_fit_the_robot() -> None:
    entry = DriveTrainEntry(quantity="torque_limit", values=(1.0, 2.0), status="published", source="x")
    with pytest.raises(InputError, match=r"^drive_train.torque_limit: has 2 values; wanted 6, one for each joint$"):
        replace(UR5E, drive_train_entries=(entry,))
    twice = replace(entry, values=(1.0,) * 6)
    with pytest.raises(InputError, match=r"^drive_train.torque_limit: occurs twice"):
        replace(UR5E, drive_train_entries=(twice, twice))
    with pytest.raises(InputError, match=r"^quantity: 'torque' is none of a drive train; did you mean 'torque_limit'"):
        DriveTrainEntry(quantity="torque", values=(1.0,), status="published", source="x")
    with pytest.raises(InputError, match=r"^quantity: 'stiffness' is none"):
        UR5E.drive_train.scaled("stiffness", 2.0)
    assert assumed_drive_train(UR5E).status["torque_limit"] == "assumed"
