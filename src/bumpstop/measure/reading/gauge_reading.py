"""What a gauge recording says: peak force, what is left of it, drift, and what is wrong with the recording."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision.verdict.two_phase import FIRST_PHASE_S
from bumpstop.measure.reading.gauge_contact import find_contact, late_fault
from bumpstop.measure.reading.gauge_curve import GaugeCurve, GaugeFormat, load_gauge_curve
from bumpstop.measure.reading.gauge_fault import GaugeFault
from bumpstop.measure.reading.gauge_faults import MIN_OFFSET_N, OFFSET_SHARE, curve_faults, sampling_faults
from bumpstop.measure.reading.gauge_pressure import MAX_PRESSURE_N_CM2, corrected_pressure

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray

# Contact begins where the force passes this share of the peak, unless a trigger is told.
_TRIGGER_SHARE = 0.03
_NOISE_SDS = 6.0
# What is left is taken over this long after the first half second [s].
_LASTING_S = 0.5
_MIN_BASELINE = 5
# So well a baseline tells the zero, as a share of what the force spans.
_MAX_ZERO_ERROR = 0.01
# What hides a higher peak, and leaves the forces that were recorded true.
_HIDES_PEAK = frozenset({"saturated", "clipped", "coarse", "gaps", "truncated", "resampled"})
# What spoils the peak force, and leaves known when contact is: with this the pressure counts.
_KEEPS_PRESSURE = _HIDES_PEAK | {"spike"}
# A recording that begins with more than this share of its highest force, and ends with less, begins in contact.
_IN_CONTACT = 0.3


@dataclass(frozen=True, eq=False)
class GaugeReading:
    """Figures of one recording.

    Attributes:
        curve: as read, zeroed and with pressing positive.
        onset: when contact begins [s].
        release: when the gauge is free again [s]; infinite: it never is.
        peak_N: greatest force in the first 0.5 s of contact, between samples: the summit of the parabola through the
            highest sample and its neighbours [N].
        sampled_peak_N: the highest sample in that time [N].
        peak_time: of the peak, after the onset [s].
        lasting_N: greatest force after the first 0.5 s, before another contact begins [N]; NaN where the recording ends
            before.
        left_N: median of that until 1 s after the onset [N].
        zero_N: force before contact, as the recording has it [N]; NaN: it has too little time before contact.
        drift_N: force once the gauge is free again less that before contact [N]; NaN: it is never free again.
        noise_N: standard deviation before contact [N]; NaN: too few samples.
        peak_pressure_N_cm2, lasting_pressure_N_cm2: highest pressure in and after the first 0.5 s, before another
            contact begins; NaN: none recorded.
        rate_hz: sampling rate [1/s].
        faults: what is wrong, each with its count.
    """

    curve: GaugeCurve
    onset: float
    release: float
    peak_N: float
    sampled_peak_N: float
    peak_time: float
    lasting_N: float
    left_N: float
    zero_N: float
    drift_N: float
    noise_N: float
    peak_pressure_N_cm2: float
    lasting_pressure_N_cm2: float
    rate_hz: float
    faults: tuple[GaugeFault, ...]

    @property
    def usable(self) -> bool:
        """Whether the peak force can be relied on: no fault spoils it."""
        return not any(fault.spoils for fault in self.faults)

    @property
    def lower_bound_N(self) -> float:
        """The highest sample, where faults only hide a higher one [N]; NaN: the peak counts, or nothing is known.

        Where the zero is not known it is no more than what the force spans.
        """
        spoiling = {fault.name for fault in self.faults if fault.spoils}
        hidden = bool(spoiling) and spoiling <= _HIDES_PEAK
        return min(self.sampled_peak_N, float(np.ptp(self.curve.force))) if hidden else math.nan

    @property
    def pressing_N(self) -> float:
        """The greatest force of this contact after its first 0.5 s [N]; NaN: there is none, or it is not known."""
        time = self.curve.time
        pressed = self.curve.force[(time - self.onset > FIRST_PHASE_S) & (time < self.release)]
        if not pressed.size or (not self.usable and math.isnan(self.lower_bound_N)):
            return math.nan
        return min(float(pressed.max()), math.inf if self.usable else float(np.ptp(self.curve.force)))

    @property
    def pressure_N_cm2(self) -> float:
        """The highest pressure of the first 0.5 s, at least [N/cm2]; NaN: none was recorded that can be relied on."""
        return self._counting(self.peak_pressure_N_cm2)

    @property
    def pressing_pressure_N_cm2(self) -> float:
        """The same of this contact after its first 0.5 s [N/cm2]."""
        time = self.curve.time
        return self._counting(
            _highest(self.curve.pressure, (time - self.onset > FIRST_PHASE_S) & (time < self.release))
        )

    def _counting(self, pressure: float) -> float:
        """Above zero; where faults spoil the force, and with it what tells the zero, no more than what it spans."""
        spoiling = {fault.name for fault in self.faults if fault.spoils}
        if self.curve.pressure is None or not pressure > 0 or not spoiling <= _KEEPS_PRESSURE:
            return math.nan
        known = self.curve.pressure[np.isfinite(self.curve.pressure)]
        if known.max() > MAX_PRESSURE_N_CM2:
            return math.nan
        return pressure if self.usable else min(pressure, float(np.ptp(known)))

    def to_json(self) -> dict[str, Any]:
        """Figures by name; those that there are not are None."""
        names = (
            *("peak_N", "sampled_peak_N", "peak_time", "lasting_N", "left_N", "onset", "zero_N", "drift_N", "noise_N"),
            *("peak_pressure_N_cm2", "lasting_pressure_N_cm2", "rate_hz"),
        )
        spelt = {"peak_time": "peak_time_s", "onset": "onset_s"}
        figures: dict[str, Any] = {}
        for name in names:
            value = float(getattr(self, name))
            figures[spelt.get(name, name)] = value if math.isfinite(value) else None
        return {
            "file": self.curve.source,
            **figures,
            "samples": int(self.curve.time.size),
            "columns": dict(zip(("time", "force", "pressure"), self.curve.columns, strict=True)),
            "units": dict(zip(("time", "force", "pressure"), self.curve.units, strict=True)),
            "usable": self.usable,
            "faults": [fault.to_json() for fault in self.faults],
        }


def read_gauge(path: str | Path, form: GaugeFormat | None = None) -> GaugeReading:
    """Read a recording and what it says.

    Args:
        path: of a CSV.
        form: what the user tells of it.

    Raises:
        InputError: the file cannot be read.
    """
    form = GaugeFormat() if form is None else form
    return analyse(load_gauge_curve(Path(path), form), form.trigger_N)


def analyse(curve: GaugeCurve, trigger_N: float | None = None) -> GaugeReading:
    """Figures and faults of a curve.

    A curve that presses downward is turned over, a zero that is off is taken away; both are named.

    Args:
        curve: as recorded.
        trigger_N: force at which contact begins [N]; None: 3 % of the peak, and six standard deviations of the noise.
    """
    raw, faults = curve.force, list(sampling_faults(curve))
    timeless = any(fault.name == "wrong_column" for fault in faults)
    zero, noise, free = _baseline(raw)
    before = free > 0
    force = raw - zero
    if -force.min() > force.max():
        force = -force
        faults.append(GaugeFault("inverted", 1, "The force is negative: it was turned over.", repaired=True))
    peak = float(force.max())
    if before and abs(zero) > max(MIN_OFFSET_N, OFFSET_SHARE * peak):
        text = f"The gauge shows {zero:.3g} N before contact: that was taken away."
        faults.append(GaugeFault("shifted", 1, text, repaired=True))
    zeroed = replace(curve, force=force)
    trigger = trigger_N
    if trigger is None:
        trigger = max(_TRIGGER_SHARE * peak, _NOISE_SDS * noise if math.isfinite(noise) else 0.0)
    contact = find_contact(zeroed, trigger, extrapolate=trigger_N is None and before)
    first, onset = contact.first, contact.onset
    faults += contact.faults
    since = curve.time - onset
    early = (since >= 0) & (since <= FIRST_PHASE_S)
    early[first] = True
    late = (since > FIRST_PHASE_S) & (curve.time < contact.next)
    at = int(np.flatnonzero(early)[np.argmax(force[early])])
    summit, summit_time = _summit(curve.time, force, at)
    lasting = late & (since <= FIRST_PHASE_S + _LASTING_S)
    rest = _free_end(force, trigger, at)
    drift = _middle(rest, _digit(raw)) if rest.size >= _MIN_BASELINE else math.nan
    pressure, pressure_faults = corrected_pressure(curve, free)
    zeroed = replace(zeroed, pressure=pressure)
    faults += pressure_faults
    faults += curve_faults(zeroed, raw, at, first, onset, summit, None if before else rest)
    if not any(fault.name == "wrong_column" for fault in faults):
        faults += late_fault(zeroed, at, onset)
    if math.isfinite(drift) and abs(drift) > max(MIN_OFFSET_N, OFFSET_SHARE * peak):
        text = f"The gauge shows {drift:.3g} N more after the contact than before it."
        faults.append(GaugeFault("drift", 1, text))
    return GaugeReading(
        curve=zeroed,
        onset=onset,
        release=contact.release,
        peak_N=summit,
        sampled_peak_N=float(force[at]),
        peak_time=summit_time - onset,
        lasting_N=float(force[late].max()) if late.any() else math.nan,
        left_N=float(np.median(force[lasting])) if lasting.any() else math.nan,
        zero_N=zero if before else math.nan,
        drift_N=drift,
        noise_N=noise,
        peak_pressure_N_cm2=_highest(pressure, early),
        lasting_pressure_N_cm2=_highest(pressure, late),
        rate_hz=1.0 / curve.step,
        # Of a force over what is no time nothing else can be said.
        faults=tuple(fault for fault in faults if not timeless or fault.name == "wrong_column"),
    )


def _highest(pressure: FloatArray | None, rows: npt.NDArray[np.bool_]) -> float:
    """Highest of some samples; NaN where none of them has a number."""
    known = np.array([]) if pressure is None else pressure[rows & np.isfinite(pressure)]
    return float(known.max()) if known.size else math.nan


def _baseline(force: FloatArray) -> tuple[float, float, int]:
    """Force before contact, its standard deviation, and how many samples it has; none where that was not recorded."""
    none = 0.0, math.nan, 0
    span = float(np.ptp(force))
    # Until the force first leaves what it begins with.
    count = int(np.argmax(np.abs(force - np.median(force[:_MIN_BASELINE])) > 0.1 * span))
    # The rise itself is no baseline.
    count = count - max(1, count // 10) if count > _MIN_BASELINE else count
    if count < _MIN_BASELINE:
        return none
    begin, highest, digit = force[:count], float(np.abs(force).max()), _digit(force)
    zero, end = _middle(begin, digit), float(np.median(force[-_MIN_BASELINE:]))
    noise = float(begin.std())
    # Where most of it is the rise, its median is off that of its first half; few noisy samples do not show a rise.
    off = abs(zero - _middle(begin[: (count + 1) // 2], digit))
    # A force between two digits may step by one at rest: that puts the halves half a digit apart.
    if off + noise / math.sqrt(count) > _MAX_ZERO_ERROR * span + 0.5 * digit:
        return none
    # A gauge that was pressed from the beginning and is free later shows less then.
    one_sign = min(float(force.max()), -float(force.min())) < 0.02 * highest
    in_contact = one_sign and abs(zero) > _IN_CONTACT * highest and abs(zero) - abs(end) > 0.1 * highest
    return none if in_contact else (zero, noise, count)


def _digit(force: FloatArray) -> float:
    """The least that two different values are apart [N]; 0: there is one value only."""
    return float(np.diff(np.unique(force)).min(initial=math.inf)) if np.ptp(force) > 0 else 0.0


def _middle(force: FloatArray, digit: float) -> float:
    """The median of a force that was rounded: of many equal values each lies anywhere in its digit."""
    median = float(np.median(force))
    same = int((force == median).sum())
    below = int((force < median).sum())
    return median + digit * ((0.5 * force.size - below) / same - 0.5) if same else median


def _summit(time: FloatArray, force: FloatArray, at: int) -> tuple[float, float]:
    """Height and time of the parabola through the highest sample and its neighbours.

    A sine of angular frequency w sampled every h is met to (w h)^4 / 128 of its height at most.
    """
    if not 0 < at < force.size - 1:
        return float(force[at]), float(time[at])
    x = time[at - 1 : at + 2] - time[at]
    y = force[at - 1 : at + 2]
    rise, fall = (y[1] - y[0]) / -x[0], (y[2] - y[1]) / x[2]
    curvature = (fall - rise) / (x[2] - x[0])
    if not curvature < 0:
        return float(y[1]), float(time[at])
    slope = rise - curvature * x[0]
    top = float(np.clip(-slope / (2 * curvature), x[0], x[2]))
    return float(y[1] + slope * top + curvature * top**2), float(time[at] + top)


def _free_end(force: FloatArray, trigger: float, at: int) -> FloatArray:
    """The later half of the force after the contact, where the gauge is free again at the end [N]."""
    tail = force[at:]
    pressed = np.flatnonzero(tail >= max(trigger, 0.1 * float(force.max())))
    free = tail[int(pressed[-1]) + 1 :] if pressed.size else tail
    return free[free.size // 2 :]
