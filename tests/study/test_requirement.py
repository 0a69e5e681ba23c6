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
from bumpstop.study.requirement.requirement import HIGHER_IS_WORSE, _Answer, require_curve, solve_requirement
from bumpstop.study.requirement.risk import Risk
from bumpstop.study.requirement.risk_search import RiskSearch
from bumpstop.study.variable import Range, Variable
from collision.cases import control_group, ur10e

EXAMPLE = Path(__file__).resolve().parents[2] / "examples/02_lower_arm_downward.toml"
# Two figures of the issue: half a percent, and twice as far the requirement is no longer met.
AGREES, BEYOND = 0.005, 1.02


def scenario(**changes: Any) -> bs.Scenario:
    """A forearm under an arm that stops quickly: distributions of few ticks."""
    data: dict[str, Any] = {
        "robot": "ur10e",
        "pose_deg": [10, -80, 110, -120, -90, 20],
        "motion": {"velocity_mm_s": [80, 40, -80]},
        "contact": {"body": "lower_arm_wrist", "limits": "ts15066", "area_cm2": 2.0},
        "detector": {"thresholds_Nm": [40, 40, 30, 12, 12, 12], "noise_sd_Nm": [7, 7, 5, 2, 2, 2]},
        "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 10, "latency_s": 0.006},
    }
    data["detector"]["feedback_period_s"] = 0.002
    return bs.Scenario.from_dict(data).with_values(changes)


def over(case: bs.Scenario, vary: str, value: float) -> float:
    """Probability of passing a limit, by the public way."""
    verdict = bs.evaluate(Variable(vary).apply(case, value)).verdict
    return max(verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0)


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
    with pytest.raises(bs.InputError, match=r"^--risk: 1e-300 is too small"):
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
            # Braking is that of all joints alike.
            if vary == "reaction.joint_acceleration_rad_s2":
                there = there.with_values({vary: 1.0})
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
        ({}, {"vary": "motion.sped"}, "--vary"),
        ({}, {"vary": "contact.area_cm2"}, "--vary"),
        ({}, {"vary": "motion.speed", "low": 20.0, "high": 10.0}, "--vary"),
        ({}, {"vary": "motion.speed", "low": -1.0, "high": 10.0}, "--vary"),
        ({}, {"vary": "motion.speed", "risk": 0.0}, "--risk"),
        ({}, {"vary": "motion.speed", "risk": math.nan}, "--risk"),
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
    assert refused.value.field == "--vary"


def test_the_speed_that_meets_the_limits_falls_where_the_arm_stops_in_constant_time() -> None:
    """At low speeds constant deceleration stops sooner: the same arm may go faster with it."""
    speeds = []
    for law in ({}, {"reaction.deceleration": "constant_time", "reaction.stopping_time_s": 0.12}):
        found = solve_requirement(scenario(**law), "motion.speed")
        assert found.value is not None
        speeds.append(found.value)
        assert over(scenario(**law), "motion.speed", found.value) <= found.risk
    assert speeds[1] < speeds[0]
