"""All faults of a scenario's keys at once, and what values outside TOML files mean."""

from __future__ import annotations

from typing import Any

import pytest

from bumpstop.collision import Scenario
from bumpstop.collision.scenario.keys import value_of
from bumpstop.errors import InputError
from collision.scenario_cases import example


def test_every_key_that_cannot_be_used_is_told() -> None:
    data = example()
    data["contact"] |= {"area_cm2": -1, "kind": "soft", "areas": 3}
    data["detector"]["noise_sd_Nm"] = [1, "two", 3, 4, 5, 6, 7]
    data["reaction"]["latency_s"] = "none"
    data["motion"]["velocity_mm_s"] = [0, 0, 0]
    del data["reaction"]["joint_acceleration_rad_s2"]
    scenario, faults = Scenario.check(data)
    assert scenario is None
    assert sorted(fault.field for fault in faults) == [
        "contact.area_cm2",
        "contact.areas",
        "contact.kind",
        "detector.noise_sd_Nm[2]",
        "motion.velocity_mm_s",
        "reaction.joint_acceleration_rad_s2",
        "reaction.latency_s",
    ]
    # Each in the words in which it is told alone.
    with pytest.raises(InputError) as alone:
        Scenario.from_dict(data)
    assert str(alone.value) in map(str, faults)


def test_a_good_scenario_has_no_faults() -> None:
    scenario, faults = Scenario.check(example())
    assert (scenario, faults) == (Scenario.from_dict(example()), [])


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("2", 2),
        ("2.5", 2.5),
        ("[1, 2]", [1, 2]),
        ("1,2, inf", [1.0, 2.0, float("inf")]),
        ('"7"', "7"),
        ("true", True),
        ("chest ", "chest"),
        ("1\nother = 2", "1\nother = 2"),
        ("9" * 5000, "9" * 5000),
        ("[" * 5000, "[" * 5000),
    ],
)
def test_values_outside_toml_files(text: str, value: Any) -> None:
    assert value_of(text) == value
