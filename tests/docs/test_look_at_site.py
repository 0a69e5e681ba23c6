"""The look at the site in a browser names what is planted."""

from __future__ import annotations

import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from tools.look_at_site import main

pytestmark = pytest.mark.skipif(shutil.which("chromium") is None, reason="needs chromium: apt-get install chromium")

HEAD = '<!DOCTYPE html><html><head><meta name="viewport" content="width=device-width"></head><body><article>'


@pytest.fixture(autouse=True)
def _playwright() -> None:
    pytest.importorskip("playwright.sync_api")


def look(arguments: list[str]) -> int:
    """Run the tool in a thread of its own: one in which another test has opened its browser can drive no second one."""
    with ThreadPoolExecutor(1) as thread:
        return thread.submit(main, arguments).result()


def test_a_sound_page_has_no_fault(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "index.html").write_text(f"{HEAD}<p>a</p>", encoding="utf-8")
    assert look([str(tmp_path), "--pictures", str(tmp_path / "seen")]) == 0
    assert "1 pages at 390 and 1440 pixels: 0 faults" in capsys.readouterr().out
    assert sorted(path.name for path in (tmp_path / "seen").iterdir()) == ["index_1440.png", "index_390.png"]


def test_planted_faults_are_named(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    body = (
        '<div style="width: 500px">x</div><img src="none.svg"><p>\\frac{1}{2}</p><img src="http://127.0.0.1:9/a.png">'
    )
    (tmp_path / "index.html").write_text(HEAD + body, encoding="utf-8")
    assert look([str(tmp_path)]) == 1
    said = capsys.readouterr().out
    assert "index.html at 390 pixels: is 118 pixels wider than the screen" in said
    assert "at 1440 pixels: is" not in said
    assert "does not draw none.svg" in said
    assert "has 1 formulas" in said
    assert "asks for http://127.0.0.1:9/a.png" in said


def test_a_folder_without_pages_is_no_site(tmp_path: Path) -> None:
    assert look([str(tmp_path)]) == 1
