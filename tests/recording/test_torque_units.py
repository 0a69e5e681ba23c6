"""Torques and times of another unit: told by what joints give, by the arm's weight, and by the rates of controllers."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from bumpstop import InputError, Robot
from bumpstop.arrays import FloatArray
from bumpstop.model import Joint, inverse_dynamics
from bumpstop.recording import Recording
from cli.support import run

ARM = Robot.load("ur10e")


def moving(rows: int = 2000, *, rest: bool = False) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Times, positions and torques with friction of an arm at 125 Hz; ``rest``: the wrist stands still, hanging."""
    t = np.arange(rows) / 125.0
    speed = 0.5 + 0.1 * np.arange(6)
    phase, size = t[:, None] * speed + np.arange(6), np.full(6, 0.4)
    if rest:
        size[3:] = 0.0
    q = size * np.sin(phase) + np.array([0.1, -1.2, 1.3, -0.6, 0.4, 0.2])
    qd, qdd = size * speed * np.cos(phase), -size * speed**2 * np.sin(phase)
    tau = inverse_dynamics(ARM, q, qd, qdd) + 5 * np.sign(qd) + np.random.default_rng(1).normal(0, 0.2, q.shape)
    return t, q, tau


def saved(folder: Path, t: FloatArray, q: FloatArray, tau: FloatArray) -> Path:
    Recording(t=t, q=q, tau=tau).save(folder / "log.parquet")
    return folder / "log.parquet"


@pytest.mark.parametrize("rest", [False, True])
@pytest.mark.parametrize("factor", [0.05, 1.0, 2.0])
def test_torques_of_this_unit_are_no_fault(factor: float, rest: bool, tmp_path: Path) -> None:
    """A wrist that rests has small ones; so has a motor's side, or a recording without the weight."""
    t, q, tau = moving(rest=rest)
    assert Recording.load(saved(tmp_path, t, q, factor * tau), robot=ARM).report.faults == ()


def test_rows_without_power_are_not_judged(tmp_path: Path) -> None:
    """Behind its brakes an arm stands with torques of zero, here in most of the rows."""
    t, q, tau = moving()
    q[:1200], tau[:1200] = q[1200], 0.0
    assert Recording.load(saved(tmp_path, t, q, tau), robot=ARM).report.faults == ()


def test_thousandths_that_carry_no_arm_are_no_other_unit(tmp_path: Path) -> None:
    t, q, tau = moving()
    (fault,) = Recording.load(saved(tmp_path, t, q, 20 * tau), robot=ARM).report.faults
    assert fault.endswith("are unit and columns right?")


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1000, r"^the torques of joint \d are \d+ Nm or more in a tenth of .*, and its limit is .* Nm: are they mNm"),
        (1e-3, r"^the torques of all joints together are 0.\d+ Nm, and the weight of the arm alone asks for .*kNm"),
    ],
)
def test_torques_off_by_a_thousand_are_a_fault(factor: float, words: str, tmp_path: Path) -> None:
    """A wrist of 5839 Nm, limit 56 Nm, was read without a note, and the fit to it was usable."""
    t, q, tau = moving()
    path = saved(tmp_path, t, q, factor * tau)
    (fault,) = Recording.load(path, robot=ARM).report.faults
    assert re.search(words, fault), fault
    assert fault in run("recording", "info", path, "--robot", "ur10e").out.replace("\n", " ")
    done = run("tune", path, "--robot", "ur10e", "--per-hour", 100, "--json")
    assert any(fault in note for note in json.loads(done.out)["notes"])


def test_torques_are_judged_without_known_limits(tmp_path: Path) -> None:
    """By what would hold the arm stretched out."""
    arm = Robot.load("sia5d")
    t = np.arange(2000) / 125.0
    phase = 0.6 * t[:, None] + np.arange(7)
    q, qd, qdd = 0.5 * np.sin(phase), 0.3 * np.cos(phase), -0.18 * np.sin(phase)
    tau = inverse_dynamics(arm, q, qd, qdd)
    assert Recording.load(saved(tmp_path, t, q, tau), robot=arm).report.faults == ()
    (fault,) = Recording.load(saved(tmp_path, t, q, 1000 * tau), robot=arm).report.faults
    assert "Nm would hold the arm stretched out: are they mNm" in fault


def test_an_arm_that_carries_no_weight_is_not_judged_by_it(tmp_path: Path) -> None:
    """The joints of a SCARA stand upright."""
    bar = ARM.joints[1].inertia
    arm = Robot(
        name="scara",
        joints=tuple(
            Joint(name=f"j{i}", link=f"l{i}", lower=-3, upper=3, velocity=4, origin=(0.3, 0, 0), inertia=bar)
            for i in range(2)
        ),
        inertia_status="unverified",
    )
    t = np.arange(500) / 125.0
    q = 0.4 * np.sin(t[:, None] + np.arange(2))
    assert Recording.load(saved(tmp_path, t, q, 1e-3 * q), robot=arm).report.faults == ()


def test_kilonewton_metres_can_be_said(tmp_path: Path) -> None:
    path = tmp_path / "run.csv"
    t, q, tau = moving(50)
    np.savetxt(path, np.hstack([t[:, None], q, 1e-3 * tau]), delimiter=",", fmt="%.12g")
    columns = {
        "time": {"column": 1},
        "position": {"columns": list(range(2, 8))},
        "torque": {"columns": list(range(8, 14)), "unit": "kNm"},
    }
    np.testing.assert_allclose(np.array(Recording.load(path, columns=columns).tau), tau, rtol=1e-9)


@pytest.mark.parametrize("robot", [ARM, None])
def test_seconds_taken_for_milliseconds_are_told(robot: Robot | None, tmp_path: Path) -> None:
    """A log was refused for jumps alone, or for degrees that it had not."""
    t, q, tau = moving()
    path = saved(tmp_path, 1e-3 * t, q, tau)
    if robot is None:
        notes = Recording.load(path).report.notes
        assert any("apart, and no controller reports at 125 kHz" in note for note in notes), notes
        return
    with pytest.raises(InputError, match=r"no controller reports at 125 kHz: are the times seconds, taken for milli"):
        Recording.load(path, robot=robot)
    # So it is where the arm rests most of the time, and moves for long enough to be refused.
    still, held = (np.concatenate([np.repeat(x[:1], 9_500, axis=0), x[::4]]) for x in (q, tau))
    times = np.arange(10_000) * 4 / 125e3
    with pytest.raises(InputError, match=r"rows are bad .*no controller reports at 31.25 kHz"):
        Recording.load(saved(tmp_path, times, still, held), robot=robot)
