"""Which law of slowing down a table of stopping distances obeys, with which numbers."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray, finite_or_none
from bumpstop.collision.stopping.deceleration_laws import LAWS, DecelerationLaw
from bumpstop.collision.stopping.stopping_table import StoppingTable
from bumpstop.errors import InputError, near_matches
from bumpstop.rounding import to_decimals
from bumpstop.terminal import in_percent, number, table, text_of

if TYPE_CHECKING:
    from rich.console import Console

SCENARIO_LAWS = ("constant_time", "constant", "ramp")
"""Laws that a scenario takes by numbers."""

# A law of more numbers must be this much better than one of fewer: relative, and of the distance.
_BETTER, _MEASURABLE = 0.8, 0.002
_MAX_DEAD_TIME, _MAX_RAMP = 1.0, 2.0  # s
# Where the table has angles: a scenario takes no lengths.
_NAME_THE_TABLE = (
    'Where a scenario may be slower, name the table itself (deceleration = "table"): '
    "a joint then takes at least as long as in that row. joint_acceleration_rad_s2 stays: a scenario needs it with "
    "every deceleration."
)
_BRAKES = (
    "Stops of category 0: every joint brakes by itself, and one that stops sooner can leave the tip farther. No "
    'numbers for all joints are on the safe side of that: name the table (deceleration = "table", stop_category = 0).'
)
# Of what is written: a stop must not be shorter than the one that was found.
_DECIMALS = 4
_MAX_DECELERATION = 1e5  # as that of a scenario [rad/s2 or m/s2]


@dataclass(frozen=True, eq=False, kw_only=True)
class DecelerationFit:
    """One law fitted to a table.

    Attributes:
        law: which.
        shape: (joints, numbers of the law's shape).
        scale: (joints, combinations of payload and extension); the joint's mean where one has no row.
        errors: (rows, joints) measured over predicted distance, minus 1, the row left out of the fit; NaN: no distance,
            or no rows enough to leave one out.
    """

    law: DecelerationLaw
    shape: FloatArray
    scale: FloatArray
    errors: FloatArray

    @property
    def median_error(self) -> float:
        """Median of the absolute leave-one-out errors; infinite where there are none."""
        return float(np.nanmedian(np.abs(self.errors))) if np.isfinite(self.errors).any() else math.inf

    @property
    def worst_error(self) -> float:
        """The greatest of them."""
        return float(np.nanmax(np.abs(self.errors))) if np.isfinite(self.errors).any() else math.inf

    @property
    def score(self) -> float:
        """What laws are compared by: between the median, which outliers leave alone, and the mean square."""
        found = np.abs(self.errors[np.isfinite(self.errors)])
        return float(np.sort(found)[: max(1, math.ceil(0.8 * len(found)))].mean()) if len(found) else math.inf


@dataclass(frozen=True, eq=False, kw_only=True)
class StoppingFit:
    """What a table says of how an arm stops.

    Attributes:
        table: the distances.
        fits: by law, from the fewest numbers to the most; those that the table has rows enough for.
        law: the one it obeys, or the one that was asked for.
        notes: what to know of it.
    """

    table: StoppingTable
    fits: dict[str, DecelerationFit]
    law: str
    notes: tuple[str, ...]

    def __str__(self) -> str:
        return text_of(self.show)

    def show(self, console: Console) -> None:
        """Print what ``bumpstop stopping`` prints: the law, its errors beside others', its numbers and [reaction]."""
        console.print(f"{self.law}: {self.fits[self.law].law.formula}")
        errors = [
            (name, *(in_percent(error, 2) for error in (each.median_error, each.worst_error)))
            for name, each in self.fits.items()
        ]
        console.print(table(("law", "median error", "worst"), errors, left=("law",)))
        headings, rows = self.numbers_by_joint()
        console.print(table(headings, rows, left=("",)))
        for note in self.notes:
            console.print(f"note: {note}")
        try:
            console.print(self.reaction_toml, end="")
        except InputError as error:
            console.print(f"no [reaction]: {error}")

    def numbers_by_joint(self) -> tuple[list[str], list[tuple[str, ...]]]:
        """Headings and rows of the chosen law's numbers, joint by joint."""
        one = self.fits[self.law]
        name, unit = one.law.scale
        unit = unit.replace("rad", "m") if self.table.linear else unit
        headings = ["", f"{name}, {unit}", "least", "most"]
        headings += [f"{shape}, {shape_unit}" for shape, shape_unit in one.law.shape] + ["exponent"]
        rows = []
        for k in range(len(self.table.joints)):
            scale = one.scale[k]
            cells = [number(float(value)) for value in (np.exp(np.log(scale).mean()), scale.min(), scale.max())]
            cells += [number(float(value)) for value in one.shape[k]]
            rows.append((self.table.joint_name(k), *cells, f"{self.exponent[k]:.3f}"))
        return headings, rows

    @property
    def exponent(self) -> FloatArray:
        """(joints,) exponent of the distance over the speed: 1 in constant time, 2 with constant deceleration."""
        return self.fits["power"].shape[:, 0]

    @cached_property
    def reaction(self) -> dict[str, Any]:
        """Keys of a scenario's ``[reaction]`` that cover every row: no joint of the table stops farther.

        Joint acceleration also holds while the arm follows its path and on the way back; where the law does not say
        it, it is the deceleration of the slowest row.

        Raises:
            InputError: the distances are those of the tool centre point in mm, and the law needs angles.
        """
        table, fit = self.table, self.fits[self.law]
        if self.law == "constant_time":
            longest = self._covering(LAWS[self.law], np.zeros(0))
            slowest = float(np.nanmin(np.where(table.known, table.speed, np.nan)))
            gentle = float(f"{slowest / longest:.3g}") if not table.linear else 1.0
            return {
                "kind": "stop",
                "deceleration": "constant_time",
                "stopping_time_s": to_decimals(longest, _DECIMALS, up=True),
                "joint_acceleration_rad_s2": max(gentle, 0.1),
            }
        if table.linear:
            raise InputError(
                table.source,
                f"has lengths, and deceleration = {self.law!r} is one of joints",
                "give reach_mm with the extension, or a table of joint angles",
            )
        shape = fit.shape.max(axis=0)
        keys: dict[str, Any] = {"kind": "stop", "deceleration": self.law}
        times = {
            key: to_decimals(float(value), _DECIMALS, up=True)
            for key, value in zip(("dead_time_s", "ramp_time_s"), shape, strict=False)
        }
        least = self._covering(fit.law, np.array([*times.values()]))
        keys |= times | {"joint_acceleration_rad_s2": to_decimals(least, _DECIMALS, up=False)}
        return keys

    def _covering(self, law: DecelerationLaw, shape: FloatArray) -> float:
        """The scale with which no distance of the table is longer than the law says."""
        known = self.table.known
        scales = law.scale_of(self.table.speed[known], self.table.distance[known], shape)
        scales = scales[np.isfinite(scales)]
        # Rows that the dead time alone covers leave the scale open.
        return float(scales.min(initial=_MAX_DECELERATION) if law.errs_low else scales.max())

    @property
    def reaction_toml(self) -> str:
        """``[reaction]`` for a scenario file, with what it stands on."""
        from bumpstop.text_files import toml_value

        fit = self.fits[self.law]
        slowest = float(np.nanmin(np.where(self.table.known, self.table.speed, np.nan)))
        unit, factor = self.table.speed_unit
        said = [
            f"Stops of {self.table.source}: {fit.law.formula}",
            f"leave-one-out error of the distance: median {in_percent(fit.median_error, 2)}, "
            f"worst {in_percent(fit.worst_error, 2)}",
            f"The numbers cover every row of the table. Its slowest row is {factor * slowest:.3g} {unit}.",
            *([] if self.table.linear else [_NAME_THE_TABLE]),
            *([_BRAKES] if self.table.category == 0 and not self.table.linear else []),
        ]
        if self.law == "constant_time":
            said.append("joint_acceleration_rad_s2: while the arm follows its path, and on the way back.")
        lines = [f"# {' '.join(line.split())}" for line in said]
        return "\n".join([*lines, "[reaction]", *(f"{k} = {toml_value(v)}" for k, v in self.reaction.items())]) + "\n"

    def to_json(self) -> dict[str, Any]:
        """Everything as JSON takes it."""
        table = self.table
        try:
            reaction: dict[str, Any] | None = self.reaction
        except InputError:
            reaction = None
        names = [table.joint_name(k) for k in range(len(table.joints))]
        return {
            "source": table.source,
            "rows": len(table.row),
            "law": self.law,
            "exponent": dict(zip(names, self.exponent.tolist(), strict=True)),
            "fits": {
                name: {
                    "median_error": finite_or_none(fit.median_error),
                    "worst_error": finite_or_none(fit.worst_error),
                    "joints": {
                        joint: {"scale": float(np.exp(np.log(fit.scale[k]).mean())), "shape": fit.shape[k].tolist()}
                        for k, joint in enumerate(names)
                    },
                }
                for name, fit in self.fits.items()
            },
            "reaction": reaction,
            "notes": list(self.notes),
        }


def fit_stopping(table: StoppingTable, law: str | None = None) -> StoppingFit:
    """Fit the laws of slowing down to a table and say which one it obeys.

    Each joint has the shape of a law, and one scale for each combination of payload and extension with rows enough;
    logarithms of distances are fitted by least squares. A law is judged by the distances of rows left out of its fit,
    one after the other. Of laws that do equally well the one with the fewest numbers counts.

    Args:
        table: stopping distances.
        law: take this one (``constant_time``, ``constant``, ``ramp``); None: the one that the table obeys.

    Raises:
        InputError: no such law, or the table has too few rows for it.
    """
    if law is not None and law not in SCENARIO_LAWS:
        raise InputError("deceleration", f"{law!r} is no law", near_matches(law, SCENARIO_LAWS))
    notes = list(table.notes)
    cells = _cells(table)
    speeds = min(len(np.unique(table.speed[table.known[:, k], k].round(12))) for k in range(len(table.joints)))
    fits: dict[str, DecelerationFit] = {}
    for name, one in LAWS.items():
        # One number more than speeds would go through every row, whatever it says.
        if 1 + len(one.shape) > speeds:
            if name == law:
                wanted = f"wanted {1 + len(one.shape)} speeds of every joint"
                raise InputError("deceleration", f"{name!r} has more numbers than {table.source} has speeds", wanted)
            continue
        fits[name] = _fit(one, table, cells)
    known = {name: fits[name].score for name in SCENARIO_LAWS if name in fits}
    least = min(known.values())
    obeyed = next(name for name, score in known.items() if _BETTER * score <= least + _MEASURABLE)
    chosen = law or obeyed
    if law is not None and law != obeyed:
        notes.append(f"The table obeys {obeyed!r}; {law!r} was asked for.")
    if speeds < 3:
        notes.append("The table has two speeds: laws with dead time or ramp would go through both, whatever they are.")
    slowest = float(np.nanmin(np.where(table.known, table.speed, np.nan)))
    unit, factor = table.speed_unit
    notes.append(
        f"Below {factor * slowest:.3g} {unit}, its slowest row, the table says nothing: the law is a guess there."
    )
    if chosen in fits and fits[chosen].worst_error > 0.3:
        notes.append(f"{chosen!r} misses a row by {100 * fits[chosen].worst_error:.0f} %: look at the picture.")
    return StoppingFit(table=table, fits=fits, law=chosen, notes=tuple(notes))


def _cells(table: StoppingTable) -> np.ndarray:
    """(rows,) what has a scale of its own: payload and extension, where each has rows at two speeds for every joint."""
    cell = table.cell
    for c in np.unique(cell):
        if (table.known[cell == c].sum(axis=0) < 2).any():
            return np.zeros(len(cell), dtype=int)
    return cell


def _fit(law: DecelerationLaw, table: StoppingTable, cells: np.ndarray) -> DecelerationFit:
    joints = len(table.joints)
    shape = np.zeros((joints, len(law.shape)))
    scale = np.ones((joints, int(cells.max()) + 1))
    errors = np.full(table.distance.shape, np.nan)
    for k in range(joints):
        rows = np.flatnonzero(table.known[:, k])
        v, d, c = table.speed[rows, k], table.distance[rows, k], cells[rows]
        shape[k], scale[k] = _fit_joint(law, v, d, c, scale.shape[1])
        for i, row in enumerate(rows):
            rest = np.arange(len(rows)) != i
            # Every number needs a speed of its own.
            if len(np.unique(v[rest].round(12))) < 1 + len(law.shape):
                continue
            fitted, scales = _fit_joint(law, v[rest], d[rest], c[rest], scale.shape[1], start=shape[k])
            errors[row, k] = d[i] / law.distance(v[i : i + 1], scales[c[i : i + 1]], fitted)[0] - 1
    return DecelerationFit(law=law, shape=shape, scale=scale, errors=errors)


def _fit_joint(
    law: DecelerationLaw, v: FloatArray, d: FloatArray, cell: np.ndarray, cells: int, start: FloatArray | None = None
) -> tuple[FloatArray, FloatArray]:
    """Shape and scales by least squares of log d; a combination without rows has the geometric mean of the others."""
    present, place = np.unique(cell, return_inverse=True)
    if law.name == "constant":
        shape, scales = _fit_constant(v, d, place, len(present))
    elif not law.shape:
        logs = np.log(law.scale_of(v, d, np.zeros(0)))
        shape, scales = np.zeros(0), np.array([logs[place == i].mean() for i in range(len(present))])
    elif law.name == "power":
        shape, scales = _fit_power(v, d, place, len(present))
    else:
        shape, scales = _fit_ramp(law, v, d, place, len(present), start)
    full = np.full(cells, math.exp(scales.mean()))
    full[present] = np.exp(scales)
    return shape, full


def _fit_power(v: FloatArray, d: FloatArray, place: np.ndarray, count: int) -> tuple[FloatArray, FloatArray]:
    """A straight line of logarithms, whose height is that of the combination."""
    indicator = (place[:, None] == np.arange(count)).astype(float)
    found = np.linalg.lstsq(np.column_stack([np.log(v), indicator]), np.log(d), rcond=None)[0]
    return found[:1], found[1:]


def _fit_constant(v: FloatArray, d: FloatArray, place: np.ndarray, count: int) -> tuple[FloatArray, FloatArray]:
    """Of d = v t + v^2 b both numbers enter linearly: relative errors, least squares without negative ones."""
    from scipy.optimize import nnls

    columns = np.where(place[:, None] == np.arange(count), (v**2 / d)[:, None], 0.0)
    found = nnls(np.column_stack([v / d, columns]), np.ones(len(v)))[0]
    # What brakes at once has no finite deceleration.
    return found[:1], np.log(np.minimum(0.5 / np.maximum(found[1:], 1e-12), _MAX_DECELERATION))


def _fit_ramp(
    law: DecelerationLaw, v: FloatArray, d: FloatArray, place: np.ndarray, count: int, start: FloatArray | None
) -> tuple[FloatArray, FloatArray]:
    from scipy.optimize import least_squares

    def residual(x: FloatArray) -> FloatArray:
        return np.asarray(np.log(law.distance(v, np.exp(x[2:])[place], x[:2]) / d))

    longest = float((d / v).min())
    starts = (
        [start] if start is not None else [longest * np.array([one, two]) for one in (0.02, 0.5) for two in (0.1, 1)]
    )
    low = np.array([0.0, 0.0, *np.full(count, -12.0)])
    high = np.array([_MAX_DEAD_TIME, _MAX_RAMP, *np.full(count, math.log(_MAX_DECELERATION))])
    best: Any = None
    for shape in starts:
        guess = law.scale_of(v, d, shape)
        guess = np.log(np.where(np.isfinite(guess), guess, 50 * v.max() ** 2 / d.max()))
        scales = [guess[place == i].mean() for i in range(count)]
        x0 = np.clip([*shape, *scales], low + 1e-6, high - 1e-6)
        found = least_squares(residual, x0, bounds=(low, high), x_scale="jac", ftol=1e-6, xtol=1e-7, max_nfev=40)
        if best is None or found.cost < best.cost:
            best = found
    return np.asarray(best.x[:2]), np.asarray(best.x[2:])
