"""The page in a real browser: what is on screen is what the command says of the scenario that the page exports."""

from __future__ import annotations

import json
import re
import time
import weakref
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from browsers import CHROMIUM
from bumpstop.cli.main import main
from bumpstop.report.markup import Html
from bumpstop.view.opened import open_source
from bumpstop.view.page.result_panel import ResultPanel, details_html
from bumpstop.view.page.server import ViewServer
from view.cases import LOWER_ARM
from view.screen import WAIT_MS, Screen

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt-get install chromium")


show_tail = ResultPanel.show_tail


@pytest.fixture(scope="module")
def server() -> Iterator[ViewServer]:
    server = ViewServer(open_source(str(LOWER_ARM)))
    yield server
    server.stop()


def told(scenario: str, folder: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """What the command says of an exported scenario."""
    file = folder / "exported.toml"
    file.write_text(scenario, encoding="utf-8")
    capsys.readouterr()
    with pytest.raises(SystemExit):
        main(["evaluate", str(file), "--json"])
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found


def test_the_page_says_what_the_command_says(
    browser: Any, server: ViewServer, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    screen, other = Screen(browser, server), Screen(browser, server)
    before = other.number("peak_force_N.p99")
    changes = (("speed, mm/s", "90", "-90"), ("area, cm²", "3", "area_cm2 = 3"), ("latency, s", None, None))
    for label, typed, words in changes[:2]:
        field = screen.field(label)
        field.fill(str(typed))
        field.press("Enter")
        screen.until(str(words))
        found = told(screen.scenario(), tmp_path, capsys)
        for key in ("mean", "p50", "p99", "p999"):
            assert screen.number(f"peak_force_N.{key}") == found["peak_force_N"][key]
        assert screen.number("verdict.p_over_pressure") == found["verdict"]["p_over_pressure"]
        assert screen.page.get_attribute("[data-verdict]", "data-verdict") == found["verdict"]["conclusion"]
        assert screen.page.text_content("[data-sentence]") == found["verdict"]["reason"]
    # The other browser still sees what it had.
    assert other.number("peak_force_N.p99") == before != screen.number("peak_force_N.p99")
    # A wrong value is refused in place with the reason that the command gives, and is not used.
    text, exported = screen.field("stiffness, N/m"), screen.scenario()
    text.fill("-5")
    screen.page.wait_for_selector("[data-refusal='contact.stiffness_N_m']", timeout=WAIT_MS)
    reason = screen.page.text_content("[data-refusal]").removeprefix("✖ ")
    with pytest.raises(SystemExit):
        main(["evaluate", str(LOWER_ARM), "--set", "contact.stiffness_N_m=-5"])
    assert capsys.readouterr().err.strip() == f"error: {reason}"
    assert screen.scenario() == exported
    # Undo goes back step by step.
    screen.page.get_by_role("button", name="Undo").click()
    screen.until("area_cm2 = 2")
    # The control shows what is in use again, and no reason to refuse it.
    screen.page.wait_for_selector("[data-refusal]", state="hidden", timeout=WAIT_MS)
    assert text.input_value() == ""
    assert not screen.faults
    assert not screen.elsewhere
    # Closing the page frees its work, and what it has.
    pages = [weakref.ref(page) for page in server.pages.values()]
    assert len(pages) == 2
    screen.page.close()
    other.page.close()
    limit = time.monotonic() + 10
    while any(page() for page in pages) and time.monotonic() < limit:
        time.sleep(0.05)
    assert not any(page() for page in pages)
    assert not server.pages


def test_the_verdict_is_in_sight_in_a_narrow_window(browser: Any, server: ViewServer) -> None:
    """It was folded up below all controls."""
    page = browser.new_page(viewport={"width": 480, "height": 700})
    try:
        page.goto(server.url)
        # New figures take the place of the element while the page settles.
        page.wait_for_function(
            """() => {
              const box = document.querySelector("#root [data-verdict]")?.getBoundingClientRect();
              return box && 0 <= box.y && box.y < 100 && box.width > 400;
            }""",
            timeout=WAIT_MS,
        )
    finally:
        page.close()


def test_plots_of_the_scenario_before_are_pale(
    browser: Any, server: ViewServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Those that follow late stood below the new verdict as if they were of it."""

    def slow(*given: Any) -> Html:
        time.sleep(3.0)
        return details_html(*given)

    screen = Screen(browser, server)
    screen.page.wait_for_selector("[data-details]", timeout=WAIT_MS)
    for charts in ("[data-plots]:has([data-details])", "[data-plots]:has([data-chart=exceedance])"):
        opacity = f"getComputedStyle(document.querySelector('{charts}')).opacity"
        screen.page.wait_for_function(f"{opacity} === '1'", timeout=WAIT_MS)
        with monkeypatch.context() as late:
            late.setattr("bumpstop.view.page.page.details_html", slow)
            late.setattr(ResultPanel, "show_tail", lambda panel, answer: (time.sleep(3.0), show_tail(panel, answer)))
            screen.field("area, cm²").fill("3.5" if "details" in charts else "4.5")
            screen.page.wait_for_function(f"{opacity} === '0.45'", timeout=WAIT_MS)
            screen.page.wait_for_function(f"{opacity} === '1'", timeout=WAIT_MS)
    screen.page.close()


def test_the_text_of_the_scenario_is_copied_where_a_browser_has_no_clipboard(browser: Any, server: ViewServer) -> None:
    """Over plain http it has one on loopback alone: nothing happened."""
    gone = "Object.defineProperty(navigator, 'clipboard', {value: undefined});"
    heard = "document.addEventListener('copy', () => window.copied = String(getSelection()));"
    screen = Screen(browser, server, before=gone + heard)
    screen.page.get_by_text("Copy as TOML", exact=True).click()
    screen.page.wait_for_function("window.copied !== undefined", timeout=WAIT_MS)
    assert screen.page.evaluate("window.copied").strip() == screen.scenario().strip()
    assert not screen.faults
    screen.page.close()


def test_what_lines_of_poor_sensitivity_are_stands_beside_the_picture(browser: Any, server: ViewServer) -> None:
    """In it, it lay over the label of the undetectable forces."""
    screen = Screen(browser, server)
    says = screen.page.locator("[data-poor]")
    screen.page.get_by_text("poor sensitivity", exact=True).click()
    says.wait_for(state="visible", timeout=WAIT_MS)
    assert re.fullmatch(r"up to [0-9]+ N along a line; orange: any force", says.text_content())
    screen.page.get_by_text("poor sensitivity", exact=True).click()
    says.wait_for(state="detached", timeout=WAIT_MS)
    screen.page.close()
