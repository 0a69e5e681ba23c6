"""Robots and their kinematics."""

from bumpstop.model.robot import Joint, Robot, robot_from_dict, robots, rotation_from_rpy

__all__ = ["Joint", "Robot", "robot_from_dict", "robots", "rotation_from_rpy"]
