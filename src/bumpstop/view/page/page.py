"""The page of one browser: its document, its panels, and the thread that computes."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError
from bumpstop.report.markup import Html, element
from bumpstop.view.answer import Answer
from bumpstop.view.document import ViewDocument
from bumpstop.view.latest import LatestWins
from bumpstop.view.page.control_panel import ControlPanel
from bumpstop.view.page.result_panel import result_html
from bumpstop.view.page.scene_view import SceneView

if TYPE_CHECKING:
    import viser

    from bumpstop.arrays import FloatArray
    from bumpstop.view.opened import Opened

# Changes of one control within this time are one step to undo.
_ONE_STEP_S = 1.0


class Page:
    """What one browser sees: nothing of it is shared with another.

    Args:
        client: the browser.
        opened: what it begins with.
    """

    def __init__(self, client: viser.ClientHandle, opened: Opened) -> None:
        self._client, self._opened = client, opened
        self._lock = threading.RLock()
        self._document = self._computed = ViewDocument(opened.scenario)
        self._answer: Answer | None = None
        self._before: Answer | None = None
        self._serial, self._last_edit = 0, 0.0
        self._moved: str | None = None
        self._scene = SceneView(client, opened, self._touched)
        with client.gui.add_folder(opened.title.rpartition("/")[2]):
            self._buttons(client.gui)
        self._panel = ControlPanel(client, opened.scenario, opened.robot, self._changed)
        with client.gui.add_folder("Scenario file", expand_by_default=False):
            self._file = client.gui.add_html("")
        client.gui.main_panel.dock_left()
        client.gui.main_panel.set_width(340)
        panel = client.gui.add_panel()
        with panel.add_tab("Result"):
            self._result = client.gui.add_html("computing ...")
        panel.dock_right()
        panel.set_width(420)
        self._worker = LatestWins(self._compute, "bumpstop-view")
        self._submit()

    @property
    def document(self) -> ViewDocument:
        """What is on screen."""
        with self._lock:
            return self._document

    def close(self) -> None:
        """Stop computing: the browser is gone."""
        self._worker.close()

    @property
    def computing(self) -> bool:
        """A thread of this page still runs."""
        return self._worker.alive

    def _buttons(self, gui: viser.GuiApi) -> None:
        steps = gui.add_button_group("steps", ("Undo", "Redo"))
        steps.on_click(lambda event: self._step(event.target.value))
        compare = gui.add_button_group("compare", ("Keep this", "Forget"))
        compare.on_click(lambda event: self._keep(event.target.value == "Keep this"))

    def _step(self, which: str) -> None:
        with self._lock:
            self._moved = None
            self._document = self._document.undo() if which == "Undo" else self._document.redo()
        self._submit()

    def _keep(self, kept: bool) -> None:
        with self._lock:
            self._before = self._answer if kept else None
        self._submit()

    def _touched(self, link: str, point: FloatArray) -> None:
        """A person clicked on the arm: contact is there."""
        rounded = [round(float(value), 4) for value in point]
        self._edit({"contact.link": link, "contact.point_m": rounded}, "contact.link")

    def _changed(self, key: str) -> None:
        """A person moved a control. What it shows now counts: calls may overtake each other."""
        with self._lock:
            control, scenario = self._panel.controls[key], self._document.scenario
            shown = self._panel.shown(key)
            if shown == control.read(scenario):
                return
            self._edit(control.write(scenario, shown), key)

    def _edit(self, changes: dict[str, Any], key: str) -> None:
        with self._lock:
            now = time.monotonic()
            same = now - self._last_edit < _ONE_STEP_S
            self._last_edit, self._moved = now, key
            try:
                self._document = self._document.edit(changes, same_step=same)
            except InputError as error:
                self._refuse(key, error)
                return
        self._submit()

    def _submit(self) -> None:
        self._worker.submit(self.document)

    def _refuse(self, key: str, error: InputError) -> None:
        """What was on screen stays; the reason stands at the control."""
        text = self._panel.controls[key].kind == "text" if key in self._panel.controls else False
        self._panel.refuse(key, str(error))
        # A text is left as it was typed, so that it can be mended.
        self._panel.show(self._document.scenario, but=key if text else None)

    def _compute(self, document: ViewDocument) -> None:
        try:
            answer = Answer.of(document.scenario)
        except InputError as error:
            with self._lock:
                if self._document is document:
                    self._document = self._computed
                    self._refuse(self._moved or "", error)
            return
        with self._lock:
            self._computed, self._answer, moved = document, answer, self._moved
            self._serial += 1
        self._draw(answer)
        if moved is not None:
            self._panel.refuse(moved, "")
        self._scene.show(document.scenario, answer)
        if not self._worker.has_newer():
            self._panel.show(document.scenario, but=moved)
            self._file.content = str(_file_html(document.text))

    def _draw(self, answer: Answer) -> None:
        self._result.content = str(result_html(answer, Html(""), serial=self._serial, before=self._before))


def _file_html(text: str) -> Html:
    copy = "navigator.clipboard.writeText(this.parentNode.querySelector('pre').textContent)"
    button = element("button", "Copy as TOML", onclick=copy, style="padding:3px 10px;margin-bottom:4px")
    look = "font-size:11px;max-height:260px;overflow:auto;background:#f6f6f6;padding:6px;user-select:all"
    return element("div", button, element("pre", text, style=look, data_scenario=""), style="padding:0 8px")
