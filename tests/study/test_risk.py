"""The risk while one thing is varied, against the scenario written out with each value."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision import CollisionProblem, integrate, stopping_curve
from bumpstop.study.requirement.requirement import HIGHER_IS_WORSE
from bumpstop.study.requirement.risk import VariedRisk, _first_cycle_beyond_singularity, _undetected_before_singularity
from bumpstop.study.variable import Variable
from collision.cases import control_group, ur10e
from study.prediction_cases import draw

BODY = {"contact__stiffness_N_m": None, "contact__body": "hand_finger", "contact__area_cm2": 2.0}
CASES = {
    "half-normal distance": control_group(**BODY),
    "from rest": control_group(**BODY, motion__start="rest"),
    "fixed distance": control_group(**BODY, contact__offset_law="fixed", contact__offset_mm=7.3),
    "one cycle, observer, latency": ur10e(
        **BODY, contact__offset_law="uniform", detector__residual="observer", reaction__latency_s=0.01
    ),
    "two phases": control_group(**BODY, contact__limits="ts15066", verdict__clamped_limit="two_phase"),
}


@pytest.mark.parametrize("vary", HIGHER_IS_WORSE)
@pytest.mark.parametrize("name", CASES)
def test_a_value_has_the_risk_of_the_scenario_that_says_so(name: str, vary: str) -> None:
    scenario, variable = CASES[name], Variable(vary)
    risks = VariedRisk(scenario, variable)
    own = 3e4 if vary == "contact.padding" else variable.value(scenario)
    for factor in (0.5, 2.0):
        value = variable.quantised(scenario, factor * own) if variable.quantum(scenario) else factor * own
        changed = variable.apply(scenario, value)
        if vary == "motion.speed" and factor < 1:
            changed = changed.with_values({"motion.duration_s": scenario.motion.duration_s / factor})
        result = bs.evaluate(changed)
        found = risks.at(value)
        verdict = result.verdict
        # Velocities and accelerations are scaled in another order: rounding, which steep tails enlarge.
        assert found.over == pytest.approx(max(verdict.p_over_force, verdict.p_over_pressure or 0.0), rel=1e-6)
        assert found.false_alarm == pytest.approx(result.false_alarm_probability, rel=1e-9)
        assert found.met == (found.over <= scenario.verdict.accepted_probability)
    assert risks.evaluations == 2


def test_an_arm_that_comes_to_rest_is_undetected_only_where_it_presses_too_hard() -> None:
    """A joint limit ends the motion: what is never detected there counts with the force at which the arm stands."""
    undetected_force = control_group(**BODY, detector__thresholds_Nm=[1e9] * 7, motion__duration_s=30.0)
    result = bs.evaluate(undetected_force)
    assert result.unbounded_because is None
    assert result.undetected_probability > 0.99
    risks = VariedRisk(undetected_force, Variable("contact.padding"))
    hard, soft = risks.at(1e8), risks.at(50.0)
    assert hard.undetected == pytest.approx(1.0)
    assert hard.over == pytest.approx(1.0)
    assert soft.undetected < 1e-3
    assert soft.met


def test_an_arm_that_passes_a_singularity_may_as_well_stop_there() -> None:
    """Against collisions drawn one by one: those detected from that control cycle on, and those never detected."""
    passed: dict[str, int] = {"sia5d": 0, "ur10e": 0}
    stands = 0
    for number, name in enumerate(passed):
        scenario, q, velocity = draw(np.random.default_rng(4), number, 60)
        robot = bs.Robot.load(name)
        moving = [j for j in range(robot.dof) if j + 1 not in scenario.motion.held_joints]
        for pose, way in zip(q, velocity, strict=True):
            changes: dict[str, Any] = {"pose_rad": pose.tolist(), "motion.velocity_mm_s": (1e3 * way).tolist()}
            try:
                problem = CollisionProblem.from_scenario(scenario.with_values(changes))
            except bs.InputError:
                continue
            curve = stopping_curve(problem)
            result = integrate(problem, curve)
            along = np.tile(pose, (curve.line.reaction_state.shape[0] + 1, 1))
            along[1:, moving] = curve.line.reaction_state[:, 0]
            side = np.linalg.slogdet(robot.jacobian(along)[:, :, moving])[0]
            beyond = np.flatnonzero(side[1:] != side[0])
            found = _undetected_before_singularity(result)
            assert _first_cycle_beyond_singularity(problem, curve) == (beyond[0] if beyond.size else None)
            if not beyond.size:
                stands += curve.end == "singularity"
                assert found == (result.undetected_probability if curve.end == "singularity" else 0.0)
                continue
            passed[name] += 1
            runs = bs.collision.monte_carlo(problem, curve, samples=4000, seed=1).runs
            late = (runs["tick"] >= beyond[0]) & (runs["offset"] < curve.tick_distance[runs["tick"]])
            share = late.mean() + result.undetected_probability
            assert found == pytest.approx(share, abs=5 * np.sqrt(share * (1 - share) / 4000) + 1e-3)
    assert min(passed.values()) > 0
    assert stands > 0
