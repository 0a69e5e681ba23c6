"""The reference simulator: a literal, step-by-step simulator of collisions, to test the fast library against."""

from .library import MAX_JOINTS, build
from .results import ReferenceRuns, ReferenceTrace
from .settings import Joint, ReferenceSettings
from .simulator import (
    forward_kinematics,
    half_normal_offsets,
    jacobian,
    pseudo_inverse,
    simulate,
    simulate_seeded,
    tick_count,
    trace,
)

__all__ = [
    "MAX_JOINTS",
    "Joint",
    "ReferenceRuns",
    "ReferenceSettings",
    "ReferenceTrace",
    "build",
    "forward_kinematics",
    "half_normal_offsets",
    "jacobian",
    "pseudo_inverse",
    "simulate",
    "simulate_seeded",
    "tick_count",
    "trace",
]
