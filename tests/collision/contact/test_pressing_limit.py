"""What an arm presses with that nothing stops: as much as its drives can."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import linprog

import bumpstop as bs
from bumpstop.errors import InputError
from bumpstop.model import Robot, gravity_torque, mass_matrix
from bumpstop.plant import Gears, Plant, PlantObject, Servo, line
from collision.contact.test_elastic_arm import scenario

DEAF: dict[str, Any] = {"detector": {"thresholds_Nm": [1e4] * 6}, "motion": {"duration_s": 0.3}}


def pressed(**changes: dict[str, Any]) -> bs.CollisionResult:
    return bs.evaluate(scenario(**(DEAF | changes)))


@pytest.mark.parametrize("gravity", [(0, 0, -9.80665), (0, 0, 9.80665), (-9.80665, 0, 0), (0, 9.80665, 0)])
def test_the_static_force_is_the_most_that_the_torques_allow(gravity: tuple[float, float, float]) -> None:
    """The same as a linear program: the greatest force for which torques within the limits hold arm and force."""
    case = scenario(**DEAF, contact={"offset_law": "fixed", "offset_mm": 0.0})
    case = case.with_values({"gravity_m_s2": list(gravity), "motion.velocity_mm_s": [0, 0, -1.0]})
    result = bs.evaluate(case)
    limit = result.pressing_limit
    assert limit is not None
    q, robot = np.radians([0, -60, 90, -120, -90, 0]), Robot.load("ur10e")
    lever, torque = -robot.jacobian(q)[2], robot.drive_train.torque_limit
    # Of both signs of the weight the greater counts.
    found = linprog(
        [-1.0],
        A_ub=np.concatenate([lever, -lever])[:, None],
        b_ub=np.tile(torque + np.abs(gravity_torque(robot, q, gravity=gravity)), 2),
    )
    # The constraint that holds the force back is the weakest joint's.
    assert limit.joint == 1 + int(np.argmin(found.slack)) % 6
    assert limit.static_force == pytest.approx(found.x[0], rel=1e-3)


def test_the_blow_takes_the_arm_s_energy() -> None:
    slow, fast = (pressed(motion={"velocity_mm_s": [0, 0, -v], "duration_s": 0.3}) for v in (1.0, 160.0))
    assert slow.pressing_limit is not None
    assert fast.pressing_limit is not None
    static, peak = slow.pressing_limit.static_force, slow.pressing_limit.peak_force
    assert peak == pytest.approx(2 * static, rel=0.01)
    assert fast.pressing_limit.peak_force > 2.05 * fast.pressing_limit.static_force
    # The energy of a motion at that speed, links and rotors.
    q, robot = np.radians([0, -60, 90, -120, -90, 0]), Robot.load("ur10e")
    rates = np.linalg.pinv(robot.jacobian(q)[:3]) @ [0, 0, -0.16]
    doubled = rates @ (mass_matrix(robot, q) + np.diag(robot.drive_train.rotor_inertia)) @ rates
    expected = static + math.sqrt(static**2 + doubled * 75e3)
    assert fast.pressing_limit.peak_force == pytest.approx(expected, rel=0.1)


def test_a_gauge_gives_back_what_its_spring_has_taken_in() -> None:
    """Pushed by a constant force, an arm of 11.7 kg met a gauge that swung back with 517 N; 455 N were the limit."""
    contact = {"stiffness_N_m": 277e3, "gauge_spring_N_m": 83e3, "gauge_mass_kg": 1.9}
    limits = [pressed(motion={"velocity_mm_s": [0, 0, -v], "duration_s": 0.3}, contact=contact) for v in (0.01, 160.0)]
    slow, fast = (result.pressing_limit for result in limits)
    assert slow is not None
    assert fast is not None
    assert slow.peak_force == pytest.approx((1 + math.sqrt(1 + 277 / 83)) * slow.static_force, rel=1e-3)
    arm, gauge, stiffness, spring, force, speed = 11.703, 1.894, 277.01e3, 83.5e3, 169.6, 0.1277
    a = np.zeros((5, 5))
    a[0, 2] = a[1, 3] = 1
    a[2] = [-stiffness / arm, stiffness / arm, 0, 0, force / arm]
    a[3] = [stiffness / gauge, -(stiffness + spring) / gauge, 0, 0, 0]
    apart = a.copy()
    apart[2], apart[3] = [0, 0, 0, 0, force / arm], [0, -spring / gauge, 0, 0, 0]
    touching, free = expm(5e-6 * a), expm(5e-6 * apart)
    x, highest = np.array([0, 0, speed, 0, 1.0]), 0.0
    for _ in range(200_000):
        x = (touching if x[0] >= x[1] else free) @ x
        highest = max(highest, stiffness * (x[0] - x[1]))
    plain = force + math.sqrt(force**2 + arm * speed**2 * stiffness)
    assert highest < force + math.sqrt(force**2 * (1 + stiffness / spring) + arm * speed**2 * stiffness)
    assert highest > 1.1 * plain


@pytest.mark.parametrize("damping", [1e3, 2e4])
def test_a_damper_presses_from_the_first_touch(damping: float) -> None:
    """Undetected the force was bounded without it, below what detected collisions had."""
    contact = {"damping_Ns_m": damping, "offset_law": "fixed", "offset_mm": 5.0}
    felt = bs.evaluate(scenario(contact=contact, detector={"thresholds_Nm": [3.0] * 6, "noise_sd_Nm": 0.01}))
    plain, unfelt = pressed(contact=contact | {"damping_Ns_m": 0.0}), pressed(contact=contact)
    assert felt.peak_force.mean >= 0.16 * damping * (1 - 1e-4)
    assert unfelt.undetected_probability == pytest.approx(1.0)
    assert unfelt.peak_force.mean >= felt.peak_force.mean
    assert plain.pressing_limit is not None
    assert unfelt.pressing_limit is not None
    more = unfelt.pressing_limit.peak_force - plain.pressing_limit.peak_force
    assert more == pytest.approx(0.16 * damping, rel=1e-3)


def test_no_latency_takes_the_blow_away() -> None:
    """A reaction that is due after the motion ends has no state: the arm was taken for one that stands."""
    at_once = pressed()
    for latency in (0.004, 0.05, 0.29, 0.4):
        late = pressed(reaction={"latency_s": latency})
        assert late.undetected_probability == pytest.approx(1.0)
        assert late.pressing_limit == at_once.pressing_limit


@pytest.mark.parametrize("samples", [None, 500])
def test_the_verdict_uses_it(samples: int | None) -> None:
    case = scenario(**DEAF, contact={"stiffness_N_m": None, "body": "thigh_knee", "limits": "ts15066", "area_cm2": 10})
    alike = bs.evaluate(case, samples=samples)
    assert alike.pressing_limit is not None
    force = alike.pressing_limit.peak_force
    assert alike.undetected_probability == pytest.approx(1.0)
    assert alike.peak_force.mean == pytest.approx(force)
    assert alike.peak_force.quantile(0.999) == pytest.approx(force, rel=1e-3)
    assert alike.verdict.acceptable is False
    assert "not detected" not in alike.verdict.reason
    said = f"{alike.pressing_limit.static_force:.4g} N at the torque limit of joint {alike.pressing_limit.joint}"
    assert any(said in note for note in alike.notes)
    assert alike.to_json()["arm"]["pressing_limit"]["peak_force_N"] == force
    weak = case.with_values(
        {"arm.torque_limit_Nm": [330.0, 330.0, 150.0, 8.0, 8.0, 8.0], "motion.velocity_mm_s": [0, 0, -5.0]}
    )
    assert bs.evaluate(weak, samples=samples).verdict.acceptable is True


def test_a_note_says_how_the_arm_is_mounted() -> None:
    assert "with the base upright" in " ".join(pressed().notes)
    hung = " ".join(bs.evaluate(scenario(**DEAF).with_values({"gravity_m_s2": [0, 0, 9.80665]})).notes)
    assert "with gravity_m_s2 as given" in hung
    assert "upright" not in hung
    assert "no effect" not in hung


@pytest.mark.parametrize("gravity", [[0, 0, 0], [0, 0, -9.6], [7.0, 7.0, -7.0], [0, 0, -9806.65]])
def test_nothing_falls_otherwise_on_earth(gravity: list[float]) -> None:
    with pytest.raises(InputError, match=r"^gravity_m_s2"):
        scenario().with_values({"gravity_m_s2": gravity})


def test_without_limits_there_is_no_bound() -> None:
    # Of the sia5d no torque limits are published.
    other = {"robot": "sia5d", "pose_deg": [0, 30, 0, 60, 0, 40, 0]}
    detector = {"thresholds_Nm": [1e4] * 7, "noise_sd_Nm": 3.0}
    data = scenario(**DEAF).to_dict() | other | {"detector": detector}
    unknown = bs.evaluate(bs.Scenario.from_dict(data))
    assert unknown.pressing_limit is None
    assert math.isinf(unknown.peak_force.mean)
    assert "count as over every limit" in " ".join(unknown.notes)
    data["arm"] = {"model": "elastic", "torque_limit_Nm": 80.0}
    assert math.isfinite(bs.evaluate(bs.Scenario.from_dict(data)).peak_force.mean)


def test_a_rigid_arm_has_no_torque_limit() -> None:
    with pytest.raises(InputError, match=r"^arm\.torque_limit_Nm"):
        scenario(arm={"model": "rigid", "torque_limit_Nm": 100.0})
    with pytest.raises(InputError, match=r"^arm\.torque_limit_Nm"):
        scenario(arm={"torque_limit_Nm": 0.0})


@pytest.mark.parametrize(("stiffness", "speed", "share"), [(5e3, 0.21, 0.7), (30e3, 0.08, 0.87), (75e3, 0.2, 0.5)])
def test_an_arm_in_mujoco_presses_no_harder(stiffness: float, speed: float, share: float) -> None:
    robot, q = Robot.load("ur10e"), np.radians([0, -60, 90, -120, -90, 0])
    limit, ahead = robot.drive_train.torque_limit * share, 0.004
    x, y, z = robot.pose(q)[:3, 3]
    body = PlantObject(name="body", stiffness=stiffness, position=(x, y, z - ahead), normal=(0, 0, -1))
    servo = Servo(velocity_bandwidth=100.0, position_gain=20.0, torque_limit=limit.tolist())
    plant = Plant(robot, friction=Gears.of(robot, q), servo=servo, objects=[body])
    # The weakest joint is driven back, and the tip slides: until it has come to the edge of the body.
    motion = line(robot, q, np.array([0, 0, -speed]), duration=(ahead + 0.1) / speed, start="moving")
    found = plant.run(motion).trace
    force = found.contact_force[found.t < (ahead + 0.08) / speed, 0]
    expected = bs.evaluate(
        scenario(
            **DEAF | {"motion": {"velocity_mm_s": [0, 0, -1e3 * speed], "duration_s": 0.3}},
            contact={"stiffness_N_m": stiffness, "offset_law": "fixed", "offset_mm": 1e3 * ahead},
            arm={"torque_limit_Nm": limit.tolist()},
        )
    ).pressing_limit
    assert expected is not None
    assert expected.joint == 3
    assert np.median(force[-20:]) == pytest.approx(expected.static_force, rel=0.03 if speed < 0.1 else 0.15)
    assert expected.static_force < force.max() < expected.peak_force


@pytest.mark.parametrize(
    ("limits", "said"),
    [
        ([3.3, 3.3, 1.5, 0.56, 0.55, 0.54], "joint 2 has 3.3 Nm, and its links take up to 139 Nm"),
        ([330.0, 50.0, 150.0, 56.0, 56.0, 56.0], "joint 2 has 50 Nm, and its weight takes"),
    ],
)
def test_torque_limits_that_cannot_hold_the_arm_bound_nothing(limits: list[float], said: str) -> None:
    """Those of motors before their gears: an arm that nobody detects was acceptable."""
    result = pressed(arm={"torque_limit_Nm": limits})
    assert pressed().pressing_limit is not None
    assert result.pressing_limit is None
    assert math.isinf(result.peak_force.quantile(0.5))
    (warning,) = [one for one in result.warnings if "torque limits" in one]
    assert said in warning
    assert not any("torque limits" in one for one in pressed().warnings)


def test_weight_along_an_axis_needs_no_torque() -> None:
    """Of an arm on a wall: gravity is along the axes of joints 2 to 4."""
    case = scenario(**DEAF, arm={"torque_limit_Nm": [330.0, 50.0, 150.0, 56.0, 56.0, 56.0]})
    assert bs.evaluate(case).pressing_limit is None
    assert bs.evaluate(case.with_values({"gravity_m_s2": [0.0, 9.80665, 0.0]})).pressing_limit is not None
