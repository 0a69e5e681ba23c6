"""The long comparisons in small sizes, what they write, and that they fail where they should."""

from __future__ import annotations

import json
import math
import sys
from concurrent.futures import Future
from concurrent.futures.process import BrokenProcessPool
from pathlib import Path
from typing import Any

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from validation.__main__ import main

import bumpstop as bs
from collision.cases import control_group
from identification.recorded import there
from validation import comparisons, facts, page, scores
from validation import findings as found_by

NEEDS = {
    "reference": ["reference_results"],
    "chapter5": ["dissertation"],
    "chapter6": ["dissertation"],
    "workspace": ["dissertation"],
    "plant": ["dissertation"],
    "rich_gears": ["dissertation"],
}


def results(folder: Path) -> dict[str, Any]:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    loaded: dict[str, Any] = json.loads((folder / "results.json").read_text(), parse_constant=refuse)
    return loaded


# Instruction sets and threads are compared by tests of every law: collision/test_batch.py, test_in_python.py, and
# collision/distribution/test_exact_law.py.
ELSEWHERE = {"instruction_sets"}


# Those that run alone belong to `make validate`, on an idle machine.
@pytest.mark.parametrize(
    "name", [name for name in comparisons.COMPARISONS if name not in comparisons.ALONE | ELSEWHERE]
)
def test_quick(name: str, tmp_path: Path) -> None:
    for file in NEEDS.get(name, []):
        if not (facts.folder() / "facts" / f"{file}.toml").is_file():
            pytest.skip(f"{file}.toml is not in {facts.folder() / 'facts'}: set BUMPSTOP_SHARED")
    if (name == "tx40" and not there("tx40")) or (name == "generic_fit" and not there("panda")):
        pytest.skip(f"the recording that {name} needs is absent: set BUMPSTOP_SHARED")
    status = main(["--quick", "--only", name, "--out", str(tmp_path)])
    found = results(tmp_path)["comparisons"][name]
    assert [check["what"] for check in found["checks"] if not check["passed"]] == []
    assert found["checks"]
    assert status == 0
    html = (tmp_path / "index.html").read_text()
    assert found["title"] in html
    for unwanted in ("<script", "<link", 'src="', ">nan<", ">inf<"):
        assert unwanted not in html.lower()


def test_interrupted_keeps_what_was_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(findings: found_by.Findings, *, quick: bool) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(comparisons.COMPARISONS["drives"], "compare", interrupt)
    only = ["--only", "convergence", "--only", "drives", "--only", "gains", "--jobs", "1"]
    assert main(["--quick", *only, "--out", str(tmp_path)]) == 130
    assert "not run: drives, gains" in capsys.readouterr().out
    found = results(tmp_path)
    assert list(found["comparisons"]) == ["convergence"]
    assert found["comparisons"]["convergence"]["passed"]
    assert found["not_run"] == ["drives", "gains"]
    assert not found["passed"]
    assert "Not run yet: drives, gains." in (tmp_path / "index.html").read_text()


def test_side_by_side_finds_the_same(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    told = {}
    for jobs in ("1", "2"):
        only = ["--only", "drives", "--only", "two_laws", "--jobs", jobs]
        assert main(["--quick", *only, "--out", str(tmp_path / jobs)]) == 0
        printed = capsys.readouterr().out
        told[jobs] = {line for line in printed.splitlines() if "PASS" in line}
    assert told["1"] == told["2"] != set()
    assert all("<figure" in (tmp_path / jobs / "index.html").read_text() for jobs in told)
    one, two = (results(tmp_path / jobs) for jobs in told)
    assert list(one["comparisons"]) == list(two["comparisons"]) == ["drives", "two_laws"]
    for name, found in one["comparisons"].items():
        assert {**found, "seconds": 0} == {**two["comparisons"][name], "seconds": 0}


def test_a_process_that_dies_is_a_failed_check(capsys: pytest.CaptureFixture[str]) -> None:
    ended: Future[tuple[found_by.Findings, str]] = Future()
    ended.set_exception(BrokenProcessPool("a process died"))
    assert not comparisons._result(ended, "drives").passed
    assert "a process died" in capsys.readouterr().out


def test_missing_facts_fail_and_say_where_they_were_looked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("BUMPSTOP_SHARED", str(tmp_path / "nowhere"))
    for name in NEEDS:
        assert main(["--quick", "--only", name, "--out", str(tmp_path)]) == 1
        assert "BUMPSTOP_SHARED" in capsys.readouterr().out
        assert not results(tmp_path)["passed"]


@pytest.mark.parametrize(("factor", "status"), [(1.0, 0), (1.01, 1)])
def test_reference_off_by_one_percent_fails(
    factor: float, status: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    text = ""
    for body in ("hand_finger", "lower_arm_wrist"):
        law = bs.evaluate(control_group(contact__body=body, motion__velocity_mm_s=[0, 0, -75]))
        force, limits = law.peak_force, law.problem.limits
        assert limits is not None
        assert limits.pressure_N_cm2 is not None
        row = [75.0, force.mean * factor, force.sd, *(force.quantile(p) for p in (0.5, 0.95, 0.99))]
        row.append(law.force_at_detection.mean)
        row += [force.exceedance(x) for x in (limits.force_N, limits.pressure_N_cm2, 2 * limits.pressure_N_cm2)]
        text += f"[{body}]\nrows = [{[round(value, 6) for value in row]}]\n"
    (tmp_path / "facts").mkdir()
    (tmp_path / "facts" / "reference_results.toml").write_text(text)
    monkeypatch.setenv("BUMPSTOP_SHARED", str(tmp_path))
    assert main(["--quick", "--only", "reference", "--out", str(tmp_path)]) == status


def test_an_error_in_a_comparison_is_a_failed_check(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(findings: found_by.Findings, *, quick: bool) -> None:
        raise ZeroDivisionError("on purpose")

    monkeypatch.setattr(comparisons.COMPARISONS["two_laws"], "compare", broken)
    assert main(["--only", "two_laws", "--out", str(tmp_path)]) == 1
    [check] = results(tmp_path)["comparisons"]["two_laws"]["checks"]
    assert "on purpose" in check["detail"]


def test_nothing_compared_is_not_passed(tmp_path: Path) -> None:
    empty = found_by.Findings("empty", "Nothing")
    assert not empty.passed
    page.write(tmp_path, [empty], {})
    assert not results(tmp_path)["passed"]


def test_what_is_not_finite_is_null_in_json_and_words_on_the_page(tmp_path: Path) -> None:
    findings = found_by.Findings("odd", "Odd <numbers>")
    findings.check("a & b", True)
    findings.table("Values", ["", "Value"], ["", ".1f"], [["inf", math.inf], ["nan", math.nan], ["none", None]])
    findings.figures["array"] = np.array([1.0, math.inf])
    page.write(tmp_path, [findings], {})
    found = results(tmp_path)["comparisons"]["odd"]
    assert found["tables"][0]["rows"] == [["inf", None], ["nan", None], ["none", None]]
    assert found["figures"]["array"] == [1.0, None]
    html = (tmp_path / "index.html").read_text()
    assert "Odd &lt;numbers&gt;" in html
    assert "a &amp; b" in html
    assert found_by.show(math.inf, ".1f") == "unbounded"


def test_scores_are_standard_normal_where_nothing_but_chance_is_between() -> None:
    rng = np.random.default_rng(1)
    samples = rng.gamma(3.0, size=(400, 2000))
    found = np.array([scores.mean_score("mean", 3.0, row).score for row in samples])
    spreads = np.array([scores.sd_score("sd", math.sqrt(3.0), row).score for row in samples])
    shares = np.array(
        [scores.probability_score("p", 0.003, int(n), 10_000).score for n in rng.binomial(10_000, 0.003, 400)]
    )
    for values in (found, spreads, shares):
        assert abs(values.mean()) < 4 / 20
        assert values.std() == pytest.approx(1, abs=0.15)


def test_scores_see_what_is_wrong() -> None:
    rng = np.random.default_rng(2)
    values = rng.normal(10, 1, 10_000)
    assert scores.mean_score("mean", 10.1, values).score < -8
    assert scores.sd_score("sd", 1.1, values).score < -8
    assert scores.probability_score("p", 0.0, 1, 1000).score == math.inf
    assert scores.probability_score("p", 1e-3, 40, 10_000).score > 6
    assert abs(scores.probability_score("p", 1e-12, 0, 1_000_000).score) < 1e-3
    constant = np.full(1000, 2.0)
    assert scores.sd_score("sd", 0.0, constant).score == 0
    assert scores.sd_score("sd", 0.1, constant).score == math.inf
