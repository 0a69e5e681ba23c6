"""An elastic arm is that of one pose: where bodies elsewhere on its line are hit harder, a warning says so."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest

import bumpstop as bs

EXAMPLES = Path(__file__).parents[3] / "examples"


def elastic(example: str, **changes: Any) -> bs.Scenario:
    table = {key.replace("__", "."): value for key, value in changes.items()}
    return bs.load_scenario(EXAMPLES / f"{example}.toml", {"arm.model": "elastic", **table})


def told(scenario: bs.Scenario) -> list[str]:
    return [warning for warning in bs.evaluate(scenario).warnings if "is that of one pose" in warning]


@pytest.mark.parametrize(
    ("example", "changes"),
    [
        ("01_hand_downward", {"contact__offset_sd_s": 1.0}),
        ("01_hand_downward", {"contact__offset_sd_s": 1.0, "reaction__kind": "stop"}),
        # A fifth of the bodies stand beyond the end of the line.
        ("01_hand_downward", {"contact__offset_sd_s": 3.0}),
        ("05_ur10e", {"contact__offset_law": "half_normal", "contact__offset_sd_s": 2.0}),
    ],
)
def test_a_far_body_that_is_hit_harder_is_told_with_its_force(example: str, changes: dict[str, Any]) -> None:
    given = elastic(example, **changes)
    (warning,) = told(given)
    found = re.search(r"after (\S+) mm the peak force \(p(\S+)\) is (\S+) N, not (\S+) N", warning)
    assert found is not None
    place, percent, there, here = map(float, found.groups())
    alone = bs.evaluate(given.with_values({"contact.offset_law": "fixed", "contact.offset_mm": place}))
    assert alone.peak_force.quantile(percent / 100) == pytest.approx(there, rel=1e-2)
    assert bs.evaluate(given).peak_force.quantile(percent / 100) == pytest.approx(here, rel=1e-3)
    assert there > 1.03 * here


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"contact__offset_sd_s": 1.0, "arm__model": "rigid"},
        {"contact__offset_law": "fixed", "contact__offset_mm": 98.0},
        {"contact__offset_law": "uniform"},
        # Hardly any body stands on the line: there is no verdict.
        {"contact__offset_sd_s": 1e4},
    ],
)
def test_bodies_at_one_place_need_no_word(changes: dict[str, Any]) -> None:
    assert not told(elastic("01_hand_downward", **changes))


def test_a_trajectory_takes_the_arm_of_every_contact() -> None:
    assert not told(elastic("06_pick_and_place_trajectory"))
