"""What a change sends to the page: the pieces that differ, and the picture only where a person would see it."""

from __future__ import annotations

import re
import threading
from contextlib import nullcontext
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.model import Robot
from bumpstop.report.markup import Html
from bumpstop.view.answer import Answer
from bumpstop.view.document import ViewDocument, with_keys
from bumpstop.view.page.control_panel import ControlPanel
from bumpstop.view.page.page import Page
from bumpstop.view.page.result_panel import ResultPanel
from bumpstop.view.page.scene_view import SceneView
from bumpstop.view.plots.distribution import exceedance_plot
from view.cases import HAND, LOWER_ARM
from view.panels import Client, Place, Sent

LOWER_ARM_SCENARIO = bs.load_scenario(LOWER_ARM)


def test_a_change_sends_the_pieces_that_differ() -> None:
    client = Client()
    panel = ResultPanel(client)  # type: ignore[arg-type]
    answer = Answer.of(HAND)
    panel.show(answer, serial=1)
    panel.show_tail(answer)
    panel.show_details(Html("plots"), answer)
    verdict, figures, tail, further = client.places
    assert [len(place.sent) for place in client.places] == [1, 1, 1, 1]
    assert client.flushed == 1
    # Warnings change the verdict's box, and nothing of the distribution.
    panel.show(answer.with_warnings(), serial=2)
    assert [len(place.sent) for place in client.places] == [2, 1, 1, 1]
    other = Answer.of(with_keys(HAND, {"contact.area_cm2": 3.0}))
    panel.show(other, serial=3)
    panel.show_tail(other)
    panel.show_details(Html("plots"), other)
    assert [len(place.sent) for place in client.places] == [3, 2, 2, 2]
    # What a slider waits for is small.
    assert len(verdict.content) + len(figures.content) < 16_000
    assert tail.content
    assert further.content


@pytest.mark.parametrize(("speed", "sent"), [(50.4, 0), (90.0, 1)])
def test_an_arrow_is_drawn_anew_where_it_is_seen_to_move(speed: float, sent: int) -> None:
    scenario = with_keys(HAND, {"motion.velocity_mm_s": [0, 0, -50.0]})
    view = SceneView.__new__(SceneView)
    arrow = Place("")
    arrow.__dict__["points"] = np.zeros((1, 2, 3))
    view._arrows = {"/force": arrow}
    view._touch = np.array([0, 0, 0, 0, 0, -1, 0, 0, -1, 0.03], dtype=float)
    view.show_force(Answer.of(scenario))
    assert len(arrow.sent) == 1
    view.show_force(Answer.of(with_keys(scenario, {"motion.velocity_mm_s": [0, 0, -speed]})))
    assert len(arrow.sent) - 1 == sent


def test_a_verdict_is_the_same_in_pieces() -> None:
    client = Client()
    ResultPanel(client).show(Answer.of(HAND), serial=7)  # type: ignore[arg-type]
    assert 'data-serial="7"' in client.places[0].content
    reason = bs.evaluate(HAND).verdict.reason
    assert reason in client.places[0].content.replace("&lt;", "<")
    assert 'data-chart="distribution"' in client.places[1].content


def test_a_line_on_warnings_stands_before_and_after_they_are_known() -> None:
    """Nothing below the verdict moves, and is drawn anew for that, when there are none."""
    client = Client()
    panel = ResultPanel(client)  # type: ignore[arg-type]
    answer = Answer.of(LOWER_ARM_SCENARIO)
    assert not answer.result.warnings
    lines = []
    for each in (answer, answer.with_warnings()):
        panel.show(each, serial=1)
        lines.append(client.places[0].content.count("<div"))
    assert "No warnings." in client.places[0].content
    assert lines[0] == lines[1]


def test_all_plots_of_an_uncertain_scenario_are_of_its_central_case() -> None:
    """The risk of higher peaks stayed that of the figures as they are given, with which the page began."""
    client = Client()
    panel = ResultPanel(client)  # type: ignore[arg-type]
    key = "uncertainty.detector.threshold_scale"
    scenario = with_keys(HAND, {key: {"distribution": "triangular", "low": 0.9, "mode": 1.0, "high": 3.0}})
    given, central = Answer.of(scenario), Answer.of_uncertain(scenario, lambda: False)
    panel.show_tail(given)
    panel.show(central.with_warnings(), serial=1)
    panel.show_details(Html("plots"), central)
    assert exceedance_plot(given) != exceedance_plot(central)
    assert exceedance_plot(central) in client.places[2].content
    marks = [re.findall('data-plots="([^"]+)"', place.content) for place in client.places]
    assert marks[2] == marks[3] != []


@pytest.mark.parametrize("newer", [False, True])
def test_the_plot_is_sent_first_and_the_force_in_the_picture_where_no_key_follows(newer: bool) -> None:
    done: list[str] = []

    class Recorder:
        def __getattr__(self, name: str) -> Any:
            return lambda *_, **__: done.append(name)

    class Further(Recorder):
        def has_newer(self) -> bool:
            return newer

        def newer_within(self, _: float) -> bool:
            done.append("pause")
            return True

    page: Any = Page.__new__(Page)
    document = page._document = ViewDocument(HAND)
    page._lock, page._serial, page._moved, page._refused = threading.RLock(), 0, None, None
    page._before = page._answer = page._judged = None
    page._result, page._scene, page._further = Recorder(), Recorder(), Further()
    page._file, page.client = Place(""), Client()
    page._program = page._points = page._late = Sent()
    page._playback, page._tools = SimpleNamespace(pose=None, expire=lambda _: None), SimpleNamespace(dragging=False)
    page._compute(document)
    assert done == ["show", "submit"]
    page._compute_details((document, page._answer))
    assert done[2:] == (["show"] if newer else ["show", "show_force", "pause"])


def test_what_a_person_moves_meanwhile_is_not_written_over() -> None:
    """Neither before the call that tells of it has come, nor after, when another scenario is on screen."""

    class Gui:
        def __getattr__(self, _: str) -> Any:
            return lambda label, *args, **named: Input(label, *args, **named)

        def add_folder(self, *_: Any, **__: Any) -> Any:
            return nullcontext()

    class Input(SimpleNamespace):
        def __init__(self, label: str, *args: Any, **named: Any) -> None:
            number = named.get("initial_value", args[-1] if args else 0.0)
            super().__init__(label=label, value=number, min=-1e9, max=1e9, options=(), order=0.0)
            inputs[label or f"slider of {list(inputs)[-1]}"] = self

        def on_update(self, told: Any) -> None:
            self.told = told

    inputs: dict[str, Any] = {}
    changed: list[object] = []
    client: Any = SimpleNamespace(gui=Gui())
    panel = ControlPanel(
        client, LOWER_ARM_SCENARIO, Robot.load("sia5d"), lambda key: changed.append((key, panel.shown(key)))
    )
    field, slider = inputs["joint 2, °"], inputs["slider of joint 2, °"]
    other = with_keys(LOWER_ARM_SCENARIO, {"contact.area_cm2": 3.0})
    slider.value = 42.0
    panel.show(other)
    assert (slider.value, field.value, inputs["area, cm²"].value) == (42.0, "30", "3")
    assert panel.moving
    slider.told(None)
    assert changed == [("pose_deg[2]", "42")]
    assert field.value == "42"
    assert not panel.moving
    panel.show(other)
    assert (slider.value, field.value, len(changed)) == (30.0, "30", 1)
    field.value = "0."
    panel.show(other)
    assert (slider.value, field.value, panel.moving) == (30.0, "0.", True)
    page: Any = Page.__new__(Page)
    answer = Answer.of(HAND)
    page._lock, page._moved, page._typed, page._pause = threading.RLock(), None, None, 0.0
    page._document, shown = ViewDocument(LOWER_ARM_SCENARIO), ViewDocument(HAND)
    nothing: Any = SimpleNamespace(show=lambda *_, **__: None, show_force=lambda _: None, follow=lambda _: None)
    page._scene = page._program = page._playback = page._points = nothing
    nothing.pose, page._tools = None, SimpleNamespace(dragging=False)
    page._further = SimpleNamespace(has_newer=lambda: False, newer_within=lambda _: False)
    page._panel = SimpleNamespace(show=lambda *_, **__: pytest.fail("an old scenario was shown"))
    page._compute_details((shown, answer))


def test_what_is_refused_has_the_plots_of_what_stays_on_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    """Work on them was given up when the other scenario was asked for."""

    def refuse(_: Any) -> Answer:
        raise bs.InputError("speed", "is too high")

    submitted: list[Any] = []
    page: Any = Page.__new__(Page)
    page._lock, page._moved, answer = threading.RLock(), "motion.speed", Answer.of(HAND)
    page._computed, page._document, page._answer = ViewDocument(HAND), ViewDocument(LOWER_ARM_SCENARIO), answer
    page._pending = {}
    page._worker = page._further = SimpleNamespace(submit=submitted.append)
    page._late = SimpleNamespace(begin=lambda: None, end=lambda **_: None)
    page._refuse = lambda key, error: submitted.append((key, str(error)))
    page.refresh()
    refused = page._document
    assert submitted == [None, refused]
    monkeypatch.setattr(Answer, "of", refuse)
    page._compute(refused)
    assert page._document is page._computed
    assert submitted[2][0] == "motion.speed"
    assert submitted[3:] == [(page._computed, answer)]
