"""Body regions and the spots inside them: rows of a limit table."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

ContactKind = Literal["clamped", "free"]
"""``"clamped"``: the body cannot get away, quasi-static limits. ``"free"``: it can, transient limits."""


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
