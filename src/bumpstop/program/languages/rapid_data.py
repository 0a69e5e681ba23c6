"""RAPID's data: arguments of instructions as speeds, zones, targets, tools and frames."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

from bumpstop.program.languages.expression import (
    Expression,
    number_of,
    numbers_of,
    read_expression,
    resolved,
    split_at,
)
from bumpstop.program.languages.rotation import from_quaternion
from bumpstop.program.languages.statements import MIN_TIME_S, SpeedSlot, Target
from bumpstop.program.languages.syntax import SyntaxTree, Token

_SPEEDS = {
    f"v{v}": float(v)
    for v in (5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 2500, 3000)
} | {f"v{v}": float(v) for v in (4000, 5000, 6000, 7000)}
_ZONES = {"fine": 0.0, "z0": 0.3} | {f"z{z}": float(z) for z in (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)}
_MAX_SPEED_MM_S = 7000.0
_NO_EXTERNAL = 9e8  # an external axis that is none is 9E9


@dataclass(frozen=True)
class Argument:
    """One argument of an instruction, with the switches behind it."""

    value: Expression | None
    end: int
    switches: Mapping[str, Expression | None]


def arguments_of(words: Sequence[Token]) -> list[Argument]:
    """Arguments between commas that stand in no bracket; switches before the first argument count as its own."""
    parts = split_at(words, ",")
    found: list[Argument] = []
    for part in parts:
        pieces = split_at(part, "\\")
        switches = {
            piece[0].text.lower(): read_expression(piece[2:]) if len(piece) > 2 else None
            for piece in pieces[1:]
            if piece
        }
        value = read_expression(pieces[0]) if pieces[0] else None
        if value is None and not pieces[0] and not found and len(parts) > 1:
            continue  # \Conc and its like, before the first argument
        found.append(Argument(value, pieces[0][-1].end if pieces[0] else 0, switches))
    return found


def speed_of(argument: Argument, constants: Mapping[str, Expression]) -> SpeedSlot | None:
    """The speed of a move; None where it is not known."""
    own = argument.switches.get("v")
    if "v" in argument.switches:
        value = number_of(own, constants)
        return None if own is None or not value or value < 0 else _slot(own.start, own.end, value, "{}")
    written = argument.value
    assert written is not None
    if written.kind == "name" and written.name.lower() in _SPEEDS and written.name.lower() not in constants:
        return _slot(argument.end, argument.end, _SPEEDS[written.name.lower()], "\\V:={}")
    found = resolved(written, constants)
    if found is None or found.kind != "list" or len(found.items) != 4:
        return None
    first = found.items[0]
    value = number_of(first, constants)
    if not value or value < 0:
        return None
    if written.kind == "list":
        return _slot(first.start, first.end, value, "{}")
    return _slot(argument.end, argument.end, value, "\\V:={}")


def time_of(argument: Argument, constants: Mapping[str, Expression]) -> SpeedSlot | None:
    """The time that a move takes; None where it is not known."""
    own = argument.switches["t"]
    value = number_of(own, constants)
    if own is None or not value or value < 0:
        return None
    return SpeedSlot(own.start, own.end, value, most=MIN_TIME_S, unit="s", time=True)


def _slot(start: int, end: int, value: float, template: str) -> SpeedSlot:
    return SpeedSlot(start, end, value, template, _MAX_SPEED_MM_S, "mm/s", 1e-3)


def zone_of(argument: Argument, constants: Mapping[str, Expression]) -> float | None:
    """How far before the target the arm goes over into the next move [m]."""
    written = argument.value
    assert written is not None
    name = written.name.lower()
    fine: float | None
    zone: float | None
    if written.kind == "name" and name in _ZONES and name not in constants:
        fine, zone = float(name == "fine"), _ZONES[name]
    else:
        found = resolved(written, constants)
        if found is None or found.kind != "list" or len(found.items) < 2:
            return None
        fine, zone = (number_of(item, constants) for item in found.items[:2])
    if "z" in argument.switches:
        zone = number_of(argument.switches["z"], constants)  # a stop point stays one
    if "inpos" in argument.switches and not fine:
        return None  # of a stop point, which it may make of this one
    return None if fine is None or zone is None else 0.0 if fine else zone / 1e3


def joint_target(expression: Expression | None, constants: Mapping[str, Expression]) -> Target:
    """Of ``MoveAbsJ``."""
    found = resolved(expression, constants)
    joints = numbers_of(found.items[0], constants) if found is not None and found.items else None
    if joints is None or (found is not None and found.kind != "list"):
        return Target(why="its target is not known before the program runs")
    own = tuple(math.radians(joint) for joint in joints if abs(joint) < _NO_EXTERNAL)
    return Target(joints=own, external=_external(found, 1, constants))


def pose_target(argument: Argument, constants: Mapping[str, Expression]) -> Target:
    """Of a move to a ``robtarget``, or ``Offs`` of one."""
    unknown = Target(why="its target is not known before the program runs")
    found, offset = resolved(argument.value, constants), [0.0, 0.0, 0.0]
    if found is not None and found.kind == "call" and found.name.lower() == "offs" and len(found.items) == 4:
        parts = [number_of(item, constants) for item in found.items[1:]]
        if None in parts:
            return unknown
        offset = [part for part in parts if part is not None]
        found = resolved(found.items[0], constants)
    if found is None or found.kind != "list" or len(found.items) < 2:
        return unknown
    pose = _pose(found.items[0], found.items[1], constants)
    if pose is None:
        return unknown
    place = (x + d / 1e3 for x, d in zip(pose[:3], offset, strict=True))
    within = _quadrants(found, constants)
    return Target(pose=(*place, *pose[3:]), external=_external(found, 3, constants), within=within)


def _quadrants(target: Expression, constants: Mapping[str, Expression]) -> tuple[tuple[int, float, float], ...]:
    """Where ``confdata`` has axes 1, 4 and 6: in quarters of a turn from zero on."""
    found = resolved(target.items[2], constants) if len(target.items) > 2 else None
    values = [number_of(item, constants) for item in found.items[:3]] if found is not None else []
    quarter = math.pi / 2
    axes = zip((0, 3, 5), values, strict=False)
    return tuple((axis, value * quarter, (value + 1) * quarter) for axis, value in axes if value is not None)


def _external(
    target: Expression | None, place: int, constants: Mapping[str, Expression]
) -> tuple[tuple[str, float | None], ...]:
    """External axes that a target has, at its place for them."""
    items = () if target is None else target.items
    found = resolved(items[place], constants) if len(items) > place else None
    values = [] if found is None else [number_of(item, constants) for item in found.items]
    axes = zip("abcdef", values, strict=False)
    return tuple((f"eax_{axis}", value) for axis, value in axes if value is None or abs(value) < _NO_EXTERNAL)


def _pose(place: Expression, turn: Expression, constants: Mapping[str, Expression]) -> tuple[float, ...] | None:
    x, q = numbers_of(place, constants), numbers_of(turn, constants)
    if x is None or q is None or len(x) != 3 or len(q) != 4:
        return None
    rotation = from_quaternion(*q)
    return None if rotation is None else (*(value / 1e3 for value in x), *rotation)


def persistent_data(tree: SyntaxTree, moves: Collection[str]) -> list[str]:
    """Names of the persistent data that moves, instructions of these names, are given; as they are declared."""
    found, used = {}, set[str]()
    for words in (statement.words for statement in tree.statements):
        texts = [word.text.lower() for word in words]
        if "pers" in texts[:2] and len(words) > texts.index("pers") + 2:
            place = texts.index("pers") + 2
            found[texts[place]] = words[place].text
        elif texts and texts[0] in moves:
            used.update(texts)
    return [name for key, name in found.items() if key in used]


def stands_apart(tool: Argument, constants: Mapping[str, Expression]) -> bool:
    """The robot does not hold the tool, or holds the work object, or something else moves that."""
    own, piece = (resolved(item, constants) for item in (tool.value, tool.switches.get("wobj")))
    held = number_of(own.items[0], constants) if own is not None and own.kind == "list" and own.items else 1
    flags = piece.items[:2] if piece is not None and piece.kind == "list" and len(piece.items) > 1 else ()
    return held != 1 or any(number_of(flag, constants) != known for flag, known in zip(flags, (0, 1), strict=False))


def frame_of_tool(expression: Expression | None, constants: Mapping[str, Expression]) -> tuple[float, ...] | None:
    """Of tooldata ``[robhold, [[x, y, z], [q1, q2, q3, q4]], load]``; ``tool0`` is the flange."""
    if expression is not None and expression.kind == "name" and expression.name.lower() == "tool0" not in constants:
        return (0.0,) * 6
    found = resolved(expression, constants)
    if found is None or found.kind != "list" or len(found.items) < 2:
        return None
    frame = resolved(found.items[1], constants)
    return _pose(*frame.items[:2], constants) if frame is not None and len(frame.items) == 2 else None


def frame_of_object(expression: Expression | None, constants: Mapping[str, Expression]) -> tuple[float, ...] | None:
    """Of wobjdata whose user frame is the base, or whose object frame is its user frame; ``wobj0`` is the base."""
    if expression is not None and expression.kind == "name" and expression.name.lower() == "wobj0" not in constants:
        return (0.0,) * 6
    found = resolved(expression, constants)
    if found is None or found.kind != "list" or len(found.items) != 5:
        return None
    user, own = (resolved(item, constants) for item in found.items[3:])
    if user is None or own is None or len(user.items) != 2 or len(own.items) != 2:
        return None
    outer, inner = _pose(*user.items, constants), _pose(*own.items, constants)
    if outer is None or inner is None or (any(outer) and any(inner)):
        return None
    return outer if any(outer) else inner
