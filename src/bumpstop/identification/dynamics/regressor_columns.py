"""Columns of the torque that an arm's inertia, friction and rotors make."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.dynamics.regressor import inertial_names, inertial_regressor, inertial_torque
from bumpstop.identification.segments.motion import UniformMotion
from bumpstop.model import unit_of

if TYPE_CHECKING:
    from collections.abc import Mapping, Sequence

    from bumpstop.model import Robot

    Couplings = Sequence[Sequence[tuple[int, float]]]

# Of what is a joint's own: where it turns, and where it slides.
_UNITS = {
    "coulomb": ("Nm", "N"),
    "viscous": ("Nm s/rad", "N s/m"),
    "rotor": ("kg m2", "kg"),
    "offset": ("Nm", "N"),
    "bend": ("Nm", "N"),
    "load": ("1", "1"),
}
BEND_AT_REST = -4 / 15
"""Value of the column of a bend at speed 0."""
# Rows whose columns are held at once.
_AT_ONCE = 10_000


def regressor_columns(
    robot: Robot,
    motion: UniformMotion,
    signs: FloatArray,
    couplings: Couplings,
    top_speed: FloatArray | None = None,
    *,
    loads: Mapping[int, FloatArray] | None = None,
    inertial: FloatArray | None = None,
) -> FloatArray:
    """Columns of the model (N, n, parameters), in the order of :func:`column_names`.

    Friction bends with the square root of the speed where ``top_speed`` is given for a joint or motor. The straight
    line that is nearest to the root between rest and top speed is taken out of that column, sqrt(u) - 4/15 - 4 u/5 with
    u the speed as a share of the top speed, so that Coulomb and viscous friction mean what they mean without it. Above
    the top speed it stays as it is there. Friction that grows with the load is a share of the torque that loads the
    gear, against the motion.

    Args:
        robot: its chain.
        motion: on an even grid.
        signs: (N, n + shared motors) of Coulomb friction, of :func:`coulomb_signs`.
        couplings: joints that share a motor.
        top_speed: (n + shared motors,) of joints, then of shared motors; NaN where friction is straight; None: it is
            everywhere.
        loads: torque (N,) that loads the gear, of joints (from 0) whose friction grows with it; default: none.
        inertial: columns of the inertial parameters where they are known already.
    """
    n = robot.dof
    if inertial is None:
        inertial = inertial_regressor(robot, motion.q, motion.qd, motion.qdd, motion.gravity)
    blocks, bends = [inertial], []
    groups = [*(((j, 1.0),) for j in range(n)), *couplings]
    for number, group in enumerate(groups):
        speed = np.sum([share * motion.qd[:, j] for j, share in group], axis=0)
        acceleration = np.sum([share * motion.qdd[:, j] for j, share in group], axis=0)
        sign = signs[:, number]
        shapes = [sign, speed, acceleration]
        if len(group) == 1:
            shapes.append(np.ones_like(motion.t))
        blocks.append(_acting_on(group, shapes, n))
        if top_speed is not None and np.isfinite(top_speed[number]):
            share_of_top = np.minimum(np.abs(speed) / top_speed[number], 1.0)
            bend = sign * (np.sqrt(share_of_top) + BEND_AT_REST - 0.8 * share_of_top)
            bends.append(_acting_on(group, [bend], n))
    for j, load in sorted((loads or {}).items()):
        bends.append(_acting_on(groups[j], [signs[:, j] * np.abs(load)], n))
    return np.concatenate(blocks + bends, axis=2)


def torque_of(
    robot: Robot,
    motion: UniformMotion,
    values: FloatArray,
    signs: FloatArray,
    couplings: Couplings,
    top_speed: FloatArray | None = None,
    loads: Mapping[int, FloatArray] | None = None,
) -> FloatArray:
    """Torque (N, n) that values (parameters,) of all columns make: their sum, without ever holding the columns.

    Other arguments as for :func:`regressor_columns`.
    """
    count = 10 * robot.dof
    torque = inertial_torque(robot, motion.q, motion.qd, motion.qdd, motion.gravity, values[:count])
    for start in range(0, motion.t.size, _AT_ONCE):
        rows = slice(start, start + _AT_ONCE)
        part = motion.part(rows)
        none = np.empty((part.t.size, robot.dof, 0))
        own = {j: load[rows] for j, load in (loads or {}).items()}
        columns = regressor_columns(robot, part, signs[rows], couplings, top_speed, loads=own, inertial=none)
        torque[rows] += columns @ values[count:]
    return torque


def _acting_on(group: Sequence[tuple[int, float]], shapes: Sequence[FloatArray], dof: int) -> FloatArray:
    """Columns (N, dof, len(shapes)) of what acts on the joints of a group with their shares."""
    block = np.zeros((shapes[0].size, dof, len(shapes)))
    for column, shape in enumerate(shapes):
        for j, share in group:
            block[:, j, column] = share * shape
    return block


def column_names(
    robot: Robot, couplings: Couplings, top_speed: FloatArray | None = None, loaded: Sequence[int] = ()
) -> list[str]:
    """Names of the columns of :func:`regressor_columns`; ``loaded``: joints (from 0) whose friction grows with load."""
    names = inertial_names(robot)
    for j in range(robot.dof):
        names += [f"coulomb_{j + 1}", f"viscous_{j + 1}", f"rotor_{j + 1}", f"offset_{j + 1}"]
    shared = [f"shared_{number + 1}" for number in range(len(couplings))]
    for name in shared:
        names += [f"{what}_{name}" for what in ("coulomb", "viscous", "rotor")]
    if top_speed is not None:
        owners = (*map(str, range(1, robot.dof + 1)), *shared)
        names += [f"bend_{name}" for name, top in zip(owners, top_speed, strict=True) if np.isfinite(top)]
    return [*names, *(f"load_{j + 1}" for j in sorted(loaded))]


def column_unit(name: str, robot: Robot, couplings: Couplings = ()) -> str:
    """Unit of the parameter of a column of :func:`column_names`."""
    what, _, owner = name.partition("_")
    if what not in _UNITS:
        return "kg" if what == "m" else "kg m" if len(what) == 2 else "kg m2"
    shared = owner.startswith("shared_")
    number = couplings[int(owner.removeprefix("shared_")) - 1][0][0] if shared else int(owner) - 1
    turning, sliding = _UNITS[what]
    return unit_of(robot.joints[number], turning=turning, sliding=sliding)


def speeds_of(motion: UniformMotion, couplings: Couplings) -> FloatArray:
    """Speeds (N, n + shared motors) of joints, then of shared motors."""
    shared = [np.asarray(sum(share * motion.qd[:, j] for j, share in group)) for group in couplings]
    return np.column_stack([motion.qd, *shared])


def checked_group(group: Sequence[tuple[int, float]], dof: int) -> tuple[tuple[int, float], ...]:
    """A shared motor: two joints or more, each once and with a share; (joint from 0, share) pairs.

    Raises:
        InputError: it is none of a robot with ``dof`` joints.
    """
    made = tuple((int(j), float(share)) for j, share in group)
    joints = [j for j, _ in made]
    usable = all(0 <= j < dof and share != 0 and math.isfinite(share) for j, share in made)
    if not usable or len(joints) < 2 or len(set(joints)) < len(joints):
        told = ",".join(f"{j + 1}:{share:g}" for j, share in made)
        valid = f"for example 5,6 or 5:1,6:-1, two joints or more; joints are 1 to {dof}"
        raise InputError("couplings", f"{told!r} cannot be used", valid)
    return made
