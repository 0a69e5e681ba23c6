"""Slips of unit: values that a scenario may hold and an arm hardly has, one function for each."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.probability_text import percent
from bumpstop.model.drive_train.assumed import gear_doubt, rotor_doubt
from bumpstop.model.length_doubts import MAX_LENGTH_M, MIN_LENGTH_M

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision.outcome import CollisionOutcome

# Softer than any body region of the limit tables by a factor of ten [N/m], and deeper than a body can be pressed [mm].
_SOFTEST_N_M, _MAX_DEFORMATION_MM = 1000.0, 50.0
# Joint angles within a turn in radians are a small pose in degrees.
_TURN = 2 * math.pi
# Slower than this an arm creeps [mm/s]; m/s were written.
_MIN_SPEED_MM_S = 5.0
# Faster than any industrial arm turns its joints [rad/s], where their own limit is not known.
_MAX_SPEED_RAD_S = 15.0
# Braking that no industrial arm reaches [rad/s2]; degrees were written.
_MAX_ACCELERATION_RAD_S2 = 100.0
# The limit of pressure is this many times farther from being reached than that of the force, or nearer.
_AREA_AT_ODDS = 10.0
_SMALLEST_AREA_CM2 = 0.05
_LIGHTEST_KG = 0.1


def unit_slips(result: CollisionOutcome) -> list[str]:
    """A sentence about each value that looks like one of another unit."""
    return [
        *_robot(result),
        *_point(result),
        *_stiffness(result),
        *_deformation(result),
        *_angles(result),
        *_slow(result),
        *_fast_joints(result),
        *_braking(result),
        *_area(result),
        *_mass(result),
        *_thresholds(result),
        *_drives(result),
    ]


def _robot(result: CollisionOutcome) -> list[str]:
    """A lever a thousand times too long is felt at once, and every force looks small; limits may bound nothing."""
    robot = result.problem.robot
    weighs = result.problem.elastic or result.scenario.contact.arm == "two_mass"
    return list(dict.fromkeys((*robot.doubts, *(robot.mass_warnings if weighs else ()))))


def _point(result: CollisionOutcome) -> list[str]:
    contact, robot = result.scenario.contact, result.problem.robot
    # A rail without an end is no length of the arm.
    farthest = min(robot.span, MAX_LENGTH_M)
    link = contact.link or robot.tip_name
    away = math.hypot(*contact.point_m)
    if away > farthest:
        return [
            f"contact.point_m lies {away:.4g} m from {link}, farther than the whole arm of {farthest:.4g} m reaches: "
            "it is in metres, in the frame of its link."
        ]
    # Frames that are fixed to a link have lengths of their own, which are no part of the chain.
    own = next((math.hypot(*frame.origin) for frame in robot.frames if frame.name == contact.link), 0.0)
    if own > max(farthest, MIN_LENGTH_M):
        return [
            f"contact.link = {link!r} is fixed {own:.4g} m off its link, farther than the whole arm of {farthest:.4g} "
            "m reaches: lengths of a URDF are in metres."
        ]
    return []


def _stiffness(result: CollisionOutcome) -> list[str]:
    contact, told = result.scenario.contact, []
    if contact.stiffness_N_m is not None and contact.stiffness_N_m < _SOFTEST_N_M:
        # What was written of the two spellings.
        if contact.stiffness_N_mm is not None:
            told = [f"contact.stiffness_N_mm = {contact.stiffness_N_mm:g} N/mm is softer than any body."]
        else:
            told = [
                f"contact.stiffness_N_m = {contact.stiffness_N_m:g} N/m is softer than any body: N/mm are 1000 times "
                "as much (contact.stiffness_N_mm)."
            ]
    if contact.padding_N_m is not None and contact.padding_N_m < _SOFTEST_N_M:
        told.append(
            f"contact.padding_N_m = {contact.padding_N_m:g} N/m is softer than any padding: N/mm are 1000 times as "
            "much."
        )
    return told


def _deformation(result: CollisionOutcome) -> list[str]:
    risk = result.scenario.verdict.accepted_probability
    deep = result.compression.quantile(1 - risk)
    deep = deep if math.isfinite(deep) else result.compression.quantile(0.5)
    if not (math.isfinite(deep) and deep > _MAX_DEFORMATION_MM):
        return []
    return [
        f"The body is deformed by {deep:.4g} mm: no body region is a linear spring so far. Check stiffness, speed and "
        "units."
    ]


def _turning(result: CollisionOutcome) -> FloatArray:
    """Which joints turn (dof,)."""
    return np.array([joint.kind == "revolute" for joint in result.problem.robot.joints])


def _angles(result: CollisionOutcome) -> list[str]:
    scenario, turns = result.scenario, _turning(result)
    if scenario.pose_deg is not None:
        angles = np.abs(np.array(scenario.pose_deg))[turns]
        broken = (angles != np.round(angles)).any()
        if angles.size and 0 < angles.max() <= _TURN and broken:
            return [
                f"pose_deg has no joint beyond {angles.max():.4g} degrees: these look like radians, which are pose_rad."
            ]
    if scenario.pose_rad is not None:
        angles = np.abs(np.array(scenario.pose_rad))[turns]
        if angles.size and angles.max() > 2 * _TURN:
            return [f"pose_rad has a joint at {angles.max():.4g} rad: this looks like degrees, which are pose_deg."]
    return []


def _slow(result: CollisionOutcome) -> list[str]:
    if result.problem.trajectory is not None:
        return []
    speed = 1e3 * math.hypot(*result.scenario.motion.velocity)
    if speed >= _MIN_SPEED_MM_S:
        return []
    return [f"The tip moves at {speed:.4g} mm/s: an arm so slow hardly works. Speeds are in mm/s."]


def _fast_joints(result: CollisionOutcome) -> list[str]:
    problem = result.problem
    limit = problem.robot.velocity
    if problem.trajectory is not None:
        t = np.linspace(0, problem.trajectory.duration, 500)
        rates, what = np.abs(problem.trajectory.at(t, 1)).max(axis=0), "The trajectory"
    else:
        rates, what = np.abs(_rates_asked(result)), "The speed asked for"
    most = np.where(np.isfinite(limit), limit, np.where(_turning(result), _MAX_SPEED_RAD_S, np.inf))
    excess = rates / most
    joint = int(np.argmax(excess))
    if not excess[joint] > 1 + 1e-6:
        return []
    unit = "rad/s" if _turning(result)[joint] else "m/s"
    needs = f"{what} needs joint {joint + 1} at {rates[joint]:.4g} {unit}"
    if not math.isfinite(limit[joint]):
        return [f"{needs}; its limit is not known, and no industrial arm is so fast."]
    slower = "" if problem.trajectory is not None else f": it collides at {percent(1 / excess[joint])} of the speed"
    return [f"{needs}, beyond its limit of {limit[joint]:.4g} {unit}{slower}."]


def _rates_asked(result: CollisionOutcome) -> FloatArray:
    """Joint rates of least norm that the velocity asks for at the start of a line, without any limit (dof,)."""
    problem, motion = result.problem, result.scenario.motion
    free = [j for j in range(problem.robot.dof) if j not in problem.held]
    rows = 6 if motion.task == "pose" else 3
    jacobian = problem.robot.jacobian(problem.q)[:rows, free]
    target = np.concatenate([problem.velocity, np.zeros(rows - 3)])
    rates = np.zeros(problem.robot.dof)
    square = jacobian @ jacobian.T + motion.damping**2 * np.eye(rows)
    rates[free] = jacobian.T @ np.linalg.lstsq(square, target, rcond=None)[0]
    return rates


def _braking(result: CollisionOutcome) -> list[str]:
    acceleration = result.problem.joint_acceleration[_turning(result)]
    if not (acceleration.size and acceleration.max() > _MAX_ACCELERATION_RAD_S2):
        return []
    return [
        f"reaction.joint_acceleration_rad_s2 = {acceleration.max():g} is more than industrial arms brake with: it is "
        "in rad/s2, not in degrees."
    ]


def _area(result: CollisionOutcome) -> list[str]:
    """Mean pressure is force over area: a wrong area makes pressure vanish, or decide alone."""
    limits, contact = result.problem.limits, result.scenario.contact
    if limits is None or not limits.permitted or not limits.pressure_N_cm2:
        return []
    crossing = limits.force_N / limits.pressure_N_cm2 * contact.peak_factor
    if contact.area_cm2 > _AREA_AT_ODDS * crossing:
        return [
            f"contact.area_cm2 = {contact.area_cm2:g} is {contact.area_cm2 / crossing:.3g} times the area at which "
            f"both limits are reached together ({crossing:.3g} cm²): the pressure never decides. It is in cm², and "
            "100 mm² are 1 cm²."
        ]
    if contact.area_cm2 < _SMALLEST_AREA_CM2:
        return [
            f"contact.area_cm2 = {contact.area_cm2:g} is a point of {100 * contact.area_cm2:g} mm2: a mean pressure "
            "says little about an edge."
        ]
    return []


def _mass(result: CollisionOutcome) -> list[str]:
    mass = result.problem.body_mass
    if mass is None or mass >= _LIGHTEST_KG:
        return []
    return [f"contact.body_mass_kg = {mass:g} is lighter than any body region: it is in kg."]


def _thresholds(result: CollisionOutcome) -> list[str]:
    """A residual without noise never alarms by itself, which no detector does."""
    problem = result.problem
    monitored = np.isfinite(problem.thresholds)
    noiseless = [str(j + 1) for j in np.flatnonzero(monitored & (problem.noise_sd <= 0))]
    if not noiseless:
        return []
    joints = f"joint {noiseless[0]}" if len(noiseless) == 1 else f"joints {', '.join(noiseless)}"
    return [f"detector.noise_sd_Nm is 0 at {joints}: no false alarm is counted there, and none delays a detection."]


def _drives(result: CollisionOutcome) -> list[str]:
    """Rotors before their gears make an elastic arm too light, gears in another unit too soft."""
    problem = result.problem
    if not problem.elastic:
        return []
    robot, drive_train = problem.robot, problem.drive_train
    doubts = (rotor_doubt(robot, drive_train.rotor_inertia), gear_doubt(robot, drive_train.gear_stiffness))
    return [f"{doubt} Forces may be too low." for doubt in doubts if doubt]
