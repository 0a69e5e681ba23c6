"""Collisions: scenario, stopping curve, force law, verdict."""

from bumpstop.collision.batch import BatchLaws, evaluate_batch
from bumpstop.collision.curve import StoppingCurve, stopping_curve
from bumpstop.collision.distribution.distribution import Distribution
from bumpstop.collision.problem import Problem
from bumpstop.collision.result import ForceLaw, evaluate, exact_law, sampled_law
from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.collision.scenario.scenario_file import load_scenario
from bumpstop.collision.verdict.verdict import Verdict

__all__ = [
    "BatchLaws",
    "Distribution",
    "ForceLaw",
    "Problem",
    "Scenario",
    "StoppingCurve",
    "Verdict",
    "evaluate",
    "evaluate_batch",
    "exact_law",
    "load_scenario",
    "sampled_law",
    "stopping_curve",
]
