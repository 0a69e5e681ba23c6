"""Thresholds are tuned on recordings whose channels are as the model has them; what is dead or wrong is told."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.detection import residual_record
from bumpstop.identification.unexplained import unexplained
from bumpstop.recording import Recording
from cli.support import run, strict_json
from identification.drives import driven, fourier
from identification.drives import planted as with_drives
from identification.test_dynamics_fit import planted
from identification.verdict_cases import good, with_current


def test_currents_that_are_dead_or_wrong_are_told() -> None:
    robot = bs.Robot.load("ur5e")
    model, log = with_drives(robot, fourier(robot, 12.0, 94.0, 1), 1)
    assert log.current is not None

    def told(joint: int, column: np.ndarray) -> str:
        spoilt = with_current(log, joint, column)
        return " ".join(unexplained(spoilt, robot, model, residual_record(spoilt, robot, model).rows))

    own = log.current[:, 2]
    assert told(2, own) == ""
    assert told(2, 1.2 * own) == ""
    assert told(
        2, np.full_like(own, 1.0)
    ) == "the current of elbow_joint is constant while the joint moves: is it the " + ("right column?")
    assert "of the current of elbow_joint is not predicted" in told(2, -own)
    top = 0.5 * np.abs(own).max()
    assert "current of elbow_joint stands at an end of its range" in told(2, np.clip(own, -top, top))


def test_a_payload_that_is_declared_is_none_of_it() -> None:
    robot = bs.Robot.load("ur5e")
    motion = fourier(robot, 12.0, 94.0, 1)
    model, _ = with_drives(robot, motion, 1)
    log = driven(bs.identification.with_payload(robot, 60.0), motion, model, 1)
    residual = residual_record(log, robot, model).rows
    assert unexplained(log, robot, model, residual)
    assert unexplained(log, robot, model, residual, payload=bs.identification.Payload(60.0)) == []


def test_torques_that_are_dead_or_wrong_are_told() -> None:
    robot, log, fit = good()
    assert log.tau is not None
    for model in (fit.model, None):
        for joint, factor in ((1, 1.0), (1, -1.0), (2, -1.0)):
            sign = np.ones(robot.dof)
            sign[joint] = factor
            turned = replace(log, tau=log.tau * sign)
            found = unexplained(turned, robot, model, residual_record(turned, robot, model).rows)
            assert len(found) == (factor < 0), (model, found)
            assert all(robot.joints[joint].name in sentence for sentence in found)


@pytest.mark.parametrize("turned", [False, True])
def test_tune_tells_a_channel_of_the_opposite_sign(turned: bool, tmp_path: Path) -> None:
    robot = bs.Robot.load("ur5e")
    log = planted(robot, 1, seconds=20.0)
    assert log.tau is not None
    sign = np.where(np.arange(robot.dof) == 1, -1.0 if turned else 1.0, 1.0)
    file = tmp_path / "run.parquet"
    Recording(t=log.t, q=log.q, tau=log.tau * sign).save(file)
    told = strict_json(run("tune", file, "--robot", "ur5e", "--json").out)["notes"]
    assert any("shoulder_lift_joint varies more than its recorded torque" in note for note in told) is turned
