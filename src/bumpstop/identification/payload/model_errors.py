"""What errors of the arm's own model make of a payload that was found with it."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.drive.error_sources import inertia_changes
from bumpstop.identification.dynamics.regressor_columns import regressor_columns

if TYPE_CHECKING:
    from collections.abc import Callable

    from bumpstop.identification.dynamics.fit_file import DynamicsEstimate
    from bumpstop.identification.payload.payload_samples import PayloadSamples, PayloadSource

    Changes = Callable[[slice], FloatArray]

_AT_ONCE = 2000  # rows whose columns are held


def errors_of_model(
    columns: FloatArray, weight: FloatArray, samples: PayloadSamples, source: PayloadSource
) -> FloatArray:
    """Covariance (m, m) of the least-squares solution that errors of the arm's own model make.

    Every cause changes the torque that the arm leaves open by one standard deviation, independent of the others; the
    fit answers each by one linear step. Causes are the gains, and the parameters of fitted dynamics or, without them,
    mass and centre of every link.

    Args:
        columns: (N, k, m) of the fit, weighted.
        weight: (k,) of the joints.
        samples: of the fit.
        source: of its torques.
    """
    changes, by_gain = _causes(samples, source)
    total: FloatArray | float = 0.0
    for rows in _chunks(samples):
        causes = np.concatenate([by_gain[rows, :, None] * np.eye(weight.size), changes(rows)], axis=2)
        total = total + np.tensordot(columns[rows], causes * weight[None, :, None], axes=((0, 1), (0, 1)))
    flat = columns.reshape(-1, columns.shape[2])
    answers = np.linalg.pinv(flat.T @ flat, hermitian=True) @ total
    covariance: FloatArray = answers @ answers.T
    return covariance


def _chunks(samples: PayloadSamples) -> list[slice]:
    return [slice(start, start + _AT_ONCE) for start in range(0, samples.t.size, _AT_ONCE)]


def _causes(samples: PayloadSamples, source: PayloadSource) -> tuple[Changes, FloatArray]:
    """Changes of the open torque: (rows, k, c) by c causes of any joint, and (N, k) by each joint's own gain."""
    if source.dynamics is not None:
        if source.fit is None:
            return lambda rows: np.zeros((samples.t[rows].size, samples.torque.shape[1], 0)), 0 * samples.torque
        # Dynamics answer another gain as the arm's own torque does: it counts for what lies beyond.
        return _of_dynamics(source.fit, samples), samples.gain_errors * (samples.torque - samples.arm)

    def by_inertia(rows: slice) -> FloatArray:
        part = samples.motion.part(rows)
        return inertia_changes(part, source.robot, source.gravity, source.inertia_uncertainty)[:, samples.known]

    if source.model is None:
        return by_inertia, 0 * samples.torque
    # The gains of a joint model were fitted to the same inertia, and answer another one.
    square = np.maximum((samples.arm**2).sum(axis=0), 1e-300)[:, None]
    answers = sum(np.einsum("tk,tkc->kc", samples.arm[rows], by_inertia(rows)) for rows in _chunks(samples)) / square
    # By no more than their errors: those that are exact do not.
    size = np.linalg.norm(answers, axis=1)
    answers = answers * np.minimum(1.0, samples.gain_errors / np.maximum(size, 1e-300))[:, None]
    rest = np.sqrt(np.maximum(samples.gain_errors**2 - size**2, 0.0))
    return lambda rows: answers * samples.torque[rows, :, None] - by_inertia(rows), rest * samples.torque


def _of_dynamics(fit: DynamicsEstimate, samples: PayloadSamples) -> Changes:
    """By independent causes: of older files only the standard errors are known."""
    model, covariance = fit.model, fit.covariance
    size, turn = (fit.errors**2, np.eye(fit.errors.size)) if covariance is None else np.linalg.eigh(covariance)
    independent = turn * np.sqrt(np.maximum(size, 0.0))
    signs, loads = model.signs(samples.motion), model.loads(samples.motion)

    def changes(rows: slice) -> FloatArray:
        own = {j: load[rows] for j, load in loads.items()}
        motion, couplings, top = samples.motion.part(rows), model.couplings, model.top_speed
        part = regressor_columns(model.robot, motion, signs[rows], couplings, top, loads=own)
        found: FloatArray = part[:, samples.known][:, :, list(model.columns)] @ independent
        return found

    return changes
