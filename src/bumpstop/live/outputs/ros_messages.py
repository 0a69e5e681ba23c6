"""The messages of a monitor's MCAP files: ROS 2 messages with their definitions; no ROS is needed to read them.

Residuals and thresholds are joint states whose effort they are: every tool that plots those by joint plots these.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.detection.detection_run import STATES
from bumpstop.recording.formats.joint_state import messages

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.arrays import FloatArray
    from bumpstop.live.output import CollisionAlarm, DataLoss, MonitorTick
    from bumpstop.live.source import SourceEvent

JOINT_STATE = "sensor_msgs/msg/JointState"
STATE, ALARM, SOURCE = "bumpstop_msgs/msg/State", "bumpstop_msgs/msg/Alarm", "bumpstop_msgs/msg/SourceEvent"
TOPICS = {
    "/joint_states": JOINT_STATE,
    "/bumpstop/residual": JOINT_STATE,
    "/bumpstop/threshold": JOINT_STATE,
    "/bumpstop/state": STATE,
    "/bumpstop/alarm": ALARM,
    "/bumpstop/source": SOURCE,
}
DEFINITIONS = {
    STATE: """\
# state: 0 no_data, 1 arming, 2 monitoring, 3 alarm
builtin_interfaces/Time stamp
uint8 state
string name
string fault
bool stop
""",
    ALARM: """\
# torques in Nm (N of joints that slide), forces in N; NaN where there is none; fast: of the band-pass channel
builtin_interfaces/Time stamp
uint32 number
float64 latency_s
string[] joints
float64[] residual
float64[] threshold
string[] fast_joints
float64[] fast
float64[] fast_threshold
float64 force
float64 force_low
float64 force_high
float64[3] best_force
float64[3] best_force_sd
string link
string[] possible_links
""",
    SOURCE: """\
string event
string text
uint32 count
""",
}
# Seconds are 32 bits with a sign, and rounding to nanoseconds may add one.
_MAX_STAMP_S = 2.0**31 - 1


class RosMessages:
    """Serialised messages (CDR) of one robot.

    Args:
        joints: names.
    """

    def __init__(self, joints: tuple[str, ...]) -> None:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self._joints = joints
        self._templates: dict[tuple[bool, bool], bytes] = {}
        self._store = get_typestore(Stores.ROS2_HUMBLE)
        for name, text in DEFINITIONS.items():
            self._store.register(get_types_from_msg(text, name))
        # Code is made for each message, which takes a tenth of a second: not while samples come.
        for kind in set(TOPICS.values()):
            self._store.get_msgdef(kind)
        for position, velocity in ((False, False), (True, False), (True, True)):
            self._template(position=position, velocity=velocity)

    def definition(self, kind: str) -> str:
        """Of a message, with those that it is made of, in the form of ROS 2."""
        text, _ = self._store.generate_msgdef(kind)
        return str(text)

    def _template(self, *, position: bool, velocity: bool) -> bytes:
        """A joint state of these joints, whose numbers are filled in later."""
        known = self._templates.get((position, velocity))
        if known is None:
            nothing, none = np.zeros(len(self._joints)), np.zeros(0)
            header = self._store.types["std_msgs/msg/Header"](stamp=self._time(0.0), frame_id="")
            known = self._templates[position, velocity] = self._cdr(
                JOINT_STATE,
                header=header,
                name=list(self._joints),
                position=nothing if position else none,
                velocity=nothing if velocity else none,
                effort=nothing,
            )
        return known

    def _time(self, stamp_s: float) -> Any:
        usable = stamp_s if abs(stamp_s) < _MAX_STAMP_S else 0.0
        sec, nanosec = divmod(round(usable * 1e9), 1_000_000_000)
        return self._store.types["builtin_interfaces/msg/Time"](sec=sec, nanosec=nanosec)

    def _cdr(self, kind: str, **fields: Any) -> bytes:
        return bytes(self._store.serialize_cdr(self._store.types[kind](**fields), kind))

    def joint_states(
        self, stamps: FloatArray, position: FloatArray | None, velocity: FloatArray | None, effort: FloatArray
    ) -> list[bytes]:
        """One of each row (N, n); stamps (N,) that ROS cannot write are zero."""
        template = self._template(position=position is not None, velocity=velocity is not None)
        return [row.tobytes() for row in messages(template, _whole(stamps), (position, velocity, effort))]

    def efforts(self, stamps: FloatArray, effort: FloatArray) -> list[bytes]:
        """The same with efforts alone."""
        return self.joint_states(stamps, None, None, effort)

    def state(self, told: MonitorTick | DataLoss) -> bytes:
        """What the detector says of a sample, or that none comes; its stamp is then zero."""
        return self._cdr(
            STATE,
            stamp=self._time(told.stamp_s),
            state=STATES.index(told.state),
            name=told.state,
            fault=told.fault,
            stop=told.stop,
        )

    def alarm(self, alarm: CollisionAlarm) -> bytes:
        """A collision."""
        event = alarm.event
        told = math.isfinite(event.force_along_sd)
        low, high = event.force_interval if told else (math.nan, math.nan)
        return self._cdr(
            ALARM,
            stamp=self._time(alarm.stamp_s),
            number=alarm.number,
            latency_s=alarm.latency_s,
            joints=[self._joints[j] for j in sorted({*event.joints, *event.fast_joints})],
            residual=event.residual,
            threshold=event.threshold,
            fast_joints=[self._joints[j] for j in event.fast_joints],
            fast=alarm.fast,
            fast_threshold=alarm.fast_threshold,
            force=event.force_along if told else math.nan,
            force_low=low,
            force_high=high,
            best_force=event.force,
            best_force_sd=event.force_sd,
            link=event.link or "",
            possible_links=list(event.possible_links),
        )

    def source_event(self, event: SourceEvent) -> bytes:
        """Something that happened to the source."""
        return self._cdr(SOURCE, event=str(event.kind), text=event.text, count=min(event.count, 2**32 - 1))


def usable_rows(ticks: Sequence[MonitorTick], dof: int, *, current: bool) -> list[MonitorTick]:
    """Those whose samples are of this robot's joints: a joint state can say them."""
    found = []
    for tick in ticks:
        effort = tick.sample.current_A if current else tick.sample.torque_Nm
        if np.shape(tick.sample.position_rad) == (dof,) and effort is not None and np.shape(effort) == (dof,):
            found.append(tick)
    return found


def _whole(stamps: FloatArray) -> Any:
    usable = np.isfinite(stamps) & (np.abs(stamps) < _MAX_STAMP_S)
    return np.round(np.where(usable, stamps, 0.0) * 1e9).astype(np.int64)
