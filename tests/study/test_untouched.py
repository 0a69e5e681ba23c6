"""What hits nothing in most cases has not been put to the test, by any study."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from bumpstop.collision import CollisionProblem, Scenario, evaluate, load_scenario
from bumpstop.study import run
from bumpstop.study.parameters.effectiveness import EffectivenessStudy
from bumpstop.study.range import Range
from bumpstop.study.requirement.design_guide import min_cost
from bumpstop.study.requirement.design_search import CostRate
from bumpstop.study.requirement.requirement import solve_requirement
from bumpstop.study.speed.workspace_speed_limits import safe_poses
from bumpstop.study.speed.worst_direction import worst_directions

HAND = Path(__file__).resolve().parents[2] / "examples/01_hand_downward.toml"
# Joint 3 reaches its limit before most contacts.
LIMITED = {"pose_deg": [149.506, -3.811, 158.859, -7.415, 95.262, 53.204, 0]}
# The motion ends 5 mm before the body.
SHORT = {"contact.offset_law": "fixed", "contact.offset_mm": 30.0, "motion.duration_s": 0.5}


def limited() -> Scenario:
    scenario = load_scenario(HAND, LIMITED)
    verdict = evaluate(scenario).verdict
    assert verdict.conclusion == "inconclusive"
    assert "52.9 %" in verdict.nothing_hit
    return scenario


@pytest.mark.parametrize("vary", ["motion.speed", "detector.thresholds"])
def test_a_requirement_has_no_answer(vary: str) -> None:
    found = solve_requirement(limited(), vary)
    assert found.value is None
    assert found.binding == "untouched"
    assert found.risk_at_value <= found.risk
    assert "nothing is put to the test. In 52.9 % of cases nothing is hit" in found.reason


def test_a_body_part_has_no_safe_speed() -> None:
    study = EffectivenessStudy(load_scenario(HAND, SHORT), (("bgia2011", "hand_finger"),), ("down",), (50.0,), (2.0,))
    rows = run(study).rows
    collision, safe = (rows.filter(pl.col("kind") == kind) for kind in ("collision", "safe_speed"))
    assert collision["acceptable"].to_list() == [None]
    assert safe["safe_speed_mm_s"].to_list() == [None]
    assert "nothing is hit" in safe["reason"][0]


def test_a_design_is_not_enough() -> None:
    scenario = limited()
    rate = CostRate.of(Range.parse("motion.speed=20:200:3", scenario), "1")
    guide = min_cost(scenario, [rate])
    assert guide.now.margin > 0
    assert not guide.now.meets
    assert guide.combined is None
    assert guide.reason.startswith("No design in these ranges is put to the test.")


def test_a_pose_has_no_safe_speed_in_its_own_direction_but_in_a_cone() -> None:
    problem = CollisionProblem.from_scenario(limited())
    q, own, most = problem.q[None], np.array([[0.0, 0.0, -1.0]]), np.array([1.0])
    alone = worst_directions(problem, q, own, 0.0, most).found
    assert alone.speed[0] == 0
    assert alone.limited_by[0] == "untouched"
    assert math.isnan(alone.risk[0])
    # Other directions are put to the test: the worst of them is told, in which the arm hits something.
    around = worst_directions(problem, q, own, math.pi / 4, most)
    assert around.found.speed[0] > 0
    velocity = around.direction[0] * around.found.speed[0]
    there = problem.scenario.with_values({"motion.velocity_mm_s": (1e3 * velocity).tolist()})
    assert evaluate(there).verdict.conclusion == "acceptable"


def test_poses_without_an_answer_are_counted() -> None:
    summary = {"none_safe": 1, "untouched": 2, "poses": 5, "limit_p50_mm_s": 0.0, "limit_p95_mm_s": 0.0}
    assert safe_poses(summary) == (
        "in 1 of 5 poses no speed is safe; in 2 most cases hit nothing, which counts as no safe speed"
    )
