"""Segments of a recording in which one joint turns at constant speed, is held, or speeds up."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.model import inverse_dynamics
from bumpstop.signal import derivatives

if TYPE_CHECKING:
    from bumpstop.identification.design.plan import IdentificationPlan, JointExperiment
    from bumpstop.recording import Recording

_WINDOW_S = 0.12  # of the derivatives
_SPEED_SHARE, _MIN_SPEED = 0.04, 0.006  # how far a constant speed may be from the planned one: share, and rad/s
_STEADY = 0.2  # acceleration at constant speed, as a share of the stroke's largest
_STILL = 0.01  # speed below which a joint stands [rad/s]
_NEAR_POSE = math.radians(3.0)
_PIECE_S = 0.1  # of a ramp
_MIN_ROWS = 20
_MIN_WAY = 0.1  # share of the stroke that a segment must cover
_GAP_S = 0.5  # a longer one ends a segment
_BEFORE_MOTION_S = 0.5  # at the end of a hold the joint may begin to move
_SETTLED = 0.5  # share of a hold after which the current has settled


@dataclass(frozen=True, eq=False)
class Segment:
    """Rows of one joint in which one thing happens.

    Attributes:
        kind: ``"constant"``, ``"ramp"`` or ``"hold"``.
        speed: planned speed with its sign [rad/s]; of a hold the sign of the motion before, 1 or -1.
        t: (N,) [s].
        current: (N,) of the motor [current].
        torque: (N,) of Newton and Euler, without reflected inertia [Nm].
        qd, qdd: (N,) [rad/s, rad/s2].
    """

    kind: str
    speed: float
    t: FloatArray
    current: FloatArray
    torque: FloatArray
    qd: FloatArray
    qdd: FloatArray


@dataclass(frozen=True, eq=False)
class Cut:
    """What recordings hold of one experiment.

    Attributes:
        constant, ramps, holds: the segments.
        fastest_seen: speed of the joint alone in its pose [rad/s]; 0: it never moved alone there.
        pose_missed: how far the other joint that is farthest from the planned pose is, at the nearest row [rad or m].
    """

    constant: tuple[Segment, ...]
    ramps: tuple[Segment, ...]
    holds: tuple[Segment, ...]
    fastest_seen: float
    pose_missed: float = 0.0


@dataclass(frozen=True, eq=False)
class Prepared:
    """A recording with its derivatives and the torques that its motion takes from the arm as it was loaded."""

    plan: IdentificationPlan
    t: FloatArray
    q: FloatArray
    qd: FloatArray
    qdd: FloatArray
    current: FloatArray
    torque: FloatArray


def prepare(plan: IdentificationPlan, recording: Recording) -> Prepared:
    """Differentiate a recording and predict its torques, once for all joints.

    Raises:
        InputError: another number of joints, or no currents.
    """
    where = recording.source or "recording"
    recording.check_robot(plan.robot)
    if recording.current is None:
        raise InputError(where, "has no motor currents", "wanted current_1 .. current_n")
    q, qd, qdd = derivatives(recording.t, recording.q, window_s=_WINDOW_S)
    torque = inverse_dynamics(plan.loaded, q, qd, qdd, gravity=plan.settings.gravity)
    return Prepared(plan, recording.t, q, qd, qdd, recording.current, torque)


def cut(experiment: JointExperiment, recordings: list[Prepared]) -> Cut:
    """Find the strokes, ramps and holds of one joint, wherever they lie in the recordings.

    A row belongs to a joint's strokes where all other joints stand within 3 degrees of the planned pose. It is at
    constant speed where its speed is within 4 % (or 0.006 rad/s) of a planned one.
    """
    constant: list[Segment] = []
    ramps: list[Segment] = []
    holds: list[Segment] = []
    fastest, missed = 0.0, math.inf
    others = np.arange(experiment.pose.size) != experiment.joint
    for log in recordings:
        parts, fast = _strokes(experiment, log)
        constant += [part for part in parts if part.kind == "constant"]
        ramps += [part for part in parts if part.kind == "ramp"]
        holds += _holds(experiment, log)
        fastest = max(fastest, fast)
        missed = min(missed, float(np.abs(log.q - experiment.pose)[:, others].max(axis=1, initial=0.0).min()))
    return Cut(tuple(constant), tuple(ramps), tuple(holds), fastest, missed)


def _strokes(experiment: JointExperiment, log: Prepared) -> tuple[list[Segment], float]:
    j = experiment.joint
    others = np.arange(log.q.shape[1]) != j
    in_pose = (np.abs(log.q - experiment.pose)[:, others] < _NEAR_POSE).all(axis=1)
    alone = in_pose & (np.abs(log.qd[:, others]) < _STILL).all(axis=1)
    moving = alone & (np.abs(log.qd[:, j]) > 2 * _STILL)
    found: list[Segment] = []
    way = _MIN_WAY * (experiment.high - experiment.low)
    speeds = np.array(experiment.speeds)
    for rows in _runs(moving, log.t):
        speed = np.abs(log.qd[rows, j])
        sign = float(np.sign(log.qd[rows, j].mean()))
        if np.ptp(log.q[rows, j]) < way:
            continue
        if rows.size >= _MIN_ROWS:
            found.append(_ramp(sign * float(speed.max()), log, rows, j))
        # The fastest planned speed that the stroke reaches: slower ones are passed on the ramps.
        top = float(np.quantile(speed, 0.9))
        planned = float(speeds[np.argmin(np.abs(speeds - top))])
        near = np.abs(speed - planned) < max(_SPEED_SHARE * planned, _MIN_SPEED)
        near &= np.abs(log.qdd[rows, j]) < _STEADY * np.abs(log.qdd[rows, j]).max()
        for part in _runs(near, log.t[rows]):
            at = rows[part][_trimmed(log.t[rows][part])]
            if at.size >= _MIN_ROWS and np.ptp(log.q[at, j]) >= way:
                found.append(_segment("constant", sign * planned, log, at, j))
    return found, float(np.abs(log.qd[alone, j]).max()) if alone.any() else 0.0


def _holds(experiment: JointExperiment, log: Prepared) -> list[Segment]:
    j, swinging = experiment.joint, experiment.hold_joint
    if swinging is None:
        return []
    others = np.array([k not in (j, swinging) for k in range(log.q.shape[1])])
    still = (np.abs(log.q - experiment.pose)[:, others] < _NEAR_POSE).all(axis=1)
    still &= np.abs(log.q[:, swinging] - experiment.pose[swinging]) < experiment.swing + _NEAR_POSE
    still &= (np.abs(log.q[:, j] - experiment.pose[j]) < _NEAR_POSE) & (np.abs(log.qd[:, j]) < _STILL)
    moved = np.where(np.abs(log.qd[:, j]) > 2 * _STILL, np.sign(log.qd[:, j]), 0.0)
    found = []
    for rows in _runs(still, log.t):
        before = np.flatnonzero(moved[: rows[0]])
        if not before.size or np.ptp(log.q[rows, swinging]) < experiment.swing:
            continue
        begin = log.t[rows[0]] + _SETTLED * (log.t[rows[-1]] - log.t[rows[0]])
        settled = rows[(log.t[rows] >= begin) & (log.t[rows] <= log.t[rows[-1]] - _BEFORE_MOTION_S)]
        if settled.size >= _MIN_ROWS:
            found.append(_segment("hold", float(moved[before[-1]]), log, settled, j))
    return found


def _ramp(speed: float, log: Prepared, rows: np.ndarray, j: int) -> Segment:
    """A stroke in pieces of a tenth of a second.

    Acceleration is the change of speed over a piece, and the other columns are its means: the second derivative of the
    positions would be flattened by its window, and with it the torque of the links.
    """
    t = log.t[rows]
    edges = np.linspace(t[0], t[-1], max(2, round((t[-1] - t[0]) / _PIECE_S) + 1))
    table = np.column_stack([log.current[rows, j], log.q[rows], log.qd[rows]])
    sums = np.zeros_like(table)
    np.cumsum((table[1:] + table[:-1]) / 2 * np.diff(t)[:, None], axis=0, out=sums[1:])
    at_edges = np.stack([np.interp(edges, t, column) for column in sums.T], axis=1)
    means = np.diff(at_edges, axis=0) / np.diff(edges)[:, None]
    n = log.q.shape[1]
    q, qd = np.ascontiguousarray(means[:, 1 : n + 1]), np.ascontiguousarray(means[:, n + 1 :])
    speeds = np.stack([np.interp(edges, t, log.qd[rows, k]) for k in range(n)], axis=1)
    qdd = np.diff(speeds, axis=0) / np.diff(edges)[:, None]
    torque = inverse_dynamics(log.plan.loaded, q, qd, qdd, gravity=log.plan.settings.gravity)[:, j]
    return Segment("ramp", speed, (edges[1:] + edges[:-1]) / 2, means[:, 0], torque, qd[:, j], qdd[:, j])


def _segment(kind: str, speed: float, log: Prepared, rows: np.ndarray, j: int) -> Segment:
    return Segment(
        kind, speed, log.t[rows], log.current[rows, j], log.torque[rows, j], log.qd[rows, j], log.qdd[rows, j]
    )


def _runs(wanted: np.ndarray, t: FloatArray) -> list[np.ndarray]:
    """Rows of every unbroken run of True; a gap in time breaks it."""
    rows = np.flatnonzero(wanted)
    if not rows.size:
        return []
    breaks = (np.diff(rows) > 1) | (np.diff(t[rows]) > _GAP_S)
    return np.split(rows, np.flatnonzero(breaks) + 1)


def _trimmed(t: FloatArray) -> np.ndarray:
    """Rows farther than the derivatives' half window from both ends: nearer ones know what lies outside."""
    return np.asarray((t >= t[0] + _WINDOW_S / 2) & (t <= t[-1] - _WINDOW_S / 2))
