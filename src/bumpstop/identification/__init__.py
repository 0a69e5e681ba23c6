"""What a recording says of the arm: inertial parameters, friction and how well they predict its torques."""

from bumpstop.identification.dynamics_fit import DynamicsFit, JointScore, identify_dynamics
from bumpstop.identification.fit_file import load_fit, save_fit
from bumpstop.identification.regressor import inertial_names, inertial_regressor

__all__ = [
    "DynamicsFit",
    "JointScore",
    "identify_dynamics",
    "inertial_names",
    "inertial_regressor",
    "load_fit",
    "save_fit",
]
