"""Motions given as joint trajectories: against lines, against formulas, against samples, and what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.arrays import FloatArray
from bumpstop.collision.trajectory import Trajectory
from bumpstop.collision.trajectory_law import TrajectoryLaw, trajectory_kernel
from collision.cases import SIA5D_POSE, control_group
from collision.test_two_laws import compare

GANTRY = """<robot name="gantry"><link name="base_link"/>{joints}</robot>"""
SLIDE = """<joint name="slide_{name}" type="prismatic"><parent link="{parent}"/><child link="{child}"/>
<axis xyz="{axis}"/><limit lower="-2" upper="2" velocity="{speed}" effort="1"/></joint><link name="{child}"/>"""
AXES = {"x": "1 0 0", "y": "0 1 0", "z": "0 0 1"}
EXAMPLE = Path(__file__).parents[2] / "examples" / "06_pick_and_place_trajectory.toml"


def gantry(folder: Path, speed: float = 1.0) -> None:
    """Three slides, so that paths are straight in the joints, too."""
    links = ["base_link", "link_x", "link_y", "link_z"]
    joints = "".join(
        SLIDE.format(name=name, parent=links[i], child=links[i + 1], axis=axis, speed=speed)
        for i, (name, axis) in enumerate(AXES.items())
    )
    (folder / "gantry.urdf").write_text(GANTRY.format(joints=joints), encoding="utf-8")


def write_csv(path: Path, time: FloatArray, *columns: FloatArray) -> Path:
    dof = columns[0].shape[1]
    names = [f"{symbol}_{j + 1}" for symbol in ("q", "qd")[: len(columns)] for j in range(dof)]
    rows = [",".join(f"{value:.17g}" for value in row) for row in np.column_stack([time, *columns])]
    path.write_text("\n".join([",".join(["t", *names]), *rows]) + "\n", encoding="utf-8")
    return path


def scenario(folder: Path, motion: dict[str, Any], robot: str = "gantry.urdf", **changes: Any) -> bs.Scenario:
    dof = 3 if "gantry" in robot else 7
    data: dict[str, Any] = {
        "robot": robot,
        "motion": motion,
        "contact": {"stiffness_N_m": 20000},
        "detector": {"thresholds_Nm": [20.0] * dof, "noise_sd_Nm": 4.0},
        "reaction": {"kind": "stop", "joint_acceleration_rad_s2": 2.0},
    }
    for key, value in changes.items():
        table, _, name = key.partition("__")
        data[table] = value if not name else data.get(table, {}) | {name: value}
    return bs.Scenario.from_dict(data, folder)


def trajectory_motion(**more: Any) -> dict[str, Any]:
    return {"kind": "trajectory", "file": "path.csv", **more}


def waves(
    seed: int, duration: float, dof: int = 7, rows: int = 40, size: float = 0.15
) -> tuple[FloatArray, FloatArray]:
    """A smooth random motion about the standard pose."""
    rng = np.random.default_rng(seed)
    t = np.linspace(0, duration, rows)
    q = np.tile(np.radians(SIA5D_POSE), (rows, 1))[:, :dof]
    for harmonic in (1, 2, 3):
        rate = 0.9 * harmonic
        q = q + size / harmonic * rng.normal(size=dof) * np.sin(rate * t[:, None] + rng.uniform(0, 6, dof))
    return t, q


# --- Against lines ------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", ["stop", "reverse"])
@pytest.mark.parametrize("latency", [0.0, 0.007])
def test_a_straight_trajectory_is_a_line(kind: str, latency: float, tmp_path: Path) -> None:
    """Along slides path and joints are straight, so nothing but the code differs."""
    gantry(tmp_path)
    velocity, duration, begin = np.array([0.03, -0.02, -0.06]), 0.8, 0.2137
    t = np.array([0.0, 0.3, duration])
    write_csv(tmp_path / "path.csv", t, t[:, None] * velocity)
    reaction = {"kind": kind, "joint_acceleration_rad_s2": [2.0, 1.0, 1.5], "latency_s": latency}
    line = scenario(
        tmp_path,
        {"velocity_mm_s": [float(v) for v in 1e3 * velocity], "task": "position", "duration_s": duration},
        pose_rad=[0.0, 0.0, 0.0],
        contact={
            "stiffness_N_m": 20000,
            "offset_law": "fixed",
            "offset_mm": 1e3 * begin * float(np.linalg.norm(velocity)),
        },
        reaction=reaction,
        detector__noise_sd_Nm=6.0,
    )
    path = scenario(tmp_path, trajectory_motion(contact_time=begin), reaction=reaction, detector__noise_sd_Nm=6.0)
    expected, found = bs.evaluate(line), bs.evaluate(path)
    assert expected.false_alarm_probability > 1e-3
    for name in ("peak_force", "force_at_detection", "detection_delay", "contact_time"):
        ours, theirs = getattr(found, name), getattr(expected, name)
        assert (ours is None) == (theirs is None)
        if ours is None:
            continue
        tolerance = 2e-3 if name == "contact_time" else 1e-8  # the line's is read between simulation steps
        assert ours.mean == pytest.approx(theirs.mean, rel=tolerance)
        assert ours.sd == pytest.approx(theirs.sd, rel=10 * tolerance)
        for p in (0.05, 0.5, 0.95, 0.999):
            assert ours.quantile(p) == pytest.approx(theirs.quantile(p), rel=tolerance, abs=1e-9)
    assert found.false_alarm_probability == pytest.approx(expected.false_alarm_probability, rel=1e-9)
    assert found.several_joints_probability == pytest.approx(expected.several_joints_probability, rel=1e-9)
    np.testing.assert_allclose(found.trigger_joint_probability, expected.trigger_joint_probability, rtol=1e-8)


def test_a_turning_arm_along_a_line(tmp_path: Path) -> None:
    """The SIA5D's own line, as rows of a trajectory: the same until it reacts, and nearly the same stop."""
    line = control_group(
        contact__offset_law="fixed", contact__offset_mm=6.3, reaction__kind="stop", motion__duration_s=0.6
    )
    problem = bs.Problem.from_scenario(line)
    curve = bs.stopping_curve(problem, whole=True)
    free = [j for j in range(7) if j not in problem.held]
    state = np.zeros((curve.ticks + 1, 2, 7))
    state[:, 0] = problem.q
    state[0, 1] = problem.start["qd"]
    state[1:, :, free] = curve.kernel.reaction_state
    write_csv(tmp_path / "path.csv", np.append(0.0, curve.tick_time), state[:, 0], state[:, 1])
    data = line.to_dict()
    data["motion"] = trajectory_motion(contact_time=6.3e-3 / curve.approach_speed)
    del data["pose_deg"], data["contact"]["offset_law"], data["contact"]["offset_mm"], data["contact"]["offset_sd_s"]
    data["contact"]["normal"] = [float(x) for x in curve.normal]
    expected, found = bs.evaluate(line), bs.evaluate(bs.Scenario.from_dict(data, tmp_path))
    assert found.force_at_detection.mean == pytest.approx(expected.force_at_detection.mean, rel=1e-4)
    assert found.detection_delay.mean == pytest.approx(expected.detection_delay.mean, rel=1e-4)
    assert found.trigger_joint_probability == pytest.approx(expected.trigger_joint_probability, rel=1e-3, abs=1e-9)
    # Along its path or along its joints, the arm stops within some millimetres, which differ little.
    assert found.peak_force.mean == pytest.approx(expected.peak_force.mean, rel=0.02)


# --- Stopping along the path --------------------------------------------------------------------------------


@pytest.mark.parametrize("speed", [0.05, 0.2, 0.5])
def test_stopping_distance(speed: float, tmp_path: Path) -> None:
    gantry(tmp_path)
    t = np.array([0.0, 1.0, 2.0])
    write_csv(tmp_path / "path.csv", t, t[:, None] * [0, 0, -speed])
    problem = bs.Problem.from_scenario(scenario(tmp_path, trajectory_motion()))
    kernel = trajectory_kernel(problem)
    curve = kernel.curve(0.1, np.array([0.0, 0.0, -1.0]))
    for k in (30, 100, 200):
        travelled = curve["farthest"][k] - curve["distance"][4 * k + 1]
        # The controller works in sub-steps of 0.2 ms; it has lost speed before it moves on.
        assert travelled == pytest.approx(speed**2 / (2 * 2.0) - speed * 0.2e-3 / 2, abs=2e-6 * speed)


def test_contact_before_the_end(tmp_path: Path) -> None:
    """An arm that stops by itself needs no reaction to; the force is that of the rest of its way."""
    gantry(tmp_path)
    t = np.linspace(0, 1, 60)
    way = 0.1 * (3 * t**2 - 2 * t**3)
    write_csv(tmp_path / "path.csv", t, way[:, None] * [0, 0, -1.0])
    law = bs.evaluate(scenario(tmp_path, trajectory_motion(contact_time=0.98)))
    rest = 0.1 - 0.1 * (3 * 0.98**2 - 2 * 0.98**3)
    assert law.undetected_probability > 0.99
    assert law.peak_force.mean == pytest.approx(20000 * rest, rel=1e-3)
    assert law.verdict.acceptable is None
    assert not any("still moves" in note for note in law.notes), "it comes to rest"
    assert isinstance(law, TrajectoryLaw)
    assert law.greatest_undetected == pytest.approx(20000 * rest, rel=1e-3)
    assert math.isinf(law.peak_force.quantile(0.5)), "collisions never detected are beyond every quantile"


@pytest.mark.parametrize("kind", ["stop", "reverse"])
@pytest.mark.parametrize("seed", range(6))
def test_no_joint_brakes_harder_than_it_may(seed: int, kind: str, tmp_path: Path) -> None:
    t, q = waves(seed, 2.0)
    write_csv(tmp_path / "path.csv", t, q)
    limit = np.array([3.0, 2.0, 4.0, 2.5, 4.0, 3.0, 5.0])
    problem = bs.Problem.from_scenario(
        scenario(
            tmp_path,
            trajectory_motion(),
            robot="sia5d",
            reaction={"kind": kind, "joint_acceleration_rad_s2": [float(x) for x in limit]},
        )
    )
    kernel, path = trajectory_kernel(problem), problem.trajectory
    assert path is not None
    assert kernel.excess == 1, "the motion itself keeps the limits"
    assert np.abs(path.at(np.linspace(0, 2, 500), 2)).max() < 2
    used = []
    for k in range(0, kernel.ticks - 60, 7):
        u = kernel.reaction(k)
        begin = u[0]
        assert begin == pytest.approx(0.004 * k + 0.001)
        # From the undisturbed motion before it, to the final speed after it.
        u = np.concatenate([[begin - 1e-3], u])
        acceleration = np.diff(path.at(np.clip(u, 0, 2)), n=2, axis=0) / 1e-6
        share = np.abs(acceleration) / limit
        assert share.max() < 1.03
        used.append(share.max(axis=1)[1:-2])
        final = u[-1] - u[-2]
        assert -1.001e-3 < final < (1e-3 if kind == "stop" else 0)
        assert (np.diff(u[1:], n=2) < 1e-12).all(), "an arm that brakes does not speed up"
    # And as hard as they may: some joint is at its limit in nearly every step.
    assert np.median(np.concatenate(used)) > 0.97


def test_curvature_beyond_the_limits(tmp_path: Path) -> None:
    """Where following the path alone needs more than the limits, the arm still brakes, and a note says so."""
    t, q = waves(1, 2.0, size=0.5)
    write_csv(tmp_path / "path.csv", t, q)
    law = bs.evaluate(
        scenario(
            tmp_path,
            trajectory_motion(contact_time=1.0),
            robot="sia5d",
            reaction={"kind": "stop", "joint_acceleration_rad_s2": 0.5},
        )
    )
    assert law.kernel.excess > 1.5
    assert any("own joint accelerations" in note for note in law.notes)
    ends = [law.kernel.reaction(k) for k in range(0, law.kernel.ticks, 11)]
    assert all((np.diff(u) >= 0).all() for u in ends)


# --- The time of contact ------------------------------------------------------------------------------------


def test_uniform_is_the_average_of_fixed_times(tmp_path: Path) -> None:
    t, q = waves(3, 0.24, rows=12, size=0.25)
    write_csv(tmp_path / "path.csv", t, q)
    noisy = {"detector__noise_sd_Nm": 5.0, "robot": "sia5d"}
    law = bs.evaluate(scenario(tmp_path, trajectory_motion(), **noisy))
    times = (np.arange(300) + 0.5) * 0.24 / 300
    fixed = [bs.evaluate(scenario(tmp_path, trajectory_motion(contact_time=float(x)), **noisy)) for x in times]

    def average(figure: Any) -> float:
        return float(np.mean([figure(one) for one in fixed]))

    assert law.false_alarm_probability > 0.01
    assert law.false_alarm_probability == pytest.approx(average(lambda one: one.false_alarm_probability), rel=2e-3)
    assert law.undetected_probability == pytest.approx(average(lambda one: one.undetected_probability), rel=5e-3)
    assert law.peak_force.mean == pytest.approx(average(lambda one: one.peak_force.mean), rel=1e-3)
    for x in np.linspace(0.3, 1.5, 7) * law.peak_force.quantile(0.4):
        assert law.peak_force.exceedance(float(x)) == pytest.approx(
            average(lambda one, x=float(x): one.peak_force.exceedance(x)), abs=4e-3
        )


DETECTORS: dict[str, dict[str, Any]] = {
    "white": {},
    "correlated": {"noise_correlation": 0.6},
    "observer": {"residual": "observer", "observer_gain_1_s": 60.0},
}


@pytest.mark.parametrize("name", list(DETECTORS))
@pytest.mark.parametrize("kind", ["stop", "reverse"])
def test_exact_and_sampled_agree(name: str, kind: str, tmp_path: Path) -> None:
    number = list(DETECTORS).index(name)
    t, q = waves(20 + number, 0.7, rows=15, size=0.2)
    write_csv(tmp_path / "path.csv", t, q)
    noise = {"thresholds_Nm": [16.0, 12, 16, 12, 9, 9, 5], "noise_sd_Nm": 3.6, "arming_delay_s": 0.02}
    compare(
        scenario(
            tmp_path,
            trajectory_motion(),
            robot="sia5d",
            detector=noise | DETECTORS[name],
            reaction={"kind": kind, "joint_acceleration_rad_s2": 6.0, "latency_s": 0.004 * number},
        ),
        40_000 if name == "white" else 15_000,
        seed=5,
    )


def test_more_nodes_change_nothing_that_is_printed() -> None:
    law, fine = (bs.evaluate(bs.load_scenario(EXAMPLE), refinement=n) for n in (1, 2))
    for name in ("force_at_detection", "detection_delay"):
        ours, theirs = getattr(law, name).to_json(), getattr(fine, name).to_json()
        for figure, value in ours.items():
            assert value == pytest.approx(theirs[figure], rel=4e-3), (name, figure)
    assert law.peak_force.mean == pytest.approx(fine.peak_force.mean, rel=1e-4)
    assert law.undetected_probability == pytest.approx(fine.undetected_probability, abs=5e-4)


def test_a_point_that_stands_still_meets_nobody(tmp_path: Path) -> None:
    gantry(tmp_path)
    t = np.linspace(0, 1, 101)
    way = np.clip(t - 0.5, 0, None) * 0.1
    rates = np.where(t[:, None] >= 0.5, 0.1, 0.0) * [0, 0, -1.0]
    write_csv(tmp_path / "path.csv", t, way[:, None] * [0, 0, -1.0], rates)
    law = bs.evaluate(scenario(tmp_path, trajectory_motion()))
    assert isinstance(law, TrajectoryLaw)
    assert law.times.still == pytest.approx(0.49, abs=0.015)
    assert any("ends while the arm still moves" in note for note in law.notes)
    (note,) = [note for note in law.notes if "does not move toward a body" in note]
    assert f"{law.times.still:.2%}" in note
    assert (bs.evaluate(law.scenario, samples=500).runs or {})["contact_time"].min() > 0.485


@pytest.mark.parametrize("contact_time", ["uniform", 0.11])
def test_quantiles_and_tails_belong_together(contact_time: float | str, tmp_path: Path) -> None:
    t, q = waves(3, 0.24, rows=12, size=0.25)
    write_csv(tmp_path / "path.csv", t, q)
    law = bs.evaluate(scenario(tmp_path, trajectory_motion(contact_time=contact_time), robot="sia5d"))
    for quantity in (law.peak_force, law.pressure, law.force_at_detection, law.detection_delay):
        for p in (1e-9, 0.01, 0.3, 0.5, 0.77, 0.95, 0.999, 1 - 1e-7):
            x = quantity.quantile(p)
            if not math.isfinite(x):
                assert law.undetected_probability > 1 - p
                continue
            assert quantity.exceedance(x) <= (1 - p) * (1 + 1e-6)
            if x > 0:
                assert quantity.exceedance(x * (1 - 1e-6)) >= (1 - p) * (1 - 1e-3) - 1e-6
        edges = np.linspace(0, quantity.quantile(0.5) * 3, 60)
        mass = float((quantity.density(edges) * np.diff(edges)).sum())
        assert mass == pytest.approx(quantity.exceedance(0.0) - quantity.exceedance(edges[-1]), abs=1e-12)


def test_sampled_runs_do_not_depend_on_threads(tmp_path: Path) -> None:
    t, q = waves(2, 0.4, rows=10)
    write_csv(tmp_path / "path.csv", t, q)
    path = scenario(tmp_path, trajectory_motion(), robot="sia5d")
    one, two = (bs.evaluate(path, samples=600, seed=9, threads=n) for n in (1, 2))
    fewer = bs.evaluate(path, samples=300, seed=9)
    assert one.runs is not None
    assert two.runs is not None
    assert fewer.runs is not None
    for name, values in one.runs.items():
        assert (values == two.runs[name]).all()
        assert (values[:300] == fewer.runs[name]).all()


# --- Files --------------------------------------------------------------------------------------------------


NAMES = ["slide_x", "slide_y", "slide_z"]


def message(**changes: Any) -> dict[str, Any]:
    points = [
        {"positions": [0.01 * i, 0.0, -0.05 * i], "time_from_start": {"sec": i, "nanosec": 500_000_000}}
        for i in range(3)
    ]
    return {"joint_names": list(NAMES), "points": points} | changes


def read(folder: Path, name: str, text: str) -> Trajectory:
    gantry(folder, speed=1.0)
    (folder / name).write_text(text, encoding="utf-8")
    problem = bs.Problem.from_scenario(scenario(folder, {"kind": "trajectory", "file": name}))
    assert problem.trajectory is not None
    return problem.trajectory


def test_the_same_motion_in_every_format(tmp_path: Path) -> None:
    import yaml

    as_json = read(tmp_path, "path.json", json.dumps(message()))
    as_yaml = read(tmp_path, "path.yaml", yaml.safe_dump(message()) + "---\n")
    turned = message(joint_names=["slide_z", "slide_x", "slide_y"])
    for i, point in enumerate(turned["points"]):
        x, y, z = point["positions"]
        point |= {"positions": [z, x, y], "velocities": [], "time_from_start": {"secs": i, "nsecs": 500_000_000}}
    in_other_order = read(tmp_path, "path.yml", yaml.safe_dump(turned))
    seconds = message()
    for i, point in enumerate(seconds["points"]):
        point["time_from_start"] = i + 0.5
    in_seconds = read(tmp_path, "seconds.json", json.dumps(seconds))
    table = read(tmp_path, "path.csv", "t,q_1,q_2,q_3\n0.5,0,0,0\n1.5,0.01,0,-5e-2\n2.5,0.02,0,-0.1\n")
    for other in (as_yaml, in_other_order, in_seconds, table):
        np.testing.assert_allclose(other.time, as_json.time, rtol=1e-15)
        np.testing.assert_array_equal(other.position, as_json.position)
        assert other.velocity is None
    assert as_json.duration == 2
    np.testing.assert_allclose(as_json.at(0.5), [0.005, 0, -0.025], atol=1e-15)


def test_velocities_are_kept(tmp_path: Path) -> None:
    path = read(
        tmp_path, "path.csv", "t,q_1,qd_1,q_2,qd_2,q_3,qd_3\n0,0,0,0,0,0,0.1\n1,0,0,0,0,0.05,0\n2,0,0,0,0,0,0\n"
    )
    assert path.velocity is not None
    np.testing.assert_allclose(path.at(np.array([0.0, 1.0, 2.0]), 1)[:, 2], [0.1, 0, 0], atol=1e-15)
    np.testing.assert_allclose(path.at(1.0)[2], 0.05)


def test_numbers_that_yaml_takes_for_texts(tmp_path: Path) -> None:
    text = "joint_names: [slide_x, slide_y, slide_z]\npoints:\n"
    text += "- {positions: [0, 0, 0], time_from_start: 0}\n- {positions: [1e-3, 0, -2E-2], time_from_start: 1e0}\n"
    assert read(tmp_path, "path.yaml", text).position[1].tolist() == [1e-3, 0, -2e-2]


HEAD = "t,q_1,q_2,q_3\n"
CSV_REFUSALS = {
    "no rows": ("", "no column 't'"),
    "one row": (HEAD + "0,0,0,0\n", "has 1 rows; wanted at least 2"),
    "degrees": ("t,q_1_deg,q_2,q_3\n", "column 'q_1_deg'; did you mean 'q_1'"),
    "twice": ("t,q_1,q_1,q_3\n", "the column 'q_1' twice"),
    "too few joints": ("t,q_1,q_2\n0,0,0\n", "no column 'q_3'"),
    "too many joints": ("t,q_1,q_2,q_3,q_4\n", "has a column 'q_4'"),
    "some velocities": ("t,q_1,q_2,q_3,qd_1\n", "no column 'qd_2'"),
    "no number": (HEAD + "0,0,0,0\n1,0,x,0\n", "row 2, column q_2: 'x' cannot be used; wanted a finite number"),
    "not finite": (HEAD + "0,0,0,0\n1,0,0,inf\n", "row 2, column q_3: inf cannot be used"),
    "NaN time": (HEAD + "0,0,0,0\nnan,0,0,0\n", "row 2, column t: nan cannot be used"),
    "too few values": (HEAD + "0,0,0,0\n1,0,0\n", "row 2 has 3 values; the header has 4"),
    "time stands": (HEAD + "0,0,0,0\n1,0,0,0\n1,0,0,0.1\n", "row 3, column t: 1 s is not after 1 s"),
    "time runs back": (HEAD + "0,0,0,0\n1,0,0,0\n0.5,0,0,0\n", "row 3, column t: 0.5 s is not after 1 s"),
    "joint limit": (HEAD + "0,0,0,0\n9,0,0,2.5\n", "row 2, column q_3: joint 3 at 2.5 is outside its limits"),
    "joint speed": (HEAD + "0,0,0,0\n1,0,1.5,0\n", "between rows 1 and 2 .*q_2: joint 2 moves at 1.5 m/s"),
    "limit between rows": (
        HEAD + "0,0,0,1.99\n4,0,0,1.99\n5,0,0,1.6\n9,0,0,1.6\n",
        "between rows 1 and 2 .*the curve through the rows takes joint 3 to .*give more rows",
    ),
    "too short": (HEAD + "0,0,0,0\n0.0005,0,0,0\n", "the motion takes 0.0005 s; wanted 0.001 to 120 s"),
    "too long": (HEAD + "0,0,0,0\n200,0,0,0.5\n", "the motion takes 200 s"),
}  # fmt: skip


@pytest.mark.parametrize("name", list(CSV_REFUSALS))
def test_csv_refusals(name: str, tmp_path: Path) -> None:
    text, words = CSV_REFUSALS[name]
    with pytest.raises(bs.InputError, match=words) as refused:
        read(tmp_path, "path.csv", text)
    assert refused.value.field == "motion.file"
    assert "path.csv: " in refused.value.problem


def point(**changes: Any) -> list[dict[str, Any]]:
    return [*message()["points"][:1], message()["points"][1] | changes]


MESSAGE_REFUSALS: dict[str, tuple[Any, str]] = {
    "a list": ([1, 2], "is no JointTrajectory"),
    "unknown key": (message(joint_name=[]), "'joint_name' is not a key; did you mean 'joint_names'"),
    "no points": ({"joint_names": NAMES}, "points is missing"),
    "points no list": (message(points=3), "points: 3 cannot be used; wanted a list"),
    "unknown joint": (message(joint_names=["slide_x", "slide_y", "slide_a"]), "no joint 'slide_a'; did you mean"),
    "missing joint": (message(joint_names=["slide_x", "slide_y"]), "joint_names: 'slide_z' is missing"),
    "joint twice": (message(joint_names=["slide_x", "slide_x", "slide_z"]), "'slide_x' occurs twice"),
    "point no table": (message(points=[4]), "point 1: 4 is no point"),
    "point key": (message(points=point(position=[1])), "point 2: 'position' is not a key; did you mean 'positions'"),
    "no time": (message(points=[{"positions": [0, 0, 0]}]), "point 1: time_from_start is missing"),
    "bad time": (message(points=point(time_from_start={"sec": 1})), "point 2, time_from_start: .*wanted sec and"),
    "few positions": (message(points=point(positions=[0, 1])), "point 2, positions: has 2 values; joint_names has 3"),
    "text": (message(points=point(positions=[0, "a", 0])), "point 2, positions, joint slide_y: 'a' cannot be used"),
    "true": (message(points=point(positions=[0, True, 0])), "point 2, positions, joint slide_y: True cannot be used"),
    "not finite": (message(points=point(positions=[0, 0, math.inf])), "joint slide_z: inf cannot be used"),
    "some velocities": (message(points=point(velocities=[0, 0, 0])), "point 2: velocities are given at some"),
    "no time passes": (message(points=point(time_from_start=0.5)), "point 2, column t: 0.5 s is not after 0.5 s"),
}  # fmt: skip


@pytest.mark.parametrize("name", list(MESSAGE_REFUSALS))
@pytest.mark.parametrize("kind", ["json", "yaml"])
def test_message_refusals(name: str, kind: str, tmp_path: Path) -> None:
    import yaml

    data, words = MESSAGE_REFUSALS[name]
    with pytest.raises(bs.InputError, match=words) as refused:
        read(tmp_path, f"path.{kind}", json.dumps(data) if kind == "json" else yaml.safe_dump(data))
    assert refused.value.field == "motion.file"


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("path.json", "{", "not valid JSON"),
        ("path.json", "[" * 100_000, "not valid JSON"),
        ("path.yaml", "a: [", "not valid YAML"),
        ("path.yaml", "!!python/object/apply:os.system [ls]", "not valid YAML"),
        ("path.yaml", "{}\n---\n{}\n", "holds 2 trajectories; wanted one"),
        ("path.yaml", "", "is no JointTrajectory"),
        ("path.txt", "", "has the extension '.txt'; wanted one of .csv"),
    ],
)
def test_damaged_files(name: str, text: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(bs.InputError, match=words):
        read(tmp_path, name, text)


def test_absent_and_endless_files(tmp_path: Path) -> None:
    gantry(tmp_path)
    with pytest.raises(bs.InputError, match=r"cannot be read \(No such file"):
        bs.Problem.from_scenario(scenario(tmp_path, trajectory_motion()))
    (tmp_path / "path.yaml").write_bytes(b" " * 5_000_001)
    with pytest.raises(bs.InputError, match="longer than 5000000 bytes"):
        bs.Problem.from_scenario(scenario(tmp_path, {"kind": "trajectory", "file": "path.yaml"}))
    (tmp_path / "path.csv").write_bytes(b"t,q_1\xff\n")
    with pytest.raises(bs.InputError, match="is not UTF-8 text"):
        bs.Problem.from_scenario(scenario(tmp_path, trajectory_motion()))


# --- Keys ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("changes", "field", "words"),
    [
        ({"motion": {"kind": "trajectory"}}, "motion.file", "is missing"),
        ({"motion": trajectory_motion(velocity_mm_s=[0, 0, 1])}, "motion.velocity_mm_s", "has no meaning with kind"),
        ({"motion": trajectory_motion(start="rest")}, "motion.start", "has no meaning with kind"),
        ({"motion": trajectory_motion(duration_s=1.0)}, "motion.duration_s", "has no meaning with kind"),
        ({"motion": trajectory_motion(task="pose")}, "motion.task", "has no meaning with kind"),
        ({"motion": trajectory_motion(held_joints=[])}, "motion.held_joints", "has no meaning with kind"),
        ({"motion": trajectory_motion(damping=0.0)}, "motion.damping", "has no meaning with kind"),
        ({"motion": trajectory_motion(contact_time=-1.0)}, "motion.contact_time", "'uniform' or a number from 0"),
        ({"motion": trajectory_motion(contact_time="late")}, "motion.contact_time", "wanted 'uniform' or a number"),
        ({"motion": {"velocity_mm_s": [0, 0, 1], "file": "a.csv"}}, "motion.file", 'has no meaning with kind = "line"'),
        ({"motion": {"velocity_mm_s": [0, 0, 1], "contact_time": 1.0}}, "motion.contact_time", "has no meaning"),
        ({"motion": {}, "pose_rad": [0.0, 0.0, 0.0]}, "motion.velocity_mm_s", "is missing"),
        ({"pose_rad": [0.0, 0.0, 0.0]}, "pose_rad", "has no meaning with motion.kind"),
        ({"pose_deg": [0.0, 0.0, 0.0]}, "pose_deg", "has no meaning with motion.kind"),
        ({"contact__offset_law": "uniform"}, "contact.offset_law", "motion.contact_time says when contact begins"),
        ({"contact__offset_sd_s": 0.1}, "contact.offset_sd_s", "motion.contact_time says when"),
        ({"contact": {"stiffness_N_m": 1e4, "offset_law": "fixed", "offset_mm": 1.0}}, "contact.offset_law", "leave"),
    ],
)  # fmt: skip
def test_key_refusals(changes: dict[str, Any], field: str, words: str, tmp_path: Path) -> None:
    with pytest.raises(bs.InputError, match=words) as refused:
        scenario(tmp_path, changes.pop("motion", trajectory_motion()), **changes)
    assert refused.value.field == field


def test_refusals_of_the_motion(tmp_path: Path) -> None:
    gantry(tmp_path)
    t = np.array([0.0, 1.0, 2.0])
    write_csv(tmp_path / "path.csv", t, t[:, None] * [0, 0, -0.1])
    with pytest.raises(bs.InputError, match="2 s is not in the motion; wanted less than 2 s"):
        bs.evaluate(scenario(tmp_path, trajectory_motion(contact_time=2.0)))
    with pytest.raises(bs.InputError, match="does not move toward the body"):
        bs.evaluate(scenario(tmp_path, trajectory_motion(contact_time=1.0), contact__normal=[0, 0, 1]))
    with pytest.raises(bs.InputError, match="never moves toward the body"):
        bs.evaluate(scenario(tmp_path, trajectory_motion(), contact__normal=[0, 0, 1]))
    with pytest.raises(bs.InputError, match="a stopping curve for every time of contact"):
        bs.stopping_curve(bs.Problem.from_scenario(scenario(tmp_path, trajectory_motion())))
    with pytest.raises(bs.InputError, match="straight lines only"):
        bs.evaluate_batch(scenario(tmp_path, trajectory_motion()), np.zeros((1, 3)), np.ones((1, 3)))


def test_a_scenario_survives_its_own_dictionary() -> None:
    loaded = bs.load_scenario(EXAMPLE)
    again = bs.Scenario.from_dict(loaded.to_dict(), loaded.folder)
    assert again == loaded
    assert again.with_values({"motion.contact_time": 1.2}).motion.contact_time == 1.2
