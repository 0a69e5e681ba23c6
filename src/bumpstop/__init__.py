"""How hard will it hit before it stops?

bumpstop tells, before anyone stands next to an industrial arm, how hard a collision will be::

    import bumpstop as bs

    scenario = bs.load_scenario("examples/01_hand_downward.toml")
    result = bs.evaluate(scenario)
    print(result.peak_force.quantile(0.99), result.verdict.reason)

The names come in groups: robots and recordings; fits of models to recordings; detectors; scenarios, results and
verdicts; studies and requirements; the simulated robot. Rooms are modules: ``bs.study``, ``bs.detection``.

Names are imported when they are first used, so that ``import bumpstop`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bumpstop.collision import (
        BatchResult,
        CollisionProblem,
        CollisionResult,
        Distribution,
        Scenario,
        StoppingCurve,
        Verdict,
        evaluate,
        evaluate_batch,
        integrate,
        load_scenario,
        monte_carlo,
        stopping_curve,
    )
    from bumpstop.contact import (
        ContactLimits,
        LimitTable,
    )
    from bumpstop.detection import (
        Detector,
        Thresholds,
        detect,
        load_labels,
        score,
        tune,
    )
    from bumpstop.errors import (
        BumpstopError,
        InputError,
    )
    from bumpstop.identification import (
        DynamicsFit,
        Payload,
        identify_dynamics,
        identify_gains,
        identify_joint_model,
        identify_payload,
    )
    from bumpstop.joint import (
        JointTorqueModel,
    )
    from bumpstop.model import (
        Joint,
        Robot,
        robots,
    )
    from bumpstop.plant import (
        Experiment,
        Plant,
    )
    from bumpstop.recording import (
        Recording,
    )
    from bumpstop.register import (
        Register,
        evaluate_register,
        load_register,
    )
    from bumpstop.study import (
        EffectivenessStudy,
        ParameterStudy,
        Requirement,
        TrajectorySpeedLimits,
        WorkspaceSpeedLimits,
        WorkspaceStudy,
        solve_requirement,
    )
    from bumpstop.uncertainty import (
        Judgement,
        UncertainResult,
        evaluate_uncertain,
        judge_situation,
        judge_situations,
    )

_HOME = {
    "bumpstop.model": (
        "Joint",
        "Robot",
        "robots",
    ),
    "bumpstop.recording": ("Recording",),
    "bumpstop.joint": ("JointTorqueModel",),
    "bumpstop.identification": (
        "DynamicsFit",
        "Payload",
        "identify_dynamics",
        "identify_gains",
        "identify_joint_model",
        "identify_payload",
    ),
    "bumpstop.detection": (
        "Detector",
        "Thresholds",
        "detect",
        "load_labels",
        "score",
        "tune",
    ),
    "bumpstop.collision": (
        "BatchResult",
        "CollisionProblem",
        "CollisionResult",
        "Distribution",
        "Scenario",
        "StoppingCurve",
        "Verdict",
        "evaluate",
        "evaluate_batch",
        "integrate",
        "load_scenario",
        "monte_carlo",
        "stopping_curve",
    ),
    "bumpstop.contact": (
        "ContactLimits",
        "LimitTable",
    ),
    "bumpstop.register": (
        "Register",
        "evaluate_register",
        "load_register",
    ),
    "bumpstop.study": (
        "EffectivenessStudy",
        "ParameterStudy",
        "Requirement",
        "TrajectorySpeedLimits",
        "WorkspaceSpeedLimits",
        "WorkspaceStudy",
        "solve_requirement",
    ),
    "bumpstop.uncertainty": (
        "Judgement",
        "UncertainResult",
        "evaluate_uncertain",
        "judge_situation",
        "judge_situations",
    ),
    "bumpstop.plant": (
        "Experiment",
        "Plant",
    ),
    "bumpstop.errors": (
        "BumpstopError",
        "InputError",
    ),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}
_ROOMS = (
    "benchmark",
    "collision",
    "contact",
    "detection",
    "identification",
    "joint",
    "measure",
    "model",
    "plant",
    "recording",
    "register",
    "report",
    "reproduction",
    "signal",
    "study",
    "uncertainty",
)

__all__ = [
    "BatchResult",
    "BumpstopError",
    "CollisionProblem",
    "CollisionResult",
    "ContactLimits",
    "Detector",
    "Distribution",
    "DynamicsFit",
    "EffectivenessStudy",
    "Experiment",
    "InputError",
    "Joint",
    "JointTorqueModel",
    "Judgement",
    "LimitTable",
    "ParameterStudy",
    "Payload",
    "Plant",
    "Recording",
    "Register",
    "Requirement",
    "Robot",
    "Scenario",
    "StoppingCurve",
    "Thresholds",
    "TrajectorySpeedLimits",
    "UncertainResult",
    "Verdict",
    "WorkspaceSpeedLimits",
    "WorkspaceStudy",
    "detect",
    "evaluate",
    "evaluate_batch",
    "evaluate_register",
    "evaluate_uncertain",
    "identify_dynamics",
    "identify_gains",
    "identify_joint_model",
    "identify_payload",
    "integrate",
    "judge_situation",
    "judge_situations",
    "load_labels",
    "load_register",
    "load_scenario",
    "monte_carlo",
    "robots",
    "score",
    "solve_requirement",
    "stopping_curve",
    "tune",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("bumpstop")
    if name in _ROOMS:
        return importlib.import_module(f"bumpstop.{name}")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'bumpstop' has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return sorted([*__all__, *_ROOMS, "__version__"])
