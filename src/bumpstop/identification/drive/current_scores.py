"""How well a joint torque model predicts recorded currents, and torques from them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.drive.drive_model import motor_current
from bumpstop.identification.dynamics.dynamics_fit import JointScore, share_predicted
from bumpstop.identification.segments.drive_samples import DriveRows, drive_rows
from bumpstop.identification.segments.motion import GRAVITY
from bumpstop.joint.model import JointTorqueModel, TorqueState

if TYPE_CHECKING:
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

DEFAULT_CUTOFF_HZ = 10.0


@dataclass(frozen=True, kw_only=True, eq=False)
class CurrentComparison:
    """A model beside recordings, at the recorded rate.

    Attributes:
        model: of the joints.
        rows: motion, Newton-Euler torque and unfiltered current.
        predicted: (N, n) motor current that the model wants for the motion [A]; NaN for a joint whose gain is unknown.
        estimated: (N, n) torque that the model makes of the measured current [Nm or N]; NaN likewise.
        filter_hz: of the zero-phase filter for ``r2``.
        notes: where the model was used outside its range.
        outside_current, outside_speed: (n,) share of the rows outside the fitted range of joint current and of speed;
            None: not counted.
    """

    model: JointTorqueModel
    rows: DriveRows
    predicted: FloatArray
    estimated: FloatArray
    filter_hz: float
    notes: tuple[str, ...]
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

    def current_scores(self) -> tuple[JointScore | None, ...]:
        """Of currents [A]; None for a joint whose gain is unknown."""
        return self._scores(self.rows.current, self.predicted)

    def torque_scores(self) -> tuple[JointScore | None, ...]:
        """Of torques [Nm or N]: Newton-Euler less estimated; None for a joint whose gain is unknown."""
        return self._scores(self.estimated, self.rows.torque)

    def _scores(self, measured: FloatArray, predicted: FloatArray) -> tuple[JointScore | None, ...]:
        scores: list[JointScore | None] = []
        known: npt.NDArray[np.bool_] = np.all(np.isfinite(self.predicted), axis=0)
        which = slice(None) if known.all() else known
        smooth, smooth_predicted = (self.rows.filtered(x[:, which], self.filter_hz) for x in (measured, predicted))
        place = np.cumsum(known) - 1
        for j, joint in enumerate(self.model.joints):
            if not known[j]:
                scores.append(None)
                continue
            error = predicted[:, j] - measured[:, j]  # eq 3.1
            scores.append(
                JointScore(
                    name=joint.name,
                    r2=share_predicted(smooth[:, place[j]], smooth_predicted[:, place[j]]),
                    r2_raw=share_predicted(measured[:, j], predicted[:, j]),
                    mean=float(error.mean()),
                    sd=float(error.std()),
                    rmse=float(np.sqrt((error**2).mean())),
                )
            )
        return tuple(scores)


def compare_currents(
    model: JointTorqueModel,
    recordings: Recording | Sequence[Recording],
    robot: Robot | Sequence[Robot],
    *,
    cutoff_hz: float | None = None,
    filter_hz: float | None = None,
    gravity: tuple[float, float, float] = GRAVITY,
) -> CurrentComparison:
    """Put a joint torque model beside recorded currents.

    Args:
        model: fitted or built in; one that holds only some of the robot's joints is compared for those, by name.
        recordings: with currents; one or more.
        robot: with inertia; or one for each recording, with the payload it carried.
        cutoff_hz: of the zero-phase filter of the motion [Hz]; default: 10, or a fifth of the recorded rate where that
            is less.
        filter_hz: cut-off at which currents are compared for ``r2``; default: ``cutoff_hz``.
        gravity: acceleration of free fall in the base frame [m/s2].

    Raises:
        InputError: no currents, too few rows, a robot of another number of joints, a model of joints that it has not.
    """
    logs = [recordings] if not isinstance(recordings, Sequence) else list(recordings)
    robots = list(robot) if isinstance(robot, Sequence) else [robot] * len(logs)
    arm = robots[0]
    place = _place(model, arm)
    if cutoff_hz is None:
        cutoff_hz = min(DEFAULT_CUTOFF_HZ, 0.2 * min(log.rate_hz for log in logs))
    rows = drive_rows(logs, robots, cutoff_hz, every_row=True, smooth_current=False, gravity=gravity).of_joints(place)
    predicted = np.empty_like(rows.current)
    for j, joint in enumerate(model.joints):
        predicted[:, j] = motor_current(joint, rows.joint(j, joint.rest_speed))
    estimated = np.empty_like(rows.current)
    total = TorqueState.at_rest(len(place))
    for part in rows.stretches:
        state = TorqueState.at_rest(len(place))
        estimated[part] = model.torque(rows.current[part], rows.qd[part], rows.qdd[part], state)
        total.outside_current += state.outside_current
        total.outside_speed += state.outside_speed
    return CurrentComparison(
        model=model,
        rows=rows,
        predicted=predicted,
        estimated=estimated,
        filter_hz=filter_hz or cutoff_hz,
        notes=model.notes(total),
        outside_current=total.outside_current / len(rows.t),
        outside_speed=total.outside_speed / len(rows.t),
    )


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
