"""A program on screen: the verdict of a segment is that of ``bumpstop program``."""

from __future__ import annotations

from pathlib import Path

import pytest

import bumpstop as bs
from bumpstop.view.answer import Answer
from bumpstop.view.document import ViewDocument
from bumpstop.view.opened import open_source
from view.cases import ROOT

PROGRAMS = ROOT / "examples" / "programs"


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
                opened.program.changes(number)
            continue
        document = document.edit(opened.program.changes(number))
        answer = Answer.of(document.scenario)
        seen.add(answer.conclusion)
        assert answer.conclusion == one.present.conclusion
        assert answer.result.verdict.p_over_force == one.present.verdict.p_over_force
        assert str(opened.program.file(number)) in document.text
    assert seen
    while document.past:
        document = document.undo()
    assert document.scenario == opened.scenario


def test_a_program_needs_its_cell(tmp_path: Path) -> None:
    with pytest.raises(bs.InputError, match="--scenario: is missing"):
        open_source(str(PROGRAMS / "place.mod"))
    with pytest.raises(bs.InputError, match="has no meaning without a program"):
        open_source("ur10e", cell=PROGRAMS / "cell.toml")
