"""Channels that stand still while their joint moves: all the time, or for a while."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray

_HELD_S = 0.1  # a channel that is told stands still for so long
# It does so a few times at most, so many times as long as ever else while the joint moves.
_TIMES, _LONGER = 5, 5.0
_MIN_OTHERS = 20  # holds that show what is usual
_AROUND_S = 0.05  # to either side, over which a speed is taken
_MOVES, _TRAVELS = 0.003, 0.001  # [rad/s or m/s], [rad or m]: less is noise of an encoder
_MOVES_ALL_THE_TIME = 0.01  # [rad or m]
# Of a channel with noise so many changes turn back the one before, and its usual step is so many of its least: where
# there is no noise, or values are coarse, a current may well be the same for long.
_TURNS_BACK, _STEPS = 0.25, 2.0
_WORDS = {"current": ("current", "A"), "torque": ("torque", "")}


@dataclass(frozen=True)
class _Holds:
    """Stretches in which a value repeats, as far as the joint moves in them: first and last rows, and travel."""

    first: npt.NDArray[np.int64]
    last: npt.NDArray[np.int64]
    travel: FloatArray


def held_notes(t: FloatArray, q: FloatArray, channels: dict[str, FloatArray], names: list[str]) -> list[str]:
    """Sentences on currents and torques that are the same to the last bit while their joint moves.

    A sample that is held for several rows, and a coarse value of a slow motion, repeat too: but often, and each time
    about as long. A channel that has died for a while does so far longer than ever else, and has noise at other times.

    Args:
        t: (N,) rising times [s].
        q: (N, n) positions [rad or m].
        channels: (N, n) by quantity; others than currents and torques are left alone.
        names: of the joints.
    """
    notes = []
    for quantity, (word, unit) in _WORDS.items():
        if quantity not in channels:
            continue
        constant = []
        for j, name in enumerate(names):
            x = channels[quantity][:, j]
            if np.ptp(x) == 0:
                constant += [name] * bool(np.ptp(q[:, j]) > _MOVES_ALL_THE_TIME)
                continue
            held = _held(t, q[:, j], x)
            if held:
                first, last = max(held, key=lambda hold: t[hold[1]] - t[hold[0]])
                more = f" ({len(held)} times in all)" if len(held) > 1 else ""
                value = f"{x[first]:.4g} {unit}".rstrip()
                what = "it may be clipped" if x[first] in (x.min(), x.max()) else "nothing was measured there"
                notes.append(
                    f"The {word} of {name} stands at {value} from {t[first]:.6g} to {t[last]:.6g} s while the joint "
                    f"moves{more}: {what}."
                )
        if constant:
            notes.append(f"The {word} of {', '.join(constant)} is constant while the joint moves.")
    return notes


def _held(t: FloatArray, q: FloatArray, x: FloatArray) -> list[tuple[int, int]]:
    """First and last rows of the stretches in which a channel ``x`` (N,) stands still that is usually alive."""
    step = float(np.median(np.diff(t)))
    parted = (np.diff(x) != 0) | (np.diff(t) > 3 * step)
    edges = np.concatenate([[0], np.flatnonzero(parted) + 1, [x.size]])
    if float((t[edges[1:] - 1] - t[edges[:-1]]).max()) < _HELD_S:
        return []
    steps = np.diff(x)
    steps = steps[steps != 0]
    if steps.size < _MIN_OTHERS or np.mean(steps[1:] * steps[:-1] < 0) < _TURNS_BACK:
        return []
    if np.median(np.abs(steps)) < _STEPS * np.quantile(np.abs(steps), 0.05):
        return []
    half = max(1, round(_AROUND_S / step))
    rows = np.arange(x.size)
    before, after = np.maximum(rows - half, 0), np.minimum(rows + half, x.size - 1)
    speed = (q[after] - q[before]) / (t[after] - t[before])
    holds = _moving_holds(t, q, np.abs(speed) > _MOVES, edges)
    time = t[holds.last] - t[holds.first]
    order = np.argsort(-time, kind="stable")
    long = time[order]
    for count in range(min(_TIMES, order.size - _MIN_OTHERS), 0, -1):
        if long[count - 1] >= max(_HELD_S, _LONGER * max(long[count], step)):
            return [(int(holds.first[k]), int(holds.last[k])) for k in order[:count] if holds.travel[k] > _TRAVELS]
    return []


def _moving_holds(t: FloatArray, q: FloatArray, moves: npt.NDArray[np.bool_], edges: npt.NDArray[np.int64]) -> _Holds:
    """Every stretch between two edges from the first to the last row in which the joint moves."""
    rows, begin = np.arange(t.size), edges[:-1]
    first = np.minimum.reduceat(np.where(moves, rows, t.size), begin)
    last = np.maximum.reduceat(np.where(moves, rows, -1), begin)
    moving = last >= 0
    first, last = first[moving], last[moving]
    way = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(q)))])
    return _Holds(first, last, way[last] - way[first])
