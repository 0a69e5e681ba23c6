"""Files of limit tables, read strictly: every refusal names the file, the row and the key."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping
from typing import Any, TypeVar

from bumpstop.contact.regions import PressureArea, Region
from bumpstop.errors import InputError, near_matches
from bumpstop.text_files import parse_toml

Table = TypeVar("Table")

# Wide enough for any body and any unit slip, narrow enough that no derived number overflows or vanishes.
_MIN_VALUE, _MAX_VALUE = 1e-6, 1e6

_TABLE_KEYS = ("name", "title", "source", "status", "note", "region", "area")
_REGION_KEYS = (
    "name",
    "label",
    "force_N",
    "transient_multiplier",
    "transient_force_N",
    "spring_N_mm",
    "effective_mass_kg",
    "source",
    "status",
)
_AREA_KEYS = (
    "number",
    "name",
    "region",
    "side",
    "pressure_N_cm2",
    "transient_multiplier",
    "transient_pressure_N_cm2",
    "source",
    "status",
)


class _Row:
    """One table of a TOML file, read key by key; ``where`` is how messages call it."""

    def __init__(self, data: Mapping[str, Any], where: str, known: Collection[str]) -> None:
        self.where = where
        self._data = data
        for key in data:
            if key not in known:
                raise InputError(where, f"unknown key {key!r}", near_matches(key, known))

    def __contains__(self, key: str) -> bool:
        return key in self._data

    def empty(self) -> list[str]:
        """Keys with an empty text."""
        return [key for key, value in self._data.items() if value == ""]

    def refuse(self, key: str, problem: str, valid: str) -> InputError:
        return InputError(f"{self.where} {key}", problem, valid)

    def text(self, key: str, default: str | None = None) -> str:
        value = self._data.get(key, default)
        if value is None:
            raise self.refuse(key, "missing", "give a text")
        if not isinstance(value, str) or not value.strip():
            raise self.refuse(key, f"{value!r} is no text", "a text that is not empty")
        return value

    def number(self, key: str, valid: str) -> float:
        valid = f"{valid} from {_MIN_VALUE:g} to {_MAX_VALUE:g}"
        if key not in self._data:
            raise self.refuse(key, "missing", f"give {valid}")
        value = self._data[key]
        # In Python true is the integer 1; in a limit table it is a slip.
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refuse(key, f"{value!r} is no number", valid)
        if not _MIN_VALUE <= value <= _MAX_VALUE:  # NaN fails every comparison
            raise self.refuse(key, f"{value!r} is out of range", valid)
        return float(value)

    def whole(self, key: str) -> int:
        value = self._data[key]
        if isinstance(value, bool) or not isinstance(value, int) or value < 1:
            raise self.refuse(key, f"{value!r} is no row number", "a whole number of at least 1")
        return value

    def transient(self, base_key: str, transient_key: str, unit: str) -> float | None:
        """The transient limit belonging to ``base_key``; None where the multiplier 0 forbids such contact."""
        base = self.number(base_key, f"a number of {unit}")
        forms = ("transient_multiplier", transient_key)
        given = [form for form in forms if form in self]
        if len(given) != 1:
            raise InputError(
                self.where,
                f"{'both' if given else 'neither'} of {forms[0]} and {forms[1]} given",
                f"give one of them; {forms[0]} = 0 where transient contact is not permitted",
            )
        if given[0] == transient_key:
            limit = self.number(transient_key, f"a number of {unit}")
        elif self._data["transient_multiplier"] == 0 and self._data["transient_multiplier"] is not False:
            return None
        else:
            limit = self.number("transient_multiplier", "0 (not permitted) or a factor") * base
        if limit < base:
            # A body stands more for an instant than for long; the usual cause is the two figures swapped.
            raise self.refuse(
                given[0],
                f"makes the transient limit {limit:g} {unit}, below the quasi-static {base_key} = {base:g}",
                "a transient limit at least as high (are the two swapped?)",
            )
        return limit


def read_table(text: str, file: str, make: Callable[..., Table]) -> Table:
    """A table from the text of its file; ``file`` is how messages call it, ``make`` takes what is in it.

    Raises:
        InputError: damaged TOML; a key that is unknown, missing or of the wrong type; a figure that is not finite and
            positive; rows that repeat or contradict each other.
    """
    data = parse_toml(text, file)
    _check_filled(data, file)
    head = _Row(data, file, _TABLE_KEYS)
    source, status = head.text("source"), head.text("status")
    regions: dict[str, Region] = {}
    for row in _rows(data, "region", file, _REGION_KEYS):
        region = _read_region(row, source, status)
        if region.name in regions:
            raise row.refuse("name", f"{region.name!r} appears twice", "one row per region")
        regions[region.name] = region
    if not regions:
        raise InputError(file, "no [[region]]", "give at least one")
    areas: dict[tuple[str, str], PressureArea] = {}
    for row in _rows(data, "area", file, _AREA_KEYS):
        area = _read_area(row, regions, source, status)
        if (area.region, area.label) in areas:
            raise row.refuse(
                "name",
                f"{area.label!r} appears twice in {area.region!r}",
                "rows of one name differ in their side",
            )
        areas[area.region, area.label] = area
    return make(
        name=head.text("name"),
        title=head.text("title"),
        source=source,
        status=status,
        note=head.text("note") if "note" in head else "",
        regions=tuple(regions.values()),
        areas=tuple(areas.values()),
    )


def _check_filled(data: Mapping[str, Any], file: str) -> None:
    """Refuse a form with places that are still empty, and say where the first is."""
    empty = [f"{file} {key}" for key in ("source", "status") if data.get(key) == ""]
    for kind, known in (("region", _REGION_KEYS), ("area", _AREA_KEYS)):
        rows = data.get(kind, [])
        if isinstance(rows, list) and all(isinstance(row, Mapping) for row in rows):
            for row in _rows(data, kind, file, known):
                empty += [f"{row.where} {key}" for key in row.empty()]
    if len(empty) > 1:
        raise InputError(
            empty[0],
            f"is empty, and so are {len(empty) - 1} more places of {data.get('title') or data.get('name') or file!r}",
            "fill in the form from a bought copy",
        )


def _rows(data: Mapping[str, Any], key: str, file: str, known: Collection[str]) -> list[_Row]:
    tables = data.get(key, [])
    if not isinstance(tables, list) or not all(isinstance(table, dict) for table in tables):
        raise InputError(f"{file} {key}", "is not a list of tables", f"begin each row with [[{key}]]")
    return [
        _Row(table, f"{file} [[{key}]] {index} ({table.get('name', 'no name')!r})", known)
        for index, table in enumerate(tables, start=1)
    ]


def _read_region(row: _Row, source: str, status: str) -> Region:
    name = row.text("name")
    return Region(
        name=name,
        label=row.text("label", name),
        force_N=row.number("force_N", "a number of N"),
        transient_force_N=row.transient("force_N", "transient_force_N", "N"),
        spring_N_mm=row.number("spring_N_mm", "a number of N/mm"),
        effective_mass_kg=row.number("effective_mass_kg", "a number of kg") if "effective_mass_kg" in row else None,
        source=row.text("source", source),
        status=row.text("status", status),
    )


def _read_area(row: _Row, regions: Mapping[str, Region], source: str, status: str) -> PressureArea:
    region = row.text("region")
    if region not in regions:
        raise row.refuse("region", f"{region!r} is not a region of this table", near_matches(region, regions))
    transient = row.transient("pressure_N_cm2", "transient_pressure_N_cm2", "N/cm2")
    # Permission belongs to the region; an area that says otherwise leaves open which of them is wrong.
    if (transient is None) != (regions[region].transient_force_N is None):
        raise InputError(
            row.where,
            f"disagrees with its region {region!r} on whether transient contact is permitted",
            "transient_multiplier = 0 in the region and all of its areas, or in none of them",
        )
    return PressureArea(
        name=row.text("name"),
        region=region,
        side=row.text("side") if "side" in row else None,
        number=row.whole("number") if "number" in row else None,
        pressure_N_cm2=row.number("pressure_N_cm2", "a number of N/cm2"),
        transient_pressure_N_cm2=transient,
        source=row.text("source", source),
        status=row.text("status", status),
    )
