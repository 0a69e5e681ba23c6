"""A program on screen: the verdict of a segment is that of ``bumpstop program``."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Any

import pytest

import bumpstop as bs
from bumpstop.view.answer import Answer
from bumpstop.view.document import ViewDocument, with_keys
from bumpstop.view.opened import open_source
from bumpstop.view.page.program_panel import ProgramPanel
from bumpstop.view.program_segments import ProgramSegments
from cli.support import run
from view.cases import ROOT
from view.panels import Host

PROGRAMS = ROOT / "examples" / "programs"


@pytest.fixture(autouse=True)
def temporary(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Where temporary folders are made: that of a program stays when its page is closed."""
    folder = tmp_path_factory.mktemp("temporary")
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    return folder


@pytest.mark.parametrize("name", ["place.script", "place.src", "place.mod"])
def test_segments_have_the_verdicts_of_the_program(name: str) -> None:
    pytest.importorskip("ruckig")
    from bumpstop.program.evaluation import evaluate_program

    opened = open_source(str(PROGRAMS / name), cell=PROGRAMS / "cell.toml")
    assert opened.program is not None
    result = evaluate_program(PROGRAMS / name, bs.load_scenario(PROGRAMS / "cell.toml"))
    assert len(opened.program.names) == len(result.segments) == len(set(opened.program.names))
    document, seen = ViewDocument(opened.scenario), set()
    for number, one in enumerate(result.segments):
        if one.present.verdict is None:
            with pytest.raises(bs.InputError, match="segment"):
                opened.program.changes(number, document.scenario)
            continue
        document = document.edit(opened.program.changes(number, document.scenario))
        answer = Answer.of(document.scenario)
        seen.add(answer.conclusion)
        assert answer.conclusion == one.present.conclusion
        assert answer.result.verdict.p_over_force == one.present.verdict.p_over_force
        assert str(opened.program.file(number)) in document.text
    assert seen
    while document.past:
        document = document.undo()
    assert document.scenario == opened.scenario


def test_no_folder_stays_where_no_page_was(tmp_path: Path, temporary: Path) -> None:
    """One stayed of every refused program, and of every picture."""
    pytest.importorskip("ruckig")
    program, cell = tmp_path / "bad.script", PROGRAMS / "cell.toml"
    program.write_text("nothing here\n")
    assert run("view", program, "--scenario", cell).status == 2
    assert run("view", PROGRAMS / "place.script", "--scenario", tmp_path / "none.toml").status == 2
    assert not list(temporary.iterdir())
    assert run("view", PROGRAMS / "place.script", "--scenario", cell, "--port", 70_000).status == 2
    assert not list(temporary.iterdir())
    done = run("view", PROGRAMS / "place.script", "--scenario", cell, "--record", tmp_path / "out")
    assert done.status == 0, done.err
    assert not list(temporary.iterdir())


def test_a_program_needs_its_cell(tmp_path: Path) -> None:
    with pytest.raises(bs.InputError, match="--scenario: is missing"):
        open_source(str(PROGRAMS / "place.mod"))
    with pytest.raises(bs.InputError, match="has no meaning without a program"):
        open_source("ur10e", cell=PROGRAMS / "cell.toml")


def placing() -> tuple[Any, ProgramSegments, ProgramPanel]:
    """A page's host with the program of the examples, its program, and the panel of its segments."""
    pytest.importorskip("ruckig")
    opened = open_source(str(PROGRAMS / "place.script"), cell=PROGRAMS / "cell.toml")
    assert opened.program is not None
    host: Any = Host(opened.scenario, program=opened.program)
    return host, opened.program, ProgramPanel(host)


def test_a_segment_that_is_refused_is_not_chosen(monkeypatch: pytest.MonkeyPatch) -> None:
    """The list showed it while the page had the one before, and its verdict."""
    host, program, panel = placing()
    first = panel._segment.value
    other = next(name for name in program.names if name != first)

    def refuse(*_: Any) -> dict[str, Any]:
        raise bs.InputError(f"segment {other}", "is too short")

    monkeypatch.setattr(type(program), "changes", refuse)
    before = host.document
    for scenario in (before.scenario, with_keys(before.scenario, {"motion.file": "retimed-1.csv"})):
        host.document = ViewDocument(scenario)
        panel._segment.value = other
        panel._choose(other)
        assert host.document.scenario == scenario
        assert panel._segment.value == first
        assert "is too short" in panel._says.content


def test_the_segment_that_was_chosen_last_is_shown(monkeypatch: pytest.MonkeyPatch) -> None:
    """While one is sought, another may be chosen and a key changed: contact was not sought with that."""
    host, program, panel = placing()
    seek = type(program).changes

    def meanwhile(self: Any, number: int, scenario: bs.Scenario) -> dict[str, Any]:
        found = seek(self, number, scenario)
        if number == 0:
            panel._segment.value = program.names[3]
            panel._choose(program.names[3])
        else:
            host.change({"contact.area_cm2": 3.0})
            panel.follow(host.document.scenario)
            assert panel._segment.value == program.names[3]
        return found

    monkeypatch.setattr(type(program), "changes", meanwhile)
    panel._segment.value = program.names[0]
    panel._choose(program.names[0])
    panel.follow(host.document.scenario)
    assert host.document.scenario.motion.file == str(program.file(3))
    assert panel._segment.value == program.names[3]
    assert "it may be harder elsewhere now" in panel._says.content


def test_contact_is_sought_with_what_is_on_screen() -> None:
    """With another detector a segment is hardest elsewhere: where it was hardest before, it is acceptable."""
    from bumpstop.program.cell import Cell

    host, program, panel = placing()
    panel._choose(program.names[3])
    panel.follow(host.document.scenario)
    assert "harder" not in panel._says.content
    chosen = host.document
    other = {"detector.thresholds_Nm": [21, 80, 80, 12, 12, 12], "detector.noise_sd_Nm": [3, 7, 5, 2, 2, 2]}
    host.change(other)
    panel.follow(host.document.scenario)
    assert Answer.of(host.document.scenario).word == "ACCEPTABLE"
    assert "it may be harder elsewhere now" in panel._says.content
    # What the button does.
    panel._choose(panel._segment.value)
    panel.follow(host.document.scenario)
    assert "harder" not in panel._says.content
    judged = Cell(with_keys(bs.load_scenario(PROGRAMS / "cell.toml"), other)).judge(program.source.segments[3].at(1.0))
    assert host.document.scenario.motion.contact_onset_s == judged.worst_s
    assert Answer.of(host.document.scenario).conclusion == judged.conclusion == "not_acceptable"
    # Back where it was sought before; and with what was slowed down.
    panel.follow(chosen.scenario)
    assert "harder" not in panel._says.content
    panel.follow(with_keys(chosen.scenario, {"motion.file": "retimed-1.csv"}))
    assert "before the segment was slowed down" in panel._says.content
