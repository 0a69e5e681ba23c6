"""From a register to the results of its situations, worst first."""

from __future__ import annotations

import math
import os
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bumpstop.arrays import as_whole_number
from bumpstop.collision import evaluate
from bumpstop.collision.probability_text import use_percent
from bumpstop.collision.summary import arm_title, what_is_hit
from bumpstop.collision.verdict.two_phase_use import TwoPhaseUse
from bumpstop.collision.verdict.verdict import in_json
from bumpstop.errors import InputError
from bumpstop.register.faults import RegisterError
from bumpstop.register.inputs import Input, inputs_of
from bumpstop.register.outcome import OUTCOMES, Outcome, outcome_of
from bumpstop.register.register import Register, as_register

if TYPE_CHECKING:
    from bumpstop.collision import CollisionResult, Distribution, Verdict
    from bumpstop.register.situation import Situation
    from bumpstop.uncertainty import Judgement

_QUANTILES = {"p50": 0.5, "p95": 0.95, "p99": 0.99, "p999": 0.999}


@dataclass(frozen=True, kw_only=True)
class SituationResult:
    """What was found of one situation.

    Attributes:
        situation: what was evaluated.
        outcome: pass, fail or inconclusive.
        reason: one sentence.
        verdict: of the collision, by its limits.
        use: share of its limit that the quantile of the accepted probability takes, the larger of force and pressure
            [1], and of both phases of contact where there are two; above 1 the limit is exceeded too often. Infinite
            where no contact is permitted or the force is unbounded, NaN without limits.
        peak_force, pressure: quantiles by name [N, N/cm²]; NaN: none, infinite: without bound.
        hit: the body region and its table, or the spring.
        motion: how the arm moves, in words.
        arm: what the arm is called.
        warnings: what makes the verdict mean less than it says.
        notes: what was assumed, and what was cut short.
        inputs: values that it rests on, with where they come from.
        method: how the distribution was computed: ``"exact"`` or ``"sampled"``.
        judgement: at the stated confidence over the inputs of ``[uncertainty]``; None without that table. All figures
            are of the scenario as given.
    """

    situation: Situation
    outcome: Outcome
    reason: str
    verdict: Verdict
    use: float
    peak_force: Mapping[str, float]
    pressure: Mapping[str, float]
    hit: str
    motion: str
    arm: str
    warnings: tuple[str, ...]
    notes: tuple[str, ...]
    inputs: tuple[Input, ...]
    method: str
    judgement: Judgement | None = None

    @property
    def confidence(self) -> float | None:
        """At which the outcome holds over the inputs of ``[uncertainty]``; None without that table."""
        return None if self.judgement is None else self.judgement.confidence

    @property
    def p_over(self) -> float:
        """Probability of exceeding a limit, the larger of force and pressure [1]; NaN without limits."""
        found = [p for p in (self.verdict.p_over_force, self.verdict.p_over_pressure) if p is not None]
        return max(found, default=math.nan)

    @property
    def use_text(self) -> str:
        """The use in percent, or why there is none."""
        if math.isnan(self.use):
            return "not judged"
        if math.isinf(self.use):
            phases = (self.verdict.limits, self.verdict.transient)
            return "unbounded" if all(one is None or one.permitted for one in phases) else "no contact permitted"
        return use_percent(self.use)

    def to_json(self) -> dict[str, Any]:
        """One item of ``situations`` of ``bumpstop evaluate --json``; figures that are not finite are None."""
        situation, verdict, judged = self.situation, self.verdict.to_json(), self.judgement
        if judged is not None:
            verdict |= in_json(judged.conclusion, judged.reason)
        return {
            "name": situation.name,
            "file": str(situation.file),
            "place": situation.place,
            "outcome": self.outcome,
            "reason": self.reason,
            "use_of_limit": _finite(self.use),
            "arm": self.arm,
            "motion": self.motion,
            "hit": self.hit,
            "kind": situation.scenario.contact.kind,
            "payload_kg": situation.payload_kg,
            "frequency": situation.frequency,
            "note": situation.note,
            "peak_force_N": {name: _finite(value) for name, value in self.peak_force.items()},
            "pressure_N_cm2": {name: _finite(value) for name, value in self.pressure.items()},
            "law": self.method,
            "confidence": self.confidence,
            "verdict": verdict | {"warnings": list(self.warnings)},
            "notes": list(self.notes),
        }


@dataclass(frozen=True)
class RegisterResult:
    """The results of a register.

    Attributes:
        register: what was evaluated.
        results: of its situations, worst first.
    """

    register: Register
    results: tuple[SituationResult, ...]

    @property
    def counts(self) -> dict[Outcome, int]:
        """How many situations have each outcome, worst first."""
        found = Counter(result.outcome for result in self.results)
        return {outcome: found[outcome] for outcome in OUTCOMES}

    @property
    def outcome(self) -> Outcome:
        """The worst of all."""
        return self.results[0].outcome

    def to_json(self) -> dict[str, Any]:
        """The object that ``bumpstop evaluate --json`` prints for a register."""
        return {
            "outcome": self.outcome,
            "counts": dict(self.counts),
            "situations": [result.to_json() for result in self.results],
        }


def evaluate_register(
    register: Register,
    *,
    samples: int | None = None,
    seed: int = 0,
    threads: int = 2,
    progress: Callable[[float], None] | None = None,
) -> RegisterResult:
    """Evaluate every situation of a register.

    Args:
        register: checked situations.
        samples: of every situation, as for :func:`bumpstop.evaluate`.
        seed: likewise, and of the points of uncertain inputs.
        threads: situations that are computed at once, 1 to 256; they do not change the results. Those with
            ``[uncertainty]`` are judged in as many processes.
        progress: told the share of the situations that are done.

    Returns:
        The results, :func:`worst_first`.

    Raises:
        RegisterError: situations that cannot be computed; it names them all.
        InputError: no register, as its path is none, or a number that cannot be used.
    """
    register = as_register(register)
    as_whole_number(threads, "threads", 1, 256)
    uncertain = [situation for situation in register.situations if situation.scenario.uncertainty]
    done, work = 0, len(register.situations) + len(uncertain)

    def judged(share: float) -> None:
        if progress is not None:
            progress(share * len(uncertain) / work)

    judgements: dict[int, Judgement | InputError] = {}
    if uncertain:
        from bumpstop.uncertainty import judge_situations

        scenarios = [situation.scenario for situation in uncertain]
        # A process takes some seconds to begin.
        processes = min(threads, max(1, len(uncertain) // 4))
        words = judge_situations(scenarios, samples=samples, seed=seed, processes=processes, progress=judged)
        judgements = {id(situation): word for situation, word in zip(uncertain, words, strict=True)}

    def one(situation: Situation) -> SituationResult | InputError:
        try:
            judgement = judgements.get(id(situation))
            if isinstance(judgement, InputError):
                raise judgement
            return _evaluate(situation, judgement, samples, seed)
        except InputError as error:
            where = f"{situation.file} {situation.place}".rstrip()
            return InputError(f"{where} ({situation.name!r}), {error.field}", error.problem, error.valid)

    found: list[SituationResult | InputError] = []
    # Not for a single scenario, of which it is asked whether it is a register.
    from concurrent.futures import ThreadPoolExecutor

    with ThreadPoolExecutor(min(threads, len(register.situations), os.cpu_count() or 1)) as pool:
        for result in pool.map(one, register.situations):
            found.append(result)
            done += 1
            if progress is not None:
                progress((done + len(uncertain)) / work)
    faults = [result for result in found if isinstance(result, InputError)]
    if faults:
        raise RegisterError(str(next(iter(register.checksums))), faults)
    results = [result for result in found if isinstance(result, SituationResult)]
    return RegisterResult(register, worst_first(results))


def worst_first(results: Sequence[SituationResult]) -> tuple[SituationResult, ...]:
    """Failures, then what is inconclusive, then what passes; of each, most of a limit first."""
    return tuple(sorted(results, key=_badness))


def _badness(result: SituationResult) -> tuple[float, ...]:
    """Sorts worst first; ties stay in the order of the register."""
    use = -math.inf if math.isnan(result.use) else result.use
    p = -1.0 if math.isnan(result.p_over) else result.p_over
    return OUTCOMES.index(result.outcome), -use, -p


def _evaluate(situation: Situation, judgement: Judgement | None, samples: int | None, seed: int) -> SituationResult:
    result = evaluate(situation.scenario.without_uncertainty(), samples=samples, seed=seed)
    outcome, reason = outcome_of(situation, result, judgement)
    return SituationResult(
        situation=situation,
        outcome=outcome,
        reason=reason,
        verdict=result.verdict,
        use=_use_of_limit(result),
        peak_force=_quantiles(result.peak_force),
        pressure=_quantiles(result.pressure),
        hit=what_is_hit(result),
        motion=result.problem.motion_in_words,
        arm=arm_title(result),
        warnings=(*result.warnings, *_payload_warnings(situation, result)),
        notes=(*result.notes, *_payload_notes(situation, result)),
        inputs=inputs_of(situation, result),
        method=result.kind,
        judgement=judgement,
    )


def _use_of_limit(result: CollisionResult) -> float:
    limits, verdict = result.problem.limits, result.verdict
    transient = verdict.transient
    if limits is None:
        return math.nan
    if not limits.permitted or (transient is not None and not transient.permitted):
        return math.inf
    if transient is not None:
        return TwoPhaseUse.of(result, transient, limits).utilisation(verdict.accepted_probability)
    p = 1 - verdict.accepted_probability
    shares = [result.peak_force.quantile(p) / limits.force_N]
    if limits.pressure_N_cm2 is not None:
        shares.append(result.pressure.quantile(p) / limits.pressure_N_cm2)
    return max(shares)


def _payload_warnings(situation: Situation, result: CollisionResult) -> list[str]:
    payload, rated = situation.payload_kg, result.problem.robot.payload_kg
    found = []
    if payload is not None and rated is not None and payload > rated:
        found.append(f"The payload of {payload:g} kg is above the {rated:g} kg that the arm is rated for.")
    if payload and _has_moving_mass(result):
        found.append(
            f"The payload of {payload:g} kg is recorded, but it is no part of the moving mass that was computed."
        )
    return found


def _has_moving_mass(result: CollisionResult) -> bool:
    return result.problem.elastic or result.scenario.contact.arm == "two_mass"


def _payload_notes(situation: Situation, result: CollisionResult) -> list[str]:
    payload, found = situation.payload_kg, []
    if not payload:
        return []
    if result.problem.robot.payload_kg is None:
        found.append(f"No rated payload of this robot is known: the payload of {payload:g} kg is not compared with it.")
    if not _has_moving_mass(result) and result.scenario.reaction.stopping_table is None:
        found.append(
            f"The payload of {payload:g} kg changes no figure: it would choose rows of a stopping table, and there is "
            "none."
        )
    return found


def _quantiles(distribution: Distribution) -> dict[str, float]:
    return {name: distribution.quantile(p) for name, p in _QUANTILES.items()}


def _finite(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None
