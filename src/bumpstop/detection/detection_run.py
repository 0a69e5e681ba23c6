"""What a detector finds in a recording: alarms, residuals, and when it had no data."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.detection.events import Event
from bumpstop.detection.settings import settings_text
from bumpstop.display import EVENT, LIMIT, Displayed
from bumpstop.errors import InputError
from bumpstop.terminal import counted, table, text_of

if TYPE_CHECKING:
    from pathlib import Path

    import numpy.typing as npt
    import polars as pl
    from matplotlib.axes import Axes
    from rich.console import Console

STATES = ("no_data", "arming", "monitoring", "alarm")
"""Names of the detector's states; a state is its place here."""
FAULTS = (
    "none",
    "filling",
    "not_finite",
    "repeated",
    "out_of_order",
    "gap",
    "outside_limits",
    "impossible_jump",
    "impossible_signal",
    "frozen",
)
"""Why a tick has no data; a fault is its place here."""
NO_DATA = STATES.index("no_data")
_LINKS = ("likeliest link", "possible links")


@dataclass(frozen=True, kw_only=True, eq=False)
class DetectionRun(Displayed):
    """A detector over a recording.

    Attributes:
        t: (N,) [s].
        residual: (N, n), estimated minus predicted motor torque [Nm or N]; NaN in rows without data.
        fast: (N, n) of the band-pass channel, likewise.
        threshold: (N, n) of the residual; in rows without data that of the row before.
        state: (N,) places in ``STATES``.
        fault: (N,) places in ``FAULTS``; 0 in rows with data.
        stop: (N,) the detector asked for a stop.
        late: (N,) samples were missing before the row.
        masked_while_arming: (N,) over a threshold while arming.
        payload_changed: (N,) the payload is recognised to have changed.
        events: alarms, and what came after a pause while they stood.
        notes: what is unusual.
        settings: of the detector, by name, with the rate and the samples in its window.
        monitored: (n,) joints with a threshold; empty: not said, all.
        units: (n,) of the torques.
        force_at: where and along what the forces of events act, in words.
        found_with: robot, model and settings behind the residuals, as :func:`found_with` has them; empty: not said.
    """

    t: FloatArray
    residual: FloatArray
    fast: FloatArray
    threshold: FloatArray
    state: npt.NDArray[np.uint8]
    fault: npt.NDArray[np.uint8]
    stop: npt.NDArray[np.bool_]
    late: npt.NDArray[np.bool_]
    masked_while_arming: npt.NDArray[np.bool_]
    payload_changed: npt.NDArray[np.bool_]
    events: tuple[Event, ...]
    notes: tuple[str, ...] = ()
    settings: Mapping[str, Any] = field(default_factory=dict)
    monitored: tuple[bool, ...] = ()
    units: tuple[str, ...] = ()
    force_at: str = ""
    found_with: Mapping[str, Any] = field(default_factory=dict)

    def __str__(self) -> str:
        return text_of(self.show)

    def to_frame(self) -> pl.DataFrame:
        """Data frame with a row for each sample: ``t``, ``state``, ``residual_1`` .., ``threshold_1`` .."""
        import polars as pl

        columns: dict[str, Any] = {"t": self.t, "state": [STATES[place] for place in self.state]}
        for stem, values in (("residual", self.residual), ("threshold", self.threshold)):
            columns |= {f"{stem}_{j + 1}": values[:, j] for j in range(values.shape[1])}
        return pl.DataFrame(columns)

    def _draw(self, axes: Axes) -> None:
        """Draw each monitored joint's residual over its threshold, and the events."""
        for event in self.events:
            axes.axvspan(event.t, event.end, color=EVENT, alpha=0.3, linewidth=0)
        for j in range(self.residual.shape[1]):
            if np.isfinite(self.threshold[:, j]).any():
                axes.plot(
                    self.t, np.abs(self.residual[:, j]) / self.threshold[:, j], linewidth=0.8, label=f"joint {j + 1}"
                )
        axes.axhline(1, color=LIMIT)
        axes.set(xlabel="time, s", ylabel="residual over threshold", ylim=(0, None))
        axes.legend(fontsize="x-small", ncols=4)

    def show(self, console: Console) -> None:
        """Print what ``bumpstop detect`` prints."""
        console.print(self.conclusion)
        if self.events:
            headings = ("begin, s", "end, s", "joints", "residual", "largest", "force, N", *_LINKS)
            rows = [event.cells(self.units) for event in self.events]
            console.print(table(headings, rows, left=("joints", "residual", "largest", *_LINKS)))
            for event in self.events:
                if event.standing:
                    held = ", ".join(f"{j + 1} up to {event.hidden[j]:.3g} {self.units[j]}" for j in event.standing)
                    console.print(f"at {event.t:.4f} s joints stood still, and friction may hide of joint {held}")
            console.print(f"force {self.force_at}, of the arm on the body")
        why = ", ".join(f"{name} {rows}" for name, rows in self.no_data_rows().items())
        console.print(f"no data: {self.no_data_s:.4g} s" + (f" ({why})" if why else ""))
        console.print(f"settings: {settings_text(self.settings)}")
        if self.arming_s:
            masked = int(self.masked_while_arming.sum())
            console.print(f"arming: {self.arming_s:.4g} s; over a threshold meanwhile: {counted(masked, 'row')}")
        if self.late.any():
            console.print(f"late: {counted(int(self.late.sum()), 'row')} came after lost ones")
        if self.payload_changed.any():
            first = float(self.t[int(self.payload_changed.argmax())])
            console.print(f"payload changed: recognised from {first:.4f} s on")
        for note in self.notes:
            console.print(f"note: {note}")

    @property
    def conclusion(self) -> str:
        """One sentence: alarms, or that the detector could not have detected anything."""
        seconds, count = float(self.t[-1] - self.t[0]), len(self.events)
        alarms = f"{counted(count, 'alarm')} in {seconds:.4g} s, {counted(self.t.size, 'row')}"
        if self.inactive:
            return f"INACTIVE all the time ({self.inactive}): nothing could be detected. {alarms}"
        idle = self.no_data_s + self.arming_s
        return alarms + (f"; active for {self.monitored_s:.4g} s of them" if idle > 0.05 * seconds else "")

    @property
    def judged(self) -> npt.NDArray[np.bool_]:
        """(N,) rows in which the detector monitored: neither without data nor arming."""
        found: npt.NDArray[np.bool_] = (self.state != NO_DATA) & (self.state != STATES.index("arming"))
        return found

    @property
    def monitored_s(self) -> float:
        """How long it monitored: the intervals that end in judged rows [s]."""
        return self._seconds(self.judged)

    @property
    def inactive(self) -> str:
        """Why it cannot have detected anything in the whole recording; empty: it monitored, for a while at least."""
        if self.monitored and not any(self.monitored):
            return "no joint is monitored"
        if self.judged.any():
            return ""
        reasons = {**self.no_data_rows(), "arming": int(np.count_nonzero(self.state == STATES.index("arming")))}
        return ", ".join(f"{name} {counted(rows, 'row')}" for name, rows in reasons.items() if rows)

    @property
    def no_data(self) -> npt.NDArray[np.bool_]:
        """(N,) rows in which the detector could not tell."""
        found: npt.NDArray[np.bool_] = self.state == NO_DATA
        return found

    @property
    def no_data_s(self) -> float:
        """How long it had no data: the intervals that end in rows without data [s]."""
        return self._seconds(self.no_data)

    @property
    def arming_s(self) -> float:
        """How long it did not judge because a motion had just begun [s]."""
        return self._seconds(self.state == STATES.index("arming"))

    @property
    def _clock(self) -> FloatArray:
        """(N,) times that never fall [s]: a row with none, or with one long past, has that of the rows before."""
        known = np.where(np.isfinite(self.t), self.t, math.nan)
        rising: FloatArray = np.fmax.accumulate(known)
        first = rising[np.isfinite(rising)][:1]
        return np.where(np.isnan(rising), first if first.size else 0.0, rising)

    def _seconds(self, rows: npt.NDArray[np.bool_]) -> float:
        clock = self._clock
        return float(np.diff(clock, prepend=clock[0])[rows].sum())

    def no_data_intervals(self) -> list[tuple[float, float]]:
        """Times from and to when it had no data: from the last row that was not to the last that was [s]."""
        return self._intervals(self.no_data)

    def arming_intervals(self) -> list[tuple[float, float]]:
        """Times from and to when it was arming, likewise [s]."""
        return self._intervals(self.state == STATES.index("arming"))

    def _intervals(self, rows: npt.NDArray[np.bool_]) -> list[tuple[float, float]]:
        clock = self._clock
        edges = np.flatnonzero(np.diff(np.concatenate([[False], rows, [False]]).astype(np.int8)))
        return [
            (float(clock[max(0, first - 1)]), float(clock[end - 1]))
            for first, end in zip(edges[::2], edges[1::2], strict=True)
        ]

    def no_data_rows(self) -> dict[str, int]:
        """Rows without data by fault."""
        return {name: int(n) for k, name in enumerate(FAULTS) if k and (n := np.count_nonzero(self.fault == k))}

    def to_json(self) -> dict[str, Any]:
        """For programs."""
        return {
            "active": not self.inactive,
            "events": [event.to_json() for event in self.events],
            "start_s": float(self._clock[0]),
            "end_s": float(self._clock[-1]),
            "monitored_s": self.monitored_s,
            "no_data": [list(interval) for interval in self.no_data_intervals()],
            "no_data_s": self.no_data_s,
            "no_data_rows": self.no_data_rows(),
            "arming": [list(interval) for interval in self.arming_intervals()],
            "arming_s": self.arming_s,
            "late_rows": int(self.late.sum()),
            "masked_rows": int(self.masked_while_arming.sum()),
            "rows": int(self.t.size),
            "settings": dict(self.settings),
            "notes": list(self.notes),
        }

    def save_residuals(self, path: str | Path) -> None:
        """Write ``t, residual_1 .. residual_n`` as Parquet, rows without data left out.

        Raises:
            InputError: the file cannot be written.
        """
        from bumpstop.detection.tuning.residual_record import write_residuals

        seen = ~self.no_data
        if not seen.any():
            raise InputError("residuals", "the detector had no data all the time", "nothing is left to write")
        write_residuals(path, self.t[seen], self.residual[seen], self.found_with)


def frozen_notes(t: FloatArray, frozen: npt.NDArray[np.bool_]) -> list[str]:
    """A sentence on rows (N,) in which feedback was frozen, if there are any."""
    if not frozen.any():
        return []
    first, rows = float(t[int(frozen.argmax())]), int(np.count_nonzero(frozen))
    return [
        f"Frozen feedback in {counted(rows, 'row')}, the first at {first:.4f} s: time goes on, but positions and "
        "signals of all joints are those of the row before. Nothing can be detected there. A simulated arm without "
        "noise does the same at rest: frozen_s = inf permits it."
    ]
