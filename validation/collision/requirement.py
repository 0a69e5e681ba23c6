"""Requirements of random scenarios against a search that tries values one by one."""

from __future__ import annotations

import time

import numpy as np

import bumpstop as bs
from bumpstop.study.requirement.requirement import HIGHER_IS_WORSE, Requirement, solve_requirement
from bumpstop.study.variable import Variable
from study.prediction_cases import draw
from validation.findings import Cell, Findings

TITLE = "Requirements against trying every value"
SEED = 99
AGREES, STEP, BEYOND, MAX_DURATION_S = 0.005, 0.002, 1.02, 0.2
# How far to either side of the answer every value is tried, and every how many from the mild end.
_NEAR, _FAR_STEP = 1.1, 0.03
_MAX_TRIES = 200
TIMES = 3
BODIES = ("hand_finger", "lower_arm_wrist", "upper_arm_elbow", "thigh_knee")


def compare(findings: Findings, *, quick: bool) -> None:
    """Draw scenarios, solve each for every variable in turn, and try values."""
    rng = np.random.default_rng(SEED)
    count = 10 if quick else 200
    differ: list[float] = []
    unmet, slack, edges, none, ranges, off, passes = 0, 0, 0, 0, 0, 0, 0
    beyond: list[str] = []
    regular: list[int] = []
    seconds: list[tuple[str, float]] = []
    names = list(HIGHER_IS_WORSE)
    for number in range(count):
        scenario, name = _scenario(rng, number), names[number % len(names)]
        best = np.inf
        for _ in range(TIMES):
            begin = time.process_time()
            found = solve_requirement(scenario, name)
            best = min(best, time.process_time() - begin)
        seconds.append((name, best))
        off += found.ill_conditioned
        most_conservative = found.low if HIGHER_IS_WORSE[name] else found.high
        if found.binding == "singularity":
            passes += 1
            edge = most_conservative if found.value is None else found.value
            if not _passes_singularity(scenario, name, edge):
                regular.append(number + 1)
            tries = _tries_until_failure(scenario, name, edge, found.risk)
            beyond.append("none fails" if tries is None else f"number {tries} fails")
            findings.progress(f"{number + 1}: {name} passes a singularity, of values tried beyond {beyond[-1]}")
        if found.value is None:
            none += 1
            if found.binding != "singularity":
                unmet += int(_over(scenario, name, most_conservative) <= found.risk)
            continue
        unmet += int(_over(scenario, name, found.value) > found.risk)
        if found.binding == "range":
            ranges += 1
            differ.append(abs(_tried(scenario, name, found) / found.value - 1))
            continue
        if found.binding == "singularity":
            continue
        edges += 1
        quantum = Variable(name).quantum(scenario)
        tried = _tried(scenario, name, found)
        if quantum is not None:
            apart = 0.0 if abs(found.value - tried) < 1.5 * quantum else 1.0
        else:
            apart = abs(found.value / tried - 1)
            worse = found.value * BEYOND if HIGHER_IS_WORSE[name] else found.value / BEYOND
            slack += int(_over(scenario, name, worse) <= found.risk)
        differ.append(apart)
        findings.progress(f"{number + 1}: {name} {found.value:g}, tried {tried:g}")
    findings.say(
        f"{count} random scenarios; in {none} no value meets the risk, in {ranges} the whole range does, and {edges} "
        f"have an edge. In {off} the arm cannot follow its line, as near a singularity. Values are tried by whole "
        f"distributions, in steps of {STEP:.1%} within 10 % of the answer, and of {_FAR_STEP:.0%} from the mild end "
        f"on, or over the whole range. In {passes} the arm passes a singularity, and the answer is that it must not: "
        f"there up to {_MAX_TRIES} values within {BEYOND - 1:.0%} beyond the answer are tried until one fails: "
        f"{', '.join(beyond) or 'there is none'}."
    )
    rows: list[list[Cell]] = []
    for name in names:
        times = [took for which, took in seconds if which == name]
        rows.append([name, float(np.median(times)) * 1e3, max(times) * 1e3])
    findings.table(
        f"Processor time of a search, the best of {TIMES}",
        ["Variable", "Median [ms]", "Longest [ms]"],
        ["", ".1f", ".1f"],
        rows,
    )
    findings.check(
        "Agrees with trying",
        max(differ, default=0.0) <= AGREES,
        f"{sum(each <= AGREES for each in differ)} of {len(differ)}; largest difference {max(differ, default=0.0):.3%}",
    )
    findings.check(
        "Where a singularity binds the determinant of the Jacobian changes its sign on the way",
        not regular,
        f"{passes - len(regular)} of {passes}" + (f"; not in {regular}" if regular else ""),
    )
    findings.check("The value meets the risk when evaluated", unmet == 0, f"{unmet} of {count} do not")
    findings.check("Two percent more does not", slack == 0, f"{slack} of {edges} do")
    late = sum(took > MAX_DURATION_S for _, took in seconds)
    findings.check(
        "Under 200 ms for 95 of 100",
        late <= 0.05 * len(seconds),
        f"{late} of {len(seconds)} take longer; median {np.median([took for _, took in seconds]) * 1e3:.0f} ms, "
        f"longest {max(took for _, took in seconds) * 1e3:.0f} ms",
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
            result = bs.evaluate(changed)
        except bs.InputError:
            continue
        if result.undetected_probability < 1e-9:
            return changed


def _over(scenario: bs.Scenario, name: str, value: float) -> float:
    """By the public way; slower arms get as much longer to go as far."""
    changed = Variable(name).apply(scenario, value)
    if name == "motion.speed":
        longer = scenario.motion.duration_s * max(1.0, Variable(name).value(scenario) / value)
        changed = changed.with_values({"motion.duration_s": longer})
    verdict = bs.evaluate(changed).verdict
    return max(verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0)


def _tried(scenario: bs.Scenario, name: str, found: Requirement) -> float:
    """The least conservative value before the first that fails, from the mild end."""
    assert found.value is not None
    variable, upward = Variable(name), HIGHER_IS_WORSE[name]
    quantum = variable.quantum(scenario)
    first, last = (found.low, found.high) if upward else (found.high, found.low)
    sign = 1 if upward else -1
    if quantum is not None:
        met = first
        while met != last and _over(scenario, name, variable.quantised(scenario, met + quantum)) <= found.risk:
            met = variable.quantised(scenario, met + quantum)
        return met
    if found.binding == "range":
        values = np.append(np.arange(np.log(first), np.log(last), sign * _FAR_STEP), np.log(last))
    else:
        near, edge = sign * np.log(_NEAR), np.log(found.value)
        far = np.arange(np.log(first), edge - near, sign * _FAR_STEP)
        values = np.concatenate([far, np.arange(edge - near, edge + near, sign * STEP)])
    met = first
    for candidate in np.exp(values):
        if not found.low <= candidate <= found.high:
            continue
        if _over(scenario, name, float(candidate)) > found.risk:
            return met
        met = float(candidate)
    return found.value if found.binding == "range" else met


def _passes_singularity(scenario: bs.Scenario, name: str, value: float) -> bool:
    """Whether the determinant of the Jacobian has both signs before a detection is certain."""
    result = bs.evaluate(Variable(name).apply(scenario, value))
    problem, curve = result.problem, result.curve
    free = [j for j in range(problem.robot.dof) if j not in problem.held]
    pose = np.array(problem.q)
    signs = set()
    for position in curve.line.reaction_state[: curve.ticks, 0]:
        pose[free] = position
        signs.add(np.sign(np.linalg.det(problem.robot.jacobian(pose)[: len(free), free])))
    return len(signs) > 1


def _tries_until_failure(scenario: bs.Scenario, name: str, value: float, risk: float) -> int | None:
    """How many values just beyond this one must be tried until one fails; None: none of very many does."""
    rng = np.random.default_rng(SEED)
    sign = 1 if HIGHER_IS_WORSE[name] else -1
    for tries in range(1, _MAX_TRIES + 1):
        if _over(scenario, name, value * (1 + sign * (BEYOND - 1) * rng.uniform())) > risk:
            return tries
    return None
