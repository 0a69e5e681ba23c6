"""Peak forces of shots against the integrated distribution, which goes another way to them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.errors import InputError
from bumpstop.measure.peak_force_model import shot_force
from measure.cells import elastic, rigid

_GAUGE = {"contact__stiffness_N_m": 276e3, "contact__gauge_spring_N_m": 75e3}
_FREE = {"contact__kind": "free", "contact__stiffness_N_m": 40e3}
CASES: dict[str, tuple[bs.Scenario, float]] = {
    # Ends of distributions that are steps are met to the width of a step.
    "rigid": (rigid(**_GAUGE), 3e-3),
    "rigid, reverse": (rigid(**_GAUGE, reaction__kind="reverse"), 3e-3),
    "rigid, constant time": (
        rigid(**_GAUGE, reaction__deceleration="constant_time", reaction__stopping_time_s=0.1),
        3e-3,
    ),
    "rigid, padding, long period": (
        rigid(**_GAUGE, contact__padding_N_m=30e3, detector__feedback_period_s=0.008),
        1e-2,
    ),
    "rigid, observer": (rigid(**_GAUGE, detector__residual="observer"), 1e-2),
    "rigid, free": (rigid(**_FREE), 1e-2),
    "elastic": (elastic(**_GAUGE), 1e-2),
    # One shot in five spreads over a quarter of the force below one value that all others have.
    "elastic, slow": (elastic(**_GAUGE, motion__velocity_mm_s=[0, 0, -40]), 3e-2),
    "elastic, soft": (elastic(contact__stiffness_N_m=20e3, contact__gauge_spring_N_m=10e3), 1e-2),
    "elastic, sideways, reverse": (
        elastic(**_GAUGE, motion__velocity_mm_s=[0, 150, 0], reaction__kind="reverse"),
        1e-2,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_quantiles_are_those_of_the_integrated_distribution(name: str) -> None:
    scenario, tolerance = CASES[name]
    found, exact = shot_force(scenario), bs.evaluate(scenario).peak_force
    for p in (0.05, 0.25, 0.5, 0.75, 0.95):
        assert found.quantile(p) == pytest.approx(exact.quantile(p), rel=tolerance), p
    assert np.exp(found.log_mean) == pytest.approx(exact.mean, rel=2 * tolerance)


def test_only_what_stands_in_the_way_of_the_force_counts() -> None:
    """Neither the offset nor the start from rest: a shot is at full speed, at the place of the scenario."""
    base = shot_force(rigid(**_GAUGE)).median
    for changes in ({"motion__start": "rest"}, {"contact__offset_law": "half_normal"}, {"motion__duration_s": 0.3}):
        assert shot_force(rigid(**_GAUGE, **changes)).median == pytest.approx(base, rel=1e-12)


@pytest.mark.parametrize(
    ("less", "more"),
    [
        ({"reaction__latency_s": 0.005}, {"reaction__latency_s": 0.02}),
        ({"reaction__joint_acceleration_rad_s2": 20}, {"reaction__joint_acceleration_rad_s2": 5}),
        ({"detector__thresholds_Nm": [20, 20, 15, 6, 6, 6]}, {"detector__thresholds_Nm": [80, 80, 60, 24, 24, 24]}),
    ],
)
def test_a_worse_arm_hits_harder(less: dict[str, Any], more: dict[str, Any]) -> None:
    assert shot_force(rigid(**_GAUGE, **less)).median < shot_force(rigid(**_GAUGE, **more)).median


def test_latency_counts_between_steps() -> None:
    """A latency of part of a step is not rounded: the peak force grows evenly."""
    forces = [shot_force(rigid(**_GAUGE), 0.0100 + 2.5e-4 * k).median for k in range(5)]
    steps = np.diff(forces)
    assert (steps > 0).all()
    assert steps.max() < 1.5 * steps.min()


def test_never_detected() -> None:
    with pytest.raises(InputError, match=r"detector.thresholds_Nm: 100 % of the shots are never detected"):
        shot_force(rigid(**_GAUGE, detector__thresholds_Nm=[1e6] * 6, motion__velocity_mm_s=[0, 0, -5]))
