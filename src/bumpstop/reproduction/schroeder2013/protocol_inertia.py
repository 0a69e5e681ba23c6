"""Reflected inertia of a joint, from the ramps between strokes (Schroeder 2013, eqs 2.32 and 2.33)."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.joint.parameters import Parameter
from bumpstop.reproduction.schroeder2013.protocol_steps import cluster_covariance, joint_torque, widened

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.reproduction.schroeder2013.constant_velocity import Segment
    from bumpstop.reproduction.schroeder2013.protocol_friction import FrictionFit
    from bumpstop.reproduction.schroeder2013.protocol_steps import MapFit

# A ramp shows its acceleration where it lasts this long, several windows of the derivatives [s].
_MIN_RAMP_S = 0.35


@dataclass(frozen=True, eq=False)
class InertiaFit:
    """Eq 2.33: torque that the map gives beyond Newton and Euler's, against acceleration.

    Attributes:
        inertia: slope [kg m2].
        r2: of that line.
        acceleration, torque: the rows (N,), torque minus what goes with friction and load [rad/s2, Nm].
    """

    inertia: Parameter
    r2: float
    acceleration: FloatArray
    torque: FloatArray


def fit_inertia(found: MapFit, friction: FrictionFit, ramps: Sequence[Segment], slowest: float) -> InertiaFit | None:
    """Eqs 2.32 and 2.33 over the ramps. None: no ramp is long enough.

    Beside acceleration stand the sign of the motion and the predicted torque: they take up what friction and map leave.
    The standard error is that of whole strokes, with what map and friction themselves are uncertain by.
    """
    rows, clusters = [], []
    for k, ramp in enumerate(ramps):
        speed = np.abs(ramp.qd)
        moving = speed > slowest
        peak = float(np.abs(ramp.qdd).max())
        if moving.sum() < 5 or 1.5 * speed.max() < _MIN_RAMP_S * peak:
            continue
        rows.append(np.column_stack([ramp.current, ramp.qd, ramp.qdd, ramp.torque])[moving])
        clusters.append(np.full(int(moving.sum()), k))
    if len(rows) < 2:
        return None
    table, cluster = np.concatenate(rows), np.concatenate(clusters)
    values = np.concatenate([[found.A.value, found.B.value], friction.values])
    y, matrix, slopes = _inertia_line(found.kind, friction, values, table)
    left = y - matrix @ slopes
    by_ramps, freedom = cluster_covariance(matrix, left, np.flatnonzero(np.diff(cluster, prepend=-1)))
    variance = float(by_ramps[0, 0])
    squares = variance**2 / freedom[0]
    for at, covariance, own in (
        (slice(0, 2), found.covariance, found.freedom),
        (slice(2, values.size), friction.covariance, friction.freedom),
    ):
        gradient = np.zeros(covariance.shape[0])
        for k, error in enumerate(np.sqrt(np.maximum(np.diag(covariance), 0.0))):
            if error > 0:
                moved = values.copy()
                moved[at.start + k] += error
                gradient[k] = (_inertia_line(found.kind, friction, moved, table)[2][0] - slopes[0]) / error
        more = max(0.0, float(gradient @ covariance @ gradient))
        variance += more
        squares += more**2 / own
    shown = y - matrix[:, 1:] @ slopes[1:]
    spread = float(((shown - shown.mean()) ** 2).sum())
    r2 = 1 - float((left**2).sum()) / spread if spread > 0 else 0.0
    error = widened(variance, variance**2 / squares if squares > 0 else np.inf)
    return InertiaFit(Parameter(float(slopes[0]), error), r2, matrix[:, 0], shown)


def _inertia_line(
    kind: str, friction: FrictionFit, values: FloatArray, table: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Left side of eq 2.32 (N,), columns (N, 3), and the slopes."""
    current, qd, qdd, torque = table.T
    sign = np.sign(qd)
    own = current - friction.current(qd, current, values[2:])
    beyond = joint_torque(kind, values[0], values[1], own, sign) - torque
    matrix = np.column_stack([qdd, sign, torque])
    return beyond, matrix, np.linalg.pinv(matrix.T @ matrix) @ (matrix.T @ beyond)
