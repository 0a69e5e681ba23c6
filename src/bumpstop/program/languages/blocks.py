"""Statements put into the blocks they stand in."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Literal

from bumpstop.program.languages.expression import Expression
from bumpstop.program.languages.statements import Branch, Frame, Loop, Node, Opaque
from bumpstop.program.languages.syntax import Statement

Kind = Literal["function", "loop", "branch"]


@dataclass
class _Open:
    kind: Kind
    line: int
    name: str = ""
    certain: bool = False
    bodies: list[list[Node]] = field(default_factory=lambda: [[]])


class Blocks:
    """Builds the functions of a program, statement by statement.

    What does not fit together, such as an end without a beginning, is not understood: the arm may be anywhere then.
    """

    def __init__(self) -> None:
        self.functions: dict[str, tuple[Node, ...]] = {}
        self.not_understood: list[tuple[int, str]] = []
        self.notes: list[str] = []
        self._open = [_Open("function", 0)]

    def add(self, node: Node) -> None:
        """A statement of the innermost block."""
        self._open[-1].bodies[-1].append(node)

    def opaque(
        self, statement: Statement, *, moves: bool = True, resets: bool = False, reframes: tuple[Frame, ...] = ()
    ) -> None:
        """A statement that is not understood, which is named.

        Args:
            statement: the whole of it.
            moves: the arm may be elsewhere afterwards.
            resets: speeds may be others afterwards.
            reframes: what may be another one afterwards, tool or frame.
        """
        text = statement.text
        self.not_understood.append((statement.line, text))
        self.add(Opaque(statement.line, text, moves, resets, reframes))

    def note(self, line: int, text: str) -> None:
        """Something that is taken for granted."""
        self.notes.append(f"line {line}: {text}")

    def note_time(self, line: int) -> None:
        """A move says its time, and not how it speeds up."""
        self.note(line, "its time says nothing of its ramps; half of it is taken to speed up, the most speed it allows")

    def begin(self, kind: Kind, statement: Statement, name: str = "", *, certain: bool = False) -> None:
        """A block opens; a ``certain`` loop is run once at least."""
        self._open.append(_Open(kind, statement.line, name.lower(), certain))

    def otherwise(self, statement: Statement) -> None:
        """The next alternative of a branch."""
        if self._open[-1].kind == "branch":
            self._open[-1].bodies.append([])
        else:
            self.opaque(statement)

    def end(self, statement: Statement, kind: Kind | None = None) -> None:
        """The innermost block closes; of a kind, where the language says which."""
        if len(self._open) == 1 or (kind is not None and self._open[-1].kind != kind):
            self.opaque(statement, resets=True, reframes=("tool", "base"))
            return
        self._close()

    def _close(self) -> None:
        closed = self._open.pop()
        bodies = tuple(tuple(body) for body in closed.bodies)
        if closed.kind == "function":
            name = closed.name
            while name in self.functions:
                name += "'"  # a second one of the same name is called by nobody
            self.functions[name] = bodies[0]
        elif closed.kind == "loop":
            self.add(Loop(closed.line, bodies[0], closed.certain))
        else:
            self.add(Branch(closed.line, bodies))

    def finish(self) -> dict[str, tuple[Node, ...]]:
        """The functions; what stands outside of all is under the empty name."""
        while len(self._open) > 1:
            self.not_understood.append((self._open[-1].line, "a block that is not closed"))
            self._close()
        main = tuple(self._open[0].bodies[0])
        return ({"": main} if main else {}) | self.functions


class Assignments:
    """What names are assigned to; a name is a constant where it is assigned once, from constants."""

    def __init__(self) -> None:
        self._found: dict[str, list[Expression | None]] = {}

    def add(self, name: str, value: Expression | None) -> None:
        """One assignment; None: to what is no expression of ours."""
        self._found.setdefault(name.lower(), []).append(value)

    def constants(self) -> dict[str, Expression]:
        """By name in small letters."""
        return {name: values[0] for name, values in self._found.items() if len(values) == 1 and values[0] is not None}
