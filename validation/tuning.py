"""Rates of false alarms that tuned thresholds achieve on residuals that were not used."""

from __future__ import annotations

import numpy as np
from scipy import stats

from bumpstop.detection import tune
from detection.tuning_cases import achieved, residuals
from validation.findings import Cell, Findings

TITLE = "False alarms of tuned thresholds on ten hours that were not used"
CONFIDENCE = 0.95
NOISE = {"normal": None, "Student's t, 5 degrees": 5.0}


def compare(findings: Findings, *, quick: bool) -> None:
    """Tune again and again on short records, and count on a long one."""
    repeats, unseen_h = (6, 1) if quick else (60, 10)
    rows: list[list[Cell]] = []
    for name, degrees in NOISE.items():
        unseen = [residuals(1.0, 5000 + hour, degrees=degrees) for hour in range(unseen_h)]
        for hours, target in ((0.1, 30.0), (0.5, 10.0)):
            inside, rates, widths = 0, [], []
            for seed in range(repeats):
                tuning = tune(residuals(hours, seed, degrees=degrees), target, confidence=CONFIDENCE)
                low, high = tuning.per_hour_interval()
                count = sum(achieved(part, tuning.thresholds(), tuning.cluster_rows) for part in unseen)
                rates.append(count / unseen_h)
                widths.append(high / max(low, 1e-3))
                inside += low <= rates[-1] <= high
            least = int(stats.binom.ppf(1e-3, repeats, CONFIDENCE))
            case = f"{name}, {hours:g} h for {target:g} an hour"
            rows.append([case, float(np.median(rates)), float(np.mean(rates)), inside / repeats])
            findings.check(
                f"{case}: the achieved rate lies in its interval in {100 * CONFIDENCE:g} % of all tunings",
                inside >= least,
                f"{inside} of {repeats}; at least {least} with a probability of 0.999",
            )
    findings.say(
        "First-order autoregressive noise of three joints with a common part, 100 rows a second, correlation 0.9 from "
        f"row to row. Thresholds tuned on {repeats} short records each are put on the same {unseen_h} h of other noise."
    )
    findings.table(
        "Achieved false alarms an hour",
        ["Noise, length of the record and wanted rate", "median", "mean", "share inside"],
        ["", ".3g", ".3g", ".3f"],
        rows,
    )
