"""Which rows of a recording can be believed."""

from __future__ import annotations

from bisect import bisect_left
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.model import Robot
from bumpstop.recording.read_report import ReadReport
from bumpstop.recording.table import RawRecording

IMPOSSIBLE = 1e6  # where no limit is known
_TIMES_LIMITS = 10.0
_LATEST = 1e12  # [s]; no clock of a controller counts so far
_LISTED = 20
_GAP = 3.0  # median intervals
# By the kind of joint: a unit that others use, in SI, the unit of SI, and what one is taken for the other.
_TAKEN_FOR_SI = {
    "revolute": ("deg", np.pi / 180, "rad", "degrees taken for radians"),
    "prismatic": ("mm", 1e-3, "m", "millimetres taken for metres"),
}
_ENOUGH = 20_000  # rows that show a unit
_SLOWEST = 0.9  # [s] between rows; controllers report more often
_LARGEST_CURRENT = 200.0  # [A]; drives of arms take less
_MANY_TURNS = 20.0  # [rad]; few arms turn a joint so far
NAMES = {"position": "q", "velocity": "qd", "current": "current", "torque": "tau", "wrench": "wrench"}
Mask = npt.NDArray[np.bool_]


def checked(
    raw: RawRecording, robot: Robot | None, max_bad: float, path: Path
) -> tuple[dict[str, FloatArray], ReadReport]:
    """Drop bad rows, list them, and refuse a recording with too many.

    Args:
        raw: quantities in SI on the joint side.
        robot: whose limits tell what is impossible, or None.
        max_bad: largest share of bad rows, 0 to 1.
        path: for messages.

    Returns:
        The quantities without bad rows, and the report.

    Raises:
        InputError: too many bad rows, fewer than two good ones, a time that stands still, degrees taken for radians
            or millimetres for metres.
    """
    raw = _without_empty(raw)
    values, n = raw.values, raw.rows.size
    t = values["t"][:, 0]
    finite = t[np.isfinite(t)]
    if finite.size > 1 and (finite == finite[0]).all():
        raise InputError(
            str(path), f"time stands still at {finite[0]:g} s", "wanted rising times; is it the right column?"
        )
    notes = list(raw.notes) + _wrong_unit(values["position"], robot, path)
    reasons: list[tuple[int, str, str]] = [(row, *_parted(why)) for row, why in raw.faults]
    good = np.ones(n, dtype=bool)
    for name, value in values.items():
        limit = _limit(name, robot, value.shape[1])
        # NaN passes through to both, and compares with nothing.
        if ((value.max(axis=0, initial=0.0) <= limit) & (value.min(axis=0, initial=0.0) >= -limit)).all():
            continue
        for reason, wrong in (
            ("not a number", np.isnan(value)),
            ("not finite", np.isinf(value)),
            ("impossible value", np.abs(value) > limit),
        ):
            _mark(reasons, good, reason, wrong, name, value, raw.rows)
    place = np.flatnonzero(good)
    doubled, backwards = _disorder(t[place])
    for reason, wrong_rows in (("doubled time", doubled), ("time runs backwards", backwards)):
        good[place[wrong_rows]] = False
        reasons += [(int(raw.rows[i]), reason, f"t = {t[i]:.9g} s") for i in place[wrong_rows]]
    _refuse(reasons, raw, int(good.sum()), max_bad, path)
    kept = values if good.all() else {name: value[good] for name, value in values.items()}
    counts: dict[str, int] = {}
    for _, reason, _ in reasons:
        counts[reason] = counts.get(reason, 0) + 1
    report = ReadReport(
        rows_read=raw.rows_read,
        dropped=_listed(reasons),
        counts=counts,
        gaps=gaps_of(kept["t"][:, 0]),
        notes=(*notes, *_other_units(kept)),
        numbered=raw.numbered,
    )
    return kept, report


def gaps_of(t: FloatArray) -> tuple[tuple[float, float], ...]:
    """Start and length [s] of the intervals longer than three times the median one; ``t`` is (N,) [s]."""
    steps = np.diff(t)
    found = np.flatnonzero(steps > _GAP * np.median(steps))
    return tuple((float(t[i]), float(steps[i])) for i in found)


def _parted(why: str) -> tuple[str, str]:
    reason, _, what = why.partition(": ")
    return reason, what


def _listed(reasons: list[tuple[int, str, str]]) -> tuple[tuple[int, str], ...]:
    return tuple((row, f"{reason}: {what}" if what else reason) for row, reason, what in sorted(reasons)[:_LISTED])


def _without_empty(raw: RawRecording) -> RawRecording:
    """Leave out what was never recorded: drivers fill it with NaN."""
    more = {name: x for name, x in raw.values.items() if name in NAMES and name != "position"}
    empty = [name for name, x in more.items() if np.isnan(x[:1]).all() and np.isnan(x).all()]
    if not empty:
        return raw
    notes = tuple(f"The {name} holds no number at all and is left out." for name in empty)
    values = {name: value for name, value in raw.values.items() if name not in empty}
    return replace(raw, values=values, notes=(*raw.notes, *notes))


def _mark(
    reasons: list[tuple[int, str, str]],
    good: Mask,
    reason: str,
    wrong: Mask,
    name: str,
    value: FloatArray,
    rows: npt.NDArray[np.int64],
) -> None:
    """Note rows that are wrong for the first time, with the first wrong value of each."""
    for i in np.flatnonzero(wrong.any(axis=1) & good):
        column = int(np.argmax(wrong[i]))
        label = "t" if name == "t" else f"{NAMES[name]}_{column + 1}"
        reasons.append((int(rows[i]), reason, f"{label} = {value[i, column]:.6g}"))
        good[i] = False


def _limit(name: str, robot: Robot | None, width: int) -> FloatArray:
    """(width,) magnitude above which a value is impossible."""
    limit = np.full(width, _LATEST if name == "t" else IMPOSSIBLE)
    if robot is not None and name == "position":
        limit = np.minimum(limit, _TIMES_LIMITS * np.maximum(np.abs(robot.lower), np.abs(robot.upper)))
    elif robot is not None and name == "velocity":
        limit = np.minimum(limit, _TIMES_LIMITS * robot.velocity)
    return limit


def _wrong_unit(q: FloatArray, robot: Robot | None, path: Path) -> list[str]:
    """Suspect degrees for radians, and millimetres for metres; (N, n) positions, some of which are enough."""
    q = q[:: max(1, q.shape[0] // _ENOUGH)]
    usual = np.abs(np.where(np.isfinite(q), q, 0.0))
    usual = np.where(usual > IMPOSSIBLE, 0.0, usual)
    largest = np.quantile(usual, 0.99, axis=0) if q.shape[0] else np.zeros(q.shape[1])
    if robot is None:
        if (largest > _MANY_TURNS).any() and (largest <= 720).all():
            return [
                f"Positions reach {largest.max():.4g}: if they are degrees, say so in a column file "
                '(position = { ..., unit = "deg" }).'
            ]
        return []
    notes = []
    for kind, (unit, factor, si, words) in _TAKEN_FOR_SI.items():
        own = np.array([joint.kind == kind for joint in robot.joints])
        bound = np.maximum(np.abs(robot.lower), np.abs(robot.upper))[own]
        fits = bool((largest[own] * factor <= 1.1 * bound).all())
        each = [f'"{unit if joint.kind == kind else _TAKEN_FOR_SI[joint.kind][2]}"' for joint in robot.joints]
        written = each[0] if own.all() else f"[{', '.join(each)}]"
        hint = f"position = {{ ..., unit = {written} }} in the column file"
        if q.shape[0] and own.any() and np.mean(usual[:, own] > _TIMES_LIMITS * bound) > 0.5:
            what = f"they look like {words}" if fits else "are unit and columns right?"
            problem = f"most positions are outside 10 x the limits of {robot.name}"
            raise InputError(str(path), f"{problem}: {what}", hint if fits else "")
        # A last joint that turns without end is often given the limits of the others: one joint alone is no sign.
        if fits and (largest[own] > 2 * bound).sum() > (1 if own.sum() > 1 else 0):
            would_fit = words.partition(" ")[0]
            notes.append(
                f"Positions reach {largest[own].max():.4g} {si}, far beyond the limits; {would_fit} would fit: {hint}."
            )
    return notes


def _other_units(values: dict[str, FloatArray]) -> list[str]:
    """Suspect milliseconds and milliamperes where seconds and amperes were said."""
    notes = []
    step = float(np.median(np.diff(values["t"][:, 0])))
    if step > _SLOWEST:
        notes.append(
            f"Rows are {step:.4g} s apart: if these are no seconds, say so in a column file "
            '(time = { ..., unit = "ms" }).'
        )
    if "current" in values:
        largest = float(np.quantile(np.abs(values["current"][:: max(1, values["t"].size // _ENOUGH)]), 0.99))
        if largest > _LARGEST_CURRENT:
            notes.append(
                f"Currents reach {largest:.4g} A: if they are milliamperes, say so in a column file "
                '(current = { ..., unit = "mA" }).'
            )
    return notes


def _disorder(t: FloatArray) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    """Rows that repeat an earlier time, and the fewest others without which time rises."""
    steps = np.diff(t)
    nothing = np.zeros(0, dtype=np.int64)
    if t.size < 2 or (steps > 0).all():
        return nothing, nothing
    _, first = np.unique(t, return_index=True)
    repeats = np.ones(t.size, dtype=bool)
    repeats[first] = False
    left = np.flatnonzero(~repeats)
    x = t[left]
    before = np.concatenate([[-np.inf], np.maximum.accumulate(x)[:-1]])
    after = np.concatenate([np.minimum.accumulate(x[::-1])[::-1][1:], [np.inf]])
    # In order with every other row: only what lies between two such rows is in doubt.
    doubtful = np.flatnonzero(~((x > before) & (x < after)))
    keep = np.ones(x.size, dtype=bool)
    keep[doubtful] = False
    for run in np.split(doubtful, np.flatnonzero(np.diff(doubtful) > 1) + 1):
        keep[run[_longest_rising(x[run])]] = True
    return np.flatnonzero(repeats), left[~keep]


def _longest_rising(x: FloatArray) -> list[int]:
    """Indices of a longest rising subsequence of distinct numbers."""
    tails: list[float] = []
    ends: list[int] = []
    previous: list[int] = []
    for i, value in enumerate(x.tolist()):
        k = bisect_left(tails, value)
        previous.append(ends[k - 1] if k else -1)
        if k == len(tails):
            tails.append(value)
            ends.append(i)
        else:
            tails[k], ends[k] = value, i
    chain = []
    i = ends[-1] if ends else -1
    while i >= 0:
        chain.append(i)
        i = previous[i]
    return chain[::-1]


def _refuse(reasons: list[tuple[int, str, str]], raw: RawRecording, good: int, max_bad: float, path: Path) -> None:
    if reasons and len(reasons) > max_bad * raw.rows_read:
        share = len(reasons) / raw.rows_read
        first = "; ".join(f"{raw.numbered} {row} ({why})" for row, why in _listed(reasons)[:3])
        problem = f"{len(reasons)} of {raw.rows_read} rows are bad ({100 * share:.3g} %): {first}"
        raise InputError(str(path), problem, f"at most {100 * max_bad:g} % may be (--max-bad)")
    if good < 2:
        raise InputError(str(path), f"has {good} usable rows", "wanted at least 2")
