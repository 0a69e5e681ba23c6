"""Trajectory messages in ROS 2 bags, and the same bag with other times in them."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.errors import InputError
from bumpstop.program.trajectories.retimed_message import (
    BASE_MOVES,
    MessageRows,
    begins_elsewhere,
    elsewhere_notes,
    position_at,
    retimed_rows,
    segments_of,
)

if TYPE_CHECKING:
    from bumpstop.program.cell import Cell
    from bumpstop.program.segment import Segment
    from bumpstop.program.trajectories.trajectory_segment import TrajectorySegment

_JOINT = "trajectory_msgs/msg/JointTrajectory"
_ROBOT = "moveit_msgs/msg/RobotTrajectory"
_DISPLAY = "moveit_msgs/msg/DisplayTrajectory"
_TYPES = (_JOINT, _ROBOT, _DISPLAY)
_ROBOT_DEFINITION = (
    "trajectory_msgs/JointTrajectory joint_trajectory\n"
    "trajectory_msgs/MultiDOFJointTrajectory multi_dof_joint_trajectory"
)


@dataclass(frozen=True, eq=False)
class BagProgram:
    """Trajectory messages of a bag.

    Attributes:
        path: of the bag.
        messages: number of the bag's message, place of the trajectory in it, its points and its segments.
    """

    language: str
    path: Path
    messages: Sequence[tuple[int, int, MessageRows, Sequence[TrajectorySegment]]]
    not_understood: Sequence[tuple[int, str]]
    moves_unseen: bool
    notes: Sequence[str] = ()

    @property
    def segments(self) -> Sequence[TrajectorySegment]:
        """Of all messages; their lines are numbers of points."""
        return [segment for *_, segments in self.messages for segment in segments]

    def file_name(self, path: Path) -> str:  # noqa: D102
        return path.stem

    def may_be_raised(self, place: object) -> bool:  # noqa: D102
        return True

    def write(self, factors: Mapping[Segment, float], target: Path) -> None:
        """A bag in a folder, with every message that is no changed trajectory as it was.

        What was sent after the end of one that takes longer now comes later by that, as the next one, which would cut
        it off.
        """
        import shutil

        from rosbags.rosbag2 import Reader, StoragePlugin, Writer

        if target.exists():
            shutil.rmtree(target) if target.is_dir() else target.unlink()
        changed: dict[int, list[tuple[int, MessageRows, Sequence[TrajectorySegment]]]] = {}
        for number, place, rows, segments in self.messages:
            if any(factors.get(segment, 1.0) != 1.0 for segment in segments):
                changed.setdefault(number, []).append((place, rows, segments))
        with Reader(self.path) as reader:
            store = _store(reader)
            mcap = self.path.suffix.lower() == ".mcap" or any(self.path.glob("*.mcap"))
            plugin = StoragePlugin.MCAP if mcap else StoragePlugin.SQLITE3
            with Writer(target, version=9, storage_plugin=plugin) as writer:
                into = {
                    one.id: writer.add_connection(one.topic, one.msgtype, **_definition(one, store))
                    for one in reader.connections
                }
                delay = longer = end = 0  # [ns]
                for number, (connection, stamp, body) in enumerate(reader.messages()):
                    raw = bytes(body)
                    if stamp >= end:
                        delay, longer = delay + longer, 0
                    if number in changed:
                        message = store.deserialize_cdr(raw, connection.msgtype)
                        trajectories = list(_trajectories(connection.msgtype, message))
                        for place, rows, segments in changed[number]:
                            new, at = retimed_rows(rows, segments, factors)
                            _set(trajectories[place], new, at)
                            if connection.msgtype == _JOINT:
                                end = stamp + _nanoseconds(rows)
                                longer = max(0, _nanoseconds(new) - _nanoseconds(rows))
                        raw = bytes(store.serialize_cdr(message, connection.msgtype))
                    writer.write(into[connection.id], stamp + delay, raw)


def holds_trajectories(path: Path) -> bool:
    """Whether a file or folder is a bag with a trajectory message in it."""
    if not (path.is_dir() or path.suffix.lower() in (".mcap", ".db3")):
        return False
    from rosbags.rosbag2 import Reader

    try:
        with Reader(path) as reader:
            return any(one.msgtype in _TYPES for one in reader.connections)
    except Exception:
        return False  # whoever reads recordings says what is wrong with it


def read_bag_trajectories(path: Path, cell: Cell) -> BagProgram:
    """The trajectories of a bag.

    Raises:
        InputError: a message is damaged.
    """
    from rosbags.rosbag2 import Reader

    found: list[tuple[int, int, MessageRows, Sequence[TrajectorySegment]]] = []
    not_understood: list[tuple[int, str]] = []
    own, stands, unseen = {joint.name for joint in cell.robot.joints}, cell.start, False
    elsewhere: list[str] = []
    begun, under_way = 0, None  # when the last one that an arm was sent began [ns], and its points
    with Reader(path) as reader:
        store = _store(reader)
        for number, (connection, stamp, body) in enumerate(reader.messages()):
            if connection.msgtype not in _TYPES:
                continue
            if connection.msgtype not in store.fielddefs:
                not_understood.append((number + 1, f"{connection.topic}: the bag does not define {connection.msgtype}"))
                stands, unseen, under_way = None, True, None
                continue
            try:
                message = store.deserialize_cdr(bytes(body), connection.msgtype)
            except Exception as error:
                raise InputError(str(path), f"message {number + 1} cannot be read ({error})") from None
            if _moves_base(connection.msgtype, message):
                not_understood.append((number + 1, f"{connection.topic} {number + 1}: {BASE_MOVES}"))
                unseen = True
            for place, trajectory in enumerate(_trajectories(connection.msgtype, message)):
                name = f"{connection.topic} {number + 1}" + (f"[{place}]" if place else "")
                rows = _rows(trajectory, cell)
                if isinstance(rows, str):
                    not_understood.append((number + 1, f"{name}: {rows}"))
                    if not own.isdisjoint(trajectory.joint_names):
                        stands, unseen, under_way = None, True, None
                else:
                    lines = list(range(1, len(rows.time) + 1))
                    if connection.msgtype == _JOINT:
                        if under_way is not None and stamp < begun + _nanoseconds(under_way):
                            stands = position_at(under_way, 1e-9 * (stamp - begun))
                        begun, under_way = stamp, rows
                    found.append((number, place, rows, segments_of(name, rows, lines, cell, stands)))
                    elsewhere += [name] if begins_elsewhere(rows, stands) else []
                    stands = rows.position[-1]
    return BagProgram("ROS bag", path, found, not_understood, unseen, elsewhere_notes(elsewhere))


def _nanoseconds(rows: MessageRows) -> int:
    """Until the last point."""
    return round(float(rows.time[-1]) * 1e9)


def _store(reader: Any) -> Any:
    """Types of ROS 2, and those that the bag defines."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    store.register(get_types_from_msg(_ROBOT_DEFINITION, _ROBOT))
    for one in reader.connections:
        if one.msgtype in _TYPES and one.msgtype not in store.fielddefs and one.msgdef.data:
            types = get_types_from_msg(one.msgdef.data, one.msgtype)
            store.register({name: fields for name, fields in types.items() if name not in store.fielddefs})
    return store


def _definition(connection: Any, store: Any) -> dict[str, Any]:
    """How a connection's type is told to the writer."""
    if connection.msgdef.data:
        return {"msgdef": connection.msgdef.data, "rihs01": connection.digest}
    return {"typestore": store} if connection.msgtype in store.fielddefs else {"msgdef": "", "rihs01": ""}


def _trajectories(kind: str, message: Any) -> Iterator[Any]:
    """The JointTrajectory messages in a message."""
    if kind == _JOINT:
        yield message
    elif kind == _ROBOT:
        yield message.joint_trajectory
    else:
        for part in message.trajectory:
            yield part.joint_trajectory


def _moves_base(kind: str, message: Any) -> bool:
    parts = [] if kind == _JOINT else [message] if kind == _ROBOT else message.trajectory
    return any(len(part.multi_dof_joint_trajectory.points) > 0 for part in parts)


def _rows(trajectory: Any, cell: Cell) -> MessageRows | str:
    known = [joint.name for joint in cell.robot.joints]
    written = list(trajectory.joint_names)
    if sorted(written) != sorted(known):
        return f"its joints are not those of {cell.robot.name}: {', '.join(written)[:120]}"
    points = trajectory.points
    for number, point in enumerate(points, start=1):
        if len(point.positions) != len(known) or not np.isfinite(point.positions).all():
            return f"point {number} has no positions of all joints"
        if len(point.velocities) not in (0, len(known)) or not np.isfinite(point.velocities).all():
            return f"point {number} has not one velocity for each joint"
        if len(point.accelerations) not in (0, len(known)) or not np.isfinite(point.accelerations).all():
            return f"point {number} has not one acceleration for each joint"
    return MessageRows.checked(
        [point.time_from_start.sec + 1e-9 * point.time_from_start.nanosec for point in points],
        [point.positions for point in points],
        [point.velocities for point in points if len(point.velocities)],
        [point.accelerations for point in points if len(point.accelerations)],
        [written.index(name) for name in known],
        [known.index(name) for name in written],
    )


def _set(trajectory: Any, rows: MessageRows, changed: np.ndarray[Any, Any]) -> None:
    """Put new times, velocities and accelerations into a message."""
    order = list(rows.order)
    for i, point in enumerate(trajectory.points):
        total = round(float(rows.time[i]) * 1e9)
        point.time_from_start.sec, point.time_from_start.nanosec = total // 10**9, total % 10**9
        if changed[i] and len(point.velocities) and rows.velocity is not None:
            point.velocities = np.ascontiguousarray(rows.velocity[i][order])
        if changed[i] and len(point.accelerations) and rows.acceleration is not None:
            point.accelerations = np.ascontiguousarray(rows.acceleration[i][order])
