"""Joints of a robot on a rail over RTDE: the rail is joint 1, and travels in registers."""

from __future__ import annotations

import math
import threading
import time
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from bumpstop.detection import Detector, DetectorSettings, save_detector
from bumpstop.errors import InputError
from bumpstop.live import JointSample
from bumpstop.live.bench import RtdeLink
from bumpstop.live.loaded_detector import LoadedDetector
from bumpstop.live.monitor import Monitor, MonitorSettings
from bumpstop.live.rtde import RtdeServer, RtdeSource
from bumpstop.live.rtde.source import output_fields
from bumpstop.live.sources.names import source_of
from bumpstop.model import Joint, LinkInertia
from detection.moving_arms import UR5E, moving
from live.cases import DT, THRESHOLD_NM, Heard

CARRIAGE = LinkInertia(mass=20.0, center=(0.0, 0.0, 0.0), tensor=((0.3, 0, 0), (0, 0.3, 0), (0, 0, 0.3)))
RAIL = Joint(name="rail", link="carriage", kind="prismatic", axis=(0.0, 1.0, 0.0), inertia=CARRIAGE)
RAILED = replace(UR5E, joints=(RAIL, *UR5E.joints), frames=(), drive_train_entries=())
# The rail is joint 1; the controller's six come first.
ORDER = [1, 2, 3, 4, 5, 6, 0]


def railed(folder: Path, *, measured_rates: bool = False) -> LoadedDetector:
    settings = DetectorSettings(period_s=DT, window_s=0.02, arming_delay_s=0.0, measured_rates=measured_rates)
    save_detector(Detector(RAILED, None, np.full(7, THRESHOLD_NM), settings), folder / "rail.detector")
    return LoadedDetector.load(folder / "rail.detector")


def test_an_arm_on_a_rail_is_monitored(tmp_path: Path) -> None:
    """Its motion without contact is no collision, and every residual is that of the joint's own torque."""
    detector = railed(tmp_path)
    t, q, _, _, tau = moving(RAILED, 250, DT, pace=0.4)
    server = RtdeServer(output_fields(7, "torque"), 1 / DT, port=0)

    def serve() -> None:
        server.wait_for_client(20.0)
        for row in range(t.size):
            position, torque = tuple(q[row, ORDER].tolist()), tuple(tau[row, ORDER].tolist())
            values: dict[str, Any] = {"timestamp": float(t[row]), "actual_q": position[:6], "actual_qd": (0.0,) * 6}
            values |= {"actual_current_as_torque": torque[:6]}
            values |= {"output_double_register_24": position[6], "output_double_register_25": torque[6]}
            server.publish(values)
            time.sleep(0.001)

    thread, heard = threading.Thread(target=serve), Heard()
    thread.start()
    address = f"rtde://127.0.0.1:{server.port}?axes=2,3,4,5,6,7"
    with source_of(address, detector) as source:
        summary = Monitor(detector, source, [heard], MonitorSettings(duration_s=2.0, speed=math.inf)).run()
    thread.join()
    server.close()
    assert summary.alarms == 0
    assert summary.judged > 200
    np.testing.assert_array_equal([tick.sample.position_rad for tick in heard.ticks], q)
    np.testing.assert_array_equal([tick.sample.torque_Nm for tick in heard.ticks], tau)


def test_the_bench_serves_the_joints_as_they_are_read() -> None:
    sample: Any = SimpleNamespace(q=np.arange(8.0), qd=np.zeros(8), current=10 + np.arange(8.0))
    kinds = ("prismatic", *["revolute"] * 6, "prismatic")
    joints = tuple(SimpleNamespace(name=f"j{k}", kind=kind) for k, kind in enumerate(kinds, 1))
    plant: Any = SimpleNamespace(
        robot=SimpleNamespace(dof=8, joints=joints, name="on a rail"),
        joint_model=None,
        sensors=SimpleNamespace(rate_hz=500.0),
    )
    with pytest.raises(InputError, match="axes: joint 1, j1, slides, and all six of a controller turn"):
        RtdeLink(plant, 0)
    axes = (2, 3, 4, 5, 6, 7)
    link = RtdeLink(plant, 0, axes)
    port = int(link.address.rpartition(":")[2])
    for signal in ("current", "torque"):
        with RtdeSource("127.0.0.1", port, joints=8, axes=axes, signal=signal) as source:  # type: ignore[arg-type]
            link.publish(sample, 1.0)
            found = source.read(1.0)
        assert isinstance(found, JointSample)
        np.testing.assert_array_equal(found.position_rad, sample.q)
        np.testing.assert_array_equal(found.current_A if signal == "current" else found.torque_Nm, sample.current)
    link.close()


def test_joints_of_the_controller_that_cannot_be(tmp_path: Path) -> None:
    detector = railed(tmp_path)
    with pytest.raises(InputError, match=r"axes: joint 1, rail, slides, and all six .* such as 2,3,4,5,6,7"):
        source_of("rtde://10.0.0.2", detector)
    for axes in ("1,2,3", "2,3,4,5,6,8", "3,2,4,5,6,7", "2,2,3,4,5,6", "0,1,2,3,4,5"):
        with pytest.raises(InputError, match=f"axes: is {axes}; wanted six rising numbers from 1 to 7"):
            source_of(f"rtde://10.0.0.2?axes={axes}", detector)
    with pytest.raises(InputError, match="axes: is '2,a'; wanted six numbers of joints"):
        source_of("rtde://10.0.0.2?axes=2,a", detector)
    without = railed(tmp_path, measured_rates=True)
    with pytest.raises(InputError, match="has no speeds of the joints in registers; the detector takes measured ones"):
        source_of("rtde://10.0.0.2?axes=2,3,4,5,6,7", without)
