"""Readers that may die of a damaged file, in a process of their own with bounded memory and time.

Parquet, Excel and MATLAB files are read by libraries that a damaged or hostile file can crash, or make ask for any
amount of memory. One process serves all files of a program, so that it starts once. It ends with its parent, and is
started anew after it has died.
"""

from __future__ import annotations

import atexit
import contextlib
import json
import os
import select
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

import numpy as np
import numpy.typing as npt

from bumpstop.errors import InputError

# Memory a file may take on top of what the process has: some for any, and so many times the size of the file. Columns
# of a recording that hardly change are compressed to a hundredth.
MIN_MEMORY = 768_000_000
_MEMORY_PER_BYTE = {"parquet": 24.0, "excel": 60.0, "matlab": 16.0}
# Less for a small MATLAB file, whose compression makes a thousand bytes of one at most: a damaged one asks for more.
_MIN_MEMORY_OF_MATLAB, _EXPANDED_PER_BYTE = 256_000_000, 3000
# Time a file may take [s]: some for any, and so much by size.
MIN_SECONDS = 30.0
_SECONDS_PER_BYTE = 2e-6
_START_SECONDS = 60.0
_KIND = {"parquet": "Parquet", "excel": "Excel", "matlab": "a MATLAB file"}
# Threads that read tables, where the environment does not say; those that multiply matrices would only take memory.
_THREADS, _ONE_THREAD = {"POLARS_MAX_THREADS": "2"}, {"OPENBLAS_NUM_THREADS": "1"}
_LENGTH = struct.Struct("<Q")


@dataclass
class _Reader:
    """The process, and what it takes to talk with it."""

    process: subprocess.Popen[bytes] | None = None
    owner: int = 0
    lock: threading.Lock = field(default_factory=threading.Lock)


_READER = _Reader()


def read_guarded(kind: str, path: Path, **request: Any) -> tuple[dict[str, Any], list[npt.NDArray[Any]]]:
    """Let the reader's process read a file.

    Args:
        kind: ``"parquet"``, ``"excel"`` or ``"matlab"``.
        path: of the file.
        request: what of it.

    Returns:
        What the reader says, and its arrays.

    Raises:
        InputError: what the reader raised, or that it died, took too long, or needed too much memory.
    """
    size = path.stat().st_size if path.is_file() else 0
    memory = _memory(kind, size)
    seconds = MIN_SECONDS + _SECONDS_PER_BYTE * size
    asked = {"kind": kind, "path": str(path.absolute()), "shown": str(path), "memory": memory} | request
    with _READER.lock:
        process = _running()
        try:
            _send(process.stdin, asked)
            answer, arrays = _receive(process.stdout, time.monotonic() + seconds)
        except TimeoutError:
            _end(process)
            problem = f"cannot be read as {_KIND[kind]} (it took longer than {seconds:.0f} s)"
            raise InputError(str(path), problem, "the file may be damaged") from None
        except (EOFError, OSError, ValueError):
            status = _end(process)
            how = f"signal {-status}" if status < 0 else f"status {status}"
            problem = (
                f"cannot be read as {_KIND[kind]} (its reader ended with {how}; it may take {memory / 1e9:.2g} GB)"
            )
            raise InputError(str(path), problem, "the file may be damaged, or need more memory") from None
        except BaseException:
            _end(process)  # interrupted in the middle of an answer
            raise
    if "error" in answer:
        raise InputError(*answer["error"])
    return answer, arrays


def _memory(kind: str, size: int) -> int:
    """Bytes that the reader may take for a file of so many."""
    least = min(MIN_MEMORY, _MIN_MEMORY_OF_MATLAB + _EXPANDED_PER_BYTE * size) if kind == "matlab" else MIN_MEMORY
    return int(least + _MEMORY_PER_BYTE[kind] * size)


def _running() -> subprocess.Popen[bytes]:
    """The process, started where there is none of this program."""
    process = _READER.process
    if process is not None and _READER.owner == os.getpid():
        if process.poll() is None:
            return process
        _end(process)
    command = "from bumpstop.recording.formats.reader_process import serve; serve()"
    home = str(Path(__file__).resolve().parents[3])
    places = [home, *(place for place in sys.path if place)]
    process = subprocess.Popen(
        [sys.executable, "-c", command],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        env=_THREADS | os.environ | _ONE_THREAD | {"PYTHONPATH": os.pathsep.join(dict.fromkeys(places))},
        start_new_session=True,  # Ctrl-C is for the parent to answer
    )
    if _READER.process is None:
        atexit.register(_close)
    _READER.process, _READER.owner = process, os.getpid()
    try:
        _receive(process.stdout, time.monotonic() + _START_SECONDS)
    except (EOFError, OSError, TimeoutError):
        status = _end(process)
        raise InputError("recording", f"the process that reads such files did not start (status {status})") from None
    return process


def _close() -> None:
    if _READER.process is not None and _READER.owner == os.getpid():
        _READER.process.kill()  # it waits for work; to wait for it held up the end of every command, and met Ctrl-C
        _end(_READER.process)


def _end(process: subprocess.Popen[bytes]) -> int:
    """End the process; its status, where it had ended by itself."""
    with contextlib.suppress(subprocess.TimeoutExpired):
        process.wait(0.2 if process.poll() is None else None)
    process.kill()
    for pipe in (process.stdin, process.stdout):
        if pipe is not None:
            with contextlib.suppress(OSError):
                pipe.close()
    _READER.process = None
    atexit.unregister(_close)
    return process.wait()


# --- Messages: a length and JSON, then the bytes of the arrays that it names ---------------------------------------


def _send(pipe: IO[bytes] | None, message: dict[str, Any], arrays: Sequence[npt.NDArray[Any]] = ()) -> None:
    assert pipe is not None
    head = message | {"arrays": [[array.dtype.str, list(array.shape)] for array in arrays]}
    text = json.dumps(head).encode()
    pipe.write(_LENGTH.pack(len(text)) + text)
    for array in arrays:
        pipe.write(np.ascontiguousarray(array).reshape(-1).view(np.uint8).data)
    pipe.flush()


def _receive(pipe: IO[bytes] | None, end: float = float("inf")) -> tuple[dict[str, Any], list[npt.NDArray[Any]]]:
    assert pipe is not None
    (length,) = _LENGTH.unpack(_exactly(pipe, _LENGTH.size, end))
    message: dict[str, Any] = json.loads(bytes(_exactly(pipe, length, end)))
    arrays = []
    for dtype, shape in message.pop("arrays", []):
        kind = np.dtype(dtype)
        count = int(np.prod(shape, dtype=np.int64)) * kind.itemsize
        arrays.append(np.frombuffer(_exactly(pipe, count, end), dtype=kind).reshape(shape))
    return message, arrays


def _exactly(pipe: IO[bytes], count: int, end: float) -> bytearray:
    """So many bytes of a pipe, before a time."""
    found = bytearray(count)
    view, at, handle = memoryview(found), 0, pipe.fileno()
    while at < count:
        if end < float("inf"):
            left = end - time.monotonic()
            if left <= 0 or not select.select([handle], [], [], left)[0]:
                raise TimeoutError
        got = os.readv(handle, [view[at : at + (1 << 20)]])
        if not got:
            raise EOFError
        at += got
    return found


# --- In the process ------------------------------------------------------------------------------------------------


def serve() -> None:
    """Answer requests until the parent ends. What libraries print goes nowhere."""
    import resource

    replies, requests = os.fdopen(os.dup(1), "wb"), os.fdopen(os.dup(0), "rb", buffering=0)
    nowhere = os.open(os.devnull, os.O_RDWR)
    for handle in (0, 1):
        os.dup2(nowhere, handle)
    import polars  # noqa: F401  before any limit of memory

    resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
    _send(replies, {})
    while True:
        try:
            asked, _ = _receive(requests)
        except EOFError:
            return
        unlimited = resource.getrlimit(resource.RLIMIT_AS)[1]
        if (space := _address_space()) is not None:
            resource.setrlimit(resource.RLIMIT_AS, (space + asked["memory"], unlimited))
        arrays: list[npt.NDArray[Any]] = []
        try:
            answer, arrays = _answer(asked)
        except InputError as error:
            answer = {"error": [error.field, error.problem, error.valid]}
        except MemoryError:
            problem = f"cannot be read as {_KIND[asked['kind']]} within {asked['memory'] / 1e9:.2g} GB of memory"
            answer = {"error": [asked["shown"], problem, "the file may be damaged, or need more"]}
        except BaseException as error:  # Rust's panics are no Exception
            reason = (str(error).splitlines() or [type(error).__name__])[0][:120]
            problem = f"cannot be read as {_KIND[asked['kind']]} ({reason})"
            answer = {"error": [asked["shown"], problem, "the file may be damaged or cut short"]}
        resource.setrlimit(resource.RLIMIT_AS, (unlimited, unlimited))
        _send(replies, answer, arrays)


def _answer(asked: dict[str, Any]) -> tuple[dict[str, Any], list[npt.NDArray[Any]]]:
    from bumpstop.recording.formats import reader_libraries

    path, shown = Path(asked["path"]), asked["shown"]
    if asked["kind"] == "parquet":
        return reader_libraries.parquet(path, shown, asked.get("columns"), asked.get("rows"))
    if asked["kind"] == "excel":
        return reader_libraries.excel(path, shown, asked["header"])
    return reader_libraries.matlab(path, shown)


def _address_space() -> int | None:
    """Bytes of memory this process has addresses for; None where the system does not say."""
    try:
        return int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return None
