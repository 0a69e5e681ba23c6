"""A test bench for monitors: the plant in real time behind the protocols that robots speak, answering as they would."""

from bumpstop.live.bench.bench import BenchRun, PlantBench
from bumpstop.live.bench.dds_link import DdsLink
from bumpstop.live.bench.link import BenchLink, LinkAnswer
from bumpstop.live.bench.rtde_link import RtdeLink

__all__ = ["BenchLink", "BenchRun", "DdsLink", "LinkAnswer", "PlantBench", "RtdeLink"]
