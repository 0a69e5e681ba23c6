"""The RTDE example in C++ against the test bench: the residuals of Python, and nothing allocated in its loop."""

from __future__ import annotations

import re
import subprocess
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop import _native
from bumpstop.detection import Detector, DetectorSettings, Thresholds, save_detector
from bumpstop.joint import JointTorqueModel
from bumpstop.live.loaded_detector import LoadedDetector
from bumpstop.live.rtde import RtdeServer
from bumpstop.live.rtde.source import output_fields
from bumpstop.model import Robot
from cpp.builds import COMPILER, ROOT, compiled
from live.test_rtde import served
from live.test_rtde_axes import railed

NUMBER = re.compile(r"-?\d+\.?\d*(?:e[-+]\d+)?")
# Only programs of one instruction set round alike.
FLAGS = {"avx2": ["-mavx2", "-mfma"], "avx512": ["-mavx512f", "-mavx512dq", "-mavx512vl"]}


def in_python(file: Path, t: np.ndarray, q: np.ndarray, current: np.ndarray) -> dict[str, Any]:
    """What the same detector says in Python, sample by sample."""
    kernel = LoadedDetector.load(file).kernel()
    residuals, events = [], []
    for row in range(len(t)):
        out = kernel.update(t[row], q[row], current[row], np.zeros(7))
        if out.state != _native.DetectorState.no_data:
            residuals.append(out.residual[:7])
        if kernel.events > len(events):
            events.append((kernel.event().t, kernel.event().contact.force_along))
    total = np.zeros(7)
    for residual in residuals:
        total += residual
    return {
        "judged": len(residuals),
        "means": (total / len(residuals)).tolist(),
        "largest": float(np.abs(residuals).max()),
        "events": events,
    }


@pytest.fixture(scope="module")
def program(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("rtde") / "05_rtde"
    source = ROOT / "examples" / "cpp" / "05_rtde.cpp"
    done = compiled([*COMPILER, "-O0", "-ffp-contract=off", *FLAGS.get(_native.target, [])], source, made)
    assert done.returncode == 0, done.stderr
    return made


def test_it_compiles_as_release(tmp_path: Path) -> None:
    """As `cmake` compiles the folder of examples by itself: what is inlined there brings warnings of its own."""
    done = compiled([*COMPILER, "-O3"], ROOT / "examples" / "cpp" / "05_rtde.cpp", tmp_path / "05_rtde")
    assert done.returncode == 0, done.stderr


def made_detector(folder: Path, period_s: float = 0.002, *, measured_rates: bool = False) -> Path:
    thresholds = Thresholds(np.array([20.0, 10, 20, 20, 20, 20, np.inf]))
    settings = DetectorSettings(period_s=period_s, arming_delay_s=0.1, measured_rates=measured_rates)
    file = folder / "arm.detector"
    save_detector(Detector(Robot.load("sia5d"), JointTorqueModel.load("sia5d"), thresholds, settings), file)
    return file


def test_same_as_python_to_the_last_digit(program: Path, tmp_path: Path) -> None:
    """The seventh joint travels in registers. Its noise makes an alarm, which is answered."""
    detector = made_detector(tmp_path)
    rng, t = np.random.default_rng(7), 0.002 * np.arange(600)
    q, current = 0.3 * np.sin(t[:, None] * np.arange(1, 8)), 100 * rng.normal(size=(600, 7))
    expected = in_python(detector, t, q, current)
    assert expected["events"]
    server = RtdeServer(output_fields(7, "current"), 500.0, port=0)
    command = [str(program), "127.0.0.1", str(server.port), str(detector), "reverse"]
    running = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert server.wait_for_client(20)
    for row in range(len(t)):
        server.publish(served(q[row], current[row], t[row]))
    answer = wait_for_answer(server)
    server.close()
    printed, _ = running.communicate(timeout=20)
    assert running.returncode == 0
    assert answer == (2, 1), printed
    lines = printed.splitlines()
    alarms = [[float(x) for x in NUMBER.findall(line)] for line in lines if line.startswith("alarm")]
    assert len(alarms) == len(expected["events"]) >= 1
    assert alarms[0] == [round(expected["events"][0][0], 6), expected["events"][0][1]]
    assert lines[-3] == f"600 samples, {expected['judged']} judged, 0 damaged, {len(alarms)} alarms"
    largest, *means = (float(x) for x in NUMBER.findall(lines[-2]))
    assert largest == expected["largest"]
    assert means == expected["means"]
    assert lines[-1] == "0 allocations in the loop"


def wait_for_answer(server: RtdeServer) -> tuple[object, object]:
    for _ in range(1000):
        values = server.inputs()[0]
        if values["input_int_register_24"]:
            return values["input_int_register_24"], values["input_int_register_25"]
        time.sleep(0.005)
    return 0, 0


def test_no_controller(program: Path, tmp_path: Path) -> None:
    detector = str(made_detector(tmp_path))
    done = subprocess.run([program, "127.0.0.1", "1", detector], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "error: cannot connect to 127.0.0.1:1\n")
    server = RtdeServer({}, 500.0, port=0)
    command = [program, "127.0.0.1", str(server.port), detector]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    server.close()
    assert done.returncode == 2
    assert done.stderr.startswith("error: the controller has not got timestamp,actual_q")


def test_a_rail_among_the_joints_of_the_controller(program: Path, tmp_path: Path) -> None:
    railed(tmp_path)
    command = [program, "127.0.0.1", "1", str(tmp_path / "rail.detector")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "error: joint 1 slides, and all six of a controller turn\n")


def test_more_samples_than_a_controller_gives(program: Path, tmp_path: Path) -> None:
    command = [program, "127.0.0.1", "1", str(made_detector(tmp_path, 0.001))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    words = "error: a controller gives 500 samples a second, the detector takes 1000\n"
    assert (done.returncode, done.stderr) == (2, words)


def test_speeds_of_joints_in_registers(program: Path, tmp_path: Path) -> None:
    """A controller sends none, and every sample would be judged with zeros."""
    command = [program, "127.0.0.1", "1", str(made_detector(tmp_path, measured_rates=True))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    words = "error: joints in registers have no speeds, and the detector takes measured ones\n"
    assert (done.returncode, done.stderr) == (2, words)
