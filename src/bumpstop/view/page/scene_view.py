"""The three-dimensional picture of a page: the arm, what it hits, and arrows of motion and force."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision.scenario_values import start_pose
from bumpstop.view.scene.arm_shapes import arm_shapes

if TYPE_CHECKING:
    from collections.abc import Callable

    import viser

    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Scenario
    from bumpstop.view.answer import Answer
    from bumpstop.view.opened import Opened

_MOTION, _FORCE, _BODY = (0, 114, 178), (213, 94, 0), (230, 170, 130)
# Arrows: one second of motion, and a newton.
_ARROW_M, _M_PER_N = 0.25, 1e-3
_BODY_RADIUS_M = 0.045


class SceneView:
    """The picture of one page.

    Args:
        client: whose page it is.
        opened: what stands in it.
        touched: told the link of the arm and the point in its frame that a person clicked.
    """

    def __init__(self, client: viser.ClientHandle, opened: Opened, touched: Callable[[str, FloatArray], None]) -> None:
        from viser import transforms

        self._client, self._robot, self._touched = client, opened.robot, touched
        self._quaternion: Callable[[FloatArray], FloatArray] = lambda R: transforms.SO3.from_matrix(R).wxyz
        self._rotation_of: dict[int, FloatArray] = {}
        scene = client.scene
        reach = opened.robot.span if np.isfinite(opened.robot.span) else 1.5
        scene.set_up_direction("+z")
        scene.add_grid("/floor", width=2 * reach, height=2 * reach, cell_size=0.1, section_size=0.5, shadow_opacity=0)
        self._shapes = {shape.link: shape for shape in arm_shapes(opened.robot)}
        self._frames: dict[int, Any] = {}
        for link, shape in self._shapes.items():
            frame = scene.add_frame(f"/arm/{link + 1}", show_axes=False)
            mesh = scene.add_mesh_simple(
                f"/arm/{link + 1}/shape", shape.vertices, shape.faces, color=shape.colour, cast_shadow=False,
                receive_shadow=False,
            )  # fmt: skip
            self._frames[link] = frame
            if link >= 0:
                mesh.on_click(self._clicked(link))
        self._body = scene.add_icosphere("/body", _BODY_RADIUS_M, color=_BODY, opacity=0.85, cast_shadow=False)
        self._look_from(reach)

    def _look_from(self, reach: float) -> None:
        camera = self._client.camera
        camera.position = (1.15 * reach, -1.25 * reach, 0.95 * reach)
        camera.look_at = (0.0, 0.0, 0.35 * reach)

    def _clicked(self, link: int) -> Callable[[Any], None]:
        def clicked(event: Any) -> None:
            frame = self._frames[link]
            pose = np.eye(4)
            pose[:3, :3] = np.asarray(self._rotation_of[link])
            pose[:3, 3] = frame.position
            origin = pose[:3, :3].T @ (np.asarray(event.ray_origin) - pose[:3, 3])
            direction = pose[:3, :3].T @ np.asarray(event.ray_direction)
            far = self._shapes[link].hit(origin, direction)
            if far is not None:
                self._touched(self._robot.joints[link].link, origin + far * direction)

        return clicked

    def show(self, scenario: Scenario, answer: Answer | None) -> None:
        """Draw a scenario, with the forces of its answer where there is one."""
        if scenario.motion.kind != "line":
            return
        q = start_pose(scenario, self._robot)
        with self._client.atomic():
            self.pose(q)
            self._contact(scenario, q, answer)

    def pose(self, q: FloatArray) -> None:
        """Draw the arm in a pose (dof,) [rad or m]."""
        self._rotation_of = {}
        for link, frame in self._frames.items():
            X = np.eye(4) if link < 0 else self._robot.pose(q, self._robot.joints[link].link)
            self._rotation_of[link] = X[:3, :3]
            frame.wxyz, frame.position = self._quaternion(X[:3, :3]), X[:3, 3]

    def _contact(self, scenario: Scenario, q: FloatArray, answer: Answer | None) -> None:
        contact = scenario.contact
        point = self._robot.pose(q, contact.link, contact.point_m)[:3, 3]
        velocity = np.asarray(scenario.motion.velocity)
        along = velocity / np.linalg.norm(velocity)
        normal = along if contact.normal is None else np.asarray(contact.normal) / np.linalg.norm(contact.normal)
        self._body.position = point + normal * _BODY_RADIUS_M
        self._arrow("/motion", point - along * _ARROW_M, point, _MOTION)
        force = 0.0 if answer is None else answer.result.peak_force.quantile(0.99)
        if np.isfinite(force) and force > 0:
            self._arrow("/force", point + normal * _M_PER_N * force, point, _FORCE)

    def _arrow(self, name: str, start: FloatArray, end: FloatArray, colour: tuple[int, int, int]) -> None:
        self._client.scene.add_arrows(
            name, np.array([[start, end]]), colour, shaft_radius=0.008, head_radius=0.02, head_length=0.05
        )
