"""Bags that end in the middle: how many messages could still be read."""

from __future__ import annotations

import struct
from pathlib import Path

from bumpstop.errors import InputError

_MAGIC = b"\x89MCAP0\r\n"
_MESSAGE, _CHUNK = 0x05, 0x06
_TABLE_LEAF = 0x0D
_SMALLEST_PAGE = 512  # bytes, of sqlite's file format
_COLUMNS = 4
_FIRST_BLOB = 12  # type of an empty one; text has odd numbers


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
    """Rows of the table ``messages`` on the pages that are left: what leads to them may be among the lost ones."""
    data = path.read_bytes()
    if not data.startswith(b"SQLite format 3\0"):
        return 0
    size = int.from_bytes(data[16:18], "big")
    size = 65536 if size == 1 else size
    if size < _SMALLEST_PAGE:  # a damaged header
        return 0
    return sum(_rows(data[start : start + size]) for start in range(size, len(data) - size + 1, size))


def _rows(page: bytes) -> int:
    """Messages on a page of sqlite's file format: rows of id, topic, time and body."""
    if page[0] != _TABLE_LEAF:
        return 0
    count = 0
    for i in range(min(int.from_bytes(page[3:5], "big"), len(page) // 4)):
        place = int.from_bytes(page[8 + 2 * i : 10 + 2 * i], "big")
        for _ in range(2):  # length of the row, and its number
            _, place = _varint(page, place)
        length, inside = _varint(page, place)
        kinds: list[int] = []
        # No row of a message has more: a damaged length would lead through the whole page, for each of its rows.
        while inside < min(place + length, len(page)) and len(kinds) <= _COLUMNS:
            kind, inside = _varint(page, inside)
            kinds.append(kind)
        count += len(kinds) == _COLUMNS and kinds[3] >= _FIRST_BLOB and kinds[3] % 2 == 0
    return count


def _varint(page: bytes, place: int) -> tuple[int, int]:
    """A number of up to nine bytes, and where the next begins."""
    value = 0
    for byte in page[place : place + 9]:
        place += 1
        value = value << 7 | byte & 0x7F
        if byte < 0x80:
            break
    return value, place


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
