"""Calling the reference simulator: nothing here imports the library under test.

Units are SI (m, rad, s, N, Nm); for a prismatic joint read m for rad and N for Nm. Joints and links are
counted from zero, and link j is the one that joint j moves.
"""

from __future__ import annotations

import ctypes
import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np
import numpy.typing as npt

from .library import MAX_JOINTS, RUN, TRACE_FIELDS, Int, Problem, Real, library
from .results import Floats, ReferenceRuns, ReferenceTrace
from .settings import ReferenceSettings


def simulate(settings: ReferenceSettings, offsets: npt.ArrayLike, noise: npt.ArrayLike | None = None) -> ReferenceRuns:
    """Simulate one run per offset, with the detector noise given.

    Args:
        settings: what to simulate.
        offsets: m, how far from its start the contact point meets the surface: (runs,), or (runs, 3) for
            per-axis walls; inf for no contact.
        noise: Nm, what is added to the residual: (runs, ticks, joints) with `tick_count(settings)` ticks or
            more. None is no noise.
    """
    problem = _problem(settings)
    joints = len(settings.joints)
    ticks = tick_count(settings)
    rows = _offset_rows(settings, offsets)
    if noise is None:
        noise = np.zeros((len(rows), ticks, joints))
    drawn = np.ascontiguousarray(noise, dtype=np.float64)
    if drawn.ndim != 3 or drawn.shape[0] != len(rows) or drawn.shape[2] != joints:
        raise ValueError(f"noise has shape {drawn.shape}, should be ({len(rows)}, ticks, {joints})")
    if drawn.shape[1] < ticks:
        raise ValueError(f"noise has {drawn.shape[1]} ticks, the run {ticks}")
    results = np.zeros(len(rows), dtype=RUN)
    status = library().reference_simulate(
        ctypes.byref(problem),
        ctypes.c_int64(len(rows)),
        _pointer(rows),
        _pointer(drawn),
        ctypes.c_int64(drawn.shape[1]),
        _pointer(results),
    )
    _check(status)
    return _runs(results, joints)


def simulate_seeded(settings: ReferenceSettings, offsets: npt.ArrayLike, seed: int) -> ReferenceRuns:
    """As `simulate`, with independent Gaussian noise from a generator of each run's own.

    Mean and standard deviation are those of the settings. Run r depends on (seed, r) and its offset only.
    """
    problem = _problem(settings)
    rows = _offset_rows(settings, offsets)
    results = np.zeros(len(rows), dtype=RUN)
    status = library().reference_simulate_seeded(
        ctypes.byref(problem),
        ctypes.c_int64(len(rows)),
        _pointer(rows),
        ctypes.c_uint64(seed),
        _pointer(results),
    )
    _check(status)
    return _runs(results, len(settings.joints))


def trace(settings: ReferenceSettings, offset: npt.ArrayLike, noise: npt.ArrayLike | None = None) -> ReferenceTrace:
    """One run, step by step.

    Args:
        settings: what to simulate.
        offset: m, a number, or three for per-axis walls; inf for no contact.
        noise: Nm, (ticks, joints). None is no noise. Fewer ticks than the run has are allowed: from then on
            nothing is detected.
    """
    problem = _problem(settings)
    joints = len(settings.joints)
    row = _offset_rows(settings, np.asarray(offset, dtype=np.float64)[np.newaxis])
    after_detection_s = 10.0  # far more than anything but run_until_free takes
    capacity = math.ceil((settings.duration_s + after_detection_s + settings.release_limit_s) / settings.step_s)
    if noise is None:
        noise = np.zeros((capacity // settings.period_steps + 1, joints))
    drawn = np.ascontiguousarray(noise, dtype=np.float64)
    if drawn.ndim != 2 or drawn.shape[1] != joints:
        raise ValueError(f"noise has shape {drawn.shape}, should be (ticks, {joints})")

    widths = dict.fromkeys(("position", "velocity", "contact_torque_Nm", "residual_Nm"), (joints,))
    widths["point_m"] = (3,)
    result = np.zeros(1, dtype=RUN)
    start_point, normal = np.zeros(3), np.zeros(3)
    while True:
        arrays = {name: np.zeros((capacity, *widths.get(name, ()))) for name in TRACE_FIELDS}
        pointers = (ctypes.c_void_p * len(TRACE_FIELDS))(*(a.ctypes.data for a in arrays.values()))
        steps = ctypes.c_int64()
        status = library().reference_trace(
            ctypes.byref(problem),
            _pointer(row),
            _pointer(drawn),
            ctypes.c_int64(len(drawn)),
            ctypes.c_int64(capacity),
            ctypes.byref(pointers),
            _pointer(result),
            ctypes.byref(steps),
            _pointer(start_point),
            _pointer(normal),
        )
        _check(status)
        if steps.value <= capacity:
            break
        capacity = steps.value
    recorded = {name: array[: steps.value].copy() for name, array in arrays.items()}
    return ReferenceTrace(**recorded, start_point_m=start_point, normal=normal, run=_runs(result, joints))


def tick_count(settings: ReferenceSettings) -> int:
    """Number of feedback ticks in a run without detection."""
    return int(library().reference_tick_count(ctypes.byref(_problem(settings))))


def half_normal_offsets(settings: ReferenceSettings, runs: int, rng: np.random.Generator, sd_s: float = 0.1) -> Floats:
    """Offsets as Schroeder (2013) draws them: |N(0, sd_s x speed)|; for per-axis walls each axis's own speed."""
    velocity = np.asarray(settings.velocity_m_s, dtype=np.float64)
    if settings.per_axis_walls:
        return np.abs(rng.normal(size=(runs, 3))) * sd_s * np.abs(velocity)
    return np.abs(rng.normal(size=runs)) * sd_s * float(np.linalg.norm(velocity))


def forward_kinematics(
    settings: ReferenceSettings,
    position: npt.ArrayLike,
    link: int | None = None,
    point_m: Sequence[float] = (0.0, 0.0, 0.0),
) -> tuple[Floats, Floats]:
    """Rotation (3, 3) of a link and place (3,) of a point given in its frame; by default of the tip."""
    problem, q, link, point = _kinematics_arguments(settings, position, link, point_m)
    rotation, place = np.zeros((3, 3)), np.zeros(3)
    library().reference_forward_kinematics(
        ctypes.byref(problem), _pointer(q), Int(link), _pointer(point), _pointer(rotation), _pointer(place)
    )
    return rotation, place


def jacobian(
    settings: ReferenceSettings,
    position: npt.ArrayLike,
    link: int | None = None,
    point_m: Sequence[float] = (0.0, 0.0, 0.0),
) -> Floats:
    """Geometric Jacobian (6, joints), linear rows first, of a point in a link's frame; default: the tip."""
    problem, q, link, point = _kinematics_arguments(settings, position, link, point_m)
    result = np.zeros((6, len(settings.joints)))
    library().reference_jacobian(ctypes.byref(problem), _pointer(q), Int(link), _pointer(point), _pointer(result))
    return result


def pseudo_inverse(matrix: npt.ArrayLike, tolerance: float = 1e-7, damping: float = 0.0) -> Floats:
    """Moore-Penrose inverse; with damping A^T (A A^T + damping^2 I)^-1 instead."""
    a = np.ascontiguousarray(matrix, dtype=np.float64)
    if a.ndim != 2 or max(a.shape) > MAX_JOINTS:
        raise ValueError(f"matrix has shape {a.shape}, should have two dimensions of at most {MAX_JOINTS}")
    result = np.zeros(a.shape[::-1])
    library().reference_pseudo_inverse(
        _pointer(a), Int(a.shape[0]), Int(a.shape[1]), Real(tolerance), Real(damping), _pointer(result)
    )
    return result


# --- Helpers ------------------------------------------------------------------------------------------------


def _problem(settings: ReferenceSettings) -> Problem:
    """The settings as C++ wants them; refuses what would make it read past its arrays or make no sense."""
    s = settings
    joints = len(s.joints)
    if not 1 <= joints <= MAX_JOINTS:
        raise ValueError(f"{joints} joints, should be 1 to {MAX_JOINTS}")
    for name in ("stiffness_N_m", "step_s", "duration_s"):
        if not getattr(s, name) > 0:
            raise ValueError(f"{name} is {getattr(s, name)}, should be positive")
    if s.substeps < 1 or s.period_steps < 1 or s.latency_steps < 0:
        raise ValueError("substeps and period_steps should be 1 or more, latency_steps 0 or more")
    if any(not 0 <= j < joints for j in s.held_joints) or len(set(s.held_joints)) >= joints:
        raise ValueError(f"held_joints is {s.held_joints}: joints are 0 to {joints - 1}, one must be free")
    at_tip = s.contact_link is None
    if s.per_axis_walls and (not at_tip or s.normal is not None):
        raise ValueError("per_axis_walls stand across the tip's velocity: no contact_link, no normal")

    p = Problem()
    p.joint_count = joints
    for j, joint in enumerate(s.joints):
        p.kind[j] = ("revolute", "prismatic").index(joint.kind)
        p.held[j] = j in s.held_joints
        p.origin_xyz[j][:] = _values("origin_m", joint.origin_m, 3)
        p.origin_rotation[j][:] = _values("origin_rotation", np.ravel(joint.origin_rotation), 9)
        p.axis[j][:] = _unit("axis", joint.axis)
    p.tip[:] = _values("tip_m", s.tip_m, 3)

    p.task = ("pose", "position").index(s.task)
    p.start_at_rest = ("moving", "rest").index(s.start)
    p.start_position[:joints] = _values("start_position", s.start_position, joints)
    p.velocity[:] = _values("velocity_m_s", s.velocity_m_s, 3)
    p.duration = s.duration_s
    p.singular_tolerance = s.singular_tolerance
    p.damping = s.damping
    p.max_speed[:joints] = _per_joint("max_speed", s.max_speed, joints)
    p.max_acceleration[:joints] = _per_joint("max_acceleration", s.max_acceleration, joints)
    p.min_position[:joints] = _per_joint("min_position", s.min_position, joints)
    p.max_position[:joints] = _per_joint("max_position", s.max_position, joints)
    if min(p.max_speed[:joints]) <= 0 or min(p.max_acceleration[:joints]) <= 0:
        raise ValueError("max_speed and max_acceleration should be positive")

    p.contact_at_tip = at_tip
    link, point = _contact_place(s, s.contact_link, s.contact_point_m)
    p.contact_link = link
    p.contact_point[:] = point
    p.normal_given = s.normal is not None
    p.normal[:] = (0.0, 0.0, 0.0) if s.normal is None else _unit("normal", s.normal)
    p.stiffness = s.stiffness_N_m
    p.per_axis_walls = s.per_axis_walls
    p.mirrored_walls = s.mirrored_walls

    p.period_steps = s.period_steps
    p.threshold[:joints] = _per_joint("thresholds_Nm", s.thresholds_Nm, joints)
    p.arming_delay = s.arming_delay_s
    p.noise_mean[:joints] = _per_joint("noise_mean_Nm", s.noise_mean_Nm, joints)
    p.noise_sd[:joints] = _per_joint("noise_sd_Nm", s.noise_sd_Nm, joints)

    p.reaction = ("reverse", "stop").index(s.reaction)
    p.latency_steps = s.latency_steps
    p.deceleration = ("limits", "fixed_time", "late_brake").index(s.deceleration)
    p.uncoordinated = int(s.uncoordinated)
    p.stopping_time = s.stopping_time_s
    p.brake_time = s.brake_time_s
    p.run_length_slip = s.run_length_slip
    p.run_until_free = s.run_until_free
    p.release_limit = s.release_limit_s
    p.step = s.step_s
    p.substeps = s.substeps
    return p


def _contact_place(settings: ReferenceSettings, link: int | None, point_m: Sequence[float]) -> tuple[int, list[float]]:
    """Link and point in its frame; without a link the tip's."""
    joints = len(settings.joints)
    if link is None:
        return joints - 1, _values("tip_m", settings.tip_m, 3)
    if not 0 <= link < joints:
        raise ValueError(f"link {link}, should be 0 to {joints - 1}")
    return link, _values("point_m", point_m, 3)


def _kinematics_arguments(
    settings: ReferenceSettings, position: npt.ArrayLike, link: int | None, point_m: Sequence[float]
) -> tuple[Problem, Floats, int, Floats]:
    q = np.array(_values("position", position, len(settings.joints)))
    link, point = _contact_place(settings, link, point_m)
    return _problem(settings), q, link, np.array(point)


def _values(name: str, values: npt.ArrayLike, count: int) -> list[float]:
    array = np.asarray(values, dtype=np.float64)
    if array.shape != (count,):
        raise ValueError(f"{name} has shape {array.shape}, should be ({count},)")
    return [float(v) for v in array]


def _per_joint(name: str, values: npt.ArrayLike, joints: int) -> list[float]:
    return _values(name, np.full(joints, values) if np.ndim(values) == 0 else values, joints)


def _unit(name: str, values: npt.ArrayLike) -> list[float]:
    vector = np.array(_values(name, values, 3))
    length = float(np.linalg.norm(vector))
    if not length > 0:
        raise ValueError(f"{name} should not be zero")
    return [float(v) for v in vector / length]


def _offset_rows(settings: ReferenceSettings, offsets: npt.ArrayLike) -> Floats:
    """Offsets as (runs, 3): C++ reads one or three of each row."""
    array = np.asarray(offsets, dtype=np.float64)
    if array.ndim == 1 and not settings.per_axis_walls:
        return np.repeat(array[:, np.newaxis], 3, axis=1)
    if array.ndim == 2 and array.shape[1] == 3 and settings.per_axis_walls:
        return np.ascontiguousarray(array)
    expected = "(runs, 3)" if settings.per_axis_walls else "(runs,)"
    raise ValueError(f"offsets have shape {array.shape}, should be {expected}")


def _pointer(array: npt.NDArray[Any]) -> ctypes.c_void_p:
    return ctypes.c_void_p(array.ctypes.data)


def _check(status: int) -> None:
    if status:
        raise ValueError("the contact point does not move at the start: give a normal")


def _runs(results: npt.NDArray[np.void], joints: int) -> ReferenceRuns:
    columns: dict[str, npt.NDArray[Any]] = {}
    for field in fields(ReferenceRuns):
        column = results[field.name]
        if field.name in ("detected", "false_alarm"):
            column = column.astype(bool)
        elif field.name.endswith("_at_detection_Nm"):
            column = column[:, :joints]
        columns[field.name] = np.ascontiguousarray(column)
    return ReferenceRuns(**columns)
