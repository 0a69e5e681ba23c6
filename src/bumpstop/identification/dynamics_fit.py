"""Inertial (base) parameters, friction and rotor inertia of an arm from recorded joint torques."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.essential import essential_values
from bumpstop.identification.motion import EvenMotion, even_motion, lowpass, onto
from bumpstop.identification.regressor import inertial_names, inertial_regressor
from bumpstop.signal import correlation_time

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.model import Robot
    from bumpstop.recording import Recording

GRAVITY = (0.0, 0.0, -9.80665)
# Columns that the others make up to this share of their length say nothing of their own.
_DEPENDENT = 1e-4
# Speed over which Coulomb friction turns from one sign to the other, as a share of a joint's root mean square speed.
# The first is taken while the cut-off is chosen; then each joint and each shared motor gets the best of all.
_SIGN_SHARES = (0.03, 0.001, 0.005, 0.1, 0.3)
# Torque and columns of a fit are filtered at this many times the motion's cut-off: what the motion lost above its own
# cut-off would otherwise shrink the torque's columns, but not the torque.
FIT_PER_CUTOFF = 4.0
_CUTOFFS_HZ = (2.0, 3.0, 4.5, 7.0, 10.0, 15.0, 30.0, 60.0)
_ROUNDS = 4  # of the joints' weights
_FOLDS = 5
_CLEAR_GAIN = 0.95
_AS_GOOD = 1.01


@dataclass(frozen=True, kw_only=True)
class JointScore:
    """How well torques of one joint are predicted.

    Attributes:
        name: of the joint.
        r2: share of the torque's variance that is predicted, both filtered alike.
        r2_raw: the same against the unfiltered torque.
        mean, sd, rmse: of the error, predicted less measured, unfiltered [Nm or N].
    """

    name: str
    r2: float
    r2_raw: float
    mean: float
    sd: float
    rmse: float


@dataclass(frozen=True, kw_only=True, eq=False)
class DynamicsFit:
    """Parameters that a recording shows, and what they predict.

    Attributes:
        robot: the chain.
        columns: numbers of the independent columns of :func:`torque_columns`.
        names: of the base parameters: the column's own, with the others that move with it.
        values, standard_errors: of the base parameters; the errors hold under residuals correlated in time.
        sign_speed: (n + shared motors,) speed scale of Coulomb friction, of joints, then of shared motors; or (n,): a
            shared motor has the mean of its joints' [rad/s or m/s].
        couplings: groups of joints that share a motor, as (joint, factor) pairs.
        cutoff_hz: of the motion's filter, chosen by held-out error.
        held_out: mean over joints of 1 - R2 on held-out fifths, by the cut-off that was tried [Hz].
        unseen: inertial and friction parameters that the motion cannot show at all.
        rows_used: of the fit.
        covariance: of the base parameters, whose diagonal the standard errors are; None: read from a file.
        predicting: values that predictions use, fitted without the parameters that the recording cannot tell from zero,
            which are 0 here; None: predictions use ``values``.
    """

    robot: Robot
    columns: tuple[int, ...]
    names: tuple[str, ...]
    values: FloatArray
    standard_errors: FloatArray
    sign_speed: FloatArray
    couplings: tuple[tuple[tuple[int, float], ...], ...]
    cutoff_hz: float
    held_out: dict[float, float]
    unseen: tuple[str, ...]
    rows_used: int
    covariance: FloatArray | None = None
    predicting: FloatArray | None = None

    def predict(self, motion: EvenMotion) -> FloatArray:
        """Joint torques (N, n) of a motion [Nm or N]."""
        columns = torque_columns(self.robot, motion, self.sign_speed, self.couplings)
        values = self.values if self.predicting is None else self.predicting
        torque: FloatArray = columns[:, :, list(self.columns)] @ values
        return torque

    def residual(self, recording: Recording) -> tuple[EvenMotion, FloatArray]:
        """Recorded minus predicted torque, unfiltered, of the same robot.

        Returns:
            The motion on its even grid, and the residual (N, n) there [Nm or N].

        Raises:
            InputError: no torque, other joints, or too few rows.
        """
        if recording.dof != self.robot.dof:
            raise InputError("recording", f"has {recording.dof} joints", f"{self.robot.name} has {self.robot.dof}")
        motion, torque = recorded_motion(recording, self.cutoff_hz)
        return motion, torque - self.predict(motion)

    def score(self, recording: Recording, *, filter_hz: float | None = None) -> tuple[JointScore, ...]:
        """Compare predicted with recorded torque.

        Args:
            recording: with torque, of the same robot.
            filter_hz: cut-off of the zero-phase filter that both pass for ``r2``; default: that of the fit.
        """
        motion, torque = recorded_motion(recording, self.cutoff_hz)
        predicted = self.predict(motion)
        cutoff = filter_hz or self.cutoff_hz
        smooth, smooth_predicted = (lowpass(x, motion.rate_hz, cutoff) for x in (torque, predicted))
        error = predicted - torque  # eq 3.1
        scores = []
        for j, joint in enumerate(self.robot.joints):
            scores.append(
                JointScore(
                    name=joint.name,
                    r2=share_predicted(smooth[:, j], smooth_predicted[:, j]),
                    r2_raw=share_predicted(torque[:, j], predicted[:, j]),
                    mean=float(error[:, j].mean()),
                    sd=float(error[:, j].std()),
                    rmse=float(np.sqrt((error[:, j] ** 2).mean())),
                )
            )
        return tuple(scores)


def identify_dynamics(
    recording: Recording,
    robot: Robot,
    *,
    cutoff_hz: float | None = None,
    couplings: Sequence[Sequence[tuple[int, float]]] = (),
) -> DynamicsFit:
    """Fit base inertial parameters, Coulomb and viscous friction, offsets and rotor inertia to recorded torque.

    Weighted least squares on the columns that the motion can tell apart; joints weigh by their own residuals. Columns
    and torque pass the same zero-phase filter, which changes nothing in a model that is linear in its parameters.
    Predictions leave out what the recording cannot tell from zero, where held-out fifths are predicted no worse so.

    Args:
        recording: with joint torques.
        robot: its kinematic chain; inertia it may have is not used.
        cutoff_hz: of the filter; default: the best of eight by the error on held-out fifths of the recording.
        couplings: joints that share a motor, numbered from 0 with their share of its speed: its friction and rotor act
            on all of them.

    Raises:
        InputError: no torque, too few rows, or a robot of another number of joints.
    """
    if recording.dof != robot.dof:
        raise InputError("recording", f"has {recording.dof} joints", f"{robot.name} has {robot.dof}")
    groups = tuple(tuple((int(j), float(share)) for j, share in group) for group in couplings)
    held_out: dict[float, float] = {}
    if cutoff_hz is None:
        rate = 1 / float(np.median(np.diff(recording.t)))
        reference = min(20.0, 0.15 * rate)
        for candidate in _CUTOFFS_HZ:
            if candidate <= 0.4 * rate:
                held_out[candidate] = _cross_validate(recording, robot, candidate, groups, reference)
        if not held_out:
            raise InputError("recording", f"{rate:.3g} rows a second", "wanted at least 5")
        # Of those that do as well as the best, the one that takes least away.
        least = min(held_out.values())
        cutoff_hz = max(candidate for candidate, share in held_out.items() if share <= _AS_GOOD * least)
    system = _System.of(recording, robot, cutoff_hz, groups, _best_shares(recording, robot, cutoff_hz, groups))
    return _with_essential(system, _solve(system, held_out))


def torque_columns(
    robot: Robot,
    motion: EvenMotion,
    sign_speed: FloatArray,
    couplings: Sequence[Sequence[tuple[int, float]]],
) -> FloatArray:
    """Columns of the model (N, n, parameters): inertial, then friction and rotor of joints, then of shared motors.

    ``sign_speed`` is that of :class:`DynamicsFit`.
    """
    n = robot.dof
    inertial = inertial_regressor(robot, motion.q, motion.qd, motion.qdd, GRAVITY)
    blocks = [inertial]
    groups = [*(((j, 1.0),) for j in range(n)), *couplings]
    for number, group in enumerate(groups):
        speed = sum(share * motion.qd[:, j] for j, share in group)
        acceleration = sum(share * motion.qdd[:, j] for j, share in group)
        scale = float(sign_speed[number] if number < sign_speed.size else np.mean([sign_speed[j] for j, _ in group]))
        shapes = [np.tanh(speed / scale), speed, acceleration]
        if len(group) == 1:
            shapes.append(np.ones_like(motion.t))
        block = np.zeros((motion.t.size, n, len(shapes)))
        for column, shape in enumerate(shapes):
            for j, share in group:
                block[:, j, column] = share * shape
        blocks.append(block)
    return np.concatenate(blocks, axis=2)


def column_names(robot: Robot, couplings: Sequence[Sequence[tuple[int, float]]]) -> list[str]:
    """Names of the columns of :func:`torque_columns`."""
    names = inertial_names(robot)
    for j in range(robot.dof):
        names += [f"coulomb_{j + 1}", f"viscous_{j + 1}", f"rotor_{j + 1}", f"offset_{j + 1}"]
    for number in range(len(couplings)):
        names += [f"{what}_shared_{number + 1}" for what in ("coulomb", "viscous", "rotor")]
    return names


@dataclass(frozen=True, eq=False)
class _System:
    """Torque columns of a recording, and what they should add up to."""

    robot: Robot
    couplings: tuple[tuple[tuple[int, float], ...], ...]
    cutoff_hz: float
    sign_speed: FloatArray
    rate_hz: float
    raw: FloatArray  # (N, n, parameters)
    columns: FloatArray  # the same, filtered
    torque: FloatArray  # (N, n)
    wanted: FloatArray  # the same, filtered

    @classmethod
    def of(
        cls,
        recording: Recording,
        robot: Robot,
        cutoff_hz: float,
        couplings: tuple[tuple[tuple[int, float], ...], ...],
        sign_shares: FloatArray | float = _SIGN_SHARES[0],
    ) -> _System:
        motion, torque = recorded_motion(recording, cutoff_hz)
        speeds = [*motion.qd.T, *(sum(share * motion.qd[:, j] for j, share in group) for group in couplings)]
        usual = np.array([np.sqrt(np.mean(speed**2)) for speed in speeds])
        sign_speed = np.maximum(sign_shares * usual, 1e-4)
        raw = torque_columns(robot, motion, sign_speed, couplings)
        columns, wanted = (lowpass(x, motion.rate_hz, FIT_PER_CUTOFF * cutoff_hz) for x in (raw, torque))
        return cls(robot, couplings, cutoff_hz, sign_speed, motion.rate_hz, raw, columns, torque, wanted)


def recorded_motion(recording: Recording, cutoff_hz: float) -> tuple[EvenMotion, FloatArray]:
    """The filtered motion of a recording, and its torques (N, n) at the same times."""
    if recording.tau is None:
        raise InputError("recording", f"{recording.source or 'it'} has no joint torque", "wanted tau_1 .. tau_n")
    motion = even_motion(recording.t, recording.q, recording.qd, cutoff_hz)
    return motion, onto(motion.t, recording.t, recording.tau)


def _cross_validate(
    recording: Recording,
    robot: Robot,
    cutoff_hz: float,
    couplings: tuple[tuple[tuple[int, float], ...], ...],
    reference_hz: float,
) -> float:
    """Mean over joints of 1 - R2 on fifths of the recording, each predicted from the other four.

    All cut-offs are judged by one and the same torque, filtered at ``reference_hz``.
    """
    system = _System.of(recording, robot, cutoff_hz, couplings)
    predicted, _ = _left_out(system, system.raw)
    measured, predicted = (lowpass(x, system.rate_hz, reference_hz) for x in (system.torque, predicted))
    return float(np.mean([1 - share_predicted(measured[:, j], predicted[:, j]) for j in range(robot.dof)]))


def _best_shares(
    recording: Recording,
    robot: Robot,
    cutoff_hz: float,
    couplings: tuple[tuple[tuple[int, float], ...], ...],
) -> FloatArray:
    """For each joint, then each shared motor, the width of the sign of friction that predicts held-out fifths best.

    All widths are tried together. A joint goes by its own error, a shared motor by the mean of its joints' shares of
    what they leave at the usual width.
    """
    errors = []
    for share in _SIGN_SHARES:
        system = _System.of(recording, robot, cutoff_hz, couplings, share)
        errors.append(((system.wanted - _left_out(system, system.columns)[0]) ** 2).mean(axis=0))
    own = np.array(errors) / np.maximum(errors[0], 1e-300)
    shared = [own[:, [j for j, _ in group]].mean(axis=1, keepdims=True) for group in couplings]
    ratios = np.concatenate([own, *shared], axis=1)
    best: FloatArray = np.array(_SIGN_SHARES)[np.argmin(ratios, axis=0)]
    # A gain that another motion would not show is no reason to leave the usual width.
    best[ratios.min(axis=0) > _CLEAR_GAIN] = _SIGN_SHARES[0]
    return best


def _left_out(system: _System, columns: FloatArray, *, essential: bool = False) -> tuple[FloatArray, FloatArray]:
    """Torque of every fifth of the rows as the other four predict it, from these columns (N, n).

    Returns:
        With all parameters; and without those that the other four cannot tell from zero, where ``essential`` asks for
        it, else the same again.
    """
    rows, joints = system.wanted.shape
    matrix, target, own = _weighted(system, _solve(system, {}))
    predicted, without = np.empty_like(system.torque), np.empty_like(system.torque)
    for part in np.array_split(np.arange(rows), _FOLDS):
        others = np.ones(rows, dtype=bool)
        others[part] = False
        known, wanted = matrix[others].reshape(-1, len(own)), target[others].ravel()
        values, *_ = np.linalg.lstsq(known, wanted, rcond=None)
        predicted[part] = without[part] = columns[part][:, :, own] @ values
        if essential:
            blocks = _blocks(wanted - known @ values, joints)
            without[part] = columns[part][:, :, own] @ essential_values(known, wanted, blocks)
    return predicted, without


def _weighted(system: _System, fit: DynamicsFit) -> tuple[FloatArray, FloatArray, list[int]]:
    """Columns of a fit (N, n, p) and what they should add up to (N, n), joints weighed; and the columns' numbers."""
    own = list(fit.columns)
    weight = 1 / np.maximum((system.wanted - system.columns[:, :, own] @ fit.values).std(axis=0), 1e-12)
    return system.columns[:, :, own] * weight[None, :, None], system.wanted * weight, own


def _with_essential(system: _System, fit: DynamicsFit) -> DynamicsFit:
    """The fit with the values that predict held-out fifths no worse, where those are the essential ones."""
    every, without = (
        ((system.wanted - predicted) ** 2).mean(axis=0)
        for predicted in _left_out(system, system.columns, essential=True)
    )
    if np.mean(without / np.maximum(every, 1e-300)) > 1:
        return fit
    matrix, target, own = _weighted(system, fit)
    matrix, wanted = matrix.reshape(-1, len(own)), target.ravel()
    blocks = _blocks(wanted - matrix @ fit.values, target.shape[1])
    return replace(fit, predicting=essential_values(matrix, wanted, blocks))


def _solve(system: _System, held_out: dict[float, float]) -> DynamicsFit:
    names = column_names(system.robot, system.couplings)
    columns, wanted = system.columns, system.wanted
    length = np.sqrt((columns**2).sum(axis=(0, 1)))
    seen = np.flatnonzero(length > 1e-9 * length.max())
    weight = 1 / np.maximum(wanted.std(axis=0), 1e-9)
    for _ in range(_ROUNDS):
        matrix = (columns[:, :, seen] * weight[None, :, None]).reshape(-1, seen.size)
        target = (wanted * weight).reshape(-1)
        chosen, groups = _independent(matrix)
        values, *_ = np.linalg.lstsq(matrix[:, chosen], target, rcond=None)
        residual = target - matrix[:, chosen] @ values
        weight = weight / np.maximum(residual.reshape(wanted.shape).std(axis=0), 1e-12)
    covariance = _covariance(matrix[:, chosen], residual, wanted.shape[1])
    return DynamicsFit(
        robot=system.robot,
        columns=tuple(int(seen[c]) for c in chosen),
        names=tuple(_label(names, seen, int(c), groups[i]) for i, c in enumerate(chosen)),
        values=values,
        standard_errors=np.sqrt(np.maximum(np.diag(covariance), 0.0)),
        sign_speed=system.sign_speed,
        couplings=system.couplings,
        cutoff_hz=system.cutoff_hz,
        held_out=held_out,
        unseen=tuple(name for i, name in enumerate(names) if i not in set(seen.tolist())),
        rows_used=wanted.shape[0],
        covariance=covariance,
    )


def _independent(matrix: FloatArray) -> tuple[np.ndarray, list[list[tuple[int, float]]]]:
    """Columns that the motion tells apart, and for each the others that move with it and by how much."""
    from scipy.linalg import qr, solve_triangular

    scale = np.linalg.norm(matrix, axis=0)
    triangle, order = qr(matrix / scale, mode="r", pivoting=True)
    diagonal = np.abs(np.diag(triangle))
    rank = int((diagonal > _DEPENDENT * diagonal[0]).sum())
    chosen, rest = order[:rank], order[rank:]
    groups: list[list[tuple[int, float]]] = [[] for _ in range(rank)]
    if rest.size:
        mixed = solve_triangular(triangle[:rank, :rank], triangle[:rank, rank:])
        mixed = mixed * scale[rest][None, :] / scale[chosen][:, None]
        for i in range(rank):
            groups[i] = [(int(c), float(k)) for c, k in zip(rest, mixed[i], strict=True) if abs(k) > 1e-3]
    return chosen, groups


def _label(names: list[str], seen: np.ndarray, column: int, group: list[tuple[int, float]]) -> str:
    return names[int(seen[column])] + "".join(
        f" {'+' if k > 0 else '-'} {abs(k):.4g} {names[int(seen[c])]}" for c, k in group
    )


def _covariance(matrix: FloatArray, residual: FloatArray, joints: int) -> FloatArray:
    """Covariance of the solution that holds where residuals are correlated in time and between joints.

    Cluster-robust: blocks of consecutive rows, long against the residuals' memory, count as independent (a sandwich of
    the blocks' scores).
    """
    blocks = _blocks(residual, joints)
    inverse = np.linalg.pinv(matrix.T @ matrix)
    meat = np.zeros_like(inverse)
    for block in blocks:
        score = matrix[block].T @ residual[block]
        meat += np.outer(score, score)
    covariance: FloatArray = inverse @ meat @ inverse * len(blocks) / (len(blocks) - 1)
    return covariance


def _blocks(residual: FloatArray, joints: int) -> list[slice]:
    """Runs of rows that are long against the memory of residuals (N * joints,), joints side by side."""
    rows = residual.size // joints
    memory = max(correlation_time(residual.reshape(rows, joints)[:, j]) for j in range(joints))
    number = max(8, min(rows // max(1, math.ceil(5 * memory)), 400))
    return [slice(part[0] * joints, (part[-1] + 1) * joints) for part in np.array_split(np.arange(rows), number)]


def share_predicted(measured: FloatArray, predicted: FloatArray) -> float:
    """R2: the share of a variance that is predicted; NaN where there is none."""
    spread = float(((measured - measured.mean()) ** 2).sum())
    return 1 - float(((measured - predicted) ** 2).sum()) / spread if spread > 0 else math.nan
