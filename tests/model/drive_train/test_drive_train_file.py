"""Drive train files: every digit there and back, and what is wrong in them by name."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from bumpstop.errors import InputError
from bumpstop.model import DriveTrain, Robot, load_drive_train, robot_from_dict
from bumpstop.model.drive_train.entry import QUANTITIES
from bumpstop.text_files import parse_toml

UR5E = Robot.load("ur5e")
JOINTS = [joint.name for joint in UR5E.joints]

positive = st.floats(1e-6, 1e6)


@given(st.data())
def test_there_and_back(tmp_path_factory: pytest.TempPathFactory, data: st.DataObject) -> None:
    values: dict[str, Any] = {
        name: data.draw(st.lists(st.floats(1e-3, 9.0), min_size=6, max_size=6), label=name) for name in QUANTITIES
    }
    values["acceleration_feedforward"] = [value / 9.0 for value in values["acceleration_feedforward"]]
    if data.draw(st.booleans()):
        values["torque_limit"][2] = np.inf
    status = {name: data.draw(st.sampled_from(["published", "identified", "unverified", "assumed"])) for name in values}
    text = st.text(st.characters(exclude_categories=["Cs"]), min_size=1).filter(lambda word: word.strip())
    source = {name: data.draw(text) for name in values}
    drive_train = DriveTrain(**values, status=status, source=source)
    path = tmp_path_factory.mktemp("files") / "drive_train.toml"
    drive_train.save(path, UR5E)
    assert load_drive_train(path, UR5E) == drive_train


def test_what_a_file_leaves_out_is_the_robots(tmp_path: Path) -> None:
    path = tmp_path / "drive_train.toml"
    found = UR5E.drive_train.with_values("gear_stiffness", 12e3, "identified", "pushes")
    found.save(path, UR5E, only=("gear_stiffness",))
    assert set(parse_toml(path.read_text(), "")) == {"format_version", "robot", "joints", "gear_stiffness"}
    assert load_drive_train(path, UR5E) == found
    assert load_drive_train(path, UR5E).status["torque_limit"] == "published"
    # One number stands for all joints.
    path.write_text(re.sub(r"\[\s*(12000\.0,?\s*){6}\]", "12000.0", path.read_text()))
    assert "= 12000.0\n" in path.read_text()
    assert load_drive_train(path, UR5E) == found


HEAD = f'format_version = 1\nrobot = "ur5e"\njoints = {JOINTS!r}\n'.replace("'", '"')
BODY = '[gear_damping]\nvalues = 0.1\nstatus = "assumed"\nsource = "a guess"\n'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", r"drive_train.toml format_version: is missing; wanted a drive train file$"),
        (HEAD.replace("version = 1", "version = 2"), r"drive_train.toml format_version: is 2; wanted 1$"),
        (HEAD.replace("version = 1", "version = true"), r"drive_train.toml format_version: is True; wanted 1$"),
        (HEAD.replace("wrist_1", "wrist_9"), r"drive_train.toml joints: .* are not those of ur5e; wanted \["),
        (
            HEAD.replace("ur5e", "ur10e"),
            r"drive_train.toml robot: is 'ur10e', and the arm is 'ur5e'; wanted its own drive train$",
        ),
        (HEAD + "[gear]\n", r"drive_train.toml gear: is no key of a drive train file; did you mean 'gear_"),
        (
            HEAD + "gear_damping = 3\n",
            r"drive_train.toml gear_damping: 3 is not a table; wanted values, status, source$",
        ),
        (HEAD + BODY.replace("values", "value"), r"gear_damping.value: is not a key of it; did you mean 'values'\?$"),
        (HEAD + BODY.replace('status = "assumed"\n', ""), r"gear_damping.status: is missing; wanted values, status,"),
        (HEAD + BODY.replace("assumed", "known"), r"gear_damping.status: 'known' is none; valid: published"),
        (HEAD + BODY.replace("a guess", " "), r"gear_damping.source: ' ' cannot be used; wanted text"),
        (HEAD + BODY.replace("0.1", "[0.1, 0.1]"), r"gear_damping.values: has shape \(2,\); wanted \(6,\)$"),
        (HEAD + BODY.replace("0.1", "[1, 1, 1, -1, 1, 1]"), r"gear_damping.values\[4\]: is -1; wanted a positive"),
        (HEAD + BODY.replace("0.1", '"0.1"'), r"gear_damping.values: "),
        ("format_version = 1 1", r"drive_train.toml: is not valid TOML"),
    ],
)
def test_files_that_cannot_be_read(tmp_path: Path, text: str, message: str) -> None:
    path = tmp_path / "drive_train.toml"
    path.write_text(HEAD + BODY, encoding="utf-8")
    load_drive_train(path, UR5E)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=message):
        load_drive_train(path, UR5E)


def test_a_drive_train_of_another_arm_is_not_written(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"^drive_train: has 7 joints; wanted 6, as ur5e has$"):
        Robot.load("panda").drive_train.save(tmp_path / "x.toml", UR5E)
    with pytest.raises(InputError, match=r"^only: 'rotor' is no quantity .* did you mean 'rotor_inertia'"):
        UR5E.drive_train.save(tmp_path / "x.toml", UR5E, only=("rotor",))
    with pytest.raises(InputError, match="cannot be read"):
        load_drive_train(tmp_path / "x.toml", UR5E)


ROBOT: dict[str, Any] = {
    "name": "two",
    "tip": {"name": "tool", "origin_m": [0.5, 0, 0]},
    "joint": [
        {"name": name, "link": f"link_{name}", "origin_m": [0.5, 0, 0], "axis": [0, 0, 1], "lower_deg": -90}
        | {"upper_deg": 90, "velocity_deg_s": 90}
        for name in ("a", "b")
    ],
}


def test_the_table_of_a_robot_file() -> None:
    table = {"rotor_inertia": {"values_kg_m2": [0.5, 0.2], "status": "published", "source": "a paper"}}
    robot = robot_from_dict({**ROBOT, "drive_train": table})
    np.testing.assert_array_equal(robot.drive_train.rotor_inertia, [0.5, 0.2])
    assert robot.drive_train.status["rotor_inertia"] == "published"
    assert robot.drive_train.source["rotor_inertia"] == "a paper"
    assert robot_from_dict(ROBOT).drive_train.status["rotor_inertia"] == "assumed"
    for bad, message in (
        (5, r"^drive_train: 5 is not a table; wanted \[drive_train.rotor_inertia\]"),
        ({"rotor": 1}, r"^drive_train.rotor: is no quantity .* did you mean 'rotor_inertia'"),
        (
            {"rotor_inertia": {**table["rotor_inertia"], "values_kg_m2": [1]}},
            r"^drive_train.rotor_inertia.values_kg_m2: ",
        ),
    ):
        with pytest.raises(InputError, match=message):
            robot_from_dict({**ROBOT, "drive_train": bad})


def test_rotors_are_given_once_in_a_robot_file() -> None:
    joint = {**ROBOT["joint"][0], "rotor_inertia_kg_m2": 0.3}
    table = {"rotor_inertia": {"values_kg_m2": 0.5, "status": "published", "source": "a paper"}}
    data = {**ROBOT, "joint": [joint, ROBOT["joint"][1]]}
    assert robot_from_dict(data).drive_train.rotor_inertia[0] == 0.3
    with pytest.raises(InputError, match=r"^drive_train.rotor_inertia: is given beside .* of joint 'a'; give it once$"):
        robot_from_dict({**data, "drive_train": table})


def test_a_file_is_what_a_robot_file_says(tmp_path: Path) -> None:
    UR5E.drive_train.save(tmp_path / "x.toml", UR5E)
    written = parse_toml((tmp_path / "x.toml").read_text(), "")
    tables = {key: value for key, value in written.items() if key in QUANTITIES}
    again = robot_from_dict(
        {
            **ROBOT,
            "joint": [{**ROBOT["joint"][0], "name": name, "link": name} for name in JOINTS],
            "drive_train": tables,
        }
    )
    assert again.drive_train == replace(UR5E.drive_train)


def test_the_robot_may_have_a_longer_name(tmp_path: Path) -> None:
    """The URDF of an arm is called otherwise than the built-in one; another arm of its maker has the same joints."""
    path = tmp_path / "drive_train.toml"
    path.write_text(HEAD + BODY, encoding="utf-8")
    for name in ("UR5e", "ur5e_robot", "ur5e"):
        assert load_drive_train(path, replace(UR5E, name=name)).gear_damping[0] == 0.1
    with pytest.raises(InputError, match=r"robot: is 'ur5e', and the arm is 'ur10e'"):
        load_drive_train(path, Robot.load("ur10e"))
