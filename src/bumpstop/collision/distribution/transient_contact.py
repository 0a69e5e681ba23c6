"""Free contact in the exact law: forces that bend with the offset, as cells and quadratures."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.collision.arm_mass import reduced_mass
from bumpstop.collision.distribution.contact_duration import antiderivatives
from bumpstop.collision.distribution.mixture import MixtureDistribution

if TYPE_CHECKING:
    from bumpstop.collision.problem import CollisionProblem

# Cells per panel, by the order of its quadrature: eight and two for every standard deviation of the noise by which a
# residual grows in it. In a far tail probability falls steeply across a cell over which it is spread evenly.
_CELLS = {8: 4, 10: 8, 14: 16}
_MAX_CELLS = 32
# With fewer panels than these there is time for more cells.
_FEW_PANELS, _CELLS_OF_FEW = 64, 16


def _cell_count(order: int, panels: int) -> int:
    cells = next((cells for highest, cells in _CELLS.items() if order <= highest), _MAX_CELLS)
    return max(cells, _CELLS_OF_FEW) if panels <= _FEW_PANELS else cells


class TransientQuantities:
    """Peak force, contact time and force at detection of an exact law of free contact."""

    def __init__(self, kernel: _native.CollisionDistribution) -> None:
        """Take the compiled distribution apart."""
        self._nodes, self._alarms = kernel.free_nodes(), kernel.free_alarms()
        coefficients: FloatArray = kernel.coefficients
        self._harmless = float(kernel.harmless)
        _, order, panels = coefficients.shape
        node, weight = np.polynomial.legendre.leggauss(order)
        edge = np.linspace(-1.0, 1.0, _cell_count(order, panels) + 1)
        legendre = np.polynomial.legendre.legvander
        below = np.diff(antiderivatives(edge, order), axis=0)
        self._mass = np.maximum(below @ coefficients, 0)
        self._node_mass = (legendre(node, order - 1) * weight[:, None]) @ coefficients
        # From the nodes to the ends of the cells: the polynomial through the nodes.
        self._to_edges = legendre(edge, order - 1) @ np.linalg.inv(legendre(node, order - 1))

    def peak_force(self) -> MixtureDistribution:
        """Peak force [N] of every collision, detected or not; no contact is no force."""
        return self._distribution("peak_force", slice(None), "force", self._harmless)

    def contact_duration(self) -> MixtureDistribution:
        """Time in contact [s], given contact."""
        return self._distribution("duration", slice(None), "duration", positive=True)

    def force_at_detection(self) -> MixtureDistribution:
        """Force at the tick of detection [N], given a detection in contact."""
        return self._distribution("force_at_detection", slice(-1))

    def _distribution(
        self, name: str, slots: slice, of_alarms: str | None = None, at_zero: float = 0.0, *, positive: bool = False
    ) -> MixtureDistribution:
        value = self._nodes[name][slots]
        edge = np.maximum(self._to_edges @ value, 0.0)
        pieces = [_Pieces(edge, self._mass[slots], value, self._node_mass[slots])]
        if of_alarms is not None:
            alarms = self._alarms
            pieces.append(
                _Pieces(
                    alarms[f"edge_{of_alarms}"],
                    alarms["mass"],
                    alarms[f"node_{of_alarms}"],
                    alarms["node_mass"],
                )
            )
        zero = np.zeros(1 if at_zero > 0 else 0)
        cells = [piece.cells(positive=positive) for piece in pieces] + [(zero, zero, zero + at_zero)]
        nodes = [piece.nodes(positive=positive) for piece in pieces] + [(zero, zero + at_zero)]
        low, high, mass = (np.concatenate(arrays) for arrays in zip(*cells, strict=True))
        node, node_mass = (np.concatenate(arrays) for arrays in zip(*nodes, strict=True))
        return MixtureDistribution.of_cells(low=low, high=high, mass=mass, node=node, node_mass=node_mass)


@dataclass(frozen=True)
class _Pieces:
    """Values at the ends of cells and at nodes along the second axis, and the probabilities of both."""

    edge: FloatArray
    mass: FloatArray
    node: FloatArray
    node_mass: FloatArray

    def cells(self, *, positive: bool) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Ends and probabilities of the cells that have any; with ``positive`` of those above zero."""
        left, right = self.edge[:, :-1], self.edge[:, 1:]
        low, high = np.minimum(left, right), np.maximum(left, right)
        used = self.mass > 0
        if positive:
            used &= high > 0
        return low[used], high[used], self.mass[used]

    def nodes(self, *, positive: bool) -> tuple[FloatArray, FloatArray]:
        """Values and probabilities of the nodes."""
        used = self.node_mass != 0
        if positive:
            used &= self.node > 0
        return self.node[used], self.node_mass[used]


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
    touching = parted = False
    pushed = 0.0
    for i in range(path.size - 1):
        speed = float(path[i + 1] - path[i]) / step
        for piece in range(pieces):
            begin = float(path[i]) + speed * short * piece
            if parted:
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
            parted = compression <= 0 and speed <= body_speed
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
