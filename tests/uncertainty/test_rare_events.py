"""Importance sampling against the integrated distribution, sampled collisions and quadrature."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from scipy.special import ndtr

import bumpstop as bs
from bumpstop.detection.tuning.residual_record import write_residuals
from bumpstop.uncertainty import overall_probability, rare_exceedance
from bumpstop.uncertainty.point_evaluation import PointEvaluator
from collision.cases import control_group


@pytest.mark.parametrize(
    "changes",
    [
        {},
        {"detector__noise_correlation": 0.5},
        {"detector__residual": "observer", "detector__noise_correlation": 0.6},
        {"contact__offset_law": "uniform", "reaction__kind": "stop", "detector__noise_correlation": 0.3},
        {"motion__duration_s": 0.2, "detector__arming_delay_s": 0.03},
    ],
    ids=["white", "correlated", "observer", "uniform gap", "never detected"],
)
def test_far_out_it_is_the_integrated_distribution(changes: dict[str, object]) -> None:
    scenario = control_group(**changes)
    law = bs.evaluate(scenario).peak_force
    force = law.quantile(1 - 1e-6)
    if not np.isfinite(force):
        force = law.quantile(0.8)
    exact = law.exceedance(force)
    found = rare_exceedance(scenario, force, runs=3000, seed=8)
    assert found.relative_error < 0.2
    assert abs(found.probability - exact) < 4 * found.standard_error + 1e-3 * exact


def test_measured_residuals(tmp_path: Path) -> None:
    """Against counts of drawn collisions, and far beyond what they reach."""
    rng = np.random.default_rng(6)
    rows = np.array([20, 10, 20, 20, 20, 20, 20]) / 4.0 * rng.standard_normal((2000, 7))
    write_residuals(tmp_path / "noise.parquet", 0.004 * np.arange(len(rows)), rows)
    data = control_group(detector__residuals="noise.parquet").to_dict()
    data["detector"].pop("noise_sd_Nm", None)
    scenario = bs.Scenario.from_dict(data, tmp_path)
    counted = bs.evaluate(scenario, samples=200_000, seed=2)
    for p in (0.3, 3e-3):
        force = counted.peak_force.quantile(1 - p)
        share = counted.peak_force.exceedance(force)
        found = rare_exceedance(scenario, force, runs=200, seed=1)
        error = np.hypot(found.standard_error, np.sqrt(share * (1 - share) / 200_000))
        assert abs(found.probability - share) < 4 * error
    far = rare_exceedance(scenario, 1.005 * counted.peak_force.quantile(1 - 1e-5), runs=200, seed=1)
    assert 0 < far.probability < 3e-5


def test_over_the_inputs() -> None:
    """One input: the probability over the limits is an integral over its normal score."""
    table = {"contact.stiffness_N_m": {"distribution": "lognormal", "sigma": 0.1}}
    scenario = control_group(contact__area_cm2=2.0, motion__velocity_mm_s=[0, 0, -47.7], uncertainty=table)
    evaluator = PointEvaluator(scenario, far_tails=True)
    z = np.linspace(-4, 9, 131)
    over = evaluator.at(evaluator.inputs[0].quantile(ndtr(z))[:, None]).p_over
    exact = np.trapezoid(over * np.exp(-z * z / 2) / np.sqrt(2 * np.pi), z)
    assert exact < 1e-5
    found = overall_probability(scenario, points=512, seed=3)
    assert found.probability == pytest.approx(exact, rel=0.05)
    assert abs(found.probability - exact) < 4 * found.standard_error


@pytest.mark.parametrize(
    ("changes", "arguments", "said"),
    [
        ({"contact__kind": "free", "contact__limits": "ts15066"}, {}, "contact.kind: 'free' is not available"),
        ({"contact__damping_Ns_m": 50.0}, {}, "contact.damping_Ns_m: 50.0 is not available: rare collisions are drawn"),
        (
            {"contact__stiffness_N_m": 75e3, "contact__gauge_spring_N_m": 75e3, "contact__gauge_mass_kg": 0.5},
            {},
            "contact.gauge_mass_kg: 0.5 is not available: rare collisions are drawn for a rigid arm on a line",
        ),
        ({}, {"force": -1.0}, "wanted a force of 0 N or more"),
        ({}, {"runs": 3}, "wanted a whole number from 100"),
    ],
)
def test_refusals(changes: dict[str, object], arguments: dict[str, float], said: str) -> None:
    with pytest.raises(bs.InputError, match=said):
        rare_exceedance(control_group(**changes), **{"force": 100.0, **arguments})  # type: ignore[arg-type]
    with pytest.raises(bs.InputError, match="no distribution"):
        overall_probability(control_group(uncertainty={"contact.area_cm2": {"interval": [0.9, 1.1]}}))


def test_trajectories_and_elastic_arms_are_refused_by_name() -> None:
    path = bs.load_scenario("examples/06_pick_and_place_trajectory.toml")
    with pytest.raises(bs.InputError, match=r"motion.kind: 'trajectory' is not available: rare collisions are drawn"):
        rare_exceedance(path, 85.0)
    elastic = bs.load_scenario("examples/05_ur10e.toml").with_values({"arm.model": "elastic"})
    with pytest.raises(bs.InputError, match=r"arm.model: 'elastic' is not available: rare collisions are drawn"):
        rare_exceedance(elastic, 85.0)
