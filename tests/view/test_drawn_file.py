"""Pictures and reports of a page, drawn in a process of their own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from bumpstop.view.answer import Answer
from bumpstop.view.document import with_keys
from bumpstop.view.page.drawn_file import drawn_file
from bumpstop.view.recorder import picture
from view.cases import HAND, LOWER_ARM
from view.test_page import save

ROOT = Path(__file__).parents[2]


def test_what_draws_stays_out_of_the_server() -> None:
    """The library, and what its figures leave behind, took as much memory as all of a page."""
    code = f"""
import sys
sys.path[:0] = {[str(ROOT), str(ROOT / "tests")]!r}
import bumpstop as bs
from bumpstop.view.answer import Answer
from view.test_page import save
(told,) = save(Answer.of(bs.load_scenario({str(LOWER_ARM)!r})), "Report")
print(told[0], told[1], len(told[2]) > 100_000, "matplotlib" in sys.modules)
"""
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=120, check=True)
    assert run.stdout.split() == ["send_file_download", "01_hand_downward.html", "True", "False"]


@pytest.mark.parametrize("refusal", ["", "cannot be used"])
def test_a_picture_says_what_the_page_says(refusal: str) -> None:
    scenario = with_keys(HAND, {"uncertainty.contact.area_cm2": {"interval": [1.8, 2.5]}})
    answer = Answer.of(scenario)
    answer = answer.without_verdict(refusal) if refusal else answer
    assert drawn_file("Picture", scenario, answer) == picture(answer)


def dies(*_: object) -> None:
    os._exit(1)


def test_a_file_whose_process_dies_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bumpstop.view.page.drawn_file._drawn", dies)
    assert save(Answer.of(HAND), "Picture") == [
        ("add_notification", "Picture", "Picture: its process has died; is there memory for it?")
    ]
