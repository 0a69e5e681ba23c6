"""Trajectories in measurement plans: the place of the gauge, peak forces there, and calibrations of them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.collision import CollisionProblem
from bumpstop.collision.trajectory.trajectory import point_places
from bumpstop.collision.trajectory.trajectory_result import TrajectoryCollisionResult
from bumpstop.errors import InputError
from bumpstop.measure import MeasurementPlan, load_plan, plan_measurements, write_plan
from bumpstop.measure.learning.plan_calibration import calibrate_plan
from bumpstop.measure.peak_force_model import shot_force
from bumpstop.measure.planning.filled_shots import read_shots
from bumpstop.measure.planning.measured_situation import MeasuredSituation

_GAUGE = {"contact.stiffness_N_m": 276e3, "contact.gauge_spring_N_m": 40e3}
# Published of joints 1 to 3; the others take the longest of their times.
_TABLE = Path("examples/stopping/tm5_700.toml").resolve()
_P = (0.05, 0.25, 0.5, 0.75, 0.95)


def path(**changes: Any) -> bs.Scenario:
    """The pick and place of the examples; ``__`` in a name stands for the dot of a key."""
    scenario = bs.load_scenario("examples/06_pick_and_place_trajectory.toml")
    return scenario.with_values({key.replace("__", "."): value for key, value in changes.items()})


def over_phases(scenario: bs.Scenario, onset: float) -> list[float]:
    """Quantiles of the integrated distribution, contact at eight phases of the control cycle [N]."""
    period = scenario.detector.feedback_period_s
    found = [
        bs.evaluate(scenario.with_values({"motion.contact_onset_s": onset + period * (k - 3.5) / 8})).peak_force
        for k in range(8)
    ]
    force = np.linspace(0.5 * found[0].quantile(0.01), 1.2 * found[0].quantile(0.99), 1500)
    below = np.mean([[1 - each.exceedance(f) for f in force] for each in found], axis=0)
    return [float(np.interp(p, below, force)) for p in _P]


@pytest.mark.parametrize(
    ("onset", "changes", "tolerance"),
    [
        # Slow contacts spread over few steps of the distribution.
        (1.49, {}, 5e-3),
        (1.0, {}, 3e-2),
        (2.6, {}, 2e-2),
        (1.49, {"reaction.kind": "reverse"}, 5e-3),
        (1.49, {"contact.kind": "free", "contact.gauge_spring_N_m": None, "contact.body_mass_kg": 4.0}, 1e-2),
        # What the path does before the reaction, gears have wound up for: else 18 % and 4 % too little force.
        (1.0, {"arm.model": "elastic"}, 3e-2),
        (1.2, {"arm.model": "elastic", "reaction.latency_s": 0.03}, 1e-2),
        (0.3936, {"arm.model": "elastic", "reaction.latency_s": 0.06}, 1e-2),
        (1.2, {"arm.model": "elastic", "arm.acceleration_feedforward": 0.0}, 1e-2),
        (2.6, {"arm.model": "elastic", "reaction.kind": "reverse"}, 1e-2),
        # Stops that take longer than what is traced about the contact: else far too little force.
        (1.49, {"reaction.deceleration": "constant_time", "reaction.stopping_time_s": 0.4}, 1e-2),
        (0.84, {"reaction.deceleration": "table", "reaction.stopping_table": str(_TABLE)}, 2e-2),
    ],
)
def test_quantiles_are_those_of_the_integrated_distribution(
    onset: float, changes: dict[str, Any], tolerance: float
) -> None:
    scenario = path().with_values(_GAUGE | changes | {"motion.contact_onset_s": onset})
    found = shot_force(scenario)
    for p, exact in zip(_P, over_phases(scenario, onset), strict=True):
        assert found.quantile(p) == pytest.approx(exact, rel=tolerance), p


def test_slower_is_the_same_path_with_longer_times(tmp_path: Path) -> None:
    """Two routes: the share of the speed, and a file whose times are twice as long."""
    at = path().with_values(_GAUGE | {"motion.contact_onset_s": 1.49})
    rows = Path("examples/06_pick_and_place.csv").read_text().splitlines()
    first = next(i for i, row in enumerate(rows) if row[:1].isdigit())
    assert "velocity" not in rows[first - 1]
    slow = [f"{2 * float(t):.9g},{rest}" for t, rest in (row.split(",", 1) for row in rows[first:])]
    (tmp_path / "slow.csv").write_text("\n".join([*rows[:first], *slow]) + "\n")
    other = at.with_values({"motion.file": str(tmp_path / "slow.csv"), "motion.contact_onset_s": 2.98})
    assert shot_force(at, speed=0.5).median == pytest.approx(shot_force(other).median, rel=1e-9)
    assert shot_force(at, speed=0.5).median < 0.6 * shot_force(at).median


def test_undetected_contact_counts_where_the_motion_ends_at_rest() -> None:
    insensitive = path(detector__thresholds_Nm=[1e4] * 7, motion__contact_onset_s=2.9)
    found = shot_force(insensitive)
    assert found.undetected > 0.999
    assert found.median == pytest.approx(bs.evaluate(insensitive).peak_force.quantile(0.5), rel=1e-3)


def test_a_trajectory_needs_its_place() -> None:
    with pytest.raises(InputError, match=r"motion.contact_onset_s: 'uniform' is not available: a gauge is hit at one"):
        shot_force(path())


def test_the_gauge_stands_where_contact_is_hardest() -> None:
    situation = MeasuredSituation.of("x", path())
    onset, found = situation.onset_s, bs.evaluate(path())
    assert isinstance(found, TrajectoryCollisionResult)
    assert onset is not None
    assert onset == found.onset
    problem = CollisionProblem.from_scenario(path())
    assert problem.trajectory is not None
    at = point_places(problem.trajectory, problem.robot, problem.contact_point, np.array([onset - 1e-5, onset]))
    assert situation.contact_point == pytest.approx(at[1])
    assert situation.speed_mm_s == pytest.approx(1e3 * np.linalg.norm(at[1] - at[0]) / 1e-5, rel=1e-3)
    assert situation.normal == pytest.approx((at[1] - at[0]) / np.linalg.norm(at[1] - at[0]), abs=1e-3)
    assert np.allclose(problem.trajectory.at(onset), situation.pose)
    assert any(f"it meets the gauge after {onset:.3f} s" in note for note in situation.notes)
    given = MeasuredSituation.of("x", path(motion__contact_onset_s=2.6))
    assert given.onset_s == 2.6


def test_a_place_that_was_passed_before_is_said(tmp_path: Path) -> None:
    """The arm lifts the part and puts it down where it was: at first it is where the gauge would stand."""
    rows = Path("examples/06_pick_and_place.csv").read_text().splitlines()
    up = [row.split(",", 1) for row in rows[1:] if float(row.split(",", 1)[0]) <= 0.72]
    there_and_back = [*up, *((str(1.5 - float(t)), rest) for t, rest in reversed(up))]
    (tmp_path / "lift.csv").write_text("\n".join([rows[0], *(f"{float(t):g},{rest}" for t, rest in there_and_back)]))
    lift = path(motion__file=str(tmp_path / "lift.csv"))
    down = MeasuredSituation.of("x", lift, onset_s=1.1)
    assert down.normal[2] < -0.9
    said = [note for note in down.notes if "passes the place of the gauge before" in note]
    assert len(said) == 1
    # By symmetry it was there for the last time when it was as high on the way up.
    assert 0.35 < float(said[0].split("last at ")[1].split(" s")[0]) < 0.4
    assert not [note for note in MeasuredSituation.of("x", lift, onset_s=0.4).notes if "passes" in note]


def test_time_of_contact_must_be_in_the_motion_and_toward_the_gauge() -> None:
    with pytest.raises(InputError, match=r"x: motion.contact_onset_s: 9 s is not in the motion; wanted less than 3 s"):
        plan_measurements([("x", path(motion__contact_onset_s=9))])
    with pytest.raises(InputError, match=r"motion.contact_onset_s: 3 s is not in the motion; wanted 0 to below 3 s"):
        MeasuredSituation.of("x", path(), onset_s=3.0)
    with pytest.raises(InputError, match=r"at 2.6 s the contact point does not move toward the gauge"):
        MeasuredSituation.of("x", path(contact__normal=[0, 0, 1]), onset_s=2.6)


def test_an_elastic_arm_is_planned_beside_a_rigid_one() -> None:
    elastic = path(arm__model="elastic", motion__contact_onset_s=1.2)
    made = plan_measurements([("rigid", path()), ("soft", elastic)], speed_shares=[1.0], points=32, shots=2)
    assert [each.name for each in made.situations] == ["rigid", "soft"]
    assert {shot.situation for shot in made.shots} == {"rigid", "soft"}
    assert "arm.gear_stiffness_Nm_rad" in made.parameters.keys


@pytest.fixture(scope="module")
def plan() -> MeasurementPlan:
    line = bs.load_scenario("examples/01_hand_downward.toml")
    return plan_measurements([("line", line), ("path", path())], points=64, shots=12, repeats=2)


def test_plan_of_lines_and_trajectories(plan: MeasurementPlan) -> None:
    assert [each.name for each in plan.situations] == ["line", "path"]
    assert {shot.situation for shot in plan.shots} == {"line", "path"}
    own = plan.situation("path").speed_mm_s
    for shot in plan.shots:
        assert shot.low_N < shot.distribution_N[0] <= shot.predicted_N <= shot.distribution_N[1] < shot.high_N
    assert {round(shot.speed_mm_s / own, 6) for shot in plan.shots if shot.situation == "path"} <= {0.5, 0.75, 1.0}
    told = next(each for each in plan.to_json()["situations"] if each["name"] == "path")
    assert told["contact_onset_s"] == plan.situation("path").onset_s
    assert len(told["joint_positions"]) == 7


def test_a_filled_plan_tells_what_was_planted(plan: MeasurementPlan, tmp_path: Path) -> None:
    """The deceleration is half of what the scenarios say; the gauge is hit by a trajectory alone."""
    table = write_plan(plan, tmp_path)
    situation = plan.situation("path")
    weak = situation.measured.with_values({"reaction.joint_acceleration_rad_s2": 2.25})
    rows = table.read_text().splitlines()
    shots = read_shots(table)
    filled = [rows[0]]
    for row, shot in zip(rows[1:], shots, strict=True):
        cells = row.split(",")
        if shot.situation == "path":
            cells[6] = f"{shot_force(weak, speed=shot.speed_mm_s / situation.speed_mm_s).median:.2f}"
        filled.append(",".join(cells))
    table.write_text("\n".join(filled) + "\n")
    loaded = load_plan(tmp_path)
    assert loaded.onsets == {"path": pytest.approx(situation.onset_s, rel=1e-12)}
    found = calibrate_plan(loaded)
    assert found.situations[1].onset_s == pytest.approx(situation.onset_s, rel=1e-12)
    factor = next(each for each in found.calibration.found if each.key == "reaction.joint_acceleration_rad_s2")
    assert factor.shown
    assert factor.low < 0.5 < factor.high
    # What is written about the whole trajectory stays about the whole of it.
    assert found.situations[1].scenario.motion.contact_onset_s == "uniform"
