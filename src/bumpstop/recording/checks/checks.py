"""Which rows of a recording are valid."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.model import Robot
from bumpstop.recording.checks.held import held_notes
from bumpstop.recording.checks.jumps import impossible_rows, spikes, turns, usual_speed
from bumpstop.recording.checks.rates import rate_faults, rates_unit
from bumpstop.recording.checks.time_order import disorder
from bumpstop.recording.checks.torque_units import torque_faults
from bumpstop.recording.checks.units import (
    IMPOSSIBLE,
    TIMES_LIMITS,
    reject_units,
    short_period,
    suspect_current,
    suspect_time,
    suspect_units,
)
from bumpstop.recording.formats.table import RawRecording
from bumpstop.recording.read_report import ReadReport
from bumpstop.terminal import counted
from bumpstop.text_files import other_robot

_LATEST = 1e12  # [s]; no clock of a controller counts so far
_LISTED = 20
_GAP = 3.0  # median intervals
_MIN_ROWS_TO_JUDGE = 20  # rows
_MOVES = 0.05  # [rad/s or m/s]
_FAR_FROM_ZERO = 0.3  # of the usual size of a column
_COARSE = 0.2  # share of rows with the time of another
NAMES = {
    "position": "q",
    "reference": "q_ref",
    "velocity": "qd",
    "current": "current",
    "torque": "tau",
    "wrench": "wrench",
}
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
    notes = list(raw.notes) + suspect_units(values["position"], robot, path)
    if robot is not None:
        reject_units(t, values["position"], robot, path)
        unit = rates_unit(values["velocity"], robot) if "velocity" in values else ""
        if unit:
            problem = f"recorded rates are far beyond the limits of {robot.name}: they look like {unit} taken for SI"
            raise InputError(str(path), problem, f'velocity = {{ ..., unit = "{unit}" }} in the column file')
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
    doubled, backwards = disorder(t[place])
    for reason, wrong_rows in (("doubled time", doubled), ("time runs backwards", backwards)):
        good[place[wrong_rows]] = False
        reasons += [(int(raw.rows[i]), reason, f"t = {t[i]:.9g} s") for i in place[wrong_rows]]
    values, notes_of_rows, faults, repaired = _implausible(values, raw.rows, good, reasons, robot)
    notes += notes_of_rows
    _refuse(reasons, raw, int(good.sum()), max_bad, path)
    kept = values if good.all() else {name: value[good] for name, value in values.items()}
    names = list(raw.joint_names or (f"joint {j + 1}" for j in range(kept["position"].shape[1])))
    if "velocity" in kept:
        faults += rate_faults(kept["t"][:, 0], kept["position"], kept["velocity"], names)
    if robot is not None and "torque" in kept:
        faults += torque_faults(kept["position"], kept["torque"], robot)
    notes += held_notes(kept["t"][:, 0], kept["position"], kept, names)
    counts: dict[str, int] = {}
    for _, reason, _ in reasons:
        counts[reason] = counts.get(reason, 0) + 1
    doubts = suspect_time(kept)
    report = ReadReport(
        rows_read=raw.rows_read,
        dropped=_as_list(reasons),
        counts=counts,
        gaps=gaps_of(kept["t"][:, 0]),
        notes=(*notes, *doubts, *suspect_current(kept)),
        time_doubts=tuple(doubts),
        numbered=raw.numbered,
        faults=tuple(faults),
        base_motion=raw.base_motion,
        repaired=repaired,
        other_joints=raw.other_joints,
        other_robot=raw.robot if robot is not None and other_robot(raw.robot, robot.name) else "",
    )
    return kept, report


def _implausible(
    values: dict[str, FloatArray],
    rows: npt.NDArray[np.int64],
    good: Mask,
    reasons: list[tuple[int, str, str]],
    robot: Robot | None,
) -> tuple[dict[str, FloatArray], list[str], list[str], int]:
    """Rows that no arm can have been in, and angles that wrap; ``good`` and ``reasons`` are added to.

    Returns:
        The quantities with angles unwrapped, notes, faults, and the number of rows whose angles were turned back.
    """
    place = np.flatnonzero(good)
    if place.size < _MIN_ROWS_TO_JUDGE:
        return values, [], [], 0
    # Mostly all of them: views, not copies.
    t, q = (values["t"][:, 0], values["position"]) if good.all() else (values["t"][place, 0], values["position"][place])
    turning = [robot is None or robot.joints[j].kind == "revolute" for j in range(q.shape[1])]
    revolute = np.array(turning, dtype=bool)
    speed = usual_speed(t, q, robot)
    bad, jumps = impossible_rows(t, q, speed, revolute)
    faults = [
        f"the positions jump at {t[i]:.6g} s, faster than the joints turn, and stay there: cut the recording there"
        for i in np.flatnonzero(jumps)[:3]
    ]
    zero: Mask = np.all(q == 0, axis=1)
    for i in np.flatnonzero(bad):
        what = "row of zeros" if zero[i] else "jump"
        j = int(np.argmax(np.abs(q[int(i)] - q[max(int(i) - 1, 0)])))
        reasons.append((int(rows[place[i]]), what, "" if zero[i] else f"q_{j + 1} = {q[int(i), j]:.6g}"))
    good[place[bad]] = False
    _zeros(values, rows, good, reasons)
    if good.sum() < 2:
        return values, [], faults, 0
    for name in ("velocity", "current", "torque"):
        if name in values:
            place = np.flatnonzero(good)
            own = values[name] if good.all() else values[name][place]
            _mark_at(reasons, good, place, spikes(own), name, values[name], rows)
    if good.sum() < 2:
        return values, [], faults, 0
    place = np.flatnonzero(good)
    t, q = (values["t"][:, 0], values["position"]) if good.all() else (values["t"][place, 0], values["position"][place])
    count = turns(t, q, speed, revolute)
    if not count.any():
        return values, [], faults, 0
    back = np.concatenate([np.zeros((1, q.shape[1])), np.cumsum(count, axis=0)])
    position = values["position"].copy()
    position[place] -= 2 * np.pi * back
    joints = ", ".join(str(j + 1) for j in np.flatnonzero(count.any(axis=0)))
    turned = int(back.any(axis=1).sum())
    wraps = int(np.abs(count).sum())
    how = f"{counted(turned, 'row', 'was')} turned back by whole turns"
    note = f"Angles of joint {joints} wrap {counted(wraps, 'time')}; {how}."
    changed = {"position": position}
    if "reference" in values:
        # Taken along by whole turns, to the one next to where the joint is.
        apart = values["reference"] - position
        whole = np.where(revolute & np.isfinite(apart), np.round(apart / (2 * np.pi)), 0.0)
        changed["reference"] = values["reference"] - 2 * np.pi * whole
    return values | changed, [note], faults, turned


def _zeros(
    values: dict[str, FloatArray], rows: npt.NDArray[np.int64], good: Mask, reasons: list[tuple[int, str, str]]
) -> None:
    """Rows in which every rate, current or torque is exactly zero while the arm moves."""
    if values["position"].shape[1] < 2 or good.sum() < _MIN_ROWS_TO_JUDGE:
        return
    fastest = None
    for name in ("velocity", "current", "torque"):
        if name not in values:
            continue
        # The first column alone says for most rows that they are none.
        if not (values[name][:, 0] == 0).any():
            continue
        place = np.flatnonzero(good)
        zero: Mask = np.all(values[name][place] == 0, axis=1)
        if not zero.any():
            continue
        if fastest is None or fastest.size != place.size:
            t, q = values["t"][place, 0], values["position"][place]
            fastest = np.abs(np.gradient(q, t, axis=0)).max(axis=1)
        wrong = place[zero & (fastest > _MOVES) & _cut_off(values[name][place], zero)]
        good[wrong] = False
        reasons += [(int(rows[i]), "row of zeros", f"all {NAMES[name]} while the arm moves") for i in wrong]


def _cut_off(x: FloatArray, zero: Mask) -> Mask:
    """Rows of zeros (N,) whose next other rows are far from zero on both sides: a column may well pass through it."""
    usual = np.sqrt((x[~zero] ** 2).mean(axis=0)) if not zero.all() else np.ones(x.shape[1])
    far: Mask = np.any(np.abs(x) > _FAR_FROM_ZERO * np.where(usual > 0, usual, np.inf), axis=1)
    other = np.flatnonzero(~zero)
    if not other.size:
        return np.ones(zero.size, dtype=bool)
    at = np.searchsorted(other, np.arange(zero.size))
    before, after = other[np.maximum(at - 1, 0)], other[np.minimum(at, other.size - 1)]
    return np.asarray(zero & (far[before] | (at == 0)) & (far[after] | (at == other.size)))


def _mark_at(
    reasons: list[tuple[int, str, str]],
    good: Mask,
    place: npt.NDArray[np.int64],
    wrong: Mask,
    name: str,
    value: FloatArray,
    rows: npt.NDArray[np.int64],
) -> None:
    for i in np.flatnonzero(wrong.any(axis=1)):
        column = int(np.argmax(wrong[i]))
        row = place[i]
        reasons.append((int(rows[row]), "spike", f"{NAMES[name]}_{column + 1} = {value[row, column]:.6g}"))
        good[row] = False


def gaps_of(t: FloatArray) -> tuple[tuple[float, float], ...]:
    """Start and length [s] of the intervals longer than three times the median one; ``t`` is (N,) [s]."""
    steps = np.diff(t)
    found = np.flatnonzero(steps > _GAP * np.median(steps))
    return tuple((float(t[i]), float(steps[i])) for i in found)


def _parted(why: str) -> tuple[str, str]:
    reason, _, what = why.partition(": ")
    return reason, what


def _as_list(reasons: list[tuple[int, str, str]]) -> tuple[tuple[int, str], ...]:
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
    if robot is not None and name in ("position", "reference"):
        limit = np.minimum(limit, TIMES_LIMITS * np.maximum(np.abs(robot.lower), np.abs(robot.upper)))
    elif robot is not None and name == "velocity":
        limit = np.minimum(limit, TIMES_LIMITS * robot.velocity)
    return limit


def _refuse(reasons: list[tuple[int, str, str]], raw: RawRecording, good: int, max_bad: float, path: Path) -> None:
    doubled = sum(reason == "doubled time" for _, reason, _ in reasons)
    if doubled > _COARSE * raw.rows_read:
        problem = (
            f"{doubled} of {raw.rows_read} rows have the time of another: the clock is too coarse, or rows are doubled"
        )
        raise InputError(str(path), problem, "write time with more digits, or give rate_hz in place of its column")
    if reasons and len(reasons) > max_bad * raw.rows_read:
        short = short_period(raw.values["t"][:, 0])
        share = len(reasons) / raw.rows_read
        first = "; ".join(f"{raw.numbered} {row} ({why})" for row, why in _as_list(reasons)[:3])
        problem = f"{len(reasons)} of {raw.rows_read} rows are bad ({100 * share:.3g} %): {first}"
        # Stamps of a busy PC fall on one another: the rows are good, and their rate is known.
        even = ""
        if doubled > len(reasons) / 2:
            even = (
                "; rows sampled evenly need no stamps: give their rate (--rate of tune, detect and score, or time = "
                "{ rate_hz = ... } in a column file)"
            )
        raise InputError(
            str(path), problem, f"at most {100 * max_bad:g} % may be (--max-bad){even}{'; ' + short if short else ''}"
        )
    if good < 2:
        raise InputError(str(path), f"has {good} usable rows", "wanted at least 2")
