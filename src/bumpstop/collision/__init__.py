"""Collisions: scenario, stopping curve, force distribution, verdict."""

from bumpstop.collision.batch import BatchResult, evaluate_batch
from bumpstop.collision.curve import StoppingCurve, stopping_curve
from bumpstop.collision.distribution.distribution import Distribution
from bumpstop.collision.evaluation import evaluate, integrate, monte_carlo
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.result import CollisionResult
from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.collision.scenario.scenario_file import load_scenario
from bumpstop.collision.verdict.verdict import Verdict

__all__ = [
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
]
