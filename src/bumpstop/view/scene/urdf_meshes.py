"""The meshes that a URDF names for its links, in the frames of the links that move them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.errors import InputError
from bumpstop.view.scene.arm_shapes import LinkShape

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.model import Robot

_GREY = (206, 210, 216)
_BASE = -1
# A link with more triangles than this slows every browser down; it is drawn from the kinematics.
_MAX_FACES = 60_000


def urdf_meshes(path: Path, robot: Robot) -> tuple[list[LinkShape], tuple[str, ...]]:
    """Meshes of the visuals of a URDF, one shape for every link that has some.

    Args:
        path: of the URDF; meshes are looked for from its folder on, of ``package://`` names in it and above it.
        robot: the arm that was read from it.

    Returns:
        The shapes, and which meshes could not be drawn.
    """
    import defusedxml.ElementTree

    parts: dict[int, list[tuple[FloatArray, Any]]] = {}
    notes = []
    children: set[str] = set()
    root = defusedxml.ElementTree.parse(path).getroot()
    for joint in root.findall("joint"):
        children |= {child.get("link", "") for child in joint.findall("child")}
    for link in root.findall("link"):
        name = link.get("name", "")
        place = _place(robot, name, is_root=name not in children)
        for visual in link.findall("visual") if place is not None else ():
            mesh = visual.find("geometry/mesh")
            if mesh is None:
                continue
            file = mesh.get("filename", "")
            found = _read(path.parent, file)
            if found is None:
                notes.append(f"The mesh {file} of link {name} cannot be read: the link is drawn from the kinematics.")
                continue
            vertices, faces = found
            assert place is not None
            number, X = place
            X = X @ _origin(visual.find("origin"))
            scale = np.array([float(s) for s in mesh.get("scale", "1 1 1").split()])
            parts.setdefault(number, []).append(((vertices * scale) @ X[:3, :3].T + X[:3, 3], faces))
    return [_joined(number, meshes) for number, meshes in parts.items()], tuple(notes)


def _place(robot: Robot, name: str, *, is_root: bool) -> tuple[int, FloatArray] | None:
    """Number of the link that moves a link of the file, and the pose of that in its frame; None: it is not drawn."""
    try:
        number, _ = robot.frame(name)
    except InputError:
        return (_BASE, np.eye(4)) if is_root else None
    q = np.clip(np.zeros(robot.dof), robot.lower, robot.upper)
    return number, np.linalg.inv(robot.pose(q, robot.joints[number].link)) @ robot.pose(q, name)


def _origin(element: Any) -> FloatArray:
    from scipy.spatial.transform import Rotation

    X = np.eye(4)
    if element is not None:
        X[:3, 3] = [float(value) for value in element.get("xyz", "0 0 0").split()]
        X[:3, :3] = Rotation.from_euler("xyz", [float(v) for v in element.get("rpy", "0 0 0").split()]).as_matrix()
    return X


def _read(folder: Path, name: str) -> tuple[FloatArray, Any] | None:
    import trimesh

    relative = name.removeprefix("file://")
    candidates = [folder / relative]
    if name.startswith("package://"):
        inside = Path(name.removeprefix("package://"))
        above = [folder, *folder.resolve().parents[:4]]
        candidates = [base / tail for base in above for tail in (inside, Path(*inside.parts[1:]))]
    file = next((candidate for candidate in candidates if candidate.is_file()), None)
    if file is None:
        return None
    try:
        mesh = trimesh.load_mesh(file)
        if isinstance(mesh, trimesh.Scene):
            mesh = mesh.to_geometry()
        vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
    except Exception:  # readers of meshes raise whatever they like at a damaged file
        return None
    return (vertices, faces) if 0 < len(faces) <= _MAX_FACES else None


def _joined(number: int, meshes: list[tuple[FloatArray, Any]]) -> LinkShape:
    counts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = np.concatenate([triangles + count for (_, triangles), count in zip(meshes, counts, strict=False)])
    return LinkShape(number, np.concatenate([vertices for vertices, _ in meshes]), faces, _GREY)
