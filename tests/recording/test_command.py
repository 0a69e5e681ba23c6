"""``bumpstop recording``."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop.model import Robot
from bumpstop.recording import Recording, limits_touched
from cli.support import run
from recording.cases import COLUMNS, lines, recording, written

TOML = "header = false\ntime = { column = 1 }\nposition = { columns = [2, 3] }\n"


@pytest.mark.parametrize("ending", ["png", "svg"])
def test_info(ending: str, tmp_path: Path) -> None:
    text = lines()
    text[50] = "1,1e306,0,x"
    path = written(tmp_path, text)
    (tmp_path / "c.toml").write_text(TOML)
    picture = tmp_path / f"p.{ending}"
    result = run("recording", "info", path, "--columns", tmp_path / "c.toml", "--picture", picture)
    assert result.status == 0
    assert "median rate 100 Hz" in result.out
    assert "bad rows: 1 of 200 (impossible value 1)" in result.out
    assert "line 51: impossible value: q_1 = 1e+306" in result.out
    assert picture.stat().st_size > 1000


def test_limits_touched(tmp_path: Path) -> None:
    robot, path = Robot.load("ur10"), tmp_path / "run.parquet"
    within = recording(dof=6)
    within.save(path)
    assert "limits touched: none" in run("recording", "info", path, "--robot", "ur10").out
    q, qd = within.q.copy(), np.array(within.qd)
    # Towards the limits and back, no faster than the joints turn.
    way = 0.01 * np.arange(200)
    q[:, 0], q[:, 2] = robot.upper[0] - np.abs(way - 0.03), robot.upper[2] + 0.005 - np.abs(way - 0.05)
    q[:, 1] = robot.lower[1] + np.abs(way - 0.04)
    qd[7:10, 1], qd[11, 4] = -robot.velocity[1], 2 * robot.velocity[4]
    beyond = replace(within, q=q, qd=qd)
    touched = {name: rows.tolist() for name, rows in limits_touched(beyond, robot).items()}
    assert touched == {"position": [1, 1, 1, 0, 0, 0], "velocity": [0, 3, 0, 0, 1, 0]}
    assert limits_touched(replace(beyond, qd=None), robot).keys() == {"position"}
    beyond.save(path)
    assert "limits touched: 7 times" in run("recording", "info", path, "--robot", "ur10").out


def test_a_robot_with_two_chains(tmp_path: Path) -> None:
    arms = "".join(
        f'<link name="{side}"/><joint name="{side}_joint" type="continuous"><parent link="torso"/>'
        f'<child link="{side}"/></joint>'
        for side in ("left", "right")
    )
    (tmp_path / "two.urdf").write_text(f'<robot name="two"><link name="torso"/>{arms}</robot>')
    recording(dof=1).save(tmp_path / "run.parquet")
    given = (tmp_path / "run.parquet", "--robot", tmp_path / "two.urdf")
    assert "error: --tip: is missing, and two.urdf has 2 ends" in run("recording", "info", *given).err
    assert run("recording", "info", *given, "--tip", "left").status == 0
    assert run("recording", "convert", given[0], tmp_path / "out.csv", *given[1:], "--tip", "right").status == 0
    assert "error: --tip: has no meaning without --robot" in run("recording", "info", given[0], "--tip", "left").err


@pytest.mark.parametrize("ending", ["parquet", "csv", "mcap"])
@pytest.mark.parametrize(
    "absent", [{}, {"tau": None}, {"wrench": None}, {"q_ref": None}, {"joint_names": ()}, {"robot": ""}]
)
def test_convert_says_what_is_lost(absent: dict[str, Any], ending: str, tmp_path: Path) -> None:
    before, out = replace(recording(), **absent), tmp_path / f"out.{ending}"
    before.save(tmp_path / "run.parquet")
    result = run("recording", "convert", tmp_path / "run.parquet", out)
    assert result.status == 0, result.err
    # A bag that holds no torque holds the current in its place.
    in_place = {"effort": "current"} if ending == "mcap" and before.tau is None else None
    after = Recording.load(out, columns=in_place)
    assert after.t.size == 200
    names = ("q", "qd", "current", "tau", "wrench", "q_ref", "joint_names", "robot")
    had, has = (
        {name for name in names if getattr(one, name) is not None and len(getattr(one, name))}
        for one in (before, after)
    )
    assert ('give a column file with effort = "current"' in result.out) == (in_place is not None)
    said = result.out.partition("no place for it: ")[2].partition("\n")[0]
    assert {name.replace(" ", "_") for name in said.split(", ") if name} == had - has


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("info", "none.csv"), "error: none.csv: there is no such file"),
        (("info", "run.csv"), "error: run.csv: has no header"),
        (("info", "run.csv", "--columns", "none.toml"), "error: --columns: 'none.toml' cannot be read"),
        (("info", "run.csv", "--picture", "p.gif"), "error: --picture"),
        (("info", "run.csv", "--max-bad", "2"), "error: --max-bad: is 2; wanted a share from 0 to 1"),
        (("info", "run.csv", "--topic", "/x"), "error: --topic: 'run.csv' is no bag"),
        (("info", "run.csv", "--columns", "c.toml", "--robot", "ur10"), "error: run.csv: holds 2 joints, ur10 has 6"),
        (("convert", "run.csv", "out.xyz", "--columns", "c.toml"), "error: out.xyz: '.xyz' is no ending"),
        (("convert", "run.csv", "./run.csv", "--columns", "c.toml"), "error: OUT: 'run.csv' is read, and would be"),
        (("convert", "run.csv", "no/out.mcap", "--columns", "c.toml"), "error: no/out.mcap: cannot be written"),
        (("convert", "run.csv", "no/out.parquet", "--columns", "c.toml"), "error: no/out.parquet: cannot be written"),
    ],
)
def test_errors(arguments: tuple[str, ...], message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    written(tmp_path, lines())
    Path("c.toml").write_text(TOML)
    result = run("recording", *arguments)
    assert result.status == 2
    assert result.err.startswith(message)
    assert len(result.err.splitlines()) == 1


def test_columns_of_the_cases_are_those_of_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, lines())
    (tmp_path / "c.toml").write_text(TOML)
    by_file, by_dict = Recording.load(path, columns=tmp_path / "c.toml"), Recording.load(path, columns=COLUMNS)
    assert (by_file.q == by_dict.q).all()


def test_one_joint_is_no_joints_and_a_rate_has_four_digits(tmp_path: Path) -> None:
    t = np.cumsum(np.full(300, 1 / 29.9999))
    Recording(t=t, q=np.sin(t)[:, None]).save(tmp_path / "one.parquet")
    result = run("recording", "info", tmp_path / "one.parquet")
    assert result.status == 0, result.err
    assert "300 rows, 1 joint\n" in result.out
    assert "median rate 30 Hz" in result.out


def test_times_have_as_many_digits_as_mean_something(tmp_path: Path) -> None:
    """Four of a duration, and times with as many decimals, also where they count from 1970."""
    path = tmp_path / "run.parquet"
    log = recording(dof=6)

    def decimal(seconds: float) -> str:
        return f"{seconds:.3f}".rstrip("0").rstrip(".")

    t = np.cumsum(np.full(log.t.size, 0.0333417)) + 0.1234567
    t[100:] += 0.7654321
    replace(log, t=t).save(path)
    said = run("recording", "info", path).out
    assert f"time: {decimal(t[0])} to {decimal(t[-1])} s ({t[-1] - t[0]:.4g} s), median rate 29.99 Hz" in said
    assert f"gaps: 1: 798.8 ms at {decimal(t[99])} s" in said
    replace(log, t=t + 1.6e9).save(path)
    said = run("recording", "info", path).out
    assert f"time: {decimal(1.6e9 + t[0])} to {decimal(1.6e9 + t[-1])} s ({t[-1] - t[0]:.4g} s)" in said


@pytest.mark.parametrize(
    ("said", "told"),
    [("ur10e", True), ("ur5", True), ("ur5e", False), ("UR5e", False), ("ur5e_robot", False), ("", False),
     ("/arms/ur10e.urdf", False), ("arm.urdf", False)],
)  # fmt: skip
def test_a_recording_that_names_another_robot_is_told(said: str, told: bool, tmp_path: Path) -> None:
    """A path is no name, and a URDF may call its arm by more words."""
    path = tmp_path / "run.parquet"
    replace(recording(dof=6), robot=said).save(path)
    note = f"The file names robot '{said}', and is read as a recording of 'ur5e'"
    assert (note in run("recording", "info", path, "--robot", "ur5e").out) == told
    assert "The file names robot" not in run("recording", "info", path).out
    assert any(note in one for one in Recording.load(path, robot=Robot.load("ur5e")).report.notes) == told


@pytest.mark.parametrize("what", ["turns", "jump", "negated", "nothing"])
def test_convert_tells_what_info_tells(what: str, tmp_path: Path) -> None:
    """Data that the reader changed or doubted went into the new file without a word."""
    t = np.arange(2000) / 250
    q = np.stack([np.sin(t) * (4.0 if what == "turns" else 1.0), 0.5 * np.sin(1.3 * t)], axis=1)
    qd = np.gradient(q, t, axis=0)
    if what == "turns":
        q[:, 0] = np.mod(q[:, 0] + np.pi, 2 * np.pi) - np.pi
    if what == "jump":
        q[1000:, 0] += 0.8
    if what == "negated":
        qd[:, 0] *= -1
    path, out = tmp_path / "run.parquet", tmp_path / "out.parquet"
    Recording(t=t, q=q, qd=qd).save(path)
    marks = ("repaired rows: ", "fault: ", "note: ")
    wanted = [line for line in run("recording", "info", path).out.splitlines() if line.startswith(marks)]
    told = run("recording", "convert", path, out)
    assert told.status == 0
    assert told.out.splitlines()[1:] == wanted
    assert bool(wanted) == (what != "nothing")
