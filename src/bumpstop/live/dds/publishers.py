"""Writers of what the monitor and the test bench say."""

from __future__ import annotations

from typing import Any

from bumpstop.live.dds.participant import make_topic

# `/bumpstop/answer`: std_msgs/msg/String, "stop" or "reverse".
ANSWER_TOPIC = "rt/bumpstop/answer"
_KEPT = 16


def writer(participant: Any, name: str, kind: Any) -> Any:
    """A writer that any reader of ROS 2 takes: reliable, in the older encoding, and one that never waits.

    Args:
        participant: of the domain.
        name: DDS name of the topic.
        kind: class of its messages.
    """
    from cyclonedds.core import Policy, Qos
    from cyclonedds.pub import DataWriter

    qos = Qos(
        Policy.Reliability.Reliable(0),
        Policy.Durability.Volatile,
        Policy.History.KeepLast(_KEPT),
        Policy.DataRepresentation(use_cdrv0_representation=True),
    )
    return DataWriter(participant, make_topic(participant, name, kind), qos=qos)
