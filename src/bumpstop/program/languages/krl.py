"""KRL: PTP, LIN and CIRC to constants, with the speeds that settings leave them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping

from bumpstop.program.languages.blocks import Assignments, Blocks
from bumpstop.program.languages.expression import Expression, Reader, number_of, read_expression, resolved
from bumpstop.program.languages.rotation import from_euler_zyx
from bumpstop.program.languages.statements import Call, Frame, Frames, Move, ReadProgram, Setting, SpeedSlot, Target
from bumpstop.program.languages.syntax import Statement, SyntaxTree, Token, parse_lines

_TOKENS = re.compile(
    r"(?P<comment>;[^\n\r]*|(?<![^\n])&[^\n\r]*)|(?P<newline>\r?\n)|(?P<space>[ \t\r\f\v]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[$#]?[A-Za-z_][A-Za-z0-9_$]*(?:\.[A-Za-z_][A-Za-z0-9_]*)*)|(?P<string>\"[^\"\n\r]*\")"
    r"|(?P<operator>==|<>|<=|>=|[-+*/=<>()\[\]{},:!?'])"
)
_TYPES = frozenset(("e6pos", "pos", "e6axis", "axis", "frame", "real", "int", "bool", "char"))
_OPEN: Mapping[str, tuple[str, bool]] = {
    "def": ("function", False),
    "deffct": ("function", False),
    "loop": ("loop", True),
    "while": ("loop", False),
    "repeat": ("loop", True),
    "for": ("loop", True),
    "if": ("branch", False),
    "switch": ("branch", False),
}
_CLOSE = {
    "end": "function",
    "endfct": "function",
    "endloop": "loop",
    "endwhile": "loop",
    "until": "loop",
    "endfor": "loop",
    "endif": "branch",
    "endswitch": "branch",
}
# What neither moves the arm nor says how it moves.
_HARMLESS_WORDS = "wait halt continue pulse defdat enddat ext extfct signal enum struc ini return"
_HARMLESS = frozenset(_HARMLESS_WORDS.split())
_BLENDS = frozenset(("c_ptp", "c_dis", "c_vel", "c_ori"))
_SETTINGS = {
    "$vel.cp": ("tool", "m/s", 3.0),
    "$acc.cp": ("acceleration tool", "m/s2", 10.0),
    "$vel_axis": ("axes", "%", 100.0),
    "$acc_axis": ("acceleration axes", "%", 100.0),
}
_FRAMES: tuple[Frame, ...] = ("tool", "base")
# Of a blend whose distance is not known: half of the way, which nothing goes beyond [m].
_UNKNOWN_BLEND = 1e3


def parse_krl(source: bytes) -> SyntaxTree:
    """The syntax tree of any bytes; a line is a statement."""
    return parse_lines(source, _TOKENS)


def read_krl(source: bytes, data: bytes = b"") -> ReadProgram:
    """What is understood of a program.

    Args:
        source: of the .src.
        data: of the .dat beside it, whose declarations count too.
    """
    tree, assignments = parse_krl(source), Assignments()
    for statement in (*parse_krl(data).statements, *tree.statements):
        for name, value in _assignments(statement.words):
            assignments.add(name, value)
    constants = assignments.constants()
    blocks = Blocks()
    for statement in tree.statements:
        if statement.words:
            _add(blocks, statement, tree, constants)
    functions = blocks.finish()
    return ReadProgram("KRL", source, functions, tuple(blocks.not_understood), tuple(blocks.notes), constants)


def _assignments(words: list[Token]) -> list[tuple[str, Expression | None]]:
    """Names and values of a declaration or an assignment; of a FOR its counter, which is no constant."""
    texts = [word.text.lower() for word in words]
    if texts[:1] == ["for"] and len(words) > 1:
        return [(words[1].text, None)]
    while texts and (texts[0] in ("decl", "global", "const") or (texts[0] in _TYPES and len(texts) > 1)):
        words, texts = words[1:], texts[1:]
    if "=" not in texts or not words or words[0].kind != "name":
        return []
    at = texts.index("=")
    if at == 1:
        return [(words[0].text, read_expression(words[2:]))]
    # An element of an array, or a part of a record, changes the whole.
    target = Reader(words[:at]).expression()
    element = target.name if target.kind == "name" and "?" not in target.name else words[0].text
    return [(element, read_expression(words[at + 1 :]))]


def _add(blocks: Blocks, statement: Statement, tree: SyntaxTree, constants: Mapping[str, Expression]) -> None:
    words = statement.words
    first = words[0].text.lower()
    if first == "global" and len(words) > 1 and words[1].text.lower() in ("def", "deffct"):
        words, first = words[1:], words[1].text.lower()
    if first in _OPEN:
        kind, certain = _OPEN[first]
        name = words[1].text if kind == "function" and len(words) > 1 else ""
        blocks.begin(kind, statement, name, certain=certain)  # type: ignore[arg-type]
    elif first in _CLOSE:
        blocks.end(statement, _CLOSE[first])  # type: ignore[arg-type]
    elif first in ("else", "case", "default"):
        blocks.otherwise(statement)
    elif first in ("ptp", "lin", "circ"):
        blocks.add(_move(blocks, statement, tree, constants))
    elif _set(blocks, statement, constants):
        pass
    elif first in ("decl", "global", "const", *_TYPES) or _is_assignment(words):
        if first.startswith("$") and not first.startswith(("$out", "$anout", "$timer", "$flag", "$cycflag", "$apo")):
            blocks.opaque(statement, moves=False, resets=True)
    elif first == "bas" or first.startswith("$"):
        blocks.opaque(statement, moves=False, resets=True, reframes=_FRAMES if first == "bas" else ())
    elif words[0].kind == "name" and [word.text for word in words[1:]] == ["(", ")"]:
        blocks.add(Call(statement.line, first))
    elif first not in _HARMLESS:
        called = len(words) > 1 and words[1].text == "("
        resets = called or first in ("goto", "interrupt", "trigger")
        blocks.opaque(statement, resets=resets, reframes=_FRAMES if resets else ())


def _is_assignment(words: list[Token]) -> bool:
    return bool(_assignments(words))


def _set(blocks: Blocks, statement: Statement, constants: Mapping[str, Expression]) -> bool:
    """A setting of speed, acceleration, tool or base; False where the statement is none."""
    words = statement.words
    texts = [word.text.lower() for word in words]
    if "=" not in texts:
        return False
    at = texts.index("=")
    name, value = texts[0], read_expression(words[at + 1 :])
    if name in ("$tool", "$base") and at == 1:
        pose = _frame(value, constants)
        blocks.add(Frames(statement.line, "tool" if name == "$tool" else "base", pose))
        if pose is None:
            blocks.opaque(statement, moves=False)
        return True
    if name not in _SETTINGS:
        return False
    key, unit, most = _SETTINGS[name]
    if name.endswith("_axis"):
        index = Reader(words[:at]).expression().name.rpartition("[")[2].rstrip("]")
        # All axes are set alike where the index counts.
        key += f"[{index}]" if index.isdecimal() else ""
    known = number_of(value, constants)
    slot = None
    if value is not None and known is not None and known > 0:
        whole = unit == "%"
        slot = SpeedSlot(
            value.start, value.end, known, "{}", most, unit, 0.01 if whole else 1.0, setting=True, whole=whole
        )
    else:
        blocks.opaque(statement, moves=False)
    blocks.add(Setting(statement.line, key, slot))
    return True


def _move(blocks: Blocks, statement: Statement, tree: SyntaxTree, constants: Mapping[str, Expression]) -> Move:
    words = statement.words
    kind = words[0].text.lower()
    linear = kind != "ptp"
    blend, why, rest = 0.0, "", words[1:]
    while rest and rest[-1].text.lower() in _BLENDS:
        distance = number_of(constants.get("$apo.cdis"), constants) if rest[-1].text.lower() == "c_dis" else None
        if distance is None and not blend:
            blocks.note(statement.line, "how far it is blended is not known; half of the way is taken")
        blend = max(blend, _UNKNOWN_BLEND if distance is None else distance / 1e3)
        rest = rest[:-1]
    parts = _parts(rest)
    if len(parts) != 1 + (kind == "circ") or any(read_expression(part) is None for part in parts):
        why = "it is not understood"
    start = tree.line_start(words[0].start)
    lead = tree.source[start : words[0].start].decode("latin-1")
    lead = lead if not lead.strip() else ""
    end = "\r\n" if b"\r\n" in tree.source else "\n"
    if linear:
        default = SpeedSlot(start, start, None, f"{lead}$VEL.CP={{}}{end}", 3.0, "m/s", setting=True)
    else:
        lines = "".join(f"{lead}$VEL_AXIS[{j}]={{0}}{end}" for j in range(1, 7))
        default = SpeedSlot(start, start, None, lines, 100.0, "%", 0.01, setting=True, whole=True)
    return Move(
        line=statement.line,
        word=words[0].text,
        linear=linear,
        target=Target(why=why) if why else _target(read_expression(parts[-1]), constants),
        measure="tool" if linear else "axes",
        default=default,
        blend=blend,
        via=_place(read_expression(parts[0]), constants) if kind == "circ" else None,
    )


def _parts(words: list[Token]) -> list[list[Token]]:
    """What stands between commas, outside of all braces."""
    parts: list[list[Token]] = [[]]
    level = 0
    for word in words:
        level += (word.text in ("{", "[", "(")) - (word.text in ("}", "]", ")"))
        if word.text == "," and level == 0:
            parts.append([])
        else:
            parts[-1].append(word)
    return parts


def _place(expression: Expression | None, constants: Mapping[str, Expression]) -> Target:
    """The point that an arc goes through; its orientation does not count, and may be missing."""
    found = resolved(expression, constants)
    values = _record(found, constants) if found is not None and found.kind == "record" else None
    if values is None or not {"X", "Y", "Z"} <= set(values):
        return Target(why="the point its arc goes through is not known before the program runs")
    return Target(pose=(*(values[name] / 1e3 for name in "XYZ"), 0.0, 0.0, 0.0))


def _target(expression: Expression | None, constants: Mapping[str, Expression]) -> Target:
    found = resolved(expression, constants)
    unknown = Target(why="its target is not known before the program runs")
    if found is None or found.kind != "record":
        return unknown
    values = _record(found, constants)
    if values is None:
        return unknown
    axes = [name for name in values if re.fullmatch(r"A[1-7]", name)]
    if axes:
        if sorted(axes) != [f"A{j + 1}" for j in range(len(axes))]:
            return Target(why="its target leaves axes as they are, which is not followed")
        return Target(joints=tuple(math.radians(values[name]) for name in sorted(axes)))
    pose = _frame(found, constants)
    return Target(pose=pose) if pose is not None else Target(why="its target leaves X to C as they are")


def _record(expression: Expression, constants: Mapping[str, Expression]) -> dict[str, float] | None:
    values = {}
    for key, item in zip(expression.keys, expression.items, strict=True):
        value = number_of(item, constants)
        if value is None or key in values:
            return None
        values[key] = value
    return values


def _frame(expression: Expression | None, constants: Mapping[str, Expression]) -> tuple[float, ...] | None:
    """Translation [m] and rotation vector [rad] of a record of X, Y, Z [mm] and A, B, C [deg]."""
    found = resolved(expression, constants)
    values = _record(found, constants) if found is not None and found.kind == "record" else None
    if values is None or not {"X", "Y", "Z", "A", "B", "C"} <= set(values):
        return None
    x, y, z = (values[name] / 1e3 for name in "XYZ")
    return (x, y, z, *from_euler_zyx(values["A"], values["B"], values["C"]))
