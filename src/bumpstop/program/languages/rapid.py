"""RAPID: MoveAbsJ, MoveJ, MoveL and MoveC to constants, with speeddata and zonedata."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from bumpstop.program.languages.blocks import Assignments, Blocks, bent_by
from bumpstop.program.languages.calls import RAPID_PURE, function_name, has_parameters, names_given
from bumpstop.program.languages.expression import (
    Expression,
    assigned,
    behind,
    number_of,
    read_expression,
)
from bumpstop.program.languages.rapid_data import (
    arguments_of,
    frame_of_object,
    frame_of_tool,
    joint_target,
    persistent_data,
    pose_target,
    speed_of,
    stands_apart,
    time_of,
    zone_of,
)
from bumpstop.program.languages.rapid_settings import HANDLERS, displaced_by, displaces, head_of, plain, raised_by
from bumpstop.program.languages.statements import (
    MIN_TIME_S,
    Branch,
    Frames,
    Jump,
    Leave,
    Move,
    ReadProgram,
    Wait,
)
from bumpstop.program.languages.syntax import TRIVIA, Statement, SyntaxTree, Token, statement_of, tokenize

_TOKENS = re.compile(
    r"(?P<comment>![^\n\r]*|%%%[\w:.\s]*%%%)|(?P<newline>\r?\n)|(?P<space>[ \t\r\f\v]+)"
    r"|(?P<number>(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][+-]?[0-9]+)?)"
    r"|(?P<name>[A-Za-z_][A-Za-z0-9_.]*)|(?P<string>\"[^\"\n\r]*\")"
    r"|(?P<operator>:=|<>|<=|>=|[-+*/=<>()\[\]{},:;\\?|%&@])"
)
# Statements that end without a semicolon.
_LINE_WORDS = (
    "module endmodule proc endproc func endfunc trap endtrap record endrecord while endwhile for endfor if elseif else "
    "endif test case default endtest error undo backward"
)
_LINES = frozenset(_LINE_WORDS.split())
# Words that end such a statement; another one begins behind it, on the same line or not.
_ENDS = {"while": "do", "for": "do", "if": "then", "elseif": "then", "case": ":", "default": ":"}
# Statements of one word and of two.
_ONE_WORDS = "endmodule endproc endfunc endtrap endrecord endwhile endfor endif endtest else undo backward"
_ONE = frozenset(_ONE_WORDS.split())
_TWO = frozenset(("trap", "record"))
_CASES = frozenset(("case", "default", "endtest"))
_OPERATOR_WORDS = "if elseif while for from to step do then test case default and or not xor div mod"
_OPERATORS = frozenset(_OPERATOR_WORDS.split())
_LOOPS = ("while", "for")
_CLOSE = {
    "endproc": "function",
    "endfunc": "function",
    "endtrap": "function",
    "endwhile": "loop",
    "endfor": "loop",
    "endif": "branch",
    "endtest": "branch",
}
# Words with a condition or a value behind them.
_CONDITIONS = frozenset((*_LOOPS, "if", "elseif", "test", "case", "default"))
_HARMLESS_WORDS = (
    "set reset setdo setao setgo waittime waitdi waitdo waituntil waitai tpwrite tperase pulsedo invertdo stop confl "
    "confj singarea accset clkreset clkstart clkstop module endmodule record endrecord "
    "waitrob gripload idelete"
)
_HARMLESS = frozenset(_HARMLESS_WORDS.split())
# Instructions that change the variable that they are given.
_CHANGING = frozenset(("incr", "decr", "add", "clear"))
_WAITS = frozenset(("waittime", "waitdi", "waitdo", "waituntil", "waitai", "waitrob", "stop"))
_JUMPS: Mapping[str, Jump] = {"return": "function", "exit": "program", "exitcycle": "cycle"}
_LEADING = "error undo backward trynext retry raise goto connect isignaldi isignaldo itimer isleep iwatch"
_DATA = frozenset(("const", "pers", "var", "local", "task"))
_BENDING = frozenset(("softact",))
_MOVES = {"movel": True, "movej": False, "moveabsj": False, "movec": True}


def parse_rapid(source: bytes) -> SyntaxTree:
    """The syntax tree of any bytes; a statement ends with a semicolon, or where the language says so without one."""
    statements: list[Statement] = []
    tokens = tokenize(source, _TOKENS)
    begin, line, reached = 0, 1, _Reached()
    for i, (token, following) in enumerate(zip(tokens, _following(tokens), strict=True)):
        if reached.ends_with(token, following):
            statements.append(statement_of(tokens[begin : i + 1], line))
            line += sum(t.text.count("\n") for t in tokens[begin : i + 1])
            begin, reached = i + 1, _Reached()
    if begin < len(tokens):
        statements.append(statement_of(tokens[begin:], line))
    return SyntaxTree(source, tuple(statements))


def _following(tokens: Sequence[Token]) -> list[str]:
    """Of every token the text of the next word, in small letters; empty at the end."""
    found, text = [], ""
    for token in reversed(tokens):
        found.append(text)
        text = text if token.kind in TRIVIA else token.text.lower()
    return found[::-1]


@dataclass
class _Reached:
    """How far a statement is read.

    Attributes:
        first: its first name in small letters, without a word that makes it local.
        count: of its words from that one on, or of all.
        level: of open brackets.
        is_label: it begins with a name that a colon may make a label.
    """

    first: str = ""
    count: int = 0
    level: int = 0
    is_label: bool = False

    def ends_with(self, token: Token, following: str) -> bool:
        """Whether it ends with its next token."""
        if token.kind == "newline":
            if self.first in ("proc", "func"):
                return self.level == 0
            return not self.first or (self.first in _LINES and self.first not in _ENDS)
        if token.kind in TRIVIA:
            return False
        if token.kind == "name" and self.first in ("", "local", "task"):
            self.is_label = not self.first and not self.count and token.text.lower() not in _LINES
            self.first, self.count = token.text.lower(), 0
        self.count += 1
        self.level += (token.text == "(") - (token.text == ")")
        closed = token.text == ")" and self.level == 0
        if self.first in ("module", "error"):
            whole = closed or (self.count == 1 + (self.first == "module") and following != "(")
        elif self.first in ("proc", "func"):
            whole = closed
        elif self.first == "test":
            whole = following in _CASES
        else:
            whole = (
                _ENDS.get(self.first) == token.text.lower()
                or self.first in _ONE
                or (self.first in _TWO and self.count == 2)
                or (self.is_label and self.count == 2 and token.text == ":")
            )
        return whole or token.text == ";"


def read_rapid(source: bytes) -> ReadProgram:
    """What is understood of a program."""
    tree, assignments, names = parse_rapid(source), Assignments(), []
    for statement in tree.statements:
        words = plain(statement)
        _assign(assignments, words)
        if (head := head_of(words)) is not None:
            names.append(function_name(head))
    constants = assignments.constants()
    bent = raised_by(tree, constants) or bent_by(tree, _BENDING) or displaced_by(tree)
    blocks = Blocks(names, RAPID_PURE, _JUMPS, ("shift",), _LEADING, bent)
    for statement in tree.statements:
        if plain(statement):
            _add(blocks, statement, constants)
    functions = blocks.finish()
    if persistent := persistent_data(tree, _MOVES):
        told = "taken as declared here, though other tasks, the pendant or an earlier run may have changed them"
        blocks.notes.append(f"{', '.join(persistent)}: PERS data of moves are {told}")
    return ReadProgram(
        "RAPID",
        source,
        functions,
        tuple(blocks.not_understood),
        tuple(blocks.notes),
        constants,
        main="main" if "main" in functions else blocks.only_first(functions),
        frames=("shift",),
        cycles="main" in functions,
    )


def _is_label(words: Sequence[Token]) -> bool:
    return len(words) > 1 and words[1].text == ":" and words[0].kind == "name" and words[0].text.lower() not in _LINES


def _value(words: Sequence[Token]) -> Sequence[Token]:
    """What a declaration or an assignment evaluates."""
    texts = [word.text for word in words]
    return words[texts.index(":=") + 1 :] if ":=" in texts else []


def _assign(assignments: Assignments, words: Sequence[Token]) -> None:
    """What a statement declares, assigns and changes."""
    if not words or _is_label(words):
        return
    first = words[0].text.lower()
    for name in names_given(words, RAPID_PURE):
        if head_of(words) is None:
            assignments.change(name)  # what a call is given it may change
        else:
            assignments.add(name, None)  # a parameter hides what has its name outside
    if first == "for" and len(words) > 1:
        assignments.add(words[1].text, None)
    elif head_of(words) is None and first in _DATA:
        rest = list(words)
        while rest and rest[0].text.lower() in _DATA:
            rest = rest[1:]
        if len(rest) > 1:  # the type and the name
            assignments.declare(rest[1].text, fixed=any(word.text.lower() == "const" for word in words[:3]))
            _assign_one(assignments, rest[1:])
            if not _value(rest):
                assignments.add(rest[1].text, None)  # it has a value already, zero, before it is assigned one
    elif assigned(words, ":=") is not None:
        _assign_one(assignments, words)
    else:
        _change(assignments, words)
    if first in _CONDITIONS and (done := behind(words, _OPERATORS, frozenset())):
        # Whether what is done by the condition is done is not known.
        if (found := assigned(done, ":=")) is not None:
            assignments.change(found[0].partition(".")[0])
        else:
            _change(assignments, done)


def _change(assignments: Assignments, words: Sequence[Token]) -> None:
    """What an instruction or a procedure is given it may change."""
    first = words[0].text.lower()
    if first in _CHANGING or not _is_known(first):
        for word in words[1:]:
            if word.kind == "name":
                assignments.change(word.text.partition(".")[0])


def _is_known(first: str) -> bool:
    return first in _MOVES or first in _HARMLESS or first in _LINES or first in _JUMPS


def _assign_one(assignments: Assignments, words: Sequence[Token]) -> None:
    found = assigned(words, ":=")
    if found is not None and found[1] == 1 and "." not in found[0]:
        assignments.add(found[0], read_expression(words[2:]))
    elif found is not None:
        # A component or an element changes the whole.
        assignments.change(found[0].partition(".")[0])


def _add(blocks: Blocks, statement: Statement, constants: Mapping[str, Expression]) -> None:
    words = plain(statement)
    first = words[0].text.lower()
    rest = behind(words, _OPERATORS, frozenset()) if first in _CONDITIONS and first != "if" else []
    if rest and first == "test":
        blocks.opaque(statement)
    if _is_label(words):
        # A jump may lead here from anywhere.
        blocks.opaque(statement)
    elif (head := head_of(words)) is not None:
        may_be_first = head[0].text.lower() == "proc" and not has_parameters(head)
        blocks.begin_function(statement, function_name(head), first=may_be_first)
        if head[0].text.lower() != "trap" and head[-1].text != ")":
            blocks.opaque(statement)
    elif first in _LOOPS:
        endless = [word.text.lower() for word in words] == ["while", "true", "do"]
        certain = endless or (first == "for" and _runs(words, constants))
        blocks.begin_loop(statement, words[1:], certain=certain, endless=endless)
    elif first == "test" or (first == "if" and words[-1].text.lower() == "then"):
        blocks.begin_branch(statement, words[1:])
    elif first in _CLOSE:
        blocks.end(statement, _CLOSE[first])  # type: ignore[arg-type]
    elif first in ("elseif", "else", "case", "default"):
        blocks.otherwise(statement, words[1:])
    elif first in HANDLERS:
        # The function ends before its handler, which begins anywhere.
        blocks.add(Leave(statement.line, "function"))
        blocks.opaque(statement)
    elif first == "if" and (jump := words[-1].text.lower()) in _JUMPS:
        blocks.evaluate(statement, words[1:])
        blocks.add(Branch(statement.line, ((Leave(statement.line, _JUMPS[jump]),),)))
    elif first in _MOVES and first not in blocks.own:
        blocks.evaluate(statement, words[1:])
        _add_move(blocks, statement, words, constants)
    elif first in _DATA or assigned(words, ":=") is not None:
        blocks.evaluate(statement, _value(words))
    elif first in _JUMPS:
        blocks.evaluate(statement, words[1:])
        blocks.jump(statement, first)
    elif first == "pdispoff":
        blocks.add(Frames(statement.line, "shift", (0.0,) * 6))
    elif displaces(words):
        blocks.opaque(statement, moves=False)
    elif first == "module":
        pass  # what stands in brackets are its attributes, and no call
    elif (first in _HARMLESS or first in _CHANGING) and first not in blocks.own and not _goes_on_elsewhere(words):
        if first == "waituntil":
            blocks.begin_loop(statement, [], certain=True)
        blocks.evaluate(statement, words[1:])
        if first == "waituntil":
            blocks.end(statement)  # it is asked again and again
        if first in _WAITS:
            blocks.add(Wait(statement.line))
        if first == "gripload":
            blocks.note_load(statement.line)
    elif len(words) == 1 and words[0].kind == "name" and first not in _LINES:
        blocks.call(statement, first)
    elif first == "velset":
        blocks.opaque(statement, moves=False, reframes=())
    else:
        blocks.opaque(statement)
    if rest and first != "test":
        blocks.opaque(statement)


def _goes_on_elsewhere(words: Sequence[Token]) -> bool:
    """Whether the arm may be jogged at a ``Stop``, and does not go back before the next move."""
    return words[0].text.lower() == "stop" and any(word.text.lower() == "noregain" for word in words)


def _runs(words: Sequence[Token], constants: Mapping[str, Expression]) -> bool:
    """Whether ``FOR i FROM 1 TO 6 DO`` runs once at least; either way counts where no step is given."""
    texts = [word.text.lower() for word in words]
    if texts[2:3] != ["from"] or "to" not in texts or "step" in texts or texts[-1] != "do":
        return False
    at = texts.index("to")
    bounds = (number_of(read_expression(part), constants) for part in (words[3:at], words[at + 1 : -1]))
    return None not in tuple(bounds)


def _add_move(blocks: Blocks, statement: Statement, words: list[Token], constants: Mapping[str, Expression]) -> None:
    why = ""
    arguments, kind = arguments_of(words[1:]), words[0].text.lower()
    via = arguments.pop(0) if kind == "movec" and arguments else None
    if len(arguments) < 4 or any(argument.value is None for argument in arguments[:4]):
        blocks.opaque(statement)
        return
    target, speed, zone, tool = arguments[:4]
    frame = frame_of_tool(tool.value, constants)
    base = frame_of_object(tool.switches.get("wobj"), constants) if "wobj" in tool.switches else (0.0,) * 6
    blocks.add(Frames(statement.line, "tool", frame))
    blocks.add(Frames(statement.line, "base", base))
    slot = time_of(speed, constants) if "t" in speed.switches else speed_of(speed, constants)
    blend = zone_of(zone, constants)
    if any("corr" in argument.switches for argument in arguments):
        why = "corrections that are not known before the program runs are added to it"
    elif stands_apart(tool, constants):
        why = "its tool stands still, or its work object moves"
    elif slot is None:
        why = "its speed is not known before the program runs"
    elif blend is None:
        why = "its zone is not known before the program runs"
    elif slot.time and (blend > 0 or (slot.value or 0.0) < MIN_TIME_S):
        why = f"its time T is given with a zone, or is below {MIN_TIME_S:g} s"
    if "tload" in tool.switches:
        blocks.note_load(statement.line)
    if slot is not None and slot.time:
        blocks.note_time(statement.line)
    blocks.add(
        Move(
            line=statement.line,
            word=words[0].text,
            linear=_MOVES[kind],
            target=joint_target(target.value, constants) if kind == "moveabsj" else pose_target(target, constants),
            measure="tool",
            speed=(slot,) if slot is not None else (),
            blend=blend or 0.0,
            why=why,
            via=None if via is None else pose_target(via, constants),
        )
    )
