"""Every fit obeys one protocol: parameters with units and errors, predictions, scores and a file."""

from __future__ import annotations

import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification import (
    DynamicsFit,
    Fit,
    Payload,
    consistent_inertias,
    identify_dynamics,
    identify_gains,
    identify_joint_model,
    identify_payload,
    with_payload,
)
from bumpstop.identification.design.plan import plan_identification
from bumpstop.joint import JointTorqueModel
from bumpstop.model import inverse_dynamics
from bumpstop.recording import Recording
from bumpstop.reproduction.schroeder2013.protocol import identify_protocol
from identification.design import test_protocol as protocol
from identification.drives import driven, drives, fourier

MASS, GAIN, CUTOFF_HZ = 2.0, 10.0, 8.0
ROBOT = bs.Robot.load("ur5e")


@cache
def torques(seed: int, mass: float = 0.0) -> Recording:
    """Torques of the arm with Coulomb and viscous friction, and noise of 0.1 Nm."""
    t, q, qd, qdd = fourier(ROBOT, 20.0, 100.0, seed)
    tau = inverse_dynamics(with_payload(ROBOT, mass), q, qd, qdd) + 2 * np.tanh(qd / 0.01) + qd
    return Recording(t=t, q=q, tau=tau + 0.1 * np.random.default_rng(seed).normal(size=tau.shape), source=f"{seed}.csv")


def currents(seed: int, mass: float = 0.0) -> Recording:
    """The same as currents of motors with 10 Nm/A."""
    log = torques(seed, mass)
    assert log.tau is not None
    return Recording(t=log.t, q=log.q, current=log.tau / GAIN)


def driven_arm(seed: int) -> Recording:
    motion = fourier(ROBOT, 20.0, 100.0, seed)
    model = drives(ROBOT, 50.0 * np.ones((1, ROBOT.dof)), kind="linear")
    return driven(ROBOT, motion, model, seed)


@cache
def dynamics() -> tuple[DynamicsFit, Recording]:
    return identify_dynamics(torques(1), ROBOT, cutoff_hz=CUTOFF_HZ), torques(2)


def gains() -> tuple[Fit, Recording]:
    loads = [None, Payload(MASS)]
    return identify_gains([currents(1), currents(3, MASS)], ROBOT, payloads=loads, cutoff_hz=CUTOFF_HZ), currents(2)


def joint_model() -> tuple[Fit, Recording]:
    return identify_joint_model(driven_arm(1), ROBOT, maps=["linear"], cutoff_hz=CUTOFF_HZ), driven_arm(2)


def payload() -> tuple[Fit, Recording]:
    return identify_payload(torques(1, MASS), ROBOT), torques(2, MASS)


def inertia() -> tuple[Fit, Recording]:
    return consistent_inertias(torques(1), dynamics()[0]), torques(2)


def protocol_fit() -> tuple[Fit, Recording]:
    plan = plan_identification(bs.Robot.load("ur10e"), protocol.SETTINGS)
    one, other = (protocol.recorded(plan, "odd", seed, (1,)) for seed in (1, 5))
    return identify_protocol(plan, one), other[0]


# By name: how it is fitted, a parameter with its unit, and the least R2 on a motion that it was not fitted to. The
# first joint of the joint model has no torque but by its own acceleration; only joint 2 moves in the protocol's.
FITS: dict[str, tuple[Callable[[], tuple[Fit, Recording]], str, str]] = {
    "dynamics": (dynamics, "viscous_2", "Nm s/rad"),
    "gains": (gains, "gain_2", "Nm/A"),
    "joint model": (joint_model, "shoulder_lift_joint.B", "Nm/A"),
    "payload": (payload, "m", "kg"),
    "inertia": (inertia, "m_3", "kg"),
    "protocol": (protocol_fit, "shoulder_lift_joint.B", "Nm/A"),
}


@pytest.mark.parametrize("name", FITS)
def test_every_fit_obeys_the_protocol(name: str, tmp_path: Path) -> None:
    make, parameter, unit = FITS[name]
    fit, other = make()
    assert isinstance(fit, Fit)
    assert list(fit.parameters) == list(fit.standard_errors)
    value, own_unit = fit.parameters[parameter]
    error = fit.standard_errors[parameter]
    assert own_unit == unit
    assert value is not None
    assert error is not None
    # A mass that only gravity shows is known to some 30 %, as the robot came with it.
    assert 0 < error < 0.35 * value
    for key, found in fit.parameters.items():
        assert found.unit
        assert fit.standard_errors[key] is None or found.value is not None, key
    found = fit.predict(other)
    assert found.predicted.shape == found.measured.shape == (found.t.size, len(found.names))
    scores = {score.name: score for score in fit.score(other)}
    assert tuple(scores) == found.names
    assert tuple(score.unit for score in scores.values()) == found.units
    assert scores["shoulder_lift_joint"].r2 > 0.97
    # What the scores say is what was predicted, not another prediction.
    place = found.names.index("shoulder_lift_joint")
    left = found.predicted[:, place] - found.measured[:, place]
    assert np.sqrt((left**2).mean()) == pytest.approx(scores["shoulder_lift_joint"].rmse, rel=1e-6)
    path = tmp_path / ("fit.urdf" if name == "inertia" else "fit.toml")
    fit.save(path)
    if name in ("dynamics", "gains"):
        again: Fit = DynamicsFit.load(path)
        assert again.parameters == fit.parameters
        assert again.standard_errors == fit.standard_errors
        assert again.score(other) == fit.score(other)
    elif name in ("joint model", "protocol"):
        saved = {joint.name: joint for joint in JointTorqueModel.load(path).joints}
        assert saved["shoulder_lift_joint"].value("B") == value
    elif name == "payload":
        with path.open("rb") as file:
            assert tomllib.load(file)["m"] == {"value": value, "standard_error": error}
    else:
        link = bs.Robot.from_urdf(path).joints[2].inertia
        assert link is not None
        assert link.mass == pytest.approx(value)


def test_a_payload_is_part_of_its_prediction() -> None:
    """Without the payload the same arm is predicted worse by what the payload weighs."""
    fit, loaded = payload()
    with_it = fit.score(loaded)[1]
    without = fit.score(torques(2))[1]
    assert with_it.rmse < 0.2
    assert without.rmse > 5.0


def test_errors_of_inertias_hold_what_was_planted() -> None:
    """Masses that the arm itself has lie within three errors of those that are found; they are the prior's, too."""
    fit, _ = inertia()
    for j, joint in enumerate(ROBOT.joints, start=1):
        assert joint.inertia is not None
        (mass, _), error = fit.parameters[f"m_{j}"], fit.standard_errors[f"m_{j}"]
        assert mass is not None
        assert error is not None
        assert abs(mass - joint.inertia.mass) < 3 * error, j
