"""Settings of RAPID that hold for moves before which they do not stand."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from bumpstop.program.languages.expression import Expression, number_of, read_expression, split_at
from bumpstop.program.languages.syntax import Statement, SyntaxTree, Token

HANDLERS = frozenset(("error", "undo", "backward"))
_FUNCTIONS = ("proc", "func", "trap")


def plain(statement: Statement) -> list[Token]:
    """The words of a statement without its semicolon."""
    words = statement.words
    return words[:-1] if words and words[-1].text == ";" else words


def head_of(words: Sequence[Token]) -> Sequence[Token] | None:
    """The head of a procedure, a function or a trap, without the word that makes it local."""
    if len(words) > 1 and words[0].text.lower() in ("local", "task"):
        words = words[1:]
    return words if len(words) > 1 and words[0].text.lower() in _FUNCTIONS else None


def displaces(words: Sequence[Token]) -> bool:
    """Whether targets may be others after a statement, or the tool turn otherwise on its way to them."""
    first = words[0].text.lower()
    return first in ("pdispset", "pdispon") or (first == "singarea" and words[-1].text.lower() != "off")


def displaced_by(tree: SyntaxTree) -> str:
    """What may displace targets where the program does not lead from it to them; empty where nothing does."""
    every = [(statement.line, words) for statement in tree.statements if (words := plain(statement))]
    firsts = {(head_of(words) or words)[0].text.lower() for _, words in every}
    goes_back = bool(firsts & {*HANDLERS, "trap"})
    for line, words in every:
        # SingArea outlasts PDispOff.
        outlasts = words[0].text.lower() == "singarea" and "pdispoff" in firsts
        if displaces(words) and (goes_back or outlasts):
            return f"{words[0].text} of line {line} may hold for it, too"
    return ""


def raised_by(tree: SyntaxTree, constants: Mapping[str, Expression]) -> str:
    """What may make every move faster than it is written, and times shorter; empty where nothing does."""
    for statement in tree.statements:
        words = plain(statement)
        for i, word in enumerate(words):
            if word.text.lower() == "velset":
                override = number_of(read_expression(split_at(words[i + 1 :], ",")[0]), constants)
                if override is None or override > 100:
                    return f"VelSet of line {statement.line} may set more than the speed that is written"
    return ""
