"""How far a clamped collision uses the limits of two phases."""

from __future__ import annotations

import math
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
        force, pressure: distributions of the share, of detected collisions or, where arm or body give way, of all;
            pressure None without a pressure limit.
        weight: probability of those collisions.
        missed_force, missed_pressure: P(another collision passes the limit for what lasts).
    """

    force: Distribution
    pressure: Distribution | None
    weight: float
    missed_force: float
    missed_pressure: float

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
        # An arm that has come to rest goes on pressing: the limit for what lasts judges those never detected.
        rest, missed_pressure = not result.problem.gives_way, 0.0
        if transient.pressure_N_cm2 is not None and lasting.pressure_N_cm2 is not None:
            pressure = result.phase_shares(per_newton / transient.pressure_N_cm2, per_newton / lasting.pressure_N_cm2)
            missed_pressure = result.undetected_over(lasting.pressure_N_cm2 / per_newton) if rest else 0.0
        return cls(
            force=force[0],
            pressure=None if pressure is None else pressure[0],
            weight=force[1],
            missed_force=result.undetected_over(lasting.force_N) if rest else 0.0,
            missed_pressure=missed_pressure,
        )

    def over(self) -> tuple[float, float | None]:
        """P(some limit of force is passed), and of pressure; None: there is none."""
        return self._over(self.force, self.missed_force), (
            None if self.pressure is None else self._over(self.pressure, self.missed_pressure)
        )

    def _over(self, share: Distribution, missed: float) -> float:
        return min(1.0, (self.weight * share.exceedance(1.0) if self.weight > 0 else 0.0) + missed)

    def utilisation(self, accepted: float) -> float:
        """The share of its limits that collisions pass with an accepted probability.

        Infinite where those outside the distribution alone pass them with more.
        """
        used = 0.0
        for quantity, missed in ((self.force, self.missed_force), (self.pressure, self.missed_pressure)):
            if quantity is not None and self.weight > 0:
                # Of the collisions of the distribution a smaller share may be over.
                left = (accepted - missed) / self.weight
                used = max(used, math.inf if left <= 0 else 0.0 if left >= 1 else quantity.quantile(1 - left))
        return used
