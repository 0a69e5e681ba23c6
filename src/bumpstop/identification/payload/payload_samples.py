"""Samples a payload is fitted to and compared on: recorded torque, the arm's own, and the payload's columns."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.dynamics.regressor import link_regressor
from bumpstop.identification.payload.tip_parameters import tip_to_link
from bumpstop.identification.segments.drive_samples import split_at_gaps
from bumpstop.identification.segments.motion import MIN_ROWS, UniformMotion, interpolate_to, lowpass, resample
from bumpstop.identification.segments.seen_motion import outside_fit

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.identification.dynamics.fit_file import DynamicsEstimate
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Torques are compared after a filter at this many times the motion's cut-off.
FIT_PER_CUTOFF = 2.0
_MIN_PERIODS = 4.0  # of the cut-off, that a segment between gaps lasts


@dataclass(frozen=True, kw_only=True, eq=False)
class PayloadSource:
    """How torque is made of recordings, and what the arm needs of it without payload.

    Attributes:
        robot: without payload, with inertia.
        model: joint torque model, of recordings with currents; or None.
        dynamics: of the arm without payload, in place of its inertia and of a joint model; or None.
        fit: that gave the dynamics, which knows its own motion and errors; None: not known.
        inertia_uncertainty: relative standard uncertainty of the robot's inertia.
        cutoff_hz: of the motion's filter.
        gravity: acceleration of free fall in the base frame [m/s2].
    """

    robot: Robot
    model: JointTorqueModel | None
    dynamics: DynamicsModel | None
    cutoff_hz: float
    gravity: tuple[float, float, float]
    fit: DynamicsEstimate | None = None
    inertia_uncertainty: float


@dataclass(frozen=True, eq=False)
class PayloadSamples:
    """Segments of a recording one after another, of the k joints whose torque is known.

    Attributes:
        t: (N,) [s].
        qd, qdd: (N, k).
        torque: (N, k) recorded, or made of currents [Nm or N].
        arm: (N, k) torque of the arm without payload.
        smooth_torque, smooth_arm: the same after the zero-phase filter.
        payload: (N, k, 10) filtered columns of the payload's inertial parameters about the tip.
        others: (N, k, m) filtered columns of friction, rotors and offsets.
        known: (n,) joints whose torque is known.
        widths: (n,) speed over which Coulomb friction turns.
        rate_hz: rows a second of the first segment.
        rows_left: recorded rows left out.
        unfiltered_payload, unfiltered_others: (N, k, ...) columns before the filter.
        motion: of these rows, of all joints.
        gain_errors: (k,) standard errors of the joints' gains as shares of them; 0: the torque was recorded.
        outside: what of the motion lies outside that of the dynamics' fit, a sentence each.
    """

    t: FloatArray
    qd: FloatArray
    qdd: FloatArray
    torque: FloatArray
    arm: FloatArray
    smooth_torque: FloatArray
    smooth_arm: FloatArray
    payload: FloatArray
    others: FloatArray
    known: npt.NDArray[np.bool_]
    widths: FloatArray
    rate_hz: float
    rows_left: int
    unfiltered_payload: FloatArray
    unfiltered_others: FloatArray
    motion: UniformMotion
    gain_errors: FloatArray
    outside: tuple[str, ...]

    @classmethod
    def of(cls, recording: Recording, source: PayloadSource, widths: FloatArray | None = None) -> PayloadSamples:
        """Filter a recording; ``widths``: those of a fit, default: by the recording's own speeds.

        Raises:
            InputError: no currents or torques, another number of joints, too few rows, no joint whose torque is known.
        """
        robot, cutoff = source.robot, source.cutoff_hz
        recording.check_robot(robot)
        parts, left = _parts(recording, cutoff)
        motions = [replace(resample(part.t, part.q, part.qd, cutoff), gravity=source.gravity) for part in parts]
        torques = [_torques(part, source, own) for part, own in zip(parts, motions, strict=True)]
        known = torques[0][2]
        q, qd, qdd = (np.concatenate([getattr(own, name) for own in motions]) for name in ("q", "qd", "qdd"))
        payload = link_regressor(robot, q, qd, qdd, source.gravity, robot.dof - 1) @ tip_to_link(robot)
        widths = sign_widths(qd) if widths is None else widths
        if source.dynamics is not None:
            others = np.tile(np.eye(robot.dof)[None], (len(qd), 1, 1))
        else:
            others = _joint_columns(qd, qdd, widths) if source.model is None else np.zeros((len(qd), robot.dof, 0))
        ends = np.cumsum([own.t.size for own in motions])[:-1]
        inside = [_inside(own.t, cutoff) for own in motions]

        def trimmed(x: FloatArray, *, smooth: bool) -> FloatArray:
            """Joints of known torque, each segment by itself, without its ends."""
            return np.concatenate(
                [
                    (lowpass(part, own.rate_hz, FIT_PER_CUTOFF * cutoff) if smooth else part)[rows]
                    for part, own, rows in zip(np.split(x[:, known], ends), motions, inside, strict=True)
                ]
            )

        torque, arm = (np.concatenate([own[k] for own in torques]) for k in (0, 1))
        names = [joint.name for joint in source.robot.joints]
        moved = _joined([own.part(rows) for own, rows in zip(motions, inside, strict=True)])
        return cls(
            t=np.concatenate([own.t[rows] for own, rows in zip(motions, inside, strict=True)]),
            qd=trimmed(qd, smooth=False),
            qdd=trimmed(qdd, smooth=False),
            torque=trimmed(torque, smooth=False),
            arm=trimmed(arm, smooth=False),
            smooth_torque=trimmed(torque, smooth=True),
            smooth_arm=trimmed(arm, smooth=True),
            payload=trimmed(payload, smooth=True),
            others=trimmed(others, smooth=True),
            known=known,
            widths=widths,
            rate_hz=motions[0].rate_hz,
            rows_left=left,
            unfiltered_payload=trimmed(payload, smooth=False),
            unfiltered_others=trimmed(others, smooth=False),
            motion=moved,
            gain_errors=_gain_errors(recording, source)[known],
            outside=() if source.fit is None else tuple(outside_fit(source.fit.seen, moved, names)),
        )


def _parts(recording: Recording, cutoff_hz: float) -> tuple[list[Recording], int]:
    """Segments between gaps that are long enough, and how many recorded rows are left out in all.

    At either end of a segment, within a period of the cut-off, the filter knows one side of the motion only: the torque
    that an arm which moves there seems to want is off by several times the noise.
    """
    found, used = [], 0
    for rows in split_at_gaps(recording.t):
        t = recording.t[rows]
        if t.size >= MIN_ROWS and t[-1] - t[0] >= _MIN_PERIODS / cutoff_hz:
            found.append(recording.between(float(t[0]), float(t[-1])))
            used += int(np.count_nonzero(_inside(t, cutoff_hz)))
    if not found:
        problem = f"has no {MIN_ROWS} rows and {_MIN_PERIODS / cutoff_hz:.3g} s without a gap"
        raise InputError("recording", problem, "record for longer, or give a higher cut-off")
    return found, recording.t.size - used


def _joined(parts: Sequence[UniformMotion]) -> UniformMotion:
    """Segments one after another."""
    t, q, qd, qdd = (np.concatenate([getattr(own, name) for own in parts]) for name in ("t", "q", "qd", "qdd"))
    return UniformMotion(t, q, qd, qdd, parts[0].rate_hz, parts[0].gravity)


def _inside(t: FloatArray, cutoff_hz: float) -> npt.NDArray[np.bool_]:
    """Which of rising times (N,) lie a period of the cut-off inside both ends."""
    inside: npt.NDArray[np.bool_] = (t >= t[0] + 1 / cutoff_hz) & (t <= t[-1] - 1 / cutoff_hz)
    return inside


def _torque_of_recording(recording: Recording, t: FloatArray, gains: FloatArray | None) -> FloatArray:
    """Recorded torque (N, n) at the times of a grid, or the currents times the gains where there is none [Nm or N]."""
    if recording.tau is not None:
        return interpolate_to(t, recording.t, recording.tau)
    if gains is None or recording.current is None:
        raise InputError(
            "recording", "has no joint torque", "wanted tau_1 .. tau_n, or currents with dynamics that know gains"
        )
    return interpolate_to(t, recording.t, recording.current * gains)


def sign_widths(qd: FloatArray) -> FloatArray:
    """(n,) speed over which Coulomb friction turns, of rates (N, n) [rad/s or m/s]."""
    widths: FloatArray = np.maximum(0.03 * np.sqrt((qd**2).mean(axis=0)), 1e-6)
    return widths


def _joint_columns(qd: FloatArray, qdd: FloatArray, widths: FloatArray) -> FloatArray:
    """Columns (N, n, 4 n) of Coulomb and viscous friction, reflected rotor and an offset of each joint."""
    rows, n = qd.shape
    columns = np.zeros((rows, n, 4 * n))
    for j in range(n):
        own = [np.tanh(qd[:, j] / widths[j]), qd[:, j], qdd[:, j], np.ones(rows)]
        columns[:, j, 4 * j : 4 * j + 4] = np.stack(own, axis=1)
    return columns


def _torques(
    recording: Recording, source: PayloadSource, motion: UniformMotion
) -> tuple[FloatArray, FloatArray, npt.NDArray[np.bool_]]:
    """Torque (N, n) by the recording, that of the arm without payload, and the joints whose torque is known."""
    from bumpstop.model import inverse_dynamics, with_rotors

    robot, model, dynamics = source.robot, source.model, source.dynamics
    if dynamics is not None:
        known = ~np.isin(np.arange(robot.dof), dynamics.unscaled)
        return _torque_of_recording(recording, motion.t, dynamics.gains), dynamics.torque(motion), known
    if model is None:
        if recording.tau is None:
            raise InputError(
                "recording", "has no joint torque", "wanted tau_1 .. tau_n, or currents with a joint model"
            )
        own = inverse_dynamics(robot, motion.q, motion.qd, motion.qdd, gravity=motion.gravity)
        return interpolate_to(motion.t, recording.t, recording.tau), own, np.ones(robot.dof, dtype=bool)
    if recording.current is None:
        raise InputError("recording", "has no motor current", "wanted current_1 ..")
    known = np.array([joint.parameters["B"] is not None for joint in model.joints])
    if not known.any():
        raise InputError("model", "knows the gain of no joint", "wanted at least one")
    torque = model.torque(interpolate_to(motion.t, recording.t, recording.current), motion.qd, motion.qdd)
    own = inverse_dynamics(with_rotors(robot, 0.0), motion.q, motion.qd, motion.qdd, gravity=motion.gravity)
    return np.where(known, torque, 0.0), own, known


def _gain_errors(recording: Recording, source: PayloadSource) -> FloatArray:
    """(n,) standard errors of the gains as shares of them; 0 where there is none, or it is not known."""
    errors = np.zeros(source.robot.dof)
    if source.model is not None:
        for j, joint in enumerate(source.model.joints):
            gain = joint.parameters["B"]
            if gain is not None and gain.standard_error is not None:
                errors[j] = gain.standard_error / gain.value
    elif source.fit is not None and source.fit.gain_errors is not None and recording.tau is None:
        assert source.fit.model.gains is not None
        seen = np.isfinite(source.fit.gain_errors)
        errors[seen] = np.abs(source.fit.gain_errors[seen] / source.fit.model.gains[seen])
    return errors
