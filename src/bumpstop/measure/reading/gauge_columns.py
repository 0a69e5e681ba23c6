"""Columns of gauge recordings: which holds time, force and pressure, and in what unit."""

from __future__ import annotations

import re
import unicodedata
from dataclasses import dataclass
from typing import Literal

from bumpstop.errors import InputError, near_matches

Quantity = Literal["time", "force", "pressure"]

# What one unit is in s, N and N/cm2.
UNITS: dict[Quantity, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6},
    "force": {"N": 1.0, "kN": 1e3, "daN": 10.0, "lbf": 4.4482216152605, "kgf": 9.80665},
    "pressure": {"N/cm2": 1.0, "MPa": 100.0, "kPa": 0.1, "bar": 10.0, "psi": 0.6894757293168},
}
# As they are written otherwise.
_SPELLINGS = {
    "sec": "s",
    "seconds": "s",
    "second": "s",
    "sek": "s",
    "msec": "ms",
    "milliseconds": "ms",
    "µs": "us",
    "μs": "us",
    "newton": "N",
    "newtons": "N",
    "lb": "lbf",
    "lbs": "lbf",
    "kp": "kgf",
    "n/cm²": "N/cm2",
    "n/cm^2": "N/cm2",
    "ncm2": "N/cm2",
    "n_cm2": "N/cm2",
    "n/mm2": "MPa",
    "n/mm²": "MPa",
}
# Words that names begin with, in the languages of the usual devices.
_WORDS: dict[Quantity, tuple[str, ...]] = {
    "time": ("time", "zeit", "temps", "tiempo", "tempo", "elapsed", "timestamp", "t"),
    "force": ("force", "kraft", "fuerza", "forza", "load", "f", "fz", "fres"),
    "pressure": ("pressure", "druck", "pression", "presion", "pressione", "p"),
}
_ONE_LETTER = 2


@dataclass(frozen=True)
class GaugeColumn:
    """A column of a recording.

    Attributes:
        name: as the file has it.
        unit: one of :data:`UNITS`; empty: not stated.
        number: of the column, from 0.
    """

    name: str
    unit: str
    number: int


def find_column(
    names: tuple[str, ...], quantity: Quantity, told: str | None, told_unit: str | None
) -> GaugeColumn | None:
    """The column of a quantity; None: there is none.

    Args:
        names: of all columns.
        quantity: which is sought.
        told: name or number, from 1, that the user gives.
        told_unit: unit that the user gives.

    Raises:
        InputError: the file has no such column, there are several, or the unit is unknown.
    """
    if told_unit is not None and _unit(told_unit, quantity) is None:
        raise InputError(
            f"{quantity}_unit", f"{told_unit!r} is no unit of {quantity}", near_matches(told_unit, UNITS[quantity])
        )
    if told is not None:
        number = _told(names, told, quantity)
    else:
        found = [number for number, name in enumerate(names) if _is(name, quantity)]
        if len(found) > 1:
            which = ", ".join(repr(names[number]) for number in found)
            raise InputError(f"{quantity}_column", f"may be any of {which}", "say which one, by its name or number")
        if not found:
            return None
        number = found[0]
    name = names[number]
    unit = _unit(told_unit, quantity) if told_unit is not None else unit_of_name(name, quantity)
    return GaugeColumn(name, unit or "", number)


def _told(names: tuple[str, ...], told: str, quantity: str) -> int:
    """Number of the column from 0."""
    same = [number for number, name in enumerate(names) if name == told]
    alike = [
        number
        for number, name in enumerate(names)
        if _plain(name) == _plain(told) or _plain(_without_unit(name)) == _plain(told)
    ]
    if len(same) > 1 or (not same and len(alike) > 1):
        numbers = ", ".join(str(number + 1) for number in same or alike)
        raise InputError(f"{quantity}_column", f"{told!r} may be any of columns {numbers}", "give its number")
    for number in (*same, *alike):
        return number
    if re.fullmatch(r"[0-9]{1,4}", told) and 1 <= int(told) <= len(names):
        return int(told) - 1
    raise InputError(f"{quantity}_column", f"{told!r} is no column", near_matches(told, names))


def _is(name: str, quantity: Quantity) -> bool:
    word = re.match(r"[a-z]+", _plain(_without_unit(name)))
    if word is None:
        return False
    if any(len(known) > _ONE_LETTER and word[0].startswith(known) for known in _WORDS[quantity]):
        return True
    return word[0] in _WORDS[quantity]


def unit_of_name(name: str, quantity: Quantity) -> str | None:
    """Unit that a name states: ``Force [N]``, ``force_N``, ``Kraft in N``; None: none."""
    found = re.search(r"[\[(]([^\[\](]*)[\])]", name)
    if found is not None:
        return _unit(found[1], quantity)
    parts = [part for part in re.split(r"[\s_,:]+", name.strip()) if part]
    for count in (2, 1):
        unit = _unit("_".join(parts[-count:]), quantity) if len(parts) > count else None
        if unit is not None:
            return unit
    return None


def is_unit(text: str) -> bool:
    """Whether a cell is a unit, in brackets or not."""
    return any(_unit(text.strip("[]() "), quantity) is not None for quantity in UNITS)


def _without_unit(name: str) -> str:
    return re.sub(r"[\[(].*", "", name).strip()


def _unit(text: str, quantity: Quantity) -> str | None:
    text = text.strip()
    if text in UNITS[quantity]:
        return text
    lower = text.lower()
    spelt = _SPELLINGS.get(lower)
    if spelt in UNITS[quantity]:
        return spelt
    same = [unit for unit in UNITS[quantity] if unit.lower() == lower]
    return same[0] if same else None


def _plain(text: str) -> str:
    letters = unicodedata.normalize("NFKD", text.casefold())
    return "".join(c for c in letters if not unicodedata.combining(c)).strip()
