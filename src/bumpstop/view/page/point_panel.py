"""Points of a workspace on a page: of a study, or computed in the background; each can be clicked."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.errors import BumpstopError
from bumpstop.report.markup import element
from bumpstop.terminal import number
from bumpstop.view.colour_scale import colours_of
from bumpstop.view.point_rows import PointRows, point_rows

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.view.page.panel_host import PanelHost

_NEAR = 0.012
_ENDS = (0.02, 0.95)  # shares of the points at which colours end
_SLICES = ("all points", "slice across x", "slice across y", "slice across z")
_POSES = 2000


class PointPanel:
    """What is coloured all over the workspace.

    Args:
        page: whose it is.
    """

    def __init__(self, page: PanelHost) -> None:
        self._page = page
        self._rows: PointRows | None = page.opened.points
        # What the points are of, and the text beside them.
        self._scenario, self._text, self._earlier = page.opened.scenario, "", False
        self._note, self._hidden = "", False
        # Of the run that was begun last; and for what is drawn and taken away by several threads.
        self._cancelled = threading.Event()
        self._drawing = threading.RLock()
        self._thread: threading.Thread | None = None
        with page.client.gui.add_folder("Workspace", expand_by_default=self._rows is not None):
            buttons = page.client.gui.add_button_group("points", ("Compute", "Cancel", "Hide"))
            buttons.on_click(lambda event: self._press(event.target.value))
            self._axis = page.client.gui.add_dropdown("show", _SLICES, hint="all points, or those near a plane")
            reach = page.opened.robot.span if np.isfinite(page.opened.robot.span) else 2.0
            self._at = page.client.gui.add_slider("plane at, m", -reach, reach, 0.01, 0.0, disabled=True)
            self._axis.on_update(lambda _: self._sliced())
            self._at.on_update(lambda _: self._draw())
            self._says = page.client.gui.add_html("")
        if self._rows is not None:
            self._draw()
        page.client.scene.on_click()(self._clicked)

    @property
    def alive(self) -> bool:
        """Its thread has not ended yet."""
        return self._thread is not None and self._thread.is_alive()

    def close(self) -> None:
        """Stop computing."""
        self._cancelled.set()

    def follow(self, scenario: Scenario) -> None:
        """Have the text beside the points say whether they are of a scenario, wherever its arm is."""
        if self._rows is not None and self._earlier != self._is_earlier(self._rows, scenario):
            self._tell(self._text)

    def _is_earlier(self, rows: PointRows, scenario: Scenario) -> bool:
        """The points are of a scenario that differs in more than the pose and a velocity of theirs."""
        velocity = np.asarray(scenario.motion.velocity)
        # Rows of a study have velocities of their own: those that were computed here have the one on screen.
        own = rows is self._page.opened.points or np.isclose(rows.velocity, velocity, rtol=1e-5).all(axis=1).any()
        return not own or _without_motion(scenario) != _without_motion(self._scenario)

    def _press(self, what: str) -> None:
        self._cancelled.set()
        if what == "Compute":
            self._cancelled, former, self._hidden = threading.Event(), self._thread, False
            self._thread = threading.Thread(
                target=self._work, args=(self._cancelled, former), name="bumpstop-view-workspace", daemon=True
            )
            self._thread.start()
        if what == "Hide":
            with self._drawing:
                self._rows, self._note, self._hidden = None, "", True
                self._page.client.scene.remove_by_name("/points")
                self._say("")

    def _work(self, cancelled: threading.Event, former: threading.Thread | None = None) -> None:
        """Distributions at random poses, in the direction on screen; what is there already stays until it is done.

        Args:
            cancelled: nobody wants more.
            former: ends first: it still has a part under way.
        """
        from bumpstop.study import WorkspaceStudy

        if former is not None:
            former.join()

        scenario = self._page.document.scenario.without_uncertainty()
        try:
            study = WorkspaceStudy(scenario=scenario, poses=_POSES, directions="scenario")
            found: list[dict[str, np.ndarray]] = []
            for shard in range(study.shards):
                share = f"{100 * shard / study.shards:.0f} %"
                if self._is_over(cancelled, share):
                    return
                self._remark(f"computing: {share}")
                columns = study.shard_columns(shard)
                with self._drawing:
                    # Points that were taken away meanwhile stay away.
                    if self._is_over(cancelled, share):
                        return
                    found.append(columns)
                    joined = {name: np.concatenate([each[name] for each in found]) for name in found[0]}
                    self._scenario = scenario
                    self._rows = point_rows(joined, self._page.opened.robot.dof, "workspace")
                    self._draw()
            self._remark("")
        except BumpstopError as error:
            self._remark(str(error))

    def _is_over(self, cancelled: threading.Event, share: str) -> bool:
        """Whether a run was cancelled, which is said beside points that stay."""
        if cancelled.is_set():
            self._remark("" if self._hidden else f"cancelled at {share}")
        return cancelled.is_set()

    def _remark(self, note: str) -> None:
        """Say something of a run, after what is said of the points where there are some."""
        with self._drawing:
            self._note = note
            if self._rows is None:
                self._say(note)
            else:
                self._tell(self._text)

    def _sliced(self) -> None:
        self._at.disabled = self._axis.value == _SLICES[0]
        self._draw()

    def _shown(self) -> PointRows | None:
        """The rows that are drawn."""
        axis = _SLICES.index(self._axis.value) - 1
        return self._rows if self._rows is None or axis < 0 else self._rows.slice(axis, float(self._at.value))

    def _draw(self) -> None:
        rows, every = self._shown(), self._rows
        if rows is None or every is None:
            return
        finite = every.value[np.isfinite(every.value)]
        size = 0.02 if len(rows.value) < 5000 else 0.008
        # A colour means the same in every slice; a few poses near a singularity must not darken all others.
        low, high = (float(end) for end in np.quantile(finite, _ENDS)) if finite.size else (0.0, 1.0)
        # In no order: the first of them stand for all while the picture turns.
        mixed = np.random.default_rng(0).permutation(len(rows.value))
        self._page.client.scene.add_point_cloud(
            "/points", rows.place[mixed].astype(np.float32), colours_of(rows.value[mixed], low, high), point_size=size,
            point_shape="circle",
        )  # fmt: skip
        if finite.size:
            ends = f"dark {number(low)} or less, bright {number(high)} or more"
            self._tell(f"{len(rows.value)} points: {rows.label}, {ends}; click one to go there")

    def _clicked(self, event: Any) -> None:
        rows = self._shown()
        if rows is None:
            return
        origin, direction = np.asarray(event.ray_origin), np.asarray(event.ray_direction)
        if self._page.scene.arm_is_hit(origin, direction):
            return
        row = rows.nearest(origin, direction, _NEAR)
        if row is None or self._page.document.scenario.motion.kind != "line":
            return
        speed = float(np.linalg.norm(self._page.document.scenario.motion.velocity))
        self._page.set_pose(rows.q[row], rows.velocity_on_screen(row, speed))
        name = int(rows.number[row])
        # No motion on screen is as slow as that.
        none = f", no speed is safe; on screen it is {number(1e3 * speed)} mm/s" if rows.none_safe(row) else ""
        otherwise = f", {rows.otherwise}" if rows.otherwise else ""
        self._tell(f"row {name + 1}: {rows.label} {number(float(rows.value[row]))}{otherwise}{none}", row=name)

    def _tell(self, text: str, row: int | None = None) -> None:
        """Say something of the points, and whether they are of the scenario on screen."""
        rows = self._rows
        if rows is not None:
            self._text, self._earlier = text, self._is_earlier(rows, self._page.document.scenario)
            earlier = "these points are of an earlier scenario" if self._earlier else ""
            self._say("; ".join(each for each in (text, earlier, self._note) if each), row)

    def _say(self, text: str, row: int | None = None) -> None:
        marked = None if row is None else str(row)
        self._says.content = str(element("div", text, style="font-size:12px;padding:2px 8px", data_point=marked))


def _without_motion(scenario: Scenario) -> dict[str, Any]:
    """What a scenario says of anything but the pose and the velocity; the points are of numbers taken for known."""
    data = scenario.without_uncertainty().to_dict()
    for key in ("pose_deg", "pose_rad"):
        data.pop(key, None)
    del data["motion"]["velocity_mm_s"]
    return data
