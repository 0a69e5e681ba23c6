"""``bumpstop plant serve``: samples in real time, an answer that turns the motion, and what it refuses."""

from __future__ import annotations

import json
import math
import os
import signal
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop.cli.main import main
from bumpstop.live import JointSample
from bumpstop.live.answer import AnswerOutput
from bumpstop.live.bench import LinkAnswer, PlantBench
from bumpstop.live.dds import DdsSource
from bumpstop.live.rtde import RtdeSource
from bumpstop.plant import Experiment, PlantReaction
from cpp.builds import ROOT

pytest.importorskip("mujoco")
EXPERIMENT = ROOT / "examples" / "plant" / "02_hand_reverse.toml"
DOMAIN = 100 + os.getpid() % 100
ANSWER_AT_S = 0.3


@pytest.fixture
def port() -> int:
    with socket.create_server(("127.0.0.1", 0)) as one:
        return int(one.getsockname()[1])


class Client(threading.Thread):
    """Reads samples until they end; answers at the first sample from a time on."""

    def __init__(self, made: Callable[[], Any], answer: str) -> None:
        super().__init__(daemon=True)
        self._made, self._answer = made, answer
        self.samples: list[JointSample] = []
        self._over = threading.Event()

    def end(self) -> list[JointSample]:
        """All samples, once the server has ended."""
        self._over.set()
        self.join()
        return self.samples

    def run(self) -> None:
        source = self._made()
        for _ in range(200):  # until the server listens
            try:
                source.open()
                break
            except ValueError:
                time.sleep(0.02)
        answered, item = False, None
        while item is not None or not self._over.is_set():
            item = source.read(0.1)
            if isinstance(item, JointSample):
                self.samples.append(item)
                if item.stamp_s >= ANSWER_AT_S and not answered and self._answer:
                    source.answer(self._answer, 1)
                    answered = True
        source.close()


def serve(capsys: pytest.CaptureFixture[str], *options: str, experiment: Path = EXPERIMENT) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(["plant", "serve", str(experiment), *options])
    out, err = capsys.readouterr()
    return int(ended.value.code or 0), out, err


@pytest.mark.parametrize("protocol", ["rtde", "dds"])
def test_an_answer_turns_the_motion(protocol: str, port: int, capsys: pytest.CaptureFixture[str]) -> None:
    """As the same reaction at the same sample does in one process; every sample arrives, behind the reaction, too."""
    found = Experiment.load(EXPERIMENT)
    plant, command = found.prepare()
    names = [joint.name for joint in plant.robot.joints]

    def rtde() -> RtdeSource:
        return RtdeSource("127.0.0.1", port, joints=7, frequency_hz=250, answers=True)

    def dds() -> DdsSource:
        return DdsSource("/served", names, effort="current", domain=DOMAIN, loopback=True, answers=True, wait_s=20)

    client = Client(rtde if protocol == "rtde" else dds, "reverse")
    client.start()
    where = ["--rtde", str(port)] if protocol == "rtde" else ["--dds", "/served", "--domain", str(DOMAIN)]
    status, out, err = serve(capsys, *where, "--wait-s", "20", "--json", "--pace", "0.5")
    samples = client.end()
    assert status == 0, err
    (run,) = json.loads(out)["runs"]
    assert run["answer"] == "reverse"
    assert run["answered_by"].startswith(protocol)
    at = run["reaction_s"]
    assert at > ANSWER_AT_S
    same = plant.run(command, on_sample=lambda s: PlantReaction() if s.t >= at - 1e-9 else None)
    assert run["objects"][0]["peak_force_N"] == same.peak_force
    assert run["samples"] == len(samples) == len(same.recording.t)
    np.testing.assert_array_equal([sample.position_rad for sample in samples], same.recording.q)
    np.testing.assert_array_equal([sample.current_A for sample in samples], same.recording.current)


def test_runs_pace_and_files(port: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The clock goes on from one run to the next."""
    text = EXPERIMENT.read_text().replace("duration_s = 1.0", "duration_s = 0.1")
    (tmp_path / "short.toml").write_text(text)
    client = Client(lambda: RtdeSource("127.0.0.1", port, joints=7, frequency_hz=250), "")
    client.start()
    options = ["--rtde", str(port), "--runs", "2", "--pause-s", "0.1", "--seed", "5", "--out", str(tmp_path / "out")]
    status, out, _ = serve(capsys, *options, experiment=tmp_path / "short.toml")
    samples = client.end()
    assert status == 0
    assert f"sia5d at 250 Hz, 0.100 s; rtde://127.0.0.1:{port}" in out
    assert out.count("  no answer") == 2
    assert out.count("hand_finger: never touched") == 2
    assert (tmp_path / "out" / "run_2" / "recording.parquet").exists()
    stamps = np.array([sample.stamp_s for sample in samples])
    assert len(stamps) == 50
    assert (np.diff(stamps) > 0).all()


class Told:
    """A link that remembers what went out, and answers with one answer."""

    address = "told"

    def __init__(self) -> None:
        self.stamps: list[float] = []
        self.answer_at, self.said = math.inf, None  # type: float, LinkAnswer | None

    def wait_for_client(self, timeout_s: float) -> bool:
        return True

    def publish(self, sample: object, stamp_s: float) -> None:
        self.stamps.append(stamp_s)
        if stamp_s >= self.answer_at:
            # As quick as a monitor in another process can be: before the call is over.
            self.answer_at, self.said = math.inf, LinkAnswer("stop", time.monotonic())

    def answer(self) -> LinkAnswer | None:
        found, self.said = self.said, None
        return found

    def close(self) -> None:
        """Nothing to do."""


@pytest.mark.parametrize(("pause_s", "pace", "least_s"), [(0.0, 1.0, 0.1), (0.0, math.inf, 0.1), (0.5, 2.0, 1.0)])
def test_the_clock_counts_what_passes_between_motions(
    tmp_path: Path, pause_s: float, pace: float, least_s: float
) -> None:
    """The arm begins where it began: no detector may take that for a motion from where it was."""
    text = EXPERIMENT.read_text().replace("duration_s = 1.0", "duration_s = 0.1")
    (tmp_path / "short.toml").write_text(text)
    plant, command = Experiment.load(tmp_path / "short.toml").prepare()
    link = Told()
    bench = PlantBench(plant, [link], PlantReaction(), pace)
    runs = []
    for _ in range(2):
        runs.append(bench.run(command))
        time.sleep(pause_s)
    steps = np.diff(link.stamps)
    (jump,) = np.flatnonzero(steps > 0.005)
    assert steps[jump] > least_s
    assert runs[1].begin_s == pytest.approx(link.stamps[jump + 1] - link.stamps[0])


def test_an_answer_belongs_to_the_sample_before_it(tmp_path: Path) -> None:
    text = EXPERIMENT.read_text().replace("duration_s = 1.0", "duration_s = 0.1")
    (tmp_path / "short.toml").write_text(text)
    plant, command = Experiment.load(tmp_path / "short.toml").prepare()
    link = Told()
    link.answer_at = 0.05
    trip = PlantBench(plant, [link], PlantReaction()).run(command).round_trip()
    assert trip is not None
    assert trip[0] == min(stamp for stamp in link.stamps if stamp >= 0.05)
    assert 0 <= trip[1] < 0.003


def test_an_interrupt_ends_what_runs_until_interrupted(port: int, tmp_path: Path) -> None:
    text = EXPERIMENT.read_text().replace("duration_s = 1.0", "duration_s = 0.1")
    (tmp_path / "short.toml").write_text(text)
    words = [sys.executable, "-c", "from bumpstop.cli.main import main; main()", "plant", "serve"]
    words += [str(tmp_path / "short.toml"), "--rtde", str(port), "--runs", "0", "--pause-s", "0.1"]
    words += ["--out", str(tmp_path / "out"), "--json"]
    client = Client(lambda: RtdeSource("127.0.0.1", port, joints=7, frequency_hz=250), "")
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as process:
        client.start()
        end = time.monotonic() + 20
        while not (tmp_path / "out" / "run_2" / "truth.toml").exists() and time.monotonic() < end:
            time.sleep(0.02)
        process.send_signal(signal.SIGINT)
        out, err = process.communicate(timeout=20)
    client.end()
    assert (process.returncode, err) == (0, "")
    assert len(json.loads(out)["runs"]) >= 1


def test_refusals(port: int, capsys: pytest.CaptureFixture[str]) -> None:
    for options, words in (
        ([], "--rtde: and --dds are both missing; give a port, a topic, or both"),
        (["--rtde", "70000"], "--rtde: is 70000; wanted 0 to 65535"),
        (["--dds", "/a", "--axes", "1,2,3,4,5,6"], "--axes: has no meaning without --rtde"),
        (["--rtde", "0", "--axes", "1,2"], "--axes: is 1,2; wanted six rising numbers from 1 to 7"),
        (["--rtde", "0", "--domain", "3"], "--domain: has no meaning without --dds"),
        (["--dds", "a b"], "--dds: 'a b' is no name of a topic; wanted such as /joint_states"),
        (["--dds", "/a", "--domain", "900"], "--domain: is 900; wanted a whole number from 0 to 232"),
        (["--rtde", "0", "--pace", "0"], "--pace: is 0; wanted 0.01 to 100"),
        (["--rtde", "0", "--wait-s", "0.1"], "--wait-s: no monitor came within 0.1 s; start one"),
    ):
        status, _, err = serve(capsys, *options)
        assert (status, err.strip()) == (2, f"error: {words}")
    with socket.create_server(("127.0.0.1", 0)) as taken:
        status, _, err = serve(capsys, "--rtde", str(taken.getsockname()[1]))
    assert status == 2
    assert "cannot listen on" in err


def test_answers_are_taken_back() -> None:
    """Once the detector monitors again; and an answer that is none is refused."""
    from types import SimpleNamespace

    from bumpstop.errors import InputError

    said: list[tuple[str, int]] = []
    source = SimpleNamespace(answer=lambda answer, number: said.append((answer, number)))
    output = AnswerOutput(source, "stop")
    output.tick(SimpleNamespace(state="monitoring"))  # type: ignore[arg-type]
    output.alarm(SimpleNamespace(number=4))  # type: ignore[arg-type]
    for state in ("alarm", "no_data", "monitoring", "monitoring"):
        output.tick(SimpleNamespace(state=state))  # type: ignore[arg-type]
    assert said == [("stop", 4), ("none", 4)]
    with pytest.raises(InputError, match="--answer: 'revers' is none; did you mean 'reverse'"):
        AnswerOutput(source, "revers")
    with pytest.raises(InputError, match="--answer: has no meaning with this source"):
        AnswerOutput(object(), "stop")


def test_the_plant_in_this_process_gives_what_a_detector_takes(tmp_path: Path) -> None:
    """Speeds for one that takes measured ones; currents of a joint model are no torques."""
    from bumpstop.detection import Detector, DetectorSettings, save_detector
    from bumpstop.errors import InputError
    from bumpstop.joint import JointTorqueModel
    from bumpstop.live.loaded_detector import LoadedDetector
    from bumpstop.live.sources.names import source_of
    from bumpstop.model import Robot

    arm, settings = Robot.load("sia5d"), DetectorSettings(period_s=0.004, measured_rates=True)
    limits = np.array([20.0] * 6 + [np.inf])
    save_detector(Detector(arm, JointTorqueModel.load("sia5d"), limits, settings), tmp_path / "c.detector")
    save_detector(Detector(arm, None, np.full(7, 20.0), settings), tmp_path / "t.detector")
    with source_of(f"plant:{EXPERIMENT}", LoadedDetector.load(tmp_path / "c.detector")) as source:
        sample = source.read(20.0)
    assert isinstance(sample, JointSample)
    assert sample.velocity_rad_s is not None
    assert sample.velocity_rad_s.shape == (7,)
    with pytest.raises(InputError, match="has currents of a joint model; the detector takes torques"):
        source_of(f"plant:{EXPERIMENT}", LoadedDetector.load(tmp_path / "t.detector"))
    (tmp_path / "half.toml").write_text(EXPERIMENT.read_text() + "\n[sensors]\nrate_hz = 125\n")
    with pytest.raises(InputError, match=r"gives a sample every 0.008 s; the detector is made for one every 0.004 s"):
        source_of(f"plant:{tmp_path / 'half.toml'}", LoadedDetector.load(tmp_path / "c.detector"))
