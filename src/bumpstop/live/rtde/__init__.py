"""Universal Robots' Real-Time Data Exchange: the protocol, a source of samples and a server for the test bench."""

from bumpstop.live.rtde.server import RtdeServer
from bumpstop.live.rtde.source import RtdeSource

__all__ = ["RtdeServer", "RtdeSource"]
