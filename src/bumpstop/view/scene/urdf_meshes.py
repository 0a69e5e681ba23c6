"""The meshes that a URDF names for its links, in the frames of the links that move them."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.model.urdf.reader import read_urdf
from bumpstop.model.urdf.xml_elements import children, parse
from bumpstop.view.scene.arm_shapes import LinkShape

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.model import Joint, Robot
    from bumpstop.model.urdf.reader import UrdfJoint

_GREY = (206, 210, 216)
_BASE = -1
# A mesh with more triangles than this slows every browser down.
_MAX_FACES = 60_000


def urdf_meshes(path: Path, robot: Robot) -> tuple[list[LinkShape], tuple[str, ...]]:
    """Meshes of the visuals of a URDF, one shape for every link that has some.

    Args:
        path: of the URDF; meshes are looked for from its folder on, of ``package://`` names in it and above it.
        robot: the arm that was read from it.

    Returns:
        The shapes, and which meshes could not be drawn.
    """
    parts: dict[int, list[tuple[FloatArray, Any]]] = {}
    left_out: list[tuple[int, str]] = []
    places = _places(path, robot)
    for link in children(parse(path), "link"):
        name = link.get("name", "")
        number, place = places.get(name, (_BASE, np.eye(4)))
        for visual in children(link, "visual") if name in places else ():
            mesh = next((mesh for shape in children(visual, "geometry") for mesh in children(shape, "mesh")), None)
            if mesh is None:
                continue
            file = mesh.get("filename", "")
            try:
                vertices, faces = _read(path.parent, file)
                X = place @ _origin(next(iter(children(visual, "origin")), None))
                scale = _three(mesh, "scale", "1 1 1")
            except _UnusableError as error:
                left_out.append((number, f"The mesh {file} of link {name} {error}"))
                continue
            # A mirrored triangle is seen from its back.
            faces = faces[:, ::-1] if np.prod(scale) < 0 else faces
            parts.setdefault(number, []).append(((vertices * scale) @ X[:3, :3].T + X[:3, 3], faces))
    # Where a link has another mesh, that alone is drawn.
    notes = [
        f"{words}: {'this mesh is left out' if number in parts else 'the link is drawn from the kinematics'}."
        for number, words in left_out
    ]
    return [_joined(number, meshes) for number, meshes in parts.items()], tuple(notes)


def _places(path: Path, robot: Robot) -> dict[str, tuple[int, FloatArray]]:
    """Number of the link that moves each link of the file, and its pose in the frame of that; none beside the arm."""
    q = np.clip(np.zeros(robot.dof), robot.lower, robot.upper)
    places = {}
    for link in (*(joint.link for joint in robot.joints), *(frame.name for frame in robot.frames), robot.tip_name):
        number, _ = robot.frame(link)
        places[link] = number, np.linalg.inv(robot.pose(q, robot.joints[number].link)) @ robot.pose(q, link)
    # What is fixed to the base, from the parent of the first joint on, up and down.
    tree, first = read_urdf(path), robot.joints[0]
    joint = next(joint for joint in tree.above.values() if joint.name == first.name)
    places[joint.parent] = _BASE, _pose(first) @ np.linalg.inv(_pose(joint))
    ahead = [joint.parent]
    while ahead:
        link = ahead.pop()
        for joint in (*tree.below[link], *([tree.above[link]] if link in tree.above else [])):
            down = joint.parent == link
            other = joint.child if down else joint.parent
            if joint.kind == "fixed" and joint.fault is None and other not in places:
                places[other] = _BASE, places[link][1] @ (_pose(joint) if down else np.linalg.inv(_pose(joint)))
                ahead.append(other)
    return places


def _pose(joint: Joint | UrdfJoint) -> FloatArray:
    X = np.eye(4)
    X[:3, 3], X[:3, :3] = joint.origin, joint.rotation
    return X


class _UnusableError(Exception):
    """A mesh cannot be drawn, and why."""


def _three(element: Any, name: str, default: str) -> FloatArray:
    """The three numbers of an attribute.

    Raises:
        _UnusableError: they are not three, or not finite.
    """
    text = element.get(name, default)
    try:
        found = np.array([float(part) for part in text.split()])
    except ValueError:
        found = np.empty(0)
    if found.shape != (3,) or not np.isfinite(found).all():
        raise _UnusableError(f"has {name} {text!r}, which is not three numbers")
    return found


def _origin(element: Any) -> FloatArray:
    from scipy.spatial.transform import Rotation

    X = np.eye(4)
    if element is not None:
        X[:3, 3] = _three(element, "xyz", "0 0 0")
        X[:3, :3] = Rotation.from_euler("xyz", _three(element, "rpy", "0 0 0")).as_matrix()
    return X


def _read(folder: Path, name: str) -> tuple[FloatArray, Any]:
    """Vertices and triangles of a file.

    Raises:
        _UnusableError: it is not there, is no mesh, or has too many triangles.
    """
    import trimesh

    relative = name.removeprefix("file://")
    candidates = [folder / relative]
    if name.startswith("package://"):
        inside = Path(name.removeprefix("package://"))
        above = [folder, *folder.resolve().parents[:4]]
        candidates = [base / tail for base in above for tail in (inside, Path(*inside.parts[1:]))]
    file = next((candidate for candidate in candidates if candidate.is_file()), None)
    if file is None:
        raise _UnusableError("is not there")
    try:
        mesh = trimesh.load_mesh(file)
        if isinstance(mesh, trimesh.Scene):
            mesh = mesh.to_geometry()
        vertices, faces = np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)
        if mesh.units is not None:  # COLLADA names the length of its unit
            vertices = vertices * trimesh.units.unit_conversion(mesh.units, "meters")
    except ImportError as error:  # says what to install
        raise _UnusableError(f"cannot be read ({error})") from None
    except Exception:  # readers of meshes raise whatever they like at a damaged file
        raise _UnusableError("cannot be read") from None
    if not len(faces) or vertices.shape[1:] != (3,) or not np.isfinite(vertices).all():
        raise _UnusableError("cannot be read")
    if len(faces) > _MAX_FACES:
        raise _UnusableError(f"has {len(faces)} triangles, and more than {_MAX_FACES} slow every browser down")
    return vertices, faces


def _joined(number: int, meshes: list[tuple[FloatArray, Any]]) -> LinkShape:
    counts = np.cumsum([0, *(len(vertices) for vertices, _ in meshes)])
    faces = np.concatenate([triangles + count for (_, triangles), count in zip(meshes, counts, strict=False)])
    return LinkShape(number, np.concatenate([vertices for vertices, _ in meshes]), faces, _GREY)
