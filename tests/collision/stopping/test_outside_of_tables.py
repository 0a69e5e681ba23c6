"""What a stopping table does not say, and what stands beside the verdict then."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from collision.stopping_cases import DEG, extension, line, one_joint

LONGEST = "is not in the stopping table and takes the longest time that it has"


@pytest.mark.parametrize(
    ("joints", "changes", "named"),
    [
        # On this line joint 5 stands.
        ("123", {}, "4, 6"),
        ("123", {"reaction.stop_category": 1}, ""),
        ("123456", {}, ""),
        # What is held does not brake.
        ("123", {"motion.held_joints": [5, 6], "motion.task": "position"}, "4"),
        ("123", {"motion.held_joints": [4, 5, 6], "motion.task": "position"}, ""),
        ("", {}, "1, 2, 3, 4, 6"),
    ],
)
def test_brakes_beside_joints_that_a_table_leaves_out_weaken_the_verdict(
    tmp_path: Path, joints: str, changes: dict[str, Any], named: str
) -> None:
    """The longest time of the others is no bound: a wrist that stops sooner may leave the tip farther."""
    columns = [f"distance_{joint}_deg" for joint in joints] or ["distance_tcp_deg"]
    table = "\n".join(["speed_deg_s," + ",".join(columns), *(f"{v}" + f",{0.1 * v}" * len(columns) for v in (5, 90))])
    brakes = line(
        tmp_path, table + "\n", kind="stop", deceleration="table", stopping_table="table.csv", stop_category=0
    )
    result = bs.evaluate(brakes.with_values(changes))
    told = [warning for warning in result.warnings if LONGEST in warning]
    assert [warning.split(" is not")[0] for warning in told] == ([f"Joint {named}"] if named else [])
    assert all("the force may be higher" in warning for warning in told)


def test_the_wrist_that_stops_sooner_does_go_farther(tmp_path: Path) -> None:
    """What the warning is about: a motion of a UR10e whose wrist stops in 0.1 s, found among random ones."""
    times = [0.4, 0.4, 0.3, 0.1, 0.1, 0.1]
    pose, velocity = [0.301, 0.423, 0.393, 0.177, 1.839, -0.532], [-121.0, -173.9, -132.8]
    force = []
    for joints in (6, 3):
        names = ",".join(f"distance_{j}_deg" for j in range(1, joints + 1))
        rows = [f"{v}," + ",".join(f"{v * t / 2:.5f}" for t in times[:joints]) for v in (5, 30, 90, 180)]
        table = "\n".join([f"speed_deg_s,{names}", *rows]) + "\n"
        scenario = line(
            tmp_path, table, kind="stop", deceleration="table", stopping_table="table.csv", stop_category=0
        ).with_values({"pose_deg": (np.array(pose) / DEG).tolist(), "motion.velocity_mm_s": velocity})
        curve = bs.stopping_curve(bs.CollisionProblem.from_scenario(scenario), whole=True)
        force.append(float((curve.max_distance - curve.tick_distance)[0]))
    assert force[0] > 1.5 * force[1]


@pytest.mark.parametrize(
    ("levels", "told"),
    [
        ((33,), ["beyond the stopping table's 33 %"]),
        ((20, 33), ["beyond the stopping table's 33 %"]),
        ((33, 100), []),
        ((90, 100), ["below the stopping table's 90 %"]),
        ((100,), ["below the stopping table's 100 %"]),
        ((), []),
    ],
)
@pytest.mark.parametrize("motion", ["line", "trajectory"])
def test_an_arm_beyond_the_extensions_of_the_table_is_noted(
    tmp_path: Path, levels: tuple[int, ...], told: list[str], motion: str
) -> None:
    rows = [f"{e},{v},{0.1 * v}" for e in levels for v in (5, 90)] or ["5,0.5", "90,9"]
    table = "\n".join([("extension_percent," if levels else "") + "speed_deg_s,distance_1_deg", *rows]) + "\n"
    reaction = {"kind": "stop", "deceleration": "table", "stopping_table": "table.csv"}
    if motion == "line":
        scenario = line(tmp_path, table, **reaction)
    else:
        scenario = one_joint(tmp_path, 1, 0.5, table, [10, -80, 110, -120, -90, 20], **reaction)
    assert 0.33 < extension([10, -80, 110, -120, -90, 20]) < 0.9
    notes = [note for note in bs.evaluate(scenario).notes if "Where reactions begin the arm is extended" in note]
    assert [note.split(" reach, ")[1].split(":")[0] for note in notes] == told
    assert all(("the force may be higher" in note) == ("beyond" in note) for note in notes)


@pytest.mark.parametrize(("category", "told"), [({}, True), ({"stop_category": 0}, False)])
def test_a_table_of_brakes_in_a_scenario_that_says_no_category_is_noted(
    tmp_path: Path, category: dict[str, int], told: bool
) -> None:
    table = "speed_deg_s,STOP 0 distance J1 [deg]\n10,1\n20,4\n"
    scenario = line(tmp_path, table, kind="stop", deceleration="table", stopping_table="table.csv", **category)
    notes = bs.CollisionProblem.from_scenario(scenario).notes
    assert any("is one of stop category 0, and reaction.stop_category is not given" in note for note in notes) is told
