"""Quantiles of uncertain inputs against scipy's own distributions, and what a point changes in a scenario."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy import stats

import bumpstop as bs
from bumpstop import CollisionProblem, Scenario
from bumpstop.uncertainty.point_evaluation import PointEvaluator
from bumpstop.uncertainty.resolved_input import resolve
from collision.cases import control_group
from collision.stopping_cases import line

U = np.linspace(0.001, 0.999, 37)


def inputs(table: dict[str, Any], **changes: Any) -> Any:
    return resolve(
        CollisionProblem.from_scenario(control_group(**{"contact__area_cm2": 2.0, **changes}, uncertainty=table))
    )


@pytest.mark.parametrize(
    ("form", "known"),
    [
        ({"distribution": "normal", "mean": 3.0, "sd": 0.4}, stats.truncnorm(-2.99975 / 0.4, 1e5, 3.0, 0.4)),
        ({"distribution": "normal", "sd": 1.0}, stats.truncnorm(-(2.0 - 1e-4), 1e5, 2.0, 1.0)),
        ({"distribution": "normal", "mean": 3.0, "relative_sd": 0.1}, stats.norm(3.0, 0.3)),
        ({"distribution": "lognormal", "median": 3.0, "sigma": 0.5}, stats.lognorm(0.5, scale=3.0)),
        ({"distribution": "uniform", "low": 1.0, "high": 3.0}, stats.uniform(1.0, 2.0)),
        ({"distribution": "triangular", "low": 1.0, "mode": 1.5, "high": 4.0}, stats.triang(0.5 / 3, 1.0, 3.0)),
        ({"distribution": "triangular", "low": 1.0, "mode": 1.0, "high": 4.0}, stats.triang(0.0, 1.0, 3.0)),
    ],
    ids=["normal", "sd alone", "relative sd", "lognormal", "uniform", "triangular", "mode at the low end"],
)
def test_quantiles(form: dict[str, Any], known: Any) -> None:
    (found,) = inputs({"contact.area_cm2": form}, contact__area_cm2=2.0 if form.get("mean") is None else 3.0)
    np.testing.assert_allclose(found.quantile(U), known.ppf(U), rtol=2e-5)


def test_what_is_cut_off_is_counted() -> None:
    (found,) = inputs({"reaction.latency_s": {"distribution": "normal", "mean": 0.02, "sd": 0.01}})
    assert found.outside == pytest.approx(stats.norm.cdf(-2.0), rel=1e-9)
    assert found.quantile(np.array([0.0, 0.5])) == pytest.approx([0.0, stats.truncnorm(-2, 1e4, 0.02, 0.01).median()])


def test_samples(tmp_path: Path) -> None:
    values = np.random.default_rng(2).uniform(1.0, 3.0, 200)
    (tmp_path / "a.csv").write_text("area_cm2\n" + "\n".join(map(repr, values.tolist())) + "\n", encoding="utf-8")
    table = {"contact.area_cm2": {"distribution": "samples", "file": "a.csv"}}
    scenario = Scenario.from_dict(control_group(uncertainty=table, contact__area_cm2=2.0).to_dict(), tmp_path)
    (found,) = resolve(CollisionProblem.from_scenario(scenario))
    np.testing.assert_allclose(found.quantile(U), np.quantile(values, U, method="hazen"), rtol=1e-12)
    (tmp_path / "a.csv").write_text("1\n2\n3\nx\n5\n6\n", encoding="utf-8")
    with pytest.raises(bs.InputError, match="line 4: 'x' is no number"):
        resolve(CollisionProblem.from_scenario(scenario))


@pytest.mark.parametrize(
    ("key", "form", "outside"),
    [
        ("motion.speed_mm_s", {"distribution": "normal", "mean": 50.0, "sd": 1.0},
         {"motion__velocity_mm_s": [0, 0, -250]}),
        ("motion.speed_mm_s", {"distribution": "lognormal", "median": 50.0, "sigma": 0.1},
         {"motion__velocity_mm_s": [0, 0, -100]}),
        ("reaction.latency_s", {"distribution": "uniform", "low": 0.002, "high": 0.006}, {"reaction__latency_s": 0.2}),
        ("contact.area_cm2", {"distribution": "triangular", "low": 1.0, "mode": 2.0, "high": 3.0},
         {"contact__area_cm2": 0.5}),
        ("detector.thresholds_Nm[2]", {"distribution": "normal", "mean": 10.0, "sd": 0.2},
         {"detector__thresholds_Nm": [20, 14, 20, 20, 20, 20, 20]}),
        # The body's own spring, and no value of the scenario.
        ("contact.stiffness_N_m", {"interval": [60_000, 90_000]}, {"contact__body": "chest"}),
    ],
)  # fmt: skip
def test_figures_that_leave_out_the_value_given_are_refused(
    key: str, form: dict[str, Any], outside: dict[str, Any]
) -> None:
    """A row, --set or a search gave the value, and the distribution judged another: PASS at 250 mm/s for 50."""
    inputs({key: form}, **({"reaction__latency_s": 0.004} if key == "reaction.latency_s" else {}))
    with pytest.raises(bs.InputError, match="leaves out the value given") as refused:
        inputs({key: form}, **outside)
    assert refused.value.field == f'uncertainty."{key}"'


def test_a_measured_body_may_be_another_than_the_table_says() -> None:
    (found,) = inputs({"contact.stiffness_N_m": {"distribution": "normal", "mean": 9000.0, "sd": 300.0}})
    assert found.central == pytest.approx(9000.0)


def test_a_point_changes_lists_items_and_factors() -> None:
    table = {
        "reaction.joint_acceleration_rad_s2": {"relative": [0.9, 1.1]},
        "detector.thresholds_Nm[2]": {"interval": [9.0, 11.0]},
        "detector.noise_sd_Nm": {"relative": [0.9, 1.1]},
        "detector.threshold_scale": {"interval": [0.8, 1.2]},
        "detector.torque_gain[1]": {"interval": [0.8, 1.25]},
        "motion.speed_mm_s": {"interval": [40, 60]},
    }
    evaluator = PointEvaluator(control_group(uncertainty=table))
    assert evaluator.central_figures.tolist() == [1.0, 10.0, 1.0, 1.0, 1.0, 50.0]
    found = evaluator.scenario_at(np.array([1.1, 9.0, 1.05, 0.9, 1.25, 60.0]))
    assert found.reaction.joint_acceleration_rad_s2 == pytest.approx(4.95)
    assert found.detector.thresholds_Nm == pytest.approx([18 / 1.25, 8.1, 18, 18, 18, 18, 18])
    sd = np.array([20, 10, 20, 20, 20, 20, 20]) / 5.5 * 1.05 / np.array([1.25, 1, 1, 1, 1, 1, 1])
    assert found.detector.noise_sd_Nm == pytest.approx(sd.tolist())
    assert found.motion.velocity_mm_s == pytest.approx([0, 0, -60])


def test_elastic_arms_and_bodies_give_what_the_scenario_does_not() -> None:
    changes = {"arm__model": "elastic", "robot": "ur10e", "pose_deg": [10, -80, 110, -120, -90, 20]}
    changes |= {"motion__held_joints": [], "detector__thresholds_Nm": [20.0] * 6, "detector__noise_sd_Nm": 2.0}
    table = {"arm.gear_stiffness_Nm_rad": {"relative": [0.5, 2.0]}, "contact.stiffness_N_m": {"relative": [0.9, 1.1]}}
    table |= {"arm.servo_bandwidth_hz[2]": {"relative": [0.9, 1.1]}}
    scenario = control_group(**changes)
    problem = CollisionProblem.from_scenario(scenario)
    evaluator = PointEvaluator(scenario.with_values({"uncertainty": table}))
    found = CollisionProblem.from_scenario(evaluator.scenario_at(np.array([2.0, 1.1, 0.9])))
    np.testing.assert_allclose(found.drive_train.gear_stiffness, 2 * np.asarray(problem.drive_train.gear_stiffness))
    assert found.body_stiffness == pytest.approx(1.1 * problem.body_stiffness)
    share = np.asarray(found.drive_train.servo_bandwidth) / np.asarray(problem.drive_train.servo_bandwidth)
    np.testing.assert_allclose(share, [1, 0.9, 1, 1, 1, 1])


@pytest.mark.parametrize("key", ["contact.padding_N_m", "contact.gauge_spring_N_m"])
def test_an_interval_of_a_key_without_a_value_has_its_middle(key: str) -> None:
    contact = {"contact__area_cm2": 2.0, "contact__stiffness_N_m": 75e3}
    (found,) = inputs({key: {"interval": [2e4, 4e5]}}, **contact)
    assert (found.given, found.central) == ("default", pytest.approx(2.1e5))
    scenario = control_group(**contact, uncertainty={key: {"interval": [2e4, 4e5]}})
    assert PointEvaluator(scenario).scenario_at(np.array([2e4])).to_dict()["contact"][key.split(".")[1]] == 2e4


def test_a_body_mass_has_no_meaning_in_clamped_contact() -> None:
    scenario = control_group(contact__area_cm2=2.0, uncertainty={"contact.body_mass_kg": {"interval": [2.0, 4.0]}})
    with pytest.raises(bs.InputError, match="clamped") as refused:
        bs.evaluate_uncertain(scenario)
    assert "nan" not in str(refused.value)


def test_torque_limits_that_nobody_knows_are_no_values() -> None:
    """They are infinite."""
    key, elastic = "arm.torque_limit_Nm", {"arm__model": "elastic"}
    assert np.isinf(CollisionProblem.from_scenario(control_group(**elastic)).drive_train.torque_limit).all()
    with pytest.raises(bs.InputError, match=r"arm.torque_limit_Nm has no value to be relative to; give one"):
        inputs({key: {"relative": [0.8, 1.2]}}, **elastic)
    for form in ({"relative": [0.8, 1.2]}, {"interval": [100, 200]}, {"distribution": "lognormal", "sigma": 0.1}):
        with pytest.raises(
            bs.InputError, match=r"Nm\[2\].*no value whose item this is; give arm.torque_limit_Nm of all"
        ):
            inputs({f"{key}[2]": form}, **elastic)
    (found,) = inputs({key: {"interval": [100, 200]}}, **elastic)
    assert found.central == 150


@pytest.mark.parametrize(
    ("key", "other", "factor"),
    [
        ("contact.stiffness_N_mm", "contact.stiffness_N_m", 1e-3),
        ("contact.stiffness_N_m", "contact.stiffness_N_mm", 1e3),
    ],
)
def test_figures_must_hold_a_stiffness_in_its_other_spelling(key: str, other: str, factor: float) -> None:
    """Soft ones passed beside the stiff body of the scenario."""
    stiff = {other.replace(".", "__"): 75.0 / factor if factor < 1 else 75.0}
    low, high = (share * 75.0 * (1.0 if factor < 1 else factor) for share in (0.3, 0.4))
    with pytest.raises(bs.InputError, match="leaves out the value given, 75"):
        inputs({key: {"distribution": "uniform", "low": low, "high": high}}, **stiff)
    (found,) = inputs({key: {"distribution": "uniform", "low": low, "high": 4 * high}}, **stiff)
    assert (found.given, found.nominal) == ("scenario", pytest.approx(low / 0.3))


@pytest.mark.parametrize(
    ("key", "given"), [("payload_percent", {"payload_kg": 10.0}), ("payload_kg", {"payload_percent": 80.0})]
)
def test_figures_must_hold_a_payload_in_its_other_spelling(tmp_path: Path, key: str, given: dict[str, float]) -> None:
    """A UR10e carries 12.5 kg; a light payload passed in the place of a heavy one."""
    rows = "payload_percent,speed_deg_s,distance_1_deg\n33,10,1\n33,20,2\n100,10,3\n100,20,6\n"
    nominal = 80.0 if key == "payload_percent" else 10.0
    scenario = line(tmp_path, rows, kind="stop", deceleration="table", stopping_table="table.csv", **given)

    def resolved(form: dict[str, Any]) -> Any:
        return resolve(CollisionProblem.from_scenario(scenario.with_values({"uncertainty": {f"reaction.{key}": form}})))

    with pytest.raises(bs.InputError, match=f"leaves out the value given, {nominal:g}"):
        resolved({"distribution": "uniform", "low": 0.2 * nominal, "high": 0.3 * nominal})
    (found,) = resolved({"distribution": "uniform", "relative": [0.9, 1.1]})
    assert (found.given, found.nominal) == ("scenario", pytest.approx(nominal))
