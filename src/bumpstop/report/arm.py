"""The arm as it stands when the motion begins, and which way it goes."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.report.markup import Html, paragraph, table
from bumpstop.report.picture import FAINT, INK, LAW, LIMIT, Picture
from bumpstop.report.section import Section
from bumpstop.report.words import arm, number, what_is_hit

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# A direction this much out of the drawing's plane is drawn as a sign, not as a short arrow.
_SIDEWAYS = 0.35
# Length of the motion's arrow, as a share of half a view's width.
_GAP = 0.38


@dataclass(frozen=True)
class _View:
    """An orthographic view: the base axes that point right, up, and toward the reader."""

    title: str
    right: int
    up: int
    toward: int
    toward_sign: int  # +1: the third axis points at the reader

    def flat(self, points: FloatArray) -> FloatArray:
        """The drawing's two coordinates of vectors (..., 3)."""
        return np.asarray(points[..., [self.right, self.up]])

    def depth(self, vector: FloatArray) -> float:
        """How far a vector points at the reader."""
        return float(vector[self.toward]) * self.toward_sign


_FRONT = _View("from the side (x, z)", 0, 2, 1, -1)
_SIDE = _View("from the front (y, z)", 1, 2, 0, 1)
_TOP = _View("from above (x, y)", 0, 1, 2, 1)


class ArmSection(Section):
    """Two views of the arm in its pose, with joints, contact point and motion."""

    title = "The arm and its motion"
    anchor = "arm"

    def content(self) -> list[Html]:
        """Where the contact is, and the pose as a table."""
        law, problem, curve = self.law, self.law.problem, self.law.curve
        contact, motion = law.scenario.contact, law.scenario.motion
        speed = math.hypot(*motion.velocity_mm_s)
        rows = [
            (
                str(j + 1),
                joint.name,
                f"{math.degrees(q):.4g} deg" if joint.kind == "revolute" else f"{q:.4g} m",
                "held still" if j in problem.held else "moves",
            )
            for j, (joint, q) in enumerate(zip(problem.robot.joints, problem.q, strict=True))
        ]
        where = contact.link or problem.robot.tip_name
        start = "already at full speed" if motion.start == "moving" else "from rest"
        return [
            paragraph(
                f"{arm(law)} moves its tip ({problem.robot.tip_name}) at {speed:g} mm/s along "
                f"{_vector(np.array(motion.velocity_mm_s) / speed)} in the base frame, {start}. The contact point on "
                f"{where} starts at {_vector(curve.start)} m and meets {what_is_hit(law)} along "
                f"{_vector(curve.normal)} at {1e3 * curve.approach_speed:.4g} mm/s."
            ),
            table(("joint", "name", "position", ""), rows, caption="Pose at the start of the motion"),
        ]

    def pictures(self) -> list[Picture]:
        """One figure with an elevation and the plan."""
        alt = (
            f"Two views of the arm as lines between its joints, numbered 1 to {self.law.problem.robot.dof} from the "
            f"base. The contact point is at {_vector(self.law.curve.start)} m; an arrow shows its motion toward the "
            f"plane of the body."
        )
        caption = (
            "Lines join the joints, numbered from the base; where several lie behind one another they share a label. "
            "Diamond: contact point. Arrow: its motion (a circle with a dot: toward the reader; with a cross: away). "
            "Hatched line: surface of the body; the gap is not to scale."
        )
        return [Picture("arm", alt, caption, self._draw, height=2.95)]

    @cached_property
    def _chain(self) -> FloatArray:
        """Base, every joint and the tip (dof + 2, 3) [m]."""
        problem = self.law.problem
        links = [joint.link for joint in problem.robot.joints]
        frames = [problem.robot.pose(problem.q, link)[:3, 3] for link in links]
        return np.array([np.zeros(3), *frames, problem.robot.pose(problem.q)[:3, 3]])

    def _draw(self, figure: Figure) -> None:
        width, height = figure.get_size_inches()
        reach = np.ptp(self._chain, axis=0)
        side = 1.87
        for i, view in enumerate((_FRONT if reach[0] >= reach[1] else _SIDE, _TOP)):
            box = ((0.6 + i * (side + 0.62)) / width, 0.48 / height, side / width, side / height)
            self._draw_view(figure.add_axes(box), view, 0.68 * max(float(reach.max()), 0.1))

    def _draw_view(self, panel: Axes, view: _View, half: float) -> None:
        flat = view.flat(self._chain)
        everything = np.concatenate([flat, view.flat(self._aim(half))])
        centre = (everything.min(axis=0) + everything.max(axis=0)) / 2
        panel.set_title(view.title, fontsize=9.5)
        panel.set_xlabel("xyz"[view.right] + " [m]")
        panel.set_ylabel("xyz"[view.up] + " [m]", labelpad=2)
        panel.grid(color="#e4e4e4", linewidth=0.6)
        panel.set_xlim(centre[0] - half, centre[0] + half)
        panel.set_ylim(centre[1] - half, centre[1] + half)
        panel.locator_params(nbins=5)
        # Wide grey lines with a thin dark core: links, whatever the paper.
        panel.plot(*flat.T, color="#c8c8c8", linewidth=7, solid_capstyle="round", solid_joinstyle="round")
        panel.plot(*flat.T, color=INK, linewidth=1)
        panel.plot(*flat[0], marker="s", markersize=9, color=FAINT)
        aim = view.flat(self._aim(half))
        for place, label in _labels(flat[1:-1], 0.17 * half):
            free = _beside(place, flat, aim, half)
            panel.plot(*np.array([place, free]).T, color=INK, linewidth=0.8, zorder=4.5)
            panel.text(
                free[0],
                free[1],
                label,
                ha="center",
                va="center",
                fontsize=8,
                zorder=5,
                bbox={"boxstyle": "round,pad=0.22", "facecolor": "white", "edgecolor": INK, "linewidth": 0.8},
            )
        self._draw_contact(panel, view, half)

    def _aim(self, half: float) -> FloatArray:
        """From the contact point to the tip of the motion's arrow, a few points on the way (5, 3) [m]."""
        velocity = np.asarray(self.law.problem.start["point_velocity"])
        way = np.linspace(0, _GAP * half, 5)[:, None] * velocity / np.linalg.norm(velocity)
        return np.asarray(self.law.curve.start + way)

    def _draw_contact(self, panel: Axes, view: _View, half: float) -> None:
        curve = self.law.curve
        point = view.flat(curve.start)
        velocity = np.asarray(self.law.problem.start["point_velocity"])
        direction = velocity / np.linalg.norm(velocity)
        panel.plot(*point, marker="D", markersize=6.5, color=LIMIT, markeredgecolor="white", zorder=6)
        gap = _GAP * half
        target = view.flat(self._aim(half)[-1])
        if math.hypot(*view.flat(direction)) > _SIDEWAYS:
            arrow = {"arrowstyle": "-|>", "color": LAW, "linewidth": 1.8, "shrinkA": 4, "shrinkB": 1}
            panel.annotate("", tuple(target), tuple(point), arrowprops=arrow, zorder=6)
        else:
            _draw_sign(panel, point + np.array([0.0, -0.19 * half]), toward=view.depth(direction) > 0)
        normal = view.flat(curve.normal)
        if math.hypot(*normal) > _SIDEWAYS:
            # The plane passes through the arrow's tip, its edge square to the normal.
            edge = np.array([-normal[1], normal[0]]) / math.hypot(*normal)
            depth = gap * float(direction @ curve.normal) * normal
            _draw_surface(panel, point + depth, edge, normal / math.hypot(*normal), half)


def _draw_sign(panel: Axes, place: FloatArray, *, toward: bool) -> None:
    """The draughtsman's sign for a vector square to the paper: an arrow's point, or its feathers."""
    panel.plot(*place, marker="o", markersize=10, markerfacecolor="white", markeredgecolor=LAW, markeredgewidth=1.6)
    inner: dict[str, Any] = {"marker": "."} if toward else {"marker": "x", "markeredgewidth": 1.6}
    panel.plot(*place, markersize=6, color=LAW, **inner)


def _draw_surface(panel: Axes, middle: FloatArray, edge: FloatArray, normal: FloatArray, half: float) -> None:
    length, depth = 0.26 * half, 0.07 * half
    ends = np.array([middle - length * edge, middle + length * edge])
    panel.plot(*ends.T, color=LIMIT, linewidth=1.6, zorder=4)
    for share in np.linspace(-0.9, 0.9, 7):
        foot = middle + share * length * edge
        tick = np.array([foot, foot + depth * (normal - edge)])
        panel.plot(*tick.T, color=LIMIT, linewidth=0.8, zorder=4)


def _beside(place: FloatArray, chain: FloatArray, aim: FloatArray, half: float) -> FloatArray:
    """Where a label goes: on its joint, or beside it where it would cover the contact point or the arrow."""
    if np.linalg.norm(place - aim, axis=1).min() > 0.16 * half:
        return place
    # The side that keeps farthest from the arm, the arrow and the sign below the contact point.
    share = np.linspace(0, 1, 6)[:, None, None]
    arm_points = (chain[:-1] + share * (chain[1:] - chain[:-1])).reshape(-1, 2)
    others = np.concatenate([arm_points, aim, [aim[0] - [0.0, 0.19 * half]]])
    angles = np.radians(np.arange(0, 360, 45))
    candidates = place + 0.27 * half * np.column_stack([np.cos(angles), np.sin(angles)])
    clear = np.linalg.norm(candidates[:, None] - others, axis=2).min(axis=1)
    return np.asarray(candidates[int(np.argmax(np.round(clear / half, 6)))])


def _labels(places: FloatArray, near: float) -> list[tuple[FloatArray, str]]:
    """Joint numbers and where to put them; joints closer than ``near`` in the drawing share a label."""
    groups: list[list[int]] = []
    for j, place in enumerate(places):
        for group in groups:
            if np.linalg.norm(places[group].mean(axis=0) - place) < near:
                group.append(j)
                break
        else:
            groups.append([j])
    return [(places[group].mean(axis=0), _numbers(group)) for group in groups]


def _numbers(group: list[int]) -> str:
    """Joints from 1 as ``3``, ``5, 6`` or ``1-4``; ``group`` counts from 0 and is sorted."""
    runs: list[list[int]] = []
    for j in group:
        if runs and runs[-1][-1] == j - 1:
            runs[-1].append(j)
        else:
            runs.append([j])
    return ", ".join(
        f"{run[0] + 1}" if len(run) == 1 else f"{run[0] + 1}{'-' if len(run) > 2 else ', '}{run[-1] + 1}"
        for run in runs
    )


def _vector(values: FloatArray) -> str:
    """A vector to four digits, without the dust that arithmetic leaves on zeros."""
    largest = float(np.abs(values).max())
    return "(" + ", ".join(number(0.0 if abs(v) < 1e-9 * largest else float(v)) for v in values) + ")"
