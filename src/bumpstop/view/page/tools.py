"""The tools of a page: undo, comparison, files, and what the picture shows besides the arm."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.errors import BumpstopError
from bumpstop.report.markup import Html, element

if TYPE_CHECKING:
    from bumpstop.view.answer import Answer
    from bumpstop.view.page.panel_host import PanelHost


class Tools:
    """Buttons and switches above the controls.

    Args:
        page: whose they are.
    """

    def __init__(self, page: PanelHost) -> None:
        self._page = page
        self.dragging = False
        gui = page.client.gui
        with gui.add_folder(page.opened.title.rpartition("/")[2]):
            steps = gui.add_button_group("steps", ("Undo", "Redo"))
            steps.on_click(lambda event: page.undo(again=event.target.value == "Redo"))
            compare = gui.add_button_group("compare", ("Keep this", "Forget"))
            compare.on_click(lambda event: page.compare(keep=event.target.value == "Keep this"))
            files = gui.add_button_group("save", ("Scenario", "Picture", "Report"))
            files.on_click(lambda event: self._save(event.target.value))
            hand = gui.add_checkbox("drag the hand", False)
            hand.on_update(lambda event: page.scene.show_hand(event.target.value))
            self._polytope = gui.add_checkbox(
                "undetectable forces", False, hint="forces at the contact point that no threshold detects, 1 m: 1000 N"
            )
            self._polytope.on_update(lambda _: page.refresh())
            self._poor = gui.add_checkbox(
                "poor sensitivity", False,
                hint="lines along the forces that no threshold detects, on every link, 1 m: 1000 N; orange: any force",
            )  # fmt: skip
            self._poor.on_update(lambda _: page.refresh())
            self._poor_says = gui.add_html("", visible=False)
            for note in page.opened.notes:
                gui.add_html(str(element("div", note, style="font-size:11px;padding:1px 10px", data_note="")))

    @property
    def polytope(self) -> bool:
        """The forces that no threshold detects are to be drawn."""
        return bool(self._polytope.value)

    @property
    def poor(self) -> bool:
        """The directions of poor sensitivity are to be drawn."""
        return bool(self._poor.value)

    def say_of_poor(self, text: str) -> None:
        """Say what the lines of poor sensitivity are; empty: there are none."""
        self._poor_says.content = str(element("div", text, style="font-size:11px;padding:1px 10px", data_poor=""))
        self._poor_says.visible = bool(text)

    def _save(self, what: str) -> None:
        """Hand a file to the browser."""
        page, settled = self._page, self._page.settled(what)
        if settled is None:
            return
        document, answer = settled
        if none := _why_not(what, answer):
            page.client.add_notification(what, none, color="red")
            return
        name = Path(page.opened.title).stem
        try:
            if what == "Scenario":
                ending, content = "toml", document.text.encode("utf-8")
            else:
                assert answer is not None
                from bumpstop.view.page.drawn_file import drawn_file

                ending = "png" if what == "Picture" else "html"
                content = drawn_file(what, document.scenario, answer)
            page.client.send_file_download(f"{name}.{ending}", content, save_immediately=True)
        except BumpstopError as error:
            page.client.add_notification(what, str(error), color="red")


def _why_not(what: str, answer: Answer | None) -> str:
    """Why a file cannot be saved; empty where it can."""
    if what == "Scenario":
        return ""
    if answer is None:
        return "The scenario has no result."
    if what == "Picture":
        return ""
    # A report has a verdict, and that of the figures as they are given would be taken for it.
    return "The verdict is still being computed: press again when it stands." if answer.pending else answer.refusal


def file_html(text: str) -> Html:
    """The text of a scenario, and a button that copies it."""
    # Over plain http a browser has a clipboard on loopback alone. Elsewhere the text is selected, and copied if it may.
    copy = (
        "const text=this.parentNode.querySelector('pre');"
        "const select=()=>{getSelection().selectAllChildren(text);document.execCommand('copy')};"
        "navigator.clipboard?navigator.clipboard.writeText(text.textContent).catch(select):select()"
    )
    button = element("button", "Copy as TOML", onclick=copy, style="padding:3px 10px;margin-bottom:4px")
    look = "font-size:11px;max-height:260px;overflow:auto;background:#f6f6f6;padding:6px;user-select:all"
    return element("div", button, element("pre", text, style=look, data_scenario=""), style="padding:0 8px")
