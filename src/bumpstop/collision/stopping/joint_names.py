"""Joints as columns and cells of stopping tables name them: by number, by word, or by both."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from bumpstop.errors import InputError

TCP = 0
"""Number of the tool centre point, where a column is about it and about no joint."""

_WORDS = {"base": 1, "shoulder": 2, "elbow": 3}
_FIRST_WRIST, _WRISTS = 4, 3
_TOOL = ("tcp", "tool")
_JOINT = ("joint", "axis", "j", "a", "jt")


@dataclass(frozen=True)
class JointName:
    """Which joint a name means.

    Attributes:
        number: as written; None: none.
        word: joint from 1 that base, shoulder, elbow or wrist 1 to 3 say, or :data:`TCP`; None: no such word.
        rest: the words that are about no joint.
    """

    number: int | None
    word: int | None
    rest: tuple[str, ...]

    @classmethod
    def of(cls, words: list[str], field: str) -> JointName:
        """Read lower-case words; ``field`` is what errors say.

        Raises:
            InputError: two joints are named, or a wrist joint without its number.
        """
        word, words = _named(words, field)
        numbered = _numbered(words)
        explicit = [(place, number) for place, number, told in numbered if told]
        if len({number for _, number in explicit}) > 1:
            raise InputError(field, "names two joints", "wanted one")
        place, number = next(iter(explicit or [(at, each) for at, each, _ in numbered]), (len(words), None))
        tool = next((at for at, each in enumerate(words) if each in _TOOL), len(words))
        if word is None and tool < place and not explicit:
            return cls(None, TCP, (*words[:tool], *words[tool + 1 :]))
        kept = () if number is None else tuple(p for p in [words[place].rstrip("0123456789")] if p and p not in _JOINT)
        return cls(number, word, (*words[:place], *kept, *words[place + 1 :]))

    @property
    def first(self) -> int | None:
        """The number that the first joint has in this counting; None without a word beside a number."""
        return None if self.number is None or not self.word else 1 + self.number - self.word

    def joint(self, first: int, field: str) -> int | None:
        """The joint, from 1, of a file whose first joint has the number ``first``; the word decides.

        Raises:
            InputError: the number is 0 in a file that counts from 1.
        """
        if self.word is not None or self.number is None:
            return self.word
        if self.number < first:
            raise InputError(field, "counts joints from 0", "wanted numbers from 1, or the joints' names beside them")
        return self.number + 1 - first


NO_JOINT = JointName(None, None, ())
"""Of a name that is about no joint."""


def first_number(named: Iterable[tuple[str, JointName]]) -> int:
    """The number of the first joint in a file, 1 or 0, by the words that stand beside its numbers.

    Args:
        named: what errors call each name, and what it says.

    Raises:
        InputError: a word and its number are different joints in either counting, or two names count differently.
    """
    found: dict[int, str] = {}
    for field, name in named:
        if name.first in (0, 1):
            found.setdefault(name.first, field)
        elif name.first is not None:
            problem = f"says joint {name.number} and a word for joint {name.word}"
            raise InputError(field, problem, "leave one of the two out")
    if len(found) > 1:
        problem = f"counts joints from 0 by their words, and {found[1]} from 1"
        raise InputError(found[0], problem, "wanted one way of counting in all of the file")
    return next(iter(found), 1)


def _named(words: list[str], field: str) -> tuple[int | None, list[str]]:
    """The joint that a word alone says, and the other words."""
    for place, word in enumerate(words):
        if word in _WORDS:
            return _WORDS[word], words[:place] + words[place + 1 :]
        wrist = re.fullmatch(r"wrist(\d*)", word)
        if wrist is None:
            continue
        # Also "wrist joint 2".
        end = next((at for at in range(place + 1, len(words)) if words[at] not in ("joint", "axis")), len(words))
        said = wrist[1] or (words[end] if end < len(words) else "")
        rest = words[:place] + words[place + 1 if wrist[1] else end + 1 :]
        if re.fullmatch(f"[1-{_WRISTS}]", said):
            return _FIRST_WRIST - 1 + int(said), rest
        if _numbered(words):
            raise InputError(
                field, "names a wrist joint, and not which", f"wanted wrist 1 to {_WRISTS}, or the joint's number alone"
            )
    return None, words


def _numbered(words: list[str]) -> list[tuple[int, int, bool]]:
    """Places and values of numbers that may be a joint's, and whether a word for joints stands before them."""
    found = []
    for place, word in enumerate(words):
        numbered = re.fullmatch(r"(joint|axis|jt?|a|t|d|s|time|distance|angle)?(\d{1,6})", word)
        if numbered is None:
            continue
        before = numbered[1] or (words[place - 1] if place else "")
        found.append((place, int(numbered[2]), before in _JOINT))
    return found
