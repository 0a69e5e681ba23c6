"""Registers of contact situations: all that may happen in a cell, judged in one go, worst first."""

from bumpstop.register.evaluation import RegisterResult, SituationResult, evaluate_register
from bumpstop.register.faults import RegisterError
from bumpstop.register.register import Register, load_register
from bumpstop.register.situation import Situation

__all__ = [
    "Register",
    "RegisterError",
    "RegisterResult",
    "Situation",
    "SituationResult",
    "evaluate_register",
    "load_register",
]
