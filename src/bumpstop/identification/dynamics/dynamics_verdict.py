"""The verdict on fitted dynamics: what the fit knows of motions that it did not see, and whether a body could be so."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.identification.dynamics.coulomb_sign import coulomb_signs
from bumpstop.identification.dynamics.regressor_columns import regressor_columns
from bumpstop.identification.fit_verdict import (
    OTHER_CAUSES,
    POOR,
    WORTHLESS,
    FitVerdict,
    fit_faults,
    gain_warnings,
    reading_faults,
    reading_warnings,
    tell_score,
)
from bumpstop.identification.segments.current_shift import tell_shifts
from bumpstop.identification.segments.motion import UniformMotion
from bumpstop.identification.segments.recorded_columns import (
    constant_words,
    doubtful_columns,
    tell_doubtful_columns,
)
from bumpstop.identification.segments.seen_motion import outside_fit
from bumpstop.model import unit_of
from bumpstop.terminal import in_percent, named

if TYPE_CHECKING:
    from bumpstop.identification.comparison import JointScore
    from bumpstop.identification.dynamics.dynamics_fit import DynamicsFit
    from bumpstop.identification.segments.torque_samples import TorqueSamples
    from bumpstop.recording import Recording

# Standard error of the torque elsewhere inside the ranges of the fit, as a share of the torque that was recorded.
_UNKNOWN, _UNSURE = 1.0, 0.3
# Condition numbers that planned excitations stay below by far; beyond the second, which is near where columns count as
# dependent, noise decides what the parameters are.
ILL_CONDITIONED, _UNDECIDED = 500.0, 5000.0
# A figure counts as negative when it is so many standard errors below zero.
_SURELY = 3.0
# Friction against the motion of this share of a joint's torque is a matter of sign, not of an imperfect model.
_OPPOSITE = 0.1
_SOME, _NEARLY_ALL = 0.05, 0.9  # shares of poses
# Share of a joint's torque left unexplained by which one of the wrong sign shows.
_MISFIT = 0.1
_POSES = 400
_OPPOSITE_SIGN = (
    f": its torque or current may have the opposite sign ([coupling] sign in a column file), {OTHER_CAUSES}"
)


def judge_dynamics(fit: DynamicsFit, recordings: Sequence[Recording]) -> FitVerdict:
    """Judge a fit by what it says about motions inside the ranges it saw, and by its own figures.

    Single-joint sweeps, for example, explain themselves by parameters that mean nothing elsewhere. So torques are
    predicted for random motions inside the ranges of positions, speeds and accelerations of the fit, with the standard
    error that the parameters' covariance gives them.

    Args:
        fit: of ``identify_dynamics`` or ``identify_gains``.
        recordings: that it was fitted to.
    """
    faults = reading_faults(recordings)
    warnings = reading_warnings(recordings, fit.model.robot)
    names = [joint.name for joint in fit.model.robot.joints]
    moving = [name not in fit.still for name in names]
    if fit.condition is not None and fit.condition > ILL_CONDITIONED:
        (faults if fit.condition > _UNDECIDED else warnings).append(
            f"the motion hardly tells parameters apart (condition number {fit.condition:.3g}, below 100 is good): move "
            "several joints at once, as bumpstop plan excitation does"
        )
    _elsewhere(fit, moving, faults, warnings)
    _bodies(fit, moving, faults, warnings)
    _gains(fit, faults, warnings)
    if fit.unexplained is not None:
        for name, moves, share in zip(names, moving, fit.unexplained, strict=True):
            if moves and np.isfinite(share) and share > POOR:
                (faults if share > WORTHLESS else warnings).append(
                    f"{in_percent(share)} of what {name} took is unexplained on held-out rows"
                )
    for name in fit.still:
        warnings.append(f"{name} hardly moves: its friction, its rotor and what only its motion shows are noise")
    quantity = "tau" if fit.model.gains is None else "current"
    tell_shifts(recordings, fit.model.robot, quantity, faults, warnings, gravity=fit.model.gravity)
    warnings += doubtful_columns(recordings, fit.model.robot, quantity)
    held_out = None
    if fit.unexplained is not None and np.isfinite(fit.unexplained).any():
        held_out = float(np.nanmean(np.where(moving, fit.unexplained, np.nan)))
    return FitVerdict(faults=tuple(faults), warnings=tuple(warnings), condition=fit.condition, held_out=held_out)


def judge_predictions(
    fit: DynamicsFit,
    rows: TorqueSamples,
    scores: Sequence[JointScore],
    filter_hz: float,
    recordings: Sequence[Recording] = (),
) -> FitVerdict:
    """Judge a model on recordings that it was not fitted to.

    Args:
        fit: the model.
        rows: of the recordings, as the fit filters them.
        scores: of the joints on these rows.
        filter_hz: cut-off of the comparison.
        recordings: the same, for what reading them found; may be left out.
    """
    faults = reading_faults(recordings)
    warnings = [*fit_faults(fit.model), *reading_warnings(recordings, fit.model.robot)]
    quantity = "tau" if fit.model.gains is None else "current"
    warnings += gain_warnings(scores)
    judged = [score.name for score in scores if not score.free_gain]
    tell_doubtful_columns(recordings, fit.model.robot, quantity, faults, warnings, judged=judged)
    tell_unpredicted(scores, quantity, filter_hz, faults, warnings)
    warnings += outside_fit(fit.seen, rows.motion, [joint.name for joint in fit.model.robot.joints])
    tell_shifts(recordings, fit.model.robot, quantity, faults, warnings, gravity=fit.model.gravity)
    return FitVerdict(faults=tuple(dict.fromkeys(faults)), warnings=tuple(dict.fromkeys(warnings)))


def tell_unpredicted(
    scores: Sequence[JointScore], quantity: str, filter_hz: float, faults: list[str], warnings: list[str]
) -> None:
    """Add a sentence on every joint whose torque the model does not predict.

    Args:
        scores: of the joints.
        quantity: that was recorded, ``"current"`` or ``"tau"``.
        filter_hz: cut-off of the comparison.
        faults: what says more than nothing against a joint is added.
        warnings: what is hardly predicted, or not judged, is added.
    """
    for score in scores:
        tell_score(score, "torque", constant_words(score.name, quantity), filter_hz, faults, warnings)


def _motion(q: FloatArray, qd: FloatArray, qdd: FloatArray) -> UniformMotion:
    return UniformMotion(np.arange(float(len(q))), q, qd, qdd, 1.0)


def _columns(fit: DynamicsFit, motion: UniformMotion) -> FloatArray:
    motion = replace(motion, gravity=fit.model.gravity)
    model, loads = fit.model, fit.model.loads(motion)
    # Poses that do not follow one another have no travel: friction has its full sign.
    signs = coulomb_signs(motion, model.couplings, model.sign_speed)
    every = regressor_columns(model.robot, motion, signs, model.couplings, model.top_speed, loads=loads)
    return every[:, :, list(fit.model.columns)]


def _spread(columns: FloatArray, covariance: FloatArray) -> FloatArray:
    """Standard error of torques (...,) with columns (..., p)."""
    variance = np.einsum("...p,pq,...q->...", columns, covariance, columns, optimize=True)
    return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def _elsewhere(fit: DynamicsFit, moving: Sequence[bool], faults: list[str], warnings: list[str]) -> None:
    if fit.covariance is None or fit.seen is None or fit.usual_torque is None:
        return
    error = _spread(_columns(fit, _motion(*fit.seen.random(_POSES))), fit.covariance)
    share = np.median(error, axis=0) / np.maximum(fit.usual_torque, 1e-12)
    for bound, kind, words in ((_UNKNOWN, faults, "is not known"), (_UNSURE, warnings, "is hardly known")):
        which = [
            j
            for j, (moves, own) in enumerate(zip(moving, share, strict=True))
            if moves and own > bound and (bound == _UNKNOWN or own <= _UNKNOWN)
        ]
        if which:
            worst = max(which, key=lambda j: float(share[j]))
            joint = fit.model.robot.joints[worst]
            error_there, usual = float(np.median(error[:, worst])), float(fit.usual_torque[worst])
            kind.append(
                f"the torque of {named([fit.model.robot.joints[j].name for j in which])} {words} beside the recorded "
                f"motion, in others within the same ranges: at {joint.name} its standard error is {error_there:.3g} "
                f"{unit_of(joint)}, and {usual:.3g} {unit_of(joint)} were usual; record a motion of several joints at "
                "once"
            )


def _bodies(fit: DynamicsFit, moving: Sequence[bool], faults: list[str], warnings: list[str]) -> None:
    """Inertia about a joint, and friction, that nothing in nature has."""
    if fit.covariance is None or fit.seen is None or fit.usual_torque is None:
        return
    values = fit.model.values if fit.model.predicting is None else fit.model.predicting
    q = fit.seen.random(_POSES)[0]
    none = np.zeros_like(q)
    at_rest = _columns(fit, _motion(q, none, none))
    all_names = fit.model.column_names
    own_names = [all_names[c] for c in fit.model.columns]
    for j, joint in enumerate(fit.model.robot.joints):
        if not moving[j]:
            continue
        unit = unit_of(joint)
        sped_up = none.copy()
        sped_up[:, j] = 1.0
        column = (_columns(fit, _motion(q, none, sped_up)) - at_rest)[:, j]
        inertia, error = column @ values, _spread(column, fit.covariance)
        negative = (inertia < -_SURELY * error) & (inertia < 0)
        # All its poses, and a torque that does not fit the other joints': as a torque with the wrong sign does.
        left = 0.0 if fit.unexplained is None else float(fit.unexplained[j])
        turned = bool(negative.mean() > _NEARLY_ALL) and left > _MISFIT
        if negative.mean() > _SOME:
            (faults if turned else warnings).append(
                f"inertia about {joint.name} is negative in {in_percent(negative.mean())} of poses within the ranges, "
                f"down to {inertia.min():.3g} {unit_of(joint, turning='kg m2', sliding='kg')}"
                + (_OPPOSITE_SIGN if turned else "")
            )
        speed = 0.5 * float(fit.seen.speed[j])
        against = none[:1].copy()
        against[:, j] = speed
        part = np.array([name.split("_")[0] in ("coulomb", "viscous", "bend", "load") for name in own_names])
        column = (_columns(fit, _motion(q[:1], against, none[:1])) * part)[0, j]
        friction, unsure = float(column @ values), float(_spread(column, fit.covariance))
        if friction < -_SURELY * unsure and friction < 0:
            # Inertia of the wrong sign, too: everything that is the joint's own is turned round.
            severe = -friction > _OPPOSITE * float(fit.usual_torque[j]) or bool(negative.mean() > _NEARLY_ALL)
            rate = unit_of(joint, turning="rad/s", sliding="m/s")
            (faults if severe else warnings).append(
                f"friction of {joint.name} is negative, {friction:.3g} {unit} at {speed:.3g} {rate}"
                + (_OPPOSITE_SIGN if severe else "")
            )


def _gains(fit: DynamicsFit, faults: list[str], warnings: list[str]) -> None:
    if fit.model.gains is None or fit.gain_errors is None:
        return
    seen = np.isfinite(fit.gain_errors)
    names = [joint.name for joint in fit.model.robot.joints]
    hidden = [name for name, one in zip(names, seen, strict=True) if not one]
    if hidden:
        warnings.append(f"the gain of {named(hidden)} is not identifiable: the scale of that torque means nothing")
    negative = [name for name, gain, one in zip(names, fit.model.gains, seen, strict=True) if one and gain < 0]
    if negative:
        how = "negative" if len(negative) == int(seen.sum()) else "negative, unlike the others"
        warnings.append(
            f"the gain of {named(negative)} is {how}: the current falls as the torque rises; give its sign in the "
            f"column file ([coupling] sign), {OTHER_CAUSES}"
        )
