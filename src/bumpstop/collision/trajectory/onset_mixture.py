"""Distributions over the time of contact: what single contacts or quadrature nodes say, mixed."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision.distribution.distribution import Distribution, SampledDistribution
from bumpstop.collision.distribution.mixture import MixtureDistribution, moments_of
from bumpstop.collision.trajectory.onset import OnsetQuadrature


class OnsetMixture:
    """Turns values at nodes of the time of contact into distributions.

    What is detected at one tick changes smoothly with the time of contact inside a panel. There each node's probability
    is spread evenly between the values at the ends of what the node stands for.
    """

    def __init__(self, times: OnsetQuadrature, contact: npt.NDArray[np.int64], tick: npt.NDArray[np.int64]) -> None:
        self._order = times.order
        key = (contact // times.order) * (int(tick.max(initial=0)) + 1) + tick
        # Small numbers: a result is kept with hundreds of thousands of them.
        self._group = np.unique(key, return_inverse=True)[1].astype(np.int32)
        self._place = (contact % times.order).astype(np.int8)
        node, weight = np.polynomial.legendre.leggauss(times.order)
        edge = np.concatenate([[-1.0], -1.0 + np.cumsum(weight)])
        # From values at the nodes to those at the ends of what they stand for: the polynomial through the nodes.
        vandermonde = np.polynomial.legendre.legvander
        self._to_edges = vandermonde(edge, times.order - 1) @ np.linalg.inv(vandermonde(node, times.order - 1))

    def distribution(
        self,
        value: FloatArray,
        mass: FloatArray,
        *,
        zero: float = 0.0,
        end: tuple[FloatArray, FloatArray] | None = None,
    ) -> MixtureDistribution:
        """Of values (detections,) with probabilities; NaN: there is none.

        Args:
            value: at each detection.
            mass: of each.
            zero: further probability at zero.
            end: values and probabilities of the collisions never detected, as they enter the moments.
        """
        groups = int(self._group.max(initial=-1)) + 1
        values = np.full((groups, self._order), math.nan)
        masses = np.zeros((groups, self._order))
        values[self._group, self._place] = value
        masses[self._group, self._place] = mass
        masses[np.isnan(values)] = 0.0
        # No polynomial goes through an infinite value, of an arm that presses for good: each of its group stands alone.
        smooth = np.where(np.isfinite(values).all(axis=1, keepdims=True), values, 0.0)
        ends = smooth @ self._to_edges.T
        low, high = np.minimum(ends[:, 1:], ends[:, :-1]), np.maximum(ends[:, 1:], ends[:, :-1])
        low, high = np.maximum(low, 0.0), np.maximum(high, 0.0)
        scale = float(values[np.isfinite(values)].max(initial=0.0))
        wide = (high - low > 1e-9 * scale) & (masses > 0) if self._order > 1 else np.zeros(masses.shape, dtype=bool)
        single = ~wide & (masses > 0)
        never, never_mass = end if end is not None else (np.zeros(0), np.zeros(0))
        known = masses > 0
        return MixtureDistribution(
            low=low[wide],
            high=high[wide],
            mass=masses[wide],
            atom=np.append(values[single], 0.0),
            atom_mass=np.append(masses[single], zero),
            moments=moments_of(
                np.concatenate([values[known], never, [0.0]]), np.concatenate([masses[known], never_mass, [zero]])
            ),
            undetected=float(never_mass.sum()),
        )


@dataclass(frozen=True, eq=False)
class DetectedCollisions:
    """Detected collisions, single runs or nodes of a quadrature.

    Attributes:
        tick: of detection (detections,).
        onset: numbers of the onsets (detections,) that they belong to.
        begin: of contact (onsets,) [s].
        normal: (onsets, 3), base frame.
        mass: probabilities (detections,), None for runs.
        mixer: of the nodes; None for runs.
    """

    tick: npt.NDArray[np.int64]
    onset: npt.NDArray[np.int64]
    begin: FloatArray
    normal: FloatArray
    mass: FloatArray | None = None
    mixer: OnsetMixture | None = None

    def distribution(self, value: FloatArray) -> tuple[Distribution, float]:
        """Of a quantity (detections,), and the probability of all of them where that is known."""
        if self.mixer is None:
            return SampledDistribution(value), math.nan
        assert self.mass is not None
        return self.mixer.distribution(value, self.mass), float(self.mass.sum())
