"""How good a model is on a recording: table 3.1, error by speed and acceleration, and contact (eqs 3.2 to 3.8).

Schroeder (2013), chapter 3. Errors have its sign: predicted less measured (eq 3.1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.errors import InputError
from bumpstop.identification.dynamics.dynamics_fit import JointScore, share_predicted
from bumpstop.identification.segments.motion import lowpass
from bumpstop.identification.segments.torque_samples import near_gaps, recorded_motion
from bumpstop.model import unit_of

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification.drive.current_scores import CurrentComparison
    from bumpstop.identification.dynamics.dynamics_fit import DynamicsFit
    from bumpstop.identification.payload.payload import Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

_MIN_IN_BIN = 20


@dataclass(frozen=True, kw_only=True, eq=False)
class Comparison:
    """What a model predicts for a recording, beside what was measured.

    Attributes:
        names: of the joints.
        units: of the quantity, joint by joint.
        t: (N,) even times [s].
        qd, qdd: (N, n) [rad/s or m/s, and per second].
        measured, predicted: (N, n) [units].
        rate_hz: rows a second.
        filter_hz: cut-off of the zero-phase filter that both pass where they are compared filtered.
        given: scores by joint that were worked out elsewhere, where rows are not even; None: they are worked out here.
    """

    names: tuple[str, ...]
    units: tuple[str, ...]
    t: FloatArray
    qd: FloatArray
    qdd: FloatArray
    measured: FloatArray
    predicted: FloatArray
    rate_hz: float
    filter_hz: float
    given: tuple[JointScore, ...] | None = None

    @cached_property
    def error(self) -> FloatArray:
        """Predicted less measured (N, n), eq 3.1."""
        return self.predicted - self.measured

    def scores(self) -> tuple[JointScore, ...]:
        """Table 3.1, with R2 filtered and raw; mean and standard deviation are of the unfiltered error."""
        if self.given is not None:
            return self.given
        smooth, smooth_predicted = (lowpass(x, self.rate_hz, self.filter_hz) for x in (self.measured, self.predicted))
        error = self.error
        return tuple(
            JointScore(
                name=name,
                r2=share_predicted(smooth[:, j], smooth_predicted[:, j]),
                r2_raw=share_predicted(self.measured[:, j], self.predicted[:, j]),
                mean=float(error[:, j].mean()),
                sd=float(error[:, j].std()),
                rmse=float(np.sqrt((error[:, j] ** 2).mean())),
            )
            for j, name in enumerate(self.names)
        )

    def by_speed(self, joint: int, bins: int = 12) -> BinnedError:
        """Error by the joint's own speed [rad/s]."""
        return binned_error(self.qd[:, joint], self.error[:, joint], bins)

    def by_acceleration(self, joint: int, bins: int = 12) -> BinnedError:
        """Error by the joint's own acceleration [rad/s2]."""
        return binned_error(self.qdd[:, joint], self.error[:, joint], bins)


@dataclass(frozen=True, eq=False)
class BinnedError:
    """Error by another quantity; bins with fewer than 20 rows are left out.

    Attributes:
        edges: (k, 2) low and high end of every bin.
        mean, sd: (k,) of the error in it.
        rows: (k,) in it.
    """

    edges: FloatArray
    mean: FloatArray
    sd: FloatArray
    rows: FloatArray


def binned_error(x: FloatArray, error: FloatArray, bins: int) -> BinnedError:
    """Mean and standard deviation of an error in bins of equal width over the middle 99.8 % of ``x`` (N,)."""
    low, high = np.quantile(x, [0.001, 0.999])
    if not high > low:
        return BinnedError(np.array([[low, high]]), error.mean()[None], error.std()[None], np.array([float(x.size)]))
    edges = np.linspace(low, high, bins + 1)
    place = np.digitize(x, edges[1:-1])
    inside = (x >= low) & (x <= high)
    kept = [k for k in range(bins) if (inside & (place == k)).sum() >= _MIN_IN_BIN]
    parts = [error[inside & (place == k)] for k in kept]
    return BinnedError(
        np.array([[edges[k], edges[k + 1]] for k in kept]).reshape(-1, 2),
        np.array([part.mean() for part in parts]),
        np.array([part.std() for part in parts]),
        np.array([float(part.size) for part in parts]),
    )


def compare_dynamics(
    fit: DynamicsFit,
    recordings: Recording | Sequence[Recording],
    *,
    filter_hz: float | None = None,
    payloads: Sequence[Payload | None] = (),
) -> Comparison:
    """Torques that fitted dynamics predict, beside recorded ones; joints whose gain is not seen are left out.

    Args:
        fit: what ``identify`` found.
        recordings: with torques, of the same robot; one or more.
        filter_hz: where they are compared filtered; default: the cut-off of the fit.
        payloads: what each of them carried beyond what the arm of the fit did; default: nothing.
    """
    rows = fit.rows(recordings, payloads)
    errors = np.zeros(fit.robot.dof) if fit.gain_errors is None else fit.gain_errors
    known = [j for j in range(fit.robot.dof) if np.isfinite(errors[j])]
    joints = [fit.robot.joints[j] for j in known]
    scores = fit.score_rows(rows, filter_hz=filter_hz)
    return Comparison(
        names=tuple(joint.name for joint in joints),
        units=tuple(unit_of(joint) for joint in joints),
        t=_one_after_another(rows.motion.t, rows.stretches),
        qd=rows.motion.qd[:, known],
        qdd=rows.motion.qdd[:, known],
        measured=rows.torque[:, known],
        predicted=(fit.predict(rows.motion, rows.carried) + rows.carried)[:, known],
        rate_hz=rows.motion.rate_hz,
        filter_hz=filter_hz or fit.cutoff_hz,
        given=tuple(scores[j] for j in known),
    )


def compare_estimates(found: CurrentComparison, robot: Robot) -> Comparison:
    """Torques that a joint model makes of motor currents, beside Newton-Euler's of the motion (table 3.1).

    Args:
        found: a joint model beside recordings.
        robot: whose joints it is of. Joints whose gain is unknown are left out.
    """
    rows, scores = found.rows, found.torque_scores()
    known = [j for j, score in enumerate(scores) if score is not None]
    # A view where all are known: of a long recording there is no need for a copy.
    which = slice(None) if len(known) == len(scores) else known
    units = {joint.name: unit_of(joint) for joint in robot.joints}
    names = tuple(found.model.joints[j].name for j in known)
    return Comparison(
        names=names,
        units=tuple(units.get(name, "Nm") for name in names),
        t=_one_after_another(rows.t, rows.stretches),
        qd=rows.qd[:, which],
        qdd=rows.qdd[:, which],
        measured=found.estimated[:, which],
        predicted=rows.torque[:, which],
        rate_hz=float(np.median(rows.rate_hz)),
        filter_hz=found.filter_hz,
        given=tuple(score for score in scores if score is not None),
    )


def _one_after_another(t: FloatArray, stretches: Sequence[slice]) -> FloatArray:
    """Times of recordings that follow one another on the page, whatever their clocks say."""
    t = t.copy()
    for before, part in pairwise(stretches):
        t[part] += max(0.0, t[before.stop - 1] - t[part.start])
    return t


@dataclass(frozen=True, kw_only=True, eq=False)
class ContactComparison:
    """A measured contact force beside the force that joint torques say (eqs 3.3 to 3.8).

    Attributes:
        joint: whose torque is used, from 0.
        t: (N,) [s].
        force: (N,) magnitude of the measured force [N].
        torque_expected: (N,) of that joint, J' F (eq 2.12) [Nm].
        torque_estimated: (N,) of that joint [Nm].
        estimated: (N,) force by eq 3.6 with its sign [N]; NaN where it is not judged.
        judged: (N,) rows where eq 3.6 says something.
        least_torque: |J' F| below which it does not [Nm].
        all_joints: (N,) force along the measured direction by least squares over all joints [N]; NaN likewise.
    """

    joint: int
    t: FloatArray
    force: FloatArray
    torque_expected: FloatArray
    torque_estimated: FloatArray
    estimated: FloatArray
    judged: np.ndarray
    least_torque: float
    all_joints: FloatArray

    @property
    def error(self) -> FloatArray:
        """Eq 3.8 (N,): estimated less measured force [N]; NaN where it is not judged."""
        return self.estimated - self.force

    @property
    def not_judged(self) -> int:
        """Rows with a measurable force whose torque at the joint is too small for eq 3.6."""
        return int((~self.judged & (self.force > 0)).sum())


def compare_contact(
    robot: Robot,
    t: FloatArray,
    q: FloatArray,
    torque: FloatArray,
    wrench: FloatArray,
    *,
    joint: int | None = None,
    in_base_frame: bool = False,
    least_torque: float | None = None,
    free: np.ndarray | None = None,
) -> ContactComparison:
    """Compare a measured contact force with the one that joint torques say.

    Eq 3.6, |F_est| = |F_meas| |tau_est| / |tau_pred|, takes the direction of the measured force for granted and divides
    by the torque that force has at the joint. Where that torque is small the quotient is noise: an error of 1 Nm in the
    torque is 1 / a newtons in the force, with the lever arm a = |J' f| of a unit force. Rows with less than
    ``least_torque`` are therefore not judged; they are NaN and counted.

    Args:
        robot: the arm.
        t: (N,) [s].
        q: (N, n) [rad or m].
        torque: (N, n) that the environment exerts on the joints, positive along +q: predicted less measured torque of
            the motors, the negative of eq 3.2's difference [Nm].
        wrench: (N, 6) that the environment exerts on the tip: force [N], then moment [Nm].
        joint: from 0; default: the one with the largest torque from the measured force.
        in_base_frame: the wrench is given along the base's axes; else along the tip's, as a sensor there gives it.
        least_torque: below which a row is not judged [Nm]; default: three standard deviations of the torque while
            nothing touches.
        free: (N,) rows without contact; default: those whose force is below 2 % of the largest.

    Raises:
        InputError: wrong shapes; no force at all.
    """
    rows = len(t)
    pose = as_float_array(q, "q", (rows, robot.dof))
    external = as_float_array(torque, "torque", (rows, robot.dof))
    measured = as_float_array(wrench, "wrench", (rows, 6)).reshape(rows, 2, 3)
    if not in_base_frame:
        measured = np.einsum("nij,nkj->nki", robot.pose(pose)[:, :3, :3], measured)
    force = np.linalg.norm(measured[:, 0], axis=1)
    if not force.max() > 0:
        raise InputError("wrench", "has no force", "wanted a recording with contact")
    expected = np.einsum("nij,ni->nj", robot.jacobian(pose), measured.reshape(rows, 6))
    if joint is None:
        joint = int(np.argmax(np.abs(expected).max(axis=0)))
    elif not 0 <= joint < robot.dof:
        raise InputError("joint", f"{joint + 1} is none of {robot.name}", f"wanted 1 to {robot.dof}")
    untouched = force < 0.02 * force.max() if free is None else np.asarray(free, dtype=bool)
    if least_torque is None:
        least_torque = 3 * float(external[untouched, joint].std()) if untouched.sum() > 10 else 1.0
    own = expected[:, joint]
    judged = np.abs(own) > max(least_torque, 1e-9)
    estimated = np.full(rows, math.nan)
    estimated[judged] = force[judged] * external[judged, joint] / own[judged]
    square = (expected**2).sum(axis=1)
    everything = np.full(rows, math.nan)
    everything[judged] = force[judged] * (expected * external).sum(axis=1)[judged] / square[judged]
    return ContactComparison(
        joint=joint,
        t=t,
        force=force,
        torque_expected=own,
        torque_estimated=external[:, joint],
        estimated=estimated,
        judged=judged,
        least_torque=least_torque,
        all_joints=everything,
    )


def contact_of(fit: DynamicsFit, recording: Recording, *, joint: int | None = None) -> ContactComparison | None:
    """The contact comparison of a recording with torques and a wrench in the tip's frame; None: it has no wrench.

    Rows in gaps were made up, and beside longer ones the motion is not known: they are left out.

    Raises:
        InputError: gaps leave no row.
    """
    if recording.wrench is None or not np.linalg.norm(recording.wrench[:, :3], axis=1).max() > 0:
        return None
    motion, torque = recorded_motion(recording, fit.cutoff_hz)
    wrench = np.stack([np.interp(motion.t, recording.t, column) for column in recording.wrench.T], axis=1)
    known = ~near_gaps(motion.t, recording.t, 1 / fit.cutoff_hz)
    if not known.any():
        raise InputError("recording", "gaps leave no row whose motion is known", "record without losing samples")
    external = fit.predict(replace(motion, gravity=fit.gravity)) - torque
    return compare_contact(fit.robot, motion.t[known], motion.q[known], external[known], wrench[known], joint=joint)
