"""Two routes to the distributions of random collisions in which something gives way."""

from __future__ import annotations

import os
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor

from bumpstop.errors import InputError
from collision.random_contacts import differences, random_contact
from validation.findings import Findings

TITLE = "Random collisions, integrated and drawn"
RUNS = 3000


def compare(findings: Findings, *, quick: bool) -> None:
    """Random arms, poses, bodies, detectors and reactions; both distributions of each."""
    count = 8 if quick else 400
    findings.say(
        f"{count} random scenarios: seven built-in arms anywhere in their reach, two of three elastic, at 20 to "
        "500 mm/s, under way or from rest; clamped, damped and free bodies and gauges; direct and observed residuals, "
        "white and correlated noise; stopping and reversing, with and without latency. Of each the integrated "
        f"distribution is set beside {RUNS} drawn collisions: probabilities within 4.5 standard errors and 0.002 to "
        "0.003, forces within 0.3 %; and beside the same pose in a batch: forces within 0.3 % of their mean and 1 mN."
    )
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        found = list(pool.map(_compare_one, range(1, count + 1)))
    compared = [one for one in found if one[2] is not None]
    apart = [f"scenario {seed}: {'; '.join(told)}" for seed, _, told in compared if told]
    longest = max(seconds for _, seconds, _ in found)
    findings.check(
        f"all of {len(compared)} are told alike",
        not apart,
        f"{', '.join(apart) or 'no difference'}; the longest took {longest:.1f} s",
    )
    ends = Counter("refused" if told is None else "compared" for _, _, told in found)
    findings.table("Scenarios", ["What became of them", "Number"], ["", "d"], [[end, n] for end, n in ends.items()])


def _compare_one(seed: int) -> tuple[int, float, list[str] | None]:
    begin = time.perf_counter()
    try:
        told = list(differences(random_contact(seed), RUNS, seed))
    except InputError:
        return seed, time.perf_counter() - begin, None
    return seed, time.perf_counter() - begin, told
