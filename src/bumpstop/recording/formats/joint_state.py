"""``sensor_msgs/msg/JointState`` as ROS 2 sends it (CDR): read and written for many messages at once."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray

NO_TIME = np.iinfo(np.int64).min
_HEADER = 4  # bytes before the first that counts for alignment


@dataclass(frozen=True)
class Layout:
    """Where things stand in a message.

    Attributes:
        little: byte order.
        names: of the joints.
        counts: (offset of the number, number) of names and of position, velocity, effort.
        starts: offset of the first position, velocity and effort.
        fixed: (start, end) of the bytes that every message of this layout shares.
    """

    little: bool
    names: tuple[str, ...]
    counts: tuple[int, int, int]
    starts: tuple[int, int, int]
    fixed: tuple[tuple[int, int], ...]


def layout(message: bytes) -> Layout:
    """Take one message apart.

    Raises:
        ValueError: it ends early or is none.
    """
    try:
        return _layout(message)
    except struct.error:
        raise ValueError("the message ends early") from None


def _layout(message: bytes) -> Layout:
    if len(message) < _HEADER + 12 or message[0] != 0 or message[1] not in (0, 1):
        raise ValueError("this is no CDR message")
    little = message[1] == 1
    number = struct.Struct("<I" if little else ">I")
    place = _HEADER + 8
    fixed = [(0, 2)]

    def count() -> int:
        nonlocal place
        place += -(place - _HEADER) % 4
        (value,) = number.unpack_from(message, place)
        fixed.append((place, place + 4))
        place += 4
        if value > len(message):
            raise ValueError("a length in the message is longer than the message")
        return int(value)

    def text() -> str:
        nonlocal place
        length = count()
        fixed.append((place, place + length))
        place += length
        return message[place - length : place].rstrip(b"\0").decode("utf-8", errors="replace")

    text()  # frame
    names = tuple(text() for _ in range(count()))
    counts, starts = [], []
    for _ in range(3):
        length = count()
        if length:
            place += -(place - _HEADER) % 8
        counts.append(length)
        starts.append(place)
        place += 8 * length
    if place > len(message):
        raise ValueError("the message ends early")
    return Layout(little, names, (counts[0], counts[1], counts[2]), (starts[0], starts[1], starts[2]), tuple(fixed))


def alike(rows: npt.NDArray[np.uint8], known: Layout) -> npt.NDArray[np.bool_]:
    """Which of (N, length) messages have the layout of the first; padding may hold anything."""
    places = np.concatenate([np.arange(start, end) for start, end in known.fixed])
    same: npt.NDArray[np.bool_] = (rows[:, places] == rows[0, places]).all(axis=1)
    return same


def stamps(rows: npt.NDArray[np.uint8], known: Layout) -> npt.NDArray[np.int64]:
    """(N,) times in the headers of (N, length) messages [ns]; ``NO_TIME``: the nanoseconds are a second or more."""
    order = "<" if known.little else ">"
    seconds = np.ascontiguousarray(rows[:, _HEADER : _HEADER + 4]).view(f"{order}i4")[:, 0].astype(np.int64)
    nanoseconds = np.ascontiguousarray(rows[:, _HEADER + 4 : _HEADER + 8]).view(f"{order}u4")[:, 0].astype(np.int64)
    return np.where(nanoseconds < 1_000_000_000, seconds * 1_000_000_000 + nanoseconds, NO_TIME)


def numbers(rows: npt.NDArray[np.uint8], known: Layout, part: int) -> FloatArray:
    """(N, count) positions, velocities or efforts (``part`` 0, 1, 2) of (N, length) messages."""
    start, count = known.starts[part], known.counts[part]
    block = np.ascontiguousarray(rows[:, start : start + 8 * count])
    if count == 0:
        return np.zeros((rows.shape[0], 0))
    return block.view("<f8" if known.little else ">f8").astype(np.float64)


def messages(
    template: bytes, time: npt.NDArray[np.int64], parts: tuple[FloatArray | None, FloatArray | None, FloatArray | None]
) -> npt.NDArray[np.uint8]:
    """(N, length) messages like ``template`` with other times [ns] and numbers."""
    known = layout(template)
    rows = np.tile(np.frombuffer(template, dtype=np.uint8), (time.size, 1))
    stamp = np.stack([time // 1_000_000_000, time % 1_000_000_000], axis=1).astype("<i4" if known.little else ">i4")
    rows[:, _HEADER : _HEADER + 8] = stamp.view(np.uint8)
    for start, count, part in zip(known.starts, known.counts, parts, strict=True):
        if part is not None and count:
            values = np.ascontiguousarray(part, dtype="<f8" if known.little else ">f8")
            rows[:, start : start + 8 * count] = values.view(np.uint8)
    return rows
