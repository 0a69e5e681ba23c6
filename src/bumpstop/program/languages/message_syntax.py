"""YAML and JSON documents as trees of spans: every value knows its bytes."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Literal

from bumpstop.errors import InputError

_MAX_LEVELS = 20
_JSON = re.compile(
    r"(?P<space>[ \t\r\n]+)|(?P<string>\"(?:[^\"\\\x00-\x1f]|\\.)*\")"
    r"|(?P<scalar>[-+0-9.eE]+|true|false|null|NaN|-?Infinity)|(?P<mark>[\[\]{},:])"
)


@dataclass(frozen=True)
class Value:
    """A value of a document.

    Attributes:
        kind: of it.
        start, end: of its bytes.
        text: of a scalar, without quotes.
        quoted: a scalar that stands in quotes is no number.
        items: of a list; the values of a map.
        keys: of a map, in the order of the items.
    """

    kind: Literal["scalar", "list", "map"]
    start: int
    end: int
    text: str = ""
    quoted: bool = False
    items: tuple[Value, ...] = ()
    keys: tuple[str, ...] = ()

    def get(self, key: str) -> Value | None:
        """The value of a key; None where there is none or more than one, or this is no map."""
        return self.items[self.keys.index(key)] if self.keys.count(key) == 1 else None

    def number(self) -> float | None:
        """Of a scalar; None where it is no finite number, or one to base 8: a whole number behind a zero."""
        if (
            self.kind != "scalar"
            or self.quoted
            or re.fullmatch(r"[+-]?0[0-9]+", self.text)
            or not re.fullmatch(r"[+-]?(?:[0-9]{1,30}\.?[0-9]{0,30}|\.[0-9]{1,30})(?:[eE][+-]?[0-9]{1,3})?", self.text)
        ):
            return None
        value = float(self.text)
        return value if abs(value) < 1e300 else None

    def numbers(self) -> list[float] | None:
        """Of a list of numbers; None where it is none."""
        values = [item.number() for item in self.items] if self.kind == "list" else [None]
        return [v for v in values if v is not None] if None not in values else None

    def scalars(self) -> Iterator[Value]:
        """All leaves in order."""
        if self.kind == "scalar":
            yield self
        for item in self.items:
            yield from item.scalars()


def parse_json(source: bytes, field: str) -> list[Value]:
    """The document of a JSON text.

    Raises:
        InputError: it is none.
    """
    text = source.decode("latin-1")
    tokens: list[tuple[str, int, int]] = []
    at = 0
    for match in _JSON.finditer(text):
        if match.start() != at:
            break
        if match.lastgroup != "space":
            tokens.append((str(match.lastgroup), match.start(), match.end()))
        at = match.end()
    if at != len(text):
        raise InputError(field, f"is not valid JSON (byte {at + 1})")
    parser = _Json(text, tokens, field)
    value = parser.value(0)
    if parser.at != len(tokens):
        parser.refuse()
    return [value]


class _Json:
    def __init__(self, text: str, tokens: list[tuple[str, int, int]], field: str) -> None:
        self._text, self._tokens, self._field, self.at = text, tokens, field, 0

    def refuse(self) -> Any:
        place = self._tokens[self.at][1] if self.at < len(self._tokens) else len(self._text)
        raise InputError(self._field, f"is not valid JSON (byte {place + 1})")

    def _take(self) -> tuple[str, int, int]:
        if self.at >= len(self._tokens):
            self.refuse()
        self.at += 1
        return self._tokens[self.at - 1]

    def _mark(self, token: tuple[str, int, int]) -> str:
        return self._text[token[1]] if token[0] == "mark" else ""

    def value(self, level: int) -> Value:
        """The value that comes next."""
        if level > _MAX_LEVELS:
            self.refuse()
        token = self._take()
        kind, start, end = token
        if kind == "string":
            return Value("scalar", start, end, self._text[start + 1 : end - 1], quoted=True)
        if kind == "scalar":
            return Value("scalar", start, end, self._text[start:end])
        closing = {"[": "]", "{": "}"}.get(self._mark(token))
        if closing is None:
            self.at -= 1
            self.refuse()
        items: list[Value] = []
        keys: list[str] = []
        while True:
            following = self._take()
            if self._mark(following) == closing and not items:
                return Value("list" if closing == "]" else "map", start, following[2])
            self.at -= 1
            if closing == "}":
                key = self._take()
                if key[0] != "string" or self._mark(self._take()) != ":":
                    self.at -= 1
                    self.refuse()
                keys.append(self._text[key[1] + 1 : key[2] - 1])
            items.append(self.value(level + 1))
            after = self._take()
            if self._mark(after) == closing:
                kind_of: Literal["list", "map"] = "list" if closing == "]" else "map"
                return Value(kind_of, start, after[2], items=tuple(items), keys=tuple(keys))
            if self._mark(after) != ",":
                self.at -= 1
                self.refuse()


def parse_yaml(source: bytes, field: str) -> list[Value]:
    """The documents of a YAML text.

    Raises:
        InputError: it is none, or has anchors, which are one value at several places.
    """
    import yaml

    try:
        text = source.decode("utf-8")
    except UnicodeDecodeError as error:
        raise InputError(field, f"is not UTF-8 text (byte {error.start + 1})") from None
    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
    depth = 0
    try:
        for event in yaml.parse(text, loader):
            if isinstance(event, yaml.AliasEvent):
                raise InputError(field, "has anchors (&, *)", "write every value out")
            depth += isinstance(event, yaml.CollectionStartEvent) - isinstance(event, yaml.CollectionEndEvent)
            # Thousands of levels exhaust the stack of the loader in C, which ends the process.
            if depth > _MAX_LEVELS:
                raise InputError(field, f"is nested deeper than {_MAX_LEVELS} levels")
        nodes = [node for node in yaml.compose_all(text, loader) if node is not None]
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        if isinstance(error, InputError):
            raise
        raise InputError(field, f"is not valid YAML ({' '.join(str(error).split())[:200]})") from None
    offsets = _Offsets(text)
    return [_of_yaml(node, offsets) for node in nodes]


class _Offsets:
    """Bytes of letters: the same number in a text that is ASCII."""

    def __init__(self, text: str) -> None:
        # The parser does not count a mark of the byte order.
        self._shift = 3 if text.startswith("\ufeff") else 0
        body = text[1:] if self._shift else text
        self._bytes: list[int] | None = None
        if not body.isascii():
            self._bytes = [0]
            for letter in body:
                self._bytes.append(self._bytes[-1] + len(letter.encode("utf-8")))

    def __call__(self, letter: int) -> int:
        return self._shift + (letter if self._bytes is None else self._bytes[letter])


def _of_yaml(node: Any, offsets: _Offsets) -> Value:
    start, end = offsets(node.start_mark.index), offsets(node.end_mark.index)
    if node.id == "scalar":
        return Value("scalar", start, end, node.value, quoted=bool(node.style))
    if node.id == "sequence":
        return Value("list", start, end, items=tuple(_of_yaml(item, offsets) for item in node.value))
    keys = tuple(str(key.value) if key.id == "scalar" else "" for key, _ in node.value)
    return Value("map", start, end, items=tuple(_of_yaml(item, offsets) for _, item in node.value), keys=keys)
