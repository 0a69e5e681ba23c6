"""Safe speeds against the distributions themselves, and re-timed trajectories against limits and path."""

from __future__ import annotations

import itertools
import json
import math
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl
import pytest

import bumpstop as bs
from bumpstop.collision import CollisionProblem, evaluate_batch, load_scenario
from bumpstop.collision.trajectory.trajectory import Trajectory
from bumpstop.errors import InputError
from bumpstop.study import run
from bumpstop.study.null_space import improve_detectability
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.speed.speed_limit import speed_limits
from bumpstop.study.speed.trajectory.retiming import retime
from bumpstop.study.speed.trajectory.trajectory_speed_limits import TrajectorySpeedLimits
from bumpstop.study.speed.trajectory.trajectory_writing import write_csv, write_ros
from bumpstop.study.speed.workspace_speed_limits import WorkspaceSpeedLimits
from bumpstop.study.speed.worst_direction import worst_directions
from study.requirement_cases import over, swinging
from study.speed_limit_cases import PICK, begin, few_rows

REPOSITORY = Path(__file__).resolve().parents[3]
HAND = REPOSITORY / "examples/01_hand_downward.toml"
LINE = REPOSITORY / "examples/05_ur10e.toml"


@pytest.fixture(scope="module")
def pick() -> TrajectorySpeedLimits:
    return TrajectorySpeedLimits(load_scenario(PICK))


@pytest.fixture(scope="module")
def found(pick: TrajectorySpeedLimits) -> Any:
    return run(pick).rows


def test_limits_are_safe_and_a_little_more_is_not(pick: TrajectorySpeedLimits, found: Any) -> None:
    rows = found.filter(found["limited_by"] == "risk").gather_every(7)
    q = rows.select([f"q_{j}" for j in range(1, 8)]).to_numpy()
    direction = rows.select("direction_x", "direction_y", "direction_z").to_numpy()
    limit = rows["limit_mm_s"].to_numpy() / 1e3
    for factor, safe in ((1.0, True), (1.0101, False)):
        evaluations = evaluate_batch(pick._line, q, direction * (factor * limit)[:, None], limits_N=[160.0])
        # The forearm's limits: 160 N, and 50 N/cm² over 4 cm², which is more.
        assert ((evaluations.exceedance[:, 0] <= 1e-3) == safe).all()


def test_a_limit_is_told_rounded_down(pick: TrajectorySpeedLimits, found: Any) -> None:
    summary = pick.summary(found) | {"lowest_limit_mm_s": 87.1478}
    assert any(line.startswith("lowest limit: 87.14 mm/s") for line in pick.lines(summary))


def test_limits_are_tight_where_the_formula_expects_none() -> None:
    """Directions in which the formula misses the limit itself: distributions are met there all the same, far above its
    guess."""
    study = WorkspaceSpeedLimits(load_scenario(HAND), poses=12, seed=1, cone_deg=20.0)
    rows = run(study).rows
    rows = rows.filter(rows["limited_by"] == "risk")
    q = rows.select([f"q_{j}" for j in range(1, 8)]).to_numpy()
    direction = rows.select("direction_x", "direction_y", "direction_z").to_numpy()
    speed = rows["limit_mm_s"].to_numpy() / 1e3
    limit = allowed_force(study._line_problem)
    assert rows.filter(rows["undetectable_N"] > 0.7 * limit).height >= 5
    # Where the risk jumps from none to some with a speed, the limit may stay two hundredths below the highest safe one.
    for factor, safe in ((1.0, True), (1.0201, False)):
        evaluations = evaluate_batch(study.scenario, q, direction * (factor * speed)[:, None], limits_N=[limit])
        assert ((evaluations.exceedance[:, 0] <= 1e-3) == safe).all()


@pytest.mark.parametrize("max_speed", [0.15, 1.0])
def test_no_slower_elastic_arm_fails(max_speed: float) -> None:
    """The force falls again above the first speeds that fail: a search from the formula's guess stayed there."""
    problem = CollisionProblem.from_scenario(swinging())
    found = speed_limits(problem, problem.q[None], np.array([[0.0, 0.0, -1.0]]), np.array([max_speed]))
    limit = 1e3 * float(found.speed[0])
    required = bs.solve_requirement(swinging(), "motion.speed", low=30.0, high=150.0).value
    assert required is not None
    assert required / 1.04 <= limit <= required
    assert found.limited_by[0] == "risk"
    assert found.risk[0] == pytest.approx(over(swinging(), "motion.speed", limit), rel=1e-6, abs=1e-12)


def test_slowed_down_no_collision_passes_the_limits(pick: TrajectorySpeedLimits, found: Any, tmp_path: Path) -> None:
    retimed = retime(
        pick.trajectory, pick.path_speed(found), pick.problem.robot.velocity, pick.problem.joint_acceleration
    )
    write_csv(tmp_path / "slow.csv", retimed)
    before = bs.evaluate(pick.scenario)
    after = bs.evaluate(pick.scenario.with_values({"motion.file": str(tmp_path / "slow.csv")}))

    def detected_over(result: Any) -> float:
        return float((result.verdict.p_over_force or 0.0) - result.undetected_probability)

    # The distributions of trajectories share no code with those of lines. Undetected ones meet an arm that stands
    # still.
    assert detected_over(before) > 0.1
    assert detected_over(after) <= pick.scenario.verdict.accepted_probability


def test_contact_at_a_time_stays_at_its_place_of_the_slowed_path(tmp_path: Path) -> None:
    study = TrajectorySpeedLimits(load_scenario(PICK, {"motion.contact_onset_s": 1.5}))
    rows, summary = run(study)
    retimed = study.slowed(rows).retimed
    assert retimed is not None
    write_csv(tmp_path / "slow.csv", retimed)
    later = summary["retimed_contact_onset_s"]
    slowed = study.scenario.with_values({"motion.file": str(tmp_path / "slow.csv"), "motion.contact_onset_s": later})
    assert CollisionProblem.from_scenario(slowed).trajectory.at(later) == pytest.approx(study.given.at(1.5), abs=2e-3)
    assert summary["retimed_verdict"]["p_over_force"] == bs.evaluate(slowed).verdict.p_over_force
    assert any(f"{later:.6g} s after the start" in line for line in study.lines(summary))


def test_a_slowed_trajectory_is_over_no_limit_between_its_waypoints_either(
    pick: TrajectorySpeedLimits, found: Any, tmp_path: Path
) -> None:
    retimed = retime(
        pick.trajectory, pick.path_speed(found), pick.problem.robot.velocity, pick.problem.joint_acceleration
    )
    write_csv(tmp_path / "slow.csv", retimed)
    again = TrajectorySpeedLimits(pick.scenario.with_values({"motion.file": str(tmp_path / "slow.csv")}))
    rows, summary = run(again)
    assert rows.height > 1.9 * found.height
    assert (summary["over"], summary["over_between"]) == (0, 0)
    assert (again.path_speed(rows) == 1).all()
    # One function judges speed limits and evaluate.
    evaluated = bs.evaluate(again.scenario)
    verdict = evaluated.verdict.to_json() | {"warnings": list(evaluated.warnings)}
    assert (summary["acceptable"], summary["verdict"]) == (evaluated.verdict.acceptable, verdict)


@pytest.mark.parametrize(("path", "angle"), [(LINE, 180.0), (HAND, 30.0)])
def test_no_direction_of_the_cone_is_worse(path: Path, angle: float) -> None:
    """In many of these poses the formula expects no safe speed in several directions, and cannot rank them."""
    study = WorkspaceSpeedLimits(load_scenario(path), poses=8, cone_deg=angle, seed=2)
    rows = run(study).rows.filter(pl.col("limit_mm_s") > 0)
    assert rows.height >= 4
    axis = np.array(study.scenario.motion.velocity_mm_s)
    axis /= np.linalg.norm(axis)
    # The cone's spiral, written out: even steps of height, golden angles apart.
    side = np.cross(axis, [1.0, 0, 0])
    side /= np.linalg.norm(side)
    height = 1 - (1 - math.cos(math.radians(angle))) * np.arange(1, 49) / 48
    turn = np.arange(48) * math.pi * (3 - math.sqrt(5))
    across = np.sqrt(np.maximum(0, 1 - height**2))[:, None]
    around = np.cos(turn)[:, None] * side + np.sin(turn)[:, None] * np.cross(axis, side)
    directions = np.vstack([axis, height[:, None] * axis + across * around])
    # Between these, too: the worst of all is mostly none of them.
    drawn = np.random.default_rng(5).normal(size=(4000, 3))
    drawn /= np.linalg.norm(drawn, axis=1)[:, None]
    directions = np.vstack([directions, drawn[drawn @ axis >= math.cos(math.radians(angle))][:1200]])
    count = len(directions)
    q = np.repeat(rows.select(pl.col(r"^q_\d$")).to_numpy(), count, axis=0)
    speed = np.repeat(rows["limit_mm_s"].to_numpy() / 1e3, count)[:, None]
    velocity = np.tile(directions, (rows.height, 1)) * speed
    evaluations = evaluate_batch(study.scenario, q, velocity, limits_N=[allowed_force(study._line_problem)])
    assert evaluations.exceedance.max() <= study.scenario.verdict.accepted_probability


def test_two_waypoints_at_rest_are_not_safe_if_the_way_between_them_is_not(tmp_path: Path) -> None:
    """A person's program: stand, move half a radian in half a second, stand. No waypoint is passed too fast."""
    q = begin() + np.array([[0.0] * 7, [0.5, *[0.0] * 6]])
    study = few_rows(tmp_path / "two.csv", [0.0, 0.5], q, np.zeros((2, 7)))
    rows, summary = run(study)
    assert (summary["waypoints"], summary["over"]) == (2, 0)
    assert summary["over_between"] > 0
    assert not summary["acceptable"]
    assert rows.filter(~rows["between"])["waypoint"].to_list() == [1, 2]
    # Where the cubic is fastest the distribution of a straight line says so too.
    top = rows.row(int(rows["speed_mm_s"].to_numpy().argmax()), named=True)
    assert top["t_s"] == pytest.approx(0.25, abs=0.02)
    evaluations = evaluate_batch(
        study._line,
        np.array([[top[f"q_{j}"] for j in range(1, 8)]]),
        1e-3 * top["speed_mm_s"] * np.array([[top[f"direction_{axis}"] for axis in "xyz"]]),
        limits_N=[160.0],
    )
    assert evaluations.exceedance[0, 0] > 1e-3


def test_the_risk_accepted_is_accepted_to_the_last_digit() -> None:
    """The speed looked at first passes the limit with a known probability: just accepted, and just not."""
    case = load_scenario(LINE)
    problem = CollisionProblem.from_scenario(case)
    limit, q = allowed_force(problem), problem.q[None]
    direction = (problem.velocity / np.linalg.norm(problem.velocity))[None]
    # By halves to a probability near the usual one.
    low, high = 0.01, 1.0
    for _ in range(40):
        max_speed = math.sqrt(low * high)
        over = float(evaluate_batch(case, q, max_speed * direction, limits_N=[limit]).exceedance[0, 0])
        low, high = (max_speed, high) if over < 1e-3 else (low, max_speed)
    for share, met in ((1 + 1e-9, True), (1 / (1 + 1e-9), False), (1 / 1.04, False)):
        asked = case.with_values({"verdict.accepted_probability": over * share})
        found = speed_limits(asked, q, direction, np.array([max_speed]))
        assert (found.limited_by[0] == "max_speed") is met
        assert found.risk[0] <= over * share


def test_a_slow_place_is_braked_for_in_time() -> None:
    """One joint at 1 rad/s that must pass one waypoint at a tenth: braking takes v^2 / 2 a each way."""
    t = np.linspace(0, 10, 2001)
    allowed = np.ones(2001)
    allowed[1000] = 0.1
    found = retime(Trajectory(t, t[:, None].copy(), np.ones((2001, 1))), allowed, np.array([10.0]), np.array([0.5]))
    a = 0.98 * 0.5
    lost = 2 * ((1 - 0.1) / a - (1 - 0.1**2) / (2 * a))
    assert found.time[-1] == pytest.approx(10 + lost, rel=1e-4)


def test_files_read_back(pick: TrajectorySpeedLimits, found: Any, tmp_path: Path) -> None:
    retimed = retime(
        pick.trajectory, pick.path_speed(found), pick.problem.robot.velocity, pick.problem.joint_acceleration
    )
    write_csv(tmp_path / "slow.csv", retimed)
    write_ros(tmp_path / "slow.json", retimed, pick.problem.robot)
    for name in ("slow.csv", "slow.json"):
        read = TrajectorySpeedLimits(load_scenario(PICK, {"motion.file": str(tmp_path / name)})).trajectory
        assert (read.position == retimed.position).all()
        assert np.abs(read.time - retimed.time).max() < 1e-9
    message = json.loads((tmp_path / "slow.json").read_text())
    assert len(message["points"][0]["accelerations"]) == 7


def test_a_wider_cone_is_never_faster(pick: TrajectorySpeedLimits, found: Any) -> None:
    rows = np.arange(0, found.height, 25)
    q, own, max_speed = pick.trajectory.position[rows], pick.direction[rows], np.ones(len(rows))
    wide = worst_directions(pick._line_problem, q, own, math.radians(40), max_speed).found.speed
    narrow = found["limit_mm_s"].to_numpy()[rows] / 1e3
    assert (wide <= narrow * 1.0101).all()
    assert (wide < narrow * 0.9).any()


def test_self_motion_keeps_the_tool_and_detects_no_less() -> None:
    problem = TrajectorySpeedLimits(load_scenario(PICK)).problem
    rng = np.random.default_rng(8)
    robot = problem.robot
    q = rng.uniform(0.5 * robot.lower, 0.5 * robot.upper, (18, 7))
    # One joint of twelve of them is beside a limit, beyond which the self-motion would go on.
    near, beside = np.arange(6, 18), rng.integers(7, size=12)
    q[near, beside] = 0.98 * np.where(rng.random(12) < 0.5, robot.lower[beside], robot.upper[beside])
    direction = rng.normal(size=(18, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    found = improve_detectability(problem, q, direction)
    assert np.abs(robot.pose(found.q) - robot.pose(q)).max() < 2e-6
    assert ((found.q >= robot.lower) & (found.q <= robot.upper)).all()
    torque = np.einsum("nij,ni->nj", robot.jacobian(found.q)[:, :3], direction)
    assert np.allclose(found.undetectable, (problem.thresholds / np.abs(torque)).min(axis=1))
    assert (found.gain >= 1).all()
    assert found.gain.max() > 1.1


def test_workspace_does_not_depend_on_threads() -> None:
    study = WorkspaceSpeedLimits(load_scenario(LINE), poses=6, cone_deg=0.0, seed=4)
    assert run(study).rows.equals(run(study, threads=2).rows)
    assert (run(study).rows["limit_mm_s"] > 0).any()


GANTRY = """<robot name="gantry"><link name="l0"/>{}</robot>"""
SLIDE = """<link name="l{0}"/><joint name="j{0}" type="prismatic"><parent link="l{1}"/><child link="l{0}"/>
<axis xyz="{2}"/><limit lower="4" upper="9" velocity="2" effort="100"/></joint>"""


def test_an_arm_that_follows_no_line_is_told_so(tmp_path: Path) -> None:
    slides = "".join(SLIDE.format(j + 1, j, axis) for j, axis in enumerate(("1 0 0", "0 1 0")))
    (tmp_path / "gantry.urdf").write_text(GANTRY.format(slides))
    (tmp_path / "path.csv").write_text("t,q_1,q_2\n0,5,5\n1,6,6\n2,7,6\n")
    changes = {"robot": str(tmp_path / "gantry.urdf"), "motion.file": str(tmp_path / "path.csv")}
    changes |= {"detector.thresholds_Nm": [50, 50], "detector.noise_sd_Nm": 5.0}
    with pytest.raises(InputError, match=r"^robot: gantry has 2 joints, which follow no straight line; speed limits "):
        TrajectorySpeedLimits(load_scenario(PICK, changes))


def test_poses_lie_all_over_the_joints_ranges(tmp_path: Path) -> None:
    slides = "".join(SLIDE.format(j + 1, j, axis) for j, axis in enumerate(("1 0 0", "0 1 0", "0 0 1")))
    (tmp_path / "gantry.urdf").write_text(GANTRY.format(slides))
    scenario = bs.Scenario.from_dict(
        {
            "robot": str(tmp_path / "gantry.urdf"),
            "pose_rad": [5.0, 6.0, 7.0],
            "motion": {"velocity_mm_s": [0, 0, -50], "task": "position"},
            "contact": {"body": "lower_arm_wrist", "limits": "ts15066"},
            "detector": {"thresholds_Nm": [50, 50, 50], "noise_sd_Nm": 5.0, "feedback_period_s": 0.004},
            "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 5.0},
        }
    )
    q = run(WorkspaceSpeedLimits(scenario, poses=100, cone_deg=0.0)).rows.select("q_1", "q_2", "q_3").to_numpy()
    assert q.min() >= 4
    assert q.max() <= 9
    # Of a hundred draws none in the lowest or the highest tenth has one chance in 37 000.
    assert (q.min(axis=0) < 4.5).all()
    assert (q.max(axis=0) > 8.5).all()


def test_a_long_trajectory_takes_the_direction_of_the_nearest_waypoint_that_moves(tmp_path: Path) -> None:
    """As many rows as two minutes at 250 Hz: nothing may grow with their square."""
    t = np.arange(30_000) / 250
    still = (t < 20) | (t > 100)
    share = np.where(still, np.where(t < 20, 0.0, 1.0), 0.5 - 0.5 * np.cos(math.pi * (t - 20) / 80))
    begin = TrajectorySpeedLimits(load_scenario(PICK)).trajectory.position[0]
    rows = np.column_stack([t, begin + share[:, None] * np.array([0.5, 0.1, 0, 0, 0, 0, 0])])
    header = ",".join(["t", *(f"q_{j + 1}" for j in range(7))])
    np.savetxt(tmp_path / "long.csv", rows, delimiter=",", header=header, comments="", fmt="%.10g")
    study = TrajectorySpeedLimits(load_scenario(PICK, {"motion.file": str(tmp_path / "long.csv")}))
    tracemalloc.start()
    direction = study.direction
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 5000 * len(t)
    moves = np.flatnonzero(np.linalg.norm(study.tip_velocity, axis=1) > 1e-6)
    for row in (0, moves[0] - 1, moves[0], moves[-1], moves[-1] + 1, len(t) - 1):
        nearest = moves[np.abs(moves - row).argmin()]
        velocity = study.tip_velocity[nearest]
        assert np.allclose(direction[row], velocity / np.linalg.norm(velocity))


@pytest.mark.parametrize(
    ("path", "changes", "settings", "field"),
    [
        (PICK, {"contact.body": None, "contact.stiffness_N_m": 1e4}, {}, "contact.body"),
        (PICK, {}, {"max_speed_mm_s": 0.0}, "--max-speed"),
        (PICK, {"verdict.accepted_probability": 1e-14}, {}, "verdict.accepted_probability"),
        (PICK, {}, {"max_speed_mm_s": math.nan}, "--max-speed"),
        (PICK, {}, {"cone_deg": -1.0}, "--cone"),
        (LINE, {"contact.kind": "free"}, {}, "contact.kind"),
        (LINE, {"contact.kind": "free", "contact.body": "skull_forehead"}, {}, "contact.body"),
        (LINE, {"verdict.clamped_limit": "two_phase"}, {}, "verdict.clamped_limit"),
        (LINE, {"motion.held_joints": [1, 2, 3, 4, 5, 6]}, {}, "motion.held_joints"),
    ],
)
def test_refuses_by_name(path: Path, changes: dict[str, Any], settings: dict[str, Any], field: str) -> None:
    kind = TrajectorySpeedLimits if path == PICK else WorkspaceSpeedLimits
    with pytest.raises(InputError) as caught:
        kind(load_scenario(path, changes), **settings)
    assert caught.value.field == field


def test_an_arm_without_a_spare_joint_is_refused() -> None:
    problem = WorkspaceSpeedLimits(load_scenario(LINE), poses=1)._line_problem
    with pytest.raises(InputError, match="6 free joints"):
        improve_detectability(problem, problem.q[None], np.array([[0.0, 0.0, 1.0]]))


def test_every_slower_speed_is_safe_where_the_body_is_at_a_fixed_distance() -> None:
    """There the risk has a sampling ripple over speed: a limit must lie below its first crest that fails."""
    changes = {"contact.offset_law": "fixed", "contact.offset_mm": 11.0, "detector.feedback_period_s": 0.012}
    case = load_scenario(LINE, changes)
    problem = CollisionProblem.from_scenario(case)
    direction = problem.velocity / np.linalg.norm(problem.velocity)
    found = speed_limits(case, problem.q[None], direction[None], np.array([1.0]))
    assert found.limited_by[0] == "risk"
    slower = found.speed[0] * np.geomspace(0.5, 1.0, 80)
    poses, limit = np.tile(problem.q, (80, 1)), allowed_force(problem)
    evaluations = evaluate_batch(case, poses, slower[:, None] * direction, limits_N=[limit])
    assert evaluations.exceedance.max() <= case.verdict.accepted_probability
    assert found.risk[0] == pytest.approx(evaluations.exceedance[-1, 0])


def test_slow_lines_are_followed_as_far_as_the_scenario_s_own() -> None:
    """Within the scenario's own time, slow arms would press too little to be detected, and no slow speed were safe."""
    short = load_scenario(LINE, {"motion.duration_s": 0.1})
    problem = CollisionProblem.from_scenario(short)
    q, direction = problem.q[None], (problem.velocity / np.linalg.norm(problem.velocity))[None]
    assert bs.evaluate(short.with_values({"motion.speed_mm_s": 5.0})).undetected_probability > 0.5
    for case in (short, load_scenario(LINE)):
        found = speed_limits(case, q, direction, np.array([0.005]))
        assert found.speed[0] == pytest.approx(0.005)
        # Followed to its own end, not to that of a batch: what it presses with then is the same at every speed.
        slow = worst_directions(CollisionProblem.from_scenario(case), q, direction, 0.3, np.array([0.005]))
        assert slow.found.speed[0] == pytest.approx(0.005)


@pytest.mark.parametrize(("cone_deg", "poses"), [(0.0, 6), (25.0, 4)])
def test_more_latency_makes_no_pose_safe_at_higher_speeds(cone_deg: float, poses: int) -> None:
    for name in (HAND, LINE):
        case = load_scenario(name, {"motion.duration_s": 0.3})
        limits = [
            run(
                WorkspaceSpeedLimits(
                    case.with_values({"reaction.latency_s": latency}), poses=poses, seed=1, cone_deg=cone_deg
                )
            ).rows["limit_mm_s"]
            for latency in (0.0, 0.003, 0.02, 0.07)
        ]
        # A search ends up to two hundredths below the highest speed that is met.
        assert all((later <= sooner * 1.0201).all() for sooner, later in itertools.pairwise(limits))
        assert (limits[-1] < limits[0]).any()
