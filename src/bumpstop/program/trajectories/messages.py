"""ROS JointTrajectory messages, alone or inside RobotTrajectory and DisplayTrajectory, as YAML and JSON."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError
from bumpstop.output_files import write_bytes
from bumpstop.program.languages.message_syntax import Value, parse_json, parse_yaml
from bumpstop.program.languages.syntax import Edit, edited
from bumpstop.program.trajectories.retimed_message import (
    BASE_MOVES,
    MessageRows,
    begins_elsewhere,
    elsewhere_notes,
    retimed_rows,
    segments_of,
)

if TYPE_CHECKING:
    from bumpstop.program.cell import Cell
    from bumpstop.program.segment import Segment
    from bumpstop.program.trajectories.trajectory_segment import TrajectorySegment

_TIMES = (("sec", "nanosec"), ("secs", "nsecs"))  # of ROS 2, of ROS 1


@dataclass(frozen=True, eq=False)
class MessageProgram:
    """Trajectory messages of a file.

    Attributes:
        source: the bytes.
        messages: with their segments, and the numbers of their points where they stand in the file.
    """

    language: str
    source: bytes
    messages: Sequence[tuple[MessageRows, Sequence[TrajectorySegment], Sequence[Value]]]
    not_understood: Sequence[tuple[int, str]]
    moves_unseen: bool
    notes: Sequence[str] = ()

    @property
    def segments(self) -> Sequence[TrajectorySegment]:
        """Of all messages."""
        return [segment for _, segments, _ in self.messages for segment in segments]

    def file_name(self, path: Path) -> str:  # noqa: D102
        return path.name

    def may_be_raised(self, place: object) -> bool:  # noqa: D102
        return True

    def write(self, factors: Mapping[Segment, float], target: Path) -> None:  # noqa: D102
        write_bytes(target, self.written(factors))

    def written(self, factors: Mapping[Segment, float]) -> bytes:
        """The file with other times, velocities and accelerations."""
        edits: list[Edit] = []
        for rows, segments, points in self.messages:
            if all(factors.get(segment, 1.0) == 1.0 for segment in segments):
                continue
            new, changed = retimed_rows(rows, segments, factors)
            for i, point in enumerate(points):
                if new.time[i] != rows.time[i]:
                    edits += _time_edits(point, float(new.time[i]))
                for key, values in (("velocities", new.velocity), ("accelerations", new.acceleration)):
                    given = point.get(key)
                    if changed[i] and given is not None and given.items and values is not None:
                        edits += [
                            Edit(item.start, item.end, repr(float(value)))
                            for item, value in zip(given.items, values[i][list(rows.order)], strict=True)
                        ]
        return edited(self.source, edits)


def read_messages(path: Path, source: bytes, cell: Cell) -> MessageProgram:
    """The trajectories of a file.

    Raises:
        InputError: it is damaged, or holds no JointTrajectory.
    """
    json = path.suffix.lower() == ".json"
    documents = (parse_json if json else parse_yaml)(source, str(path))
    found: list[tuple[MessageRows, Sequence[TrajectorySegment], Sequence[Value]]] = []
    not_understood = []
    own, stands, unseen = {joint.name for joint in cell.robot.joints}, cell.start, False
    elsewhere: list[str] = []
    for name, message in _trajectories(documents):
        line = source.count(b"\n", 0, message.start) + 1
        if _moves_base(message):
            not_understood.append((line, f"{name}: {BASE_MOVES}"))
            unseen = True
            continue
        rows = _rows(message, cell)
        if isinstance(rows, str):
            not_understood.append((line, f"{name}: {rows}"))
            names = message.get("joint_names")
            if names is None or not own.isdisjoint(item.text for item in names.items):
                stands, unseen = None, True
            continue
        points = message.get("points")
        assert points is not None
        lines = [source.count(b"\n", 0, point.start) + 1 for point in points.items]
        found.append((rows, segments_of(name, rows, lines, cell, stands), points.items))
        elsewhere += [name] if begins_elsewhere(rows, stands) else []
        stands = rows.position[-1]
    if not found and not not_understood:
        raise InputError(str(path), "holds no JointTrajectory", "wanted joint_names and points")
    return MessageProgram("ROS trajectory", source, found, not_understood, unseen, elsewhere_notes(elsewhere))


def _trajectories(documents: Sequence[Value]) -> Iterator[tuple[str, Value]]:
    """Every map with joint_names and points, and where it stands."""

    def inside(value: Value, name: str) -> Iterator[tuple[str, Value]]:
        if value.kind == "map" and "joint_names" in value.keys and "points" in value.keys:
            held = [value.get(key) for key in ("joint_names", "points")]
            # Messages have a part for what stands on no joints, which is mostly empty.
            if any(one is None or one.kind != "list" or one.items for one in held):
                yield name or "trajectory", value
            return
        for i, item in enumerate(value.items):
            if value.kind == "map":
                # What a person called it says more than the names of the message's own fields.
                key = value.keys[i]
                called = value.get("name") or value.get("id")
                inner = key if key not in ("joint_trajectory", "trajectory") or not name else name
                if called is not None and called.kind == "scalar" and called.text:
                    inner = called.text
            else:
                inner = f"{name or 'trajectory'}[{i}]"
            yield from inside(item, inner)

    for number, document in enumerate(documents, start=1):
        yield from inside(document, f"message {number}" if len(documents) > 1 else "")


def _moves_base(message: Value) -> bool:
    """Whether this is a MultiDOFJointTrajectory that moves something."""
    points = message.get("points")
    return points is not None and any(point.get("transforms") is not None for point in points.items)


def _rows(message: Value, cell: Cell) -> MessageRows | str:
    """The numbers of a message in the robot's order of joints, or what is wrong with them."""
    names, points = message.get("joint_names"), message.get("points")
    known = [joint.name for joint in cell.robot.joints]
    if names is None or points is None or names.kind != "list" or points.kind != "list":
        return "joint_names and points are no lists"
    written = [item.text for item in names.items]
    if sorted(written) != sorted(known):
        return f"its joints are not those of {cell.robot.name}: {', '.join(written)[:120]}"
    # Column of the message for every joint of the robot, and the other way round.
    column = [written.index(name) for name in known]
    order = [known.index(name) for name in written]
    times, position, velocity, acceleration = [], [], [], []
    for number, point in enumerate(points.items, start=1):
        t, q, qd = point.get("time_from_start"), point.get("positions"), point.get("velocities")
        at = None if t is None else _seconds(t)
        numbers = None if q is None else q.numbers()
        if at is None or numbers is None or len(numbers) != len(known):
            return f"point {number} has no positions of all joints or no time"
        times.append(at)
        position.append(numbers)
        if qd is not None and qd.items:
            rates = qd.numbers()
            if rates is None or len(rates) != len(known):
                return f"point {number} has not one velocity for each joint"
            velocity.append(rates)
        qdd = point.get("accelerations")
        if qdd is not None and qdd.items:
            values = qdd.numbers()
            if values is None or len(values) != len(known):
                return f"point {number} has not one acceleration for each joint"
            acceleration.append(values)
    return MessageRows.checked(times, position, velocity, acceleration, column, order)


def _seconds(value: Value) -> float | None:
    for whole, billionths in _TIMES:
        if sorted(value.keys) == sorted((whole, billionths)):
            parts = [value.items[value.keys.index(key)].number() for key in (whole, billionths)]
            if parts[0] is None or parts[1] is None:
                return None
            return parts[0] + 1e-9 * parts[1]
    return value.number()


def _time_edits(point: Value, t: float) -> list[Edit]:
    value = point.get("time_from_start")
    assert value is not None
    total = round(t * 1e9)
    for names in _TIMES:
        if sorted(value.keys) == sorted(names):
            parts = (total // 10**9, total % 10**9)
            items = [value.items[value.keys.index(name)] for name in names]
            return [Edit(item.start, item.end, str(part)) for item, part in zip(items, parts, strict=True)]
    return [Edit(value.start, value.end, np.format_float_positional(total * 1e-9, trim="0", precision=9))]
