"""The page in a real browser, opened from the disk: what is on screen is what the command says of the text in it."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from web.exports import ROOT

import bumpstop as bs
from browsers import CHROMIUM
from web.node import MISSING, WHY_NOT

WAIT_MS = 60_000
pytestmark = [
    pytest.mark.skipif(MISSING, reason=WHY_NOT),
    pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt-get install chromium"),
]


def open_page(browser: Any, script: Path, folder: Path) -> Any:
    style = (ROOT / "web" / "page.css").read_text(encoding="utf-8")
    text = f'<!doctype html><meta charset="utf-8"><style>{style}</style><div id="bumpstop"></div>'
    file = folder / "page.html"
    file.write_text(f'{text}<script src="{script.as_uri()}"></script>', encoding="utf-8")
    opened = browser.new_page(viewport={"width": 1280, "height": 800})
    opened.faults = []
    opened.on("console", lambda message: opened.faults.append(message.text) if message.type == "error" else None)
    opened.on("pageerror", lambda error: opened.faults.append(str(error)))
    opened.on("request", lambda request: opened.faults.append(request.url) if "://" in request.url[:9] else None)
    opened.faults.clear()
    opened.goto(file.as_uri())
    return opened


@pytest.fixture(scope="module")
def page(page_script: Path, tmp_path_factory: pytest.TempPathFactory, browser: Any) -> Iterator[Any]:
    opened = open_page(browser, page_script, tmp_path_factory.mktemp("page"))
    yield opened
    assert [fault for fault in opened.faults if not fault.startswith(("file:", "blob:"))] == []
    opened.close()


def settled(page: Any) -> None:
    """Wait until the text on screen is answered, the warning about steps included."""
    page.wait_for_selector("#bumpstop[data-state=done]", timeout=WAIT_MS)


def compare_with_command(page: Any) -> dict[str, Any]:
    text = page.input_value("#bumpstop textarea")
    wanted: dict[str, Any] = bs.evaluate(bs.Scenario.from_dict(tomllib.loads(text))).to_json()
    shown = page.eval_on_selector_all("[data-number]", "all => all.map(one => [one.dataset.number, one.dataset.value])")
    assert len(shown) == 30
    for name, value in shown:
        here: Any = wanted
        for key in name.split("."):
            here = here[key]
        assert value == "null" if here is None else float(value) == pytest.approx(here, rel=1e-9, abs=0), name
    verdict = wanted["verdict"]
    assert page.get_attribute("#bumpstop .verdict", "data-verdict") == verdict["conclusion"]
    assert verdict["reason"] in page.text_content("#bumpstop .verdict")
    assert page.eval_on_selector_all(".warnings li", "all => all.map(one => one.textContent)") == verdict["warnings"]
    return wanted


def test_the_page_says_what_the_command_says_of_its_text(page: Any) -> None:
    settled(page)
    assert compare_with_command(page)["verdict"]["conclusion"] == "acceptable"
    page.select_option("#bumpstop select", label="02_lower_arm_downward.toml")
    settled(page)
    assert compare_with_command(page)["verdict"]["conclusion"] == "not_acceptable"
    text = page.input_value("#bumpstop textarea")
    changed = text.replace("velocity_mm_s = [0, 0, -75]", "speed_mm_s = 60\ndirection = [0, 0.1, -1]").replace(
        "= 2.0", "= 3.0"
    )
    assert changed != text
    page.fill("#bumpstop textarea", changed)
    settled(page)
    compare_with_command(page)
    page.fill("#bumpstop textarea", changed + "\n[simulation]\nstep_s = 0.004\nsubsteps = 1\n")
    settled(page)
    compare_with_command(page)
    page.select_option("#bumpstop select", label="05_ur10e.toml")
    settled(page)
    compare_with_command(page)
    assert page.locator("#bumpstop svg .curve").get_attribute("points").count(",") > 100


def test_a_wrong_value_leaves_no_verdict(page: Any) -> None:
    page.select_option("#bumpstop select", label="01_hand_downward.toml")
    settled(page)
    text = page.input_value("#bumpstop textarea")
    for before, after, words in (
        (
            "area_cm2 = 2.0",
            "area_cm2 = -2.0",
            "contact.area_cm2: -2 cannot be used; wanted a number from 0.0001 to 10000",
        ),
        ("held_joints", "held_joint", "motion.held_joint: is not a key of a scenario"),
        (
            "[contact]",
            '[arm]\nmodel = "elastic"\n[contact]',
            "arm.model: this page does not compute arms that give way",
        ),
        ("[contact]", "[contact", "line 9: a table's name ends with ]"),
    ):
        page.fill("#bumpstop textarea", text.replace(before, after))
        settled(page)
        assert page.get_attribute("#bumpstop .verdict", "data-verdict") == "refused"
        assert words in page.text_content("#bumpstop .verdict")
        assert page.locator("[data-number]").count() == 0


def test_what_is_typed_while_it_computes_ends_the_work(page: Any) -> None:
    text = (ROOT / "examples" / "04_hand_lateral.toml").read_text(encoding="utf-8")
    # Small tails of correlated noise take many seconds.
    page.fill("#bumpstop textarea", text.replace("= 0.004", "= 0.002\nnoise_correlation = 0.5"))
    page.wait_for_timeout(500)
    assert page.get_attribute("#bumpstop .verdict", "data-verdict") == "computing"
    assert "ACCEPTABLE" not in page.text_content("#bumpstop .verdict")
    page.select_option("#bumpstop select", label="05_ur10e.toml")
    settled(page)
    compare_with_command(page)


def test_a_core_that_fails_leaves_no_verdict_and_computes_again(page: Any) -> None:
    # Deeper than the reader can follow: not a refusal, but a failure of the worker.
    page.fill("#bumpstop textarea", "robot = " + "[" * 200_000)
    settled(page)
    assert page.get_attribute("#bumpstop .verdict", "data-verdict") == "refused"
    assert "The computation failed" in page.text_content("#bumpstop .verdict")
    # What is still being computed of the text before must not answer for this one.
    page.evaluate("""() => {
      const text = document.querySelector("#bumpstop textarea");
      for (const value of ["robot = 1", "#".repeat(1000001)]) {
        text.value = value;
        text.dispatchEvent(new Event("input"));
      }
    }""")
    page.wait_for_timeout(500)
    assert "more than 1000000 letters" in page.text_content("#bumpstop .verdict")
    page.select_option("#bumpstop select", label="01_hand_downward.toml")
    settled(page)
    compare_with_command(page)


def test_a_verdict_outlives_the_check_for_coarse_steps(browser: Any, page_script: Path, tmp_path: Path) -> None:
    """Finer steps take more memory than a browser may have: the page said that nothing could be computed."""
    script, check = page_script.read_text(encoding="utf-8"), "function finerStepsWarning(core, text, coarse) {"
    assert script.count(check) == 1
    (tmp_path / "small.js").write_text(
        script.replace(check, f"{check} throw new Error('Aborted()');"), encoding="utf-8"
    )
    page = open_page(browser, tmp_path / "small.js", tmp_path)
    for name in ("01_hand_downward.toml", "04_hand_lateral.toml"):
        page.select_option("#bumpstop select", label=name)
        settled(page)
        assert page.get_attribute("#bumpstop .verdict", "data-verdict") == "acceptable"
        words = "Whether finer simulation steps hit harder could not be computed here (Error: Aborted())."
        assert page.eval_on_selector_all(".warnings li", "all => all.map(one => one.textContent)")[-1] == words
        assert page.locator("[data-number]").count() == 30
    page.close()


def test_a_link_holds_the_scenario(page: Any) -> None:
    page.select_option("#bumpstop select", label="05_ur10e.toml")
    before = page.input_value("#bumpstop textarea")
    text = before.replace("latency_s = 0.006", "latency_s = 0.012  # ä & = #")
    assert text != before
    page.fill("#bumpstop textarea", text)
    page.click("text=Link")
    address = page.url
    page.goto("about:blank")
    page.goto(address)
    settled(page)
    assert page.input_value("#bumpstop textarea") == text
    compare_with_command(page)
    page.evaluate("location.hash = '#scenario=%E0%A4%A'")
    settled(page)
    assert page.get_attribute("#bumpstop .verdict", "data-verdict") == "refused"


def test_the_page_fits_a_phone(page: Any) -> None:
    page.set_viewport_size({"width": 400, "height": 800})
    settled(page)
    assert page.evaluate("document.documentElement.scrollWidth") <= 400
    page.set_viewport_size({"width": 1280, "height": 800})
