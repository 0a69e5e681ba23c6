"""The monitor: samples in, the detector's word and alarms out, and a count of everything that was not judged."""

from __future__ import annotations

import math
import time
from collections import Counter
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.detection.detection_run import FAULTS, STATES
from bumpstop.detection.events import Event
from bumpstop.live.event_limiter import EventLimiter
from bumpstop.live.lag_check import LagCheck
from bumpstop.live.latency import LatencyHistogram
from bumpstop.live.output import CollisionAlarm, DataLoss, MonitorTick
from bumpstop.live.sample import JointSample
from bumpstop.live.source import SourceEvent, SourceEventKind, stop_time
from bumpstop.live.stream_checks import StreamChecks
from bumpstop.live.summary import MonitorSummary
from bumpstop.live.unit_check import UnitCheck

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence

    from bumpstop import _native
    from bumpstop.arrays import FloatArray
    from bumpstop.live.loaded_detector import LoadedDetector
    from bumpstop.live.output import Output
    from bumpstop.live.source import Source

# Kinds that say nothing bad of a source.
_USUAL = (SourceEventKind.STARTED, SourceEventKind.ENDED)
_NO_DATA, _ARMING, _ALARM = (STATES.index(name) for name in ("no_data", "arming", "alarm"))
_FLUSH_S = 0.1
_LONGEST_READ_S = 0.05
_FIRST_S = 1.0


@dataclass(frozen=True, kw_only=True)
class MonitorSettings:
    """How a monitor runs.

    Attributes:
        duration_s: end after so long [s]; infinite: when the source or somebody ends it.
        stop_after_s: without a sample for longer the source has stopped [s]; None: ten periods of the detector at
            ``speed``, at least 0.1 s, and 1 s before the first.
        rearm_s: an alarm is taken as dealt with once everything was below its thresholds for so long [s]; infinite:
            the first alarm stands. No silence, gap or new connection ends an alarm: the time counts anew behind it.
        speed: seconds of the source in a second of our clock; infinite: its samples are read as fast as they can be.
    """

    duration_s: float = math.inf
    stop_after_s: float | None = None
    rearm_s: float = 0.5
    speed: float = 1.0


class Monitor:
    """Judges the samples of a source.

    Where there is no sample, or one that cannot be judged, the state is ``"no_data"`` and the arm must stop, as in a
    control loop; behind a silence, a restart or a flood the detector arms itself as it does at its beginning.

    Args:
        detector: of the arm.
        source: of its samples, open.
        outputs: what is told of everything, in this order.
        settings: how it runs.
    """

    def __init__(
        self,
        detector: LoadedDetector,
        source: Source,
        outputs: Sequence[Output] = (),
        settings: MonitorSettings | None = None,
    ) -> None:
        self.detector, self._source, self._outputs = detector, source, tuple(outputs)
        self._settings = settings or MonitorSettings()
        self._kernel = detector.kernel(latched=math.isinf(self._settings.rearm_s))
        self._checks = StreamChecks(detector, paced=self._settings.speed <= 1)
        self._units = UnitCheck(detector)
        self._limiter = EventLimiter()
        given = self._settings.stop_after_s
        self._stop_after = stop_time(detector.period_s, self._settings.speed) if given is None else given
        # What comes during a longer read would count as having waited.
        self._longest_read_s = min(_LONGEST_READ_S, 0.25 * self._stop_after)
        self._lag = LagCheck(self._stop_after, self._settings.speed)
        # A source that begins may take a while.
        self._begin_after = max(_FIRST_S, self._stop_after) if given is None else given
        self._nan = np.full(detector.dof, math.nan)
        self._no_rates = np.zeros(detector.dof)
        self._stopping = self._ended = self._silent = False
        self._last_received: float | None = None
        self._events = self._kernel.events
        self._quiet_since, self._was_judged = -math.inf, False
        # An alarm that nobody has dealt with; what the kernel forgets of it is kept here.
        self._standing = False
        self._payload_changed = False
        self._last_state = _NO_DATA
        self.latency, self.alarm_latency = LatencyHistogram(), LatencyHistogram()
        self.samples = self.judged = self.alarms = self.dropped = self.arming = self.masked_while_arming = 0
        self.kinds: Counter[SourceEventKind] = Counter()
        self.faults: Counter[str] = Counter()
        self.largest_share = np.zeros(detector.dof)
        self.silent_s = self._lasted = 0.0
        self.problems: list[str] = []

    def stop(self) -> None:
        """End :meth:`run` after the sample at hand; may be called from a handler of signals or another thread."""
        self._stopping = True

    @property
    def inactive(self) -> bool:
        """The arm is not watched now: no sample has come yet, none comes, or the last could not be judged."""
        return self._silent or self._last_received is None or self._last_state == _NO_DATA

    @property
    def state(self) -> str:
        """``"inactive"``, ``"arming"``, ``"monitoring"`` or ``"alarm"``."""
        return "inactive" if self.inactive else STATES[self._last_state]

    def age_s(self) -> float:
        """Time since the last sample came [s]; NaN: none has come."""
        return math.nan if self._last_received is None else time.monotonic() - self._last_received

    def summary(self) -> MonitorSummary:
        """What has been seen so far."""
        found = {str(kind): count for kind, count in sorted(self.kinds.items()) if kind not in _USUAL and count}
        return MonitorSummary(
            duration_s=self._lasted,
            samples=self.samples,
            judged=self.judged,
            arming=self.arming,
            masked_while_arming=self.masked_while_arming,
            no_data=dict(sorted(self.faults.items())),
            dropped=self.dropped,
            found=found,
            alarms=self.alarms,
            silent_s=self.silent_s,
            latency_ms=self.latency.in_ms(),
            alarm_latency_ms=self.alarm_latency.in_ms(),
            largest_share=tuple(float(x) for x in self.largest_share),
            active_at_end=not self.inactive and self._last_state != _ARMING,
            problems=tuple(self.problems),
        )

    def run(self, every: Callable[[Monitor], None] | None = None) -> MonitorSummary:
        """Until the duration is over, the source has ended or :meth:`stop` was called.

        Args:
            every: called about ten times a second.
        """
        begin = time.monotonic()
        self._begin = begin
        try:
            self._read(begin, every)
        finally:
            self._finish(begin)
        return self.summary()

    def _read(self, begin: float, every: Callable[[Monitor], None] | None) -> None:
        end, next_flush = begin + self._settings.duration_s, begin + _FLUSH_S
        while not self._stopping and not self._ended:
            now = time.monotonic()
            if now >= end:
                break
            if now >= next_flush:
                next_flush = now + _FLUSH_S
                self._flush(now)
                if every is not None:
                    every(self)
            item = self._next(end)
            if isinstance(item, JointSample):
                self.take(item)
            elif isinstance(item, SourceEvent):
                self._hear(item)
            else:
                self._look_for_silence(time.monotonic())

    def _next(self, end: float) -> JointSample | SourceEvent | None:
        """What comes next; None: nothing has come for a while, and nothing waits to be read."""
        if self._lag.suspected:
            if (item := self._source.read(0.0)) is not None:
                return item
            self._lag.nothing_waits(time.monotonic())
        begin = time.monotonic()
        item = self._source.read(min(self._longest_read_s, max(0.0, end - begin)))
        if item is None and time.monotonic() - begin > 2 * self._longest_read_s:
            # Who was held up in a read does not know what came meanwhile.
            item = self._source.read(self._longest_read_s)
        if item is None:
            self._lag.nothing_waits(time.monotonic())
        return item

    def _finish(self, begin: float) -> None:
        now = time.monotonic()
        if self._silent and self._last_received is not None:
            self.silent_s += now - self._last_received
        self._lasted = now - begin
        # Whoever reads outputs must not take the last state for that of now, whatever ended this.
        for event in self._limiter.due(now, final=True):
            self._tell(event, now)
        self._tell_loss(SourceEventKind.ENDED, now)
        self._flush(now)

    def take(self, sample: JointSample) -> None:
        """Judge a sample."""
        self.samples += 1
        if self._last_received is None or self._silent:
            self._began(sample)
        self._last_received = sample.received_s
        checked = self._checks.check(sample)
        for kind, text, count in checked.findings:
            self._found(kind, text, count, sample.received_s)
        if checked.restart:
            self._forget()
        late = self._lag.look(sample.stamp_s, sample.received_s)
        if late:
            # The end of it is no other lag.
            self._found(SourceEventKind.LAGGING, late, int(self._lag.lagging), sample.received_s)
        if not checked.usable or checked.signal is None:
            self.dropped += 1
            if self._checks.flooded:
                self._kernel.reset()
                self._events = self._kernel.events
            self._say_nothing(sample, str(checked.findings[-1][0]) if checked.findings else "flooded")
            return
        rates = sample.velocity_rad_s if self.detector.measured_rates else None
        out = self._kernel.update(
            sample.stamp_s, sample.position_rad, checked.signal, self._no_rates if rates is None else rates
        )
        self._judge(sample, checked.signal, out)

    def _judge(self, sample: JointSample, signal: FloatArray, out: _native.DetectorOutput) -> None:
        n, own = self.detector.dof, int(out.state.value)
        events = self._kernel.events
        begins, self._events = events != self._events, events
        # Where the first alarm stands, an event behind a silence is no other.
        told = begins and not (self._standing and math.isinf(self._settings.rearm_s))
        self._standing |= begins
        state = _ALARM if self._standing and own != _NO_DATA else own
        residual = np.array(out.residual[:n])
        tick = MonitorTick(
            sample=sample,
            state=STATES[state],
            fault=FAULTS[int(out.fault.value)],
            alarm=self._standing,
            stop=out.stop or self._standing,
            residual=residual,
            threshold=np.array(out.threshold[:n]),
        )
        self._last_state = state
        if told:
            self._alarm(tick, np.array(out.fast[:n]))
        self.latency.add(self._age(sample))
        over = out.over | out.over_fast
        if state == _NO_DATA:
            self.faults[tick.fault] += 1
            self._was_judged = False
        else:
            arming = own == _ARMING
            self.arming += arming
            self.judged += not arming
            self.masked_while_arming += arming and out.masked_while_arming
            share = np.abs(residual) / tick.threshold
            np.maximum(self.largest_share, share, out=self.largest_share)
            unit = self._units.look(sample.stamp_s, signal, residual)
            if unit:
                self._found(SourceEventKind.WRONG_UNIT, unit, 1, sample.received_s)
            self._look_at_payload(sample, changed=out.payload_changed)
            if self._rearmed(sample.stamp_s, self._standing, arming or over != 0):
                self._kernel.acknowledge()
                self._standing = False
        for output in self._outputs:
            output.tick(tick)

    def _look_at_payload(self, sample: JointSample, *, changed: bool) -> None:
        """Tell once that the payload has changed, until it is as declared again."""
        before, self._payload_changed = self._payload_changed, changed
        if changed and not before:
            text = f"the residuals look like a payload of {self._kernel.payload_change():+.3g} kg that nobody declared"
            self._found(SourceEventKind.PAYLOAD_CHANGED, text, 1, sample.received_s)

    def _alarm(self, tick: MonitorTick, fast: FloatArray) -> None:
        self.alarms += 1
        event = Event.of_loop(self.detector.links, self._kernel.event())
        alarm = CollisionAlarm(
            stamp_s=tick.sample.stamp_s,
            number=self.alarms,
            event=event,
            latency_s=self._age(tick.sample),
            tick=tick,
            fast=fast,
            fast_threshold=self.detector.fast_thresholds_at(tick.threshold),
        )
        for output in self._outputs:
            output.alarm(alarm)
        self.alarm_latency.add(self._age(tick.sample))

    def _age(self, sample: JointSample) -> float:
        """Time since a sample was received, or could have been [s]."""
        return max(0.0, time.monotonic() - sample.received_s) + self._lag.lag_s

    def _rearmed(self, t: float, alarm: bool, loud: bool) -> bool:
        """As a run over a recording has it: everything was judged and below its thresholds for long enough."""
        if not alarm or loud:
            self._quiet_since, self._was_judged = t, alarm
            return False
        if not self._was_judged:
            self._quiet_since = t
        self._was_judged = True
        return t - self._quiet_since >= self._settings.rearm_s

    def _say_nothing(self, sample: JointSample, fault: str) -> None:
        """A tick of a sample that the detector was not given: it watches nothing meanwhile."""
        self._last_state, self._was_judged = _NO_DATA, False
        tick = MonitorTick(
            sample=sample,
            state="no_data",
            fault=fault,
            alarm=self._standing,
            stop=True,
            residual=self._nan,
            threshold=self.detector.thresholds,
        )
        for output in self._outputs:
            output.tick(tick)

    def _began(self, sample: JointSample) -> None:
        if self._silent and self._last_received is not None:
            self.silent_s += sample.received_s - self._last_received
        word = "samples come again" if self._last_received is not None else "samples come"
        self._silent = False
        self._found(SourceEventKind.STARTED, word, 1, sample.received_s)

    def _look_for_silence(self, now: float) -> None:
        for event in self._limiter.due(now):
            self._tell(event, now)
        none = self._last_received is None
        since = self._begin if self._last_received is None else self._last_received
        if self._silent or now - since <= (self._begin_after if none else self._stop_after):
            return
        self._silent = True
        first = "no sample has come" if none else "no sample"
        self._found(SourceEventKind.STOPPED, f"{first} for {now - since:.3g} s", 1, now)
        self._lose_data(SourceEventKind.STOPPED, now)

    def _hear(self, event: SourceEvent) -> None:
        now = time.monotonic()
        # Of one silence the source and the monitor may both tell; it counts once, whoever is first.
        stopped = event.kind is SourceEventKind.STOPPED
        if not (stopped and self._silent):
            self.kinds[event.kind] += event.count
        self._silent |= stopped
        self._tell(event, now)
        if event.kind is SourceEventKind.ENDED:
            self._ended = True
            return
        if stopped or event.kind is SourceEventKind.RESTARTED:
            self._lose_data(event.kind, now)
        self._look_for_silence(now)

    def _lose_data(self, why: SourceEventKind, now: float) -> None:
        """Nothing is judged until samples come, and what they show then may be a motion of any kind."""
        self._forget()
        self._checks.reset()
        self._last_state = _NO_DATA
        self._tell_loss(why, now)

    def _tell_loss(self, why: SourceEventKind, now: float) -> None:
        for output in self._outputs:
            output.data_loss(DataLoss(fault=str(why), alarm=self._standing, received_s=now))

    def _forget(self) -> None:
        """Begin anew, but for an alarm that stands: what is not seen does not end it."""
        self._kernel.reset()
        self._events = self._kernel.events
        self._lag.reset()
        self._was_judged = False

    def _found(self, kind: SourceEventKind, text: str, count: int, now: float) -> None:
        self.kinds[kind] += count
        event = self._limiter.add(kind, text, now, count)
        if event is not None:
            self._tell(event, now)

    def _tell(self, event: SourceEvent, now: float) -> None:
        for output in self._outputs:
            output.source_event(event, now)

    def _flush(self, now: float) -> None:
        for event in self._limiter.due(now):
            self._tell(event, now)
        for output in self._outputs:
            output.flush(now)
            self.problems += output.problems()
