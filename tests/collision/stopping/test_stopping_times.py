"""A stopping table in a reaction: its rows come out again, between them it is linear, and outside it errs on the safe
side or is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.stopping.deceleration import Deceleration
from bumpstop.collision.stopping.stopping_times import stopping_times
from bumpstop.collision.trajectory.trajectory_curve import trajectory_kernel
from collision.stopping_cases import DEG, STRETCHED, extension, line, one_joint

ROOT = Path(__file__).resolve().parents[3]
TM5_700 = ROOT / "examples" / "stopping" / "tm5_700.toml"


def overtravel(scenario: bs.Scenario) -> float:
    """Along the path, of the reaction to a tick early on the way, as time of the undisturbed arm [s]."""
    u = np.asarray(trajectory_kernel(bs.CollisionProblem.from_scenario(scenario)).reaction(4))
    return float(u.max() - u[0])


def test_a_joint_that_stands_but_for_rounding_does_not_brake(tmp_path: Path) -> None:
    """By symmetry: its rate is 1e-17, and its rows are ten times as long."""
    rows = "speed_deg_s,distance_1_deg,distance_2_deg,distance_3_deg\n10,40,4,4\n20,160,16,16\n"
    scenario = one_joint(tmp_path, 2, 0.2, rows, STRETCHED)
    problem = bs.CollisionProblem.from_scenario(scenario)
    law, limits = problem.deceleration, problem.joint_acceleration
    still, rounding = (
        law.profile(problem.robot, np.zeros(6), np.array([rate, 0.2, 0.0, 0.0, 0.0, 0.0]), limits)[1]
        for rate in (0.0, 1e-17)
    )
    assert still == rounding
    without = overtravel(scenario)
    path = tmp_path / "turn.csv"
    head, *lines = path.read_text().splitlines()
    moved = [line.split(",") for line in lines]
    trembling = [",".join((t, f"{1e-17 * float(t):.3e}", *rest)) for t, _, *rest in moved]
    path.write_text("\n".join([head, *trembling]) + "\n")
    assert overtravel(scenario) == pytest.approx(without, rel=1e-9)


def grid(distance: Any) -> str:
    """Rows of distance(payload, extension, speed, joint) [deg] at two payloads, two extensions and three speeds."""
    lines = ["payload_percent,extension_percent,speed_deg_s,distance_1_deg,distance_2_deg,distance_3_deg"]
    for p in (50, 100):
        for e in (40, 90):
            lines += [
                f"{p},{e},{v}," + ",".join(f"{distance(p, e, v, j):.9f}" for j in (1, 2, 3)) for v in (20, 60, 100)
            ]
    return "\n".join(lines) + "\n"


def plain(p: float, e: float, v: float, j: int) -> float:
    return (0.1 + 0.0005 * v) * v * (1 + 0.003 * p) * (0.5 + 0.01 * e) * (1 + 0.1 * j)


@pytest.mark.parametrize("joint", [1, 2, 3])
@pytest.mark.parametrize("speed", [20.0, 60.0, 100.0, 45.0])
@pytest.mark.parametrize("payload", [50.0, 100.0, 70.0])
def test_inside_the_grid_the_distance_is_that_of_the_table(
    tmp_path: Path, joint: int, speed: float, payload: float
) -> None:
    """Rows come out to 1 %. Between them the time is linear, which planted distances are."""
    pose = [0, -40, 100, 0, 0, 0]
    scenario = one_joint(tmp_path, joint, speed * DEG, grid(plain), pose, payload_percent=payload)
    # Joints 2 and 3 change the extension on the way to the tick; the path until then is short.
    reaction_time = 17e-3
    there = np.array(pose, dtype=float)
    there[joint - 1] += speed * reaction_time
    wanted = plain(payload, 100 * extension(there.tolist()), speed, joint)
    assert 40 < 100 * extension(there.tolist()) < 90
    assert overtravel(scenario) * speed == pytest.approx(wanted, rel=0.01)


def test_rows_of_the_tm5_700_come_out_again(tmp_path: Path) -> None:
    """Joint 1 alone, at payloads of 33 and 100 % and the extension of the pose."""
    text = "\n".join(line for line in TM5_700.read_text().splitlines() if "extension" not in line or "columns" in line)
    scenario = one_joint(tmp_path, 1, 118.8 * DEG, "speed_percent,distance_1_deg\n", STRETCHED)
    (tmp_path / "tm5.toml").write_text(text)
    for payload, wanted in ((33.0, 17.94), (100.0, 17.86)):  # rows at 100 % extension and 66 % speed; 66 % has the same
        known = scenario.with_values({"reaction.stopping_table": "tm5.toml", "reaction.payload_percent": payload})
        assert 0.66 < extension(STRETCHED) < 1
        assert overtravel(known) * 118.8 == pytest.approx(wanted, rel=0.01)


@pytest.mark.parametrize("law", [lambda v: 0.15 * v, lambda v: v * v / 400, lambda v: 0.05 * v + v * v / 600])
def test_below_the_slowest_row_no_joint_stops_sooner_than_by_the_law(tmp_path: Path, law: Any) -> None:
    table = grid(lambda p, e, v, j: law(v))
    for speed in (2.0, 10.0, 19.0):
        found = overtravel(one_joint(tmp_path, 1, speed * DEG, table, STRETCHED)) * speed
        # A stop ends within a sub-step of 0.2 ms.
        assert found > law(speed) - 2e-4 * speed
        assert found <= law(20.0) * speed / 20.0 + 1e-6


def test_distances_that_hardly_fall_with_the_speed_are_followed_below_the_slowest_row(tmp_path: Path) -> None:
    """Time that grows toward low speeds goes on growing."""
    table = grid(lambda p, e, v, j: 2 + 0.05 * v)
    found = overtravel(one_joint(tmp_path, 1, 15 * DEG, table, STRETCHED)) * 15
    assert found > 3.0 * 15 / 20 * 1.05


def test_beyond_the_fastest_row_its_deceleration_holds(tmp_path: Path) -> None:
    table = grid(lambda p, e, v, j: 0.15 * v)
    found = overtravel(one_joint(tmp_path, 1, 115 * DEG, table, STRETCHED)) * 115
    assert found == pytest.approx(15 * 1.15**2, rel=0.005)


def test_notes_tell_what_was_assumed(tmp_path: Path) -> None:
    problem = bs.CollisionProblem.from_scenario(one_joint(tmp_path, 1, 1.0, grid(plain), STRETCHED))
    told = " ".join(problem.notes)
    assert "Payload not given" in told
    assert "Joint 4, 5, 6 is not in the stopping table" in told
    assert "Below 20 deg/s" in told


def test_without_a_payload_the_slowest_counts(tmp_path: Path) -> None:
    given, heavy = (
        overtravel(one_joint(tmp_path, 1, 1.0, grid(plain), STRETCHED, **payload))
        for payload in ({}, {"payload_percent": 100.0})
    )
    assert given == heavy


def crossing(p: float, e: float, v: float, j: int) -> float:
    """Toward low rates the light payload takes longer, the heavy one not; joint 3 does not tell them apart."""
    if j == 3:
        return 0.17 * v
    return (0.16 - 0.0005 * v) * v if p == 50 else 0.155 * v * (1 + 0.001 * v)


@pytest.mark.parametrize("speed", [1.0, 5.0, 15.0, 20.0, 33.0, 60.0, 90.0, 100.0, 130.0])
def test_without_a_payload_no_payload_takes_longer_at_any_rate(tmp_path: Path, speed: float) -> None:
    pose = np.array([[0, -40, 100, 0, 0, 0]]) * DEG
    found = []
    for payload in ({}, *({"payload_percent": percent} for percent in (50.0, 60.0, 75.0, 99.0, 100.0))):
        problem = bs.CollisionProblem.from_scenario(one_joint(tmp_path, 1, 1.0, grid(crossing), STRETCHED, **payload))
        assert problem.deceleration.times is not None
        found.append(problem.deceleration.times.by_joint(problem.robot, pose, np.full((1, 6), speed * DEG))[0])
    unknown, known = found[0], np.array(found[1:])
    assert (unknown >= known.max(axis=0) - 1e-12).all()
    # Joints 4 to 6 are not in the table, and take the longest of those that are.
    assert (known[:, 3:] >= known[:, :3].max(axis=1, keepdims=True) - 1e-12).all()
    if speed >= 60 or speed == 20:  # the two cross below, where the line between the longest at both ends is longer
        np.testing.assert_allclose(unknown[:3], known[:, :3].max(axis=0), rtol=1e-9)


def test_a_joint_that_slides_beside_a_table_of_angles_takes_the_longest_of_all(tmp_path: Path) -> None:
    """Its speed in m/s is none of the table's levels."""
    scenario = one_joint(tmp_path, 1, 1.0, grid(plain), STRETCHED)
    robot = bs.Robot.load("ur10e")
    sliding = replace(robot, joints=(*robot.joints[:5], replace(robot.joints[5], kind="prismatic")))
    times = stopping_times(scenario.reaction, tmp_path, sliding)
    assert times is not None
    pose = np.array([STRETCHED]) * DEG
    slow, *levels = (times.by_joint(sliding, pose, np.full((1, 6), v))[0] for v in (0.3, *times.rate[times.rate > 0]))
    longest = np.max(levels)
    assert slow[5] == pytest.approx(longest, rel=1e-12)
    assert slow[4] < longest


@pytest.mark.parametrize("carriage", [0.0, 3.0])
def test_an_arm_on_a_rail_takes_the_longest_time_of_all_extensions(tmp_path: Path, carriage: float) -> None:
    """Stretched at the rail's beginning it counted as folded, and stopped in half of the table's way."""
    rows = "extension_percent,speed_deg_s,distance_2_deg\n33,30,3\n33,100,10\n100,30,6\n100,100,20\n"
    scenario = one_joint(tmp_path, 1, 1.0, rows, STRETCHED, stop_category=1)
    arm = bs.Robot.load("ur10e")
    joints = tuple(replace(joint, inertia=None) for joint in arm.joints)
    rail = bs.Joint(name="rail", link="carriage", kind="prismatic", axis=(0, 1, 0), lower=0.0, upper=3.0, velocity=1.0)
    moved = bs.Robot(name="on a rail", joints=(rail, *joints), tip_origin=arm.tip_origin)
    times = stopping_times(scenario.reaction, tmp_path, moved)
    found = times.by_joint(moved, np.array([[carriage, *STRETCHED]]), np.eye(7)[1:2])
    assert found[0, 1] == pytest.approx(0.4)
    assert times.levels is None
    assert any("Joint 1 slides" in note for note in times.notes)
    assert stopping_times(scenario.reaction, tmp_path, arm).levels == (0.33, 1.0)


def test_brakes_without_a_payload_are_noted(tmp_path: Path) -> None:
    """A joint that stops sooner may leave the tip farther, so the longest time of every joint is no bound."""
    told = [
        " ".join(bs.CollisionProblem.from_scenario(line(tmp_path, grid(plain), **table, **more)).notes)
        for table in ({"kind": "stop", "deceleration": "table", "stopping_table": "table.csv"},)
        for more in ({"stop_category": 0}, {"stop_category": 1})
    ]
    assert ["a known payload may go farther" in text for text in told] == [True, False]
    assert all("of every joint the longest time of all payloads" in text for text in told)


@pytest.mark.parametrize(
    ("table", "reaction", "field", "problem"),
    [
        (grid(plain).replace("distance_3", "distance_7"), {}, "reaction.stopping_table", "has joint 7"),
        (grid(plain).replace("\n100,", "\n90,"), {"payload_percent": 95.0}, "reaction.payload_percent", "above the"),
        (
            grid(plain).replace("payload_percent", "payload_kg"),
            {"payload_percent": 95.0},
            "reaction.payload_percent",
            "kg",
        ),
        ("speed_deg_s,distance_1_deg\n1,1\n2,2\n", {"payload_kg": 1.0}, "reaction.payload_kg", "no meaning"),
        (grid(plain).replace("_deg", "_mm"), {}, "reaction.stopping_table", "lengths"),
        ("speed_deg_s,distance_1_deg\n1,1\n", {}, "reaction.stopping_table", "one distance"),
        (
            "category,speed_deg_s,distance_1_deg\n0,1,1\n0,2,2\n1,1,1\n1,2,2\n",
            {},
            "reaction.stop_category",
            "is not given, and",
        ),
        (
            "category,speed_deg_s,distance_1_deg\n0,1,1\n0,2,2\n",
            {"stop_category": 1},
            "reaction.stop_category",
            "1 is not",
        ),
    ],
)
def test_tables_that_do_not_fit_are_refused(
    tmp_path: Path, table: str, reaction: dict[str, Any], field: str, problem: str
) -> None:
    with pytest.raises(bs.InputError) as refused:
        bs.CollisionProblem.from_scenario(one_joint(tmp_path, 1, 1.0, table, STRETCHED, **reaction))
    assert refused.value.field == field
    assert problem in str(refused.value)


@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_a_table_of_constant_times_is_constant_time(tmp_path: Path, kind: str) -> None:
    table = grid(lambda p, e, v, j: 0.1 * v)
    tabled = line(tmp_path, table, kind=kind, deceleration="table", stopping_table="table.csv")
    timed = line(tmp_path, table, kind=kind, deceleration="constant_time", stopping_time_s=0.2)
    curves = [
        bs.stopping_curve(bs.CollisionProblem.from_scenario(one), whole=True).max_distance for one in (tabled, timed)
    ]
    np.testing.assert_allclose(curves[0], curves[1], rtol=0, atol=2e-9)
    batch = bs.evaluate_batch(
        tabled, *(np.array([x]) for x in (bs.CollisionProblem.from_scenario(tabled).q, [0.08, 0.04, -0.06]))
    )
    assert batch.mean[0] == pytest.approx(bs.evaluate(timed).peak_force.mean, rel=1e-5)


def test_brakes_of_a_table_stop_every_joint_in_its_own_time(tmp_path: Path) -> None:
    """Category 0: the same rates, but each joint falls to zero in its own time; the farthest point is another one."""
    table = grid(lambda p, e, v, j: 0.05 * v * j)
    scenarios = [
        line(tmp_path, table, kind="stop", deceleration="table", stopping_table="table.csv", **category)
        for category in ({"stop_category": 0}, {"stop_category": 1})
    ]
    problems = [bs.CollisionProblem.from_scenario(one) for one in scenarios]
    brakes, drives = (bs.stopping_curve(problem, whole=True) for problem in problems)
    assert not np.allclose(brakes.max_distance, drives.max_distance, atol=1e-5)
    # By hand, from the first tick: every joint goes on for v T / 2, less half a sub-step.
    problem, h = problems[0], 0.0002
    state = np.asarray(brakes.line.reaction_state)[0]
    times = np.array([0.1, 0.2, 0.3, 0.3, 0.3, 0.3])
    t = np.arange(0, 0.3001, 0.001)[:, None]
    n = np.minimum(t, times) / h
    way = h * (n - n * (n + 1) / (2 * times / h))
    q = state[0] + state[1] * way
    link, point = problem.contact_point
    place = problem.robot.chain.poses(np.ascontiguousarray(q), link, point)[:, :3, 3]
    assert float(((place - brakes.start) @ brakes.normal).max()) == pytest.approx(brakes.max_distance[0], abs=2e-6)


def test_the_limit_of_even_time_is_the_stop_of_the_ramp() -> None:
    """Twice the distance over the speed, of the distance that the law of tables says."""
    from bumpstop.collision.stopping.deceleration_laws import ramp_distance

    v, a = np.array([0.1, 0.5, 2.0]), 4.0
    law = Deceleration(law="ramp", ramp_time=0.2)
    np.testing.assert_allclose(
        law.even_time(v / a), 2 * ramp_distance(v, np.full(3, a), np.array([0.0, 0.2])) / v, rtol=1e-12
    )


def test_a_speed_that_rows_of_other_joints_say_again_changes_nothing(tmp_path: Path) -> None:
    """Below its slowest row the time of joint 1 grows toward rest, as without the second row of joint 2."""
    head, again = "speed_1_deg_s,speed_2_deg_s,distance_1_deg,distance_2_deg\n", "50,60,10,15\n"
    first, *_, last = rows = ["50,30,10,5\n", again, "100,90,15,30\n"]
    problems = [
        bs.CollisionProblem.from_scenario(
            line(tmp_path, head + "".join(each), kind="stop", deceleration="table", stopping_table="table.csv")
        )
        for each in (rows, (first, last))
    ]
    found = [p.deceleration.times.by_joint(p.robot, np.zeros((1, 6)), np.full((1, 6), 10 * DEG)) for p in problems]
    assert found[0][0, 0] == pytest.approx(found[1][0, 0]) == pytest.approx(0.48)
