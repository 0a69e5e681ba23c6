"""Meshes of a URDF: those that stand with the base, and those of other units and formats."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.model import Robot
from bumpstop.view.opened import open_source
from bumpstop.view.scene.arm_shapes import LinkShape
from bumpstop.view.scene.urdf_meshes import urdf_meshes
from view.cases import LOWER_ARM, urdf_of_twelve_joints

FIXED = '<joint name="{}" type="fixed"><parent link="{}"/><child link="{}"/><origin xyz="0 0 {}"/></joint>'


@pytest.mark.parametrize(("base", "above"), [(None, 1.5), ("base", 0.5), ("plate", 0.5)])
def test_meshes_of_what_is_fixed_to_the_base_are_drawn(base: str | None, above: float, tmp_path: Path) -> None:
    """Only the root's was, and in the frame of whatever link was the base."""
    trimesh = pytest.importorskip("trimesh")
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / "box.stl")
    visual = '<visual><origin xyz="0 0 0.5"/><geometry><mesh filename="box.stl"/></geometry></visual>'
    links = f'<link name="base">{visual}</link><link name="room"/><link name="plate"/>'
    text = urdf_of_twelve_joints().replace('<link name="base"/>', links)
    more = FIXED.format("stand", "room", "base", 1) + FIXED.format("under", "base", "plate", 0)
    file = tmp_path / "snake.urdf"
    file.write_text(text.replace("</robot>", f"{more}</robot>"), encoding="utf-8")
    shapes, notes = urdf_meshes(file, Robot.from_urdf(file, base, "l11"))
    assert [(shape.link, *shape.vertices.mean(axis=0).round(6)) for shape in shapes] == [(-1, 0.0, 0.0, above)]
    assert notes == ()


def test_a_mesh_with_a_unit_of_its_own_is_in_metres(tmp_path: Path) -> None:
    """COLLADA in millimetres was drawn a thousand times too large."""
    trimesh = pytest.importorskip("trimesh")
    pytest.importorskip("collada")
    text = trimesh.creation.box((100, 200, 300)).export(file_type="dae").decode()
    unit = '<unit name="millimeter" meter="0.001"/><up_axis>'
    (tmp_path / "box.dae").write_text(text.replace("<up_axis>", unit, 1), encoding="utf-8")
    (shape,), notes = drawn(tmp_path)
    assert (shape.link, *np.ptp(shape.vertices, axis=0).round(6)) == (2, 0.1, 0.2, 0.3)
    assert notes == ()


def test_what_reads_a_mesh_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Most meshes of ROS are COLLADA: they were said to be unreadable."""
    trimesh = pytest.importorskip("trimesh")

    def missing(_: object) -> None:
        raise ImportError("missing `pip install pycollada`")

    monkeypatch.setattr(trimesh, "load_mesh", missing)
    said = "cannot be read (missing `pip install pycollada`): the link is drawn from the kinematics."
    assert drawn(tmp_path) == ([], (f"The mesh box.dae of link l2 {said}",))


def test_a_urdf_whose_ending_is_in_capitals_opens(tmp_path: Path) -> None:
    """Other commands read it; it was taken for a recording."""
    file = tmp_path / "SNAKE.URDF"
    file.write_text(urdf_of_twelve_joints(), encoding="utf-8")
    assert open_source(str(file)).robot.dof == 12


def test_a_urdf_with_several_ends_opens_with_a_tip(tmp_path: Path) -> None:
    """The refusal named the tips that there are, and none could be given."""
    file = tmp_path / "snake.urdf"
    more = (
        '<link name="cup"/><link name="eye"/>'
        + FIXED.format("a", "l11", "cup", 0.1)
        + FIXED.format("b", "l11", "eye", 0)
    )
    file.write_text(urdf_of_twelve_joints().replace("</robot>", f"{more}</robot>"), encoding="utf-8")
    with pytest.raises(InputError, match=r"^--tip: is missing, .* give one of 'cup', 'eye'"):
        open_source(str(file))
    opened = open_source(str(file), base="base", tip="cup")
    assert (opened.robot.tip_name, opened.scenario.tip, opened.scenario.base) == ("cup", "cup", "base")
    for source in ("ur10e", str(LOWER_ARM)):
        with pytest.raises(InputError, match="--tip: has no meaning without a URDF"):
            open_source(source, tip="cup")


def drawn(folder: Path) -> tuple[list[LinkShape], tuple[str, ...]]:
    """Shapes and notes of an arm whose third link has a mesh."""
    visual = '<visual><geometry><mesh filename="box.dae"/></geometry></visual>'
    file = folder / "snake.urdf"
    file.write_text(urdf_of_twelve_joints().replace('<link name="l2"/>', f'<link name="l2">{visual}</link>'), "utf-8")
    (folder / "box.dae").touch()
    return urdf_meshes(file, Robot.from_urdf(file))
