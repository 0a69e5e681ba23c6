"""Lengths in another unit are told, and those of every real arm are believed."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from bumpstop.detection import Detector, Thresholds
from bumpstop.model import Robot, robots
from bumpstop.model.inertia import vector3
from bumpstop.model.joint import Joint
from bumpstop.model.urdf.writer import write_urdf
from cli.support import run
from model.urdf_cases import scaled

UR10E = Robot.load("ur10e")


@pytest.mark.parametrize("name", robots())
def test_built_in_arms_are_believed(name: str) -> None:
    assert Robot.load(name).length_doubts == ()


@pytest.mark.parametrize(("factor", "said"), [(1e3, "longer than 6 m"), (1e2, "longer than 6 m"), (1e-2, "shorter")])
def test_all_lengths_in_another_unit(factor: float, said: str) -> None:
    (doubt,) = scaled(UR10E, factor).length_doubts
    assert doubt.startswith("The lengths of ur10e do not look like metres: its links are ")
    assert said in doubt


def test_one_length_in_another_unit() -> None:
    (tip,) = replace(UR10E, tip_name="tcp", tip_origin=(0.0, 0.0, -120.0)).length_doubts
    assert "the tip 'tcp' lies 120 m off, all other lengths of the arm are 1.66 m together" in tip
    joints = list(UR10E.joints)
    joints[2] = replace(joints[2], origin=vector3(1e3 * np.array(joints[2].origin)))
    (elbow,) = replace(UR10E, joints=tuple(joints)).length_doubts
    assert f"the origin of joint {joints[2].name!r} lies 612.7 m off" in elbow
    # A long tool is none.
    assert replace(UR10E, tip_origin=(0.0, 0.0, 1.5)).length_doubts == ()


def test_travel_and_where_the_arm_stands_are_no_lengths_of_it() -> None:
    arm = replace(UR10E, inertia_status="unknown", drive_train_entries=())
    far = replace(arm.joints[0], origin=(20.0, 30.0, 4.0))
    assert replace(arm, joints=(far, *arm.joints[1:])).length_doubts == ()
    rail = Joint(name="rail", link="carriage", kind="prismatic", origin=(9.0, 0.0, 1.0), lower=0.0, upper=40.0)
    assert replace(arm, joints=(rail, far, *arm.joints[1:])).length_doubts == ()
    long = scaled(arm, 1e3)
    assert len(replace(long, joints=(rail, *long.joints)).length_doubts) == 1
    # Nothing turns, or nothing is known.
    assert replace(arm, joints=(rail,), frames=(), tip_origin=(0.0, 0.0, 50.0)).length_doubts == ()
    assert replace(arm, joints=arm.joints[:1], frames=(), tip_origin=(0.0, 0.0, 0.0)).length_doubts == ()


def test_a_urdf_is_read_with_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "mm.urdf"
    write_urdf(scaled(UR10E, 1e3), path)
    found = Robot.from_urdf(path)
    assert found.length_doubts[0] in found.warnings
    write_urdf(UR10E, path)
    assert Robot.from_urdf(path).length_doubts == ()


def test_detectors_and_undetectable_forces_tell_it(tmp_path: Path) -> None:
    """A largest undetectable force of 0.2 N was printed of an arm in millimetres, without a word."""
    arm = scaled(UR10E, 1e3)
    path = tmp_path / "mm.urdf"
    write_urdf(arm, path)
    pose, thresholds = "0,-60,90,-30,90,0", "40,40,25,12,12,12"
    result = run("sensitivity", str(path), "--pose-deg", pose, "--thresholds", thresholds, "--json")
    assert Robot.from_urdf(path).length_doubts[0] in json.loads(result.out)["notes"]
    assert arm.length_doubts[0] in Detector(arm, None, Thresholds.parse(thresholds)).notes
    assert not any("metres" in note for note in Detector(UR10E, None, Thresholds.parse(thresholds)).notes)
