"""Shots of cells that another simulator computes: the reference simulator's elastic arm, and an arm in MuJoCo."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

import bumpstop as bs
from bumpstop.collision import CollisionProblem
from bumpstop.measure.learning.peak_force_ensemble import Condition
from bumpstop.measure.peak_force_model import ShotForce, TracedCollision
from bumpstop.model import mass_matrix
from bumpstop.plant import Gears, Plant, PlantObject, PlantReaction, Sample, Sensors, Servo, line
from reference.elastic_arm import Body, ElasticArm, collide

Array = npt.NDArray[np.float64]

_TINY = 5e-5
_AHEAD_M = 4e-3
_AFTER_S = 0.15
_WINDOW_S = 0.25


@dataclass(frozen=True)
class _Course:
    force: Array
    residual: Array
    peak: float


class _ReferenceCollision(TracedCollision):
    """Courses of the reference simulator's arm, on the same paths."""

    def _course(self, path: Array, reaction: int) -> _Course:  # type: ignore[override]
        del reaction  # of a line, whose speed is even until then
        problem = self.problem
        train = problem.drive_train
        lever = self.curve.torque_per_newton[self.contact_step - 1]
        arm = ElasticArm.of_servo(
            mass_matrix(problem.robot, problem.q),
            train.rotor_inertia,
            train.gear_stiffness,
            lever,
            gear_damping_ratio=train.gear_damping,
            velocity_bandwidth=train.servo_bandwidth,
            position_gain=train.servo_position_gain,
            feedforward=train.acceleration_feedforward,
            feeds_motors=True,
            rates=np.asarray(problem.start.qd) / problem.approach_speed,
        )
        body = Body(stiffness=problem.contact.body.stiffness)
        found = collide(arm, body, path, self.step, offset=self.offset, tiny=_TINY)
        every = round(self.step / _TINY)
        return _Course(found.force[::every], found.residual[::every], found.peak_force)


def reference_force(scenario: bs.Scenario) -> ShotForce:
    """Peak forces of shots by the reference simulator, detected by its own residuals."""
    late = scenario.reaction.latency_s + scenario.reaction.dead_time_s
    collision = _ReferenceCollision(scenario, _WINDOW_S)
    weights = collision.detections(late)
    return collision.outcome(weights, late, 0.0)


def plant_shot(scenario: bs.Scenario, condition: Condition, random: np.random.Generator) -> float:
    """Peak force that a gauge with a mass of its own shows in MuJoCo [N].

    What the motors' currents say of a contact is not simulated: how long after the contact the detector alarms is drawn
    from its probabilities in the linear equations.
    """
    late = scenario.reaction.latency_s
    collision = TracedCollision(scenario, _WINDOW_S)
    weights = collision.detections(late).ravel()
    delay = collision.step * collision.begin.ravel()[random.choice(weights.size, p=weights / weights.sum())]
    problem = CollisionProblem.from_scenario(scenario)
    robot, train, situation = problem.robot, problem.drive_train, condition.situation
    inertia = np.diag(mass_matrix(robot, problem.q))
    damping = 2 * train.gear_damping * np.sqrt(train.gear_stiffness / (1 / train.rotor_inertia + 1 / inertia))
    gears = Gears(
        rotor_inertia=train.rotor_inertia.tolist(), stiffness=train.gear_stiffness.tolist(), damping=damping.tolist()
    )
    velocity = np.asarray(scenario.motion.velocity)
    speed = float(np.linalg.norm(velocity))
    pad = scenario.contact.stiffness_N_m
    assert pad is not None
    gauge = PlantObject.gauge(
        situation.gauge.device,
        position=(situation.contact_point + _AHEAD_M * velocity / speed).tolist(),
        normal=situation.normal.tolist(),
        stiffness=pad,
    )
    # With gravity the links hang in their gears, and contact begins a little sooner than along the command.
    plant = Plant(
        robot,
        friction=gears,
        servo=Servo.of(train),
        sensors=Sensors(rate_hz=1000.0),
        objects=[gauge],
        gravity=(0, 0, 0),
    )
    answer = PlantReaction(
        kind=scenario.reaction.kind,
        joint_acceleration=problem.joint_acceleration.tolist(),
        latency_s=math.ceil(1e3 * late) / 1e3,
    )

    def watch(sample: Sample) -> PlantReaction | None:
        return answer if sample.t >= _AHEAD_M / speed + delay else None

    command = line(robot, problem.q, velocity.tolist(), duration=_AHEAD_M / speed + _AFTER_S, start="moving")
    run = plant.run(command, on_sample=watch)
    return float(run.trace.measured_force.max())
