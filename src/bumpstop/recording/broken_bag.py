"""Bags that end in the middle: how many messages could still be read."""

from __future__ import annotations

import sqlite3
import struct
from pathlib import Path

from bumpstop.errors import InputError

_MAGIC = b"\x89MCAP0\r\n"
_MESSAGE, _CHUNK = 0x05, 0x06


def describe_damage(path: Path, error: Exception) -> InputError:
    """The error for a bag that its reader gave up on."""
    reason = (str(error).splitlines() or [type(error).__name__])[0][:160]
    files = sorted([*path.glob("*.db3"), *path.glob("*.mcap")]) if path.is_dir() else [path]
    readable = 0
    for file in files:
        if not file.is_file() or file.stat().st_size == 0:
            continue
        readable += _in_mcap(file) if file.suffix == ".mcap" else _in_sqlite(file)
    if path.is_file() and path.stat().st_size == 0:
        return InputError(str(path), "is empty", "wanted a ROS 2 bag")
    problem = f"the bag is damaged or ends in the middle ({reason}); {readable} messages are readable"
    return InputError(str(path), problem, "record it again, or mend it with ros2 bag reindex or mcap recover")


def _in_sqlite(path: Path) -> int:
    count = 0
    try:
        with sqlite3.connect(f"file:{path}?mode=ro&immutable=1", uri=True) as connection:
            # Else sqlite refuses a file shorter than its header says before it has read anything.
            connection.execute("PRAGMA writable_schema = ON")
            for _ in connection.execute("SELECT data FROM messages"):
                count += 1
    except sqlite3.Error:
        pass  # what came before it counts
    return count


def _in_mcap(path: Path) -> int:
    data = path.read_bytes()
    return _messages(data, len(_MAGIC)) if data.startswith(_MAGIC) else 0


def _messages(data: bytes, place: int) -> int:
    """Complete messages among the records from ``place`` on, those in complete chunks included."""
    count = 0
    while place + 9 <= len(data):
        kind, size = struct.unpack_from("<BQ", data, place)
        place += 9
        if place + size > len(data):
            break
        if kind == _MESSAGE:
            count += 1
        elif kind == _CHUNK:
            count += _messages(_unpacked(data[place : place + size]), 0)
        place += size
    return count


def _unpacked(chunk: bytes) -> bytes:
    from rosbags.rosbag2.storage_mcap import DECOMPRESSORS

    try:
        (size,) = struct.unpack_from("<Q", chunk, 16)
        (length,) = struct.unpack_from("<I", chunk, 28)
        (stored,) = struct.unpack_from("<Q", chunk, 32 + length)
        start = 40 + length
        return DECOMPRESSORS[chunk[32 : 32 + length].decode()](chunk[start : start + stored], size)
    except Exception:  # of any decompressor: nothing of this chunk can be read
        return b""
