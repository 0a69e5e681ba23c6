"""How sure a verdict is: uncertain inputs, cases, what matters most, rare events."""

from bumpstop.uncertainty.evaluation import evaluate_uncertain
from bumpstop.uncertainty.result import TornadoBar, UncertainCase, UncertainResult

__all__ = ["TornadoBar", "UncertainCase", "UncertainResult", "evaluate_uncertain"]
