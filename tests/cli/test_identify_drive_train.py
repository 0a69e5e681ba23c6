"""``bumpstop identify --model drive-train``: a file that a scenario may name, and what it refuses."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from bumpstop.model import Robot, load_drive_train
from cli.support import run, strict_json
from identification.drive_train.test_drive_train_fit import STIFFNESS, pushes
from identification.test_dynamics_fit import ROTOR, planted


def push_table(path: Path, robot: Robot) -> None:
    made = pushes(robot, STIFFNESS, 25, 4)
    assert made.displacement is not None
    names = [f"q_{j}" for j in range(1, 7)] + [f"force_{x}_N" for x in "xyz"] + [f"displacement_{x}_mm" for x in "xyz"]
    rows = np.column_stack([made.q, made.force, 1e3 * made.displacement]).tolist()
    path.write_text("\n".join([",".join(names), *(",".join(map(repr, row)) for row in rows)]) + "\n")


def test_a_drive_train_file(tmp_path: Path) -> None:
    robot = Robot.load("ur5e")
    planted(robot, 1).save(tmp_path / "log.parquet")
    push_table(tmp_path / "pushes.csv", robot)
    options = ("--robot", "ur5e", "--model", "drive-train", "--pushes", tmp_path / "pushes.csv")
    result = run("identify", tmp_path / "log.parquet", *options, "-o", tmp_path / "out")
    assert result.status == 0, result.err
    lines = [line.strip() for line in result.out.splitlines()]
    assert "rotor inertia:" in lines
    assert any(line.startswith("shoulder_pan_joint: 0.") and line.endswith(" kg m2") for line in lines)
    assert "wrist_3_joint: not identified: no push loads it" in lines
    assert "servo bandwidth: not looked for: no recording has references (q_ref)" in lines
    file = tmp_path / "out" / "drive_train.toml"
    assert f"drive train: {file}" in lines
    found = load_drive_train(file, robot)
    assert abs(found.rotor_inertia[0] - ROTOR) < 0.15
    np.testing.assert_allclose(found.gear_stiffness[:5], STIFFNESS[:5], rtol=0.1)
    told = strict_json(run("identify", tmp_path / "log.parquet", *options, "--json").out)
    assert told["identified"] == ["rotor_inertia", "gear_stiffness"]
    gears = told["quantities"]["gear_stiffness"]
    assert gears["values"][5] is None
    assert gears["values"][0] == found.gear_stiffness[0]
    assert gears["status"] == "assumed", "one gear is"
    assert "q_ref" in told["not_looked_for"]["servo_bandwidth"]
    assert told["warnings"] == []
    # Gears need no recording.
    alone = strict_json(run("identify", *options, "--json").out)
    assert alone["quantities"]["gear_stiffness"] == gears
    assert run("identify", *options[:2], *options[4:], "--json").out == run("identify", *options, "--json").out
    for option, value in (("--payload", "2"), ("--cutoff", "4"), ("--gravity", "0,0,9.8")):
        silent = run("identify", *options, option, value)
        assert (silent.status, f"error: {option}: has no meaning with pushes alone" in silent.err) == (2, True)
    refused = run("identify", *options[:4])
    assert (refused.status, "error: recordings: there are none; wanted" in refused.err) == (2, True)


def test_nothing_to_tell(tmp_path: Path) -> None:
    robot = Robot.load("ur5e")
    log = planted(robot, 1, seconds=4.0)
    from dataclasses import replace

    replace(log, tau=None).save(tmp_path / "log.parquet")
    given = ("identify", tmp_path / "log.parquet", "--robot", "ur5e", "--model", "drive-train")
    result = run(*given, "-o", tmp_path / "x.toml")
    assert result.status == 3
    assert "NOT USABLE  Nothing of the drive train was identified." in result.out
    assert not (tmp_path / "x.toml").exists()
    log.save(tmp_path / "log.parquet")
    for options, message in (
        (("--consistent",), "error: --consistent: is for dynamics, not for a drive train"),
        (("--pushes", tmp_path / "none.csv"), "none.csv"),
    ):
        refused = run(*given, *options)
        assert refused.status == 2
        assert message in refused.err
    refused = run("identify", tmp_path / "log.parquet", "--robot", "ur5e", "--pushes", tmp_path / "p.csv")
    assert (refused.status, "error: --pushes: is for a drive train, not for dynamics" in refused.err) == (2, True)
