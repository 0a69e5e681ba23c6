"""Placeholder inertia is told from an arm's, and no verdict of two masses rests on it; reach against closed forms."""

from __future__ import annotations

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision import Scenario
from bumpstop.errors import InputError
from bumpstop.model import Joint, Robot, robots
from bumpstop.model.inertia import LinkInertia
from bumpstop.model.inertia_doubts import inertia_doubts
from bumpstop.model.urdf.writer import write_urdf


def with_inertia(robot: Robot, mass: list[float], scale: list[float] | None = None) -> Robot:
    """The robot with links of given masses [kg], each a ball of its own size unless scales are given."""
    sizes = scale if scale is not None else [0.01 * (j + 1) for j in range(robot.dof)]
    joints = [
        replace(joint, inertia=LinkInertia(mass=m, tensor=((s, 0, 0), (0, s, 0), (0, 0, s))))
        for joint, m, s in zip(robot.joints, mass, sizes, strict=True)
    ]
    return replace(robot, joints=tuple(joints), inertia_status="unverified")


@pytest.mark.parametrize("name", robots())
def test_built_in_arms_are_believed(name: str) -> None:
    robot = Robot.load(name)
    assert inertia_doubts(robot.name, robot.joints, robot.reach, robot.turning_reach) == ()
    assert robot.turning_reach == robot.reach
    assert robot.inertia_doubts == ()


@pytest.mark.parametrize(
    ("mass", "scale", "said"),
    [
        ([2.0] * 6, None, "6 of 6 links have the same mass, 2 kg"),
        ([9.1, 7.7, 5.5, 3.3, 2.2, 1.1], [0.01] * 6, "6 of 6 links have the same moments of inertia, 0.01, 0.01, 0.01"),
        ([9.1, 7.7, 5.5, 3.3, 2.2, 0.0], None, "link 'wrist_3_link' has no mass"),
        ([9.1, 7.7, 1.0, 2.0, 1.0, 1.5], None, "3 of 6 links weigh exactly 0, 1 or 2 kg"),
        ([2.0, 2.00004, 1.99997, 9.1, 5.5, 4.4], None, "3 of 6 links have the same mass, 2 kg"),
        (
            [9.1, 7.7, 5.5, 3.3, 2.2, 1.1],
            [0.01, 0.0100002, 0.0099999, 0.3, 0.2, 0.1],
            "3 of 6 links have the same moments of inertia, 0.01, 0.01, 0.01",
        ),
        (
            [9.1, 7.7, 5.5, 3.3, 2.2, 0.5],
            [0.5, 0.4, 0.3, 0.2, 0.1, 1.0],
            "link 'wrist_3_link' turns as if its 0.5 kg were 1.41 m off its centre",
        ),
        ([1.1, 1.2, 0.5, 0.3, 0.2, 0.1], None, "all links together weigh 3.4 kg, less than any known arm"),
        ([9100.0, 7700.0, 5500.0, 3300.0, 2200.0, 1100.0], None, "(4.65e+03 kg; are the masses grams?)"),
    ],
)
def test_placeholders_are_named(mass: list[float], scale: list[float] | None, said: str) -> None:
    (doubt,) = with_inertia(Robot.load("ur10e"), mass, scale).inertia_doubts
    assert doubt.startswith("The inertia of ur10e looks like placeholders, not like an arm's: ")
    assert said in doubt


def test_one_mass_and_tensor_in_many_links_of_any_arm() -> None:
    """Whatever the placeholder, and whichever two links of the seven were measured."""
    rng = np.random.default_rng(8)
    for name in robots():
        robot = Robot.load(name)
        for _ in range(20):
            mass, scale = float(10 ** rng.uniform(-2, 2)), float(10 ** rng.uniform(-6, 1))
            masses, scales = [mass] * robot.dof, [scale] * robot.dof
            for measured in rng.choice(robot.dof, 2, replace=False):
                masses[measured], scales[measured] = 3.3 + measured, 0.033 + measured / 1000
            (doubt,) = with_inertia(robot, masses, scales).inertia_doubts
            assert f"links have the same mass, {mass:.3g}"[:-1] in doubt
            assert "links have the same moments of inertia" in doubt


def test_objection() -> None:
    robot = Robot.load("ur10e")
    assert robot.inertia_objection == ""
    assert Robot.load("sia5d").inertia_objection == "", "assumed, and an arm's"
    assert with_inertia(robot, [2.0] * 6).inertia_objection == with_inertia(robot, [2.0] * 6).inertia_doubts[0]
    unknown = replace(
        robot, joints=(replace(robot.joints[0], inertia=None), *robot.joints[1:]), inertia_status="unknown"
    )
    assert unknown.inertia_objection == "The inertia of ur10e is not known: no mass of 'shoulder_link'."


def test_two_equal_links_are_no_placeholders() -> None:
    """The UR10's maker gives two links of its wrist the same 2 kg."""
    assert with_inertia(Robot.load("ur10e"), [7.1, 12.7, 4.27, 2.0, 2.0, 0.365]).inertia_doubts == ()


def impact(robot: Robot, folder: Path, arm: str) -> Scenario:
    write_urdf(robot, folder / "arm.urdf")
    return Scenario.from_dict(
        {
            "robot": "arm.urdf",
            "pose_deg": [0, -70, 100, -120, -80, 0],
            "motion": {"velocity_mm_s": [0, 0, -200]},
            "contact": {"stiffness_N_m": 75000, "kind": "free", "body_mass_kg": 4.4, "arm": arm},
            "detector": {"thresholds_Nm": [20] * 6, "noise_sd_Nm": 3.0},
            "reaction": {"joint_acceleration_rad_s2": 5.0},
        },
        folder,
    )


def test_no_two_mass_verdict_from_placeholders(tmp_path: Path) -> None:
    real = Robot.load("ur10e")
    believed = bs.evaluate(impact(real, tmp_path, "two_mass"))
    assert believed.problem.robot.inertia_status == "unverified"
    assert believed.impact_bounds is not None
    assert believed.impact_bounds.reduced_mass is not None
    fake = with_inertia(real, [2.0] * 6)
    with pytest.raises(InputError, match=r"^contact\.arm: 'two_mass' needs a plausible inertia") as refused:
        bs.evaluate(impact(fake, tmp_path, "two_mass"))
    assert ".;" not in str(refused.value)
    driven = bs.evaluate(impact(fake, tmp_path, "position_driven"))
    assert driven.impact_bounds is not None
    assert driven.impact_bounds.reduced_mass is None
    assert any("looks like placeholders, so the reduced mass gives no upper limit" in note for note in driven.notes)


@pytest.mark.parametrize(("key", "arm"), [("contact.arm", "two_mass"), ("arm.model", "elastic")])
def test_a_link_without_mass_is_named(tmp_path: Path, key: str, arm: str) -> None:
    real = Robot.load("ur10e")
    unknown = replace(real, joints=(replace(real.joints[0], inertia=None), *real.joints[1:]), inertia_status="unknown")
    scenario = impact(unknown, tmp_path, "position_driven").with_values({key: arm})
    objection = rf"'{arm}' needs a plausible inertia\. The inertia of \w+ is not known: no mass of"
    with pytest.raises(InputError, match=rf"^{re.escape(key)}: {objection} 'shoulder_link'"):
        bs.evaluate(scenario)


def test_reach_of_a_plane_arm() -> None:
    """Two links of 0.5 and 0.3 m that turn in a plane, the elbow between 60 and 120 degrees: by the law of cosines."""
    elbow = Joint(name="b", link="2", origin=(0.5, 0, 0), lower=math.radians(60), upper=math.radians(120))
    arm = Robot(name="plane", joints=(Joint(name="a", link="1"), elbow), tip_origin=(0.3, 0, 0))
    assert arm.reach == pytest.approx(math.sqrt(0.5**2 + 0.3**2 + 2 * 0.5 * 0.3 * math.cos(math.radians(60))), rel=1e-4)
    free = replace(arm, joints=(arm.joints[0], replace(elbow, lower=-math.inf, upper=math.inf)))
    assert free.reach == pytest.approx(0.8, rel=1e-4)


@pytest.mark.parametrize("name", robots())
def test_no_pose_reaches_farther(name: str) -> None:
    robot = Robot.load(name)
    q = np.random.default_rng(5).uniform(robot.lower, robot.upper, size=(20000, robot.dof))
    tip = robot.pose(q)[:, :3, 3] - np.asarray(robot.joints[0].origin)
    assert 0.9 * robot.reach < np.hypot(tip[:, 0], tip[:, 1]).max() <= robot.reach <= robot.span


def test_a_slide_without_limits_reaches_everywhere() -> None:
    rail = Joint(name="x", link="carriage", kind="prismatic", axis=(1, 0, 0))
    assert Robot(name="rail", joints=(rail,)).reach == math.inf


def test_a_rail_makes_no_arm_larger() -> None:
    arm = Robot.load("ur10e")
    carriage = LinkInertia(mass=120.0, tensor=((9, 0, 0), (0, 8, 0), (0, 0, 7)))
    rail = Joint(name="rail", link="carriage", kind="prismatic", axis=(1, 0, 0), lower=-3, upper=3, inertia=carriage)
    first = replace(arm.joints[0], rotation=((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    moved = replace(
        arm, joints=(rail, first, *arm.joints[1:]), frames=(), drive_train_entries=(), inertia_status="unverified"
    )
    assert moved.reach > 4
    assert moved.turning_reach == pytest.approx(arm.reach, rel=0.2)
    assert moved.inertia_doubts == ()
    unknown = tuple(replace(joint, inertia=None) for joint in moved.joints)
    bare = replace(moved, joints=unknown, inertia_status="unknown")
    assert bare.drive_train.rotor_inertia[0] < 150, "the mass of an arm of that reach, not of that travel"


def test_a_centre_beyond_the_reach_is_named() -> None:
    arm = Robot.load("ur5e")
    joints = list(arm.joints)
    assert joints[2].inertia is not None
    joints[2] = replace(joints[2], inertia=replace(joints[2].inertia, center=(200.0, 0.0, 10.0)))
    [said] = replace(arm, joints=tuple(joints), inertia_status="unverified").inertia_doubts
    assert f"link {joints[2].link!r} has its centre 200 m off its frame" in said
