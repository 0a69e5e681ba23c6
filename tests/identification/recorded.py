"""The positions of real arms as motions, for currents of known drives on top of them."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

import bumpstop as bs
from bumpstop.identification.segments.drive_samples import slope
from bumpstop.recording import Recording
from bumpstop.signal import zero_phase_lowpass
from identification.drives import Motion

SHARED = Path(os.environ.get("BUMPSTOP_SHARED", Path(__file__).resolve().parents[3] / "shared")) / "data"
TX40_COLUMNS = {
    "header": True,
    "time": {"rate_hz": 5000},
    "position": {"columns": [f"Joint_{j}" for j in range(1, 7)]},
    "torque": {"columns": [f"Joint_{j}" for j in range(1, 7)], "side": "motor", "file": "curr_data.csv"},
    "coupling": {
        "ratio": [
            [32, 0, 0, 0, 0, 0],
            [0, 32, 0, 0, 0, 0],
            [0, 0, 45, 0, 0, 0],
            [0, 0, 0, -48, 0, 0],
            [0, 0, 0, 0, 45, 0],
            [0, 0, 0, 0, 32, 32],
        ],
        "offset_rad": [0, -np.pi / 2, np.pi / 2, 0, 0, 0],
    },
}
FILES = {
    "ur10": "ur10_ros2/ur10_exciting_trajectory.db3",
    "panda": "panda_ros2/panda_exciting_trajectory.db3",
    "tx40": "staubli_tx40/pos_read_data.csv",
}


def there(name: str) -> bool:
    """Whether the recording is beside the repository."""
    return (SHARED / FILES[name]).exists()


def arm_and_motion(name: str) -> tuple[bs.Robot, Motion]:
    """A real arm and its motion, smoothed below 5 Hz so that its rates and accelerations are known: t, q, qd, qdd."""
    if name == "tx40":
        robot = bs.Robot.from_urdf(SHARED / "staubli_tx40" / "tx40_mdh_modified.urdf")
        log = Recording.load(SHARED / FILES[name], columns=TX40_COLUMNS, robot=robot)
        log = log.between(float(log.t[0]), float(log.t[0]) + 7.0)
    else:
        robot = bs.Robot.load(name)
        log = Recording.load(SHARED / FILES[name])
    rate = min(log.rate_hz, 250.0)
    t = np.arange(log.t[0], log.t[-1], 1 / rate)
    smooth = zero_phase_lowpass(log.t, log.q, 5.0)
    q = np.stack([np.interp(t, log.t, smooth[:, j]) for j in range(robot.dof)], axis=1)
    q = zero_phase_lowpass(t, q, 5.0)
    qd = slope(q, rate)
    return robot, (t, q, qd, slope(qd, rate))
