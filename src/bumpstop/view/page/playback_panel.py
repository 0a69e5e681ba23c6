"""Playing a trajectory or a recording: the arm moves, and the worst place is a click away."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.errors import BumpstopError
from bumpstop.report.markup import element
from bumpstop.terminal import number
from bumpstop.view.colour_scale import colours_of
from bumpstop.view.latest import LatestWins
from bumpstop.view.playback import Playback, recorded_playback, trajectory_playback
from bumpstop.view.retimed_scenario import retimed_scenario

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Scenario
    from bumpstop.view.page.panel_host import PanelHost

_FRAME_S = 0.05
_ELSEWHERE = "The arm is where the scenario has it; move the time to see where it was."


class PlaybackPanel:
    """A time slider with play, of what was opened with a motion; nothing of a straight line.

    Args:
        page: whose it is.

    Attributes:
        pose: of the arm at the time that is shown (dof,) [rad or m]; None: of the scenario.
    """

    def __init__(self, page: PanelHost) -> None:
        self._page = page
        self.pose: FloatArray | None = None
        # Where the scenario has the arm.
        self._at = (page.opened.scenario.pose_deg, page.opened.scenario.pose_rad)
        self._closed = threading.Event()
        self._running = threading.Event()
        self._lock = threading.Lock()
        self._playback: Playback | None = None
        # The scenario whose motion is to be played, and the one that it was last asked for.
        self._wanted: Scenario | None = None
        self._submitted: Scenario | None = None
        # What "Apply safe speeds" put on screen.
        self._slowed: Scenario | None = None
        self._worker: LatestWins[Scenario] | None = None
        if page.opened.recorded is None and page.opened.scenario.motion.kind == "line":
            return
        self._build(page.client.gui)
        self._worker = LatestWins(self._compute, "bumpstop-view-motion")
        self._player = threading.Thread(target=self._play, name="bumpstop-view-playback", daemon=True)
        self._player.start()
        self.follow(page.opened.scenario)

    @property
    def alive(self) -> bool:
        """One of its threads has not ended yet."""
        return self._worker is not None and (self._worker.alive or self._player.is_alive())

    def close(self) -> None:
        """Stop playing and computing."""
        self._closed.set()
        self._running.set()
        if self._worker is not None:
            self._worker.close()

    def expire(self, scenario: Scenario) -> None:
        """Take away what is of another scenario: its safe speeds would be taken for those of this one.

        Args:
            scenario: on screen. A recording stays what it is, but the arm goes where its scenario is moved.
        """
        with self._lock:
            at, self._at = self._at, (scenario.pose_deg, scenario.pose_rad)
            if self._at != at and self.pose is not None and self._page.opened.recorded is not None:
                self.pose = None
                self._running.clear()
                self._says.content = _line(_ELSEWHERE, times=None)
            recorded = self._page.opened.recorded is not None
            if self._worker is None or scenario == self._wanted or (recorded and self._wanted is not None):
                return
            self._wanted, self._submitted, self._playback = scenario, None, None
            self._running.clear()
            self._time.disabled = True
            self._says.content = _line("computing ...", times=None)
            self._page.client.scene.remove_by_name("/way")
            if scenario != self._slowed:
                self._times.content = ""

    def follow(self, scenario: Scenario) -> None:
        """Have the motion be that of a scenario: a trajectory is computed anew, a recording stays what it is."""
        self.expire(scenario)
        with self._lock:
            if self._worker is not None and self._wanted is not None and self._wanted != self._submitted:
                self._submitted = self._wanted
                self._worker.submit(self._wanted)

    def _build(self, gui: Any) -> None:
        with gui.add_folder("Motion in time"):
            self._time = gui.add_slider("time, s", 0.0, 1.0, 0.001, 0.0, disabled=True)
            self._time.on_update(lambda _: self._show())
            buttons = gui.add_button_group("play", ("Play", "Stop", "Worst"))
            buttons.on_click(lambda event: self._press(event.target.value))
            if self._page.opened.recorded is None:
                slow = gui.add_button("Apply safe speeds", hint="slow the trajectory down to its safe speeds")
                slow.on_click(lambda _: self._slow_down())
            self._times = gui.add_html("")
            self._says = gui.add_html("computing ...")

    def _press(self, what: str) -> None:
        playback = self._playback
        if playback is None:
            return
        if what == "Play":
            self._running.set()
            return
        self._running.clear()
        if what == "Worst":
            self._time.value = float(playback.time[playback.worst])

    def _slow_down(self) -> None:
        """Put the slowed trajectory on screen, one step to undo, and say what it costs."""
        try:
            scenario = self._page.document.scenario
            found = retimed_scenario(scenario, self._page.opened.folder, self._closed.is_set)
        except BumpstopError as error:
            self._times.content = _line(str(error), times=None)
            return
        if found is None:
            return
        if self._page.document.scenario != scenario:
            # Safe speeds of what was on screen need not be safe for what is.
            self._times.content = _line("The scenario was changed meanwhile: press again.", times=None)
            return
        self._page.change(found.changes, "motion.file")
        self._slowed = self._page.document.scenario
        longer = 100 * (found.after_s / found.before_s - 1)
        took = f"{number(found.before_s)} s before, {number(found.after_s)} s at safe speeds ({longer:+.1f} %)"
        self._times.content = _line(f"{took}: {found.file}", times=f"{found.before_s!r} {found.after_s!r}")

    def _show(self) -> None:
        playback = self._playback
        if playback is None:
            return
        t = float(self._time.value)
        self.pose = playback.pose_at(t)
        answer = self._page.answer
        if answer is None:
            self._page.scene.pose(self.pose)
        else:
            self._page.scene.show(answer.scenario, self.pose, answer, hand=False)
        self._says.content = str(
            element(
                "div",
                element("div", playback.words_at(t), data_playback=f"{t:.3f}"),
                playback.chart(t),
                style="font-size:12px;padding:2px 8px",
            )
        )

    def _compute(self, scenario: Scenario) -> None:
        worker, recorded = self._worker, self._page.opened.recorded
        assert worker is not None
        try:
            if recorded is not None:
                playback: Playback | None = recorded_playback(recorded, self._page.opened.robot)
            else:
                playback = trajectory_playback(scenario, worker.has_newer, self._progress)
        except BumpstopError as error:
            with self._lock:
                if scenario == self._wanted:
                    self._says.content = _line(str(error), times=None)
            return
        with self._lock:
            if playback is None or scenario != self._wanted:
                return
            self._playback = playback
            self._time.min, self._time.max = float(playback.time[0]), float(playback.time[-1])
            if not playback.time[0] <= self._time.value <= playback.time[-1]:
                self._time.value = float(playback.time[-1])
            self._time.disabled = False
            self._page.client.scene.add_point_cloud(
                "/way", playback.places.astype(np.float32), colours_of(playback.shown_values), point_size=0.012
            )
        self._show()

    def _play(self) -> None:
        while not self._closed.is_set():
            self._running.wait()
            playback = self._playback
            if self._closed.is_set():
                return
            if playback is None:
                self._running.clear()
                continue
            t = float(self._time.value) + _FRAME_S
            if t >= playback.time[-1]:
                self._running.clear()
                t = float(playback.time[-1])
            self._time.value = t
            self._closed.wait(_FRAME_S)

    def _progress(self, share: float) -> None:
        self._says.content = _line(f"computing: {100 * share:.0f} %", times=None)


def _line(text: str, *, times: str | None) -> str:
    look = "font-size:12px;padding:2px 8px;overflow-wrap:anywhere"
    return str(element("div", text, style=look, data_times=times))
