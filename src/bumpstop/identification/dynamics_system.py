"""The linear system of a recording's torques: its solution, what it leaves out, and held-out errors."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.clusters import blocks_of, clustered_covariance
from bumpstop.identification.essential import essential_values
from bumpstop.identification.torque_columns import column_names, speeds_of, torque_columns

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification.reach import Reach
    from bumpstop.identification.torque_rows import TorqueRows
    from bumpstop.model import Robot

    Groups = tuple[tuple[tuple[int, float], ...], ...]

# Torque and columns of a fit are filtered at this many times the motion's cut-off: what the motion lost above its own
# cut-off would otherwise shrink the torque's columns, but not the torque.
FIT_PER_CUTOFF = 4.0
# Columns that the others make up to this share of their length say nothing of their own.
_DEPENDENT = 1e-4
_RATHER_FIRST = 1e-8  # share of its length that a column counts less than the one before it
_ROUNDS = 4  # of the joints' weights
# Held-out fifths are made of so many parts of the rows each, spread over the time: where one stretch of a short
# recording is all that shows a parameter, the other four fifths would otherwise know nothing of it.
_FOLDS, _PARTS = 5, 20
# Parameters are left out of predictions where no joint's held-out error grows by more than this factor.
_WORST_LOSS = 1.1
_LEAST_SIGN_SPEED = 1e-4  # [rad/s or m/s]


@dataclass(frozen=True, eq=False)
class System:
    """Torque columns of recordings, and what they should add up to.

    Attributes:
        robot, couplings, cutoff_hz: as in :class:`DynamicsFit`.
        rows: motion and torque.
        reach: of these rows what the columns are of: M rows, margins of blocks included.
        sign_speed, top_speed: shape of friction, as :func:`torque_columns` takes it.
        raw: (M, n, parameters) columns.
        columns: (N, n, parameters) the same, filtered, without margins.
        wanted: (N, n) torque without what payloads make, filtered alike. Of currents: the currents, and what payloads
            make is the last column.
    """

    robot: Robot
    couplings: Groups
    cutoff_hz: float
    rows: TorqueRows
    reach: Reach
    sign_speed: FloatArray
    top_speed: FloatArray | None
    raw: FloatArray
    columns: FloatArray
    wanted: FloatArray

    @classmethod
    def of(
        cls,
        rows: TorqueRows,
        robot: Robot,
        cutoff_hz: float,
        couplings: Groups,
        sign_shares: FloatArray | float,
        *,
        bent: bool = False,
        known: System | None = None,
        reach: Reach | None = None,
    ) -> System:
        """The system of some rows.

        Args:
            rows: of a motion filtered at ``cutoff_hz``.
            robot: the chain.
            cutoff_hz: of the motion.
            couplings: joints that share a motor.
            sign_shares: speed over which Coulomb friction turns, as a share of each root mean square speed.
            bent: friction bends with the speed.
            known: another system of the same rows, whose inertial columns are taken over.
            reach: of these rows what columns are made of; default: as far as the system's own filter reaches.
        """
        speeds = speeds_of(rows.motion, couplings)
        sign_speed = np.maximum(sign_shares * np.sqrt(np.mean(speeds**2, axis=0)), _LEAST_SIGN_SPEED)
        top_speed = np.maximum(np.abs(speeds).max(axis=0), _LEAST_SIGN_SPEED) if bent else None
        count = 10 * robot.dof
        cutoff = FIT_PER_CUTOFF * cutoff_hz
        reach = known.reach if known is not None else reach or rows.reach.narrowed(cutoff)
        inertial = None if known is None else known.raw[:, :, :count]
        raw = torque_columns(robot, reach.motion, sign_speed, couplings, top_speed, inertial=inertial)
        if rows.currents:
            raw = np.concatenate([raw, reach.carried[:, :, None]], axis=2)
        if known is None:
            columns = reach.filtered(raw, cutoff)
            wanted = rows.torque_below(cutoff)
            if not rows.currents:
                wanted = wanted - reach.filtered(reach.carried, cutoff)
        else:
            columns = np.concatenate([known.columns[:, :, :count], reach.filtered(raw[:, :, count:], cutoff)], axis=2)
            wanted = known.wanted
        return cls(robot, couplings, cutoff_hz, rows, reach, sign_speed, top_speed, raw, columns, wanted)

    @property
    def names(self) -> list[str]:
        """Of the columns."""
        return column_names(self.robot, self.couplings, bent=self.top_speed is not None)

    def solved(self) -> Solution:
        """Weighted least squares on the independent columns."""
        columns, wanted = self.columns, self.wanted
        whole = triangle_of(np.concatenate(self.triangles, axis=1))
        length = np.sqrt((whole[:, :, :-1] ** 2).sum(axis=(0, 1)))
        seen = np.flatnonzero(length > 1e-9 * length.max())
        weight = 1 / np.maximum(wanted.std(axis=0), 1e-9)
        for _ in range(_ROUNDS):
            last = weight
            matrix = (whole * last[:, None, None]).reshape(-1, whole.shape[2])
            chosen, groups = independent(matrix[:, seen])
            values, *_ = np.linalg.lstsq(matrix[:, seen[chosen]], matrix[:, -1], rcond=None)
            every = np.zeros(columns.shape[2])
            every[seen[chosen]] = values
            error = wanted - columns @ every
            weight = last / np.maximum((error * last).std(axis=0), 1e-12)
        names = self.names
        matrix = (columns[:, :, seen[chosen]] * last[None, :, None]).reshape(-1, chosen.size)
        return Solution(
            columns=[int(seen[c]) for c in chosen],
            names=tuple(label_of(names, seen, int(c), groups[i]) for i, c in enumerate(chosen)),
            values=values,
            covariance=clustered_covariance(matrix, (error * last).ravel(), wanted.shape[1]),
            weight=1 / np.maximum(error.std(axis=0), 1e-12),
            unseen=tuple(name for i, name in enumerate(names) if i not in set(seen.tolist())),
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

    def weighted(self, solution: Solution) -> tuple[FloatArray, FloatArray]:
        """Columns of a solution (N, n, p) and what they should add up to (N, n), joints weighed."""
        return (
            self.columns[:, :, solution.columns] * solution.weight[None, :, None],
            self.wanted * solution.weight,
        )

    def fold_values(self) -> list[FloatArray]:
        """Parameters (n, parameters) by weighted least squares, of all rows but those of one fifth, fifth by fifth.

        Torques of all joints have one set of parameters. Currents, whose gains are not known, have one for each joint.

        From sums of products of the columns, part by part and joint by joint: all weights and fifths share them. Of
        columns that the motion cannot tell apart the shortest values are taken, which predict the same.
        """
        length = np.sqrt((self.columns**2).sum(axis=(0, 1)))
        length[length <= 1e-9 * length.max()] = np.inf  # what is not seen has no value
        squares, moments = [], []
        for part in self._parts():
            own = np.moveaxis(self.columns[part], 1, 0) / length
            turned = own.transpose(0, 2, 1)
            squares.append(turned @ own)
            moments.append((turned @ self.wanted[part].T[:, :, None])[:, :, 0])
        square, moment = np.sum(squares, axis=0), np.sum(moments, axis=0)
        power = (self.wanted**2).sum(axis=0)
        spread = np.maximum(self.wanted.std(axis=0), 1e-9)
        for _ in range(_ROUNDS):
            values = _normal(square, moment, spread, self.rows.currents)
            left = power - 2 * (moment * values).sum(axis=1) + np.einsum("ji,jik,jk->j", values, square, values)
            spread = np.sqrt(np.maximum(left / self.wanted.shape[0], 1e-16 * power + 1e-24))
        found = []
        for fold in range(_FOLDS):
            others = [k for k in range(_PARTS) if k % _FOLDS != fold]
            own_square, own_moment = (np.sum([x[k] for k in others], axis=0) for x in (squares, moments))
            found.append(_normal(own_square, own_moment, spread, self.rows.currents) / length)
        return found

    def left_out(self) -> FloatArray:
        """Unfiltered torque (M, n) of every fifth of the rows, with its margins, as the other four predict it."""
        parts = [slice(a, b) for a, b in pairwise(self.reach.edges(self._edges()))]
        return _by_fold(self.raw, self.fold_values(), parts)

    def held_out(self) -> FloatArray:
        """Mean square error (n,) of filtered torques on held-out fifths."""
        predicted = _by_fold(self.columns, self.fold_values(), self._parts())
        error: FloatArray = ((self.wanted - predicted) ** 2).mean(axis=0)
        return error

    def _edges(self) -> list[int]:
        edges: list[int] = np.linspace(0, self.wanted.shape[0], _PARTS + 1).astype(int).tolist()
        return edges

    def _parts(self) -> list[slice]:
        return [slice(a, b) for a, b in pairwise(self._edges())]

    def essential(self, solution: Solution) -> FloatArray | None:
        """Values without the parameters that cannot be told from zero; None where fifths are predicted worse so."""
        matrix, target = self.weighted(solution)
        joints, own = target.shape[1], solution.columns
        every, without = [], []
        for fold in range(_FOLDS):
            parts = [part for k, part in enumerate(self._parts()) if k % _FOLDS != fold]
            flat = np.concatenate([matrix[part] for part in parts]).reshape(-1, len(own))
            wanted = np.concatenate([target[part] for part in parts]).ravel()
            others = [triangle for k, triangle in enumerate(self.triangles) if k % _FOLDS != fold]
            square = (np.concatenate(others, axis=1) * solution.weight[:, None, None]).reshape(
                -1, self.raw.shape[2] + 1
            )
            values = np.linalg.lstsq(square[:, own], square[:, -1], rcond=None)[0]
            every.append(np.tile(values, (joints, 1)))
            told = essential_values(flat, wanted, blocks_of(wanted - flat @ values, joints))
            without.append(np.tile(told, (joints, 1)))
        columns = self.columns[:, :, own]
        predicted = (_by_fold(columns, found, self._parts()) for found in (every, without))
        errors = [((self.wanted - own) ** 2).mean(axis=0) for own in predicted]
        ratios = errors[1] / np.maximum(errors[0], 1e-300)
        if ratios.mean() > 1 or ratios.max() > _WORST_LOSS:
            return None
        flat, wanted = matrix.reshape(-1, len(own)), target.ravel()
        return essential_values(flat, wanted, blocks_of(wanted - flat @ solution.values, joints))


@dataclass(frozen=True, kw_only=True, eq=False)
class Solution:
    """Base parameters of a system.

    Attributes:
        columns: numbers of the independent columns.
        names: of the base parameters.
        values: (p,) of them.
        covariance: (p, p) that holds under residuals correlated in time and between joints.
        weight: (n,) of the joints, one over their residuals' standard deviation.
        unseen: columns that are zero.
    """

    columns: list[int]
    names: tuple[str, ...]
    values: FloatArray
    covariance: FloatArray
    weight: FloatArray
    unseen: tuple[str, ...]


def _by_fold(columns: FloatArray, values: Sequence[FloatArray], parts: Sequence[slice]) -> FloatArray:
    """Torque (rows, n) of columns (rows, n, parameters), each part by the values of its own fold."""
    predicted = np.empty(columns.shape[:2])
    for k, part in enumerate(parts):
        predicted[part] = np.einsum("tjp,jp->tj", columns[part], values[k % _FOLDS])
    return predicted


def _normal(square: FloatArray, moment: FloatArray, spread: FloatArray, apart: bool) -> FloatArray:
    """Least squares (n, p) from products (n, p, p) and (n, p) of joints that weigh by one over their spread (n,).

    ``apart``: every joint has parameters of its own; else all have the same.
    """
    if apart:
        return np.array(
            [np.linalg.lstsq(own, sums, rcond=_DEPENDENT**2)[0] for own, sums in zip(square, moment, strict=True)]
        )
    weight = 1 / spread**2
    values = np.linalg.lstsq(np.tensordot(weight, square, 1), weight @ moment, rcond=_DEPENDENT**2)[0]
    return np.tile(values, (moment.shape[0], 1))


def independent(matrix: FloatArray) -> tuple[np.ndarray, list[list[tuple[int, float]]]]:
    """Columns that the motion tells apart, and for each the others that move with it and by how much."""
    from scipy.linalg import qr, solve_triangular

    # Of columns that are as good as one another the first is taken, whatever the rounding of their rows.
    scale = np.linalg.norm(matrix, axis=0) * (1 + _RATHER_FIRST * np.arange(matrix.shape[1]))
    triangle, order = qr(matrix / scale, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    rank = int((diagonal > _DEPENDENT * diagonal[0]).sum())
    chosen, rest = order[:rank], order[rank:]
    groups: list[list[tuple[int, float]]] = [[] for _ in range(rank)]
    if rest.size:
        mixed = solve_triangular(triangle[:rank, :rank], triangle[:rank, rank:])
        mixed = mixed * scale[rest][None, :] / scale[chosen][:, None]
        for i in range(rank):
            # By their numbers: which of two alike is pivoted first is a matter of rounding.
            groups[i] = sorted((int(c), float(k)) for c, k in zip(rest, mixed[i], strict=True) if abs(k) > 1e-3)
    return chosen, groups


def label_of(names: list[str], seen: np.ndarray, column: int, group: list[tuple[int, float]]) -> str:
    """Name of a base parameter: the column's own, with the others that move with it."""
    return names[int(seen[column])] + "".join(
        f" {'+' if k > 0 else '-'} {abs(k):.4g} {names[int(seen[c])]}" for c, k in group
    )


def triangle_of(rows: FloatArray) -> FloatArray:
    """Upper triangles (n, up to p, p) with the squares of rows (n, N, p)."""
    return np.asarray(np.linalg.qr(rows, mode="r"))
