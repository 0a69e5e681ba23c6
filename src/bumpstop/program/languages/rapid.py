"""RAPID: MoveAbsJ, MoveJ, MoveL and MoveC to constants, with speeddata and zonedata."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bumpstop.program.languages.blocks import Assignments, Blocks
from bumpstop.program.languages.expression import Expression, number_of, numbers_of, read_expression, resolved
from bumpstop.program.languages.rotation import from_quaternion
from bumpstop.program.languages.statements import MIN_TIME_S, Call, Frames, Move, ReadProgram, SpeedSlot, Target
from bumpstop.program.languages.syntax import Statement, SyntaxTree, Token, statement_of, tokenize

_TOKENS = re.compile(
    r"(?P<comment>![^\n\r]*)|(?P<newline>\r?\n)|(?P<space>[ \t\r\f\v]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_.]*)|(?P<string>\"[^\"\n\r]*\")"
    r"|(?P<operator>:=|<>|<=|>=|[-+*/=<>()\[\]{},:;\\?|%&@])"
)
# Statements that end with their line, not with a semicolon.
_LINE_WORDS = (
    "module endmodule proc endproc func endfunc trap endtrap record endrecord while endwhile for endfor if elseif else "
    "endif test case default endtest error undo backward"
)
_LINES = frozenset(_LINE_WORDS.split())
_OPEN = {"proc": "function", "func": "function", "trap": "function", "while": "loop", "for": "loop", "test": "branch"}
_CLOSE = {
    "endproc": "function",
    "endfunc": "function",
    "endtrap": "function",
    "endwhile": "loop",
    "endfor": "loop",
    "endif": "branch",
    "endtest": "branch",
}
_HARMLESS_WORDS = (
    "set reset setdo setao setgo waittime waitdi waitdo waituntil waitai tpwrite tperase pulsedo invertdo stop confl "
    "confj singarea accset return incr decr add clear clkreset clkstart clkstop module endmodule record endrecord "
    "waitrob gripload idelete"
)
_HARMLESS = frozenset(_HARMLESS_WORDS.split())
_DATA = frozenset(("const", "pers", "var", "local", "task"))
_SPEEDS = {
    f"v{v}": float(v)
    for v in (5, 10, 20, 30, 40, 50, 60, 80, 100, 150, 200, 300, 400, 500, 600, 800, 1000, 1500, 2000, 2500, 3000)
} | {f"v{v}": float(v) for v in (4000, 5000, 6000, 7000)}
_ZONES = {"fine": 0.0, "z0": 0.3} | {f"z{z}": float(z) for z in (1, 5, 10, 15, 20, 30, 40, 50, 60, 80, 100, 150, 200)}
_MAX_SPEED_MM_S = 7000.0
_MOVES = {"movel": True, "movej": False, "moveabsj": False, "movec": True}
_NO_EXTERNAL = 9e8  # an external axis that is none is 9E9


@dataclass(frozen=True)
class _Argument:
    """One argument of an instruction, with the switches behind it."""

    value: Expression | None
    end: int
    switches: Mapping[str, Expression | None]


def parse_rapid(source: bytes) -> SyntaxTree:
    """The syntax tree of any bytes; a statement ends with a semicolon, or with its line where the language says so."""
    statements: list[Statement] = []
    tokens = tokenize(source, _TOKENS)
    begin, line, first = 0, 1, ""
    for i, token in enumerate(tokens):
        if not first and token.kind == "name":
            first = token.text.lower()
        ends = token.text == ";" or (
            token.kind == "newline" and (not first or first in _LINES) and token is not tokens[begin]
        )
        if ends or (token.kind == "newline" and not first):
            statements.append(statement_of(tokens[begin : i + 1], line))
            line += sum(t.text.count("\n") for t in tokens[begin : i + 1])
            begin, first = i + 1, ""
    if begin < len(tokens):
        statements.append(statement_of(tokens[begin:], line))
    return SyntaxTree(source, tuple(statements))


def read_rapid(source: bytes) -> ReadProgram:
    """What is understood of a program."""
    tree, assignments = parse_rapid(source), Assignments()
    for statement in tree.statements:
        if (assigned := _assignment(_plain(statement))) is not None:
            assignments.add(*assigned)
    constants = assignments.constants()
    blocks = Blocks()
    for statement in tree.statements:
        if _plain(statement):
            _add(blocks, statement, constants)
    functions = blocks.finish()
    return ReadProgram("RAPID", source, functions, tuple(blocks.not_understood), tuple(blocks.notes), constants)


def _plain(statement: Statement) -> list[Token]:
    words = statement.words
    return words[:-1] if words and words[-1].text == ";" else words


def _assignment(words: Sequence[Token]) -> tuple[str, Expression | None] | None:
    texts = [word.text.lower() for word in words]
    if texts[:1] == ["for"] and len(words) > 1:
        return words[1].text, None
    declared = False
    while texts and texts[0] in _DATA:
        words, texts, declared = words[1:], texts[1:], True
    if declared and len(words) > 1:
        words, texts = words[1:], texts[1:]  # the type
    if not words or words[0].kind != "name" or ":=" not in texts:
        return None
    at = texts.index(":=")
    if at == 1:
        return words[0].text, read_expression(list(words[2:]))
    # A component or an element changes the whole.
    return (words[0].text.split(".")[0], None) if texts[1] == "{" else None


def _add(blocks: Blocks, statement: Statement, constants: Mapping[str, Expression]) -> None:
    words = _plain(statement)
    first = words[0].text.lower()
    if first in ("local", "task") and len(words) > 1 and words[1].text.lower() in _OPEN:
        words, first = words[1:], words[1].text.lower()
    if first in _OPEN:
        kind = _OPEN[first]
        # A function with arguments is called with other ones.
        name = words[1].text if kind == "function" and first == "proc" and len(words) > 1 else ""
        blocks.begin(kind, statement, name, certain=_certain(words))  # type: ignore[arg-type]
    elif first == "if" and words[-1].text.lower() == "then":
        blocks.begin("branch", statement)
    elif first in _CLOSE:
        blocks.end(statement, _CLOSE[first])  # type: ignore[arg-type]
    elif first in ("elseif", "else", "case", "default"):
        blocks.otherwise(statement)
    elif first in _MOVES:
        _add_move(blocks, statement, words, constants)
    elif first in _DATA or _assignment(words) is not None:
        pass
    elif len(words) == 1 and words[0].kind == "name" and first not in _HARMLESS and first not in _LINES:
        blocks.add(Call(statement.line, first))
    elif first not in _HARMLESS:
        blocks.opaque(statement, moves=first != "velset")


def _certain(words: Sequence[Token]) -> bool:
    return [word.text.lower() for word in words] == ["while", "true", "do"] or words[0].text.lower() == "for"


def _add_move(blocks: Blocks, statement: Statement, words: list[Token], constants: Mapping[str, Expression]) -> None:
    arguments, kind = _arguments(words[1:]), words[0].text.lower()
    via = arguments.pop(0) if kind == "movec" and arguments else None
    if len(arguments) < 4 or any(argument.value is None for argument in arguments[:4]):
        blocks.opaque(statement)
        return
    target, speed, zone, tool = arguments[:4]
    why = ""
    frame = _frame_of_tool(tool.value, constants)
    base = _frame_of_object(tool.switches.get("wobj"), constants) if "wobj" in tool.switches else (0.0,) * 6
    blocks.add(Frames(statement.line, "tool", frame))
    blocks.add(Frames(statement.line, "base", base))
    slot = _time(speed, constants) if "t" in speed.switches else _speed(speed, constants)
    blend = _zone(zone, constants)
    if slot is None:
        why = "its speed is not known before the program runs"
    elif blend is None:
        why = "its zone is not known before the program runs"
    elif slot.time and (blend > 0 or (slot.value or 0.0) < MIN_TIME_S):
        why = f"its time T is given with a zone, or is below {MIN_TIME_S:g} s"
    if slot is not None and slot.time:
        blocks.note_time(statement.line)
    blocks.add(
        Move(
            line=statement.line,
            word=words[0].text,
            linear=_MOVES[kind],
            target=_joint_target(target.value, constants) if kind == "moveabsj" else _pose_target(target, constants),
            measure="tool",
            speed=(slot,) if slot is not None else (),
            blend=blend or 0.0,
            why=why,
            via=None if via is None else _pose_target(via, constants),
        )
    )


def _arguments(words: Sequence[Token]) -> list[_Argument]:
    """Arguments between commas that stand in no bracket; switches before the first argument count as its own."""
    parts: list[list[Token]] = [[]]
    level = 0
    for word in words:
        level += (word.text in ("[", "(", "{")) - (word.text in ("]", ")", "}"))
        if word.text == "," and level == 0:
            parts.append([])
        else:
            parts[-1].append(word)
    found: list[_Argument] = []
    for part in parts:
        pieces: list[list[Token]] = [[]]
        depth = 0
        for word in part:
            depth += (word.text in ("[", "(", "{")) - (word.text in ("]", ")", "}"))
            if word.text == "\\" and depth == 0:
                pieces.append([])
            else:
                pieces[-1].append(word)
        switches = {
            piece[0].text.lower(): read_expression(piece[2:]) if len(piece) > 2 else None
            for piece in pieces[1:]
            if piece
        }
        value = read_expression(pieces[0]) if pieces[0] else None
        if value is None and not pieces[0] and not found and len(parts) > 1:
            continue  # \Conc and its like, before the first argument
        found.append(_Argument(value, pieces[0][-1].end if pieces[0] else 0, switches))
    return found


def _speed(argument: _Argument, constants: Mapping[str, Expression]) -> SpeedSlot | None:
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


def _time(argument: _Argument, constants: Mapping[str, Expression]) -> SpeedSlot | None:
    own = argument.switches["t"]
    value = number_of(own, constants)
    if own is None or not value or value < 0:
        return None
    return SpeedSlot(own.start, own.end, value, most=MIN_TIME_S, unit="s", time=True)


def _slot(start: int, end: int, value: float, template: str) -> SpeedSlot:
    return SpeedSlot(start, end, value, template, _MAX_SPEED_MM_S, "mm/s", 1e-3)


def _zone(argument: _Argument, constants: Mapping[str, Expression]) -> float | None:
    """How far before the target the arm goes over into the next move [m]."""
    if "z" in argument.switches:
        value = number_of(argument.switches["z"], constants)
        return None if value is None else value / 1e3
    written = argument.value
    assert written is not None
    if written.kind == "name" and written.name.lower() in _ZONES and written.name.lower() not in constants:
        return _ZONES[written.name.lower()] / 1e3
    found = resolved(written, constants)
    if found is None or found.kind != "list" or len(found.items) < 2:
        return None
    fine, zone = number_of(found.items[0], constants), number_of(found.items[1], constants)
    return None if fine is None or zone is None else 0.0 if fine else zone / 1e3


def _joint_target(expression: Expression | None, constants: Mapping[str, Expression]) -> Target:
    found = resolved(expression, constants)
    joints = numbers_of(found.items[0], constants) if found is not None and found.items else None
    if joints is None or (found is not None and found.kind != "list"):
        return Target(why="its target is not known before the program runs")
    return Target(joints=tuple(math.radians(joint) for joint in joints if abs(joint) < _NO_EXTERNAL))


def _pose_target(argument: _Argument, constants: Mapping[str, Expression]) -> Target:
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
    return Target(pose=(*(x + d / 1e3 for x, d in zip(pose[:3], offset, strict=True)), *pose[3:]))


def _pose(place: Expression, turn: Expression, constants: Mapping[str, Expression]) -> tuple[float, ...] | None:
    x, q = numbers_of(place, constants), numbers_of(turn, constants)
    if x is None or q is None or len(x) != 3 or len(q) != 4:
        return None
    rotation = from_quaternion(*q)
    return None if rotation is None else (*(value / 1e3 for value in x), *rotation)


def _frame_of_tool(expression: Expression | None, constants: Mapping[str, Expression]) -> tuple[float, ...] | None:
    """Of tooldata ``[robhold, [[x, y, z], [q1, q2, q3, q4]], load]``; ``tool0`` is the flange."""
    if expression is not None and expression.kind == "name" and expression.name.lower() == "tool0":
        return (0.0,) * 6
    found = resolved(expression, constants)
    if found is None or found.kind != "list" or len(found.items) < 2:
        return None
    frame = resolved(found.items[1], constants)
    return _pose(*frame.items[:2], constants) if frame is not None and len(frame.items) == 2 else None


def _frame_of_object(expression: Expression | None, constants: Mapping[str, Expression]) -> tuple[float, ...] | None:
    """Of wobjdata whose object frame is its user frame; ``wobj0`` is the base."""
    if expression is not None and expression.kind == "name" and expression.name.lower() == "wobj0":
        return (0.0,) * 6
    found = resolved(expression, constants)
    if found is None or found.kind != "list" or len(found.items) != 5:
        return None
    user, own = (resolved(item, constants) for item in found.items[3:])
    if user is None or own is None or len(user.items) != 2 or len(own.items) != 2:
        return None
    inner = _pose(*own.items, constants)
    if inner is None or any(abs(x) > 0 for x in inner):
        return None
    return _pose(*user.items, constants)
