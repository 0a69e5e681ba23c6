"""Quantities that look like those of another unit."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.model import Robot
from bumpstop.recording.checks.rates import too_fast
from bumpstop.recording.checks.stamps import in_bursts, mean_period, uneven_stamps

IMPOSSIBLE = 1e6  # where no limit is known
TIMES_LIMITS = 10.0
_ENOUGH = 20_000  # rows that show a unit
_TOO_FAST = 3.0  # times the speed limit: what a tenth of the rows exceed are other units
_MAX_PERIOD_S = 0.9  # [s] between rows; controllers report more often
_MIN_PERIOD_S = 5e-5  # [s]; and less often
_MAX_CURRENT = 200.0  # [A]; drives of arms take less
_MANY_TURNS = 20.0  # [rad]; few arms turn a joint so far
# By the kind of joint: a unit that others use, in SI, the unit of SI, and what one is taken for the other.
_TAKEN_FOR_SI = {
    "revolute": ("deg", np.pi / 180, "rad", "degrees taken for radians"),
    "prismatic": ("mm", 1e-3, "m", "millimetres taken for metres"),
}


def suspect_units(q: FloatArray, robot: Robot | None, path: Path) -> list[str]:
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
        if q.shape[0] and own.any() and np.mean(usual[:, own] > TIMES_LIMITS * bound) > 0.5:
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


def reject_units(t: FloatArray, q: FloatArray, robot: Robot, path: Path) -> None:
    """Positions within the limits whose speeds are not, and would be with other times, in degrees or millimetres."""
    share = too_fast(t, q, robot)
    if not (share > _TOO_FAST).any():
        return
    # Times come first: of positions that nothing is wrong with, uneven stamps make any speed.
    known = np.isfinite(t)
    if in_bursts(t[known]):
        even = np.arange(np.count_nonzero(known), dtype=np.float64) * mean_period(t[known])
        share = too_fast(even, q[known], robot)
        if not (share > _TOO_FAST).any():
            raise uneven_stamps(t[known], str(path))
    hint = short_period(t)
    if hint:
        j = int(np.argmax(share))
        problem = f"joint {j + 1} moves at {share[j]:.3g} times its speed limit or more in a tenth of the rows"
        raise InputError(str(path), problem, hint)
    for kind, (unit, factor, si, words) in _TAKEN_FOR_SI.items():
        own = np.array([joint.kind == kind for joint in robot.joints])
        fast = own & (share > _TOO_FAST)
        if fast.any() and (share[own] * factor < 1.0).all():
            j = int(np.argmax(np.where(fast, share, 0.0)))
            moves = "turns" if kind == "revolute" else "slides"
            problem = (
                f"joint {j + 1} {moves} at {share[j]:.3g} times its speed limit or more in a tenth of the rows: "
                f"positions look like {words}"
            )
            raise InputError(str(path), problem, f'position = {{ ..., unit = "{unit}" }} in the column file, not {si}')


def short_period(t: FloatArray) -> str:
    """What to say of times (N,) [s] that follow each other faster than controllers report; empty: they do not."""
    t = t[np.isfinite(t)]
    # Of all rows of a burst together: a PC writes them down at once, whatever they are apart.
    step = mean_period(t) if t.size > 1 else _MIN_PERIOD_S
    if not 0 < step < _MIN_PERIOD_S:
        return ""
    return (
        f"rows are {step:.3g} s apart, and no controller reports at {1e-3 / step:.4g} kHz: are the times seconds, "
        'taken for milliseconds (time = { ..., unit = "s" })?'
    )


def suspect_time(values: dict[str, FloatArray]) -> list[str]:
    """Suspect milliseconds for seconds and seconds for milliseconds."""
    short = short_period(values["t"][:, 0])
    notes = [f"{short[0].upper()}{short[1:]}"] if short else []
    step = float(np.median(np.diff(values["t"][:, 0])))
    if step > _MAX_PERIOD_S:
        units = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
        unit = next((name for name, size in units.items() if size * step <= _MAX_PERIOD_S), "ns")
        notes.append(
            f"Rows are {step:.4g} s apart: if these are no seconds, say so in a column file "
            f'(time = {{ ..., unit = "{unit}" }}).'
        )
    return notes


def suspect_current(values: dict[str, FloatArray]) -> list[str]:
    """Suspect milliamperes for amperes."""
    notes = []
    if "current" in values:
        largest = float(np.quantile(np.abs(values["current"][:: max(1, values["t"].size // _ENOUGH)]), 0.99))
        if largest > _MAX_CURRENT:
            notes.append(
                f"Currents reach {largest:.4g} A: if they are milliamperes, say so in a column file "
                '(current = { ..., unit = "mA" }).'
            )
    return notes
