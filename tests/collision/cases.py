"""Scenarios the collision tests share: Schroeder's control group, and others that differ from it in every way."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from bumpstop import CollisionProblem, Robot, Scenario
from reference import Joint, ReferenceSettings, ReferenceTrace, tick_count, trace

SIA5D_POSE = [0, 30, 0, -20, 0, -40, 0]
UR10E_POSE = [10, -80, 110, -120, -90, 20]


def control_group(**changes: Any) -> Scenario:
    """A hand under the SIA5D's tool at 50 mm/s (Schroeder's tables 5.2 and 6.1); dotted keys with ``__``."""
    data: dict[str, Any] = {
        "robot": "sia5d",
        "pose_deg": SIA5D_POSE,
        "motion": {"velocity_mm_s": [0, 0, -50], "held_joints": [7]},
        "contact": {"body": "hand_finger", "limits": "bgia2011", "area_cm2": 1.0, "offset_law": "half_normal"},
        "detector": {
            "thresholds_Nm": [20, 10, 20, 20, 20, 20, 20],
            "noise_sd_Nm": [20 / 5.5, 10 / 5.5, *[20 / 5.5] * 5],
        },
        "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 4.5},
    }
    return Scenario.from_dict(data).with_values({key.replace("__", "."): value for key, value in changes.items()})


def ur10e(**changes: Any) -> Scenario:
    """A lower arm beside the UR10e."""
    data: dict[str, Any] = {
        "robot": "ur10e",
        "pose_deg": UR10E_POSE,
        "motion": {"velocity_mm_s": [80, 40, -60]},
        "contact": {"body": "lower_arm_wrist", "limits": "ts15066", "area_cm2": 2.0},
        "detector": {"thresholds_Nm": [40, 40, 30, 12, 12, 12], "noise_sd_Nm": [7, 7, 5, 2, 2, 2]},
        "reaction": {"kind": "reverse", "joint_acceleration_rad_s2": 10},
    }
    return Scenario.from_dict(data).with_values({key.replace("__", "."): value for key, value in changes.items()})


VARIED: dict[str, Scenario] = {
    "lower arm at 75": control_group(motion__velocity_mm_s=[0, 0, -75], contact__body="lower_arm_wrist"),
    "lateral, two joints feel it": control_group(motion__velocity_mm_s=[0, 50, 0]),
    "oblique": control_group(motion__velocity_mm_s=[30, -25, -40], contact__body="upper_arm_elbow"),
    "stop with latency": control_group(
        reaction__kind="stop",
        reaction__latency_s=0.011,
        motion__velocity_mm_s=[0, 0, -60],
        contact__stiffness_N_m=12000,
    ),
    "noisy detector, false alarms": control_group(detector__noise_sd_Nm=[8, 4.5, 8, 8, 8, 8, 8]),
    "undetected at a joint limit": control_group(
        pose_deg=[0, 109.7, 0, -20, 0, -40, 0], motion__velocity_mm_s=[0, 0, -30], detector__noise_sd_Nm=3.0
    ),
    "noise mean, arming delay, uniform offset": control_group(
        detector__noise_mean_Nm=[0, 4, 0, -6, 0, 3, 0],
        detector__arming_delay_s=0.03,
        contact__offset_law="uniform",
        detector__noise_sd_Nm=2.5,
    ),
    "false alarms whose stopping path arrives beyond the end": control_group(
        detector__noise_sd_Nm=[8, 4.5, 8, 8, 8, 8, 8],
        motion__duration_s=0.1,
        contact__offset_law="fixed",
        contact__offset_mm=6.0,
        reaction__latency_s=0.03,
    ),
    "armed after contact": control_group(
        detector__arming_delay_s=0.1, contact__offset_law="fixed", contact__offset_mm=1.0
    ),
    "from rest, fixed offset, fine feedback": control_group(
        motion__start="rest", contact__offset_law="fixed", contact__offset_mm=3.3, detector__feedback_period_s=0.002
    ),
    "seven free joints, elbow of the arm hit": control_group(
        motion__held_joints=[],
        motion__velocity_mm_s=[0, 120, 0],
        contact__link="link_u",
        contact__point_m=[0.1, 0.0, 0.05],
        contact__stiffness_N_m=30000,
    ),
    "UR10e, oblique, unmonitored joint": ur10e(detector__thresholds_Nm=[40, math.inf, 30, 12, 12, 12]),
    "UR10e, position only, damped": ur10e(
        motion__task="position", motion__damping=0.05, contact__offset_law="half_normal", contact__offset_sd_s=0.02
    ),
}


def fixed(offset_mm: float, **changes: Any) -> Scenario:
    """The control group with a body at a known distance."""
    return control_group(contact__offset_law="fixed", contact__offset_mm=offset_mm, **changes)


# Detectors whose ticks are not judged each by itself.
REMEMBERING: dict[str, Scenario] = {
    "noise correlated by one half": control_group(detector__noise_correlation=0.5),
    "noise correlated by nine tenths": control_group(detector__noise_correlation=0.9, contact__offset_law="uniform"),
    "alternating noise, two joints": control_group(
        detector__noise_correlation=-0.5, motion__velocity_mm_s=[0, 50, 0], contact__offset_law="uniform"
    ),
    "correlated false alarms": control_group(
        detector__noise_correlation=0.7, detector__noise_sd_Nm=[8, 4.5, 8, 8, 8, 8, 8], contact__offset_sd_s=0.05
    ),
    "observer": control_group(detector__residual="observer"),
    "slow observer, correlated noise": control_group(
        detector__residual="observer",
        detector__observer_gain_1_s=12.0,
        detector__noise_correlation=0.95,
        contact__offset_law="uniform",
    ),
    "armed after contact, correlated": fixed(1.0, detector__arming_delay_s=0.05, detector__noise_correlation=0.8),
    "noise mean, one joint without noise, correlated": control_group(
        detector__noise_mean_Nm=[0, 3, 0, -6, 0, 0, 0],
        detector__noise_sd_Nm=[3, 2, 3, 0, 3, 3, 3],
        detector__noise_correlation=0.6,
        contact__offset_law="uniform",
    ),
    "UR10e, observer, correlated": ur10e(
        detector__residual="observer", detector__observer_gain_1_s=90.0, detector__noise_correlation=0.4
    ),
    "false alarms whose stopping path arrives, correlated": fixed(
        6.0,
        detector__noise_sd_Nm=[8, 4.5, 8, 8, 8, 8, 8],
        detector__noise_correlation=0.85,
        motion__duration_s=0.1,
        reaction__latency_s=0.03,
    ),
}


def free(mass: float, **changes: Any) -> Scenario:
    """The control group against a body that gets away, of a mass in kg."""
    return control_group(contact__kind="free", contact__body_mass_kg=mass, **changes)


# Bodies that get away.
FREE: dict[str, Scenario] = {
    # The distribution of a body that mostly gets away undetected is nearly a point, which no share above a quantile can
    # be told from: here most are detected.
    "light, mostly detected": free(
        2.0,
        detector__thresholds_Nm=[4, 2, 4, 4, 4, 4, 4],
        detector__noise_sd_Nm=0.5,
        motion__velocity_mm_s=[0, 0, -40],
        contact__offset_sd_s=0.02,
    ),
    "trunk": free(40.0, contact__stiffness_N_m=25000, contact__offset_sd_s=0.02),
    "fast, detected while it rises": free(40.0, motion__velocity_mm_s=[0, 0, -150], contact__offset_law="uniform"),
    "latency, stop": free(
        8.0, motion__velocity_mm_s=[0, 0, -250], contact__offset_law="uniform", reaction__latency_s=0.006,
        reaction__kind="stop",
    ),
    "observer, correlated noise": free(
        12.0, motion__velocity_mm_s=[0, 0, -250], contact__offset_law="uniform", detector__residual="observer",
        detector__noise_correlation=0.5,
    ),
    "false alarms before contact": free(
        20.0, detector__noise_sd_Nm=[8, 4.5, 8, 8, 8, 8, 8], motion__velocity_mm_s=[0, 60, 0],
        contact__offset_sd_s=0.03,
    ),
    "soft and heavy, fixed": free(
        60.0, contact__stiffness_N_m=8000, contact__offset_law="fixed", contact__offset_mm=1.3
    ),
    # After a false alarm the arm swings forward again and strikes most bodies then, much harder than at first.
    "false alarms beside a singularity": free(
        9.0, pose_deg=[133.29, -46.9, 35.07, 69.4, 77.78, 91.38, 0], motion__velocity_mm_s=[7.81, -12.28, -26.85],
        detector__noise_sd_Nm=[8, 4, 8, 8, 8, 8, 8],
    ),
}  # fmt: skip

# Short stops and slow retreats under bodies that take their time, where contact outlasts what the arm does.
OUTLASTING: dict[str, Scenario] = {
    "a short stop under a heavy body": free(
        60.0, contact__stiffness_N_m=8000, contact__offset_law="uniform", reaction__kind="stop",
        reaction__joint_acceleration_rad_s2=20.0, detector__thresholds_Nm=[4, 2, 4, 4, 4, 4, 4],
        detector__noise_sd_Nm=0.4,
    ),
    "a retreat from a heavy body": free(
        60.0, contact__stiffness_N_m=8000, contact__offset_law="uniform",
        detector__thresholds_Nm=[8, 4, 8, 8, 8, 8, 8], detector__noise_sd_Nm=1.5,
    ),
    "a hard retreat, late": free(
        300.0, contact__stiffness_N_m=5000, contact__offset_law="uniform", reaction__latency_s=0.03,
        reaction__joint_acceleration_rad_s2=15.0, motion__velocity_mm_s=[0, 0, -120],
    ),
    "false alarms whose stop still arrives": free(
        60.0, contact__stiffness_N_m=8000, contact__offset_law="fixed", contact__offset_mm=2.0,
        detector__noise_sd_Nm=[8, 4.5, 8, 8, 8, 8, 8], reaction__kind="stop", reaction__latency_s=0.013,
    ),
    "a motion that ends in contact": free(
        60.0, contact__stiffness_N_m=8000, contact__offset_law="fixed", contact__offset_mm=1.0,
        pose_deg=[0, 109.7, 0, -20, 0, -40, 0], motion__velocity_mm_s=[0, 0, -30],
        detector__thresholds_Nm=[6, 3, 6, 6, 6, 6, 6], detector__noise_sd_Nm=1.5, reaction__latency_s=0.02,
    ),
    "a motion shorter than the latency": free(
        30.0, contact__stiffness_N_m=20000, contact__offset_law="uniform", motion__duration_s=0.02,
        reaction__latency_s=0.01, detector__noise_sd_Nm=[8, 4.5, 8, 8, 8, 8, 8],
    ),
}  # fmt: skip


def swinging_forward(offset_mm: float, tick: int, **changes: Any) -> Scenario:
    """A slow arm beside a singularity, sure to react at a tick: it comes back behind the body, then far into it."""
    return control_group(
        **{
            "pose_deg": [133.29, -46.9, 35.07, 69.4, 77.78, 91.38, 0],
            "motion__velocity_mm_s": [7.81, -12.28, -26.85],
            "contact__stiffness_N_m": 30000.0,
            "contact__offset_law": "fixed",
            "contact__offset_mm": offset_mm,
            "detector__noise_sd_Nm": 0.0,
            "detector__noise_mean_Nm": [0, 11, 0, 0, 0, 0, 0],
            "detector__arming_delay_s": 0.004 * tick + 0.001,
        }
        | changes
    )


def reference_trace(scenario: Scenario, **changes: Any) -> ReferenceTrace:
    """The reference simulator's one run of a scenario with a fixed offset, its noise the mean, until arm and body
    separate."""
    problem, settings = (
        CollisionProblem.from_scenario(scenario),
        reference_settings(scenario, run_until_free=True, **changes),
    )
    noise = np.tile(problem.noise_mean, (tick_count(settings), 1))
    return trace(settings, problem.offset_size, noise)


def reference_settings(scenario: Scenario, **changes: Any) -> ReferenceSettings:
    """The reference simulator's settings for a scenario."""
    problem = CollisionProblem.from_scenario(scenario)
    robot, motion, contact = problem.robot, scenario.motion, scenario.contact
    link, point = robot.frame(contact.link, contact.point_m)
    settings: dict[str, Any] = {
        "joints": joints_of(robot),
        "tip_m": robot.tip_origin,
        "held_joints": tuple(problem.held),
        "start_position": problem.q,
        "velocity_m_s": problem.velocity,
        "task": motion.task,
        "start": motion.start,
        "duration_s": motion.duration_s,
        "damping": motion.damping,
        "singular_tolerance": 1e-12,
        "max_speed": robot.velocity,
        "stiffness_N_m": problem.stiffness,
        "thresholds_Nm": problem.thresholds,
        "period_steps": problem.period_steps,
        "arming_delay_s": scenario.detector.arming_delay_s,
        "reaction": scenario.reaction.kind,
        "max_acceleration": problem.joint_acceleration,
        "latency_steps": problem.latency_steps,
        "deceleration": {"constant": "limits", "constant_time": "fixed_time", "ramp": "late_brake"}[
            scenario.reaction.deceleration
        ],
        "uncoordinated": scenario.reaction.stop_category == 0,
        "stopping_time_s": scenario.reaction.stopping_time_s or 0.0,
        "brake_time_s": scenario.reaction.ramp_time_s or 0.0,
        "step_s": scenario.simulation.step_s,
        "substeps": scenario.simulation.substeps,
    }
    if contact.link is not None or any(contact.point_m):
        settings |= {"contact_link": link, "contact_point_m": tuple(point)}
    if contact.normal is not None or motion.damping > 0:
        # Damped rates do not quite go where they were asked to, and the normal is where they go.
        normal = np.array(contact.normal or problem.start.point_velocity)
        settings["normal"] = normal / np.linalg.norm(normal)
    return ReferenceSettings(**settings | changes)


def joints_of(robot: Robot) -> tuple[Joint, ...]:
    """The robot's joints as the reference simulator takes them."""
    return tuple(
        Joint(kind=joint.kind, origin_m=joint.origin, axis=joint.axis, origin_rotation=joint.rotation)
        for joint in robot.joints
    )
