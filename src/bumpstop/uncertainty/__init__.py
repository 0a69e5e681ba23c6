"""How sure a verdict is: uncertain inputs, cases, what matters most, rare events."""

from bumpstop.uncertainty.cases import TornadoBar, UncertainCase
from bumpstop.uncertainty.evaluation import evaluate_uncertain
from bumpstop.uncertainty.judgement import Judgement, judge_situation, judge_situations
from bumpstop.uncertainty.overall_probability import overall_probability
from bumpstop.uncertainty.rare_exceedance import RareProbability, rare_exceedance
from bumpstop.uncertainty.result import UncertainResult

__all__ = [
    "Judgement",
    "RareProbability",
    "TornadoBar",
    "UncertainCase",
    "UncertainResult",
    "evaluate_uncertain",
    "judge_situation",
    "judge_situations",
    "overall_probability",
    "rare_exceedance",
]
