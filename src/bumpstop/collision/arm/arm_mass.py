"""The mass with which an arm meets a body."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.model import effective_mass

if TYPE_CHECKING:
    from bumpstop.collision.scenario.contact_table import ContactTable
    from bumpstop.model import Robot


def reduced_mass(body: float, arm: float) -> float:
    """Mass with which two free bodies meet [kg]."""
    return body if np.isinf(arm) else body * arm / (body + arm)


def arm_mass_at(robot: Robot, contact: ContactTable, q: FloatArray, normal: FloatArray) -> float | None:
    """Effective mass of the arm at the contact point along a direction [kg]; None: not known or implausible.

    Args:
        robot: with the inertia of every link, or the mass is not known.
        contact: names the contact point.
        q: joint positions (dof,) [rad or m].
        normal: direction (3,), base frame, of any length.
    """
    if robot.inertia_objection:
        return None
    try:
        mass = effective_mass(robot, q, normal / np.linalg.norm(normal), contact.link, contact.point_m)
    except InputError:  # a mass matrix without an inverse says nothing
        return None
    return float(mass)
