"""Thresholds for a wanted number of false alarms an hour, from residuals of contact-free motion."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations
from typing import get_args

import numpy as np

from bumpstop.arrays import FloatArray, as_number
from bumpstop.detection.band_pass_channel import band_pass_channel
from bumpstop.detection.durations import hours_in_words
from bumpstop.detection.tuning.extreme_values import MIN_ROWS, PeaksOverThreshold
from bumpstop.detection.tuning.joint_scales import block_rows, too_few
from bumpstop.detection.tuning.moments import ruling_moments
from bumpstop.detection.tuning.proportions import Proportions, Segment, largest_held_out, proportions
from bumpstop.detection.tuning.residual_file import ResidualSeries
from bumpstop.detection.tuning.result import MAX_EXTRAPOLATION, Term, Tuning
from bumpstop.detection.tuning.run_spread import RunSpread
from bumpstop.errors import InputError, near_matches
from bumpstop.terminal import counted

# What is asked for where no rate is given: so many an hour, or one alarm in so many times the recordings' length.
_DEFAULT_PER_HOUR, _DEFAULT_REACH = 1.0, 10.0
_BIASED = 0.3  # of a threshold
_APART = 0.1  # spread of runs from which it is told


def tune(
    series: ResidualSeries | Sequence[ResidualSeries],
    per_hour: float | None = None,
    *,
    joints: Sequence[int] | None = None,
    confidence: float = 0.95,
    terms: Sequence[Term] = (),
    units: Sequence[str] = (),
) -> Tuning:
    """Choose thresholds that residuals of contact-free motion pass a wanted number of times an hour.

    1. The proportion of the thresholds: each joint's is the level that its own residuals pass as often as those of any
       other joint, ``per_hour / n`` times an hour, n being the number of monitored joints and channels (see
       ``joint_scales``).
    2. The largest residual of any joint, each in units of its threshold, is one series. Its tail gives the factor at
       which any joint alarms ``per_hour`` times an hour, whatever the joints have in common. The units of a part of the
       rows come from the other parts (see ``largest_held_out``).
    3. Intervals join what the tail does not tell, by profile likelihood, with how much runs differ (see ``RunSpread``):
       they are those of a new run. Every series is a run. A single one is cut into parts; then the interval holds for
       more of that run only.

    Alarms that follow each other closely count as one (see ``PeaksOverThreshold``). Thresholds are symmetric; a mean of
    the residual counts.

    Args:
        series: one or several recordings with the same joints and rate.
        per_hour: wanted false alarms an hour, of all joints together; default: what the recordings can carry, one alarm
            in ten times their length, but no fewer than one an hour.
        joints: numbers from 0 of those to watch; default: all whose residual ever changes.
        confidence: of the intervals, between 0.5 and 0.999.
        terms: what to tune beside constant thresholds: ``"fast"``, those of the band-pass channel, with as many
            alarms as the others; ``"speed"`` and ``"acceleration"``, what the motion of a joint adds.
        units: of the residuals of each joint (dof,), ``"Nm"`` or ``"N"``; default: ``"Nm"``.

    Raises:
        InputError: recordings that do not go together, a joint in ``joints`` without noise, too few independent peaks,
            a rate that is not between 0 and that of the peaks, or terms of motion that the series do not hold.
    """
    parts = [series] if isinstance(series, ResidualSeries) else list(series)
    dof, period = _common(parts)
    if not 0.5 <= as_number(confidence, "confidence") <= 0.999:
        raise InputError("confidence", f"is {confidence}", "wanted 0.5 to 0.999")
    wanted = _terms(terms, parts)
    supported = default_per_hour(parts)
    asked, per_hour = per_hour, supported if per_hour is None else per_hour
    if not as_number(per_hour, "per_hour") > 0:
        raise InputError("per_hour", f"is {per_hour}", "wanted more than 0")
    still = {}
    for j in range(dof):
        every = np.concatenate([part.rows[:, j] for part in parts])
        if not np.ptp(every) > 0:
            # Detectors have a residual of zero where they know none.
            still[j] = "never changes" if every.any() else "is 0 all the time: its gain or its model is unknown"
    monitored = sorted(set([j for j in range(dof) if j not in still] if joints is None else joints))
    if len(still) == dof:
        raise InputError("residuals", "of no joint ever change", "wanted those of contact-free motion")
    if not monitored or not 0 <= monitored[0] <= monitored[-1] < dof:
        raise InputError("joints", f"{[j + 1 for j in monitored]} are not all joints", f"wanted some of 1 to {dof}")
    for j in still:
        if j in monitored:
            raise InputError(f"residual of joint {j + 1}", still[j], "leave that joint out")
    rows = [one for number, part in enumerate(parts) for one in _segments(part, number, monitored, wanted)]
    found, tail, larger = _tail(rows, period, per_hour)
    lengths = [sum(len(one.t) for one in rows if one.run == number) for number in range(len(parts))]
    tuning = Tuning(
        _of_all(found.constant, monitored, dof, math.inf),
        np.stack([_of_all(found.speed, monitored, dof, 0.0), _of_all(found.acceleration, monitored, dof, 0.0)]),
        _of_all(found.fast, monitored, dof, math.inf),
        tail,
        replace(RunSpread.of(tail, lengths), units=larger),
        float(per_hour),
        confidence,
        period,
        wanted,
        units=tuple(units),
    )
    thresholds = tuning.thresholds()
    notes = _notes(tuning, thresholds, rows, monitored, parts)
    notes += [f"The residual of joint {j + 1} {why}." for j, why in still.items()]

    def without(left: list[Segment]) -> FloatArray:
        fewer, its_tail, _ = _tail(left, period, per_hour)
        return fewer.constant * its_tail.level_of(per_hour)

    watched = {j: tuning.units[j] if tuning.units else "Nm" for j in monitored}
    notes += ruling_moments(rows, [part.source for part in parts], watched, thresholds[monitored], without)
    if asked is None and supported > _DEFAULT_PER_HOUR:
        notes.append(
            f"No rate was given: {hours_in_words(tail.hours)} carry one alarm in {_DEFAULT_REACH:g} times that, "
            f"{supported:.3g} an hour. For fewer, record for longer or give the rate."
        )
    return replace(tuning, notes=tuple(notes))


def _tail(rows: Sequence[Segment], period: float, per_hour: float) -> tuple[Proportions, PeaksOverThreshold, float]:
    """The proportion of thresholds, the tail of the largest residual in units of them, and how sure these units are.

    Where the rows are too few for tails, a part of them does not know what joints do in the others, and units of other
    rows would raise all thresholds far. They are those of all rows then, and the interval carries the difference.

    Returns:
        Proportions, tail, and the logarithm of how much larger residuals are in units of other rows; 0: they are.

    Raises:
        InputError: too few rows or peaks.
    """
    count = sum(len(one.t) for one in rows)
    if count < MIN_ROWS:
        raise InputError("residuals", f"{count} rows", f"wanted at least {MIN_ROWS}")
    residual = [np.abs(one.residual) for one in rows]
    size = block_rows(residual)
    few = too_few(residual, size, period)
    passed = None if few else per_hour / residual[0].shape[1] * count * period / 3600
    whole = proportions(rows, passed, size)
    held_out = PeaksOverThreshold.fit(largest_held_out(rows, whole, passed, size), period)
    if not few:
        return whole, held_out, 0.0
    tail = PeaksOverThreshold.fit([whole.largest(one) for one in rows], period)
    if not per_hour < min(tail.rate, held_out.rate):  # refused where the rate is asked for
        return whole, tail, 0.0
    return whole, tail, abs(math.log(held_out.level_of(per_hour) / tail.level_of(per_hour)))


def _segments(part: ResidualSeries, run: int, monitored: Sequence[int], terms: Sequence[Term]) -> list[Segment]:
    """Rows of a recording between its gaps, with what the terms need."""
    fast = band_pass_channel(part) if "fast" in terms else None
    columns = list(monitored)

    def of(values: FloatArray | None, rows: slice, wanted: bool) -> FloatArray | None:
        return np.abs(values[rows][:, columns]) if wanted and values is not None else None

    return [
        Segment(
            run,
            part.t[rows],
            part.rows[rows][:, columns],
            of(fast, rows, "fast" in terms),
            of(part.qd, rows, "speed" in terms),
            of(part.qdd, rows, "acceleration" in terms),
        )
        for rows in part.segments()
    ]


def _terms(given: Sequence[Term], parts: Sequence[ResidualSeries]) -> tuple[Term, ...]:
    known = get_args(Term)
    for term in given:
        if term not in known:
            raise InputError("terms", f"{str(term)[:40]!r} is none", near_matches(str(term), known))
    for term, field in (("speed", "qd"), ("acceleration", "qdd")):
        for part in parts:
            if term in given and getattr(part, field) is None:
                raise InputError("terms", f"{part.source} does not hold the {term} of the joints", "give recordings")
    return tuple(term for term in known if term in given)


def _of_all(values: FloatArray, monitored: Sequence[int], dof: int, otherwise: float) -> FloatArray:
    found = np.full(dof, otherwise)
    found[list(monitored)] = values
    return found


def default_per_hour(parts: Sequence[ResidualSeries]) -> float:
    """False alarms an hour that are wanted if none are told: one in ten times the recordings, at least one an hour."""
    hours = sum(len(part.rows) * part.period for part in parts) / 3600
    return max(_DEFAULT_PER_HOUR, 1 / (_DEFAULT_REACH * hours)) if hours > 0 else _DEFAULT_PER_HOUR


def _common(parts: Sequence[ResidualSeries]) -> tuple[int, float]:
    if not parts:
        raise InputError("residuals", "there are none", "wanted at least one recording")
    first = parts[0]
    for part in parts[1:]:
        if part.dof != first.dof:
            raise InputError(part.source, f"has {part.dof} joints", f"{first.source} has {first.dof}")
        if abs(part.period - first.period) > 0.01 * first.period:
            raise InputError(
                part.source, f"has a row every {part.period:.6g} s", f"{first.source} every {first.period:.6g} s"
            )
    for one, other in combinations(parts, 2):
        if np.array_equal(one.rows, other.rows):
            # Each would count as hours of its own, and intervals would be too narrow.
            raise InputError(
                "residuals", f"of {one.source} and {other.source} are the same", "give each recording once"
            )
    return first.dof, first.period


def _notes(
    tuning: Tuning,
    thresholds: FloatArray,
    rows: Sequence[Segment],
    monitored: Sequence[int],
    parts: Sequence[ResidualSeries],
) -> list[str]:
    tail, spread = tuning.tail, tuning.spread
    notes = [
        f"{tail.excess.size} independent peaks in {hours_in_words(tail.hours)}; alarms within "
        f"{tail.cluster_rows * tuning.period_s:.3g} s of each other count as one."
    ]
    if spread.runs == 1:
        notes.append(
            "One recording: the interval holds for more of the same run only. Other days, speeds and payloads are not "
            "in it; give several recordings to have them."
        )
    elif spread.sd > _APART:
        notes.append(
            f"From recording to recording residuals differ by {100 * spread.sd:.0f} %: the interval is that of a new "
            "one. A model that fits all of them, or thresholds for each kind of motion, would allow lower ones."
        )
    residual = [np.abs(one.residual) for one in rows]
    if too_few(residual, block_rows(residual), tuning.period_s):
        notes.append(
            "Too short to tell how joints' tails differ: thresholds stand to each other as the largest residuals. "
            "Record for longer."
        )
    times = tuning.extrapolation()
    if times > MAX_EXTRAPOLATION:
        notes.append(
            f"Extrapolated too far: one alarm in {hours_in_words(1 / tuning.target)} is {times:.4g} times what was "
            f"recorded, more than {MAX_EXTRAPOLATION} times. Record for at least "
            f"{hours_in_words(1 / tuning.target / MAX_EXTRAPOLATION)}."
        )
    mean = np.concatenate([one.residual for one in rows]).mean(axis=0)
    for j, bias in zip(monitored, mean, strict=True):
        if abs(bias) > _BIASED * thresholds[j]:
            unit = tuning.units[j] if tuning.units else "Nm"
            notes.append(
                f"The residual of joint {j + 1} has a mean of {bias:.3g} {unit}, much of its threshold of "
                f"{thresholds[j]:.3g} {unit}: a model that fits better would allow a lower one."
            )
    gaps = sum(len(part.segments()) - 1 for part in parts)
    if gaps:
        notes.append(
            f"{counted(gaps, 'gap')} in time: peaks on either side count as separate, and the gaps not as hours."
        )
    unmonitored = [str(j + 1) for j in np.flatnonzero(np.isinf(tuning.shares))]
    if unmonitored:
        notes.append(f"Not monitored: joint {', '.join(unmonitored)}.")
    return notes
