"""Errors of a drive's parameters beyond noise: the choice of the current-to-torque model, and the published inertia."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.identification.dynamics.regressor import link_regressor
from bumpstop.identification.statistics.robust_fit import HUBER, RobustFit

if TYPE_CHECKING:
    from bumpstop.identification.drive.drive_model import DriveModel, JointMotion
    from bumpstop.identification.segments.drive_samples import DriveSamples
    from bumpstop.identification.segments.motion import UniformMotion
    from bumpstop.model import LinkInertia, Robot

INERTIA_UNCERTAINTY = 0.05
"""Relative standard uncertainty of a published inertia where none is stated. Gains of a UR3e by its controller differ
by 5 % from those by its published inertia."""
_STEP = 1e-3  # of the largest torque, over which a current's slope is taken


@dataclass(frozen=True)
class GainByModel:
    """The gain that a candidate model came to on the samples that models are chosen on.

    Attributes:
        gain, error: B and its standard error by noise [Nm/A or N/A].
        held_out: root mean square error on held-out fifths of the time [A].
    """

    gain: float
    error: float
    held_out: float


def weights_of(models: Sequence[GainByModel], independent: float) -> FloatArray:
    """Weights (m,) of models, with the sum 1: likelihoods of their held-out errors (pseudo-BMA, Geisser and Eddy 1979).

    Args:
        models: one or more.
        independent: number of residuals that count as independent.
    """
    errors = np.array([model.held_out for model in models])
    weights = (errors.min() / np.maximum(errors, 1e-300)) ** independent if errors.min() > 0 else (errors == 0) * 1.0
    found: FloatArray = weights / weights.sum()
    return found


def error_of_choice(models: Sequence[GainByModel], chosen: int, weights: FloatArray) -> float:
    """Standard error of B that the choice among models adds to the noise of the chosen one.

    Models that predict held-out rows as well may come to other gains, and know theirs less well: the mean square
    distance of the gain from the chosen one over all of them is the variance within each and between them.

    Args:
        models: all, on the same samples.
        chosen: which of them.
        weights: (m,) of :func:`weights_of`.
    """
    own = models[chosen]
    more = [(model.gain - own.gain) ** 2 + model.error**2 - own.error**2 for model in models]
    return float(np.sqrt(max(0.0, float(weights @ np.array(more)))))


def inertia_changes(
    rows: DriveSamples | UniformMotion, arm: Robot, gravity: tuple[float, float, float], uncertainty: float
) -> FloatArray:
    """Changes of the torque (N, n, 4 n) that one standard deviation of the inertia makes, each independent [Nm or N].

    Of every link the mass, with all moments in proportion, and the place of its centre along each axis of the link, by
    a share of its distance from the link's origin.

    Args:
        rows: of the motion.
        arm: with inertia.
        gravity: acceleration of free fall in the base frame [m/s2].
        uncertainty: relative standard uncertainty of masses and of distances of centres.
    """
    changes = []
    for number, joint in enumerate(arm.joints):
        assert joint.inertia is not None
        own = _parameters(joint.inertia)
        center = np.asarray(joint.inertia.center)
        far = float(np.linalg.norm(center))
        moved = [
            _parameters(replace(joint.inertia, center=tuple((center + uncertainty * far * axis).tolist()))) - own
            for axis in np.eye(3)
        ]
        columns = link_regressor(arm, rows.q, rows.qd, rows.qdd, gravity, number)
        changes.append(columns @ np.stack([uncertainty * own, *moved], axis=1))
    return np.concatenate(changes, axis=2)


def _parameters(link: LinkInertia) -> FloatArray:
    """Inertial parameters (10,) about the origin of a link's frame."""
    center, tensor = np.asarray(link.center), np.asarray(link.tensor)
    about = tensor + link.mass * (center @ center * np.eye(3) - np.outer(center, center))
    return np.array([link.mass, *(link.mass * center), *about.diagonal(), *about[[0, 0, 1], [1, 2, 2]]])


def errors_of_inertia(
    law: DriveModel,
    fit: RobustFit,
    motion: JointMotion,
    changes: FloatArray,
    rows: DriveSamples,
    fitted: npt.NDArray[np.bool_],
) -> FloatArray:
    """Standard errors (k,) of the free parameters that an uncertain inertia makes.

    Another torque means another current; the fit answers it as it answers a residual, by one Gauss-Newton step.

    Args:
        law: that was fitted.
        fit: of it.
        motion: of the joint, (N,).
        changes: (N, c) of its torque by one standard deviation of independent causes [Nm or N].
        rows: that filter like the fit.
        fitted: (N,) rows that the fit is to.
    """
    step = _STEP * max(float(np.abs(motion.torque).max()), 1e-12)
    up, down = (law.current(fit.values, replace(motion, torque=motion.torque + side))[0] for side in (step, -step))
    slope = (up - down) / (2 * step)
    currents = rows.filtered(slope[:, None] * changes)[fitted]
    weight = np.minimum(1.0, HUBER * fit.scale / np.maximum(np.abs(fit.residual), 1e-300))
    length = np.maximum(np.linalg.norm(fit.columns, axis=0), 1e-300)
    scaled = fit.columns / length
    weighted = scaled * weight[:, None]
    answers = np.linalg.lstsq(weighted.T @ scaled, weighted.T @ currents, rcond=1e-13)[0] / length[:, None]
    errors: FloatArray = np.linalg.norm(answers, axis=1)
    return errors
