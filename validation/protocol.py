"""The source's protocol on the plant: do the intervals of what it finds hold what was planted?"""

from __future__ import annotations

import numpy as np

from bumpstop.identification.plan import ProtocolSettings
from plant.protocol_cases import FRICTION, MAP, SETTINGS, Z95, recovered, source_plan
from validation.findings import Findings

TITLE = "The protocol on the plant"
# Medians of coefficients that hardly show, as A of a wrist, are known to their own standard error alone.
SPREAD = 2.0
QUICK = ProtocolSettings(speed_shares=(0.2, 0.4, 0.6), repeats=1, ramp_repeats=1, holds=2, hold_s=2.0)


def compare(findings: Findings, *, quick: bool) -> None:
    """Coverage of 95 % intervals and medians, joint by joint."""
    seeds = 2 if quick else 20
    rates = (250.0,) if quick else (250.0, 1000.0)
    settings = QUICK if quick else SETTINGS
    findings.say(
        f"{seeds} seeds at {' and '.join(f'{rate:g}' for rate in rates)} Hz with 1 % lost samples; friction, maps and "
        "scatter of table 2.2, rotors planted, gears that do no more. "
        f"{len(settings.speed_shares)} speeds, {settings.repeats} repeats, {settings.holds} holds of "
        f"{settings.hold_s:g} s from either side: far fewer than the source's."
    )
    found = recovered(source_plan(settings), range(seeds), rates, (4,) if quick else ())
    rows = []
    for one in found:
        held = np.abs(one.off) < Z95
        rows.append(
            [
                f"joint {one.joint}, {one.name}",
                one.truth,
                100 * one.median_error,
                100 * float(held.mean()),
                float(one.off.mean()),
                float(one.off.std()),
            ]
        )
    findings.table(
        "What was found",
        ["Parameter", "Planted", "Median error [%]", "Intervals that hold it [%]", "Mean off [se]", "Sd off [se]"],
        ["s", ".4g", "+.2f", ".1f", "+.2f", ".2f"],
        rows,
    )
    for names, share, what in ((MAP, 0.02, "maps"), (FRICTION, 0.03, "friction")):
        judged = [(one, abs(one.median_error) - SPREAD * one.median_known_to) for one in found if one.name in names]
        worst, beyond = max(judged, key=lambda pair: pair[1])
        findings.check(
            f"Medians of {what} within {100 * share:g} %, beyond what so many fits can tell",
            beyond < share,
            f"the worst is {worst.name} of joint {worst.joint}, {100 * worst.median_error:+.2f} % +- "
            f"{100 * worst.median_known_to:.2f} %",
        )
    off = np.concatenate([one.off for one in found])
    coverage = float((np.abs(off) < Z95).mean())
    low, high = (0.5, 1.01) if quick else (0.92, 0.975)
    findings.check(
        "Pooled coverage of 95 % intervals between 92 and 97.5 %",
        low <= coverage <= high,
        f"{100 * coverage:.1f} % of {off.size}",
    )
