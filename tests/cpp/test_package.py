"""The C++ package as users meet it: installed by cmake, found by find_package, fed with a file that Python wrote."""

from __future__ import annotations

import platform
import re
import shutil
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection import Detector, DetectorSettings, Thresholds, describe_detector, save_detector
from bumpstop.joint import JointTorqueModel
from bumpstop.model import describe, effective_mass, inverse_dynamics
from cpp.builds import COMPILER, WARNINGS

ROOT = Path(__file__).resolve().parents[2]
NUMBER = re.compile(r"-?\d+\.\d+(?:e[-+]\d+)?|-?\d+e[-+]\d+|inf")


def cmake() -> str:
    """The cmake beside this Python, or any other."""
    beside = Path(sys.executable).parent / "cmake"
    found = str(beside) if beside.exists() else shutil.which("cmake")
    if found is None:
        pytest.skip("no cmake: the test packages bring one")
    return found


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Install the package, then build the examples against it, warnings being errors."""
    folder = tmp_path_factory.mktemp("cpp")
    tool, prefix = cmake(), folder / "prefix"

    def run(*arguments: object) -> None:
        done = subprocess.run([str(a) for a in arguments], capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr

    run(tool, "-S", ROOT, "-B", folder / "package", f"-DCMAKE_INSTALL_PREFIX={prefix}")
    run(tool, "--install", folder / "package")
    shutil.copytree(ROOT / "examples" / "cpp", folder / "examples")
    # A third of the time of -O3, at which continuous integration compiles the same headers into the kernels.
    own = [f"-DCMAKE_PREFIX_PATH={prefix}", "-DCMAKE_CXX_FLAGS_RELEASE=-O0"]
    run(tool, "-S", folder / "examples", "-B", folder / "build", *own)
    run(tool, "--build", folder / "build", "-j2")
    return folder / "build"


def without(text: str, keyword: str) -> str:
    return "\n".join(line for line in text.splitlines() if not line.startswith(keyword))


def numbers(built: Path, program: str, robot: bs.Robot, tmp_path: Path) -> list[float]:
    file = tmp_path / "arm.robot"
    file.write_text(describe(robot), encoding="utf-8")
    done = subprocess.run([built / program, file], capture_output=True, text=True, check=True)
    return [float(found) for line in done.stdout.splitlines() for found in NUMBER.findall(line)]


@pytest.mark.parametrize("name", bs.robots())
def test_kinematics(built: Path, name: str, tmp_path: Path) -> None:
    robot = bs.Robot.load(name)
    q = 0.1 * np.arange(1, robot.dof + 1)
    found = np.array(numbers(built, "01_kinematics", robot, tmp_path))
    np.testing.assert_allclose(found[:3], robot.pose(q)[:3, 3], atol=1e-11)
    np.testing.assert_allclose(found[3:].reshape(-1, 3).T, robot.jacobian(q)[:3], atol=1e-11)


@pytest.mark.parametrize("name", ["sia5d", "ur10e", "panda", "iiwa14"])
def test_dynamics(built: Path, name: str, tmp_path: Path) -> None:
    robot = bs.Robot.load(name)
    joints = np.arange(robot.dof)
    q, qd, qdd = 0.1 * (joints + 1), 0.3 - 0.1 * joints, 0.2 * joints
    found = numbers(built, "02_dynamics", robot, tmp_path)
    np.testing.assert_allclose(found[:-1], inverse_dynamics(robot, q, qd, qdd), rtol=1e-9, atol=1e-9)
    assert found[-1] == pytest.approx(float(effective_mass(robot, q, [0, 0, -1])), rel=1e-9)


def test_force_law(built: Path, tmp_path: Path) -> None:
    law = bs.evaluate(bs.load_scenario(ROOT / "examples" / "01_hand_downward.toml"))
    force = law.peak_force
    found = numbers(built, "03_force_distribution", bs.Robot.load("sia5d"), tmp_path)
    expected = [force.mean, force.sd, *(force.quantile(p) for p in (0.5, 0.95, 0.99, 0.999))]
    np.testing.assert_allclose(found[:6], expected, rtol=1e-7)
    assert found[-1] == pytest.approx(law.false_alarm_probability, rel=1e-3)


def detector_of_the_source() -> Detector:
    thresholds = Thresholds(
        np.array([20, 10, 20, 20, 20, 20, np.inf]), fast=np.array([9.0] * 6 + [np.inf]), model_errors=1
    )
    settings = DetectorSettings(period_s=0.004, payload_kg=1.5, arming_delay_s=0.1)
    return Detector(bs.Robot.load("sia5d"), JointTorqueModel.load("sia5d"), thresholds, settings)


def test_the_loop_sees_what_python_sees(built: Path, tmp_path: Path) -> None:
    detector = detector_of_the_source()
    rng, t = np.random.default_rng(1), 0.004 * np.arange(500)
    q, current = 0.3 * np.sin(t[:, None] * np.arange(1, 8)), 100 * rng.normal(size=(500, 7))
    current[200] = np.nan
    run = detector.run_rows(t, q, current)
    save_detector(detector, tmp_path / "arm.detector")
    rows = np.hstack([t[:, None], q, current])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,q,current", comments="", fmt="%.17g")
    command = [built / "04_detector", tmp_path / "arm.detector", tmp_path / "log.csv"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    # An empty cell is no zero.
    text = (tmp_path / "log.csv").read_text(encoding="utf-8")
    (tmp_path / "log.csv").write_text(text.replace("nan", ""), encoding="utf-8")
    assert subprocess.run(command, capture_output=True, text=True, check=True).stdout == done.stdout
    event = run.events[0]
    joints = " ".join(str(j + 1) for j in sorted({*event.joints, *event.fast_joints}))
    assert (
        f"alarm at {event.t:.6f} s: joints {joints}, {event.force_along:.6f} N, likeliest on {event.link}"
        in done.stdout
    )
    # The programs are compiled for different instruction sets.
    largest = float(done.stdout.split()[-2])
    assert largest == pytest.approx(np.nanmax(np.abs(run.residual)), rel=1e-9)


def test_the_loop_takes_measured_speeds_from_the_recording(built: Path, tmp_path: Path) -> None:
    """They stand behind the signals. Where they are missing nothing runs: it would with joints that stand still."""
    made = detector_of_the_source()
    detector = Detector(made.robot, made.model, made.thresholds, replace(made.settings, measured_rates=True))
    save_detector(detector, tmp_path / "arm.detector")
    rng, t = np.random.default_rng(1), 0.004 * np.arange(500)
    phase = t[:, None] * np.arange(1, 8)
    q, qd, current = 0.3 * np.sin(phase), 0.3 * np.arange(1, 8) * np.cos(phase), 100 * rng.normal(size=(500, 7))
    command = [built / "04_detector", tmp_path / "arm.detector", tmp_path / "log.csv"]
    for rows, found in ((np.hstack([t[:, None], q, current, qd]), ""), (np.hstack([t[:, None], q, current]), "row 1 ")):
        np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t", comments="", fmt="%.17g")
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if found:
            assert (done.returncode, done.stdout) == (2, "")
            assert f"error: {found}has no speeds of the joints, and the detector takes measured ones" in done.stderr
            continue
        run = detector.run_rows(t, q, current, qd=qd)
        assert f"alarm at {run.events[0].t:.6f} s: joints" in done.stdout
        assert float(done.stdout.split()[-2]) == pytest.approx(np.nanmax(np.abs(run.residual)), rel=1e-9)


def test_the_loop_at_1_khz(built: Path, tmp_path: Path) -> None:
    """Paced, it takes as long as the recording, and sees the same."""
    made = detector_of_the_source()
    detector = Detector(made.robot, made.model, made.thresholds, DetectorSettings(period_s=0.001))
    save_detector(detector, tmp_path / "arm.detector")
    t = 5 + 0.001 * np.arange(300)
    q = 0.3 * np.sin(t[:, None] * np.arange(1, 8))
    rows = np.hstack([t[:, None], q, np.random.default_rng(1).normal(0, 100, q.shape)])
    np.savetxt(tmp_path / "log.csv", rows, delimiter=",", header="t,q,current", comments="", fmt="%.17g")
    command = [built / "04_detector", tmp_path / "arm.detector", tmp_path / "log.csv"]
    quick = subprocess.run(command, capture_output=True, text=True, check=True).stdout.splitlines()
    begin = time.perf_counter()
    paced = subprocess.run([*command, "paced"], capture_output=True, text=True, check=True).stdout.splitlines()
    assert time.perf_counter() - begin > 0.299
    assert "alarm at" in quick[0]
    assert [line for line in paced if "longest update" not in line] == quick
    assert len(paced) == len(quick) + 1


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda text: text.replace("bumpstop-detector 2", "bumpstop-detector 1"), "not a detector of version 2"),
        (lambda text: text[: text.rindex("end")], "ends without 'end'"),
        (lambda text: text.replace("arming_delay", "arming"), "unknown keyword 'arming'"),
        (lambda text: text.replace("constant 20.0", "constant nan"), "'constant' wants 7 numbers in its range, once"),
        (lambda text: text.replace("constant 20.0", "constant"), "'constant' wants 7 numbers in its range, once"),
        (lambda text: text.replace("period 0.004", "period 0.0"), "'period' wants 1 numbers in its range, once"),
        (lambda text: without(text, "max_no_data_time"), "'max_no_data_time' is missing"),
        (lambda text: text.replace("residual direct", "residual else"), "'residual' wants direct or observer"),
        (lambda text: text.replace("joint_torque odd power", "joint_torque odd", 1), "'joint_torque' wants a map"),
        (lambda text: without(text, "joint_errors"), "wanted 7 lines 'joint_torque' and 'joint_errors'"),
        (lambda text: without(text, "inertia"), "is not known"),
    ],
)
def test_damaged_detectors_are_refused(built: Path, spoil: object, message: str, tmp_path: Path) -> None:
    text = describe_detector(detector_of_the_source())
    file = tmp_path / "arm.detector"
    file.write_text(spoil(text), encoding="utf-8")  # type: ignore[operator]
    done = subprocess.run([built / "04_detector", file, file], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert message in done.stderr


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda text: "", "the description is empty"),
        (lambda text: text.replace("bumpstop-robot 1", "bumpstop-robot 2"), "line 1: not a robot description"),
        (lambda text: text.replace("end\n", ""), "ends without 'end'"),
        (
            lambda text: text.replace("origin 0.0 0.0 0.31", "origin 0.0 0.31"),
            "'origin' wants 3 numbers in its range, once",
        ),
        (
            lambda text: text.replace("origin 0.0 0.0 0.31", "origin 0.0 nan 0.31"),
            "'origin' wants 3 numbers in its range, once",
        ),
        (lambda text: text.replace("axis 0.0 0.0 1.0", "axis 0.0 0.0 2.0"), "'axis' wants a unit vector"),
        (lambda text: text.replace("joint revolute", "joint planar"), "'joint' wants revolute or prismatic"),
        (lambda text: text.replace("limits", "limit"), "unknown keyword 'limit'"),
        (
            lambda text: "\n".join(line for line in text.splitlines() if not line.startswith("joint")),
            "before the first",
        ),
        (lambda text: text.replace("joint revolute joint_l\n", ""), "'link' comes twice"),
        (lambda text: without_line(text, 7), "joint 'joint_s' has no rotation"),
        (lambda text: text.replace("rotation 1.0", "rotation -1.0", 1), "'rotation' wants nine numbers of a rotation"),
        (
            lambda text: text.replace("origin 0.0 0.0 0.31", "origin 0.0 inf 0.31"),
            "'origin' wants 3 numbers in its range, once",
        ),
        (lambda text: text.replace("\ninertia ", "\ninertia -", 1), "'inertia' wants fourteen numbers"),
    ],
)
def test_damaged_descriptions_are_refused(built: Path, spoil: object, message: str, tmp_path: Path) -> None:
    file = tmp_path / "arm.robot"
    file.write_text(spoil(describe(bs.Robot.load("sia5d"))), encoding="utf-8")  # type: ignore[operator]
    done = subprocess.run([built / "01_kinematics", file], capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert message in done.stderr


def without_line(text: str, number: int) -> str:
    lines = text.splitlines()
    return "\n".join(lines[:number] + lines[number + 1 :])


def test_no_line_may_be_missing_come_twice_or_go_on(built: Path, tmp_path: Path) -> None:
    """A line that a copy lost, or that two copies brought, would else be another arm without a word."""
    robot = describe(bs.Robot.load("sia5d"))
    for program, text in (("01_kinematics", robot), ("04_detector", describe_detector(detector_of_the_source()))):
        lines, file = text.splitlines(), tmp_path / "text"

        def status(text: list[str], program: str = program, file: Path = file) -> int:
            file.write_text("\n".join(text) + "\n", encoding="utf-8")
            return subprocess.run([built / program, file, file], capture_output=True, check=False).returncode

        assert status(lines) == 0
        assert status([line + "\r" for line in lines[:4]] + [" "] + lines[4:]) == 0  # what is no damage
        for number, line in enumerate(lines):
            key, rest = line.split()[0], lines[number + 1 :]
            if key == "#":
                continue
            may_be_missing = program == "01_kinematics" and key == "inertia"
            assert status(lines[:number] + rest) == (0 if may_be_missing else 2), line
            assert status([*lines[: number + 1], line, *rest]) == 2, line
            if key not in ("name", "joint", "link", "tip"):  # their names may hold blanks
                assert status([*lines[:number], line + " 0.5", *rest]) == 2, line


def test_unknown_inertia_stays_unknown(built: Path, tmp_path: Path) -> None:
    file = tmp_path / "arm.robot"
    file.write_text(without(describe(bs.Robot.load("ur10e")), "inertia"), encoding="utf-8")
    done = subprocess.run([built / "02_dynamics", file], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (2, "error: the inertia of ur10e is not known\n")


@pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="instruction sets of other processors")
def test_files_for_several_instruction_sets_share_nothing(tmp_path: Path) -> None:
    """Registers differ in size: what the linker took for one type would be read wrongly in one of the files."""
    here = Path(__file__).parent
    command = [*COMPILER, *WARNINGS, f"-I{ROOT / 'include'}"]
    flags = {"baseline": [], "avx2": ["-mavx2", "-mfma"], "avx512": ["-mavx512f", "-mavx512dq", "-mavx512vl"]}
    for name, own in flags.items():
        source, to = str(here / "instruction_set.cpp"), str(tmp_path / f"{name}.o")
        subprocess.run([*command, *own, f"-DWHERE={name}", "-c", source, "-o", to], check=True)
    objects = [str(tmp_path / f"{name}.o") for name in flags]
    program = str(tmp_path / "program")
    subprocess.run([*command, str(here / "instruction_sets.cpp"), *objects, "-o", program], check=True)
    names = subprocess.run([program], capture_output=True, text=True, check=True).stdout.split()
    assert len(set(names)) == len(flags)
