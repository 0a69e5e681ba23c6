"""Syntax trees without loss: spans over the bytes of a program, and edits of them."""

from __future__ import annotations

import re
from codecs import BOM_UTF8
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

# What neither acts nor separates.
TRIVIA = ("space", "comment", "newline", "continuation")


@dataclass(frozen=True, slots=True)
class Token:
    """A word of a program.

    Attributes:
        kind: name of the lexer's group that matched; ``"other"`` for what no group knows.
        start, end: of the bytes.
        text: the bytes as Latin-1, one letter a byte, whatever the file's encoding.
    """

    kind: str
    start: int
    end: int
    text: str


@dataclass(frozen=True, slots=True)
class Statement:
    """One statement: its tokens in order, with space, comments and line ends.

    Attributes:
        line: of its first word, from 1.
    """

    tokens: tuple[Token, ...]
    line: int

    @property
    def words(self) -> list[Token]:
        """The tokens that mean something."""
        return [token for token in self.tokens if token.kind not in TRIVIA]

    @property
    def text(self) -> str:
        """Its words as they stand, without space around them."""
        words = self.words
        if not words:
            return ""
        return "".join(t.text for t in self.tokens if words[0].start <= t.start < words[-1].end)


@dataclass(frozen=True)
class SyntaxTree:
    """A program as statements of tokens; the tokens of all statements are its bytes, in order.

    Attributes:
        source: the bytes.
    """

    source: bytes
    statements: tuple[Statement, ...]

    def tokens(self) -> Iterator[Token]:
        """All leaves in order."""
        for statement in self.statements:
            yield from statement.tokens

    def text(self) -> bytes:
        """The program printed from its leaves."""
        return b"".join(token.text.encode("latin-1") for token in self.tokens())

    @cached_property
    def _line_ends(self) -> list[int]:
        return [match.start() for match in re.finditer(rb"\n", self.source)]

    def line_start(self, offset: int) -> int:
        """Offset of the first byte of the line that holds an offset."""
        return self.source.rfind(b"\n", 0, offset) + 1


@dataclass(frozen=True, slots=True)
class Edit:
    """New bytes for a span; an empty span is a place between two bytes.

    Attributes:
        start, end: of the span.
        text: what stands there afterwards.
    """

    start: int
    end: int
    text: str


def edited(source: bytes, edits: Iterable[Edit]) -> bytes:
    """The source with the spans of the edits replaced and every other byte as it was.

    Raises:
        ValueError: two edits overlap, or one is beyond the source.
    """
    parts, at = [], 0
    for edit in sorted(set(edits), key=lambda e: (e.start, e.end)):
        if not at <= edit.start <= edit.end <= len(source):
            raise ValueError(f"edits overlap or lie outside at byte {edit.start}")
        parts += [source[at : edit.start], edit.text.encode("latin-1")]
        at = edit.end
    return b"".join([*parts, source[at:]])


def tokenize(source: bytes, pattern: re.Pattern[str]) -> list[Token]:
    """Cut bytes into tokens, none left over.

    Args:
        source: of the program.
        pattern: with a named group for every kind of token; each match has one letter at least.
    """
    text, found, at = source.decode("latin-1"), list[Token](), 0
    if source.startswith(BOM_UTF8):
        at = len(BOM_UTF8)  # editors of Windows write it
        found.append(Token("space", 0, at, text[:at]))
    for match in pattern.finditer(text, at):
        if match.start() > at:
            found.append(Token("other", at, match.start(), text[at : match.start()]))
        if match.end() > match.start():
            found.append(Token(match.lastgroup or "other", match.start(), match.end(), match[0]))
            at = match.end()
    if at < len(text):
        found.append(Token("other", at, len(text), text[at:]))
    return found


def statement_of(tokens: Sequence[Token], line: int) -> Statement:
    """A statement whose line is that of its first word, where it begins on a given line."""
    for token in tokens:
        if token.kind not in TRIVIA:
            break
        line += token.text.count("\n")
    return Statement(tuple(tokens), line)


def parse_lines(source: bytes, pattern: re.Pattern[str]) -> SyntaxTree:
    """The syntax tree of a language in which a line is a statement; of any bytes."""
    statements: list[Statement] = []
    begin, line = 0, 1
    tokens = tokenize(source, pattern)
    for i, token in enumerate(tokens):
        if token.kind == "newline":
            statements.append(statement_of(tokens[begin : i + 1], line))
            begin, line = i + 1, line + 1
    if begin < len(tokens):
        statements.append(statement_of(tokens[begin:], line))
    return SyntaxTree(source, tuple(statements))
