"""The three-dimensional picture of a page: the arm, what it hits, a person, and arrows of motion and force."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.contact import LimitTable
from bumpstop.view.scene.person import person_parts

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser

    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Scenario
    from bumpstop.view.answer import Answer
    from bumpstop.view.opened import Opened
    from bumpstop.view.scene.polytope import ForcePolytope

_MOTION, _FORCE, _BODY, _SKIN, _CHOSEN = (0, 114, 178), (213, 94, 0), (230, 170, 130), (225, 200, 180), (213, 94, 0)
# Lengths of arrows: of the motion, and of a newton.
_ARROW_M, _M_PER_N = 0.25, 1e-3
_SEEN_M = 0.003  # about a pixel of a picture that holds the arm and the person
_FACING = -0.8  # the person looks at the arm and the camera [rad]


@dataclass(frozen=True)
class Clicks:
    """What a page is told of its picture.

    Attributes:
        arm: the link of the arm and the point in its frame [m] that a person clicked.
        body: the name of the body region that a person clicked.
        hand: the place and orientation (4, 4) that a person dragged the hand to.
    """

    arm: Callable[[str, FloatArray], None]
    body: Callable[[str], None]
    hand: Callable[[FloatArray], None]


class SceneView:
    """The picture of one page.

    Args:
        client: whose page it is.
        opened: what stands in it.
        clicks: told what a person does in the picture.
    """

    def __init__(self, client: viser.ClientHandle, opened: Opened, clicks: Clicks) -> None:
        self._client, self._robot, self._clicks = client, opened.robot, clicks
        reach = opened.robot.span if np.isfinite(opened.robot.span) else 1.5
        scene = client.scene
        scene.set_up_direction("+z")
        scene.add_light_ambient("/ambient", intensity=1.2)
        scene.add_grid("/floor", width=4, height=4, cell_size=0.25, section_size=1.0, shadow_opacity=0)
        self._shapes = {shape.link: shape for shape in opened.shapes}
        self._frames: dict[int, Any] = {}
        for link, shape in self._shapes.items():
            self._frames[link] = scene.add_frame(f"/arm/{link + 1}", show_axes=False)
            mesh = scene.add_mesh_simple(
                f"/arm/{link + 1}/shape", shape.vertices, shape.faces, color=shape.colour, cast_shadow=False,
                receive_shadow=False,
            )  # fmt: skip
            if link >= 0:
                mesh.on_click(self._clicked(link))
        self._body = scene.add_icosphere("/body", 1.0, color=_BODY, opacity=0.85, cast_shadow=False, visible=False)
        self._hand = scene.add_transform_controls("/hand", scale=0.18 * reach, visible=False, depth_test=False)
        self._hand.on_update(self._dragged)
        self._parts: dict[str, Any] = {}
        self._arrows: dict[str, Any] = {}
        self._q: FloatArray | None = None
        self._touch: FloatArray | None = None
        self._table = ""
        self._person_at = (-0.45 * reach - 0.35, 0.6 * reach + 0.35, 0.0)
        client.camera.position = (1.2 * reach, -1.5 * reach, 0.95 * reach)
        client.camera.look_at = (-0.1 * reach, 0.1 * reach, 0.4 * reach)

    def arm_is_hit(self, origin: FloatArray, direction: FloatArray) -> bool:
        """Whether a ray meets the arm as it is drawn.

        Args:
            origin: of the ray (3,) [m].
            direction: of the ray (3,).
        """
        for link, shape in self._shapes.items():
            frame = self._frames[link]
            R = rotation_of(frame.wxyz)
            if shape.hit(R.T @ (origin - frame.position), R.T @ direction) is not None:
                return True
        return False

    def place_of(self, body: str) -> FloatArray:
        """Where a part of the person stands, middle of its box (3,) [m].

        Args:
            body: name of the body region.
        """
        part = self._parts[body]
        corners = np.asarray(part.vertices)
        return np.asarray(rotation_of(part.wxyz) @ (corners.min(axis=0) + corners.max(axis=0)) / 2 + part.position)

    def _clicked(self, link: int) -> Callable[[Any], None]:
        def clicked(event: Any) -> None:
            frame = self._frames[link]
            R = rotation_of(frame.wxyz)
            origin = R.T @ (np.asarray(event.ray_origin) - frame.position)
            direction = R.T @ np.asarray(event.ray_direction)
            far = self._shapes[link].hit(origin, direction)
            if far is not None:
                self._clicks.arm(self._robot.joints[link].link, origin + far * direction)

        return clicked

    def _dragged(self, event: Any) -> None:
        # What the page itself moves has no client.
        if event.client is None:
            return
        X = np.eye(4)
        X[:3, :3], X[:3, 3] = rotation_of(event.target.wxyz), event.target.position
        self._clicks.hand(X)

    def show_hand(self, visible: bool) -> None:
        """Show or hide what the hand is dragged by."""
        self._hand.visible = visible

    def show(self, scenario: Scenario, q: FloatArray, answer: Answer, *, hand: bool) -> None:
        """Draw a scenario with the forces of its answer.

        Args:
            scenario: on screen.
            q: pose of the arm (dof,) [rad or m].
            answer: of the scenario.
            hand: put what the hand is dragged by where the hand is.
        """
        with self._client.atomic():
            self.pose(q)
            self._person(scenario)
            self._contact(scenario, q, answer)
            if hand:
                X = self._robot.pose(q)
                self._hand.wxyz, self._hand.position = quaternion(X[:3, :3]), X[:3, 3]

    def pose(self, q: FloatArray) -> None:
        """Draw the arm in a pose (dof,) [rad or m]."""
        # What stands as it stood is not sent: a picture that need not be drawn anew leaves its time to the plots.
        if self._q is not None and (self._q == q).all():
            return
        self._q = q.copy()
        for link, frame in self._frames.items():
            X = np.eye(4) if link < 0 else self._robot.pose(q, self._robot.joints[link].link)
            frame.wxyz, frame.position = quaternion(X[:3, :3]), X[:3, 3]

    def _person(self, scenario: Scenario) -> None:
        """A figure whose parts are the regions of the limit table; the part that is hit stands out."""
        if scenario.contact.limits != self._table:
            self._table = scenario.contact.limits
            for part in self._parts.values():
                part.remove()
            table = LimitTable.load(self._table, relative_to=scenario.folder)
            self._parts = {}
            for name, (vertices, faces) in person_parts(table).items():
                part = self._client.scene.add_mesh_simple(
                    f"/person/{name}", vertices, faces, color=_SKIN, cast_shadow=False, receive_shadow=False,
                    position=self._person_at, wxyz=(np.cos(_FACING / 2), 0.0, 0.0, np.sin(_FACING / 2)),
                )  # fmt: skip
                part.on_click(self._chooses(name))
                self._parts[name] = part
        for name, part in self._parts.items():
            colour = _CHOSEN if name == scenario.contact.body else _SKIN
            if tuple(part.color) != colour:
                part.color = colour

    def _chooses(self, name: str) -> Callable[[Any], None]:
        def chosen(_: Any) -> None:
            self._clicks.body(name)

        return chosen

    def _contact(self, scenario: Scenario, q: FloatArray, answer: Answer) -> None:
        """The body that is hit: a ball whose disc has the contact area, and the arrows of motion and force."""
        contact = scenario.contact
        point = self._robot.pose(q, contact.link, contact.point_m)[:3, 3]
        velocity = direction_of_motion(answer)
        normal = velocity if contact.normal is None else np.asarray(contact.normal) / np.linalg.norm(contact.normal)
        radius = max(0.03, 1e-2 * float(np.sqrt(contact.area_cm2 / np.pi)))
        touch = np.concatenate([point, normal, velocity, [radius]])
        if self._touch is not None and np.allclose(touch, self._touch, rtol=0, atol=1e-9):
            return
        self._touch = touch
        self._body.scale, self._body.position, self._body.visible = radius, point + normal * radius, True
        beyond = point + normal * 2 * radius
        self._arrow("/motion", beyond, beyond + velocity * _ARROW_M, _MOTION)
        self.show_force(answer)

    def show_force(self, answer: Answer) -> None:
        """Draw the 99 % quantile of the peak force, 1 m for 1000 N, beside the body that is hit."""
        if self._touch is None:
            return
        point, normal, radius = self._touch[:3], self._touch[3:6], float(self._touch[9])
        force = answer.result.peak_force.quantile(0.99)
        length = _M_PER_N * min(force, 1000.0) if np.isfinite(force) else 1.0
        side = np.cross(normal, [0.0, 0.0, 1.0]) if abs(normal[2]) < 0.9 else np.array([1.0, 0.0, 0.0])
        start = point + normal * radius + side * 1.6 * radius
        self._arrow("/force", start, start - normal * max(length, 0.01), _FORCE)

    def _arrow(self, name: str, start: FloatArray, end: FloatArray, colour: tuple[int, int, int]) -> None:
        points = np.array([[start, end]])
        if name in self._arrows:
            # Each change has the whole picture drawn anew, for a quarter of a second.
            if np.abs(self._arrows[name].points - points).max() > _SEEN_M:
                self._arrows[name].points = points
            return
        self._arrows[name] = self._client.scene.add_arrows(
            name, points, colour, shaft_radius=0.008, head_radius=0.02, head_length=0.05
        )

    def show_polytope(self, polytope: ForcePolytope | None, at: FloatArray) -> None:
        """Draw the forces that no threshold detects at a point [m], or take them away."""
        scene = self._client.scene
        if polytope is None:
            for name in ("/undetectable", "/undetectable_label"):
                scene.remove_by_name(name)
            return
        scene.add_mesh_simple(
            "/undetectable", _M_PER_N * polytope.vertices, polytope.faces, color=(204, 121, 167), opacity=0.4,
            position=at, side="double", flat_shading=True, cast_shadow=False, receive_shadow=False,
        )  # fmt: skip
        text = f"{polytope.largest_N:.0f} N undetected" if np.isfinite(polytope.largest_N) else "any force undetected"
        scene.add_label("/undetectable_label", text, position=at + _M_PER_N * polytope.farthest)


def direction_of_motion(answer: Answer) -> FloatArray:
    """Unit vector (3,) in which the contact point moves, base frame."""
    velocity = np.asarray(answer.result.problem.velocity, dtype=np.float64)
    if not velocity.any():
        velocity = np.asarray(answer.result.curve.normal, dtype=np.float64)
    return np.asarray(velocity / np.linalg.norm(velocity))


def quaternion(R: FloatArray) -> FloatArray:
    """A rotation matrix as w, x, y, z, as viser has it."""
    from viser.transforms import SO3

    return np.asarray(SO3.from_matrix(R).wxyz, dtype=np.float64)


def rotation_of(wxyz: Any) -> FloatArray:
    """The rotation matrix (3, 3) of w, x, y, z."""
    from viser.transforms import SO3

    return np.asarray(SO3(np.asarray(wxyz)).as_matrix(), dtype=np.float64)
