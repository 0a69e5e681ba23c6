"""Pictures and videos of the plant, drawn by MuJoCo without a screen."""

from __future__ import annotations

import math
import os
from collections.abc import Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop.errors import InputError
from bumpstop.plant.command import COMMAND_STEP
from bumpstop.plant.mjcf import import_mujoco

if TYPE_CHECKING:
    from collections.abc import Iterator

    from bumpstop.arrays import FloatArray
    from bumpstop.plant.plant import Plant
    from bumpstop.plant.run import PlantRun

Image = npt.NDArray[np.uint8]
_BACKENDS = ("egl", "osmesa")
_FRAMES_PER_S = 25
_MAX_FRAMES = 1500
_OCTREE = 2  # Pillow's Quantize.FASTOCTREE
_NO_LIBRARY = "on Debian and Ubuntu: apt-get install libegl1 libgl1-mesa-dri, or libosmesa6 and MUJOCO_GL=osmesa"


def offscreen(width: int, height: int) -> Any:
    """An OpenGL context without a screen, by EGL or OSMesa, or by the one that MUJOCO_GL names.

    Raises:
        InputError: none of them works on this machine.
    """
    asked = os.environ.get("MUJOCO_GL", "").lower()
    causes = []
    for backend in (asked,) if asked in _BACKENDS else _BACKENDS:
        platform = os.environ.get("PYOPENGL_PLATFORM")
        try:
            if backend == "egl":
                from mujoco.egl import GLContext
            else:
                from mujoco.osmesa import GLContext
            context = GLContext(width, height)
            context.make_current()
        # What a missing library raises is not one kind of error: PyOpenGL fails where it first needs it.
        except Exception as error:
            causes.append(f"{backend}: {' '.join(str(error).split())[:80]}")
            if platform is None:
                os.environ.pop("PYOPENGL_PLATFORM", None)
        else:
            return context
    raise InputError("picture", f"no OpenGL without a screen ({'; '.join(causes)})", _NO_LIBRARY)


class Renderer:
    """Draws a plant; a context manager.

    Args:
        plant: what is drawn.
        q: poses that must fit into the picture (N, dof) [rad or m]; the camera stands still.
        width, height: of the picture.
    """

    def __init__(self, plant: Plant, q: FloatArray, width: int = 960, height: int = 720) -> None:
        self._mujoco, self._plant = import_mujoco(), plant
        robot = plant.robot
        tips = robot.pose(q)[:, :3, 3]
        places = np.concatenate([np.zeros((1, 3)), tips, *(robot.pose(q, j.link)[:, :3, 3] for j in robot.joints)])
        low, high = places.min(axis=0), places.max(axis=0)
        self._look_at = (low + high) / 2
        self._distance = 1.6 * float(np.linalg.norm(high - low))
        # From the side the tip is on, turned so far that the arm is not seen end on.
        x, y = tips.mean(axis=0)[:2]
        self._azimuth = math.degrees(math.atan2(y, x)) + 125.0
        self._size = (width, height)
        self._data = self._mujoco.MjData(plant.model)

    def __enter__(self) -> Renderer:
        mj, model = self._mujoco, self._plant.model
        self._context = offscreen(*self._size)
        self._scene = mj.MjvScene(model, maxgeom=500)
        self._drawing = mj.MjrContext(model, mj.mjtFontScale.mjFONTSCALE_150)
        mj.mjr_setBuffer(mj.mjtFramebuffer.mjFB_OFFSCREEN, self._drawing)
        return self

    def __exit__(self, *_: object) -> None:
        self._drawing.free()
        self._context.free()

    def draw(self, q: FloatArray, pushed: Sequence[tuple[float, float]] = ()) -> Image:
        """The arm in a pose (dof,), with how far each object is pushed in and away [m]; (height, width, 3)."""
        mj, plant, data = self._mujoco, self._plant, self._data
        mj.mj_resetData(plant.model, data)
        for joint, position in zip(plant.robot.joints, q, strict=True):
            data.joint(joint.name).qpos[0] = position
        for thing, (depth, away) in zip(plant.objects, pushed, strict=False):
            data.joint(thing.geom).qpos[0] = depth
            if thing.body_mass is not None:
                data.joint(thing.behind).qpos[0] = away
        mj.mj_kinematics(plant.model, data)
        mj.mj_comPos(plant.model, data)
        mj.mj_camlight(plant.model, data)
        camera = mj.MjvCamera()
        camera.type = mj.mjtCamera.mjCAMERA_FREE
        camera.lookat[:] = self._look_at
        camera.distance, camera.azimuth, camera.elevation = self._distance, self._azimuth, -15.0
        mj.mjv_updateScene(plant.model, data, mj.MjvOption(), None, camera, mj.mjtCatBit.mjCAT_ALL.value, self._scene)
        width, height = self._size
        view = mj.MjrRect(0, 0, width, height)
        mj.mjr_render(view, self._scene, self._drawing)
        pixels = np.empty((height, width, 3), dtype=np.uint8)
        mj.mjr_readPixels(pixels, None, view, self._drawing)
        return np.ascontiguousarray(pixels[::-1])


def picture(plant: Plant, run: PlantRun, path: str | Path) -> None:
    """Draw the moment of the greatest force, or the end where nothing is touched, into a PNG file.

    Raises:
        InputError: the ending is another, the file cannot be written, or no OpenGL works without a screen.
    """
    path = checked_ending(path, "--picture", ".png")
    forces = run.trace.contact_force
    row = int(np.argmax(forces.sum(axis=1))) if forces.any() else len(run.trace.t) - 1
    with _files(path), Renderer(plant, run.trace.q[row : row + 1]) as renderer:
        _image(renderer.draw(run.trace.q[row], pushed_and_away(plant, run, row))).save(path)


def video(plant: Plant, run: PlantRun, path: str | Path) -> int:
    """Draw the run as an animated GIF, 25 frames a second; returns their number.

    GIF, as Pillow, which matplotlib brings, writes it: MP4 would need ffmpeg. A run longer than a minute is sped up.

    Raises:
        InputError: as :func:`picture`.
    """
    path = checked_ending(path, "--video", ".gif")
    every = round(1000 / _FRAMES_PER_S)
    while len(run.trace.t) / every > _MAX_FRAMES:
        every *= 2
    with _files(path), Renderer(plant, run.trace.q[::every], 480, 360) as renderer:
        frames = [
            _image(renderer.draw(run.trace.q[row], pushed_and_away(plant, run, row)))
            for row in range(0, len(run.trace.t), every)
        ]
        # One palette for all, as palettes of their own flicker; the octree keeps small areas of strong colour.
        palette = frames[0].quantize(255, method=_OCTREE)
        first, *others = (frame.quantize(palette=palette, dither=0) for frame in frames)
        first.save(path, save_all=True, append_images=others, duration=1000 // _FRAMES_PER_S, loop=0)
    return len(frames)


def pushed_and_away(plant: Plant, run: PlantRun, row: int) -> list[tuple[float, float]]:
    """How far each object is pushed in, and how far a free body has got away by then [m]."""
    found = []
    forces = run.trace.contact_force[: row + 1].T
    for number, (thing, force) in enumerate(zip(plant.objects, forces, strict=True)):
        if thing.body_mass is None:
            away = 0.0
        elif thing.spring is not None:
            away = float(run.trace.measured_force[row, number]) / thing.spring
        else:
            away = float(np.cumsum(force).sum()) * COMMAND_STEP**2 / thing.body_mass
        found.append((float(force[-1]) / thing.stiffness, away))
    return found


def _image(pixels: Image) -> Any:
    from PIL import Image as Pillow

    return Pillow.fromarray(pixels)


def checked_ending(path: str | Path, option: str, ending: str) -> Path:
    """The path, where it ends so.

    Raises:
        InputError: it does not; names the option.
    """
    path = Path(path)
    if path.suffix.lower() != ending:
        raise InputError(option, f"{str(path)!r} does not end in {ending}", f"for example run{ending}")
    return path


@contextmanager
def _files(path: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise InputError(str(path), f"cannot be written ({error.strerror or error})") from None
