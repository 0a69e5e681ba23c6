"""What a gauge shows before contact: its zero, the noise, and whether the zero stays."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.measure.reading.gauge_contact import GaugeContact, find_contact, samples_before
from bumpstop.measure.reading.gauge_fault import GaugeFault

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray
    from bumpstop.measure.reading.gauge_curve import GaugeCurve

# Contact begins where the force passes this share of the peak, unless a trigger is told.
_TRIGGER_SHARE = 0.03
_NOISE_SDS = 6.0
# A zero that is off or moves by more than a share of the peak, and by more than this, is told [N].
OFFSET_SHARE, MIN_OFFSET_N = 0.01, 1.0
# A zero that moves by more than this share shortly before contact spoils the peak: the rise up to the trigger is less.
_MOVING_SHARE = 0.03
_LOAD_SHARE = 0.1
# Medians of n samples differ by more than this many times their noise over the root of n once in 10 000 times.
_MEDIAN_SDS = 7.0
MIN_BASELINE = 5
# Of a shorter time before contact too much belongs to the rise [s].
_MIN_BEFORE_S = 0.05
# A recording that begins with more than this share of its highest force, and ends elsewhere, begins in contact.
_IN_CONTACT = 0.3
# The zero depends on when contact begins, and that on the zero.
_MAX_ROUNDS = 8


@dataclass(frozen=True, eq=False)
class ZeroedGauge:
    """A curve from zero on, pressing positive, and its contact.

    Attributes:
        curve: zeroed, pressing positive.
        contact: the one that leads to the highest force.
        trigger: force from which there is contact [N].
        before: samples shortly before contact, of which the zero is; empty: the recording begins in contact.
        zero: force before contact, as the recording has it [N]; NaN: it begins in contact.
        noise: standard deviation before contact [N]; NaN: too few samples.
        faults: what was changed, and a zero that moves.
    """

    curve: GaugeCurve
    contact: GaugeContact
    trigger: float
    before: npt.NDArray[np.intp]
    zero: float
    noise: float
    faults: tuple[GaugeFault, ...]


def zeroed_gauge(curve: GaugeCurve, trigger_N: float | None) -> ZeroedGauge:
    """Find contact and take away what the gauge shows shortly before it.

    Args:
        curve: as recorded.
        trigger_N: force at which contact begins [N]; None: 3 % of the peak, and six standard deviations of the noise.
    """
    raw = curve.force
    zero, noise, known = _rough_zero(raw)
    before, last, settled = np.arange(0), -1, True
    for _ in range(_MAX_ROUNDS):
        force = raw - zero
        inverted = -force.min() > force.max()
        force = -force if inverted else force
        peak = float(force.max())
        least = max(_TRIGGER_SHARE * peak, _NOISE_SDS * noise if math.isfinite(noise) else 0.0)
        trigger = least if trigger_N is None else trigger_N
        zeroed = replace(curve, force=force)
        contact = find_contact(zeroed, trigger, extrapolate=trigger_N is None and known)
        settled = not known or contact.first == last
        if settled:
            break
        before, last = samples_before(zeroed, contact.first, trigger), contact.first
        settled = before.size < MIN_BASELINE or curve.time[last] - curve.time[before[0]] < _MIN_BEFORE_S
        if settled:
            break
        zero, noise = float(np.median(raw[before])), float(raw[before].std())
    found = []
    if inverted:
        found.append(GaugeFault("inverted", 1, "The force is negative: it was turned over.", repaired=True))
    if known and abs(zero) > max(MIN_OFFSET_N, OFFSET_SHARE * peak):
        text = f"The gauge shows {zero:.3g} N before contact: that was taken away."
        found.append(GaugeFault("shifted", 1, text, repaired=True))
    if not settled:
        text = "The force creeps from the zero into contact: the zero is not known, nor the peak."
        found.append(GaugeFault("drift", 1, text, spoils=True))
    elif known:
        found += _moving(zeroed, contact.first, trigger, before, peak)
    return ZeroedGauge(zeroed, contact, trigger, before, zero if known else math.nan, noise, tuple(found))


def _rough_zero(force: FloatArray) -> tuple[float, float, bool]:
    """Force before it first leaves what it begins with, its standard deviation, and whether there is such a time."""
    span = float(force.max() - force.min())
    if span == 0:
        return 0.0, math.nan, False
    away = np.abs(force - np.median(force[:MIN_BASELINE])) > 0.1 * span
    count = int(np.argmax(away)) if away.any() else force.size
    # The rise itself is no baseline.
    count = count - max(1, count // 10) if count > MIN_BASELINE else count
    if count < MIN_BASELINE:
        return 0.0, math.nan, False
    begin, highest = force[:count], float(np.abs(force).max())
    zero, end = float(np.median(begin)), float(np.median(force[-MIN_BASELINE:]))
    one_sign = min(float(force.max()), -float(force.min())) < 0.02 * highest
    in_contact = one_sign and abs(zero) > _IN_CONTACT * highest and abs(end - zero) > 0.1 * highest
    return (0.0, math.nan, False) if in_contact else (zero, float(begin.std()), True)


def _moving(
    curve: GaugeCurve, first: int, trigger: float, before: npt.NDArray[np.intp], peak: float
) -> list[GaugeFault]:
    """Whether the zero moves by more than noise explains until contact, or still does shortly before it."""
    if before.size < 2 * MIN_BASELINE:
        return []
    found = []
    free = np.flatnonzero(curve.force[:first] < trigger)
    # A force at the begin that is higher than shortly before contact is a zero, too.
    free = np.arange(before[-1] + 1) if curve.force[0] >= trigger else free[free <= before[-1]]
    size = min(before.size, free.size // 3)
    if size >= MIN_BASELINE:
        moved, noise = _step(curve.force[free[:size]], curve.force[free[-size:]])
        if abs(moved) > max(MIN_OFFSET_N, OFFSET_SHARE * peak, noise):
            # What rises so far may be a load, which belongs to the peak.
            load = moved > _LOAD_SHARE * peak
            text = (
                f"The zero moves by {moved:.3g} N before contact: what the gauge shows shortly before it was taken "
                f"away{', but it may be a load' if load else ''}."
            )
            found.append(GaugeFault("drift", 1, text, repaired=True, spoils=load))
    half = before.size // 2
    moved, noise = _step(curve.force[before[:half]], curve.force[before[-half:]])
    if abs(moved) > max(MIN_OFFSET_N, _MOVING_SHARE * peak, noise):
        text = (
            f"The zero moves by {moved:.3g} N in the last {curve.time[first] - curve.time[before[0]]:.2g} s before "
            "contact: the peak is off by as much."
        )
        found.append(GaugeFault("drift", 1, text, spoils=True))
    return found


def _step(begin: FloatArray, end: FloatArray) -> tuple[float, float]:
    """How far a median moves, and how far noise alone may move it."""
    noise = 0.5 * (float(begin.std()) + float(end.std()))
    return float(np.median(end) - np.median(begin)), _MEDIAN_SDS * noise / math.sqrt(end.size)
