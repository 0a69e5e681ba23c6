"""Every refusal of the command line: status 2, one line that names field, value and remedy, nothing on stdout."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

import bumpstop as bs
from bumpstop.identification import DynamicsFit
from bumpstop.joint import JointTorqueModel
from cli.support import EXAMPLE, Result, evaluate, run


def check_refusal(result: Result, *words: str) -> None:
    assert result.status == 2
    assert result.out == ""
    assert result.err.startswith("error: ")
    assert result.err.endswith("\n")
    assert result.err.count("\n") == 1
    assert result.err.rstrip("\n").isprintable()
    for word in words:
        assert word in result.err
    # Neither a traceback, nor a box, nor the libraries' own words.
    for leak in ("Traceback", "│", "╭", "pydantic", "Input should", "nanobind", "Usage:"):
        assert leak not in result.err


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (
            ("study", "speed-limits", EXAMPLE, "--max-speed", "fast"),
            "--max-speed: 'fast' cannot be used; wanted a number",
        ),
        (
            ("study", "effectiveness", EXAMPLE, "--speed", "9", "--speed", "1,5"),
            "--speed: '1,5' cannot be used;",
        ),
        (("require", EXAMPLE, "--vary", "motion.speed", "--risk", ""), "--risk: '' cannot be used; wanted a number"),
        *(
            (
                ("require", EXAMPLE, "--vary", f"motion.speed={span}"),
                f"--vary: 'motion.speed={span}' is not KEY=LOW:HIGH",
            )
            for span in ("10", "10:200:20", "10:200:log", "[10, 20]", "")
        ),
        (
            ("plan", "identification", "--robot", "ur5e", "--speeds", "50,200"),
            "--speeds: 200 % cannot be used; wanted a",
        ),
        (
            ("plan", "identification", "--robot", "ur5e", "--speeds", "50,60"),
            "--speeds: 50 %, 60 %: speeds so alike show no friction that depends on speed; wanted two at least",
        ),
        (("plan", "identification", "--robot", "ur5e", "--ramps", "-1"), "--ramps: is -1; wanted 0 to 1000"),
        (("plan", "identification", "--robot", "ur5e", "--hold-s", "nan"), "--hold-s: is nan; wanted 1 to 3600"),
        (("plan", "identification", "--robot", "ur5e", "--repeats", "12345678"), "--repeats: is 12345678; wanted 1"),
        (("plan", "excitation", "--robot", "ur5e", "--speed-percent", "nan"), "--speed-percent: nan % cannot be used;"),
        (("plan", "excitation", "--robot", "ur5e", "--period-s", "0"), "--period-s: is 0.0; wanted 1 to 600"),
        (("experiment", "glass", "--runs", "2.5"), "--runs: '2.5' cannot be used; wanted a whole number"),
        (("experiment", "glass", "--runs", "0"), "--runs: is 0; wanted 1 to 100000"),
        (("experiment", "glass", "--latency", "-1"), "--latency: is -1.0; wanted 0 to 1"),
        (("experiment", "glass", "--runs", "100", "--out", EXAMPLE), "01_hand_downward.toml' cannot be written"),
        (
            ("plant", "run", EXAMPLE.parent / "plant" / "01_press_foam.toml", "--seed", "-1"),
            "--seed: -1 cannot be used; wanted greater than or equal to 0",
        ),
        (("experiment", "glass", "--seed", "1e3"), "--seed: '1e3' cannot be used; wanted a whole number"),
    ],
)
def test_an_option_is_refused_by_its_own_name_and_before_any_work(arguments: tuple[object, ...], words: str) -> None:
    check_refusal(run(*arguments), words)


@pytest.mark.parametrize("option", [("--out", ""), ("--out=",), ("-o", "")])
def test_an_empty_folder_is_not_the_current_one(
    option: tuple[str, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    command = ("experiment", "glass") if "-o" in option else ("evaluate", EXAMPLE)
    check_refusal(run(*command, *option), "--out: is empty; wanted a folder")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ("contact.area_cm2=0", "contact.area_cm2: 0 cannot be used; wanted a number from 0.0001 to 10000"),
        ("contact.area_cm2=wide", "contact.area_cm2: 'wide' cannot be used; wanted a number"),
        ("contact.area_cm2=", "contact.area_cm2: '' cannot be used; wanted a number"),
        ("contact.area_cm2=true", "contact.area_cm2: true cannot be used; wanted a number"),
        ("contact.area_cm2=2020-01-02", "contact.area_cm2: 2020-01-02 cannot be used"),
        ("contact.area_cm2=1e400", "contact.area_cm2: inf cannot be used"),
        ("contact.area_cm2=" + "9" * 400, "contact.area_cm2: a number of more than 40 digits cannot be used"),
        ("contact.area_cm2=" + "9" * 5000, "contact.area_cm2: '99"),
        ("contact.area_cm2=" + "[" * 5000 + "]" * 5000, "contact.area_cm2: '[["),
        ("contact.area_cm2=1\nother=2", r"contact.area_cm2: '1\nother=2' cannot be used"),
        ("contact.ara_cm2=5", "contact.ara_cm2: is not a key of a scenario; did you mean 'area_cm2'"),
        ("contact.body=hand", "contact.body: 'hand' is not a region of bgia2011; did you mean 'hand_finger'?"),
        (
            "contact.body=arm",
            "contact.body: 'arm' is not a region of bgia2011; did you mean 'upper_arm_elbow' or 'lower_arm",
        ),
        ("contact.body=skull_forehead", "but of ts15066, which must not be mixed with it"),
        ("contact.body=\x1b[31mred", r"contact.body: '\x1b[31mred'"),
        ("contact.limits=absent.toml", "absent.toml' cannot be read (No such"),
        ("contact.limits=ts1506", "contact.limits: no table is called 'ts1506'"),
        ("contact.limits=/tmp", "contact.limits: '/tmp' is a folder"),
        ("contact.kind=free", "contact.body_mass_kg: is missing; free contact needs it: bgia2011 gives no mass"),
        ("detector.residuals=absent.parquet", "detector.residuals: "),
        ("motion.kind=trajectory", 'motion.velocity_mm_s: has no meaning with kind = "trajectory"; leave it out'),
        ("detector.thresholds_Nm=[1, 2]", "detector.thresholds_Nm: has 2 values; sia5d has 7 joints"),
        ("detector.thresholds_Nm=[1, 0, 3, 4, 5, 6, 7]", "detector.thresholds_Nm[2]: 0 cannot be used"),
        ("detector.noise_sd_Nm=nan", "detector.noise_sd_Nm: nan cannot be used; wanted a number from 0 to 1e6, or"),
        ("detector.feedback_period_s=0.0055", "detector.feedback_period_s: 0.0055 is not a whole number of simulation"),
        ("motion.velocity_mm_s=[0, 0", "motion.velocity_mm_s: '[0, 0' cannot be used; wanted a list of 3 numbers"),
        ("motion.velocity_mm_s=[0,0,0]", "motion.velocity_mm_s: is zero"),
        ("motion.held_joints=[8]", "motion.held_joints: 8 is no joint of sia5d; valid: 1 to 7"),
        ("motion.held_joints=[1, 2]", "motion.task: 'pose' needs 6 free joints, 5 are free"),
        ("pose_deg=[0, 0, 0, 0, 0, 0, 0]", "pose_deg: is singular"),
        (
            "pose_rad=[0, 3, 0, 0, 0, 0, 0]",
            "pose_rad: joint 2 at 3 is outside its limits; valid: -1.91986 to 1.91986 rad",
        ),
        ("pose_deg=[0, 0, 0, 0, 0, 0, 181]", "pose_deg: joint 7 at 181 is outside its limits; valid: -180 to 180 deg"),
        ("robot=sia5", "robot: there is no built-in robot 'sia5'; did you mean 'sia5d'?"),
        ("robot=absent.urdf", "absent.urdf: cannot be read (No such file or directory); wanted a URDF file"),
        ("tip=tool0", "tip: has no meaning with the built-in robot 'sia5d'; give it with the path of a URDF"),
        ("base=5", "base: 5 cannot be used; wanted the name of a link of the URDF"),
        ("robot.x=5", "robot.x: 'robot' is not a table"),
        ("contact.area_cm2.x=5", "contact.area_cm2.x: 'area_cm2' is not a table"),
        ("contact.link=link", "contact.link: sia5d has no link 'link'; did you mean 'link_"),
        ("contact.normal=[0, 0, 1]", "contact.normal: the contact point on tool0 does not move toward the body"),
        ("folder=/tmp", "folder: is not a key of a scenario"),
        ("made_by.seed=5", "made_by.seed: is not a key of a scenario; [made_by] only records how a result was made"),
        ("pose_deg[2]=5", "'pose_deg[2]': is not a key of a scenario; did you mean 'pose_deg'"),
        ("uncertainty.pose_deg[2]={interval=[9, 9.5]}", 'uncertainty."pose_deg[2]": 9 to 9.5 leaves out the value'),
        ('uncertainty."pose_deg[2]"={interval=[9, 9.5]}', 'uncertainty."pose_deg[2]": 9 to 9.5 leaves out the value'),
        # Not KEY=VALUE.
        ("contact", "--set: 'contact' is not KEY=VALUE; for example --set contact.area_cm2=2"),
        ("", "--set: '' is not KEY=VALUE"),
        ("=5", "--set: '=5' is not KEY=VALUE"),
        ("contact..x=5", "--set: 'contact..x=5' is not KEY=VALUE"),
        (".=5", "--set: '.=5' is not KEY=VALUE"),
        ("'contact.area_cm2'=5", "is not KEY=VALUE"),
    ],
)
def test_changes_that_cannot_be_used(change: str, words: str) -> None:
    check_refusal(evaluate(change), words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--sampled", "0"), "--sampled: '0' cannot be used; wanted a whole number from 1 to 100000000"),
        (("--sampled", "-5"), "--sampled: '-5' cannot be used"),
        (("--sampled", "many"), "--sampled: 'many' cannot be used; wanted a whole number from 1"),
        (("--sampled", "1e3"), "--sampled: '1e3' cannot be used"),
        (("--sampled", "1.5"), "--sampled: '1.5' cannot be used"),
        (("--sampled", "9" * 5000), "--sampled: '99"),
        (("--seed", "-1"), "--seed: '-1' cannot be used; wanted a whole number from 0 to 18446744073709551615"),
        (("--seed", str(2**64)), "--seed: '18446744073709551616' cannot be used"),
        (("--threads", "0"), "--threads: '0' cannot be used; wanted a whole number from 1 to 256"),
        (("--threads", "1000000"), "--threads: '1000000' cannot be used"),
        (("--jsn",), "No such option: --jsn (Possible options: --json"),
        (("--set",), "Option '--set' requires an argument; see bumpstop --help"),
        (("second.toml",), "second.toml: cannot be read (No such file or directory); wanted a scenario file"),
    ],
)
def test_options_that_cannot_be_used(arguments: tuple[str, ...], words: str) -> None:
    check_refusal(evaluate(options=arguments), words)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("evalute",), "No such command 'evalute'. Did you mean 'evaluate'"),
        (("xyzzy",), "No such command 'xyzzy'; see bumpstop --help"),
        (("--bogus",), "No such option: --bogus"),
        (("evaluate",), "Missing argument 'SCENARIO...'; see bumpstop evaluate --help"),
        (("robots", "sia5d"), "No such command 'sia5d'"),
        (("robots", "show"), "Missing argument 'robot'; see bumpstop robots show --help"),
        (("robots", "show", "sia5"), "robot: there is no built-in robot 'sia5'; did you mean 'sia5d'?"),
        (("robots", "show", "absent.urdf"), "absent.urdf: cannot be read (No such file or directory)"),
        (("robots", "show", "sia5d", "--tip", "tool0"), "--tip: has no meaning with the built-in robot 'sia5d'; give"),
        (("robots", "show", "sia5d", "--base", "b"), "--base: has no meaning with the built-in robot 'sia5d'"),
        (
            ("identify", "a.csv", "--robot", "sia5d", "--tip", "t"),
            "--tip: has no meaning with the built-in robot 'sia5d'",
        ),
        (("plan", "excitation", "--robot", "ur5e", "--base", "b"), "--base: has no meaning with the built-in robot"),
        (
            ("plan", "identification", "--robot", "ur5e", "--load-m", "0,0,0.1"),
            "--load-m: has no effect without --load-kg; give both, or neither",
        ),
        (
            ("study", "parameters", EXAMPLE, "--vary", "detector.observer_gain_1_s=10:80"),
            "--vary: 'detector.observer_gain_1_s' has no effect with detector.residual = \"direct\"",
        ),
        (("robots", "show", "sia5d", "--picture", "a.pdf"), "--picture: 'a.pdf' is neither .png nor .svg; for example"),
        (
            ("robots", "show", "sia5d", "--picture", "absent/a.png"),
            "--picture: 'absent/a.png' cannot be written (No such",
        ),
        (
            ("bodies", "--limits", "bgia"),
            "--limits: no table is called 'bgia'; a built-in name or a path ending in .toml",
        ),
        (("bodies", "--limits", "absent.toml"), "--limits: 'absent.toml' cannot be read (No such file"),
    ],
)
def test_commands_that_cannot_be_used(arguments: tuple[object, ...], words: str) -> None:
    check_refusal(run(*arguments), words)


def test_files_that_are_no_scenario(tmp_path: Path) -> None:
    absent, binary, empty = tmp_path / "absent.toml", tmp_path / "binary.toml", tmp_path / "empty.toml"
    binary.write_bytes(bytes(range(256)))
    empty.write_text("")
    check_refusal(run("evaluate", absent), f"{absent}: cannot be read (No such file or directory)")
    check_refusal(run("evaluate", tmp_path), f"{tmp_path}: is a folder")
    check_refusal(run("evaluate", binary), f"{binary}: is not UTF-8 text (byte 129)")
    check_refusal(run("evaluate", empty), "robot: is missing; wanted the name of a robot (bumpstop robots lists them)")
    check_refusal(run("evaluate", "/dev/zero"), "/dev/zero: is longer than 1000000 bytes")


@pytest.mark.parametrize(
    "command",
    [
        ("evaluate", "FILE"),
        ("require", "FILE", "--vary", "motion.speed"),
        ("study", "parameters", "FILE"),
        ("bodies", "--limits", "FILE"),
        ("sensitivity", "ur5e", "--pose-deg", "10,-80,110,-120,-90,20", "--thresholds", "FILE"),
        ("detect", "absent.csv", "--model", "FILE", "--thresholds", "1"),
        ("detect", "absent.csv", "--robot", "ur5e", "--thresholds", "FILE"),
        ("recording", "info", EXAMPLE.parent / "06_pick_and_place.csv", "--columns", "FILE"),
        ("score", "absent.parquet", "--labels", "FILE", "--thresholds", "1"),
        ("validate", "FILE", "absent.csv"),
        ("identify", "absent.csv", "--robot", "ur5e", "--protocol", "FILE"),
        ("plant", "run", "FILE"),
        ("plant", "run", EXAMPLE.parent / "plant" / "01_press_foam.toml", "--plan", "FILE"),
    ],
)
def test_text_that_is_none(command: tuple[object, ...], tmp_path: Path) -> None:
    binary = tmp_path / "binary.toml"
    binary.write_bytes(bytes(range(256)))
    for file, words in (
        (binary, "is not UTF-8 text (byte 129); wanted "),
        ("/dev/zero", "is longer than "),
        (tmp_path / "absent.toml", "cannot be read (No such file or directory); wanted "),
    ):
        check_refusal(run(*(file if part == "FILE" else part for part in command)), str(file), words)


@pytest.mark.parametrize(
    "command",
    [
        ("plan", "excitation", "--robot", "ur5e"),
        ("plant", "run", EXAMPLE.parent / "plant" / "01_press_foam.toml"),
        ("experiment", "glass"),
        ("evaluate", "absent.toml"),
        ("identify", "absent.csv", "--robot", "ur5e"),
        ("validate", "absent.toml", "absent.csv"),
        ("tune", "absent.csv", "--robot", "ur5e"),
        ("score", "absent.json", "--labels", "absent.csv"),
    ],
)
def test_a_folder_is_looked_at_before_any_work(command: tuple[object, ...], tmp_path: Path) -> None:
    (tmp_path / "file").write_text("here first")
    for name in ("file", "file/below"):
        check_refusal(run(*command, "--out", tmp_path / name), "--out: ", "cannot be written (Not a directory)")
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.parametrize(
    ("command", "name", "words"),
    [
        (("identify", "absent.csv", "--robot", "ur5e", "--out"), "none/model.toml", "--out: "),
        (("tune", "absent.csv", "--robot", "ur5e", "--save"), "none/limits.toml", "--save: "),
        (("tune", "absent.csv", "--robot", "ur5e", "--save"), "", "--save: "),
    ],
)
def test_a_file_is_looked_at_before_any_work(command: tuple[str, ...], name: str, words: str, tmp_path: Path) -> None:
    check_refusal(run(*command, tmp_path / name), words, "cannot be written (", "give another file")


def test_a_name_cannot_steer_the_terminal() -> None:
    check_refusal(run("evaluate", "a\nb\x1b[31m\u202e.toml"), r"error: a b\x1b[31m\u202e.toml: cannot be read")
    check_refusal(run("evaluate", os.fsdecode(b"a\xff.toml")), r"error: a\udcff.toml: cannot be read")


@pytest.mark.parametrize("spoilt", ["file/below", "file"])
def test_a_folder_that_cannot_be_made(tmp_path: Path, spoilt: str) -> None:
    (tmp_path / "file").write_text("here first")
    folder = tmp_path / spoilt
    check_refusal(evaluate(options=("--out", folder)), f"--out: {str(folder)!r} cannot be written (", "another folder")
    assert (tmp_path / "file").read_text() == "here first"


@pytest.mark.parametrize("name", ["settings.toml", "law.parquet"])
def test_a_file_that_cannot_be_written(tmp_path: Path, name: str) -> None:
    (tmp_path / name).mkdir()
    check_refusal(evaluate(options=("--out", tmp_path)), "--out: ", "cannot be written (", "irectory")


def test_refused_before_anything_is_written(tmp_path: Path) -> None:
    folder = tmp_path / "out"
    check_refusal(evaluate("contact.area_cm2=0", options=("--out", folder)))
    assert not folder.exists()
    assert EXAMPLE.exists()


def test_the_folder_of_a_fit_is_no_model(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """``identify -o fit`` writes fit/model.toml; ``--model fit`` was told that no built-in model is called so."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "fit").mkdir()
    (tmp_path / "fit" / "model.toml").write_text('kind = "dynamics"\n')
    (tmp_path / "log.csv").write_text("t,q_1\n0,0\n1,0\n")
    words = "joint model: 'fit' is a folder; wanted a joint model (TOML); in it is fit/model.toml"
    for command in (
        ("tune", "log.csv", "--model", "fit"),
        ("detect", "log.csv", "--model", "fit", "--thresholds", "9"),
        ("detector", "arm.detector", "--model", "fit", "--thresholds", "9"),
        ("sensitivity", "ur5e", "--pose-deg", "0,0,0,0,0,0", "--thresholds", "9,9,9,9,9,9", "--model", "fit"),
        ("validate", "fit", "log.csv"),
    ):
        check_refusal(run(*command), words)
    with pytest.raises(bs.InputError, match=r"^fit: is a folder; .*in it is fit/model.toml"):
        DynamicsFit.load("fit")
    (tmp_path / "empty").mkdir()
    check_refusal(run("evaluate", "empty"), "empty: is a folder")


@pytest.mark.parametrize("name", ["", "x" * 5000, "a\0b"])
def test_what_is_no_name_is_no_folder_either(name: str) -> None:
    with pytest.raises(bs.InputError, match=r"^joint model: none is called '"):
        JointTorqueModel.load(name)
