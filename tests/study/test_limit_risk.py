"""The risk of passing a limit with the fewest reactions, against the whole law with all of them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import bumpstop as bs
from bumpstop.collision import CollisionProblem, integrate, stopping_curve
from bumpstop.kernels import core
from collision.cases import REMEMBERING, VARIED
from study.prediction_cases import draw

# Below this the whole law's interpolated probabilities have digits of their own.
MIN_PROBABILITY = 1e-8
RESOLUTION = 1e-3  # of the answer near the accepted risk
# Reactions are followed to 1e-10 rad or so, and the force is off by K times what that moves the point: far less than
# what changes a probability by a part in ten thousand.
ROUNDING = 1e-4


def _ask(problem: CollisionProblem, force: float, accepted: float, known: object = None) -> dict[str, float]:
    question = (problem.detector, problem.stiffness, problem.offset_kind, problem.offset_size, force, accepted)
    found: dict[str, float] = core.limit_risk(problem.setup, problem.q, problem.velocity, *question, known)
    return found


def _over(law: bs.CollisionResult, force: float) -> float:
    """Never detected counts as over, unless the arm comes to rest: then its force is among the others."""
    tail = law.kernel.tail("peak_force", np.array([force]))[0, 0]
    return float(tail) + (0.0 if law.kernel.rests else law.undetected_probability)


# An arm that starts from rest does not follow its line evenly, and reactions are simulated one by one.
CASES = {
    **VARIED,
    **{f"{name}, from rest": scenario.with_values({"motion.start": "rest"}) for name, scenario in VARIED.items()},
    **{name: REMEMBERING[name] for name in ("alternating noise, two joints", "armed after contact, correlated")},
    "observer, from rest": REMEMBERING["observer"].with_values({"motion.start": "rest"}),
}


@pytest.mark.parametrize("name", CASES)
def test_the_risk_is_that_of_the_whole_law(name: str) -> None:
    scenario = CASES[name]
    problem = CollisionProblem.from_scenario(scenario)
    law = integrate(problem, stopping_curve(problem))
    asked = 0
    for share in (0.5, 0.05, 1e-3):
        try:
            # At a fixed distance the force has single values: this lies just below one.
            force = (1 - 1e-6) * law.peak_force.quantile(1 - share)
        except bs.InputError:
            continue
        if not np.isfinite(force):
            continue
        over = _over(law, force)
        if not over > MIN_PROBABILITY:
            continue
        asked += 1
        found = _ask(problem, force, over)
        allowed = (RESOLUTION + ROUNDING) * over
        assert found["low"] - allowed <= over <= found["high"] + allowed
        assert found["high"] - found["low"] <= RESOLUTION * found["high"]
        assert found["false_alarm"] == pytest.approx(law.false_alarm_probability, abs=1e-9)
        assert found["undetected"] == pytest.approx(law.undetected_over(force), abs=1e-9)
        # Far from what is accepted the bounds are wide, and bounds all the same.
        for accepted in (1e-3 * over, min(1.0, 1e3 * over)):
            wide = _ask(problem, force, accepted)
            assert wide["low"] - allowed <= over <= wide["high"] + allowed
            assert (wide["high"] <= accepted) == (over <= accepted)
    assert asked or law.undetected_probability > 0.5


@given(number=st.integers(0, 10_000))
@settings(max_examples=40, deadline=None)
def test_the_risk_is_that_of_the_whole_law_wherever_an_arm_stands(number: int) -> None:
    scenario, q, velocity = draw(np.random.default_rng(number), number, 1)
    changes = {"pose_rad": q[0].tolist(), "motion.velocity_mm_s": (1e3 * velocity[0]).tolist()}
    try:
        problem = CollisionProblem.from_scenario(scenario.with_values(changes))
    except bs.InputError:
        return  # a singular start
    law = integrate(problem, stopping_curve(problem))
    force = law.peak_force.quantile(0.99)
    if not np.isfinite(force):
        return
    over = _over(law, force)
    found = _ask(problem, force, over)
    allowed = (RESOLUTION + ROUNDING) * over
    assert found["low"] - allowed <= over <= found["high"] + allowed
    # With a latency all reactions are simulated, those between ticks as well.
    assert found["follows"] or problem.latency_steps or found["reactions"] <= law.curve.ticks


def test_a_known_path_serves_other_thresholds_and_stiffnesses() -> None:
    scenario = VARIED["seven free joints, elbow of the arm hit"]
    known = core.KnownPath()
    for factor, stiffness in ((1.0, 3e4), (0.6, 3e4), (0.6, 8e4), (1.3, 8e4), (1.3, 1e4), (1.0, 3e4)):
        thresholds = [factor * each for each in scenario.detector.thresholds_Nm]
        changed = scenario.with_values({"detector.thresholds_Nm": thresholds, "contact.stiffness_N_m": stiffness})
        problem = CollisionProblem.from_scenario(changed)
        force = bs.evaluate(changed).peak_force.quantile(0.9)
        alone, shared = _ask(problem, force, 0.1), _ask(problem, force, 0.1, known)
        for bound in ("low", "high", "undetected", "false_alarm"):
            assert shared[bound] == pytest.approx(alone[bound], rel=RESOLUTION, abs=1e-15)
        assert shared["reactions"] <= alone["reactions"]


@pytest.mark.parametrize("name", ["sia5d", "ur10e"])
def test_an_arm_that_passes_a_singularity_may_as_well_stop_there(name: str) -> None:
    number = 0 if name == "sia5d" else 1
    rng = np.random.default_rng(4)
    scenario, q, velocity = draw(rng, number, 60)
    robot = bs.Robot.load(name)
    moving = [j for j in range(robot.dof) if j + 1 not in scenario.motion.held_joints]
    passed = 0
    for pose, way in zip(q, velocity, strict=True):
        changes = {"pose_rad": pose.tolist(), "motion.velocity_mm_s": (1e3 * way).tolist()}
        try:
            problem = CollisionProblem.from_scenario(scenario.with_values(changes))
        except bs.InputError:
            continue
        found = _ask(problem, 50.0, 1.0)
        curve = stopping_curve(problem)
        along = np.tile(pose, (curve.kernel.reaction_state.shape[0] + 1, 1))
        along[1:, moving] = curve.kernel.reaction_state[:, 0]
        side = np.linalg.slogdet(robot.jacobian(along)[:, :, moving])[0]
        beyond = np.flatnonzero(side[1:] != side[0])
        if found["follows"] or not beyond.size:
            unnoticed = found["undetected"]
            if curve.end == "singularity":
                # An arm that stands at a singularity may as well get across.
                unnoticed = integrate(problem, curve).undetected_probability
            assert found["at_crossing"] == pytest.approx(unnoticed * (not found["follows"]), abs=1e-9)
            continue
        passed += 1
        # DetectedCollisions from that tick on, counted in the whole law.
        law = integrate(problem, curve)
        runs = bs.collision.monte_carlo(problem, curve, samples=4000, seed=1).runs
        late = (runs["tick"] >= beyond[0]) & (runs["offset"] < curve.tick_distance[runs["tick"]])
        share = late.mean() + law.undetected_probability
        assert found["at_crossing"] == pytest.approx(share, abs=5 * np.sqrt(share * (1 - share) / 4000) + 1e-3)
    assert passed > 0
