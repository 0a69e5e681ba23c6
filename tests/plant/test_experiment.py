"""Experiment files, the command that runs them, and pictures."""

from __future__ import annotations

import json
import tomllib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.plant import Experiment
from bumpstop.plant.picture import offscreen
from bumpstop.recording import Recording
from cli.support import run, strict_json
from collision.scenario_cases import is_let_go

EXAMPLES = sorted((Path(__file__).resolve().parents[2] / "examples" / "plant").glob("*.toml"))
SHORT: dict[str, Any] = {
    "robot": "sia5d",
    "pose_deg": [0, 30, 0, -20, 0, -40, 0],
    "motion": {"kind": "line", "velocity_mm_s": [0, 0, -50], "duration_s": 0.1, "held_joints": [7]},
    "friction": {"rotor_inertia_kg_m2": 0.5},
    "object": [{"kind": "plexiglas", "ahead_mm": 2.0}],
}


def short(**changes: Any) -> dict[str, Any]:
    """The short experiment; ``table__key`` changes a key, None leaves it out."""
    data = json.loads(json.dumps(SHORT))
    for name, value in changes.items():
        *tables, key = name.split("__")
        here = data
        for table in tables:
            here = here[int(table)] if table.isdigit() else here.setdefault(table, {})
        if value is None:
            here.pop(key, None)
        else:
            here[key] = value
    return data


def written(folder: Path, text: str) -> Path:
    path = folder / "experiment.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_examples_run(path: Path) -> None:
    """Of the long ones the first second."""
    experiment = Experiment.load(path)
    plant, command = experiment.prepare()
    found = experiment.run_on(plant, type(command)(command.q[:1500], command.qd[:1500], command.react))
    assert len(found.recording.t) > 100
    assert found.recording.current is not None
    if found.reaction_time is None:
        assert np.abs(found.trace.q - command.q[1 : 1 + len(found.trace.q)]).max() < 0.02


def test_the_files_hold_what_was_true(tmp_path: Path) -> None:
    text = (
        'robot = "sia5d"\njoint_model = "sia5d"\npose_deg = [0, 30, 0, -20, 0, -40, 0]\nseed = 6\n'
        '[motion]\nkind = "line"\nvelocity_mm_s = [0, 0, -50]\nduration_s = 0.1\nheld_joints = [7]\n'
        "[friction]\nrotor_inertia_kg_m2 = 0.5\n[sensors]\nrate_hz = 1000\n"
        '[[object]]\nkind = "plexiglas"\nahead_mm = 2.0\n'
    )
    out = tmp_path / "out"
    done = run("plant", "run", written(tmp_path, text), "-o", out, "--json")
    assert done.status == 0, done.err
    said = strict_json(done.out)
    log = Recording.load(out / "recording.parquet")
    truth = tomllib.loads((out / "truth.toml").read_text(encoding="utf-8"))
    assert said["samples"] == len(log.t) == truth["run"]["samples"] == 100
    assert truth["joint"][1]["D"] == 267.345
    assert truth["joint"][1]["inertia_kg_m2"] == 0.5
    assert truth["joint"][6]["modelled"] is False
    (thing,) = truth["object"]
    assert thing["stiffness_N_m"] == 19100
    assert 0.97 * 19100 < thing["series_stiffness_N_m"] < 19100
    assert said["objects"][0]["peak_force_N"] == truth["run"]["peak_force_N"][0] > 40
    assert log.wrench is not None
    assert np.abs(log.wrench[:, 0]).max() == pytest.approx(truth["run"]["peak_force_N"][0], rel=0.02)
    assert {Path(name).name for name in said["files"]} == {"recording.parquet", "truth.toml", "trace.parquet"}
    again = run("plant", "run", tmp_path / "experiment.toml", "-o", tmp_path / "again", "--seed", 7)
    assert again.status == 0, again.err
    assert "plexiglas: 19100 N/m (published), peak" in again.out
    other = Recording.load(tmp_path / "again" / "recording.parquet")
    assert other.current is not None
    assert not np.array_equal(other.current, log.current)


def test_a_trajectory_and_a_urdf_from_beside_the_file(tmp_path: Path) -> None:
    from plant.test_mjcf import URDF

    (tmp_path / "two.urdf").write_text(URDF, encoding="utf-8")
    (tmp_path / "way.csv").write_text("t,q_1,q_2\n0,0,0\n0.1,0.02,0.005\n0.2,0.05,0.01\n", encoding="utf-8")
    text = 'robot = "two.urdf"\n[motion]\nkind = "trajectory"\nfile = "way.csv"\nhold_s = 0.05\n'
    found = Experiment.load(written(tmp_path, text)).run()
    assert found.recording.dof == 2
    np.testing.assert_allclose(found.trace.q[-1], [0.05, 0.01], atol=1e-3)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "unknown key": (short(motion__speed=3), "motion.speed: is not a key of an experiment"),
    "near key": (short(sensors__rate=250), "sensors.rate: is not a key of an experiment; did you mean 'rate_hz'?"),
    "unknown table": (short(frictoin={}), "frictoin: is not a key of an experiment; did you mean 'friction'"),
    "key of an object": (short(object__0__stifness=3), "object[1].stifness: is not a key of an experiment"),
    "kind": (short(motion__kind="lines"), "motion.kind: 'lines' cannot be used; wanted 'line', 'press'"),
    "no kind": (short(motion__kind=None), "motion.kind: is missing"),
    "no motion": (short(motion=None), "motion: is missing"),
    "missing for its kind": (short(motion__duration_s=None), "motion.duration_s: is missing"),
    "meaningless for its kind": (short(motion__way_mm=3.0), "motion.way_mm: has no meaning with kind"),
    "no pose": (short(pose_deg=None), "pose_deg: is missing"),
    "two poses": (short(pose_rad=[0.0] * 7), "pose_deg: and pose_rad are both given"),
    "short pose": (short(pose_deg=[0, 30]), "pose_deg: has 2 values; sia5d has 7 joints"),
    "range": (short(sensors__rate_hz=5000), "sensors.rate_hz: 5000 cannot be used; wanted less than or equal to 1000"),
    "text": (short(seed="one"), "seed: 'one' cannot be used; wanted a whole number"),
    "nan": (short(friction__ripple_Nm=float("nan")), "friction.ripple_Nm: nan cannot be used"),
    "wrong length": (short(friction__ripple_Nm=[1.0, 2.0]), "friction.ripple: has shape (2,); wanted (7,)"),
    "robot": (short(robot="sia5"), "robot: there is no built-in robot 'sia5'"),
    "joint model": (short(joint_model="sia5"), "joint model: none is called 'sia5'"),
    "object kind": (short(object__0__kind="hand"), "object.kind: 'hand' is neither an object nor a body region"),
    "limits of foam": (
        short(object__0__kind="foam", object__0__limits="no_such_table"),
        "object.limits: has no meaning with 'foam'; leave it out",
    ),
    "limits that are no table": (
        short(object__0__kind="hand_finger", object__0__limits="no_such_table"),
        "object.limits: no table is called 'no_such_table'",
    ),
    "limits of a gauge": (
        short(object__0__kind="gauge_hand_finger", object__0__limits="bgia2011"),
        "object.limits: has no meaning with 'gauge_hand_finger'",
    ),
    "no place": (short(object__0__ahead_mm=None), "object[1].position_mm: is missing"),
    "zero": (short(motion__velocity_mm_s=[0, 0, 0]), "motion.velocity_mm_s: is zero"),
    "folder": (short(folder="/"), "folder: is not a key of an experiment"),
    "link": (short(contact_link="hand"), "link: sia5d has no link 'hand'"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refusals(case: str) -> None:
    data, message = REFUSED[case]
    with pytest.raises(InputError) as refused:
        Experiment.from_dict(data).run()
    assert str(refused.value).startswith(message), str(refused.value)


@pytest.mark.parametrize("case", ["unknown key", "no pose", "zero", "range"])
def test_a_refusal_holds_nobody(case: str) -> None:
    """As of scenarios: the error of a validator stays in pydantic's."""
    assert is_let_go(lambda: Experiment.from_dict(REFUSED[case][0]))


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"robot = ", "is not valid TOML"),
        (b"\xff\xfe", "is not UTF-8 text (byte 1)"),
        (b"a = " + b"[" * 3000, "is not valid TOML"),
        (b"#" * 1_000_001, "is longer than 1000000 bytes"),
    ],
)
def test_damaged_files(content: bytes, message: str, tmp_path: Path) -> None:
    path = tmp_path / "experiment.toml"
    path.write_bytes(content)
    done = run("plant", "run", path)
    assert done.status == 2
    assert done.out == ""
    assert message in done.err.splitlines()[-1]
    assert done.err.startswith("error: ")


def test_bad_paths(tmp_path: Path) -> None:
    for arguments, message in (
        ((tmp_path / "none.toml",), "cannot be read (No such file or directory)"),
        ((EXAMPLES[0], "--picture", "a.jpg"), "--picture: 'a.jpg' does not end in .png"),
        ((EXAMPLES[0], "--video", "a.mp4"), "--video: 'a.mp4' does not end in .gif"),
    ):
        done = run("plant", "run", *arguments)
        assert done.status == 2
        assert message in done.err


def test_no_offscreen_library_is_said_in_a_line(monkeypatch: pytest.MonkeyPatch) -> None:
    import builtins

    real = builtins.__import__

    def without(name: str, *rest: Any) -> Any:
        if name in ("mujoco.egl", "mujoco.osmesa"):
            raise AttributeError("'NoneType' object has no attribute 'glGetError'")
        return real(name, *rest)

    monkeypatch.setattr(builtins, "__import__", without)
    with pytest.raises(InputError, match=r"no OpenGL without a screen \(egl: .*; osmesa: .*apt-get install libegl1"):
        offscreen(64, 48)


def test_pictures_show_the_arm(tmp_path: Path) -> None:
    try:
        offscreen(64, 48).free()
    except InputError as error:
        pytest.skip(str(error))
    from PIL import Image

    text = json.dumps(SHORT["pose_deg"])
    path = written(
        tmp_path,
        f'robot = "sia5d"\npose_deg = {text}\n[motion]\nkind = "line"\nvelocity_mm_s = [0, 0, -50]\nduration_s = 0.2\n'
        'held_joints = [7]\n[friction]\nrotor_inertia_kg_m2 = 0.5\n[[object]]\nkind = "foam"\nahead_mm = 2.0\n',
    )
    done = run("plant", "run", path, "--picture", tmp_path / "p.png", "--video", tmp_path / "v.gif")
    assert done.status == 0, done.err
    with Image.open(tmp_path / "p.png") as picture:
        pixels = np.asarray(picture.convert("RGB")).astype(int)
    assert pixels.shape == (720, 960, 3)
    # Foam is yellow, and nothing else is: enough of it is seen, beside the arm's grey, and not all over.
    yellow = (pixels[..., 0] > 120) & (pixels[..., 1] > 110) & (pixels[..., 2] < 0.6 * pixels[..., 0])
    assert 100 < yellow.sum() < 20_000
    with Image.open(tmp_path / "v.gif") as film:
        assert film.n_frames == 5  # type: ignore[attr-defined]
        assert film.info["duration"] == 40
