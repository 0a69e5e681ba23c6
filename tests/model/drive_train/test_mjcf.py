"""Rotor inertia from MJCF files: what MuJoCo reads of the same file, and what is refused."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.arm.compliance import drive_train_of
from bumpstop.model import load_drive_train

mujoco = pytest.importorskip("mujoco")

PANDA = bs.Robot.load("panda")
EXAMPLE = Path(__file__).parents[3] / "examples" / "05_ur10e.toml"
# Classes of defaults within one another, childclass, a frame, and an attribute of a joint's own.
MODEL = """<mujoco model="arm">
  <default>
    <joint armature="0.3"/>
    <default class="arm">
      <joint damping="1" armature="0.1"/>
      <default class="wrist"><joint armature="0.05"/></default>
      <default class="same"><joint damping="2"/></default>
    </default>
  </default>
  <worldbody><body name="a"><geom size="0.1"/><joint name="joint1"/>
    <body name="b" childclass="arm"><geom size="0.1"/><joint name="joint2"/>
      <body name="c"><geom size="0.1"/><joint name="joint3" class="wrist"/>
        <body name="d" childclass="wrist"><geom size="0.1"/><joint name="joint4"/>
          <body name="e"><geom size="0.1"/><joint name="joint5" armature="0.7"/>
            <frame childclass="same"><body name="f"><geom size="0.1"/><joint name="joint6"/>
              <body name="g" childclass="main"><geom size="0.1"/><joint name="joint7"/></body>
            </body></frame>
          </body></body></body></body></body>
  </worldbody>
</mujoco>
"""


def load(tmp_path: Path, text: str, robot: bs.Robot = PANDA) -> bs.model.DriveTrain:
    path = tmp_path / "arm.xml"
    path.write_text(text, encoding="utf-8")
    return load_drive_train(path, robot)


def test_armatures_are_what_mujoco_reads(tmp_path: Path) -> None:
    truth = mujoco.MjModel.from_xml_string(MODEL)
    found = load(tmp_path, MODEL)
    np.testing.assert_array_equal(found.rotor_inertia, truth.dof_armature)
    assert len(set(truth.dof_armature)) == 4
    assert found.status["rotor_inertia"] == "unverified"
    assert found.source["rotor_inertia"] == "armature in the MJCF file arm.xml"
    np.testing.assert_array_equal(found.gear_stiffness, PANDA.drive_train.gear_stiffness)


@pytest.mark.parametrize(
    "sections",
    [
        '<default><joint armature="0.2"/></default><default><joint armature="2.5"/></default>',
        '<default><joint armature="0.2"/></default><default><joint damping="1"/></default>',
        '<default><joint damping="1"/></default><default><joint armature="2.5"/></default>',
        '<default><joint armature="0.2"/><default class="a"><joint damping="1"/></default></default>'
        '<default><joint armature="2.5"/><default class="b"><joint damping="1"/></default></default>',
        '<default><default class="a"><joint armature="0.4"/></default></default>'
        '<default><joint armature="2.5"/><default class="b"/></default>',
    ],
)
def test_sections_of_defaults_go_on_with_those_before(sections: str, tmp_path: Path) -> None:
    classes = [name for name in ("a", "b") if f'class="{name}"' in sections] + ["main"]
    body = '<body name="b{0}"><geom size="0.1"/><joint name="joint{0}" class="{1}" {2}/>'
    parts = [body.format(j, classes[j % len(classes)], 'armature="0.9"' if j > 4 else "") for j in range(1, 8)]
    text = f"<mujoco>{sections}<worldbody>{''.join(parts)}{'</body>' * 7}</worldbody></mujoco>"
    truth = mujoco.MjModel.from_xml_string(text).dof_armature
    found = load(tmp_path, text).rotor_inertia
    np.testing.assert_array_equal(found, np.where(truth > 0, truth, PANDA.drive_train.rotor_inertia))


def test_joints_without_armature_keep_the_robot_s(tmp_path: Path) -> None:
    found = load(tmp_path, MODEL.replace('armature="0.7"', 'armature="0"'))
    assert found.rotor_inertia[4] == PANDA.drive_train.rotor_inertia[4]
    assert found.status["rotor_inertia"] == "assumed"
    assert "for joint 1, 2, 3, 4, 6, 7; " in found.source["rotor_inertia"]


def test_one_figure_for_all_joints_is_told_as_a_placeholder(tmp_path: Path) -> None:
    joints = "".join(f'<body><joint name="panda_joint{n}" armature="0.1"/>' for n in range(1, 8)) + "</body>" * 7
    found = load(tmp_path, f"<mujoco><worldbody>{joints}</worldbody></mujoco>")
    assert found.rotor_inertia.tolist() == [0.1] * 7
    assert found.status["rotor_inertia"] == "assumed"
    assert "placeholder" in found.source["rotor_inertia"]


def test_a_scenario_names_the_file(tmp_path: Path) -> None:
    file = tmp_path / "arm.xml"
    file.write_text(MODEL, encoding="utf-8")
    changes = {
        "robot": "panda",
        "pose_deg": [0, -45, 0, -135, 0, 90, 45],
        "detector.thresholds_Nm": [20] * 7,
        "detector.noise_sd_Nm": [3] * 7,
        "arm.model": "elastic",
        "arm.file": str(file),
    }
    found = drive_train_of(bs.load_scenario(EXAMPLE, changes), PANDA)
    assert found.rotor_inertia[4] == 0.7


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("<robot/>", "has <robot> at its root"),
        ("<mujoco><worldbody/></mujoco>", "has no armature of a joint of panda"),
        ('<mujoco><include file="x.xml"/></mujoco>', "<include> is not followed"),
        (MODEL.replace("0.7", "-0.7"), "joint 'joint5' armature: is -0.7"),
        (MODEL.replace("0.7", "much"), "'much' is not a finite number"),
        (MODEL.replace("0.05", "nan"), "class 'wrist' joint armature: 'nan' is not a finite number"),
        ("<mujoco>", "is not XML"),
        ('<!DOCTYPE m [<!ENTITY a "b">]><mujoco/>', "wanted an MJCF file without them"),
        ("<mujoco><worldbody>" + "<body>" * 20_000 + "</body>" * 20_000 + "</worldbody></mujoco>", "has no armature"),
    ],
)
def test_bad_files_are_refused_by_name(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(bs.InputError) as caught:
        load(tmp_path, text)
    assert words in str(caught.value)
