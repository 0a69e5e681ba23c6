"""Schroeder's protocol on the plant: every trajectory of a plan, with the sensors of an experiment."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.plant.command import COMMAND_STEP, Command, PlantReaction

if TYPE_CHECKING:
    from bumpstop.identification.design.plan import IdentificationPlan, JointExperiment
    from bumpstop.identification.design.timed_path import TimedPath
    from bumpstop.model import Robot
    from bumpstop.plant.experiment import Experiment
    from bumpstop.plant.run import PlantRun

# Of the experiment, what a plan does itself or has no place for.
_OF_THE_PLAN = ("motion", "pose_deg", "pose_rad", "object", "reaction", "gravity_m_s2")
# Seeds of joints must differ, and those of neighbouring experiments must not meet.
_SEEDS_APART = 1_000_003


def planned_arm(plan: IdentificationPlan) -> Robot:
    """The arm that a plan moves: with its load, and with the rotors that the plan's own arm leaves out."""
    rotors = [joint.rotor_inertia for joint in plan.robot.joints]
    joints = [replace(joint, rotor_inertia=rotor) for joint, rotor in zip(plan.loaded.joints, rotors, strict=True)]
    return replace(plan.loaded, joints=tuple(joints))


def follow(path: TimedPath) -> Command:
    """A path of a plan, told every millisecond. Nothing makes it turn back."""
    count = int(np.floor(path.duration / COMMAND_STEP + 1e-9)) + 1
    t: FloatArray = np.arange(count, dtype=np.float64) * COMMAND_STEP
    q, qd, _ = path.at(t)

    def react(command: Command, knot: int, reaction: PlantReaction, limit: FloatArray, rest: float, /) -> Command:
        raise InputError("reaction", "has no meaning on a path of a plan", "leave it out")

    return Command(q, qd, react)


def planned_experiments(plan: IdentificationPlan, joints: Sequence[int] = ()) -> tuple[JointExperiment, ...]:
    """Experiments of a plan, all or those of some joints (numbers from 1).

    Raises:
        InputError: a joint that the plan does not move.
    """
    known = [one.joint + 1 for one in plan.experiments]
    for number in joints:
        if number not in known:
            raise InputError("joint", f"{number} is not moved by the plan", f"wanted one of {known}")
    return tuple(one for one in plan.experiments if not joints or one.joint + 1 in joints)


def simulate_protocol(
    experiment: Experiment, plan: IdentificationPlan, joints: Sequence[int] = ()
) -> Iterator[tuple[JointExperiment, PlantRun]]:
    """Run a plan's trajectories on the plant of an experiment, one after the other.

    Load and direction of gravity are the plan's. Each joint has a seed of its own, made from the experiment's.

    Args:
        experiment: robot, joint model, friction, sensors, servo and seed.
        plan: for the same robot.
        joints: numbers from 1; none: all that the plan moves.

    Raises:
        InputError: the experiment is of another robot, or has keys that a plan leaves no room for.
    """
    for key in _OF_THE_PLAN:
        if key in experiment.model_fields_set:
            raise InputError(key, "has no meaning with a plan", "leave it out")
    robot = experiment.arm()
    if robot.name != plan.robot.name or robot.dof != plan.robot.dof:
        raise InputError("robot", f"{robot.name!r} is not the plan's", f"the plan is for {plan.robot.name}")
    for one in planned_experiments(plan, joints):
        seed = (experiment.seed * _SEEDS_APART + one.joint) % 2**64
        plant = experiment.plant(planned_arm(plan), gravity=plan.settings.gravity, seed=seed)
        yield one, plant.run(follow(plan.path(one)))
