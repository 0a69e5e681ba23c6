"""The same figures from every set of kernels and any number of threads."""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
from dataclasses import astuple, dataclass
from typing import Any

from bumpstop import kernels
from validation.facts import REPOSITORY
from validation.findings import Cell, Findings

TITLE = "Instruction sets and threads"
# Relative difference of a figure between two sets of kernels.
ALLOWED = 1e-12
# Probabilities below this are rounding of sums that come to one.
NEGLIGIBLE = 1e-15


@dataclass(frozen=True)
class Difference:
    """What lies between two sets of kernels for one example.

    Attributes:
        figures: how many figures and tails are compared.
        worst, where: largest relative difference of a figure, and which.
        tail, tail_where: the same of the forces that belong to a tail's probability.
        ticks: of 1000 sampled runs, those noticed at another tick.
    """

    figures: int
    worst: float
    where: str
    tail: float
    tail_where: str
    ticks: int


def compare(findings: Findings, *, quick: bool) -> None:
    """Run the examples in one process for each target, and compare."""
    targets = kernels.available_targets()
    runs, poses = (70_000, 20) if quick else (1_000_000, 400)
    findings.say(
        f"This processor and this build have the kernels {', '.join(targets)}. Each runs all examples in a process of "
        f"its own: exact laws, {runs} sampled runs and {poses} batch laws, the latter two with one thread and with "
        "two."
    )
    found = {target: _probe(target, runs, poses) for target in targets}
    for target, result in found.items():
        same = all(one == two for one, two in result["sampled"].values())
        findings.check(f"{target}: sampled runs of every example are the same bits with 1 and 2 threads", same)
        one, two = result["batch"]
        findings.check(f"{target}: {poses} batch laws are the same bits with 1 and 2 threads", one == two)
    if len(targets) == 1:
        findings.say(f"There is nothing to compare {targets[0]} with here.")
        return
    findings.say(
        "Figures are compared by their relative difference. The probability of passing a given force falls so "
        "steeply that a force off by 1e-12 of itself changes it by a few hundred times that, so tails are compared "
        "by the force: their relative difference over their steepness (but no less than one)."
    )
    first, *others = targets
    rows: list[list[Cell]] = []
    for other in others:
        for name in found[first]["figures"]:
            apart = _difference(found[first], found[other], name)
            pair = f"{first}, {other}"
            findings.check(
                f"{name}, {pair}: {apart.figures} figures agree to {ALLOWED:g}",
                max(apart.worst, apart.tail) <= ALLOWED,
                f"{apart.worst:.1e}, {apart.where}; tails {apart.tail:.1e}, {apart.tail_where}",
            )
            findings.check(
                f"{name}, {pair}: 1000 sampled runs are noticed at the same ticks",
                apart.ticks == 0,
                f"{apart.ticks} differ",
            )
            rows.append([name, pair, *astuple(apart)])
    findings.table(
        "Largest differences between sets of kernels",
        ["Example", "Kernels", "Figures", "Relative difference", "at", "of tails", "at", "Other ticks in 1000 runs"],
        ["", "", "d", ".1e", "", ".1e", "", "d"],
        rows,
    )


def _probe(target: str, runs: int, poses: int) -> dict[str, Any]:
    """What :mod:`validation.probe` prints with the kernels of one target."""
    done = subprocess.run(
        [sys.executable, "-m", "validation.probe", str(runs), str(poses)],
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
    figures, tails = ours["figures"][name], ours["tails"][name]
    apart = {what: _relative(value, theirs["figures"][name][what]) for what, value in figures.items()}
    tail_apart = {
        what: _relative(p, theirs["tails"][name].get(what, (None, 1.0))[0]) / max(1.0, steepness)
        for what, (p, steepness) in tails.items()
    }
    where, tail_where = max(apart, key=lambda what: apart[what]), max(tail_apart, key=lambda what: tail_apart[what])
    return Difference(
        figures=len(apart) + len(tail_apart),
        worst=apart[where],
        where=where,
        tail=tail_apart[tail_where],
        tail_where=tail_where,
        ticks=sum(a != b for a, b in zip(ours["ticks"][name], theirs["ticks"][name], strict=True)),
    )


def _relative(value: float | None, other: float | None) -> float:
    """Relative difference of two figures, infinite where only one of them exists."""
    if value is None or other is None:
        return 0.0 if value is other else math.inf
    size = max(abs(value), abs(other))
    return abs(value - other) / size if size > NEGLIGIBLE else 0.0
