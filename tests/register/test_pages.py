"""Pages of registers: verdict first, everything named, the same bytes again."""

from __future__ import annotations

import hashlib
import math
import re
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest

import bumpstop as bs
from bumpstop.contact import LimitTable
from bumpstop.register import RegisterResult, evaluate_register, load_register
from bumpstop.register.shots import Shot, load_shots
from bumpstop.report.register.dossier import DossierHead, write_dossier
from bumpstop.report.register.page import write_register
from bumpstop.report.register.provenance import ProvenancePart
from register.cases import EXAMPLES
from register.cases import write_register as register_of

HEAD = DossierHead(cell='Press 4 </style> "x"', author="A. <b> Smith", revision="C\\2")


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"body": "face", "kind": "free"}, "no contact permitted"),
        ({"body": "face", "verdict.clamped_limit": "two_phase"}, "no contact permitted"),
        ({"detector.thresholds_Nm": [1e9] * 7}, "unbounded"),
    ],
)
def test_an_infinite_use_says_why(tmp_path: Path, changes: dict[str, Any], text: str) -> None:
    row = {"name": "a", "contact.limits": "ts15066", **changes}
    (found,) = bs.evaluate_register(bs.load_register(register_of(tmp_path, row))).results
    assert (found.use, found.use_text) == (math.inf, text)


class Text(HTMLParser):
    """Sections by anchor, rows of tables, tags that are open."""

    VOID = ("meta", "wbr", "path", "circle", "rect", "use", "br")

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.sections: dict[str, str] = {}
        self.rows: list[list[str]] = []
        self.tags: set[str] = set()
        self._section = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attributes: list[tuple[str, str | None]]) -> None:
        self.tags.add(tag)
        if tag not in self.VOID:
            self.open.append(tag)
        if tag == "section":
            self._section = str(dict(attributes)["id"])
            self.sections[self._section] = ""
        if tag == "tr":
            self.rows.append([])
        if tag in ("td", "th"):
            self.rows[-1].append("")

    def handle_endtag(self, tag: str) -> None:
        if tag not in self.VOID:
            assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if self._section:
            self.sections[self._section] += data
        if "td" in self.open or "th" in self.open:
            self.rows[-1][-1] += data


@pytest.fixture(scope="module")
def result() -> RegisterResult:
    return bs.evaluate_register(bs.load_register(EXAMPLES / "ur10e_hand_guiding.toml"))


def shots_of(folder: Path, result: RegisterResult) -> tuple[Path, Any]:
    path = folder / "shots.csv"
    path.write_text(
        "situation,shot,speed_mm_s,predicted_peak_force_N,predicted_low_N,predicted_high_N,measured_peak_force_N\n"
        "hand between flange and table,first,30,66,60,78,71.5\n"
        "hand between flange and table,second,30,66,60,78,80.5\n"
        "upper arm at the elbow,first,200,,,,\n",
        encoding="utf-8",
    )
    return path, load_shots(path, result.register.situations)


def test_shots_that_show_nothing_are_marked(tmp_path: Path, result: RegisterResult) -> None:
    name = "hand between flange and table"
    found = next(one for one in result.results if one.situation.name == name)
    speed = math.hypot(*(found.situation.scenario.motion.velocity_mm_s or ()))
    middle = found.peak_force["p50"]
    shot = Shot(situation=name, shot="1", speed_mm_s=speed, predicted_N=middle, low_N=middle - 6, high_N=middle + 6,
                measured_N=middle)  # fmt: skip
    none = {"low_N": math.nan, "high_N": math.nan}
    shots = [
        shot,
        replace(shot, shot="2", measured_N=middle / 1000),
        replace(shot, shot="3", speed_mm_s=speed / 4),
        replace(shot, shot="4", measured_N=2 * middle, **none),
        replace(shot, shot="5", **none),
    ]
    page = write_dossier(result, tmp_path, HEAD, shots).read_text(encoding="utf-8")
    words = {row[1]: row[-1] for row in Text(page).rows if len(row) == 7 and row[0] == name and row[1] in "12345"}
    limit = found.verdict.limits.force_N if found.verdict.limits else math.inf
    assert words == {
        "1": "in the band",
        "2": "far below: reading or unit?",
        "3": "speed? the band is of another",
        "4": "above the limit" if 2 * middle > limit else "above",
        "5": "",
    }
    assert "1 of 3 measured peaks with a band lie in it" in page


def test_shots_without_a_peak_are_marked(tmp_path: Path, result: RegisterResult) -> None:
    shot = Shot(situation="upper arm at the elbow", shot="1", speed_mm_s=100, predicted_N=66, low_N=60, high_N=78,
                measured_N=math.nan)  # fmt: skip
    shots = [
        shot,
        replace(shot, shot="2", lower_bound_N=70.0, unusable_recording="s.csv"),
        replace(shot, shot="3", recording="r.csv"),
    ]
    page = write_dossier(result, tmp_path, HEAD, shots).read_text(encoding="utf-8")
    rows = {
        row[1]: row[-2:] for row in Text(page).rows if len(row) == 7 and row[0] == shot.situation and row[1] in "123"
    }
    assert rows == {
        "1": ["", "not measured yet"],
        "2": ["at least 70", "recording cannot be relied on"],
        "3": ["", "recording not read"],
    }
    assert "2 shots were made and have no peak that can be relied on." in page


def test_a_file_that_changes_meanwhile_is_named(tmp_path: Path) -> None:
    samples, scenario = tmp_path / "stiffness.csv", tmp_path / "cell.toml"
    samples.write_text("\n".join(str(9000 + 50 * k) for k in range(40)), encoding="utf-8")
    text = (EXAMPLES.parent / "02_lower_arm_downward.toml").read_text(encoding="utf-8")
    uncertain = '"contact.stiffness_N_m" = { distribution = "samples", file = "stiffness.csv" }'
    scenario.write_text(f"{text}\n[uncertainty]\n{uncertain}\n", encoding="utf-8")
    register = load_register(scenario)
    read = hashlib.sha256(samples.read_bytes()).hexdigest()
    result = evaluate_register(register)
    samples.write_text("10000\n" * 40, encoding="utf-8")
    [row] = [row for row in Text(str(ProvenancePart(result).content()[0])).rows if row[0] == str(samples)]
    assert row[1].startswith(f"{read} (changed")


def test_dossier(tmp_path: Path, result: RegisterResult) -> None:
    file, shots = shots_of(tmp_path, result)
    page = write_dossier(result, tmp_path, HEAD, shots, [file]).read_text(encoding="utf-8")
    text = Text(page)
    assert text.open == []
    assert list(text.sections) == [
        *("verdict", "situations", "assumptions", "measurements", "stopping"),
        *("inputs", "limits", "standards", "provenance"),
    ]
    assert not text.tags & {"details", "script", "link", "iframe", "img"}
    first = text.sections["verdict"]
    assert first.index("FAIL") < first.index("preliminary assessment; measurement decides")
    assert "neither it nor this page is a safety function" in first
    assert "not the risk of ISO 12100" in first
    rows = {tuple(row) for row in text.rows}
    assert {("cell", HEAD.cell), ("author", HEAD.author), ("revision", HEAD.revision)} <= rows
    names = [one.situation.name for one in result.results]
    verdicts = [row for row in text.rows if len(row) == 5 and row[0] in names]
    assert [row[0] for row in verdicts] == names
    assert [row[1] for row in verdicts] == ["FAIL"] + 4 * ["INCONCLUSIVE"]
    measured = text.sections["measurements"]
    assert "3 shots are planned, 2 are measured. 1 of 2 measured peaks with a band lie in it." in measured
    assert any(row[1:3] == ["second", "30"] and row[-1] == "above" for row in text.rows)
    for path in (EXAMPLES / "ur10e_hand_guiding.toml", EXAMPLES / "ur10e_table.toml", file):
        assert (str(path), hashlib.sha256(path.read_bytes()).hexdigest()) in rows
    for name in ("bgia2011", "ts15066"):
        for region in LimitTable.load(name).regions:
            assert any(row[:2] == [region.label, f"{region.force_N:g}"] for row in text.rows)


def test_the_remark_of_a_row_is_shown(tmp_path: Path) -> None:
    path = register_of(tmp_path, {"name": "a", "note": "guard to be moved <first>"}, {"name": "b", "speed_mm_s": 20})
    found = bs.evaluate_register(bs.load_register(path))
    assert {one["name"]: one["note"] for one in found.to_json()["situations"]} == {
        "a": "guard to be moved <first>",
        "b": "",
    }
    for page in (write_register(found, tmp_path / "a"), write_dossier(found, tmp_path / "b", HEAD)):
        assert ["a", "guard to be moved <first>"] in Text(page.read_text(encoding="utf-8")).rows
    without = bs.evaluate_register(bs.load_register(register_of(tmp_path, {"name": "b"})))
    assert "Remarks" not in write_register(without, tmp_path / "c").read_text(encoding="utf-8")


def test_figures_are_not_torn_apart(tmp_path: Path, result: RegisterResult) -> None:
    file, shots = shots_of(tmp_path, result)
    page = write_dossier(result, tmp_path, HEAD, shots, [file]).read_text(encoding="utf-8")
    assert not re.findall(r"\d\.<wbr>\d", page)
    tables = re.findall("<table>(.*?)</table>", page, re.DOTALL)
    assert not re.findall(r"<td>(-?\d+(?:\.\d+)?(?: %| kg| to [\d.]+)?)</td>", "".join(tables))
    (style,) = re.findall("<style>(.*?)</style>", page, re.DOTALL)
    assert ".numbers td { white-space: nowrap; }" in style


def test_what_is_just_above_a_limit_is_told_so(tmp_path: Path, result: RegisterResult) -> None:
    (first,) = [one for one in result.results if one.situation.name == "hand between flange and table"]
    limits = first.verdict.transient or first.verdict.limits
    assert limits is not None
    above = limits.force_N + 0.01
    verdict = replace(first.verdict, p_over_force=0.00102, p_over_pressure=0.0)
    close = replace(first, verdict=verdict, peak_force=dict.fromkeys(first.peak_force, above))
    shot = Shot(situation=first.situation.name, shot="1", speed_mm_s=30, predicted_N=66, low_N=60, high_N=120,
                measured_N=120.02)  # fmt: skip
    shots = [shot, replace(shot, shot="2", measured_N=math.nan, lower_bound_N=above)]
    page = write_dossier(replace(result, results=(close,)), tmp_path, HEAD, shots).read_text(encoding="utf-8")
    rows = [row for row in Text(page).rows if row and row[0] == first.situation.name]
    assert first.verdict.accepted_probability == 0.001
    assert [row[3] for row in rows if len(row) == 5] == ["0.102 %"]
    assert [row[1:4] for row in rows if len(row) == 10] == [[f"{above:.15g}"] * 3]
    assert [row[4:6] for row in rows if len(row) == 7 and row[1] in "12"] == [
        ["60 to 120", "120.02"],
        ["60 to 120", f"at least {above:.15g}"],
    ]


def test_one_shot_is_one(tmp_path: Path, result: RegisterResult) -> None:
    _, shots = shots_of(tmp_path, result)
    for some, words in (
        (shots[:1], "1 shot is planned, 1 is measured. 1 of 1 measured peak with a band lies in it."),
        (shots[2:], "1 shot is planned, 0 are measured. 0 of 0 measured peaks with a band lie in it."),
        (shots, "3 shots are planned, 2 are measured. 1 of 2 measured peaks with a band lie in it."),
    ):
        page = write_dossier(result, tmp_path, HEAD, some).read_text(encoding="utf-8")
        assert words in Text(page).sections["measurements"]


def test_every_input_has_a_kind_and_a_status(tmp_path: Path, result: RegisterResult) -> None:
    text = Text(write_dossier(result, tmp_path, HEAD).read_text(encoding="utf-8"))
    rows = [
        row
        for row in text.rows
        if len(row) in (5, 6) and row[-3] in ("required", "from a standard", "engineering choice")
    ]
    shown = {(row[0] if len(row) == 6 else "", *row[-5:-2]) for row in rows}
    for one in result.results:
        for value in one.inputs:
            word = {"required": "required", "standard": "from a standard", "choice": "engineering choice"}[value.kind]
            cells = (value.key, value.value, word)
            assert ("", *cells) in shown or (one.situation.name, *cells) in shown, cells
    assert all(row[-2] for row in rows)
    by_key = {row[-5]: row[-3:-1] for row in rows}
    assert by_key["detector.thresholds_Nm"] == ["required", "assumed"]
    assert by_key["verdict.accepted_probability"] == ["engineering choice", "default"]
    assert by_key["reaction.joint_acceleration_rad_s2"] == ["required", "given"]
    assert by_key["force limit, Chest (ts15066)"] == ["from a standard", "unrecorded"]


def test_the_same_bytes_again(tmp_path: Path, result: RegisterResult) -> None:
    again = bs.evaluate_register(bs.load_register(EXAMPLES / "ur10e_hand_guiding.toml"), threads=1)
    one, other = (write_dossier(found, tmp_path / name, HEAD) for found, name in ((result, "a"), (again, "b")))
    assert one.read_bytes() == other.read_bytes()
    pages = [write_register(found, tmp_path / name).read_bytes() for found, name in ((result, "a"), (again, "b"))]
    assert pages[0] == pages[1]


def test_sheets_are_numbered_and_name_cell_and_revision(tmp_path: Path, result: RegisterResult) -> None:
    page = write_dossier(result, tmp_path, HEAD).read_text(encoding="utf-8")
    (style,) = re.findall("<style>(.*?)</style>", page, re.DOTALL)
    assert 'content: "page " counter(page) " of " counter(pages)' in style
    (name,) = re.findall(r'@bottom-left { content: "([^"]*)"', style)
    told = re.sub(r"\\([0-9a-f]{6})", lambda found: chr(int(found[1], 16)), name)
    assert told == f"{HEAD.cell}, revision {HEAD.revision}"


def test_a_page_of_many_situations_draws_the_worst(tmp_path: Path) -> None:
    rows = [{"name": f"at {speed} mm/s", "speed_mm_s": speed} for speed in range(20, 63)]
    found = bs.evaluate_register(bs.load_register(register_of(tmp_path, *rows)))
    page = write_register(found, tmp_path / "out").read_text(encoding="utf-8")
    assert "The 40 worst of 43." in page
    assert page.index("at 62 mm/s") < page.index("at 61 mm/s") < page.index("at 20 mm/s")
    assert (tmp_path / "out" / "use_of_limits.svg").exists()


def test_stopping_tables_are_shown(tmp_path: Path) -> None:
    table = EXAMPLES.parent / "stopping" / "tm5_700.toml"
    base = {"scenario": str(EXAMPLES / "ur10e_table.toml"), "speed_mm_s": 20.0}
    path = register_of(
        tmp_path,
        {"name": "with", **base, "reaction.deceleration": "table", "reaction.stopping_table": str(table)},
        {"name": "without", **base},
    )
    result = bs.evaluate_register(bs.load_register(path))
    text = Text(write_dossier(result, tmp_path / "out", HEAD).read_text(encoding="utf-8"))
    stopping = text.sections["stopping"]
    assert str(table) in stopping
    assert "None for without." in stopping
    assert "constant_time: d = v T / 2" in stopping
    assert any(str(table) == row[0] and len(row[1]) == 64 for row in text.rows if len(row) == 2)


def test_probabilities_of_a_page_are_all_in_percent(tmp_path: Path, result: RegisterResult) -> None:
    """P(over) was, and a false alarm beside it was 0.0123."""
    page = Text(write_register(result, tmp_path).read_text(encoding="utf-8"))
    (at,) = (i for i, row in enumerate(page.rows) if row and row[-1] == "false alarm")
    for row, one in zip(page.rows[at + 1 :], result.results, strict=False):
        assert row[0] == one.situation.name
        assert re.fullmatch(r"(?:less than |over )?[\d.]+ %", row[-1]), row[-1]
