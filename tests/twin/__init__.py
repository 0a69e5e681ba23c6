"""The slow twin: a literal, step-by-step simulator of collisions, to test the fast library against."""

from .library import MAX_JOINTS, build
from .results import TwinRuns, TwinTrace
from .settings import Joint, TwinSettings
from .twin import (
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
    "TwinRuns",
    "TwinSettings",
    "TwinTrace",
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
