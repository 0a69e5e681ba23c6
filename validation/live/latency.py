"""A monitor that is fed at 1 kHz from another process: lost samples, latencies, memory."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np

import bumpstop as bs
from bumpstop.detection import Detector, DetectorSettings, save_detector
from bumpstop.model import inverse_dynamics
from validation.findings import Findings

TITLE = "A monitor at 1 kHz"
ROBOT = "panda"
PERIOD_S = 1e-3
# The motion repeats itself, so that it can be published over and over; a push every time.
CYCLE_S = 5.0
PUSH_NM, PUSH_ROWS = 30.0, slice(2000, 2060)
TOPIC = "rt/latency/joint_states"
MAX_P99_MS = 2.0
MAX_GROWTH_MB = 4.0
_BEGINS_S = 10.0  # memory is compared from then on


def compare(findings: Findings, *, quick: bool) -> None:
    """Ten minutes, or fifteen seconds where it must be quick."""
    duration = 15.0 if quick else 600.0
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        written, summary, memory = run(folder, duration)
        transport, alarms = latencies(folder)
    count = written["count"]
    wanted = count // round(CYCLE_S / PERIOD_S)
    found = {key: value for key, value in summary["found"].items() if key != "stopped"}
    findings.check(
        "no sample lost, repeated or damaged",
        summary["samples"] == count and not found,
        f"{summary['samples']} of {count}, {found}",
    )
    findings.check(
        "every push is an alarm, and nothing else", summary["alarms"] == wanted, f"{summary['alarms']} of {wanted}"
    )
    p99 = float(np.quantile(alarms, 0.99))
    findings.check(
        f"p99 from receipt to verdict below {MAX_P99_MS:g} ms",
        summary["latency_ms"]["p99"] < MAX_P99_MS,
        f"{summary['latency_ms']['p99']:.3g} ms",
    )
    findings.check(f"p99 from a sample's time to its alarm below {MAX_P99_MS:g} ms", p99 < MAX_P99_MS, f"{p99:.3g} ms")
    growth = max(memory[1:]) - memory[0]
    findings.check(
        f"memory grows by less than {MAX_GROWTH_MB:g} MB",
        growth < MAX_GROWTH_MB,
        f"{memory[0]:.1f} MB, then up to {growth:+.2f} MB in {duration - _BEGINS_S:.0f} s",
    )
    late = written["late_ms"]
    rows = [
        ["published after it was due", late["0.5"], late["0.99"], late["1"]],
        ["received after it was due", *(1e3 * float(np.quantile(transport, p)) for p in (0.5, 0.99, 1))],
        ["verdict after it was received", *(summary["latency_ms"][key] for key in ("p50", "p99", "largest"))],
        ["alarm after it was due", *(float(np.quantile(alarms, p)) for p in (0.5, 0.99, 1))],
    ]
    findings.table("Latencies of a sample, ms", ["", "median", "p99", "largest"], ["", ".3g", ".3g", ".3g"], rows)
    findings.figures |= {"load": os.getloadavg()[0], "samples": summary["samples"], "memory_MB": memory}


def run(folder: Path, duration_s: float) -> tuple[dict[str, object], dict[str, object], list[float]]:  # type: ignore[type-arg]
    """What the writer and the monitor say, and the monitor's memory second by second [MB]."""
    robot = bs.Robot.load(ROBOT)
    t = PERIOD_S * np.arange(round(CYCLE_S / PERIOD_S))
    draw = np.random.default_rng(1)
    speed, phase = 2 * np.pi / CYCLE_S * draw.integers(1, 4, robot.dof), draw.uniform(0, 6, robot.dof)
    middle = (robot.lower + robot.upper) / 2
    angle = t[:, None] * speed + phase
    q, qd, qdd = middle + 0.2 * np.sin(angle), 0.2 * speed * np.cos(angle), -0.2 * speed**2 * np.sin(angle)
    tau = inverse_dynamics(robot, q, qd, qdd) + draw.normal(0, 0.05, q.shape)
    tau[PUSH_ROWS, 1] += PUSH_NM
    names = [joint.name for joint in robot.joints]
    np.savez(folder / "rows.npz", names=names, period_s=PERIOD_S, position=q, effort=tau)
    save_detector(
        Detector(robot, None, np.full(robot.dof, 10.0), DetectorSettings(period_s=PERIOD_S)), folder / "arm.detector"
    )
    domain, count = 90 + os.getpid() % 100, round(duration_s / PERIOD_S)
    source = f"dds://{TOPIC.removeprefix('rt/')}?domain={domain}&effort=torque"
    program = "from bumpstop.cli.main import main; main()"
    words = [
        "monitor",
        source,
        "--detector",
        str(folder / "arm.detector"),
        "--json",
        "--stop-after-s",
        "1",
        "--mcap",
        str(folder / "w.mcap"),
        "--rotate-s",
        "60",
        "--jsonl",
        str(folder / "w.jsonl"),
    ]
    environment = os.environ | {"ROS_LOCALHOST_ONLY": "1"}
    asked = [str(folder / "rows.npz"), str(domain), TOPIC, str(count)]
    memory = []
    with (
        subprocess.Popen(
            [sys.executable, "-m", "validation.live.joint_state_writer", *asked],
            stdout=subprocess.PIPE,
            text=True,
            env=environment,
        ) as writer,
        subprocess.Popen(
            [sys.executable, "-c", program, *words], stdout=subprocess.PIPE, text=True, env=environment
        ) as monitor,
    ):
        begin = time.monotonic()
        while writer.poll() is None:
            time.sleep(1.0)
            if time.monotonic() - begin > _BEGINS_S and writer.poll() is None:
                memory.append(_resident_MB(monitor.pid))
        monitor.terminate()
        said, told = writer.communicate()[0], monitor.communicate()[0]
    return json.loads(said), json.loads(told), memory


def latencies(folder: Path) -> tuple[np.ndarray, np.ndarray]:  # type: ignore[type-arg]
    """From when samples were due: until they were received (N,) [s], and until alarms of theirs were told (M,) [ms]."""
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    wall = time.time() - time.monotonic()
    received, alarms = [], []
    for path in sorted(folder.glob("w_*.mcap")):
        with AnyReader([path], default_typestore=get_typestore(Stores.ROS2_HUMBLE)) as reader:
            wanted = [one for one in reader.connections if one.topic in ("/joint_states", "/bumpstop/alarm")]
            for connection, at, raw in reader.messages(wanted):
                message = reader.deserialize(raw, connection.msgtype)
                if connection.topic == "/joint_states":
                    stamp = message.header.stamp
                    received.append(at / 1e9 - wall - (stamp.sec + stamp.nanosec / 1e9))
                else:
                    stamp = message.stamp
                    alarms.append(1e3 * (at / 1e9 - wall - (stamp.sec + stamp.nanosec / 1e9) + message.latency_s))
    return np.array(received), np.array(alarms)


def _resident_MB(pid: int) -> float:
    for line in Path(f"/proc/{pid}/status").read_text().splitlines():
        if line.startswith("VmRSS:"):
            return float(line.split()[1]) / 1024
    return float("nan")
