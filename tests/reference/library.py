"""simulator.cpp, compiled on first use, and the layouts it shares with Python."""

from __future__ import annotations

import ctypes
import functools
import hashlib
import os
import shlex
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np

MAX_JOINTS = 16
SOURCE = Path(__file__).parent / "cpp/simulator.cpp"

# No fused multiply-adds: where the compiler may contract a * b + c, results differ from machine to machine.
DEFAULT_FLAGS = (
    "-O2",
    "-std=c++20",
    "-shared",
    "-fPIC",
    "-ffp-contract=off",
    "-Wall",
    "-Wextra",
    "-Werror",
)

Int = ctypes.c_int32
Real = ctypes.c_double
_IntPerJoint = Int * MAX_JOINTS
_RealPerJoint = Real * MAX_JOINTS


class Problem(ctypes.Structure):
    """Field by field the `Problem` of problem.hpp."""

    _fields_ = (
        ("joint_count", Int),
        ("kind", _IntPerJoint),
        ("held", _IntPerJoint),
        ("origin_xyz", (Real * 3) * MAX_JOINTS),
        ("origin_rotation", (Real * 9) * MAX_JOINTS),
        ("axis", (Real * 3) * MAX_JOINTS),
        ("tip", Real * 3),
        ("task", Int),
        ("start_at_rest", Int),
        ("start_position", _RealPerJoint),
        ("velocity", Real * 3),
        ("duration", Real),
        ("singular_tolerance", Real),
        ("damping", Real),
        ("max_speed", _RealPerJoint),
        ("max_acceleration", _RealPerJoint),
        ("min_position", _RealPerJoint),
        ("max_position", _RealPerJoint),
        ("contact_at_tip", Int),
        ("contact_link", Int),
        ("contact_point", Real * 3),
        ("normal_given", Int),
        ("normal", Real * 3),
        ("stiffness", Real),
        ("per_axis_walls", Int),
        ("mirrored_walls", Int),
        ("period_steps", Int),
        ("threshold", _RealPerJoint),
        ("arming_delay", Real),
        ("noise_mean", _RealPerJoint),
        ("noise_sd", _RealPerJoint),
        ("reaction", Int),
        ("latency_steps", Int),
        ("deceleration", Int),
        ("uncoordinated", Int),
        ("stopping_time", Real),
        ("brake_time", Real),
        ("run_length_slip", Int),
        ("run_until_free", Int),
        ("release_limit", Real),
        ("step", Real),
        ("substeps", Int),
    )


# Field by field the `Run` of problem.hpp.
RUN = np.dtype(
    [
        ("detected", np.int32),
        ("false_alarm", np.int32),
        ("detection_tick", np.int32),
        ("trigger_mask", np.uint32),
        ("detection_time_s", np.float64),
        ("end_time_s", np.float64),
        ("force_at_detection_N", np.float64),
        ("force_at_end_N", np.float64),
        ("max_force_N", np.float64),
        ("max_force_axis_N", np.float64, 3),
        ("max_compression_m", np.float64),
        ("max_deflection_m", np.float64),
        ("max_deflection_axis_m", np.float64, 3),
        ("max_travel_m", np.float64),
        ("contact_start_s", np.float64),
        ("contact_end_s", np.float64),
        ("residual_at_detection_Nm", np.float64, MAX_JOINTS),
        ("noise_at_detection_Nm", np.float64, MAX_JOINTS),
    ],
    align=True,
)

# The fields of ReferenceTrace that C++ fills, in the order of `TraceArrays` in problem.hpp.
TRACE_FIELDS = (
    "time_s",
    "position",
    "velocity",
    "point_m",
    "travel_m",
    "force_N",
    "contact_torque_Nm",
    "residual_Nm",
)


def build(compiler: str | None = None, flags: Sequence[str] | None = None, cache_dir: str | Path | None = None) -> Path:
    """Compile simulator.cpp, unless this was done before, and return the path of the shared object.

    Args:
        compiler: a command, default `$CXX` or else `c++`.
        flags: replace the default flags.
        cache_dir: where shared objects are kept, default a folder of this user's below the system's temporary
            one. A file's name holds a digest of sources, compiler and flags, so variants live side by side.
    """
    command = shlex.split(compiler or os.environ.get("CXX") or "c++")
    options = list(DEFAULT_FLAGS if flags is None else flags)
    folder = Path(cache_dir or Path(tempfile.gettempdir()) / f"bumpstop-reference-{os.getuid()}")
    sources = b"".join(path.read_bytes() for path in (SOURCE, *sorted(SOURCE.parent.glob("*.hpp"))))
    digest = hashlib.sha256(sources + "\0".join([*command, *options]).encode()).hexdigest()
    shared = folder / f"reference-{digest[:16]}.so"
    if shared.exists():
        return shared
    folder.mkdir(mode=0o700, parents=True, exist_ok=True)
    # Under a name of its own first, so that tests running side by side never load half a file.
    with tempfile.TemporaryDirectory(dir=folder) as scratch:
        unfinished = Path(scratch) / shared.name
        done = subprocess.run(
            [*command, *options, "-o", str(unfinished), str(SOURCE)],
            capture_output=True,
            text=True,
            check=False,
        )
        if done.returncode:
            raise RuntimeError(f"{shlex.join(command)} could not compile {SOURCE.name}:\n{done.stderr}")
        unfinished.replace(shared)
    return shared


@functools.cache
def library() -> ctypes.CDLL:
    """The shared object, with the types of what it returns; its layouts are those given here."""
    shared = ctypes.CDLL(str(build()))
    for function in ("reference_problem_size", "reference_run_size", "reference_tick_count"):
        getattr(shared, function).restype = ctypes.c_int64
    for function in ("reference_simulate", "reference_simulate_seeded", "reference_trace"):
        getattr(shared, function).restype = ctypes.c_int32
    for function in ("reference_forward_kinematics", "reference_jacobian", "reference_pseudo_inverse"):
        getattr(shared, function).restype = None
    if shared.reference_problem_size() != ctypes.sizeof(Problem) or shared.reference_run_size() != RUN.itemsize:
        raise RuntimeError("library.py and problem.hpp disagree about the layout of Problem or Run")
    return shared
