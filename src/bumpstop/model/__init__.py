"""Robots and their kinematics."""

from bumpstop.model.inertia import LinkInertia
from bumpstop.model.robot import Frame, Joint, Robot, robots, rotation_from_rpy
from bumpstop.model.robot_file import robot_from_dict

__all__ = ["Frame", "Joint", "LinkInertia", "Robot", "robot_from_dict", "robots", "rotation_from_rpy"]
