"""Files that appear whole or not at all: written under another name beside their place, then moved there."""

from __future__ import annotations

import contextlib
import errno
import os
import re
import stat
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, TYPE_CHECKING

if TYPE_CHECKING:
    import polars as pl


@contextmanager
def replacing(path: str | os.PathLike[str], *, durable: bool = False) -> Iterator[Path]:
    """Give a path to write to; at the end of the block that file takes the place of ``path``, in one step.

    An error inside the block leaves ``path`` as it was and nothing beside it. What is no ordinary file, such as
    ``/dev/stdout``, is given as it is.

    Args:
        path: of the file; a symbolic link is followed.
        durable: wait until the content is on the disk before it gets its name.

    Raises:
        OSError: it cannot be written, or is there and may not be written.
    """
    place = Path(os.path.realpath(path))
    mode = None
    with contextlib.suppress(FileNotFoundError):
        mode = place.stat().st_mode
    if mode is not None and not stat.S_ISREG(mode):
        yield place
        return
    # A folder lets a file be replaced that may not be written itself.
    if mode is not None and not os.access(place, os.W_OK):
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(path))
    # Short, as the name may already be as long as a file system allows.
    waiting = place.with_name(f".{place.name[:40]}.{os.urandom(6).hex()}")
    try:
        yield waiting
        if mode is not None:
            waiting.chmod(stat.S_IMODE(mode))
        if durable:
            _wait_for_disk(waiting)
        waiting.replace(place)
        if durable:
            _wait_for_disk(place.parent)
    except OSError as error:
        # In the words of the file that was asked for. Of some writers everything is in the message.
        said = (error.strerror or str(error)).replace(str(waiting), str(place))
        raise OSError(error.errno or errno.EIO, said, str(path)) from None
    finally:
        with contextlib.suppress(OSError):
            waiting.unlink(missing_ok=True)


def write_bytes(path: str | os.PathLike[str], content: bytes, *, durable: bool = False) -> None:
    """Write a file whole or not at all; arguments and errors as :func:`replacing`."""
    with replacing(path, durable=durable) as waiting:
        waiting.write_bytes(content)


def write_parquet(
    path: str | os.PathLike[str], rows: pl.DataFrame, metadata: dict[str, str] | None = None, *, durable: bool = False
) -> None:
    """Write a Parquet file whole or not at all; OSError where it cannot be written."""
    with _opened(path, durable=durable) as file:
        rows.write_parquet(file, metadata=metadata)


def write_csv(path: str | os.PathLike[str], rows: pl.DataFrame) -> None:
    """Write a CSV file whole or not at all; OSError where it cannot be written."""
    with _opened(path) as file:
        rows.write_csv(file)


@contextmanager
def _opened(path: str | os.PathLike[str], *, durable: bool = False) -> Iterator[IO[bytes]]:
    """Give a file that polars writes to: it takes no path that is not UTF-8, and has errors of its own kinds."""
    with replacing(path, durable=durable) as waiting, waiting.open("wb") as file:
        try:
            yield file
        except Exception as error:
            number = re.search(r"\(os error (\d+)\)", str(error))
            if number is None:
                raise
            raise OSError(int(number[1]), os.strerror(int(number[1]))) from None


def _wait_for_disk(path: Path) -> None:
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
