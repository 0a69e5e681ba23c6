"""What a monitor sees, as topics of ROS 2."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

from bumpstop.live.dds.participant import domain_of, on_loopback_only, participant, topic_name
from bumpstop.live.dds.publishers import writer

if TYPE_CHECKING:
    from bumpstop.live.output import CollisionAlarm, DataLoss, MonitorTick
    from bumpstop.live.source import SourceEvent


class DdsOutput:
    """Publishes residuals, alarms and wrenches.

    Of every sample ``/bumpstop/residual`` has the residual as the efforts of a ``sensor_msgs/msg/JointState`` (NaN
    without data) [Nm or N], ``/bumpstop/state`` the state as a ``std_msgs/msg/String``, and ``/bumpstop/alarm`` a
    ``std_msgs/msg/Bool`` that says whether an alarm stands. At an alarm ``/bumpstop/wrench`` has the estimated
    force of the contact as a ``geometry_msgs/msg/WrenchStamped`` (NaN where unknown, as all torques are) [N].

    Args:
        joints: names of the robot's joints.
        frame: name of the base frame, in which forces are.
        prefix: of the topics.
        domain: of DDS; None: that of ``ROS_DOMAIN_ID``, else 0.
        loopback: stay on this machine; None: as ``ROS_LOCALHOST_ONLY`` says.

    Raises:
        InputError: no prefix, no such domain, or cyclonedds is not installed.
    """

    def __init__(
        self,
        joints: Sequence[str],
        *,
        frame: str = "base",
        prefix: str = "/bumpstop",
        domain: int | None = None,
        loopback: bool | None = None,
    ) -> None:
        base = topic_name(prefix)
        joined = participant(domain_of(domain), loopback=on_loopback_only() if loopback is None else loopback)
        from bumpstop.live.dds import types

        self._types: Any = types
        self._joints, self._frame = list(joints), frame
        kinds = {
            "residual": types.JointState,
            "state": types.String,
            "alarm": types.Bool,
            "wrench": types.WrenchStamped,
        }
        self._writers: dict[str, Any] = {name: writer(joined, f"{base}/{name}", kind) for name, kind in kinds.items()}
        self._participant: Any = joined
        self._failed: dict[str, int] = {}

    def alarm(self, alarm: CollisionAlarm) -> None:
        """Publish the force of a collision, and the alarm."""
        types = self._types
        force = [float(x) for x in alarm.event.force]
        found = types.Vector3(*(force if len(force) == 3 else [math.nan] * 3))
        unknown = types.Vector3(math.nan, math.nan, math.nan)
        self._write("alarm", types.Bool(True))
        self._write(
            "wrench", types.WrenchStamped(types.header(alarm.stamp_s, self._frame), types.Wrench(found, unknown))
        )

    def tick(self, tick: MonitorTick) -> None:
        """Publish a judged sample."""
        types = self._types
        head = types.header(tick.sample.stamp_s, self._frame)
        self._write("residual", types.JointState(head, self._joints, [], [], tick.residual.tolist()))
        self._write("state", types.String(tick.state))
        self._write("alarm", types.Bool(tick.alarm))

    def data_loss(self, loss: DataLoss) -> None:
        """Publish the state, and whether an alarm stands."""
        self._write("state", self._types.String(loss.state))
        self._write("alarm", self._types.Bool(loss.alarm))

    def source_event(self, event: SourceEvent, received_s: float) -> None:
        """Nothing to publish."""

    def flush(self, now_s: float) -> None:
        """Nothing is held back."""

    def problems(self) -> list[str]:
        """Sentences about what could not be published since the last call."""
        found = [f"{count} messages of {name} could not be published" for name, count in self._failed.items()]
        self._failed.clear()
        return found

    def close(self) -> None:
        """Leave the domain; may be called twice."""
        self._writers.clear()
        self._participant = None

    def _write(self, name: str, message: Any) -> None:
        try:
            self._writers[name].write(message)
        except Exception:  # whatever the network does, the monitor goes on
            self._failed[name] = self._failed.get(name, 0) + 1
