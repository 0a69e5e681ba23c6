"""Playing a trajectory or a recording: the arm moves, and the worst place is a click away."""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.errors import BumpstopError
from bumpstop.report.markup import element
from bumpstop.view.colour_scale import colours_of
from bumpstop.view.playback import Playback, playback_of

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.view.page.page import Page

_FRAME_S = 0.05


class PlaybackPanel:
    """A time slider with play, of what was opened with a motion; nothing of a straight line.

    Args:
        page: whose it is.

    Attributes:
        pose: of the arm at the time that is shown (dof,) [rad or m]; None: of the scenario.
    """

    def __init__(self, page: Page) -> None:
        self._page = page
        self.pose: FloatArray | None = None
        self._closed = threading.Event()
        self._running = threading.Event()
        self._playback: Playback | None = None
        self._thread: threading.Thread | None = None
        if page.opened.recorded is None and page.opened.scenario.motion.kind == "line":
            return
        self._build(page.client.gui)
        self._thread = threading.Thread(target=self._work, name="bumpstop-view-playback", daemon=True)
        self._thread.start()

    @property
    def alive(self) -> bool:
        """Its thread has not ended yet."""
        return self._thread is not None and self._thread.is_alive()

    def close(self) -> None:
        """Stop playing and computing."""
        self._closed.set()
        self._running.set()

    def _build(self, gui: Any) -> None:
        with gui.add_folder("Motion in time"):
            self._time = gui.add_slider("time, s", 0.0, 1.0, 0.001, 0.0, disabled=True)
            self._time.on_update(lambda _: self._show())
            buttons = gui.add_button_group("play", ("Play", "Stop", "Worst"))
            buttons.on_click(lambda event: self._press(event.target.value))
            self._says = gui.add_html("computing ...")

    def _press(self, what: str) -> None:
        if self._playback is None:
            return
        if what == "Play":
            self._running.set()
            return
        self._running.clear()
        if what == "Worst":
            self._time.value = float(self._playback.time[self._playback.worst])

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

    def _work(self) -> None:
        try:
            self._playback = playback_of(self._page.opened, self._closed.is_set, self._progress)
        except BumpstopError as error:
            self._says.content = str(element("div", str(error), style="padding:2px 8px"))
            return
        if self._playback is None:
            return
        playback = self._playback
        self._time.min, self._time.max = float(playback.time[0]), float(playback.time[-1])
        self._time.disabled = False
        self._page.client.scene.add_point_cloud(
            "/way", playback.places.astype(np.float32), colours_of(playback.shown_values), point_size=0.012
        )
        self._show()
        while not self._closed.is_set():
            self._running.wait()
            if self._closed.is_set():
                return
            t = float(self._time.value) + _FRAME_S
            if t >= playback.time[-1]:
                self._running.clear()
                t = float(playback.time[-1])
            self._time.value = t
            self._closed.wait(_FRAME_S)

    def _progress(self, share: float) -> None:
        self._says.content = str(element("div", f"computing: {100 * share:.0f} %", style="padding:2px 8px"))
