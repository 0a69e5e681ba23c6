"""A detector's file, a motion without contact, and a source that says what a test tells it to."""

from __future__ import annotations

import time
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.detection import Detector, DetectorSettings, save_detector
from bumpstop.live import JointSample, MonitorTick, SourceEvent, SourceEventKind
from bumpstop.live.loaded_detector import LoadedDetector
from bumpstop.live.output import CollisionAlarm, DataLoss
from bumpstop.recording import Recording
from detection.moving_arms import UR5E, moving

DT = 0.004
N = 6
NAMES = tuple(joint.name for joint in UR5E.joints)
THRESHOLD_NM = 10.0
# Rows until the window is full.
FILLING = DetectorSettings(window_s=0.02).window_samples(DT) - 1


def detector_file(folder: Path, **settings: object) -> Path:
    """A detector of torques for a UR5e at 250 Hz."""
    path = folder / "ur5e.detector"
    given = DetectorSettings(**{"period_s": DT, "window_s": 0.02, "arming_delay_s": 0.0} | settings)  # type: ignore[arg-type]
    save_detector(Detector(UR5E, None, np.full(N, THRESHOLD_NM), given), path)
    return path


def loaded(folder: Path, **settings: object) -> LoadedDetector:
    return LoadedDetector.load(detector_file(folder, **settings))


def motion(rows: int, *, push_Nm: float = 0.0, at: int = 0, until: int = 0, seed: int = 1) -> Recording:
    """A motion with torques; from row ``at`` on, something pushes on joint 2."""
    t, q, qd, _, tau = moving(UR5E, rows, DT, seed, pace=0.4)
    tau = tau.copy()
    tau[at:until, 1] += push_Nm
    return Recording(t=t, q=q, qd=qd, tau=tau, joint_names=NAMES)


def samples(log: Recording) -> list[JointSample]:
    """The rows; when they are received, the source says."""
    assert log.tau is not None
    return [
        JointSample(
            stamp_s=float(log.t[i]), received_s=0.0, position_rad=log.q[i], torque_Nm=log.tau[i],
            sequence=None,
        )
        for i in range(log.t.size)
    ]  # fmt: skip


def at(sample: JointSample, **changes: object) -> JointSample:
    return replace(sample, **changes)  # type: ignore[arg-type]


class ScriptedSource:
    """Gives what it is told to: samples, events, or None for a twentieth of a second in which nothing comes."""

    name = "scripted"

    def __init__(self, script: Iterable[JointSample | SourceEvent | None]) -> None:
        self._script, self._silent_s = iter(script), 0.0

    def open(self) -> None:
        """Nothing to do."""

    def read(self, timeout_s: float) -> JointSample | SourceEvent | None:
        if self._silent_s < 1e-6:
            item = next(self._script, SourceEvent(SourceEventKind.ENDED, "the script is at its end"))
            self._silent_s = 0.05 if item is None else 0.0
        if self._silent_s:
            waited_s = min(timeout_s, self._silent_s)
            time.sleep(waited_s)
            self._silent_s -= waited_s
            return None
        return replace(item, received_s=time.monotonic()) if isinstance(item, JointSample) else item

    def close(self) -> None:
        """Nothing to do."""

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        """Nothing to do."""


class Heard:
    """An output that remembers."""

    def __init__(self) -> None:
        self.ticks: list[MonitorTick] = []
        self.alarms: list[CollisionAlarm] = []
        self.events: list[SourceEvent] = []
        self.losses: list[DataLoss] = []

    def alarm(self, alarm: CollisionAlarm) -> None:
        self.alarms.append(alarm)

    def tick(self, tick: MonitorTick) -> None:
        self.ticks.append(tick)

    def data_loss(self, loss: DataLoss) -> None:
        self.losses.append(loss)

    def source_event(self, event: SourceEvent, received_s: float) -> None:
        self.events.append(event)

    def flush(self, now_s: float) -> None:
        """Nothing to do."""

    def problems(self) -> list[str]:
        return []

    def close(self) -> None:
        """Nothing to do."""

    def residual(self) -> FloatArray:
        return np.array([tick.residual for tick in self.ticks])

    def kinds(self) -> Sequence[SourceEventKind]:
        return [event.kind for event in self.events]
