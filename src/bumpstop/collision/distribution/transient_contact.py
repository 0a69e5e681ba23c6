"""Free contact: bounds by formula."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bumpstop.collision.arm.arm_mass import reduced_mass

if TYPE_CHECKING:
    from bumpstop.collision.problem import CollisionProblem


@dataclass(frozen=True, kw_only=True)
class ImpactBounds:
    """What an undetected impact at the approach speed comes to, without a simulation.

    Attributes:
        position_driven: the arm keeps its speed whatever it hits, v sqrt(m K) [N].
        reduced_mass: the arm is a free mass too, v sqrt(mu K) with 1 / mu = 1 / m + 1 / arm_mass [N]; None where the
            arm's inertia is not known, or looks like placeholders.
        arm_mass: effective mass of the arm along the contact normal, 1 / (n' J M^-1 J' n) [kg], or None.
        status: of the arm's inertia: ``"published"``, ``"unverified"``, ``"assumed"`` or ``"unknown"``.
    """

    position_driven: float
    reduced_mass: float | None
    arm_mass: float | None
    status: str

    def to_json(self) -> dict[str, Any]:
        """As ``bumpstop evaluate --json`` gives it."""
        return {
            "position_driven_N": self.position_driven,
            "reduced_mass_N": self.reduced_mass,
            "arm_effective_mass_kg": self.arm_mass,
            "arm_inertia": self.status,
        }


def impact_bounds(problem: CollisionProblem) -> ImpactBounds | None:
    """Bounds on the peak force of free contact along a line; None for clamped contact."""
    if problem.body_mass is None:
        return None
    return bounds_at(problem, problem.approach_speed, problem.arm_mass)


def bounds_at(problem: CollisionProblem, speed: float, arm: float | None) -> ImpactBounds:
    """The same at an approach speed [m/s] and with an effective mass of the arm [kg], None where it is not known."""
    mass, stiffness = problem.body_mass, problem.stiffness
    assert mass is not None
    reduced = None if arm is None else speed * (stiffness * reduced_mass(mass, arm)) ** 0.5
    return ImpactBounds(
        position_driven=speed * (mass * stiffness) ** 0.5,
        reduced_mass=reduced,
        arm_mass=arm,
        status=problem.robot.inertia_status,
    )
