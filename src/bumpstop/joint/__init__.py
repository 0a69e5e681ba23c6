"""Joint torque from motor current."""

from bumpstop.joint.model import JointTorqueModel, TorqueState, joint_models
from bumpstop.joint.parameters import JointParameters, Parameter

__all__ = ["JointParameters", "JointTorqueModel", "Parameter", "TorqueState", "joint_models"]
