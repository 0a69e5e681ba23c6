"""What is computed of a scenario on screen."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Literal

from bumpstop.arrays import finite_or_none
from bumpstop.collision import evaluate
from bumpstop.collision.verdict.two_phase_use import TwoPhaseUse
from bumpstop.view.latest import SupersededError

if TYPE_CHECKING:
    from collections.abc import Callable

    from bumpstop.collision import CollisionResult, Scenario
    from bumpstop.uncertainty import UncertainResult

Tone = Literal["good", "bad", "open"]
# A word beside the colour: the verdict must be readable without colours.
_WORDS: dict[str, tuple[str, Tone]] = {
    "acceptable": ("ACCEPTABLE", "good"),
    "not_acceptable": ("NOT ACCEPTABLE", "bad"),
    "inconclusive": ("INCONCLUSIVE", "open"),
    "no_limits": ("NO VERDICT", "open"),
    "pending": ("COMPUTING", "open"),
    "refused": ("NO VERDICT", "open"),
}


@dataclass(frozen=True, eq=False)
class Answer:
    """The result of a scenario, as the page shows it.

    Attributes:
        result: computed in full, as :func:`bumpstop.evaluate` does it; of a scenario with ``[uncertainty]`` that of the
            central case.
        uncertain: the verdict with an interval, of a scenario with ``[uncertainty]``.
        checked: the warnings beside the verdict are computed, which takes a second evaluation with finer steps.
        pending: the scenario has ``[uncertainty]``, and its verdict is not computed yet: ``result`` is of the figures
            as they are given, and no verdict.
        refusal: why ``[uncertainty]`` cannot be used, and there is no verdict; else empty.
    """

    result: CollisionResult
    uncertain: UncertainResult | None = None
    pending: bool = False
    checked: bool = False
    refusal: str = ""

    @classmethod
    def of(cls, scenario: Scenario) -> Answer:
        """Compute a scenario; of one with ``[uncertainty]`` the collision of its figures as they are given.

        Raises:
            InputError: it cannot be computed.
        """
        # Threads as of the command.
        answer = cls(evaluate(scenario.without_uncertainty(), threads=2), pending=bool(scenario.uncertainty))
        # What a page says is computed here, in the thread that computes.
        _ = answer.figures
        return answer

    @classmethod
    def of_uncertain(cls, scenario: Scenario, superseded: Callable[[], bool]) -> Answer:
        """Compute the verdict of a scenario with ``[uncertainty]``, as ``bumpstop evaluate`` does it.

        Args:
            scenario: with ``[uncertainty]``.
            superseded: asked while it is computed, which takes seconds.

        Raises:
            InputError: it cannot be computed.
            SupersededError: another scenario is on screen.
        """
        from bumpstop.uncertainty import evaluate_uncertain

        def progress(_: float) -> None:
            if superseded():
                raise SupersededError

        uncertain = evaluate_uncertain(scenario, progress=progress)
        answer = cls(uncertain.central, uncertain)
        _ = answer.figures
        return answer

    @property
    def scenario(self) -> Scenario:
        """The scenario that was computed."""
        return self.result.scenario

    @property
    def conclusion(self) -> str:
        """The verdict as ``bumpstop evaluate --json`` names it; ``"pending"`` or ``"refused"`` where there is none."""
        if self.pending or self.refusal:
            return "refused" if self.refusal else "pending"
        return self.result.verdict.conclusion if self.uncertain is None else self.uncertain.conclusion

    @property
    def word(self) -> str:
        """The verdict in a word."""
        return _WORDS[self.conclusion][0]

    @property
    def tone(self) -> Tone:
        """Which of three looks the verdict has."""
        return _WORDS[self.conclusion][1]

    @property
    def sentence(self) -> str:
        """The verdict in a sentence, with its probability."""
        if self.pending:
            return "How sure the verdict is, is being computed. The figures are of the numbers as they are given."
        if self.refusal:
            return self.refusal
        return self.result.verdict.reason if self.uncertain is None else self.uncertain.reason

    def without_verdict(self, refusal: str) -> Answer:
        """The same, of which it is known that there is no verdict, and why."""
        return replace(self, pending=False, refusal=refusal)

    def with_warnings(self) -> Answer:
        """The same with what makes the verdict mean less than it says."""
        _ = self.result.warnings
        return replace(self, checked=True)

    @cached_property
    def figures(self) -> dict[str, float | None]:
        """Numbers of ``bumpstop evaluate --json`` by dotted key, from the same functions; None: not finite."""
        result, verdict = self.result, self.result.verdict
        numbers: dict[str, float | None] = {}
        for name, law in (("peak_force_N", result.peak_force), ("pressure_N_cm2", result.pressure)):
            numbers |= {f"{name}.{key}": value for key, value in law.to_json().items()}
        over = {"p_over_force": verdict.p_over_force, "p_over_pressure": verdict.p_over_pressure}
        numbers |= {f"verdict.{key}": value for key, value in over.items()}
        numbers["false_alarm_probability"] = result.false_alarm_probability
        numbers["undetected_probability"] = result.undetected_probability
        numbers["no_contact_probability"] = result.no_contact_probability
        return {key: None if value is None else finite_or_none(value) for key, value in numbers.items()}

    @property
    def limits_N(self) -> list[tuple[str, float]]:
        """The limits as peak forces, lowest first; infinite where contact is not limited, zero where not permitted."""
        limits, first = self.result.problem.limits, self.result.problem.transient_limits
        contact = self.scenario.contact
        if limits is None:
            return []
        if not limits.permitted or (first is not None and not first.permitted):
            return [("no contact permitted", 0.0)]
        if first is not None:
            phases = (("limit later", limits), ("limit at first", first))
            return [(name, phase.allowed_force_N(contact.area_cm2, contact.peak_factor)) for name, phase in phases]
        found = [("force limit", limits.force_N)]
        if limits.pressure_N_cm2 is not None:
            found.append(("pressure limit", limits.pressure_N_cm2 * contact.area_cm2 / contact.peak_factor))
        return sorted(found, key=lambda limit: limit[1])

    @property
    def marked_limits_N(self) -> list[tuple[str, float]]:
        """The limit that is met first [N], or those of two phases; none that is infinite."""
        limits = self.limits_N
        if self.result.problem.transient_limits is None:
            limits = [("limit", force) for _, force in limits[:1]]
        return [(name, force) for name, force in limits if math.isfinite(force)]

    @property
    def peak_limit_N(self) -> float:
        """What no peak may pass whenever it comes [N]: the limit met first, or that at first; infinite without one."""
        return max((force for _, force in self.marked_limits_N), default=math.inf)

    @property
    def p99_share(self) -> float:
        """The share of the limits that one collision in a hundred passes; 0 without limits."""
        result, limits, first = self.result, self.result.problem.limits, self.result.problem.transient_limits
        if limits is not None and first is not None and self.peak_limit_N > 0:
            return TwoPhaseUse.of(result, first, limits).utilisation(0.01)
        p99 = result.peak_force.quantile(0.99)
        return 0.0 if math.isinf(self.peak_limit_N) else p99 / self.peak_limit_N if self.peak_limit_N else math.inf
