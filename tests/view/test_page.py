"""What a page says and saves: what is on screen, its refusals, and what a change takes out."""

from __future__ import annotations

import threading
import time
from contextlib import nullcontext
from html import unescape
from types import SimpleNamespace
from typing import Any

import pytest

import bumpstop as bs
from bumpstop.model import Robot
from bumpstop.view.answer import Answer
from bumpstop.view.controls import NOT_GIVEN, controls_of
from bumpstop.view.document import ViewDocument, with_keys
from bumpstop.view.latest import LatestWins
from bumpstop.view.page import page as page_module
from bumpstop.view.page.control_panel import ControlPanel
from bumpstop.view.page.late_notice import LateNotice
from bumpstop.view.page.page import Page
from bumpstop.view.page.result_panel import ResultPanel
from bumpstop.view.page.tools import Tools
from view.cases import HAND, LOWER_ARM
from view.panels import Client, Place, Sent

LOWER_ARM_SCENARIO = bs.load_scenario(LOWER_ARM)


@pytest.fixture
def browserless() -> Any:
    """Makes a page on which nothing is drawn and nothing computed."""

    def made(scenario: bs.Scenario) -> Any:
        page = page_with(ViewDocument(scenario), None)
        page._last_edit, page.refresh = 0.0, lambda: None
        page._program = Sent()
        return page

    return made


def save(answer: Answer | None, what: str) -> list[tuple[Any, ...]]:
    """What the browser is sent when a button of the tools is pressed."""
    tools, client = Tools.__new__(Tools), Sent()
    page: Any = SimpleNamespace(
        client=client, settled=lambda _: None if answer is None else (ViewDocument(HAND), answer)
    )
    tools._page, page.opened = page, SimpleNamespace(title="01_hand_downward.toml")
    tools._save(what)
    return client.sent


def test_a_report_waits_for_its_verdict() -> None:
    """The figures as they are given are acceptable: without [uncertainty] that is no verdict."""
    answer = Answer.of(with_keys(HAND, {"uncertainty.contact.area_cm2": {"interval": [1.8, 2.5]}}))
    assert answer.pending
    ((told, button, words),) = save(answer, "Report")
    assert (told, button) == ("add_notification", "Report")
    assert words == "The verdict is still being computed: press again when it stands."
    (refused,) = save(answer.without_verdict("cannot be used"), "Report")
    assert refused[2] == "cannot be used"
    ((told, file, _),) = save(answer, "Scenario")
    assert (told, file) == ("send_file_download", "01_hand_downward.toml")


def page_with(document: ViewDocument, answer: Answer | None) -> Any:
    """A page on which nothing is drawn, with what it would show in ``said``."""
    page: Any = Page.__new__(Page)
    page._lock, page._serial, page._pause = threading.RLock(), 0, 0.0
    page._moved, page._typed, page._refused, page._pending = None, None, None, {}
    page._document = page._computed = document
    page._answer, page._before, page._judged = answer, None, None
    page.said = said = Sent()
    page._playback, page._tools = (
        SimpleNamespace(pose=None, follow=said.follow, expire=said.expire),
        SimpleNamespace(dragging=False),
    )
    page._scene, page._program, page._file = SimpleNamespace(show=said.scene, show_force=said.scene), said, Place("")
    page.client, page._points, page._result, page._panel = (
        Client(),
        said,
        said,
        SimpleNamespace(show=said.controls, refuse=said.refused),
    )
    page._panel.controls = {control.key: control for control in controls_of(HAND, Robot.load("sia5d"))}
    page._further = SimpleNamespace(has_newer=lambda: False, newer_within=lambda _: False, submit=said.submit)
    page._late = SimpleNamespace(begin=lambda: None, end=lambda **_: None)
    page._draw_forces = lambda _: None
    return page


def test_a_click_on_another_part_says_what_went_with_the_former(browserless: Any) -> None:
    """What was given of the former was taken for the new one; a second click on a part loses nothing."""
    page = browserless(
        with_keys(
            HAND,
            {"contact.stiffness_N_m": 5_000, "uncertainty.contact.stiffness_N_m": {"interval": [4_000, 6_000]}},
        )
    )
    page._hit("hand_finger")
    # It is hit already.
    assert page._document.scenario.contact.stiffness_N_m == 5_000
    assert page.said.sent == []
    page._hit("chest")
    assert page._document.scenario.contact.body == "chest"
    assert page._document.scenario.contact.stiffness_N_m is None
    assert page.said.sent == [
        (
            "say",
            "Taken out with this change: contact.stiffness_N_m = 5000.0, "
            "uncertainty.contact.stiffness_N_m = 4000 to 6000. Undo brings it back.",
        )
    ]
    page.undo()
    assert page._document.scenario.contact.stiffness_N_m == 5_000
    assert page.said.sent[1:] == [("say", "")]


def test_what_has_no_control_is_refused_beside_the_verdict(browserless: Any) -> None:
    """Nothing was said of a file that is gone: the page showed what it had shown before."""
    page = browserless(HAND)
    page._answer = Answer.of(HAND)
    before = page._document
    page.change({"motion.file": "gone.csv"}, "motion.file")
    with pytest.raises(bs.InputError) as by_the_command:
        bs.load_scenario(LOWER_ARM, {"motion.file": "gone.csv"})
    assert page._document is before
    assert page.said.sent[-1] == ("say", str(by_the_command.value))
    assert "motion.file" in page.said.sent[-1][1]
    # A refusal at a control stands there alone.
    page.said.sent.clear()
    page.change({"contact.area_cm2": -1.0}, "contact.area_cm2")
    assert ("refused", "contact.area_cm2") in [sent[:2] for sent in page.said.sent]
    assert page.said.sent[-1] == ("say", "")


def test_a_scenario_without_a_result_says_why() -> None:
    """The page said "computing ..." for good."""
    singular = with_keys(HAND, {"pose_deg": [0, 0, 0, 0, 0, 0, 0]})
    with pytest.raises(bs.InputError) as by_the_command:
        bs.evaluate(singular)
    page, client = page_with(ViewDocument(singular), None), Client()
    page._result = ResultPanel(client)  # type: ignore[arg-type]
    page._compute(page._document)
    box = client.places[0].content
    assert "NO VERDICT" in box
    assert str(by_the_command.value) in unescape(box)
    assert "computing" not in box


def test_what_is_said_stands_below_the_verdict_until_it_is_taken_back() -> None:
    client = Client()
    panel = ResultPanel(client)  # type: ignore[arg-type]
    panel.show(Answer.of(HAND), serial=1)
    panel.say("motion.file: is gone", refused=True)
    panel.show(Answer.of(LOWER_ARM_SCENARIO), serial=2)
    box = client.places[0].content
    assert box.index('data-serial="2"') < box.index("✖ motion.file: is gone")
    panel.say("")
    assert "motion.file" not in client.places[0].content


def test_of_two_quick_changes_the_one_that_can_be_used_stays() -> None:
    """Both were lost, and the reason for the first stood at the control of the second."""
    page = page_with(ViewDocument(HAND), Answer.of(HAND))
    page._last_edit, page.refresh = 0.0, lambda: page.said.refresh()
    upward = {"contact.normal": [0.0, 0.0, 1.0]}
    with pytest.raises(bs.InputError) as by_the_command:
        bs.evaluate(with_keys(HAND, upward))
    for first, second in (("contact.normal", "contact.area_cm2"), ("contact.area_cm2", "contact.normal")):
        page._document = page._computed = ViewDocument(HAND)
        for key in (first, second):
            page.change(upward if key == "contact.normal" else {key: 3.0}, key)
        page.said.sent.clear()
        page._compute(page._document)
        assert page._document.scenario == with_keys(HAND, {"contact.area_cm2": 3.0})
        assert page._document.undo().scenario == HAND
        told = ("say" if second == "contact.area_cm2" else "refused", str(by_the_command.value))
        assert told in [(sent[0], sent[-1]) for sent in page.said.sent]
        assert not [sent for sent in page.said.sent if sent[0] == "refused" and sent[1] == "contact.area_cm2"]
        assert page.said.sent[-1] == ("refresh",)
        page._compute(page._document)
        assert page._computed.scenario.contact.area_cm2 == 3.0
        assert page._pending == {}
        # What is refused in its field still is when the other change is computed.
        assert [sent[2] for sent in page.said.sent if sent[:2] == ("refused", "contact.normal")] == (
            [] if second == "contact.area_cm2" else [str(by_the_command.value)]
        )


def test_what_went_with_the_first_of_two_quick_clicks_is_named(browserless: Any) -> None:
    """The second took nothing out any more: the notice was gone before anybody could read it."""
    page = browserless(with_keys(HAND, {"contact.stiffness_N_m": 30_000}))
    for body in ("chest", "stomach"):
        page._hit(body)
        assert "contact.stiffness_N_m = 30000.0" in page.said.sent[-1][1]
    assert page._document.undo().scenario.contact.stiffness_N_m == 30_000
    # Nothing of an earlier step.
    page._last_edit = 0.0
    page._hit("face")
    assert page.said.sent[-1] == ("say", "")


def test_a_verdict_that_is_late_is_called_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """It stood beside the new value of a control as if it were of it, for minutes."""
    client, page, of = Client(), page_with(ViewDocument(HAND), Answer.of(HAND)), Answer.of
    page._result = ResultPanel(client)  # type: ignore[arg-type]
    page._result.show(page._answer, serial=1)
    page._last_edit, page._late = 0.0, LateNotice(page._result.wait)
    quick = page._document
    go_on = threading.Event()

    def slow(scenario: bs.Scenario) -> Answer:
        go_on.wait(20)
        return of(scenario)

    def late() -> bool:
        return "is being computed" in client.places[0].content

    page._worker = LatestWins(page._compute, "test")
    # Quick ones come and go without a word.
    for area in (2.5, 3.0, 3.5):
        page.change({"contact.area_cm2": area}, "contact.area_cm2")
        time.sleep(0.1)
    assert not late()
    assert not [sent for sent in client.places[0].sent if "is being computed" in sent]
    monkeypatch.setattr(Answer, "of", slow)
    page.change({"contact.area_cm2": 4.0}, "contact.area_cm2")
    assert not late()
    for ends, area in (("result", 5.0), ("refusal", 6.0)):
        until(late)
        # It is the first that is late, whatever is changed meanwhile.
        page.change({"contact.area_cm2": area}, "contact.area_cm2")
        assert late()
        go_on.set()
        until(lambda: not late())
        until(lambda: page._document is page._computed)
        go_on.clear()
        if ends == "result":
            monkeypatch.setattr(Answer, "of", refusing(slow))
            page.change({"contact.area_cm2": 5.5}, "contact.area_cm2")
    assert page._document.scenario.contact.area_cm2 == 5.0
    assert quick.scenario == HAND
    for part in (page._late, page._worker):
        part.close()


def until(holds: Any) -> None:
    end = time.monotonic() + 20
    while not holds() and time.monotonic() < end:
        time.sleep(0.01)
    assert holds()


def refusing(of: Any) -> Any:
    def refused(scenario: bs.Scenario) -> Answer:
        of(scenario)
        raise bs.InputError("contact", "cannot be computed")

    return refused


def test_buttons_wait_for_the_result_of_what_is_on_screen() -> None:
    """ "Report" and "Keep this" took the result before, where they were pressed right after a key."""
    page, before = page_with(ViewDocument(HAND), Answer.of(HAND)), ViewDocument(HAND)
    page._panel.moving, page.refresh = False, lambda: None
    page._document = before.edit({"contact.area_cm2": 3.0})

    def compute() -> None:
        time.sleep(0.1)
        # The key after that, of which the server has not been told yet.
        page._panel.moving = True
        page._compute(page._document)
        time.sleep(0.1)
        page._document, page._panel.moving = page._document.edit({"contact.area_cm2": 4.0}), False
        time.sleep(0.1)
        page._compute(page._document)

    computer = threading.Thread(target=compute)
    computer.start()
    document, answer = page.settled("Report")
    computer.join()
    assert document.scenario.contact.area_cm2 == answer.scenario.contact.area_cm2 == 4.0
    page.compare(keep=True)
    assert page._before is answer


def test_buttons_do_not_wait_for_ever(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(page_module, "_PATIENCE_S", 0.05)
    page = page_with(ViewDocument(HAND), Answer.of(HAND))
    page._panel.moving, page._document = False, page._document.edit({"contact.area_cm2": 3.0})
    page._before, page.client = kept, told = Answer.of(HAND), Sent()
    assert page.settled("Report") is None
    page.compare(keep=True)
    assert page._before is kept
    words = "The last change is still being computed: press again when its verdict stands."
    assert told.sent == [("add_notification", "Report", words), ("add_notification", "Keep this", words)]
    assert save(None, "Scenario") == []


def test_a_choice_that_is_gone_is_moved_by_nobody() -> None:
    """An option of the former body part: from then on its control did not follow the scenario."""
    palm = with_keys(HAND, {"contact.limits": "ts15066", "contact.pressure_area": "palm (dominant)"})
    chest = with_keys(palm, {"contact.body": "chest", "contact.pressure_area": None})

    class Choice(SimpleNamespace):
        """As one of viser: what is not among the options is the first of them."""

        def __setattr__(self, name: str, value: Any) -> None:
            super().__setattr__(name, value)
            if name == "options" and self.value not in value:
                self.value = value[0]

    class Gui:
        def __getattr__(self, _: str) -> Any:
            return lambda label, *rest, **named: SimpleNamespace(
                value=named.get("initial_value", rest[-1] if rest else 0.0), on_update=lambda _: None, min=-1e9,
                max=1e9, order=0.0,
            )  # fmt: skip

        def add_folder(self, *_: Any, **__: Any) -> Any:
            return nullcontext()

        def add_dropdown(self, label: str, options: tuple[str, ...], *, initial_value: str, **_: Any) -> Any:
            choices[label] = Choice(value=initial_value, options=options, on_update=lambda _: None, order=0.0)
            return choices[label]

    choices: dict[str, Any] = {}
    client: Any = SimpleNamespace(gui=Gui())
    panel = ControlPanel(client, palm, Robot.load("sia5d"), lambda _: None)
    assert choices["pressure area"].value == "palm (dominant)"
    panel.show(chest)
    assert choices["pressure area"].value == NOT_GIVEN
    assert not panel.moving
    panel.show(palm)
    assert choices["pressure area"].value == "palm (dominant)"


def test_an_uncertainty_that_cannot_be_used_is_refused_at_its_control() -> None:
    """Nothing says that before the verdict with an interval is computed: a clamped body has no mass."""
    page, key = page_with(ViewDocument(HAND), None), "uncertainty.contact.body_mass_kg"
    page._compute(page._document)
    before = page._document
    page._document = before.edit({key: {"distribution": "normal", "relative_sd": 0.05}})
    page._moved = key
    page._compute(page._document)
    assert page._answer.word == "COMPUTING"
    page._compute_details((page._document, page._answer))
    assert page._document is page._computed is before
    assert page._answer.word == "ACCEPTABLE"
    refused = [sent[1:] for sent in page.said.sent if sent[0] == "refused"]
    assert refused[-1][0] == key
    assert "body_mass_kg" in refused[-1][1]
    assert page.said.sent[-1] == ("submit", (before, page._answer))


def test_an_uncertainty_of_a_file_that_cannot_be_used_is_the_sentence() -> None:
    """There is nothing to go back to, and the file stays on screen to be mended."""
    document = ViewDocument(with_keys(HAND, {"uncertainty.contact.body_mass_kg": {"interval": [1.0, 2.0]}}))
    page = page_with(document, None)
    page._compute(document)
    page._compute_details((document, page._answer))
    assert page._document is document
    assert (page._answer.word, page._answer.conclusion) == ("NO VERDICT", "refused")
    assert "body_mass_kg" in page._answer.sentence


def test_the_text_of_the_scenario_comes_with_its_verdict() -> None:
    """It was copied with the verdict of another beside it, for seconds where a picture took long."""
    page = page_with(ViewDocument(HAND), None)
    page._result = SimpleNamespace(show=lambda answer, **_: shown.append((answer.scenario, page._file.content)))
    shown: list[Any] = []
    for area in (2.5, 3.0):
        page._document = page._document.edit({"contact.area_cm2": area})
        page._compute(page._document)
        assert shown[-1][0] == page._document.scenario
        assert f"area_cm2 = {area}" in shown[-1][1]
        assert page.said.sent[-2] == ("follow", page._document.scenario)
