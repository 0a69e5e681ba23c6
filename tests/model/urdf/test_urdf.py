"""URDF files: what is read, what is refused and how it is said, and what Pinocchio makes of the same files."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest

from bumpstop.errors import InputError
from bumpstop.model import Robot
from bumpstop.model.urdf.reader import read_urdf
from model.urdf_cases import ARM, changed, check, random_urdf, read

# --- What is read -----------------------------------------------------------------------------------------------------


def test_a_chain(tmp_path: Path) -> None:
    arm = read(ARM, tmp_path)
    check(ARM, arm)
    assert (arm.name, arm.tip_name, arm.warnings) == ("arm", "tool", ("arm.urdf has no inertia for 'wrist'.",))
    assert [joint.name for joint in arm.joints] == ["turn", "push", "roll"]
    assert [joint.link for joint in arm.joints] == ["upper", "slide", "wrist"]
    assert [joint.kind for joint in arm.joints] == ["revolute", "prismatic", "revolute"]
    assert arm.lower.tolist() == [-2.0, 0.0, -math.inf]
    assert arm.upper.tolist() == [2.5, 0.5, math.inf]
    assert arm.velocity.tolist() == [3.0, 1.0, math.inf]
    assert arm.source == "the URDF file arm.urdf"
    assert arm.inertia_status == "unknown"
    assert read_urdf(tmp_path / "arm.urdf").links["upper"].meshes == ("package://arm/upper.stl",)


def test_fixed_links_give_their_mass_and_keep_their_name(tmp_path: Path) -> None:
    arm = read(ARM, tmp_path)
    assert [frame.name for frame in arm.frames] == ["camera"]
    inertia = arm.joints[1].inertia
    assert inertia is not None
    assert inertia.mass == pytest.approx(2.8)
    # The camera's centre, 0.01 along its x, which points along (cos 1.5, sin 1.5).
    place = np.array([0.01 * math.cos(1.5), 0.05 + 0.01 * math.sin(1.5), 0.0])
    np.testing.assert_allclose(inertia.center, 0.3 / 2.8 * place, rtol=0, atol=1e-15)
    number, point = arm.frame("camera", (0.01, 0, 0))
    assert number == 1
    np.testing.assert_allclose(point, place, rtol=0, atol=1e-15)
    q = np.array([0.3, 0.2, 1.0])
    camera = arm.pose(q, "slide") @ np.array(
        [[math.cos(1.5), -math.sin(1.5), 0, 0], [math.sin(1.5), math.cos(1.5), 0, 0.05], [0, 0, 1, 0], [0, 0, 0, 1]]
    )
    np.testing.assert_allclose(arm.pose(q, "camera"), camera, rtol=0, atol=1e-14)
    np.testing.assert_allclose(arm.pose(q[None], "camera")[0], camera, rtol=0, atol=1e-14)
    np.testing.assert_array_equal(arm.jacobian(q, "camera"), arm.jacobian(q, "slide", (0, 0.05, 0)))


@pytest.mark.parametrize(
    ("rpy", "said"), [("0 0 2", False), ("1e-5 0 1", False), ("0.1 0 0", True), ("3.14 0 0", True)]
)
def test_a_base_that_is_not_upright_is_told(rpy: str, said: bool, tmp_path: Path) -> None:
    mount = f'<joint name="bolt" type="fixed"><origin rpy="{rpy}"/><parent link="world"/><child link="base"/></joint>'
    text = changed(('<link name="base"/>', f'<link name="world"/><link name="base"/>{mount}'))
    sentence = (
        "Gravity, unless it is given, is taken along -z of 'base', which the file turns against 'world'; "
        "base='world' keeps it."
    )
    assert (sentence in read(text, tmp_path, "base").warnings) is said
    assert not any("Gravity" in warning for warning in read(text, tmp_path).warnings)


def test_limits_that_are_degrees_are_told(tmp_path: Path) -> None:
    text = changed(('lower="-2"', 'lower="-170"'))
    assert "Joint 'turn' (-170 to" in "".join(read(text, tmp_path).warnings)
    assert not any("degrees" in warning for warning in read(ARM, tmp_path).warnings)


def test_the_tip_keeps_its_orientation(tmp_path: Path) -> None:
    arm = read(ARM, tmp_path)
    model = pin.buildModelFromXML(ARM)
    data = model.createData()
    pin.framesForwardKinematics(model, data, np.array([0.3, 0.2, math.cos(1.0), math.sin(1.0)]))
    pose = data.oMf[model.getFrameId("tool")].homogeneous
    np.testing.assert_allclose(arm.pose([0.3, 0.2, 1.0]), pose, rtol=0, atol=1e-14)


def test_base_and_tip_are_chosen(tmp_path: Path) -> None:
    whole = read(ARM, tmp_path)
    part = read(ARM, tmp_path, "upper", "slide")
    assert [joint.name for joint in part.joints] == ["push"]
    assert part.warnings[0] == "Moves 'upper' itself and is taken to stand still: 'turn'."
    assert part.warnings[1] == "Beside the chain, joint 'roll' moves 'wrist': left out, with 0 kg in 2 links."
    assert (part.tip_name, part.tip_origin) == ("slide", (0.0, 0.0, 0.0))
    q = [0.3, 0.2, 0.0]
    between = np.linalg.inv(whole.pose(q, "upper")) @ whole.pose(q, "slide")
    np.testing.assert_allclose(part.pose([0.2]), between, rtol=0, atol=1e-14)


def test_what_moves_beside_the_chain_is_left_out_and_said(tmp_path: Path) -> None:
    finger = """<link name="finger"><inertial><mass value="0.2"/><inertia ixx="0" iyy="0" izz="0" ixy="0" ixz="0"
        iyz="0"/></inertial></link><joint name="grip" type="prismatic"><mimic joint="turn"/><parent link="tool"/>
        <child link="finger"/><limit lower="0" upper="1" velocity="1"/></joint></robot>"""
    text = ARM.replace("</robot>", finger)
    arm = read(text, tmp_path, tip="tool")
    assert arm.warnings[0] == "Beside the chain, joint 'grip' moves 'finger': left out, with 0.2 kg in 1 link."
    assert [joint.name for joint in arm.joints] == ["turn", "push", "roll"]
    with pytest.raises(InputError, match=r"joint 'grip': follows joint 'turn' \(mimic\); wanted joints that move on"):
        read(text, tmp_path)
    # A planar joint beside the chain is no more in the way than a revolute one.
    other = changed(
        (
            "</robot>",
            '<link name="p"/><joint name="s" type="planar"><parent link="wrist"/><child link="p"/></joint></robot>',
        )
    )
    assert read(other, tmp_path, tip="tool").dof == 3
    with pytest.raises(InputError, match=r"^tip: is missing, and arm.urdf has 2 ends; give one of 'tool', 'p'$"):
        read(changed(("</robot>", other[other.index('<link name="p"') :].replace("planar", "fixed"))), tmp_path)


def test_other_namespaces_and_extensions_are_passed_over(tmp_path: Path) -> None:
    text = changed(
        (
            '<robot name="arm">',
            '<robot name="arm" xmlns="http://www.ros.org" xmlns:xacro="http://www.ros.org/wiki/xacro">',
        ),
        ("</robot>", "<gazebo><a/></gazebo><ros2_control/><transmission><joint name='turn'/></transmission></robot>"),
        ("<visual>", "<self_collision_checking/><visual>"),
    )
    assert read(text, tmp_path).dof == 3


def test_axes_come_out_of_length_one(tmp_path: Path) -> None:
    arm = read(changed(("0.6 0 0.8", "0.6000003 0 0.8000004")), tmp_path)
    assert abs(np.linalg.norm(arm.joints[2].axis) - 1) < 3e-16


@pytest.mark.parametrize("effort", ["3.4028235e+38", "inf", "", "-1"])
def test_efforts_are_passed_over(effort: str, tmp_path: Path) -> None:
    """Programs that know of no limit write the greatest number there is, an infinity or nothing."""
    arm = read(changed(('velocity="3" effort="50"', f'velocity="3" effort="{effort}"')), tmp_path)
    assert (arm.joints[0].lower, arm.joints[0].upper, arm.joints[0].velocity) == (-2, 2.5, 3)


def test_axes_of_five_digits_are_axes(tmp_path: Path) -> None:
    """Exporters of drawing programs round every figure so; the direction that is meant is off by less than 1e-5."""
    rng = np.random.default_rng(9)
    for axis in (*rng.normal(size=(200, 3)), np.array([1.0, 0.0, 1.0]), np.array([1.0, 1.0, 1.0])):
        meant = axis / np.linalg.norm(axis)
        written = " ".join(f"{value:.5g}" for value in meant)
        found = np.asarray(read(changed(("0.6 0 0.8", written)), tmp_path).joints[2].axis)
        assert abs(np.linalg.norm(found) - 1) < 3e-16
        assert np.abs(found - meant).max() < 1e-5


def test_random_files_as_pinocchio_reads_them(tmp_path: Path) -> None:
    rng = np.random.default_rng(1)
    merged = 0
    for _ in range(60):
        text = random_urdf(rng)
        arm = read(text, tmp_path, tip="tip")
        check(text, arm)
        model = pin.buildModelFromXML(text)
        data = model.createData()
        assert model.njoints == arm.dof + 1
        q = rng.uniform(np.maximum(arm.lower, -3), np.minimum(arm.upper, 3))
        theirs = np.zeros(model.nq)
        for value, joint in zip(q, arm.joints, strict=True):
            moved = model.joints[model.getJointId(joint.name)]
            theirs[moved.idx_q : moved.idx_q + moved.nq] = (
                value if moved.nq == 1 else (math.cos(value), math.sin(value))
            )
        pin.framesForwardKinematics(model, data, theirs)
        for name in ("tip", *(frame.name for frame in arm.frames), *(joint.link for joint in arm.joints)):
            pose = data.oMf[model.getFrameId(name)].homogeneous
            np.testing.assert_allclose(arm.pose(q, name), pose, rtol=0, atol=1e-12)
        for joint in arm.joints:
            inertia = model.inertias[model.getJointId(joint.name)]
            if joint.inertia is None:
                assert inertia.mass == 0
                continue
            merged += 1
            assert joint.inertia.mass == pytest.approx(inertia.mass, rel=1e-14)
            np.testing.assert_allclose(joint.inertia.center, inertia.lever, rtol=0, atol=1e-14)
            np.testing.assert_allclose(joint.inertia.tensor, inertia.inertia, rtol=0, atol=1e-13)
    assert merged > 150


# --- What is refused --------------------------------------------------------------------------------------------------

LIMIT = '<limit lower="-2" upper="2.5" velocity="3" effort="50"/>'
MASS = '<mass value="4"/>'
INERTIA = '<inertia ixx="0.03" iyy="0.03" izz="0.01" ixy="0" ixz="0.001" iyz="0"/>'
ROLL = '<joint name="roll" type="continuous">'


@pytest.mark.parametrize(
    ("replacement", "message"),
    [
        # The tree.
        (
            ('<child link="wrist"/>', '<child link="slide"/>'),
            r"link 'slide': has two parents: joints 'push' and 'roll'",
        ),
        (('<parent link="base"/>', '<parent link="tool"/>'), r"joint 'turn': closes a loop through link"),
        (('<parent link="base"/>', '<parent link="upper"/>'), r"joint 'turn': closes a loop through link 'upper'"),
        (
            ('<parent link="base"/>', '<parent link="bas"/>'),
            r"joint 'turn' parent: there is no link 'bas'; did .* 'base'",
        ),
        (
            ('<child link="tool"/>', '<child link="tol"/>'),
            r"joint 'flange' child: there is no link 'tol'; did .* 'tool'",
        ),
        (('<link name="base"/>', '<link name="base"/><link name="base"/>'), r"link 'base': occurs twice"),
        (('name="push"', 'name="turn"'), r"joint 'turn': occurs twice"),
        (
            ('<link name="base"/>', '<link name="base"/><link name="lost"/>'),
            r"has 2 links without a parent: 'base', 'lost'",
        ),
        (('<link name="base"/>', ""), r"joint 'turn' parent: there is no link 'base'"),
        (('<link name="base"/>', "<link/>"), r"<link> has no name"),
        (('<link name="base"/>', f'<link name="{"x" * 201}"/>'), r"is longer than 200 characters"),
        (('<child link="upper"/>', ""), r"joint 'turn': has no <child>"),
        (('<child link="upper"/>', '<child link="upper"/><child link="upper"/>'), r"joint 'turn': has 2 <child>"),
        # Kinds.
        (
            ('type="prismatic"', 'type="planar"'),
            r"joint 'push': is planar; wanted revolute, continuous, prismatic and fixed",
        ),
        (('type="prismatic"', 'type="floating"'), r"joint 'push': is floating"),
        (
            ('type="prismatic"', 'type="slider"'),
            r"joint 'push' type: 'slider' is no kind of joint; valid: revolute, con",
        ),
        (('type="prismatic"', ""), r"joint 'push': <joint> has no type"),
        ((ROLL, ROLL + '<mimic joint="turn"/>'), r"joint 'roll': follows joint 'turn' \(mimic\)"),
        ((ROLL, ROLL + '<mimic joint="trn"/>'), r"joint 'roll' mimic: there is no joint 'trn'; did you mean 'turn'"),
        ((ROLL, ROLL + "<mimick/>"), r"joint 'roll': <mimick> is not an element of a URDF there; did you mean 'mimic'"),
        # Axes.
        (('xyz="0.6 0 0.8"', 'xyz="0 0 0"'), r"joint 'roll' axis: is zero; wanted a unit vector"),
        (('xyz="0.6 0 0.8"', 'xyz="0 0 2"'), r"joint 'roll' axis: '0 0 2' has length 2; wanted 0 0 1"),
        (('xyz="0.6 0 0.8"', 'xyz="0.6 0 0.80002"'), r"joint 'roll' axis: .* has length 1.00002; wanted 0.59999"),
        (
            ('xyz="0.6 0 0.8"', 'xyz="0 nan 1"'),
            r"joint 'roll' axis xyz: 'nan' is not a finite number; wanted 3 numbers",
        ),
        (('xyz="0.6 0 0.8"', 'xyz="0 1"'), r"joint 'roll' axis xyz: '0 1' has 2 values; wanted 3 numbers"),
        (('xyz="0.6 0 0.8"', ""), r"joint 'roll' axis xyz: is missing"),
        # Numbers.
        (('xyz="0 0 0.4"', 'xyz="0 0 inf"'), r"joint 'turn' origin xyz: 'inf' is not a finite number"),
        (('xyz="0 0 0.4"', 'xyz="0 0 1e400"'), r"joint 'turn' origin xyz: 1e400 is too large; wanted at most 1000 m"),
        (('xyz="0 0 0.4"', 'xyz="0,0,1"'), r"joint 'turn' origin xyz: '0,0,1' has 1 values"),
        (('xyz="0 0 0.4"', 'xyz="0 0 1_0"'), r"joint 'turn' origin xyz: '1_0' is not a finite number"),
        (('xyz="0 0 0.4"', 'zyx="0 0 0.4"'), r"joint 'turn' origin: 'zyx' is not one of its attributes; .*xyz"),
        # Limits.
        ((LIMIT, ""), r"joint 'turn' limit: is missing; wanted <limit> with lower, upper and velocity"),
        ((LIMIT, '<limit lower="-2" velocity="3"/>'), r"joint 'turn' limit: has no upper; wanted lower, upper and"),
        ((LIMIT, '<limit lower="-2" upper="2"/>'), r"joint 'turn' limit: has no velocity"),
        (
            (LIMIT, '<limit lower="2" upper="-2" velocity="3"/>'),
            r"joint 'turn' limit: lower 2 is not below upper -2; wanted lower below upper; \"continuous\" joints have",
        ),
        (
            (LIMIT, '<limit effort="0" lower="0" upper="0" velocity="0"/>'),
            r"joint 'turn' limit: lower 0 is not below upper 0; wanted lower below upper",
        ),
        (
            (LIMIT, '<limit lower="-2" upper="2" velocity="0"/>'),
            r"joint 'turn' limit: velocity is 0; wanted a positive",
        ),
        ((LIMIT, '<limit lower="nan" upper="2" velocity="3"/>'), r"joint 'turn' limit lower: 'nan' is not a finite"),
        (
            (LIMIT, '<limit lowr="-2" upper="2" velocity="3"/>'),
            r"joint 'turn' limit: 'lowr' is not .* did you mean 'lower'",
        ),
        ((LIMIT, LIMIT + LIMIT), r"joint 'turn': has 2 <limit>"),
        # Inertia.
        ((MASS, '<mass value="-4"/>'), r"link 'upper' mass: -4.0 kg; wanted zero or more"),
        ((MASS, '<mass value="nan"/>'), r"link 'upper' mass value: 'nan' is not a finite number"),
        ((MASS, ""), r"link 'upper' inertial: has no <mass>"),
        ((INERTIA, ""), r"link 'upper' inertial: has no <inertia>"),
        ((' iyz="0"/>', "/>"), r"link 'upper' inertia iyz: is missing"),
        (('ixx="0.03"', 'ixx="-0.03"'), r"link 'upper' inertia: has a negative principal moment"),
        (("<inertial>", "<inertail>"), r"is not XML"),
        ((MASS, MASS + MASS), r"link 'upper' inertial: has 2 <mass>"),
        (('<link name="wrist"/>', '<link name="wrist"><inertai/></link>'), r"link 'wrist': <inertai> is .* 'inertial'"),
        # The file.
        (('<robot name="arm">', "<robot>"), r"<robot> has no name"),
        (
            ('<robot name="arm">', '<!DOCTYPE a [<!ENTITY b "c">]><robot name="&b;">'),
            r"has a document type or entities",
        ),
        (('<robot name="arm">', '<!DOCTYPE a SYSTEM "file:///etc/passwd"><robot name="arm">'), r"has a document type"),
        (("</robot>", ""), r"is not XML \(no element found: line"),
        (
            ('xyz="0.6 0 0.8"', 'xyz="${axis}"'),
            r"is a xacro file, not yet a URDF; expand it first: xacro FILE.xacro > FILE",
        ),
        (("</robot>", "<xacro:arm/></robot>"), r"is a xacro file"),
    ],
)
def test_refused(replacement: tuple[str, str], message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message) as refused:
        read(changed(replacement), tmp_path)
    assert refused.value.field.startswith(str(tmp_path / "arm.urdf"))


def test_declared_xacro_is_recognised(tmp_path: Path) -> None:
    declared = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:include filename="x"/></robot>'
    with pytest.raises(InputError, match="is a xacro file"):
        read(declared, tmp_path)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not XML"),
        ("robot: arm", "is not XML"),
        ("<sdf/>", r"begins with <sdf>; wanted a URDF file, which begins with <robot>"),
        ('<robot name="arm"/>', "has no links"),
        (b'<?xml version="1.0" encoding="klingon"?><robot/>', r"is not XML \(unknown encoding"),
        (b'<?xml version="1.0" encoding="utf-7"?><robot/>', "is not XML"),
        (bytes(range(256)), "is not XML"),
        ("<robot>" + " " * 5_000_000, "is longer than 5000000 bytes"),
        ('<robot name="a">' + "<a/>" * 200_000 + "</robot>", "has more than 200000 elements"),
        (
            '<robot name="a">' + "".join(f'<link name="{i}"/>' for i in range(10_001)) + "</robot>",
            "more than 10000 links",
        ),
        ('<robot name="a"><link name="b"/></robot>', r"^tip: nothing moves between 'b' and 'b' of arm.urdf"),
    ],
)
def test_no_urdf(text: str | bytes, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        read(text, tmp_path)


def test_too_many_joints(tmp_path: Path) -> None:
    joint = '<joint name="j{0}" type="continuous"><parent link="{1}"/><child link="{0}"/></joint><link name="{0}"/>'
    links = "".join(joint.format(i + 1, i) for i in range(17))
    with pytest.raises(InputError, match="17 joints move '17'; wanted at most 16"):
        read(f'<robot name="long"><link name="0"/>{links}</robot>', tmp_path)
    assert read(f'<robot name="long"><link name="0"/>{links}</robot>', tmp_path, "1").dof == 16


def test_no_file(tmp_path: Path) -> None:
    for path, message in (
        (tmp_path / "absent.urdf", "No such file"),
        (tmp_path, "Is a directory"),
        (Path("a\0b"), "null"),
    ):
        with pytest.raises(InputError, match=rf"cannot be read \(.*{message}"):
            Robot.from_urdf(path)


@pytest.mark.parametrize(
    ("base", "tip", "message"),
    [
        ("bse", None, r"^base: arm.urdf has no link 'bse'; did you mean 'base'\?$"),
        (None, "tol", r"^tip: arm.urdf has no link 'tol'; did you mean 'tool'\?$"),
        ("slide", "upper", r"^tip: 'upper' is not below 'slide' in arm.urdf; "),
        ("wrist", "tool", r"^tip: nothing moves between 'wrist' and 'tool'"),
    ],
)
def test_no_such_chain(base: str | None, tip: str | None, message: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=message):
        read(ARM, tmp_path, base, tip)


def test_a_name_is_text(tmp_path: Path) -> None:
    for key in ("base", "tip"):
        with pytest.raises(InputError, match=rf"^{key}: 3 is no name; wanted text$"):
            read(ARM, tmp_path, **{key: 3})


def test_long_lists_are_cut(tmp_path: Path) -> None:
    joint = '<link name="{0:03}"/><joint name="{0}" type="fixed"><parent link="tool"/><child link="{0:03}"/></joint>'
    text = changed(("</robot>", "".join(joint.format(i) for i in range(500)) + "</robot>"))
    with pytest.raises(InputError, match=r"^base: arm.urdf has no link 'x'; valid: base, .*, 033 and 466 more$"):
        read(text, tmp_path, "x")
    with pytest.raises(
        InputError, match=r"^tip: is missing, and arm.urdf has 500 ends; give one of '000', .*, '011', \.\.\.$"
    ):
        read(text, tmp_path)


def test_an_inertia_that_cannot_be_is_a_warning_or_an_error(tmp_path: Path) -> None:
    text = changed(('izz="0.01"', 'izz="0.1"'))
    arm = read(text, tmp_path)
    assert arm.warnings[0].startswith(
        "Link 'upper' of arm.urdf: its inertia breaks the triangle inequality (principal moments 0.03, 0.03, 0.1 kg m2)"
    )
    with pytest.raises(
        InputError, match=r"link 'upper' inertia: breaks the triangle inequality .*; wanted the inertia of"
    ):
        read(text, tmp_path, strict_inertia=True)
    assert read(ARM, tmp_path, strict_inertia=True).dof == 3
    assert "turns, but has no mass" in read(changed(('value="4"', 'value="0"')), tmp_path).warnings[0]
