"""Meshes of a URDF that stand with the base."""

from __future__ import annotations

from pathlib import Path

import pytest

from bumpstop.model import Robot
from bumpstop.view.scene.urdf_meshes import urdf_meshes
from view.cases import urdf_of_twelve_joints

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
