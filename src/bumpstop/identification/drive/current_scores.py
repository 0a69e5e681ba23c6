"""How well a joint torque model predicts recorded currents, and torques from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.comparison import Comparison, JointScore, joint_score, one_after_another
from bumpstop.identification.drive.drive_model import DriveModel, JointMotion, motor_current
from bumpstop.identification.segments.drive_samples import DriveSamples, drive_samples
from bumpstop.identification.segments.rest import resting
from bumpstop.joint.model import JointTorqueModel, TorqueState
from bumpstop.joint.parameters import JointParameters
from bumpstop.model import unit_of
from bumpstop.terminal import in_percent

if TYPE_CHECKING:
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

DEFAULT_CUTOFF_HZ = 10.0
# Rows outside, as a share of all, that are worth a word: single ones are peaks between rows of the fit.
_TOLD = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class CurrentComparison:
    """A model beside recordings, at the recorded rate.

    Attributes:
        model: of the joints.
        rows: motion, Newton-Euler torque and unfiltered current.
        predicted: (N, n) motor current that the model wants for the motion [A]. For a joint whose gain is unknown, its
            friction and the multiples of torque and acceleration that suit these recordings best.
        estimated: (N, n) torque that the model makes of the measured current [Nm or N]; NaN where the gain is unknown.
        torque_units: of the joints.
        gravity: acceleration of free fall in the base frame [m/s2].
        free_gains: joints (from 0) whose gain is unknown.
        filter_hz: of the zero-phase filter for ``r2``.
        notes: where the motion wants currents outside the model's range, or is faster.
        outside_current, outside_speed: (n,) share of the rows whose motion wants a joint current outside the fitted
            range, and whose speed is outside it; None: not counted.
    """

    model: JointTorqueModel
    rows: DriveSamples
    predicted: FloatArray
    estimated: FloatArray
    filter_hz: float
    notes: tuple[str, ...]
    torque_units: tuple[str, ...]
    gravity: tuple[float, float, float]
    free_gains: tuple[int, ...] = ()
    outside_current: FloatArray | None = None
    outside_speed: FloatArray | None = None

    @property
    def current(self) -> FloatArray:
        """Measured motor currents (N, n) [A]."""
        return self.rows.current

    @property
    def torque(self) -> FloatArray:
        """Newton-Euler torque of the motion (N, n), without rotors [Nm or N]."""
        return self.rows.torque

    @property
    def torque_residual(self) -> FloatArray:
        """Torque estimated from current less that of the motion (N, n) [Nm or N]: the detector's direct residual."""
        return self.estimated - self.rows.torque

    def current_scores(self) -> tuple[JointScore, ...]:
        """Of currents [``model.unit``]; R2 of a joint whose gain is unknown is that up to a free gain."""
        return self.currents().scores()

    def torque_scores(self) -> tuple[JointScore | None, ...]:
        """Of torques [Nm or N]: Newton-Euler minus estimated; None for a joint whose gain is unknown."""
        known = iter(self.torques().scores())
        return tuple(None if j in self.free_gains else next(known) for j in range(len(self.model.joints)))

    def currents(self) -> Comparison:
        """Motor currents that the model wants beside measured ones; of all joints."""
        return self._comparison(self.rows.current, self.predicted, range(len(self.model.joints)), None)

    def torques(self) -> Comparison:
        """Newton-Euler torques beside those that the model makes of currents; of joints whose gain is known."""
        known = [j for j in range(len(self.model.joints)) if j not in self.free_gains]
        return self._comparison(self.estimated, self.rows.torque, known, self.torque_units)

    @cached_property
    def _rests(self) -> npt.NDArray[np.bool_]:
        """(N, n) rows at which each joint rests."""
        rows = self.rows
        parts = zip(rows.segments, rows.rate_hz, strict=True)
        return np.concatenate([resting(rows.q[part], rate) for part, rate in parts])

    def _comparison(
        self, measured: FloatArray, predicted: FloatArray, joints: Sequence[int], units: Sequence[str] | None
    ) -> Comparison:
        # A view where all are known: of a long recording there is no need for a copy.
        which = slice(None) if len(joints) == len(self.model.joints) else list(joints)
        measured, predicted, rows = measured[:, which], predicted[:, which], self.rows
        names = tuple(self.model.joints[j].name for j in joints)
        told = tuple(self.model.unit if units is None else units[j] for j in joints)
        smooth, smooth_predicted = (rows.filtered(x, self.filter_hz) for x in (measured, predicted))
        scores = tuple(
            joint_score(
                names[k],
                (measured[:, k], predicted[:, k]),
                (smooth[:, k], smooth_predicted[:, k]),
                told[k],
                rests=self._rests[:, j],
                free_gain=j in self.free_gains,
            )
            for k, j in enumerate(joints)
        )
        return Comparison(
            names=names,
            units=told,
            t=one_after_another(rows.t, rows.segments),
            qd=rows.qd[:, which],
            qdd=rows.qdd[:, which],
            measured=measured,
            predicted=predicted,
            rate_hz=float(np.median(rows.rate_hz)),
            filter_hz=self.filter_hz,
            given=scores,
        )


def compare_currents(
    model: JointTorqueModel,
    recordings: Recording | Sequence[Recording],
    robot: Robot | Sequence[Robot],
    *,
    cutoff_hz: float | None = None,
    filter_hz: float | None = None,
    gravity: tuple[float, float, float] | None = None,
) -> CurrentComparison:
    """Put a joint torque model beside recorded currents.

    Args:
        model: fitted or built in; one that holds only some of the robot's joints is compared for those, by name.
        recordings: with currents; one or more.
        robot: with inertia; or one for each recording, with the payload it carried.
        cutoff_hz: of the zero-phase filter of the motion [Hz]; default: 10, or a fifth of the recorded rate where that
            is less.
        filter_hz: cut-off at which currents are compared for ``r2``; default: ``cutoff_hz``.
        gravity: acceleration of free fall in the base frame [m/s2]; default: the model's.

    Raises:
        InputError: no currents, too few rows, a robot of another number of joints, a model of joints that it has not.
    """
    logs = [recordings] if not isinstance(recordings, Sequence) else list(recordings)
    robots = list(robot) if isinstance(robot, Sequence) else [robot] * len(logs)
    arm = robots[0]
    place = _place(model, arm)
    if cutoff_hz is None:
        cutoff_hz = min(DEFAULT_CUTOFF_HZ, 0.2 * min(log.rate_hz for log in logs))
    falls = model.gravity if gravity is None else gravity
    rows = drive_samples(logs, robots, cutoff_hz, every_row=True, smooth_current=False, gravity=falls).of_joints(place)
    predicted = np.empty_like(rows.current)
    free_gains = tuple(j for j, joint in enumerate(model.joints) if joint.parameters["B"] is None)
    for j, joint in enumerate(model.joints):
        motion = rows.joint(j, joint.rest_speed)
        if j in free_gains:
            predicted[:, j] = _current_by_free_gain(joint, motion, rows, rows.current[:, j], filter_hz or cutoff_hz)
        else:
            predicted[:, j] = motor_current(joint, motion)
    estimated = np.empty_like(rows.current)
    total = TorqueState.at_rest(len(place))
    for part in rows.segments:
        measured, wanted = TorqueState.at_rest(len(place)), TorqueState.at_rest(len(place))
        estimated[part] = model.torque(rows.current[part], rows.qd[part], rows.qdd[part], measured)
        # As the range of the fit: noise would carry its own rows out of it.
        model.torque(predicted[part], rows.qd[part], rows.qdd[part], wanted)
        total.outside_current += wanted.outside_current
        total.outside_speed += measured.outside_speed
    return CurrentComparison(
        model=model,
        rows=rows,
        predicted=predicted,
        estimated=estimated,
        filter_hz=filter_hz or cutoff_hz,
        notes=model.notes(total),
        torque_units=tuple(unit_of(arm.joints[j]) for j in place),
        gravity=falls,
        free_gains=free_gains,
        outside_current=total.outside_current / len(rows.t),
        outside_speed=total.outside_speed / len(rows.t),
    )


def outside_ranges(model: JointTorqueModel, current: FloatArray | None, speed: FloatArray | None) -> list[str]:
    """What of a motion lies outside the ranges of a joint model's fit, a sentence for each joint and quantity.

    Args:
        model: of the joints.
        current: (n,) share of the rows outside; None: not counted.
        speed: (n,) the same of the speeds.
    """
    return [
        f"{joint.name}: {in_percent(share)} of the rows {words}"
        for shares, words in (
            (current, "want joint currents outside those of the fit"),
            (speed, "are faster than the fit saw"),
        )
        for joint, share in zip(model.joints, [] if shares is None else shares.tolist(), strict=False)
        if share > _TOLD
    ]


def _current_by_free_gain(
    joint: JointParameters, motion: JointMotion, rows: DriveSamples, measured: FloatArray, cutoff_hz: float
) -> FloatArray:
    """Motor current (N,) by the friction of a joint, and by its torque and acceleration as they suit ``measured`` best.

    Two numbers are fitted to the recordings that are scored, current per torque and current per acceleration: what is
    left says how well friction and the shape of the torque are known, and nothing of the scale.
    """
    values = {name: joint.value(name) for name in joint.parameters}
    law = DriveModel("unknown_gain", joint.friction, ("torque", "acceleration"), values, joint.rest_speed)
    friction, columns = law.current(np.zeros(2), motion)
    smooth = rows.filtered(np.column_stack([columns, measured - friction]), cutoff_hz)
    length = np.maximum(np.linalg.norm(smooth[:, :2], axis=0), 1e-300)
    share = np.linalg.lstsq(smooth[:, :2] / length, smooth[:, 2], rcond=1e-9)[0] / length
    current: FloatArray = friction + columns @ share
    return current


def _place(model: JointTorqueModel, arm: Robot) -> list[int]:
    """Which joints of the arm a model is of: all in their order, or some by name."""
    if len(model.joints) == arm.dof:
        return list(range(arm.dof))
    names = [joint.name for joint in arm.joints]
    stray = [joint.name for joint in model.joints if joint.name not in names]
    if stray or len(model.joints) > arm.dof:
        problem = f"has {len(model.joints)} joints, {stray[0]!r} among them" if stray else "has a joint twice"
        raise InputError("model", problem, f"{arm.name} has {', '.join(names)}")
    return [names.index(joint.name) for joint in model.joints]
