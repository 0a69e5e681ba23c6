"""Free contact: single runs, and bounds by formula."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.arm.arm_mass import reduced_mass

if TYPE_CHECKING:
    from bumpstop.collision.problem import CollisionProblem


def body_displacement(path: FloatArray, offset: float, stiffness: float, mass: float, step: float) -> FloatArray:
    """How far a free body has been pushed from its place, along a path that is straight between steps.

    The single run that the compiled code solves for many: contact from the first touch until arm and body part, after
    which the body goes on as fast as it then is.

    Args:
        path: distance of the contact point along the normal at every simulation step (steps,) [m].
        offset: where the body stands at rest [m].
        stiffness: of its spring [N/m].
        mass: behind it [kg].
        step: between two entries of ``path`` [s].

    Returns:
        (steps,) [m]; the force is ``stiffness max(0, path - offset - displacement)``.
    """
    frequency = math.sqrt(stiffness / mass)
    pieces = max(1, math.ceil(frequency * step / 0.5))
    short = step / pieces
    displaced, body_speed, compression = np.zeros(path.size), 0.0, 0.0
    touching = separated = False
    pushed = 0.0
    for i in range(path.size - 1):
        speed = float(path[i + 1] - path[i]) / step
        for piece in range(pieces):
            begin = float(path[i]) + speed * short * piece
            if separated:
                pushed += body_speed * short
                continue
            left = short
            if not touching:
                gap = offset - begin
                if not (speed > 0 and speed * short > gap):
                    continue
                touching, compression = True, max(-gap, 0.0)
                left = short - max(gap, 0.0) / speed
            c, s = math.cos(frequency * left), math.sin(frequency * left)
            closing = speed - body_speed
            body_speed = speed - (closing * c - compression * frequency * s)
            compression = compression * c + closing / frequency * s
            # A body first touched where a piece ends is still being approached.
            separated = compression <= 0 and speed <= body_speed
            pushed = begin + speed * short - offset - max(compression, 0.0)
        displaced[i + 1] = pushed
    return displaced


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
