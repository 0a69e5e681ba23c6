"""Detectors side by side: false alarms an hour against newtons at detection."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray, as_number
from bumpstop.benchmark.methods import METHODS, Method
from bumpstop.benchmark.planted import CONTACT_S, WORKS, PlantedRuns, planted_runs
from bumpstop.benchmark.signals import Signals, signals_of_motion
from bumpstop.display import Displayed
from bumpstop.errors import InputError
from bumpstop.terminal import number, table, text_of

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes
    from rich.console import Console

    from bumpstop.model import Robot

RATES = (1.0, 3.0, 10.0, 30.0, 100.0, 300.0)  # false alarms an hour
BLOCK_S = 0.5  # alarms within it count as one
_SETTLED_S = 1.0  # of a recording, left out at its beginning
_LEVEL = 0.999  # quantile of a joint's residual that its threshold stands in proportion to
_STYLES = ("-", "--", "-.", ":", "-", "--", "-.")
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#E69F00", "#CC79A7", "#222222", "#767676")


@dataclass(frozen=True, eq=False)
class OperatingPoint:
    """A method at a rate of false alarms.

    Attributes:
        method: which.
        per_hour: false alarms an hour of free motion.
        median_N, p95_N: force at detection that half and 95 of 100 contacts stay below; infinite: they go undetected.
        undetected: share of the contacts.
    """

    method: Method
    per_hour: float
    median_N: float
    p95_N: float
    undetected: float


@dataclass(frozen=True, eq=False)
class DetectorBenchmark(Displayed):
    """What the comparison found.

    Attributes:
        points: of every method at every rate.
        hours: of free motion that alarms were counted in.
        contacts: how many.
        about: the arm and where its recordings come from, in words.
    """

    points: tuple[OperatingPoint, ...]
    hours: float
    contacts: int
    about: str

    def at(self, per_hour: float) -> dict[str, OperatingPoint]:
        """Points at a rate, by name of the method."""
        return {point.method.name: point for point in self.points if point.per_hour == per_hour}

    def to_frame(self) -> pl.DataFrame:
        """Data frame with a row for every method and rate."""
        import polars as pl

        names = ("per_hour", "median_N", "p95_N", "undetected")
        rows = [{"method": p.method.name} | {name: getattr(p, name) for name in names} for p in self.points]
        return pl.DataFrame(rows)

    def to_json(self) -> dict[str, Any]:
        """The object of ``--json``; a force that is unbounded is None."""
        rows = [
            {key: None if isinstance(x, float) and not math.isfinite(x) else x for key, x in row.items()}
            for row in self.to_frame().to_dicts()
        ]
        return {"about": self.about, "hours": self.hours, "contacts": self.contacts, "points": rows}

    def __str__(self) -> str:
        return text_of(self.show)

    def show(self, console: Console) -> None:
        """Print what ``bumpstop benchmark detectors`` prints."""
        rates = sorted({point.per_hour for point in self.points})
        methods = list({point.method.name: point.method for point in self.points}.values())
        console.print(f"{self.about}: {self.contacts} contacts, {self.hours:.3g} h of free motion")
        console.print("median force at detection, N, by false alarms an hour")
        rows = []
        for method in methods:
            found = {p.per_hour: p for p in self.points if p.method is method}
            lag = "follows no ramp" if math.isnan(method.lag_s) else f"{1e3 * method.lag_s:.0f} ms"
            cells = ["undetected" if math.isinf(found[r].median_N) else number(found[r].median_N) for r in rates]
            rows.append([method.name, lag, *cells])
        console.print(table(("method", "lag", *(f"{rate:g}" for rate in rates)), rows, left=("method",)))

    def _draw(self, axes: Axes) -> None:
        """Draw a curve for each method: lower and farther left is better."""
        from bumpstop.report.picture import plain_ticks

        methods = list({point.method.name: point.method for point in self.points}.values())
        for k, method in enumerate(methods):
            points = [p for p in self.points if p.method is method and math.isfinite(p.median_N)]
            places = [p.median_N for p in points], [p.per_hour for p in points]
            axes.loglog(*places, _STYLES[k % 7], color=_COLOURS[k % 7], marker="o", markersize=3, label=method.name)
        axes.set(xlabel="median force at detection, N", ylabel="false alarms an hour")
        # Room for the legend beside the curves.
        low, high = axes.get_xlim()
        high *= (high / low) ** 0.7
        axes.set_xlim(low, high)
        forces = [lead * 10.0**power for power in range(-3, 7) for lead in (1, 2, 5)]
        plain_ticks(axes.xaxis, [force for force in forces if low <= force <= high])
        plain_ticks(axes.yaxis)
        axes.legend(fontsize="x-small", loc="center right")


def compare_detectors(
    robot: Robot,
    *,
    hours: float = 1.0,
    contacts: int = 200,
    stiffness_N_m: float = 20_000.0,
    seed: int = 0,
    methods: Sequence[Method] = METHODS,
) -> DetectorBenchmark:
    """Compare detectors on planted work of an arm.

    Args:
        robot: with inertia.
        hours: of free motion, 0.33 to 100: half of it sets the proportion of the thresholds, half of it counts alarms.
        contacts: at least so many, 10 to 100 000.
        stiffness_N_m: of the body, 100 to 1e7.
        seed: of motion and noise.
        methods: which.

    Raises:
        InputError: a value outside its range, or an arm without inertia.
    """
    for name, value, low, high in (
        ("hours", hours, 0.33, 100.0),
        ("contacts", contacts, 10, 100_000),
        ("stiffness_N_m", stiffness_N_m, 100.0, 1e7),
    ):
        if not low <= as_number(value, name) <= high:
            raise InputError(name, f"is {value}", f"wanted {low:g} to {high:g}")
    seconds = 60.0
    free = planted_runs(robot, 2 * max(WORKS, round(hours * 30)), seconds, seed=seed)
    hit = planted_runs(robot, math.ceil(contacts / 19), seconds, stiffness_N_m=stiffness_N_m, seed=seed)
    still, pushed = (signals_of_motion(robot, runs.q, runs.torque, runs.dt) for runs in (free, hit))
    return compare_signals(still, pushed, hit, methods, f"{robot.title or robot.name}, planted")


def compare_signals(
    free: Signals, hit: Signals, truth: PlantedRuns, methods: Sequence[Method], about: str
) -> DetectorBenchmark:
    """Compare detectors on given signals.

    Args:
        free: without contact, two runs at least.
        hit: with contacts.
        truth: forces and onsets of those.
        methods: which.
        about: where the signals come from, in words.
    """
    settled = round(_SETTLED_S / free.dt)
    half = free.direct.shape[0] // 2
    counted = free.direct[half:, settled:]
    hours = counted.shape[0] * counted.shape[1] * free.dt / 3600
    rates = [rate for rate in RATES if rate * hours >= 1]
    if not rates:
        raise InputError("hours", f"leave {hours:.2g} h to count alarms in", f"wanted more, for {RATES[-1]:g} an hour")
    points = []
    for method in methods:
        still, pushed = np.abs(method.residual(free)), np.abs(method.residual(hit))
        share = np.quantile(still[:half, settled:].reshape(-1, still.shape[2]), _LEVEL, axis=0)
        level = (still[half:, settled:] / share).max(axis=2)
        peaks = np.sort(_block_maxima(level, round(BLOCK_S / free.dt)))[::-1]
        for rate in rates:
            over = (pushed / share).max(axis=2) > peaks[round(rate * hours) - 1]
            forces = _forces_at_detection(over, truth)
            median, p95 = (float(np.quantile(forces, p, method="inverted_cdf")) for p in (0.5, 0.95))
            points.append(OperatingPoint(method, rate, median, p95, float(np.isinf(forces).mean())))
    return DetectorBenchmark(tuple(points), hours, len(truth.onsets), about)


def _block_maxima(level: FloatArray, rows: int) -> FloatArray:
    """Largest level of every block of so many rows."""
    blocks = level.shape[1] // rows
    maxima: FloatArray = level[:, : blocks * rows].reshape(-1, rows).max(axis=1)
    return maxima


def _forces_at_detection(over: np.ndarray[Any, np.dtype[np.bool_]], truth: PlantedRuns) -> FloatArray:
    """Force of each contact at its first row over a threshold [N]; infinite: none, or over one already at the onset."""
    found = np.full(len(truth.onsets), np.inf)
    rows = round(CONTACT_S / truth.dt)
    for number_of, (run, begin) in enumerate(truth.onsets.astype(int)):
        during = over[run, begin : begin + rows]
        # An alarm that stands already when contact begins detects nothing.
        if during.any() and not during[0]:
            found[number_of] = truth.contact_force[run, begin + int(during.argmax())]
    return found
