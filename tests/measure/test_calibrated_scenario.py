"""Scenarios that carry what was learned, where they say something of the same keys themselves."""

from __future__ import annotations

import tomllib
from typing import Any

import pytest

import bumpstop as bs
from bumpstop.measure import MeasuredShot
from bumpstop.measure.learning.calibrated_scenario import calibrated_toml
from bumpstop.measure.learning.calibration import calibrate
from bumpstop.measure.learning.peak_force_ensemble import PeakForceEnsemble
from bumpstop.measure.parameters import CONTACT, Parameters
from bumpstop.measure.planning.measured_situation import situations_of
from bumpstop.measure.planning.plan import conditions_of
from measure.cells import rigid


def calibrated(scenario: bs.Scenario, device: str | None = None) -> dict[str, Any]:
    """The scenario after one shot, as it is written."""
    situations = situations_of([("place", scenario)], device)
    parameters = Parameters.of([each.measured for each in situations])
    conditions = conditions_of(situations, parameters, (1.0,))
    peak_forces = PeakForceEnsemble.of(parameters, conditions, points=32, seed=3)
    shot = MeasuredShot("place", conditions[0].speed_mm_s, 100.0, 1)
    data = tomllib.loads(calibrated_toml(calibrate(peak_forces, [shot], refine=0), scenario))
    bs.Scenario.from_dict(data)
    return data


@pytest.mark.parametrize(("body", "device"), [("hand_finger", None), (None, "hand")])
def test_the_pad_of_a_gauge_is_no_stiffness_of_a_body(body: str | None, device: str | None) -> None:
    """Also where the scenario gives the body's itself: a soft pad would make its forces too low."""
    data = calibrated(rigid(contact__body=body, contact__stiffness_N_m=60000.0), device)
    assert data["contact"]["stiffness_N_m"] == 60000.0
    assert CONTACT not in data["uncertainty"]


@pytest.mark.parametrize("key", ["contact.stiffness_N_m", "contact.stiffness_N_mm"])
def test_how_well_a_body_is_known_says_nothing_of_the_pad(key: str) -> None:
    said = {"distribution": "lognormal", "sigma": 0.01}
    (situation,) = situations_of([("hand", rigid(uncertainty={key: said}))])
    parameters = Parameters.of([situation.measured])
    assert parameters.each[parameters.index(CONTACT)].sd == 0.25


@pytest.mark.parametrize("key", ["contact.stiffness_N_mm", "detector.thresholds_Nm[2]"])
def test_what_was_learned_replaces_what_was_said_in_other_words(key: str) -> None:
    said = {"distribution": "normal", "relative_sd": 0.1}
    data = calibrated(rigid(contact__body=None, contact__stiffness_N_m=60000.0, uncertainty={key: said}))
    assert key not in data["uncertainty"]
    assert CONTACT in data["uncertainty"]
