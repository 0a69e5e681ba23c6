"""Every collision ends, and ends alike on every instruction set."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections import Counter
from typing import Any

from bumpstop import _native
from collision.random_scenarios import ALLOWED, difference
from validation.facts import REPOSITORY
from validation.findings import Cell, Findings

TITLE = "Every collision ends"
# Scenarios of one process, and how long it may take: hundreds of times as long as it does.
TOGETHER, MAX_DURATION_S = 250, 1800


def compare(findings: Findings, *, quick: bool) -> None:
    """Random scenarios, those with one sub-step on every set of kernels."""
    count = 30 if quick else 10_000
    findings.say(
        f"{count} random scenarios: built-in and random arms of six and seven joints, at rest and under way, 1 to 16 "
        "sub-steps, round and other accelerations, either task, joints held, damping, latency, stopping and reversing. "
        "Of each the integrated distribution, a batch of its pose and three others, and predictions are computed, in a "
        "process that would be ended where it stood still."
    )
    found = [found for first in range(0, count, TOGETHER) for found in _run(first, min(TOGETHER, count - first))]
    seconds = [one["seconds"] for one in found]
    stood = [one["seed"] for one in found if "stood_still" in one]
    ends = Counter(one.get("end", "refused") for one in found)
    findings.check(
        f"all {count} end",
        len(found) == count and not stood,
        f"the longest took {max(seconds):.1f} s; {stood or 'none'} did not",
    )
    findings.table(
        "How their motions end", ["End", "Scenarios"], ["", "d"], [[end, n] for end, n in ends.most_common()]
    )
    targets = _native.available_targets()
    share = 12 if quick else count // 10
    first, *others = [_run(count, share, "--one-sub-step", target=target) for target in targets]
    rows: list[list[Cell]] = []
    for target, other in zip(targets[1:], others, strict=True):
        apart = [difference(one, two) for one, two in zip(first, other, strict=True)]
        findings.check(
            f"{targets[0]}, {target}: {share} scenarios with one sub-step have the same figures",
            max(apart) <= ALLOWED,
            f"{max(apart):.1e}, scenario {first[apart.index(max(apart))]['seed']}",
        )
        rows.append([f"{targets[0]}, {target}", share, max(apart)])
    if rows:
        findings.table(
            "Largest differences with one sub-step", ["Kernels", "Scenarios", "Relative"], ["", "d", ".1e"], rows
        )


def _run(first: int, count: int, *options: str, target: str = "") -> list[dict[str, Any]]:
    """What :mod:`collision.random_scenarios` prints; fewer than asked for where it stood still."""
    command = [sys.executable, "-m", "collision.random_scenarios", str(first), str(count), *options]
    environment = os.environ | ({"BUMPSTOP_TARGET": target} if target else {})
    try:
        done = subprocess.run(
            command,
            cwd=REPOSITORY / "tests",
            env=environment,
            stdout=subprocess.PIPE,
            text=True,
            timeout=MAX_DURATION_S,
            check=True,
        )
    except subprocess.TimeoutExpired as stuck:
        printed = stuck.stdout or b""
        return [json.loads(line) for line in (printed if isinstance(printed, str) else printed.decode()).splitlines()]
    return [json.loads(line) for line in done.stdout.splitlines()]
