"""Robots and their kinematics."""

from bumpstop.model.inertia import LinkInertia
from bumpstop.model.robot import Joint, Robot, robot_from_dict, robots, rotation_from_rpy

__all__ = ["Joint", "LinkInertia", "Robot", "robot_from_dict", "robots", "rotation_from_rpy"]
