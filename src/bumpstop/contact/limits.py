"""Limit tables: body regions and the force and pressure they may take.

A table is a TOML file (see ``docs/reference/contact.md``). Two come with the package, ``bgia2011`` and ``ts15066``;
users bring their own in the same format. Files are checked once, in :meth:`LimitTable.load`, and trusted
afterwards.
"""

from __future__ import annotations

import functools
import os
from dataclasses import dataclass
from typing import get_args

from bumpstop.arrays import as_name
from bumpstop.contact.contact_limits import ContactLimits
from bumpstop.contact.regions import ContactKind, PressureArea, Region
from bumpstop.errors import InputError, near_matches

_BUILTIN = ("bgia2011", "ts15066")
# Tables whose figures only a bought copy has: they come empty, to be filled in.
_FORMS = ("iso10218_2_2025_annex_m",)


def builtin_tables() -> tuple[str, ...]:
    """Names of the tables that come with bumpstop, each a valid argument of :meth:`LimitTable.load`."""
    return _BUILTIN


def limit_forms() -> tuple[str, ...]:
    """Names of tables that come as empty forms, each a valid argument of :func:`form_text`."""
    return _FORMS


def form_text(name: str) -> str:
    """The text of an empty form, to be filled in from a bought copy of the standard and loaded by its path.

    Raises:
        InputError: there is no form of that name.
    """
    if name not in _FORMS:
        raise InputError("form", f"no form is called {name!r}", near_matches(name, _FORMS))
    from importlib import resources

    return (resources.files("bumpstop.contact") / "data" / "forms" / f"{name}.toml").read_text(encoding="utf-8")


@dataclass(frozen=True, kw_only=True, slots=True, repr=False)
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

    def __repr__(self) -> str:
        """Its name and how much it holds."""
        return f"LimitTable({self.name!r}, {len(self.regions)} regions, {len(self.areas)} areas)"

    @classmethod
    def load(
        cls,
        name_or_path: str | os.PathLike[str],
        relative_to: str | os.PathLike[str] | None = None,
        *,
        field: str = "contact.limits",
    ) -> LimitTable:
        """Load a built-in table by name, or a user's table from a TOML file.

        Args:
            name_or_path: a name from :func:`builtin_tables`; or a path, which as a string ends in ``.toml``
                or contains a separator.
            relative_to: folder that a relative path starts from, usually the scenario's; default: the current
                folder.
            field: what the user calls the table, for messages.

        Raises:
            InputError: an unknown name; a form that is still empty; an absent or unreadable file; damaged TOML;
                a key that is unknown, missing or of the wrong type; a figure that is not finite and positive; a
                transient limit below the quasi-static one; rows that repeat or contradict each other; the name of a
                built-in table.
                The message names the file, the row and the key.
        """
        if isinstance(name_or_path, str):
            if name_or_path in _BUILTIN:
                return _load_builtin(name_or_path)
            if name_or_path in _FORMS:
                raise InputError(
                    field,
                    f"{name_or_path!r} is an empty form without figures",
                    "write it with bumpstop bodies --form FILE, fill it in from a bought copy and give its path",
                )
            if not (name_or_path.endswith(".toml") or "/" in name_or_path or os.sep in name_or_path):
                raise InputError(
                    field,
                    f"no table is called {name_or_path!r}",
                    f"a built-in name or a path ending in .toml; {near_matches(name_or_path, _BUILTIN)}",
                )
        from bumpstop.contact.table_file import read_table
        from bumpstop.text_files import as_path, read_text

        path = as_path(relative_to or ".", "relative_to") / as_path(name_or_path, field)
        wanted = f"wanted a limit table (TOML), or one of {', '.join(_BUILTIN)}"
        table = read_table(read_text(path, wanted, field=field), str(path), cls)
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
        as_name(name, "contact.body", "wanted the name of a region")
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
        if not isinstance(kind, str) or kind not in get_args(ContactKind):
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
            as_name(wanted, "contact.pressure_area", "wanted the name of an area")
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

    from bumpstop.contact.table_file import read_table

    file = resources.files("bumpstop.contact").joinpath("data", f"{name}.toml")
    return read_table(file.read_text(encoding="utf-8"), file.name, LimitTable)
