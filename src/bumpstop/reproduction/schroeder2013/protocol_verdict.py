"""The verdict on a joint model by the protocol."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.identification.fit_verdict import FitVerdict, reading_faults
from bumpstop.identification.segments.current_shift import tell_shifts
from bumpstop.identification.segments.recorded_columns import doubtful_columns
from bumpstop.terminal import in_percent, named

if TYPE_CHECKING:
    from bumpstop.recording import Recording
    from bumpstop.reproduction.schroeder2013.fit_comparison import FitComparison
    from bumpstop.reproduction.schroeder2013.protocol import ProtocolFit, ProtocolJoint

# Share of the torque's variance left unexplained on strokes that were not fitted.
_WORTHLESS, _POOR = 1.0, 0.3
# Both fits see the same noise: what lies so many standard errors, and this share of itself, apart is another matter.
_APART, _BY = 5.0, 0.1
_MAX_EXPONENT = 3.0


def judge_protocol(fit: ProtocolFit, beside: FitComparison, recordings: Sequence[Recording]) -> FitVerdict:
    """Judge a protocol's joints by what they explain, by what was seen, and by the general fit beside them.

    Args:
        fit: of ``identify_protocol``.
        beside: the general fit of the same recordings.
        recordings: that both were fitted to.
    """
    faults = reading_faults(recordings)
    warnings: list[str] = []
    for number, why in fit.missing:
        warnings.append(f"{fit.plan.robot.joints[number].name} is not identified: {why}")
    shares = [_held_out(joint) for joint in fit.joints]
    for joint, share in zip(fit.joints, shares, strict=True):
        name = joint.experiment.name
        if share is not None and share > _POOR:
            (faults if share > _WORTHLESS else warnings).append(
                f"{in_percent(share)} of the torque of {name} is unexplained on strokes that were not fitted"
            )
        elif 1 - joint.r2 > _POOR:
            (faults if joint.r2 < 0 else warnings).append(
                f"{in_percent(1 - joint.r2)} of the torque of {name} at constant speed is unexplained"
            )
        if joint.hardly_seen:
            lost = "B" in joint.hardly_seen
            one = len(joint.hardly_seen) == 1
            seen = "is hardly seen: its standard error is" if one else "are hardly seen: their standard errors are"
            text = f"{named(joint.hardly_seen)} of {name} {seen} above a quarter of {'it' if one else 'them'}"
            (faults if lost and len(fit.joints) == 1 else warnings).append(text)
        exponent = joint.parameters.get("F")
        if exponent is not None and exponent.value >= _MAX_EXPONENT:
            faults.append(f"friction of {name} grows as fast as the law allows, F = {exponent.value:.3g}: it is none")
    for pair in beside.joints:
        apart = []
        for name in ("B", "D", "inertia"):
            difference = pair.difference(name)
            own, other = pair.pair(name)
            if difference is None or own is None or other is None:
                continue
            if abs(difference) > _APART and abs(own.value - other.value) > _BY * abs(own.value):
                apart.append(f"{name} {own.value:.4g} and {other.value:.4g}")
        if apart:
            warnings.append(f"protocol and general fit disagree on {pair.general.name}: {named(apart)}")
    tell_shifts(recordings, fit.plan.robot, "current", faults, warnings, gravity=fit.plan.settings.gravity)
    warnings += doubtful_columns(recordings, fit.plan.robot, "current")
    known = [share for share in shares if share is not None]
    return FitVerdict(
        faults=tuple(faults),
        warnings=tuple(warnings),
        condition=max(map(_condition, fit.joints)),
        held_out=float(np.mean(known)) if known else None,
    )


def _held_out(joint: ProtocolJoint) -> float | None:
    """Share of the torque's variance that the chosen map leaves on strokes it was not fitted to."""
    error = joint.held_out.get(joint.map_fit.kind, math.nan)
    spread = float(np.concatenate([part.torque for part in joint.cut.constant]).var())
    return error**2 / spread if math.isfinite(error) and spread > 0 else None


def _condition(joint: ProtocolJoint) -> float:
    """Condition number of the map's two columns, from how their errors go together."""
    covariance = joint.map_fit.covariance
    both = float(covariance[0, 0] * covariance[1, 1])
    if not both > 0:
        return 1.0
    together = min(abs(float(covariance[0, 1])) / math.sqrt(both), 1 - 1e-15)
    return math.sqrt((1 + together) / (1 - together))
