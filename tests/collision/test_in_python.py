"""What a person meets in Python: wrong arguments, numbers of numpy, short reprs, copies for other processes."""

from __future__ import annotations

import copy
import math
import pickle
import re
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context
from typing import Any

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.joint import JointTorqueModel
from bumpstop.model import mass_matrix
from collision.cases import FREE, control_group

POSE = np.deg2rad([0, 30, 0, -20, 0, -40, 0])


@pytest.mark.parametrize("given", ["examples/01_hand_downward.toml", {"robot": "sia5d"}, None])
def test_only_scenarios_are_evaluated(given: Any) -> None:
    with pytest.raises(bs.InputError, match=r"^scenario: .*load_scenario\(path\)"):
        bs.evaluate(given)
    with pytest.raises(bs.InputError, match=r"^scenario: "):
        bs.evaluate_batch(given, POSE[None], [[0, 0, -0.05]])
    with pytest.raises(bs.InputError, match=r"^problem: .*Problem\.from_scenario"):
        bs.stopping_curve(given)


@pytest.mark.parametrize(
    "wrong",
    [
        {"samples": 10.0}, {"samples": "10"}, {"samples": True}, {"samples": 0}, {"samples": 10, "seed": 1.5},
        {"samples": 10, "seed": -1}, {"samples": 10, "threads": 0}, {"samples": 10, "threads": 2.5},
        {"refinement": 0}, {"refinement": 1.5},
    ],
)  # fmt: skip
def test_counts_are_whole_numbers(wrong: dict[str, Any]) -> None:
    field, value = list(wrong.items())[-1]
    with pytest.raises(bs.InputError, match=rf"^{field}: is {re.escape(repr(value))}; wanted a whole number from \d"):
        bs.evaluate(control_group(), **wrong)


def test_quantiles_and_exceedances_are_of_one_number() -> None:
    of_both = [bs.evaluate(control_group()), bs.evaluate(control_group(), samples=100), bs.evaluate(FREE["trunk"])]
    for force in (distribution.peak_force for distribution in of_both):
        for wrong in ([0.5, 0.9], np.array([0.5, 0.9]), "0.5", None):
            with pytest.raises(bs.InputError, match=r"^p: "):
                force.quantile(wrong)  # type: ignore[arg-type]
            with pytest.raises(bs.InputError, match=r"^x: "):
                force.exceedance(wrong)  # type: ignore[arg-type]
        with pytest.raises(bs.InputError, match=r"^x: is nan"):
            force.exceedance(math.nan)
        assert force.quantile(np.float64(0.5)) == force.quantile(0.5)  # type: ignore[arg-type]


def test_numbers_of_numpy_are_numbers() -> None:
    scenario = control_group()
    plain: dict[str, Any] = {
        "motion.velocity_mm_s": [0.0, 10.0, -50.0],
        "motion.held_joints": [7],
        "detector.thresholds_Nm": [20.0, 10.0, 20.0, 20.0, 20.0, 20.0, 20.0],
        "contact.area_cm2": 2.0,
        "simulation.substeps": 4,
    }
    of_numpy = {
        "motion.velocity_mm_s": np.array([0, 10, -50]),
        "motion.held_joints": (np.int64(7),),
        "detector.thresholds_Nm": np.array([20, 10, 20, 20, 20, 20, 20.0]),
        "contact.area_cm2": np.float32(2),
        "simulation.substeps": np.int32(4),
    }
    assert scenario.with_values(of_numpy) == scenario.with_values(plain)
    with pytest.raises(bs.InputError, match=r"^contact.area_cm2: true cannot be used"):
        scenario.with_values({"contact.area_cm2": np.bool_(True)})


def test_reprs_fit_on_a_screen() -> None:
    scenario = control_group()
    distribution = bs.evaluate(scenario)
    robot, table = bs.Robot.load("sia5d"), bs.LimitTable.load("ts15066")
    for noun in (
        distribution,
        bs.evaluate(scenario, samples=1000),
        distribution.peak_force,
        distribution.curve,
        robot,
        table,
    ):
        assert len(repr(noun)) < 320, type(noun).__name__
    # To five digits, of which the last is rounded.
    shown = float(re.findall(r"p99=([\d.]+)", repr(distribution))[0])
    assert shown == pytest.approx(distribution.peak_force.quantile(0.99), rel=1e-4)
    assert "sia5d at 50 mm/s" in repr(distribution)
    assert "7 joints: joint_s, joint_l" in repr(robot)


def test_what_holds_no_memory_of_the_kernels_is_copied_and_sent() -> None:
    robot = bs.Robot.load("sia5d")
    before = mass_matrix(robot, POSE)  # from here on it keeps a chain of the kernels
    model = JointTorqueModel.load("sia5d")
    rest = np.zeros((1, 6))
    torque = model.torque(rest + 1.0, rest + 0.1, rest)
    for again in (lambda noun: pickle.loads(pickle.dumps(noun)), copy.deepcopy, copy.copy):
        assert again(robot) == robot
        assert (mass_matrix(again(robot), POSE) == before).all()
        assert again(model) == model
        assert np.array_equal(again(model).torque(rest + 1.0, rest + 0.1, rest), torque)
        assert again(control_group()) == control_group()
    refused = pickle.loads(pickle.dumps(bs.InputError("pose_deg", "is missing", "give it")))
    assert (refused.field, refused.problem, refused.valid) == ("pose_deg", "is missing", "give it")
    assert str(refused) == "pose_deg: is missing; give it"


def figures(speed: float) -> tuple[float, ...]:
    distribution = bs.evaluate(control_group(motion__velocity_mm_s=[0, 0, -speed]))
    return (
        distribution.peak_force.mean,
        distribution.peak_force.quantile(0.999),
        distribution.contact_duration.mean if distribution.contact_duration else 0.0,
    )


def test_threads_and_processes_give_the_numbers_of_one() -> None:
    speeds = [20.0, 35.0, 50.0, 80.0, 120.0]
    alone = [figures(speed) for speed in speeds]
    with ThreadPoolExecutor(4) as pool:
        assert list(pool.map(figures, speeds)) == alone
    with ProcessPoolExecutor(1, mp_context=get_context("spawn")) as pool:
        assert list(pool.map(figures, speeds)) == alone
        # A refusal comes back as what it is, and the pool lives on.
        with pytest.raises(bs.InputError, match=r"^motion.velocity_mm_s"):
            pool.submit(figures, 1e9).result()
        assert pool.submit(figures, 20.0).result() == alone[0]


@pytest.mark.parametrize("name", ["arm.urdf", "cells/arm.xml"])
def test_files_are_no_names_of_robots(name: str) -> None:
    with pytest.raises(bs.InputError, match=r"wanted Robot\.from_urdf\(path\)"):
        bs.Robot.load(name)
