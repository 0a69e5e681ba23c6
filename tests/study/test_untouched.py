"""What hits nothing in most cases has not been put to the test, by any study."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure

from bumpstop.collision import CollisionProblem, Scenario, evaluate, load_scenario
from bumpstop.report.document import Document
from bumpstop.report.picture import FAINT, LAW
from bumpstop.report.studies.effectiveness import pages_of
from bumpstop.report.studies.workspace import SlicesPart
from bumpstop.report.studies.workspace import pages_of as workspace_pages_of
from bumpstop.study import WorkspaceStudy, run
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


def test_a_safe_speed_may_end_where_nothing_is_hit(tmp_path: Path) -> None:
    """The page had no word for it."""
    scenario = load_scenario(HAND, {"pose_deg": [0, 30, 0, 114.6, 0, -40, 0]})
    found = run(EffectivenessStudy.of(scenario, ["hand_finger"], ["down"], areas_cm2=[2.0]))
    assert {each["binding"] for each in found.summary["safe_speeds"]} == {"untouched"}
    assert "cm²: 17.7, faster nothing is hit in most cases" in str(found)
    title, parts, _ = pages_of(found.study, found.rows, found.summary)
    page = Document(title, "", "study", parts).html()
    assert "17.7 (n)" in page
    assert "n that faster motions hit nothing in most cases" in page


def test_a_safe_speed_has_no_untouched_ones_below() -> None:
    """Of a body at a fixed distance that a slow arm does not reach in time, a requirement asks nothing."""
    scenario = Scenario.from_dict(
        {
            "robot": "ur10e",
            "pose_deg": [92.7, 5.1, -114.4, 103.9, 49.1, -25.5],
            "motion": {"velocity_mm_s": [3.2, 19.7, 1.7], "duration_s": 0.5, "task": "position"},
            "contact": {"body": "hand_finger", "offset_law": "fixed", "offset_mm": 20, "padding_N_m": 5000.0},
            "detector": {
                "thresholds_Nm": [20, 3, 20, 3, 40, 3],
                "noise_sd_Nm": [0.4, 0.06, 0.4, 0.3, 0.8, 0.3],
                "feedback_period_s": 0.016,
            },
            "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 20, "dead_time_s": 0.01},
        }
    )
    study = EffectivenessStudy.of(scenario, ["hand_finger"], ["right"], areas_cm2=[1.0], highest_speed_mm_s=300)
    for each in run(study).summary["safe_speeds"]:
        assert each["safe_speed_mm_s"] is None
        assert each["reason"].startswith("In 100 % of cases nothing is hit")


def test_a_page_tells_motions_that_hit_nothing_from_safe_ones() -> None:
    far = {"contact.offset_law": "fixed", "contact.offset_mm": 600.0}
    study = WorkspaceStudy(load_scenario(HAND.parent / "05_ur10e.toml", far), poses=20)
    found = run(study)
    assert found.summary["never_touch"] == 16
    slices = SlicesPart(study, found.rows)
    (picture,) = slices.pictures()
    assert "grey plus signs: in most cases nothing is hit" in picture.caption
    figure = Figure()
    picture.draw(figure)
    marks = {LAW: 0, FAINT: 0}
    for panel in figure.axes:
        for drawn in panel.collections:
            for color in marks:
                if len(drawn.get_facecolor()) and np.allclose(drawn.get_facecolor()[0], to_rgba(color)):
                    marks[color] += len(drawn.get_offsets())
    assert marks[FAINT] == 16
    assert marks[LAW] <= 4


def test_a_page_says_when_undetected_collisions_are_over_every_limit() -> None:
    found = run(WorkspaceStudy(load_scenario(HAND), poses=3))
    title, parts, notes = workspace_pages_of(found.study, found.rows, found.summary)
    assert "Collisions never detected count as over every limit, unless the arm comes to rest before that." in notes
    page = Document(title, "", "study", parts).html()
    assert "undetected collisions among it unless the arm comes to rest before that." in page


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
