"""The errors bumpstop raises on purpose, and the near matches they offer."""

from __future__ import annotations

import difflib
import errno
import os
import re
from collections.abc import Iterable

# A list longer than this helps nobody.
_MAX_LISTED = 40
# Of a longer key or word only the ends are shown. Paths, which may be long, have separators.
_MAX_LETTERS = 100
_SHOWN_OF_EACH_END = 40
# Of a longer message only the ends are shown: what was written may be a line of a million words.
_MAX_MESSAGE, _SHOWN_OF_MESSAGE = 1500, 600


class BumpstopError(Exception):
    """Root of every error bumpstop raises on purpose."""


class InputError(BumpstopError, ValueError):
    """Something the user gave cannot be used; the message says what, and what would be valid.

    Attributes:
        field: dotted name of what is wrong (``motion.velocity_mm_s``), or a path.
        problem: the value and why it cannot be used.
        valid: what would have been accepted; may be empty when the problem says it all.
    """

    def __init__(self, field: str, problem: str, valid: str = "") -> None:
        self.field = field
        self.problem = problem
        self.valid = valid
        super().__init__(_readable(f"{field}: {problem}" + (f"; {valid}" if valid else "")))

    def __reduce__(self) -> tuple[type[InputError], tuple[str, str, str]]:
        """Pickled by its parts: a pool of processes that cannot read a refusal breaks down."""
        return type(self), (self.field, self.problem, self.valid)


def _readable(message: str) -> str:
    """A message whose words a person can read: what was written may be a key of a million letters."""
    if len(message) <= _MAX_LETTERS:
        return message

    def cut(word: re.Match[str]) -> str:
        text = word[0]
        return f"{text[:_SHOWN_OF_EACH_END]}...{text[-_SHOWN_OF_EACH_END:]} ({len(text)} letters)"

    message = re.sub(rf"[^\s/\\]{{{_MAX_LETTERS + 1},}}", cut, message)
    if len(message) <= _MAX_MESSAGE:
        return message
    return f"{message[:_SHOWN_OF_MESSAGE]} ... {message[-_SHOWN_OF_MESSAGE:]} ({len(message)} letters)"


def near_matches(name: str, known: Iterable[str]) -> str:
    """Say which known names are close to ``name``, and list them all when none is.

    Args:
        name: what the user wrote.
        known: the names that exist.

    Returns:
        ``"did you mean 'a' or 'b'?"``, or ``"valid: a, b, c"``; a very long list is cut.
    """
    name = str(name)[: 4 * _MAX_LETTERS]
    names = list(dict.fromkeys(known))  # a link may be the tip as well
    spelling = {known_name.casefold(): known_name for known_name in names}
    wanted = name.casefold()
    close = difflib.get_close_matches(wanted, spelling, n=3, cutoff=0.6)
    if not close and len(wanted) >= 3:
        close = [candidate for candidate in spelling if wanted in candidate][:3]
    close = [spelling[match] for match in close]
    if close:
        return "did you mean " + " or ".join(repr(match) for match in close) + "?"
    more = len(names) - _MAX_LISTED
    return "valid: " + ", ".join(names[:_MAX_LISTED]) + (f" and {more} more" if more > 0 else "")


def where_else(error: OSError) -> str:
    """What to do where a folder cannot be written: on a full disk no other folder helps."""
    full = any(os.strerror(code) in str(error) for code in (errno.ENOSPC, errno.EDQUOT))
    return "make room on its disk, or give a folder on another one" if full else "give another folder"
