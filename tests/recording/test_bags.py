"""ROS 2 bags: topics, names, layouts, damage."""

from __future__ import annotations

import sqlite3
import time
from contextlib import closing
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from rosbags.rosbag2 import CompressionFormat, CompressionMode, Reader, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

from bumpstop import InputError, Joint, Robot
from bumpstop.recording import Recording
from recording.cases import recording

STORE = get_typestore(Stores.ROS2_HUMBLE)
STATE = "sensor_msgs/msg/JointState"


def state(t: float, names: list[str], effort: bool = True) -> bytes:
    types = STORE.types
    stamp = types["builtin_interfaces/msg/Time"](sec=int(t), nanosec=round(1e9 * (t % 1)))
    header = types["std_msgs/msg/Header"](stamp=stamp, frame_id="")
    q = np.array([t + ord(name[0]) for name in names])
    message: Any = types[STATE](
        header=header, name=names, position=q, velocity=2 * q, effort=3 * q if effort else np.zeros(0)
    )
    return bytes(STORE.serialize_cdr(message, STATE))


def bag(folder: Path, plugin: StoragePlugin, topics: dict[str, list[bytes]], kind: str = STATE) -> Path:
    with Writer(folder / "bag", version=9, storage_plugin=plugin) as writer:
        for topic, bodies in topics.items():
            connection = writer.add_connection(topic, kind, typestore=STORE)
            for i, body in enumerate(bodies):
                writer.write(connection, i * 10_000_000, body)
    return folder / "bag"


@pytest.mark.parametrize("plugin", list(StoragePlugin))
@pytest.mark.parametrize("bare", [False, True])
def test_folder_and_bare_file(plugin: StoragePlugin, bare: bool, tmp_path: Path) -> None:
    path = bag(tmp_path, plugin, {"/joint_states": [state(5 + 0.01 * i, ["a", "b"]) for i in range(50)]})
    if bare:
        (path / "metadata.yaml").unlink()
        (path,) = path.iterdir()
    found = Recording.load(path)
    assert found.joint_names == ("a", "b")
    np.testing.assert_allclose(found.t, 0.01 * np.arange(50), atol=1e-9)
    np.testing.assert_allclose(found.q[:, 1], 5 + found.t + ord("b"))
    assert found.tau is not None
    np.testing.assert_allclose(found.tau, 3 * found.q)
    assert any("Time 0 is 5.0" in note for note in found.report.notes)


def test_what_is_no_bag_of_ros_2_says_what_helps(tmp_path: Path) -> None:
    """A compressed message was one that names no joints, and a bag of ROS 1 an unknown ending."""
    for mode, said in ((CompressionMode.FILE, "is compressed"), (CompressionMode.MESSAGE, "its messages are compress")):
        folder = tmp_path / mode.name
        writer = Writer(folder, version=9, storage_plugin=StoragePlugin.SQLITE3)
        writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            connection = writer.add_connection("/joint_states", STATE, typestore=STORE)
            for i in range(50):
                writer.write(connection, i * 10_000_000, state(5 + 0.01 * i, ["a", "b"]))
        assert Recording.load(folder).t.size == 50
        (file,) = folder.glob("*.db3*")
        with pytest.raises(InputError, match=f"{said}.*; give the bag's folder, with its metadata.yaml"):
            Recording.load(file)
    (tmp_path / "old.bag").write_bytes(b"#ROSBAG V2.0\n")
    with pytest.raises(InputError, match="is a bag of ROS 1; make one of ROS 2 of it, as rosbags-convert does"):
        Recording.load(tmp_path / "old.bag")


def test_a_file_that_the_metadata_leave_out_is_named(tmp_path: Path) -> None:
    """The third part of a split bag was left out without a word."""
    path = bag(tmp_path, StoragePlugin.MCAP, {"/joint_states": [state(0.01 * i, ["a", "b"]) for i in range(50)]})
    assert not any("does not name" in note for note in Recording.load(path).report.notes)
    (path / "bag_1.mcap").write_bytes((path / "bag.mcap").read_bytes())
    (note,) = [note for note in Recording.load(path).report.notes if "does not name" in note]
    assert note.startswith("bag_1.mcap is in the bag's folder")
    # Nor does a name within another count.
    (path / "bag_1.mcap").rename(path / "ag.mcap")
    assert any(note.startswith("ag.mcap is in the bag's folder") for note in Recording.load(path).report.notes)


def test_a_bag_is_written_where_its_name_says(tmp_path: Path) -> None:
    """Not into a folder of that name, and into the file that a link leads to."""
    folder, link, file = tmp_path / "dir.mcap", tmp_path / "link.mcap", tmp_path / "real.mcap"
    folder.mkdir()
    with pytest.raises(InputError, match=r"dir\.mcap: cannot be written \(Is a directory\)"):
        recording().save(folder)
    assert list(folder.iterdir()) == []
    file.write_text("before")
    link.symlink_to(file.name)
    recording().save(link)
    assert link.is_symlink()
    assert Recording.load(file).t.size == 200
    assert {path.name for path in tmp_path.iterdir()} == {"dir.mcap", "link.mcap", "real.mcap"}


def test_messages_without_a_time_are_bad_rows(tmp_path: Path) -> None:
    """One that was not stamped, among times of a wall clock, and one with a second or more of nanoseconds."""
    bodies = [bytearray(state(0.01 * i, ["a", "b"])) for i in range(400)]
    for i, body in enumerate(bodies[1:], start=1):
        body[4:8] = (1_700_000_000 + i // 100).to_bytes(4, "little")
    bodies[30][8:12] = (1_500_000_000).to_bytes(4, "little")
    found = Recording.load(bag(tmp_path, StoragePlugin.MCAP, {"/s": [bytes(body) for body in bodies]}))
    assert found.report.counts == {"not a number": 2}
    assert [row for row, _ in found.report.dropped] == [1, 31]
    assert (found.t[0], found.t.size) == (0.0, 398)
    assert found.t[-1] == pytest.approx(3.98, abs=1e-6)
    # Times of a simulation begin at zero.
    again = Recording.load(
        bag(tmp_path / "sim", StoragePlugin.MCAP, {"/s": [state(0.01 * i, ["a"]) for i in range(400)]})
    )
    assert again.t.size == 400


def test_names_are_put_in_order_and_other_joints_left_out(tmp_path: Path) -> None:
    bodies = [state(0.01 * i, ["c", "a", "b"] if i % 2 else ["b", "a", "grip"]) for i in range(50)]
    bodies[10:20] = [state(0.01 * i, ["grip"]) for i in range(10, 20)]
    found = Recording.load(bag(tmp_path, StoragePlugin.MCAP, {"/s": bodies}), columns={"joint_names": ["a", "b"]})
    assert found.t.size == 40
    np.testing.assert_allclose(found.q, found.t[:, None] + [ord("a"), ord("b")])
    assert any("10 messages of other joints" in note for note in found.report.notes)
    with pytest.raises(InputError, match="no joint is called 'z'"):
        Recording.load(tmp_path / "bag", columns={"joint_names": ["a", "z"]})


@pytest.mark.parametrize(
    "columns",
    [
        {"position": {"columns": [2, 1]}},
        {"time": {"rate_hz": 10}},
        {"torque": {"columns": [1, 2], "file": "effort.csv"}},
    ],
)
def test_places_that_a_bag_would_pass_over_are_refused(columns: dict[str, Any], tmp_path: Path) -> None:
    path = bag(tmp_path, StoragePlugin.MCAP, {"/s": [state(0.1 * i, ["b", "a"]) for i in range(5)]})
    with pytest.raises(InputError, match=rf"columns.{next(iter(columns))}: .*; joint_names choose and order joints"):
        Recording.load(path, columns=columns)
    in_degrees = Recording.load(path, columns={"position": {"unit": "deg"}})
    np.testing.assert_allclose(in_degrees.q, np.radians(Recording.load(path).q))


def test_units_of_a_bag_are_those_of_its_joints_in_the_robots_order(tmp_path: Path) -> None:
    """A driver that counts in degrees and millimetres, and has no efforts."""
    joints = (
        Joint(name="b", link="b", lower=-4, upper=4, velocity=3),
        Joint(name="a", link="a", kind="prismatic", lower=-1, upper=1, velocity=1),
    )
    robot = Robot(name="slide", joints=joints)
    path = bag(tmp_path, StoragePlugin.MCAP, {"/s": [state(0.1 * i, ["a", "b"], effort=False) for i in range(5)]})
    units = {
        "position": {"unit": ["deg", "mm"]}, "velocity": {"unit": ["deg/s", "mm/s"]}, "torque": {"unit": ["Nm"] * 3}
    }  # fmt: skip
    found = Recording.load(path, columns=units, robot=robot)
    np.testing.assert_allclose(found.q[0], [np.radians(98), 0.097], rtol=1e-12)
    with pytest.raises(InputError, match=r"columns.position.unit: 'mm' is none of joint 'b', which turns"):
        Recording.load(path, columns={"position": {"unit": ["mm", "deg"]}}, robot=robot)


def test_two_joints_of_one_name_are_refused(tmp_path: Path) -> None:
    """The second would get what the first has."""
    path = bag(tmp_path, StoragePlugin.MCAP, {"/s": [state(0.1 * i, ["a", "b", "b"]) for i in range(5)]})
    with pytest.raises(InputError, match="a message has 2 joints called 'b'"):
        Recording.load(path)
    assert Recording.load(path, columns={"joint_names": ["a"]}).dof == 1


def test_effort_may_be_current_or_absent(tmp_path: Path) -> None:
    path = bag(tmp_path, StoragePlugin.MCAP, {"/s": [state(0.1 * i, ["a"]) for i in range(5)]})
    found = Recording.load(path, columns={"effort": "current"})
    assert found.tau is None
    assert found.current is not None
    (tmp_path / "two").mkdir()
    path = bag(tmp_path / "two", StoragePlugin.MCAP, {"/s": [state(0.1 * i, ["a"], effort=False) for i in range(5)]})
    assert Recording.load(path).tau is None


def test_topics(tmp_path: Path) -> None:
    bodies = [state(0.1 * i, ["a"]) for i in range(5)]
    path = bag(tmp_path, StoragePlugin.MCAP, {"/left": bodies, "/right": bodies})
    with pytest.raises(InputError, match="two or more hold joint states: /left, /right; choose one with --topic"):
        Recording.load(path)
    assert Recording.load(path, topic="/left").dof == 1
    with pytest.raises(InputError, match="no topic '/rigth'; did you mean '/right'"):
        Recording.load(path, topic="/rigth")


def test_other_message_type(tmp_path: Path) -> None:
    kind = "std_msgs/msg/Float64"
    body = bytes(STORE.serialize_cdr(STORE.types[kind](data=1.0), kind))
    path = bag(tmp_path, StoragePlugin.SQLITE3, {"/x": [body]}, kind)
    with pytest.raises(InputError, match=r"no topic holds sensor_msgs/msg/JointState; topics: /x \(std_msgs"):
        Recording.load(path)
    with pytest.raises(InputError, match="'/x' holds std_msgs/msg/Float64"):
        Recording.load(path, topic="/x")


@pytest.mark.parametrize("plugin", list(StoragePlugin))
def test_bag_that_ends_in_the_middle(plugin: StoragePlugin, tmp_path: Path) -> None:
    many = [state(0.01 * i, ["a", "b"]) for i in range(20000)]
    path = bag(tmp_path, plugin, {"/s": many})
    (file,) = (inner for inner in path.iterdir() if inner.suffix != ".yaml")
    data = file.read_bytes()
    file.write_bytes(data[: int(0.7 * len(data))])
    with pytest.raises(InputError, match=r"ends in the middle .* [1-9][0-9]{3,4} messages are readable"):
        Recording.load(file)


def test_lengths_without_end_in_a_damaged_bag_cost_no_minutes(tmp_path: Path) -> None:
    """A page whose 16 000 rows all say that they reach far beyond its end."""
    page = bytearray(b"\xff" * 65536)
    page[0], page[3:5] = 0x0D, (16383).to_bytes(2, "big")
    page[8 : 8 + 2 * 16383] = b"\x90\x00" * 16383
    first = bytearray(65536)
    first[:18] = b"SQLite format 3\x00" + (1).to_bytes(2, "big")
    file = tmp_path / "r.db3"
    file.write_bytes(first + page)
    begin = time.process_time()
    with pytest.raises(InputError, match=r"damaged .* 0 messages are readable"):
        Recording.load(file)
    assert time.process_time() - begin < 10


@pytest.mark.parametrize("size", [0, 256])
def test_a_damaged_size_of_pages_finds_no_messages(size: int, tmp_path: Path) -> None:
    file = tmp_path / "r.db3"
    file.write_bytes(b"SQLite format 3\0" + size.to_bytes(2, "big") + bytes(2000))
    with pytest.raises(InputError, match=r"damaged .* 0 messages are readable"):
        Recording.load(file)


@pytest.mark.parametrize("damage", ["timestamp = 'x'", "timestamp = x'00'", "data = 5"])
def test_a_cell_of_another_kind_is_damage(damage: str, tmp_path: Path) -> None:
    path = bag(tmp_path, StoragePlugin.SQLITE3, {"/s": [state(0.01 * i, ["a", "b"]) for i in range(20)]})
    (file,) = path.glob("*.db3")
    with closing(sqlite3.connect(file)) as base:
        base.execute(f"UPDATE messages SET {damage} WHERE id = 7")
        base.commit()
    with pytest.raises(InputError, match="the bag is damaged or ends in the middle"):
        Recording.load(file)


def test_unreadable_message_is_a_bad_row(tmp_path: Path) -> None:
    bodies = [state(0.01 * i, ["a", "b"]) for i in range(200)]
    bodies[7] = bodies[7][:40]
    report = Recording.load(bag(tmp_path, StoragePlugin.MCAP, {"/s": bodies})).report
    assert report.counts == {"unreadable message": 1}
    assert report.dropped[0][0] == 8
    assert report.rows_read == 200


def test_what_we_write_others_decode(tmp_path: Path) -> None:
    before = recording()
    before.save(tmp_path / "run.mcap")
    with Reader(tmp_path / "run.mcap") as reader:
        (connection,) = reader.connections
        assert (connection.topic, connection.msgtype) == ("/joint_states", STATE)
        messages: list[Any] = [STORE.deserialize_cdr(body, STATE) for *_, body in reader.messages()]
    assert messages[3].name == ["a", "b"]
    np.testing.assert_array_equal(np.array([message.position for message in messages]), before.q)
    np.testing.assert_array_equal(np.array([message.effort for message in messages]), before.tau)
    assert messages[150].header.stamp.sec == 1
    assert messages[150].header.stamp.nanosec == 500_000_000


def test_a_unit_that_would_not_count_is_refused(tmp_path: Path) -> None:
    path = bag(tmp_path, StoragePlugin.MCAP, {"/s": [state(0.1 * i, ["b", "a"]) for i in range(5)]})
    for effort, other, unit in (("current", "torque", "mNm"), ("torque", "current", "mA")):
        with pytest.raises(
            InputError, match=rf"columns.{other}: says nothing: .* for a {effort}; give effort = .{other}"
        ):
            Recording.load(path, columns={"effort": effort, other: {"unit": unit}})
    for name, unit in (("time", "ms"), ("reference", "deg"), ("wrench", "SI")):
        with pytest.raises(InputError, match=rf"columns.{name}: says nothing: joint states .*; leave {name} out"):
            Recording.load(path, columns={name: {"unit": unit}})
    found = Recording.load(path, columns={"effort": "current", "current": {"unit": "mA"}}).current
    assert found is not None
    np.testing.assert_allclose(found, 3e-3 * Recording.load(path).q)


def test_efforts_of_a_wrong_count_are_told(tmp_path: Path) -> None:
    bodies = [state(0.1 * i, ["b", "a"]) for i in range(20)]
    for i in (4, 5, 6):
        message: Any = STORE.deserialize_cdr(bodies[i], STATE)
        message.effort = np.ones(1)
        bodies[i] = bytes(STORE.serialize_cdr(message, STATE))
    notes = Recording.load(bag(tmp_path, StoragePlugin.MCAP, {"/s": bodies}), max_bad=0.5).report.notes
    assert any("3 messages have another number of efforts than of joints" in note for note in notes)
    assert not any("velocities" in note for note in notes)


def test_joints_in_messages_of_their_own_are_named(tmp_path: Path) -> None:
    bodies = [state(0.1 * i, ["a"] if i % 2 else ["b"]) for i in range(20)]
    path = bag(tmp_path, StoragePlugin.MCAP, {"/s": bodies})
    with pytest.raises(InputError, match=r"no message holds all joints together: a, b; choose .* joint_names"):
        Recording.load(path, columns={"joint_names": ["a", "b"]})
