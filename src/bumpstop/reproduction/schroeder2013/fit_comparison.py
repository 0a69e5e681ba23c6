"""The general fit beside the protocol's, on the same recordings: do two ways to one figure agree?"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.identification.drive.joint_model_fit import identify_joint_model

if TYPE_CHECKING:
    from bumpstop.identification.drive.joint_fit import JointFit
    from bumpstop.joint.parameters import Parameter
    from bumpstop.recording import Recording
    from bumpstop.reproduction.schroeder2013.protocol import ProtocolFit, ProtocolJoint


@dataclass(frozen=True, eq=False)
class JointComparison:
    """One joint in both fits.

    Attributes:
        protocol: as the protocol found it.
        general: as the general fit did.
    """

    protocol: ProtocolJoint
    general: JointFit

    def pair(self, name: str) -> tuple[Parameter | None, Parameter | None]:
        """A parameter by the protocol and by the general fit; None where one has none."""
        return self.protocol.parameters.get(name), self.general.parameters.parameters.get(name)

    def difference(self, name: str) -> float | None:
        """Protocol less general in combined standard errors; None where it cannot be told.

        A and B of two maps are not the same things, nor is B beside a map that lacks A. Both fits see the same noise,
        so that differences are smaller than those of independent measurements.
        """
        own, other = self.pair(name)
        if own is None or other is None or own.standard_error is None or other.standard_error is None:
            return None
        if name in ("A", "B") and self.protocol.map != self.general.parameters.map:
            return None
        if name == "B" and "A" in self.general.unobservable:
            return None
        combined = math.hypot(own.standard_error, other.standard_error)
        return (own.value - other.value) / combined if combined > 0 else None


@dataclass(frozen=True, eq=False)
class FitComparison:
    """The general fit of the joints that the protocol identified.

    Attributes:
        joints: in the protocol's order, without those that cannot be fitted.
        cutoff_hz: of the general fit's filter.
        rows_used: by it.
        why_not: why there is none of the joints that lack one; or empty.
    """

    joints: tuple[JointComparison, ...]
    cutoff_hz: float
    rows_used: int
    why_not: str = ""


def compare_fits(
    fit: ProtocolFit, recordings: Sequence[Recording], *, progress: Callable[[float], None] | None = None
) -> FitComparison:
    """Fit the same recordings as a whole, strokes, ramps, holds and all between them.

    Laws of friction and maps are those that the protocol chose, so that parameters can be compared. Load and
    direction of gravity are the plan's.

    Args:
        fit: of :func:`~bumpstop.reproduction.schroeder2013.protocol.identify_protocol`.
        recordings: the same.
        progress: called with the share that is done, 0 to 1.
    """
    report = progress or (lambda share: None)
    try:
        found, rows_used, cutoff_hz = _fitted(fit, recordings, fit.joints, report)
    except InputError as error:
        if len(fit.joints) == 1:
            return FitComparison((), math.nan, 0, _reason(error))
    else:
        return FitComparison(found, cutoff_hz, rows_used)
    # The protocol stands without it, and so do joints without one that cannot be fitted.
    pairs: list[JointComparison] = []
    reasons: list[str] = []
    rows_used, cutoff_hz = 0, math.nan
    for joint in fit.joints:
        try:
            own, rows_used, cutoff_hz = _fitted(fit, recordings, (joint,), report)
            pairs += own
        except InputError as error:
            reasons.append(_reason(error))
    return FitComparison(tuple(pairs), cutoff_hz, rows_used, "; ".join(dict.fromkeys(reasons)))


def _reason(error: InputError) -> str:
    return f"{error.field}: {error.problem}"


def _fitted(
    fit: ProtocolFit,
    recordings: Sequence[Recording],
    joints: Sequence[ProtocolJoint],
    progress: Callable[[float], None],
) -> tuple[tuple[JointComparison, ...], int, float]:
    """Pairs, rows used and cut-off of a fit of these joints alone; others stand still and show nothing."""
    plan = fit.plan
    found = identify_joint_model(
        list(recordings),
        plan.loaded,
        maps=tuple(dict.fromkeys(joint.map for joint in joints)),
        frictions=tuple(dict.fromkeys(joint.friction.law for joint in joints)),
        gravity=plan.settings.gravity,
        joints=[joint.experiment.joint for joint in joints],
        progress=progress,
    )
    pairs = tuple(JointComparison(joint, own) for joint, own in zip(joints, found.joints, strict=True))
    return pairs, found.rows_used, found.cutoff_hz
