"""What the terminal, the page and JSON say of a verdict: the same, and beside it what weakens it."""

from __future__ import annotations

from pathlib import Path

import pytest

from bumpstop.text_files import to_toml
from cli.support import EXAMPLE, evaluate, run, strict_json
from collision.verdict.test_verdict_notes import SWINGING

pytestmark = pytest.mark.usefixtures("unsaved_pictures")

SHORT = ("contact.offset_law=fixed", "contact.offset_mm=500", "motion.duration_s=1")


def sets(*changes: str) -> list[str]:
    return [part for change in changes for part in ("--set", change)]


def plain(text: str) -> str:
    return " ".join(text.split())


def test_inconclusive_everywhere(tmp_path: Path) -> None:
    shown = run("evaluate", EXAMPLE, *sets(*SHORT), "--out", tmp_path)
    assert shown.status == 4
    assert " INCONCLUSIVE " in shown.out
    told = evaluate(*SHORT)
    assert told.status == 4
    verdict = strict_json(told.out)["verdict"]
    assert verdict["acceptable"] is None
    assert verdict["conclusion"] == "inconclusive"
    assert verdict["reason"] in plain(shown.out)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert "<strong>Inconclusive</strong>" in page
    assert verdict["reason"] in page


def test_what_fails_stays_not_acceptable() -> None:
    told = evaluate("contact.area_cm2=0.5")
    assert told.status == 3
    assert strict_json(told.out)["verdict"]["conclusion"] == "not_acceptable"


def test_warnings_stand_with_the_verdict(tmp_path: Path) -> None:
    change = "contact.area_cm2=200"
    (warning,) = strict_json(evaluate(change).out)["verdict"]["warnings"]
    shown = run("evaluate", EXAMPLE, *sets(change), "--out", tmp_path).out
    assert f"warning: {warning}" in plain(shown)
    assert shown.index("warning:") < shown.index("peak force, N"), "before the figures"
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    beside = page[page.index("Beside this verdict") : page.index("What the verdict rests on")]
    assert warning.split(",")[0].replace('"', "&quot;") in beside


@pytest.mark.parametrize(
    "changes",
    [
        ("arm.model=elastic",),
        ("contact.kind=free", "contact.body_mass_kg=20"),
        ("verdict.clamped_limit=two_phase",),
    ],
    ids=["elastic arm", "free contact", "two phases"],
)
def test_a_sooner_reaction_that_goes_farther_is_told_everywhere(changes: tuple[str, ...], tmp_path: Path) -> None:
    """These follow the latest reaction alone, which beside a singularity is not the one that goes farthest."""
    path = tmp_path / "swinging.toml"
    path.write_text(to_toml(SWINGING), encoding="utf-8")
    warnings = strict_json(evaluate(*changes, scenario=path).out)["verdict"]["warnings"]
    (warning,) = (own for own in warnings if "reacts sooner than after reaction.latency_s" in own)
    shown = run("evaluate", path, *sets(*changes), "--out", tmp_path / "page").out
    assert f"warning: {warning}" in plain(shown)
    page = (tmp_path / "page" / "report.html").read_text(encoding="utf-8")
    beside = page[page.index("Beside this verdict") : page.index("What the verdict rests on")]
    assert warning in beside


def test_false_alarms_an_hour_everywhere() -> None:
    shown = run("evaluate", EXAMPLE).out
    assert "0.239 false alarms an hour of free motion" in shown
    assert strict_json(evaluate().out)["verdict"]["false_alarms_per_hour"] == pytest.approx(0.23852, rel=1e-4)


def test_the_page_compares_the_quantile_of_the_accepted_probability(tmp_path: Path) -> None:
    """At 72.5 mm/s p99 stays below the pressure limit and p99.95 does not."""
    changes = ("contact.body=lower_arm_wrist", "motion.speed_mm_s=72.5", "verdict.accepted_probability=0.0005")
    assert run("evaluate", EXAMPLE, *sets(*changes), "--out", tmp_path).status == 3
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    row = page[page.index("Peak pressure, likewise") :]
    row = row[: row.index("</tr>")]
    assert "p99.95" in row
    assert "<strong>above</strong>" in row
    assert "0.239 false alarms an hour of free motion" in page
    figures = strict_json(evaluate(*changes).out)["pressure_N_cm2"]
    assert figures["p99"] < 50 < figures["p999"]
