"""Verdicts with an interval against brute force over the inputs, and rare events against the integral."""

from __future__ import annotations

import itertools
import time

import numpy as np
import numpy.typing as npt
from scipy.special import ndtr

import bumpstop as bs
from bumpstop.uncertainty import overall_probability, rare_exceedance
from bumpstop.uncertainty.point_evaluation import PointEvaluator
from collision.cases import control_group
from uncertainty.uncertain_cases import random_uncertain
from validation.findings import Cell, Findings

TITLE = "Verdicts with an interval against brute force"
# Independent draws of the inputs beside each interval.
_DRAWS = 40
# Swings that differ by less than this share have no order.
_APART = 0.1
_WITHIN = 0.05
_RUNS = 100_000
Array = npt.NDArray[np.float64]


def compare(findings: Findings, *, quick: bool) -> None:
    """Coverage, order of the tornado, inconclusive verdicts, importance sampling."""
    _coverage(findings, 3 if quick else 500)
    _order(findings, 3 if quick else 200)
    _swaps(findings, 6 if quick else 200, 40 if quick else 400)
    _swaps_at_confidence(findings, 1 if quick else 30)
    _rare(findings, 2000 if quick else _RUNS)


def _coverage(findings: Findings, count: int) -> None:
    """Further draws of the inputs, of which 95 % must lie within the 95 % case, and 90 % within the interval."""
    below, inside, held, sure = [], [], [], 0
    for seed in range(count):
        scenario = random_uncertain(seed, assumed=0)
        result = bs.evaluate_uncertain(scenario, seed=seed)
        evaluator = PointEvaluator(scenario)
        u = np.random.default_rng([5, seed]).random((_DRAWS, len(evaluator.inputs)))
        drawn = evaluator.at(np.column_stack([each.quantile(u[:, j]) for j, each in enumerate(evaluator.inputs)]))
        low, high = result.p_over_interval
        below.append((drawn.p_over <= high).mean())
        inside.append(((drawn.p_over >= low) & (drawn.p_over <= high)).mean())
        if result.acceptable:
            sure += 1
            held.append((evaluator.exceedance_ratio(drawn) <= 1).mean())
        if (seed + 1) % 50 == 0:
            findings.progress(f"{seed + 1}: below {np.mean(below):.4f}, inside {np.mean(inside):.4f}")
    error = float(np.std(below) / np.sqrt(count))
    findings.say(
        f"{count} random scenarios with one to three inputs that have a distribution; beside each interval {_DRAWS} "
        "independent draws of the inputs."
    )
    findings.check(
        "95 % of further draws lie below the 95 % case",
        np.mean(below) >= 0.95 - 4 * error,
        f"{np.mean(below):.4f}, standard error {error:.4f}",
    )
    error = float(np.std(inside) / np.sqrt(count))
    findings.check(
        "90 % of further draws lie in the interval from 5 % to 95 %",
        np.mean(inside) >= 0.9 - 4 * error,
        f"{np.mean(inside):.4f}, standard error {error:.4f}",
    )
    findings.check(
        "Where the verdict is acceptable it holds at 95 % of further draws",
        np.mean(held) >= 0.95,
        f"{np.mean(held):.4f} of the draws of {sure} acceptable scenarios",
    )


def _order(findings: Findings, count: int) -> None:
    """Of narrow ranges a swing is a derivative times the range."""
    pairs, wrong, apart = 0, 0, []
    for seed in range(count):
        scenario = random_uncertain(seed, assumed=1, distributions=3, width=0.1)
        evaluator = PointEvaluator(scenario)
        bars = {bar.key: bar.swing for bar in bs.evaluate_uncertain(scenario, points=64).tornado}
        centre, slopes = evaluator.central_figures, {}
        for j, each in enumerate(evaluator.inputs):
            low, high = each.limits(0.95)
            step = np.zeros(len(centre))
            step[j] = 0.25 * (high - low)
            use = evaluator.at(centre + np.array([-step, step])).utilisation
            slopes[each.key] = float(abs(use[1] - use[0]) / (2 * step[j]) * (high - low))
        for one, other in itertools.combinations(bars, 2):
            if abs(slopes[one] - slopes[other]) <= _APART * max(slopes[one], slopes[other]):
                continue
            pairs += 1
            wrong += (bars[one] > bars[other]) != (slopes[one] > slopes[other])
        apart += [abs(bars[key] / slopes[key] - 1) for key in bars if slopes[key] > 1e-3]
    findings.check(
        "The order of the tornado is that of finite differences",
        wrong == 0,
        f"{pairs - wrong} of {pairs} pairs that differ by more than {_APART:.0%}; a swing differs from "
        f"slope times range by {np.median(apart):.2%} in the median, {max(apart):.1%} at most",
    )


def _swaps(findings: Findings, count: int, values: int) -> None:
    """Assumed inputs alone: any value that swaps the verdict must make it inconclusive."""
    swapping, missed, needless, words = 0, 0, 0, dict.fromkeys(("acceptable", "not_acceptable", "inconclusive"), 0)
    for seed in range(count):
        scenario = random_uncertain(seed, assumed=1 + seed % 3, distributions=0)
        result, evaluator = bs.evaluate_uncertain(scenario), PointEvaluator(scenario)
        rows = _tried(evaluator, values, seed)
        ratio = evaluator.exceedance_ratio(evaluator.at(rows))
        swaps = bool((ratio > 1).any() and (ratio <= 1).any())
        words[result.conclusion] += 1
        swapping += swaps
        missed += swaps and result.conclusion != "inconclusive"
        needless += not swaps and result.conclusion == "inconclusive"
    findings.check(
        "INCONCLUSIVE wherever another value of an assumed input swaps the verdict",
        missed == 0 and swapping > 0,
        f"{swapping - missed} of {swapping} among {count} scenarios, {values} values of each: {words}; in {needless} "
        "only the search found a value that swaps",
    )


def _swaps_at_confidence(findings: Findings, count: int) -> None:
    """The same beside an input that has a distribution: the verdict at 95 % is computed anew at values of the other."""
    swapping, missed = 0, 0
    for seed in range(count):
        scenario = random_uncertain(1000 + seed, assumed=1, distributions=1)
        result, evaluator = bs.evaluate_uncertain(scenario), PointEvaluator(scenario)
        ((j, assumed),) = [(j, each) for j, each in enumerate(evaluator.inputs) if each.assumed]
        holds = set()
        for value in np.linspace(*assumed.limits(0.95), 11):
            rows = result.points.figures.copy()
            rows[:, j] = value
            ratio = np.sort(evaluator.exceedance_ratio(evaluator.at(rows)))
            holds.add(bool(ratio[244] <= 1))
        swapping += len(holds) == 2
        missed += len(holds) == 2 and result.conclusion != "inconclusive"
    findings.check(
        "So it is beside an input that has a distribution",
        missed == 0,
        f"{swapping - missed} of {swapping} among {count} scenarios",
    )


def _tried(evaluator: PointEvaluator, values: int, seed: int) -> Array:
    """Each assumed input by itself from end to end, and all of them at random."""
    ends = np.array([each.limits(0.95) for each in evaluator.inputs])
    count = len(ends)
    u = np.random.default_rng([6, seed]).random((values // 2, count))
    rows = [ends[:, 0] + u * np.ptp(ends, axis=1)]
    for j in range(count):
        alone = np.tile(evaluator.central_figures, (values // (2 * count), 1))
        alone[:, j] = np.linspace(*ends[j], len(alone))
        rows.append(alone)
    return np.concatenate(rows)


def _rare(findings: Findings, runs: int) -> None:
    """At one in a million: collisions, and the inputs."""
    rows: list[list[Cell]] = []
    cases = {
        "white noise": control_group(),
        "correlated 0.5": control_group(detector__noise_correlation=0.5),
        "correlated 0.9": control_group(detector__noise_correlation=0.9),
        "observer, correlated 0.6": control_group(detector__residual="observer", detector__noise_correlation=0.6),
        "uniform gap, stop, correlated 0.3": control_group(
            contact__offset_law="uniform", reaction__kind="stop", detector__noise_correlation=0.3
        ),
    }
    worst = 0.0
    for name, scenario in cases.items():
        law = bs.evaluate(scenario).peak_force
        force = law.quantile(1 - 1e-6)
        exact = law.exceedance(force)
        begin = time.process_time()
        found = rare_exceedance(scenario, force, runs=runs, seed=12)
        rows.append([name, exact, found.probability, found.relative_error, time.process_time() - begin])
        worst = max(worst, abs(found.probability / exact - 1))
    # Of few runs the standard error is larger than what is claimed of many.
    allowed = _WITHIN * max(1.0, (_RUNS / runs) ** 0.5)
    findings.check(
        f"Importance sampling of the noise within {allowed:.0%} of the integrated distribution at 1e-6",
        worst <= allowed,
        f"{worst:.2%} at most, {runs} runs",
    )
    table = {"contact.stiffness_N_m": {"distribution": "lognormal", "sigma": 0.1}}
    scenario = control_group(contact__area_cm2=2.0, motion__velocity_mm_s=[0, 0, -47.7], uncertainty=table)
    evaluator = PointEvaluator(scenario, far_tails=True)
    z = np.linspace(-5, 9, 281)
    over = evaluator.at(evaluator.inputs[0].quantile(ndtr(z))[:, None]).p_over
    exact = float(np.trapezoid(over * np.exp(-z * z / 2) / np.sqrt(2 * np.pi), z))
    begin = time.process_time()
    found = overall_probability(scenario, points=1024, seed=3)
    rows.append(["over the inputs", exact, found.probability, found.relative_error, time.process_time() - begin])
    findings.check(
        f"Importance sampling of the inputs within {_WITHIN:.0%} of quadrature",
        abs(found.probability / exact - 1) <= _WITHIN,
        f"{found.probability:.4g} and {exact:.4g}, {found.runs} distributions",
    )
    findings.table(
        "Rare events", ["", "exact", "estimate", "relative standard error", "processor time [s]"],
        ["", ".4g", ".4g", ".2%", ".1f"], rows,
    )  # fmt: skip
