"""Trajectories that an arm is sent one after the other: when each comes, and where the arm is then."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from bumpstop.program.trajectories.bag import read_bag_trajectories
from bumpstop.program.trajectories.retimed_message import MessageRows, position_at
from program.corpora import cell

TYPE = "trajectory_msgs/msg/JointTrajectory"


def turned(angle: float) -> list[float]:
    """Joint positions of the cell's pose, the first joint elsewhere [rad]."""
    return [angle, *np.radians([-90, 90, -90, -90, 0])]


def sent(folder: Path, *messages: tuple[float, Sequence[tuple[float, float]]]) -> Path:
    """A bag of messages: when each was sent [s], and times [s] and first joints [rad] of its points, each at rest."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    header = types["std_msgs/msg/Header"](types["builtin_interfaces/msg/Time"](0, 0), "")
    names, none = [joint.name for joint in cell().robot.joints], np.zeros(0)
    with Writer(folder / "bag", version=9) as writer:
        into = writer.add_connection("/arm/joint_trajectory", TYPE, typestore=store)
        for stamp, rows in messages:
            points = []
            for t, angle in rows:
                duration = types["builtin_interfaces/msg/Duration"](int(t), round(t % 1 * 1e9))
                position = np.array(turned(angle))
                point = types["trajectory_msgs/msg/JointTrajectoryPoint"](position, np.zeros(6), none, none, duration)
                points.append(point)
            body = store.serialize_cdr(types[TYPE](header, names, points), TYPE)
            writer.write(into, round(stamp * 1e9), bytes(body))
    return folder / "bag"


def stamps(path: Path) -> list[float]:
    from rosbags.rosbag2 import Reader

    with Reader(path) as reader:
        return [1e-9 * stamp for _, stamp, _ in reader.messages()]


THERE, BACK = [(0.0, 0.0), (2.0, 0.4)], [(0.0, 0.4), (2.0, 0.0)]


def test_a_trajectory_that_comes_too_early_begins_where_the_one_before_it_is(tmp_path: Path) -> None:
    told = "/arm/joint_trajectory 2: the first point is at 0 s, and is not where the arm is then"
    for stamp, second, early in (
        (2.0, BACK, False),
        (0.5, BACK, True),
        # A cubic from rest to rest is at 0.15625 of its way after a quarter of its time.
        (0.5, [(0.0, 0.0625), (2.0, 0.0)], False),
        (2.0, [(0.0, 0.0625), (2.0, 0.0)], True),
    ):
        folder = tmp_path / f"{stamp} {second[0]}"
        folder.mkdir()
        notes = read_bag_trajectories(sent(folder, (0.0, THERE), (stamp, second)), cell()).notes
        assert [note.startswith(told) for note in notes] == [True] * early


def test_how_an_arm_on_its_way_gets_to_a_later_first_point_is_not_known(tmp_path: Path) -> None:
    late = [(0.5, 0.4), (2.0, 0.0)]
    for stamp, known in ((2.0, True), (1.0, False)):
        (tmp_path / str(stamp)).mkdir()
        found = read_bag_trajectories(sent(tmp_path / str(stamp), (0.0, THERE), (stamp, late)), cell())
        assert [bool(segment.why) for segment in found.segments] == [False, *[True] * (not known), False]


def test_what_follows_a_slower_trajectory_is_sent_later(tmp_path: Path) -> None:
    """Else the next one would cut it off on its way."""
    source = read_bag_trajectories(sent(tmp_path, (0.0, THERE), (2.5, BACK), (5.0, THERE)), cell())
    first, second, _ = source.segments
    for number, factors in enumerate(({first: 0.5}, {first: 2.0}, {first: 0.5, second: 0.4})):
        path = tmp_path / f"new {number}"
        source.write(factors, path)
        again = read_bag_trajectories(path, cell())
        assert not again.notes
        longer = [max(0.0, float(segment.time[-1]) - 2.0) for segment in again.segments]
        assert stamps(path) == pytest.approx([0.0, 2.5 + longer[0], 5.0 + longer[0] + longer[1]])


def test_where_a_message_has_the_arm_at_a_time() -> None:
    q = np.array([turned(0.1), turned(0.4)])
    rows = MessageRows(np.array([1.0, 3.0]), q, np.zeros((2, 6)), None, tuple(range(6)))
    for t, angle in ((0.0, 0.1), (2.0, 0.25), (9.0, 0.4)):
        assert position_at(rows, t) == pytest.approx(turned(angle))
