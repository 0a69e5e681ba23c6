"""How far a clamped collision uses the limits of two phases."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from bumpstop.collision.distribution.distribution import Distribution

if TYPE_CHECKING:
    from bumpstop.collision.outcome import CollisionOutcome
    from bumpstop.contact import ContactLimits


@dataclass(frozen=True, eq=False)
class TwoPhaseUse:
    """How far a collision uses its limits: the greater of both phases' share, 1 being the limit itself.

    Attributes:
        force, pressure: distributions of the share, of detected collisions; pressure None without a pressure limit.
        weight: probability of those collisions; all others are counted by who asks.
    """

    force: Distribution
    pressure: Distribution | None
    weight: float

    @classmethod
    def of(cls, result: CollisionOutcome, transient: ContactLimits, lasting: ContactLimits) -> TwoPhaseUse:
        """Compute the shares of a distribution of clamped contact.

        Args:
            result: exact or sampled.
            transient: limits of the first half second of contact.
            lasting: quasi-static limits, for what comes after.
        """
        contact = result.scenario.contact
        per_newton = contact.peak_factor / contact.area_cm2
        force = result.phase_shares(1 / transient.force_N, 1 / lasting.force_N)
        pressure = None
        if transient.pressure_N_cm2 is not None and lasting.pressure_N_cm2 is not None:
            pressure = result.phase_shares(per_newton / transient.pressure_N_cm2, per_newton / lasting.pressure_N_cm2)
        return cls(force[0], None if pressure is None else pressure[0], force[1])

    def over(self, share: Distribution, undetected: float) -> float:
        """P(some limit is passed), undetected collisions counting as over."""
        return min(1.0, (self.weight * share.exceedance(1.0) if self.weight > 0 else 0.0) + undetected)
