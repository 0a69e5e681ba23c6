"""Trajectory messages: one motion, however it is written, and nothing but times and rates changed."""

from __future__ import annotations

import json
import re
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

import bumpstop as bs
from bumpstop.arrays import FloatArray
from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.collision.trajectory.trajectory_file import read_rows
from bumpstop.program.evaluation import evaluate_program
from bumpstop.program.safe_speed import highest_safe
from bumpstop.program.source import Source, read_source
from bumpstop.program.trajectories.bag import BagProgram, read_bag_trajectories
from bumpstop.program.trajectories.messages import MessageProgram, read_messages
from program.corpora import EXAMPLES, cell


def messages(path: Path) -> MessageProgram:
    source = read_source(path, cell(), 1.0)
    assert isinstance(source, MessageProgram)
    return source


def test_a_display_trajectory_has_a_segment_for_each_part() -> None:
    found = messages(EXAMPLES / "planned.json")
    assert [(s.name, s.lines) for s in found.segments] == [("trajectory[0]", (2, 22)), ("trajectory[1]", (23, 33))]
    assert found.segments[0].given.duration == pytest.approx(1.2)


def test_the_line_of_a_place_is_that_of_its_point() -> None:
    """Points of several lines."""
    (segment,) = messages(EXAMPLES / "planned.yaml").segments
    at = [segment.line_at(time, segment.given) for time in (0.0, 0.75, 1.5)]
    assert at == [4, 19, 34] == [segment.lines[0], 19, segment.lines[1]]


@pytest.mark.parametrize("name", ["planned.json", "planned.yaml"])
def test_only_times_and_rates_change(name: str) -> None:
    found = messages(EXAMPLES / name)
    assert found.written({}) == found.source
    new = found.written(dict.fromkeys(found.segments, 0.5))
    again = read_messages(Path(name), new, cell())
    for old, other in zip(found.segments, again.segments, strict=True):
        assert (old.position == other.position).all()
        time, velocity, _ = old.rows_at(0.5)
        assert np.allclose(other.time - other.time[0], time, atol=2e-9)
        assert other.velocity is not None
        assert np.allclose(other.velocity, velocity, atol=1e-12)
        # Velocities are those of the times: the cubics through them turn no joint back.
        t = np.linspace(0, other.given.duration, 500)
        assert (np.diff(other.given.at(t)[:, 0]) >= -1e-7).all()


def test_evaluate_reads_what_is_written(tmp_path: Path) -> None:
    found = messages(EXAMPLES / "planned.yaml")
    (segment,) = found.segments
    (tmp_path / "new.yaml").write_bytes(found.written({segment: 0.7}))
    rows = read_rows(tmp_path / "new.yaml", cell().robot)
    assert np.allclose(rows.time, segment.at(0.7).time, atol=2e-9)
    assert np.allclose(rows.velocity, segment.at(0.7).velocity, atol=1e-12)  # type: ignore[arg-type]


def quintic(share: FloatArray) -> tuple[FloatArray, ...]:
    """Positions, velocities and accelerations of a quintic from rest to rest, at shares of its 6.5 s."""
    s, t = share[:, None], 6.5
    begin, way = np.array([0, -1.57, 1.57, -1.57, -1.57, 0]), np.array([0.4, 0.27, -0.07, -0.2, 0, 0])
    rate, bend = 30 * (s - s**2) ** 2 / t, 60 * s * (1 - s) * (1 - 2 * s) / t**2
    return begin + (10 * s**3 - 15 * s**4 + 6 * s**5) * way, rate * way, bend * way


def of_quintic(rows: int) -> MessageProgram:
    share = np.linspace(0, 1, rows)
    names = ("time_from_start", "positions", "velocities", "accelerations")
    values = zip(*(part.tolist() for part in (6.5 * share, *quintic(share))), strict=True)
    points = [dict(zip(names, point, strict=True)) for point in values]
    message = {"joint_names": [joint.name for joint in cell().robot.joints], "points": points}
    return read_messages(Path("m.json"), json.dumps(message).encode(), cell())


@pytest.mark.parametrize("rows", [2, 3, 7, 40])
def test_points_with_accelerations_are_joined_by_quintics(rows: int) -> None:
    """As controllers of ROS join them: the same motion, however many points tell it."""
    (segment,) = of_quintic(rows).segments
    share = np.linspace(0, 1, 2000)
    position, velocity, _ = quintic(share)
    assert np.allclose(segment.given.at(6.5 * share), position, atol=1e-6)
    assert np.allclose(segment.given.at(6.5 * share, 1), velocity, atol=1e-5)


@pytest.mark.parametrize("rows", [3, 7])
def test_points_with_accelerations_are_written_as_they_are_judged(rows: int) -> None:
    found = of_quintic(rows)
    (segment,) = found.segments
    (again,) = read_messages(Path("m.json"), found.written({segment: 0.6}), cell()).segments
    t = np.linspace(0, segment.at(0.6).duration, 500)
    assert np.allclose(again.given.at(t, 1), segment.at(0.6).at(t, 1), atol=1e-6)


def test_a_segment_beside_a_slower_one_moves_as_it_was_judged(tmp_path: Path) -> None:
    """What is written of the row where they meet, at no rest, holds for both."""
    h = np.array([0, 0.5, 1, 0.5, 0])[:, None]
    t, sign = np.array([6, 6, 6, 3, 3])[:, None], np.array([1, 1, 1, -1, -1])[:, None]
    begin, way = np.array([0, -1.57, 1.57, -1.57, -1.57, 0]), np.array([0.4, 0.27, -0.07, -0.2, 0, 0])
    q, qd, qdd = begin + (3 * h**2 - 2 * h**3) * way, sign * 6 * (h - h**2) / t * way, (6 - 12 * h) / t**2 * way
    values = zip(q.tolist(), qd.tolist(), qdd.tolist(), (0, 3, 6, 7.5, 9), strict=True)
    names = ("positions", "velocities", "accelerations", "time_from_start")
    points = [dict(zip(names, value, strict=True)) for value in values]
    message = {"joint_names": [joint.name for joint in cell().robot.joints], "points": points}
    (tmp_path / "m.json").write_text(json.dumps(message))
    scenario = bs.load_scenario(EXAMPLES / "cell.toml")
    found = evaluate_program(tmp_path / "m.json", scenario, faster=False)
    assert [one.present.conclusion for one in found.segments] == ["acceptable", "not_acceptable"]
    assert found.written_outcome == "PASS"
    found.source.write(found.factors, tmp_path / "new.json")
    again = read_source(tmp_path / "new.json", cell(), 1.0)
    for one, other in zip(found.segments, again.segments, strict=True):
        assert cell().tool_speed(other.at(1.0)) == pytest.approx(one.written.tool_speed, rel=1e-3)


def changed(change: dict[str, Any]) -> bytes:
    data = json.loads((EXAMPLES / "planned.json").read_text())
    message = data["trajectory"][0]["joint_trajectory"]
    for key, value in change.items():
        if key == "joint_names":
            message[key] = value
        else:
            message["points"][3][key] = value
    return json.dumps(data).encode()


@pytest.mark.parametrize("points", [2, 3, 5, 41])
def test_points_without_velocities_are_left_and_reached_at_rest(points: int) -> None:
    """A spline that does not rest there was judged as if the arm went on, and no speed of it was safe."""
    t = np.linspace(0, 6, points)
    share = (t / 6) ** 3 * (10 - 15 * (t / 6) + 6 * (t / 6) ** 2)
    start, way = np.array(cell().start), np.array([0.6, 0.2, -0.2, 0, 0.1, 0])
    places = [(start + s * way).tolist() for s in share]
    rows = [{"positions": q, "time_from_start": at} for q, at in zip(places, t.tolist(), strict=True)]
    text = json.dumps({"joint_names": [joint.name for joint in cell().robot.joints], "points": rows})
    (segment,) = read_messages(Path("m.json"), text.encode(), cell()).segments
    for factor in (1.0, 0.6):
        motion = segment.at(factor)
        spline = CubicSpline(motion.time, motion.position, bc_type="clamped")
        at = np.linspace(0, motion.duration, 999)
        assert np.abs(motion.at(at, 1) - spline(at, 1)).max() < 1e-12
        # A controller that goes straight from point to point is nowhere faster than the joint is between the two.
        mean = np.abs(np.diff(motion.position, axis=0) / np.diff(motion.time)[:, None])
        between = [np.abs(motion.at(np.linspace(*ends, 99), 1)).max(axis=0) for ends in pairwise(motion.time)]
        assert (mean <= np.array(between) + 1e-12).all()
    safe = highest_safe(segment, cell(), 1.0, cell().judge(segment.at(1.0)))
    assert safe.factor > 0.3
    assert safe.judged is not None
    assert safe.judged.conclusion == "acceptable"


def test_a_joint_beyond_its_limit_is_named_without_rows_that_are_in_no_file() -> None:
    rows = [{"positions": [3.0 * t, -1.57, 1.57, -1.57, -1.57, 0], "time_from_start": t} for t in (0, 1)]
    text = json.dumps({"joint_names": [joint.name for joint in cell().robot.joints], "points": rows})
    (segment,) = read_messages(Path("m.json"), text.encode(), cell()).segments
    said = "at t = 0.5 s joint 1 moves at 4.5 rad/s; its limit is 2.094 rad/s"
    assert cell().judge(segment.at(1.0)).reason == said


def test_a_joint_outside_its_limits_is_named_with_them_and_when() -> None:
    """Of a row and between rows, without the rows that are in no file."""
    limits = "outside its limits; valid: -6.28319 to 6.28319 rad"
    for at, rate, said in (
        ([6.0, 6.4], None, rf"at t = 1 s joint 1 at 6\.4 is {limits}"),
        ([6.0, 6.2], [1.5, -1.5], rf"at t = 0\.\d+ s the curve through the rows takes joint 1 to 6\.\d+, {limits}"),
    ):
        q = np.array([[x, -1.57, 1.57, -1.57, -1.57, 0] for x in at])
        qd = None if rate is None else np.outer(rate, np.eye(6)[0])
        assert re.fullmatch(said, cell().judge(Trajectory(np.array([0.0, 1.0]), q, qd)).reason)


def test_a_message_that_begins_elsewhere_is_named() -> None:
    data = json.loads((EXAMPLES / "planned.json").read_text())
    assert not read_messages(Path("planned.json"), json.dumps(data).encode(), cell()).notes
    data["trajectory"][1]["joint_trajectory"]["points"].pop(0)
    data["trajectory"][1]["joint_trajectory"]["points"].pop(0)
    data["trajectory"][1]["joint_trajectory"]["points"][0]["time_from_start"] = 0
    (note,) = read_messages(Path("planned.json"), json.dumps(data).encode(), cell()).notes
    said = "the first point is at 0 s, and is not where the arm is then: the way there is not in the file, nor judged"
    assert note == f"trajectory[1]: {said}"


def test_whole_numbers_behind_a_zero_are_to_base_8_and_not_taken() -> None:
    """``nanosec: 050000000`` is 10 ms to the readers of YAML that ROS has, and was 50 ms here."""
    text = (EXAMPLES / "planned.yaml").read_text()
    padded = re.sub(r"nanosec: ([1-9][0-9]+)", r"nanosec: 0\1", text)
    assert padded != text
    found = read_messages(Path("planned.yaml"), padded.encode(), cell())
    assert not found.segments
    assert found.moves_unseen


def test_the_way_to_a_first_point_that_comes_later_is_named() -> None:
    data = json.loads((EXAMPLES / "planned.json").read_text())
    for part in data["trajectory"]:
        for point in part["joint_trajectory"]["points"]:
            point["time_from_start"]["sec"] += 1
    found = read_messages(Path("planned.json"), json.dumps(data).encode(), cell())
    # The second message begins where the first one ends, unless its first point is missing.
    assert [bool(segment.why) for segment in found.segments] == [True, False, False]
    assert found.segments[0].name == "trajectory[0], first point"
    assert found.segments[0].why == "how the arm gets to its first point in 1 s is not in the message"
    data["trajectory"][1]["joint_trajectory"]["points"].pop(0)
    data["trajectory"][0]["joint_trajectory"]["points"][0]["positions"] = cell().start.tolist()  # type: ignore[union-attr]
    later = read_messages(Path("planned.json"), json.dumps(data).encode(), cell())
    assert [bool(segment.why) for segment in later.segments] == [False, True, False]
    new = read_messages(Path("planned.json"), found.written({found.segments[1]: 0.5}), cell())
    assert [rows.time[0] for rows, *_ in new.messages] == [1, 1]


def test_a_first_point_where_the_arm_stands_that_it_passes_at_a_rate_is_named() -> None:
    stands = cell().start
    assert stands is not None
    names, way = [joint.name for joint in cell().robot.joints], np.array([0.5, 0, 0, 0, 0, 0])
    for rate, known in ((0.0, True), (0.5, False)):
        points = [
            {"positions": stands.tolist(), "velocities": (rate * way).tolist(), "time_from_start": 2.0},
            {"positions": (stands + way).tolist(), "velocities": [0] * 6, "time_from_start": 4.0},
        ]
        message = json.dumps({"joint_names": names, "points": points}).encode()
        found = read_messages(Path("m.json"), message, cell()).segments
        assert [bool(segment.why) for segment in found] == ([False] if known else [True, False])


def test_what_a_message_that_is_not_understood_leaves_is_not_known() -> None:
    data = json.loads((EXAMPLES / "planned.json").read_text())
    first, second = (part["joint_trajectory"] for part in data["trajectory"])
    for point in second["points"]:
        point["time_from_start"]["sec"] += 1
    between = {"joint_names": first["joint_names"], "points": [{"positions": [1.0] * 6}]}
    gripper = {"joint_names": ["finger"], "points": [{"positions": [1.0]}]}
    for message, known in ((between, False), (gripper, True)):
        data["trajectory"].insert(1, {"joint_trajectory": message})
        found = read_messages(Path("x.json"), json.dumps(data).encode(), cell())
        assert [bool(segment.why) for segment in found.segments] == ([False] * 2 if known else [False, True, False])
        assert found.moves_unseen != known
        data["trajectory"].pop(1)


@pytest.mark.parametrize(
    ("change", "why"),
    [
        ({"joint_names": ["a", "b"]}, "joints are not those of ur10e"),
        ({"positions": [1, 2]}, "point 4 has no positions of all joints"),
        ({"positions": ["x"] * 6}, "point 4 has no positions of all joints"),
        ({"velocities": [1]}, "point 4 has not one velocity for each joint"),
        ({"time_from_start": {"sec": 0, "nanosec": 0}}, "point 4 is not after the one before it"),
        ({"velocities": [1e200] * 6}, "point 4 has a velocity of 1e+200, over 10000"),
        ({"positions": [0, 0, -2e4, 0, 0, 0]}, "point 4 has a position of 2e+04, over 10000"),
        ({"time_from_start": {"sec": 0}}, "point 4 has no positions of all joints or no time"),
    ],
)
def test_a_message_that_is_not_understood_is_named_and_left(change: dict[str, Any], why: str) -> None:
    source = changed(change)
    found = read_messages(Path("x.json"), source, cell())
    ((_, text),) = found.not_understood
    assert text.startswith("trajectory[0]: ")
    assert why in text
    assert [segment.name for segment in found.segments] == ["trajectory[1]"]
    first, second = (json.loads(text)["trajectory"] for text in (source, found.written({found.segments[0]: 0.5})))
    assert first[0] == second[0]
    assert first[1] != second[1]


def test_joints_in_any_order() -> None:
    data = json.loads((EXAMPLES / "planned.json").read_text())
    for part in data["trajectory"]:
        message = part["joint_trajectory"]
        message["joint_names"] = message["joint_names"][::-1]
        for point in message["points"]:
            for key in ("positions", "velocities", "accelerations"):
                point[key] = point[key][::-1]
    turned = read_messages(Path("x.json"), json.dumps(data).encode(), cell())
    found = messages(EXAMPLES / "planned.json")
    assert (turned.segments[0].position == found.segments[0].position).all()
    factors = dict.fromkeys(turned.segments, 0.5)
    new = json.loads(turned.written(factors))["trajectory"][0]["joint_trajectory"]["points"]
    same = json.loads(found.written(dict.fromkeys(found.segments, 0.5)))["trajectory"][0]["joint_trajectory"]["points"]
    assert [point["velocities"][::-1] for point in new] == [point["velocities"] for point in same]


def test_an_empty_part_of_a_message_is_no_trajectory() -> None:
    """Goals of ``FollowJointTrajectory`` have one for what stands on no joints."""
    goal = json.loads((EXAMPLES / "planned.json").read_text())["trajectory"][0]["joint_trajectory"]
    data = {"trajectory": goal, "multi_dof_trajectory": {"joint_names": [], "points": []}}
    found = read_messages(Path("x.json"), json.dumps(data).encode(), cell())
    assert len(found.segments) == 1
    assert not found.not_understood


def bag(folder: Path, mcap: bool, *, base_moves: bool = False) -> Path:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    robot_type, joint_type = "moveit_msgs/msg/RobotTrajectory", "trajectory_msgs/msg/JointTrajectory"
    definition = "trajectory_msgs/JointTrajectory joint_trajectory\ntrajectory_msgs/MultiDOFJointTrajectory m"
    store.register(get_types_from_msg(definition.replace(" m", " multi_dof_joint_trajectory"), robot_type))
    types = store.types
    time, nothing = types["builtin_interfaces/msg/Time"](0, 0), np.zeros(0)
    header = types["std_msgs/msg/Header"](time, "")
    made = []
    for part in json.loads((EXAMPLES / "planned.json").read_text())["trajectory"]:
        points = [
            types["trajectory_msgs/msg/JointTrajectoryPoint"](
                *(np.array(point[key], dtype=np.float64) for key in ("positions", "velocities", "accelerations")),
                nothing,
                types["builtin_interfaces/msg/Duration"](**point["time_from_start"]),
            )
            for point in part["joint_trajectory"]["points"]
        ]
        made.append(types[joint_type](header, part["joint_trajectory"]["joint_names"], points))
    plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
    with Writer(folder / "bag", version=9, storage_plugin=plugin) as writer:
        words = writer.add_connection("/said", "std_msgs/msg/String", typestore=store)
        writer.write(words, 1, bytes(store.serialize_cdr(types["std_msgs/msg/String"]("up"), "std_msgs/msg/String")))
        one = writer.add_connection("/plan", joint_type, typestore=store)
        writer.write(one, 2, bytes(store.serialize_cdr(made[0], joint_type)))
        other = writer.add_connection("/moveit", robot_type, typestore=store)
        still = types["trajectory_msgs/msg/MultiDOFJointTrajectoryPoint"](
            [], [], [], types["builtin_interfaces/msg/Duration"](1, 0)
        )
        multi = types["trajectory_msgs/msg/MultiDOFJointTrajectory"](header, [], [still] * base_moves)
        writer.write(other, 3, bytes(store.serialize_cdr(types[robot_type](made[1], multi), robot_type)))
    return folder / "bag"


@pytest.mark.parametrize("kind", ["file", "bag"])
def test_a_base_that_moves_leaves_the_program_open(kind: str, tmp_path: Path) -> None:
    if kind == "bag":
        found: Any = read_bag_trajectories(bag(tmp_path, True, base_moves=True), cell())
    else:
        data = json.loads((EXAMPLES / "planned.json").read_text())
        part = data["trajectory"][0]
        point = {"transforms": [{"translation": {"x": 1}}], "time_from_start": {"sec": 1}}
        part["multi_dof_joint_trajectory"] = {"joint_names": ["base"], "points": [point]}
        found = read_messages(Path("x.json"), json.dumps(data).encode(), cell())
    assert found.moves_unseen
    assert any("moves what the arm stands on" in text for _, text in found.not_understood)
    assert found.segments


@pytest.mark.parametrize("mcap", [True, False])
def test_bags(mcap: bool, tmp_path: Path) -> None:
    from rosbags.rosbag2 import Reader

    path = bag(tmp_path, mcap)
    source: Source = read_source(path, cell(), 1.0)
    assert isinstance(source, BagProgram)
    assert [segment.name for segment in source.segments] == ["/plan 2", "/moveit 3"]
    plain = messages(EXAMPLES / "planned.json")
    assert (source.segments[1].position == plain.segments[1].position).all()
    source.write({source.segments[0]: 0.5}, tmp_path / "new")
    again = read_bag_trajectories(tmp_path / "new", cell())
    time, velocity, _ = source.segments[0].rows_at(0.5)
    assert np.allclose(again.segments[0].time, time, atol=2e-9)
    assert np.allclose(again.segments[0].velocity, velocity)  # type: ignore[arg-type]
    with Reader(path) as before, Reader(tmp_path / "new") as after:
        old, new = ([(c.topic, t, bytes(body)) for c, t, body in reader.messages()] for reader in (before, after))
    assert [one[:2] for one in old] == [one[:2] for one in new]
    assert [one == other for one, other in zip(old, new, strict=True)] == [True, False, True]
