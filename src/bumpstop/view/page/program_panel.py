"""The segments of a program on a page: the one that is chosen is the motion on screen."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from bumpstop.errors import BumpstopError
from bumpstop.report.markup import element
from bumpstop.view.document import with_keys

if TYPE_CHECKING:
    from bumpstop.collision import Scenario
    from bumpstop.view.page.panel_host import PanelHost


class ProgramPanel:
    """A list of segments, of what was opened with a program; else nothing.

    Args:
        page: whose it is.
    """

    def __init__(self, page: PanelHost) -> None:
        self._page, self._program = page, page.opened.program
        if self._program is None:
            return
        gui = page.client.gui
        with gui.add_folder("Program"):
            start = self._name(page.opened.scenario)
            self._segment: Any = gui.add_dropdown("segment", self._program.names, initial_value=start)
            self._segment.on_update(lambda event: self._choose(event.target.value) if event.client else None)
            seek = gui.add_button(
                "Seek hardest contact", hint="of the segment, with the detector and the body on screen"
            )
            seek.on_click(lambda _: self._choose(self._segment.value))
            self._says = gui.add_html("")
        # Those in which contact is where it is hardest.
        self._sought = [page.opened.scenario]
        # The segment on screen; what is slowed down is of the one before.
        self._shown = start
        self._seeking: object | None = None

    def follow(self, scenario: Scenario) -> None:
        """Have the list show the segment that a scenario moves; what was slowed down is of the one chosen last."""
        # A segment that is being sought has been chosen, and is not on screen yet.
        if self._program is not None and self._seeking is None:
            name = self._name(scenario)
            self._shown = name or self._shown
            if self._segment.value != self._shown:
                self._segment.value = self._shown
            if scenario in self._sought:
                self._say("")
            elif name is None:
                self._say("Contact is where it was hardest before the segment was slowed down.")
            else:
                self._say(
                    "Contact is where it was hardest before the last changes; it may be harder elsewhere now. "
                    '"Seek hardest contact" puts it there.'
                )

    def _name(self, scenario: Scenario) -> str | None:
        assert self._program is not None
        files = [str(self._program.file(number)) for number in range(len(self._program.names))]
        return self._program.names[files.index(scenario.motion.file)] if scenario.motion.file in files else None

    def _choose(self, name: str) -> None:
        assert self._program is not None
        seeking = self._seeking = object()
        self._say("seeking the hardest contact ...")
        scenario, refusal = self._page.document.scenario, ""
        try:
            changes = self._program.changes(self._program.names.index(name), scenario)
            sought = with_keys(scenario, changes)
        except BumpstopError as error:
            refusal = str(error)
        finally:
            newest = self._seeking is seeking
            self._seeking = None if newest else self._seeking
        if not newest:
            return
        if refusal:
            self.follow(self._page.document.scenario)
            self._say(refusal)
            return
        # What has been changed meanwhile is not what contact was sought with.
        self._sought.append(sought)
        self._page.change(changes, "motion.file")

    def _say(self, text: str) -> None:
        self._says.content = str(element("div", text, style="font-size:12px;padding:2px 8px"))
