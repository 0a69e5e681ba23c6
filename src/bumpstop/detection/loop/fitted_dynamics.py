"""Fitted dynamics in the form that a control loop takes: include/bumpstop/detection/fitted_dynamics.hpp."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.model import Robot

# Of a link whose mass the torques do not show [kg]. Any would do: what it adds is taken off the link before.
_ANY_MASS = 1.0
_MIN_MASS = 1e-6  # of a link that slides [kg]
_TENSOR = [4, 7, 8, 7, 5, 9, 8, 9, 6]  # places of the second moments among the ten parameters, by rows
_OF_MOTOR = ("coulomb", "viscous", "rotor", "offset", "bend", "load")
Link = tuple[float, "FloatArray", "FloatArray"]


class FittedDynamics:
    """The two sets of parameters of a fit, link by link and motor by motor.

    Attributes:
        model: the fit's.
        by_all: joints (from 0) whose torque all parameters predict; the others have those alone that differ from zero.
    """

    def __init__(self, model: DynamicsModel) -> None:
        """Put a fit's parameters into that form.

        Raises:
            InputError: a sliding link without a mass has first moments, which no body has; or there are more motors
                than the kernels hold.
        """
        self.model = model
        n = model.robot.dof
        if n + len(model.couplings) > _native.max_motors:
            problem = f"{len(model.couplings)} shared motors"
            raise InputError("model", problem, f"wanted at most {_native.max_motors - n}")
        self.by_all = tuple(range(n)) if model.predicting is None else tuple(model.predicted_by_all)
        names = model.column_names
        self._sets = []
        for values in (model.values, model.values if model.predicting is None else model.predicting):
            every = np.zeros(len(names))
            every[list(model.columns)] = values
            self._sets.append((links_of(model.robot, every[: 10 * n]), dict(zip(names, every, strict=True))))

    @property
    def gains(self) -> FloatArray:
        """(n,) torque per unit of the signal; ones where the signal is torque."""
        found = np.ones(self.model.robot.dof) if self.model.gains is None else self.model.gains
        return np.asarray(found, dtype=np.float64)

    def kernel(self) -> _native.FittedDynamics:
        """In the kernels' form."""
        made, n = _native.FittedDynamics(), self.model.robot.dof
        made.by_all = sum(1 << j for j in self.by_all)
        made.gain = [*self.gains.tolist(), *[0.0] * (_native.max_joints - n)]
        for essential, (links, _) in enumerate(self._sets):
            bodies = [_native.LinkInertia(mass, center, tensor, 0.0) for mass, center, tensor in links]
            made.set(bool(essential), bodies, self._motors(essential))
        return made

    def lines(self) -> list[str]:
        """Lines of a detector's file."""
        n = self.model.robot.dof
        found = [f"fitted_gain {_numbers(self.gains)}", f"fitted_by_all {sum(1 << j for j in self.by_all)}"]
        for number, name in enumerate(("all", "essential")):
            for mass, center, tensor in self._sets[number][0]:
                found.append(f"fitted_link {name} {_numbers([mass, *center, *tensor.ravel()])}")
            for motor in self._motors(number):
                figures = [motor.sign_speed, *(getattr(motor, one) for one in _OF_MOTOR[:-1])]
                figures += [motor.top_speed, motor.load, *motor.share[:n]]
                found.append(f"fitted_motor {name} {_numbers(figures)}")
        travels = [motor.presliding for motor in self._motors(0)]
        if any(travels):
            found.append(f"fitted_presliding {_numbers(travels)}")
        return found

    def _motors(self, number: int) -> list[_native.FittedMotor]:
        """Of one set: those of the joints, then the shared ones."""
        model, named = self.model, self._sets[number][1]
        n = model.robot.dof
        groups = [*([(j, 1.0)] for j in range(n)), *model.couplings]
        made = []
        for m, group in enumerate(groups):
            motor, owner = _native.FittedMotor(), str(m + 1) if m < n else f"shared_{m + 1 - n}"
            share = [0.0] * _native.max_joints
            for j, factor in group:
                share[j] = factor
            motor.share = share
            own_scale = m < model.sign_speed.size
            motor.sign_speed = float(
                model.sign_speed[m] if own_scale else np.mean([model.sign_speed[j] for j, _ in group])
            )
            for what in _OF_MOTOR:
                setattr(motor, what, float(named.get(f"{what}_{owner}", 0.0)))
            top = math.inf if model.top_speed is None else float(model.top_speed[m])
            motor.top_speed = top if math.isfinite(top) else math.inf
            travel = 0.0 if model.presliding is None else float(model.presliding[m])
            motor.presliding = travel if math.isfinite(travel) else 0.0
            made.append(motor)
        return made


def links_of(robot: Robot, values: FloatArray) -> list[Link]:
    """Masses, centres (3,) and tensors (3, 3) about them with the torques of inertial parameters (10 dof,).

    Base parameters are those of no body: a link may have first moments and no mass. A mass on the axis of a joint that
    turns makes the same torques on either side of it. So every link that turns is given one kilogram, and what that
    adds at its origin is taken off the link before.

    Raises:
        InputError: a sliding link has first moments, but no mass.
    """
    own = values.reshape(robot.dof, 10).copy()
    found: list[Link] = []
    for i in reversed(range(robot.dof)):
        joint, mass, first = robot.joints[i], float(own[i, 0]), own[i, 1:4]
        if joint.kind == "revolute":
            surplus, mass = _ANY_MASS - mass, _ANY_MASS
            if i > 0:
                at = np.asarray(joint.origin, dtype=np.float64)
                own[i - 1, 0] -= surplus
                own[i - 1, 1:4] -= surplus * at
                own[i - 1, 4:] -= surplus * _moments(at)
        elif abs(mass) < _MIN_MASS and first.any():
            raise InputError(
                "model",
                f"has no mass of {joint.link}, which slides, but first moments",
                "a loop cannot use it: fit a recording in which that joint moves faster",
            )
        center = first / mass if abs(mass) >= _MIN_MASS else np.zeros(3)
        tensor = own[i, _TENSOR].reshape(3, 3) - mass * ((center @ center) * np.eye(3) - np.outer(center, center))
        found.append((mass, center, tensor))
    return found[::-1]


def _moments(at: FloatArray) -> FloatArray:
    """(6,) second moments of a unit mass at a point, in the order of the parameters."""
    full = (at @ at) * np.eye(3) - np.outer(at, at)
    return np.array([full[0, 0], full[1, 1], full[2, 2], full[0, 1], full[0, 2], full[1, 2]])


def _numbers(values: object) -> str:
    return " ".join(repr(float(value)) for value in np.asarray(values))
