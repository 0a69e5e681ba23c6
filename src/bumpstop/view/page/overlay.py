"""What a page draws over the arm when it is asked to: the arm as it was, and where it hardly feels a force."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.view.page.scene_view import direction_of_motion, quaternion
from bumpstop.view.scene.polytope import force_polytope
from bumpstop.view.scene.poor_directions import poor_directions

if TYPE_CHECKING:
    from collections.abc import Sequence

    import viser

    from bumpstop.arrays import FloatArray
    from bumpstop.model import Robot
    from bumpstop.view.answer import Answer
    from bumpstop.view.page.scene_view import SceneView
    from bumpstop.view.page.tools import Tools
    from bumpstop.view.scene.arm_shapes import LinkShape
    from bumpstop.view.scene.poor_directions import PoorDirections

_GHOST, _FELT, _UNFELT = (86, 180, 233), (170, 60, 130), (213, 94, 0)
_OPACITY = 0.35
_M_PER_N = 1e-3
# Lines to scale end here; those of directions without any detection have one length.
_MAX_LINE_M, _UNFELT_M = 0.25, 0.12


class Overlay:
    """Further things in the picture of one page.

    Args:
        client: whose page it is.
        robot: the arm.
        shapes: of the arm.
    """

    def __init__(self, client: viser.ClientHandle, robot: Robot, shapes: Sequence[LinkShape]) -> None:
        self._scene, self._robot, self._shapes = client.scene, robot, shapes
        self._client = client
        self._before: Answer | None = None
        self._poor = False

    def show_before(self, answer: Answer | None) -> None:
        """Draw the arm of an earlier result as a ghost with its motion and force, or take it away."""
        if answer is self._before:
            return
        self._before = answer
        with self._client.atomic():
            self._scene.remove_by_name("/before")
            if answer is not None:
                self._ghost(answer)

    def _ghost(self, answer: Answer) -> None:
        q, contact = answer.result.problem.q, answer.scenario.contact
        for shape in self._shapes:
            X = np.eye(4) if shape.link < 0 else self._robot.pose(q, self._robot.joints[shape.link].link)
            self._scene.add_mesh_simple(
                f"/before/{shape.link + 1}", shape.vertices, shape.faces, color=_GHOST, opacity=_OPACITY,
                position=X[:3, 3], wxyz=quaternion(X[:3, :3]), cast_shadow=False, receive_shadow=False,
            )  # fmt: skip
        point = self._robot.pose(q, contact.link, contact.point_m)[:3, 3]
        along = direction_of_motion(answer)
        side = np.cross(along, [0.0, 0.0, 1.0]) if abs(along[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        force = answer.result.peak_force.quantile(0.99)
        length = _M_PER_N * min(force, 1000.0) if np.isfinite(force) else 1.0
        # On the other side than the present one: the two can be compared where the arm has not moved.
        start = point - 0.06 * side
        points = np.array([[start, start - along * max(length, 0.01)]])
        self._scene.add_arrows("/before/force", points, _GHOST, shaft_radius=0.008, head_radius=0.02, head_length=0.05)

    def show_forces(self, answer: Answer, scene: SceneView, tools: Tools) -> None:
        """Draw forces that no threshold detects, at the contact point and on every link, where they are asked for.

        Args:
            answer: of the scenario on screen.
            scene: the picture.
            tools: that ask for them.
        """
        problem, contact = answer.result.problem, answer.scenario.contact
        at = problem.robot.pose(problem.q, contact.link, contact.point_m)[:3, 3]
        scene.show_polytope(force_polytope(problem, problem.q) if tools.polytope else None, at)
        tools.say_of_poor(self.show_poor(poor_directions(problem, problem.q) if tools.poor else None))

    def show_poor(self, found: PoorDirections | None) -> str:
        """Draw where forces stay undetected, 1 m for 1000 N, or take it away.

        Returns:
            What the lines are, to stand beside the picture: in it, it would cover other labels. Empty: there are none.
        """
        if found is None:
            if self._poor:
                self._scene.remove_by_name("/poor")
            self._poor = False
            return ""
        self._poor = True
        lines = poor_lines(found)
        unfelt = ~np.isfinite(found.force)
        with self._client.atomic():
            self._scene.remove_by_name("/poor")
            for name, kept, colour in (("none", unfelt, _UNFELT), ("some", ~unfelt, _FELT)):
                if kept.any():
                    self._scene.add_line_segments(f"/poor/{name}", lines[kept], colour, thickness=0.006)
        words = [] if unfelt.all() else [f"up to {found.force[~unfelt].max():.0f} N along a line"]
        return "; ".join([*words, *(["orange: any force"] if unfelt.any() else [])])


def poor_lines(found: PoorDirections) -> FloatArray:
    """Lines (N, 2, 3) across the places along the directions [m]."""
    finite = np.isfinite(found.force)
    half = np.where(finite, np.minimum(_M_PER_N * np.where(finite, found.force, 0.0), _MAX_LINE_M), _UNFELT_M)
    reach = half[:, None] * found.direction
    return np.stack([found.place - reach, found.place + reach], axis=1)
