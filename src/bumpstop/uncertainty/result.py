"""The verdict with an interval: cases, what matters most, and what was assumed."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision.summary import sign
from bumpstop.collision.verdict.verdict import ACCEPTABLE, in_json
from bumpstop.display import ASSUMED, CURVE, LIMIT, Displayed
from bumpstop.terminal import text_of
from bumpstop.uncertainty.cases import TornadoBar, UncertainCase
from bumpstop.uncertainty.conclusion import rank_of
from bumpstop.uncertainty.point_evaluation import LEVELS
from bumpstop.uncertainty.summary import case_table, tornado_table

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from rich.console import Console

    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionResult, Scenario
    from bumpstop.collision.verdict.verdict import Conclusion
    from bumpstop.uncertainty.point_evaluation import Points
    from bumpstop.uncertainty.resolved_input import ResolvedInput


@dataclass(frozen=True, eq=False)
class UncertainResult(Displayed):
    """A scenario with ``[uncertainty]``, evaluated.

    Attributes:
        scenario: as given.
        central: the distribution of the central case, whose scenario is without ``[uncertainty]``.
        inputs: the uncertain inputs.
        cases: central, confident and worst; see :class:`UncertainCase`.
        p_over_interval: probabilities over the limits that the quantiles 1 - c and c of the inputs come to.
        tornado: inputs, the greatest swing first.
        points: drawn from the inputs that have a distribution, what is assumed in its central case.
        confidence: c, as the scenario asks for it.
        conclusion: the verdict in a word.
        reason: one sentence.
        deciding: keys of assumed inputs that swap the verdict by themselves.
        evaluations: distributions that were computed.
        seed: of the points.
        notes: what was cut off and left out.
    """

    scenario: Scenario
    central: CollisionResult
    inputs: tuple[ResolvedInput, ...]
    cases: tuple[UncertainCase, ...]
    p_over_interval: tuple[float, float]
    tornado: tuple[TornadoBar, ...]
    points: Points
    confidence: float
    conclusion: Conclusion
    reason: str
    deciding: tuple[str, ...]
    evaluations: int
    seed: int
    notes: tuple[str, ...] = field(default=())

    @property
    def acceptable(self) -> bool | None:
        """Whether it holds at the stated confidence; None without limits or inconclusive."""
        return ACCEPTABLE[self.conclusion]

    def case(self, name: str) -> UncertainCase:
        """One of :attr:`cases` by its name."""
        return next(case for case in self.cases if case.name == name)

    @cached_property
    def mean_p_over(self) -> float:
        """Probability over the limits, averaged over the inputs that have a distribution; NaN without limits."""
        return float(self.points.p_over.mean())

    @cached_property
    def force_band(self) -> FloatArray:
        """Peak force [N] exceeded with each of the probabilities of :data:`LEVELS`: its quantiles 1 - c, 0.5 and c.

        Shape (3, levels).
        """
        ranked = np.sort(self.points.force, axis=0)
        ranks = [rank_of(p, len(ranked)) for p in (1 - self.confidence, 0.5, self.confidence)]
        return np.asarray(ranked[ranks])

    def _draw(self, axes: Axes) -> None:
        """Draw the tornado chart: how far each input by itself moves the use of the limit, or its median force."""
        for place, bar in enumerate(self.tornado):
            left, right = sorted((bar.utilisation_low, bar.utilisation_high))
            axes.barh(place, right - left, left=left, color=ASSUMED if bar.assumed else CURVE)
        axes.set_yticks(range(len(self.tornado)), [bar.key for bar in self.tornado])
        axes.invert_yaxis()
        axes.axvline(1, color=LIMIT)
        axes.set_xlabel("use of the limit")

    def __str__(self) -> str:
        return text_of(self.print_to, width=80, wrapped=True)

    def print_to(self, console: Console) -> None:
        """Print the verdict with its interval, then the central case, as ``bumpstop evaluate`` does."""
        judged, integrated = self.conclusion != "no_limits", self.central.kind == "exact"
        names = {
            "central": "central",
            "confident": f"{100 * self.confidence:g} % of the inputs",
            "worst": "worst admissible" if any(each.assumed for each in self.inputs) else "worst: nothing is assumed",
        }
        console.print(sign(self.conclusion), self.reason)
        console.print(case_table({names[case.name]: case for case in self.cases}, judged=judged, integrated=integrated))
        console.print(tornado_table(self.tornado, judged=judged))
        for note in self.notes:
            console.print(f"note: {note}")
        drawn = "" if integrated else f" of {self.central.samples} collisions each"
        console.print(
            f"{self.evaluations} distributions{drawn} at well-spread points, seed {self.seed}; probabilities are of "
            "exceeding a limit in one contact, not the risk of ISO 12100",
            style="dim",
        )
        console.print()
        self.central.print_to(console, case="central case")

    def to_json(self) -> dict[str, Any]:
        """The object that ``bumpstop evaluate --json`` prints; figures that are not finite are None."""
        found = self.central.to_json()
        # Whoever reads the verdict alone must not take that of the central case for it.
        found["verdict"] |= in_json(self.conclusion, self.reason)
        found["uncertainty"] = {
            "conclusion": self.conclusion,
            "acceptable": self.acceptable,
            "reason": self.reason,
            "confidence": self.confidence,
            "p_over_interval": [_finite(p) for p in self.p_over_interval],
            "mean_p_over": _finite(self.mean_p_over),
            "cases": {
                case.name: {
                    "p_over": _finite(case.p_over),
                    "false_alarm_probability": _finite(case.false_alarm),
                    "utilisation": _finite(case.utilisation),
                    "inputs": {each.key: float(x) for each, x in zip(self.inputs, case.figures, strict=True)},
                }
                for case in self.cases
            },
            "tornado": [
                {
                    "key": bar.key,
                    "low": bar.low,
                    "high": bar.high,
                    "relative": bar.relative,
                    "assumed": bar.assumed,
                    "utilisation_low": _finite(bar.utilisation_low),
                    "utilisation_high": _finite(bar.utilisation_high),
                    "p_over_low": _finite(bar.p_over_low),
                    "p_over_high": _finite(bar.p_over_high),
                    "swing": _finite(bar.swing),
                }
                for bar in self.tornado
            ],
            "force_band_N": {
                "exceedance": LEVELS.tolist(),
                **{
                    name: [_finite(force) for force in row]
                    for name, row in zip(("low", "median", "high"), self.force_band, strict=True)
                },
            },
            "deciding": list(self.deciding),
            "points": len(self.points),
            "evaluations": self.evaluations,
            "seed": self.seed,
            "notes": list(self.notes),
        }
        return found


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
