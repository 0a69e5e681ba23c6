"""The risk that is accepted is accepted to the last digit, by every search for a speed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop.arrays import FloatArray
from bumpstop.collision import CollisionProblem, evaluate, evaluate_batch, load_scenario
from bumpstop.study.pose_batch import PoseBatch
from bumpstop.study.prediction import stopping_time_per_speed
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.speed import crest_scan
from bumpstop.study.speed.crest_scan import CrestScan
from bumpstop.study.speed.speed_limit import SpeedLimits, speed_limits
from bumpstop.study.speed.speed_risk import SpeedRisks, speed_risks
from bumpstop.study.speed.trajectory.own_motion import own_speeds
from bumpstop.study.speed.trajectory.slowing import slow_down
from bumpstop.study.speed.workspace_speed_limits import safe_poses
from bumpstop.study.speed.worst_direction import _Search
from study.speed_limit_cases import PICK

LINE = Path(__file__).resolve().parents[3] / "examples/05_ur10e.toml"
# Of the probability that is met: a little more of it may be accepted, a little less or 4 % less may not.
SHARES = [(1 + 1e-9, True), (1 / (1 + 1e-9), False), (1 / 1.04, False)]


GAUGE = {"contact.stiffness_N_m": 75e3, "contact.gauge_spring_N_m": 75e3, "contact.gauge_mass_kg": 2.0}


def accepting(problem: CollisionProblem, risk: float) -> CollisionProblem:
    asked = problem.scenario.with_values({"verdict.accepted_probability": risk})
    return CollisionProblem.from_scenario(asked)


@pytest.mark.parametrize(("share", "met"), SHARES)
def test_of_a_whole_trajectory_at_one_path_speed(share: float, met: bool) -> None:
    problem = CollisionProblem.from_scenario(load_scenario(PICK, {"verdict.accepted_probability": 0.999999}))
    times = np.linspace(1.0, 1.4, 81)
    every = np.full(times.size, 0.1)
    found, risks = own_speeds(problem, times, every, every)
    middle = int(np.argmin(np.where(found == every, np.abs(risks - 0.5), 1.0)))
    assert 0.1 < risks[middle] < 0.9
    time, speed, risk = times[[middle]], every[:1], risks[[middle]]
    found, _ = own_speeds(accepting(problem, float(risk[0]) * share), time, speed, speed)
    assert bool(found[0] == speed[0]) is met
    assert found[0] <= speed[0]


def test_of_a_gauge_with_a_mass_along_a_trajectory() -> None:
    changes: dict[str, Any] = {"verdict.accepted_probability": 0.999999, **GAUGE}
    problem = CollisionProblem.from_scenario(load_scenario(PICK, changes))
    times = np.linspace(1.0, 1.9, 61)
    speed = np.full(times.size, 0.1)
    found, risk = own_speeds(problem, times, speed, speed)
    middle = int(np.argmin(np.where(found == speed, np.abs(risk - 0.5), 1.0)))
    assert 1e-3 < risk[middle] < 0.999
    alone = evaluate(problem.scenario.with_values({"motion.contact_onset_s": float(times[middle])}))
    assert risk[middle] == pytest.approx(alone.peak_force.exceedance(allowed_force(problem)), rel=1e-6)


@pytest.mark.parametrize(("share", "met"), SHARES)
def test_of_a_slowed_trajectory(share: float, met: bool) -> None:
    problem = CollisionProblem.from_scenario(load_scenario(PICK))
    trajectory = problem.trajectory
    assert trajectory is not None
    path_speed = np.full(trajectory.time.size, 0.8)
    given = slow_down(accepting(problem, 0.999999), trajectory, path_speed).judged
    assert given is not None
    assert 1e-6 < given.over < 0.999
    slowing = slow_down(accepting(problem, given.over * share), trajectory, path_speed)
    assert slowing.judged is not None
    assert (slowing.eased == 0) is met
    assert slowing.judged.over <= given.over * share


def line() -> tuple[CollisionProblem, FloatArray, FloatArray, float, float]:
    """A line, its pose and direction, a speed near its limit and the risk there."""
    problem = CollisionProblem.from_scenario(load_scenario(LINE))
    q, direction = problem.q[None], (problem.velocity / np.linalg.norm(problem.velocity))[None]
    speed = float(speed_limits(problem, q, direction, np.array([1.0])).speed[0])
    found = evaluate_batch(problem, q, speed * direction, limits_N=[allowed_force(problem)])
    return problem, q, direction, speed, float(found.exceedance[0, 0])


@pytest.mark.parametrize(("share", "met"), SHARES)
def test_of_the_worst_of_some_directions(share: float, met: bool) -> None:
    problem, q, direction, speed, risk = line()
    assert 1e-6 < risk < 1
    found = SpeedLimits(np.array([speed]), np.array([risk]), np.array(["risk"]), 0, np.zeros(1, dtype=bool))
    search = _Search(accepting(problem, risk * share), q, direction.copy(), found)
    search.settle(direction[:, None])
    assert bool(search.found.speed[0] == speed) is met


@pytest.mark.parametrize(("share", "met"), SHARES)
@pytest.mark.parametrize(("top", "between"), [(0.1, True), (0.1025, False)])
def test_of_the_crests_below_a_speed(
    top: float, between: bool, share: float, met: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The greatest risk below a speed lies between two of the values looked at first, or at one of them."""
    changes = {"contact.offset_law": "fixed", "contact.offset_mm": 11.0, "detector.feedback_period_s": 0.012}
    problem = CollisionProblem.from_scenario(load_scenario(LINE, changes))
    q, direction = problem.q[None], (problem.velocity / np.linalg.norm(problem.velocity))[None]
    gain = stopping_time_per_speed(problem, PoseBatch(problem, q, direction).joint_rates(q))
    looked: list[float] = []

    def noted(*args: Any, **settings: Any) -> SpeedRisks:
        found = speed_risks(*args, **settings)
        looked.append(float(found.over.max()))
        return found

    def below(risk: float) -> float:
        asked, own = accepting(problem, risk), np.zeros(1)
        return float(CrestScan(asked, q, direction, gain, 1).highest_safe(np.array([top]), own)[0])

    monkeypatch.setattr(crest_scan, "speed_risks", noted)
    assert below(0.999999) == top
    at_values, beside = looked
    assert (beside > 1.06 * at_values) if between else (at_values > 1.06 * beside)
    assert (below(max(looked) * share) == top) is met


@pytest.mark.parametrize(
    ("half", "twentieth", "said"),
    [
        (20.0, 80.25, "; half of all poses are safe up to 20 mm/s, one in twenty up to 80.25 mm/s"),
        (87.1478, 99.996, "; half of all poses are safe up to 87.14 mm/s, one in twenty up to 99.99 mm/s"),
        (0.0, 7.5, "; one in twenty is safe up to 7.5 mm/s"),
        (0.0, 0.0, ""),
    ],
)
def test_no_pose_is_safe_up_to_no_speed(half: float, twentieth: float, said: str) -> None:
    summary = {"none_safe": 3, "untouched": 0, "poses": 5, "limit_p50_mm_s": half, "limit_p95_mm_s": twentieth}
    assert safe_poses(summary) == f"in 3 of 5 poses no speed is safe{said}"
