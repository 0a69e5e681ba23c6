"""``bumpstop identify`` and ``validate`` with several recordings of joint torques, and what they carried."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import bumpstop as bs
from bumpstop.identification import with_payload
from cli.support import run, strict_json
from identification.test_dynamics_fit import COULOMB, VISCOUS, planted

ROBOT = "ur5e"
CENTER = (0.02, -0.01, 0.07)


def test_several_recordings_make_one_fit(tmp_path: Path) -> None:
    """Planted friction is found from two recordings, one with a declared payload, and a third is predicted."""
    robot = bs.Robot.load(ROBOT)
    loaded = with_payload(robot, 2.0, CENTER)
    files = []
    for number, (arm, seconds) in enumerate(((robot, 8.0), (loaded, 10.0), (robot, 8.0)), start=1):
        files.append(tmp_path / f"{number}.parquet")
        planted(arm, number, seconds=seconds).save(files[-1])
    options = ("--robot", ROBOT, "--cutoff", 6, "--payload", "2:2.0,0.02,-0.01,0.07")
    result = run("identify", *files[:2], *options, "-o", tmp_path / "out", "--json")
    assert result.status == 0, result.err
    found = strict_json(result.out)
    one = strict_json(run("identify", files[0], "--robot", ROBOT, "--cutoff", 6, "--json").out)
    assert found["rows_used"] > 2 * one["rows_used"]
    for j, joint in enumerate(found["joints"], start=1):
        for name, truth in (("coulomb", COULOMB), ("viscous", VISCOUS)):
            own = joint["parameters"][name]
            assert abs(own["value"] - truth / j) < 5 * own["standard_error"] + 0.02 * truth / j
    model = tmp_path / "out/model.toml"
    assert (tmp_path / "out/report.html").exists()
    again = strict_json(run("validate", model, files[2], "--json").out)["joints"]
    assert min(joint["r2"] for joint in again) > 0.98
    both = ("validate", model, files[2], files[1], "--json", "--out", tmp_path / "page")
    declared = strict_json(run(*both, "--payload", "2:2.0,0.02,-0.01,0.07").out)["joints"]
    silent = strict_json(run(*both).out)["joints"]
    assert declared[1]["rmse"] < 0.5 * silent[1]["rmse"]
    assert np.isclose(declared[1]["rmse"], again[1]["rmse"], rtol=0.2)


def test_what_several_recordings_cannot_be(tmp_path: Path) -> None:
    robot = bs.Robot.load(ROBOT)
    planted(robot, 1, seconds=4.0).save(tmp_path / "a.parquet")
    planted(bs.Robot.load("panda"), 1, seconds=4.0).save(tmp_path / "b.parquet")
    for options, message in (
        ((tmp_path / "b.parquet",), "7 joints"),
        (("--payload", "2:1.5"), "recordings are 1 to 1"),
        (("--known", "elbow_joint.B=3"), "--known: is for"),
    ):
        result = run("identify", tmp_path / "a.parquet", *options, "--robot", ROBOT, "--cutoff", 6)
        assert result.status == 2
        assert result.err.startswith("error: ")
        assert result.err.count("\n") == 1
        assert message in result.err
