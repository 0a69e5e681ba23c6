"""Elastic arms: the integrated distribution against the sampled distribution."""

from __future__ import annotations

from pathlib import Path

import bumpstop as bs
from collision.contact.elastic_cases import CASES, OWN_ERROR, differences, scenario
from validation.findings import Findings

TITLE = "Elastic arms: integrated against sampled distribution"
ALLOWED = 4.0
TRAJECTORY = Path(__file__).resolve().parents[2] / "examples/06_pick_and_place_trajectory.toml"


def compare(findings: Findings, *, quick: bool) -> None:
    """Means and quantiles of every case, and of a trajectory, whose single collisions take longer."""
    runs, on_trajectory = (5000, 0) if quick else (1_000_000, 50_000)
    names = list(CASES)[:2] if quick else list(CASES)
    findings.say(
        f"One integrates over contact offset and noise, the other draws {runs} collisions (of the trajectory "
        f"{on_trajectory}) and follows each by itself. Means and the probabilities beyond four quantiles of three "
        f"quantities are compared in standard errors of the sample, after {100 * OWN_ERROR:g} % of the value: an arm "
        "that bounces is smooth to this only."
    )
    cases = {name: (scenario(**CASES[name]), runs) for name in names}
    if on_trajectory:
        elastic = bs.load_scenario(TRAJECTORY).with_values({"arm.model": "elastic"})
        cases["trajectory"] = (elastic, on_trajectory)
    rows = []
    for number, (name, (case, count)) in enumerate(cases.items()):
        found = differences(bs.evaluate(case), bs.evaluate(case, samples=count, seed=2000 + number, threads=2))
        worst = max(found, key=lambda one: abs(one.errors))
        findings.check(
            f"{name}: {len(found)} figures within {ALLOWED:g} standard errors",
            abs(worst.errors) <= ALLOWED,
            f"worst {worst.errors:+.2f}, {worst.what}",
        )
        rows += [[name, one.what, one.integrated, one.sampled, one.errors] for one in found]
    findings.table(
        "Every figure of both distributions, and their difference in standard errors",
        ["Scenario", "Figure", "Integrated", "Sampled", "Difference [standard errors]"],
        ["", "", ".6g", ".6g", "+.2f"],
        rows,
    )
