"""Drives undo what the joint torque model does, and add what it cannot say."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.joint import JointParameters, JointTorqueModel, Parameter
from bumpstop.plant import Gears
from bumpstop.plant.drive import Drives
from model.dynamics_cases import general_arm


def models() -> list[JointTorqueModel]:
    """Both maps with all laws of friction, with and without a range that currents leave."""
    rng = np.random.default_rng(3)
    found = []
    for number in range(12):
        joints = []
        for arm_joint in general_arm().joints:
            law, odd = str(rng.choice(["power", "stribeck", "load_dependent"])), bool(rng.random() < 0.5)
            values = {"A": float(rng.uniform(0, 2e-4)), "B": float(rng.uniform(0.05, 0.2))}
            if law == "power":
                values |= {"D": float(rng.uniform(0, 300)), "F": float(rng.uniform(0.1, 1.5))}
            elif law == "stribeck":
                values |= {"coulomb": 20.0, "viscous": 5.0, "stribeck": 10.0, "stribeck_speed": 0.1}
            else:
                values |= {"coulomb": 20.0, "viscous": 5.0, "load": 0.1}
            values |= {"hysteresis": float(rng.uniform(0, 5)), "inertia": float(rng.uniform(0, 2))}
            joints.append(
                JointParameters(
                    name=arm_joint.name,
                    map="odd" if odd else "load_dependent",
                    friction=law,  # type: ignore[arg-type]
                    parameters={name: Parameter(value) for name, value in values.items()},
                    current_range=(-100.0, 100.0) if not odd or number % 2 else None,
                )
            )
        found.append(JointTorqueModel(robot="general", created_from="test", unit="A", joints=tuple(joints)))
    return found


@pytest.mark.parametrize("number", range(12))
def test_the_current_is_the_one_whose_torque_is_passed_on(number: int) -> None:
    robot, model = general_arm(), models()[number]
    rng = np.random.default_rng(4)
    drives = Drives(robot, model, Gears())
    for scale in (0.003, 0.1, 1.0):
        # From the model's side: a current is its torque; from the drives' side: that torque wants this current.
        qd = rng.normal(size=7) * scale
        drives.reset(np.zeros(7), qd)
        slope = rng.uniform(0, 50, 7)
        passed = rng.normal(size=7) * 20
        current = drives.current(passed + slope * qd, qd, slope * qd)
        direct = replace(model, joints=tuple(without_memory(joint) for joint in model.joints))
        np.testing.assert_allclose(direct.torque(current, qd), passed, rtol=1e-9, atol=1e-9)


def without_memory(joint: JointParameters) -> JointParameters:
    return replace(joint, parameters={**joint.parameters, "hysteresis": None, "inertia": None})


def test_friction_in_the_loop_is_what_the_model_says() -> None:
    """What a motor gives beyond what is passed on, is the torque of the friction current, at a steady load."""
    model, robot = models()[0], general_arm()
    drives = Drives(robot, model, Gears())
    direct = replace(model, joints=tuple(without_memory(joint) for joint in model.joints))
    qd, passed = np.array([0.5, -0.3, 1.0, -0.02, 0.1, 2.0, -1.0]), np.array([20.0, -10, 5, 3, -2, 1, 0.5])
    drives.reset(np.zeros(7), qd, passed)
    tau = passed
    for _ in range(2000):  # of 1 ms, with a load that follows within 20
        damping, against, slope, base = drives.resist(np.zeros(7), qd, tau)
        tau = passed + damping * qd + against
    assert np.array_equal(against, base)
    assert np.array_equal(damping, slope)
    assert (damping >= 0).all()
    current = drives.current(tau, qd, slope * qd + base)
    np.testing.assert_allclose(direct.torque(current, qd), passed, rtol=1e-9)
    # All that the current would give without friction.
    frictionless = replace(direct, joints=tuple(frictionless_joint(joint) for joint in direct.joints))
    np.testing.assert_allclose(frictionless.torque(current, qd), tau, rtol=1e-6)


@pytest.mark.parametrize("number", range(12))
def test_friction_within_a_millisecond_follows_its_law(number: int) -> None:
    """The line that is held is the law's tangent: a rate 1 % off gets the friction of that rate."""
    model = models()[number]
    near, off = Drives(general_arm(), model, Gears()), Drives(general_arm(), model, Gears())
    qd, passed = np.array([0.5, -0.3, 1.0, -0.2, 0.1, 2.0, -1.0]), np.array([20.0, -10, 5, 3, -2, 1, 0.5])
    found = []
    for drives, rate in ((near, qd), (off, 1.01 * qd)):
        drives.reset(np.zeros(7), rate, passed)
        tau = passed
        for _ in range(500):
            slope, base = drives.resist(np.zeros(7), rate, tau)[2:]
            tau = passed + slope * rate + base
        found.append((slope, base))
    (slope, base), (there, base_there) = found
    law, line, through_zero = (
        there * 1.01 * qd + base_there,
        slope * 1.01 * qd + base,
        1.01 * (slope * qd + base),
    )
    assert np.abs(line - law).max() < 0.1 * np.abs(through_zero - law).max()


def frictionless_joint(joint: JointParameters) -> JointParameters:
    off = ("D", "coulomb", "viscous", "stribeck", "load")
    values = {name: Parameter(0.0) if name in off else value for name, value in joint.parameters.items()}
    return replace(joint, parameters=values)


def test_hysteresis_has_the_models_memory() -> None:
    model, robot = models()[0], general_arm()
    drives = Drives(robot, model, Gears())
    held = np.array([joint.value("hysteresis") for joint in model.joints])
    drives.reset(np.zeros(7))
    assert not drives.resist(np.zeros(7), np.zeros(7), np.zeros(7))[1].any()
    for sign in (1.0, -1.0):
        drives.resist(np.zeros(7), np.full(7, 0.5 * sign), np.zeros(7))
        np.testing.assert_allclose(drives.resist(np.zeros(7), np.zeros(7), np.zeros(7))[1], sign * held)


def test_presliding_turns_hysteresis_round_over_a_way() -> None:
    model, robot = models()[0], general_arm()
    held = np.array([joint.value("hysteresis") for joint in model.joints])
    drives = Drives(robot, model, Gears(presliding=1e-3))
    drives.reset(np.zeros(7))
    creep = np.full(7, 1e-4)
    for way, share in ((1e-3, 1 - np.exp(-1)), (1e-2, 1 - np.exp(-10)), (9.9e-3, None)):
        against = drives.resist(np.full(7, way), creep, np.zeros(7))[1]
        if share is not None:
            np.testing.assert_allclose(against, share * held, rtol=1e-9)
        else:  # a tenth of the way back has turned it by a tenth, to first order
            np.testing.assert_allclose(against / held, -1 + (2 - np.exp(-10)) * np.exp(-0.1), rtol=1e-9)


def test_what_gears_add() -> None:
    robot = general_arm()
    drives = Drives(
        robot, None, Gears(load_share=0.1, stribeck=2.0, stribeck_speed=0.05, ripple=0.5, ripple_per_turn=100)
    )
    q, qd, tau = np.full(7, 0.3), np.full(7, 0.4), np.full(7, 30.0)
    drives.reset(q, qd, tau)
    damping, against, slope, base = drives.resist(q, qd, tau)
    assert not slope.any()
    assert not base.any()
    np.testing.assert_allclose(against, 0.5 * np.sin(30.0))
    # The load has gone a twentieth of the way from 30 to what is left of it.
    load = 30.0 - 0.05 * 0.5 * np.sin(30.0)
    np.testing.assert_allclose(damping * qd, 0.1 * load + 2.0 * np.exp(-64.0), rtol=1e-12)


def test_joints_without_a_model_and_joints_of_another_arm() -> None:
    robot, model = general_arm(), models()[0]
    drives = Drives(robot, replace(model, joints=model.joints[:5]), Gears(rotor_inertia=0.5))
    assert drives.unmodelled == ("j5", "j6")
    np.testing.assert_array_equal(drives.inertia, 0.5)
    current = drives.current(np.full(7, 3.0), np.full(7, 0.2), np.zeros(7))
    np.testing.assert_allclose(current[5:], 3.0)
    with pytest.raises(InputError, match="joint_model: has a joint 'elbow' that general has not"):
        Drives(robot, replace(model, joints=(replace(model.joints[0], name="elbow"),)), Gears())
    with pytest.raises(InputError, match=r"friction.load_share\[1\]: is 1; wanted 0 to 0.99"):
        Drives(robot, None, Gears(load_share=1.0))
    with pytest.raises(InputError, match=r"friction.ripple: has shape \(2,\); wanted \(7,\)"):
        Drives(robot, None, Gears(ripple=[1.0, 2.0]))
