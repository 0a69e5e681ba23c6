"""Messages of ROS 2 that travel here, as DDS sees them: package ``sensor_msgs`` and what it is made of.

The module must not postpone annotations: cyclonedds reads them as types.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

from cyclonedds.idl import IdlStruct
from cyclonedds.idl.annotations import final
from cyclonedds.idl.types import float64, int32, uint32

if TYPE_CHECKING:
    from builtins import list as sequence  # as cyclonedds' own says nothing of what is in it
else:
    from cyclonedds.idl.types import sequence


@dataclass
@final
class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
    """``builtin_interfaces/msg/Time``."""

    sec: int32
    nanosec: uint32


@dataclass
@final
class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
    """``std_msgs/msg/Header``."""

    stamp: Time
    frame_id: str


@dataclass
@final
class JointState(IdlStruct, typename="sensor_msgs::msg::dds_::JointState_"):
    """``sensor_msgs/msg/JointState``."""

    header: Header
    name: sequence[str]
    position: sequence[float64]
    velocity: sequence[float64]
    effort: sequence[float64]


@dataclass
@final
class Bool(IdlStruct, typename="std_msgs::msg::dds_::Bool_"):
    """``std_msgs/msg/Bool``."""

    data: bool


@dataclass
@final
class String(IdlStruct, typename="std_msgs::msg::dds_::String_"):
    """``std_msgs/msg/String``."""

    data: str


@dataclass
@final
class Vector3(IdlStruct, typename="geometry_msgs::msg::dds_::Vector3_"):
    """``geometry_msgs/msg/Vector3``."""

    x: float64
    y: float64
    z: float64


@dataclass
@final
class Wrench(IdlStruct, typename="geometry_msgs::msg::dds_::Wrench_"):
    """``geometry_msgs/msg/Wrench``."""

    force: Vector3
    torque: Vector3


@dataclass
@final
class WrenchStamped(IdlStruct, typename="geometry_msgs::msg::dds_::WrenchStamped_"):
    """``geometry_msgs/msg/WrenchStamped``."""

    header: Header
    wrench: Wrench


_NANOSECONDS = 1_000_000_000


def header(stamp_s: float, frame: str = "") -> Header:
    """A header with a time [s]; one that a header cannot hold is 0."""
    whole = round(stamp_s * _NANOSECONDS) if abs(stamp_s) < 2**31 - 1 else 0
    return Header(Time(whole // _NANOSECONDS, whole % _NANOSECONDS), frame)


def seconds(stamp: Time) -> float:
    """A time as a number [s]."""
    return stamp.sec + stamp.nanosec / _NANOSECONDS
