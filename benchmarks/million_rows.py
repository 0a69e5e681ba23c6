"""A recording of 10^6 rows and seven joints: read, differentiated and fitted by the command line."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from bumpstop.model import Robot, inverse_dynamics
from bumpstop.recording import Recording

ROWS, RATE = 1_000_000, 1000.0
GAINS = (20.0, 20.0, 15.0, 10.0, 8.0, 8.0, 5.0)  # Nm for each unit of current
LIMIT_S = 10.0
LIMIT_GB = 1.0


def recorded(*, torques: bool = False) -> Recording:
    """The SIA5D swinging for a quarter of an hour, with a linear map, Coulomb and viscous friction and noise.

    ``torques``: the torques of the motors were recorded, not their currents.
    """
    robot = Robot.load("sia5d")
    rng = np.random.default_rng(4)
    t = np.arange(ROWS) / RATE
    q, qd, qdd = np.zeros((3, ROWS, robot.dof))
    for j in range(robot.dof):
        for wave in range(1, 6):
            w, size, phase = 2 * np.pi * 0.1 * wave * (1 + 0.013 * j), 0.25 * rng.normal(), 2 * np.pi * rng.random()
            sine, cosine = np.sin(w * t + phase), np.cos(w * t + phase)
            q[:, j] += size * sine
            qd[:, j] += size * w * cosine
            qdd[:, j] -= size * w * w * sine
    current = inverse_dynamics(robot, q, qd, qdd) / GAINS + 0.8 * np.tanh(qd / 0.01) + 0.3 * qd + 0.05 * qdd
    current += 0.05 * rng.normal(size=q.shape)
    names = tuple(joint.name for joint in robot.joints)
    measured = {"tau": current * GAINS} if torques else {"current": current}
    return Recording(t=t, q=q + 1e-5 * rng.normal(size=q.shape), **measured, joint_names=names, robot=robot.name)


def million_rows(row: Callable[..., None]) -> None:
    """Print time, work of the cores and memory of ``bumpstop identify``, start of the interpreter included."""
    row("", "measured", "target", None)
    for model, kind, *settings in (
        ("joint", "parquet"),
        ("joint", "csv"),
        ("dynamics", "parquet"),
        ("dynamics", "parquet", "--cutoff", "60"),
        ("dynamics", "csv"),
    ):
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / f"log.{kind}"
            recorded(torques=model == "dynamics").save(path)
            command = [sys.executable, "-c", "from bumpstop.cli.main import main; main()", "identify", str(path)]
            command += ["--robot", "sia5d", "--model", model, *settings, "-o", str(Path(folder) / "model.toml")]
            begin = time.perf_counter()
            child = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
            _, status, used = os.wait4(child.pid, 0)
            took = time.perf_counter() - begin
            child.returncode = os.waitstatus_to_exitcode(status)
            ok = took < LIMIT_S and child.returncode == 0
            what = " ".join([model, *settings])
            row(f"identify {what}, 10^6 rows of 7 joints, {kind}", f"{took:.1f} s", f"< {LIMIT_S:g} s", ok)
            # Other programs lengthen the time by the clock, waiting threads of a linear algebra library the work.
            row("  work of all cores", f"{used.ru_utime + used.ru_stime:.1f} s", "", None)
            memory = used.ru_maxrss / 1e6
            row("  memory at most", f"{memory:.2f} GB", f"< {LIMIT_GB:g} GB", memory < LIMIT_GB)
