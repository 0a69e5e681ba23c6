"""Files of joint trajectories and the keys that go with them: every format, and what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision.trajectory.trajectory import Trajectory
from collision.trajectory_cases import EXAMPLE, gantry, scenario, trajectory_motion, write_csv

NAMES = ["slide_x", "slide_y", "slide_z"]


def message(**changes: Any) -> dict[str, Any]:
    points = [
        {"positions": [0.01 * i, 0.0, -0.05 * i], "time_from_start": {"sec": i, "nanosec": 500_000_000}}
        for i in range(3)
    ]
    return {"joint_names": list(NAMES), "points": points} | changes


def read(folder: Path, name: str, text: str) -> Trajectory:
    gantry(folder, speed=1.0)
    (folder / name).write_text(text, encoding="utf-8")
    problem = bs.CollisionProblem.from_scenario(scenario(folder, {"kind": "trajectory", "file": name}))
    assert problem.trajectory is not None
    return problem.trajectory


def test_the_same_motion_in_every_format(tmp_path: Path) -> None:
    import yaml

    as_json = read(tmp_path, "path.json", json.dumps(message()))
    as_yaml = read(tmp_path, "path.yaml", yaml.safe_dump(message()) + "---\n")
    turned = message(joint_names=["slide_z", "slide_x", "slide_y"])
    for i, point in enumerate(turned["points"]):
        x, y, z = point["positions"]
        point |= {"positions": [z, x, y], "velocities": [], "time_from_start": {"secs": i, "nsecs": 500_000_000}}
    in_other_order = read(tmp_path, "path.yml", yaml.safe_dump(turned))
    seconds = message()
    for i, point in enumerate(seconds["points"]):
        point["time_from_start"] = i + 0.5
    in_seconds = read(tmp_path, "seconds.json", json.dumps(seconds))
    table = read(tmp_path, "path.csv", "t,q_1,q_2,q_3\n0.5,0,0,0\n1.5,0.01,0,-5e-2\n2.5,0.02,0,-0.1\n")
    for other in (as_yaml, in_other_order, in_seconds, table):
        np.testing.assert_allclose(other.time, as_json.time, rtol=1e-15)
        np.testing.assert_array_equal(other.position, as_json.position)
        assert other.velocity is None
    assert as_json.duration == 2
    np.testing.assert_allclose(as_json.at(0.5), [0.005, 0, -0.025], atol=1e-15)


def test_velocities_are_kept(tmp_path: Path) -> None:
    path = read(
        tmp_path, "path.csv", "t,q_1,qd_1,q_2,qd_2,q_3,qd_3\n0,0,0,0,0,0,0.1\n1,0,0,0,0,0.05,0\n2,0,0,0,0,0,0\n"
    )
    assert path.velocity is not None
    np.testing.assert_allclose(path.at(np.array([0.0, 1.0, 2.0]), 1)[:, 2], [0.1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(path.at(1.0)[2], 0.05)


def test_extremes_are_those_of_a_dense_look() -> None:
    rng = np.random.default_rng(8)
    time = np.cumsum(rng.uniform(0.05, 1, 12))
    path = Trajectory(time - time[0], rng.normal(size=(12, 3)), rng.normal(size=(12, 3)))
    for derivative in (0, 1):
        at, value = path.extremes(derivative)
        for i in range(11):
            t = np.linspace(path.time[i], path.time[i + 1], 4001)
            dense = path.at(np.minimum(t, np.nextafter(path.time[i + 1], 0)), derivative)
            np.testing.assert_allclose(value[i].max(axis=0), dense.max(axis=0), atol=1e-5)
            np.testing.assert_allclose(value[i].min(axis=0), dense.min(axis=0), atol=1e-5)
            for j in range(3):
                np.testing.assert_allclose(
                    path.at(path.time[i] + at[i, 2:, j], derivative)[:, j], value[i, 2:, j], atol=1e-9
                )


def test_numbers_that_yaml_takes_for_texts(tmp_path: Path) -> None:
    text = "joint_names: [slide_x, slide_y, slide_z]\npoints:\n"
    text += "- {positions: [0, 0, 0], time_from_start: 0}\n- {positions: [1e-3, 0, -2E-2], time_from_start: 1e0}\n"
    assert read(tmp_path, "path.yaml", text).position[1].tolist() == [1e-3, 0, -2e-2]


HEAD = "t,q_1,q_2,q_3\n"
CSV_REFUSALS = {
    "no rows": ("", "no column 't'"),
    "one row": (HEAD + "0,0,0,0\n", "has 1 rows; wanted at least 2"),
    "degrees": ("t,q_1_deg,q_2,q_3\n", "column 'q_1_deg'; did you mean 'q_1'"),
    "twice": ("t,q_1,q_1,q_3\n", "the column 'q_1' twice"),
    "too few joints": ("t,q_1,q_2\n0,0,0\n", "no column 'q_3'"),
    "too many joints": ("t,q_1,q_2,q_3,q_4\n", "has a column 'q_4'"),
    "some velocities": ("t,q_1,q_2,q_3,qd_1\n", "no column 'qd_2'"),
    "no blank": (HEAD + "0,0,0\x1f,0\n", r"row 1, column q_2: '0\\x1f' cannot be used; wanted a finite number"),
    "no number": (HEAD + "0,0,0,0\n1,0,x,0\n", "row 2, column q_2: 'x' cannot be used; wanted a finite number"),
    "not finite": (HEAD + "0,0,0,0\n1,0,0,inf\n", "row 2, column q_3: inf cannot be used"),
    "NaN time": (HEAD + "0,0,0,0\nnan,0,0,0\n", "row 2, column t: nan cannot be used"),
    "too few values": (HEAD + "0,0,0,0\n1,0,0\n", "row 2 has 3 values; the header has 4"),
    "time stands": (HEAD + "0,0,0,0\n1,0,0,0\n1,0,0,0.1\n", "row 3, column t: 1 s is not after 1 s"),
    "time runs back": (HEAD + "0,0,0,0\n1,0,0,0\n0.5,0,0,0\n", "row 3, column t: 0.5 s is not after 1 s"),
    "joint limit": (HEAD + "0,0,0,0\n9,0,0,2.5\n", "row 2, column q_3: joint 3 at 2.5 is outside its limits"),
    "joint speed": (HEAD + "0,0,0,0\n1,0,1.5,0\n", "between rows 1 and 2 .*q_2: joint 2 moves at 1.5 m/s"),
    "limit between rows": (
        HEAD + "0,0,0,1.99\n4,0,0,1.99\n5,0,0,1.6\n9,0,0,1.6\n",
        "between rows 1 and 2 .*the curve through the rows takes joint 3 to .*give more rows",
    ),
    "time too great": (
        HEAD + "0,0,0,0\n1e300,0,0,0\n",
        r"row 2, column t: 1e\+300 cannot be used; wanted -1e\+12 to 1e\+12",
    ),
    "speed of one row": (
        HEAD[:-1] + ",qd_1,qd_2,qd_3\n0,0,0,0,0,0,0\n0.0005,0,0,0,0,3,0\n0.001,0,0,0,0,0,0\n9,0,0,0.1,0,0,0\n",
        "between rows 1 and 2 .*q_2: joint 2 moves at 3 m/s; its limit is 1 m/s",
    ),
    "speed next to the limit": (
        HEAD + "0,0,0,0\n1,0,1.00002,0\n",
        "joint 2 moves at 1.00002 m/s; its limit is 1 m/s",
    ),
    "too short": (HEAD + "0,0,0,0\n0.0005,0,0,0\n", "the motion takes 0.0005 s; wanted 0.001 to 120 s"),
    "too long": (HEAD + "0,0,0,0\n200,0,0,0.5\n", "the motion takes 200 s"),
}  # fmt: skip


@pytest.mark.parametrize("name", list(CSV_REFUSALS))
def test_csv_refusals(name: str, tmp_path: Path) -> None:
    text, words = CSV_REFUSALS[name]
    with pytest.raises(bs.InputError, match=words) as refused:
        read(tmp_path, "path.csv", text)
    assert refused.value.field == "motion.file"
    assert "path.csv: " in refused.value.problem


def point(**changes: Any) -> list[dict[str, Any]]:
    return [*message()["points"][:1], message()["points"][1] | changes]


MESSAGE_REFUSALS: dict[str, tuple[Any, str]] = {
    "a list": ([1, 2], "is no JointTrajectory"),
    "unknown key": (message(joint_name=[]), "'joint_name' is not a key; did you mean 'joint_names'"),
    "no points": ({"joint_names": NAMES}, "points is missing"),
    "points no list": (message(points=3), "points: 3 cannot be used; wanted a list"),
    "unknown joint": (message(joint_names=["slide_x", "slide_y", "slide_a"]), "no joint 'slide_a'; did you mean"),
    "missing joint": (message(joint_names=["slide_x", "slide_y"]), "joint_names: 'slide_z' is missing"),
    "joint twice": (message(joint_names=["slide_x", "slide_x", "slide_z"]), "'slide_x' occurs twice"),
    "point no table": (message(points=[4]), "point 1: 4 is no point"),
    "point key": (message(points=point(position=[1])), "point 2: 'position' is not a key; did you mean 'positions'"),
    "no time": (message(points=[{"positions": [0, 0, 0]}]), "point 1: time_from_start is missing"),
    "bad time": (message(points=point(time_from_start={"sec": 1})), "point 2, time_from_start: .*wanted sec and"),
    "few positions": (message(points=point(positions=[0, 1])), "point 2, positions: has 2 values; joint_names has 3"),
    "text": (message(points=point(positions=[0, "a", 0])), "point 2, positions, joint slide_y: 'a' cannot be used"),
    "true": (message(points=point(positions=[0, True, 0])), "point 2, positions, joint slide_y: True cannot be used"),
    "not finite": (message(points=point(positions=[0, 0, math.inf])), "joint slide_z: inf cannot be used"),
    "some velocities": (message(points=point(velocities=[0, 0, 0])), "point 2: velocities are given at some"),
    "no time passes": (message(points=point(time_from_start=0.5)), "point 2, column t: 0.5 s is not after 0.5 s"),
}  # fmt: skip


@pytest.mark.parametrize("name", list(MESSAGE_REFUSALS))
@pytest.mark.parametrize("kind", ["json", "yaml"])
def test_message_refusals(name: str, kind: str, tmp_path: Path) -> None:
    import yaml

    data, words = MESSAGE_REFUSALS[name]
    with pytest.raises(bs.InputError, match=words) as refused:
        read(tmp_path, f"path.{kind}", json.dumps(data) if kind == "json" else yaml.safe_dump(data))
    assert refused.value.field == "motion.file"


# Forty lines that stand for 2^40 values.
NESTED = "[&a0 {x: 1}, " + ", ".join(f"&a{i} {{l: *a{i - 1}, r: *a{i - 1}}}" for i in range(1, 41)) + "]"
MERGED = "  m0: &m0 {a: 1}\n" + "\n".join(f"  m{i}: &m{i} {{<<: [*m{i - 1}, *m{i - 1}]}}" for i in range(1, 41))


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("path.json", "{", "not valid JSON"),
        ("path.json", "[" * 100_000, "not valid JSON"),
        ("path.yaml", "a: [", "not valid YAML"),
        ("path.yaml", "!!python/object/apply:os.system [ls]", "not valid YAML"),
        # Newer versions of PyYAML count the levels themselves.
        ("path.yaml", "[" * 200_000, "nested deeper than 20 levels|maximum nesting depth"),
        ("path.yaml", "- " * 200_000, "nested deeper than 20 levels"),
        ("path.yaml", "0x" + "f" * 6000, "is no JointTrajectory"),
        ("path.yaml", "joint_names: [0x" + "f" * 6000 + "]\npoints: []", "no joint a number of more than 60 digits"),
        ("path.yaml", f"header: {NESTED}\njoint_names: [*a40]\npoints: []", "no joint a value of type dict"),
        ("path.yaml", f"header:\n{MERGED}\njoint_names: []\npoints: []", "merge keys are not read"),
        ("path.yaml", "{}\n---\n{}\n", "holds 2 trajectories; wanted one"),
        ("path.yaml", "", "is no JointTrajectory"),
        ("path.txt", "", "has the extension '.txt'; wanted one of .csv"),
    ],
)
def test_damaged_files(name: str, text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(bs.InputError, match=words):
        read(tmp_path, name, text)


def test_absent_and_endless_files(tmp_path: Path) -> None:
    gantry(tmp_path)
    with pytest.raises(bs.InputError, match=r"cannot be read \(No such file"):
        bs.CollisionProblem.from_scenario(scenario(tmp_path, trajectory_motion()))
    (tmp_path / "path.yaml").write_bytes(b" " * 5_000_001)
    with pytest.raises(bs.InputError, match="longer than 5000000 bytes"):
        bs.CollisionProblem.from_scenario(scenario(tmp_path, {"kind": "trajectory", "file": "path.yaml"}))
    (tmp_path / "path.csv").write_bytes(b"t,q_1\xff\n")
    with pytest.raises(bs.InputError, match="is not UTF-8 text"):
        bs.CollisionProblem.from_scenario(scenario(tmp_path, trajectory_motion()))


# --- Keys ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"motion": {"kind": "trajectory"}}, "motion.file", "is missing"),
        ({"motion": trajectory_motion(velocity_mm_s=[0, 0, 1])}, "motion.velocity_mm_s", "has no meaning with kind"),
        ({"motion": trajectory_motion(start="rest")}, "motion.start", "has no meaning with kind"),
        ({"motion": trajectory_motion(duration_s=1.0)}, "motion.duration_s", "has no meaning with kind"),
        ({"motion": trajectory_motion(task="pose")}, "motion.task", "has no meaning with kind"),
        ({"motion": trajectory_motion(held_joints=[])}, "motion.held_joints", "has no meaning with kind"),
        ({"motion": trajectory_motion(damping=0.0)}, "motion.damping", "has no meaning with kind"),
        ({"motion": trajectory_motion(contact_onset_s=-1.0)}, "motion.contact_onset_s", "'uniform' or a number from 0"),
        ({"motion": trajectory_motion(contact_onset_s="late")}, "motion.contact_onset_s", "wanted 'uniform' or"),
        ({"motion": {"velocity_mm_s": [0, 0, 1], "file": "a.csv"}}, "motion.file", 'has no meaning with kind = "line"'),
        ({"motion": {"velocity_mm_s": [0, 0, 1], "contact_onset_s": 1.0}}, "motion.contact_onset_s", "has no meaning"),
        ({"motion": {}, "pose_rad": [0.0, 0.0, 0.0]}, "motion.velocity_mm_s", "is missing"),
        ({"pose_rad": [0.0, 0.0, 0.0]}, "pose_rad", "has no meaning with motion.kind"),
        ({"pose_deg": [0.0, 0.0, 0.0]}, "pose_deg", "has no meaning with motion.kind"),
        ({"contact__offset_law": "uniform"}, "contact.offset_law", "motion.contact_onset_s says when contact begins"),
        ({"contact__offset_sd_s": 0.1}, "contact.offset_sd_s", "motion.contact_onset_s says when"),
        ({"contact": {"stiffness_N_m": 1e4, "offset_law": "fixed", "offset_mm": 1.0}}, "contact.offset_law", "leave"),
    ],
)  # fmt: skip
def test_key_refusals(changes: dict[str, Any], field: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(bs.InputError, match=words) as refused:
        scenario(tmp_path, changes.pop("motion", trajectory_motion()), **changes)
    assert refused.value.field == field


def test_refusals_of_the_motion(tmp_path: Path) -> None:
    gantry(tmp_path)
    t = np.array([0.0, 1.0, 2.0])
    write_csv(tmp_path / "path.csv", t, t[:, None] * [0, 0, -0.1])
    with pytest.raises(bs.InputError, match="2 s is not in the motion; wanted less than 2 s"):
        bs.evaluate(scenario(tmp_path, trajectory_motion(contact_onset_s=2.0)))
    with pytest.raises(bs.InputError, match="does not move toward the body"):
        bs.evaluate(scenario(tmp_path, trajectory_motion(contact_onset_s=1.0), contact__normal=[0, 0, 1]))
    with pytest.raises(bs.InputError, match=r"contact\.normal: the contact point never moves toward the body"):
        bs.evaluate(scenario(tmp_path, trajectory_motion(), contact__normal=[0, 0, 1]))
    with pytest.raises(bs.InputError, match="a stopping curve for every time of contact"):
        bs.stopping_curve(bs.CollisionProblem.from_scenario(scenario(tmp_path, trajectory_motion())))
    with pytest.raises(bs.InputError, match="straight lines only"):
        bs.evaluate_batch(scenario(tmp_path, trajectory_motion()), np.zeros((1, 3)), np.ones((1, 3)))


def test_a_scenario_survives_its_own_dictionary() -> None:
    loaded = bs.load_scenario(EXAMPLE)
    again = bs.Scenario.from_dict(loaded.to_dict(), loaded.folder)
    assert again == loaded
    assert again.with_values({"motion.contact_onset_s": 1.2}).motion.contact_onset_s == 1.2
