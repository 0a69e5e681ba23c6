"""Rates of false alarms that tuned thresholds achieve on residuals that were not used."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import get_args

import numpy as np
from scipy import stats

from bumpstop.detection import ResidualSeries, tune
from bumpstop.plant.drive import ScatterPer
from bumpstop.reproduction.schroeder2013.collisions import Residual
from detection.tuning_cases import achieved, residuals
from validation.detection import free_hours
from validation.findings import Cell, Findings

TITLE = "False alarms of tuned thresholds on ten hours that were not used"
CONFIDENCE = 0.95
NOISE = {"normal": None, "Student's t, 5 degrees": 5.0}
HEADINGS = ["wanted", "median", "mean", "share inside"]
FORMATS = [".3g", ".3g", ".3g", ".3f"]
# Fewer alarms than this have a spread of their own that is no smaller than the interval: they are told, not judged.
MIN_ALARMS = 20
# Of the plant: recordings of so many rounds through so many moves; each is tuned on, and the next ones are unseen.
MOVES, ROUNDS, RECORDINGS, UNSEEN_H = 120, 3, 24, 10.0
TARGETS: tuple[float | None, ...] = (10.0, None)
CASES: list[tuple[ScatterPer, Residual]] = list(itertools.product(get_args(ScatterPer), get_args(Residual)))


def compare(findings: Findings, *, quick: bool) -> None:
    """Tune again and again on short records, and count on a long one: known noise, then the plant."""
    _known_noise(findings, *((4, 1) if quick else (60, 10)))
    if quick:
        _plant(findings, moves=2, rounds=4, count=4, unseen_h=0.01, cases=[("sample", "direct")], targets=(600.0,))
    else:
        _plant(findings, moves=MOVES, rounds=ROUNDS, count=RECORDINGS, unseen_h=UNSEEN_H, cases=CASES, targets=TARGETS)


def _known_noise(findings: Findings, repeats: int, unseen_h: int) -> None:
    rows: list[list[Cell]] = []
    for name, degrees in NOISE.items():
        unseen = [residuals(1.0, 5000 + hour, degrees=degrees) for hour in range(unseen_h)]
        for hours, target in ((0.1, 30.0), (0.5, 10.0)):
            records = [residuals(hours, seed, degrees=degrees) for seed in range(repeats)]
            rows.append(_judged(findings, f"{name}, {hours:g} h", target, records, [unseen] * repeats))
    findings.say(
        "First-order autoregressive noise of three joints with a common part, 100 rows a second, correlation 0.9 from "
        f"row to row. Thresholds tuned on {repeats} short records each are put on the same {unseen_h} h of other noise."
    )
    findings.table("Achieved false alarms an hour", ["Noise, length of the record", *HEADINGS], ["", *FORMATS], rows)


def _plant(
    findings: Findings,
    *,
    moves: int,
    rounds: int,
    count: int,
    unseen_h: float,
    cases: Sequence[tuple[ScatterPer, Residual]],
    targets: Sequence[float | None],
) -> None:
    parts = free_hours.moves(1, moves)
    rows: list[list[Cell]] = []
    seconds = sum(part.duration for part in parts)
    others = round(unseen_h * 3600 / (seconds * rounds) + 0.5)
    for scatter, of_scatter in itertools.groupby(cases, key=lambda case: case[0]):
        logs = free_hours.recordings(parts, rounds * count, scatter)
        findings.progress(f"{len(logs) * seconds / 3600:.3g} h of the plant, friction anew per {scatter}")
        for _, kind in of_scatter:
            found = free_hours.residuals(logs, kind)
            records = [_joined([next(found) for _ in range(rounds)]) for _ in range(count)]
            unseen = [[records[(k + other) % count] for other in range(1, others + 1)] for k in range(count)]
            what = f"friction anew per {scatter}, {kind}, {records[0].monitored_s / 3600:.2g} h"
            rows += [_judged(findings, what, target, records, unseen) for target in targets]
    findings.say(
        f"The plant goes through {moves} moves of Schroeder's first workspace motion, {seconds:.0f} s, with sensors "
        f"and friction of other seeds every time; residuals of joints 1 to 6 at 250 Hz. Each of {count} recordings of "
        f"{rounds} rounds is tuned on, and its thresholds are put on the {others} that follow, "
        f"{others * rounds * seconds / 3600:.1f} h that were not used."
    )
    findings.table("Achieved on the plant", ["Noise, residual, tuned on", *HEADINGS], ["", *FORMATS], rows)


def _joined(rounds: Sequence[ResidualSeries]) -> ResidualSeries:
    """Rounds as one record; the seconds in which the detector fills itself part them."""
    begin, t = 0.0, []
    for one in rounds:
        t.append(one.t + begin)
        begin = float(t[-1][-1]) + 1.0
    return ResidualSeries(np.concatenate(t), np.concatenate([one.rows for one in rounds]), rounds[0].source)


def _judged(
    findings: Findings,
    what: str,
    target: float | None,
    records: Sequence[ResidualSeries],
    unseen: Sequence[Sequence[ResidualSeries]],
) -> list[Cell]:
    """Tune on every record and count on what belongs to it: a row of the table, and the check."""
    inside, rates = 0, []
    for record, others in zip(records, unseen, strict=True):
        tuning = tune(record, target, confidence=CONFIDENCE)
        low, high = tuning.per_hour_interval()
        alarms = sum(achieved(part, tuning.thresholds(), tuning.cluster_rows) for part in others)
        rates.append(alarms * 3600 / sum(part.monitored_s for part in others))
        inside += low <= rates[-1] <= high
        wanted = tuning.target
    row: list[Cell] = [what, wanted, float(np.median(rates)), float(np.mean(rates)), inside / len(records)]
    if wanted * sum(part.monitored_s for part in unseen[0]) / 3600 < MIN_ALARMS:
        return row
    least = int(stats.binom.ppf(1e-3, len(records), CONFIDENCE))
    findings.check(
        f"{what}, {wanted:g} an hour: the achieved rate lies in its interval in {100 * CONFIDENCE:g} % of all tunings",
        inside >= least,
        f"{inside} of {len(records)}; at least {least} with a probability of 0.999",
    )
    return row
