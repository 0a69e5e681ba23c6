"""The check of the documentation site finds what is planted, and the site has what it must."""

from __future__ import annotations

import json
import re
from pathlib import Path

from tools.check_site import faults_of_figures, faults_of_files, faults_of_links, faults_of_search, faults_of_words

import bumpstop as bs
from bumpstop.cli.completion import scenario_keys
from docs.pages import PAGES, read


def site(folder: Path, body: str) -> Path:
    (folder / "other.html").write_text('<h1 id="there">x</h1>', encoding="utf-8")
    (folder / "drawn.svg").write_text("<svg/>", encoding="utf-8")
    (folder / "index.html").write_text(f"<html><body>{body}</body></html>", encoding="utf-8")
    return folder


def test_a_sound_page_has_no_fault(tmp_path: Path) -> None:
    body = '<a href="other.html#there">a</a><a href="https://else.where/x">a</a><img src="drawn.svg"><a href="#">a</a>'
    assert faults_of_links(site(tmp_path, body)) == []
    assert faults_of_figures(tmp_path, ["drawn"]) == []


def test_planted_faults_are_found(tmp_path: Path) -> None:
    body = (
        '<a href="none.html">a</a><a href="other.html#nowhere">a</a><a href="../../x.html">a</a>'
        '<script src="https://else.where/a.js"></script><link href="//else.where/a.css"><img src="missing.png">'
        "<style>@font-face { src: url('https://else.where/font.woff2') }</style>"
    )
    found = "\n".join(faults_of_links(site(tmp_path, body)))
    for planted in (
        "none.html does not",
        "#nowhere: no such",
        "x.html is outside",
        "a.js from",
        "a.css from",
        "missing.png",
    ):
        assert planted in found
    assert "font.woff2 from another host" in found
    (tmp_path / "a.css").write_text("b { background: url(http://else.where/b.png) } c { mask: url(no.svg) }")
    (tmp_path / "a.js").write_text("fetch('https://else.where')")
    assert len(faults_of_files(tmp_path)) == 3
    assert faults_of_figures(tmp_path, ["drawn"]) == ["figure drawn is on no page"]


def test_a_key_that_search_does_not_find_is_named(tmp_path: Path) -> None:
    index = {"terms": {"contact": 1, "area_cm2": 2}, "titleterms": {}}
    (tmp_path / "searchindex.js").write_text(f"Search.setIndex({json.dumps(index)})")
    assert faults_of_search(tmp_path, ["contact.area_cm2", "contact.body"]) == ["search does not find contact.body"]


def test_mangled_words_are_named(tmp_path: Path) -> None:
    body = (
        "<p>e.g. \u2013set a=1, --out</p><strong>upper</strong> (<em>lower</em><em>,</em>) \u2013 limits; 3\u2013five"
    )
    found = faults_of_words(site(tmp_path, body))
    assert found == ["index.html: \u2013set", "index.html: the name lower stands as a type"]
    assert faults_of_words(site(tmp_path, "<p>\u2013 a limit, <code>--set</code> (<em>float</em>)</p>")) == []


def test_every_public_name_is_in_the_reference_of_python() -> None:
    """The page lists the names that rooms give to the package: every public one belongs to a room."""
    assert "{public-names}" in read("docs/reference/python.md")
    listed = {name for names in bs._HOME.values() for name in names}
    assert set(bs.__all__) <= listed
    assert all((getattr(bs, name).__doc__ or "").strip() for name in bs.__all__)


def test_every_figure_is_on_one_page() -> None:
    source = read("docs/extensions/figures.py")
    drawn = re.findall(r'^    Picture\("(\w+)"', source, re.MULTILINE)
    pages = [page.read_text(encoding="utf-8") for page in PAGES]
    shown = [name for page in pages for name in re.findall(r"\{made-figure\} (\w+)", page)]
    assert sorted(drawn) == sorted(shown)


def test_keys_of_the_reference_are_those_of_scenarios() -> None:
    assert "{scenario-keys}" in read("docs/reference/scenario_keys.md")
    assert {"robot", "contact.area_cm2", "detector.thresholds_Nm", "verdict.accepted_probability"} <= set(
        scenario_keys()
    )
