"""Robots from URDF files in scenarios."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
import pytest

from bumpstop import evaluate
from bumpstop.collision import CollisionProblem, Scenario
from bumpstop.errors import InputError
from model.urdf_cases import ARM, read
from validation import facts

TX40 = facts.folder() / "data" / "staubli_tx40" / "tx40_mdh_modified.urdf"


SCENARIO: dict[str, Any] = {
    "robot": "arm.urdf",
    "pose_rad": [0.4, 0.2, 1.0],
    "motion": {"velocity_mm_s": [30, 0, -40], "task": "position", "damping": 0.01, "duration_s": 0.5},
    "contact": {"body": "hand_finger", "limits": "bgia2011"},
    "detector": {"thresholds_Nm": [10, 20, 5], "noise_sd_Nm": 1.0},
    "reaction": {"joint_acceleration_rad_s2": 5.0},
}


def test_scenario(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    scenario = Scenario.from_dict(SCENARIO, tmp_path)
    law = evaluate(scenario)
    assert law.problem.robot.tip_name == "tool"
    assert "arm.urdf has no inertia for 'wrist'." in law.notes
    # A point of a link that is fixed to another is a point of that other one.
    camera = CollisionProblem.from_scenario(
        scenario.with_values({"contact.link": "camera", "contact.point_m": [0.1, 0, 0]})
    )
    point = [0.1 * math.cos(1.5), 0.05 + 0.1 * math.sin(1.5), 0.0]
    slide = CollisionProblem.from_scenario(scenario.with_values({"contact.link": "slide", "contact.point_m": point}))
    assert camera.approach_speed == pytest.approx(slide.approach_speed, rel=1e-12)


def test_scenario_with_base_and_tip(tmp_path: Path) -> None:
    (tmp_path / "arm.urdf").write_text(ARM)
    scenario = Scenario.from_dict({**SCENARIO, "base": "base", "tip": "camera", "pose_rad": [0.4, 0.2]}, tmp_path)
    scenario = scenario.with_values({"detector.thresholds_Nm": [10, 20]})
    with pytest.raises(InputError, match=r"^motion.task: 'position' needs 3 free joints, 2 are free"):
        evaluate(scenario)
    for key, value in (("base", "bas"), ("tip", "camra")):
        with pytest.raises(InputError, match=f"^{key}: arm.urdf has no link {value!r}; did you mean") as refused:
            CollisionProblem.from_scenario(scenario.with_values({key: value}))
        assert refused.value.field == key
        with pytest.raises(InputError, match=rf"^{key}: has no meaning with the built-in robot 'ur10e'; "):
            Scenario.from_dict({**SCENARIO, "robot": "ur10e", key: value}, tmp_path)


@pytest.mark.skipif(not TX40.is_file(), reason=f"{TX40} is not there: set BUMPSTOP_SHARED")
def test_a_file_that_nobody_here_wrote() -> None:
    scenario = Scenario.from_dict(
        {
            **SCENARIO,
            "robot": TX40.name,
            "pose_rad": [0.2, 0.4, 1.2, 0.2, 1.0, 0.3],
            "motion": {"velocity_mm_s": [0, 0, -50]},
            "detector": {"thresholds_Nm": [20, 20, 15, 6, 6, 4], "noise_sd_Nm": 1.0},
        },
        TX40.parent,
    )
    law = evaluate(scenario)
    assert 0 < law.peak_force.quantile(0.5) < math.inf
    arm = law.problem.robot
    assert (arm.dof, arm.tip_name, arm.warnings, arm.inertia_status) == (6, "tool0", (), "unverified")
    model = pin.buildModelFromUrdf(str(TX40))
    data = model.createData()
    rng = np.random.default_rng(2)
    for q in rng.uniform(arm.lower, arm.upper, (50, 6)):
        pin.framesForwardKinematics(model, data, q)
        pose = data.oMf[model.getFrameId("tool0")].homogeneous
        np.testing.assert_allclose(arm.pose(q), pose, rtol=0, atol=1e-14)
    assert sum(joint.inertia.mass for joint in arm.joints if joint.inertia) == pytest.approx(23.01)


def test_what_is_fixed_to_a_link_does_not_tell_what_it_weighs(tmp_path: Path) -> None:
    """A link with a shape has a mass that the file keeps to itself; a mere frame has none."""
    begin = ARM.index("<inertial>", ARM.index('<link name="slide">'))
    end = ARM.index("</inertial>", begin) + len("</inertial>")
    shape = "<collision><geometry><box size='0.1 0.1 0.3'/></geometry></collision>"
    shaped, frame = (read(ARM[:begin] + text + ARM[end:], tmp_path) for text in (shape, ""))
    assert shaped.joints[1].inertia is None
    assert shaped.warnings == ("arm.urdf has no inertia for 'slide', 'wrist'.",)
    assert frame.joints[1].inertia is not None
    assert frame.joints[1].inertia.mass == pytest.approx(0.3)


def test_a_part_with_a_shape_and_no_mass_is_told(tmp_path: Path) -> None:
    """A hand without inertia weighed nothing, and nobody said so."""
    shape = '<visual><geometry><box size="0.1 0.1 0.1"/></geometry></visual>'
    arm = read(ARM.replace('<link name="tool"/>', f'<link name="tool">{shape}</link>'), tmp_path)
    assert arm.warnings == ("arm.urdf has no inertia for 'wrist'.",), "that link is unknown as a whole"
    wrist = ARM[
        ARM.index("<inertial>", ARM.index('<link name="camera">')) : ARM.index("</inertial>", ARM.rindex("<inertial>"))
    ]
    known = ARM.replace('<link name="wrist"/>', f'<link name="wrist">{wrist}</inertial></link>')
    arm = read(known.replace('<link name="tool"/>', f'<link name="tool">{shape}</link>'), tmp_path)
    said = "arm.urdf has a shape and no mass for 'tool': what it weighs is left out."
    assert said in arm.mass_warnings
    assert said in arm.warnings
    assert said not in read(known, tmp_path).warnings


@pytest.mark.parametrize(("joint", "rpy"), [("turn", "0 0.3 0"), ("flange", "1.57 0 0.2")])
def test_origins_that_are_turned_by_degrees_are_told(joint: str, rpy: str, tmp_path: Path) -> None:
    """Limits in degrees were doubted, a turn by 90 rad was not."""
    said = f"Origins turned by more than a whole turn, taken as radians; degrees? Joint {joint!r} (90)."
    assert said in read(ARM.replace(f'rpy="{rpy}"', 'rpy="0 -90 0"'), tmp_path).doubts
    whole = read(ARM.replace(f'rpy="{rpy}"', 'rpy="0 -6.2832 0"'), tmp_path)
    assert not any("degrees" in warning for warning in whole.warnings)
