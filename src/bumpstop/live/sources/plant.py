"""The simulated robot as a source, in this process."""

from __future__ import annotations

import math
import queue
import threading
import time
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError
from bumpstop.live.sample import JointSample
from bumpstop.live.source import Source, SourceEvent, SourceEventKind

if TYPE_CHECKING:
    from bumpstop.live.answer import Answer
    from bumpstop.plant import Experiment, PlantReaction, Sample

_MAX_WAITING = 1000  # samples, before the plant waits for its reader


class PlantSource(Source):
    """Runs an experiment in a thread of its own and gives its feedback samples.

    Its samples have currents: in the unit of the experiment's joint model, without one in Nm, which are torques, too.

    Args:
        experiment: to run, once.
        speed: seconds of the motion in a second; infinite: as fast as MuJoCo goes.
        name: as the user wrote it.

    Raises:
        InputError: the experiment cannot be used.
    """

    def __init__(self, experiment: Experiment, speed: float = 1.0, name: str = "plant") -> None:
        if not speed > 0:
            raise InputError("--speed", f"is {speed}", "wanted more than zero, or max")
        self._plant, self._command = experiment.prepare()
        self._given = experiment.reaction_of(self._plant.robot)
        self._speed, self._name = speed, name
        self._waiting: queue.Queue[JointSample | SourceEvent] = queue.Queue(_MAX_WAITING)
        self._closed = threading.Event()
        self._thread: threading.Thread | None = None
        self._reaction: PlantReaction | None = None

    @property
    def name(self) -> str:
        """As the user wrote it."""
        return self._name

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of the robot's joints."""
        return tuple(joint.name for joint in self._plant.robot.joints)

    @property
    def period_s(self) -> float:
        """Between its samples [s]."""
        return 1 / self._plant.sensors.rate_hz

    @property
    def gives_torques(self) -> bool:
        """Its currents are in Nm, as it has no joint model."""
        return self._plant.joint_model is None

    def answer(self, answer: Answer, number: int) -> None:
        """Turn the motion at the next sample, as the experiment's ``[reaction]`` says; the first answer counts.

        Args:
            answer: ``"stop"`` or ``"reverse"``; ``"none"`` changes nothing.
            number: of the alarm.
        """
        if answer != "none" and self._reaction is None:
            self._reaction = replace(self._given, kind=answer)

    def open(self) -> None:
        """Begin the motion."""
        if self._thread is None:
            self._begin = time.monotonic()
            self._thread = threading.Thread(target=self._move, name="plant", daemon=True)
            self._thread.start()

    def _move(self) -> None:
        try:
            self._plant.run(self._command, on_sample=self._give, to_end=True)
            last = SourceEvent(SourceEventKind.ENDED, "the experiment is at its end")
        except _ClosedError:
            return
        except InputError as error:
            last = SourceEvent(SourceEventKind.ENDED, f"the experiment has ended: {error}")
        self._put(last)

    def _give(self, sample: Sample) -> PlantReaction | None:
        if math.isfinite(self._speed):
            wait = self._begin + sample.t / self._speed - time.monotonic()
            if wait > 0:
                self._closed.wait(wait)
        current = np.array(sample.current)
        self._put(
            JointSample(
                stamp_s=sample.t,
                received_s=time.monotonic(),
                position_rad=np.array(sample.q),
                velocity_rad_s=np.array(sample.qd),
                current_A=current,
                torque_Nm=current if self.gives_torques else None,
            )
        )
        return self._reaction

    def _put(self, item: JointSample | SourceEvent) -> None:
        while not self._closed.is_set():
            try:
                self._waiting.put(item, timeout=0.1)
            except queue.Full:
                continue
            return
        raise _ClosedError

    def read(self, timeout_s: float) -> JointSample | SourceEvent | None:
        """The next sample or ``ENDED``; None: neither within the time [s]."""
        try:
            return self._waiting.get(timeout=max(timeout_s, 0.0))
        except queue.Empty:
            return None

    def close(self) -> None:
        """End the motion where it is."""
        self._closed.set()
        if self._thread is not None:
            self._thread.join(5.0)


class _ClosedError(Exception):
    """The source was closed while the plant moved."""
