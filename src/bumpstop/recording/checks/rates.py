"""Recorded rates beside the differences of positions: sign, scale and lag; and speeds beside the robot's limits."""

from __future__ import annotations

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.model import Robot

_WINDOW_S = 0.06  # over which differences are taken, and recorded rates are averaged
_LAG_S = 0.3  # lags that are tried
_MAX_ROWS = 40_000
_MOVES = 0.02  # root mean square speed below which nothing is compared [rad/s or m/s]
_RELATED, _ALIKE = 0.5, 0.9  # correlations: the rate of these positions or not; alike but for a factor
_SCALE = 1.2  # factor that is no noise
_MIN_LAG_S, _LAG_STEPS, _LAG_WORTH = 0.02, 1.5, 0.5  # a lag that is told: its size, and what it leaves unexplained
_FAR_TOO_FAST = 5.0  # times the speed limit
# Factors that a wrong unit makes of recorded rates: difference of positions by recorded rate.
_UNITS = (
    (np.pi / 180, 'the rates are degrees per second, or the positions radians by mistake (velocity unit = "deg/s")'),
    (180 / np.pi, 'the positions are degrees and the rates rad/s (position unit = "deg")'),
    (np.pi / 30, 'the rates are turns per minute (velocity unit = "rpm")'),
    (1e-3, 'the rates are thousandths (velocity unit = "mm/s")'),
    (1e3, 'the positions are thousandths (position unit = "mm")'),
)


def rate_faults(t: FloatArray, q: FloatArray, qd: FloatArray, names: list[str]) -> list[str]:
    """Sentences on recorded rates that are not those of the positions.

    Args:
        t: (N,) rising times [s].
        q: (N, n) positions [rad or m].
        qd: (N, n) recorded rates, of whatever unit.
        names: of the joints.
    """
    if t.size < 50:
        return []
    rows = slice(0, _MAX_ROWS) if t.size <= _MAX_ROWS else _liveliest(qd)
    t, q, qd = t[rows], q[rows], qd[rows]
    step = float(np.median(np.diff(t)))
    half = max(1, round(_WINDOW_S / step / 2))
    if t.size < 8 * half:
        return []
    width = 2 * half
    time = t[width:] - t[:-width]
    # Not across gaps.
    whole = time < 1.5 * width * step
    speed = (q[width:] - q[:-width]) / np.maximum(time, 1e-12)[:, None]
    sums = np.concatenate([np.zeros((1, q.shape[1])), np.cumsum((qd[1:] + qd[:-1]) / 2 * np.diff(t)[:, None], axis=0)])
    recorded = (sums[width:] - sums[:-width]) / np.maximum(time, 1e-12)[:, None]
    faults: list[str] = []
    scales: dict[str, float] = {}
    together: list[tuple[FloatArray, FloatArray]] = []
    for j, name in enumerate(names):
        v, r = speed[whole, j], recorded[whole, j]
        size, own = float(np.sqrt(np.mean(v**2))), float(np.sqrt(np.mean(r**2)))
        if v.size < 50 or size < _MOVES or own == 0:
            continue
        related = _related(v / size, r / own, max(1, round(_LAG_S / step)))
        # What has the opposite sign at once is not made alike by a shift of half a period.
        opposite = float(related[related.size // 2]) < -_RELATED
        best = float(related.min() if opposite else related.max())
        if opposite:
            faults.append(f"the recorded rate of {name} has the opposite sign of its positions' differences")
        elif best < _RELATED:
            faults.append(
                f"the recorded rate of {name} is not that of its positions (correlation {best:.2f}): is it the right "
                "column?"
            )
        else:
            together.append((v / size, r / own))
            if best > _ALIKE:
                scales[name] = size / own
    return faults + _lag(together, step) + _wrong_scales(scales)


def _lag(pairs: list[tuple[FloatArray, FloatArray]], step: float) -> list[str]:
    """A lag that all joints have together, as a clock or a filter makes it."""
    if not pairs:
        return []
    most = max(1, round(_LAG_S / step))
    related = np.mean([_related(v, r, most) for v, r in pairs], axis=0)
    best, middle = int(np.argmax(related)), related.size // 2
    lag = (best - middle) * step
    if abs(lag) < max(_MIN_LAG_S, _LAG_STEPS * step):
        return []
    if 1 - float(related[best]) > _LAG_WORTH * (1 - float(related[middle])):
        return []
    how = "lag behind" if lag > 0 else "run ahead of"
    return [f"the recorded rates {how} the positions by {1e3 * abs(lag):.3g} ms"]


def _wrong_scales(scales: dict[str, float]) -> list[str]:
    wrong = {name: scale for name, scale in scales.items() if not 1 / _SCALE < scale < _SCALE}
    if not wrong:
        return []
    values = np.array(list(wrong.values()))
    usual = float(np.median(values))
    which = "all moving joints" if len(wrong) == len(scales) > 1 else ", ".join(wrong)
    said = f"positions of {which} change {usual:.4g} times as fast as their recorded rates say"
    for factor, words in _UNITS:
        if (np.abs(np.log(values / factor)) < np.log(_SCALE)).all():
            return [f"{said}: {words}"]
    same = len(wrong) == len(scales) > 1 and float(np.ptp(np.log(values))) < np.log(_SCALE)
    return [
        f"{said}: " + ("does time run so much too slow or too fast?" if same and usual < 10 else "are the units right?")
    ]


def _liveliest(qd: FloatArray) -> slice:
    """Rows in one piece with the most motion: of a long recording they are enough."""
    power = np.concatenate([[0.0], np.cumsum((qd**2).sum(axis=1))])
    starts = np.arange(0, qd.shape[0] - _MAX_ROWS, _MAX_ROWS // 4)
    begin = int(starts[np.argmax(power[starts + _MAX_ROWS] - power[starts])])
    return slice(begin, begin + _MAX_ROWS)


def _related(v: FloatArray, r: FloatArray, most: int) -> FloatArray:
    """Correlation of ``v`` with ``r`` so many rows later, from -most to most, each over the rows that both have."""
    most = min(most, v.size // 4)
    count = 1 << (v.size + most).bit_length()
    both = np.fft.irfft(np.conj(np.fft.rfft(v, count)) * np.fft.rfft(r, count), count)
    lags = np.arange(-most, most + 1)
    power_v, power_r = (np.concatenate([[0.0], np.cumsum(x**2)]) for x in (v, r))
    n = v.size
    later, earlier = np.maximum(lags, 0), np.maximum(-lags, 0)
    own = (power_v[n - later] - power_v[earlier]) * (power_r[n - earlier] - power_r[later])
    related: FloatArray = both[lags] / np.sqrt(np.maximum(own, 1e-300))
    return related


def rates_unit(qd: FloatArray, robot: Robot) -> str:
    """The unit that recorded rates (N, n) seem to have, by the robot's limits; empty: nothing speaks against SI."""
    few = np.abs(qd[:: max(1, qd.shape[0] // 20_000)])
    few = few[np.isfinite(few).all(axis=1)]
    if few.shape[0] < 20:
        return ""
    share = np.quantile(few, 0.9, axis=0) / robot.velocity
    units = (("revolute", "deg/s", np.pi / 180), ("revolute", "rpm", np.pi / 30), ("prismatic", "mm/s", 1e-3))
    for kind, unit, factor in units:
        own = np.array([joint.kind == kind for joint in robot.joints])
        if (own & (share > _FAR_TOO_FAST)).any() and (share[own] * factor < 1).all():
            return unit
    return ""


def too_fast(t: FloatArray, q: FloatArray, robot: Robot) -> FloatArray:
    """(n,) speed that a tenth of the rows exceed, as a multiple of each joint's limit."""
    rows = np.arange(0, t.size - 1, max(1, t.size // 20_000))
    steps = t[rows + 1] - t[rows]
    good = np.isfinite(steps) & (steps > 0)
    usual = float(np.median(steps[good])) if good.any() else np.inf
    with np.errstate(all="ignore"):  # garbage is still in there
        speed = np.abs(q[rows + 1] - q[rows]) / np.maximum(steps, usual)[:, None]
    speed = speed[good & np.isfinite(speed).all(axis=1)]
    if speed.shape[0] < 20:
        return np.zeros(q.shape[1])
    share: FloatArray = np.quantile(speed, 0.9, axis=0) / robot.velocity
    return share
