"""The linear system of a recording's torques: its solution, what it leaves out, and held-out errors."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.dynamics.coulomb_sign import coulomb_signs
from bumpstop.identification.dynamics.regressor_columns import column_names, regressor_columns, speeds_of
from bumpstop.identification.statistics.clusters import blocks_of, clustered_covariance
from bumpstop.identification.statistics.essential_parameters import essential_values
from bumpstop.identification.statistics.held_out import PARTS, PIECES, SPREAD, Folds, by_fold, part_edges
from bumpstop.identification.statistics.independent_columns import (
    condition_of,
    independent,
    label_of,
    triangle_of,
)
from bumpstop.identification.statistics.normal_equations import NormalEquations

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    import numpy.typing as npt

    from bumpstop.identification.segments.padded_segments import PaddedSegments
    from bumpstop.identification.segments.torque_samples import TorqueSamples
    from bumpstop.model import Robot

    Groups = tuple[tuple[tuple[int, float], ...], ...]

# Torque and columns of a fit are filtered at this many times the motion's cut-off: the columns hold nothing above it,
# and torque there would be noise of the fit.
FIT_PER_CUTOFF = 1.0
_ROUNDS = 4  # of the joints' weights
# Parameters are left out of a joint's predictions where its held-out error falls to this share of it.
_CLEARLY_LESS = 0.98
_MIN_SIGN_SPEED = 1e-4  # [rad/s or m/s]
_ROUNDING = 1e-12  # of a mean square


@dataclass(frozen=True, eq=False)
class System:
    """Torque columns of recordings, and what they should add up to; zero at rows that a joint is not fitted to.

    Attributes:
        robot, couplings, cutoff_hz: as in :class:`DynamicsFit`.
        rows: motion and torque.
        reach: of these rows what the columns are of: M rows, margins of blocks included.
        sign_speed, presliding, top_speed: shape of friction, as in :class:`DynamicsModel`.
        signs: (M, n + shared motors) of Coulomb friction.
        loads: torque (M,) that loads the gears of joints whose friction grows with it.
        raw: (M, n, parameters) columns.
        columns: (N, n, parameters) the same, filtered, without margins.
        wanted: (N, n) torque without what payloads make, filtered alike. Of currents: the currents, and what payloads
            make is the last column.
        counts: (n,) rows that each joint is fitted to.
        known_products: sums of products of the inertial columns, where another system of these rows has them; None.
    """

    robot: Robot
    couplings: Groups
    cutoff_hz: float
    rows: TorqueSamples
    reach: PaddedSegments
    sign_speed: FloatArray
    presliding: FloatArray | None
    top_speed: FloatArray | None
    signs: FloatArray
    loads: Mapping[int, FloatArray]
    raw: FloatArray
    columns: FloatArray
    wanted: FloatArray
    counts: FloatArray
    known_products: FloatArray | None = None

    @classmethod
    def of(
        cls,
        rows: TorqueSamples,
        robot: Robot,
        cutoff_hz: float,
        couplings: Groups,
        sign_shares: FloatArray | float,
        *,
        presliding: FloatArray | None = None,
        bent: np.ndarray | bool = False,
        loads: Mapping[int, FloatArray] | None = None,
        known: System | None = None,
        reach: PaddedSegments | None = None,
    ) -> System:
        """The system of some rows.

        Args:
            rows: of a motion filtered at ``cutoff_hz``.
            robot: the chain.
            cutoff_hz: of the motion.
            couplings: joints that share a motor.
            sign_shares: speed over which Coulomb friction turns, as a share of each root mean square speed.
            presliding: (n + shared motors,) travel over which it turns in place of that; NaN: it does not.
            bent: friction bends with the speed; (n + shared motors,) or all alike.
            loads: torque (M,) that loads the gears of joints whose friction grows with it; default: of none.
            known: another system of the same rows, whose inertial columns are taken over.
            reach: of these rows what columns are made of; default: as far as the system's own filter reaches.
        """
        speeds = speeds_of(rows.motion, couplings)
        sign_speed = np.maximum(sign_shares * np.sqrt(np.mean(speeds**2, axis=0)), _MIN_SIGN_SPEED)
        tops = np.maximum(np.abs(speeds).max(axis=0), _MIN_SIGN_SPEED)
        top_speed = np.where(bent, tops, np.nan) if np.any(bent) else None
        count = 10 * robot.dof
        cutoff = FIT_PER_CUTOFF * cutoff_hz
        reach = known.reach if known is not None else reach or rows.reach.trimmed(cutoff)
        inertial = None if known is None else known.raw[:, :, :count]
        signs = coulomb_signs(reach.motion, couplings, sign_speed, presliding)
        raw = regressor_columns(robot, reach.motion, signs, couplings, top_speed, loads=loads, inertial=inertial)
        if rows.currents:
            raw = np.concatenate([raw, reach.carried[:, :, None]], axis=2)
        if known is None:
            columns = reach.filtered(raw, cutoff)
            wanted = rows.torque_below(cutoff)
            if not rows.currents:
                wanted = wanted - reach.filtered(reach.carried, cutoff)
            wanted = np.where(rows.used, wanted, 0.0)
        else:
            columns = np.concatenate([known.columns[:, :, :count], reach.filtered(raw[:, :, count:], cutoff)], axis=2)
            wanted = known.wanted
        columns[~rows.used] = 0.0
        counts = np.maximum(rows.used.sum(axis=0), 1).astype(np.float64)
        return cls(
            robot=robot,
            couplings=couplings,
            cutoff_hz=cutoff_hz,
            rows=rows,
            reach=reach,
            sign_speed=sign_speed,
            presliding=presliding,
            top_speed=top_speed,
            signs=signs,
            loads=loads or {},
            raw=raw,
            columns=columns,
            wanted=wanted,
            counts=counts,
            # Not the system itself, whose columns are large.
            known_products=None if known is None else known._equations.products[:, :, :count, :count],
        )

    @property
    def names(self) -> list[str]:
        """Of the columns."""
        return column_names(self.robot, self.couplings, self.top_speed, tuple(self.loads))

    def spread(self, x: FloatArray) -> FloatArray:
        """Root mean square (n,) of what is zero at rows that a joint is not fitted to (N, n)."""
        size: FloatArray = np.sqrt((x**2).sum(axis=0) / self.counts)
        return size

    @cached_property
    def base(self) -> Base:
        """Weighted least squares on the independent columns."""
        whole = triangle_of(np.concatenate(self.triangles, axis=1))
        length = np.sqrt((whole[:, :, :-1] ** 2).sum(axis=(0, 1)))
        seen = np.flatnonzero(length > 1e-9 * length.max())
        weight = 1 / np.maximum(self.spread(self.wanted), 1e-9)
        for _ in range(_ROUNDS):
            last = weight
            matrix = (whole * last[:, None, None]).reshape(-1, whole.shape[2])
            chosen, groups = independent(matrix[:, seen])
            values, *_ = np.linalg.lstsq(matrix[:, seen[chosen]], matrix[:, -1], rcond=None)
            every = np.zeros(self.columns.shape[2])
            every[seen[chosen]] = values
            error = self.wanted - self.columns @ every
            weight = last / np.maximum(self.spread(error * last), 1e-12)
        return Base(seen, chosen, groups, every, last, error)

    def solved(self) -> Solution:
        """Base parameters and their covariance."""
        base, names = self.base, self.names
        own = base.seen[base.chosen]
        matrix = (self.columns[:, :, own] * base.weight[None, :, None]).reshape(-1, own.size)
        return Solution(
            condition=condition_of(matrix),
            columns=own.tolist(),
            names=tuple(label_of(names, base.seen, int(c), base.groups[i]) for i, c in enumerate(base.chosen)),
            values=base.values[own],
            covariance=clustered_covariance(matrix, (base.error * base.weight).ravel(), self.wanted.shape[1]),
            weight=1 / np.maximum(self.spread(base.error), 1e-12),
            unobservable=tuple(name for i, name in enumerate(names) if i not in set(base.seen.tolist())),
        )

    @cached_property
    def triangles(self) -> list[FloatArray]:
        """Of every part, joint by joint, a triangle (n, up to parameters + 1, parameters + 1) with the same squares.

        Least squares of the rows, columns and what they should add up to side by side, are those of the triangles:
        weights, folds and choices of columns go through these instead.
        """
        return [
            triangle_of(np.concatenate([self.columns[part], self.wanted[part][:, :, None]], axis=2).transpose(1, 0, 2))
            for part in self._parts()
        ]

    def load_of(self, values: FloatArray) -> FloatArray:
        """Torque (M, n) that loads the gears: what inertia and payloads make of it, by values of all columns.

        Args:
            values: (parameters,), or (n, parameters) where each joint has its own; of this system, or of one with the
                same inertia and other friction.
        """
        count = 10 * self.robot.dof
        every = np.broadcast_to(values, (self.robot.dof, values.shape[-1]))
        load: FloatArray = np.einsum("tjp,jp->tj", self.raw[:, :, :count], every[:, :count])
        return load + (self.raw[:, :, -1] * every[:, -1] if self.rows.currents else self.reach.carried)

    def reloaded(self, values: FloatArray) -> System:
        """The same with the loads that :meth:`load_of` says of other values."""
        if not self.loads:
            return self
        load = self.load_of(values)
        loads = {j: np.ascontiguousarray(load[:, j]) for j in self.loads}
        places = [self.names.index(f"load_{j + 1}") for j in loads]
        raw, columns = self.raw.copy(), self.columns.copy()
        for place, (j, own) in zip(places, loads.items(), strict=True):
            raw[:, j, place] = self.signs[:, j] * np.abs(own)
        columns[:, :, places] = self.reach.filtered(raw[:, :, places], FIT_PER_CUTOFF * self.cutoff_hz)
        columns[~self.rows.used] = 0.0
        return replace(self, loads=loads, raw=raw, columns=columns)

    @cached_property
    def values(self) -> FloatArray:
        """Parameters (n, parameters) by weighted least squares; shortest ones, as for :meth:`fold_values`."""
        return self._equations.values()

    def fold_values(self, folds: Folds = SPREAD) -> list[FloatArray]:
        """Parameters (n, parameters) by weighted least squares, of all rows but those of one fifth, fifth by fifth.

        Torques of all joints have one set of parameters. Currents, whose gains are not known, have one for each joint.

        Of columns that the motion cannot tell apart the shortest values are taken, which predict the same.
        """
        return [self._equations.values(left_out=fold) for fold in folds]

    @cached_property
    def _equations(self) -> NormalEquations:
        return NormalEquations.of(
            self.columns,
            self.wanted,
            self._parts(),
            self.counts,
            apart=self.rows.currents,
            known=self.known_products,
        )

    def left_out(self) -> FloatArray:
        """Unfiltered torque (M, n) of every fifth of the rows, with its margins, as the other four predict it."""
        parts = [slice(a, b) for a, b in pairwise(self.reach.edges(self._edges()))]
        return by_fold(self.raw, self.fold_values(), parts, SPREAD)

    def held_out(self) -> FloatArray:
        """Mean square error (n,) of filtered torques on held-out fifths."""
        error: FloatArray = self.held_out_parts().sum(axis=0)
        return error

    def unexplained(self) -> FloatArray:
        """Share (n,) of the variance of filtered torques that is left on held-out fifths; NaN where there is none."""
        spread = self.spread(self.wanted - self.rows.used * (self.wanted.sum(axis=0) / self.counts)) ** 2
        # A constant torque has none but rounding.
        varies = spread > _ROUNDING * self.spread(self.wanted) ** 2
        with np.errstate(divide="ignore", invalid="ignore"):
            share: FloatArray = np.where(varies, self.held_out() / spread, np.nan)
        return share

    def held_out_parts(self, folds: Folds = SPREAD) -> FloatArray:
        """What each part, predicted from the other folds, has of the mean square error (parts, n)."""
        squares = (self.wanted - by_fold(self.columns, self.fold_values(folds), self._parts(), folds)) ** 2
        return np.array([squares[part].sum(axis=0) for part in self._parts()]) / self.counts

    def _edges(self) -> list[int]:
        return part_edges(self.wanted.shape[0])

    def _parts(self) -> list[slice]:
        return [slice(a, b) for a, b in pairwise(self._edges())]

    def essential(
        self, own: Sequence[int], values: FloatArray, weight: FloatArray, inverse: FloatArray | None = None
    ) -> tuple[FloatArray, npt.NDArray[np.bool_]] | None:
        """Values without the parameters that cannot be told from zero, and the joints that they predict no worse.

        Joints differ in what is told of them: each takes these values where its held-out fifths are predicted no worse
        by them.

        Args:
            own: numbers of the independent columns.
            values: (p,) of these by least squares.
            weight: (n,) of the joints: one over what is left of each.
            inverse: (n,) inverse gains, of currents, whose last column is a known load.

        Returns:
            Values (p,) and joints (n,); None where no joint takes them.
        """
        n = self.wanted.shape[1]
        turn = np.ones(n) if inverse is None else inverse
        wanted = self.wanted if inverse is None else self.wanted - self.columns[:, :, -1] * inverse
        columns = self.columns[:, :, list(own)] * turn[None, :, None]
        matrix, target = columns * weight[None, :, None], wanted * weight
        parts = self._parts()
        both = np.concatenate([matrix, target[:, :, None]], axis=2)
        triangles = [np.linalg.qr(both[part].reshape(-1, both.shape[2]), mode="r") for part in parts]
        joints = np.ones(n, dtype=bool)
        for folds in (SPREAD, PIECES):
            every, without = [], []
            for fold in folds:
                others = [k for k in range(PARTS) if k not in fold]
                flat = np.concatenate([matrix[parts[k]] for k in others]).reshape(-1, len(own))
                aim = np.concatenate([target[parts[k]] for k in others]).ravel()
                square = np.concatenate([triangles[k] for k in others])
                plain = np.linalg.lstsq(square[:, :-1], square[:, -1], rcond=None)[0]
                every.append(np.tile(plain, (n, 1)))
                told = essential_values(flat, aim, blocks_of(aim - flat @ plain, n))
                without.append(np.tile(told, (n, 1)))
            errors = [((wanted - by_fold(columns, own_, parts, folds)) ** 2).sum(axis=0) for own_ in (every, without)]
            joints &= errors[1] <= _CLEARLY_LESS * errors[0]
        if not joints.any():
            return None
        flat, aim = matrix.reshape(-1, len(own)), target.ravel()
        return essential_values(flat, aim, blocks_of(aim - flat @ values, n)), joints


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """Base parameters of a system.

    Attributes:
        columns: numbers of the independent columns.
        names: of the base parameters.
        values: (p,) of them.
        covariance: (p, p) that holds under residuals correlated in time and between joints.
        weight: (n,) of the joints, one over their residuals' standard deviation.
        unobservable: columns that are zero.
        condition: condition number of the weighted columns, each brought to length one.
    """

    condition: float
    columns: list[int]
    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    weight: FloatArray
    unobservable: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Base:
    """Least squares on the independent columns of a system.

    Attributes:
        seen: numbers of the columns that are not zero.
        chosen: places among these of the independent ones.
        groups: for each of them the others that move with it, as :func:`independent` gives them.
        values: (parameters,) of all columns, zero but for the independent ones.
        weight: (n,) of the joints.
        error: (N, n) that is left.
    """

    seen: np.ndarray
    chosen: np.ndarray
    groups: list[list[tuple[int, float]]]
    values: FloatArray
    weight: FloatArray
    error: FloatArray
