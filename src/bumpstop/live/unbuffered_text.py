"""Text to a file descriptor as it is written, without Python's buffers."""

from __future__ import annotations

import io
import os
import select
import sys


class UnbufferedText(io.TextIOBase):
    """Writes to a descriptor at once. A thread that is held up in it holds no lock that the end of Python waits for.

    What cannot be written is dropped, and :meth:`check` says so: rich would keep the text and print it later.

    Args:
        descriptor: to write to; it stays open.
        encoding: of the text; letters it lacks are written as escapes.
    """

    def __init__(self, descriptor: int, encoding: str) -> None:
        self._descriptor, self._encoding = descriptor, encoding
        self._failed: OSError | None = None

    @property
    def encoding(self) -> str:  # type: ignore[override]
        """Of the text."""
        return self._encoding

    def fileno(self) -> int:
        """The descriptor."""
        return self._descriptor

    def isatty(self) -> bool:
        """Whether it is a terminal."""
        return os.isatty(self._descriptor)

    def writable(self) -> bool:
        """It is."""
        return True

    def write(self, text: str) -> int:
        """Write all of it, however long that takes, or drop what cannot be written."""
        data = text.encode(self._encoding, "backslashreplace")
        while data:
            try:
                data = data[os.write(self._descriptor, data) :]
            except BlockingIOError:
                select.select([], [self._descriptor], [])
            except BrokenPipeError:
                self._failed = OSError("nobody reads it any more")
                break
            except OSError as error:
                self._failed = error
                break
        return len(text)

    def check(self) -> None:
        """Nothing, if all was written since the last call.

        Raises:
            OSError: nobody reads it any more, or the disk is full.
        """
        failed, self._failed = self._failed, None
        if failed is not None:
            raise failed


def standard_output() -> UnbufferedText | None:
    """Standard output; None: it is closed, or what stands in for it has no descriptor."""
    try:
        return UnbufferedText(sys.stdout.fileno(), sys.stdout.encoding)
    except (AttributeError, OSError, ValueError):
        return None


def warn(text: str) -> None:
    """A warning on standard error, unless it takes nothing now."""
    try:
        descriptor = sys.stderr.fileno()
        if select.select([], [descriptor], [], 0.0)[1]:
            os.write(descriptor, f"warning: {text}\n".encode(errors="backslashreplace"))
    except (AttributeError, OSError, ValueError):
        return
