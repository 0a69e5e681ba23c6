"""When contact begins in a recording of a gauge, and what was touched before it."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.measure.reading.gauge_fault import GaugeFault

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray
    from bumpstop.measure.reading.gauge_curve import GaugeCurve

# A gauge that shows less than the trigger for so long is free again [s].
_FREE_S = 0.05
# What stays below this share of the highest force is a touch, no collision.
_TOUCH_SHARE = 1 / 3
# What lasts is above the peak by more than noise.
_HARDER = 1.05


@dataclass(frozen=True)
class GaugeContact:
    """The contact that leads to the highest force.

    Attributes:
        first: its first sample.
        onset: when it begins [s].
        release: when the gauge is free again [s]; infinite: it never is.
        next: when the next contact begins that is no part of its first phase [s]; infinite: there is none.
        faults: touches and collisions before it, and hard contacts after it.
    """

    first: int
    onset: float
    release: float
    next: float
    faults: tuple[GaugeFault, ...]


def find_contact(curve: GaugeCurve, trigger: float, *, extrapolate: bool) -> GaugeContact:
    """The contact that leads to the highest force.

    Contacts are parted where the gauge is free again. What is within the first phase before the highest force belongs
    to it, unless it is a mere touch. So does what follows within the first phase, as of an arm that bounces and
    presses.

    Args:
        curve: zeroed, pressing positive.
        trigger: force from which there is contact [N].
        extrapolate: whether the onset is led back to zero along the rise.
    """
    force, time = curve.force, curve.time
    begins, releases = _contacts(curve, trigger)
    highest = int(np.argmax(force))
    count = int(np.searchsorted(begins, highest, side="right"))
    if not count:
        onset = _crossing(curve, highest, trigger)
        return GaugeContact(highest, onset, float(time[highest]), math.inf, ())
    later, begins = time[begins[count:]], begins[:count]
    tops = np.maximum.reduceat(force[: highest + 1], begins)
    hard = np.flatnonzero(tops >= _TOUCH_SHARE * force[highest])
    near = hard[time[highest] - time[begins[hard]] <= FIRST_PHASE_S]
    own = int(near[0]) if near.size else count - 1
    first = int(begins[own])
    onset = _crossing(curve, first, trigger)
    if extrapolate:
        onset = _begin(curve, first, onset)
    faults = _before(time[begins[: own + 1]], tops[: own + 1], hard, force[highest])
    bounces = int(np.searchsorted(later, onset + FIRST_PHASE_S, side="right"))
    release, following = float(releases[count - 1 + bounces]), float(later[bounces:].min(initial=math.inf))
    faults += _after(curve, later[bounces:], onset, _TOUCH_SHARE * force[highest])
    return GaugeContact(first, onset, release, following, tuple(faults))


def late_fault(curve: GaugeCurve, at: int, onset: float) -> list[GaugeFault]:
    """Whether the highest sample of the first phase is far below what comes later in the same contact.

    A force that rises at once, after the first phase, is that of a collision of a gauge that was loaded before; the
    peak is another then. One that rises slowly is a press: its two phases are what they are.

    Args:
        curve: zeroed, pressing positive.
        at: the highest sample of the first phase.
        onset: when contact begins [s].
    """
    force, time = curve.force, curve.time
    highest = int(np.argmax(force))
    low = _TOUCH_SHARE * force[highest]
    if force[at] >= low:
        return _pressed_on(curve, at, highest, onset)
    rises_from = np.flatnonzero(force[:highest] < low)[-1]
    sudden = bool(time[highest] - time[rises_from] <= FIRST_PHASE_S)
    text = (
        f"The highest force, {force[highest]:.4g} N, comes {time[highest] - onset:.3g} s after the beginning of "
        f"contact, which shows {force[at]:.4g} N in its first {FIRST_PHASE_S:g} s: the gauge was "
        f"{'loaded before the collision' if sudden else 'pressed slowly'}."
    )
    return [GaugeFault("late", 1, text, spoils=sudden)]


def _pressed_on(curve: GaugeCurve, at: int, highest: int, onset: float) -> list[GaugeFault]:
    """Whether the arm presses harder after the first phase than it hit."""
    force = curve.force
    if curve.time[highest] - onset <= FIRST_PHASE_S or force[highest] <= _HARDER * force[at]:
        return []
    text = (
        f"The highest force, {force[highest]:.4g} N, comes {curve.time[highest] - onset:.3g} s after the beginning "
        f"of contact, which shows {force[at]:.4g} N in its first {FIRST_PHASE_S:g} s: the gauge was pressed on."
    )
    return [GaugeFault("late", 1, text)]


def _contacts(curve: GaugeCurve, trigger: float) -> tuple[npt.NDArray[np.intp], FloatArray]:
    """First samples of all contacts, and when the gauge is free after each [s]."""
    above = np.concatenate([[False], curve.force >= trigger, [False]])
    edges = np.flatnonzero(np.diff(above))
    begins, ends = edges[::2], edges[1::2]
    free = curve.time[begins[1:]] - curve.time[ends[:-1] - 1] >= _FREE_S
    released = np.append(curve.time, np.inf)[ends]
    return np.concatenate([begins[:1], begins[1:][free]]), np.concatenate([released[:-1][free], released[-1:]])


def _before(begins: FloatArray, tops: FloatArray, hard: npt.NDArray[np.intp], peak: float) -> list[GaugeFault]:
    """Faults of what is before the last of some contacts."""
    own = begins.size - 1
    collisions = hard[hard < own]
    found = []
    touches = own - collisions.size
    if touches:
        touched = np.setdiff1d(np.arange(own), collisions)
        last = begins[own] - begins[touched[-1]]
        often = "once" if touches == 1 else f"{touches} times"
        text = (
            f"The gauge was touched {often} before the collision, last {last:.2g} s before, with "
            f"{tops[touched].max():.4g} N at most: that was left out."
        )
        found.append(GaugeFault("touched", touches, text, repaired=True))
    if collisions.size:
        at = int(collisions[0])
        text = (
            f"The gauge was hit with {tops[at]:.4g} N, was free again, and was hit with {peak:.4g} N "
            f"{begins[own] - begins[at]:.3g} s later: it is not known which collision counts."
        )
        found.append(GaugeFault("several", int(collisions.size) + 1, text, spoils=True))
    return found


def _after(curve: GaugeCurve, begins: FloatArray, onset: float, hard: float) -> list[GaugeFault]:
    """A fault of contacts that begin after one that has ended, where a force of them is hard [N]."""
    if not begins.size:
        return []
    most = float(curve.force[curve.time >= begins[0]].max())
    if most < hard:
        return []
    text = (
        f"The gauge was free again, and pressed anew {begins[0] - onset:.3g} s after the beginning of contact, with "
        f"{most:.4g} N at most: that is left out, and is not judged as what is left."
    )
    return [GaugeFault("anew", int(begins.size), text)]


def _crossing(curve: GaugeCurve, first: int, trigger: float) -> float:
    """When the force passes the trigger before its first sample above it, straight between samples [s]."""
    if first == 0:
        return float(curve.time[0])
    low, high = curve.force[first - 1], curve.force[first]
    share = (trigger - low) / (high - low) if high > low else 1.0
    share = min(1.0, max(0.0, float(share)))
    return float(curve.time[first - 1] + share * (curve.time[first] - curve.time[first - 1]))


def _begin(curve: GaugeCurve, first: int, crossing: float) -> float:
    """Where the rise began that passes the trigger at a time [s]: it is straight at first."""
    force, time = curve.force, curve.time
    beyond = np.flatnonzero(force[first:] >= 2 * force[first])
    other = first + int(beyond[0]) if beyond.size else first
    if other == first or not force[first] > 0:
        return crossing
    slope = (force[other] - force[first]) / (time[other] - time[first])
    return min(crossing, float(time[first] - force[first] / slope))
