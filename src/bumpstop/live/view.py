"""The monitor on a terminal: a table that stays, or a plain line a second where it is none."""

from __future__ import annotations

import math
import time
from typing import TYPE_CHECKING, Any, Self

from bumpstop.live.output import CollisionAlarm, MonitorTick
from bumpstop.live.outputs.background import BackgroundOutput
from bumpstop.live.unbuffered_text import UnbufferedText, warn
from bumpstop.terminal import counted, table

if TYPE_CHECKING:
    from collections.abc import Sequence
    from types import TracebackType

    from rich.console import Console, RenderableType

    from bumpstop.live.loaded_detector import LoadedDetector
    from bumpstop.live.monitor import Monitor
    from bumpstop.live.output import DataLoss
    from bumpstop.live.outputs.background import Told

_LINE_S = 1.0
_DRAW_S = 0.25
_BAR = 20
_WORST = "worst joint"


class MonitorView(BackgroundOutput):
    """What a person sees; an output of the monitor. Alarms and events of the source stay above the table.

    It prints in a thread: a terminal that is stopped, or a pipe that nobody reads, holds up no sample.

    Args:
        detector: of the monitor.
        console: to write on.
        source: its name.
    """

    what = "standard output"
    max_waiting, max_ending_s = 1000, 1.0

    def __init__(self, detector: LoadedDetector, console: Console, source: str) -> None:
        super().__init__()
        self._detector, self._console, self._source = detector, console, source
        self._monitor: Monitor | None = None
        self._next_line = self._next_rate = time.monotonic() + _LINE_S
        self._next_draw = 0.0
        self._before: tuple[float, int] | None = None
        self._rate = math.nan
        self._live: Any = None
        self._conclusion: tuple[str, ...] = ()

    def every(self, monitor: Monitor) -> None:
        """About ten times a second: remember whom to show, and count its samples."""
        self._monitor = monitor
        now = time.monotonic()
        if now < self._next_rate:
            return
        self._next_rate = now + _LINE_S
        if self._before is not None:
            since, count = self._before
            self._rate = (monitor.samples - count) / (now - since)
        self._before = now, monitor.samples

    def line(self) -> str:
        """State, rate, age of the last sample, worst joint and alarms, on one line."""
        monitor = self._monitor
        assert monitor is not None
        worst = "no data" if self._last is None else f"no data ({self._last.fault})"
        tick = self._judged()
        if tick is not None:
            share = _shares(tick)
            j = max(range(len(share)), key=lambda k: share[k])
            worst = f"{_WORST} {self._detector.joints[j]} at {100 * share[j]:.0f} % of its threshold"
        age = monitor.age_s()
        told = "no sample yet" if math.isnan(age) else f"last sample {1e3 * age:.0f} ms ago"
        rate = "" if math.isnan(self._rate) else f"{self._rate:.0f} samples/s, "
        return f"{monitor.state.upper()}: {rate}{told}, {worst}, {counted(monitor.alarms, 'alarm')}"

    def _judged(self) -> MonitorTick | None:
        """The last tick, if there are data now."""
        told = self._last
        return told if isinstance(told, MonitorTick) and told.state != "no_data" else None

    def __rich__(self) -> RenderableType:
        """The table."""
        from rich.console import Group

        monitor, tick = self._monitor, self._judged()
        if monitor is None:
            return f"waiting for {self._source}"
        rows = []
        share = [] if tick is None else _shares(tick)
        for j, name in enumerate(self._detector.joints):
            if tick is None:
                rows.append((name, "-", "-", "-", ""))
                continue
            bar = "#" * min(_BAR, round(_BAR * share[j]))
            limit = tick.threshold[j]
            otherwise = "band-pass alone" if self._detector.monitored[j] else "not monitored"
            threshold = f"{limit:.3g}" if math.isfinite(limit) else otherwise
            unit = self._detector.units[j]
            rows.append((name, f"{tick.residual[j]:+.3g} {unit}", threshold, f"{100 * share[j]:.0f} %", bar))
        columns = ("joint", "residual", "threshold", "share", "")
        return Group(self.line(), table(columns, rows, ("joint", "")))

    def _say(self, text: str) -> None:
        shown = "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)
        if self._live is not None:
            self._live.console.print(shown, markup=False, highlight=False)
        else:
            self._console.print(shown, markup=False, highlight=False)
        self._check()

    def _check(self) -> None:
        """What was printed is written."""
        if isinstance(self._console.file, UnbufferedText):
            self._console.file.check()
        self.wrote = True

    def tick(self, tick: MonitorTick) -> None:
        """The last one is shown."""
        self._last = tick

    def data_loss(self, loss: DataLoss) -> None:
        """Shown instead of the last."""
        self._last = loss

    def flush(self, now_s: float) -> None:
        """Nothing to do: the thread shows the state by itself."""

    def problems(self) -> list[str]:
        """What has failed since the last call; said on standard error, too, as nobody may see the rest."""
        found = super().problems()
        for problem in found:
            warn(problem)
        return found

    def write(self, batch: Sequence[Told]) -> None:
        """Alarms and events of the source, and what is due of the state."""
        self.pending = len(batch)
        for told in batch:
            if isinstance(told, CollisionAlarm):
                self._say(alarm_line(told, self._detector))
            elif isinstance(told, tuple):
                event, _ = told
                many = f" ({event.count} times)" if event.count > 1 else ""
                self._say(f"source {event.kind}: {event.text}{many}")
            self.pending -= 1
        self._show_state(time.monotonic())

    def _show_state(self, now: float) -> None:
        if self._ending.is_set():
            return
        if self._live is not None and now >= self._next_draw:
            self._next_draw = now + _DRAW_S
            self._live.start()
            self._live.refresh()
            self._check()
        if self._live is None and self._monitor is not None and now >= self._next_line:
            self._next_line = now + _LINE_S
            self._say(self.line())

    def finish(self) -> None:
        """Take the table away and print the last lines."""
        if self._live is not None:
            self._live.stop()
            self._live = None
            self._check()
        for line in self._conclusion:
            self._say(line)

    def conclude(self, lines: Sequence[str]) -> None:
        """Print what waits and these last lines, and end."""
        self._conclusion = tuple(lines)
        self.close()

    def __enter__(self) -> Self:
        """Begin to print, and on a terminal to draw."""
        if self._console.is_terminal:
            from rich.live import Live

            # Nothing else may print through it: that would wait for the terminal.
            self._live = Live(
                self,
                console=self._console,
                auto_refresh=False,
                transient=True,
                redirect_stdout=False,
                redirect_stderr=False,
            )
        self.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        """End."""
        self.close()


def _shares(tick: MonitorTick) -> list[float]:
    """Residuals in units of their thresholds."""
    pairs = zip(tick.residual.tolist(), tick.threshold.tolist(), strict=True)
    return [abs(r) / t for r, t in pairs]


def _over(alarm: CollisionAlarm, j: int, unit: str) -> str:
    """By how much a joint is over: its residual, the band-pass channel of that, or both."""
    event, found = alarm.event, []
    if j in event.joints:
        found.append(f"{event.residual[j]:+.3g} of {event.threshold[j]:.3g} {unit}")
    if j in event.fast_joints:
        limit = alarm.fast_threshold[j]
        of = f" of {limit:.3g}" if math.isfinite(limit) else ""
        found.append(f"{alarm.fast[j]:+.3g}{of} {unit} in the band-pass channel")
    return " and ".join(found)


def alarm_line(alarm: CollisionAlarm, detector: LoadedDetector) -> str:
    """An alarm in one sentence: time, joints with their residuals, force and link."""
    event = alarm.event
    joints = sorted({*event.joints, *event.fast_joints})
    names = ", ".join(f"{detector.joints[j]} {_over(alarm, j, detector.units[j])}" for j in joints)
    along = " ".join(f"{x:.4g}" for x in detector.direction)
    if math.isfinite(event.force_along_sd):
        force = f"{event.force_along:.3g} +- {2 * event.force_along_sd:.2g} N at {detector.force_at} along {along}"
    else:
        force = f"no joint shows a force along {along}"
    link = f", likeliest link {event.link}" if event.link else ""
    kilograms = event.payload_change_kg
    load = "" if kilograms is None else f", explained by a payload of {kilograms:+.3g} kg that nobody declared"
    return (
        f"COLLISION {alarm.number} at {alarm.stamp_s:.4f} s: {names}; {force}{link}{load}; "
        f"{1e3 * alarm.latency_s:.2f} ms after the sample came"
    )
