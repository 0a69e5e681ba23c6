"""Fields of the Real-Time Data Exchange of Universal Robots: their types, and recipes of several of them."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

# Every type of a field, by its name in the protocol, as ``struct`` has it. Numbers are big-endian.
FIELD_TYPES = {
    "BOOL": "?",
    "UINT8": "B",
    "UINT32": "I",
    "UINT64": "Q",
    "INT32": "i",
    "DOUBLE": "d",
    "VECTOR3D": "3d",
    "VECTOR6D": "6d",
    "VECTOR6INT32": "6i",
    "VECTOR6UINT32": "6I",
}
# What a controller answers in place of a type.
NOT_FOUND, IN_USE = "NOT_FOUND", "IN_USE"

Value = bool | int | float | tuple[int, ...] | tuple[float, ...]


class ProtocolError(Exception):
    """Bytes that are no message of the protocol; the text says why."""


@dataclass(frozen=True)
class Recipe:
    """Fields that travel together in one data package.

    Attributes:
        number: by which packages name the recipe; 0: the controller rejected it.
        names: of the fields, in their order.
        types: of the fields, of :data:`FIELD_TYPES`.
    """

    number: int
    names: tuple[str, ...]
    types: tuple[str, ...]

    def __post_init__(self) -> None:
        if len(self.names) != len(self.types):
            raise ProtocolError(f"a recipe of {len(self.names)} fields has {len(self.types)} types")
        for name, kind in zip(self.names, self.types, strict=True):
            if kind not in FIELD_TYPES:
                raise ProtocolError(f"field {name} has the unknown type {kind[:40]!r}")

    @cached_property
    def _layout(self) -> struct.Struct:
        return struct.Struct(">" + "".join(FIELD_TYPES[kind] for kind in self.types))

    @cached_property
    def _widths(self) -> tuple[int, ...]:
        """How many numbers each field has."""
        return tuple(int(FIELD_TYPES[kind][:-1] or 1) for kind in self.types)

    @property
    def size(self) -> int:
        """Bytes of the values."""
        return self._layout.size

    def pack(self, values: Sequence[Value]) -> bytes:
        """The values of all fields as bytes.

        Raises:
            ProtocolError: another number of values, or one that its type cannot hold.
        """
        flat: list[bool | int | float] = []
        for value in values:
            flat += value if isinstance(value, tuple) else (value,)
        try:
            return self._layout.pack(*flat)
        except struct.error as error:
            raise ProtocolError(f"values do not fit {', '.join(self.types)}: {error}") from None

    def unpack(self, data: bytes) -> dict[str, Value]:
        """The values of all fields by name.

        Raises:
            ProtocolError: the data have another size.
        """
        if len(data) != self.size:
            raise ProtocolError(f"the values have {len(data)} bytes, recipe {self.number} has {self.size}")
        flat = self._layout.unpack(data)
        found: dict[str, Value] = {}
        at = 0
        for name, width in zip(self.names, self._widths, strict=True):
            found[name] = flat[at] if width == 1 else flat[at : at + width]
            at += width
        return found
