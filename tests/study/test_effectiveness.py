"""The effectiveness study: what Schroeder (2013, chapter 6) states in words, safe speeds, bodies without a limit."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.study import run
from bumpstop.study.parameters import region_collisions
from bumpstop.study.parameters.effectiveness import EffectivenessStudy
from bumpstop.study.parameters.region_collisions import RegionCollisions
from bumpstop.study.requirement.requirement import solve_requirement
from bumpstop.study.requirement.sampling_ripple import SLOWER_MAY_FAIL
from collision.cases import control_group, ur10e
from study.requirement_cases import swinging

BODIES = ["hand_finger", "lower_arm_wrist", "upper_arm_elbow"]


@pytest.fixture(scope="module")
def summary() -> dict[str, Any]:
    """Three body parts of both tables, as Schroeder (2013) moved."""
    return run(EffectivenessStudy.of(control_group(), bodies=BODIES), threads=2).summary


def found(summary: dict[str, Any], **wanted: Any) -> dict[str, Any]:
    (row,) = [row for row in summary["collisions"] if all(row[key] == value for key, value in wanted.items())]
    return row


def test_a_hand_downward(summary: dict[str, Any]) -> None:
    hand = {"table": "bgia2011", "body": "hand_finger", "direction": "down", "area_cm2": 2.0}
    verdicts = {v: found(summary, speed_mm_s=v, **hand)["acceptable"] for v in (10.0, 25.0, 50.0, 75.0, 100.0)}
    assert verdicts == {10.0: True, 25.0: True, 50.0: True, 75.0: False, 100.0: False}
    for speed in (75.0, 100.0):
        assert found(summary, speed_mm_s=speed, **hand)["p_over_force"] > 0.5


def test_arms_downward(summary: dict[str, Any]) -> None:
    for speed in (10.0, 25.0, 50.0, 75.0):
        lower = found(
            summary, table="bgia2011", body="lower_arm_wrist", direction="down", area_cm2=2.0, speed_mm_s=speed
        )
        assert lower["p_over_force"] < 1e-3
    upper = found(summary, table="bgia2011", body="upper_arm_elbow", direction="down", area_cm2=2.0, speed_mm_s=75.0)
    assert upper["p_over_pressure"] < 1e-4


def test_lateral_motion_is_noticed_by_joints_1_and_3() -> None:
    rows, _ = run(EffectivenessStudy.of(control_group(), bodies=["hand_finger"], directions=["left"]))
    lateral = rows.filter((rows["kind"] == "collision") & (rows["table"] == "bgia2011") & (rows["area_cm2"] == 1.0))
    for row in lateral.iter_rows(named=True):
        assert row["trigger_1"] == pytest.approx(row["trigger_3"], rel=0.1)
        assert max(row[f"trigger_{j}"] for j in (2, 4, 5, 6, 7)) < 0.01
    several = lateral.sort("speed_mm_s")["several_joints"].to_list()
    assert several == sorted(several)
    assert several[0] < 1 / 3


def test_a_safe_speed_is_safe_and_a_tenth_more_is_not(summary: dict[str, Any]) -> None:
    for row in summary["safe_speeds"][::5]:
        speed = row["safe_speed_mm_s"]
        direction = {"down": (0, 0, -1), "left": (0, 1, 0)}[row["direction"]]

        def acceptable(speed: float, row: Any = row, direction: Any = direction) -> bool | None:
            return bs.evaluate(
                control_group(
                    contact__body=row["body"],
                    contact__limits=row["table"],
                    contact__area_cm2=row["area_cm2"],
                    motion__velocity_mm_s=[speed * x for x in direction],
                )
            ).verdict.acceptable

        assert acceptable(speed) is True
        assert acceptable(speed + 0.1) is False


@pytest.mark.parametrize(
    ("case", "direction", "way"),
    [
        # A stiffness of the scenario is not that of any body of a table.
        (ur10e(contact__stiffness_N_m=12345.0, contact__peak_factor=1.7, reaction__latency_s=0.006), "up", (0, 0, 1)),
        (ur10e(contact__kind="free", contact__body_mass_kg=2.0, reaction__kind="stop"), "left", (0, 1, 0)),
        (
            control_group(contact__offset_law="uniform", motion__damping=0.02, motion__held_joints=[]),
            "back",
            (-1, 0, 0),
        ),
        (ur10e(contact__padding_N_m=2e4, detector__noise_mean_Nm=[1, -2, 1, 0.5, 0, 0]), "forward", (1, 0, 0)),
    ],
)
def test_rows_are_single_laws(case: bs.Scenario, direction: str, way: tuple[int, int, int]) -> None:
    rows = run(
        EffectivenessStudy.of(
            case,
            bodies=["hand_finger", "chest", "thigh_knee"],
            directions=[direction],
            speeds_mm_s=[20.0, 70.5],
            areas_cm2=[1.0, 2.5],
        )
    ).summary["collisions"]
    known = [row for row in rows if not row["reason"]]
    assert {row["table"] for row in known} == {"bgia2011", "ts15066"}
    data = case.to_dict()
    data["contact"].pop("stiffness_N_m", None)
    for row in known:
        own = {"body": row["body"], "limits": row["table"], "area_cm2": row["area_cm2"]}
        contact = data["contact"] | own
        if row["table"] == "ts15066":
            contact.pop("body_mass_kg", None)
        motion = data["motion"] | {"velocity_mm_s": [row["speed_mm_s"] * x for x in way]}
        result = bs.evaluate(bs.Scenario.from_dict(data | {"contact": contact, "motion": motion}))
        verdict, limits = result.verdict, result.verdict.limits
        assert limits is not None
        wanted = {
            "limit_force_N": limits.force_N,
            "limit_pressure_N_cm2": limits.pressure_N_cm2,
            "mean_N": result.peak_force.mean,
            "p999_N": result.peak_force.quantile(0.999),
            "p_over_force": verdict.p_over_force,
            "p_over_pressure": verdict.p_over_pressure,
            "false_alarm": result.false_alarm_probability,
            "trigger_2": result.trigger_joint_probability[1],
            "acceptable": verdict.acceptable,
        }
        assert {key: row[key] for key in wanted} == pytest.approx(wanted, rel=1e-9, abs=1e-15)


@pytest.mark.parametrize(
    "case",
    [
        # Little noise and few ticks: crests that are farther apart than what a scan in wide steps looks at.
        ur10e(
            contact__offset_law="fixed",
            contact__offset_mm=11.0,
            contact__area_cm2=2.0,
            detector__noise_sd_Nm=0.5,
            detector__feedback_period_s=0.008,
        ),
        # At 1.8 mm/s the body is met just before the five seconds end.
        control_group(contact__offset_law="fixed", contact__offset_mm=8.9, contact__area_cm2=2.0),
    ],
)
def test_a_safe_speed_is_below_the_first_tooth_that_fails(case: bs.Scenario) -> None:
    bodies, body = ["hand_finger", "lower_arm_wrist"], ("ts15066", "hand_finger")
    study = EffectivenessStudy.of(case, bodies=bodies, directions=["down"], speeds_mm_s=[50.0], areas_cm2=[2.0])
    found = {(s["table"], s["body"]): s["safe_speed_mm_s"] for s in run(study).summary["safe_speeds"]}

    def over(speed: float) -> float:
        there = study.scenario_of(*body, "down", speed, 2.0)
        # Slow arms get longer to go as far.
        verdict = bs.evaluate(there.with_values({"motion.duration_s": 5 * max(1.0, 50 / speed)})).verdict
        return max(verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0)

    safe = found[body]
    # Where crests are high they are as wide as a feedback period is of the time to the body: 3 and 4 % of the speed.
    slower = np.geomspace(1.0, safe, 600)
    assert all(over(float(speed)) <= case.verdict.accepted_probability for speed in slower)
    assert any(over(safe + step) > case.verdict.accepted_probability for step in np.linspace(0.01, 0.12, 12))


def test_a_soft_body_has_a_safe_speed_though_a_slow_arm_takes_longer_to_be_noticed() -> None:
    """In the five seconds of the scenario an arm at 1 mm/s presses an abdomen no farther than 5 mm."""
    case = ur10e(contact__body="abdomen", contact__padding_N_m=2e4)
    slow = case.with_values({"motion.velocity_mm_s": [0, 0, -1]})
    assert bs.evaluate(slow).undetected_probability > case.verdict.accepted_probability
    study = EffectivenessStudy.of(case, bodies=["abdomen"], directions=["down"], areas_cm2=[1.0], speeds_mm_s=[1, 50])
    summary = run(study).summary
    assert [row["acceptable"] for row in summary["collisions"]] == [True, True]
    (safe,) = [row["safe_speed_mm_s"] for row in summary["safe_speeds"]]
    downward = case.with_values({"motion.velocity_mm_s": [0, 0, -107.7], "contact.area_cm2": 1.0})
    required = solve_requirement(downward, "motion.speed", low=1.0, high=250.0).value
    assert required is not None
    assert safe == pytest.approx(required, abs=0.1 + 1e-4 * required)


def test_a_larger_area_is_never_worse_and_tables_are_not_mixed(summary: dict[str, Any]) -> None:
    speeds = {
        (s["table"], s["body"], s["direction"], s["area_cm2"]): s["safe_speed_mm_s"] for s in summary["safe_speeds"]
    }
    for table, body, direction, area in speeds:
        assert speeds[table, body, direction, 2.0] >= speeds[table, body, direction, area]
    assert (
        found(summary, table="ts15066", body="hand_finger", direction="down", area_cm2=1.0, speed_mm_s=50.0)[
            "limit_force_N"
        ]
        != found(summary, table="bgia2011", body="hand_finger", direction="down", area_cm2=1.0, speed_mm_s=50.0)[
            "limit_force_N"
        ]
    )


def test_a_body_without_a_limit_for_free_contact_is_reported_and_not_judged() -> None:
    scenario = control_group(contact__kind="free", contact__limits="ts15066", contact__body="hand_finger")
    study = EffectivenessStudy.of(
        scenario,
        bodies=["face", "hand_finger"],
        directions=["down"],
        speeds_mm_s=[50.0],
        areas_cm2=[1.0],
        highest_speed_mm_s=2.0,
    )
    rows, summary = run(study)
    by_body = {(row["table"], row["body"]): row for row in summary["collisions"]}
    face = by_body["ts15066", "face"]
    assert face["acceptable"] is None
    assert "does not permit transient contact" in face["reason"]
    assert "gives no mass" in by_body["bgia2011", "hand_finger"]["reason"]
    assert by_body["ts15066", "hand_finger"]["mean_N"] > 0
    speeds = {(s["table"], s["body"]): s for s in summary["safe_speeds"]}
    assert speeds["ts15066", "face"]["safe_speed_mm_s"] is None
    assert speeds["ts15066", "hand_finger"]["binding"] == "none"
    assert rows.height == 2 * len(study.bodies)


@pytest.mark.parametrize(
    ("options", "field"),
    [
        ({"bodies": ["hnad_finger"]}, "--body"),
        ({"directions": ["sideways"]}, "--direction"),
        ({"speeds_mm_s": [0.0]}, "--speed"),
        ({"speeds_mm_s": [float("nan")]}, "--speed"),
        ({"areas_cm2": [-1.0]}, "--area"),
        ({"highest_speed_mm_s": 1.0}, "--highest-speed"),
        ({"highest_speed_mm_s": float("inf")}, "--highest-speed"),
        ({"highest_speed_mm_s": 2e5}, "--highest-speed"),
    ],
)
def test_bad_choices_are_refused_by_name(options: dict[str, Any], field: str) -> None:
    with pytest.raises(bs.InputError) as refused:
        EffectivenessStudy.of(control_group(), **options)
    assert refused.value.field == field


def test_when_nothing_can_be_judged_it_says_so() -> None:
    scenario = control_group(contact__kind="free", contact__limits="ts15066", contact__body="hand_finger")
    with pytest.raises(bs.InputError, match="no body asked for"):
        EffectivenessStudy.of(scenario, bodies=["face"])
    with pytest.raises(bs.InputError, match="the same for every direction"):
        EffectivenessStudy.of(control_group(contact__normal=[0.0, 0.0, -1.0]))


def test_a_risk_no_quantile_can_hold_is_refused() -> None:
    with pytest.raises(bs.InputError) as refused:
        EffectivenessStudy.of(control_group(verdict__accepted_probability=1e-14))
    assert refused.value.field == "verdict.accepted_probability"


def test_no_slower_elastic_arm_fails() -> None:
    """A scan by tens of per cent steps over the speeds that fail, from 116 to 138 mm/s."""
    study = EffectivenessStudy.of(swinging(), ["upper_arm_elbow"], ["down"], [10.0], [0.17], 155.0)
    table = [row for row in run(study).summary["safe_speeds"] if row["table"] == "ts15066"]
    required = solve_requirement(swinging(), "motion.speed", low=30.0, high=155.0).value
    assert required is not None
    assert [(row["safe_speed_mm_s"], row["binding"]) for row in table] == [
        (pytest.approx(required, abs=0.101), "pressure")
    ]


@pytest.mark.parametrize(("model", "noise", "warned"), [
    ("rigid", "residuals", False), ("elastic", "residuals", True), ("elastic", "noise_sd_Nm", False),
])  # fmt: skip
def test_measured_residuals_say_that_slower_speeds_may_fail(
    model: str, noise: str, warned: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    """There is no requirement of sampled collisions: few speeds are looked at, each of which takes long."""
    case = ur10e(arm__model=model)
    if noise == "residuals":
        case = case.with_values({"detector.noise_sd_Nm": None, "detector.residuals": "free.parquet"})
    monkeypatch.setattr(region_collisions, "warnings_of", lambda scenario_of: ())
    collisions = RegionCollisions(case, lambda speed, area: case, 20.0)
    monkeypatch.setattr(collisions, "_safe_speed", lambda area: {"safe_speed_mm_s": 20.0})
    assert collisions.safe_speed(2.0)["warnings"] == ([SLOWER_MAY_FAIL] if warned else [])


def test_in_free_contact_a_scenario_of_a_table_without_masses_has_rows_of_the_others() -> None:
    free = control_group(contact__kind="free", contact__limits="bgia2011", contact__body="hand_finger")
    study = EffectivenessStudy.of(free, ["hand_finger"], ["down"], [50.0], [1.0], 2.0)
    by_table = {row["table"]: row for row in run(study).summary["collisions"]}
    assert "gives no mass" in by_table["bgia2011"]["reason"]
    assert by_table["ts15066"]["mean_N"] > 0


def test_in_two_phases_each_speed_is_computed_once(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[float, float]] = []
    case = control_group(verdict__clamped_limit="two_phase", contact__body="hand_finger")

    def scenario_of(speed: float, area: float) -> bs.Scenario:
        asked.append((speed, area))
        return case.with_values({"motion.velocity_mm_s": [0, 0, -speed], "contact.area_cm2": area})

    monkeypatch.setattr(region_collisions, "warnings_of", lambda scenario_of: ())
    collisions = RegionCollisions(case, scenario_of, 100.0)
    rows = [collisions.collision(100.0, area) | collisions.safe_speed(area) for area in (1.0, 2.0)]
    assert len(asked) == len(set(asked))
    assert rows[0]["p_over_pressure"] > rows[1]["p_over_pressure"]
