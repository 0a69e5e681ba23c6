"""``bumpstop plan identification``: what it prints and leaves."""

from __future__ import annotations

import re
from pathlib import Path

from cli.support import EXAMPLE, run, strict_json

QUICK = ("--repeats", 2)


def test_trajectories_of_another_plan_do_not_stay_beside_the_new(tmp_path: Path) -> None:
    """They would be taken for its own, and run on another arm."""
    mine = tmp_path / "joint_x.csv"
    mine.write_text("mine")
    (tmp_path / "joint_9.csv").write_text("a recording, as no plan was here")
    first = run("plan", "identification", "--robot", "sia5d", "--out", tmp_path, *QUICK)
    assert (first.status, first.err) == (0, "")
    assert "removed" not in first.out
    before = {path.name for path in tmp_path.iterdir()} - {mine.name}
    assert "joint_9.csv" in before
    second = run("plan", "identification", "--robot", "ur10e", "--out", tmp_path, "--json", *QUICK)
    assert (second.status, second.err) == (0, "")
    found = strict_json(second.out)
    assert set(found["removed"]) == before - set(found["files"])
    assert {"joint_6.csv", "joint_6.json"} <= set(found["removed"])
    assert {path.name for path in tmp_path.iterdir()} == {*found["files"], mine.name}
    (tmp_path / "joint_7.json").write_text("{}")
    third = run("plan", "identification", "--robot", "ur10e", "--out", tmp_path, *QUICK)
    assert "removed, as they are of another plan: joint_7.json\n" in third.out


def test_a_plan_of_measurements_is_not_written_over(tmp_path: Path) -> None:
    """Both have a plan.toml; nor is one of identification by a plan of measurements."""
    plan = tmp_path / "plan.toml"
    plan.write_text("points = 32\n[[situation]]\n")
    (tmp_path / "joint_9.csv").write_text("a recording")
    refused = f"error: --out: {str(plan)!r} exists, and is no file of this command; give another folder\n"
    assert run("plan", "identification", "--robot", "ur10e", "--out", tmp_path, *QUICK) == (2, "", refused)
    assert plan.read_text() == "points = 32\n[[situation]]\n"
    assert (tmp_path / "joint_9.csv").read_text() == "a recording"
    plan.write_text('kind = "identification_plan"\n')
    assert run("measure", "plan", EXAMPLE, "--out", tmp_path) == (2, "", refused)
    assert plan.read_text() == 'kind = "identification_plan"\n'


def test_a_plan_that_moves_no_joint_is_refused(tmp_path: Path) -> None:
    """It says why of each joint, and leaves the plan that was there."""
    fast = ("--repeats", 1, "--ramps", 0, "--holds", 0, "--speeds", "50,100")
    assert run("plan", "identification", "--robot", "sia5d", "--out", tmp_path, *QUICK).status == 0
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    refused = run("plan", "identification", "--robot", "sia5d", "--out", tmp_path, *fast)
    assert (refused.status, refused.out) == (2, "")
    assert refused.err.startswith("error: plan: no joint of sia5d is left for it (joint_s: its axis is vertical")
    assert "joint_l, joint_e, joint_u, joint_r, joint_b: its stroke of 180 deg has room for 1 of the" in refused.err
    assert "; or slower speeds, or a higher acceleration; or " in refused.err
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before


def test_minutes_have_a_digit_where_they_are_few() -> None:
    found = run("plan", "identification", "--robot", "ur10e", "--repeats", 1, "--ramps", 0, "--holds", 0)
    minutes = re.search(r"joints, (\S+) min", found.out)
    assert minutes is not None
    assert float(minutes[1]) < 10
    assert re.fullmatch(r"\d\.\d", minutes[1])


def test_a_motion_that_hardly_tells_parameters_apart_is_told_so() -> None:
    given = ("plan", "excitation", "--robot", "ur5e", "--rounds", 0, "--periods", 1)
    assert "hardly tells parameters apart" in run(*given, "--acceleration", 0.1).out
    assert "warning" not in run(*given[:4], "--rounds", 20, "--periods", 1).out


def test_the_rate_of_the_rows_is_not_one_of_the_motion(tmp_path: Path) -> None:
    """At one row a second the curve through the points was another motion, 5 mm nearer to the floor than was told."""
    written = []
    for rate in (1, 50, 400):
        folder = tmp_path / str(rate)
        options = ("--robot", "ur5e", "--rounds", 0, "--periods", 1, "--harmonics", 8, "--period-s", 5)
        result = run("plan", "excitation", *options, "--rate", rate, "--out", folder, "--json")
        assert (result.status, result.err) == (0, "")
        written.append((folder / "excitation.json").read_bytes())
        assert len((folder / "excitation.csv").read_text().splitlines()) == 5 * rate + 2
    assert written[0] == written[1] == written[2]
    points = strict_json(written[0].decode())["points"]
    assert len(points) == 5 * 64 + 1  # forty for each period of the highest harmonic
