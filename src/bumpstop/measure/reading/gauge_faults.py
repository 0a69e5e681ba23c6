"""What may be wrong with a gauge recording: rows, times and the shape of the force."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.measure.reading.gauge_curve import MAX_BACKWARD_SHARE
from bumpstop.measure.reading.gauge_fault import GaugeFault
from bumpstop.measure.reading.gauge_gaps import hidden_peak, step_faults
from bumpstop.terminal import counted

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.measure.reading.gauge_curve import GaugeCurve

# Equal samples at the top; of a smooth peak there are at least such a share beside them in the next digits.
_MIN_FLAT, _NEAR_DIGITS, _SMOOTH = 3, 8, 0.25
# Shares of the device's range: noise about its end, and the farthest reading of that device.
_AT_END, _SHORTLY_BEYOND, _BEYOND = 0.999, 1.005, 1.02
# From the beginning of contact to the peak.
_MIN_RISE_SAMPLES = 5
_MIN_RATE_HZ = 500.0
# What gauges of collisions show at all.
_MIN_PEAK_N, _MAX_PEAK_N = 2.0, 5000.0
# The fastest amplifiers of gauges write 100 000 samples in a second.
_MIN_STEP_S, _MAX_STEP_S = 0.9e-5, 0.02
_MIN_DURATION_S, _MAX_DURATION_S = 5e-3, 600.0
_MIN_STAIR, _MAX_STAIR = 3, 100
# Samples before and after the rise that are looked at, too.
_BESIDE_RISE = 400
# Of two rounded ends and what lies between; no file has a finer digit, as a share of the curve's height.
_ROUNDED, _MIN_DIGIT = 1.05, 1e-6
_MIN_CORNERS = 5
_MIN_CUT_SHARE = 0.05
# A zero that is off by more than a share of the peak, and by more than this, is told [N].
OFFSET_SHARE, MIN_OFFSET_N = 0.01, 1.0
# So many standard deviations of the noise no single sample of a few is below zero.
_LOW_SDS = 4.0
# The standard deviation of noise over the median size of its second differences; too few of them tell none.
_SD_OF_BENDS, _MIN_BENDS = 1.4826 / math.sqrt(6), 10


def sampling_faults(curve: GaugeCurve) -> list[GaugeFault]:
    """Faults of rows and times."""
    if curve.backward > MAX_BACKWARD_SHARE * (curve.time.size + curve.repeated):
        text = f"Column {curve.columns[0]!r} goes back {curve.backward} times: it is no time."
        return [GaugeFault("wrong_column", curve.backward, text, spoils=True)]
    found = []
    if curve.unreadable:
        text = f"{counted(curve.unreadable, 'row', 'holds')} no number, or more than there are columns: dropped."
        found.append(GaugeFault("unreadable", curve.unreadable, text, repaired=True))
    missing = 0 if curve.pressure is None else int(np.isnan(curve.pressure).sum())
    if missing:
        text = f"{counted(missing, 'pressure', 'is')} no number: the highest pressure is at least what is told."
        found.append(GaugeFault("unreadable", missing, text))
    if curve.repeated:
        text = f"{counted(curve.repeated, 'row', 'has')} the time of an earlier one: dropped."
        found.append(GaugeFault("repeated", curve.repeated, text, repaired=True))
    if curve.backward:
        text = f"Time goes back {counted(curve.backward, 'time')}: the rows were sorted."
        found.append(GaugeFault("backward", curve.backward, text, repaired=True))
    found += step_faults(curve)
    step = curve.step
    if not curve.rate_told and not _MIN_STEP_S <= step <= _MAX_STEP_S:
        text = (
            f"A sample every {step:.3g} s is no recording of a collision: the unit of time, {curve.units[0]!r}, is "
            "wrong, or the file is an excerpt."
        )
        found.append(GaugeFault("wrong_unit", 1, text, spoils=True))
    elif not _MIN_DURATION_S <= curve.time[-1] - curve.time[0] <= _MAX_DURATION_S:
        text = f"A recording of {curve.time[-1] - curve.time[0]:.3g} s: the unit of time, {curve.units[0]!r}, is wrong."
        found.append(GaugeFault("wrong_unit", 1, text, spoils=True))
    return found


def curve_faults(
    curve: GaugeCurve, raw: FloatArray, at: int, first: int, onset: float, peak: float, rest: FloatArray | None
) -> list[GaugeFault]:
    """Faults of the force.

    Args:
        curve: zeroed, pressing positive.
        raw: as recorded (samples,) [N].
        at: the highest sample of the first half second.
        first: the first sample in contact.
        onset: when contact begins [s].
        peak: force there [N].
        rest: once the gauge is free again, where there is too little time before contact [N]; None: there is enough.
    """
    wrong = _wrong_column(curve)
    if wrong:
        return [wrong]
    force = curve.force
    found = []
    if not _MIN_PEAK_N <= peak <= _MAX_PEAK_N:
        text = (
            f"A peak of {peak:.3g} N is none of a gauge of collisions: the unit of force, {curve.units[1]!r}, is "
            "wrong, or nothing was hit."
        )
        found.append(GaugeFault("wrong_unit", 1, text, spoils=True))
    highest = float(np.abs(raw).max())
    if highest > _BEYOND * curve.full_scale_N:
        text = (
            f"A force of {highest:.4g} N is beyond the device's range of {curve.full_scale_N:.4g} N: the range or the "
            f"unit of force, {curve.units[1]!r}, is wrong."
        )
        found.append(GaugeFault("wrong_unit", 1, text, spoils=True))
    found += hidden_peak(curve, at, first, onset)
    stairs = _repeats(force, first, at)
    found += _flat(curve, raw, at, stairs)
    found += _flat_pressure(curve, onset)
    lines = _straight(force, first, at)
    if stairs or lines:
        every = max(stairs, lines)
        rate = 1 / (every * curve.step)
        how = "each value is held" if stairs >= lines else "values lie on straight lines"
        text = f"The curve was resampled: {how} for {every} samples, so it was measured at {rate:.4g} Hz."
        found.append(GaugeFault("resampled", every, text, spoils=(at - first) / every < _MIN_RISE_SAMPLES))
    rise = at - first
    if rise < _MIN_RISE_SAMPLES or 1 / curve.step < _MIN_RATE_HZ:
        text = f"{rise} samples from the beginning of contact to the peak, at {1 / curve.step:.4g} Hz: too coarse."
        found.append(GaugeFault("coarse", 1, text, spoils=rise < _MIN_RISE_SAMPLES))
    found += _truncated(curve, at, onset, rest)
    neighbours = max(force[max(at - 1, 0)], force[min(at + 1, force.size - 1)])
    if 0 < at < force.size - 1 and neighbours < 0.5 * force[at]:
        text = "The peak is a single sample, twice as high as its neighbours."
        found.append(GaugeFault("spike", 1, text, spoils=True))
    return found


def _wrong_column(curve: GaugeCurve) -> GaugeFault | None:
    force, name = curve.force, curve.columns[1]
    steps = np.diff(force)
    if not steps.any():
        return GaugeFault("wrong_column", 1, f"Column {name!r} never changes: it is no force.", spoils=True)
    if (steps >= 0).all() or (steps <= 0).all():
        even = np.ptp(steps) < 1e-3 * np.abs(steps).max()
        what = "a time or a counter" if even else "a time, a travel or an integral"
        if even or np.count_nonzero(steps) > 0.9 * steps.size:
            text = f"Column {name!r} only goes one way: it is {what}, no force."
            return GaugeFault("wrong_column", 1, text, spoils=True)
    return None


def _flat(curve: GaugeCurve, raw: FloatArray, at: int, held: int) -> list[GaugeFault]:
    found = []
    level, scale = float(np.abs(raw[at])), curve.full_scale_N
    known = level <= _BEYOND * scale
    top = _cut_at_top(curve.force, at, held, at_end=known and level >= _AT_END * scale)
    if _AT_END * scale <= level <= _SHORTLY_BEYOND * scale:
        # At the end of a known range noise goes on where the force cannot.
        top = max(top, _at_range_end(curve.force, raw, at, held, _AT_END * scale))
    if top:
        name = "clipped" if known and level < 0.98 * scale else "saturated"
        where = f"the device's range of {scale:.4g} N" if name == "saturated" and known else f"{level:.4g} N"
        text = f"{counted(top, 'sample', 'stands')} at {where}: the peak is higher than what is recorded."
        found.append(GaugeFault(name, top, text, spoils=True))
    lowest = curve.force == curve.force.min()
    count = int(lowest.sum())
    if count > _MIN_CUT_SHARE * raw.size and np.unique(raw).size > 10 and _one_sided(curve.force, lowest):
        low = counted(count, "sample", "stands")
        text = f"{low} at the lowest value while others scatter above: what lies below was cut off."
        found.append(GaugeFault("clipped", count, text))
    return found


def _flat_pressure(curve: GaugeCurve, onset: float) -> list[GaugeFault]:
    """Whether the pressure of the first half second of contact is cut off: the force can be relied on all the same."""
    if curve.pressure is None:
        return []
    known = np.isfinite(curve.pressure)
    pressure, since = curve.pressure[known], curve.time[known] - onset
    early = np.flatnonzero((since >= 0) & (since <= FIRST_PHASE_S))
    if not early.size:
        return []
    at = int(early[np.argmax(pressure[early])])
    # A pressure sensor is slower than a gauge: how long it holds a value shows in all of the contact.
    top = _cut_at_top(pressure, at, _repeats(pressure, int(early[0]), pressure.size - 1), at_end=False)
    if not top:
        return []
    text = f"{top} pressures stand at {pressure[at]:.4g} N/cm²: the highest pressure is at least what is told."
    return [GaugeFault("saturated", top, text)]


def _cut_at_top(force: FloatArray, at: int, held: int, *, at_end: bool) -> int:
    """How many samples stand at the top where the curve breaks off on both sides of them; 0: it does not.

    A smooth peak of n samples in its highest digit has n more on either side in the next eight digits.

    Args:
        force: pressing positive (samples,) [N].
        at: its highest sample.
        held: for how many samples the device holds each value.
        at_end: the highest sample is at the end of the device's range: there no peak is smooth.
    """
    height = float(force[at])
    low = np.flatnonzero(force < 0.5 * height)
    before, after = low[low < at].max(initial=-1), low[low > at].min(initial=force.size)
    part = force[before + 1 : after]
    top = np.flatnonzero(part == height)
    if top.size < max(_MIN_FLAT, 2 * held + 1):
        return 0
    if at_end:
        return int(top.size)
    digit = max(float(np.diff(np.unique(part)).min(initial=height)), _MIN_DIGIT * height)
    near = part > height - (_NEAR_DIGITS + 0.5) * digit
    sides = (near[: top[0]][::-1], near[top[-1] + 1 :])
    # Up to the first sample that is lower.
    beside = [int(np.argmin(np.append(side, False))) for side in sides]
    return int(top.size) if max(beside) < _SMOOTH * top.size else 0


def _at_range_end(force: FloatArray, raw: FloatArray, at: int, held: int, end: float) -> int:
    """How many samples about the highest one stand at the end of the device's range; 0: no more than a summit has.

    Args:
        force: pressing positive (samples,) [N].
        raw: as recorded [N].
        at: the highest sample.
        held: for how many samples the device holds each value.
        end: force from which the range is at its end [N].
    """
    low = np.flatnonzero(force < 0.5 * force[at])
    before, after = low[low < at].max(initial=-1), low[low > at].min(initial=force.size)
    count = int((np.abs(raw[before + 1 : after]) >= end).sum())
    return count if count >= max(_MIN_FLAT, 2 * held + 1) else 0


def _one_sided(force: FloatArray, lowest: FloatArray) -> bool:
    """Whether samples of the baseline scatter, but to one side only."""
    peak = float(force.max())
    base = force[force < 0.05 * peak]
    scattered = base[base > force.min()]
    return bool(scattered.size > 0.1 * lowest.sum())


def _repeats(force: FloatArray, first: int, last: int) -> int:
    """For how many samples each value is held from one sample to another, as on the way to the peak; 0: none."""
    rise = force[max(first - 1, 0) : last + 1]
    if rise.size < 2 * _MIN_STAIR:
        return 0
    changes = np.flatnonzero(np.diff(rise) != 0)
    if changes.size < 2 or changes.size > rise.size / 2:
        return 0
    return int(np.median(np.diff(changes)))


def _straight(force: FloatArray, first: int, at: int) -> int:
    """For how many samples the curve runs straight between corners; 0: it does not.

    Straight is what leaves a line by less than a digit of the file, about the rise to the peak. Lines between other
    samples, as far apart, leave it by more: a curve that is smooth is met as well by all of them.
    """
    part = force[max(first - _BESIDE_RISE, 0) : at + _BESIDE_RISE + 1]
    if part.size < 4 * _MIN_STAIR or not np.ptp(part) > 0:
        return 0
    digit = max(float(np.diff(np.unique(part)).min()), _MIN_DIGIT * float(np.ptp(part)))
    # Two of three samples at least are no corners.
    if (np.abs(np.diff(part, 2)) <= 2.01 * digit).mean() < 0.6:
        return 0
    for every in range(min(_MAX_STAIR, part.size // 4), _MIN_STAIR - 1, -1):
        off = [_off_lines(part, every, phase) / digit for phase in range(every)]
        met = any(each.max() <= _ROUNDED for each in off)
        if met and max(int((each > 2 * _ROUNDED).sum()) for each in off) >= _MIN_CORNERS:
            return every
    return 0


def _off_lines(values: FloatArray, every: int, phase: int) -> FloatArray:
    """Farthest off the straight lines between samples so far apart, for each of them."""
    knots = np.arange(phase, values.size, every)
    index = np.arange(knots[0], knots[-1])
    off = np.abs(values[index] - np.interp(index, knots, values[knots]))
    return np.asarray(np.maximum.reduceat(off, knots[:-1] - phase), dtype=np.float64)


def _truncated(curve: GaugeCurve, at: int, onset: float, rest: FloatArray | None) -> list[GaugeFault]:
    found = []
    force, last = curve.force, curve.force.size - 1
    peak = float(force[at])
    if rest is not None:
        found.append(_nothing_before(force, at, rest))
    if at >= last - 1:
        text = "The recording ends at its highest force: the peak is not in it."
        found.append(GaugeFault("truncated", 1, text, spoils=True))
    elif curve.time[-1] - onset < FIRST_PHASE_S and force[-1] > 0.05 * peak:
        text = (
            f"The recording ends {1e3 * (curve.time[-1] - onset):.4g} ms after the beginning of contact, with "
            f"{force[-1]:.4g} N: what is left after {FIRST_PHASE_S:g} s is not in it."
        )
        found.append(GaugeFault("truncated", 1, text))
    return found


def _nothing_before(force: FloatArray, at: int, rest: FloatArray) -> GaugeFault:
    """What it means that there is too little time before contact: nothing tells the zero.

    A mass that parts from the gauge pulls it below its zero for a moment: after the peak only what rests counts.
    """
    peak, begin = float(force[at]), float(force[0])
    # Second differences leave nothing of a smooth curve, and a median nothing of the end of a contact.
    bends = np.abs(np.diff(force[at + (force.size - at) // 2 :], 2))
    noise = _SD_OF_BENDS * float(np.median(bends)) if bends.size >= _MIN_BENDS else 0.0
    levels = [(float(force[: at + 1].min()), 1)]
    levels += [(float(np.median(rest)), rest.size)] if rest.size else []
    limit = max(MIN_OFFSET_N, OFFSET_SHARE * peak)
    low = [level for level, count in levels if level < -max(limit, _LOW_SDS * noise / math.sqrt(count))]
    in_contact = begin > 0.05 * peak
    begins = f"begins in contact, at {begin:.4g} N" if in_contact else "has too little time before contact"
    if low:
        text = f"The recording {begins}, and shows {min(low):.4g} N: its zero is not known, and lower than 0 N."
    elif in_contact:
        text = f"The recording {begins}: what was before is missing."
    else:
        text = f"The recording {begins}: its zero is taken to be 0 N."
    return GaugeFault("truncated", 1, text, spoils=bool(low) or begin > 0.5 * peak)
