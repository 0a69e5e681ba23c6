"""Columns of the torque that an arm's inertia, friction and rotors make."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.motion import GRAVITY, EvenMotion
from bumpstop.identification.regressor import inertial_names, inertial_regressor, inertial_torque

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.model import Robot

    Couplings = Sequence[Sequence[tuple[int, float]]]

# Rows whose columns are held at once.
_AT_ONCE = 10_000


def torque_columns(
    robot: Robot,
    motion: EvenMotion,
    sign_speed: FloatArray,
    couplings: Couplings,
    top_speed: FloatArray | None = None,
    *,
    inertial: FloatArray | None = None,
) -> FloatArray:
    """Columns of the model (N, n, parameters), in the order of :func:`column_names`.

    Friction bends with the square root of the speed where ``top_speed`` is given. The straight line that is nearest to
    the root between rest and top speed is taken out of that column, sqrt(u) - 4/15 - 4 u/5 with u the speed as a share
    of the top speed, so that Coulomb and viscous friction mean what they mean without it. Above the top speed it stays
    as it is there.

    Args:
        robot: its chain.
        motion: on an even grid.
        sign_speed: speed over which Coulomb friction turns, as in :class:`DynamicsFit`.
        couplings: joints that share a motor.
        top_speed: (n + shared motors,) of joints, then of shared motors; None: friction is straight.
        inertial: columns of the inertial parameters where they are known already.
    """
    n = robot.dof
    if inertial is None:
        inertial = inertial_regressor(robot, motion.q, motion.qd, motion.qdd, GRAVITY)
    blocks, bends = [inertial], []
    groups = [*(((j, 1.0),) for j in range(n)), *couplings]
    for number, group in enumerate(groups):
        speed = np.sum([share * motion.qd[:, j] for j, share in group], axis=0)
        acceleration = np.sum([share * motion.qdd[:, j] for j, share in group], axis=0)
        scale = float(sign_speed[number] if number < sign_speed.size else np.mean([sign_speed[j] for j, _ in group]))
        sign = np.tanh(speed / scale)
        shapes = [sign, speed, acceleration]
        if len(group) == 1:
            shapes.append(np.ones_like(motion.t))
        blocks.append(_acting_on(group, shapes, n))
        if top_speed is not None:
            share_of_top = np.minimum(np.abs(speed) / top_speed[number], 1.0)
            bend = sign * (np.sqrt(share_of_top) - 4 / 15 - 0.8 * share_of_top)
            bends.append(_acting_on(group, [bend], n))
    return np.concatenate(blocks + bends, axis=2)


def torque_of(
    robot: Robot,
    motion: EvenMotion,
    values: FloatArray,
    sign_speed: FloatArray,
    couplings: Couplings,
    top_speed: FloatArray | None = None,
) -> FloatArray:
    """Torque (N, n) that values (parameters,) of all columns make: their sum, without ever holding the columns.

    Other arguments as for :func:`torque_columns`.
    """
    count = 10 * robot.dof
    torque = inertial_torque(robot, motion.q, motion.qd, motion.qdd, GRAVITY, values[:count])
    for start in range(0, motion.t.size, _AT_ONCE):
        rows = slice(start, start + _AT_ONCE)
        part = motion.part(rows)
        none = np.empty((part.t.size, robot.dof, 0))
        columns = torque_columns(robot, part, sign_speed, couplings, top_speed, inertial=none)
        torque[rows] += columns @ values[count:]
    return torque


def _acting_on(group: Sequence[tuple[int, float]], shapes: Sequence[FloatArray], dof: int) -> FloatArray:
    """Columns (N, dof, len(shapes)) of what acts on the joints of a group with their shares."""
    block = np.zeros((shapes[0].size, dof, len(shapes)))
    for column, shape in enumerate(shapes):
        for j, share in group:
            block[:, j, column] = share * shape
    return block


def column_names(robot: Robot, couplings: Couplings, *, bent: bool = False) -> list[str]:
    """Names of the columns of :func:`torque_columns`; ``bent``: with those of friction that bends."""
    names = inertial_names(robot)
    for j in range(robot.dof):
        names += [f"coulomb_{j + 1}", f"viscous_{j + 1}", f"rotor_{j + 1}", f"offset_{j + 1}"]
    shared = [f"shared_{number + 1}" for number in range(len(couplings))]
    for name in shared:
        names += [f"{what}_{name}" for what in ("coulomb", "viscous", "rotor")]
    if bent:
        names += [f"bend_{name}" for name in (*map(str, range(1, robot.dof + 1)), *shared)]
    return names


def speeds_of(motion: EvenMotion, couplings: Couplings) -> FloatArray:
    """Speeds (N, n + shared motors) of joints, then of shared motors."""
    shared = [np.asarray(sum(share * motion.qd[:, j] for j, share in group)) for group in couplings]
    return np.column_stack([motion.qd, *shared])
