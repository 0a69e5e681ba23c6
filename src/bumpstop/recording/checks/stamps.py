"""Times that a PC wrote beside rows which a controller sampled evenly: jitter, bursts, stamps that are the same."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray, as_number
from bumpstop.errors import InputError
from bumpstop.terminal import counted

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.recording.formats.table import RawRecording
    from bumpstop.recording.signals import Signals

_RATES = (1.0, 1e5)  # [Hz]
_SAME_RATE = 0.02  # of the stated rate, between it and that of the stamps
_ROUGHLY = 0.3  # likewise, before lost rows are known
_AHEAD = 251  # rows among which some come without delay
_MIN_AHEAD = 50
_LONG = 1000  # rows over which jitter averages out
_AROUND = 101  # rows whose median tells a stamp that is none of theirs
_FAR = 1000  # periods that such a stamp is off
_FOLLOWS = _SAME_RATE  # of a period, by which the level of the lowest stamps may change from row to row
_LOST = 0.5  # of a period: a delay that never comes back is a row that was lost
_UNUSABLE = 0.2  # share of intervals that no controller makes
_SHORT = 0.1  # of a period, below which a sample repeats the one before
_SMOOTHER = 2.0  # positions over even times against positions over stamps: then stamps, not samples, are uneven
_ENOUGH = 20_000


def mean_period(t: FloatArray) -> float:
    """Time from row to row (N,), the same whatever the jitter: median over long spans, per row [s]."""
    span = max(1, min(_LONG, (t.size - 1) // 4))
    return float(np.median(t[span:] - t[:-span])) / span


def even_times(t: FloatArray, rate_hz: float) -> tuple[FloatArray, list[str]]:
    """Times of rows that were sampled evenly, from stamps that came some time later.

    A stamp is a sampling time and a delay. Delays come and go; what never comes back is a row that was lost. So the
    lowest of the stamps to come, each less its row's even time, rises by a period at every lost row. The spacing is
    that of the lowest stamps, so that they and the result do not part in long recordings.

    Args:
        t: (N,) stamps in the order of the rows, any numbers [s].
        rate_hz: that the rows were sampled at.

    Returns:
        (N,) rising times [s], and sentences for a reader.

    Raises:
        InputError: a rate that is none, or that the stamps contradict.
    """
    if not _RATES[0] <= as_number(rate_hz, "rate_hz") <= _RATES[1]:
        raise InputError("rate_hz", f"is {rate_hz:g}", f"wanted from {_RATES[0]:g} to {_RATES[1]:g} Hz")
    known = np.isfinite(t)
    if np.count_nonzero(known) < 2:
        return np.arange(t.size) / rate_hz, [f"No stamps: rows are taken as even, at {rate_hz:g} Hz as stated."]
    from scipy.ndimage import median_filter, minimum_filter1d

    rows, period = np.arange(t.size), 1 / rate_hz
    stamps = np.interp(rows, rows[known], t[known])
    _check_rate(mean_period(stamps), rate_hz, _ROUGHLY)
    offset = stamps - rows * period
    usual = median_filter(offset, size=min(_AROUND, t.size), mode="nearest")
    trusted = known & (np.abs(offset - usual) <= _FAR * period)
    offset[~trusted] = math.inf
    ahead = min(_AHEAD, t.size)
    lowest = minimum_filter1d(offset, ahead, mode="nearest", origin=-((ahead - 1) // 2))
    lost = _levels(lowest / period)
    # A delay longer than is looked ahead comes back later.
    lost = np.minimum.accumulate(lost[::-1])[::-1]
    lost -= lost[0]
    drift, start = _line_below(offset - lost * period, ahead)
    period += drift
    _check_rate(period, rate_hz, _SAME_RATE)
    even = start + period * rows + lost * period
    delays = 1e3 * (stamps - even)[trusted]
    notes = [
        f"Rows are taken as even, at {rate_hz:g} Hz as stated: their stamps came up to "
        f"{np.quantile(delays, 0.999):.3g} ms later, {counted(int(lost[-1]), 'row', 'was')} lost."
    ]
    return even, notes


def _levels(lowest: FloatArray) -> npt.NDArray[np.int64]:
    """(N,) whole periods that the lowest stamps to come (N,) [periods] have stepped up by.

    Before a lost row they rise in several small steps, as fewer rows without delay are left. So each is compared with
    the level since the last whole step, which follows a clock that drifts.
    """
    level, lost = float(lowest[0]), 0
    found = []
    for value in lowest[: -min(_MIN_AHEAD, lowest.size)].tolist():  # too few come behind the others
        rise = value - lost - level
        if math.isinf(level):  # no stamp so far
            level = value
        elif math.isfinite(rise):
            whole = round(rise) if abs(rise) > _LOST else 0
            lost += whole
            level += min(max(rise - whole, -_FOLLOWS), _FOLLOWS)
        found.append(lost)
    return np.array(found + [lost] * (lowest.size - len(found)), dtype=np.int64)


def _check_rate(period: float, rate_hz: float, tolerance: float) -> None:
    if not abs(period * rate_hz - 1) <= tolerance:
        came = f"{1 / period:.4g} Hz" if period > 0 else "no rising times"
        raise InputError("rate_hz", f"is {rate_hz:g}", f"by their stamps the rows came at {came}")


def _line_below(offset: FloatArray, ahead: int) -> tuple[float, float]:
    """Slope per row and beginning of the line through the lowest of every so many offsets (N,)."""
    block = max(1, min(ahead, offset.size // 4))
    edges = np.arange(0, offset.size - block + 1, block)
    parts = offset[: edges.size * block].reshape(edges.size, block)
    place, low = edges + parts.argmin(axis=1), parts.min(axis=1)
    place, low = place[np.isfinite(low)], low[np.isfinite(low)]
    if place.size < 2:
        return 0.0, float(low[0]) if low.size else 0.0
    slope, start = np.polyfit(place, low, 1)
    return float(slope), float(start)


def retimed(raw: RawRecording, rate_hz: float) -> RawRecording:
    """What was read, with even times in place of its stamps; arguments and errors as :func:`even_times`."""
    even, notes = even_times(raw.values["t"][:, 0], rate_hz)
    return replace(raw, values={**raw.values, "t": even[:, None]}, notes=(*raw.notes, *notes))


def in_bursts(t: FloatArray) -> bool:
    """Whether many rows follow the one before sooner than any controller samples; times are (N,) [s]."""
    return bool(t.size > 1 and np.mean(np.diff(t) < _SHORT * mean_period(t)) > _UNUSABLE)


def uneven_stamps(t: FloatArray, where: str) -> InputError:
    """What to say of times (N,) [s] that no controller sampled at; ``where`` names the recording."""
    mean = mean_period(t)
    low, high = (1e3 * float(x) for x in np.quantile(np.diff(t), [0.02, 0.98]))
    return InputError(
        where,
        f"intervals are mostly {low:.3g} to {high:.3g} ms, {1e3 * mean:.4g} ms on average: stamped by a PC?",
        f"state the rate that the controller samples at, for example --rate {1 / mean:.3g} of tune, detect and score "
        f"(rate_hz in Python), or time = {{ rate_hz = {1 / mean:.3g} }} in a column file where no row was lost",
    )


def stamped_by_a_pc(recording: Signals) -> str:
    """A sentence where stamps are uneven but the samples are not; empty: there is no sign of it.

    Positions tell: halfway between its neighbours a sample is where a smooth motion has it only at the true times.

    Raises:
        InputError: no detector can be run at such times.
    """
    t = recording.t
    if t.size < 20:
        return ""
    part = slice(0, _ENOUGH)
    at, q, mean = t[part], recording.q[part], mean_period(t)
    span = at[2:] - at[:-2]
    share = (at[1:-1] - at[:-2]) / span
    moving = q[2:] != q[:-2]

    def rough(rows: npt.NDArray[np.bool_]) -> tuple[float, float]:
        """Mean distance from halfway between the neighbours, over the stamps and over even times."""
        counted = moving & rows[:, None]
        if not counted.any():
            return 0.0, 0.0
        by = (np.abs(q[:-2] + s * (q[2:] - q[:-2]) - q[1:-1])[counted].mean() for s in (share[:, None], 0.5))
        given, even = by
        return float(given), float(even)

    given, even = rough(np.ones(span.size, dtype=bool))
    if in_bursts(t) and even * _SMOOTHER < given:
        raise uneven_stamps(t, recording.source or "recording")
    given, even = rough(np.abs(span - 2 * mean) < mean)  # nothing is lost between
    if not even * _SMOOTHER < given:
        return ""
    return (
        f"Times look stamped by a PC: positions are {given / even:.2g} times smoother if rows are taken as even. "
        f"--rate {1 / mean:.3g} does so, if the controller samples at that rate."
    )
