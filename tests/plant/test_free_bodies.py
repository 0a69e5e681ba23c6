"""Bodies that get away: the plant's blow beside the closed form of the law, and where the body goes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.plant import Experiment, Plant, PlantObject, PlantRun, line
from bumpstop.plant.picture import pushed_and_away
from plant.cases import STANDARD, source_arm, source_plant

AHEAD = 0.005


def hit(mass: float, stiffness: float, speed: float) -> tuple[Plant, PlantObject, PlantRun]:
    """The arm of Schroeder (2013) drives into a body until it has got away."""
    robot = source_arm()
    x, y, z = robot.pose(STANDARD)[:3, 3]
    part = PlantObject(name="part", position=(x, y, z - AHEAD), normal=(0, 0, -1), stiffness=stiffness, body_mass=mass)
    plant = source_plant(1, [part])
    seconds = AHEAD / speed + 4 * math.sqrt(mass / stiffness)
    run = plant.run(line(robot, STANDARD, [0, 0, -speed], duration=seconds, start="moving", held_joints=[7]))
    return plant, part, run


# Hands and an upper body, as limit tables have them, and one in between.
@pytest.mark.parametrize(
    ("mass", "stiffness", "speed"), [(0.6, 75000, 0.25), (4.4, 25000, 0.25), (1.5, 10000, 0.1), (40, 9000, 0.1)]
)
def test_an_undetected_blow_is_v_root_mk(mass: float, stiffness: float, speed: float) -> None:
    """Within 2 %, and it leaves with twice the arm's speed: what it has taken up by then is 2 m v."""
    plant, part, run = hit(mass, stiffness, speed)
    force = run.trace.contact_force[:, 0]
    assert run.peak_force == pytest.approx(speed * math.sqrt(mass * stiffness), rel=0.02)
    assert force[-1] == 0
    rate = float(plant.data.joint(part.behind).qvel[0])
    assert rate == pytest.approx(2 * speed, rel=0.05)
    assert run.truth["object"][0]["body_mass_kg"] == mass


def test_the_picture_knows_where_the_body_is() -> None:
    """By the trace's force alone, against MuJoCo's own position."""
    plant, part, run = hit(1.5, 10000, 0.1)
    ((depth, away),) = pushed_and_away(plant, run, len(run.trace.t) - 1)
    assert depth == 0
    assert away == pytest.approx(float(plant.data.joint(part.behind).qpos[0]), rel=0.05)
    middle = int(np.argmax(run.trace.contact_force[:, 0]))
    ((depth, away),) = pushed_and_away(plant, run, middle)
    assert depth == pytest.approx(run.peak_force / 10000)
    assert 0 < away < depth * 10


def test_series_stiffness_is_that_of_the_body_held() -> None:
    plant, part, _ = hit(4.4, 25000, 0.25)
    assert plant.series_stiffness(STANDARD, part) == pytest.approx(24730, rel=0.01)


def test_free_bodies_of_an_experiment_file(tmp_path: Path) -> None:
    text = """
robot = "sia5d"
joint_model = "sia5d"
pose_deg = [0, 30, 0, -20, 0, -40, 0]
[motion]
kind = "line"
velocity_mm_s = [0, 0, -100]
duration_s = 0.2
held_joints = [7]
[[object]]
kind = "hand_finger"
ahead_mm = 5
body_mass_kg = %s
"""
    file = tmp_path / "experiment.toml"
    file.write_text(text % "0.6")
    plant, _ = Experiment.load(file).prepare()
    assert plant.objects[0].body_mass == 0.6
    for mass, problem in (("0.01", "kg in its face"), ("0", "0"), ("nan", "number")):
        file.write_text(text % mass)
        with pytest.raises(bs.InputError, match=problem):
            Experiment.load(file).prepare()
