"""``bumpstop robots``: the list, one robot in full, and its picture."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from bumpstop.model import Robot, effective_mass, robots
from bumpstop.model.urdf.writer import write_urdf
from cli.support import run, strict_json
from model.urdf_cases import ARM, scaled


@pytest.fixture
def arm(tmp_path: Path) -> Path:
    path = tmp_path / "arm.urdf"
    path.write_text(ARM)
    return path


def test_list() -> None:
    result = run("robots")
    assert (result.status, result.err) == (0, "")
    for name in robots():
        assert f"\n{name} " in result.out
    assert "assumed" in next(line for line in result.out.splitlines() if line.startswith("sia5d"))


@pytest.mark.parametrize("name", robots())
def test_show(name: str) -> None:
    result = run("robots", "show", name)
    assert (result.status, result.err) == (0, "")
    for said in ("tip: ", "geometry: ", "inertia: ", "note: ", "rated payload: "):
        assert f"\n{said}" in result.out


def test_effective_masses_and_drive_train(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("COLUMNS", raising=False)  # as workers of tests have it
    out = run("robots", "show", "ur5e", "--pose-deg", "0,-90,90,-90,-90,0").out
    lines = [" ".join(line.split()) for line in out.splitlines()]
    begin = lines.index("effective mass [kg] of the tip at 0 -90 90 -90 -90 0 deg, along the axes of the base frame:")
    robot, q = Robot.load("ur5e"), np.deg2rad([0, -90, 90, -90, -90, 0])
    for row, definition, words in (
        (2, "links", "moving links, joints free"),
        (3, "links_and_rotors", "links and rotors, joints free"),
        (4, "composite_rigid_body", "one composite rigid body"),
    ):
        masses = [f"{float(effective_mass(robot, q, n, definition=definition)):.4g}" for n in np.eye(3)]  # type: ignore[arg-type]
        assert lines[begin + row] == " ".join([words, *masses])
    assert lines[begin + 5] == "ISO/TS 15066, M/2 8.85 8.85 8.85"
    assert lines[begin + 6] == "ISO/TS 15066, M/2 and the rated payload 13.85 13.85 13.85"
    assert "rotor inertia: 1.5 1.5 1.5 0.28 0.28 0.28 kg m2; ASSUMED: a class of arms, " in out
    assert "torque limit: 150 150 150 28 28 28 Nm; published: max. joint torques of the maker" in out
    hz = " ".join(6 * ["15.92"])
    assert f"servo bandwidth: 100 100 100 100 100 100 rad/s ({hz} Hz); ASSUMED" in out
    # Told once for all joints, and no name is folded where nothing is too wide.
    lines = run("robots", "show", "sia5d").out.splitlines()
    assert "torque limit: unknown" in lines
    assert any(line.split()[:3] == ["1", "shoulder_pan_joint", "shoulder_link"] for line in out.splitlines())
    bad = run("robots", "show", "ur5e", "--pose-deg", "0,0,0")
    assert (bad.status, bad.out) == (2, "")
    assert "--pose-deg: " in bad.err


def test_settings_find_the_file_from_elsewhere(arm: Path) -> None:
    scenario = arm.parent / "scenario.toml"
    scenario.write_text(
        """
        robot = "arm.urdf"
        base = "base"
        tip = "tool"
        pose_rad = [0.4, 0.2, 1.0]
        motion = { velocity_mm_s = [30, 0, -40], task = "position", damping = 0.01, duration_s = 0.2 }
        contact = { stiffness_N_m = 50000, link = "camera" }
        detector = { thresholds_Nm = [10, 20, 5], noise_sd_Nm = 1.0 }
        reaction = { joint_acceleration_rad_s2 = 5.0 }
        """
    )
    first = run("evaluate", scenario, "--json", "--out", arm.parent / "elsewhere")
    assert (first.status, first.err) == (0, "")
    assert "arm.urdf has no inertia for 'wrist'." in strict_json(first.out)["notes"]
    assert run("evaluate", arm.parent / "elsewhere" / "settings.toml", "--json") == first
    assert "the URDF file arm.urdf" in (arm.parent / "elsewhere" / "report.html").read_text()


def test_an_assumed_inertia_is_seen() -> None:
    assert "inertia: AN ASSUMPTION, not measured and not published; " in run("robots", "show", "sia5d").out
    assert "ASSUMPTION" not in run("robots", "show", "panda").out


def test_show_a_file(arm: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    result = run("robots", "show", arm)
    assert (result.status, result.err) == (0, "")
    lines = result.out.splitlines()
    assert lines[0].startswith("arm: 3 joints, reach ")
    rows = [" ".join(line.split()) for line in lines[2:5]]
    assert rows[0] == "1 turn upper 0 0 400 0 17.1887 0 0 1 0 -114.6 to 143.2 171.9 4"
    assert rows[1] == "2 push slide 0 0 350 0 0 0 0 0 1 0 to 500 mm 1000 mm/s 2.8"
    assert rows[2] == "3 roll wrist 100 0 200 0 0 0 0.6 0 0.8 no limits no limit -"
    assert "tip: tool, at 0 0 100 mm of the last link, rpy 89.9544 0 11.4592 deg" in lines
    assert "fixed to links: camera (on slide)" in lines
    assert "inertia: unknown" in lines
    assert "effective mass: not told. The inertia of arm is not known: no mass of 'wrist'." in lines
    assert "warning: arm.urdf has no inertia for 'wrist'." in lines


def test_show_part_of_a_file(arm: Path) -> None:
    assert "2 joints" in run("robots", "show", arm, "--base", "upper").out
    assert "1 joints" not in run("robots", "show", arm, "--tip", "camera").out
    result = run("robots", "show", arm, "--tip", "tol")
    assert (result.status, result.out) == (2, "")
    assert result.err == "error: --tip: arm.urdf has no link 'tol'; did you mean 'tool'?\n"


def test_strict_inertia(arm: Path) -> None:
    arm.write_text(ARM.replace('izz="0.01"', 'izz="0.1"'))
    assert "warning: Link 'upper' of arm.urdf: its inertia breaks the triangle" in run("robots", "show", arm).out
    result = run("robots", "show", arm, "--strict-inertia")
    assert result.status == 2
    assert "link 'upper' inertia: breaks the triangle inequality" in result.err


@pytest.mark.parametrize(("name", "begin"), [("a.png", b"\x89PNG"), ("a.svg", b"<?xml")])
def test_picture(name: str, begin: bytes, arm: Path) -> None:
    picture = arm.parent / name
    result = run("robots", "show", arm, "--picture", picture)
    assert result.status == 0
    assert result.out.splitlines()[-1] == f"picture: {picture}"
    assert picture.read_bytes().startswith(begin)


def test_an_arm_in_millimetres_is_shown_with_what_is_doubted(tmp_path: Path) -> None:
    """No class of arms is as large, and its figures were refused as if somebody had written them."""
    path = tmp_path / "mm.urdf"
    write_urdf(scaled(Robot.load("ur10e"), 1e3), path)
    text = path.read_text(encoding="utf-8")
    path.write_text(re.sub(' effort="[^"]*"', "", text), encoding="utf-8")
    shown = run("robots", "show", str(path))
    assert (shown.status, shown.err) == (0, "")
    assert "\ndrive train: not told. The lengths of ur10e do not look like metres: its links are " in shown.out
    elastic = 'robot = "mm.urdf"\npose_deg = [0, -90, 90, -90, -90, 0]\narm.model = "elastic"\n'
    file = tmp_path / "s.toml"
    file.write_text(
        elastic
        + """motion.velocity_mm_s = [0, 0, -100]
detector = { thresholds_Nm = [20, 20, 20, 20, 20, 20], noise_sd_Nm = 1 }
reaction.joint_acceleration_rad_s2 = 5
[contact]
body = "chest"
limits = "ts15066"
"""
    )
    refused = run("evaluate", str(file))
    assert refused.status == 2
    assert "'elastic' needs a plausible inertia. The lengths of ur10e do not look like metres" in refused.err
