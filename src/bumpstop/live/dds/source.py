"""Joint states of ROS 2 as a source of joint samples, over DDS and without ROS."""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Sequence
from typing import Any, get_args

from bumpstop.errors import InputError
from bumpstop.live.answer import Answer
from bumpstop.live.dds.joint_states import DamagedStateError, Effort, ForeignStateError, JointStateReader
from bumpstop.live.dds.participant import (
    domain_of,
    import_cyclonedds,
    make_topic,
    on_loopback_only,
    participant,
    topic_name,
)
from bumpstop.live.event_limiter import EventLimiter
from bumpstop.live.sample import JointSample
from bumpstop.live.source import Source, SourceEvent, SourceEventKind

JOINT_STATE = "sensor_msgs::msg::dds_::JointState_"
# Messages that wait in the reader while nobody reads.
_MAX_WAITING = 4096
_MAX_AT_ONCE = 256
# After the first sample so long for a second writer to show itself.
_SECOND_WRITER_S = 0.3


class DdsSource(Source):
    """Samples of a topic of ``sensor_msgs/msg/JointState``.

    The reader takes what any writer offers: best-effort and volatile. One writer is read, the first whose states have
    all joints; another that has them, too, is named and left out. A writer that went away is waited for. One that was
    killed is on the list of writers for some seconds more: another with the joints is read once it has been silent.

    Args:
        topic: ``/joint_states``, ``joint_states`` or ``rt/joint_states``.
        joints: names of the robot's joints, in its order.
        effort: what the states carry as effort: ``"current"`` or ``"torque"``.
        domain: of DDS; None: that of ``ROS_DOMAIN_ID``, else 0.
        wait_s: for the first sample [s].
        stop_after_s: once the writer that is read was silent for longer, another is read in its place [s].
        loopback: stay on this machine; None: as ``ROS_LOCALHOST_ONLY`` says.
        answers: whether :meth:`answer` will be called.

    Raises:
        InputError: something cannot be used.
    """

    def __init__(
        self,
        topic: str,
        joints: Sequence[str],
        *,
        effort: Effort = "torque",
        domain: int | None = None,
        wait_s: float = 5.0,
        stop_after_s: float = 0.1,
        loopback: bool | None = None,
        answers: bool = False,
    ) -> None:
        if effort not in get_args(Effort):
            raise InputError("effort", f"is {effort!r}", f"valid: {', '.join(get_args(Effort))}")
        self._topic, self._domain, self._wait = topic_name(topic), domain_of(domain), wait_s
        self._stop_after = stop_after_s
        self._joints = tuple(joints)
        self._loopback = on_loopback_only() if loopback is None else loopback
        self._states = JointStateReader(joints, effort)
        self._limiter = EventLimiter()
        self._queue: deque[JointSample | SourceEvent] = deque()
        self._participant: Any = None
        self._reader: Any = None
        self._waiting: Any = None
        self._will_answer, self._answers = answers, None  # type: bool, Any
        self._writer: int | None = None
        # When the writer that is read was heard last.
        self._heard_s = -math.inf
        self._opening = self._lost = False

    @property
    def name(self) -> str:
        """``dds://TOPIC``."""
        return f"dds://{self._topic}"

    def open(self) -> None:
        """Join the domain and wait for the first sample.

        Raises:
            InputError: nobody writes the topic, it is of another type, its states have not got the joints, or two
                writers have them.
        """
        if self._reader is not None:
            return
        import_cyclonedds()
        from cyclonedds.core import InstanceState, Policy, Qos, ReadCondition, SampleState, ViewState, WaitSet
        from cyclonedds.sub import DataReader

        from bumpstop.live.dds.publishers import ANSWER_TOPIC, writer
        from bumpstop.live.dds.types import JointState, String

        self._participant = participant(self._domain, loopback=self._loopback)
        states = make_topic(self._participant, self._topic, JointState)
        every = Policy.History.KeepLast(_MAX_WAITING)
        qos = Qos(Policy.Reliability.BestEffort, Policy.Durability.Volatile, every)
        self._reader = DataReader(self._participant, states, qos=qos)
        self._waiting = WaitSet(self._participant)
        self._waiting.attach(ReadCondition(self._reader, SampleState.Any | ViewState.Any | InstanceState.Any))
        if self._will_answer:
            # Now, so that readers have found it when an answer is due.
            self._answers = writer(self._participant, ANSWER_TOPIC, String)
        self._opening = True
        try:
            self._await_first()
        except BaseException:
            self.close()
            raise
        finally:
            self._opening = False

    def _await_first(self) -> None:
        end, second = time.monotonic() + self._wait, None
        last: SourceEvent | None = None
        while second is None or time.monotonic() < second:
            left = (end if second is None else second) - time.monotonic()
            if left <= 0:
                raise self._nothing_there(last)
            known = len(self._queue)
            self._receive(min(left, 0.1))
            for item in list(self._queue)[known:]:
                if isinstance(item, SourceEvent):
                    last = item
                    if item.kind is SourceEventKind.FOREIGN and "second writer" in item.text:
                        raise InputError(self.name, "two writers publish these joints", "end one of them")
                elif second is None:
                    second = time.monotonic() + _SECOND_WRITER_S

    def _nothing_there(self, last: SourceEvent | None) -> InputError:
        """Why no sample has come."""
        if last is not None:
            valid = f"wanted {', '.join(self._joints)}"
            return InputError(self.name, f"no usable joint state within {self._wait:g} s: {last.text}", valid)
        types = self._types_on_topic()
        if types - {JOINT_STATE}:
            found = ", ".join(sorted(types - {JOINT_STATE}))
            return InputError(self.name, f"the topic carries {found}", f"wanted {JOINT_STATE}")
        if types or self._reader.get_matched_publications():
            return InputError(self.name, f"a writer is there, and nothing came within {self._wait:g} s")
        problem = f"nobody writes it in domain {self._domain} within {self._wait:g} s"
        return InputError(self.name, problem, "check the topic, ROS_DOMAIN_ID and ROS_LOCALHOST_ONLY")

    def _types_on_topic(self) -> set[str]:
        from cyclonedds.builtin import BuiltinDataReader, BuiltinTopicDcpsPublication

        found = BuiltinDataReader(self._participant, BuiltinTopicDcpsPublication).read(N=1000)
        return {one.type_name for one in found if getattr(one, "topic_name", None) == self._topic}

    def read(self, timeout_s: float) -> JointSample | SourceEvent | None:
        """The next sample or event; None: neither within the time [s]."""
        if not self._queue:
            self._receive(max(0.0, timeout_s))
        if not self._queue:
            self._queue.extend(self._limiter.due(time.monotonic()))
        return self._queue.popleft() if self._queue else None

    def _receive(self, timeout_s: float) -> None:
        if not self._waiting.wait(max(1, int(timeout_s * 1e9))):
            self._writer_changed()
            return
        now = time.monotonic()
        messages = self._taken(now)
        # Nobody was silent whose messages only waited here.
        if any(one.sample_info.valid_data and one.sample_info.publication_handle == self._writer for one in messages):
            self._heard_s = now
        for message in messages:
            self._take(message, now)
        self._queue.extend(self._limiter.due(now))

    def _taken(self, now_s: float) -> list[Any]:
        """Messages that wait, not too many at once."""
        found: list[Any] = []
        for _ in range(_MAX_AT_ONCE):
            try:
                # One by one: what cannot be read must not take its neighbours away.
                taken = self._reader.take(1)
            except Exception as error:
                self._tell(SourceEventKind.DAMAGED, f"a message that cannot be read ({type(error).__name__})", now_s)
                continue
            if not taken:
                break
            found += taken
        return found

    def _take(self, message: Any, now_s: float) -> None:
        info = message.sample_info
        if not info.valid_data:
            self._writer_changed()
            return
        self.take_state(message, info.publication_handle, now_s)

    def take_state(self, message: Any, writer: int, now_s: float) -> None:
        """Take a joint state as if it had come from the network.

        Args:
            message: ``sensor_msgs/msg/JointState``.
            writer: handle of who wrote it.
            now_s: ``time.monotonic()`` [s].
        """
        try:
            sample = self._states.sample(message, now_s)
        except ForeignStateError as error:
            self._tell(SourceEventKind.FOREIGN, f"a joint state {error}", now_s)
            return
        except DamagedStateError as error:
            self._tell(SourceEventKind.DAMAGED, f"a joint state {error}", now_s)
            return
        if self._writer is None:
            self._writer = writer
            if self._lost:
                self._lost = False
                self._queue.append(SourceEvent(SourceEventKind.RESTARTED, f"{self.name}: a writer is there again"))
        elif writer != self._writer:
            self._writer_changed()
            silent_s = now_s - self._heard_s
            if self._writer is not None and (self._opening or silent_s <= self._stop_after):
                self._tell(SourceEventKind.FOREIGN, "a second writer has the same joints; it is left out", now_s)
                return
            if self._writer is None:
                self.take_state(message, writer, now_s)
                return
            self._writer = writer
            text = f"{self.name}: its writer was silent for {silent_s:.3g} s; another with the same joints is read"
            self._queue.append(SourceEvent(SourceEventKind.RESTARTED, text))
        self._heard_s = now_s
        self._queue.append(sample)

    def _writer_changed(self) -> None:
        """See whether the writer that is read has gone."""
        # The one list has handles with a sign, the other without.
        present = {handle % 2**64 for handle in self._reader.get_matched_publications()}
        if self._writer is None or self._writer % 2**64 in present:
            return
        self._writer, self._lost = None, True
        self._queue.append(SourceEvent(SourceEventKind.STOPPED, f"{self.name}: its writer went away; waiting for one"))

    def _tell(self, kind: SourceEventKind, text: str, now_s: float) -> None:
        event = self._limiter.add(kind, f"{self.name}: {text}", now_s)
        if event is not None:
            self._queue.append(event)

    def answer(self, answer: Answer, number: int) -> None:
        """Publish an answer, ``"stop"`` or ``"reverse"``, as ``std_msgs/msg/String`` on ``/bumpstop/answer``.

        Args:
            answer: what the arm shall do; ``"none"`` is not published.
            number: of the alarm, which this topic does not carry.
        """
        if answer != "none" and self._answers is not None:
            from cyclonedds.core import DDSException

            from bumpstop.live.dds.types import String

            try:
                self._answers.write(String(answer))
            except DDSException as error:
                self._tell(
                    SourceEventKind.DAMAGED, f"the answer {answer!r} was not sent: {error.msg}", time.monotonic()
                )

    def close(self) -> None:
        """Leave the domain; may be called twice, and without :meth:`open`."""
        self._answers = self._waiting = self._reader = self._participant = None
