"""Running arms: samples from recordings, networks and the simulated robot, and the monitor that judges them."""

from bumpstop.live.output import CollisionAlarm, DataLoss, MonitorTick, Output
from bumpstop.live.sample import JointSample
from bumpstop.live.source import Source, SourceEvent, SourceEventKind

__all__ = [
    "CollisionAlarm",
    "DataLoss",
    "JointSample",
    "MonitorTick",
    "Output",
    "Source",
    "SourceEvent",
    "SourceEventKind",
]
