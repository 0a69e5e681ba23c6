"""A million random and mutated messages to each source."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from live.fuzz_cases import FuzzCount, fuzz_dds_source, fuzz_decoders, fuzz_rtde_source
from validation.findings import Findings

TITLE = "Damaged messages to the sources of a monitor"
_BATCH = 20_000
RUNS: dict[str, Callable[[np.random.Generator, int], FuzzCount]] = {
    "RTDE decoders": fuzz_decoders,
    "RTDE source": fuzz_rtde_source,
    "DDS source": fuzz_dds_source,
}


def compare(findings: Findings, *, quick: bool) -> None:
    """No crash, and every message is a sample or is told."""
    count = 2_000 if quick else 1_000_000
    shown = []
    for number, (name, fuzz) in enumerate(RUNS.items()):
        done, problem = [], ""
        batches = max(1, count // _BATCH)
        try:
            for batch in range(batches):
                done.append(fuzz(np.random.default_rng([30, number, batch]), min(count, _BATCH)))
        except Exception as error:
            problem = f"batch {len(done)}: {type(error).__name__}: {error}"
        total = [sum(getattr(one, key) for one in done) for key in ("messages", "samples", "bad", "rejected")]
        findings.check(f"{name}: no crash and no silent gap", not problem, problem or f"{total[0]} messages")
        shown.append([name, *total])
    findings.table(
        "What came of the messages",
        ["Messages to", "Messages", "Samples", "Told as bad", "Refused by a decoder"],
        ["", "d", "d", "d", "d"],
        shown,
    )
