"""Effectiveness in Schroeder's standard pose (its chapter 6): what it states, and what we find."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

from bumpstop.study import run
from bumpstop.study.parameters.effectiveness import EffectivenessStudy
from collision.cases import control_group
from validation.facts import load
from validation.findings import PROBABILITY, Cell, Findings, probability
from validation.scores import probability_score

TITLE = "Effectiveness in the standard pose (Schroeder 2013, chapter 6)"
TABLE = "bgia2011"
BODIES = ("hand_finger", "lower_arm_wrist", "upper_arm_elbow")
AREAS_CM2 = (0.5, 1.0, 2.0)
# Schroeder (2013) drew 1000 runs: what it saw in none of them has a probability of a few thousandths at most.
SELDOM = 1e-3
MORE_SELDOM = 1e-4


Laws = dict[tuple[str, float], "Collisions"]


@dataclass(frozen=True)
class Collisions:
    """Rows of the study of one body, direction and speed, by contact area.

    Attributes:
        by_area: columns of ``rows.parquet`` by area [cm2].
    """

    by_area: dict[float, dict[str, Any]]

    @property
    def any_area(self) -> dict[str, Any]:
        """A row of which only what the area does not change is read."""
        return self.by_area[AREAS_CM2[-1]]

    @property
    def over_force(self) -> float:
        """P(force over its limit)."""
        return float(self.any_area["p_over_force"])

    def over_pressure(self, area_cm2: float) -> float:
        """P(pressure over its limit) with an area."""
        return float(self.by_area[area_cm2]["p_over_pressure"])

    @property
    def trigger_joint_probability(self) -> list[float]:
        """By joint, given detection."""
        return [float(self.any_area[f"trigger_{j + 1}"]) for j in range(7)]

    @property
    def multi_joint_probability(self) -> float:
        """Of two or more at the tick of detection."""
        return float(self.any_area["several_joints"])


def compare(findings: Findings, *, quick: bool) -> None:
    """Ask the study for every collision of sections 6.2.1 and 6.2.2 and set it beside Schroeder's statement."""
    del quick  # integrated distributions are quick
    facts = load("dissertation")["effectiveness"]
    findings.say(
        "Straight down or sideways in the standard pose, control-group detector and reaction (table 5.2), limits of "
        "BG/BGIA 2011, by bumpstop study effectiveness. Schroeder's charts are lost; its statements in words remain. "
        "A collision counts as acceptable here when force and pressure pass their limits with a probability of at most "
        f"{SELDOM:g} each."
    )
    down = _collisions(BODIES, "down", facts["downward_speeds_mm_s"])
    aside = {speed: one for (_, speed), one in _collisions(BODIES[:1], "left", facts["lateral_speeds_mm_s"]).items()}
    statements: list[list[Cell]] = []
    _hand(findings, statements, facts, down)
    _lower_arm(findings, statements, facts, down)
    _upper_arm(findings, statements, down)
    _lateral(findings, statements, facts, aside)
    findings.table(
        "Schroeder's statements beside ours", ["Section", "Schroeder (2013)", "Ours"], ["", "", ""], statements
    )
    headings = ["Body", "Speed [mm/s]", "Mean peak force [N]", "99 % [N]", "P(over force)"]
    headings += [f"P(over pressure), {area:g} cm2" for area in AREAS_CM2]
    formats = ["", "g", ".1f", ".1f", *([PROBABILITY] * (1 + len(AREAS_CM2)))]
    findings.table("Downward", headings, formats, [_row(body, speed, result) for (body, speed), result in down.items()])
    findings.table(
        "Sideways", headings, formats, [_row("hand_finger", speed, result) for speed, result in aside.items()]
    )
    findings.table(
        "Joints that notice the sideways motion (they sum to more than 1 where joints fire together)",
        ["Speed [mm/s]", *(f"P(joint {j + 1})" for j in range(7)), "P(several at once)"],
        ["g", *([PROBABILITY] * 8)],
        [[speed, *result.trigger_joint_probability, result.multi_joint_probability] for speed, result in aside.items()],
    )


def _collisions(bodies: tuple[str, ...], direction: str, speeds: list[float]) -> Laws:
    """What the study finds of Schroeder's limit table, by body and speed."""
    study = EffectivenessStudy.of(
        control_group(), list(bodies), [direction], [float(speed) for speed in speeds], list(AREAS_CM2)
    )
    rows = run(study).rows
    found: dict[tuple[str, float], dict[float, dict[str, Any]]] = {}
    for row in rows.filter((rows["table"] == TABLE) & (rows["kind"] == "collision")).iter_rows(named=True):
        found.setdefault((row["body"], row["speed_mm_s"]), {})[row["area_cm2"]] = row
    return {which: Collisions(by_area) for which, by_area in found.items()}


def _row(body: str, speed: float, result: Collisions) -> list[Cell]:
    return [
        body.replace("_", " "),
        speed,
        result.any_area["mean_N"],
        result.any_area["p99_N"],
        result.over_force,
        *(result.over_pressure(area) for area in AREAS_CM2),
    ]


def _hand(findings: Findings, statements: list[list[Cell]], facts: dict[str, Any], down: Laws) -> None:
    over = facts["hand_downward_over_force_limit_at_mm_s"]
    hand = {speed: result for (body, speed), result in down.items() if body == "hand_finger"}
    for speed, result in hand.items():
        wanted = speed not in over
        force, pressure = probability(result.over_force), probability(result.over_pressure(2.0))
        findings.check(
            f"Hand, downward, {speed:g} mm/s, 2 cm2: {'acceptable' if wanted else 'not acceptable'}",
            result.by_area[2.0]["acceptable"] is wanted,
            f"P(over force) {force}, P(over pressure) {pressure}",
        )
    for speed in over:
        findings.check(
            f"Hand, downward, {speed:g} mm/s: most collisions pass the force limit",
            hand[speed].over_force > 0.5,
            f"{hand[speed].over_force:.4f}",
        )
    small = hand[25].over_pressure(0.5)
    findings.check("Hand, downward, 25 mm/s, 0.5 cm2: most collisions pass the pressure", small > 0.5, f"{small:.3f}")
    passing = " and ".join(f"{speed:g}" for speed in over)
    ours = ", ".join(f"{speed:g} mm/s: {probability(result.over_force)}" for speed, result in hand.items())
    one, two = (probability(hand[50].over_pressure(area)) for area in (1.0, 2.0))
    statements += [
        ["6.2.1", f"hand: the force limit is passed at {passing} mm/s", f"P(over force): {ours}"],
        [
            "6.2.1",
            "hand, 50 mm/s: acceptable once the area is 2 cm2 instead of 1 cm2",
            f"P(over pressure) {one} with 1 cm2, {two} with 2 cm2",
        ],
        ["6.2.1", "hand, 25 mm/s: over the pressure limit with 0.5 cm2", f"P(over pressure) {small:.3f}"],
    ]


def _lower_arm(findings: Findings, statements: list[list[Cell]], facts: dict[str, Any], down: Laws) -> None:
    arm = {speed: result for (body, speed), result in down.items() if body == "lower_arm_wrist"}
    for speed, result in arm.items():
        findings.check(
            f"Lower arm, downward, {speed:g} mm/s: P(over 160 N) below {SELDOM:g}",
            result.over_force < SELDOM,
            probability(result.over_force),
        )
    for speed, area in ((10, 1.0), (25, 1.0), (50, 2.0)):
        p = arm[speed].over_pressure(area)
        findings.check(
            f"Lower arm, downward, {speed} mm/s, {area:g} cm2: P(over pressure) below {SELDOM:g}",
            p < SELDOM,
            probability(p),
        )
    counted, runs = (int(word) for word in str(facts["lower_arm_75_over_2cm2_pressure"]).split(" of "))
    p = arm[75].over_pressure(2.0)
    score = probability_score("", p, counted, runs).score
    findings.check(
        f"Lower arm, downward, 75 mm/s, 2 cm2: Schroeder's {counted} of {runs} within three sampling errors",
        abs(score) < 3,
        f"we expect {runs * p:.2f}, {score:+.2f} errors",
    )
    worst = max(result.over_force for result in arm.values())
    statements += [
        ["6.2.1", "lower arm: below the force limit at all speeds", f"P(over force) at most {probability(worst)}"],
        [
            "6.2.1",
            "lower arm, 1 cm2: below the pressure limit at 10 and 25 mm/s",
            "P(over pressure) " + " and ".join(probability(arm[v].over_pressure(1)) for v in (10, 25)),
        ],
        [
            "6.2.1",
            f"lower arm, 75 mm/s, 2 cm2: {counted} of {runs} runs over the pressure limit",
            f"{runs * p:.2f} of {runs}",
        ],
    ]


def _upper_arm(findings: Findings, statements: list[list[Cell]], down: Laws) -> None:
    arm = {speed: result for (body, speed), result in down.items() if body == "upper_arm_elbow"}
    p = arm[75].over_pressure(2.0)
    findings.check(
        f"Upper arm, downward, 75 mm/s, 2 cm2: P(over pressure) below {MORE_SELDOM:g}", p < MORE_SELDOM, probability(p)
    )
    slow = max(max(arm[v].over_force, arm[v].over_pressure(1.0)) for v in (10, 25))
    findings.check(
        "Upper arm, downward, 10 and 25 mm/s, 1 cm2: hardly ever over a limit", slow < SELDOM, probability(slow)
    )
    statements += [
        ["6.2.1", "upper arm, 75 mm/s: all collisions acceptable", f"P(over pressure, 2 cm2) {probability(p)}"],
        [
            "6.2.1",
            "upper arm, 10 and 25 mm/s: well below all limits",
            f"P(over a limit, 1 cm2) at most {probability(slow)}",
        ],
    ]


def _lateral(
    findings: Findings, statements: list[list[Cell]], facts: dict[str, Any], aside: dict[float, Collisions]
) -> None:
    joints = facts["lateral_trigger_joints"]
    for speed, result in aside.items():
        p = result.trigger_joint_probability
        others = max(p[j] for j in range(len(p)) if j + 1 not in joints)
        first, second = (p[j - 1] for j in joints)
        findings.check(
            f"Hand, sideways, {speed:g} mm/s: joints {joints[0]} and {joints[1]} notice it about equally, hardly any "
            "other",
            math.isclose(first, second, rel_tol=0.1) and others < 0.01,
            f"{first:.3f} and {second:.3f}, any other at most {probability(others)}",
        )
    both = [result.multi_joint_probability for result in aside.values()]
    findings.check(
        "Hand, sideways: both joints at once in less than a third of collisions at 10 mm/s, in more with every speed",
        both[0] < 1 / 3 and both == sorted(both),
        ", ".join(f"{p:.3f}" for p in both),
    )
    runs = facts["runs_lateral"]
    for speed in (10, 25):
        result = aside[speed]
        over = max(result.over_force, result.over_pressure(2.0))
        findings.check(
            f"Hand, sideways, {speed} mm/s, 2 cm2: not once in {runs} runs over a limit is what we expect too",
            (1 - over) ** runs > 0.01,
            f"P(over a limit) {probability(over)}",
        )
    statements += [
        [
            "6.2.2",
            f"sideways: joints {joints[0]} and {joints[1]} equally",
            "; ".join(
                f"{speed:g} mm/s: " + " and ".join(f"{result.trigger_joint_probability[j - 1]:.3f}" for j in joints)
                for speed, result in aside.items()
            ),
        ],
        [
            "6.2.2",
            "sideways: both joints at once in less than a third of runs at 10 mm/s, more with speed",
            ", ".join(f"{p:.3f}" for p in both),
        ],
        [
            "6.2.2",
            f"sideways, 10 and 25 mm/s, 2 cm2: none of {runs} runs over a limit",
            " and ".join(probability(max(aside[v].over_force, aside[v].over_pressure(2.0))) for v in (10, 25)),
        ],
    ]
