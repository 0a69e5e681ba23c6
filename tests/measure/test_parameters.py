"""Parameters: factors and shifts of keys, and how far they may be off."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision import CollisionProblem
from bumpstop.errors import InputError
from bumpstop.measure.parameters import (
    CONTACT,
    DECELERATION,
    GEARS,
    LATENCY,
    ROTORS,
    SERVO,
    STOPPING_TIME,
    Parameters,
    told_spread,
)
from measure.cells import elastic, rigid


def test_each_arm_and_law_has_its_own() -> None:
    assert GEARS not in Parameters.of([rigid()]).keys
    assert {GEARS, SERVO, ROTORS} <= set(Parameters.of([elastic()]).keys)
    assert STOPPING_TIME not in Parameters.of([rigid()]).keys
    law = rigid(reaction__deceleration="constant_time", reaction__stopping_time_s=0.1)
    assert DECELERATION not in Parameters.of([law]).keys
    assert STOPPING_TIME in Parameters.of([law]).keys
    assert "contact.padding_N_m" in Parameters.of([rigid(), rigid(contact__padding_N_m=2e4)]).keys


def test_zero_is_the_scenario_and_one_a_standard_deviation() -> None:
    scenario = elastic()
    parameters = Parameters.of([scenario], {GEARS: 0.3, LATENCY: 0.004})
    same, before = parameters.at(scenario, np.zeros(len(parameters))), CollisionProblem.from_scenario(scenario)
    assert CollisionProblem.from_scenario(same).drive_train.gear_stiffness == pytest.approx(
        before.drive_train.gear_stiffness
    )
    z = np.zeros(len(parameters))
    z[parameters.index(GEARS)], z[parameters.index(LATENCY)] = 1.0, -10.0
    moved = CollisionProblem.from_scenario(parameters.at(scenario, z))
    ratio = moved.drive_train.gear_stiffness / before.drive_train.gear_stiffness
    assert ratio == pytest.approx(math.exp(0.3))
    # A latency is never negative.
    assert moved.scenario.reaction.latency_s == 0.0
    assert moved.drive_train.rotor_inertia == pytest.approx(before.drive_train.rotor_inertia)
    assert moved.drive_train.servo_bandwidth == pytest.approx(before.drive_train.servo_bandwidth)


@pytest.mark.parametrize(
    ("spec", "shift", "wanted"),
    [
        ({"distribution": "lognormal", "sigma": 0.2}, False, 0.2),
        ({"distribution": "normal", "mean": 0.01, "sd": 0.003}, True, 0.003),
        ({"distribution": "normal", "sd": 0.003}, True, 0.003),
        ({"distribution": "normal", "relative_sd": 0.1}, False, 0.1),
        ({"distribution": "normal", "mean": 200.0, "sd": 30.0}, False, 0.15),
        ({"distribution": "uniform", "low": 0.0, "high": 0.012}, True, 0.012 / math.sqrt(12)),
        ({"relative": [0.5, 2.0]}, False, math.log(4) / math.sqrt(12)),
        ({"interval": [100.0, 200.0]}, False, math.log(2) / math.sqrt(12)),
        ({"distribution": "samples", "file": "x.csv"}, False, None),
        ({"distribution": "normal", "mean": 0.02, "relative_sd": 0.3}, True, 0.006),
        ({"distribution": "lognormal", "median": 0.02, "sigma": 0.3}, True, 0.006),
    ],
)
def test_spread_of_an_uncertain_input(spec: dict[str, Any], shift: bool, wanted: float | None) -> None:
    found = told_spread(spec, 0.01 if shift else [100.0, 200.0], shift=shift)
    assert found is None if wanted is None else found == pytest.approx(wanted)


@pytest.mark.parametrize(("key", "sd"), [("contact.stiffness_N_m", 6000.0), ("contact.stiffness_N_mm", 6.0)])
def test_spread_of_a_stiffness_in_either_unit(key: str, sd: float) -> None:
    said = {key: {"distribution": "normal", "sd": sd}}
    parameters = Parameters.of([rigid(contact__body=None, contact__stiffness_N_m=60000.0, uncertainty=said)])
    assert parameters.each[parameters.index(CONTACT)].sd == pytest.approx(0.1)


def test_triangular_spread_against_draws() -> None:
    spec = {"distribution": "triangular", "low": 0.002, "mode": 0.004, "high": 0.012}
    drawn = np.random.default_rng(0).triangular(0.002, 0.004, 0.012, 200_000)
    assert told_spread(spec, 0.004, shift=True) == pytest.approx(drawn.std(), rel=0.01)


def test_bad_input() -> None:
    with pytest.raises(InputError, match=r"arm.gears: is no key that measured forces tell; valid: reaction.latency_s"):
        Parameters.of([rigid()], fixed=["arm.gears"])
    with pytest.raises(InputError, match=r"reaction.latency_s: a spread of -1 cannot be used"):
        Parameters.of([rigid()], {LATENCY: -1.0})
    with pytest.raises(InputError, match="fixed: names every parameter"):
        Parameters.of([rigid()], fixed=list(Parameters.of([rigid()]).keys))


def test_values_stay_those_of_a_checked_scenario() -> None:
    parameters = Parameters.of([rigid()])
    for seed in range(5):
        moved = parameters.at(rigid(), np.random.default_rng(seed).standard_normal(len(parameters)))
        again = bs.Scenario.from_dict(moved.to_dict())
        assert again.detector.thresholds_Nm == moved.detector.thresholds_Nm
