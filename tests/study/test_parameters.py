"""The parameter study: rows, Schroeder's relationships, derivatives, and what is refused."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop.report.studies.parameters import pages_of
from bumpstop.study import run
from bumpstop.study.parameters.fits import R2_WANTED
from bumpstop.study.parameters.parameters import SOURCE, ParameterStudy, _difference
from collision.cases import control_group, ur10e


@pytest.fixture(scope="module")
def control() -> tuple[bs.Scenario, pl.DataFrame, dict[str, Any]]:
    """Schroeder's five parameters about its control group (table 5.2)."""
    scenario = control_group(contact__stiffness_N_m=5600.0)
    rows, summary = run(ParameterStudy.of(scenario), threads=2)
    return scenario, rows, summary


def test_the_relationships_of_table_5_3(control: Any) -> None:
    _, _, summary = control
    directions = {each["key"]: each["direction"] for each in summary["parameters"]}
    assert set(directions) == set(SOURCE)
    assert directions.pop("reaction.joint_acceleration_rad_s2") == "down"
    assert set(directions.values()) == {"up"}
    for each in summary["parameters"]:
        r2 = {fit["name"]: fit["r2"] for fit in each["fits"]}
        assert each["source_law"] == SOURCE[each["key"]][0]
        if each["key"] == "reaction.joint_acceleration_rad_s2":
            # Force at detection plus a part that falls with one over the acceleration.
            assert each["better_law"] == "constant plus power"
            assert r2["power"] < R2_WANTED < r2["constant plus power"]
        else:
            assert r2[each["source_law"]] >= R2_WANTED
            assert each["better_law"] is None


def test_rows_are_the_laws_of_their_scenarios(control: Any) -> None:
    scenario, rows, _ = control
    sweep = rows.filter((rows["kind"] == "sweep") & (rows["key"] == "motion.speed"))
    assert sweep.height == 20
    for row in sweep[::7].iter_rows(named=True):
        result = bs.evaluate(scenario.with_values({"motion.velocity_mm_s": [0, 0, -row["value"]]}))
        assert row["mean_N"] == result.peak_force.mean
        assert row["p999_N"] == result.peak_force.quantile(0.999)
        assert row["p_over_force"] == result.verdict.p_over_force


def test_derivatives_agree_with_differences_of_another_width(control: Any) -> None:
    scenario, _, summary = control

    def mean(**changes: Any) -> float:
        return bs.evaluate(
            scenario.with_values({key.replace("__", "."): v for key, v in changes.items()})
        ).peak_force.mean

    wanted = {
        "contact.stiffness": (mean(contact__stiffness_N_m=5630.0) - mean(contact__stiffness_N_m=5570.0)) / 60,
        "motion.speed": (mean(motion__velocity_mm_s=[0, 0, -50.3]) - mean(motion__velocity_mm_s=[0, 0, -49.7])) / 0.6,
        # A quantised key: across one whole step on either side.
        "detector.feedback_period_s": (
            mean(detector__feedback_period_s=0.005) - mean(detector__feedback_period_s=0.003)
        )
        / 0.002,
    }
    found = {each["key"]: each["derivative"] for each in summary["parameters"]}
    for key, slope in wanted.items():
        # Both differences are second order; a width of a per cent leaves far less than a hundredth.
        assert found[key]["mean"] == pytest.approx(slope, rel=5e-3)
    assert found["detector.feedback_period_s"]["mean"] == pytest.approx(wanted["detector.feedback_period_s"], rel=1e-9)
    assert found["detector.feedback_period_s"]["quantised"]


def _mean(scenario: bs.Scenario, **changes: Any) -> float:
    return bs.evaluate(scenario.with_values({key.replace("__", "."): v for key, v in changes.items()})).peak_force.mean


def _derivative(scenario: bs.Scenario, vary: str) -> dict[str, Any]:
    (found,) = run(ParameterStudy.of(scenario, vary=[vary])).summary["parameters"]
    return {**found["derivative"], "control": found["control"]}


def test_at_the_end_of_what_a_key_takes_the_slope_is_no_secant() -> None:
    # Damping enters by its square, so that at 0 nothing depends on it; a secant says -0.3 N.
    damping = _derivative(control_group(), "motion.damping=0:0.02:3")
    assert abs(damping["mean"]) < 1e-3
    assert damping["error"] > 10 * abs(damping["mean"])
    # A body that touches, within the way to the first tick: the same slope as from closer by.
    touching = control_group(contact__offset_law="fixed", contact__offset_mm=0.0)
    found = _derivative(touching, "contact.offset_mm=0:0.2:3")
    near, nearer = ((_mean(touching, contact__offset_mm=h) - _mean(touching)) / h for h in (2e-3, 1e-3))
    assert found["mean"] == pytest.approx(2 * nearer - near, rel=2e-3)


def test_a_slope_with_one_point_missing_is_that_of_the_others() -> None:
    h = np.array([-0.5, 0.0, 0.5, 1.0])
    slope, error = _difference(h, 2.0 + 3.0 * h - 0.7 * h**2 + 0.4 * h**3)
    assert slope == pytest.approx(3.0, rel=1e-12)
    # Without the cubic the three nearest points are off by 0.4 h^2.
    assert error == pytest.approx(0.4 * 0.5**2, rel=1e-9)


def test_a_latency_between_steps_is_that_of_the_law() -> None:
    # 6.2 ms are rounded up to 7 ms, which is where the slope, and its share of the force, are wanted.
    scenario = control_group(reaction__latency_s=0.0062)
    found = _derivative(scenario, "reaction.latency_s=0:0.01:3")
    slope = (_mean(scenario, reaction__latency_s=0.008) - _mean(scenario, reaction__latency_s=0.006)) / 0.002
    assert found["control"] == 0.007
    assert found["mean"] == pytest.approx(slope, rel=1e-9)
    assert found["elasticity"] == pytest.approx(slope * 0.007 / _mean(scenario), rel=1e-9)


# Four keys of two arms that reverse or stop, obliquely, by other offset laws.
SLOPES = [
    (
        control_group(motion__velocity_mm_s=[20.0, -15.0, -45.0], reaction__kind="stop", reaction__latency_s=0.012),
        ["detector.thresholds_Nm[2]=5:15", "detector.noise_sd_Nm=0.5:3", "reaction.latency_s=0.002:0.02"],
    ),
    (
        control_group(contact__offset_law="uniform", motion__damping=0.02, motion__velocity_mm_s=[0.0, 30.0, -30.0]),
        ["detector.thresholds=5:15", "motion.damping=0.01:0.1"],
    ),
    (
        control_group(detector__noise_correlation=0.6, detector__residual="observer"),
        ["detector.observer_gain_1_s=20:100", "detector.noise_correlation=0.2:0.8", "contact.offset_sd_s=0.05:0.2"],
    ),
]


@pytest.mark.parametrize(("scenario", "keys"), SLOPES)
def test_slopes_are_those_of_laws_much_closer_together(scenario: bs.Scenario, keys: list[str]) -> None:
    study = ParameterStudy.of(scenario, vary=[f"{key}:2" for key in keys])
    for each in run(study).summary["parameters"]:
        name, here = each["key"], each["control"]
        step = 0.001 if each["derivative"]["quantised"] else 1e-3 * here
        item = name.partition("[")[2]

        def mean(value: float, name: str = name, here: float = here, item: str = item) -> float:
            key = {"detector.thresholds": "detector.thresholds_Nm"}.get(name, name.partition("[")[0])
            own: Any = scenario.to_dict()[key.partition(".")[0]][key.partition(".")[2]]
            if item:
                own[int(item[:-1]) - 1] = value
            else:
                own = [x * value / here for x in own] if isinstance(own, list) else value
            return bs.evaluate(scenario.with_values({key: own})).peak_force.mean

        slope = (mean(here + step) - mean(here - step)) / (2 * step)
        assert each["derivative"]["mean"] == pytest.approx(slope, rel=5e-3), name


@pytest.mark.parametrize("offset_law", ["uniform", "half_normal"])
@pytest.mark.parametrize("kind", ["stop", "reverse"])
@pytest.mark.parametrize("arm", [control_group, ur10e])
def test_where_the_force_has_corners_the_slope_is_that_of_its_trend_within_the_error(
    arm: Callable[..., bs.Scenario], kind: str, offset_law: str
) -> None:
    """An arm comes to rest at the end of a step: between two corners the slope is off by up to some per cent."""
    scenario = arm(reaction__kind=kind, contact__offset_law=offset_law)
    speed = np.array(scenario.motion.velocity_mm_s)
    acceleration = scenario.reaction.joint_acceleration_rad_s2
    assert not isinstance(acceleration, list)
    share = np.linspace(-0.08, 0.08, 33)
    trends = {
        "motion.speed": [_mean(scenario, motion__velocity_mm_s=(speed * (1 + x)).tolist()) for x in share],
        "reaction.joint_acceleration_rad_s2": [
            _mean(scenario, reaction__joint_acceleration_rad_s2=acceleration * (1 + x)) for x in share
        ],
    }
    for key, forces in trends.items():
        found = _derivative(scenario, f"{key}=5:150:3")
        slope = np.polynomial.polynomial.polyfit(share, forces, 3)[1] / found["control"]
        assert found["mean"] == pytest.approx(slope, rel=4e-3), key
        assert abs(found["mean"] - slope) < found["error"], key


def test_a_value_that_has_no_law_is_named() -> None:
    study = ParameterStudy.of(control_group(), vary=["pose_deg[2]=-100:100:3"])
    with pytest.raises(bs.InputError, match=r"^pose_deg: with pose_deg\[2\] = 0: is singular"):
        run(study)


def test_a_key_that_changes_nothing_has_no_law() -> None:
    study = ParameterStudy.of(control_group(), vary=["verdict.accepted_probability=0.1:0.9:4"])
    (found,) = run(study).summary["parameters"]
    assert found["fits"] == []
    assert found["direction"] == "neither"
    assert found["derivative"]["mean"] == 0


def test_what_is_wrong_without_any_change_is_told_before_any_work() -> None:
    scenario = control_group()
    wrong = scenario.model_copy(update={"contact": scenario.contact.model_copy(update={"body": "hand_back"})})
    with pytest.raises(bs.InputError) as refused:
        ParameterStudy.of(wrong, vary=["reaction.latency_s=0:0.02:3"])
    assert "with " not in refused.value.problem


def test_a_value_outside_its_range_is_told() -> None:
    """A gauge of 75000 N/m was varied from 1400 to 21000 without a word."""
    scenario = control_group(contact__stiffness_N_m=75000.0)
    study = ParameterStudy.of(scenario, ["contact.stiffness=1400:21000:4", "motion.speed=10:200:4"])
    rows, summary = run(study)
    (told,) = [line for line in study.lines(summary) if "outside" in line]
    words = "the scenario's own contact.stiffness, 75000 N/m, lies outside 1400 to 21000: vary it about its value with"
    assert told.strip() == f"{words} --vary contact.stiffness=LOW:HIGH"
    _, parts, _ = pages_of(study, rows, summary)
    page = "".join(str(html) for part in parts for html in part.content())
    assert "own contact.stiffness, 75000 N/m, lies outside" in page
    assert "own motion.speed" not in page
