"""What slides has m and N: no page and no line about a gantry speaks of rad and Nm."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from bumpstop import Joint, Robot
from bumpstop.model import LinkInertia, inverse_dynamics, write_urdf
from bumpstop.recording import Recording
from cli.support import run

ANGULAR = re.compile(r"\b(?:Nm|rad)\b")
SOLID = ((0.1, 0.0, 0.0), (0.0, 0.1, 0.0), (0.0, 0.0, 0.1))
KINDS = {"gantry": ("prismatic", "prismatic", "prismatic"), "scara": ("revolute", "prismatic", "revolute")}


def machine(name: str) -> Robot:
    """Three joints, along x, along z and along y or about z."""
    first, second, third = KINDS[name]
    return Robot(
        name=name,
        joints=tuple(
            Joint(
                name=axis,
                link=f"link_{axis}",
                kind=kind,  # type: ignore[arg-type]
                origin=(0.3, 0.0, 0.1),
                axis=along,
                lower=-1.0,
                upper=1.0,
                velocity=2.0,
                inertia=LinkInertia(mass=mass, center=(0.1, 0.02, 0.0), tensor=SOLID),
            )
            for axis, kind, along, mass in (
                ("x", first, (1.0, 0.0, 0.0), 9.0),
                ("z", second, (0.0, 0.0, 1.0), 5.0),
                ("y", third, (0.0, 1.0, 0.0), 2.0),
            )
        ),
        tip_origin=(0.2, 0.0, 0.0),
    )


@pytest.fixture(params=list(KINDS))
def shop(request: pytest.FixtureRequest, tmp_path: Path) -> tuple[str, Path, Path]:
    """A machine's name, its URDF, and a recording of it that moves freely."""
    robot = machine(request.param)
    write_urdf(robot, tmp_path / "machine.urdf")
    rng = np.random.default_rng(4)
    t = np.arange(0, 12, 0.01)
    w = 2 * np.pi * np.array([[0.3, 0.37, 0.43], [0.71, 0.83, 0.97]])[:, None]
    phase = w * t[:, None] + rng.uniform(0, 6, (2, 1, 3))
    q, qd, qdd = (0.25 * part.sum(axis=0) for part in (np.sin(phase), w * np.cos(phase), -w * w * np.sin(phase)))
    tau = inverse_dynamics(robot, q, qd, qdd) + 2 * np.tanh(qd / 0.02) + qd
    tau += rng.normal(0, 0.02, tau.shape)
    names = tuple(joint.name for joint in robot.joints)
    Recording(t=t, q=q, qd=qd, tau=tau, joint_names=names).save(tmp_path / "run.parquet")
    return request.param, tmp_path / "machine.urdf", tmp_path / "run.parquet"


def words(page: Path) -> str:
    """What a page says, keys of files left out."""
    text = page.read_text(encoding="utf-8")
    return re.sub(r"<style.*?</style>", "", text, flags=re.DOTALL)


def check(name: str, *texts: str) -> None:
    """A gantry has no rad and no Nm; what also turns has both, and those of what slides in brackets."""
    for text in texts:
        found = ANGULAR.findall(text)
        if name == "gantry":
            assert not found, text
        else:
            assert found, text


def test_a_recording(shop: tuple[str, Path, Path], tmp_path: Path) -> None:
    name, urdf, log = shop
    result = run("recording", "info", log, "--robot", urdf, "--picture", tmp_path / "p.svg")
    assert result.status == 0, result.err
    headings = result.out.splitlines()[2]
    check(name, headings, (tmp_path / "p.svg").read_text(encoding="utf-8"))
    wanted = ("q, m ", "qd, m/s", "tau, N ") if name == "gantry" else ("q, rad (m)", "qd, rad/s (m/s)", "tau, Nm (N)")
    assert all(heading in headings for heading in wanted), headings


def test_fits(shop: tuple[str, Path, Path], tmp_path: Path) -> None:
    name, urdf, log = shop
    # From torques alone slides do not tell a mass from their rotors.
    for options in (("--consistent",), ("--model", "payload", *(("--mass", "1") if name == "gantry" else ()))):
        result = run("identify", log, "--robot", urdf, *options, "--cutoff", "8", "-o", tmp_path / "out")
        assert result.status == 0, result.err
        check(name, result.out, words(tmp_path / "out/report.html"))
        if "--consistent" in options:
            unit = "N" if name == "gantry" else r"Nm \(N\)"
            assert re.search(rf"mean error, {unit} +sd, {unit} +rmse, {unit}$", result.out, re.MULTILINE)
            # Slides have friction in N, and in N s/m where it grows with the speed.
            assert re.search(r"\+- \S+ N  coulomb_\d", result.out)
            assert re.search(r"\+- \S+ N s/m  viscous_\d", result.out)
        if name == "gantry" and "--consistent" in options:
            rotors = re.findall(r"rotor \S+ (.*); torque error \S+ (\w+),", result.out)
            assert rotors == [("kg", "N")] * 3


def test_thresholds(shop: tuple[str, Path, Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    name, urdf, log = shop
    monkeypatch.setenv("COLUMNS", "160")
    result = run("tune", log, "--robot", urdf, "--out", tmp_path / "out")
    assert result.status == 0, result.err
    unit = "N" if name == "gantry" else "Nm (N)"
    for heading in (f"threshold, {unit}", f"95 % interval, {unit}"):
        assert f">{heading}<" in words(tmp_path / "out/report.html")
        assert heading in result.out
    terms = run("tune", log, "--robot", urdf, "--terms", "fast,speed,acceleration")
    # Headings as long as those of a scara are folded all the same.
    per = ("per speed, N s/m", "per acceleration, N s2/m") if name == "gantry" else ("Nm s/rad", "Nm s2/rad")
    assert all(heading in terms.out for heading in per)
    if name == "gantry":
        check(name, result.out, words(tmp_path / "out/report.html"))


def test_what_is_alike_at_every_pose_has_no_rank(tmp_path: Path) -> None:
    """The condition number of a gantry is the same everywhere."""
    write_urdf(machine("gantry"), tmp_path / "machine.urdf")
    (tmp_path / "s.toml").write_text(
        """
        robot = "machine.urdf"
        pose_rad = [0.1, 0.1, 0.1]
        motion = { velocity_mm_s = [0, 0, -40], task = "position" }
        contact = { body = "hand_finger" }
        detector = { thresholds_Nm = [20, 20, 20], noise_sd_Nm = 4 }
        reaction = { joint_acceleration_rad_s2 = 5 }
        """
    )
    result = run("study", "workspace", tmp_path / "s.toml", "--poses", 6, "--predict", "--out", tmp_path / "out")
    assert result.status == 0, result.err
    assert "condition number: rank correlation none" in result.out
    for text in (result.out, words(tmp_path / "out/report.html")):
        assert not re.search(r"\bnan\b", text)


def test_sensitivity(shop: tuple[str, Path, Path]) -> None:
    name, urdf, _ = shop
    result = run("sensitivity", urdf, "--pose-deg", "0.1,0.1,0.1", "--thresholds", "9,9,9")
    assert result.status == 0, result.err
    heading = next(line for line in result.out.splitlines() if "threshold" in line and "joint" in line)
    check(name, heading)
    unit = "N" if name == "gantry" else "Nm (N)"
    assert all(words in heading for words in (f"threshold, {unit} ", f"{unit} per N", f"undetected, {unit} "))
    assert f"singular values (linear, {'1' if name == 'gantry' else 'm/rad (1)'}): " in result.out
