"""How good a model is on a recording: table 3.1, error by speed and acceleration, and contact (eqs 3.2 to 3.8).

Schroeder (2013), chapter 3. Errors have its sign: predicted less measured (eq 3.1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.errors import InputError
from bumpstop.identification.segments.torque_samples import near_ends, near_gaps, recorded_motion

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording


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
        min_torque: |J' F| below which it does not [Nm].
        all_joints: (N,) force along the measured direction by least squares over all joints whose torque is known [N];
            NaN likewise.
    """

    joint: int
    t: FloatArray
    force: FloatArray
    torque_expected: FloatArray
    torque_estimated: FloatArray
    estimated: FloatArray
    judged: np.ndarray
    min_torque: float
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
    min_torque: float | None = None,
    free: np.ndarray | None = None,
    known: Sequence[int] | None = None,
) -> ContactComparison:
    """Compare a measured contact force with the one that joint torques say.

    Eq 3.6, |F_est| = |F_meas| |tau_est| / |tau_pred|, takes the direction of the measured force for granted and divides
    by the torque that force has at the joint. Where that torque is small the quotient is noise: an error of 1 Nm in the
    torque is 1 / a newtons in the force, with the lever arm a = |J' f| of a unit force. Rows with less than
    ``min_torque`` are therefore not judged; they are NaN and counted.

    Args:
        robot: the arm.
        t: (N,) [s].
        q: (N, n) [rad or m].
        torque: (N, n) that the environment exerts on the joints, positive along +q: predicted less measured torque of
            the motors, the negative of eq 3.2's difference [Nm].
        wrench: (N, 6) that the environment exerts on the tip: force [N], then moment [Nm].
        joint: from 0; default: the one with the largest torque from the measured force.
        in_base_frame: the wrench is given along the base's axes; else along the tip's, as a sensor there gives it.
        min_torque: below which a row is not judged [Nm]; default: three standard deviations of the torque while
            nothing touches.
        free: (N,) rows without contact; default: those whose force is below 2 % of the largest.
        known: joints (from 0) whose torque is known, which alone are used; default: all.

    Raises:
        InputError: wrong shapes; no force at all; ``joint`` is none of those that are known.
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
    used = list(range(robot.dof) if known is None else known)
    if joint is None:
        joint = used[int(np.argmax(np.abs(expected[:, used]).max(axis=0)))]
    elif not 0 <= joint < robot.dof:
        raise InputError("joint", f"{joint + 1} is none of {robot.name}", f"wanted 1 to {robot.dof}")
    elif joint not in used:
        usable = ", ".join(str(j + 1) for j in used)
        raise InputError("joint", f"the gain of {robot.joints[joint].name} is not known", f"wanted one of {usable}")
    untouched = force < 0.02 * force.max() if free is None else np.asarray(free, dtype=bool)
    if min_torque is None:
        min_torque = 3 * float(external[untouched, joint].std()) if untouched.sum() > 10 else 1.0
    own = expected[:, joint]
    judged = np.abs(own) > max(min_torque, 1e-9)
    estimated = np.full(rows, math.nan)
    estimated[judged] = force[judged] * external[judged, joint] / own[judged]
    square = (expected[:, used] ** 2).sum(axis=1)
    together = (expected[:, used] * external[:, used]).sum(axis=1)
    everything = np.full(rows, math.nan)
    everything[judged] = force[judged] * together[judged] / square[judged]
    return ContactComparison(
        joint=joint,
        t=t,
        force=force,
        torque_expected=own,
        torque_estimated=external[:, joint],
        estimated=estimated,
        judged=judged,
        min_torque=min_torque,
        all_joints=everything,
    )


def contact_of(model: DynamicsModel, recording: Recording, *, joint: int | None = None) -> ContactComparison | None:
    """The contact comparison of a recording with a wrench in the tip's frame; None: it has none, or no torque is known.

    Of currents torques are known where the model knows the gains. Rows in gaps were made up, and beside longer ones and
    at ends in motion the acceleration is not known: they are left out.

    Raises:
        InputError: gaps and ends leave no row, or the torque of ``joint`` is not known.
    """
    if recording.wrench is None or not np.linalg.norm(recording.wrench[:, :3], axis=1).max() > 0:
        return None
    scaled = [j for j in range(model.robot.dof) if j not in model.unscaled]
    if not scaled:
        return None
    motion, torque = recorded_motion(recording, model.cutoff_hz, model.gains)
    wrench = np.stack([np.interp(motion.t, recording.t, column) for column in recording.wrench.T], axis=1)
    beside_s = 1 / model.cutoff_hz
    known = ~(near_gaps(motion.t, recording.t, beside_s) | near_ends(motion, beside_s))
    if not known.any():
        problem = "gaps and ends leave no row whose motion is known"
        raise InputError("recording", problem, "record longer, without losing samples")
    external = model.torque(replace(motion, gravity=model.gravity)) - torque
    return compare_contact(
        model.robot, motion.t[known], motion.q[known], external[known], wrench[known], joint=joint, known=scaled
    )
