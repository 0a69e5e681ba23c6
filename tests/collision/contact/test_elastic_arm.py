"""Arms that give way: their limits, both distributions, and what is refused."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop import _native
from bumpstop.collision import problem as problem_module
from bumpstop.collision.contact_course import arm_in_contact
from bumpstop.collision.problem import CollisionProblem
from bumpstop.model import DriveTrain
from collision.contact.elastic_cases import CASES, differences, scenario

KEPT = 40_000  # runs


@pytest.mark.parametrize("name", CASES)
def test_integrated_and_sampled_agree(name: str) -> None:
    case = scenario(**CASES[name])
    for difference in differences(bs.evaluate(case), bs.evaluate(case, samples=KEPT, seed=5)):
        assert abs(difference.errors) <= 4, difference


def test_stiff_gears_and_servos_are_the_rigid_arm() -> None:
    stiff = {
        "gear_stiffness_Nm_rad": 1e12,
        "gear_damping": 1.0,
        "rotor_inertia_kg_m2": 1.0,
        "servo_bandwidth_hz": 1e5,
        "servo_position_gain_1_s": 1e6,
    }
    elastic = bs.evaluate(scenario(arm=stiff, reaction={"kind": "reverse"}))
    rigid = bs.evaluate(scenario(arm={"model": "rigid"}, reaction={"kind": "reverse"}))
    for p in (0.01, 0.5, 0.99):
        assert elastic.peak_force.quantile(p) == pytest.approx(rigid.peak_force.quantile(p), rel=1e-4)
        assert elastic.force_at_detection.quantile(p) == pytest.approx(rigid.force_at_detection.quantile(p), rel=1e-3)


def test_an_elastic_arm_hits_softer_than_a_rigid_one_and_says_on_what_that_rests() -> None:
    elastic, rigid = bs.evaluate(scenario()), bs.evaluate(scenario(arm={"model": "rigid"}))
    assert elastic.peak_force.mean < 0.5 * rigid.peak_force.mean
    assert elastic.to_json()["arm"]["model"] == "elastic"
    beside = elastic.to_json()["arm"]["other"]
    assert beside["model"] == "rigid"
    assert beside["peak_force_N"]["mean"] == pytest.approx(rigid.peak_force.mean, rel=1e-12)
    shown = f"rigid arm instead: peak force p50 {rigid.peak_force.quantile(0.5):.4g}"
    assert shown in " ".join(str(elastic).split())
    assert elastic.to_json()["arm"]["status"]["gear_stiffness"] == "assumed"
    assert rigid.to_json()["arm"] == {"model": "rigid"}
    assert any("ASSUMED" in warning for warning in elastic.warnings)
    given = dict.fromkeys(("rotor_inertia_kg_m2", "gear_damping"), 1.0) | {
        "gear_stiffness_Nm_rad": 20000.0,
        "servo_bandwidth_hz": 20.0,
        "servo_position_gain_1_s": 20.0,
        "acceleration_feedforward": 1.0,
    }
    assert not any("ASSUMED" in warning for warning in bs.evaluate(scenario(arm=given)).warnings)


def test_the_pose_of_contact_does_not_move_with_the_latency() -> None:
    found = []
    for latency_s in (0.0, 0.001, 0.003, 0.004, 0.006):
        problem = CollisionProblem.from_scenario(scenario(reaction={"latency_s": latency_s}))
        arm = arm_in_contact(problem, bs.stopping_curve(problem), 0.003)
        found.append(np.array(arm.matrix(problem.contact.body, in_contact=True)))
    for matrix in found[1:]:
        assert np.abs(matrix - found[0]).max() < 1e-7 * np.abs(found[0]).max()


@pytest.mark.parametrize(
    ("changes", "field"),
    [
        ({"arm": {"gear_stiffness_Nm_rad": [1.0, 2.0]}}, "arm.gear_stiffness_Nm_rad"),
        ({"arm": {"gear_stiffness_Nm_rad": 0.0}}, "arm.gear_stiffness_Nm_rad"),
        ({"arm": {"rotor_inertia_kg_m2": -1.0}}, "arm.rotor_inertia_kg_m2"),
        ({"arm": {"servo_bandwidth_hz": 0.0}}, "arm.servo_bandwidth_hz"),
        ({"arm": {"model": "rigid", "gear_damping": 0.1}}, "arm.gear_damping"),
        ({"contact": {"gauge_mass_kg": 0.3}}, "contact.gauge_spring_N_m"),
        (
            {"contact": {"body": "lower_arm_wrist", "gauge_spring_N_m": 75e3, "stiffness_N_m": None}},
            "contact.stiffness_N_m: is missing",
        ),
        ({"contact": {"kind": "free", "body_mass_kg": 4.0, "arm": "two_mass"}}, "contact.arm"),
        ({"arm": {"file": "nowhere.toml"}}, "nowhere.toml"),
    ],
)
def test_what_cannot_be_used_is_refused_by_name(changes: dict[str, dict[str, Any]], field: str) -> None:
    with pytest.raises(bs.InputError) as refused:
        bs.evaluate(scenario(**changes))
    assert field in str(refused.value)


def test_no_servo_on_the_motors_is_unstable() -> None:
    random = np.random.default_rng(3)
    problem = CollisionProblem.from_scenario(scenario())
    compliance = problem.setup.arm
    assert compliance is not None
    for _ in range(200):
        for name, low, high in (
            ("rotor_inertia", -3, 2),
            ("gear_stiffness", 1, 6),
            ("gear_damping", -4, 0),
            ("servo_bandwidth", -1, 4),
            ("servo_position_gain", -1, 4),
        ):
            setattr(compliance, name, 10 ** random.uniform(low, high, 6))
        arm = _native.ElasticArm(problem.robot.chain, compliance, problem.q, np.zeros(6), np.zeros(6))
        modes = np.linalg.eigvals(arm.matrix(_native.ContactBody(), in_contact=False))
        assert modes.real.max() < 1e-9 * abs(modes).max()


def test_a_rigid_arm_has_the_elastic_one_beside_it_where_its_drives_are_known(monkeypatch: pytest.MonkeyPatch) -> None:
    rigid, elastic = scenario(arm={"model": "rigid"}), bs.evaluate(scenario())
    assert bs.evaluate(rigid).other_arm is None
    own = problem_module.drive_train_of

    def known(given: bs.Scenario, robot: bs.Robot) -> DriveTrain:
        found = own(given, robot)
        for name in ("rotor_inertia", "gear_stiffness", "servo_bandwidth"):
            found = found.with_values(name, getattr(found, name), "published", "a data sheet")
        return found

    monkeypatch.setattr(problem_module, "drive_train_of", known)
    beside = bs.evaluate(rigid).other_arm
    assert beside is not None
    assert beside.peak_force.mean == elastic.peak_force.mean
    # What goes with a rigid arm alone has none.
    free = {"contact": {"kind": "free", "body_mass_kg": 4.0, "arm": "two_mass"}}
    assert bs.evaluate(scenario(arm={"model": "rigid"}, **free)).other_arm is None
