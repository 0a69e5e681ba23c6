"""The controller for ros2_control, compiled against the interface that its folder states: the residuals of Python."""

from __future__ import annotations

import re
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from bumpstop import _native
from bumpstop.live.loaded_detector import LoadedDetector
from bumpstop.recording import Recording
from cpp.builds import COMPILER, ROOT, WARNINGS
from live.test_cpp_rtde import FLAGS, made_detector

FOLDER = ROOT / "examples" / "ros2_control"


@pytest.fixture(scope="module")
def replay(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("ros2_control") / "replay"
    folders = [f"-I{path}" for path in (FOLDER / "include", FOLDER / "interface", ROOT / "include")]
    flags = [*WARNINGS, "-O0", "-ffp-contract=off", "-pthread", *FLAGS.get(_native.target, [])]
    # In one piece: most of the work is in the headers.
    whole = made.with_suffix(".cpp")
    parts = (FOLDER / "src" / "collision_controller.cpp", FOLDER / "test" / "replay.cpp")
    whole.write_text("".join(f'#include "{part}"\n' for part in parts))
    done = subprocess.run([*COMPILER, *flags, *folders, str(whole), "-o", str(made)], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return made


def test_same_as_python_to_the_last_digit(replay: Path, tmp_path: Path) -> None:
    """Every tick is published, and the update allocates nothing."""
    file = made_detector(tmp_path)
    detector = LoadedDetector.load(file)
    rng, begin = np.random.default_rng(8), 1_700_000_000_123_456_789
    time = begin + 2_000_000 * np.arange(700) + rng.integers(0, 50_000, 700)
    t = 1e-9 * (time - time[0]).astype(np.float64)
    q, current = 0.3 * np.sin(t[:, None] * np.arange(1, 8)), 100 * rng.normal(size=(700, 7))
    # What cannot be judged hides no alarm that stands.
    current[650, 0] = np.nan
    names = [f"{name}/{what}" for what in ("position", "effort") for name in detector.joints]
    rows = [f"{time[row]}," + ",".join(f"{x:.17g}" for x in (*q[row], *current[row])) for row in range(700)]
    (tmp_path / "log.csv").write_text("\n".join(["time," + ",".join(names), *rows]) + "\n")
    done = subprocess.run([replay, file, tmp_path / "log.csv"], capture_output=True, text=True, check=True)
    *ticks, last = done.stdout.splitlines()
    events = [line.split()[3:] for line in ticks if line.startswith("event")]
    residuals = np.array([[float(x) for x in line.split(",")[1:]] for line in ticks if not line.startswith("event")])
    assert ticks[0].split(",")[0] == f"{time[0] // 10**9}.{time[0] % 10**9:09d}"
    kernel, expected, forces, alarmed = detector.kernel(), [], [], 0
    for row in range(700):
        out = kernel.update(t[row], q[row], current[row], np.zeros(7))
        expected.append(out.residual[:7])
        alarmed += alarmed > 0 or out.state == _native.DetectorState.alarm
        if kernel.events > len(forces):
            forces.append(list(kernel.event().contact.force))
    np.testing.assert_array_equal(residuals, expected)
    assert np.isnan(residuals[650]).all()
    assert [[float(x) for x in event] for event in events] == forces
    assert len(forces) >= 1
    assert last == f"{alarmed} ticks in alarm, 0 left out, 0 allocations in updates"


def test_the_readme_says_how_to_replay(replay: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Its lines write a file that is judged as the recording is; times in seconds and other headers are told."""
    (lines,) = re.findall(r"```py\n(.*?)```", (FOLDER / "README.md").read_text(), re.DOTALL)
    monkeypatch.chdir(tmp_path)
    file = made_detector(tmp_path)
    detector, rng = LoadedDetector.load(file), np.random.default_rng(8)
    t = 0.002 * np.arange(300)
    q, current = 0.3 * np.sin(t[:, None] * np.arange(1, 8)), 100 * rng.normal(size=(300, 7))
    (tmp_path / "press").mkdir()
    Recording(t=t, q=q, current=current, joint_names=detector.joints).save("press/recording.parquet")
    exec(compile(lines, "README.md", "exec"), {})
    done = subprocess.run([replay, file, "log.csv"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    found = [[float(x) for x in line.split(",")[1:]] for line in done.stdout.splitlines()[:300]]
    # Times of whole nanoseconds are others in the last digits.
    expected = detector.kernel().run(t, q, current, None, np.inf)[0]
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    text = (tmp_path / "log.csv").read_text()
    for change, status, words in (
        (text.replace("/position", ""), 2, "wanted the header time,JOINT/position,...,JOINT/effort,..."),
        (text.replace("\n2000000,", "\n0.002,"), 2, "row 2: wanted whole nanoseconds and 14 numbers"),
        (re.sub(r"000000,", ",", text), 1, "error: no tick was judged"),
    ):
        (tmp_path / "log.csv").write_text(change)
        done = subprocess.run([replay, file, "log.csv"], capture_output=True, text=True)
        assert (done.returncode, words in done.stderr) == (status, True), done.stderr


def test_refusals(replay: Path, tmp_path: Path) -> None:
    file = made_detector(tmp_path)
    log = tmp_path / "log.csv"
    log.write_text("time,a/position,a/effort\n0,0,0\n")
    done = subprocess.run([replay, file, log], capture_output=True, text=True)
    assert (done.returncode, done.stderr) == (2, "joints: 1 names, the detector's sia5d has 7 joints\n")
    done = subprocess.run([replay, tmp_path / "none", log], capture_output=True, text=True)
    assert done.returncode == 2
    assert "none': the file cannot be read" in done.stderr


@pytest.mark.parametrize(
    ("names", "rate", "said"),
    [
        (lambda names: names, 500, ""),
        (lambda names: names, 0, ""),  # not told, as of the manager's own in Humble
        (lambda names: [f"left_{name}" for name in names], 502, ""),
        (lambda names: names, 250, "update_rate: is 250 Hz, the detector '{}' is for 500 Hz"),
        (
            lambda names: [names[1], names[0], *names[2:]],
            500,
            "joints: number 1 is 'joint_l', the detector's is 'joint_s': give them in its order",
        ),
        (
            lambda names: [*names[:6], "joint_t2"],
            500,
            "joints: number 7 is 'joint_t2', the detector's is 'joint_t': give them in its order",
        ),
    ],
)
def test_joints_in_another_order_and_another_rate_are_refused(
    replay: Path, names: Callable[[list[str]], list[str]], rate: int, said: str, tmp_path: Path
) -> None:
    file, log = made_detector(tmp_path), tmp_path / "log.csv"
    given = names(list(LoadedDetector.load(file).joints))
    rows = [f"{2_000_000 * k}" + f",{0.1 + 1e-4 * k}" * 14 for k in range(300)]
    header = ",".join(f"{name}/{what}" for what in ("position", "effort") for name in given)
    log.write_text("\n".join([f"time,{header}", *rows]) + "\n")
    done = subprocess.run([replay, file, log, str(rate)], capture_output=True, text=True)
    if said:
        assert (done.returncode, done.stderr) == (2, said.format(file) + "\n")
    else:
        assert done.returncode == 0, done.stderr


def test_the_interface_says_what_it_is_not() -> None:
    for header in (FOLDER / "interface").rglob("*.hpp"):
        assert re.match(r"// Not \w+: ", header.read_text()), header
    assert "not ros2_control" in (FOLDER / "interface" / "README.md").read_text()
