"""Both methods against the reference simulator, which simulates every collision with code of its own."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

import bumpstop as bs
from bumpstop import _native
from bumpstop.collision.distribution.contact_duration import monte_carlo_contact_duration
from bumpstop.collision.distribution.distribution import SampledDistribution
from collision.cases import VARIED, reference_settings
from reference import ReferenceRuns, half_normal_offsets, simulate, simulate_seeded
from validation.findings import Cell, Findings
from validation.scores import Score, bonferroni, distribution_scores, probability_score, trigger_scores, worst

TITLE = "Run by run against the reference simulator"
# How far a stopping curve may be from the literal path [m]; times the stiffness it is a force.
CURVE_ALLOWED = 1e-9
# Contact begins and ends where a path passes the surface; at the slowest release, a hundredth of the speed, that is
# 1e-9 m over 0.1 mm/s.
TIME_ALLOWED = 1e-5
OWN_NOISE = ("lower arm at 75", "lateral, two joints feel it")


@dataclass(frozen=True)
class Differences:
    """Largest differences between the sampled distribution and the reference simulator over the same runs.

    Attributes:
        runs, undetected: how many; of the latter only the absence of a detection is compared.
        ticks, triggers, missed: runs whose tick or whose joints differ, or that only the reference simulator detected.
        peak, at_detection: of forces [N].
        residual: [Nm].
        contact_duration: [s]; NaN where the arm stops in contact.
    """

    runs: int
    undetected: int
    ticks: int
    triggers: int
    missed: int
    peak: float
    at_detection: float
    residual: float
    contact_duration: float


def compare(findings: Findings, *, quick: bool) -> None:
    """Compare every scenario run by run, and two by their statistics."""
    runs = 20 if quick else 500
    names = list(VARIED)[:3] if quick else list(VARIED)
    findings.say(
        "The reference simulator computes everything again at every controller sub-step and shares no code with the "
        f"library. Given the same offsets and the same noise, each of {runs} collisions a scenario must come out the "
        f"same: the tick, the joints over their thresholds, and the forces within {CURVE_ALLOWED:g} m of the stopping "
        "curve, which is that length times the body's stiffness in newtons."
    )
    rows: list[list[Cell]] = []
    for name in names:
        rows.append(_same_noise(findings, name, runs))
    findings.table(
        "Runs that differ, and the largest differences of the others",
        [
            "Scenario",
            "Runs",
            "Never detected",
            "Other tick",
            "Other joints",
            "Peak force [N]",
            "Force at detection [N]",
            "Residual [Nm]",
            "Contact time [s]",
        ],
        ["", "d", "d", "d", "d", ".1e", ".1e", ".1e", ".1e"],
        rows,
    )
    _own_noise(findings, 200 if quick else 5000, quick=quick)


def _same_noise(findings: Findings, name: str, runs: int) -> list[Cell]:
    scenario = VARIED[name]
    found = _differences(scenario, runs)
    stiffness = bs.CollisionProblem.from_scenario(scenario).stiffness
    allowed = CURVE_ALLOWED * stiffness
    findings.check(
        f"{name}: {found.runs} runs have the same tick and joints",
        found.ticks == found.triggers == found.missed == 0,
        f"{found.ticks} other ticks, {found.triggers} other joints, {found.missed} detected by the reference alone",
    )
    findings.check(
        f"{name}: forces within {allowed:.1e} N",
        max(found.peak, found.at_detection) < allowed,
        f"{found.peak:.1e} N at the peak, {found.at_detection:.1e} N at detection",
    )
    if not math.isnan(found.contact_duration):
        findings.check(
            f"{name}: contact times within {TIME_ALLOWED:g} s",
            found.contact_duration < TIME_ALLOWED,
            f"{found.contact_duration:.1e} s",
        )
    return [
        name,
        found.runs,
        found.undetected,
        found.ticks,
        found.triggers,
        found.peak,
        found.at_detection,
        found.residual,
        found.contact_duration,
    ]


def _differences(scenario: bs.Scenario, runs: int, seed: int = 5) -> Differences:
    """Simulate sampled runs again with the reference simulator, with the same offsets and noise."""
    problem = bs.CollisionProblem.from_scenario(scenario)
    result = bs.evaluate(scenario, samples=runs, seed=seed)
    assert result.runs is not None
    offset, tick = result.runs["offset"], result.runs["tick"]
    ticks = _ticks_to_simulate(result)
    settings = replace(
        reference_settings(scenario),
        duration_s=ticks * problem.period_steps * scenario.simulation.step_s,
        run_until_free=scenario.reaction.kind == "reverse",
    )
    # In portions, because noise is drawn for every tick that a run might reach.
    size = max(1, 2_000_000 // (ticks * problem.robot.dof))
    theirs: list[ReferenceRuns] = []
    for begin in range(0, runs, size):
        count = min(size, runs - begin)
        noise = _native.standard_noise(seed, begin, count, ticks, problem.robot.dof)
        noise = noise * problem.noise_sd + problem.noise_mean
        theirs.append(simulate(settings, offset[begin : begin + count], noise))

    def column(field: str) -> npt.NDArray[Any]:
        return np.concatenate([getattr(part, field) for part in theirs])

    detected = tick >= 0
    same = detected & (column("detection_tick") == tick)

    def largest(field: str, ours: npt.NDArray[np.float64], among: npt.NDArray[np.bool_] = same) -> float:
        apart = np.abs(column(field)[among] - ours[among])
        return float(apart.max()) if apart.size else math.nan

    contact_duration = math.nan
    if scenario.reaction.kind == "reverse":
        ours = monte_carlo_contact_duration(problem, result.curve.kernel, tick, offset)
        both = same & np.isfinite(ours) & (result.runs["force_at_detection"] > 0)
        lasts = column("contact_end_s") - column("contact_start_s")
        contact_duration = float(np.abs(lasts - ours)[both].max()) if both.any() else math.nan
    return Differences(
        runs=runs,
        undetected=int((~detected).sum()),
        ticks=int((detected & ~same).sum()),
        triggers=int((column("trigger_mask") != result.runs["triggers"])[same].sum()),
        missed=int(column("detected")[~detected].sum()),
        peak=largest("max_force_N", result.runs["peak_force"]),
        at_detection=largest("force_at_detection_N", result.runs["force_at_detection"]),
        residual=largest("residual_at_detection_Nm", result.runs["residual"]),
        contact_duration=contact_duration,
    )


def _ticks_to_simulate(result: bs.CollisionResult) -> int:
    """How long the reference simulator runs: to the curve's end, and beyond where the curve leaves nothing to detect.

    It knows neither joint limits nor singularities: where the motion ends at one of them, it is told to.
    """
    ticks = result.curve.ticks
    if result.curve.end != "all_detected":
        return ticks
    scenario = result.scenario
    period = scenario.detector.feedback_period_s
    beyond = 20 + math.ceil(scenario.detector.arming_delay_s / period)
    return min(ticks + beyond, math.floor(scenario.motion.duration_s / period))


def _own_noise(findings: Findings, runs: int, *, quick: bool) -> None:
    """Integrated results against runs with the simulator's own offsets and noise: nothing but the model is shared."""
    findings.say(
        "With offsets and noise of its own, from another generator, the reference simulator shares nothing with the "
        f"library but the model: {runs} runs of two scenarios against the integrated distribution."
    )
    rows: list[list[Cell]] = []
    for number, name in enumerate(OWN_NOISE[:1] if quick else OWN_NOISE):
        scenario = VARIED[name]
        result = bs.evaluate(scenario)
        settings = reference_settings(
            scenario, noise_sd_Nm=result.problem.noise_sd, noise_mean_Nm=result.problem.noise_mean
        )
        offsets = half_normal_offsets(settings, runs, np.random.default_rng(80 + number), scenario.contact.offset_sd_s)
        found = simulate_seeded(settings, offsets, seed=3 + number)
        scores = _reference_scores(result, found)
        far, bound = worst(scores), bonferroni(len(scores))
        findings.check(
            f"{name}: {len(scores)} figures of {runs} runs within {bound:.1f} standard errors",
            abs(far.score) < bound,
            f"worst {far.score:+.2f}, {far.what}",
        )
        rows += [[name, score.what, score.known, score.sampled, score.score] for score in scores]
    findings.table(
        "Integrated distribution against the reference simulator with its own noise",
        ["Scenario", "Figure", "Exact", "Reference simulator", "Difference [standard errors]"],
        ["", "", ".6g", ".6g", "+.2f"],
        rows,
    )


def _reference_scores(result: bs.CollisionResult, found: ReferenceRuns) -> list[Score]:
    """Compare forces, triggers and false alarms; every run is detected."""
    after_contact = found.detected & ~found.false_alarm
    scores = [
        probability_score("P(false alarm)", result.false_alarm_probability, int(found.false_alarm.sum()), len(found)),
        probability_score("P(undetected)", result.undetected_probability, int((~found.detected).sum()), len(found)),
        *trigger_scores(result, found.trigger_mask[found.detected]),
        *distribution_scores("peak force", "N", result.peak_force, SampledDistribution(found.max_force_N)),
    ]
    at_detection = SampledDistribution(found.force_at_detection_N[after_contact])
    delay = SampledDistribution((found.detection_time_s - found.contact_start_s)[after_contact])
    scores += distribution_scores("force at detection", "N", result.force_at_detection, at_detection)
    scores += distribution_scores("detection delay", "s", result.detection_delay, delay)
    return scores
