"""Requirements of random scenarios against a search that tries values one by one."""

from __future__ import annotations

import time

import numpy as np

import bumpstop as bs
from bumpstop.study.requirement import HIGHER_IS_HARSHER, require
from bumpstop.study.risk import VariedRisk
from bumpstop.study.variable import Variable
from study.prediction_cases import draw
from validation.findings import Cell, Findings

TITLE = "Requirements against trying every value"
SEED = 99
AGREES, STEP, BEYOND, LONGEST_S = 0.005, 0.002, 1.02, 0.05
# How far to either side of the answer every value is tried, and every how many from the mild end.
_NEAR, _FAR_STEP = 1.1, 0.03
BODIES = ("hand_finger", "lower_arm_wrist", "upper_arm_elbow", "thigh_knee")


def compare(findings: Findings, *, quick: bool) -> None:
    """Draw scenarios, solve each for every variable in turn, and try values."""
    rng = np.random.default_rng(SEED)
    count = 10 if quick else 200
    differ, unmet, slack, seconds, none, ranges = [], 0, 0, [], 0, 0
    astray: list[float] = []  # differences where the arm cannot follow its line
    astray_s: list[float] = []
    names = list(HIGHER_IS_HARSHER)
    rows: list[list[Cell]] = []
    for number in range(count):
        scenario, name = _scenario(rng, number), names[number % len(names)]
        best = np.inf
        for _ in range(2):
            begin = time.process_time()
            found = require(scenario, name)
            best = min(best, time.process_time() - begin)
        if found.erratic:
            astray_s.append(best)
        else:
            seconds.append((name, best))
        if found.value is None:
            none += 1
            unmet += int(_over(scenario, name, found.low if HIGHER_IS_HARSHER[name] else found.high) <= found.risk)
            continue
        unmet += int(_over(scenario, name, found.value) > found.risk)
        if found.binding == "range":
            ranges += 1
            continue
        quantum = Variable(name).quantum(scenario)
        tried = _tried(scenario, name, found.value, found.low, found.high, found.risk)
        if quantum is not None:
            apart = 0.0 if abs(found.value - tried) < 1.5 * quantum else 1.0
        else:
            apart = abs(found.value / tried - 1)
        (astray if found.erratic else differ).append(apart)
        if quantum is None and not found.erratic:
            worse = found.value * BEYOND if HIGHER_IS_HARSHER[name] else found.value / BEYOND
            slack += int(_over(scenario, name, worse) <= found.risk)
        findings.progress(f"{number + 1}: {name} {found.value:g}, tried {tried:g}")
    for name in names:
        times = [took for which, took in seconds if which == name]
        rows.append([name, float(np.median(times)) * 1e3, max(times) * 1e3])
    findings.say(
        f"{count} random scenarios; in {none} no value meets the risk, in {ranges} the whole range does, "
        f"and in {len(astray_s)} the arm cannot follow its line and the risk may be erratic. Values are tried "
        f"in steps of {STEP:.1%} within 10 % of the answer, and of {_FAR_STEP:.0%} from the mild end on."
    )
    findings.table(
        "Processor time of a search, the better of two",
        ["Variable", "Median [ms]", "Longest [ms]"],
        ["", ".1f", ".1f"],
        rows,
    )
    findings.check(
        "Agrees with trying", max(differ, default=0.0) <= AGREES, f"largest difference {max(differ, default=0.0):.3%}"
    )
    findings.check("The value meets the risk when evaluated", unmet == 0, f"{unmet} of {count} do not")
    findings.check("Two percent more does not", slack == 0, f"{slack} of {len(differ)} do")
    findings.table(
        "Where the arm cannot follow its line, as near a singularity (no check)",
        ["Searches", "Median [ms]", "Longest [ms]", "Within 50 ms", "With an answer tried", "Agree to 0.5 %"],
        ["d", ".1f", ".1f", "d", "d", "d"],
        [
            [
                len(astray_s),
                float(np.median(astray_s)) * 1e3 if astray_s else None,
                max(astray_s, default=0.0) * 1e3,
                sum(took <= LONGEST_S for took in astray_s),
                len(astray),
                sum(each <= AGREES for each in astray),
            ]
        ],
    )
    late = sum(took > LONGEST_S for _, took in seconds)
    findings.check(
        "Under 50 ms each",
        late == 0,
        f"{late} of {len(seconds)} take longer; median {np.median([took for _, took in seconds]) * 1e3:.0f} ms",
    )


def _scenario(rng: np.random.Generator, number: int) -> bs.Scenario:
    """A random one that starts from a pose it can use, against a body."""
    while True:
        scenario, q, velocity = draw(rng, number, 1)
        body = str(rng.choice(BODIES))
        changes = {
            "pose_rad": q[0].tolist(),
            "motion.velocity_mm_s": (1e3 * velocity[0]).tolist(),
            "contact.stiffness_N_m": None,
            "contact.body": body,
            "contact.area_cm2": float(rng.uniform(1, 6)),
        }
        try:
            changed = scenario.with_values(changes)
            law = bs.evaluate(changed)
        except bs.InputError:
            continue
        if law.undetected_probability < 1e-9:
            return changed


def _over(scenario: bs.Scenario, name: str, value: float) -> float:
    """By the public way; slower arms get as much longer to go as far."""
    changed = Variable(name).apply(scenario, value)
    if name == "motion.speed":
        longer = scenario.motion.duration_s * max(1.0, Variable(name).value(scenario) / value)
        changed = changed.with_values({"motion.duration_s": longer})
    verdict = bs.evaluate(changed).verdict
    return max(verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0)


def _tried(scenario: bs.Scenario, name: str, value: float, low: float, high: float, risk: float) -> float:
    """The harshest value before the first that fails, from the mild end."""
    variable = Variable(name)
    upward, quantum = HIGHER_IS_HARSHER[name], variable.quantum(scenario)
    risks = VariedRisk(scenario, variable, low if name == "contact.padding" else high)
    first = low if upward else high
    sign = 1 if upward else -1
    if quantum is not None:
        met = first
        while risks.at(variable.quantised(scenario, met + quantum)).over <= risk:
            met = variable.quantised(scenario, met + quantum)
        return met
    near = np.log(_NEAR)
    far = np.arange(np.log(first), np.log(value) - sign * near, sign * _FAR_STEP)
    close = np.arange(np.log(value) - sign * near, np.log(value) + sign * near, sign * STEP)
    met = first
    for candidate in np.exp(np.concatenate([far, close])):
        if not low <= candidate <= high:
            continue
        if risks.at(float(candidate)).over > risk:
            return met
        met = float(candidate)
    return met
