"""A key that somebody gives changes the result, is refused, or is named in a note."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop import Scenario
from bumpstop.collision.scenario.unused_keys import given_without_effect
from bumpstop.detection import ResidualSeries
from collision.cases import control_group

HAND = {"contact__limits": "ts15066", "contact__area_cm2": 2.0}
SCENARIOS = {
    "clamped": control_group(**HAND),
    "free": control_group(**HAND, contact__kind="free"),
    "observer, uniform offset": control_group(
        **HAND, detector__residual="observer", contact__offset_law="uniform", reaction__kind="stop"
    ),
    "without a body": Scenario.from_dict(
        {
            "robot": "sia5d",
            # In a plane it would not matter which of the joints that turn the arm out of it are held.
            "pose_deg": [0, 30, 10, -20, 5, -40, 0],
            "motion": {"velocity_mm_s": [0, 0, -50], "held_joints": [7]},
            "contact": {"stiffness_N_m": 75000.0, "offset_law": "fixed", "offset_mm": 1.0},
            "detector": {"thresholds_Nm": [20, 10, 20, 20, 20, 20, 20], "noise_sd_Nm": 2.0},
            "reaction": {"joint_acceleration_rad_s2": 4.5},
        }
    ),
}
# Other values of every key that a line may have.
OTHERS: dict[str, list[Any]] = {
    "pose_deg": [[0, 31, 0, -20, 0, -40, 0]],
    "pose_rad": [[0.1, 0.5, 0, -0.3, 0, -0.7, 0]],
    "motion.kind": ["trajectory"],
    "motion.velocity_mm_s": [[0, 5, -60]],
    "motion.start": ["rest"],
    "motion.duration_s": [0.01],
    "motion.task": ["position"],
    "motion.held_joints": [[3]],
    "motion.damping": [0.05],
    "motion.file": ["a.csv"],
    "motion.contact_onset_s": [1.0],
    "contact.body": ["lower_arm_wrist"],
    "contact.limits": ["ts15066", "bgia2011"],
    "contact.kind": ["free", "clamped"],
    "contact.area_cm2": [3.3],
    "contact.stiffness_N_m": [5e4],
    "contact.padding_N_m": [5e4],
    "contact.damping_Ns_m": [200.0],
    "contact.gauge_spring_N_m": [75000.0],
    "contact.gauge_mass_kg": [0.3],
    "arm.model": ["elastic"],
    "arm.file": ["absent.toml"],
    "arm.rotor_inertia_kg_m2": [1.0],
    "arm.gear_stiffness_Nm_rad": [1e4],
    "arm.gear_damping": [0.1],
    "arm.servo_bandwidth_hz": [20.0],
    "arm.servo_position_gain_1_s": [20.0],
    "arm.torque_limit_Nm": [100.0],
    "arm.acceleration_feedforward": [0.5],
    "contact.body_mass_kg": [5.0],
    "contact.pressure_area": ["palm (non-dominant)"],
    "contact.peak_factor": [2.0],
    "contact.link": ["link_5_b"],
    "contact.point_m": [[0.05, 0, 0]],
    "contact.normal": [[0.1, 0, -1]],
    "contact.stiffness_N_mm": [50.0],
    "motion.speed_mm_s": [60.0],
    "motion.direction": [[0, 1, -3]],
    "gravity_m_s2": [[-9.80665, 0, 0]],
    "assumed": [["detector.thresholds_Nm"]],
    "contact.arm": ["two_mass"],
    "contact.offset_law": ["uniform", "half_normal"],
    "contact.offset_sd_s": [0.03, 0.3],
    "contact.offset_mm": [2.0],
    "detector.thresholds_Nm": [[25.0] * 7],
    "detector.noise_sd_Nm": [3.0],
    "detector.noise_mean_Nm": [0.5],
    "detector.noise_correlation": [0.4],
    "detector.residuals": ["absent.parquet"],
    "detector.feedback_period_s": [0.002],
    "detector.residual": ["observer", "direct"],
    "detector.observer_gain_1_s": [20.0, 80.0],
    "detector.arming_delay_s": [0.1],
    "reaction.kind": ["stop", "reverse"],
    "reaction.joint_acceleration_rad_s2": [6.0],
    "reaction.latency_s": [0.004],
    "reaction.deceleration": ["constant_time", "ramp", "table"],
    "reaction.dead_time_s": [0.004],
    "reaction.stopping_time_s": [0.1],
    "reaction.ramp_time_s": [0.02],
    "reaction.stopping_table": ["absent.csv"],
    "reaction.payload_kg": [1.0],
    "reaction.payload_percent": [50.0],
    "reaction.stop_category": [0, 1, 2],
    "simulation.step_s": [0.0005],
    "simulation.substeps": [3],
    "verdict.accepted_probability": [0.01],
    "verdict.max_false_alarm": [0.01],
    "verdict.clamped_limit": ["two_phase", "quasi_static"],
    "verdict.confidence": [0.9],
    "uncertainty": [{"contact.stiffness_N_m": {"relative": [0.9, 1.1]}}],
}


def result(scenario: Scenario) -> tuple[dict[str, Any], list[str]]:
    """Everything in JSON, and apart from it the notes about keys without effect."""
    found = bs.evaluate(scenario).to_json()
    return found, [note for note in found.pop("notes") if "has no effect" in note]


def test_every_key_is_tried() -> None:
    keys = set()
    for name, field in Scenario.model_fields.items():
        inner = getattr(field.annotation, "model_fields", None)
        keys |= {name} if inner is None else {f"{name}.{key}" for key in inner}
    assert keys - set(OTHERS) == {"robot", "base", "tip", "folder"}


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_key_counts_or_a_note_says_that_it_does_not(name: str) -> None:
    scenario = SCENARIOS[name]
    before, notes = result(scenario)
    assert notes == []
    for key, values in OTHERS.items():
        table, _, inner = key.rpartition(".")
        for value in values:
            if value == getattr(getattr(scenario, table) if table else scenario, inner):
                continue
            try:
                after, notes = result(scenario.with_values({key: value}))
            except bs.InputError:
                continue
            assert (after == before) == any(note.startswith(key + " ") for note in notes), (key, value, notes)


def test_defaults_that_nobody_gave_are_neither_noted_nor_spelt_out() -> None:
    scenario = SCENARIOS["clamped"]
    free = scenario.with_values({"contact.kind": "free"})
    assert given_without_effect(free) == {}
    assert "clamped_limit" not in free.to_dict()["verdict"]
    assert "clamped_limit" in scenario.to_dict()["verdict"]
    assert "observer_gain_1_s" not in scenario.to_dict()["detector"]
    # Copies of a scenario in which one was given say so, too.
    given = scenario.with_values({"detector.observer_gain_1_s": 50.0})
    for copy in (given, Scenario.from_dict(given.to_dict()), given.with_values({"reaction.kind": "stop"})):
        assert list(given_without_effect(copy)) == ["detector.observer_gain_1_s"]


@pytest.mark.parametrize("category", [1, 2])
@pytest.mark.parametrize("several", [True, False])
def test_a_stop_category_that_chooses_rows_counts(category: int, several: bool, tmp_path: Path) -> None:
    head, rows = "speed_deg_s,distance_1_deg", [(10, 1), (90, 9)]
    table = [f"category,{head}", *(f"{c},{v},{d * c}" for c in (1, 2) for v, d in rows)]
    plain = [head, *(f"{v},{d}" for v, d in rows)]
    (tmp_path / "table.csv").write_text("\n".join(table if several else plain) + "\n")
    data = SCENARIOS["without a body"].to_dict()
    data["reaction"] |= {"kind": "stop", "deceleration": "table", "stopping_table": "table.csv"}
    data["reaction"] |= {"stop_category": category}
    result = bs.evaluate(Scenario.from_dict(data, tmp_path))
    said = "reaction.stop_category has no effect on numbers"
    assert any(said in note for note in result.notes) is not several
    assert (said in str(result).replace("\n", " ")) is not several


def test_measured_residuals_leave_no_use_for_a_noise(tmp_path: Path) -> None:
    rows = np.random.default_rng(1).normal(0, 2, (3000, 7))
    ResidualSeries(np.arange(0.0, 12.0, 0.004), rows).save(tmp_path / "noise.parquet")
    data = SCENARIOS["clamped"].to_dict()
    laws = {}
    for sd in (None, 0.1, 9.0):
        data["detector"] |= {"residuals": "noise.parquet", "noise_sd_Nm": sd}
        distribution = bs.evaluate(Scenario.from_dict(data, tmp_path), samples=200)
        laws[sd] = {key: value for key, value in distribution.to_json().items() if key != "notes"}
        said = "detector.noise_sd_Nm has no effect with detector.residuals, whose noise counts." in distribution.notes
        assert said == (sd is not None)
    assert laws[None] == laws[0.1] == laws[9.0]
