"""A controller of Universal Robots as a source of joint samples."""

from __future__ import annotations

import time
from collections import deque
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from bumpstop.arrays import as_number
from bumpstop.errors import InputError
from bumpstop.live.answer import ANSWERS, Answer
from bumpstop.live.event_limiter import EventLimiter
from bumpstop.live.rtde.axes import CONTROLLER_JOINTS, DEFAULT_AXES, FIRST_REGISTER, joint_order
from bumpstop.live.rtde.connection import LostConnectionError, RtdeConnection
from bumpstop.live.rtde.fields import ProtocolError, Recipe, Value
from bumpstop.live.rtde.messages import LEVELS, PORT, Data, Reply, Text, decode_reply
from bumpstop.live.sample import JointSample
from bumpstop.live.source import Source, SourceEvent, SourceEventKind

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.arrays import FloatArray

Signal = Literal["current", "torque"]

_SIGNAL_FIELDS: dict[str, str] = {"current": "actual_current", "torque": "actual_current_as_torque"}
# Input registers that carry an answer: what to do, and the number of the alarm.
ANSWER_FIELDS = {f"input_int_register_{FIRST_REGISTER}": "INT32", f"input_int_register_{FIRST_REGISTER + 1}": "INT32"}
MAX_FREQUENCY_HZ = 500.0
_OPEN_TIMEOUT_S = 2.0
_AGAIN_TIMEOUT_S = 0.5
_FIRST_PAUSE_S, _LONGEST_PAUSE_S = 0.1, 2.0
# A connection that gives samples so long after it was made is a good one: the next trial comes soon again.
_GOOD_AFTER_S = 2.0
# So many bad packages in a row mean that packages begin elsewhere than it seems.
_MAX_BAD = 3


def output_fields(joints: int, signal: Signal) -> dict[str, str]:
    """Fields that a source reads, with their types."""
    fields = {
        "timestamp": "DOUBLE",
        "actual_q": "VECTOR6D",
        "actual_qd": "VECTOR6D",
        _SIGNAL_FIELDS[signal]: "VECTOR6D",
    }
    registers = range(FIRST_REGISTER, FIRST_REGISTER + 2 * (joints - CONTROLLER_JOINTS))
    return fields | {f"output_double_register_{number}": "DOUBLE" for number in registers}


class RtdeSource(Source):
    """Samples of a Universal Robots controller over its Real-Time Data Exchange.

    The connection is made anew whenever it ends. Pauses between trials grow from 0.1 s to 2 s, and are short again once
    samples have come for 2 s.

    Args:
        host, port: of the controller.
        joints: number of joints of the detector's robot, from 6; those beyond 6 are read from registers.
        axes: (6,) which of them, from 1, the controller's are, from its base to its wrist; the others are those in
            registers, in their order.
        signal: ``"current"`` reads ``actual_current``, ``"torque"`` reads ``actual_current_as_torque``.
        frequency_hz: of the samples, up to 500.
        answers: whether :meth:`answer` will be called: the input registers are then taken.

    Raises:
        InputError: something cannot be used.
    """

    def __init__(
        self,
        host: str,
        port: int = PORT,
        *,
        joints: int = CONTROLLER_JOINTS,
        axes: Sequence[int] = DEFAULT_AXES,
        signal: Signal = "current",
        frequency_hz: float = MAX_FREQUENCY_HZ,
        answers: bool = False,
    ) -> None:
        self._order = joint_order(joints, axes)
        if signal not in _SIGNAL_FIELDS:
            raise InputError("signal", f"is {signal!r}", f"valid: {', '.join(_SIGNAL_FIELDS)}")
        if not 1 <= as_number(frequency_hz, "frequency_hz") <= MAX_FREQUENCY_HZ:
            raise InputError("frequency_hz", f"is {frequency_hz:g}", f"wanted 1 to {MAX_FREQUENCY_HZ:g}")
        self._host, self._port, self._joints, self._signal = host, port, joints, signal
        self._frequency = frequency_hz
        self._inputs = ANSWER_FIELDS if answers else {}
        self._connection: RtdeConnection | None = None
        self._outputs, self._written = Recipe(0, (), ()), Recipe(0, (), ())
        self._queue: deque[JointSample | SourceEvent] = deque()
        self._limiter = EventLimiter()
        self._bad = 0
        self._pause, self._next_trial, self._connected_s = _FIRST_PAUSE_S, 0.0, 0.0
        self._answered = 0, 0

    @property
    def name(self) -> str:
        """``rtde://HOST:PORT``."""
        return f"rtde://{self._host}:{self._port}"

    @property
    def controller(self) -> str:
        """Version of the controller's software; empty without a connection."""
        return "" if self._connection is None else str(self._connection.controller or "")

    def open(self) -> None:
        """Connect and negotiate.

        Raises:
            InputError: there is no controller, it speaks another protocol, or has not got what is needed.
        """
        if self._connection is not None:
            return
        try:
            self._connection = self._connected(_OPEN_TIMEOUT_S)
        except LostConnectionError as error:
            raise InputError(self.name, str(error), "wanted a controller of Universal Robots") from None
        except ProtocolError as error:
            problem = f"what answers there does not speak RTDE: {error}"
            raise InputError(self.name, problem, f"wanted a controller of Universal Robots, port {PORT}") from None

    def _connected(self, timeout_s: float) -> RtdeConnection:
        connection = RtdeConnection(self._host, self._port, timeout_s)
        fields = output_fields(self._joints, self._signal)
        try:
            self._outputs, self._written = connection.negotiate(self._frequency, fields, self._inputs)
            if self._inputs:
                # A robot that was told to stop must not see that taken back by a connection made anew.
                connection.send_inputs(self._written, self._answered)
        except BaseException:
            connection.close()
            raise
        for text in connection.texts:
            self._said(text)
        self._connected_s = time.monotonic()
        return connection

    def read(self, timeout_s: float) -> JointSample | SourceEvent | None:
        """The next sample or event; None: neither within the time [s]."""
        end = time.monotonic() + timeout_s
        while not self._queue:
            left = end - time.monotonic()
            if self._connection is None:
                self._try_again(max(0.0, left))
            else:
                self._receive(self._connection, max(0.0, left))
            if left <= 0:
                break
        if not self._queue:
            self._queue.extend(self._limiter.due(time.monotonic()))
        return self._queue.popleft() if self._queue else None

    def _receive(self, connection: RtdeConnection, timeout_s: float) -> None:
        try:
            package = connection.package(timeout_s)
        except LostConnectionError as error:
            self._lose(SourceEventKind.STOPPED, f"{error}; connecting again")
            return
        except ProtocolError as error:
            self._lose(SourceEventKind.DAMAGED, f"{error}; connecting again")
            return
        if package is None:
            return
        try:
            self._take(decode_reply(*package), connection.received_s)
        except ProtocolError as error:
            self._bad_package(SourceEventKind.DAMAGED, str(error))

    def _take(self, message: Reply, received_s: float) -> None:
        if isinstance(message, Text):
            self._said(message)
        elif not isinstance(message, Data):
            self._bad_package(SourceEventKind.FOREIGN, f"{type(message).__name__} among the data packages")
        elif message.recipe != self._outputs.number:
            text = f"a data package of recipe {message.recipe}, ours is {self._outputs.number}"
            self._bad_package(SourceEventKind.FOREIGN, text)
        else:
            self._queue.append(self._sample(self._outputs.unpack(message.values), received_s))
            self._bad = 0
            if received_s - self._connected_s >= _GOOD_AFTER_S:
                self._pause = _FIRST_PAUSE_S

    def _bad_package(self, kind: SourceEventKind, text: str) -> None:
        self._tell(kind, text)
        self._bad += 1
        if self._bad >= _MAX_BAD:
            self._lose(SourceEventKind.DAMAGED, f"{self._bad} bad packages in a row; connecting again")

    def _sample(self, values: dict[str, Value], received_s: float) -> JointSample:
        def vector(field: str, register: int) -> FloatArray:
            beyond = range(register, register + 2 * (self._joints - CONTROLLER_JOINTS), 2)
            more = [cast(float, values[f"output_double_register_{number}"]) for number in beyond]
            found = np.empty(self._joints)
            found[self._order] = [*cast("tuple[float, ...]", values[field]), *more]
            return found

        signal = vector(_SIGNAL_FIELDS[self._signal], FIRST_REGISTER + 1)
        return JointSample(
            stamp_s=cast(float, values["timestamp"]),
            received_s=received_s,
            position_rad=vector("actual_q", FIRST_REGISTER),
            velocity_rad_s=np.array(values["actual_qd"]) if self._joints == CONTROLLER_JOINTS else None,
            current_A=signal if self._signal == "current" else None,
            torque_Nm=signal if self._signal == "torque" else None,
        )

    def _said(self, text: Text) -> None:
        """Warnings and information of a controller say nothing of samples."""
        if text.level <= LEVELS.index("error"):
            self._tell(SourceEventKind.DAMAGED, f"the controller says: {text.source}: {text.text}")

    def _tell(self, kind: SourceEventKind, text: str) -> None:
        """Of what can come with every message at most one event a second."""
        event = self._limiter.add(kind, f"{self.name}: {text}", time.monotonic())
        if event is not None:
            self._queue.append(event)

    def _tell_at_once(self, kind: SourceEventKind, text: str) -> None:
        """Of connections: none may be missed, and the pauses between them keep these few."""
        self._queue.append(SourceEvent(kind, f"{self.name}: {text}"))

    def _lose(self, kind: SourceEventKind, text: str) -> None:
        assert self._connection is not None
        self._connection.close()
        self._connection, self._bad = None, 0
        self._wait()
        self._tell_at_once(kind, text)

    def _wait(self) -> None:
        """Put off the next trial, and the one after it longer: what connects may break at once, again and again."""
        self._next_trial = time.monotonic() + self._pause
        self._pause = min(2 * self._pause, _LONGEST_PAUSE_S)

    def _try_again(self, timeout_s: float) -> None:
        """Wait until the next trial is due, or the time is over; then try."""
        wait = self._next_trial - time.monotonic()
        if wait > 0:
            time.sleep(min(wait, timeout_s))
            if wait > timeout_s:
                return
        try:
            self._connection = self._connected(_AGAIN_TIMEOUT_S)
        except (LostConnectionError, ProtocolError, InputError) as error:
            if not isinstance(error, LostConnectionError):
                self._tell(SourceEventKind.DAMAGED, f"cannot go on: {error}; connecting again")
            self._wait()
            return
        self._tell_at_once(SourceEventKind.RESTARTED, "connected again")

    def answer(self, answer: Answer, number: int) -> None:
        """Write an answer into the controller's registers, at once.

        A program of the controller reads them with ``read_input_integer_register(24)``: 0 none, 1 stop, 2 reverse; 25
        has the number of the alarm. An answer that finds no connection is written as soon as there is one.

        Args:
            answer: what the arm shall do.
            number: of the alarm, from 1.
        """
        self._answered = ANSWERS.index(answer), number
        self._write(*self._answered)

    def _write(self, answer: int, number: int) -> None:
        if self._connection is None:
            return
        try:
            self._connection.send_inputs(self._written, (answer, number))
        except LostConnectionError as error:
            self._lose(SourceEventKind.STOPPED, f"{error}; connecting again")

    def close(self) -> None:
        """Pause the exchange and end; may be called twice, and without :meth:`open`."""
        if self._connection is not None:
            self._connection.pause()
            self._connection.close()
            self._connection = None
