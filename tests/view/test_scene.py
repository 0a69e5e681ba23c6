"""What stands in the picture: shapes where joints are, forces by two routes, a hand that is reached for."""

from __future__ import annotations

import re
from itertools import combinations

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.contact import LimitTable
from bumpstop.detection.sensitivity import undetectable_force_along
from bumpstop.model import Robot
from bumpstop.view.colour_scale import colours_of
from bumpstop.view.page.overlay import poor_lines
from bumpstop.view.plots.chart import Chart, ticks
from bumpstop.view.point_rows import SLICE_M, PointRows
from bumpstop.view.scene.arm_shapes import arm_shapes
from bumpstop.view.scene.person import person_parts
from bumpstop.view.scene.polytope import force_polytope
from bumpstop.view.scene.poor_directions import poor_directions
from bumpstop.view.scene.reaching import reach_for
from view.cases import HAND, ROOT, twelve_joints


@pytest.mark.parametrize("robot", [*map(Robot.load, bs.robots()), twelve_joints()], ids=lambda robot: robot.name)
def test_shapes_enclose_the_lines_between_joints(robot: Robot) -> None:
    """A ray across the middle of every line meets the shape of the link that carries it."""
    shapes = {shape.link: shape for shape in arm_shapes(robot)}
    for number, joint in enumerate([*robot.joints[1:], None], start=0):
        end = np.asarray(robot.tip_origin if joint is None else joint.origin)
        if np.linalg.norm(end) < 0.02:
            continue
        side = np.cross(end, [0.3, 0.5, 0.7])
        side /= np.linalg.norm(side)
        far = shapes[number].hit(end / 2 + 5 * side, -side)
        assert far is not None
        assert 4.5 < far < 5.0
        assert shapes[number].hit(end / 2 + 5 * side, side) is None
    for shape in shapes.values():
        # Closed and facing outwards: the signed volume is positive, and every edge has its opposite.
        a, b, c = (shape.vertices[shape.faces[:, k]] for k in range(3))
        assert np.einsum("ij,ij->i", a, np.cross(b, c)).sum() > 0
        edges = [tuple(edge) for f in shape.faces.tolist() for edge in ((f[0], f[1]), (f[1], f[2]), (f[2], f[0]))]
        assert {(j, i) for i, j in edges} == set(edges)


def test_corners_of_undetectable_forces_touch_a_threshold() -> None:
    rng = np.random.default_rng(1)
    problem = bs.CollisionProblem.from_scenario(HAND)
    for _ in range(5):
        q = problem.q + 0.2 * rng.standard_normal(problem.q.size)
        found = force_polytope(problem, q)
        torque = np.abs(found.vertices @ problem.robot.jacobian(q)[:3]) / problem.thresholds
        assert torque.max(axis=1) == pytest.approx(1.0, rel=1e-6)
        sizes = np.linalg.norm(found.vertices, axis=1)
        assert found.largest_N == pytest.approx(sizes.max(), rel=1e-6)
        # Along a corner nothing more stays undetected than the corner itself.
        corner = found.vertices[int(sizes.argmax())]
        along = undetectable_force_along(problem.robot, q, corner / np.linalg.norm(corner), problem.thresholds)
        assert along == pytest.approx(sizes.max(), rel=1e-6)


@pytest.mark.parametrize("name", ["01_hand_downward", "05_ur10e"])
def test_poor_directions_are_those_of_the_sensitivity(name: str) -> None:
    """By two routes: a force along a row, at its point of its link, and no place's other directions are poorer."""
    problem = bs.CollisionProblem.from_scenario(bs.load_scenario(ROOT / "examples" / f"{name}.toml"))
    robot, q, theta = problem.robot, problem.q, problem.thresholds
    found = poor_directions(problem, q)
    assert set(found.link) >= {robot.dof - 1, 1}
    rng = np.random.default_rng(5)
    for row in range(found.link.size):
        link, point = robot.joints[int(found.link[row])].link, found.point[row]
        assert robot.pose(q, link, point)[:3, 3] == pytest.approx(found.place[row])
        along = undetectable_force_along(robot, q, found.direction[row], theta, link=link, point=point)
        if np.isinf(found.force[row]):
            assert along > 1e9
            continue
        assert along == pytest.approx(found.force[row], rel=1e-6)
        if np.isfinite(found.force[(found.place == found.place[row]).all(axis=1)]).all():
            others = rng.standard_normal((200, 3))
            others /= np.linalg.norm(others, axis=1, keepdims=True)
            poses = np.tile(q, (200, 1))
            beside = undetectable_force_along(robot, poses, others, theta, link=link, point=point)
            assert beside.max() <= found.force[row] * (1 + 1e-9)
    # Long links have three places, the last of them at the next joint.
    places = np.unique(np.round(found.place[found.link == 2], 9), axis=0)
    assert len(places) == 3
    end = robot.pose(q, robot.joints[3].link)[:3, 3]
    assert np.linalg.norm(places - end, axis=1).min() < 1e-6
    # The first link turns about one axis: two directions of three are not detected there at all.
    assert np.isinf(found.force[found.link == 1]).any()
    lines = poor_lines(found)
    length = np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1)
    felt = np.isfinite(found.force) & (found.force < 250)
    assert length[felt] == pytest.approx(2e-3 * found.force[felt])


def test_a_hand_is_reached_for_within_limits() -> None:
    rng, robot = np.random.default_rng(2), Robot.load("ur10e")
    for _ in range(10):
        q = rng.uniform(-1.2, 1.2, 6)
        near = np.clip(q + 0.15 * rng.standard_normal(6), robot.lower, robot.upper)
        found = reach_for(robot, q, robot.pose(near))
        assert np.abs(robot.pose(found)[:3, 3] - robot.pose(near)[:3, 3]).max() < 2e-3
    far = np.eye(4)
    far[:3, 3] = (9.0, 0.0, 0.0)
    stretched = reach_for(robot, np.full(6, 0.3), far, turned=False)
    assert ((stretched >= robot.lower) & (stretched <= robot.upper)).all()
    assert robot.pose(stretched)[0, 3] > 1.0


@pytest.mark.parametrize("table", ["bgia2011", "ts15066"])
def test_every_region_can_be_clicked(table: str) -> None:
    limits = LimitTable.load(table)
    parts = person_parts(limits)
    assert set(parts) == {region.name for region in limits.regions}
    lengths = [round(float(np.abs(vertices).sum()), 6) for vertices, _ in parts.values()]
    assert len(set(lengths)) > 0.6 * len(lengths)


def test_a_click_finds_the_point_under_it() -> None:
    rng = np.random.default_rng(3)
    place = rng.uniform(-1, 1, (61_000, 3))
    rows = PointRows(place, place[:, :1], place, place, place[:, 0], "x", np.arange(61_000))
    eye = np.array([0.0, -6.0, 0.0])
    for row in rng.integers(0, 61_000, 20):
        found = rows.nearest(eye, place[row] - eye, 0.002)
        assert found is not None
        away = place[found] - eye
        assert np.cross(away, place[row] - eye) / np.linalg.norm(away) == pytest.approx(np.zeros(3), abs=0.1)
    assert rows.nearest(eye, [0.0, -1.0, 0.0], 0.002) is None


def test_a_slice_has_the_rows_near_its_plane() -> None:
    rng = np.random.default_rng(6)
    place = rng.uniform(-1, 1, (5000, 3))
    rows = PointRows(place, place[:, :2], place, place, place[:, 0], "x", np.arange(5000))
    found = rows.slice(2, 0.3)
    assert np.flatnonzero(np.abs(place[:, 2] - 0.3) <= SLICE_M).tolist() == found.number.tolist()
    assert 150 < found.number.size < 350
    assert (found.place == place[found.number]).all()
    assert (found.q == place[found.number, :2]).all()
    assert rows.slice(0, 3.0).number.size == 0


def test_colours_keep_the_order_of_numbers() -> None:
    colours = colours_of(np.linspace(0, 1, 40)).astype(float)
    brightness = colours @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(brightness) > 0).all()
    assert (colours_of(np.array([np.nan, 0.0, np.inf, 1.0]))[[0, 2]] == [[150] * 3, [253, 231, 37]]).all()


def test_ticks_are_round_and_few() -> None:
    rng = np.random.default_rng(4)
    for _ in range(200):
        low = rng.uniform(-1e3, 1e3)
        high = low + 10.0 ** rng.uniform(-6, 6)
        found = ticks(low, high, 6)
        assert 2 <= len(found) <= 7
        assert low - 1e-6 * (high - low) <= found[0] <= found[-1] <= high + 1e-6 * (high - low)


def test_labels_of_a_chart_do_not_meet() -> None:
    """Lines and dots wherever they are, each with its label; five of them are as many as a chart has."""
    rng = np.random.default_rng(2)
    for _ in range(60):
        chart = Chart("", (0.0, 10.0), (0.0, 10.0), labels=("", ""))
        chart.mark(rng.uniform(0, 10), rng.uniform(0, 10), "median 89.95 N", below=True)
        chart.mark(rng.uniform(0, 10), rng.uniform(0, 10), "p99 102.1 N")
        chart.horizontal(rng.uniform(0, 10), "limit 140 N")
        for x in rng.uniform(0, 12, 2):
            chart.vertical(x, "force limit 160 N")
        boxes = []
        for place, anchor, text in re.findall(
            r'<text (.*?)text-anchor="(\w+)".*?>([^<]+ N.*?)</text>', chart.svg(axes=False)
        ):
            x, y = (float(value) for value in re.findall(r'"([-\d.]+)"', place))
            left = x if anchor == "start" else x - 5.6 * len(text)
            boxes.append((left, y - 10, left + 5.6 * len(text), y + 3))
        assert len(boxes) == 5
        for (left, top, right, bottom), (x0, y0, x1, y1) in combinations(boxes, 2):
            assert not (left < x1 and x0 < right and top < y1 and y0 < bottom)
