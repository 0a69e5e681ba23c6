"""The verdict on joint models from currents, on their validation, and on payloads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.identification.drive.current_scores import outside_ranges
from bumpstop.identification.drive.observability import OPPOSITE_SIGN, SURE_GAIN
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
from bumpstop.identification.segments.recorded_columns import (
    constant_words,
    doubtful_columns,
    tell_doubtful_columns,
)
from bumpstop.terminal import in_percent, named

if TYPE_CHECKING:
    from bumpstop.identification.drive.current_scores import CurrentComparison
    from bumpstop.identification.drive.joint_fit import JointFit
    from bumpstop.identification.drive.joint_model_fit import JointModelFit
    from bumpstop.identification.payload.payload_fit import PayloadFit
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Share of a current's variance that friction may leave as it drifts with temperature and load.
_DRIFT = 0.1
_ILL_CONDITIONED = 1000.0
# Friction has a sign when it is so many standard errors from zero.
_SURELY = 3.0
# A payload's mass is hardly known where its standard error is above this share of it.
_HARDLY = 0.3
# A payload that leaves more of the torque's square is doubtful.
_MUCH = 0.5


def judge_joint_model(fit: JointModelFit, recordings: Sequence[Recording]) -> FitVerdict:
    """Judge a joint torque model by what was seen of each joint and by its errors on held-out rows.

    Args:
        fit: of ``identify_joint_model``.
        recordings: that it was fitted to.
    """
    faults = reading_faults(recordings)
    warnings = reading_warnings(recordings, fit.robot)
    opposite = [joint.name for joint in fit.joints if joint.unobservable.get("B") == OPPOSITE_SIGN]
    for joint in fit.joints:
        if joint.name in opposite:
            # A current of the opposite sign has friction of the opposite sign, too.
            advice = f"give its sign in the column file ([coupling] sign), {OTHER_CAUSES}"
            if joint.braking > _SURELY:
                advice = (
                    "its friction has the right sign, so look whether its positions and its current are reversed, its "
                    "current has an offset or it is the wrong column"
                )
            faults.append(f"the gain of {joint.name} is opposite: the current falls as the torque rises; {advice}")
        elif joint.braking < -_SURELY:
            faults.append(
                f"the friction of {joint.name} comes out negative: is its current of the opposite sign (give it in the "
                "column file, [coupling] sign), are its positions reversed, or is it the wrong column?"
            )
    hidden = [joint.name for joint in fit.joints if not joint.observable and joint.name not in opposite]
    if len(hidden) + len(opposite) == len(fit.joints):
        faults.append("no joint shows its gain in this motion")
    elif hidden:
        warnings.append(f"the gain of {named(hidden)} is not identifiable in this motion: its torque stays unknown")
    shares = []
    for joint in fit.joints:
        unexplained = _held_out(joint)
        if unexplained is not None:
            shares.append(unexplained)
            if unexplained > POOR:
                (faults if unexplained > WORTHLESS else warnings).append(
                    f"{in_percent(unexplained)} of the current of {joint.name} is unexplained on held-out rows"
                )
        if "D" in joint.unobservable and "F" in joint.unobservable:
            warnings.append(f"{joint.name} rests: its friction stays unknown")
        at_zero = [
            name
            for name in ("D", "coulomb", "viscous", "inertia")
            if name not in joint.unobservable and _at_zero(joint, name)
        ]
        if at_zero:
            warnings.append(f"{named(at_zero)} of {joint.name} would come out negative and is held at 0")
        gain = joint.parameters.parameters["B"]
        if gain is not None and joint.gain_errors:
            share = math.hypot(joint.gain_errors["noise"], joint.gain_errors["model"]) / gain.value
            if share > SURE_GAIN:
                warnings.append(
                    f"the gain of {joint.name} is hardly known: its standard error is {in_percent(share)}, as other "
                    "maps and friction laws that predict the current about as well have other gains"
                )
        if joint.observable and joint.condition > _ILL_CONDITIONED:
            warnings.append(f"the motion of {joint.name} hardly tells its parameters apart ({joint.condition:.3g})")
    if fit.inconsistent:
        warnings.append(
            f"the recordings want different gains of {named(fit.inconsistent)}: did the arm carry something undeclared?"
        )
    tell_shifts(recordings, fit.robot, "current", faults, warnings, gravity=fit.gravity)
    warnings += doubtful_columns(recordings, fit.robot, "current")
    conditions = [joint.condition for joint in fit.joints if joint.observable]
    return FitVerdict(
        faults=tuple(faults),
        warnings=tuple(warnings),
        condition=max(conditions, default=None),
        held_out=float(np.mean(shares)) if shares else None,
    )


def _held_out(joint: JointFit) -> float | None:
    """Share of the current's variance that the chosen map and friction leave on held-out fifths."""
    own = joint.parameters
    chosen = [tried for tried in joint.candidates if (tried.map, tried.friction) == (own.map, own.friction)]
    spread = float(joint.measured.var())
    if not chosen or chosen[-1].held_out is None or not spread > 0:
        return None
    return chosen[-1].held_out ** 2 / spread


def _at_zero(joint: JointFit, name: str) -> bool:
    found = joint.parameters.parameters.get(name)
    return found is not None and found.value == 0 and found.standard_error is not None


def judge_currents(
    found: CurrentComparison, recordings: Sequence[Recording] = (), robot: Robot | None = None
) -> FitVerdict:
    """Judge a joint torque model on recordings that it was not fitted to.

    Args:
        found: the model beside them.
        recordings: the same, for what reading them found; may be left out.
        robot: that moved, for a shift in time between its motion and the currents; None: none is looked for.
    """
    faults = reading_faults(recordings)
    warnings = [*fit_faults(found.model), *reading_warnings(recordings, robot)]
    judged = [score.name for score in found.current_scores() if not score.free_gain]
    if judged:
        warnings += gain_warnings(found.current_scores())
    else:
        faults.append("the model knows the gain of no joint")
    if robot is not None:
        tell_doubtful_columns(recordings, robot, "current", faults, warnings, judged=judged)
    tell_unpredicted(found, faults, warnings)
    warnings += outside_ranges(found.model, found.outside_current, found.outside_speed)
    if robot is not None:
        tell_shifts(recordings, robot, "current", faults, warnings, gravity=found.gravity)
    return FitVerdict(faults=tuple(dict.fromkeys(faults)), warnings=tuple(warnings))


def tell_unpredicted(found: CurrentComparison, faults: list[str], warnings: list[str]) -> None:
    """Add a sentence on every joint whose current, or the torque made of it, the model does not predict.

    A joint that carries little shows friction above all: its current may be predicted well, and the small rest be more
    than its torque varies. So the torque counts where the current errs, too, by more than friction's own drift.

    Args:
        found: the model beside recordings.
        faults: what says more than nothing against a joint is added.
        warnings: what is hardly predicted, or not judged, is added.
    """
    for score, torque in zip(found.current_scores(), found.torque_scores(), strict=True):
        tell_score(score, "current", constant_words(score.name, "current"), found.filter_hz, faults, warnings)
        if torque is not None and _DRIFT < 1 - score.r2 <= WORTHLESS and torque.r2 < 0:
            offset = ": does its current have an offset?" if abs(torque.mean) > torque.sd else ""
            faults.append(f"the torque made of the current of {score.name} errs by more than it varies{offset}")


def judge_payload(found: PayloadFit, recording: Recording, robot: Robot) -> FitVerdict:
    """Judge a payload by whether its mass was seen and could be one, and by what it explains.

    Args:
        found: of ``identify_payload``.
        recording: that it was fitted to.
        robot: that carried it.
    """
    faults = [*fit_faults(found.source.dynamics or found.source.model), *reading_faults([recording])]
    warnings = reading_warnings([recording], robot)
    mass, error = found.parameters["m"].value, found.standard_errors["m"]
    if mass is None:
        fault = "the motion does not show the payload's mass"
        if found.source.model is None and found.source.dynamics is None:
            fault += " beside friction, rotors and offsets: dynamics fitted without it know them (--dynamics)"
        faults.append(fault)
    elif error is not None and mass < -2 * error:
        faults.append(f"the payload's mass comes out as {mass:.3g} kg: are the arm's inertia and the signs right?")
    elif error is not None and error > _HARDLY * abs(mass):
        warnings.append(f"the payload's mass is hardly known: {mass:.3g} +- {error:.2g} kg")
    unobservable = [name for name in found.unobservable if name != "m"]
    if unobservable:
        warnings.append(f"the motion does not show {named(unobservable)}")
    if found.center is not None and max(map(abs, found.center)) > 1.0:
        far = ", ".join(f"{x:.3g}" for x in found.center)
        warnings.append(f"the centre of mass lies at ({far}) m, farther from the tip than tools reach")
    if found.joints_left_out:
        warnings.append(f"{named(found.joints_left_out)} of unknown gain is left out")
    left = (found.rmse**2).sum() / max(float((found.rmse_without**2).sum()), 1e-300)
    if left > _MUCH or (mass is not None and error is not None and mass < 2 * error):
        # A search that needs five more fits, and imports what imports scipy.
        from bumpstop.identification.payload.other_gravity import other_gravity

        mounted = other_gravity(found, recording, robot)
        faults += [mounted] if mounted else []
    if mass is not None and error is not None and abs(mass) > 2 * error and left > 1 - 0.05:
        warnings.append(f"the payload explains {in_percent(1 - left, 2)} of what the arm leaves open")
    warnings += found.outside
    if found.errors_unknown:
        warnings.append(f"the standard errors do not know of errors of {found.errors_unknown}: nothing states them")
    quantity = "tau" if recording.tau is not None else "current"
    tell_shifts([recording], robot, quantity, faults, warnings, gravity=found.source.gravity)
    warnings += doubtful_columns([recording], robot, quantity)
    return FitVerdict(
        faults=tuple(faults), warnings=tuple(warnings), condition=found.condition, held_out=found.unexplained
    )
