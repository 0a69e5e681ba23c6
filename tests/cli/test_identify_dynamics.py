"""``bumpstop identify`` and ``validate`` with several recordings of joint torques, and what they carried."""

from __future__ import annotations

from pathlib import Path

import numpy as np

import bumpstop as bs
from bumpstop.identification import with_payload
from cli.support import run, strict_json
from identification.test_dynamics_fit import COULOMB, VISCOUS, planted
from identification.test_gains_fit import GAINS, LOAD, currents

ROBOT = "ur5e"
CENTER = (0.02, -0.01, 0.07)


def test_several_recordings_make_one_fit(tmp_path: Path) -> None:
    """Planted friction is found from two recordings, one with a declared payload, and a third is predicted."""
    robot = bs.Robot.load(ROBOT)
    loaded = with_payload(robot, 2.0, CENTER)
    files = []
    for number, (arm, seconds) in enumerate(((robot, 6.0), (loaded, 8.0), (robot, 6.0)), start=1):
        files.append(tmp_path / f"{number}.parquet")
        planted(arm, number, seconds=seconds).save(files[-1])
    options = ("--robot", ROBOT, "--cutoff", 6, "--payload", "2:2.0,0.02,-0.01,0.07")
    result = run("identify", *files[:2], *options, "-o", tmp_path / "arm.toml", "--json")
    assert result.status == 0, result.err
    found = strict_json(result.out)
    one = strict_json(run("identify", files[0], "--robot", ROBOT, "--cutoff", 6, "--json").out)
    assert found["rows_used"] > 2 * one["rows_used"]
    for j, joint in enumerate(found["joints"], start=1):
        for name, truth in (("coulomb", COULOMB), ("viscous", VISCOUS)):
            own = joint["parameters"][name]
            assert abs(own["value"] - truth / j) < 5 * own["standard_error"] + 0.02 * truth / j
    model = tmp_path / "arm.toml"
    again = strict_json(run("validate", model, files[2], "--json").out)["joints"]
    assert min(joint["r2"] for joint in again) > 0.98
    both = ("validate", model, files[2], files[1], "--json")
    declared = strict_json(run(*both, "--payload", "2:2.0,0.02,-0.01,0.07").out)["joints"]
    silent = strict_json(run(*both).out)["joints"]
    assert declared[1]["rmse"] < 0.5 * silent[1]["rmse"]
    assert np.isclose(declared[1]["rmse"], again[1]["rmse"], rtol=0.25)


def test_what_several_recordings_cannot_be(tmp_path: Path) -> None:
    robot = bs.Robot.load(ROBOT)
    planted(robot, 1, seconds=4.0).save(tmp_path / "a.parquet")
    planted(bs.Robot.load("panda"), 1, seconds=4.0).save(tmp_path / "b.parquet")
    for options, message in (
        ((tmp_path / "b.parquet",), "7 joints"),
        (("--payload", "2:1.5"), "recordings are 1 to 1"),
        (("--known", "elbow_joint.B=3"), "--known: is for drives, and torques were recorded"),
        *(
            (("--shared-motor", group), "--shared-motor: ")
            for group in ("5", "5,5", "5,7", "0,5", "5,6:0", "5,6:nan", "5,x", "")
        ),
    ):
        result = run("identify", tmp_path / "a.parquet", *options, "--robot", ROBOT, "--cutoff", 6)
        assert result.status == 2
        assert result.err.startswith("error: ")
        assert result.err.count("\n") == 1
        assert message in result.err


def test_gains_and_dynamics_from_currents(tmp_path: Path) -> None:
    """A load that one recording carries gives the scale; the model then predicts the torque behind other currents."""
    robot = bs.Robot.load(ROBOT)
    bare, loaded = tmp_path / "bare.parquet", tmp_path / "loaded.parquet"
    currents(robot, 1).save(bare)
    currents(with_payload(robot, LOAD.mass, LOAD.center), 2).save(loaded)
    options = ("--robot", ROBOT, "--model", "dynamics", "--cutoff", 10)
    told = ("--payload", "2:3.0,0.03,0,0.08")
    result = run("identify", bare, loaded, *options, *told, "-o", tmp_path / "arm.toml", "--json")
    assert result.status == 0, result.err
    found = strict_json(result.out)
    for joint, truth in zip(found["joints"], GAINS, strict=True):
        gain = joint["parameters"]["B"]
        assert abs(gain["value"] - truth) < 4.5 * gain["standard_error"]
    compared = strict_json(run("validate", tmp_path / "arm.toml", loaded, "--payload", "3,0.03,0,0.08", "--json").out)
    assert min(joint["r2"] for joint in compared["joints"][:4]) > 0.98
    words = run("identify", bare, *options, "--known", f"elbow_joint.B={GAINS[2]}").out
    assert "elbow_joint: 10 (given) Nm/A" in words
    assert "wrist_3_joint: cannot be seen" in words
    for more, message in (
        ((), "gains: their scale cannot be seen: nothing known is carried"),
        (("--payload", "3"), "gains: their scale cannot be seen: all recordings carry the same"),
        (("--known", "elbow_joint.inertia=3"), "--known: elbow_joint.inertia is no gain"),
        (("--known", "elbow.B=3"), "'elbow' is no joint of ur5e"),
        (("--shared-motor", "5,6"), "--shared-motor: is for torques"),
    ):
        refused = run("identify", bare, *options, *more)
        assert refused.status == 2
        assert refused.err.count("\n") == 1
        assert message in refused.err
