"""How hard will it hit before it stops?

bumpstop tells, before anyone stands next to an industrial arm, how hard a collision will be::

    import bumpstop as bs

    scenario = bs.load_scenario("examples/01_hand_downward.toml")
    law = bs.evaluate(scenario)
    print(law.peak_force.quantile(0.99), law.verdict.reason)

Names are imported when they are first used, so that ``import bumpstop`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bumpstop.collision import (
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
    from bumpstop.contact import ContactLimits, LimitTable
    from bumpstop.errors import BumpstopError, InputError
    from bumpstop.model import Joint, Robot, robots
    from bumpstop.recording import Recording

_HOME = {
    "bumpstop.collision": (
        "Distribution",
        "CollisionResult",
        "CollisionProblem",
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
    "bumpstop.contact": ("ContactLimits", "LimitTable"),
    "bumpstop.errors": ("BumpstopError", "InputError"),
    "bumpstop.model": ("Joint", "Robot", "robots"),
    "bumpstop.recording": ("Recording",),
}
_MODULE_OF = {name: module for module, names in _HOME.items() for name in names}

__all__ = [
    "BumpstopError",
    "CollisionProblem",
    "CollisionResult",
    "ContactLimits",
    "Distribution",
    "InputError",
    "Joint",
    "LimitTable",
    "Recording",
    "Robot",
    "Scenario",
    "StoppingCurve",
    "Verdict",
    "evaluate",
    "evaluate_batch",
    "integrate",
    "load_scenario",
    "monte_carlo",
    "robots",
    "stopping_curve",
]


def __getattr__(name: str) -> Any:
    if name == "__version__":
        from importlib.metadata import version

        return version("bumpstop")
    if name not in _MODULE_OF:
        raise AttributeError(f"module 'bumpstop' has no attribute {name!r}")
    return getattr(importlib.import_module(_MODULE_OF[name]), name)


def __dir__() -> list[str]:
    return sorted([*__all__, "__version__"])
