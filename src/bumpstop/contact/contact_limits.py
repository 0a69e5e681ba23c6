"""The limits of one contact: what force and pressure one body region may take from it."""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from bumpstop.contact.regions import ContactKind
from bumpstop.errors import InputError

# Skull, forehead, larynx, eyes, ears and face are those that ISO/TS 15066 lists; others are words for parts of them.
_HEAD = re.compile(
    r"\b(heads?|skull|cranium|forehead|temples?|face|facial|cheeks?|chin|jaw|nose|mouth|lips?|eyes?|ears?|larynx|"
    r"throat)\b"
)


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
        stiffness_N_m: the region as a linear spring, k_CC of Schroeder's eq 6.1 [N/m].
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
    def head_note(self) -> str:
        """What ISO/TS 15066 asks beside its limits of head and throat; empty of other regions.

        It goes by the words of the region's name, so that tables of users have it, too.
        """
        if not self.permitted or not _HEAD.search(f"{self.region} {self.label}".lower().replace("_", " ")):
            return ""
        return (
            f"{self.label} is a sensitive region: ISO/TS 15066 asks that contact with skull, forehead, larynx, eyes, "
            "ears or face be prevented whenever reasonably practicable, also below the limits."
        )

    @property
    def crossing_area_cm2(self) -> float | None:
        """Area at which both limits allow the same force, F / p [cm2]: the corner in Schroeder's figure 6.1.

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
