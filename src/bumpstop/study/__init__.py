"""Studies: many collisions with a question."""

from bumpstop.shards import run, to_jsonable
from bumpstop.study.parameters.effectiveness import EffectivenessStudy
from bumpstop.study.parameters.parameters import ParameterStudy
from bumpstop.study.requirement.requirement import Requirement, solve_requirement
from bumpstop.study.speed.trajectory.trajectory_speed_limits import TrajectorySpeedLimits
from bumpstop.study.speed.workspace_speed_limits import WorkspaceSpeedLimits
from bumpstop.study.study import Study
from bumpstop.study.variable import Variable
from bumpstop.study.workspace.workspace import WorkspaceStudy

__all__ = [
    "EffectivenessStudy",
    "ParameterStudy",
    "Requirement",
    "Study",
    "TrajectorySpeedLimits",
    "Variable",
    "WorkspaceSpeedLimits",
    "WorkspaceStudy",
    "run",
    "solve_requirement",
    "to_jsonable",
]
