"""Joint torque from motor current."""

from bumpstop.joint.model import JointParameters, JointTorqueModel, Parameter, TorqueState, joint_models

__all__ = ["JointParameters", "JointTorqueModel", "Parameter", "TorqueState", "joint_models"]
