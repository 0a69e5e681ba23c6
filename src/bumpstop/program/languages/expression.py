"""Expressions of robot languages: numbers, names, lists, poses, records and calls, with their spans."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any

from bumpstop.program.languages.syntax import Token

# Deeper brackets are no program that a person writes, and would exhaust the stack.
_MAX_LEVELS = 40
_CLOSING = {"(": ")", "[": "]", "{": "}"}
_CONSTANTS = {"pi": math.pi, "true": 1.0, "false": 0.0}
# A value of more than this is no speed, length or angle.
_MAX_VALUE = 1e12


@dataclass(frozen=True)
class Expression:
    """A part of a statement.

    Attributes:
        kind: ``"number"``, ``"name"``, ``"string"``, ``"list"``, ``"pose"``, ``"record"``, ``"call"``, ``"binary"``,
            ``"minus"`` or ``"unknown"``.
        start, end: of its bytes.
        name: of a name or a call; the operator.
        items: of a list, a pose, a call or an operator.
        keys: names of the items of a record; of a call the names of named arguments, empty for others.
        value: of a number.
    """

    kind: str
    start: int
    end: int
    name: str = ""
    items: tuple[Expression, ...] = ()
    keys: tuple[str, ...] = ()
    value: float = math.nan

    def argument(self, name: str, place: int) -> Expression | None:
        """The argument of a call by its name, or by its place where it has none."""
        for key, item in zip(self.keys, self.items, strict=True):
            if key == name:
                return item
        if place < len(self.items) and not any(self.keys[: place + 1]):
            return self.items[place]
        return None


@dataclass
class Reader:
    """Reads expressions from words.

    Attributes:
        words: of a statement, without space and comments.
        at: number of the next word.
        failed: something was met that is no expression.
    """

    words: Sequence[Token]
    at: int = 0
    failed: bool = False
    _level: int = field(default=0, repr=False)

    def peek(self) -> str:
        """Text of the next word; empty at the end."""
        return self.words[self.at].text if self.at < len(self.words) else ""

    def take(self, *texts: str) -> Token | None:
        """The next word if it is one of these, in any case; None and nothing taken if not."""
        if self.at < len(self.words) and self.peek().lower() in texts:
            self.at += 1
            return self.words[self.at - 1]
        return None

    @property
    def done(self) -> bool:
        """Nothing is left, and nothing went wrong."""
        return self.at >= len(self.words) and not self.failed

    def expression(self) -> Expression:
        """A sum of products of parts."""
        return self._chain(("+", "-"), lambda: self._chain(("*", "/"), self._part))

    def _chain(self, operators: tuple[str, ...], part: Any) -> Expression:
        left: Expression = part()
        while not self.failed and (operator := self.take(*operators)):
            right = part()
            name = operator.kind if operator.kind == "division" else operator.text
            left = Expression("binary", left.start, right.end, name, (left, right))
        return left

    def _unknown(self) -> Expression:
        self.failed = True
        place = self.words[min(self.at, len(self.words) - 1)].end if self.words else 0
        return Expression("unknown", place, place)

    def _part(self) -> Expression:
        if self.at >= len(self.words) or self._level > _MAX_LEVELS:
            return self._unknown()
        self._level += 1
        try:
            return self._simple_part()
        finally:
            self._level -= 1

    def _simple_part(self) -> Expression:
        word = self.words[self.at]
        self.at += 1
        if word.text in ("-", "+"):
            inner = self._part()
            return Expression("minus", word.start, inner.end, "", (inner,)) if word.text == "-" else inner
        if word.kind == "number":
            return Expression("number", word.start, word.end, value=_number(word.text))
        if word.kind == "string":
            return Expression("string", word.start, word.end, word.text)
        if word.text == "(":
            inner = self.expression()
            closed = self.take(")")
            return inner if closed else self._unknown()
        if word.text == "[":
            return self._items("list", word, "]")
        if word.text == "{":
            return self._record(word)
        if word.kind == "name":
            return self._named(word)
        self.at -= 1
        return self._unknown()

    def _named(self, word: Token) -> Expression:
        following = self.peek()
        if following == "[" and word.text == "p":
            self.at += 1
            return self._items("pose", word, "]")
        if following == "(":
            self.at += 1
            return self._items("call", word, ")")
        if following == "[":
            self.at += 1
            # An element of an array: its name with its index, where that is a number.
            inside = self._items("list", word, "]")
            index = inside.items[0] if len(inside.items) == 1 else None
            shown = f"{index.value:g}" if index is not None and index.kind == "number" else "?"
            return Expression("name", word.start, inside.end, f"{word.text}[{shown}]")
        return Expression("name", word.start, word.end, word.text)

    def _items(self, kind: str, opening: Token, closing: str) -> Expression:
        items: list[Expression] = []
        keys: list[str] = []
        while not self.failed:
            if end := self.take(closing):
                return Expression(kind, opening.start, end.end, opening.text, tuple(items), tuple(keys))
            if items and not self.take(","):
                return self._unknown()
            key = ""
            if self.at + 1 < len(self.words) and self.words[self.at + 1].text == "=":
                key, self.at = self.peek(), self.at + 2
            items.append(self.expression())
            keys.append(key)
        return self._unknown()

    def _record(self, opening: Token) -> Expression:
        """KRL's ``{X 1, Y 2}``, also with the name of its type before a colon."""
        items: list[Expression] = []
        keys: list[str] = []
        if self.at + 1 < len(self.words) and self.words[self.at + 1].text == ":":
            self.at += 2
        while not self.failed:
            if end := self.take("}"):
                return Expression("record", opening.start, end.end, "", tuple(items), tuple(keys))
            if items and not self.take(","):
                return self._unknown()
            if self.at >= len(self.words) or self.words[self.at].kind != "name":
                return self._unknown()
            keys.append(self.peek().upper())
            self.at += 1
            if self.take("[") and not self.take("]"):  # of text
                return self._unknown()
            items.append(self.expression())
        return self._unknown()


def read_expression(words: Sequence[Token]) -> Expression | None:
    """The expression that words are, all of them; None where they are none."""
    reader = Reader(words)
    found = reader.expression()
    return found if reader.done else None


def assigned(words: Sequence[Token], *signs: str) -> tuple[str, int] | None:
    """The name that a statement assigns to and the place of the sign, which is 1 where it is not a part of it."""
    level = 0
    for i, word in enumerate(words):
        level += (word.text in ("(", "[", "{")) - (word.text in (")", "]", "}"))
        if level == 0 and word.text in signs:
            is_target = words[0].kind == "name" and (i == 1 or (i > 1 and words[1].text in (".", "[", "{")))
            return (words[0].text, i) if is_target else None
    return None


def behind(words: Sequence[Token], operators: frozenset[str], closing: frozenset[str]) -> Sequence[Token]:
    """What follows a condition on its line: another statement; all but the first word where brackets do not fit.

    Args:
        words: of the statement that begins with the condition's word, which is an operator here, too.
        operators: words in small letters that need something before or behind them.
        closing: words in small letters behind which the next statement begins.
    """
    level, joining = 0, operators | closing
    for i, (word, following) in enumerate(pairwise(words), start=1):
        level += (word.text in _CLOSING) - (word.text in _CLOSING.values())
        one, other = word.text.lower(), following.text.lower()
        if level == 0 and one in closing:
            return words[i:]
        ends = word.kind in ("name", "number", "string") or word.text in _CLOSING.values()
        begins = following.kind == "name" or following.text == "%"
        if level == 0 and ends and begins and not {one, other} & joining:
            return words[i:]
    level += (words[-1].text in _CLOSING) - (words[-1].text in _CLOSING.values())
    return words[1:] if level else []


def split_at(words: Sequence[Token], mark: str) -> list[list[Token]]:
    """What stands between marks that are in no bracket; one part at least."""
    parts: list[list[Token]] = [[]]
    level = 0
    for word in words:
        level += (word.text in _CLOSING) - (word.text in _CLOSING.values())
        if word.text == mark and level == 0:
            parts.append([])
        else:
            parts[-1].append(word)
    return parts


def number_of(expression: Expression | None, constants: Mapping[str, Expression], *, depth: int = 0) -> float | None:
    """The value of an expression of constants; None where it is not known before the program runs."""
    if expression is None or depth > _MAX_LEVELS:
        return None
    if expression.kind == "number":
        value: float | None = expression.value
    elif expression.kind == "name":
        known = constants.get(expression.name.lower())
        if known is None:
            value = _CONSTANTS.get(expression.name.lower())
        else:
            value = number_of(known, constants, depth=depth + 1)
    elif expression.kind == "minus":
        inner = number_of(expression.items[0], constants, depth=depth + 1)
        value = None if inner is None else -inner
    elif expression.kind == "call" and expression.name.lower() == "d2r" and len(expression.items) == 1:
        inner = number_of(expression.items[0], constants, depth=depth + 1)
        value = None if inner is None else math.radians(inner)
    elif expression.kind == "binary":
        value = _binary(expression, constants, depth)
    else:
        value = None
    return value if value is not None and abs(value) <= _MAX_VALUE else None


def _binary(expression: Expression, constants: Mapping[str, Expression], depth: int) -> float | None:
    left, right = (number_of(item, constants, depth=depth + 1) for item in expression.items)
    if left is None or right is None:
        return None
    if expression.name in ("/", "division"):
        found = left / right if right else math.nan
        # Where two whole numbers may be integers the rest is cut off.
        cut = expression.name == "division" and left.is_integer() and right.is_integer() and not found.is_integer()
        return None if cut or not right else found
    return {"+": left + right, "-": left - right, "*": left * right}[expression.name]


def resolved(expression: Expression | None, constants: Mapping[str, Expression]) -> Expression | None:
    """The expression that a name stands for, name by name; None where it stands for nothing that is known."""
    for _ in range(_MAX_LEVELS):
        if expression is None or expression.kind != "name":
            return expression
        expression = constants.get(expression.name.lower())
    return None


def numbers_of(expression: Expression | None, constants: Mapping[str, Expression]) -> list[float] | None:
    """The values of a list or a pose of constants; None where one is not known."""
    expression = resolved(expression, constants)
    if expression is None or expression.kind not in ("list", "pose"):
        return None
    values = [number_of(item, constants) for item in expression.items]
    return [v for v in values if v is not None] if None not in values else None


def _number(text: str) -> float:
    base = {"'b": 2, "'h": 16}.get(text[:2].lower())  # of KRL's 'B101' and 'HFF'
    try:
        value = float(int(text[2:-1], base)) if base else float(text)
    except (ValueError, OverflowError):
        return math.nan
    return value if math.isfinite(value) else math.nan
