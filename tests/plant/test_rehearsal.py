"""Schroeder's protocol on the plant: one motion for many recorders, torques that move the arm, planted truth found."""

from __future__ import annotations

import numpy as np
import pytest

import bumpstop as bs
from bumpstop.identification.design.plan import IdentificationPlan, ProtocolSettings
from bumpstop.model import inverse_dynamics
from bumpstop.plant import Experiment, Plant, PlantReaction, Sensors, line
from bumpstop.reproduction.schroeder2013.simulate_protocol import follow, planned_arm, simulate_protocol
from plant.cases import ROTORS, STANDARD, source_arm, source_plant
from plant.protocol_cases import source_plan

SHORT = ProtocolSettings(speed_shares=(0.2, 0.4, 0.6), repeats=1, ramp_repeats=1, holds=2, hold_s=2.0)


@pytest.fixture(scope="module")
def plan() -> IdentificationPlan:
    return source_plan(SHORT)


def test_recorders_of_one_motion_report_what_plants_of_their_own_would() -> None:
    sensors = [Sensors(rate_hz=250, loss=0.1, jitter_s=3e-4, current_noise=2.0), Sensors(rate_hz=1000, loss=0.05)]
    command = line(source_arm(), STANDARD, [0, 0, -0.05], duration=0.2, held_joints=[7])
    runs = source_plant(1).runs(command, [(sensors[0], 5), (sensors[1], 6)])
    for run, own, seed in zip(runs, sensors, (5, 6), strict=True):
        alone = source_plant(seed, sensors=own).run(command)
        for name in ("t", "q", "current", "wrench"):
            np.testing.assert_array_equal(getattr(run.recording, name), getattr(alone.recording, name))
        assert run.truth == alone.truth
        assert run.lost == alone.lost


def test_truth_is_the_torque_that_moves_the_arm() -> None:
    """Newton-Euler of the traced motion, rotors included, against the traced torque; rates against their change."""
    run = source_plant(1).run(line(source_arm(), STANDARD, [0, 0, -0.2], duration=0.4, start="rest", held_joints=[7]))
    trace = run.trace
    needed = inverse_dynamics(source_arm(), trace.q, trace.qd, trace.qdd) + trace.qdd * ROTORS
    rows = slice(20, -1)
    error = (trace.tau - needed)[rows]
    assert np.abs(error).max() < 0.01 * np.abs(trace.qdd * ROTORS).max()
    change = np.diff(trace.qd, axis=0) / 1e-3
    assert np.abs(change - trace.qdd[1:]).mean() < 0.05 * np.abs(change).max()


def test_plan_and_experiment_must_fit(plan: IdentificationPlan) -> None:
    with pytest.raises(bs.InputError, match="is not the plan's"):
        next(simulate_protocol(Experiment.from_dict({"robot": "ur10e"}), plan))
    with pytest.raises(bs.InputError, match=r"1 is not moved by the plan; wanted one of \[2, 3, 4, 5, 6\]"):
        next(simulate_protocol(Experiment.from_dict({"robot": "sia5d"}), plan, [1]))
    with pytest.raises(bs.InputError, match="gravity_m_s2: has no meaning with a plan"):
        next(simulate_protocol(Experiment.from_dict({"robot": "sia5d", "gravity_m_s2": [0.0, 0.0, -9.8]}), plan))
    with pytest.raises(bs.InputError, match="motion: is missing"):
        Experiment.from_dict({"robot": "sia5d"}).prepare()


def test_plan_leaves_no_room_for_reactions(plan: IdentificationPlan) -> None:
    command = follow(plan.path(plan.experiments[0]))
    with pytest.raises(bs.InputError, match="has no meaning on a path of a plan"):
        command.reaction(10, PlantReaction())


def test_load_of_the_plan_is_carried() -> None:
    loaded = source_plan(ProtocolSettings(load_kg=2.0, load_m=(0.1, 0.0, 0.0), holds=0))
    heavier = sum(joint.inertia.mass for joint in planned_arm(loaded).joints if joint.inertia)
    unpadded = sum(joint.inertia.mass for joint in source_arm().joints if joint.inertia)
    assert heavier - unpadded == pytest.approx(2.0)
    assert Plant(planned_arm(loaded)).robot.dof == 7
