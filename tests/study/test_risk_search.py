"""Requirements where the risk has a sampling ripple, jumps, or is met in whole steps."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.study.requirement.requirement import HIGHER_IS_WORSE, _Answer, solve_requirement
from bumpstop.study.requirement.risk import Risk
from bumpstop.study.requirement.risk_search import RiskSearch
from bumpstop.study.requirement.sampling_ripple import force_may_fall, has_ripple, risk_may_fall
from bumpstop.study.variable import Variable
from collision.cases import control_group
from study.requirement_cases import over, random_swinging, scenario, swinging

_FIXED = {"contact.offset_law": "fixed", "contact.offset_mm": 4.0}


_SLOW_TICKS = {"detector.feedback_period_s": 0.012, "verdict.accepted_probability": 1e-9}


@pytest.mark.parametrize(
    ("vary", "changes", "high"),
    [
        # As good as a fixed distance: far less than one tick apart.
        ("motion.speed", {"contact.offset_law": "half_normal", "contact.offset_sd_s": 2e-4, **_SLOW_TICKS}, None),
        # A crest that fails at its point alone, narrower than the distance of the values looked at.
        ("motion.speed", {"contact.offset_law": "fixed", "contact.offset_mm": 11.0, **_SLOW_TICKS}, None),
        # The less conservative end itself is met, and slower ones are not.
        ("motion.speed", _FIXED | {"detector.feedback_period_s": 0.004}, 124.072),
    ],
)
def test_every_more_conservative_value_is_met_where_the_risk_has_a_ripple(
    vary: str, changes: dict[str, Any], high: float | None
) -> None:
    case = scenario(**changes)
    found = solve_requirement(case, vary, high=high)
    assert found.value is not None
    more_conservative = np.geomspace(0.5 * found.value, found.value, 60)
    assert max(over(case, vary, float(value)) for value in more_conservative) <= case.verdict.accepted_probability


def test_every_shorter_feedback_period_is_met_where_the_risk_has_a_ripple() -> None:
    """One period among the more conservative ones, 26 ms, falls on the point of a crest; its neighbours have no
    risk."""
    changes = {
        "motion.velocity_mm_s": [48.25, 24.125, -48.25],
        "contact.offset_law": "fixed",
        "contact.offset_mm": 6.18,
        "verdict.accepted_probability": 0.01,
    }
    case = scenario(**changes)
    found = solve_requirement(case, "detector.feedback_period_s")
    assert found.value is not None
    tried = {step: over(case, "detector.feedback_period_s", 1e-3 * step) for step in range(1, 51)}
    least = min(step for step, risk in tried.items() if risk > 0.01)
    assert max(tried[least - 1], tried[least + 1]) < 1e-3
    assert found.value == pytest.approx(1e-3 * (least - 1))


def test_every_shorter_feedback_period_is_met_where_the_last_ticks_decide() -> None:
    """A motion too short for every body to be detected: how long before its end the last tick falls has a sampling
    ripple."""
    case = control_group(
        motion__duration_s=0.3,
        contact__body="hand_finger",
        contact__area_cm2=20.0,
        contact__stiffness_N_m=5600.0,
        detector__thresholds_Nm=[5, 3, 5, 5, 5, 5, 5],
        detector__noise_sd_Nm=0.6,
        verdict__accepted_probability=0.02,
    )
    vary = "detector.feedback_period_s"
    fails = [ms for ms in range(1, 61) if over(case, vary, ms / 1000) > 0.02]
    assert over(case, vary, 0.059) < 0.02 < over(case, vary, 0.05)
    assert solve_requirement(case, vary, low=0.001, high=0.06).value == pytest.approx((fails[0] - 1) / 1000)


def test_an_arm_that_starts_from_rest_meets_the_risk_at_more_conservative_values_too() -> None:
    """Its ticks are nearer to each other than the distances the body may have."""
    case = bs.Scenario.from_dict({
        "robot": "iiwa14",
        "pose_deg": [20, 37, 9, -77, 24, 68, 0],
        "motion": {"velocity_mm_s": [-78, 48, -10], "start": "rest"},
        "contact": {"body": "thigh_knee", "area_cm2": 0.72},
        "detector": {
            "thresholds_Nm": [29.3, 17.7, 7.3, 10.0, 21.3, 11.1, 25.6],
            "noise_sd_Nm": [5.23, 3.16, 1.3, 1.79, 3.8, 1.98, 4.57],
            "feedback_period_s": 0.001,
        },
        "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 4.84},
        "verdict": {"accepted_probability": 1.8e-5},
    })  # fmt: skip
    found = solve_requirement(case, "contact.padding")
    assert found.value is not None
    more_conservative = np.geomspace(found.value / 4, found.value, 40)
    assert (
        max(over(case, "contact.padding", float(value)) for value in more_conservative)
        <= case.verdict.accepted_probability
    )


def test_an_arm_that_starts_from_rest_meets_the_risk_at_lower_speeds_too() -> None:
    """It speeds up all the way to the body, as fast whatever speed is asked: one crest reaches over many values."""
    case = scenario(**{
        "motion.start": "rest",
        "contact.offset_law": "fixed",
        "contact.offset_mm": 4.7,
        "detector.feedback_period_s": 0.004,
        "reaction.joint_acceleration_rad_s2": 2.64,
        "verdict.accepted_probability": 5.5e-5,
    })  # fmt: skip
    found = solve_requirement(case, "motion.speed")
    assert found.value is not None
    lower = np.geomspace(0.8 * found.value, found.value, 60)
    assert max(over(case, "motion.speed", float(value)) for value in lower) <= case.verdict.accepted_probability
    beyond = found.value * np.linspace(1.0005, 1.005, 10)
    assert max(over(case, "motion.speed", float(value)) for value in beyond) > case.verdict.accepted_probability


@pytest.mark.parametrize("high", [158.0, 300.0])
def test_no_slower_elastic_arm_fails(high: float) -> None:
    """Its force falls again where a faster arm is detected in an earlier swing."""
    case = swinging()
    assert over(case, "motion.speed", 130.0) > 0.9
    assert over(case, "motion.speed", 150.0) < 1e-5
    found = solve_requirement(case, "motion.speed", low=3.0, high=high)
    assert found.value is not None
    assert found.binding == "pressure"
    slower = np.geomspace(0.5 * found.value, found.value, 60)
    assert max(over(case, "motion.speed", float(value)) for value in slower) <= found.risk
    assert over(case, "motion.speed", 1.002 * found.value) > found.risk


@pytest.mark.parametrize(
    ("vary", "seed"), [("motion.speed", 8), ("motion.speed", 10), ("motion.speed", 12), ("contact.padding", 19)]
)
def test_no_more_conservative_value_of_a_random_elastic_arm_fails(vary: str, seed: int) -> None:
    """The range ends in a valley of the force, and a crest before it passes the limit."""
    drawn = random_swinging(seed, vary)
    assert drawn is not None
    case, valley = drawn
    low = valley / 10 if vary == "motion.speed" else 1e3
    found = solve_requirement(case, vary, low=low, high=valley)
    assert found.value is not None
    assert found.value < 0.99 * valley
    more_conservative = np.geomspace(max(low, found.value / 4), found.value, 60)
    assert max(over(case, vary, float(value)) for value in more_conservative) <= found.risk


def test_where_the_risk_need_not_grow() -> None:
    """Contact anywhere between two ticks of an arm that does not swing has neither ripples nor falls."""
    cases: dict[str, tuple[dict[str, Any], bool, bool]] = {
        "even": ({}, False, False),
        "free": ({"contact.kind": "free", "contact.body_mass_kg": 3.0}, False, False),
        "fixed": (_FIXED, True, False),
        "rest": ({"motion.start": "rest"}, True, False),
        "narrow": ({"contact.offset_law": "half_normal", "contact.offset_sd_s": 1e-3}, True, False),
        "wide": ({"contact.offset_law": "half_normal", "contact.offset_sd_s": 1e-2}, False, False),
        "elastic": ({"arm.model": "elastic"}, False, True),
        "damping": ({"contact.damping_Ns_m": 500.0}, False, True),
        "elastic at a distance": ({"arm.model": "elastic", **_FIXED}, True, True),
    }
    for name, (changes, ripple, fall) in cases.items():
        case = scenario(**changes)
        assert (has_ripple(case), force_may_fall(case), risk_may_fall(case)) == (ripple, fall, ripple or fall), name


# An arm that lags behind its line: the risk falls for a while with harder padding, and jumps where it is a step later.
LAGGING = {
    "robot": "sia5d",
    "pose_rad": [-0.363094726, -0.004907327, -1.003024240, -0.668798952, 0.266017168, -1.855768757, -2.216611018],
    "motion": {"velocity_mm_s": [71.0627454, 134.0381230, -72.2386140], "held_joints": [7]},
    "contact": {"body": "upper_arm_elbow", "limits": "bgia2011", "area_cm2": 2.03869461},
    "detector": {
        "thresholds_Nm": [22.5951897, 39.2544407, 14.0980883, 12.2826232, 29.0908350, 12.3529798, 15.8620814],
        "noise_sd_Nm": [3.49700380, 6.07531649, 2.18192762, 1.90095239, 4.50231939, 1.91184132, 2.45493663],
        "feedback_period_s": 0.008,
    },
    "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 10.4317903},
}


@pytest.mark.parametrize("high", [2.1e3, 3e3, 2e4, 1e8])
def test_values_close_below_a_crossing_are_met_where_the_risk_jumps(high: float) -> None:
    case = bs.Scenario.from_dict(LAGGING)
    found = solve_requirement(case, "contact.padding", low=1e3, high=high)
    assert found.value is not None
    assert found.ill_conditioned
    for step in np.linspace(0, 0.03, 7):
        assert over(case, "contact.padding", found.value * math.exp(-step)) <= found.risk


def _at_a_distance(robot: str, pose: list[float], velocity: list[float], mm: float, **keys: Any) -> bs.Scenario:
    text: dict[str, Any] = {"robot": robot, "pose_deg": pose, "motion": {"velocity_mm_s": velocity}}
    if robot == "sia5d":
        text["motion"]["held_joints"] = [7]
    contact, detector, reaction = keys["contact"], keys["detector"], keys["reaction"]
    return bs.Scenario.from_dict({
        **text,
        "contact": {**contact, "offset_law": "fixed", "offset_mm": mm},
        "detector": detector,
        "reaction": reaction,
        "verdict": {"accepted_probability": 1e-6},
    })  # fmt: skip


# A failure far above the edge, whose neighbourhood reaches down to an earlier failure but not below that one; and, in
# the last, a search that began between two whole steps and did not end.
_CREST_BELOW_CREST = {
    "feedback_period": _at_a_distance(
        "sia5d", [-13.19, 42.51, 12.31, -11.99, -7.41, -29.43, 9.58], [2.06, 76.33, -37.38], 20.0,
        contact={"body": "hand_finger", "area_cm2": 2.76594154281951},
        detector={
            "thresholds_Nm": [9.51, 25.18, 8.06, 29.7, 27.74, 29.72, 25.28],
            "noise_sd_Nm": [1.21, 3.2, 1.03, 3.78, 3.53, 3.78, 3.22], "feedback_period_s": 0.004,
        },
        reaction={"kind": "stop", "joint_acceleration_rad_s2": 25.80316506132681},
    ),
    "speed": _at_a_distance(
        "ur3e", [-13.99, -104.02, 92.05, -84.83, -80.29, -11.03], [-86.65, -7.72, -155.66], 20.0,
        contact={"body": "lower_arm_wrist", "area_cm2": 4.673457446716328, "limits": "ts15066"},
        detector={
            "thresholds_Nm": [11.35, 21.15, 24.15, 9.1, 12.31, 12.11],
            "noise_sd_Nm": [1.66, 3.1, 3.54, 1.33, 1.8, 1.77], "feedback_period_s": 0.002,
        },
        reaction={"kind": "stop", "joint_acceleration_rad_s2": 7.161345151023133, "latency_s": 0.004},
    ),
    "steps": _at_a_distance(
        "sia5d", [-1.31, 19.76, 9.86, -21.13, 5.72, -51.86, 11.68], [116.14, 12.34, 37.81], 1.0,
        contact={"body": "lower_arm_wrist", "area_cm2": 4.463841175813476, "limits": "ts15066"},
        detector={
            "thresholds_Nm": [20.48, 17.32, 25.81, 8.3, 23.03, 26.61, 10.29],
            "noise_sd_Nm": [2.1, 1.77, 2.64, 0.85, 2.36, 2.73, 1.05], "feedback_period_s": 0.008,
        },
        reaction={"kind": "reverse", "joint_acceleration_rad_s2": 23.471396641749077, "latency_s": 0.01},
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", _CREST_BELOW_CREST)
def test_crests_below_an_earlier_failure_are_looked_at(name: str) -> None:
    case = _CREST_BELOW_CREST[name]
    vary = "motion.speed" if name == "speed" else "detector.feedback_period_s"
    found = solve_requirement(case, vary)
    assert found.value is not None
    if name == "speed":
        tried = [float(value) for value in np.geomspace(0.9 * found.value, found.value, 60)]
    else:
        tried = [1e-3 * step for step in range(1, round(1e3 * found.value) + 1)]
    assert max(over(case, vary, value) for value in tried) <= 1e-6
    beyond = [found.value * (1 + 2e-4 * i) for i in range(1, 20)] if name == "speed" else [found.value + 1e-3]
    assert max(over(case, vary, value) for value in beyond) > 1e-6


def test_an_answer_has_four_digits_beside_a_risk_that_dips() -> None:
    """The first value of four digits below the crossing exceeds what is accepted once more."""
    case = bs.Scenario.from_dict({
        "robot": "iiwa14",
        "pose_rad": [
            -0.21867654080949395, 0.6648316441248183, 1.8302624689534364, 0.6009121850260266, 2.559147955088388,
            -0.6241716831004931, -0.7546210345955724,
        ],
        "motion": {"velocity_mm_s": [-24.926094038106225, -137.00007289280478, 106.00057962110493],
                   "held_joints": [3]},
        "contact": {"body": "chest", "limits": "ts15066", "area_cm2": 3.533330516984194},
        "detector": {
            "thresholds_Nm": [
                29.716383342774108, 8.013605776201091, 17.651009738227756, 16.24114537992149, 15.881011250691856,
                9.056916755827187, 26.919525423092324,
            ],
            "noise_sd_Nm": [
                3.6094045061393207, 0.9733467382422096, 2.1439228775651142, 1.9726782577465571, 1.928935729126496,
                1.1000691360431096, 3.269693193968972,
            ],
            "feedback_period_s": 0.002,
        },
        "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 7.253721042974778, "latency_s": 0.02,
                     "dead_time_s": 0.04901105135996651},
        "verdict": {"accepted_probability": 1e-06},
    })  # fmt: skip
    found = solve_requirement(case, "contact.padding")
    assert found.value is not None
    assert found.value == float(f"{found.value:.4g}")
    assert over(case, "contact.padding", found.value) <= 1e-6


class Step:
    """A risk that passes what is accepted at one value, and none beside it."""

    def __init__(self, search: RiskSearch, last: float) -> None:
        self.evaluations, self._last, self._upward = 0, last, search.upward
        self.problem, self.force_limit, self.undetected = search.risks.problem, 1.0, 0.0

    def at(self, value: float) -> Risk:
        met = value <= self._last if self._upward else value >= self._last
        return Risk(1e-9 if met else 0.5, 0.0, 0.0, "force", 0.0, met)


def stepped(vary: str, last: float, ends: tuple[float, float]) -> tuple[RiskSearch, Any]:
    """A search whose values are met up to ``last`` in the less conservative direction, and its answer."""
    variable, upward = Variable(vary), HIGHER_IS_WORSE[vary]
    search = RiskSearch(scenario(), variable, ends, 1e-3, upward=upward)
    search.risks = Step(search, last)  # type: ignore[assignment]
    return search, _Answer(search, ends).requirement()


@pytest.mark.parametrize("seed", range(30))
@pytest.mark.parametrize("vary", ["motion.speed", "reaction.joint_acceleration_rad_s2"])
def test_four_digits_are_kept_on_the_safe_side(vary: str, seed: int) -> None:
    last = float(10 ** np.random.default_rng(seed).uniform(0.5, 2.5))
    search, found = stepped(vary, last, (1.0, 1000.0))
    assert found.value is not None
    assert found.value == float(f"{found.value:.4g}")
    assert found.value <= last if search.upward else found.value >= last
    assert abs(found.value / last - 1) < 1.2e-3
    assert found.reason.startswith("Above " if search.upward else "Below ")
    assert f" {found.value:g} " in found.reason


@pytest.mark.parametrize("last", [0.004, 0.0041, 0.0045, 0.0049, 0.004999])
def test_whole_steps_are_taken_on_the_safe_side(last: float) -> None:
    """The nearest step to 4.9 ms is one that fails."""
    assert stepped("detector.feedback_period_s", last, (0.001, 0.05))[1].value == 0.004
    assert stepped("detector.feedback_period_s", 0.05, (0.001, 0.05))[1].binding == "range"
