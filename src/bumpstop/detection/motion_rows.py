"""Speeds and accelerations of the rows of residuals, as the detector takes them."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.detection.offline import detect
from bumpstop.detection.thresholds import Thresholds
from bumpstop.detection.tuning.residual_file import ResidualSeries

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.detection.settings import DetectorSettings
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Thresholds that nothing reaches, and that leave what motion adds to them ten digits.
_QUIET = 1e6


def with_motion(
    series: ResidualSeries,
    recording: Recording,
    robot: Robot,
    model: JointTorqueModel | DynamicsModel | None,
    settings: DetectorSettings | None = None,
) -> ResidualSeries:
    """Residuals with the sizes of the joints' speeds and accelerations, so that thresholds can grow with these.

    They are what the detector itself multiplies with ``per_speed`` and ``per_acceleration``: its thresholds over the
    recording are read back.

    Args:
        series: residuals of ``recording``.
        recording: as for :func:`detect`, like the other arguments.
        robot: with inertia, unless dynamics are fitted.
        model: of currents; or a model of dynamics; or None.
        settings: of the detector whose residuals they are.

    Raises:
        InputError: as :func:`detect`.
    """
    # A joint whose gain is not known must not be monitored; nothing is said of its motion.
    known = _watchable(robot, model)

    def sizes(law: Thresholds) -> FloatArray:
        run = detect(recording, robot, model, law, settings)
        rows = np.searchsorted(run.t, series.t)
        found: FloatArray = np.where(known, run.threshold[rows] - _QUIET, 0.0)
        return found

    ones = np.ones(robot.dof)
    quiet = np.where(known, _QUIET, np.inf)
    speed, acceleration = Thresholds(quiet, speed=ones), Thresholds(quiet, acceleration=ones)
    return replace(series, qd=sizes(speed), qdd=sizes(acceleration))


def _watchable(robot: Robot, model: JointTorqueModel | DynamicsModel | None) -> np.ndarray:
    from bumpstop.joint import JointTorqueModel

    if not isinstance(model, JointTorqueModel):
        return np.ones(robot.dof, dtype=bool)
    known = {joint.name for joint in model.joints if joint.parameters["B"] is not None}
    return np.array([joint.name in known for joint in robot.joints])
