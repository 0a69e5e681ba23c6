"""What recordings say of an arm: drives, inertia, friction, payload, and how well they are predicted."""

from bumpstop.identification.comparison import Comparison, JointScore
from bumpstop.identification.drive.current_scores import CurrentComparison, compare_currents
from bumpstop.identification.drive.drive_model import JointMotion, motor_current, stiction_share
from bumpstop.identification.drive.joint_fit import Candidate, JointFit
from bumpstop.identification.drive.joint_model_fit import JointModelFit, identify_joint_model
from bumpstop.identification.drive.joint_model_verdict import judge_currents, judge_joint_model, judge_payload
from bumpstop.identification.dynamics.dynamics_fit import DynamicsFit, identify_dynamics
from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
from bumpstop.identification.dynamics.dynamics_verdict import judge_dynamics, judge_predictions
from bumpstop.identification.dynamics.gains_fit import identify_gains
from bumpstop.identification.dynamics.physical_consistency import ConsistentFit, consistent_inertias
from bumpstop.identification.dynamics.regressor import inertial_names, inertial_regressor
from bumpstop.identification.fit import Fit, Quantity
from bumpstop.identification.fit_verdict import FitVerdict
from bumpstop.identification.payload.payload import Payload, with_payload
from bumpstop.identification.payload.payload_fit import PayloadFit, identify_payload

__all__ = [
    "Candidate",
    "Comparison",
    "ConsistentFit",
    "CurrentComparison",
    "DynamicsFit",
    "DynamicsModel",
    "Fit",
    "FitVerdict",
    "JointFit",
    "JointModelFit",
    "JointMotion",
    "JointScore",
    "Payload",
    "PayloadFit",
    "Quantity",
    "compare_currents",
    "consistent_inertias",
    "identify_dynamics",
    "identify_gains",
    "identify_joint_model",
    "identify_payload",
    "inertial_names",
    "inertial_regressor",
    "judge_currents",
    "judge_dynamics",
    "judge_joint_model",
    "judge_payload",
    "judge_predictions",
    "motor_current",
    "stiction_share",
    "with_payload",
]
