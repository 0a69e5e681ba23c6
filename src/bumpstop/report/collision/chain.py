"""A chain as lines between its joints, in two views."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.model import Robot
from bumpstop.report.picture import FAINT, INK, Picture

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class View:
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


FRONT = View("from the side (x, z)", 0, 2, 1, -1)
SIDE = View("from the front (y, z)", 1, 2, 0, 1)
TOP = View("from above (x, y)", 0, 1, 2, 1)


def chain_picture(robot: Robot) -> Picture:
    """The arm with every joint at zero, or at the limit nearest to it."""
    chain = chain_points(robot, np.clip(0.0, robot.lower, robot.upper))
    name = robot.title or robot.name
    alt = f"Two views of {name} as lines between its joints, numbered 1 to {robot.dof} from the base."
    caption = "Every joint at zero, or at the limit nearest to it. Joints that lie behind one another share a label."

    def draw(figure: Figure) -> None:
        draw_views(figure, chain, lambda panel, view, half: draw_chain(panel, view, chain, half, np.empty((0, 2))))

    return Picture("chain", alt, caption, draw, height=2.95)


def chain_points(robot: Robot, q: FloatArray) -> FloatArray:
    """Base, every joint and the tip (dof + 2, 3) in the base frame [m]."""
    frames = [robot.pose(q, joint.link)[:3, 3] for joint in robot.joints]
    return np.array([np.zeros(3), *frames, robot.pose(q)[:3, 3]])


def draw_views(figure: Figure, chain: FloatArray, draw: Callable[[Axes, View, float], None]) -> None:
    """Two panels side by side, an elevation and the plan, each filled by ``draw(panel, view, half its width in m)``."""
    width, height = figure.get_size_inches()
    reach = np.ptp(chain, axis=0)
    side = 1.82
    for i, view in enumerate((FRONT if reach[0] >= reach[1] else SIDE, TOP)):
        box = ((0.68 + i * (side + 0.62)) / width, 0.48 / height, side / width, side / height)
        draw(figure.add_axes(box), view, 0.68 * max(float(reach.max()), 0.1))


def draw_chain(panel: Axes, view: View, chain: FloatArray, half: float, aim: FloatArray) -> None:
    """Draw the links and number the joints.

    Args:
        panel: to draw in.
        view: from where.
        chain: base, joints and tip (dof + 2, 3) [m].
        half: half the width of the panel [m].
        aim: points (N, 2) of the drawing that labels keep clear of, from the contact point on; may be none.
    """
    flat = view.flat(chain)
    everything = np.concatenate([flat, aim])
    centre = (everything.min(axis=0) + everything.max(axis=0)) / 2
    panel.set_title(view.title, fontsize=9.5)
    panel.set_xlabel("xyz"[view.right] + " [m]")
    panel.set_ylabel("xyz"[view.up] + " [m]", labelpad=2)
    panel.grid(color="#e4e4e4", linewidth=0.6)
    panel.set_xlim(centre[0] - half, centre[0] + half)
    panel.set_ylim(centre[1] - half, centre[1] + half)
    # One decimal fits between the panels' edges, two do not: no steps of a quarter.
    panel.locator_params(nbins=6, steps=[1, 2, 5, 10])
    # Wide grey lines with a thin dark core: links, whatever the paper.
    panel.plot(*flat.T, color="#c8c8c8", linewidth=7, solid_capstyle="round", solid_joinstyle="round")
    panel.plot(*flat.T, color=INK, linewidth=1)
    panel.plot(*flat[0], marker="s", markersize=9, color=FAINT)
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


def _beside(place: FloatArray, chain: FloatArray, aim: FloatArray, half: float) -> FloatArray:
    """Where a label goes: on its joint, or beside it where it would cover the contact point or the arrow."""
    if len(aim) == 0 or np.linalg.norm(place - aim, axis=1).min() > 0.16 * half:
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
