"""Numbers typed key by key in a real browser: what stands in the field is what the scenario says."""

from __future__ import annotations

import time
from typing import Any

import pytest

from browsers import CHROMIUM
from bumpstop.view.opened import open_source
from bumpstop.view.page.page import Page
from bumpstop.view.page.server import ViewServer
from view.cases import ROOT
from view.screen import WAIT_MS, Screen

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt-get install chromium")
# Numbers that begin with one that is refused, and have more digits than a slider has steps.
TYPED = {
    "motion.speed": "51.5",
    "motion.direction": "0.333, 0.125, -0.6666",
    "motion.duration_s": "0.75625",
    "motion.damping": "0.0123",
    "contact.area_cm2": "0.525",
    "contact.point_m": "0.0055, 0.0125, -.1234",
    "contact.damping_Ns_m": "7.25",
    "contact.peak_factor": "1.25",
    "contact.offset_sd_s": "0.0512",
    "detector.noise_correlation": "0.1234",
    "detector.feedback_period_s": "0.002",
    "detector.observer_gain_1_s": "0.5",
    "detector.arming_delay_s": "0.0035",
    "reaction.latency_s": "0.0125",
    "reaction.dead_time_s": "0.0125",
}


def until_it_says(page: Page, key: str, wanted: Any) -> None:
    end = time.monotonic() + WAIT_MS / 1e3
    while page._panel.controls[key].read(page.document.scenario) != wanted and time.monotonic() < end:
        time.sleep(0.02)
    assert page._panel.controls[key].read(page.document.scenario) == wanted


@pytest.mark.parametrize("delay_ms", [30, 200])
def test_a_number_typed_by_hand_is_the_number_of_the_scenario(browser: Any, delay_ms: int) -> None:
    """ "0" is refused as an area: it was taken back while "0.5" was being typed, which became 2.5."""
    server = ViewServer(open_source(str(ROOT / "examples" / "01_hand_downward.toml")))
    screen = Screen(browser, server, (1280, 800))
    screen.wait_for_the_picture()
    try:
        page = next(iter(server.pages.values()))
        for panel in ("Detector", "Reaction"):
            screen.open_folder(panel)
        numbers = {key for key, each in page._panel.controls.items() if each.kind in ("slider", "number", "vector")}
        poses = {f"pose_deg[{j}]": f"{j}.1256" for j in range(1, 8)}
        assert numbers == TYPED.keys() | poses.keys()
        # A slow hand is a matter of the field, not of its key.
        every = 1 if delay_ms < 100 else 4
        for key, text in list((TYPED | {"pose_deg[2]": "30.1234"}).items())[::every]:
            field = screen.field(page._panel.controls[key].label)
            field.click()
            field.press("Control+A")
            screen.page.keyboard.type(text, delay=delay_ms)
            same = tuple(float(part) for part in text.split(","))
            if key == "motion.direction":
                size = sum(part**2 for part in same) ** 0.5
                same = tuple(part / size for part in same)
            until_it_says(page, key, pytest.approx(same if len(same) > 1 else same[0], rel=1e-9))
            assert field.input_value() == text
            refusal = screen.page.locator(f"[data-refusal='{key}']:visible")
            refusal.wait_for(state="detached", timeout=WAIT_MS)
        # A slider has no second field, which would round what is typed there.
        assert screen.fields("area, cm²").count() == 1
        # What cannot be used stays as it was typed, with the words of the command below it.
        field = screen.field("area, cm²")
        field.fill("2,5")
        words = "contact.area_cm2: [2.0, 5.0] cannot be used; wanted a number from 0.0001 to 10000"
        screen.page.wait_for_selector("[data-refusal='contact.area_cm2']:visible", timeout=WAIT_MS)
        assert words in screen.page.text_content("[data-refusal='contact.area_cm2']")
        assert field.input_value() == "2,5"
        assert not screen.faults
    finally:
        screen.page.close()
        server.stop()


def test_a_slider_and_its_field_follow_each_other(browser: Any) -> None:
    server = ViewServer(open_source(str(ROOT / "examples" / "01_hand_downward.toml")))
    screen = Screen(browser, server, (1280, 800))
    screen.wait_for_the_picture()
    try:
        page = next(iter(server.pages.values()))
        slider, field = page._panel._sliders["contact.area_cm2"], screen.field("area, cm²")
        thumb = screen.thumb("area, cm²")
        thumb.focus()
        thumb.press("ArrowRight")
        until_it_says(page, "contact.area_cm2", pytest.approx(2.1))
        screen.page.wait_for_function("field => field.value === '2.1'", arg=field.element_handle(), timeout=WAIT_MS)
        field.fill("31.25")
        until_it_says(page, "contact.area_cm2", 31.25)
        end = time.monotonic() + WAIT_MS / 1e3
        while slider.value != 31.25 and time.monotonic() < end:
            time.sleep(0.02)
        assert slider.value == 31.25
        assert slider.max >= 31.25
        # What a click in the picture sets, its control shows.
        page._hit("chest")
        screen.until_chosen(page._panel.controls["contact.body"], "chest")
    finally:
        screen.page.close()
        server.stop()
