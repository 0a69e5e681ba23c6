"""The plant as a publisher of joint states over DDS."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any, Literal, cast

from bumpstop.live.bench.link import LinkAnswer
from bumpstop.live.dds.participant import domain_of, make_topic, participant, topic_name
from bumpstop.live.dds.publishers import ANSWER_TOPIC, writer

if TYPE_CHECKING:
    from bumpstop.plant import Plant, Sample

# A reader keeps nothing of what was written before it knew the writer, and may learn of it later than the writer of the
# reader.
_SETTLE_S = 1.0


class DdsLink:
    """Publishes a plant's samples as ``sensor_msgs/msg/JointState``; the currents are its efforts.

    Args:
        plant: whose joints are published.
        topic: ``/joint_states``.
        domain: of DDS; None: that of ``ROS_DOMAIN_ID``, else 0.
        loopback: stay on this machine.

    Raises:
        InputError: no topic, no such domain, or cyclonedds is not installed.
    """

    def __init__(self, plant: Plant, topic: str, *, domain: int | None = None, loopback: bool = True) -> None:
        self._topic = topic_name(topic)
        self._participant: Any = participant(domain_of(domain), loopback=loopback)
        from cyclonedds.core import Policy, Qos
        from cyclonedds.sub import DataReader

        from bumpstop.live.dds.types import JointState, String

        self._found_s: float | None = None
        self._names = [joint.name for joint in plant.robot.joints]
        self._writer: Any = writer(self._participant, self._topic, JointState)
        qos = Qos(Policy.Reliability.Reliable(0), Policy.History.KeepLast(16))
        self._reader: Any = DataReader(self._participant, make_topic(self._participant, ANSWER_TOPIC, String), qos=qos)

    @property
    def address(self) -> str:
        """``dds://TOPIC``."""
        return f"dds://{self._topic}"

    def wait_for_client(self, timeout_s: float) -> bool:
        """Whether a reader has found the topic, and has had time to see its writer, within the time [s]."""
        end = time.monotonic() + timeout_s
        while True:
            if not self._writer.get_matched_subscriptions():
                self._found_s = None
            elif self._found_s is None:
                self._found_s = time.monotonic()
            elif time.monotonic() - self._found_s >= _SETTLE_S:
                return True
            if time.monotonic() >= end:
                return False
            time.sleep(0.01)

    def publish(self, sample: Sample, stamp_s: float) -> None:
        """Send a sample of the plant, with its time by the bench's clock [s]."""
        from bumpstop.live.dds.types import JointState, header

        q, qd, current = sample.q.tolist(), sample.qd.tolist(), sample.current.tolist()
        self._writer.write(JointState(header(stamp_s), self._names, q, qd, current))

    def answer(self) -> LinkAnswer | None:
        """The answer that came since the last call; None: none."""
        found = None
        for message in self._reader.take(16):
            if message.sample_info.valid_data and message.data in ("stop", "reverse") and found is None:
                # The writer's clock: both are of one machine on the loopback.
                ago = 1e-9 * (time.time_ns() - message.sample_info.source_timestamp)
                found = LinkAnswer(cast(Literal["stop", "reverse"], message.data), time.monotonic() - max(0.0, ago))
        return found

    def close(self) -> None:
        """Leave the domain; may be called twice."""
        self._reader = self._writer = self._participant = None
