"""What the page computes is what the command computes: the compiled core in node against the one in Python."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from web.exports import ROOT

import bumpstop as bs
from bumpstop.collision.probability_text import accepted_percent, decimal, percent, small_percent
from bumpstop.collision.verdict.unit_slips import unit_slips
from bumpstop.errors import InputError
from web.cases import random_tables
from web.node import MISSING, WHY_NOT, in_node

pytestmark = pytest.mark.skipif(MISSING, reason=WHY_NOT)

# The aim of the page. The arithmetic is the same, but sums go over two lanes and not over eight: most figures agree to
# the last digits. Tails that are as good as nothing have fewer digits.
RELATIVE, RELATIVE_OF_NOTHING, NOTHING = 1e-9, 1e-6, 1e-20
# Keys of the command that the page does not give.
NOT_GIVEN = {"contact_duration_s", "arm"}


def differences(told: Any, wanted: Any, path: str = "") -> list[str]:
    """Where two objects of JSON differ."""
    if isinstance(wanted, dict):
        if told.keys() != wanted.keys():
            return [f"{path}: keys {sorted(told.keys() ^ wanted.keys())}"]
        return [found for key in wanted for found in differences(told[key], wanted[key], f"{path}.{key}")]
    if isinstance(wanted, list):
        pairs = enumerate(zip(told, wanted, strict=True))
        return [found for i, (one, other) in pairs for found in differences(one, other, f"{path}[{i}]")]
    number = isinstance(wanted, float) and isinstance(told, int | float)
    digits = RELATIVE_OF_NOTHING if number and wanted < NOTHING else RELATIVE
    same = math.isclose(told, wanted, rel_tol=digits) if number else told == wanted
    return [] if same else [f"{path}: {told!r}, wanted {wanted!r}"]


def command(text: str) -> tuple[dict[str, Any], list[str]]:
    """What the command says of a scenario, as far as the page says it, and the warnings that the page looks for."""
    result = bs.evaluate(bs.Scenario.from_dict(tomllib.loads(text)))
    slips = unit_slips(result)
    found = result.to_json()
    warnings = [one for one in found["verdict"].pop("warnings") if one not in slips]
    return {key: value for key, value in found.items() if key not in NOT_GIVEN}, warnings


def compare(text: str, told: dict[str, Any]) -> list[str]:
    """Differences of a scenario that both compute. Warnings that the page looks for are all there, and no others."""
    wanted, warnings = command(text)
    known = wanted.pop("notes")
    said, notes = told["verdict"].pop("warnings"), told.pop("notes")
    found = differences(told, wanted)
    found += [] if said == warnings else [f"warnings {said}, wanted {warnings}"]
    return found + [f"own note: {one}" for one in notes if one not in known]


def test_examples_have_the_numbers_of_the_command(page_script: Path) -> None:
    texts = {path.name: path.read_text(encoding="utf-8") for path in sorted((ROOT / "examples").glob("0[1-5]*.toml"))}
    assert len(texts) == 5
    for name, told in zip(texts, in_node(page_script, "evaluate", list(texts.values())), strict=True):
        assert compare(texts[name], told) == [], name


def test_random_scenarios_have_the_numbers_of_the_command(page_script: Path) -> None:
    texts = [tomli_w.dumps(random_tables(seed)) for seed in range(28)]
    computed = 0
    for seed, (text, told) in enumerate(zip(texts, in_node(page_script, "evaluate", texts), strict=True)):
        if "refused" in told:
            with pytest.raises(InputError):
                command(text)
            continue
        assert compare(text, told) == [], f"seed {seed}\n{text}"
        computed += 1
    assert computed > 20


# Steps of which a motion of 123.5 or 122.5 can be written exactly.
STEP = 2.0**-10
HALVES = {"simulation.step_s": STEP, "detector.feedback_period_s": 4 * STEP}
WARNINGS = {
    "much_untouched": ("In 23 % of cases nothing is hit", {"motion.duration_s": 0.12}),
    "half_a_step_more": ("of cases nothing is hit", {**HALVES, "motion.duration_s": 123.5 * STEP}),
    "half_a_step_less": ("of cases nothing is hit", {**HALVES, "motion.duration_s": 122.5 * STEP}),
    # No warnings, but the other reasons of a verdict.
    "false_alarms": ("", {"detector.noise_sd_Nm": [3.6, 2.6, 3.6, 3.6, 3.6, 3.6, 3.6]}),
    "never_detected": ("", {"detector.thresholds_Nm": [1e6] * 7, "motion.duration_s": 0.6}),
    "never_detected_to_the_end": (
        "",
        {"detector.thresholds_Nm": [1e6] * 7, "motion.velocity_mm_s": [0, 0, -300.0]},
    ),
    "everything": ("", {"detector.noise_sd_Nm": 2.6, "contact.stiffness_N_m": 2e5, "contact.area_cm2": 1.0}),
    "untouched": ("", {"motion.duration_s": 0.02}),
    "normal": ("contact.normal lies 78.7 degrees off", {"contact.normal": [1.0, 0.0, -0.2]}),
    "rest": ("From rest the arm has reached", {"motion.start": "rest", "contact.offset_sd_s": 0.001}),
    "rest_at_a_distance": (
        "Give the largest contact.offset_mm there can be",
        {"motion.start": "rest", "contact.offset_law": "fixed", "contact.offset_mm": 0.2},
    ),
    "head": ("is a sensitive region", {"contact.body": "face", "motion.velocity_mm_s": [0, 0, -10.0]}),
    "steps": (
        "Simulation steps are coarse",
        {"simulation.step_s": 0.02, "simulation.substeps": 1, "detector.feedback_period_s": 0.02},
    ),
    "steps_fixed": (
        "Simulation steps are coarse",
        {
            "simulation.step_s": 0.02,
            "simulation.substeps": 1,
            "detector.feedback_period_s": 0.02,
            "contact.offset_law": "fixed",
            "contact.offset_mm": 4.0,
        },
    ),
    "substeps_of_a_long_motion": (
        "Simulation sub-steps of 0.02 s are coarse",
        {
            "simulation.step_s": 0.02,
            "simulation.substeps": 1,
            "detector.feedback_period_s": 0.02,
            "motion.duration_s": 900.0,
        },
    ),
}


@pytest.mark.parametrize("name", WARNINGS)
def test_warnings_that_the_page_looks_for_are_those_of_the_command(page_script: Path, name: str) -> None:
    words, changes = WARNINGS[name]
    scenario = bs.load_scenario(ROOT / "examples" / "01_hand_downward.toml").with_values(changes)
    text = tomli_w.dumps(scenario.as_given())
    (told,) = in_node(page_script, "evaluate", [text])
    assert any(words in one for one in told["verdict"]["warnings"]) == bool(words), told["verdict"]
    assert compare(text, told) == []


@pytest.mark.parametrize(("key", "figure"), [("accepted_probability", "p_over_force"), ("max_false_alarm", "")])
def test_what_is_near_to_accepted_is_told_apart_as_by_the_command(page_script: Path, key: str, figure: str) -> None:
    scenario = bs.load_scenario(ROOT / "examples" / "01_hand_downward.toml").with_values(
        {"motion.speed_mm_s": 75.0, "contact.area_cm2": 9.0, "detector.noise_sd_Nm": 2.6}
    )
    found = bs.evaluate(scenario).verdict
    p = found.p_over_force if figure else found.false_alarm_probability
    assert p is not None
    near = [scenario.with_values({f"verdict.{key}": p * factor}) for factor in (1 / 1.0001, 1.0001, 0.99, 1.01)]
    texts = [tomli_w.dumps(one.as_given()) for one in near]
    for text, told in zip(texts, in_node(page_script, "evaluate", texts), strict=True):
        assert compare(text, told) == []


def test_numbers_are_written_as_the_command_writes_them(page_script: Path) -> None:
    values = [10.0**k * factor for k in range(-14, 8) for factor in (1.0, 1.2345678, 9.99999951, 4.5678)]
    shares = [value for value in values if value <= 1] + [0.0, 1.0, 0.99895, 0.9999991, 0.5]
    written = [f"{value:{form}}" for form in ("g", ".3g", ".17g") for value in values]
    asked = [["general", value, digits] for digits in (6, 3, 17) for value in values]
    assert in_node(page_script, "words", asked) == written
    for name, function in (("percent", percent), ("smallPercent", small_percent)):
        for integrated in (False, True):
            wanted = [function(p, integrated=integrated) for p in shares]
            assert in_node(page_script, "words", [[name, p, integrated] for p in shares]) == wanted
    accepted = [p for p in (*shares, 0.029905, 1e-3 / 1.0001) if 0 < p < 1]
    wanted = [accepted_percent(p) for p in accepted]
    assert in_node(page_script, "words", [["acceptedPercent", p] for p in accepted]) == wanted
    assert in_node(page_script, "words", [["decimal", p] for p in shares]) == [
        decimal(p, integrated=True) for p in shares
    ]
