"""Every control in a real browser: changed there, the page has the figures of the command on what it exports."""

from __future__ import annotations

import json
import os
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from browsers import CHROMIUM
from bumpstop.cli.main import main
from bumpstop.model import Robot
from bumpstop.view.controls import PANELS, Control, controls_of
from bumpstop.view.opened import open_source
from bumpstop.view.page.page import Page
from bumpstop.view.page.server import ViewServer
from view.cases import HAND, ROOT
from view.control_cases import needed, other_value
from view.screen import WAIT_MS, Screen

pytestmark = pytest.mark.skipif(CHROMIUM is None, reason="needs chromium: apt-get install chromium")
ALL = controls_of(HAND, Robot.load("sia5d"))
# One of each kind; `make validate` goes through all of them, which takes minutes.
CONTROLS = ALL if "BUMPSTOP_ALL_CONTROLS" in os.environ else tuple({each.kind: each for each in ALL}.values())
_OPEN = ("Motion", "Contact")


@pytest.fixture(scope="module")
def opened(browser: Any) -> Iterator[tuple[Screen, Page]]:
    server = ViewServer(open_source(str(ROOT / "examples" / "01_hand_downward.toml")))
    screen = Screen(browser, server)
    screen.wait_for_the_picture()
    for panel in set(PANELS) - set(_OPEN):
        screen.open_folder(panel)
    yield screen, next(iter(server.pages.values()))
    screen.page.close()
    server.stop()


@pytest.mark.parametrize("control", CONTROLS, ids=[control.key for control in CONTROLS])
def test_the_page_has_the_figures_of_the_command(
    opened: tuple[Screen, Page], control: Control, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    screen, page = opened
    try:
        change(screen, page, control)
        file = tmp_path / "exported.toml"
        file.write_text(screen.scenario(), encoding="utf-8")
        compare(screen, told_of(file, capsys))
    finally:
        while page.document.past:
            page.undo()
        screen.until_same_as(page.document.text)


def change(screen: Screen, page: Page, control: Control) -> None:
    """Change a control in the browser."""
    if changes := needed(control):
        before = screen.scenario()
        page.change(changes, key="")
        screen.until_other_than(before)
        # The file may be shown before the control is: what it shows still is no change.
        if control.kind == "choice":
            screen.until_chosen(control, str(control.read(page.document.scenario)))
    before, wanted = screen.scenario(), other_value(control)
    screen.set(control, wanted)
    screen.until_other_than(before)
    same = pytest.approx(wanted) if isinstance(wanted, float | tuple) else wanted
    until = time.monotonic() + WAIT_MS / 1e3
    while control.read(page.document.scenario) != same and time.monotonic() < until:
        screen.page.wait_for_timeout(20)
    assert screen.page.locator("[data-refusal]:visible").all_text_contents() == []
    # What the control shows is what the file says.
    assert control.read(page.document.scenario) == same
    screen.until_same_as(page.document.text)
    if control.panel == "Uncertainty":
        screen.page.wait_for_selector("[data-verdict]:not([data-verdict='pending'])", timeout=WAIT_MS)


def compare(screen: Screen, told: dict[str, Any]) -> None:
    """What stands on the page is what the command says."""
    central = told.get("central", told)
    if (mean := central["peak_force_N"]["mean"]) is not None:
        # Text and figures are sent together; a busy browser may draw one before the other.
        shown = "mean => Number(document.querySelector(\"[data-figure='peak_force_N.mean']\")?.dataset.value) === mean"
        screen.page.wait_for_function(shown, arg=mean, timeout=WAIT_MS)
    for name in ("peak_force_N", "pressure_N_cm2"):
        for key, value in central[name].items():
            assert figure(screen, f"{name}.{key}") == value, (name, key)
    for key in ("p_over_force", "p_over_pressure"):
        assert figure(screen, f"verdict.{key}") == central["verdict"][key]
    for key in ("false_alarm_probability", "undetected_probability", "no_contact_probability"):
        assert figure(screen, key) == central[key]
    assert screen.page.get_attribute("[data-verdict]", "data-verdict") == told["verdict"]["conclusion"]
    assert screen.page.text_content("[data-sentence]") == told["verdict"]["reason"]
    assert not screen.faults


def figure(screen: Screen, key: str) -> float | None:
    """A number on the page; None where there is none."""
    value = screen.page.get_attribute(f"[data-figure='{key}']", "data-value")
    return float(value) if value else None


def told_of(file: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """What the command says of a scenario."""
    capsys.readouterr()
    with pytest.raises(SystemExit):
        main(["evaluate", str(file), "--json"])
    found: dict[str, Any] = json.loads(capsys.readouterr().out)
    return found
