"""No command writes over a file that it reads: it is refused before any work, and every file stays as it was."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from cli.support import EXAMPLE, run
from recording.cases import recording

# What files hold that a command looks into before it is refused.
FILES = {
    "cols.toml": 'position = { columns = [1, 2] }\ncurrent = { columns = [1, 2], file = "cur.csv" }\n',
    "m.toml": 'robot = "arm.svg"\n',
    "e.png": 'robot = "ur10e"\n',
    "d/truth.toml": 'robot = "ur10e"\n',
    "d/joint_2/truth.toml": 'robot = "ur10e"\n',
    "d/run_1/truth.toml": 'robot = "ur10e"\n',
}
THRESHOLDS = ("--thresholds", "30,30,20,10,10,10")
UR10E = ("--robot", "ur10e")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    return tmp_path


def check(lost: str, option: str, what: str, *arguments: object) -> None:
    """The command is refused for that file, whose bytes stay."""
    for name, text in {lost: "mine\n", **FILES}.items():
        if name in (lost, *arguments):
            Path(name).parent.mkdir(parents=True, exist_ok=True)
            Path(name).write_text(text, encoding="utf-8")
    before = Path(lost).read_bytes()
    refused = f"error: {option}: {lost!r} is read, and would be written over; give another {what}\n"
    assert run(*arguments) == (2, "", refused)
    assert Path(lost).read_bytes() == before


@pytest.mark.parametrize(
    ("lost", "arguments"),
    [
        ("c.parquet", ("tune", "c.parquet", *UR10E, "--save", "c.parquet")),
        ("m.toml", ("tune", "c.parquet", "--model", "m.toml", "--save", "m.toml")),
        ("arm.svg", ("tune", "c.parquet", "--model", "m.toml", "--save", "arm.svg")),
        ("cur.csv", ("tune", "c.csv", *UR10E, "--columns", "cols.toml", "--save", "cur.csv")),
    ],
)
def test_of_tune(folder: Path, lost: str, arguments: tuple[str, ...]) -> None:
    check(lost, "--save", "file", *arguments)


def test_of_a_scenario_of_tune(folder: Path) -> None:
    text = EXAMPLE.read_text(encoding="utf-8")
    Path("s.toml").write_text(text, encoding="utf-8")
    refused = "error: --save: 's.toml' is read, and would be written over; give another file\n"
    assert run("tune", "c.parquet", *UR10E, "--scenario", "s.toml", "--save", "s.toml") == (2, "", refused)
    assert Path("s.toml").read_text(encoding="utf-8") == text


@pytest.mark.parametrize("link", [os.symlink, os.link])
def test_of_a_link(folder: Path, link: object) -> None:
    """The file has another name there."""
    Path("m.toml").write_text(FILES["m.toml"])
    assert callable(link)
    link("m.toml", "other.toml")
    refused = "error: --save: 'other.toml' is read, and would be written over; give another file\n"
    assert run("tune", "c.parquet", "--model", "m.toml", "--save", "other.toml") == (2, "", refused)
    assert Path("m.toml").read_text() == FILES["m.toml"]


@pytest.mark.parametrize(
    ("lost", "option", "arguments"),
    [
        ("m.toml", "FILE", ("detector", "m.toml", "--model", "m.toml", *THRESHOLDS)),
        ("th.toml", "FILE", ("detector", "th.toml", *UR10E, "--thresholds", "th.toml")),
        ("arm.urdf", "FILE", ("robots", "export", "arm.urdf", "arm.urdf")),
        ("arm.svg", "--picture", ("robots", "show", "arm.svg", "--picture", "arm.svg")),
        ("cur.csv", "OUT", ("recording", "convert", "pos.csv", "cur.csv", "--columns", "cols.toml")),
        ("bag/bag_0.mcap", "OUT", ("recording", "convert", "bag", "bag/bag_0.mcap")),
        ("run.svg", "--picture", ("recording", "info", "run.csv", "--columns", "run.svg", "--picture", "run.svg")),
        ("run.csv", "--jsonl", ("monitor", "run.csv", "--detector", "x.det", "--jsonl", "run.csv")),
        ("x.det", "--jsonl", ("monitor", "run.csv", "--detector", "x.det", "--jsonl", "x.det")),
        ("e.png", "--picture", ("plant", "run", "e.png", "--picture", "e.png")),
        ("arm.urdf", "--out", ("identify", "r.parquet", "--robot", "arm.urdf", "--consistent", "-o", "arm.toml")),
        ("dy.toml", "--out", ("identify", "r.parquet", *UR10E, "--dynamics", "dy.toml", "-o", "dy.toml")),
        ("col.toml", "--out", ("identify", "r.parquet", *UR10E, "--columns", "col.toml", "-o", "col.toml")),
        ("plan.toml", "--out", ("identify", "r.parquet", *UR10E, "--protocol", "plan.toml", "-o", "plan.toml")),
    ],
)
def test_of_a_file(folder: Path, lost: str, option: str, arguments: tuple[str, ...]) -> None:
    check(lost, option, "file", *arguments)


@pytest.mark.parametrize(
    ("lost", "arguments"),
    [
        ("d/residuals.parquet", ("detect", "d/residuals.parquet", *UR10E, *THRESHOLDS)),
        ("d/events.json", ("detect", "r.parquet", *UR10E, "--thresholds", "d/events.json")),
        ("d/report.html", ("score", "r.parquet", "--labels", "d/report.html", *UR10E, *THRESHOLDS)),
        ("d/report.html", ("validate", "d/report.html", "r.parquet")),
        ("d/model.urdf", ("identify", "r.parquet", "--robot", "d/model.urdf", "--consistent")),
        ("d/payload.toml", ("identify", "r.parquet", *UR10E, "--model", "payload", "--dynamics", "d/payload.toml")),
        ("d/joint_model.toml", ("identify", "r.parquet", *UR10E, "--columns", "d/joint_model.toml")),
        ("d/readings.csv", ("measure", "read", "d/readings.csv")),
        ("d/truth.toml", ("plant", "run", "d/truth.toml")),
        ("d/joint_2/truth.toml", ("plant", "run", "d/joint_2/truth.toml", "--plan", "plan.toml")),
        ("d/run_1/truth.toml", ("plant", "serve", "d/run_1/truth.toml", "--rtde", 0)),
        ("d/points.csv", ("benchmark", "detectors", "--recording", "d/points.csv")),
        ("d/joint_1.csv", ("plan", "identification", "--robot", "d/joint_1.csv")),
        ("d/excitation.csv", ("plan", "excitation", "--robot", "d/excitation.csv")),
        ("d/report.html", ("stopping", "d/report.html")),
    ],
)
def test_in_a_folder(folder: Path, lost: str, arguments: tuple[object, ...]) -> None:
    Path("d").mkdir(exist_ok=True)
    check(lost, "--out", "folder", *arguments, "-o", "d")


def test_in_the_folder_of_a_page_alone(folder: Path) -> None:
    Path("d").mkdir()
    check("d/view.png", "--record", "folder", "view", "d/view.png", "--record", "d")


def test_of_files_that_an_experiment_names(folder: Path) -> None:
    Path("recording.parquet").write_text("mine\n")
    Path("e.toml").write_text('robot = "./recording.parquet"\n')
    refused = "error: --out: 'recording.parquet' is read, and would be written over; give another folder\n"
    assert run("plant", "run", "e.toml", "-o", ".") == (2, "", refused)
    assert Path("recording.parquet").read_text() == "mine\n"


def test_of_a_register(folder: Path) -> None:
    register = Path("report.html")
    text = EXAMPLE.read_text(encoding="utf-8")
    register.write_text(text, encoding="utf-8")
    refused = "error: --out: 'report.html' is read, and would be written over; give another folder\n"
    assert run("evaluate", register, EXAMPLE, "-o", ".") == (2, "", refused)
    head = ("--cell", "c", "--author", "a", "--revision", "1")
    assert run("report", register, *head, "-o", ".") == (2, "", refused)
    assert run("report", EXAMPLE, "--shots", register, *head, "-o", ".") == (2, "", refused)
    assert register.read_text(encoding="utf-8") == text


def test_in_the_folder_of_a_bag_that_a_program_replaces(folder: Path) -> None:
    scenario = Path("d/moves/cell.toml")
    scenario.parent.mkdir(parents=True)
    text = EXAMPLE.read_text(encoding="utf-8")
    scenario.write_text(text, encoding="utf-8")
    refused = f"error: --out: {str(scenario)!r} is read, and would be written over; give another folder\n"
    assert run("program", "moves.mcap", "--scenario", scenario, "-o", "d") == (2, "", refused)
    assert scenario.read_text(encoding="utf-8") == text


def test_the_name_of_a_built_in_robot_is_no_file(folder: Path) -> None:
    """And an output of an earlier run is not in the way."""
    recording(dof=6).save("run.parquet")
    for _ in range(2):
        assert run("recording", "convert", "run.parquet", "out.parquet", *UR10E).status == 0
        assert run("robots", "export", "ur10e", "arm.txt").status == 0
