"""What a stream of samples shows of itself: lost, repeated, disordered, damaged and foreign samples, and floods."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.live.rate_check import RateCheck
from bumpstop.live.source import SourceEventKind
from bumpstop.terminal import counted

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.live.loaded_detector import LoadedDetector
    from bumpstop.live.sample import JointSample

Finding = tuple[SourceEventKind, str, int]

# A clock or a counter that goes back so far has begun again [s, samples]; so it has after so many samples in a row that
# are older than one before.
_RESTART_S = 1.0
_RESTART_COUNT = 1000
_MAX_BACK = 10
# The source's clock may gain so much on ours between two samples [s].
_AHEAD_S = 1.0
# So many samples in a row closer than this share of a period are a flood, and as many others end it.
_FLOOD_SHARE = 0.5
_FLOOD_SAMPLES = 10
# Of a period: an interval longer than this means lost samples.
_LATE_SHARE = 1.5


@dataclass(frozen=True, slots=True)
class CheckedSample:
    """What to do with a sample.

    Attributes:
        findings: kind, sentence and number of samples, of everything that is wrong.
        restart: the detector must forget the past.
        usable: the detector can be given it; what is wrong with it there, it says itself.
        signal: (n,) what the detector takes, where it is usable: currents or torques.
    """

    findings: tuple[Finding, ...]
    restart: bool = False
    usable: bool = True
    signal: FloatArray | None = None


class StreamChecks:
    """Looks at one sample after the other, as they come.

    Args:
        detector: says which joints and which signal, and how often.
        paced: the clock of the source runs no faster than ours; else ours says nothing of it.
    """

    def __init__(self, detector: LoadedDetector, *, paced: bool = True) -> None:
        self._detector, self._paced = detector, paced
        self._period = detector.period_s
        self._rate = RateCheck(detector.period_s)
        # The detector needs no signal of a joint that it does not monitor.
        needless = detector.description.settings.samples.unmonitored
        self._needless = np.array([bool(needless >> j & 1) for j in range(detector.dof)])
        self.reset()

    def reset(self) -> None:
        """Forget the stream, as before its first sample."""
        self._stamp, self._received, self._sequence = -math.inf, -math.inf, None  # type: tuple[float, float, int | None]
        self._newest_back, self._back = -math.inf, 0
        self._close, self._spaced, self.flooded = 0, 0, False

    def check(self, sample: JointSample) -> CheckedSample:
        """What is wrong with the next sample."""
        foreign = self._foreign(sample)
        if foreign:
            return CheckedSample(((SourceEventKind.FOREIGN, foreign, 1),), usable=False)
        signal = sample.current_A if self._detector.takes_current else sample.torque_Nm
        assert signal is not None
        if not math.isfinite(sample.stamp_s):
            text = f"a sample's time is {sample.stamp_s}"
            return CheckedSample(((SourceEventKind.DAMAGED, text, 1),), usable=False)
        findings: list[Finding] = []
        damaged = self._damaged(sample, signal)
        if damaged:
            findings.append((SourceEventKind.DAMAGED, damaged, 1))
        counted, restart = self._look_at_sequence(sample, findings)
        restart = self._look_at_time(sample, findings, counted) or restart
        if restart:
            self._close, self._back, self.flooded = 0, 0, False
            self._stamp, self._received = sample.stamp_s, sample.received_s
        return CheckedSample(tuple(findings), restart=restart, usable=not self.flooded, signal=signal)

    def _foreign(self, sample: JointSample) -> str:
        """Why a sample is none of this robot's; empty: it is."""
        own, n = self._detector, self._detector.dof
        if np.shape(sample.position_rad) != (n,):
            return f"a sample of {np.size(sample.position_rad)} joints; {own.robot} has {n}"
        wanted = sample.current_A if own.takes_current else sample.torque_Nm
        if wanted is None:
            other = sample.torque_Nm if own.takes_current else sample.current_A
            has = "neither" if other is None else "torques" if own.takes_current else "currents"
            return f"samples have {has}; the detector takes {own.signal}s"
        if np.shape(wanted) != (n,):
            return f"a sample with {np.size(wanted)} {own.signal}s; {own.robot} has {n} joints"
        if own.measured_rates:
            if sample.velocity_rad_s is None:
                return "samples have no rates; the detector takes measured ones"
            if np.shape(sample.velocity_rad_s) != (n,):
                return f"a sample with {np.size(sample.velocity_rad_s)} rates; {own.robot} has {n} joints"
        return ""

    def _damaged(self, sample: JointSample, signal: FloatArray) -> str:
        """Which number is none; empty: all are."""
        columns = [("position", sample.position_rad), (self._detector.signal, signal)]
        if self._detector.measured_rates and sample.velocity_rad_s is not None:
            columns.append(("rate", sample.velocity_rad_s))
        for name, values in columns:
            fine = np.isfinite(values)
            if values is signal:
                fine |= self._needless
            if not fine.all():
                bad = int(np.argmin(fine))
                return f"{name} of {self._detector.joints[bad]} is {values[bad]}"
        return ""

    def _look_at_sequence(self, sample: JointSample, findings: list[Finding]) -> tuple[bool, bool]:
        """Whether the sender's count tells how many samples are missing, and whether it has begun again."""
        number, before = sample.sequence, self._sequence
        self._sequence = number
        # A count that stands or jumps says nothing of samples.
        if number is None or before is None or number == before or number - before > _RESTART_COUNT:
            return False, False
        if number > before:
            missing = number - before - 1
            if missing:
                findings.append((SourceEventKind.LOST, f"{counted(missing, 'sample', 'is')} missing", missing))
            return True, False
        if before - number < _RESTART_COUNT and number != 0:
            self._sequence = before
            return False, False
        findings.append((SourceEventKind.RESTARTED, f"the source counts from {number} again", 1))
        return False, True

    def _look_at_time(self, sample: JointSample, findings: list[Finding], counted: bool) -> bool:
        """Whether the sender's clock has begun again; samples are missing by its times where no count tells."""
        if self._stamp == -math.inf:
            self._stamp, self._received = sample.stamp_s, sample.received_s
            return False
        step, passed = sample.stamp_s - self._stamp, sample.received_s - self._received
        if step <= 0:
            return self._not_later(sample, -step, findings)
        self._back, self._newest_back = 0, -math.inf
        self._watch_flood(step, findings)
        # A flood has its own name.
        rate = self._rate.look(step) if step >= _FLOOD_SHARE * self._period else ""
        if rate:
            findings.append((SourceEventKind.WRONG_RATE, rate, 1))
        if self._paced and step - max(passed, 0.0) > _AHEAD_S:
            text = f"the sender's clock went ahead by {step - passed:.3g} s"
            findings.append((SourceEventKind.JUMPED_AHEAD, text, 1))
        elif step > _LATE_SHARE * self._period and not counted:
            count = max(1, round(step / self._period) - 1)
            missing = "1 sample is missing" if count == 1 else f"{count} samples are missing"
            findings.append((SourceEventKind.LOST, f"{missing}, {step:.3g} s", count))
        self._stamp, self._received = sample.stamp_s, sample.received_s
        return False

    def _not_later(self, sample: JointSample, back: float, findings: list[Finding]) -> bool:
        if back == 0:
            findings.append((SourceEventKind.REPEATED, "a sample of the same time came again", 1))
            return False
        # Samples that are old, but later each time, are those of a clock that was put back a little.
        self._back = self._back + 1 if sample.stamp_s > self._newest_back else 1
        self._newest_back = sample.stamp_s
        if back > _RESTART_S or self._back >= _MAX_BACK:
            text = f"the sender's clock went back by {back:.3g} s"
            findings.append((SourceEventKind.RESTARTED, text, 1))
            self._newest_back = -math.inf
            return True
        findings.append((SourceEventKind.WENT_BACK, f"a sample is {back:.3g} s older than one before", 1))
        return False

    def _watch_flood(self, step: float, findings: list[Finding]) -> None:
        if step < _FLOOD_SHARE * self._period:
            self._close, self._spaced = self._close + 1, 0
        else:
            self._spaced += 1
            if self._spaced >= _FLOOD_SAMPLES or not self.flooded:
                self._close, self.flooded = 0, False
        if self._close >= _FLOOD_SAMPLES:
            self.flooded = True
        if self.flooded:
            text = f"samples come every {step:.3g} s; the detector is made for {self._period:.3g} s"
            findings.append((SourceEventKind.FLOODED, text, 1))
