"""The arm as it stands when the motion begins, and which way it goes."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.summary import what_is_hit
from bumpstop.collision.trajectory.trajectory import point_motion
from bumpstop.collision.trajectory.trajectory_result import TrajectoryCollisionResult
from bumpstop.report.collision.chain import View, chain_points, draw_chain, draw_views
from bumpstop.report.formatting import arm
from bumpstop.report.markup import Html, paragraph, table
from bumpstop.report.picture import LAW, LIMIT, Picture
from bumpstop.report.section import Section
from bumpstop.terminal import number

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# A direction this much out of the drawing's plane is drawn as a sign, not as a short arrow.
_SIDEWAYS = 0.35
# Length of the motion's arrow, as a share of half a view's width.
_GAP = 0.38


class ArmSection(Section):
    """Two views of the arm in its pose, with joints, contact point and motion."""

    title = "The arm and its motion"
    anchor = "arm"

    def content(self) -> list[Html]:
        """Where the contact is, and the pose as a table."""
        result, problem, curve = self.result, self.result.problem, self.result.curve
        contact, motion = result.scenario.contact, result.scenario.motion
        rows = [
            (
                str(j + 1),
                joint.name,
                f"{math.degrees(q):.4g} deg" if joint.kind == "revolute" else f"{q:.4g} m",
                "held still" if self._contact_begin is None and j in problem.held else "moves",
            )
            for j, (joint, q) in enumerate(zip(problem.robot.joints, self._q, strict=True))
        ]
        where = contact.link or problem.robot.tip_name
        if self._contact_begin is not None:
            assert problem.trajectory is not None
            return [
                paragraph(
                    f"{arm(result)} follows a joint trajectory of {problem.trajectory.duration:.4g} s. Drawn is the "
                    f"hardest moment to be hit: contact that begins after {self._contact_begin:.3f} s. The "
                    f"contact point on {where} then is at {_vector(curve.start)} m and meets {what_is_hit(result)} "
                    f"along {_vector(curve.normal)} at {1e3 * curve.approach_speed:.4g} mm/s."
                ),
                table(("joint", "name", "position", ""), rows, caption="Pose at that moment"),
            ]
        speed = math.hypot(*motion.velocity)
        start = "already at full speed" if motion.start == "moving" else "from rest"
        return [
            paragraph(
                f"{arm(result)} moves its tip ({problem.robot.tip_name}) at {1e3 * speed:g} mm/s along "
                f"{_vector(np.array(motion.velocity) / speed)} in the base frame, {start}. The contact point on "
                f"{where} starts at {_vector(curve.start)} m and meets {what_is_hit(result)} along "
                f"{_vector(curve.normal)} at {1e3 * curve.approach_speed:.4g} mm/s."
            ),
            table(("joint", "name", "position", ""), rows, caption="Pose at the start of the motion"),
        ]

    def pictures(self) -> list[Picture]:
        """One figure with an elevation and the plan."""
        alt = (
            f"Two views of the arm as lines between its joints, numbered 1 to {self.result.problem.robot.dof} from the "
            f"base. The contact point is at {_vector(self.result.curve.start)} m; an arrow shows its motion toward the "
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
        return chain_points(self.result.problem.robot, self._q)

    @property
    def _contact_begin(self) -> float | None:
        """When the contact that is drawn begins in its trajectory [s]; None: the motion is a line."""
        return self.result.onset if isinstance(self.result, TrajectoryCollisionResult) else None

    @property
    def _q(self) -> FloatArray:
        """Pose that is drawn (dof,) [rad or m]."""
        trajectory = self.result.problem.trajectory
        if trajectory is None or self._contact_begin is None:
            return self.result.problem.q
        return trajectory.at(self._contact_begin)

    @cached_property
    def _velocity(self) -> FloatArray:
        """Of the contact point in that pose (3,) [m/s]."""
        problem = self.result.problem
        if problem.trajectory is None or self._contact_begin is None:
            return np.asarray(problem.start.point_velocity)
        t = np.array([self._contact_begin])
        return np.asarray(point_motion(problem.trajectory, problem.robot, problem.contact_point, t)[0][0])

    def _draw(self, figure: Figure) -> None:
        draw_views(figure, self._chain, self._draw_view)

    def _draw_view(self, panel: Axes, view: View, half: float) -> None:
        aim = view.flat(self._aim(half))
        draw_chain(panel, view, self._chain, half, aim)
        self._draw_contact(panel, view, half)

    def _aim(self, half: float) -> FloatArray:
        """From the contact point to the tip of the motion's arrow, a few points on the way (5, 3) [m]."""
        velocity = self._velocity
        way = np.linspace(0, _GAP * half, 5)[:, None] * velocity / np.linalg.norm(velocity)
        return np.asarray(self.result.curve.start + way)

    def _draw_contact(self, panel: Axes, view: View, half: float) -> None:
        curve = self.result.curve
        point = view.flat(curve.start)
        velocity = self._velocity
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


def _vector(values: FloatArray) -> str:
    """A vector to four digits, without the dust that arithmetic leaves on zeros."""
    largest = float(np.abs(values).max())
    return "(" + ", ".join(number(0.0 if abs(v) < 1e-9 * largest else float(v)) for v in values) + ")"
