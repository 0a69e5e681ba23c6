"""Pictures and a short animation of a scenario, drawn without a browser."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.errors import InputError, where_else
from bumpstop.output_files import write_bytes
from bumpstop.report.colours import AREA, EVENT, FAINT, INK, LAW, LIMIT
from bumpstop.terminal import number
from bumpstop.view.answer import Answer
from bumpstop.view.controls import SPEED, controls_of
from bumpstop.view.document import with_keys
from bumpstop.view.scene.arm_shapes import arm_shapes

if TYPE_CHECKING:
    from contextlib import AbstractContextManager

    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Scenario

_SIZE_INCH, _DPI, _FRAME_DPI, _FRAMES, _FRAME_MS = (9.0, 4.6), 100, 70, 12, 200
_TONES = {"good": EVENT, "bad": LIMIT, "open": FAINT}
_LIGHT = np.array([0.35, -0.6, 0.72])


def picture(answer: Answer) -> bytes:
    """The arm, its force distribution against the limits and the verdict, as PNG."""
    with _style():
        figure = _figure(answer, None)
        stream = io.BytesIO()
        figure.savefig(stream, format="png", dpi=_DPI, metadata={"Software": None})
    return stream.getvalue()


def record(scenario: Scenario, folder: Path) -> list[Path]:
    """Write ``view.png``, and for a straight line ``view.gif``, in which the speed grows until the verdict changes.

    Args:
        scenario: to draw.
        folder: made where it is missing.

    Returns:
        The files.

    Raises:
        InputError: the scenario cannot be computed, or the folder not be written.
    """
    answer = Answer.of(scenario)
    if answer.pending:
        answer = Answer.of_uncertain(scenario, lambda: False)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        files = [folder / "view.png"]
        write_bytes(files[0], picture(answer))
        if scenario.motion.kind == "line":
            files.append(folder / "view.gif")
            _animate(scenario.without_uncertainty(), files[-1])
    except OSError as error:
        problem = f"{str(folder)!r} cannot be written ({error.strerror or error})"
        raise InputError("--record", problem, where_else(error)) from None
    return files


def _animate(scenario: Scenario, file: Path) -> None:
    """From half the speed to twice, or as far as the arm can do it, and back."""
    from PIL import Image

    answers = []
    start = Answer.of(scenario)
    control = next(each for each in controls_of(scenario, start.result.problem.robot) if each.key == SPEED)
    now = float(control.read(scenario))  # type: ignore[arg-type]
    for speed in np.linspace(0.5 * now, 2.0 * now, _FRAMES):
        try:
            answers.append(Answer.of(with_keys(scenario, control.write(scenario, round(float(speed), 1)))))
        except InputError:
            break
    answers = answers or [start]
    top = max(_highest(answer) for answer in answers)
    with _style():
        # The arm stands in one pose: it is drawn once, and the rest over it.
        arm = _pixels(answers[0], top, parts=("arm",))
        frames = [
            Image.fromarray(_pixels(answer, top, parts=("rest",), below=arm)).quantize(64, dither=Image.Dither.NONE)
            for answer in answers
        ]
    frames += frames[-2:0:-1]
    frames[0].save(file, save_all=True, append_images=frames[1:], duration=_FRAME_MS, loop=0, optimize=True)


def _pixels(answer: Answer, top: float, *, parts: tuple[str, ...], below: Any = None) -> Any:
    """A frame (height, width, 3), its parts drawn over what stands ``below``."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE_INCH, dpi=_FRAME_DPI)
    canvas: Any = FigureCanvasAgg(figure)
    if below is not None:
        # Axes stand at 0, and images of a figure before them.
        figure.figimage(below, zorder=-1)
    _fill(figure, answer, top, parts)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def _style() -> AbstractContextManager[None]:
    """The look of the report's figures."""
    from bumpstop.report.picture import Picture

    return Picture("view", "", "", lambda _: None).style()


def _highest(answer: Answer) -> float:
    value = answer.result.peak_force.quantile(0.9999)
    limit = answer.peak_limit_N
    return max(value if math.isfinite(value) else 0.0, 1.1 * limit if math.isfinite(limit) else 0.0, 1.0)


def _figure(answer: Answer, top: float | None) -> Figure:
    from matplotlib.figure import Figure

    figure = Figure(figsize=_SIZE_INCH)
    _fill(figure, answer, top)
    return figure


def _fill(figure: Figure, answer: Answer, top: float | None, parts: tuple[str, ...] = ("arm", "rest")) -> None:
    if "arm" in parts:
        _draw_arm(figure.add_axes((0.0, 0.02, 0.48, 0.8), projection="3d"), answer)
    if "rest" not in parts:
        return
    law = figure.add_axes((0.55, 0.15, 0.42, 0.6))
    _draw_distribution(law, answer, top)
    colour = _TONES[answer.tone]
    figure.text(
        0.02, 0.955, answer.word, color="white", fontweight="bold", fontsize=13, va="center",
        bbox={"facecolor": colour, "edgecolor": "none", "boxstyle": "square,pad=0.35"},
    )  # fmt: skip
    figure.text(0.02, 0.885, _wrapped(answer.sentence), color=INK, fontsize=9.5, va="top")
    speed = 1e3 * float(np.linalg.norm(answer.result.problem.velocity))
    robot, limits = answer.result.problem.robot, answer.result.problem.limits
    hit = "" if limits is None else f" against {limits.label}"
    moving = f" at {number(speed)} mm/s" if speed else ""
    figure.text(0.98, 0.955, f"{robot.title or robot.name}{moving}{hit}", ha="right", va="center", color=INK)


def _wrapped(text: str) -> str:
    import textwrap

    # A number and its sign stay together: that space is none for textwrap.
    return "\n".join(textwrap.wrap(text.replace(" %", "\N{NO-BREAK SPACE}%"), 116))


def _draw_distribution(axes: Axes, answer: Answer, top: float | None) -> None:
    from bumpstop.report.collision.bins import bins

    result = answer.result
    edges = bins(result.peak_force, result.samples)
    high = top or _highest(answer)
    if edges.size:
        density = result.peak_force.density(edges)
        axes.stairs(density, edges, fill=True, color=AREA, alpha=0.45)
        axes.stairs(density, edges, color=LAW)
        axes.set_ylim(0, 1.3 * float(density.max()))
    axes.set_xlim(0, high)
    if answer.peak_limit_N < high:
        axes.axvspan(answer.peak_limit_N, high, facecolor="none", edgecolor=LIMIT, alpha=0.5, hatch="///", linewidth=0)
    for height, (limit, force) in zip((0.97, 0.75), answer.marked_limits_N, strict=False):
        if force < high:
            axes.axvline(force, color=LIMIT, linestyle="--")
            _label(axes, force, height, f"{limit} {number(force)} N", LIMIT)
    p99 = result.peak_force.quantile(0.99)
    if math.isfinite(p99) and p99 < high:
        axes.axvline(p99, color=EVENT, linestyle="-.")
        _label(axes, p99, 0.86, f"p99 {number(p99)} N", EVENT)
    axes.set_xlabel("peak force [N]")
    axes.set_ylabel("density [1/N]")


def _label(axes: Axes, x: float, height: float, text: str, colour: str) -> None:
    """A label beside a line across, on the side that has more room; on white, as it may stand on another line."""
    left = x > 0.5 * axes.get_xlim()[1]
    axes.annotate(
        text, (x, height), (-4 if left else 4, 0), xycoords=axes.get_xaxis_transform(), textcoords="offset points",
        ha="right" if left else "left", va="top", color=colour,
        bbox={"facecolor": "white", "edgecolor": "none", "pad": 1.0},
    )  # fmt: skip


def _draw_arm(axes: Any, answer: Answer) -> None:
    from mpl_toolkits.mplot3d.art3d import Poly3DCollection

    problem = answer.result.problem
    robot, q = problem.robot, problem.q
    corners, colours = [], []
    for shape in arm_shapes(robot):
        X = np.eye(4) if shape.link < 0 else robot.pose(q, robot.joints[shape.link].link)
        vertices = shape.vertices @ X[:3, :3].T + X[:3, 3]
        triangles = vertices[shape.faces]
        corners.append(triangles)
        colours.append(_shaded(triangles, np.array(shape.colour) / 255))
    faces = np.concatenate(corners)
    axes.add_collection3d(Poly3DCollection(faces, facecolors=np.concatenate(colours), linewidths=0))
    contact = answer.scenario.contact
    point = robot.pose(q, contact.link, contact.point_m)[:3, 3]
    velocity = problem.velocity if problem.velocity.any() else np.asarray(answer.result.curve.normal)
    along = velocity / np.linalg.norm(velocity)
    axes.scatter(*point, color="#E69F00", s=60, depthshade=False)
    axes.quiver(*point, *(0.2 * along), color=LAW, linewidth=2.2)
    low, high = faces.reshape(-1, 3).min(axis=0), faces.reshape(-1, 3).max(axis=0)
    middle, half = (low + high) / 2, float((high - low).max()) / 2
    axes.set_xlim(middle[0] - half, middle[0] + half)
    axes.set_ylim(middle[1] - half, middle[1] + half)
    axes.set_zlim(middle[2] - half, middle[2] + half)
    axes.set_box_aspect((1, 1, 1), zoom=1.45)
    axes.view_init(22, -55)
    axes.set_axis_off()


def _shaded(triangles: FloatArray, colour: FloatArray) -> FloatArray:
    """A colour for every triangle, by how it faces the light."""
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    facing = (normal / np.maximum(size, 1e-15)) @ (_LIGHT / np.linalg.norm(_LIGHT))
    return np.asarray(np.clip(colour * (0.62 + 0.38 * facing)[:, None], 0, 1))
