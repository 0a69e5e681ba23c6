"""Peak forces of the standard pose against an independent scalar transcription of Schroeder's simulator."""

from __future__ import annotations

import math
from itertools import product
from typing import Any

import bumpstop as bs
from collision.cases import control_group
from validation.facts import load
from validation.findings import Cell, Findings
from validation.scores import bonferroni, probability_score

TITLE = "Reference runs of the standard pose"
REFERENCE_RUNS = 10_000  # a row
BODIES = ("hand_finger", "lower_arm_wrist")
QUANTILES = {"median": 0.5, "p95": 0.95, "p99": 0.99}
# Allowed relative difference. The reference's own sampling errors are 0.05 to 0.14 % and 0.7 %.
MEAN_ALLOWED, SD_ALLOWED = 0.005, 0.03
ROUNDING_N = 0.005  # forces are given to 0.01 N


def compare(findings: Findings, *, quick: bool) -> None:
    """Compare every row with the exact and with the sampled distribution."""
    facts = load("reference_results")
    samples = 20_000 if quick else 1_000_000
    findings.say(
        "Schroeder's arm in its standard pose moves straight down onto a hand and onto a lower arm. The reference "
        f"is a scalar transcription of Schroeder's simulator, written independently, with {REFERENCE_RUNS} runs a "
        f"row. Compared are the integrated distribution and the sampled distribution with {samples} runs."
    )
    columns = [
        "Speed [mm/s]",
        "Figure",
        "Exact",
        "Sampled",
        "Reference",
        "Exact - ref.",
        "Sampled - ref.",
        "Standard errors",
    ]
    scores: list[tuple[float, str]] = []
    for body in BODIES:
        rows: list[list[Cell]] = []
        for row in facts[body]["rows"]:
            rows += _row(findings, body, row, samples, scores)
        findings.table(
            f"{body.replace('_', ' ')}: peak force and probabilities; last column: integrated distribution, in "
            "sampling errors of the reference",
            columns,
            ["g", "", ".4f", ".4f", ".4f", "+.4f", "+.4f", "+.1f"],
            rows,
        )
    bound = bonferroni(len(scores))
    far, what = max(scores, key=lambda score: abs(score[0]))
    findings.check(
        f"All {len(scores)} figures of both distributions within {bound:.1f} sampling errors of the reference's",
        abs(far) < bound,
        f"worst {far:+.2f}, {what}",
    )


def _row(
    findings: Findings, body: str, row: list[float], samples: int, scores: list[tuple[float, str]]
) -> list[list[Cell]]:
    """Check one row of the reference; returns the table's rows and appends to the scores."""
    speed, mean, sd, *others = row
    median, p95, p99, at_detection, *shares = others
    scenario = control_group(contact__body=body, motion__velocity_mm_s=[0, 0, -speed])
    exact = bs.evaluate(scenario)
    laws = (exact, bs.evaluate(scenario, samples=samples, seed=int(speed), threads=2))
    limits = exact.problem.limits
    assert limits is not None
    assert limits.pressure_N_cm2 is not None

    # name, reference, its standard error, both distributions' figure
    figures: list[tuple[str, float, float, list[float]]] = [
        ("mean [N]", mean, sd / math.sqrt(REFERENCE_RUNS), [result.peak_force.mean for result in laws]),
        ("sd [N]", sd, _sd_error(laws[1]), [result.peak_force.sd for result in laws]),
    ]
    for (name, p), value in zip(QUANTILES.items(), (median, p95, p99), strict=True):
        quantiles = [result.peak_force.quantile(p) for result in laws]
        figures.append((f"{name} [N]", value, _quantile_error(exact.peak_force, p), quantiles))
    figures.append(
        (
            "mean force at detection [N]",
            at_detection,
            exact.force_at_detection.sd / math.sqrt(REFERENCE_RUNS),
            [result.force_at_detection.mean for result in laws],
        )
    )
    rows: list[list[Cell]] = []
    for what, reference, error, ours in figures:
        # The last digit of the reference is rounded, and the sampled distribution has an error of its own.
        errors = [
            math.hypot(error, ROUNDING_N),
            math.hypot(error * math.sqrt(1 + REFERENCE_RUNS / samples), ROUNDING_N),
        ]
        parts = [(value - reference) / e for value, e in zip(ours, errors, strict=True)]
        scores += [(part, f"{body}, {speed:g} mm/s, {what}") for part in parts]
        rows.append([speed, what, *ours, reference, *(value - reference for value in ours), parts[0]])
    names = ("P(over force limit)", "P(over pressure limit, 1 cm2)", "P(over pressure limit, 2 cm2)")
    # Pressure over an area is a force limit: area times pressure.
    forces = (limits.force_N, limits.pressure_N_cm2, 2 * limits.pressure_N_cm2)
    for what, force, share in zip(names, forces, shares, strict=True):
        ours = [result.peak_force.exceedance(force) for result in laws]
        # None of a million runs does not mean that it cannot happen.
        known = [ours[0], (round(ours[1] * samples) + 0.5) / (samples + 1)]
        count = round(share * REFERENCE_RUNS)
        parts = [-probability_score(what, p, count, REFERENCE_RUNS).score for p in known]
        parts[1] /= math.sqrt(1 + REFERENCE_RUNS / samples)
        scores += [(part, f"{body}, {speed:g} mm/s, {what}") for part in parts]
        rows.append([speed, what, *ours, share, *(p - share for p in ours), parts[0]])

    for (what, value, allowed), (index, kind) in product(
        (("mean", mean, MEAN_ALLOWED), ("sd", sd, SD_ALLOWED)), enumerate(("exact", "sampled"))
    ):
        ours_now = getattr(laws[index].peak_force, what)
        findings.check(
            f"{body}, {speed:g} mm/s, {kind} distribution: {what} within {100 * allowed:g} %",
            abs(ours_now / value - 1) < allowed,
            f"{ours_now:.3f} N against {value:.2f} N ({100 * (ours_now / value - 1):+.2f} %)",
        )
    return rows


def _sd_error(result: bs.CollisionResult) -> float:
    """Standard error [N] of the reference's standard deviation, from the fourth moment of a sample."""
    values: Any = getattr(result.peak_force, "values")  # noqa: B009 - only sampled distributions have it
    sd = values.std()
    kurtosis = float((((values - values.mean()) / sd) ** 4).mean())
    return float(sd / 2 * math.sqrt((kurtosis - 1) / REFERENCE_RUNS))


def _quantile_error(force: bs.Distribution, p: float) -> float:
    """Standard error [N] of the reference's quantile: that of its probability over the density there."""
    error = math.sqrt(p * (1 - p) / REFERENCE_RUNS)
    # Half the distance between the quantiles one error either way: the density need not be smooth.
    return (force.quantile(min(p + error, 1 - 1e-9)) - force.quantile(p - error)) / 2
