"""Requirements against a search that tries every value, and against the distribution itself."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.cli.main import main
from bumpstop.errors import InputError
from bumpstop.study.range import Range
from bumpstop.study.requirement.requirement import HIGHER_IS_WORSE, require_curve, solve_requirement
from bumpstop.study.variable import Variable
from collision.cases import control_group, ur10e
from study.requirement_cases import over, scenario

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/02_lower_arm_downward.toml"
# Two figures of the issue: half a percent, and twice as far the requirement is no longer met.
AGREES, BEYOND = 0.005, 1.02


@pytest.mark.parametrize("vary", HIGHER_IS_WORSE)
def test_value_meets_the_risk_and_two_percent_more_does_not(vary: str) -> None:
    case = scenario(**({"detector.thresholds_Nm": [40, 40, 40, 40, 40, 40]} if vary == "contact.padding" else {}))
    found = solve_requirement(case, vary)
    assert found.value is not None
    assert found.binding in ("force", "pressure")
    assert over(case, vary, found.value) <= found.risk
    step = Variable(vary).quantum(case)
    worse = found.value * BEYOND if HIGHER_IS_WORSE[vary] else found.value / BEYOND
    assert over(case, vary, worse if step is None else found.value + step) > found.risk


def test_accelerations_by_joint_stay_in_proportion() -> None:
    """As wherever else a list is varied: the answer was of an arm whose joints are all as slow as the slowest."""
    by_joint = [20.0, 20.0, 20.0, 10.0, 20.0, 8.0]
    vary = "reaction.joint_acceleration_rad_s2"
    case = scenario(**{vary: by_joint})
    found = solve_requirement(case, vary)
    assert found.value is not None
    verdict = bs.evaluate(case.with_values({vary: [a * found.value / 8.0 for a in by_joint]})).verdict
    assert max(verdict.p_over_force, verdict.p_over_pressure or 0.0) == pytest.approx(found.risk_at_value, rel=1e-6)
    assert over(case, vary, found.value / BEYOND) > found.risk


@pytest.mark.parametrize("offset", [None, 3.0, 11.0])
def test_agrees_with_trying_every_value(offset: float | None) -> None:
    fixed = {} if offset is None else {"contact.offset_law": "fixed", "contact.offset_mm": offset}
    # Little noise, so that a fixed distance shows its crests.
    case = scenario(**fixed, **{"detector.noise_sd_Nm": 0.5, "detector.feedback_period_s": 0.008})
    found = solve_requirement(case, "motion.speed", low=40.0, high=300.0)
    assert found.value is not None
    values = 40 * (300 / 40) ** np.linspace(0, 1, 1300)
    failing = [value for value in values if over(case, "motion.speed", float(value)) > found.risk]
    assert math.isclose(found.value, failing[0], rel_tol=AGREES)


def test_quantised_values_are_safe_whole_steps() -> None:
    case = scenario()
    found = solve_requirement(case, "detector.feedback_period_s")
    steps = found.value / 0.001 if found.value else 0.0
    assert math.isclose(steps, round(steps))
    risks = [over(case, "detector.feedback_period_s", 0.001 * n) for n in range(1, round(steps) + 2)]
    assert all(risk <= found.risk for risk in risks[:-1])
    assert risks[-1] > found.risk


def test_says_why_no_value_meets_it() -> None:
    undetected_force = scenario(**{"detector.thresholds_Nm": [400.0, 400.0, 400.0, 400.0, 400.0, 400.0]})
    found = solve_requirement(undetected_force, "motion.speed")
    assert found.value is None
    assert found.risk_at_value > found.risk
    assert "stay undetected" in found.reason or "never detected" in found.reason


def test_a_small_risk_is_not_said_to_be_that_of_most_collisions() -> None:
    found = solve_requirement(scenario(), "motion.speed", risk=1e-13, low=111.0, high=300.0)
    assert found.value is None
    assert found.risk_at_value < 1e-3
    assert "most collisions" not in found.reason


def test_a_risk_that_is_not_followed_is_refused() -> None:
    with pytest.raises(bs.InputError, match=r"^risk: 1e-300 is too small"):
        solve_requirement(scenario(), "motion.speed", risk=1e-300)


def test_whole_range_may_meet_it() -> None:
    found = solve_requirement(scenario(), "motion.speed", low=5.0, high=20.0)
    assert (found.value, found.binding) == (20.0, "range")


def test_a_slow_arm_is_followed_no_longer_than_a_simulation_takes() -> None:
    """At a tenth of the speed a scenario of 400 s would take 4000 s, twice as many steps as there may be."""
    long = solve_requirement(control_group(motion__duration_s=400.0), "motion.speed")
    assert long.value == solve_requirement(control_group(), "motion.speed").value


def test_padding_is_looked_for_in_a_range_too() -> None:
    case = scenario(**{"motion.velocity_mm_s": [160.0, 80.0, -160.0]})
    anywhere = solve_requirement(case, "contact.padding")
    assert anywhere.value is not None
    assert anywhere.binding != "range"
    ends = Range.parse(f"contact.padding={anywhere.value / 3}:{anywhere.value * 3}", case)
    found = solve_requirement(case, "contact.padding", low=ends.low, high=ends.high)
    assert found.value == pytest.approx(anywhere.value, rel=AGREES)
    against = Range.parse("contact.padding=3e3:3e4:2", case)
    softer, harder = (row["value"] for row in require_curve(case, "motion.speed", against))
    assert softer > harder


def test_curve_of_equal_risk_falls_with_the_latency() -> None:
    case = scenario()
    rows = require_curve(case, "motion.speed", Range.parse("reaction.latency_s=0:0.02:3", case))
    speeds = [row["value"] for row in rows]
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[0] > speeds[-1]


# Other arms, ways, reactions and offsets, and what is traded for what.
TRADES = [
    (
        control_group(motion__velocity_mm_s=[20.0, -15.0, -45.0], reaction__kind="stop", contact__area_cm2=2.0),
        "motion.speed",
        "reaction.latency_s=0:0.02:3",
    ),
    (control_group(contact__area_cm2=2.0), "detector.thresholds", "motion.speed=20:50:3"),
    (
        control_group(contact__offset_law="uniform", contact__area_cm2=2.0, motion__damping=0.02),
        "motion.speed",
        "detector.thresholds=5:15:3",
    ),
    (
        control_group(contact__offset_law="fixed", contact__offset_mm=7.3, contact__area_cm2=2.0),
        "motion.speed",
        "contact.offset_mm=2:20:3",
    ),
    (
        ur10e(detector__residual="observer", reaction__joint_acceleration_rad_s2=[8, 10, 12, 10, 9, 11]),
        "reaction.joint_acceleration_rad_s2",
        "motion.speed=50:110:2",
    ),
    (
        ur10e(detector__noise_mean_Nm=[1, -2, 1, 0.5, 0, 0], detector__noise_correlation=0.6),
        "detector.thresholds",
        "contact.area_cm2=1:3:2",
    ),
    (ur10e(motion__velocity_mm_s=[110, 55, -80]), "contact.padding", "detector.feedback_period_s=0.002:0.008:3"),
]


@pytest.mark.parametrize(("case", "vary", "against"), TRADES)
def test_points_of_a_trade_curve_are_on_the_edge(case: bs.Scenario, vary: str, against: str) -> None:
    second = Range.parse(against, case)
    upward = HIGHER_IS_WORSE[vary]
    rows = require_curve(case, vary, second)
    assert [row["against"]["value"] for row in rows] == list(second.values)
    found = 0
    for row in rows:
        there = second.variable.apply(case, row["against"]["value"])

        def risk(value: float, there: bs.Scenario = there) -> float:
            slower = max(1.0, Variable(vary).value(there) / value) if vary == "motion.speed" else 1.0
            return over(there.with_values({"motion.duration_s": 5.0 * slower}), vary, value)

        if row["value"] is None:
            assert risk(row["low"] if upward else row["high"]) > row["risk"]
            continue
        more_conservative = np.geomspace(row["low"] if upward else row["high"], row["value"], 20)
        assert all(risk(float(value)) <= row["risk"] * (1 + 1e-6) for value in more_conservative)
        if row["binding"] == "range":
            continue
        found += 1
        # Within a tenth of a per cent; a crest of a sampling ripple may end sooner.
        beyond = row["value"] * (1 + 0.001 * np.linspace(0.1, 1, 10)) ** (1 if upward else -1)
        assert any(risk(float(value)) > row["risk"] for value in beyond)
    assert found


@pytest.mark.parametrize(
    ("changes", "arguments", "field"),
    [
        ({}, {"vary": "motion.sped"}, "vary"),
        ({}, {"vary": "contact.area_cm2"}, "vary"),
        ({}, {"vary": "motion.speed", "low": 20.0, "high": 10.0}, "vary"),
        ({}, {"vary": "motion.speed", "low": -1.0, "high": 10.0}, "vary"),
        ({}, {"vary": "motion.speed", "risk": 0.0}, "risk"),
        ({}, {"vary": "motion.speed", "risk": math.nan}, "risk"),
        ({"contact.body": None, "contact.stiffness_N_m": 1e4}, {"vary": "motion.speed"}, "contact.body"),
        ({"contact.body": "skull_forehead", "contact.kind": "free"}, {"vary": "motion.speed"}, "contact.body"),
        ({"detector.thresholds_Nm": [math.inf] * 6}, {"vary": "detector.thresholds"}, "detector.thresholds"),
    ],
)
def test_refuses_by_name(changes: dict[str, Any], arguments: dict[str, Any], field: str) -> None:
    with pytest.raises(InputError) as caught:
        solve_requirement(scenario(**changes), **arguments)
    assert caught.value.field == field


def test_an_arm_that_passes_a_singularity_meets_no_risk() -> None:
    case = bs.Scenario.from_dict(
        {
            "robot": "ur10e",
            "pose_rad": [-2.6, -5.31, 1.57, 1.78, -3.66, 5.97],
            "motion": {"velocity_mm_s": [76, -13, 32]},
            "contact": {"body": "thigh_knee", "area_cm2": 2.0},
            "detector": {"thresholds_Nm": [36, 32, 29, 22, 26, 27], "noise_sd_Nm": [7.3, 6.6, 6.0, 4.5, 5.4, 5.6]},
            "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 4.0, "latency_s": 0.01},
        }
    )
    found = solve_requirement(case, "reaction.joint_acceleration_rad_s2")
    assert found.value is None
    assert found.binding == "singularity"
    assert found.ill_conditioned
    # Beside the most conservative value the arm gets across at some, and at others it does not.
    ends = {
        bs.evaluate(Variable(found.variable).apply(case, value)).curve.end
        for value in np.linspace(0.98, 1.0, 60) * found.high
    }
    assert "singularity" in ends
    assert len(ends) > 1
    # What does not change the path does not change on which side of the singularity it ends.
    assert solve_requirement(case, "contact.padding").binding != "singularity"


def test_a_risk_that_no_value_meets_is_told_closely() -> None:
    """From rest, where risks far from the accepted one are only bounded while values are looked for."""
    changes = {
        "motion.velocity_mm_s": [0.0, 0.0, -61.66],
        "motion.start": "rest",
        "contact.area_cm2": 2.0,
        "contact.offset_law": "half_normal",
        "contact.offset_sd_s": 0.0548,
        "detector.feedback_period_s": 0.008,
        "reaction.latency_s": 0.01,
    }
    case = control_group().with_values(changes)
    found = solve_requirement(case, "reaction.joint_acceleration_rad_s2", high=45.0)
    assert found.value is None
    assert 1e-3 < found.risk_at_value < 0.1
    assert found.risk_at_value == pytest.approx(over(case, found.variable, 45.0), rel=2e-3)


def test_the_terminal_says_at_most_or_at_least(capsys: pytest.CaptureFixture[str]) -> None:
    for vary, words in (("motion.speed", "at most"), ("reaction.joint_acceleration_rad_s2", "at least")):
        with pytest.raises(SystemExit):
            main(["require", str(EXAMPLE), "--vary", vary])
        printed = capsys.readouterr().out
        assert f"{vary}: {words} " in printed
        assert ("Above " in printed) == (words == "at most")
        assert ("Below " in printed) == (words == "at least")


def test_an_acceleration_that_decides_about_no_stop_is_refused() -> None:
    timed = scenario(**{"reaction.deceleration": "constant_time", "reaction.stopping_time_s": 0.1})
    with pytest.raises(InputError, match="decides about no stop") as refused:
        solve_requirement(timed, "reaction.joint_acceleration_rad_s2")
    assert refused.value.field == "vary"


def test_the_speed_that_meets_the_limits_falls_where_the_arm_stops_in_constant_time() -> None:
    """At low speeds constant deceleration stops sooner: the same arm may go faster with it."""
    speeds = []
    for law in ({}, {"reaction.deceleration": "constant_time", "reaction.stopping_time_s": 0.12}):
        found = solve_requirement(scenario(**law), "motion.speed")
        assert found.value is not None
        speeds.append(found.value)
        assert over(scenario(**law), "motion.speed", found.value) <= found.risk
    assert speeds[1] < speeds[0]
