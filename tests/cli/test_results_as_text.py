"""``str`` of a result is what its command prints: one implementation for both."""

from __future__ import annotations

import tomllib
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.stopping import fit_stopping, load_stopping_table
from bumpstop.detection import ResidualSeries, tune
from bumpstop.model import inverse_dynamics
from bumpstop.study import run as run_study
from cli.support import REPOSITORY, run

UR5E = bs.Robot.load("ur5e")
TM5_700 = REPOSITORY / "examples" / "stopping" / "tm5_700.toml"
EXAMPLE = REPOSITORY / "examples" / "01_hand_downward.toml"


@pytest.fixture(autouse=True)
def wide_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "120")


def pushed(tmp_path: Path) -> Path:
    """A recording of an arm at rest that is pushed from half a second on."""
    t = np.arange(0, 1, 0.004)
    q = np.tile([0.1, -1.2, 1.4, -0.5, 0.3, 0.2], (t.size, 1)) + 1e-6 * np.sin(40 * t)[:, None]
    tau = inverse_dynamics(UR5E, q, 0 * q, 0 * q) + np.where(t >= 0.5, 30.0, 0.0)[:, None]
    path = tmp_path / "pushed.parquet"
    bs.Recording(t=t, q=q, tau=tau, robot="ur5e").save(path)
    return path


def test_a_run_of_the_detector(tmp_path: Path) -> None:
    path = pushed(tmp_path)
    printed = run("detect", path, "--robot", "ur5e", "--thresholds", "20,20,20,10,10,10")
    found = bs.detect(bs.Recording.load(path), UR5E, None, [20, 20, 20, 10, 10, 10])
    assert found.events
    assert str(found).splitlines()[0] in printed.out
    table = [line for line in str(found).splitlines() if line.split()[0] == "0.5000"]
    assert len(table) == len(found.events)
    for line in table:
        assert " ".join(line.split()) in " ".join(printed.out.split())
    assert "force at flange along 0 0 -1, of the arm on the body" in str(found)


def test_a_fit_of_stopping_distances() -> None:
    found = str(fit_stopping(load_stopping_table(TM5_700)))
    assert run("stopping", TM5_700).out.split() == found.split()
    assert tomllib.loads(found[found.index("[reaction]") :])["reaction"]["kind"] == "stop"


def test_a_requirement() -> None:
    found = bs.solve_requirement(bs.load_scenario(EXAMPLE), "motion.speed")
    printed = run("require", EXAMPLE, "--vary", "motion.speed").out
    assert printed == f"{found}\n"
    assert f"motion.speed: at most {found.value:g} mm/s" in printed


def test_a_study() -> None:
    study = bs.ParameterStudy.of(bs.load_scenario(EXAMPLE), ["motion.speed=20:80"])
    printed = run("study", "parameters", EXAMPLE, "--vary", "motion.speed=20:80").out
    assert printed.startswith(f"{run_study(study)}\n")


def test_tuned_thresholds_name_every_joint() -> None:
    rng = np.random.default_rng(3)
    rows = rng.normal(size=(20_000, 2)) * [1.0, 2.0]
    found = tune(ResidualSeries(np.arange(20_000) * 0.004, rows))
    first, _, *joints = str(found).splitlines()
    assert first.startswith(f"{found.target:.4g} false alarms an hour; 95 % interval ")
    for j, (line, threshold) in enumerate(zip(joints, found.thresholds(), strict=True), start=1):
        assert line.split()[:2] == [str(j), f"{threshold:.4g}"]
