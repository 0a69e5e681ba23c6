"""The parameter study: planted laws, the source's relationships, derivatives, equal risk and the guide."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop.study import run
from bumpstop.study.equal_risk import allowed_force
from bumpstop.study.fits import R2_WANTED, fit_laws
from bumpstop.study.parameters import SOURCE, ParameterStudy
from collision.cases import control_group


@pytest.mark.parametrize(
    ("name", "parameters"),
    [
        ("linear", (3.0, -0.2)),
        ("quadratic", (17.0, 0.07, 0.0013)),
        ("power", (0.4, 1.3)),
        ("power", (44.0, 0.105)),
        ("constant plus power", (20.6, 17.0, -0.998)),
        ("constant plus power", (2.0, 0.3, 2.5)),
    ],
)
def test_a_planted_law_is_found_again(name: str, parameters: tuple[float, ...]) -> None:
    x = np.linspace(2.0, 30.0, 15)
    a, b, c = (*parameters, 0.0)[:3]
    y = {
        "linear": a + b * x,
        "quadratic": a + b * x + c * x**2,
        "power": a * x**b,
        "constant plus power": a + b * x**c,
    }[name]
    fit = next(fit for fit in fit_laws(x, y) if fit.name == name)
    assert fit.parameters == pytest.approx(parameters, rel=1e-5)
    assert fit.r2 == pytest.approx(1.0, abs=1e-9)
    assert fit.fitted == pytest.approx(y, rel=1e-6)


def test_too_few_points_and_negative_values_get_only_the_laws_they_allow() -> None:
    assert [fit.name for fit in fit_laws(np.array([1.0, 2.0, 3.0]), np.array([1.0, 2.0, 2.5]))] == ["linear", "power"]
    names = [fit.name for fit in fit_laws(np.linspace(-2, 2, 9), np.linspace(1, 3, 9) ** 2)]
    assert names == ["linear", "quadratic"]


@pytest.fixture(scope="module")
def control() -> tuple[bs.Scenario, pl.DataFrame, dict[str, Any]]:
    """The source's five parameters about its control group (table 5.2)."""
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
        law = bs.evaluate(scenario.with_values({"motion.velocity_mm_s": [0, 0, -row["value"]]}))
        assert row["mean_N"] == law.peak_force.mean
        assert row["p999_N"] == law.peak_force.quantile(0.999)
        assert row["p_over_force"] == law.verdict.p_over_force


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


PAIR = ("motion.speed=20:80:5", "reaction.joint_acceleration_rad_s2=3:18:5")


@pytest.fixture(scope="module")
def priced() -> tuple[bs.Scenario, dict[str, Any]]:
    """A collision over its limit, with prices for slower and for stopping harder."""
    scenario = control_group(motion__velocity_mm_s=[0.0, 0.0, -80.0], contact__area_cm2=2.0)
    study = ParameterStudy.of(
        scenario,
        vary=[*PAIR, "detector.feedback_period_s=0.003:0.004"],
        pairs=["motion.speed,reaction.joint_acceleration_rad_s2"],
        prices=["motion.speed=1", "reaction.joint_acceleration_rad_s2=4", "detector.feedback_period_s=3000"],
    )
    return scenario, run(study, threads=2)[1]


def test_along_a_curve_of_equal_risk_the_risk_is_equal(priced: Any) -> None:
    scenario, summary = priced
    (pair,) = summary["equal_risk"]
    seen = 0
    for curve in pair["curves"]:
        for line in curve["lines"]:
            for speed, acceleration in line[5 :: len(line) // 3]:
                there = scenario.with_values(
                    {
                        "motion.velocity_mm_s": [0.0, 0.0, -speed],
                        "reaction.joint_acceleration_rad_s2": acceleration,
                    }
                )
                law = bs.evaluate(there)
                # A spline through five points a side of a surface that bends by a few tens of per cent between them.
                assert law.peak_force.quantile(1 - curve["risk"]) == pytest.approx(allowed_force(law.problem), rel=0.02)
                seen += 1
    assert seen >= 8


def test_the_guide_meets_the_limits_at_the_least_cost_of_a_grid(priced: Any) -> None:
    scenario, summary = priced
    guide = summary["guide"]
    plan = guide["together"]
    assert not guide["now"]["meets"]
    assert plan["meets"]
    assert plan["cost"] <= min(alone["cost"] for alone in guide["alone"].values() if alone) + 1e-9

    def acceptable(speed: float, acceleration: float, period: float) -> bool:
        changes = {
            "motion.velocity_mm_s": [0.0, 0.0, -speed],
            "reaction.joint_acceleration_rad_s2": acceleration,
            "detector.feedback_period_s": period,
        }
        return bool(bs.evaluate(scenario.with_values(changes)).verdict.acceptable)

    best = plan["values"]
    at = best["motion.speed"], best["reaction.joint_acceleration_rad_s2"], best["detector.feedback_period_s"]
    assert acceptable(*at)
    for speed, acceleration, period in itertools.product(
        np.linspace(50, 80, 4), np.linspace(4.5, 12, 4), (0.003, 0.004)
    ):
        cost = (80 - speed) + 4 * (acceleration - 4.5) + 3000 * (0.004 - period)
        if cost < 0.99 * plan["cost"]:
            assert not acceptable(speed, acceleration, period), "a cheaper plan was overlooked"


def test_a_value_that_has_no_law_is_named() -> None:
    study = ParameterStudy.of(control_group(), vary=["pose_deg[2]=-100:100:3"])
    with pytest.raises(bs.InputError, match=r"^pose_deg: with pose_deg\[2\] = 0: is singular"):
        run(study)


def test_a_key_that_changes_nothing_has_no_law() -> None:
    study = ParameterStudy.of(control_group(), vary=["verdict.risk=0.1:0.9:4"])
    (found,) = run(study)[1]["parameters"]
    assert found["fits"] == []
    assert found["direction"] == "neither"
    assert found["derivative"]["mean"] == 0


def test_a_guide_that_finds_nothing_says_why() -> None:
    scenario = control_group(motion__velocity_mm_s=[0.0, 0.0, -100.0])
    study = ParameterStudy.of(scenario, vary=["motion.speed=90:100:2"], prices=["motion.speed=1"])
    guide = run(study)[1]["guide"]
    assert guide["together"] is None
    assert guide["alone"] == {"motion.speed": None}
    assert "Nothing in these ranges is enough" in guide["reason"]


@pytest.mark.parametrize(
    ("vary", "more", "problem"),
    [
        (["motion.speed=10:20", "motion.speed=20:30"], {}, "names 'motion.speed' twice"),
        (["contact.padding=1e3:1e4"], {}, "'contact.padding' has no value in the scenario"),
        (["motion.speed=10:20"], {"pairs": ["motion.speed"]}, "KEY,KEY"),
        (["motion.speed=10:20"], {"pairs": ["motion.speed,contact.area_cm2"]}, "is not varied"),
        (["motion.speed=10:20"], {"prices": ["motion.speed=-1"]}, "is no price"),
        (["motion.speed=10:20"], {"prices": ["motion.speed"]}, "is no price"),
        (["motion.speed=10:20"], {"prices": ["contact.area_cm2=1"]}, "is not varied"),
    ],
)
def test_bad_pairs_and_prices_are_refused(vary: list[str], more: dict[str, Any], problem: str) -> None:
    with pytest.raises(bs.InputError, match=problem):
        ParameterStudy.of(control_group(), vary=vary, **more)


def test_without_limits_there_is_nothing_to_guide_to() -> None:
    data = control_group(contact__stiffness_N_m=5600.0).to_dict()
    del data["contact"]["body"]
    scenario = bs.Scenario.from_dict(data)
    with pytest.raises(bs.InputError, match=r"contact\.body"):
        ParameterStudy.of(scenario, vary=["motion.speed=10:20"], prices=["motion.speed=1"])
    rows, _ = run(ParameterStudy.of(scenario, vary=["motion.speed=10:20:3"]))
    assert rows["p_over_force"].null_count() == rows.height


def test_what_is_wrong_without_any_change_is_told_before_any_work() -> None:
    scenario = control_group()
    wrong = scenario.model_copy(update={"contact": scenario.contact.model_copy(update={"body": "hand_back"})})
    with pytest.raises(bs.InputError) as refused:
        ParameterStudy.of(wrong, vary=["reaction.latency_s=0:0.02:3"])
    assert "with " not in refused.value.problem
