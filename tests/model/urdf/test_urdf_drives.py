"""What a URDF tells of motors is read where it can be meant, and passed over where it cannot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bumpstop.model import Robot, with_rotors
from bumpstop.model.drive_train.assumed import assumed_drive_train
from bumpstop.model.urdf.writer import write_urdf
from model.urdf_cases import ARM

TRANSMISSION = (
    '<transmission name="t"><joint name="{joint}">{inside}</joint>'
    '<actuator name="m">{actuator}</actuator>{more}</transmission>'
)


def read(tmp_path: Path, *changes: tuple[str, str], extra: str = "") -> Robot:
    text = ARM
    for old, new in changes:
        assert text.count(old) >= 1
        text = text.replace(old, new)
    path = tmp_path / "arm.urdf"
    path.write_text(text.replace("</robot>", extra + "</robot>"))
    return Robot.from_urdf(path, tip="tool")


def transmission(joint: str, actuator: str, inside: str = "", more: str = "") -> str:
    return TRANSMISSION.format(joint=joint, actuator=actuator, inside=inside, more=more)


def test_effort_limits(tmp_path: Path) -> None:
    drive_train = read(tmp_path, ('velocity="1" effort="50"', 'velocity="1" effort="80"')).drive_train
    np.testing.assert_array_equal(drive_train.torque_limit, [50, 80, np.inf])
    assert drive_train.status["torque_limit"] == "unverified"
    assert drive_train.source["torque_limit"] == "the URDF file arm.urdf"
    # The rated torque of the class is the limit where there is one.
    assert drive_train.gear_stiffness[0] == 5000.0
    assert drive_train.status["gear_stiffness"] == "assumed"


@pytest.mark.parametrize("effort", ["3.4028235e+38", "inf", "", "-1", "0", "nan", "strong", "1e9"])
def test_efforts_that_cannot_be_meant(effort: str, tmp_path: Path) -> None:
    robot = read(tmp_path, ('velocity="3" effort="50"', f'velocity="3" effort="{effort}"'))
    np.testing.assert_array_equal(robot.drive_train.torque_limit, [np.inf, 50, np.inf])
    robot = read(tmp_path, ('effort="50"', f'effort="{effort}"'))
    assert robot.drive_train == assumed_drive_train(robot)
    assert robot.drive_train_entries == ()


def test_one_effort_for_all_joints_is_a_placeholder(tmp_path: Path) -> None:
    axis = '<axis xyz="0.6 0 0.8"/>'
    alike = read(tmp_path, (axis, axis + '<limit effort="50" velocity="2"/>'))
    assert alike.drive_train_entries == ()
    other = read(tmp_path, (axis, axis + '<limit effort="51" velocity="2"/>'))
    np.testing.assert_array_equal(other.drive_train.torque_limit, [50, 50, 51])


DRAKE = '<robot name="arm" xmlns:drake="http://drake.mit.edu">'


def test_rotors_of_transmissions(tmp_path: Path) -> None:
    """Drake's elements; the number as text with a reduction at the actuator, at the joint or at the transmission."""
    extra = (
        transmission("turn", '<drake:rotor_inertia value="2e-4"/><drake:gear_ratio value="100"/>')
        + transmission("push", "<rotorInertia>1e-4</rotorInertia>", "<mechanicalReduction>-300</mechanicalReduction>")
        + transmission(
            "roll", "<motorInertia> 3e-5 </motorInertia>", more="<mechanicalReduction>50</mechanicalReduction>"
        )
    )
    robot = read(tmp_path, ('<robot name="arm">', DRAKE), extra=extra)
    np.testing.assert_allclose(robot.drive_train.rotor_inertia, [2e-4 * 100**2, 1e-4 * 300**2, 3e-5 * 50**2])
    assert robot.drive_train.status["rotor_inertia"] == "unverified"
    # The mass matrix is that of the links, as in every robot without rotors in its joints.
    assert with_rotors(robot, 0.0) == robot


@pytest.mark.parametrize("ratio", ["1:100", "${ratio}", "", "inf"])
def test_a_ratio_that_cannot_be_read_is_not_1(ratio: str, tmp_path: Path) -> None:
    text = f"<rotorInertia>2e-4</rotorInertia><mechanicalReduction>{ratio}</mechanicalReduction>"
    robot = read(tmp_path, extra=transmission("turn", text))
    assert robot.drive_train.rotor_inertia[0] == assumed_drive_train(robot).rotor_inertia[0]
    assert robot.drive_train.status["rotor_inertia"] == "assumed"


def test_rotors_of_some_joints(tmp_path: Path) -> None:
    robot = read(tmp_path, ('<axis xyz="0 1 0"/>', '<axis xyz="0 1 0"/><dynamics armature="0.7" damping="1"/>'))
    assumed = assumed_drive_train(robot).rotor_inertia
    np.testing.assert_array_equal(robot.drive_train.rotor_inertia, [0.7, *assumed[1:]])
    assert robot.drive_train.status["rotor_inertia"] == "assumed"
    assert "for joint 1; a class of arms" in robot.drive_train.source["rotor_inertia"]


@pytest.mark.parametrize(
    "extra",
    [
        transmission("turn", "<mechanicalReduction>100</mechanicalReduction>"),
        transmission("turn", "<rotorInertia>light</rotorInertia>"),
        transmission("turn", "<rotorInertia>-1e-4</rotorInertia><mechanicalReduction>100</mechanicalReduction>"),
        transmission("turn", "<rotorInertia>1e4</rotorInertia><mechanicalReduction>100</mechanicalReduction>"),
        transmission("turn", "<rotorInertia>1e-4</rotorInertia>", more='<joint name="push"/>'),
        transmission("elsewhere", "<rotorInertia>1e-4</rotorInertia>"),
        "<transmission/>",
        "".join(transmission(joint, "<rotorInertia>0.1</rotorInertia>") for joint in ("turn", "push", "roll")),
    ],
    ids=["no rotor", "text", "negative", "huge", "coupled", "of another joint", "empty", "placeholder"],
)
def test_transmissions_that_tell_nothing(extra: str, tmp_path: Path) -> None:
    robot = read(tmp_path, extra=extra)
    assert [entry.quantity for entry in robot.drive_train_entries] == ["torque_limit"]


def test_files_that_are_written_keep_torque_limits(tmp_path: Path) -> None:
    robot = Robot.load("ur5e")
    write_urdf(robot, tmp_path / "ur5e.urdf")
    again = Robot.from_urdf(tmp_path / "ur5e.urdf")
    np.testing.assert_array_equal(again.drive_train.torque_limit, robot.drive_train.torque_limit)
