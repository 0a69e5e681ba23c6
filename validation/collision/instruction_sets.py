"""The same figures from every set of kernels and any number of threads."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import astuple, dataclass
from typing import Any

import numpy as np

from bumpstop import _native
from validation.facts import REPOSITORY
from validation.findings import Cell, Findings

TITLE = "Instruction sets and threads"
# Difference between two sets of kernels: of forces and times relative, of probabilities as it stands.
# Positions of a metre are rounded to 1e-16 m, which a stiff body feels as 1e-11 N: sds of forces come close to this.
ALLOWED = 1e-11
# Leaps of batches are judged loosely, and arms near singularities enlarge roundings.
ALLOWED_IN_BATCHES = 1e-8
# Probabilities below this are rounding of sums that come to one.
NEGLIGIBLE = 1e-15


@dataclass(frozen=True)
class Difference:
    """What lies between two sets of kernels for one example.

    Attributes:
        figures: how many figures and tails are compared.
        value, value_where: largest relative difference of a force or time, and which.
        probability, probability_where: largest difference of a probability.
        tail, tail_where: largest relative difference of the forces that belong to a tail's probability.
        ticks: of 1000 sampled runs, those detected at another tick.
    """

    figures: int
    value: float
    value_where: str
    probability: float
    probability_where: str
    tail: float
    tail_where: str
    ticks: int


def compare(findings: Findings, *, quick: bool) -> None:
    """Run the examples in one process for each target, and compare."""
    targets = _native.available_targets()
    runs, along, poses = (70_000, 3000, 20) if quick else (300_000, 300_000, 3000)
    findings.say(
        f"This processor and this build have the kernels {', '.join(targets)}. Each runs all examples in a process of "
        f"its own: integrated distributions, {runs} sampled runs ({along} along a trajectory) and {poses} batch "
        "distributions, the latter two with one thread and with two."
    )
    found = {target: _probe(target, runs, along, poses) for target in targets}
    for target, result in found.items():
        same = all(one == two for one, two in result["sampled"].values())
        findings.check(f"{target}: sampled runs of every example are the same bits with 1 and 2 threads", same)
        one, two = result["batch"]
        findings.check(f"{target}: {poses} batch distributions are the same bits with 1 and 2 threads", one == two)
    if len(targets) == 1:
        findings.say(f"There is nothing to compare {targets[0]} with here.")
        return
    findings.say(
        "Forces and times are compared by their relative difference, probabilities by their difference. The "
        "probability of passing a given force falls so steeply that a force off by 1e-12 of itself changes it by a "
        "few hundred times that, so tails are compared by the force: their relative difference over their steepness "
        "(but no less than one)."
    )
    first, *others = targets
    rows: list[list[Cell]] = []
    for other in others:
        for name in found[first]["figures"]:
            apart = _difference(found[first], found[other], name)
            pair = f"{first}, {other}"
            findings.check(
                f"{name}, {pair}: {apart.figures} figures agree to {ALLOWED:g}",
                max(apart.value, apart.probability, apart.tail) <= ALLOWED,
                f"{apart.value:.1e}, {apart.value_where}; {apart.probability:.1e}, {apart.probability_where}; "
                f"tails {apart.tail:.1e}",
            )
            findings.check(
                f"{name}, {pair}: 1000 sampled runs are detected at the same ticks",
                apart.ticks == 0,
                f"{apart.ticks} differ",
            )
            rows.append([name, pair, *astuple(apart)])
        batches = _batches_apart(found[first]["batch_figures"], found[other]["batch_figures"])
        findings.check(
            f"{first}, {other}: {poses} batches agree to {ALLOWED_IN_BATCHES:g}",
            max(batches.values()) <= ALLOWED_IN_BATCHES,
            ", ".join(f"{name} {apart:.1e}" for name, apart in batches.items()),
        )
    findings.table(
        "Largest differences between sets of kernels",
        ["Example", "Kernels", "Figures", "Value", "at", "Probability", "at", "Tail", "at", "Other ticks in 1000 runs"],
        ["", "", "d", ".1e", "", ".1e", "", ".1e", "", "d"],
        rows,
    )


def _probe(target: str, *counts: int) -> dict[str, Any]:
    """What :mod:`validation.collision.probe` prints with the kernels of one target."""
    done = subprocess.run(
        [sys.executable, "-m", "validation.collision.probe", *map(str, counts)],
        cwd=REPOSITORY,
        env=os.environ | {"BUMPSTOP_TARGET": target},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        raise RuntimeError(f"{target}: {done.stderr.strip().splitlines()[-1]}")
    result: dict[str, Any] = json.loads(done.stdout)
    assert result["target"] == target
    return result


def _difference(ours: dict[str, Any], theirs: dict[str, Any], name: str) -> Difference:
    """Compare what two processes printed of one example."""
    figures, others = ours["figures"][name], theirs["figures"][name]
    values = {what: _relative(x, others[what]) for what, x in figures.items() if not what.startswith("P(")}
    probabilities = {what: abs(p - others[what]) for what, p in figures.items() if what.startswith("P(")}
    tails = {
        what: _relative(p, theirs["tails"][name].get(what, (None, 1.0))[0]) / max(1.0, steepness)
        for what, (p, steepness) in ours["tails"][name].items()
    }
    value, probability, tail = (max(apart, key=apart.__getitem__) for apart in (values, probabilities, tails))
    return Difference(
        figures=len(values) + len(probabilities) + len(tails),
        value=values[value],
        value_where=value,
        probability=probabilities[probability],
        probability_where=probability,
        tail=tails[tail],
        tail_where=tail,
        ticks=sum(a != b for a, b in zip(ours["ticks"][name], theirs["ticks"][name], strict=True)),
    )


def _batches_apart(ours: dict[str, list[float]], theirs: dict[str, list[float]]) -> dict[str, float]:
    """Largest differences: of exceedances as they stand, of sds as shares of the mean, whose squares they come from."""
    mean = np.array(ours["mean"])
    apart = {}
    for name, values in ours.items():
        value, other = np.array(values), np.array(theirs[name])
        same = np.isclose(value, other, rtol=0, atol=0, equal_nan=True)
        scale = np.ones_like(value)
        if name != "exceedance":
            scale = np.maximum(np.abs(value), 1.0)
        if name == "sd":
            scale = np.maximum(scale, np.where(np.isfinite(mean), mean, 0.0))
        with np.errstate(invalid="ignore"):
            difference = np.where(same, 0.0, np.abs(value - other) / scale)
        apart[name] = float(np.where(np.isnan(difference), np.inf, difference).max())
    return apart


def _relative(value: float | None, other: float | None) -> float:
    """Relative difference of two figures, infinite where only one of them exists."""
    if value is None or other is None:
        return 0.0 if value is other else math.inf
    size = max(abs(value), abs(other))
    return abs(value - other) / size if size > NEGLIGIBLE else 0.0
