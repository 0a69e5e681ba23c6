"""Statements put into the blocks they stand in."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal

from bumpstop.program.languages.calls import calls_in
from bumpstop.program.languages.expression import Expression, read_expression
from bumpstop.program.languages.statements import Branch, Call, Frame, Jump, Leave, Loop, Move, Node, Opaque, Wait
from bumpstop.program.languages.syntax import Statement, SyntaxTree, Token

Kind = Literal["function", "loop", "branch"]
_MAX_OPEN = 40  # blocks in each other: more is no program that a person writes, and would exhaust the stack


@dataclass
class _Open:
    kind: Kind
    line: int
    name: str = ""
    certain: bool = False
    endless: bool = False
    bodies: list[list[Node]] = field(default_factory=lambda: [[]])
    after: tuple[Node, ...] = ()


class Blocks:
    """Builds the functions of a program, statement by statement.

    What does not fit together, such as an end without a beginning, is not understood: the arm may be anywhere then.
    """

    def __init__(
        self,
        functions: Iterable[str],
        pure: frozenset[str],
        jumps: Mapping[str, Jump],
        frames: tuple[Frame, ...],
        leading: str,
        bent: str = "",
    ) -> None:
        """Prepare.

        Args:
            functions: names of all functions of the program in small letters, each as often as it is written.
            pure: functions of the language that only compute.
            jumps: words of the language that leave a loop, a function or the program.
            frames: what the language's statements and functions may set.
            leading: words of statements that are not understood, but only lead to others or come from them.
            bent: why no move of the program is known to go as it is written; empty where they do.
        """
        self.functions: dict[str, tuple[Node, ...]] = {}
        self.not_understood: list[tuple[int, str]] = []
        self.notes: list[str] = []
        # Which of two functions of one name is called is not known.
        counts = Counter(functions)
        self.own = frozenset(counts)
        self._names = {name for name, count in counts.items() if count == 1}
        self._pure, self._jumps, self._frames = pure - self._names, jumps, frames
        self._leading, self._bent = frozenset(leading.split()), bent
        self._never_first: set[str] = set()
        self._open = [_Open("function", 0)]

    def add(self, node: Node) -> None:
        """A statement of the innermost block."""
        if isinstance(node, Move) and not node.why:
            node = replace(node, why=self._bent)
        self._open[-1].bodies[-1].append(node)

    def opaque(
        self,
        statement: Statement,
        *,
        moves: bool = True,
        resets: bool = True,
        reframes: tuple[Frame, ...] | None = None,
    ) -> None:
        """A statement that is not understood, which is named.

        Args:
            statement: the whole of it.
            moves: the arm may be elsewhere afterwards.
            resets: speeds may be others afterwards.
            reframes: what may be another one afterwards; None: all that the language sets.
        """
        text, words = statement.text, [word.text.lower() for word in statement.words]
        self.not_understood.append((statement.line, text))
        leads = words[len(words) > 1 and words[0] == "global"] in self._leading or words[1:] == [":"]
        self.add(Opaque(statement.line, text, moves, resets, self._frames if reframes is None else reframes, leads))
        for word in statement.words:
            if word.kind == "name" and word.text.lower() in self._jumps:
                # Whether it jumps is not known.
                self.add(Branch(statement.line, ((Leave(statement.line, self._jumps[word.text.lower()]),),)))

    def jump(self, statement: Statement, word: str) -> None:
        """A jump by a word of the language."""
        self.add(Leave(statement.line, self._jumps[word]))

    def evaluate(self, statement: Statement, words: Sequence[Token]) -> None:
        """What an expression of a statement calls: a function of the program, or something that is not understood."""
        names = calls_in(words, self._pure)
        call = read_expression(words) if len(names) == 1 else None
        if call is not None and call.kind == "call" and not call.items and names[0] in self._names:
            self.add(Call(statement.line, names[0]))
        elif names:
            self.opaque(statement)

    def call(self, statement: Statement, name: str) -> None:
        """A call without arguments."""
        if name in self._names:
            self.add(Call(statement.line, name))
        else:
            self.opaque(statement)

    def note(self, line: int, text: str) -> None:
        """Something that is taken for granted."""
        self.notes.append(f"line {line}: {text}")

    def note_time(self, line: int) -> None:
        """A move says its time, and not how it speeds up."""
        self.note(line, "its time says nothing of its ramps; half of it is taken to speed up, the most speed it allows")

    def note_load(self, line: int) -> None:
        """What the arm carries is set."""
        self.note(line, "what the arm carries is set, and not followed: the load of the scenario's robot is judged")

    def begin_function(self, statement: Statement, name: str, *, first: bool) -> None:
        """A function; ``first``: a program may begin with it."""
        name = name.lower()
        while name in self.functions or any(block.name == name for block in self._open[1:]):
            name += "'"  # a second one of the same name is called by nobody
        if not first:
            self._never_first.add(name)
        self._open.append(_Open("function", statement.line, name))

    def begin_branch(self, statement: Statement, condition: Sequence[Token]) -> None:
        """A branch whose condition is evaluated before it."""
        self.evaluate(statement, condition)
        self._open.append(_Open("branch", statement.line))

    def begin_loop(
        self, statement: Statement, condition: Sequence[Token], *, certain: bool = False, endless: bool = False
    ) -> None:
        """A loop whose condition is evaluated before every round; a ``certain`` one is run once at least."""
        opened = _Open("loop", statement.line, "", certain, endless)
        if calls_in(condition, self._pure):
            self.opaque(statement)
            again = Opaque(statement.line, statement.text, resets=True, reframes=self._frames)
            opened.bodies, opened.after = [[again]], (again,)
        self._open.append(opened)

    def otherwise(self, statement: Statement, condition: Sequence[Token]) -> None:
        """The next alternative of a branch."""
        if self._open[-1].kind != "branch":
            self.opaque(statement)
            return
        if calls_in(condition, self._pure):
            # Before all alternatives, for it may be evaluated before the later ones, too.
            self.not_understood.append((statement.line, statement.text))
            before = Opaque(statement.line, statement.text, resets=True, reframes=self._frames)
            self._open[-2].bodies[-1].append(before)
        self._open[-1].bodies.append([])

    def end(self, statement: Statement, kind: Kind | None = None, condition: Sequence[Token] = ()) -> None:
        """The innermost block closes; of a kind, where the language says which."""
        if len(self._open) == 1 or (kind is not None and self._open[-1].kind != kind):
            self.opaque(statement)
            return
        self.evaluate(statement, condition)
        self._close()

    def _close(self) -> None:
        closed = self._open.pop()
        bodies = tuple(tuple(body) for body in closed.bodies)
        if closed.kind == "function":
            body = bodies[0]
            # Where it ends it returns anyway.
            last = body[-1] if body else None
            self.functions[closed.name] = body[:-1] if isinstance(last, Leave) and last.what == "function" else body
        elif len(self._open) > _MAX_OPEN:
            self.not_understood.append((closed.line, text := f"a block inside of {_MAX_OPEN} others"))
            self.add(Opaque(closed.line, text, resets=True, reframes=self._frames))
        elif closed.kind == "loop":
            self.add(Loop(closed.line, bodies[0], closed.certain, closed.endless))
            for node in closed.after:
                self.add(node)
        else:
            self.add(Branch(closed.line, bodies))

    def finish(self) -> dict[str, tuple[Node, ...]]:
        """The functions; what stands outside of all is under the empty name."""
        while len(self._open) > 1:
            self.not_understood.append((self._open[-1].line, "a block that is not closed"))
            self._close()
        self.not_understood = list(dict.fromkeys(self.not_understood))
        main = tuple(self._open[0].bodies[0])
        return ({"": main} if main else {}) | self.functions

    def may_be_first(self, name: str) -> bool:
        """Whether a program may begin with a function: it has no parameters, and is called by no event."""
        return name not in self._never_first

    def only_first(self, functions: Mapping[str, Sequence[Node]]) -> str | None:
        """The one function with something to do that may be first and that no other calls; None where it is not one."""
        called = set(called_by(functions.values()))
        firsts = [
            name
            for name, body in functions.items()
            if name not in called and self.may_be_first(name) and does_something(body)
        ]
        return firsts[0] if len(firsts) == 1 else None


def called_by(bodies: Iterable[Sequence[Node]]) -> Iterable[str]:
    """Names of the functions that are called somewhere in bodies."""
    for body in bodies:
        for node in body:
            if isinstance(node, Call):
                yield node.name
            elif isinstance(node, Loop):
                yield from called_by([node.body])
            elif isinstance(node, Branch):
                yield from called_by(node.bodies)


def does_something(body: Sequence[Node]) -> bool:
    """Whether moves or calls stand in a body."""
    return any(
        isinstance(node, (Move, Call))
        or (isinstance(node, Loop) and does_something(node.body))
        or (isinstance(node, Branch) and any(does_something(inner) for inner in node.bodies))
        for node in body
    )


def idles(body: Sequence[Node]) -> bool:
    """Whether a body only waits and computes: it moves nothing, and sets nothing that moves hang on."""
    return all(
        isinstance(node, (Wait, Leave))
        or (isinstance(node, Loop) and idles(node.body))
        or (isinstance(node, Branch) and all(idles(inner) for inner in node.bodies))
        for node in body
    )


def moves_unseen(body: Sequence[Node]) -> bool:
    """Whether something in a body is not understood and may move the arm itself."""
    return any(
        (isinstance(node, Opaque) and node.moves and not node.leads)
        or (isinstance(node, Loop) and moves_unseen(node.body))
        or (isinstance(node, Branch) and any(moves_unseen(inner) for inner in node.bodies))
        for node in body
    )


def bent_by(tree: SyntaxTree, words: frozenset[str]) -> str:
    """Which of some words, in small letters, may take every move off its path, in a sentence; empty where none does."""
    for statement in tree.statements:
        for word in statement.words:
            if word.text.lower().partition(".")[0] in words:
                return f"{word.text} of line {statement.line} may take it off its path"
    return ""


_UNKNOWN = Expression("unknown", 0, 0)


class Assignments:
    """What names are assigned to; a name is a constant where it is assigned once, from constants."""

    def __init__(self) -> None:
        self._found: dict[str, list[Expression | None]] = {}
        self._changed: set[str] = set()
        self._declared: Counter[str] = Counter()
        self._fixed: set[str] = set()

    def add(self, name: str, value: Expression | None) -> None:
        """One assignment; None: to what is no expression of ours."""
        self._found.setdefault(name.lower(), []).append(value)

    def change(self, name: str) -> None:
        """A part of a name changes, or something that is not read changes it."""
        self._changed.add(name.lower())

    def declare(self, name: str, *, fixed: bool = False) -> None:
        """A declaration: of two the inner one hides the other; nothing that a ``fixed`` name is given to changes it."""
        self._declared[name.lower()] += 1
        if fixed:
            self._fixed.add(name.lower())

    def constants(self) -> dict[str, Expression]:
        """By name in small letters; of a name that has no known value an unknown one, whatever it means elsewhere."""
        changed = (self._changed - self._fixed) | {name for name, count in self._declared.items() if count > 1}
        # Names that the language itself has, as speeds and zones, are changed by nothing.
        found = {name: _UNKNOWN for name in changed if name in self._declared or name in self._found}
        for name, values in self._found.items():
            # A change of the whole is one of its parts.
            heads = [name[: match.start()] for match in re.finditer(r"[.\[]", name)]
            whole = len(values) == 1 and name not in changed
            known = whole and not any(head in changed or head in self._found for head in heads)
            found[name] = (values[0] if known else None) or _UNKNOWN
        return found
