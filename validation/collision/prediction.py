"""Predicted forces against integrated distributions of random cases and against predictors of Schroeder (2013)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import bumpstop as bs
from bumpstop.collision import evaluate_batch
from bumpstop.study.directions import draw_directions
from bumpstop.study.prediction import predict_batch
from collision.cases import control_group
from study.prediction_cases import draw
from validation.findings import Cell, Findings

TITLE = "Forces predicted from the pose alone"
Floats = npt.NDArray[np.float64]
QUANTILE = 0.999
LIMIT_N = 135.0  # hand, clamped, BG/BGIA 2011
MAX_GAIN = 20.0  # rad/m
# Where the form holds, and of all cases; then shares of the force.
MIN_R2, MIN_R2_OF_ALL = 0.999, 0.95
MAX_MEDIAN_ERROR, MAX_USUAL_ERROR, MAX_MEDIAN_RATIO = 0.01, 0.05, 1.2
SEED = 77
OBSERVER_GAINS_1_S = (20.0, 60.0, 200.0)


@dataclass(frozen=True)
class Cases:
    """Detected cases with their distributions and their predictions."""

    mean: Floats
    quantile: Floats
    expected: Floats
    bound: Floats
    trusted: npt.NDArray[np.bool_]
    undetectable: Floats
    condition: Floats
    singular_value: Floats
    drawn: int
    over: int  # of all drawn and trusted, those with a quantile over their bound, whatever ended them

    def __len__(self) -> int:
        return len(self.mean)


def compare(findings: Findings, *, quick: bool) -> None:
    """Draw cases, compute their distributions, and compare."""
    rng = np.random.default_rng(SEED)
    scenarios, count = (6, 100) if quick else (500, 200)
    varied = _joined([_cases(*draw(rng, number, count)) for number in range(scenarios)])
    findings.say(
        f"{varied.drawn} random cases of two robots ({scenarios} scenarios of their own stiffness, thresholds, noise, "
        f"feedback period, latency and reaction, {count} poses, directions and speeds each); {len(varied)} of them are "
        f"detected for certain and have a joint-speed gain under {MAX_GAIN:g} rad/m. The bound is for "
        f"the quantile {QUANTILE:g}."
    )
    _accuracy(findings, varied)
    _observers(findings, rng, *((4, 20) if quick else (80, 40)))
    control = control_group()
    robot = bs.Robot.load("sia5d")
    poses = 300 if quick else 5000
    q = rng.uniform(robot.lower, robot.upper, size=(poses, robot.dof))
    q[:, 6] = 0.0
    alike = _cases(control, q, 0.05 * draw_directions("sphere", np.zeros(3), poses, rng))
    _predictors(findings, "all of them varied", varied)
    _predictors(findings, "the source's control group, pose and direction varied", alike)


def _cases(scenario: bs.Scenario, q: Floats, velocity: Floats) -> Cases:
    laws = evaluate_batch(scenario, q, velocity, probabilities=[QUANTILE], threads=2)
    found = predict_batch(scenario, q, velocity, quantile=QUANTILE)
    kept = (laws.end == "all_detected") & (laws.undetected_probability < 1e-9) & (found.gain < MAX_GAIN)
    kept &= np.isfinite(laws.mean) & np.isfinite(laws.quantile[:, 0])
    robot = bs.Robot.load(scenario.robot)
    moving = [j for j in range(robot.dof) if j + 1 not in scenario.motion.held_joints]
    values = np.linalg.svd(robot.jacobian(q)[:, :3, moving], compute_uv=False)
    return Cases(
        laws.mean[kept],
        laws.quantile[kept, 0],
        found.expected[kept],
        found.bound[kept],
        found.trusted[kept],
        found.undetectable[kept],
        (values[:, 0] / values[:, -1])[kept],
        values[kept, -1],
        len(q),
        int((found.trusted & ~(laws.quantile[:, 0] <= found.bound)).sum()),
    )


def _joined(parts: list[Cases]) -> Cases:
    arrays = [name for name in Cases.__dataclass_fields__ if name not in ("drawn", "over")]
    return Cases(
        **{name: np.concatenate([getattr(part, name) for part in parts]) for name in arrays},
        drawn=sum(part.drawn for part in parts),
        over=sum(part.over for part in parts),
    )


def _r2(predicted: Floats, exact: Floats) -> float:
    """1 - SSE/SST about the identity, in logarithms."""
    error, spread = np.log(predicted) - np.log(exact), np.log(exact) - np.log(exact).mean()
    return float(1 - (error @ error) / (spread @ spread))


def _accuracy(findings: Findings, cases: Cases) -> None:
    trusted = cases.trusted
    handed = np.where(trusted, cases.expected, cases.mean)
    rows: list[list[Cell]] = []
    for name, predicted, exact in (
        ("where the form holds", cases.expected[trusted], cases.mean[trusted]),
        ("elsewhere", cases.expected[~trusted], cases.mean[~trusted]),
        ("all", cases.expected, cases.mean),
        ("all, the integrated distribution elsewhere", handed, cases.mean),
    ):
        error = np.abs(predicted / exact - 1)
        rows.append(
            [
                name,
                len(exact) / len(cases),
                _r2(predicted, exact),
                float(np.median(error)),
                float(np.quantile(error, 0.99)),
            ]
        )
    findings.table(
        "Expected peak force against the mean of the integrated distribution",
        ["Cases", "Share", "R2 in log force", "Median error", "99 % of errors under"],
        ["", ".3f", ".5f", ".5f", ".4f"],
        rows,
    )
    r2, median, usual = (float(rows[0][column] or 0) for column in (2, 3, 4))
    findings.check("R2 where the form holds", r2 >= MIN_R2, f"{r2:.5f}, wanted {MIN_R2:g}")
    findings.check("Median error there", median <= MAX_MEDIAN_ERROR, f"{median:.2%}, at most {MAX_MEDIAN_ERROR:.0%}")
    findings.check("99 % of errors there", usual <= MAX_USUAL_ERROR, f"{usual:.2%}, at most {MAX_USUAL_ERROR:.0%}")
    r2_of_all = float(rows[2][2] or 0)
    findings.check("R2 of all cases", r2_of_all >= MIN_R2_OF_ALL, f"{r2_of_all:.4f}, wanted {MIN_R2_OF_ALL:g}")
    ratio = cases.bound[trusted] / cases.quantile[trusted]
    below = int((ratio < 1).sum())
    findings.check(
        "The bound is never below the exact quantile",
        below == 0,
        f"{below} of {len(ratio)}; the lowest ratio is {ratio.min():.5f}",
    )
    findings.check(
        "No trusted case exceeds its bound more often, however its motion ends",
        cases.over == 0,
        f"{cases.over} of {cases.drawn} drawn",
    )
    findings.table(
        "Bound over exact quantile, where the form holds",
        ["Lowest", "1 %", "Median", "99 %", "Highest"],
        [".4f"] * 5,
        [[float(x) for x in np.quantile(ratio, [0, 0.01, 0.5, 0.99, 1])]],
    )
    found = float(np.median(ratio))
    findings.check(
        "Median ratio of bound and exact quantile",
        found <= MAX_MEDIAN_RATIO,
        f"{found:.4f}, at most {MAX_MEDIAN_RATIO:g}",
    )


def _observers(findings: Findings, rng: np.random.Generator, scenarios: int, count: int) -> None:
    """The bound of detectors whose residual follows the contact slowly."""
    rows: list[list[Cell]] = []
    over = cases = 0
    for gain in OBSERVER_GAINS_1_S:
        ratios = []
        for number in range(scenarios):
            scenario, q, velocity = draw(rng, number, count)
            slow = scenario.with_values({"detector.residual": "observer", "detector.observer_gain_1_s": gain})
            found = predict_batch(slow, q, velocity, quantile=QUANTILE)
            laws = evaluate_batch(slow, q[found.trusted], velocity[found.trusted], probabilities=[QUANTILE], threads=2)
            ratios.append(found.bound[found.trusted] / laws.quantile[:, 0])
        ratio = np.concatenate(ratios)
        rows.append([gain, len(ratio), float(ratio.min()), float(np.median(ratio))])
        over += int((~(ratio >= 1)).sum())
        cases += len(ratio)
    findings.table(
        "Bound over exact quantile with an observer, where the form holds",
        ["Gain [1/s]", "Cases", "Lowest", "Median"],
        ["g", "d", ".4f", ".4f"],
        rows,
    )
    findings.check("With an observer the bound is never below the exact quantile", over == 0, f"{over} of {cases}")


def _predictors(findings: Findings, which: str, cases: Cases) -> None:
    from scipy.stats import spearmanr

    unsafe = cases.quantile > LIMIT_N
    rows: list[list[Cell]] = []
    measures = {
        "bound (cut at the limit)": cases.bound,
        "expected force": cases.expected,
        "undetectable force": cases.undetectable,
        "condition number": cases.condition,
        "smallest singular value": -cases.singular_value,
    }
    for name, value in measures.items():
        cut = LIMIT_N if name.startswith("bound") else _best_cut(value, unsafe)
        refused = value > cut
        rows.append(
            [
                name,
                abs(float(spearmanr(np.where(np.isfinite(value), value, 1e300), cases.quantile).statistic)),
                float((~refused & unsafe).sum() / max(1, unsafe.sum())),
                float((refused & ~unsafe).sum() / max(1, (~unsafe).sum())),
            ]
        )
    findings.table(
        f"Predictors of unsafe cases ({which}): {unsafe.sum()} of {len(cases)} pass {LIMIT_N:g} N with more than "
        f"{1 - QUANTILE:.3g}",
        ["Predictor", "Rank correlation", "Unsafe missed", "Safe refused"],
        ["", ".3f", ".4f", ".4f"],
        rows,
    )
    missed = float(rows[0][2] or 0)
    findings.check(f"The bound misses no unsafe case ({which})", missed == 0, f"{missed:.2%}")


def _best_cut(value: Floats, unsafe: npt.NDArray[np.bool_]) -> float:
    """The cut with the least sum of both shares of errors."""
    order = np.argsort(value)
    missed = np.cumsum(unsafe[order]) / max(1, unsafe.sum())
    refused = 1 - np.cumsum(~unsafe[order]) / max(1, (~unsafe).sum())
    return float(value[order][int(np.argmin(missed + refused))])
