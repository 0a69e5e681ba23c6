"""The page of one browser: its document, its panels, and the threads that compute."""

from __future__ import annotations

import threading
import time
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError
from bumpstop.report.markup import element
from bumpstop.view.answer import Answer
from bumpstop.view.document import ViewDocument, replayed, taken_out, taken_out_words
from bumpstop.view.freed_memory import trim_freed_memory
from bumpstop.view.latest import LatestWins, SupersededError
from bumpstop.view.page.control_panel import ControlPanel
from bumpstop.view.page.late_notice import LateNotice
from bumpstop.view.page.overlay import Overlay
from bumpstop.view.page.playback_panel import PlaybackPanel
from bumpstop.view.page.point_panel import PointPanel
from bumpstop.view.page.pose_keys import pose_of, pose_values
from bumpstop.view.page.program_panel import ProgramPanel
from bumpstop.view.page.result_panel import ResultPanel, details_html
from bumpstop.view.page.scene_view import Clicks, SceneView
from bumpstop.view.page.tools import Tools, file_html
from bumpstop.view.scene.reaching import reach_for

if TYPE_CHECKING:
    from collections.abc import Mapping

    import viser

    from bumpstop.arrays import FloatArray
    from bumpstop.view.controls import Shown
    from bumpstop.view.opened import Opened

# Changes of one control within this time are one step to undo.
_ONE_STEP_S = 1.0
# A browser draws the panel in a frame of its own before the picture, which takes longer.
_FRAME_S = 0.06
# A slider that rests for so long has time for further plots, or for as long as its distribution took: a number that is
# typed on the way to another may make them the work of minutes.
_PAUSE_S = 0.12
# How long a button waits for the result of what was changed before.
_PATIENCE_S = 10.0


class Page:
    """What one browser sees: nothing of it is shared with another.

    Args:
        client: the browser.
        opened: what it begins with.
        first: the result of its scenario; None where it has none.
    """

    def __init__(self, client: viser.ClientHandle, opened: Opened, first: Answer | None) -> None:
        self.client, self.opened = client, opened
        self._lock = threading.RLock()
        self._document = self._computed = ViewDocument(opened.scenario)
        self._answer = first
        self._before: Answer | None = None
        # The newest that has its verdict.
        self._judged: tuple[ViewDocument, Answer] | None = None
        self._serial, self._last_edit, self._pause = 0, 0.0, _PAUSE_S
        # The control of the last change, the one whose field a person is in, and the one that says a refusal of it.
        self._moved: str | None = None
        self._typed: str | None = None
        self._refused: str | None = None
        # The newest changes of what has a result, in their order, by their keys: what they change, and their controls.
        self._pending: dict[frozenset[str], tuple[Mapping[str, Any], str]] = {}
        self._result = ResultPanel(client)
        self._late = LateNotice(self._result.wait)
        if first is not None:
            self._result.show_first(first)
        self._worker: LatestWins[ViewDocument] = LatestWins(self._compute, "bumpstop-view")
        self._further = LatestWins(self._compute_details, "bumpstop-view-details")
        self._hand = LatestWins(self._reach, "bumpstop-view-hand")
        self._scene = SceneView(client, opened, Clicks(self._touched, self._hit, self._hand.submit))
        if opened.scenario.motion.kind == "line":
            # Where there is no result, the arm is drawn all the same.
            self._scene.pose(pose_of(opened, opened.scenario))
        self._overlay = Overlay(client, opened.robot, opened.shapes)
        self._tools = Tools(self)
        self._program = ProgramPanel(self)
        self._playback = PlaybackPanel(self)
        self._points = PointPanel(self)
        self._panel = ControlPanel(client, opened.scenario, opened.robot, self._changed)
        with client.gui.add_folder("Scenario file", expand_by_default=False):
            self._file = client.gui.add_html(str(file_html(self._document.text)))
        client.gui.main_panel.dock_left()
        client.gui.main_panel.set_width(340)
        self.refresh()

    @property
    def document(self) -> ViewDocument:
        """What is on screen."""
        with self._lock:
            return self._document

    @property
    def answer(self) -> Answer | None:
        """The newest result; None before the first."""
        with self._lock:
            return self._answer

    @property
    def scene(self) -> SceneView:
        """The three-dimensional picture."""
        return self._scene

    def close(self) -> None:
        """Stop computing: the browser is gone."""
        for part in self._threads:
            part.close()
        with self._lock:
            # Results may have hundreds of megabytes, and what is left of a browser goes when Python looks for circles.
            self._answer = self._before = self._judged = None

    def wait(self, seconds: float) -> None:
        """Wait until nothing of a closed page is computed any more, but not longer."""
        end = time.monotonic() + seconds
        while self.computing and time.monotonic() < end:
            time.sleep(0.01)

    @property
    def computing(self) -> bool:
        """A thread of this page still runs."""
        return any(each.alive for each in self._threads)

    @property
    def _threads(self) -> tuple[Any, ...]:
        return self._worker, self._further, self._hand, self._late, self._result, self._playback, self._points

    def refresh(self) -> None:
        """Compute and draw what is on screen."""
        # Nobody waits for more about the scenario before, which may take many times the work and the memory.
        self._further.submit(None)
        self._late.begin()
        self._worker.submit(self.document)

    def undo(self, *, again: bool = False) -> None:
        """One step back, or ``again`` forward."""
        with self._lock:
            self._moved, self._typed, self._pending = None, None, {}
            self._document = self._document.redo() if again else self._document.undo()
            self._result.say("")
        self.refresh()

    def compare(self, *, keep: bool) -> None:
        """Keep what is on screen to compare with, or forget it."""
        settled = self.settled("Keep this") if keep else (self.document, None)
        if settled is None:
            return
        with self._lock:
            self._before = settled[1]
        self.refresh()

    def settled(self, button: str) -> tuple[ViewDocument, Answer | None] | None:
        """Wait until what a person has changed is computed; what then is on screen, and its result where it has one.

        None: that takes longer than somebody waits who has pressed a button, and a note says so.

        Args:
            button: that was pressed.
        """
        end = time.monotonic() + _PATIENCE_S
        while time.monotonic() < end:
            with self._lock:
                if self._document is self._computed and not self._panel.moving:
                    return self._document, self._answer
            time.sleep(0.01)
        none = "The last change is still being computed: press again when its verdict stands."
        self.client.add_notification(button, none, color="red")
        return None

    def change(self, changes: Mapping[str, Any], key: str) -> None:
        """Change keys of the scenario on screen.

        Args:
            changes: dotted keys and new values; None takes a key out.
            key: of the control at which a refusal is told.
        """
        with self._lock:
            self._typed = None
            self._change(changes, key)

    def _change(self, changes: Mapping[str, Any], key: str) -> None:
        with self._lock:
            now = time.monotonic()
            same = now - self._last_edit < _ONE_STEP_S
            self._last_edit, self._moved, self._refused = now, key, None
            before = self._document.scenario
            try:
                self._document = self._document.edit(changes, same_step=same)
            except InputError as error:
                self._refuse(key, error)
                return
            self._pending.pop(frozenset(changes), None)
            self._pending[frozenset(changes)] = changes, key
            # Of all changes that are one step, the first took it out.
            before = before if self._document.scenario == before else self._document.past[-1]
            gone = {name: value for name, value in taken_out(before, changes).items() if name != key}
            self._result.say(taken_out_words(gone) if gone else "")
        self.refresh()

    def set_pose(self, q: FloatArray, velocity: FloatArray | None = None, *, dragged: bool = False) -> None:
        """Put the arm into a pose (dof,) [rad or m], by eye or not, and give its tip a velocity (3,) [m/s]."""
        scenario = self.document.scenario
        key, values = pose_values(self.opened, scenario, q, dragged=dragged)
        changes: dict[str, Any] = {key: values}
        if velocity is not None:
            changes["motion.velocity_mm_s"] = [float(f"{1e3 * v:.12g}") for v in velocity]
        self.change(changes, f"{key}[1]")

    def _touched(self, link: str, point: FloatArray) -> None:
        self.change({"contact.link": link, "contact.point_m": [round(float(x), 4) for x in point]}, "contact.link")

    def _hit(self, body: str) -> None:
        self._typed = None
        self._set("contact.body", body)

    def _reach(self, X: FloatArray) -> None:
        scenario = self.document.scenario
        if scenario.motion.kind == "line":
            self.set_pose(reach_for(self.opened.robot, pose_of(self.opened, scenario), X), dragged=True)

    def _changed(self, key: str) -> None:
        """A person moved a control. What it shows now counts: calls may overtake each other."""
        with self._lock:
            self._typed = key
            self._set(key, self._panel.shown(key))

    def _set(self, key: str, shown: Shown) -> None:
        """Have the scenario say what a control shows, or would show."""
        with self._lock:
            control, scenario = self._panel.controls[key], self._document.scenario
            if shown == control.text(scenario):
                if key == self._moved:
                    self._panel.refuse(key, "")
                return
            self._moved = key
            try:
                changes = control.write(scenario, shown)
            except InputError as error:
                self._refuse(key, error)
                return
            self._change(changes, key)

    def _refuse(self, key: str, error: InputError) -> None:
        """What was on screen stays; the reason stands at the control, or beside the verdict where there is none."""
        self._refused, control = key, self._panel.controls.get(key)
        # What is typed is left as it was, so that it can be mended, or is on the way to a number that can be used.
        typed = control is not None and control.kind != "choice" and key == self._typed
        self._panel.show(self._document.scenario, but=key if typed else None)
        self._program.follow(self._document.scenario)
        if control is not None:
            self._panel.refuse(key, str(error))
        if self._answer is None:
            self._result.show_none(str(error), serial=self._serial)
        elif control is None:
            self._result.say(str(error), refused=True)
        else:
            self._result.say("")

    def _compute(self, document: ViewDocument) -> None:
        begin = time.monotonic()
        try:
            answer = Answer.of(document.scenario)
        except InputError as error:
            self._take_back(document, error)
            return
        with self._lock:
            self._computed, self._answer, moved = document, answer, self._moved
            if self._document is document:
                self._pending = {}
            if not answer.pending:
                self._judged = document, answer
            self._pause = max(_PAUSE_S, time.monotonic() - begin)
            self._serial += 1
            more = self._document is not document
        with self.client.atomic():
            self._late.end(more=more)
            self._draw(answer, document)
        # At once, and not after the pause: what is of another scenario stands beside this verdict.
        self._playback.expire(document.scenario)
        self._program.follow(document.scenario)
        self._points.follow(document.scenario)
        if moved is not None and moved != self._refused:
            self._panel.refuse(moved, "")
        self._further.submit((document, answer))

    def _take_back(self, document: ViewDocument, error: InputError) -> None:
        """Go back to what has a result, with those changes since then that can be used, and say why others cannot."""
        with self._lock:
            computed, pending, moved = self._computed, [*self._pending.values()], self._moved or ""
        alone = len(pending) < 2 or self.document is not document
        kept, refused = (computed, {moved: error}) if alone else replayed(computed, pending, Answer.of)
        with self._lock:
            if self._document is not document:
                return
            self._document, self._pending = kept, {}
            if moved in refused:
                self._refuse(moved, refused.pop(moved))
            if refused:
                # Their controls show what is used instead.
                self._panel.show(kept.scenario, but=self._typed)
                self._result.say("; ".join(str(why) for why in refused.values()), refused=True)
            self._late.end(more=kept is not computed)
            if kept is not computed:
                self.refresh()
            elif self._answer is not None:
                self._further.submit((computed, self._answer))

    def _compute_details(self, answered: tuple[ViewDocument, Answer] | None) -> None:
        """What comes after the distribution, and nothing for None."""
        if answered is None:
            return
        try:
            self._show_further(*answered)
        finally:
            trim_freed_memory()

    def _show_further(self, document: ViewDocument, answer: Answer) -> None:
        """Show the picture, then further plots, and how sure an uncertain verdict is."""
        time.sleep(_FRAME_S)
        q = answer.result.problem.q if self._playback.pose is None else self._playback.pose
        self._scene.show(document.scenario, q, answer, hand=not self._tools.dragging)
        if self._further.has_newer():
            return
        # Before the pause: viser draws a picture over and over for 0.25 s, in which the next key would have to wait.
        self._scene.show_force(answer)
        if self._further.newer_within(self._pause):
            return
        self._playback.follow(document.scenario)
        with self._lock:
            # A control that shows what was on screen before would put it there again.
            if self._document is not document:
                return
            self._panel.show(document.scenario, but=self._typed)
        self._draw_forces(answer)
        self._result.show_tail(answer)
        try:
            if answer.pending:
                answer = Answer.of_uncertain(document.scenario, self._further.has_newer)
        except SupersededError:
            return
        except InputError as error:
            if self._took_back(document, error):
                return
            answer = answer.without_verdict(str(error))
        try:
            answer = answer.with_warnings()
            details = details_html(answer, self._further.has_newer)
        except SupersededError:
            return
        except InputError as error:
            details = element("div", f"No further plots: {error}")
        with self._lock:
            if self._computed is not document:
                return
            self._answer = answer
            if not answer.refusal:
                self._judged = document, answer
            self._serial += 1
        self._draw(answer, document)
        self._result.show_details(details, answer)

    def _took_back(self, document: ViewDocument, error: InputError) -> bool:
        """Go back to what had a verdict and refuse what was changed; False where there is neither."""
        with self._lock:
            if self._document is not document:
                return True
            moved = self._moved
            if self._judged is None or moved is None:
                return False
            judged = document, answer = self._judged
            self._document, self._computed, self._answer = document, document, answer
            self._serial += 1
            self._refuse(moved, error)
        self._draw(answer, document)
        self._further.submit(judged)
        return True

    def _draw_forces(self, answer: Answer) -> None:
        """Forces that no threshold detects: at the contact point, and all over the arm; and the result kept before."""
        self._overlay.show_forces(answer, self._scene, self._tools)
        with self._lock:
            before = self._before
        self._overlay.show_before(before)

    def _draw(self, answer: Answer, document: ViewDocument) -> None:
        """Show a result and the text of its scenario at once: whoever copies the text has what the verdict is of."""
        text = str(file_html(document.text))
        with self.client.atomic():
            if self._file.content != text:
                self._file.content = text
            self._result.show(answer, serial=self._serial, before=self._before)
        # What stands together is sent when it is whole.
        self.client.flush()
