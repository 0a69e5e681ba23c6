"""The integrated distribution's arithmetic: twice the quadrature, and far tails with forty digits."""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import pairwise

import mpmath as mp
import numpy as np

import bumpstop as bs
from collision.cases import control_group
from validation.facts import REPOSITORY
from validation.findings import Cell, Findings

TITLE = "Convergence and far tails of the integrated distribution"
# Largest relative change of a mean or a quantile when the quadrature's order doubles.
CHANGE_ALLOWED = 1e-6
# Relative difference from 40 digits. Near 1e-100 a probability multiplies the rounding of its argument by 500.
TAIL_ALLOWED = 1e-11
# Above this probability tails come from interpolated outcomes, right to 1e-10 or better in all.
DIRECT = 1e-6
NEAR_ALLOWED = 1e-9
# Ticks are followed until the chance of no detection is below this: of tails farther out only that is known.
CUT = 1e-18
DIGITS = 40
TAILS = (1e-1, 1e-4, 1e-8, 1e-12, 1e-15, 1e-17, 1e-20, 1e-30, 1e-60)


def compare(findings: Findings, *, quick: bool) -> None:
    """Refine every example, then evaluate the tails of a small scenario in two ways."""
    # Over the time of contact in a trajectory another rule is used; its own tests say how far it is right.
    examples = [path for path in sorted((REPOSITORY / "examples").glob("*.toml")) if "trajectory" not in path.stem]
    findings.say(
        "The integrated distribution integrates over the contact offset with Gauss's rule on panels. Doubling the "
        "rule's order (refinement 2) must not change any probability as it is printed, and means and quantiles only "
        "far beyond the digits that matter."
    )
    rows: list[list[Cell]] = []
    for path in examples[:2] if quick else examples:
        rows += _refine(findings, path.stem, bs.load_scenario(path))
    findings.table(
        "Largest changes from refinement 1 to refinement 2",
        ["Example", "Quantity", "Largest relative change of mean, sd and quantiles", "at"],
        ["", "", ".1e", ""],
        rows,
    )
    _far_tails(findings, quick=quick)


def _refine(findings: Findings, name: str, scenario: bs.Scenario) -> list[list[Cell]]:
    coarse, fine = bs.evaluate(scenario), bs.evaluate(scenario, refinement=2)
    before, after = dict(_probabilities(coarse)), dict(_probabilities(fine))
    changed = [what for what in before if f"{before[what]:.4f}" != f"{after[what]:.4f}"]
    most = max(before, key=lambda what: abs(after[what] - before[what]))
    findings.check(
        f"{name}: none of {len(before)} probabilities changes in its four printed decimals",
        not changed,
        ", ".join(changed) or f"largest change {abs(after[most] - before[most]):.1e}, {most}",
    )
    rows: list[list[Cell]] = []
    for what, rough, refined in (
        ("peak force", coarse.peak_force, fine.peak_force),
        ("force at detection", coarse.force_at_detection, fine.force_at_detection),
        ("detection delay", coarse.detection_delay, fine.detection_delay),
        ("contact time", coarse.contact_duration, fine.contact_duration),
    ):
        if rough is None or refined is None:
            continue
        changes = {
            figure: abs(new - old) / abs(new)
            for (figure, old), new in zip(rough.to_json().items(), refined.to_json().values(), strict=True)
            if old is not None and new
        }
        worst = max(changes, key=lambda figure: changes[figure])
        rows.append([name, what, changes[worst], worst])
    largest = max(float(row[2] or 0) for row in rows)
    findings.check(
        f"{name}: means, standard deviations and quantiles change by less than {CHANGE_ALLOWED:g} of themselves",
        largest < CHANGE_ALLOWED,
        f"largest {largest:.1e}",
    )
    return rows


def _probabilities(result: bs.CollisionResult) -> Iterator[tuple[str, float]]:
    """Every probability that is printed, and the peak force's exceedance at 60 forces."""
    yield "false alarm", result.false_alarm_probability
    yield "undetected", result.undetected_probability
    yield "no contact", result.no_contact_probability
    yield "several joints", result.multi_joint_probability
    for j, p in enumerate(result.trigger_joint_probability, start=1):
        yield f"joint {j}", float(p)
    if result.verdict.p_over_force is not None:
        yield "over the force limit", result.verdict.p_over_force
    if result.verdict.p_over_pressure is not None:
        yield "over the pressure limit", result.verdict.p_over_pressure
    for x in np.linspace(0.5, 1.5, 60) * result.peak_force.mean:
        yield f"peak force over {x:.1f} N", result.peak_force.exceedance(float(x))


# --- Far tails ------------------------------------------------------------------------------------------------


def _far_tails(findings: Findings, *, quick: bool) -> None:
    order = 16 if quick else 40
    findings.say(
        f"P(peak force > x) of two small scenarios, never detected counted as over, evaluated with {DIGITS} digits by "
        "mpmath straight from the formula: alarm probabilities of every joint and tick by complementary error "
        f"functions, and for the half-normal offset Gauss's rule with {order} nodes between all places where the "
        f"integrand breaks. Only the stopping curve is common to both. Below {DIRECT:g} the library evaluates a tail "
        "by itself, above it interpolates, and its documentation promises as many digits for 1e-17 as for 0.3."
    )
    # Two monitored joints and a body at most 35 ms of travel away: a dozen ticks hold the whole law.
    small = control_group(
        motion__velocity_mm_s=[0, 0, -100],
        detector__thresholds_Nm=[math.inf, 10, math.inf, 20, math.inf, math.inf, math.inf],
        contact__offset_sd_s=0.005,
    )
    # Slower, so that there is more than one tick between certain silence and certain detection.
    fixed = small.with_values(
        {"motion.velocity_mm_s": [0, 0, -25], "contact.offset_law": "fixed", "contact.offset_mm": 1.17}
    )
    rows: list[list[Cell]] = []
    for name, scenario in (("half-normal offset", small), ("fixed offset", fixed)):
        result = bs.evaluate(scenario)
        if scenario.contact.offset_law == "fixed":
            forces = _between_atoms(result)
        else:
            forces = [x for p in (TAILS[2:3] if quick else TAILS) if (x := _force_of_tail(result, p)) is not None]
        near, far, farther = [], [], []  # differences, of the second relative; then probabilities
        for x, exact in zip(forces, _tails_of_40_digits(result, forces, order), strict=True):
            ours = result.peak_force.exceedance(x)
            apart = float(abs(mp.mpf(ours) / exact - 1))
            rows.append([name, x, mp.nstr(exact, 17), f"{ours:.16e}", apart])
            if exact > DIRECT:
                near.append(apart * float(exact))
            elif exact > CUT:
                far.append(apart)
            else:
                farther.append(ours)
        for where, differences, allowed in (
            (f"above {DIRECT:g} agree with {DIGITS} digits to {NEAR_ALLOWED:g}", near, NEAR_ALLOWED),
            (f"from {DIRECT:g} to {CUT:g} agree to {TAIL_ALLOWED:g} of themselves", far, TAIL_ALLOWED),
        ):
            if differences:
                findings.check(
                    f"{name}: tails {where}",
                    max(differences) < allowed,
                    f"largest difference of {len(differences)}: {max(differences):.1e}",
                )
        if farther:
            findings.check(
                f"{name}: tails below {CUT:g} are found to be that",
                max(farther) < CUT,
                f"largest of {len(farther)}: {max(farther):.1e}",
            )
    findings.table(
        f"P(peak force > x), {DIGITS} digits and ours",
        ["Scenario", "x [N]", f"{DIGITS} digits", "Ours", "Relative difference"],
        ["", ".4f", "", "", ".1e"],
        rows,
    )


def _tail(result: bs.CollisionResult, x: float) -> float:
    """P(detected, and peak force > x), computed by itself."""
    problem = result.problem
    return result.curve.line.tail_without_interpolation(problem.detector, problem.contact, x)


def _force_of_tail(result: bs.CollisionResult, p: float) -> float | None:
    """A force that is exceeded with this probability, by bisection; None where the last tick's is larger."""
    low, high = 0.0, 10 * result.peak_force.mean
    for _ in range(60):
        middle = (low + high) / 2
        low, high = (middle, high) if _tail(result, middle) > p else (low, middle)
    return low if _tail(result, low) < 2 * p else None


def _between_atoms(result: bs.CollisionResult) -> list[float]:
    """Forces halfway between the possible peaks of a fixed offset, from each of which on the tail is smaller."""
    assert result.scenario.contact.offset_mm is not None
    peaks = np.unique(result.problem.stiffness * (result.curve.max_distance - result.scenario.contact.offset_mm / 1e3))
    peaks = peaks[peaks > 0]
    forces = (peaks[1:] + peaks[:-1]) / 2
    return [float(x) for x in forces if _tail(result, float(x)) > 0]


def _tails_of_40_digits(result: bs.CollisionResult, forces: list[float], order: int) -> list[mp.mpf]:
    """P(peak force > x) for every x, never detected counted as over, from the curve's doubles by the formula."""
    with mp.workdps(DIGITS):
        stiffness = mp.mpf(result.problem.stiffness)
        farthest = [mp.mpf(float(s)) for s in result.curve.max_distance]
        depths = [mp.mpf(x) / stiffness for x in forces]
        contact = result.scenario.contact
        if contact.offset_law == "fixed":
            assert contact.offset_mm is not None
            nodes = [(mp.mpf(contact.offset_mm / 1e3), mp.mpf(1))]
        else:
            nodes = list(_offset_nodes(result, depths, order))
        tails = [mp.mpf(0)] * len(forces)
        for offset, weight in nodes:
            detected, survived = _detected_at(result, offset)
            for i, depth in enumerate(depths):
                over = mp.fsum(p for p, s in zip(detected, farthest, strict=True) if s - offset > depth)
                tails[i] += weight * (over + survived)
        return tails


def _offset_nodes(result: bs.CollisionResult, depths: list[mp.mpf], order: int) -> Iterator[tuple[mp.mpf, mp.mpf]]:
    """Offsets and weights of Gauss's rule on all smooth pieces of a half-normal distribution cut at seven sd."""
    sd = mp.mpf(result.problem.offset_size)
    largest = 7 * sd
    # The integrand breaks where contact begins one tick later, and where a tick's stopping path passes a force.
    breaks = {mp.mpf(0), largest}
    breaks |= {mp.mpf(float(s)) for s in result.curve.tick_distance}
    breaks |= {mp.mpf(float(s)) - depth for s in result.curve.max_distance for depth in depths}
    cuts = sorted(cut for cut in breaks if 0 <= cut <= largest)
    rule = _gauss_rule(order)
    norm = mp.sqrt(2 / mp.pi) / (sd * mp.erf(7 / mp.sqrt(2)))
    for low, high in pairwise(cuts):
        middle, half = (low + high) / 2, (high - low) / 2
        for x, w in rule:
            offset = middle + half * x
            yield offset, half * w * norm * mp.exp(-((offset / sd) ** 2) / 2)


def _gauss_rule(order: int) -> list[tuple[mp.mpf, mp.mpf]]:
    """Nodes and weights of Gauss and Legendre's rule on [-1, 1], by Newton's method from the doubles' nodes."""
    rule = []
    for start in np.polynomial.legendre.leggauss(order)[0]:
        x = mp.mpf(float(start))
        for _ in range(3):  # each step doubles the digits
            value, before = mp.legendre(order, x), mp.legendre(order - 1, x)
            slope = order * (before - x * value) / (1 - x * x)
            x -= value / slope
        slope = order * (mp.legendre(order - 1, x) - x * mp.legendre(order, x)) / (1 - x * x)
        rule.append((x, 2 / ((1 - x * x) * slope**2)))
    return rule


def _detected_at(result: bs.CollisionResult, offset: mp.mpf) -> tuple[list[mp.mpf], mp.mpf]:
    """P(detected at tick k) for every tick, and P(never), for one offset."""
    problem = result.problem
    survival, detected = mp.mpf(1), []
    for s, torques in zip(result.curve.tick_distance, result.curve.torque_per_newton, strict=True):
        force = problem.stiffness * max(mp.mpf(0), mp.mpf(float(s)) - offset)
        alarm = mp.mpf(0)  # 1 - product of (1 - q_j), without subtracting from one
        for a, threshold, sd in zip(torques, problem.thresholds, problem.noise_sd, strict=True):
            if math.isfinite(threshold):
                mean, scale = mp.mpf(float(a)) * force, 1 / (mp.mpf(float(sd)) * mp.sqrt(2))
                tau = mp.mpf(float(threshold))
                q = (mp.erfc((tau - mean) * scale) + mp.erfc((tau + mean) * scale)) / 2
                alarm += (1 - alarm) * q
        detected.append(survival * alarm)
        survival *= 1 - alarm
    return detected, survival
