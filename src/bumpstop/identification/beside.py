"""The general fit beside the protocol's, on the same recordings: do two ways to one figure agree?"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bumpstop.errors import InputError
from bumpstop.identification.joint_model_fit import identify_joint_model

if TYPE_CHECKING:
    from bumpstop.identification.joint_fit import JointFit
    from bumpstop.identification.protocol import ProtocolFit, ProtocolJoint
    from bumpstop.joint.model import Parameter
    from bumpstop.recording import Recording


@dataclass(frozen=True, eq=False)
class JointBeside:
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
        if name == "B" and "A" in self.general.unseen:
            return None
        combined = math.hypot(own.standard_error, other.standard_error)
        return (own.value - other.value) / combined if combined > 0 else None


@dataclass(frozen=True, eq=False)
class GeneralBeside:
    """The general fit of the joints that the protocol identified.

    Attributes:
        joints: in the protocol's order.
        cutoff_hz: of the general fit's filter.
        rows_used: by it.
        why_not: why there is no general fit; or empty.
    """

    joints: tuple[JointBeside, ...]
    cutoff_hz: float
    rows_used: int
    why_not: str = ""


def general_beside(
    fit: ProtocolFit, recordings: Sequence[Recording], *, progress: Callable[[float], None] | None = None
) -> GeneralBeside:
    """Fit the same recordings as a whole, strokes, ramps, holds and all between them.

    Friction is that of the protocol, and maps are those that it chose, so that parameters can be compared. Load and
    direction of gravity are the plan's.

    Args:
        fit: of :func:`~bumpstop.identification.protocol.identify_protocol`.
        recordings: the same.
        progress: called with the share that is done, 0 to 1.
    """
    plan = fit.plan
    maps = tuple(dict.fromkeys(joint.map for joint in fit.joints))
    try:
        found = identify_joint_model(
            list(recordings),
            plan.loaded,
            maps=maps,
            frictions=("power",),
            gravity=plan.settings.gravity,
            progress=progress,
        )
    except InputError as error:
        # The protocol stands without it.
        return GeneralBeside((), math.nan, 0, f"{error.field}: {error.problem}")
    joints = tuple(JointBeside(joint, found.joints[joint.experiment.joint]) for joint in fit.joints)
    return GeneralBeside(joints, found.cutoff_hz, found.rows_used)
