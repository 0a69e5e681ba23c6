"""Schroeder's collisions on the plant, with our detector."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("mujoco")

from bumpstop.cli.main import main
from bumpstop.detection.detection_run import STATES
from bumpstop.errors import InputError
from bumpstop.joint import JointTorqueModel
from bumpstop.model import inverse_dynamics
from bumpstop.plant import Gears, Plant, Sensors
from bumpstop.reproduction.schroeder2013.collision_table import CollisionTable
from bumpstop.reproduction.schroeder2013.collisions import (
    ARMING_S,
    PERIOD_S,
    POSE,
    ROTORS,
    CollisionExperiment,
    experiments,
)
from bumpstop.signal import differences
from plant.cases import joint_model


@pytest.mark.parametrize(("name", "speed"), [("plexiglas", 50), ("fiberboard", 75), ("glass", 25), ("banana", 10)])
def test_contact_is_noticed_inside_the_band(name: str, speed: float) -> None:
    made = CollisionExperiment(name=name)
    run = made.run(speed / 1e3, 3)
    assert run.detected
    assert not run.false_alarm
    assert run.force is not None
    assert run.delay is not None
    assert 0 < run.force < made.force_bound(speed / 1e3)
    assert run.peak > run.force
    assert 1 in run.joints
    # The alarm that the arm reacted to is the one found in its recording.
    assert run.detection.events[0].t == run.alarm_s
    assert run.run.reaction_time == pytest.approx(run.alarm_s + made.latency_s, abs=2e-3)


def test_threshold_force_is_that_of_the_source() -> None:
    # Table 4.4 lists 22.57 to 23.07 N, table 4.6 15.6 to 16.2 N for joint 2, with the arm that was there.
    assert CollisionExperiment(name="fiberboard").threshold_force() == pytest.approx(22.8, rel=0.03)
    assert CollisionExperiment(name="banana").threshold_force() == pytest.approx(15.8, rel=0.04)


def test_bound_is_the_equation_written_out() -> None:
    made = CollisionExperiment(name="plexiglas")
    lever = abs(made.lever()[1])
    assert made.force_bound(0.1) == pytest.approx(2 * 10 / lever + 19100 * 0.1 * PERIOD_S, rel=1e-12)


def test_seed_decides_everything() -> None:
    made = CollisionExperiment(name="plexiglas")
    one, two, other = made.run(0.1, 5), made.run(0.1, 5), made.run(0.1, 6)
    assert one.peak == two.peak
    assert one.alarm_s == two.alarm_s
    assert one.peak != other.peak


def test_friction_scatters_from_motion_to_motion() -> None:
    """One draw a joint and motion, with the sign of the rate: nothing of it is left between the samples of a run."""
    robot = CollisionExperiment(name="plexiglas").robot
    command = CollisionExperiment(name="plexiglas").command(0.1)
    found = {}
    for per in ("motion", "sample"):
        all_runs = [
            Plant(
                robot,
                JointTorqueModel.load("sia5d"),
                friction=Gears(rotor_inertia=list(ROTORS), scatter=scatter, scatter_per=per),  # type: ignore[arg-type]
            ).runs(command, [(Sensors(), seed) for seed in range(12)])
            for scatter in (10.0, 0.0)
        ]
        shifts = []
        for run, plain in zip(*all_runs, strict=True):
            assert run.recording.current is not None
            assert plain.recording.current is not None
            fast = np.abs(run.trace.qd[(1e3 * run.recording.t).round().astype(int) - 1, 1]) > 0.02
            shifts.append((run.recording.current - plain.recording.current)[fast, 1])
        rows = np.array(shifts)
        found[per] = (rows.mean(axis=1).std(), rows.std(axis=1).mean())
    assert found["motion"][1] < 1e-9
    # Twelve draws of sd 10: the sample's sd lies within a factor of two with a probability of 0.9999.
    assert 5.0 < found["motion"][0] < 20.0
    assert found["sample"][1] == pytest.approx(10.0, rel=0.1)
    assert found["sample"][0] < 2.0


@pytest.mark.parametrize("at", ["elbow", "forearm"])
def test_other_links_are_felt(at: str) -> None:
    made = CollisionExperiment(name="plexiglas", at=at)  # type: ignore[arg-type]
    run = made.run(0.1, 1)
    assert run.detected
    assert run.force is not None
    assert run.force < made.force_bound(0.1)
    # The wrist's sensor does not feel what another link touches.
    log = run.run.recording
    assert log.wrench is not None
    assert np.abs(log.wrench[log.t > run.contact_s][:, :3]).max() < 0.2 * run.peak


def test_lost_sample_alarms_with_naive_differences_only() -> None:
    """Table 4.4 at 100 mm/s: assumed sample times make a spike of the acceleration where one sample is missing."""
    made = CollisionExperiment(name="fiberboard")
    plant = Plant(made.robot, JointTorqueModel.load("sia5d"), sensors=Sensors(), seed=2, friction=_gears())
    log = plant.run(made.command(0.1)).recording
    gone = int(np.searchsorted(log.t, 0.6))
    keep = np.arange(len(log.t)) != gone
    t, q = log.t[keep], log.q[keep]
    assert log.current is not None
    current = log.current[keep]
    limits = made.thresholds
    assumed = t[0] + PERIOD_S * np.arange(len(t))
    over = {}
    for name, times in (("naive", assumed), ("true", t)):
        qd, qdd = differences(times, q)
        estimated = joint_model(inertia=True).torque(current[:, :6], qd[:, :6], qdd[:, :6])
        residual = estimated - inverse_dynamics(made.robot, q, qd, qdd)[:, :6]
        near = slice(gone - 2, gone + 3)
        over[name] = bool((np.abs(residual[near]) > limits[:6]).any())
    assert over == {"naive": True, "true": False}
    found = made.detector().run_rows(t, q, current)
    # The detector sees the motion begin a little after it has.
    judged = found.t > ARMING_S + 0.05
    assert not found.events
    assert found.late[gone]
    assert (found.state[judged] == STATES.index("monitoring")).all()


def _gears() -> Gears:
    return Gears(rotor_inertia=list(ROTORS))


def test_table_and_files(tmp_path: Path) -> None:
    import polars as pl

    table = CollisionTable.measure(CollisionExperiment(name="fiberboard"), runs=2, seed=4, speeds_mm_s=[150, 175])
    data = json.loads(json.dumps(table.to_json(), allow_nan=False))
    assert data["thresholds_Nm"][6] is None
    assert [row["source"]["peak_force_N"] for row in data["speeds"]] == [142.28, None]
    table.save(tmp_path)
    runs = pl.read_parquet(tmp_path / "runs.parquet")
    assert runs["seed"].to_list() == [4, 5, 4, 5]
    peaks = [run.peak for row in table.rows for run in row.runs]
    assert runs["peak_force_N"].to_list() == peaks
    samples = pl.read_parquet(tmp_path / "samples.parquet")
    assert samples.filter(pl.col("speed_mm_s") == 150)["force_N"].max() <= max(peaks[:2])


def test_command_writes_a_page(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as done:
        main(["experiment", "glass", "--runs", "1", "--speeds", "37.5", "--json", "--out", str(tmp_path)])
    assert done.value.code == 0
    data = json.loads(capsys.readouterr().out)
    assert data["speeds"][0]["source"]["force_at_detection_N"] is None
    assert data["speeds"][0]["detected"] == 1
    assert "37.5" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert (tmp_path / "run_37_5.png").exists()


@pytest.mark.parametrize(
    "changes",
    [
        {"name": "steel"},
        {"at": "knee"},
        {"residual": "none"},
        {"scatter_per": "day"},
        {"latency_s": -1},
        {"stiffness": math.nan},
        {"loss": 2},
    ],
)
def test_refusals(changes: dict[str, object]) -> None:
    with pytest.raises(InputError):
        CollisionExperiment(**({"name": "glass"} | changes))  # type: ignore[arg-type]


def test_refused_runs_and_speeds(capsys: pytest.CaptureFixture[str]) -> None:
    made = CollisionExperiment(name="glass")
    with pytest.raises(SystemExit):
        main(["experiment", "glass", "--runs", "1", "--speeds", "25,0.5"])
    assert "--speeds: has 0.5; wanted 1 to 250 mm/s" in capsys.readouterr().err
    with pytest.raises(InputError, match="runs"):
        CollisionTable.measure(made, runs=0)
    with pytest.raises(InputError, match="speed"):
        made.run(0.0)
    with pytest.raises(InputError, match="speed"):
        made.run(math.nan)


def test_tables_are_those_of_the_source() -> None:
    import os
    import tomllib

    shared = Path(os.environ.get("BUMPSTOP_SHARED", Path(__file__).resolve().parents[3] / "shared"))
    path = shared / "facts" / "dissertation.toml"
    if not path.exists():
        pytest.skip(f"{path} is not there")
    facts = tomllib.loads(path.read_text(encoding="utf-8"))
    keys = {"plexiglas": "plexiglas", "fiberboard": "fiberboard", "glass": "glovebox_glass", "banana": "banana"}
    for name in experiments():
        fact = facts[f"experiment_{keys[name]}"]
        rows = CollisionExperiment(name=name).rows()
        assert sum(row.runs for row in rows) == len(fact["speed_mm_s"])
        if name != "glass":
            peaks = [None if peak < 0 else peak for peak in fact["maximum_force_N"]]
            assert [row.peak_N for row in rows] == peaks
            assert [row.force_N for row in rows] == fact["force_at_detection_N"]
    assert math.isclose(float(POSE[1]), math.radians(30))
