"""``bumpstop evaluate`` of many situations and ``bumpstop report``: status, table, JSON, faults."""

from __future__ import annotations

from pathlib import Path

import pytest

from cli.support import EXAMPLE, run, strict_json
from docs.pages import code, command_line, read, rows, section
from register.cases import EXAMPLES, write_register

HEAD = ("--cell", "Press 4", "--author", "A. Smith", "--revision", "B")
SHORT = {"contact.offset_law": "fixed", "contact.offset_mm": 500.0, "motion.duration_s": 1.0}


@pytest.mark.parametrize(
    ("situations", "status"),
    [
        ([{}], 0),
        ([{}, {"contact.area_cm2": 0.5}], 3),
        ([{}, SHORT], 4),
        ([SHORT, {"contact.area_cm2": 0.5}, {}], 3),
    ],
)
def test_the_worst_decides_the_status(tmp_path: Path, situations: list[dict[str, object]], status: int) -> None:
    path = write_register(tmp_path, *({"name": f"number {i}", **row} for i, row in enumerate(situations)))
    shown = run("evaluate", path)
    assert (shown.status, shown.err) == (status, "")
    told = run("evaluate", path, "--json")
    assert told.status == status
    found = strict_json(told.out)
    assert {"pass": 0, "fail": 3, "inconclusive": 4}[found["outcome"]] == status
    assert sum(found["counts"].values()) == len(situations)
    order = [shown.out.index(one["name"]) for one in found["situations"]]
    assert order == sorted(order)
    for one in found["situations"]:
        assert one["reason"].split()[0] in shown.out
    assert run("report", path, *HEAD, "-o", tmp_path / "out").status == status


def test_a_warning_of_many_situations_is_said_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "200")
    rows = [{"name": "rigid"}, {"name": "first", "arm.model": "elastic"}, {"name": "second", "arm.model": "elastic"}]
    path = write_register(tmp_path, *rows)
    warned = {
        one["name"]: one["verdict"]["warnings"]
        for one in strict_json(run("evaluate", path, "--json").out)["situations"]
    }
    (warning,) = warned["first"]
    assert warned == {"rigid": [], "first": [warning], "second": [warning]}
    shown = run("evaluate", path).out.splitlines()
    assert [line for line in shown if line.startswith("warning")] == [f"warning 1, of 2 situations: {warning}"]
    marked = {name: next("Warning 1." in line for line in shown if f" {name} " in line) for name in warned}
    assert marked == {"rigid": False, "first": True, "second": True}


def test_json_keys_are_documented() -> None:
    text = section(command_line(), "### Many situations")
    found = strict_json(run("evaluate", EXAMPLE, EXAMPLES / "sia5d_downward.csv", "--json").out)
    assert {key for name, *_ in rows(text, "key of a register") for key in code(name)} == set(found)
    keys = {key for name, *_ in rows(text, "key of a situation") for key in code(name)}
    assert all(set(one) == keys for one in found["situations"])
    assert [one["place"] for one in found["situations"] if one["file"] == str(EXAMPLE)] == [""]


def test_keys_of_rows_and_inputs_are_documented() -> None:
    from bumpstop.register.rows import OWN, WORDS
    from bumpstop.register.shots import COLUMNS, MAY_LACK
    from bumpstop.register.statements import STATUSES

    page = read("docs/how_to/register.md")
    keys = {key for name, *_ in rows(page, "key of a row") for key in code(name)}
    assert keys == {*OWN, *WORDS}
    (status,) = [meaning for name, meaning in rows(page, "key of `[[input]]`") if name == "`status`"]
    assert tuple(code(status)) == STATUSES
    assert {key for name, *_ in rows(page, "column") for key in code(name)} == {*COLUMNS, *MAY_LACK}


def test_every_fault_has_a_line_and_the_last_line_is_the_error(tmp_path: Path) -> None:
    path = write_register(tmp_path, {"name": "a", "body": "\x1b[31mhand"}, {"name": "b", "kind": "soft"}, {"name": "c"})
    refused = run("evaluate", path, "--json", "--out", tmp_path / "out")
    assert (refused.status, refused.out) == (2, "")
    *faults, last = refused.err.splitlines()
    assert len(faults) == 2
    assert all(line.startswith(f"fault: {path} [[situation]] ") for line in faults)
    assert "\x1b" not in refused.err
    assert last == f"error: {path}: 2 entries cannot be used; no situation is evaluated until all can be"
    assert not (tmp_path / "out").exists()


def test_changes_hold_for_all_situations_and_sampling_is_repeatable() -> None:
    options = ("--set", "motion.speed_mm_s=60", "--sampled", "2000", "--seed", "3", "--json")
    one, other = (run("evaluate", EXAMPLES / "sia5d_downward.csv", *options, "--threads", n) for n in (1, 3))
    assert one.out == other.out
    found = strict_json(one.out)["situations"]
    assert {(item["motion"], item["law"]) for item in found} == {("at 60 mm/s", "sampled")}


@pytest.mark.parametrize(
    ("arguments", "problem"),
    [
        (("--cell", " "), "--cell: ' ' cannot be used; wanted 1 to 120 letters on one line"),
        (("--author", "a\nb"), "--author: 'a\\nb' cannot be used"),
        (("--shots", "absent.csv"), "absent.csv: cannot be read"),
        (("--out", EXAMPLE), "--out: "),
        (("--set", "contact.body=hnd"), "contact.body: 'hnd' is not a region of bgia2011"),
    ],
)
def test_bad_input_of_a_report(tmp_path: Path, arguments: tuple[object, ...], problem: str) -> None:
    refused = run("report", EXAMPLES / "sia5d_downward.csv", *HEAD, "-o", tmp_path / "out", *arguments)
    assert (refused.status, refused.out) == (2, "")
    assert refused.err.splitlines()[-1].startswith(f"error: {problem}"), refused.err
    assert not (tmp_path / "out").exists()


def test_a_report_needs_its_head() -> None:
    refused = run("report", EXAMPLES / "sia5d_downward.csv", "--cell", "x", "-o", "out")
    assert refused.status == 2
    assert "--author" in refused.err
