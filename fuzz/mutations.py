"""Damage by chance: what a disk, a transfer, an editor or an adversary may do to a file."""

from __future__ import annotations

import random
from collections.abc import Callable

_NUMBERS = (
    b"0", b"-1", b"1e308", b"-1e-320", b"nan", b"inf", b"9" * 400, b"18446744073709551616", b"0x7fffffff", b"1_000",
    b"",
)  # fmt: skip
_WORDS = (
    b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"[", b"]" * 50, b"{" * 50, b"[" * 2000, b'"', b"'''", b"\n" * 30, b"\r",
    b";" * 100,
    b"," * 5000, b"a" * 100_000, b"../../../etc/passwd", b"/dev/zero", b"&a;", b"&a;" * 1000, b"<x>" * 500, b"%s%n",
    b"\\u0000",
    b"!!python/object/apply:os.system ['touch pwned']", b"*n", b"a.b.c.d.e.f.g", b"= = =", b"\xf0\x9f\xa4\x96",
)  # fmt: skip


def mutated(content: bytes, others: list[bytes], rng: random.Random) -> bytes:
    """The content with one to eight changes.

    Args:
        content: of a file.
        others: of other files, to splice from.
        rng: source of chance.
    """
    data = bytearray(content)
    for _ in range(rng.choice((1, 1, 1, 2, 3, 8))):
        rng.choice(_CHANGES)(data, others, rng)
    return bytes(data[:2_000_000])


def _place(data: bytearray, rng: random.Random) -> int:
    return rng.randrange(len(data) + 1)


def _flip(data: bytearray, others: list[bytes], rng: random.Random) -> None:
    if data:
        data[rng.randrange(len(data))] ^= 1 << rng.randrange(8)


def _set(data: bytearray, others: list[bytes], rng: random.Random) -> None:
    if data:
        data[rng.randrange(len(data))] = rng.choice((0, 255, 127, 128, rng.randrange(256)))


def _set_number(data: bytearray, others: list[bytes], rng: random.Random) -> None:
    """Two, four or eight bytes, as lengths and offsets of binary formats."""
    size = rng.choice((2, 4, 8))
    if len(data) > size:
        at = rng.randrange(len(data) - size)
        value = rng.choice(
            (0, 1, 2 ** (8 * size) - 1, 2 ** (8 * size - 1), 2 ** (8 * size - 1) - 1, rng.randrange(1 << 16))
        )
        data[at : at + size] = value.to_bytes(size, rng.choice(("little", "big")))


def _cut(data: bytearray, others: list[bytes], rng: random.Random) -> None:
    first, last = sorted((_place(data, rng), _place(data, rng)))
    if rng.random() < 0.3:
        last = len(data)
    del data[first:last]


def _repeat(data: bytearray, others: list[bytes], rng: random.Random) -> None:
    first = _place(data, rng)
    piece = bytes(data[first : first + rng.choice((1, 10, 100, 1000))])
    data[first:first] = piece * rng.choice((1, 2, 10, 100))


def _insert(data: bytearray, others: list[bytes], rng: random.Random) -> None:
    at = _place(data, rng)
    data[at:at] = rng.choice(_WORDS)


def _replace_number(data: bytearray, others: list[bytes], rng: random.Random) -> None:
    """A number that is written out becomes another."""
    start = _place(data, rng)
    while start < len(data) and not 48 <= data[start] <= 57:
        start += 1
    end = start
    while end < len(data) and data[end] in b"0123456789.eE+-":
        end += 1
    data[start:end] = rng.choice(_NUMBERS)


def _replace_line(data: bytearray, others: list[bytes], rng: random.Random) -> None:
    """A line is moved, doubled, or comes from another file."""
    lines = bytes(data).split(b"\n")
    source = rng.choice(others).split(b"\n") if others and rng.random() < 0.3 else lines
    lines[rng.randrange(len(lines))] = rng.choice(source)
    data[:] = b"\n".join(lines)


def _splice(data: bytearray, others: list[bytes], rng: random.Random) -> None:
    if others:
        other = rng.choice(others)
        data[_place(data, rng) :] = other[rng.randrange(len(other) + 1) :]


_CHANGES: tuple[Callable[[bytearray, list[bytes], random.Random], None], ...] = (
    _flip, _set, _set_number, _cut, _repeat, _insert, _replace_number, _replace_line, _splice,
)  # fmt: skip
