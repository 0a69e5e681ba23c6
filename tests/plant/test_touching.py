"""What a plant of one joint touches, beside closed forms: stiffness in series, forces, moments, plates."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np
import pytest

from bumpstop.errors import InputError
from bumpstop.plant import Experiment, Gears, Plant, PlantObject, Sample, Sensors, Servo, mjcf
from plant.pendulum import INERTIA, LENGTH, MASS, NONE, pendulum, still, swing


@pytest.mark.parametrize("stiffness", [math.inf, 2000.0])
@pytest.mark.parametrize("kind", ["revolute", "prismatic"])
def test_what_gives_is_in_series(stiffness: float, kind: str) -> None:
    """1/K = 1/K_object + n'J (1/w^2 m + 1/K_gear) J'n, m being the rotor where the gear gives."""
    rotor, own = 0.4, 3700.0
    robot, servo = pendulum(rotor=rotor, kind=kind), Servo(bandwidth_hz=15.0)
    turns = kind == "revolute"
    plant = Plant(robot, friction=Gears(stiffness=stiffness), servo=servo, gravity=NONE)
    moved = rotor + ((INERTIA if turns else MASS) if math.isinf(stiffness) else 0.0)
    lever = LENGTH if turns else 1.0
    give = lever**2 * (1 / (moved * (2 * math.pi * 15.0) ** 2) + 1 / stiffness)
    normal = (0, 0, -1) if turns else (0, 0, 1)
    thing = PlantObject.of("foam", position=(0, 0, 0), normal=normal)
    assert plant.series_stiffness([0.0], thing) == pytest.approx(1 / (1 / own + give), rel=8e-3)
    # In the field of gravity, and at half the lever.
    near = Plant(
        robot,
        friction=Gears(stiffness=stiffness),
        servo=servo,
        contact_link="l",
        contact_point=(0.5 * LENGTH, 0, 0),
    )
    nearby = give / 4 if turns else give
    assert near.series_stiffness([0.0], thing) == pytest.approx(1 / (1 / own + nearby), rel=8e-3)


def test_each_object_has_its_own_force_and_contact_torque_is_that_of_the_touching_link() -> None:
    robot = pendulum(rotor=2.0)
    point = (0.8 * LENGTH, 0.0, 0.0)

    def plate(name: str, q: float) -> PlantObject:
        """In the way of the point, where it gets at q."""
        x, y, z = robot.pose([q], "l", point)[:3, 3].tolist()
        return PlantObject.of("foam", name=name, position=(x, y, z), normal=(-math.sin(q), 0, -math.cos(q)))

    seen: list[Sample] = []
    away = replace(plate("away", 0.1), position=(0.0, 5.0, 0.0))
    plant = Plant(robot, objects=[away, plate("there", 0.1)], contact_link="l", contact_point=point)
    plant.run(swing(0.12, 0.2), on_sample=seen.append)
    last = seen[-1]
    assert last.contact_force[0] == 0
    assert last.contact_force[1] > 20
    # The plate turns its face a little while the arm goes on: the lever is that of its normal.
    assert last.contact_torque[0] == pytest.approx(0.8 * LENGTH * last.contact_force[1], rel=1e-2)


def test_the_wrist_feels_moments_and_has_noise_of_its_own() -> None:
    robot = pendulum(rotor=0.5)
    loud = Sensors(rate_hz=1000, force_noise=0.3, moment_noise=0.02, position_noise=1e-5, current_noise=0.2)
    runs = [Plant(robot, sensors=sensors, seed=3).run(still(0.3, 2.0)) for sensors in (Sensors(rate_hz=1000), loud)]
    clean, noisy = (run.recording for run in runs)
    assert clean.wrench is not None
    assert noisy.wrench is not None
    assert clean.current is not None
    assert noisy.current is not None
    # 2000 samples tell an sd to 1.6 %.
    spread = (noisy.wrench - clean.wrench).std(axis=0)
    np.testing.assert_allclose(spread, [0.3] * 3 + [0.02] * 3, rtol=0.08)
    rows = np.column_stack([noisy.wrench - clean.wrench, noisy.q - clean.q, noisy.current - clean.current])
    between = np.corrcoef(rows.T) - np.eye(8)
    assert np.abs(between).max() < 0.1  # four and a half standard errors
    # What touches beside the tip twists the wrist.
    point = (LENGTH, 0.05, 0.0)
    thing = PlantObject.of("foam", position=robot.pose([0.1], "l", point)[:3, 3].tolist(), normal=(0, 0, -1))
    run = Plant(robot, objects=[thing], contact_point=(0.0, 0.05, 0.0)).run(swing(0.12, 0.3))
    assert run.recording.wrench is not None
    wrench, force = run.recording.wrench[-1], run.trace.contact_force[-1, 0]
    assert force > 10
    # The object pushes up: R'(0, 0, F) at 50 mm along y twists by 50 mm F about x, and the part along x about z.
    q = float(run.trace.q[-1, 0])
    tool = np.array([-math.sin(q), 0.0, math.cos(q)]) * force
    np.testing.assert_allclose(wrench[:3], tool, atol=0.02 * force)
    np.testing.assert_allclose(wrench[3:], np.cross([0, 0.05, 0], tool), atol=0.02 * 0.05 * force)


def test_a_plate_swings_and_comes_to_rest_as_its_figures_say() -> None:
    """With 0.3 of the critical damping where nothing is said: each half swing leaves exp(-0.3 pi / sqrt(0.91))."""
    plate = PlantObject(name="plate", position=(2, 0, 0), normal=(0, 1, 0), stiffness=3700.0, mass=1.0)
    model = mujoco.MjModel.from_xml_string(mjcf(pendulum(), objects=[plate]))
    data = mujoco.MjData(model)
    data.joint(plate.geom).qpos[0] = 0.01
    path = []
    for _ in range(1000):
        mujoco.mj_step(model, data)
        path.append(float(data.joint(plate.geom).qpos[0]))
    assert -min(path) / 0.01 == pytest.approx(math.exp(-0.3 * math.pi / math.sqrt(0.91)), rel=0.02)
    assert int(np.argmin(path)) * 2e-4 == pytest.approx(math.pi / math.sqrt(0.91 * 3700), rel=0.02)


def test_a_face_is_as_wide_and_as_high_as_told() -> None:
    """Of a wall the width is level."""
    wall = PlantObject(name="wall", position=(2, 0, 0), normal=(0.6, 0.8, 0), stiffness=3700.0, size=(0.2, 0.05))
    model = mujoco.MjModel.from_xml_string(mjcf(pendulum(), objects=[wall]))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    axes = data.geom(wall.geom).xmat.reshape(3, 3)
    width, height, _ = model.geom(wall.geom).size
    assert (width, height) == (0.2, 0.05)
    assert abs(axes[2, 0]) < 1e-12
    assert abs(axes[2, 1]) == pytest.approx(1.0)


def test_what_touches_is_a_ball_about_the_contact_point() -> None:
    """In the frame of a tip that is turned, and in that of its link."""
    turned = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
    robot = replace(pendulum(), tip_rotation=turned)
    for link in (None, "l"):
        model = mujoco.MjModel.from_xml_string(mjcf(robot, contact_link=link, contact_point=(0.01, 0.02, 0.03)))
        data = mujoco.MjData(model)
        data.qpos[0] = 0.3
        mujoco.mj_forward(model, data)
        place = robot.pose([0.3], link, (0.01, 0.02, 0.03))[:3, 3]
        np.testing.assert_allclose(data.geom(":tool").xpos, place, atol=1e-12)


def urdf(joints: int) -> str:
    """So many links of half a metre, one behind the other, about parallel axes."""
    parts = ['<robot name="flap"><link name="l0"/>']
    for j in range(joints):
        parts.append(
            f'<joint name="j{j}" type="revolute"><origin xyz="{0.5 if j else 0} 0 0"/><parent link="l{j}"/>'
            f'<child link="l{j + 1}"/><axis xyz="0 1 0"/><limit lower="-2" upper="2" velocity="2" effort="1"/></joint>'
            f'<link name="l{j + 1}"><inertial><origin xyz="0.3 0 0"/><mass value="3"/>'
            '<inertia ixx="0.03" ixy="0" ixz="0" iyy="0.04" iyz="0" izz="0.04"/></inertial></link>'
        )
    end = f'<joint name="end" type="fixed"><origin xyz="0.5 0 0"/><parent link="l{joints}"/><child link="tip"/></joint>'
    return "".join([*parts, end, '<link name="tip"/></robot>'])


@pytest.mark.parametrize("more", [0, 2])
def test_arms_without_a_straight_line_may_touch(tmp_path: Path, more: int) -> None:
    """One joint, or three about parallel axes: no tip that goes where it is told is no reason to lose a run."""
    (tmp_path / "flap.urdf").write_text(urdf(1 + more), encoding="utf-8")
    names = "".join(f",q_{j + 1}" for j in range(1 + more))
    rows = "".join(f"{t},{q}{',0' * more}\n" for t, q in ((0, 0), (0.1, 0.02), (0.2, 0.05)))
    (tmp_path / "way.csv").write_text(f"t{names}\n{rows}", encoding="utf-8")
    data = {
        "robot": "flap.urdf",
        "friction": {"rotor_inertia_kg_m2": 0.5},
        "motion": {"kind": "trajectory", "file": "way.csv"},
        "object": [{"kind": "foam", "position_mm": [500.0 * (1 + more), 0.0, -5.0], "normal": [0, 0, -1]}],
    }
    run = Experiment.from_dict(data, tmp_path).run()
    assert run.peak_force > 0
    assert 0.97 * 3700 < run.truth["object"][0]["series_stiffness_N_m"] < 3700


def test_a_face_along_which_the_arm_only_slides_is_refused() -> None:
    thing = PlantObject.of("foam", position=(0, 0, 0), normal=(0, 1, 0))
    with pytest.raises(InputError, match="the arm does not move along the object's normal here"):
        Plant(pendulum()).series_stiffness([0.2], thing)
