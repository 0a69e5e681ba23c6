"""What ``bumpstop evaluate`` says beside a verdict is said of programs, too, and finer steps that overturn it count."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest

import bumpstop as bs
from bumpstop.collision.arm.other_arm_verdict import said_beside
from bumpstop.collision.verdict.finer_steps import STEPS_DECIDE
from bumpstop.program.cell import Cell
from bumpstop.program.evaluation import evaluate_program
from bumpstop.program.languages.rapid import read_rapid
from bumpstop.program.source import TextProgram
from cli.support import run
from program.corpora import EXAMPLES, segments

COARSE = {"simulation.step_s": 0.008, "simulation.substeps": 1, "detector.feedback_period_s": 0.008}
HEAD = {"contact.body": "cranium_forehead", "contact.limits": "bgia2011"}
THERE, BACK = "[0.12, -1.57, 1.57, -1.57, -1.57, 0]", "[0, -1.57, 1.57, -1.57, -1.57, 0]"
TURNED = "the verdict is NOT ACCEPTABLE"


def program(folder: Path, *speeds: float) -> Path:
    moves = [f"movej({(THERE, BACK)[i % 2]}, v={speed})\n" for i, speed in enumerate(speeds)]
    (folder / "p.script").write_text("".join(moves))
    return folder / "p.script"


def command(path: Path, changes: dict[str, Any], *options: object) -> Any:
    values = [text for key, value in changes.items() for text in ("--set", f"{key}={value}")]
    return run("program", path, "--scenario", EXAMPLES / "cell.toml", *values, *options)


@pytest.mark.parametrize(
    ("changes", "said"),
    [(HEAD, "is a sensitive region: ISO/TS 15066 asks"), ({"arm.model": "elastic"}, "rest on an ASSUMED drive train")],
    ids=["head", "assumed"],
)
@pytest.mark.usefixtures("unsaved_pictures")
def test_every_sentence_is_told_once(tmp_path: Path, changes: dict[str, Any], said: str) -> None:
    """Of a segment that fails, too."""
    done = command(program(tmp_path, 0.4, 0.05), changes, "--out", tmp_path / "out")
    assert (done.out.count(said), done.err) == (1, "")
    assert "note: segment 1 as given and " in done.out
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert page.count(said) == 1
    assert page.index(said) < page.index('id="segments"')
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    assert sum(said in note for note in summary["notes"]) == 1
    assert not summary["fails_with_finer_steps"]
    for number, one in enumerate(summary["segments"], start=1):
        evaluated = bs.evaluate(bs.load_scenario(tmp_path / "out" / "segments" / f"{number}.toml"))
        assert one["written"]["warnings"] == list(said_beside(evaluated))
        assert said in one["present"]["warnings"][0]


def test_that_the_other_arm_fails_is_said(tmp_path: Path) -> None:
    said = "The rigid arm in the place of the elastic one exceeds the limits: the peak force exceeds 160 N"
    done = command(program(tmp_path, 0.4), {"arm.model": "elastic"})
    assert f"note: segment 1 as written: {said}" in done.out


@pytest.mark.usefixtures("unsaved_pictures")
def test_what_finer_steps_overturn_is_no_pass(tmp_path: Path) -> None:
    path = program(tmp_path, 0.4, 0.133, 0.02)
    done = command(path, COARSE, "--out", tmp_path / "out")
    assert done.status == 3
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    lowered, kept, slow = summary["segments"]
    assert (summary["present"], summary["written"], summary["fails_with_finer_steps"]) == ("FAIL", "INCONCLUSIVE", True)
    # A speed that is too high is lowered as far as is known, and one that is not is not raised.
    assert [one["present"]["outcome"] for one in (lowered, kept, slow)] == ["FAIL", "INCONCLUSIVE", "PASS"]
    assert [one["written"]["outcome"] for one in (lowered, kept, slow)] == ["INCONCLUSIVE", "INCONCLUSIVE", "PASS"]
    assert lowered["factor"] < 1
    assert (kept["factor"], slow["factor"]) == (1.0, 1.0)
    assert (lowered["safe_factor"], kept["safe_factor"], slow["safe_factor"]) == (None, None, 1.0)
    assert (kept["limited_by"], slow["limited_by"]) == ("simulation_steps", "simulation_steps")
    assert lowered["written"]["reason"] == kept["present"]["reason"] == STEPS_DECIDE
    for number, one in enumerate((lowered, kept, slow), start=1):
        warnings = bs.evaluate(bs.load_scenario(tmp_path / "out" / "segments" / f"{number}.toml")).warnings
        assert one["written"]["warnings"] == list(warnings)
        assert any(TURNED in warning for warning in warnings) == (one["written"]["outcome"] != "PASS")
    # What fails anyway is not computed again with finer steps.
    assert lowered["present"]["warnings"] == []
    page = (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    for text in (done.out, page):
        assert text.count(TURNED) == 1
        assert text.count(STEPS_DECIDE) == 2
    first, second, third = done.out.splitlines()[1:4]
    assert [line.split()[-2] for line in (first, second, third)] == ["INCONCLUSIVE", "INCONCLUSIVE", "PASS"]
    assert [line.split()[-3] for line in (first, second)] == ["-", "-"]
    assert "coarse simulation steps" in page


def test_a_program_whose_steps_decide_is_inconclusive(tmp_path: Path) -> None:
    done = command(program(tmp_path, 0.133), COARSE, "--json")
    assert done.status == 4
    found = json.loads(done.out)
    assert (found["present"], found["written"]) == ("INCONCLUSIVE", "INCONCLUSIVE")
    assert command(program(tmp_path, 0.133), {}, "--json", "--only-slower").status == 0


def test_why_nothing_is_raised_is_told(tmp_path: Path) -> None:
    cell = bs.load_scenario(EXAMPLES / "cell.toml", COARSE)
    result = evaluate_program(program(tmp_path, 0.02), cell)
    (said,) = result.notes
    assert said.startswith("segment 1 faster, which is not written: Simulation steps are coarse")
    assert (result.present, result.written_outcome, result.fails_with_finer_steps) == ("PASS", "PASS", False)


def test_finer_steps_count_of_every_body() -> None:
    """One that is hit less hard may be the one whose steps decide."""
    (segment,) = segments(f"movej({THERE}, v=0.133)")
    coarse = bs.load_scenario(EXAMPLES / "cell.toml", COARSE)
    fine = bs.load_scenario(EXAMPLES / "cell.toml", {"contact.body": "upper_arm_elbow", "contact.padding_N_m": 2e5})
    motion = segment.at(1.0)
    alone, other = Cell(coarse).judge(motion), Cell(fine).judge(motion)
    assert (alone.conclusion, other.conclusion) == ("inconclusive", "acceptable")
    for both in (Cell(fine, coarse), Cell(coarse, fine)):
        judged = both.judge(motion)
        assert judged.conclusion == "inconclusive"
        assert judged.warnings == alone.warnings


def test_a_program_is_not_passed_whose_last_statement_is_not_understood(tmp_path: Path) -> None:
    """Which may move the arm as fast as it likes: no move that is understood comes after it."""
    said = "what is not understood may move the arm, and is not judged"
    for line, status in (("speedl([0,0,-2,0,0,0], 3, 5)", 4), ("set_tcp(pose)", 0), ("set_payload(1)", 0)):
        path = program(tmp_path, 0.02)
        path.write_text(f"{path.read_text()}{line}\n")
        done = command(path, {}, "--json", "--only-slower")
        found = json.loads(done.out)
        assert done.status == status, line
        assert found["segments"][0]["present"]["outcome"] == "PASS"
        assert (said in found["notes"]) == (status == 4) == (found["present"] == found["written"] == "INCONCLUSIVE")


def test_what_only_leads_elsewhere_moves_nothing() -> None:
    go = "MoveAbsJ [[17,-85,88,-93,-90,0],[9E9]],v100,fine,tool0;\n"
    for text, unseen in (("ERROR\nTRYNEXT;\n", False), ("SearchL di1,p,p,v10,t;\n", True), ("GOTO a;\na:\n", False)):
        read = read_rapid(f"PROC main()\n{go}{text}ENDPROC\n".encode())
        assert TextProgram(read, ()).moves_unseen == unseen


@pytest.mark.usefixtures("unsaved_pictures")
def test_nothing_is_won_where_nothing_could_be_judged(tmp_path: Path) -> None:
    """Six speeds of axes do not tell those of seven joints; each question stands on one line."""
    cell = EXAMPLES.parent / "01_hand_downward.toml"
    done = run("program", EXAMPLES / "place.src", "--scenario", cell, "--out", tmp_path / "out")
    assert done.status == 4
    assert "INCONCLUSIVE as given, INCONCLUSIVE as written\n" in done.out
    assert "\nline 8, PTP: " in done.out
    assert " s won" not in (tmp_path / "out" / "report.html").read_text(encoding="utf-8").replace("won, s", "")


def test_a_tool_that_is_not_where_contact_is_is_told(tmp_path: Path) -> None:
    """A turn of the wrist was made four times faster than the program's own tool may be, without a word."""
    path = tmp_path / "p.script"
    path.write_text(f"set_tcp(p[0, 0.25, 0.3, 0, 0, 0])\nmovej({THERE}, v=0.05)\nmovej({BACK}, v=0.05)\n")
    said = (
        "note: Contact is at flange, 391 mm from the tool that line 2 moves, which may hit harder: contact.point_m = "
        "[0, 0.25, 0.3] looks there.\n"
    )
    assert said in command(path, {}).out
    there, elsewhere = (
        command(path, {"contact.point_m": "0,0.25,0.3"}).out,
        command(path, {"contact.link": "flange"}).out,
    )
    assert "from the tool" not in there
    assert "from the tool" not in elsewhere, "a place that was chosen is one"
    assert "from the tool" not in command(program(tmp_path, 0.05, 0.05), {}).out
