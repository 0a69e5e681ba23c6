"""Body regions and the force and pressure they may take: tables, their rows, and the limits of one contact.

A table is a TOML file (see ``docs/contact.md``). Two come with the package, ``bgia2011`` and ``ts15066``;
users bring their own in the same format. Files are checked once, in :meth:`LimitTable.load`, and trusted
afterwards.
"""

from __future__ import annotations

import functools
import math
import os
from collections.abc import Collection, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, get_args

from bumpstop.errors import InputError, near_matches

ContactKind = Literal["clamped", "free"]
"""``"clamped"``: the body cannot get away, quasi-static limits. ``"free"``: it can, transient limits."""

_BUILTIN = ("bgia2011", "ts15066")

# Wide enough for any body and any unit slip, narrow enough that no derived number overflows or vanishes.
_SMALLEST, _LARGEST = 1e-6, 1e6


def builtin_tables() -> tuple[str, ...]:
    """Names of the tables that come with bumpstop, each a valid argument of :meth:`LimitTable.load`."""
    return _BUILTIN


@dataclass(frozen=True, kw_only=True, slots=True)
class Region:
    """A body region: one row of a table, with limits on the force anywhere in it.

    Attributes:
        name: how scenarios call it, ``hand_finger``.
        label: how reports call it, ``Hand/Finger``.
        force_N: quasi-static force limit [N].
        transient_force_N: transient force limit [N]; None where transient contact is not permitted.
        spring_N_mm: stiffness of the region as a linear spring [N/mm].
        effective_mass_kg: mass that moves when the region is struck [kg]; None where the table has none.
        source: where the figures come from.
        status: how well they are attested (``single``, ``multi``, ``unrecorded``, or the user's own word).
    """

    name: str
    label: str
    force_N: float
    transient_force_N: float | None
    spring_N_mm: float
    effective_mass_kg: float | None
    source: str
    status: str

    def force_limit_N(self, kind: ContactKind) -> float | None:
        """Force limit [N] for this kind of contact; None where that kind is not permitted."""
        return self.force_N if kind == "clamped" else self.transient_force_N


@dataclass(frozen=True, kw_only=True, slots=True)
class PressureArea:
    """A spot inside a region with its own pressure limit: one row of a table.

    Attributes:
        name: what the table calls it, ``palm``; rows of one region may share it when their sides differ.
        region: name of the region it lies in.
        side: ``dominant``, ``non_dominant`` or the table's own word; None where one row serves both sides.
        number: the row's number in the standard; None where it has none.
        pressure_N_cm2: quasi-static pressure limit [N/cm2].
        transient_pressure_N_cm2: transient pressure limit [N/cm2]; None where that is not permitted.
        source: where the figures come from.
        status: how well they are attested, as in :class:`Region`.
    """

    name: str
    region: str
    side: str | None
    number: int | None
    pressure_N_cm2: float
    transient_pressure_N_cm2: float | None
    source: str
    status: str

    @property
    def label(self) -> str:
        """Name and side, ``palm (dominant)``: unique within a region."""
        return self.name if self.side is None else f"{self.name} ({self.side})"

    def pressure_limit_N_cm2(self, kind: ContactKind) -> float | None:
        """Pressure limit [N/cm2] for this kind of contact; None where that kind is not permitted."""
        return self.pressure_N_cm2 if kind == "clamped" else self.transient_pressure_N_cm2


@dataclass(frozen=True, kw_only=True, slots=True)
class ContactLimits:
    """What one contact may do to one body region, with where every limit comes from.

    Both limits hold at once. Where a table permits no such contact at all, ``permitted`` is False, ``reason``
    says so and the limits are 0: no force is acceptable there, which is not the same as a small limit.

    Attributes:
        table: name of the table.
        region: name of the region.
        label: the region as reports call it.
        kind: ``"clamped"`` (quasi-static limits) or ``"free"`` (transient limits).
        permitted: whether the table permits this kind of contact with this region.
        reason: one sentence when it does not; empty otherwise.
        force_N: force limit [N].
        pressure_N_cm2: limit on the highest pressure [N/cm2]; None where the table has none for the region.
        pressure_area: label of the row the pressure limit comes from; None without one.
        stiffness_N_m: the region as a linear spring, k_CC of the source's eq 6.1 [N/m].
        effective_mass_kg: mass that moves when the region is struck [kg]; None where the table has none.
        force_source: where the force limit comes from.
        force_status: how well it is attested.
        pressure_source: where the pressure limit comes from; None without one.
        pressure_status: how well it is attested; None without one.
    """

    table: str
    region: str
    label: str
    kind: ContactKind
    permitted: bool
    reason: str
    force_N: float
    pressure_N_cm2: float | None
    pressure_area: str | None
    stiffness_N_m: float
    effective_mass_kg: float | None
    force_source: str
    force_status: str
    pressure_source: str | None
    pressure_status: str | None

    @property
    def crossing_area_cm2(self) -> float | None:
        """Area at which both limits allow the same force, F / p [cm2]: the corner in the source's figure 6.1.

        On a smaller area the pressure limit governs, on a larger one the force limit. With uneven pressure
        the corner lies at this area times the peak factor. None without a pressure limit or when not
        permitted.
        """
        if self.pressure_N_cm2 is None or not self.permitted:
            return None
        return self.force_N / self.pressure_N_cm2

    def allowed_force_N(self, area_cm2: float, peak_factor: float = 1.0) -> float:
        """Largest force that respects both limits, min(F, p area / peak_factor) [N].

        Args:
            area_cm2: contact area [cm2], finite and above 0.
            peak_factor: highest over mean pressure in that area [1], finite and at least 1.

        Raises:
            InputError: an argument outside those ranges.
        """
        return min(self.force_N, self.force_at_pressure_limit_N(area_cm2, peak_factor))

    def governing(self, area_cm2: float, peak_factor: float = 1.0) -> Literal["force", "pressure"]:
        """Which limit is reached first as the force grows; ``"force"`` when both are reached together.

        That includes contacts that are not permitted, where both limits are 0: ask ``permitted`` first.

        Args:
            area_cm2: contact area [cm2], finite and above 0.
            peak_factor: highest over mean pressure in that area [1], finite and at least 1.

        Raises:
            InputError: an argument outside those ranges.
        """
        by_pressure = self.force_at_pressure_limit_N(area_cm2, peak_factor)
        return "pressure" if by_pressure < self.force_N else "force"

    def force_at_pressure_limit_N(self, area_cm2: float, peak_factor: float = 1.0) -> float:
        """Force at which the pressure reaches its limit, p area / peak_factor [N]; infinite without a pressure limit.

        Args:
            area_cm2: contact area [cm2], finite and above 0.
            peak_factor: highest over mean pressure in that area [1], finite and at least 1.

        Raises:
            InputError: an argument outside those ranges.
        """
        # The comparisons are written so that NaN fails them.
        if not 0.0 < area_cm2 < math.inf:
            raise InputError("contact.area_cm2", f"{area_cm2!r} is no contact area", "a finite number of cm2 above 0")
        if not 1.0 <= peak_factor < math.inf:
            raise InputError(
                "contact.peak_factor",
                f"{peak_factor!r} cannot be the highest over the mean pressure",
                "a finite number of at least 1",
            )
        return math.inf if self.pressure_N_cm2 is None else self.pressure_N_cm2 * area_cm2 / peak_factor


@dataclass(frozen=True, kw_only=True, slots=True)
class LimitTable:
    """A table of body limits: regions, pressure areas, and where they come from. Immutable.

    Attributes:
        name: short name, ``bgia2011``.
        title: name of the document.
        source: where the figures come from, for rows that do not say it themselves.
        status: how well they are attested, likewise.
        note: what a reader of any result must know; may be empty.
        regions: the body regions, in the file's order.
        areas: the pressure areas, in the file's order.
    """

    name: str
    title: str
    source: str
    status: str
    note: str
    regions: tuple[Region, ...]
    areas: tuple[PressureArea, ...]

    @classmethod
    def load(
        cls, name_or_path: str | os.PathLike[str], relative_to: str | os.PathLike[str] | None = None
    ) -> LimitTable:
        """Load a built-in table by name, or a user's table from a TOML file.

        Args:
            name_or_path: a name from :func:`builtin_tables`; or a path, which as a string ends in ``.toml``
                or contains a separator.
            relative_to: folder that a relative path starts from, usually the scenario's; default: the current
                folder.

        Raises:
            InputError: an unknown name; an absent or unreadable file; damaged TOML; a key that is unknown,
                missing or of the wrong type; a figure that is not finite and positive; a transient limit
                below the quasi-static one; rows that repeat or contradict each other; the name of a built-in
                table.
                The message names the file, the row and the key.
        """
        if isinstance(name_or_path, str):
            if name_or_path in _BUILTIN:
                return _load_builtin(name_or_path)
            if not (name_or_path.endswith(".toml") or "/" in name_or_path or os.sep in name_or_path):
                raise InputError(
                    "contact.limits",
                    f"no table is called {name_or_path!r}",
                    f"a built-in name or a path ending in .toml; {near_matches(name_or_path, _BUILTIN)}",
                )
        path = Path(relative_to or ".", name_or_path)
        try:
            content = path.read_bytes()
        except (OSError, ValueError) as error:  # ValueError: a NUL character in the path
            problem = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
            raise InputError(
                "contact.limits",
                f"cannot read {str(path)!r}: {problem}",
                f"give a readable TOML file, or one of {', '.join(_BUILTIN)}",
            ) from error
        table = _read_table(content, str(path))
        if table.name in _BUILTIN:
            # A changed copy under the old name would pass for the original in every report.
            raise InputError(
                f"{path} name",
                f"{table.name!r} is the name of a built-in table",
                "give your table its own name",
            )
        return table

    def region(self, name: str) -> Region:
        """The region of that name.

        Raises:
            InputError: this table has no such region. The message gives near matches, and says so when the
                name belongs to a built-in table: the tables divide the body differently.
        """
        for row in self.regions:
            if row.name == name:
                return row
        problem = f"{name!r} is not a region of {self.name}"
        elsewhere = [
            other
            for other in _BUILTIN
            if other != self.name and any(row.name == name for row in _load_builtin(other).regions)
        ]
        if elsewhere:
            problem += f" but of {' and '.join(elsewhere)}, which must not be mixed with it"
        raise InputError("contact.body", problem, near_matches(name, [row.name for row in self.regions]))

    def areas_of(self, region: str) -> tuple[PressureArea, ...]:
        """The pressure areas of a region, in the file's order; empty where the table has none for it.

        Raises:
            InputError: this table has no such region.
        """
        self.region(region)
        return tuple(area for area in self.areas if area.region == region)

    def contact_limits(self, region: str, kind: ContactKind, pressure_area: str | None = None) -> ContactLimits:
        """The limits that judge one kind of contact with one region.

        Args:
            region: name of the region.
            kind: ``"clamped"`` for quasi-static limits, ``"free"`` for transient ones.
            pressure_area: name of the spot that is hit, with its side (``palm (dominant)``) or without; of
                several rows that fit, the lowest limit counts. Default: the lowest of the region, since
                contact can rarely be confined to a tougher spot.

        Raises:
            InputError: an unknown region, kind or pressure area.
        """
        if kind not in get_args(ContactKind):
            raise InputError(
                "contact.kind",
                f"{kind!r} is no kind of contact",
                "'clamped' (quasi-static limits) or 'free' (transient limits)",
            )
        row = self.region(region)
        area = self._area(row, kind, pressure_area)
        force = row.force_limit_N(kind)
        permitted = force is not None
        reason = ""
        if not permitted:
            reason = f"{self.name} does not permit transient contact with this region ({row.label}), at any force."
        return ContactLimits(
            table=self.name,
            region=row.name,
            label=row.label,
            kind=kind,
            permitted=permitted,
            reason=reason,
            force_N=force or 0.0,
            pressure_N_cm2=(area.pressure_limit_N_cm2(kind) or 0.0) if area else None,
            pressure_area=area.label if area else None,
            stiffness_N_m=row.spring_N_mm * 1000.0,
            effective_mass_kg=row.effective_mass_kg,
            force_source=row.source,
            force_status=row.status,
            pressure_source=area.source if area else None,
            pressure_status=area.status if area else None,
        )

    def _area(self, region: Region, kind: ContactKind, wanted: str | None) -> PressureArea | None:
        """The row whose pressure limit judges the contact; None where the region has none."""
        candidates = self.areas_of(region.name)
        if wanted is not None:
            fitting = tuple(area for area in candidates if wanted in (area.name, area.label))
            if not fitting:
                names = dict.fromkeys(name for area in candidates for name in (area.name, area.label))
                raise InputError(
                    "contact.pressure_area",
                    f"{wanted!r} is not a pressure area of {region.name} in {self.name}",
                    near_matches(wanted, names) if names else "leave it out: the region has no pressure limits",
                )
            candidates = fitting
        # Where nothing is permitted every limit is 0; the quasi-static figure then picks the row.
        return min(
            candidates,
            key=lambda area: (area.pressure_limit_N_cm2(kind) or 0.0, area.pressure_N_cm2),
            default=None,
        )


@functools.cache
def _load_builtin(name: str) -> LimitTable:
    from importlib import resources

    file = resources.files("bumpstop.contact").joinpath("data", f"{name}.toml")
    return _read_table(file.read_bytes(), file.name)


# Reading a file. Every refusal names the file, the row and the key. tomllib and importlib.resources are
# imported where they are used: most commands need the names of the tables, few need a table.

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
        valid = f"{valid} from {_SMALLEST:g} to {_LARGEST:g}"
        if key not in self._data:
            raise self.refuse(key, "missing", f"give {valid}")
        value = self._data[key]
        # In Python true is the integer 1; in a limit table it is a slip.
        if isinstance(value, bool) or not isinstance(value, int | float):
            raise self.refuse(key, f"{value!r} is no number", valid)
        if not _SMALLEST <= value <= _LARGEST:  # NaN fails every comparison
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


def _read_table(content: bytes, file: str) -> LimitTable:
    import tomllib

    try:
        data = tomllib.loads(content.decode())
    except (ValueError, RecursionError) as error:  # ValueError: bad TOML, bad UTF-8, absurd integers
        raise InputError(file, f"damaged TOML: {error}") from error
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
    return LimitTable(
        name=head.text("name"),
        title=head.text("title"),
        source=source,
        status=status,
        note=head.text("note") if "note" in head else "",
        regions=tuple(regions.values()),
        areas=tuple(areas.values()),
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
