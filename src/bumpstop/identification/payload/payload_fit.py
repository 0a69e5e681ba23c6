"""What an arm of known inertia carries, from its joint torques or from currents and a joint torque model."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.dynamics.regressor import INERTIAL, link_regressor
from bumpstop.identification.segments.drive_samples import stretches_of, without_rotors
from bumpstop.identification.segments.motion import GRAVITY, MIN_ROWS, EvenMotion, even_motion, lowpass, onto
from bumpstop.identification.statistics.held_out import held_out_share
from bumpstop.identification.statistics.independent_columns import condition_of
from bumpstop.identification.statistics.robust_fit import long_run_covariance, visible_share
from bumpstop.model.inertia import vector3
from bumpstop.signal import correlation_time

if TYPE_CHECKING:
    from bumpstop.identification.dynamics.dynamics_fit import DynamicsFit
    from bumpstop.identification.payload.payload import Payload
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Columns that the others make up to this share of their length are not seen.
_DEPENDENT = 1e-3
_ROUNDING = 1e-9  # of the longest column
_HEAVIEST = 10_000.0  # [kg]
# Nor are those known no better than to a kilogram, or the payload's own mass, at this distance from the tip [m].
_ARM = 0.1
_ROUNDS = 4  # of the joints' weights, and of a point mass's second moments
_WINDOW = 4.0  # of the long-run covariance, in correlation times
# Torques are compared after a filter at this many times the motion's cut-off.
_FIT_PER_CUTOFF = 2.0
_MIN_PERIODS = 4.0  # of the cut-off, that a stretch between gaps lasts


@dataclass(frozen=True, kw_only=True, eq=False)
class PayloadFit:
    """A payload at the tip; what the motion cannot show is None.

    Attributes:
        values: by name: ``m`` [kg], ``mx my mz`` [kg m] and, if asked for, ``Ixx Iyy Izz Ixy Ixz Iyz`` [kg m2]
            about the origin of the tip, in its frame.
        standard_errors: likewise; they hold under residuals correlated in time and between joints.
        center: of mass in the frame of the tip [m], or None.
        center_errors: standard errors of ``center``, or None.
        unseen: names of what the motion cannot show.
        joints_left_out: joints whose torque is unknown.
        rows_used: of the fit.
        rows_left: recorded rows left away: in stretches between gaps too short to use, or within a period of the
            cut-off of their ends.
        joints: names of the others, by which the payload was found.
        t: (N,) of the rows that were compared [s].
        wanted: (N, joints) torque that the arm without payload does not explain, filtered [Nm or N].
        explained: (N, joints) what the payload explains of it; where torques were recorded, what friction and offsets
            explain is taken from ``wanted``.
        condition: condition number of the weighted columns, each brought to length one.
        unexplained: share of the torque's variance beyond the arm's that is left on held-out fifths of the rows.
    """

    values: dict[str, float | None]
    standard_errors: dict[str, float | None]
    center: tuple[float, float, float] | None
    center_errors: tuple[float, float, float] | None
    unseen: tuple[str, ...]
    joints_left_out: tuple[str, ...]
    rows_used: int
    rows_left: int
    joints: tuple[str, ...]
    t: FloatArray
    wanted: FloatArray
    explained: FloatArray
    condition: float | None = None
    unexplained: float | None = None

    @property
    def rmse(self) -> FloatArray:
        """Root mean square of what the payload leaves (joints,) [Nm or N]."""
        return np.asarray(np.sqrt(((self.wanted - self.explained) ** 2).mean(axis=0)))

    @property
    def rmse_without(self) -> FloatArray:
        """The same where nothing is carried (joints,) [Nm or N]."""
        return np.asarray(np.sqrt((self.wanted**2).mean(axis=0)))


def identify_payload(
    recording: Recording,
    robot: Robot,
    *,
    model: JointTorqueModel | None = None,
    dynamics: DynamicsFit | None = None,
    mass: float | None = None,
    inertia: bool = False,
    cutoff_hz: float | None = None,
    gravity: tuple[float, float, float] | None = None,
) -> PayloadFit:
    """Fit mass and first moments of a payload at the tip, by weighted least squares.

    From currents the joint model takes away friction. Fitted dynamics take away all that the arm makes without payload,
    its friction too, and need no inertia of the robot; an offset of every joint is fitted beside the payload. From
    recorded torques alone Coulomb and viscous friction and an offset of every joint are fitted beside the payload; the
    offset takes what a pose that never changes would show.

    Args:
        recording: with currents, if a model is given, else with torques.
        robot: without payload, with inertia.
        model: joint torque model of this robot, fitted without payload or with the payload declared.
        dynamics: fit of this robot without payload, in place of its inertia and of a joint model.
        mass: of the payload where it is known [kg]; then only its centre is looked for.
        inertia: fit second moments, too; without, those of a point mass are taken.
        cutoff_hz: of the motion's filter; default: 5, or a tenth of the recorded rate where that is less.
        gravity: acceleration of free fall in the base frame [m/s2]; default: that of the dynamics, else along -z.

    Raises:
        InputError: both a model and dynamics, a mass that no payload has, no currents or torques, another number of
            joints, too few rows, no joint whose torque is known.
    """
    recording.check_robot(robot)
    if model is not None and dynamics is not None:
        raise InputError("model", "is given beside dynamics", "wanted one of them: both say the arm's friction")
    if mass is not None and not 0 < mass < _HEAVIEST:
        raise InputError("mass", f"is {mass:g} kg", f"wanted above 0 and below {_HEAVIEST:g}")
    if gravity is None:
        gravity = GRAVITY if dynamics is None else dynamics.gravity
    cutoff = min(5.0, 0.1 * recording.rate_hz) if cutoff_hz is None else cutoff_hz
    parts, left = _parts(recording, cutoff)
    motions = [replace(even_motion(part.t, part.q, part.qd, cutoff), gravity=gravity) for part in parts]
    torques = [_bare_torque(part, robot, model, dynamics, own) for part, own in zip(parts, motions, strict=True)]
    known = torques[0][1]
    q, qd, qdd = (np.concatenate([getattr(own, name) for own in motions]) for name in ("q", "qd", "qdd"))
    payload = link_regressor(robot, q, qd, qdd, gravity, robot.dof - 1) @ _tip_to_link(robot)
    if dynamics is not None:
        nuisance = np.tile(np.eye(robot.dof)[None], (len(qd), 1, 1))
    else:
        nuisance = _friction(qd) if model is None else np.zeros((len(qd), robot.dof, 0))
    ends = np.cumsum([own.t.size for own in motions])[:-1]
    inside = [_inside(own.t, cutoff) for own in motions]

    def filtered(x: FloatArray) -> FloatArray:
        """Each stretch by itself, without its ends."""
        return np.concatenate(
            [
                lowpass(part, own.rate_hz, _FIT_PER_CUTOFF * cutoff)[rows]
                for part, own, rows in zip(np.split(x[:, known], ends), motions, inside, strict=True)
            ]
        )

    t = np.concatenate([own.t[rows] for own, rows in zip(motions, inside, strict=True)])
    bare = np.concatenate([torque for torque, _ in torques])
    wanted, seen_by, others = filtered(bare), filtered(payload), filtered(nuisance)
    count = 10 if inertia else 4
    # What no joint feels is rounding, and would become huge.
    size = np.linalg.norm(seen_by[:, :, :count].reshape(-1, count), axis=0)
    seen_by[:, :, :count][:, :, size < _ROUNDING * size.max()] = 0.0
    point = np.zeros(6)
    weight = 1 / np.maximum(wanted.std(axis=0), 1e-9)
    for _ in range(_ROUNDS):
        target = wanted - (0.0 if inertia else seen_by[:, :, 4:] @ point)
        columns = np.concatenate([seen_by[:, :, :count], others], axis=2) * weight[None, :, None]
        if mass is not None:  # its column is known: it goes to the other side
            target = target - seen_by[:, :, 0] * mass
            columns[:, :, 0] = 0.0
        flat = columns.reshape(-1, columns.shape[2])
        length = np.maximum(np.linalg.norm(flat, axis=0), 1e-300)
        solution = np.linalg.lstsq(flat / length, (target * weight).ravel(), rcond=1e-9)[0] / length
        residual = target * weight - columns @ solution
        if not inertia:
            first = np.where(visible_share(flat)[:4] > _DEPENDENT, solution[:4], 0.0)
            first[0] = first[0] if mass is None else mass
            point = _point_moments(first)
        weight = weight / np.maximum(residual.std(axis=0), 1e-12)
    weight_columns = columns / np.maximum(residual.std(axis=0), 1e-12)[None, :, None]
    residual = residual / np.maximum(residual.std(axis=0), 1e-12)
    covariance = _covariance(weight_columns, residual)
    shares = visible_share(flat)[:count]
    if mass is not None:
        solution[0], shares[0], covariance[0], covariance[:, 0] = mass, 1.0, 0.0, 0.0
    names = INERTIAL[:count]
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))[:count]
    enough = max(1.0, float(solution[0])) * np.array([1.0] + [_ARM] * 3 + [_ARM**2] * 6)[:count]
    seen = (shares > _DEPENDENT) & (spread < enough)
    values = {name: float(solution[i]) if seen[i] else None for i, name in enumerate(names)}
    errors = {name: float(spread[i]) if seen[i] else None for i, name in enumerate(names)}
    center, center_errors = _center(solution[:4], covariance[:4, :4]) if seen[:4].all() else (None, None)
    friction = others @ solution[count:]
    explained = seen_by[:, :, :count] @ solution[:count] + (0.0 if inertia else seen_by[:, :, 4:] @ point)
    left_out = tuple(joint.name for joint, own in zip(robot.joints, known, strict=True) if not own)
    return PayloadFit(
        values=values,
        standard_errors=errors,
        center=center,
        center_errors=center_errors,
        unseen=tuple(name for i, name in enumerate(names) if not seen[i]),
        joints_left_out=left_out,
        rows_used=t.size,
        rows_left=left,
        joints=tuple(joint.name for joint in robot.joints if joint.name not in left_out),
        t=t,
        wanted=wanted - friction,
        explained=explained,
        condition=condition_of(weight_columns.reshape(-1, weight_columns.shape[2])),
        unexplained=held_out_share(weight_columns, residual + weight_columns @ solution),
    )


def _parts(recording: Recording, cutoff_hz: float) -> tuple[list[Recording], int]:
    """Stretches between gaps that are long enough, and how many recorded rows are left away in all.

    At either end of a stretch, within a period of the cut-off, the filter knows one side of the motion only: the torque
    that an arm which moves there seems to want is off by several times the noise.
    """
    found, used = [], 0
    for rows in stretches_of(recording.t):
        t = recording.t[rows]
        if t.size >= MIN_ROWS and t[-1] - t[0] >= _MIN_PERIODS / cutoff_hz:
            found.append(recording.between(float(t[0]), float(t[-1])))
            used += int(np.count_nonzero(_inside(t, cutoff_hz)))
    if not found:
        problem = f"has no {MIN_ROWS} rows and {_MIN_PERIODS / cutoff_hz:.3g} s without a gap"
        raise InputError("recording", problem, "record for longer, or give a higher cut-off")
    return found, recording.t.size - used


def _inside(t: FloatArray, cutoff_hz: float) -> npt.NDArray[np.bool_]:
    """Which of rising times (N,) lie a period of the cut-off inside both ends."""
    inside: npt.NDArray[np.bool_] = (t >= t[0] + 1 / cutoff_hz) & (t <= t[-1] - 1 / cutoff_hz)
    return inside


def _bare_torque(
    recording: Recording,
    robot: Robot,
    model: JointTorqueModel | None,
    dynamics: DynamicsFit | None,
    motion: EvenMotion,
) -> tuple[FloatArray, npt.NDArray[np.bool_]]:
    """Torque that the arm without payload does not explain (N, n), and the joints where it is known."""
    from bumpstop.model import inverse_dynamics

    if dynamics is not None:
        if len(dynamics.robot.joints) != robot.dof:
            raise InputError("dynamics", f"has {len(dynamics.robot.joints)} joints", f"{robot.name} has {robot.dof}")
        errors = np.zeros(robot.dof) if dynamics.gain_errors is None else dynamics.gain_errors
        return torque_of_recording(recording, motion.t, dynamics.gains) - dynamics.predict(motion), np.isfinite(errors)
    if model is None:
        if recording.tau is None:
            raise InputError(
                "recording", "has no joint torque", "wanted tau_1 .. tau_n, or currents with a joint model"
            )
        own = inverse_dynamics(robot, motion.q, motion.qd, motion.qdd, gravity=motion.gravity)
        return onto(motion.t, recording.t, recording.tau) - own, np.ones(robot.dof, dtype=bool)
    if recording.current is None:
        raise InputError("recording", "has no motor current", "wanted current_1 ..")
    if len(model.joints) != robot.dof:
        raise InputError("model", f"has {len(model.joints)} joints", f"{robot.name} has {robot.dof}")
    known = np.array([joint.parameters["B"] is not None for joint in model.joints])
    if not known.any():
        raise InputError("model", "knows the gain of no joint", "wanted at least one")
    torque = model.torque(onto(motion.t, recording.t, recording.current), motion.qd, motion.qdd)
    return np.where(known, torque, 0.0) - inverse_dynamics(
        without_rotors(robot), motion.q, motion.qd, motion.qdd, gravity=motion.gravity
    ), known


def torque_of_recording(recording: Recording, t: FloatArray, gains: FloatArray | None) -> FloatArray:
    """Recorded torque (N, n) at the times of a grid, or the currents times the gains where there is none [Nm or N]."""
    if recording.tau is not None:
        return onto(t, recording.t, recording.tau)
    if gains is None or recording.current is None:
        raise InputError(
            "recording", "has no joint torque", "wanted tau_1 .. tau_n, or currents with dynamics that know gains"
        )
    return onto(t, recording.t, recording.current * gains)


def _friction(qd: FloatArray) -> FloatArray:
    """Columns (N, n, 3 n) of Coulomb and viscous friction and an offset of each joint."""
    rows, n = qd.shape
    columns = np.zeros((rows, n, 3 * n))
    for j in range(n):
        width = max(0.03 * float(np.sqrt((qd[:, j] ** 2).mean())), 1e-6)
        columns[:, j, 3 * j : 3 * j + 3] = np.stack([np.tanh(qd[:, j] / width), qd[:, j], np.ones(rows)], axis=1)
    return columns


def payload_torque(robot: Robot, payload: Payload, motion: EvenMotion) -> FloatArray:
    """Torque (N, n) that a payload at the tip adds to a motion [Nm or N]."""
    center = np.asarray(payload.center)
    first = payload.mass * np.array([1.0, *center])
    parameters = _tip_to_link(robot) @ np.concatenate([first, _point_moments(first)])
    torque: FloatArray = (
        link_regressor(robot, motion.q, motion.qd, motion.qdd, motion.gravity, robot.dof - 1) @ parameters
    )
    return torque


def _tip_to_link(robot: Robot) -> FloatArray:
    """Matrix (10, 10) from inertial parameters in the frame of the tip to those in the frame of the last link."""
    X = np.eye(4)
    X[:3, :3], X[:3, 3] = np.asarray(robot.tip_rotation), robot.tip_origin
    return np.stack([parameters_of(X @ pseudo_inertia(unit) @ X.T) for unit in np.eye(10)], axis=1)


def pseudo_inertia(parameters: FloatArray) -> FloatArray:
    """Second moments of mass of a body as a 4 x 4 matrix (Wensing, Kim and Slotine 2018), positive definite for a body.

    Args:
        parameters: (10,) m, mx, my, mz, Ixx, Iyy, Izz, Ixy, Ixz, Iyz about the origin.
    """
    m, x, y, z, xx, yy, zz, xy, xz, yz = parameters
    tensor = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    matrix = np.empty((4, 4))
    matrix[:3, :3] = 0.5 * np.trace(tensor) * np.eye(3) - tensor
    matrix[:3, 3] = matrix[3, :3] = x, y, z
    matrix[3, 3] = m
    return matrix


def parameters_of(matrix: FloatArray) -> FloatArray:
    """The parameters (10,) of a pseudo-inertia (4, 4)."""
    spread = matrix[:3, :3]
    tensor = np.trace(spread) * np.eye(3) - spread
    return np.array([matrix[3, 3], *matrix[:3, 3], *np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]])


def _point_moments(first: FloatArray) -> FloatArray:
    """Second moments (6,) of a point with this mass and these first moments (4,)."""
    mass, moment = first[0], first[1:]
    if not mass > 0:
        return np.zeros(6)
    tensor = (moment @ moment * np.eye(3) - np.outer(moment, moment)) / mass
    return np.array([*np.diag(tensor), tensor[0, 1], tensor[0, 2], tensor[1, 2]])


def _covariance(columns: FloatArray, residual: FloatArray) -> FloatArray:
    """Covariance of a least-squares solution whose residuals (N, n) are correlated in time and between joints."""
    rows = residual.shape[0]
    flat = columns.reshape(-1, columns.shape[2])
    inverse = np.linalg.pinv(flat.T @ flat, hermitian=True)
    memory = max(correlation_time(residual[:, j]) for j in range(residual.shape[1]))
    window = min(math.ceil(_WINDOW * memory), rows // 3)
    scores = np.einsum("tjk,tj->tk", columns, residual)
    lost = (1 - 0.5 / _WINDOW) * (1 - window / rows)
    covariance: FloatArray = inverse @ long_run_covariance(scores, window) @ inverse / lost
    return covariance


def _center(
    first: FloatArray, covariance: FloatArray
) -> tuple[tuple[float, float, float], tuple[float, float, float]] | tuple[None, None]:
    """Centre of mass and its standard errors; none of a mass that could as well be nothing."""
    mass = float(first[0])
    if mass < 2 * math.sqrt(max(float(covariance[0, 0]), 0.0)):
        return None, None
    center = first[1:] / mass
    turn = np.concatenate([-center[:, None], np.eye(3)], axis=1) / mass
    errors = np.sqrt(np.maximum(np.diag(turn @ covariance @ turn.T), 0.0))
    return vector3(center), vector3(errors)
