"""Long work of the kernels, and somebody who does not want it any more."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING

from bumpstop import _native

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator


@contextmanager
def asked_while_working(question: Callable[[], None]) -> Iterator[None]:
    """Let the kernels that this thread calls ask, some twenty times a second, whether their work is still wanted.

    Args:
        question: what it raises ends the work, and is raised where the work was asked for.
    """
    _native.ask_while_working(question)
    try:
        yield
    finally:
        _native.ask_while_working(None)
