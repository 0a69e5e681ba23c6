"""ROS 2 bags: folders, and bare ``.db3`` and ``.mcap`` files."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError, near_matches
from bumpstop.model import Robot
from bumpstop.recording.columns import Columns, Quantity
from bumpstop.recording.formats.joint_state import NO_TIME, alike, layout, numbers, stamps
from bumpstop.recording.formats.table import RawRecording

JOINT_STATE = "sensor_msgs/msg/JointState"
_PARTS = ("position", "velocity", "torque")
_STILL = 0.01  # a joint that moves by less stands [rad or m]
_ZSTD = b"\x28\xb5\x2f\xfd"  # a frame of it begins so, and a message with the order of its bytes
_WALL_NS = 100_000_000 * 1_000_000_000  # later than this is a clock on the wall, not one of a simulation


class _Gathered:
    """Rows taken from messages, by groups of one layout."""

    def __init__(self) -> None:
        self.number: list[npt.NDArray[np.int64]] = []
        self.stamp: list[npt.NDArray[np.int64]] = []
        self.parts: tuple[list[FloatArray], list[FloatArray], list[FloatArray]] = ([], [], [])
        self.faults: list[tuple[int, str]] = []
        self.others = 0
        self.wrong_counts = dict.fromkeys(_PARTS[1:], 0)
        self.left_out: list[FloatArray] = []


def read_bag(path: Path, columns: Columns, robot: Robot | None, topic: str | None) -> RawRecording:
    """Read the joint states of a bag; time counts from the first message.

    Args:
        path: of the bag's folder or of a bare file.
        columns: its ``topic``, ``effort``, ``joint_names`` and units hold.
        robot: whose joint names choose and order those of the messages, unless the column file has some.
        topic: before the column file's.

    Raises:
        InputError: cut short, no such topic, two that could be meant, another message type, other joint names.
    """
    received, bodies, chosen = _messages(_bag(path), topic or columns.topic)
    if not bodies:
        raise InputError(str(path), f"topic {chosen!r} holds no message")
    if all(body.startswith(_ZSTD) for body in bodies):
        raise InputError(str(path), "its messages are compressed", "give the bag's folder, with its metadata.yaml")
    wanted = columns.joint_names or (tuple(joint.name for joint in robot.joints) if robot is not None else ())
    base, other = ((), ()) if robot is None else (robot.base_joints, robot.other_joints)
    found, names = _gather(bodies, wanted, (*base, *other), path)
    notes = [
        f"{name} is in the bag's folder, and its metadata.yaml does not name it: it is not read (ros2 bag reindex)."
        for name in _unnamed_files(path)
    ]
    if found.others:
        notes.append(f"{found.others} messages of other joints on the topic are left out.")
    for kind, count in found.wrong_counts.items():
        if count:
            what = {"velocity": "velocities", "torque": "efforts"}[kind]
            notes.append(f"{count} messages have another number of {what} than of joints: these {what} are left out.")
    number = np.concatenate(found.number)
    order = np.argsort(number, kind="stable")
    number = number[order]
    stamp = np.concatenate(found.stamp)[order]
    if (stamp == 0).all():
        stamp = received[number]
        notes.append("The messages carry no time; the bag's own times of receiving them are used.")
    begin, t = _times(stamp)
    values: dict[str, FloatArray] = {"t": t[:, None]}
    if begin >= 1_000_000_000:
        notes.append(f"Time 0 is {begin // 1_000_000_000}.{begin % 1_000_000_000:09d} s of the bag's clock.")
    left_out = np.concatenate(found.left_out)[order].T
    moved = {
        name: span
        for name, column in zip((*base, *other), left_out, strict=True)
        if name not in names and (span := _moved(values["t"][:, 0], column))
    }
    if beside := [repr(name) for name in other if name in moved]:
        notes.append(f"Joints that the chain leaves out move: {', '.join(beside)}; what they carry is not known.")
    for name, part in zip(_PARTS, found.parts, strict=True):
        value = np.concatenate(part)[order]
        if name == "position" or not np.isnan(value).all():
            label = "current" if name == "torque" and columns.effort == "current" else name
            values[label] = columns.quantities.get(label, Quantity()).in_si(value, label)
    return RawRecording(
        values=values,
        rows=number + 1,
        rows_read=number.size + len(found.faults),
        numbered="message",
        faults=tuple(found.faults),
        joint_names=tuple(joint.name for joint in robot.joints) if robot and robot.dof == len(names) else names,
        notes=tuple(notes),
        base_motion={name: moved[name] for name in base if name in moved},
        other_joints=found.others,
    )


def _times(stamp: npt.NDArray[np.int64]) -> tuple[int, FloatArray]:
    """The first time [ns], and (N,) times after it [s]; NaN where a message has none.

    Beside times of a clock on the wall a zero is none: the message was not stamped.
    """
    known = stamp != NO_TIME
    if known.any() and np.median(stamp[known]) > _WALL_NS:
        known &= stamp != 0
    begin = int(stamp[known][0]) if known.any() else 0
    return begin, np.where(known, (np.where(known, stamp, begin) - begin) * 1e-9, np.nan)


def _moved(t: FloatArray, position: FloatArray) -> tuple[float, float] | None:
    """From when to when [s] a joint moved (N,); None: it did not, or was not recorded."""
    known = np.isfinite(position) & np.isfinite(t)
    t, position = t[known], position[known]
    if not t.size or np.ptp(position) < _STILL:
        return None
    away, back = (np.abs(position - position[end]) >= _STILL / 2 for end in (0, -1))
    return float(t[away].min()), float(t[back].max())


def _gather(
    bodies: list[bytes], wanted: tuple[str, ...], left_out: tuple[str, ...], path: Path
) -> tuple[_Gathered, tuple[str, ...]]:
    """Take all messages apart, those of one layout together; of joints that are left out only the positions."""
    found = _Gathered()
    names = wanted
    seen: list[str] = []
    by_length: dict[int, list[int]] = {}
    for i, body in enumerate(bodies):
        by_length.setdefault(len(body), []).append(i)
    # The most frequent length first: without wanted names its joints are the recording's.
    for indices in sorted(by_length.values(), key=len, reverse=True):
        left = np.array(indices)
        while left.size:
            try:
                known = layout(bodies[left[0]])
            except ValueError as error:
                found.faults.append((int(left[0]) + 1, f"unreadable message: {error}"))
                left = left[1:]
                continue
            rows = np.frombuffer(b"".join(bodies[i] for i in left), dtype=np.uint8).reshape(left.size, -1)
            same = alike(rows, known)
            names = names or known.names
            seen += [name for name in known.names if name not in seen]
            twice = [name for name in names if known.names.count(name) > 1]
            if twice:
                raise InputError(str(path), f"a message has {known.names.count(twice[0])} joints called {twice[0]!r}")
            if not set(names) <= set(known.names):
                found.others += int(same.sum())
            elif known.counts[0] != len(known.names):
                what = f"wrong field count: {known.counts[0]} positions of {len(known.names)} joints"
                found.faults += [(int(i) + 1, what) for i in left[same]]
            else:
                place = [known.names.index(name) for name in names]
                blocks = [numbers(rows[same], known, part) for part in range(len(found.parts))]
                beside = np.full((len(blocks[0]), len(left_out)), np.nan)
                for k, name in enumerate(left_out):
                    if name in known.names:
                        beside[:, k] = blocks[0][:, known.names.index(name)]
                found.left_out.append(beside)
                found.number.append(left[same])
                found.stamp.append(stamps(rows[same], known))
                for name, block, into in zip(_PARTS, blocks, found.parts, strict=True):
                    absent = block.shape[1] != len(known.names)
                    if absent and block.shape[1]:
                        found.wrong_counts[name] += len(block)
                    into.append(np.full((len(block), len(names)), np.nan) if absent else block[:, place])
            left = left[~same]
    if not names:
        raise InputError(str(path), "the messages name no joints", "wanted sensor_msgs/msg/JointState with names")
    if not found.number:
        missing = [name for name in names if name not in seen]
        if seen and missing:
            problem = f"no joint is called {missing[0]!r}; the bag's are {', '.join(seen)}"
            raise InputError("joint_names", problem, "give joint_names = [...] in the robot's order in a column file")
        if found.others:
            problem = f"no message holds all joints together: {', '.join(names)}"
            raise InputError(str(path), problem, "choose those of one message with joint_names, in a column file")
        raise InputError(str(path), "no message can be read", "; ".join(dict.fromkeys(why for _, why in found.faults)))
    return found, names


def _bag(path: Path) -> Path:
    """The folder of a bag, or the only file in a folder without metadata."""
    if not path.is_dir() or (path / "metadata.yaml").exists():
        return path
    files = sorted([*path.glob("*.db3"), *path.glob("*.mcap")])
    if len(files) != 1:
        problem = f"has no metadata.yaml and {len(files)} bag files"
        raise InputError(str(path), problem, "give the path of one .db3 or .mcap file")
    return files[0]


def _unnamed_files(path: Path) -> list[str]:
    """Names of a folder's bag files that its metadata leave out."""
    metadata = path / "metadata.yaml"
    if not metadata.is_file():
        return []
    text = metadata.read_text(encoding="utf-8", errors="replace")
    files = [file.name for kind in ("*.db3", "*.mcap") for file in path.glob(kind)]
    return sorted(name for name in files if not re.search(rf"(?<![\w.-]){re.escape(name)}", text))


def _messages(path: Path, topic: str) -> tuple[npt.NDArray[np.int64], list[bytes], str]:
    """Times of receiving [ns] and bodies of all messages of the topic, and its name."""
    from rosbags.rosbag2 import Reader

    try:
        with Reader(path) as reader:
            connections = _connections(reader.connections, topic, path)
            times, bodies = [], []
            for _, time, body in reader.messages(connections):
                times.append(time)
                bodies.append(bytes(memoryview(body)))  # a number would be a length
            received = np.array(times, dtype=np.int64)
    except InputError:
        raise
    except Exception as error:  # rosbags and what it stands on raise many kinds for a damaged file
        from bumpstop.recording.formats.damaged_bag import describe_damage

        raise describe_damage(path, error) from None
    return received, bodies, connections[0].topic


def _connections(connections: list[Any], topic: str, path: Path) -> list[Any]:
    types = {connection.topic: connection.msgtype for connection in connections}
    states = sorted(name for name, kind in types.items() if kind == JOINT_STATE)
    listed = ", ".join(f"{name} ({kind})" for name, kind in sorted(types.items())) or "none"
    if topic:
        if topic not in types:
            raise InputError(
                "topic", f"{str(path)!r} has no topic {topic!r}", near_matches(topic, types) or "it has none"
            )
        if types[topic] != JOINT_STATE:
            raise InputError("topic", f"{topic!r} holds {types[topic]}", f"wanted {JOINT_STATE}; topics: {listed}")
    elif not states:
        raise InputError(str(path), f"no topic holds {JOINT_STATE}", f"topics: {listed}")
    elif len(states) > 1:
        raise InputError("topic", f"two or more hold joint states: {', '.join(states)}", "choose one with --topic")
    wanted = topic or states[0]
    return [connection for connection in connections if connection.topic == wanted]
