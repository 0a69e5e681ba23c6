"""A motion in time, to be played: a trajectory with its safe speeds, or a recording with its residuals."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.detection.detection_run import STATES
from bumpstop.report.colours import EVENT, LAW
from bumpstop.report.markup import Html
from bumpstop.terminal import number
from bumpstop.view.plots.chart import Chart
from bumpstop.view.study_rows import study_rows

if TYPE_CHECKING:
    from collections.abc import Callable

    from bumpstop.arrays import FloatArray
    from bumpstop.collision import Scenario
    from bumpstop.model import Robot
    from bumpstop.view.opened import Recorded

# Points of a way, and of a chart, that are worth drawing.
_MAX_PLACES, _MAX_CHART = 4000, 600


@dataclass(frozen=True, eq=False)
class Playback:
    """A motion in time.

    Attributes:
        time: (N,) [s].
        position: (N, dof) [rad or m].
        places: (M, 3) of the tip, evenly chosen [m].
        shown_values: (M,) by which they are coloured.
        value: (N,) what is charted; NaN where it is not known.
        limit: (N,) what it is charted against.
        value_label: name and unit of the value.
        limit_label: name of the limit.
        over: (N,) rows that are over their limit.
        worst: row in which the value is nearest its limit, or farthest over it.
        alarms: times [s].
        alarmed: (N,) rows in which an alarm stands, also of the band-pass channel; None: nothing raises any.
        unknown: what is said where the value is not known.
    """

    time: FloatArray
    position: FloatArray
    places: FloatArray
    shown_values: FloatArray
    value: FloatArray
    limit: FloatArray
    value_label: str
    limit_label: str
    over: npt.NDArray[np.bool_]
    worst: int
    alarms: tuple[float, ...] = ()
    alarmed: npt.NDArray[np.bool_] | None = None
    unknown: str = "no data"

    def pose_at(self, t: float) -> FloatArray:
        """The pose at a time, linear between rows (dof,) [rad or m]."""
        columns = range(self.position.shape[1])
        return np.array([np.interp(t, self.time, self.position[:, j]) for j in columns])

    def words_at(self, t: float) -> str:
        """What holds at a time."""
        row = int(np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, self.time.size - 1))
        if np.isnan(self.value[row]):
            return f"{t:.3f} s: {self.unknown}"
        pairs = ((self.value_label, self.value), (self.limit_label, self.limit))
        said = ", ".join(_figure(label, float(value[row])) for label, value in pairs)
        standing = ", an alarm stands" if self.alarmed is not None and self.alarmed[row] else ""
        if not self.over[row]:
            return f"{t:.3f} s: {said}: within{standing}"
        # A study looks as far ahead as a collision that begins here can go.
        ahead = "" if self.value[row] > self.limit[row] else ", a collision that begins here gets faster"
        return f"{t:.3f} s: {said}: over{ahead}{standing}"

    def chart(self, t: float) -> Html:
        """Value and limit over time, the time that is shown, and alarms."""
        kept = np.unique(np.linspace(0, self.time.size - 1, _MAX_CHART).astype(int))
        # Of the rows between two that are drawn the worst: a collision takes few of them.
        value, limit = np.fmax.reduceat(self.value, kept), np.fmin.reduceat(self.limit, kept)
        finite = limit[np.isfinite(limit)]
        top = 1.2 * max(float(np.nan_to_num(self.value).max(initial=0.0)), float(finite.min(initial=0.0)), 1e-9)
        span = (float(self.time[0]), float(self.time[-1]))
        labels = ("time [s]", self.value_label)
        chart = Chart(self.limit_label, span, (0.0, top), labels=labels, height=150, name="playback")
        known = np.isfinite(value)
        for part in np.split(np.arange(kept.size), np.flatnonzero(np.diff(known)) + 1):
            if known[part].all():
                chart.line(self.time[kept[part]], value[part], LAW)
        chart.line(self.time[kept], np.minimum(np.nan_to_num(limit, posinf=2 * top), 2 * top), "#D55E00", dash="6 3")
        for alarm in self.alarms[:_MAX_CHART]:
            chart.mark(alarm, 0.0, "", EVENT)
        chart.vertical(t, "", "#222222", dash="2 2")
        return chart.svg()


def _figure(label: str, value: float) -> str:
    """A label with its number before the unit."""
    name, _, unit = label.partition(", ")
    return f"{name} {number(value)} {unit}".rstrip()


def trajectory_playback(
    scenario: Scenario, stopped: Callable[[], bool], progress: Callable[[float], None]
) -> Playback | None:
    """The trajectory of a scenario with its safe speeds; None where nobody waits.

    Args:
        scenario: with a trajectory.
        stopped: asked between parts of the work.
        progress: told the share that is done.

    Raises:
        InputError: it cannot be computed.
    """
    from bumpstop.study import TrajectorySpeedLimits

    study = TrajectorySpeedLimits(scenario=scenario.without_uncertainty())
    rows = study_rows(study, stopped, progress)
    if rows is None:
        return None
    time, position = study.trajectory.time, study.trajectory.position
    speed, limit = rows["speed_mm_s"].to_numpy(), rows["limit_mm_s"].to_numpy()
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(speed > 0, speed / np.maximum(limit, 1e-9), 0.0)
    over = rows["over"].to_numpy()
    even = np.linspace(float(time[0]), float(time[-1]), _MAX_CHART)
    places = study.problem.robot.pose(study.given.at(even))[:, :3, 3]
    return Playback(
        time,
        position,
        places,
        np.interp(even, time, limit),
        speed,
        limit,
        "speed of the tip, mm/s",
        "safe speed, mm/s",
        over,
        int(np.where(over | ~over.any(), share, -1.0).argmax()),
    )


def recorded_playback(recorded: Recorded, robot: Robot) -> Playback:
    """A recording with its residuals, where a detector ran over it: its rows may be others than the recording's."""
    recording, run = recorded.recording, recorded.run
    t = recording.t if run is None else run.t
    q = np.column_stack([np.interp(t, recording.t, column) for column in recording.q.T])
    kept = np.unique(np.linspace(0, t.size - 1, _MAX_PLACES).astype(int))
    places = robot.pose(q[kept])[:, :3, 3]
    if run is None:
        none = np.full(t.size, np.nan)
        return Playback(
            t, q, places, t[kept], none, none + np.inf,
            "no residual", "no detector given", none > 0, 0, unknown="no detector given",
        )  # fmt: skip
    with np.errstate(invalid="ignore"):
        share = np.fmax.reduce(np.abs(run.residual) / run.threshold, axis=1)
    return Playback(
        t, q, places, np.fmax.reduceat(share, kept), share, np.ones(t.size),
        "largest residual over its threshold", "threshold", share > 1, int(np.nan_to_num(share, nan=-1.0).argmax()),
        tuple(event.t for event in run.events), run.state == STATES.index("alarm"),
    )  # fmt: skip
