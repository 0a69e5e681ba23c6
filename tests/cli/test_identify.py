"""``bumpstop identify`` and ``validate`` where currents were recorded, and every damaged recording through them."""

from __future__ import annotations

import os
import tomllib
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.cli.identification.arm_recordings import load_parts
from bumpstop.identification import with_payload
from bumpstop.joint import JointTorqueModel
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from cli.support import run, strict_json
from identification.drives import driven, fourier, planted

ROBOT = "ur5e"


@cache
def arm_and_logs() -> tuple[bs.Robot, JointTorqueModel, Recording, Recording]:
    robot = bs.Robot.load(ROBOT)
    truth, log = planted(robot, fourier(robot, 20.0, 94.0, 1), 1)
    return robot, truth, log, driven(robot, fourier(robot, 10.0, 94.0, 2), truth, 2)


@pytest.mark.usefixtures("unsaved_pictures")
def test_a_recording_whose_name_is_no_text(tmp_path: Path) -> None:
    """Model and page show it with escapes, as errors do."""
    path = tmp_path / os.fsdecode(b"run\xff.parquet")
    arm_and_logs()[2].save(path)
    made = run("identify", path, "--robot", ROBOT, "--cutoff", 6, "-o", tmp_path / "model")
    assert (made.status, made.err) == (0, "")
    model = tmp_path / "model" / "joint_model.toml"
    assert JointTorqueModel.load(model).created_from == str(tmp_path / r"run\udcff.parquet")
    compared = run("validate", model, path, "-o", tmp_path / "page")
    assert (compared.status, compared.err) == (0, "")
    assert r"run\udcff.parquet" in (tmp_path / "page" / "report.html").read_text(encoding="utf-8")


def in_milliamperes(log: Recording, path: Path, spoil: int = 0) -> Path:
    """A CSV file without names at uneven times, currents in mA, with so many rows that are no numbers."""
    rng = np.random.default_rng(1)
    assert log.current is not None
    t = log.t + rng.uniform(-0.0005, 0.0005, log.t.size)
    table = np.column_stack([t, log.q, 1000 * log.current])
    lines = [",".join(f"{value:.7g}" for value in row) for row in table]
    for place in rng.choice(len(lines), spoil, replace=False):
        lines[place] = "nan,1e306,garbage"
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    columns = [f"time = {{ column = 1 }}\nposition = {{ columns = {list(range(2, 8))} }}\nformat = 'csv'"]
    columns += [f"header = false\ncurrent = {{ columns = {list(range(8, 14))}, unit = 'mA' }}"]
    (path.parent / "columns.toml").write_text("\n".join(columns) + "\n", encoding="utf-8")
    return path


@pytest.mark.usefixtures("unsaved_pictures")
def test_from_a_text_file_to_a_validated_model(tmp_path: Path) -> None:
    _, truth, log, other = arm_and_logs()
    first = in_milliamperes(log, tmp_path / "one.csv", spoil=3)
    model = tmp_path / "joint_model.toml"
    options = ("--robot", ROBOT, "--columns", tmp_path / "columns.toml")
    result = run("identify", first, *options, "-o", model, "--json")
    assert result.status == 0, result.err
    found = strict_json(result.out)
    assert found["rows_dropped"] == 3
    assert found["rows_used"] > 0.95 * log.t.size
    assert [joint["name"] for joint in found["joints"]] == [joint.name for joint in truth.joints]
    for joint, own in zip(found["joints"], truth.joints, strict=True):
        assert joint["observable"]
        assert joint["r2"] > 0.95
        assert 0 < joint["rmse_A"] < 0.1
        assert joint["parameters"]["B"]["value"] == pytest.approx(own.value("B"), rel=0.1)
        assert joint["parameters"]["hysteresis"] == {"value": None, "standard_error": None}
        assert joint["candidates"]
    assert found["filter"]["cutoff_hz"] > 0
    assert JointTorqueModel.load(model).robot == ROBOT
    second = in_milliamperes(other, tmp_path / "two.csv")
    result = run(
        "validate", model, first, second, "--columns", tmp_path / "columns.toml", "--json", "--out", tmp_path / "page"
    )
    page = (tmp_path / "page" / "report.html").read_text(encoding="utf-8")
    scores = [joint["torque"] for joint in strict_json(result.out)["joints"]]
    assert all(f"{score['r2']:.4f}" in page for score in scores if score["r2"] is not None)
    assert result.status == 0, result.err
    compared = strict_json(result.out)["joints"]
    assert all(set(joint) >= {"name", "r2", "r2_raw", "mean", "sd", "rmse", "unit"} for joint in compared)
    assert all(joint["unit"] == "A" and joint["torque"]["unit"] == "Nm" for joint in compared)
    assert min(joint["r2"] for joint in compared) > 0.97
    told = [note for note in strict_json(result.out)["notes"] if "the model was fitted to this recording" in note]
    assert [note.split(":")[0] for note in told] == [str(first)]


def test_words_for_people(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    robot, _, log, _ = arm_and_logs()
    log.save(tmp_path / "log.parquet")
    result = run("identify", tmp_path / "log.parquet", "--robot", ROBOT, "--payload", "0.0", "-o", tmp_path / "m")
    assert result.status == 0, result.err
    assert "5-fold cross-validation error" in (tmp_path / "m" / "report.html").read_text(encoding="utf-8")
    assert "shoulder_pan_joint: hysteresis is not identifiable" in result.out
    assert "5-fold cross-validation error" in result.out
    # However narrow the terminal is, names are whole and every parameter stands on its joint's line.
    lines = result.out.splitlines()
    told = lines[lines.index("parameters, with their standard errors:") + 1 :][: robot.dof]
    for joint, line in zip(JointTorqueModel.load(tmp_path / "m" / "joint_model.toml").joints, told, strict=True):
        seen = {name: found for name, found in joint.parameters.items() if found is not None}
        figures = (f"{name} {found.value:.4g} +- {found.standard_error:.2g}" for name, found in seen.items())
        assert line == f"  {joint.name}: {', '.join(figures)}"
    result = run("validate", tmp_path / "m" / "joint_model.toml", tmp_path / "log.parquet")
    assert result.status == 0, result.err
    assert "torque estimated from current" in result.out


def test_what_is_recorded_chooses_the_model(tmp_path: Path) -> None:
    _, _, log, _ = arm_and_logs()
    both = replace(log, tau=log.current)
    both.save(tmp_path / "both.parquet")
    dynamics = strict_json(run("identify", tmp_path / "both.parquet", "--robot", ROBOT, "--cutoff", 5, "--json").out)
    assert "base_parameters" in dynamics
    options = ("--robot", ROBOT, "--cutoff", 5, "--model", "joint", "--json")
    assert strict_json(run("identify", tmp_path / "both.parquet", *options).out)["kind"] == "joint_model"


def test_a_payload_that_the_controller_was_told_of_is_no_note_once_it_is_declared(tmp_path: Path) -> None:
    names = [
        "timestamp",
        *(f"actual_q_{j}" for j in range(6)),
        "payload",
        *(f"payload_cog_{axis}" for axis in range(3)),
    ]
    rows = [",".join(names), *(f"{0.01 * i}" + ",0.1" * 6 + ",1.07,0,0,0.058" for i in range(60))]
    path, arm = tmp_path / "log.csv", bs.Robot.load("ur5e")
    path.write_text("\n".join(rows) + "\n")
    for given, noted in (
        (None, True),
        (["1.07"], True),
        (["1.07,0,0,0.058"], False),
        (["1:1.07,0,0,0.058"], False),
    ):
        (log,) = load_parts([path], None, arm, None, None, None, 0.01, given)
        assert any("told of a payload" in note for note in log.report.notes) == noted


def test_a_payload_is_found_and_told_as_the_next_fit_wants_it(tmp_path: Path) -> None:
    robot, truth, _, _ = arm_and_logs()
    center = (0.02, -0.01, 0.08)
    carried = driven(with_payload(robot, 2.0, center), fourier(robot, 10.0, 94.0, 3), truth, 3)
    log = tmp_path / "carried \U0001f9be.parquet"
    carried.save(log)
    truth.save(tmp_path / "joint_model.toml")
    options = ("--robot", ROBOT, "--model", "payload", "--joint-model", tmp_path / "joint_model.toml")
    result = run("identify", log, *options, "-o", tmp_path / "out", "--json")
    assert result.status == 0, result.err
    found = strict_json(result.out)
    mass = found["parameters"]["m"]
    assert abs(mass["value"] - 2.0) < 4 * mass["standard_error"]
    for value, error, planted_at in zip(
        found["center_m"]["value"], found["center_m"]["standard_error"], center, strict=True
    ):
        assert abs(value - planted_at) < 4 * error
    assert all(joint["rmse_Nm"] < joint["rmse_without_payload_Nm"] for joint in found["joints"])
    kept = tomllib.loads((tmp_path / "out/payload.toml").read_text(encoding="utf-8"))
    assert kept["created_from"] == str(log)
    assert kept["m"] == mass
    assert kept["center_m"]["value"] == found["center_m"]["value"]
    assert "Torque that the payload explains" in (tmp_path / "out/report.html").read_text(encoding="utf-8")
    words = run("identify", log, *options).out
    (line,) = [line for line in words.splitlines() if line.startswith("for --payload: ")]
    assert [float(x) for x in line.split(": ")[1].split(",")] == pytest.approx(
        [mass["value"], *found["center_m"]["value"]], rel=1e-3
    )


def test_inertias_that_bodies_can_have_are_written_for_other_programs(tmp_path: Path) -> None:
    robot = bs.Robot.load(ROBOT)
    t, q, qd, qdd = fourier(robot, 10.0, 94.0, 4)
    tau = inverse_dynamics(robot, q, qd, qdd) + 2.0 * np.sign(qd)
    Recording(t=t, q=q, tau=tau + np.random.default_rng(1).normal(size=tau.shape)).save(tmp_path / "log.parquet")
    options = ("--robot", ROBOT, "--cutoff", 5, "--consistent", "-o", tmp_path / "arm.toml", "--json")
    result = run("identify", tmp_path / "log.parquet", *options)
    assert result.status == 0, result.err
    found = strict_json(result.out)["consistent"]
    again = bs.Robot.from_urdf(tmp_path / "arm.urdf")
    for link, joint in zip(found["links"], again.joints, strict=True):
        assert joint.inertia is not None
        assert joint.inertia.mass == pytest.approx(link["mass_kg"], rel=1e-6)
        low, middle, high = np.linalg.eigvalsh(np.array(link["tensor_kg_m2"]))
        assert low > 0
        assert high < low + middle
    for joint in found["joints"]:
        assert joint["rmse_Nm"] < 1.1 * joint["rmse_unconstrained_Nm"]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--payload", "1,2"), "--payload: '1,2' cannot be used; for example 1.5,0,0,0.06"),
        (("--payload", "3:1"), "recordings are 1 to 1"),
        (("--payload", "-1"), "--payload: is -1.0 kg"),
        (("--known", "elbow=2"), "--known: 'elbow=2' cannot be used"),
        (("--known", "elbow_jiont.B=2"), "did you mean 'elbow_joint'?"),
        (("--cutoff", "-3"), "--cutoff: is -3.0"),
        (("--model", "dynamics", "--cutoff", "nan"), "--cutoff: is nan"),
        (("--shared-motor", "5,6"), "--shared-motor: is for dynamics"),
        (("--from", "30"), "leaves nothing"),
        (("--out", "absent/model.toml"), "--out: 'absent/model.toml' cannot be written"),
        (("--max-bad", "7"), "--max-bad: is 7"),
        (("--consistent",), "--consistent: is for dynamics, not for joint models"),
        (("--second-moments",), "--second-moments: is for a payload, not for joint models"),
        (("--model", "payload"), "--joint-model: is missing"),
        (("--model", "payload", "--joint-model", "sia5d"), "--robot: is 'ur5e', and the model was fitted to 'sia5d'"),
        (("--model", "payload", "--joint-model", "absent.toml"), "absent.toml"),
        (("--model", "payload", "--consistent"), "--consistent: is for dynamics"),
        (
            ("--model", "dynamics", "--second-moments"),
            "--second-moments: is for a payload, not for dynamics; give --model payload",
        ),
        (("--model", "payload", "--shared-motor", "5,6"), "--shared-motor: is for dynamics"),
    ],
)
def test_options_that_cannot_be_used(options: tuple[str, ...], message: str, tmp_path: Path) -> None:
    _, _, log, _ = arm_and_logs()
    log.between(0, 8).save(tmp_path / "log.parquet")
    result = run("identify", tmp_path / "log.parquet", "--robot", ROBOT, *options)
    assert result.status == 2
    assert result.err.startswith("error: ")
    assert result.err.count("\n") == 1
    assert message in result.err


def test_an_arm_that_stands_still_shows_no_gain(tmp_path: Path) -> None:
    """Its torque over its current is a number, but friction may carry any part of the torque."""
    log = arm_and_logs()[2].between(0, 8)
    assert log.current is not None
    current = 1.0 + 0.01 * np.random.default_rng(1).normal(size=log.q.shape)
    Recording(t=log.t, q=np.tile(log.q[:1], (log.t.size, 1)), current=current).save(tmp_path / "log.parquet")
    result = run("identify", tmp_path / "log.parquet", "--robot", ROBOT, "--json")
    assert result.status == 3
    found = strict_json(result.out)
    assert found["verdict"]["faults"] == ["no joint shows its gain in this motion"]
    assert not any(joint["observable"] for joint in found["joints"])
    assert sum("friction may carry any part" in warning for warning in found["warnings"]) >= 2


def text_of(log: Recording) -> list[str]:
    assert log.current is not None
    names = ["t", *(f"q_{j}" for j in range(1, 7)), *(f"current_{j}" for j in range(1, 7))]
    rows = np.column_stack([log.t, log.q, log.current])
    return [",".join(names), *(",".join(f"{value:.7g}" for value in row) for row in rows)]


def in_degrees(lines: list[str]) -> list[str]:
    rows = (line.split(",") for line in lines[1:])
    turned = (",".join([r[0], *(str(80 + 57.3 * float(x)) for x in r[1:7]), *r[7:]]) for r in rows)
    return [lines[0], *turned]


DAMAGE: dict[str, tuple[Any, str]] = {
    "many truncated rows": (lambda lines: [line if i % 9 else line[:20] for i, line in enumerate(lines, 1)], "field"),
    "garbage values": (lambda lines: [lines[0], *(line + "e306" for line in lines[1:])], "rows are bad"),
    "a column too many": (
        lambda lines: [lines[0], *(line + ",1" for line in lines[1:])],
        "line 1 names 13 columns",
    ),
    "empty": (lambda lines: [], "is empty"),
    "names alone": (lambda lines: lines[:1], "has no row of data"),
    "constant time": (lambda lines: [lines[0], *("1" + line[line.index(",") :] for line in lines[1:])], "stands still"),
    "no currents": (
        lambda lines: [",".join(line.split(",")[:7]) for line in lines],
        "has neither motor currents nor joint torques",
    ),
    "a name twice": (lambda lines: [lines[0].replace("q_2", "q_1"), *lines[1:]], "has 2 columns 'q_1'"),
    "five joints": (lambda lines: [",".join(line.split(",")[:6]) for line in lines], "holds 5 joints"),
    "degrees": (in_degrees, "degrees taken for radians"),
    "few rows": (lambda lines: lines[:30], "segment of 50 rows"),
}


@pytest.mark.parametrize("damage", list(DAMAGE))
def test_damaged_text_files(damage: str, tmp_path: Path) -> None:
    spoil, message = DAMAGE[damage]
    _, _, log, _ = arm_and_logs()
    lines = spoil(text_of(log.between(0, 6)))
    path = tmp_path / "log.csv"
    path.write_text("".join(line + "\n" for line in lines), encoding="utf-8")
    result = run("identify", path, "--robot", ROBOT, "--cutoff", 8)
    assert result.status == 2, result.out
    assert result.err.startswith("error: ")
    assert result.err.count("\n") == 1
    assert message in result.err, result.err


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ("wrong topic", "has no topic '/jont_states'; did you mean '/joint_states'?"),
        ("wrong names", "joint_names: no joint is called"),
        ("truncated", "ends in the middle"),
        ("not a bag", "log.mcap"),
        ("a model", "log.mcap"),
    ],
)
def test_damaged_bags(damage: str, message: str, tmp_path: Path) -> None:
    """Two topics and unknown types of messages take the same way, and are tried in tests/recording."""
    _, _, log, _ = arm_and_logs()
    right = tuple(joint.name for joint in arm_and_logs()[1].joints)
    names = tuple(f"x{j}" for j in range(6)) if damage == "wrong names" else right
    path = tmp_path / "log.mcap"
    replace(log, joint_names=names).save(path)
    columns = tmp_path / "columns.toml"
    columns.write_text('effort = "current"\n', encoding="utf-8")
    options: list[Any] = ["--robot", ROBOT, "--columns", columns]
    if damage == "wrong topic":
        options += ["--topic", "/jont_states"]
    if damage == "truncated":
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 6 // 10])
    if damage == "not a bag":
        path.write_bytes(b"no bag at all" * 9)
    result = run("validate", path, path) if damage == "a model" else run("identify", path, *options)
    assert result.status == 2, result.out
    assert result.err.count("\n") == 1
    assert result.err.startswith("error: ")
    assert message in result.err, result.err


def test_the_file_of_a_joint_model_says_what_its_fit_was_worth(tmp_path: Path) -> None:
    robot, truth, log, _ = arm_and_logs()
    log.save(tmp_path / "log.parquet")
    model, bad, old = (tmp_path / f"{name}.toml" for name in ("model", "bad", "old"))
    result = run("identify", tmp_path / "log.parquet", "--robot", ROBOT, "-o", model)
    verdict = result.out.removeprefix("verdict: ").split(" (")[0]
    assert JointTorqueModel.load(model).verdict == verdict == "usable"
    text = model.read_text(encoding="utf-8")
    bad.write_text(text.replace('verdict = "usable"', 'verdict = "not usable"'), encoding="utf-8")
    old.write_text(text.replace('verdict = "usable"\n', ""), encoding="utf-8")
    assert JointTorqueModel.load(old).verdict == ""
    carried = driven(with_payload(robot, 2.0, (0.02, -0.01, 0.08)), fourier(robot, 10.0, 94.0, 3), truth, 3)
    carried.save(tmp_path / "carried.parquet")
    said = "the model comes of a fit that was judged not usable"
    limits = ("--thresholds", "90,90,90,30,30,30")
    for file, told in ((model, False), (old, False), (bad, True)):
        for use in (
            ("tune", tmp_path / "log.parquet", "--model", file),
            ("detect", tmp_path / "log.parquet", "--model", file, *limits),
            ("detector", tmp_path / "arm.det", "--model", file, *limits, "--period", 0.01),
            ("validate", file, tmp_path / "log.parquet"),
        ):
            result = run(*use)
            assert result.status == 0, result.err
            assert (said in result.out) == told, use
        fit = ("identify", tmp_path / "carried.parquet", "--robot", ROBOT, "--model", "payload", "--joint-model", file)
        result = run(*fit)
        assert (f"not usable: {said}" in result.out) == told
        assert result.status == (3 if told else 0)


def test_a_refused_fit_says_what_the_times_look_like(tmp_path: Path) -> None:
    """Milliseconds for seconds: "0.125 rows a second" alone sent nobody to the column of the times."""
    log = arm_and_logs()[2]
    path, model = tmp_path / "ms.parquet", tmp_path / "model.toml"
    replace(log, t=1e3 * log.t).save(path)
    arm_and_logs()[1].save(model)
    said = 'if these are no seconds, say so in a column file (time = { ..., unit = "ms" })'
    refused = run("identify", path, "--robot", ROBOT)
    assert (refused.status, said in refused.err) == (2, True)
    judged = run("validate", model, path)
    assert (judged.status, "verdict: not usable" in judged.out, said in judged.out) == (3, True, True)
