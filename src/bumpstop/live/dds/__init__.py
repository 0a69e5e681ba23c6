"""DDS as ROS 2 uses it: joint states in, residuals, alarms and wrenches out, without ROS."""

from bumpstop.live.dds.output import DdsOutput
from bumpstop.live.dds.source import DdsSource

__all__ = ["DdsOutput", "DdsSource"]
