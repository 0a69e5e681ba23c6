"""Torque limits and rotors of motors before their gears are none of the joints, wherever they come from."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.model import Robot, robots
from bumpstop.model.drive_train.assumed import gear_doubt, rotor_doubt, torque_limit_doubt
from bumpstop.model.drive_train.entry import DriveTrainEntry
from bumpstop.model.urdf.writer import write_urdf

EXAMPLES = Path(__file__).parents[3] / "examples"
UR10E = Robot.load("ur10e")
BARE = replace(UR10E, drive_train_entries=())
# Those of its motors, before gears of 101 to 1.
MOTOR_SIDE = (3.27, 3.27, 1.49, 0.55, 0.56, 0.57)


def with_efforts(folder: Path, efforts: tuple[float, ...], more: str = "") -> Robot:
    path = folder / "arm.urdf"
    write_urdf(UR10E, path)
    text = path.read_text(encoding="utf-8")
    assert len(re.findall(r'effort="[^"]*"', text)) == 6
    given = iter(efforts)
    text = re.sub(r'effort="[^"]*"', lambda _: f'effort="{next(given)}"', text)
    path.write_text(text.replace("</robot>", more + "</robot>"), encoding="utf-8")
    return Robot.from_urdf(path)


@pytest.mark.parametrize("name", robots())
def test_drives_of_built_in_arms_are_believed(name: str) -> None:
    robot = Robot.load(name)
    assert torque_limit_doubt(robot, robot.drive_train.torque_limit) == ""
    assert rotor_doubt(robot, robot.drive_train.rotor_inertia) == ""
    assert gear_doubt(robot, robot.drive_train.gear_stiffness) == ""
    assert torque_limit_doubt(robot, np.full(robot.dof, np.inf)) == ""


def test_efforts_of_motors_are_no_torque_limits_and_make_no_gears_soft(tmp_path: Path) -> None:
    """The gears of the class are twisted by 0.01 rad at the limit: they were a hundredth as stiff."""
    found = with_efforts(tmp_path, MOTOR_SIDE)
    assert np.isinf(found.drive_train.torque_limit).all()
    assert found.drive_train.status["torque_limit"] == "assumed"
    plain = with_efforts(tmp_path, (0.0,) * 6)
    np.testing.assert_array_equal(found.drive_train.gear_stiffness, plain.drive_train.gear_stiffness)
    (said,) = [warning for warning in found.warnings if "torque limits" in warning]
    assert "joint 2 has 3.27 Nm, and its links take up to 139 Nm" in said
    assert plain.warnings == with_efforts(tmp_path, (330.0, 330.0, 150.0, 56.0, 56.0, 56.0)).warnings


def test_one_limit_that_cannot_hold_casts_doubt_on_all() -> None:
    limits = (330.0, 330.0, 5.0, 56.0, 56.0, 56.0)
    entry = DriveTrainEntry(quantity="torque_limit", values=limits, status="published", source="sheet")
    assert np.isinf(replace(BARE, drive_train_entries=(entry,)).drive_train.torque_limit).all()
    assert "joint 3 has 5 Nm" in torque_limit_doubt(BARE, limits)
    # Springs may carry a part of the weight.
    assert torque_limit_doubt(BARE, (330.0, 40.0, 20.0, 8.0, 4.0, 0.5)) == ""


def test_a_rotor_before_its_gear_is_not_that_of_the_joint(tmp_path: Path) -> None:
    """Without the ratio, 1 stands for it: the arm was as light as its links."""
    limits, rotors = (330.0, 330.0, 150.0, 56.0, 56.0, 56.5), (2e-4, 2e-4, 1e-4, 4e-5, 4e-5, 5e-5)
    transmission = (
        '<transmission name="t"><joint name="{}"/><actuator name="m"><motorInertia>{}</motorInertia>{}</actuator>'
        "</transmission>"
    )
    names = [joint.name for joint in UR10E.joints]
    found = {}
    for ratio in ("", "<mechanicalReduction>101</mechanicalReduction>"):
        more = "".join(transmission.format(name, rotor, ratio) for name, rotor in zip(names, rotors, strict=True))
        found[ratio] = with_efforts(tmp_path, limits, more)
    bare, geared = found.values()
    assert bare.drive_train.status["rotor_inertia"] == "assumed"
    assert bare.drive_train.rotor_inertia[0] == pytest.approx(3.3)
    (said,) = [warning for warning in bare.warnings if "rotor" in warning]
    assert "is the gear ratio missing? They count as unknown." in said
    assert geared.drive_train.rotor_inertia[0] == pytest.approx(2e-4 * 101**2)
    assert not any("rotor" in warning for warning in geared.warnings)


ROTORS = np.array((3.3e-4, 3.3e-4, 1.5e-4, 5.6e-5, 5.6e-5, 5.6e-5))


def told(changes: dict[str, object]) -> list[str]:
    elastic = bs.load_scenario(EXAMPLES / "05_ur10e.toml", {"arm.model": "elastic", **changes})
    return [warning for warning in bs.evaluate(elastic).warnings if "ASSUMED" not in warning]


def test_an_elastic_arm_of_rotors_before_their_gears_is_told(tmp_path: Path) -> None:
    """Forces came out a third too low of armatures, files and keys, without a word; only a URDF's were doubted."""
    mjcf, file = tmp_path / "arm.xml", tmp_path / "drive_train.toml"
    bodies = "".join(
        f'<body><joint name="{joint.name}" armature="{rotor}"/></body>'
        for joint, rotor in zip(UR10E.joints, ROTORS, strict=True)
    )
    mjcf.write_text(f"<mujoco><worldbody>{bodies}</worldbody></mujoco>", encoding="utf-8")
    UR10E.drive_train.with_values("rotor_inertia", ROTORS, "published", "sheet").save(file, UR10E)
    for changes in ({"arm.file": str(mjcf)}, {"arm.file": str(file)}, {"arm.rotor_inertia_kg_m2": ROTORS.tolist()}):
        (warning,) = told(changes)
        assert "joint 1 has 0.00033 kg m2, arms like it 3.3 kg m2; is the gear ratio missing?" in warning
    assert told({"arm.rotor_inertia_kg_m2": (ROTORS * 101**2).tolist()}) == []


def test_gears_in_another_unit_are_told() -> None:
    """Of Nm per degree they are a 57th as stiff, and forces were 40 % too low."""
    stiffness = UR10E.drive_train.gear_stiffness
    (warning,) = told({"arm.gear_stiffness_Nm_rad": np.radians(stiffness).tolist()})
    assert "joint 1 has 576 Nm/rad, arms like it 3.3e+04 Nm/rad; in another unit" in warning
    assert told({"arm.gear_stiffness_Nm_rad": (0.1 * stiffness).tolist()}) == []
