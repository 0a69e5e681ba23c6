"""KRL: PTP, LIN and CIRC to constants, with the speeds that settings leave them."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence

from bumpstop.program.languages.blocks import Assignments, Blocks, bent_by, does_something
from bumpstop.program.languages.calls import KRL_PURE, calls_in, function_name, has_parameters, names_given
from bumpstop.program.languages.expression import (
    Expression,
    Reader,
    assigned,
    behind,
    number_of,
    read_expression,
    split_at,
)
from bumpstop.program.languages.krl.data import arc_place, forget_fractions, frame_of_record, pose_or_axes
from bumpstop.program.languages.krl.inline_forms import InlineForms
from bumpstop.program.languages.krl.look_ahead import looks_no_further
from bumpstop.program.languages.krl.variables import ALL_FRAMES, changed_by
from bumpstop.program.languages.statements import (
    Frame,
    Frames,
    Jump,
    Move,
    Node,
    ReadProgram,
    Setting,
    SpeedSlot,
    Target,
    Wait,
)
from bumpstop.program.languages.syntax import Statement, SyntaxTree, Token, parse_lines

_TOKENS = re.compile(
    r"(?P<comment>;[^\n\r]*|(?:(?<![^\n])|(?<=\A\xef\xbb\xbf))&[^\n\r]*)|(?P<newline>\r?\n)|(?P<space>[ \t\r\f\v]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?|'(?:[bB][01]+|[hH][0-9a-fA-F]+)')"
    r"|(?P<name>[$#]?[A-Za-z_][A-Za-z0-9_$]*(?:\.[A-Za-z_][A-Za-z0-9_]*)*)|(?P<string>\"[^\"\n\r]*\")"
    r"|(?P<division>/)|(?P<operator>==|<>|<=|>=|[-+*=<>()\[\]{},:!?'])"
)
_TYPES = frozenset(("e6pos", "pos", "e6axis", "axis", "frame", "real", "int", "bool", "char"))
_FUNCTIONS = ("def", "deffct")
_LOOPS = ("loop", "while", "repeat", "for")
_BRANCHES = ("if", "switch")
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
# Words behind which a line is at its end, and words that need something before or behind them.
_ENDS = frozenset(("loop", "repeat", "then", "else", "default", *(word for word in _CLOSE if word != "until")))
_OPERATOR_WORDS = "if while for to step until switch case and or not exor b_and b_or b_exor b_not"
_OPERATORS = frozenset(_OPERATOR_WORDS.split())
# What neither moves the arm nor says how it moves.
_HARMLESS_WORDS = "wait halt continue pulse defdat enddat ext extfct signal enum struc ini anout"
_DECLARATIONS = ("defdat", "enddat", "ext", "extfct", "signal", "enum", "struc")
_HARMLESS = frozenset(_HARMLESS_WORDS.split())
_WAITS = ("wait", "halt", "pulse", "anout")
_LEADING = "goto interrupt brake resume"
# Sensors and weaving, which add to what is written.
_BENDING = frozenset(("rsi_on", "st_on", "$tech", "$tech_c"))
_JUMPS: Mapping[str, Jump] = {"exit": "loop", "return": "function"}
# Other motions: the arm is elsewhere after them, and that is all.
_OTHER_WORDS = "sptp slin scirc ptp_rel lin_rel circ_rel sptp_rel slin_rel scirc_rel"
_OTHER_MOTIONS = frozenset(_OTHER_WORDS.split())
_BLENDS = frozenset(("c_ptp", "c_dis", "c_vel", "c_ori"))
_SETTINGS = {
    "$vel.cp": ("tool", "m/s", 3.0),
    "$acc.cp": ("acceleration tool", "m/s2", 10.0),
    "$vel_axis": ("axes", "%", 100.0),
    "$acc_axis": ("acceleration axes", "%", 100.0),
    "$apo": ("blend", "", 0.0),
    "$apo.cdis": ("blend", "mm", 1e6),
}
_FRAMES: tuple[Frame, ...] = ("tool", "base")
_MAX_AXES = 12  # of an arm and what it carries or rides on


def parse_krl(source: bytes) -> SyntaxTree:
    """The syntax tree of any bytes; a line is a statement."""
    return parse_lines(source, _TOKENS)


def read_krl(source: bytes, data: bytes = b"", config: bytes = b"") -> ReadProgram:
    """What is understood of a program.

    Args:
        source: of the .src.
        data: of the .dat beside it, whose declarations count too.
        config: of the controller's $config.dat, of which records count: numbers may be what other programs leave there.
    """
    tree, assignments, names = parse_krl(source), Assignments(), []
    common, own = parse_krl(config).statements, (*parse_krl(data).statements, *tree.statements)
    shared = [s for s in common if any(word.text == "{" for word in s.words)]
    variables = {part[0].text.lower() for s in (*common, *own) for part in _declared(s.words)}
    for statement in (*shared, *own):
        _assign(assignments, statement.words)
        if (head := _head(statement.words)) is not None:
            names.append(function_name(head))
    constants = assignments.constants()
    whole = (s.words for s in own if any(word.text.lower() == "int" for word in s.words[:4]))
    forget_fractions(constants, [part for words in whole for part in _declared(words)])
    blocks = Blocks(names, KRL_PURE, _JUMPS, _FRAMES, _LEADING, bent_by(tree, _BENDING))
    counts = dict[str, tuple[float, float]]()
    forms = InlineForms(tree, constants, blocks.own)
    before = ""
    # Where it does not look ahead nothing is blended.
    looks_ahead = "$advance" not in constants or (number_of(constants["$advance"], constants) or 0) >= 1
    for number, statement in enumerate(tree.statements):
        forms.follow(statement)
        if words := statement.words:
            first = words[0].text.lower()
            if first == "for" and len(words) > 1:
                variables.add(words[1].text.lower())
                # What the index of a setting runs through is said by the loop around it, where it does nothing else.
                bounds = _bounds(words, constants) if _only_sets(tree.statements, number) else None
                counts[words[1].text.lower()] = bounds or (math.nan, math.nan)
            elif first == "endfor" or _head(words):
                counts.clear()
            elif assigned(words, "=") is not None:
                counts.pop(first, None)
            nodes = forms.sets(statement)
            if (alone := forms.spline(statement)) is not None:
                nodes = [_move(statement, tree, constants, alone), *forms.after(statement)]
            asks = nodes is None and before != "continue" and looks_no_further(words, variables)
            waits = first in _WAITS or not looks_ahead or asks
            if waits:
                blocks.add(Wait(statement.line))
            if nodes is None:
                _add(blocks, statement, tree, constants, counts)
            for node in nodes or ():
                blocks.add(node)
            if waits:
                blocks.add(Wait(statement.line))  # in the block that begins here, too
            before = first
    functions = blocks.finish()
    # A module begins with its first function; the others are its own.
    main = "" if does_something(functions.get("", ())) else next((name for name in names), None)
    return ReadProgram(
        "KRL",
        source,
        functions,
        tuple(blocks.not_understood),
        (*blocks.notes, *forms.notes),
        constants,
        main=main if main is not None and blocks.may_be_first(main) else None,
        frames=_FRAMES,
    )


def _head(words: list[Token]) -> list[Token] | None:
    """The head of a function, without the word that makes it global."""
    if len(words) > 1 and words[0].text.lower() == "global":
        words = words[1:]
    return words if words and words[0].text.lower() in _FUNCTIONS else None


def _rest(words: list[Token]) -> Sequence[Token]:
    """What stands behind the end of a line that opens, goes on with or closes a block; KRL has no such thing."""
    if (head := _head(words)) is not None:
        level = 0
        for i, word in enumerate(head):
            level += (word.text == "(") - (word.text == ")")
            if word.text == ")" and level == 0:
                return head[i + 1 :]
        return head[1:] if level else head[3:]
    first = words[0].text.lower()
    blocks = first in _LOOPS or first in _BRANCHES or first in _CLOSE or first in ("else", "case", "default")
    return behind(words, _OPERATORS, _ENDS) if blocks else []


def _assign(assignments: Assignments, words: list[Token]) -> None:
    """What a statement declares, assigns and changes."""
    texts = [word.text.lower() for word in words]
    for word in _rest(words) if words else []:
        if word.kind == "name":
            assignments.change(word.text.partition(".")[0])
    for name in names_given(words, KRL_PURE):
        if _head(words) is None:
            assignments.change(name)  # what a call is given it may change
        else:
            assignments.add(name, None)  # a parameter hides what has its name outside
    if texts[:1] == ["for"] and len(words) > 1:
        assignments.add(words[1].text, None)
        return
    for part in _declared(words):
        assignments.declare(part[0].text)
        _assign_one(assignments, part)
    plain, declared = _without_type(words)
    if plain and not declared:
        _assign_one(assignments, plain)


def _declared(words: list[Token]) -> list[list[Token]]:
    """The variables of a declaration, each with what is assigned to it."""
    plain, declared = _without_type(words)
    return [part for part in split_at(plain, ",") if declared and part and part[0].kind == "name"]


def _without_type(words: list[Token]) -> tuple[list[Token], bool]:
    """The words of a declaration behind its type, and whether they are one."""
    rest = words
    while rest and rest[0].text.lower() in ("decl", "global", "const"):
        rest = rest[1:]
    declared = len(rest) < len(words) and _head(words) is None
    if rest and rest[0].text.lower() in _TYPES and len(rest) > 1:
        return rest[1:], True
    # Of a type that is not the language's own.
    return (rest[1:] if declared and len(rest) > 1 and rest[1].kind == "name" else rest), declared


def _assign_one(assignments: Assignments, words: list[Token]) -> None:
    found = assigned(words, "=")
    if found is None:
        return
    name, at = found
    value = read_expression(words[at + 1 :])
    if at > 1:
        # An element of an array is a name of its own where its number is known; a part of it changes the whole.
        reader = Reader(words[:at])
        target = reader.expression()
        whole = reader.done and target.kind == "name" and "?" not in target.name
        element = target.name if target.kind == "name" and "?" not in target.name else name
        if not whole:
            assignments.change(element)
            return
        name = target.name
    assignments.add(name, value)
    if "." in name and not name.startswith("$"):
        assignments.change(name.partition(".")[0])


def _add(
    blocks: Blocks,
    statement: Statement,
    tree: SyntaxTree,
    constants: Mapping[str, Expression],
    counts: Mapping[str, tuple[float, float]],
) -> None:
    words = statement.words
    first = words[0].text.lower()
    rest = _rest(words)
    if rest and first == "switch":
        blocks.opaque(statement)
    if (head := _head(words)) is not None:
        may_be_first = head[0].text.lower() == "def" and not has_parameters(head)
        blocks.begin_function(statement, function_name(head), first=may_be_first)
    elif first in _LOOPS:
        certain = first in ("loop", "repeat") or (first == "for" and _bounds(words, constants) is not None)
        blocks.begin_loop(statement, words[1:], certain=certain, endless=first == "loop")
    elif first in _BRANCHES:
        blocks.begin_branch(statement, words[1:-1] if words[-1].text.lower() == "then" else words[1:])
    elif first in _CLOSE:
        blocks.end(statement, _CLOSE[first], words[1:])  # type: ignore[arg-type]
    elif first in ("else", "case", "default"):
        blocks.otherwise(statement, words[1:])
    elif first in _DECLARATIONS:
        pass
    elif [word.text.lower() for word in words] == ["ptp", "$axis_act"]:
        blocks.add(Wait(statement.line))  # it goes to where the arm stands when it has come to rest
    elif first in ("ptp", "lin", "circ"):
        blocks.evaluate(statement, words[1:])
        blocks.add(_move(statement, tree, constants))
    elif first in _JUMPS:
        blocks.evaluate(statement, words[1:])
        blocks.jump(statement, first)
    elif first in _HARMLESS or _without_type(words)[1]:
        blocks.evaluate(statement, words[1:])
    elif (target := assigned(words, "=")) is not None:
        blocks.evaluate(statement, words[target[1] + 1 :])
        if not _set(blocks, statement, constants, counts) and first.startswith("$"):
            if first.startswith("$load"):
                blocks.note_load(statement.line)
            resets, reframes = changed_by(first, words[-1].text.lower())
            if resets or reframes:
                blocks.opaque(statement, moves=False, resets=resets, reframes=reframes)
    elif first == "bas" or first.startswith("$"):
        blocks.opaque(statement, moves=False, reframes=ALL_FRAMES)
    elif words[0].kind == "name" and [word.text for word in words[1:]] == ["(", ")"]:
        blocks.call(statement, first)
    else:
        other = first in _OTHER_MOTIONS
        blocks.opaque(statement, resets=not other, reframes=() if other else None)
    if rest and first != "switch":
        blocks.opaque(statement)


def _bounds(words: list[Token], constants: Mapping[str, Expression]) -> tuple[float, float] | None:
    """First and last number of ``FOR I=1 TO 6``; None where they are not known, or it may run never."""
    texts = [word.text.lower() for word in words]
    if "to" not in texts or texts[2:3] != ["="] or "step" in texts:
        return None
    at = texts.index("to")
    low, high = (number_of(read_expression(part), constants) for part in (words[3:at], words[at + 1 :]))
    return (low, high) if low is not None and high is not None and low <= high else None


def _only_sets(statements: Sequence[Statement], number: int) -> bool:
    """Whether a loop has nothing but assignments before its end, to others than its index: no round is left out."""
    index = statements[number].words[1].text.lower()
    for i in range(number + 1, len(statements)):
        if words := statements[i].words:
            if assigned(words, "=") is None or calls_in(words, KRL_PURE):
                return words[0].text.lower() == "endfor"
            if words[0].text.lower() == index:
                return False
    return False


def _axes(
    words: list[Token], constants: Mapping[str, Expression], counts: Mapping[str, tuple[float, float]]
) -> list[str] | None:
    """Keys of the axes that ``$VEL_AXIS[I]`` sets, ``[3]`` of axis 3; None where they are not known."""
    if len(words) == 1:
        return [""]
    index = read_expression(words[2:-1])
    number = number_of(index, constants)
    name = index.name.lower() if index is not None and index.kind == "name" else ""
    low, high = (number, number) if number is not None else counts.get(name, (math.nan, math.nan))
    whole = low.is_integer() and high.is_integer() and 1 <= low <= high <= _MAX_AXES
    return [f"[{axis}]" for axis in range(int(low), int(high) + 1)] if whole else None


def _set(
    blocks: Blocks,
    statement: Statement,
    constants: Mapping[str, Expression],
    counts: Mapping[str, tuple[float, float]],
) -> bool:
    """A setting of speed, acceleration, tool or base; False where the statement is none."""
    words = statement.words
    texts = [word.text.lower() for word in words]
    if "=" not in texts:
        return False
    at = texts.index("=")
    name, value = texts[0], read_expression(words[at + 1 :])
    if name in ("$tool", "$base") and at == 1 and (pose := frame_of_record(value, constants)) is not None:
        blocks.add(Frames(statement.line, "tool" if name == "$tool" else "base", pose))
        return True
    if name not in _SETTINGS:
        return False
    key, unit, most = _SETTINGS[name]
    axes = _axes(words[:at], constants, counts) if name.endswith("_axis") else [""]
    known = number_of(value, constants)
    if unit == "%" and known is not None:
        known = float(math.ceil(known))  # the controller takes a whole one
    slot = None
    if value is not None and known is not None and (known > 0 or name == "$apo.cdis") and axes is not None:
        factor = {"%": 0.01, "mm": 1e-3}.get(unit, 1.0)
        slot = SpeedSlot(value.start, value.end, known, "{}", most, unit, factor, setting=True, whole=unit == "%")
    else:
        blocks.opaque(statement, moves=False, resets=False, reframes=())
    for axis in axes or [""]:
        blocks.add(Setting(statement.line, f"{key}{axis}", slot))
    return True


def _move(stated: Statement, tree: SyntaxTree, constants: Mapping[str, Expression], own: Sequence[Node] = ()) -> Move:
    """A move; of the planner of splines where something is set for it alone."""
    words = stated.words
    kind = words[0].text.lower().removeprefix("s")
    linear = kind != "ptp"
    why, rest, blends = "", words[1:], set[str]()
    while rest and rest[-1].text.lower() in (("c_spl",) if own else _BLENDS):
        blends.add(rest[-1].text.lower())
        rest = rest[:-1]
    rest = rest[: [word.text.lower() for word in rest].index("with")] if own else rest
    parts = split_at(rest, ",")
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
    target = Target(why=why) if why else pose_or_axes(read_expression(parts[-1]), constants, posture=not linear)
    return Move(
        line=stated.line,
        word=words[0].text,
        linear=linear,
        target=target,
        measure="tool" if linear else "axes",
        default=default,
        blend=(None if blends in ({"c_dis"}, {"c_spl"}) else math.inf) if blends else 0.0,
        via=arc_place(read_expression(parts[0]), constants) if kind == "circ" else None,
        own=tuple(own),
        planner="spline" if own else "",
    )
