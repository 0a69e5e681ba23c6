"""Curves of equal risk, and the guide to the cheapest values that meet the limits."""

from __future__ import annotations

import itertools
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.study import run
from bumpstop.study.parameters.equal_risk import allowed_force
from bumpstop.study.parameters.parameters import ParameterStudy
from bumpstop.study.requirement.design_guide import min_cost
from bumpstop.study.requirement.requirement import solve_requirement
from bumpstop.study.variable import Variable
from collision.cases import control_group, ur10e

PAIR = ("motion.speed=20:80:5", "reaction.joint_acceleration_rad_s2=3:18:5")


@pytest.fixture(scope="module")
def rates() -> tuple[bs.Scenario, dict[str, Any]]:
    """A collision over its limit, with costs for slower and for stopping harder."""
    scenario = control_group(motion__velocity_mm_s=[0.0, 0.0, -80.0], contact__area_cm2=2.0)
    study = ParameterStudy.of(
        scenario,
        vary=[*PAIR, "detector.feedback_period_s=0.003:0.004"],
        pairs=["motion.speed,reaction.joint_acceleration_rad_s2"],
        cost_rates=["motion.speed=1", "reaction.joint_acceleration_rad_s2=4", "detector.feedback_period_s=3000"],
    )
    return scenario, run(study, threads=2).summary


def test_printed_values_meet_the_limits(rates: Any) -> None:
    """They are typed into a scenario from the terminal or the page: the digits shown must be enough."""
    scenario, summary = rates
    plans = [plan for plan in (summary["guide"]["combined"], *summary["guide"]["single_change"].values()) if plan]
    assert len(plans) >= 3
    for plan in plans:
        typed = {key: float(f"{value:.6g}") for key, value in plan["values"].items()}
        assert typed == plan["values"]
        there = scenario
        for key, value in typed.items():
            there = Variable(key).apply(there, value)
        assert bs.evaluate(there).verdict.acceptable


def _check_curves(scenario: bs.Scenario, pair: dict[str, Any]) -> int:
    """Distributions of points of all curves have their risk, and nowhere more; the number of points."""
    seen = 0
    for curve in pair["curves"]:
        for line in curve["lines"]:
            for values in line[:: max(1, len(line) // 6)]:
                there = scenario
                for key, value in zip(pair["keys"], values, strict=True):
                    variable = Variable(key)
                    assert value == variable.quantised(scenario, value)
                    there = variable.apply(there, value)
                result = bs.evaluate(there)
                allowed = allowed_force(result.problem)
                assert (1 - 2e-4) * allowed <= result.peak_force.quantile(1 - curve["risk"]) <= (1 + 1e-9) * allowed
                over = max(result.verdict.p_over_force or 0.0, result.verdict.p_over_pressure or 0.0)
                assert 0.97 * curve["risk"] <= over <= (1 + 1e-6) * curve["risk"]
                seen += 1
    return seen


def test_along_a_curve_of_equal_risk_the_risk_is_equal(rates: Any) -> None:
    scenario, summary = rates
    (pair,) = summary["equal_risk"]
    assert len(pair["curves"]) == 4
    assert _check_curves(scenario, pair) >= 20


@pytest.mark.parametrize(
    ("scenario", "ranges"),
    [
        # Three rows a side, of which straight lines are off by a tenth of the force, and whole steps.
        (
            ur10e(reaction__kind="stop", reaction__latency_s=0.006, motion__velocity_mm_s=[80.0, 40.0, -80.0]),
            ("detector.feedback_period_s=0.001:0.009:3", "contact.area_cm2=0.5:4:3"),
        ),
        # Some of the rows have a force without bound.
        (
            control_group(contact__area_cm2=2.0, motion__velocity_mm_s=[15.0, -10.0, -40.0]),
            ("motion.speed=20:80:7", "detector.thresholds=5:600:7:log"),
        ),
    ],
)
def test_curves_of_equal_risk_are_no_coarser_than_distributions(scenario: bs.Scenario, ranges: tuple[str, str]) -> None:
    keys = [text.partition("=")[0] for text in ranges]
    study = ParameterStudy.of(scenario, vary=list(ranges), pairs=[",".join(keys)])
    (pair,) = run(study).summary["equal_risk"]
    assert pair["keys"] == keys
    assert _check_curves(scenario, pair) >= 8


def test_the_guide_meets_the_limits_at_the_least_cost_of_a_grid(rates: Any) -> None:
    scenario, summary = rates
    guide = summary["guide"]
    design = guide["combined"]
    assert not guide["now"]["meets"]
    assert design["meets"]
    assert (
        design["cost"]
        <= min(single_change["cost"] for single_change in guide["single_change"].values() if single_change) + 1e-9
    )

    def acceptable(speed: float, acceleration: float, period: float) -> bool:
        changes = {
            "motion.velocity_mm_s": [0.0, 0.0, -speed],
            "reaction.joint_acceleration_rad_s2": acceleration,
            "detector.feedback_period_s": period,
        }
        return bool(bs.evaluate(scenario.with_values(changes)).verdict.acceptable)

    best = design["values"]
    at = best["motion.speed"], best["reaction.joint_acceleration_rad_s2"], best["detector.feedback_period_s"]
    assert acceptable(*at)
    for speed, acceleration, period in itertools.product(
        np.linspace(50, 80, 4), np.linspace(4.5, 12, 4), (0.003, 0.004)
    ):
        cost = (80 - speed) + 4 * (acceleration - 4.5) + 3000 * (0.004 - period)
        if cost < 0.99 * design["cost"]:
            assert not acceptable(speed, acceleration, period), "a cheaper plan was overlooked"


# A threshold is to be low for the force and high for false alarms: at either end of these ranges one of the two is
# missed. And far too high a threshold hides that a lower speed would help.
TWO_SIDED = {
    "too high": (
        {"motion__velocity_mm_s": [0.0, 0.0, -60.0], "contact__area_cm2": 2.0},
        {"detector.thresholds": (4.0, 10.0)},
    ),
    "too low": (
        {"detector__thresholds_Nm": [12.0, 6.0, 12.0, 12.0, 12.0, 12.0, 12.0], "contact__area_cm2": 2.0},
        {"detector.thresholds": (4.0, 30.0)},
    ),
    "undetecting": (
        {
            "motion__velocity_mm_s": [0.0, 0.0, -100.0],
            "detector__thresholds_Nm": [2000.0] * 7,
            "contact__area_cm2": 2.0,
        },
        {"motion.speed": (20.0, 100.0), "detector.thresholds": (8.0, 2000.0)},
    ),
}


@pytest.mark.parametrize("name", TWO_SIDED)
def test_the_guide_finds_what_meets_limits_and_false_alarms_at_once(name: str) -> None:
    changes, ends = TWO_SIDED[name]
    scenario = control_group(**changes)
    study = ParameterStudy.of(
        scenario,
        vary=[f"{key}={low}:{high}:2" for key, (low, high) in ends.items()],
        cost_rates=[f"{key}=1" for key in ends],
    )
    guide = run(study).summary["guide"]
    assert guide["combined"] is not None, guide["reason"]
    start, best = guide["now"]["values"], guide["combined"]["values"]

    def acceptable(values: dict[str, float]) -> bool:
        here = scenario
        for key, value in values.items():
            here = Variable(key).apply(here, value)
        return bool(bs.evaluate(here).verdict.acceptable)

    assert acceptable(best)
    # All values somewhat nearer to the present ones, in steps of a twentieth of what is changed or of the best value.
    nearer = [
        best[key] + (start[key] - best[key]) * np.linspace(0, min(1, best[key] / abs(start[key] - best[key])), 21)
        for key in ends
    ]
    for values in itertools.product(*nearer):
        cost = sum(abs(value - start[key]) for key, value in zip(ends, values, strict=True))
        if cost < guide["combined"]["cost"] * (1 - 1e-4):
            assert not acceptable(dict(zip(ends, values, strict=True))), "a cheaper plan was overlooked"


def test_the_guide_does_not_stay_beside_the_cheapest_single_change() -> None:
    """Softer padding alone is enough; a larger area and a harder stop together are a sixth cheaper."""
    scenario = control_group(
        motion__velocity_mm_s=[0.0, 0.0, -79.0],
        contact__area_cm2=2.0,
        contact__padding_N_m=240e3,
        reaction__latency_s=0.009,
    )
    cost_rates = {"contact.padding": 1.64e-6, "reaction.joint_acceleration_rad_s2": 0.0364, "contact.area_cm2": 0.171}
    ranges = ["contact.padding=24e3:240e3", "reaction.joint_acceleration_rad_s2=3.6:22.5", "contact.area_cm2=2:4"]
    study = ParameterStudy.of(
        scenario, ranges, cost_rates=[f"{key}={cost_rate}" for key, cost_rate in cost_rates.items()]
    )
    design = min_cost(scenario, study.cost_rates).combined
    assert design is not None
    other = {"reaction.joint_acceleration_rad_s2": 10.5, "contact.area_cm2": 2.25}
    assert bs.evaluate(scenario.with_values(other)).verdict.acceptable
    assert design.cost <= sum(cost_rates[key] * (value - Variable(key).value(scenario)) for key, value in other.items())


def test_the_guide_changes_nothing_needlessly() -> None:
    """A search left a threshold of 9.99999 Nm in the place of 10."""
    path = "examples/02_lower_arm_downward.toml"
    more = {"motion.velocity_mm_s": [0, 0, -95], "reaction.latency_s": 0.012, "contact.offset_law": "uniform"}
    scenario = bs.load_scenario(path, more | {"detector.residual": "observer"})
    vary = ["motion.speed=20:100:9", "detector.thresholds=5:15:9"]
    study = ParameterStudy.of(scenario, vary, None, ["motion.speed=1", "detector.thresholds=5"])
    guide = min_cost(scenario, study.cost_rates)
    alone = guide.single_change["motion.speed"]
    assert guide.combined is not None
    assert alone is not None
    assert guide.combined.values == alone.values
    assert guide.combined.values["detector.thresholds"] == 10.0
    assert guide.combined.meets


def test_one_key_of_many_whole_steps_has_a_cheapest_one() -> None:
    scenario = control_group(contact__area_cm2=2.0, reaction__latency_s=0.1)
    study = ParameterStudy.of(scenario, ["reaction.latency_s=0:0.1"], cost_rates=["reaction.latency_s=100"])
    design = min_cost(scenario, study.cost_rates).combined
    assert design is not None
    longest = design.values["reaction.latency_s"]
    for latency, meets in ((longest, True), (longest + scenario.simulation.step_s, False)):
        assert bs.evaluate(scenario.with_values({"reaction.latency_s": latency})).verdict.acceptable == meets


def test_too_many_whole_steps_are_refused_before_the_first_law() -> None:
    scenario = control_group(contact__area_cm2=2.0, reaction__latency_s=0.1)
    cost_rates = ["reaction.latency_s=100", "motion.speed=1"]
    with pytest.raises(bs.InputError, match=r"--cost: 101 combinations of whole steps.*wanted at most 64"):
        ParameterStudy.of(scenario, ["reaction.latency_s=0:0.1", "motion.speed=30:50"], cost_rates=cost_rates)


def test_no_arm_is_slowed_until_it_does_not_arrive() -> None:
    """In 0.4 s an arm slower than 75 mm/s does not get to a body 30 mm away, which makes it no safer to meet."""
    scenario = control_group(
        motion__velocity_mm_s=[0.0, 0.0, -80.0],
        motion__duration_s=0.4,
        contact__offset_law="fixed",
        contact__offset_mm=30.0,
        contact__area_cm2=2.0,
    )
    study = ParameterStudy.of(scenario, vary=["motion.speed=20:80:4"], cost_rates=["motion.speed=1"])
    rows, summary = run(study)
    assert rows["no_contact"].max() == 0
    least_conservative = solve_requirement(scenario, "motion.speed").value
    assert least_conservative is not None
    assert least_conservative < 70
    # Against a body at a fixed distance the risk has a sampling ripple: the guide may stop at a crest that is a little
    # higher.
    assert summary["guide"]["combined"]["values"]["motion.speed"] == pytest.approx(least_conservative, rel=0.03)


def test_a_guide_that_finds_nothing_says_why() -> None:
    scenario = control_group(motion__velocity_mm_s=[0.0, 0.0, -100.0])
    study = ParameterStudy.of(scenario, vary=["motion.speed=90:100:2"], cost_rates=["motion.speed=1"])
    guide = run(study).summary["guide"]
    assert guide["combined"] is None
    assert guide["single_change"] == {"motion.speed": None}
    assert "No design in these ranges is enough" in guide["reason"]


@pytest.mark.parametrize(
    ("vary", "more", "problem"),
    [
        (["motion.speed=10:20", "motion.speed=20:30"], {}, "names 'motion.speed' twice"),
        (["contact.padding=1e3:1e4"], {}, "'contact.padding' has no value in the scenario"),
        (["motion.speed=10:20"], {"pairs": ["motion.speed"]}, "KEY,KEY"),
        (
            ["motion.speed=10:20", "contact.area_cm2=1:2"],
            {"pairs": ["motion.speed,contact.area_cm2", "motion.speed, contact.area_cm2"]},
            "twice",
        ),
        (["motion.speed=10:20"], {"pairs": ["motion.speed,contact.area_cm2"]}, "is not varied"),
        (["motion.speed=10:20"], {"cost_rates": ["motion.speed=-1"]}, "is no cost"),
        (["motion.speed=10:20"], {"cost_rates": ["motion.speed"]}, "is no cost"),
        (["motion.speed=10:20"], {"cost_rates": ["motion.speed=1", "motion.speed=2"]}, "names 'motion.speed' twice"),
        (["motion.speed=10:20"], {"cost_rates": ["contact.area_cm2=1"]}, "is not varied"),
    ],
)
def test_bad_pairs_and_cost_rates_are_refused(vary: list[str], more: dict[str, Any], problem: str) -> None:
    with pytest.raises(bs.InputError, match=problem):
        ParameterStudy.of(control_group(), vary=vary, **more)


def test_without_limits_there_is_nothing_to_guide_to() -> None:
    data = control_group(contact__stiffness_N_m=5600.0).to_dict()
    del data["contact"]["body"]
    scenario = bs.Scenario.from_dict(data)
    with pytest.raises(bs.InputError, match=r"contact\.body"):
        ParameterStudy.of(scenario, vary=["motion.speed=10:20"], cost_rates=["motion.speed=1"])
    rows, _ = run(ParameterStudy.of(scenario, vary=["motion.speed=10:20:3"]))
    assert rows["p_over_force"].null_count() == rows.height
