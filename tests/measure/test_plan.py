"""Measurement plans: gauges, places, the order of the shots, and what is written."""

from __future__ import annotations

import csv
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision import CollisionProblem, stopping_curve
from bumpstop.errors import InputError
from bumpstop.measure import MeasurementPlan, gauge_of, load_plan, plan_measurements, write_plan
from bumpstop.measure.planning.design import Belief, greedy_design
from bumpstop.measure.planning.filled_shots import read_shots
from bumpstop.measure.planning.measured_situation import MeasuredSituation
from bumpstop.measure.planning.plan_file import COLUMNS
from bumpstop.plant import gauge_regions
from measure.cells import elastic, rigid
from validation import facts


def named() -> list[tuple[str, bs.Scenario]]:
    return [
        ("hand, down", rigid()),
        ("belly/side", rigid(contact__body="abdomen", motion__velocity_mm_s=[120, 0, 0])),
        ("thigh", rigid(contact__body="thigh_knee", contact__kind="free")),
    ]


@pytest.fixture(scope="module")
def plan() -> MeasurementPlan:
    return plan_measurements(named(), points=48, repeats=2, shots=12)


def test_devices_are_those_of_the_facts() -> None:
    if not (facts.folder() / "facts" / "measured_forces.toml").is_file():
        pytest.skip("measured_forces.toml is absent: set BUMPSTOP_SHARED")
    told = facts.load("measured_forces")["gauge"]
    assert set(gauge_regions()) == set(told)
    bodies = {"abdomen": "abdomen", "chest": "chest", "upper_arm": "upper_arm_elbow", "back": "back_shoulders"}
    bodies |= {"lower_arm": "lower_arm_wrist", "thigh": "thigh_knee", "lower_leg": "lower_leg", "hand": "hand_finger"}
    for device, (spring, shore) in told.items():
        gauge = gauge_of(rigid(contact__body=bodies[device]))
        assert (gauge.device, gauge.spring_N_m, gauge.pad_shore_a) == (device, 1e3 * spring, shore)


def test_every_region_of_both_tables_has_a_gauge() -> None:
    for table in ("bgia2011", "ts15066"):
        for region in bs.LimitTable.load(table).regions:
            gauge = gauge_of(rigid(contact__limits=table, contact__body=region.name))
            assert gauge.spring_N_m > 0
            assert gauge.series_N_m < min(gauge.spring_N_m, gauge.pad_N_m)
            assert gauge.status
            assert gauge.source
    skull = gauge_of(rigid(contact__body="skull_forehead"))
    assert skull.device == "hand"
    assert "0.5 times the region's stiffness" in skull.note
    assert skull.status.startswith("engineering choice")


def test_device_given() -> None:
    assert gauge_of(rigid(), "chest").device == "chest"
    with pytest.raises(InputError, match="gauge: 'hands' is no device; did you mean 'hand'"):
        gauge_of(rigid(), "hands")


def test_scenario_that_has_a_gauge_keeps_it() -> None:
    scenario = rigid(contact__stiffness_N_m=2e5, contact__gauge_spring_N_m=6e4)
    gauge = gauge_of(scenario)
    assert gauge.series_N_m == pytest.approx(1 / (1 / 2e5 + 1 / 6e4))
    assert gauge.measured(scenario) is scenario


def test_gauge_takes_the_body_s_place() -> None:
    for kind in ("clamped", "free"):
        situation = MeasuredSituation.of("x", rigid(contact__kind=kind, contact__body="chest"))
        problem = CollisionProblem.from_scenario(situation.measured)
        assert problem.stiffness == pytest.approx(situation.gauge.series_N_m)
        assert situation.clamped is (kind == "clamped")
        assert problem.gets_away is (kind == "free")
        if kind == "free":
            assert problem.body_mass == CollisionProblem.from_scenario(situation.scenario).body_mass


def test_place_and_approach() -> None:
    """The tip moves down: the gauge stands at it and looks up, and the approach ends at full speed."""
    slow = rigid(reaction__joint_acceleration_rad_s2=0.5, motion__velocity_mm_s=[0, 0, -250])
    situation = MeasuredSituation.of("x", slow)
    robot = bs.Robot.load("ur10e")
    assert situation.contact_point == pytest.approx(robot.pose(np.radians(slow.pose_deg))[:3, 3], abs=1e-9)
    assert situation.normal == pytest.approx([0, 0, -1], abs=1e-9)
    assert situation.start_point - situation.contact_point == pytest.approx([0, 0, situation.approach], abs=1e-9)
    rest = slow.with_values({"motion.start": "rest", "motion.duration_s": 2.0})
    curve = stopping_curve(CollisionProblem.from_scenario(rest), whole=True)
    at_full_speed = np.flatnonzero(np.diff(curve.distance) >= 0.999 * 0.25 * 1e-3)[0]
    assert 0.05 < curve.distance[at_full_speed] < situation.approach < 1.3 * curve.distance[at_full_speed + 1]


def test_no_room_for_the_approach_is_told() -> None:
    stretched = rigid(
        pose_deg=[0, -20, 10, -80, -90, 0],
        motion__velocity_mm_s=[400, 0, 0],
        reaction__joint_acceleration_rad_s2=0.5,
    )
    assert any("has no room: the arm comes to a singularity" in n for n in MeasuredSituation.of("x", stretched).notes)


def test_shots(plan: MeasurementPlan) -> None:
    assert [shot.number for shot in plan.shots] == list(range(1, 13))
    spread = [plan.spread, *(shot.spread for shot in plan.shots)]
    assert all(after < before for before, after in pairwise(spread))
    own = {s.situation for s in plan.shots if math.isclose(s.speed_mm_s, plan.situation(s.situation).speed_mm_s)}
    assert own == {name for name, _ in named()}
    for shot in plan.shots:
        assert shot.low_N <= shot.distribution_N[0] <= shot.predicted_N <= shot.distribution_N[1] <= shot.high_N
    assert max(np.unique([(s.situation, s.speed_mm_s) for s in plan.shots], axis=0, return_counts=True)[1]) <= 2


def test_expected_force_is_that_of_the_integrated_distribution(plan: MeasurementPlan) -> None:
    for shot in plan.shots:
        situation = plan.situation(shot.situation)
        exact = bs.evaluate(situation.at_speed(shot.speed_mm_s)).peak_force
        assert shot.predicted_N == pytest.approx(exact.quantile(0.5), rel=1e-9)


class _Surfaces:
    """Of a linear model: peak forces that go with the parameters."""

    def __init__(self, scatter: list[float]) -> None:
        self.log_sd, self.error = np.array(scatter), np.zeros(len(scatter))


def test_greedy_order_against_conditioning_of_a_normal_distribution() -> None:
    """Gains against the variance that is left by the textbook formula, for every candidate."""
    random = np.random.default_rng(5)
    from bumpstop.measure.learning.posterior import ErrorModel

    draws = random.standard_normal((4000, 3)) @ random.standard_normal((3, 5))
    errors, weights = ErrorModel(gauge=0.3, model=0.1), np.array([1.0, 0, 2, 1, 0])
    surfaces = _Surfaces([0.1, 0.2, 0.1, 0.4, 0.1])
    belief = Belief(draws, surfaces, errors, weights)  # type: ignore[arg-type]
    covariance, noise = belief.covariance.copy(), belief.noise

    def left(shots: list[int]) -> float:
        rows = np.eye(5)[shots]
        inverse = np.linalg.inv(rows @ covariance @ rows.T + np.diag(noise[shots]))
        after = covariance - covariance @ rows.T @ inverse @ rows @ covariance
        return float(weights @ np.diag(after) / weights.sum())

    design = greedy_design(belief, 6, repeats=3, own_speed=np.zeros(5, dtype=bool))
    taken: list[int] = []
    for number, condition in enumerate(design.condition.tolist()):
        best = min((c for c in range(5) if taken.count(c) < 3), key=lambda c: left([*taken, c]))
        assert condition == best
        taken.append(condition)
        assert design.spread[number + 1] == pytest.approx(math.sqrt(left(taken)), rel=1e-9)


def test_round_trip(plan: MeasurementPlan, tmp_path: Path) -> None:
    table = write_plan(plan, tmp_path / "plan")
    assert table.read_text().splitlines()[0] == ",".join(COLUMNS)
    again = load_plan(tmp_path / "plan")
    assert [name for name, _ in again.named] == [name for name, _ in named()]
    for (_, scenario), situation in zip(again.named, plan.situations, strict=True):
        assert scenario.to_dict() == situation.scenario.to_dict()
    assert again.devices == {each.name: each.gauge.device for each in plan.situations}
    assert again.fixed == plan.fixed
    assert again.spread == {each.key: each.sd for each in plan.parameters.each}
    assert (again.seed, again.points, again.errors) == (plan.seed, plan.points, plan.errors)
    for row, shot in zip(again.shots, plan.shots, strict=True):
        assert (row.shot, row.situation) == (shot.number, shot.situation)
        assert row.speed_mm_s == pytest.approx(shot.speed_mm_s, rel=1e-9)
        assert math.isnan(row.measured_N)


def test_a_filled_plan_is_not_written_over(plan: MeasurementPlan, tmp_path: Path) -> None:
    table = write_plan(plan, tmp_path)
    write_plan(plan, tmp_path)
    rows = table.read_text().splitlines()
    rows[1] = rows[1].replace(",,,", ",101.5,,", 1)
    table.write_text("\n".join(rows) + "\n")
    assert read_shots(table)[0].measured_N == 101.5
    with pytest.raises(InputError, match="is filled in already"):
        write_plan(plan, tmp_path)


@pytest.mark.parametrize("column", ["measured_peak_force_N", "recording", "remark", "operator"])
def test_any_cell_that_people_fill_keeps_a_plan(column: str, plan: MeasurementPlan, tmp_path: Path) -> None:
    table = write_plan(plan, tmp_path)
    head, *rows = csv.reader(table.read_text().splitlines())
    if column not in head:
        head, rows = [*head, column], [[*row, ""] for row in rows]
    rows[-1][head.index(column)] = "gauge slipped, again tomorrow"
    with table.open("w", newline="") as file:
        csv.writer(file).writerows([head, *rows])
    before = table.read_bytes()
    with pytest.raises(InputError, match="is filled in already"):
        write_plan(plan, tmp_path)
    assert table.read_bytes() == before


def test_table_of_a_spreadsheet_with_decimal_commas(plan: MeasurementPlan, tmp_path: Path) -> None:
    table = write_plan(plan, tmp_path)
    plain = read_shots(table)
    lines = table.read_text().replace("hand, down", "hand down").replace('"', "")
    table.write_text(lines.replace(".", "\0").replace(",", ";").replace("\0", ","))
    for row, before in zip(read_shots(table), plain, strict=True):
        assert row.speed_mm_s == before.speed_mm_s


@pytest.mark.parametrize(
    ("change", "problem"),
    [
        (lambda rows: [rows[0].replace("speed_mm_s", "speed"), *rows[1:]], "column speed_mm_s: is missing"),
        (lambda rows: [rows[0], rows[1].replace(",,,", ",hard,,", 1)], "row 1, measured_peak_force_N: 'hard' cannot"),
        (
            lambda rows: [rows[0], rows[1].replace(",,,", ",-5,,", 1)],
            "row 1, measured_peak_force_N: '-5' cannot",
        ),
        (lambda rows: rows[:1], "has no rows|holds no numbers"),
        (lambda rows: [rows[0], "," + rows[1].partition(",")[2].partition(",")[2]], "row 1, situation: is empty"),
    ],
)
def test_bad_tables(plan: MeasurementPlan, tmp_path: Path, change: object, problem: str) -> None:
    table = write_plan(plan, tmp_path)
    rows = [row for row in table.read_text().splitlines() if '"' not in row]
    table.write_text("\n".join(change(rows)) + "\n")  # type: ignore[operator]
    with pytest.raises(InputError, match=problem):
        read_shots(table)


def test_unknown_situation(plan: MeasurementPlan, tmp_path: Path) -> None:
    table = write_plan(plan, tmp_path)
    table.write_text(table.read_text().replace("thigh,", "thi,"))
    with pytest.raises(InputError, match="situation: 'thi' has no scenario; did you mean 'thigh'"):
        load_plan(tmp_path)


def test_bad_input() -> None:
    with pytest.raises(InputError, match="situation: there is none"):
        plan_measurements([])
    with pytest.raises(InputError, match="situation: 'a' is named twice"):
        plan_measurements([("a", rigid()), ("a", rigid())])
    for name in ("=1+1", " +2", "-a", "@b", "a\rb", "", "a" * 81):
        with pytest.raises(
            InputError, match=r"situation: .* is no name; wanted a text .* does not begin with = \+ - @"
        ):
            plan_measurements([(name, rigid())])
    with pytest.raises(InputError, match="robot: the situations are of 2 robots: sia5d, ur10e"):
        plan_measurements([("a", rigid()), ("b", bs.load_scenario("examples/01_hand_downward.toml"))])
    with pytest.raises(InputError, match=r"speeds: 1.5 cannot be used; wanted shares of the speed"):
        plan_measurements([("a", rigid())], speed_shares=[1.5])
    with pytest.raises(InputError, match=r"detector.threshold: is no key that measured forces tell; valid: reaction"):
        plan_measurements([("a", rigid())], spread={"detector.threshold": 0.1})
    with pytest.raises(InputError, match="shots: is 0; wanted a whole number from 1"):
        plan_measurements([("a", rigid())], shots=0)
    insensitive = rigid(detector__thresholds_Nm=[math.inf] * 5 + [1e6], motion__velocity_mm_s=[0, 0, -10])
    with pytest.raises(InputError, match="no shot would be detected for certain"):
        plan_measurements([("a", insensitive)], points=32)


def test_what_is_known_is_no_parameter() -> None:
    known = ["reaction.latency_s", "arm.rotor_inertia_kg_m2"]
    made = plan_measurements([("a", elastic())], fixed=known, speed_shares=[1.0], points=32, shots=2)
    assert "reaction.latency_s" not in made.parameters.keys
    assert "arm.gear_stiffness_Nm_rad" in made.parameters.keys
