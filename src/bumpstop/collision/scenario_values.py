"""Values of a scenario in SI, each checked against the robot."""

from __future__ import annotations

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.contact import ContactLimits
from bumpstop.detection import ResidualRecord
from bumpstop.errors import InputError
from bumpstop.model import Robot
from bumpstop.model.pose_limits import check_pose


def gives_way(scenario: Scenario) -> bool:
    """Whether more than a clamped spring gives: the arm, a mass behind the spring, or damping."""
    contact = scenario.contact
    held = contact.kind == "clamped" and contact.gauge_mass_kg is None and not contact.damping_Ns_m > 0
    return scenario.arm.model == "elastic" or not held


def mass_of_body(scenario: Scenario, limits: ContactLimits | None) -> float | None:
    """Mass of a free body [kg]; None: it is clamped."""
    contact = scenario.contact
    if contact.kind == "clamped":
        return None
    mass = contact.body_mass_kg
    if mass is None and limits is not None:
        mass = limits.effective_mass_kg
    if mass is None:
        assert limits is not None
        raise InputError(
            "contact.body_mass_kg",
            "is missing",
            f"free contact needs it: {limits.table} gives no mass of a body region",
        )
    return mass


def sd_of_noise(scenario: Scenario, robot: Robot, residuals: ResidualRecord | None) -> FloatArray:
    """Standard deviation of the noise by joint (dof,) [Nm or N]."""
    if residuals is not None:
        measured: FloatArray = residuals.rows.std(axis=0)
        return measured
    sd = scenario.detector.noise_sd_Nm
    assert sd is not None
    return per_joint(sd, robot, "detector.noise_sd_Nm")


def start_pose(scenario: Scenario, robot: Robot) -> FloatArray:
    """Start pose (dof,) [rad or m]."""
    in_degrees = scenario.pose_deg is not None
    field = "pose_deg" if in_degrees else "pose_rad"
    values = scenario.pose_deg if scenario.pose_deg is not None else scenario.pose_rad
    assert values is not None
    if len(values) != robot.dof:
        raise InputError(field, f"has {len(values)} values", f"{robot.name} has {robot.dof} joints")
    q = np.array(values, dtype=np.float64)
    turns = np.array([joint.kind == "revolute" for joint in robot.joints])
    if in_degrees:
        q[turns] = np.radians(q[turns])
    check_pose(robot, q, field, in_degrees=in_degrees)
    return q


def per_joint(value: float | list[float], robot: Robot, field: str, *, each: bool = False) -> FloatArray:
    """One number for every joint (dof,); ``each``: one for all of them is not enough."""
    if not isinstance(value, list):
        return np.full(robot.dof, float(value))
    if len(value) != robot.dof:
        other = "" if each else ", or one number for all"
        raise InputError(field, f"has {len(value)} values", f"{robot.name} has {robot.dof} joints: one for each{other}")
    return np.array(value, dtype=np.float64)


def steps_of_period(period: float, step: float) -> int:
    """Feedback period in simulation steps."""
    steps = round(period / step)
    if steps < 1 or abs(steps * step - period) > 1e-6 * step:
        raise InputError(
            "detector.feedback_period_s",
            f"{period:g} is not a whole number of simulation steps",
            f"wanted a multiple of simulation.step_s = {step:g}",
        )
    return steps
