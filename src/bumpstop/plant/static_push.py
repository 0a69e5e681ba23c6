"""Static pushes: the stiffness of object, servo and gears in series."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Protocol

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.errors import InputError
from bumpstop.plant.command import COMMAND_STEP, Command, PlantReaction, line

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.model import Robot
    from bumpstop.plant.drive import Gears
    from bumpstop.plant.objects import PlantObject
    from bumpstop.plant.run import PlantRun

_PUSHES_N = (20.0, 60.0)
_PUSH_S, _HOLD_S = 0.2, 0.3
# Of the contact point along the normal per joint: below it no joint moves it that way [m/rad or 1].
_MIN_LEVER = 1e-6


class PushedArm(Protocol):
    """What a push asks of a plant; :class:`bumpstop.plant.Plant` says what each is."""

    robot: Robot
    gears: Gears
    contact: tuple[str | None, tuple[float, ...]]

    def hanging(self, q: FloatArray) -> FloatArray:
        """Where the links stand while the motors hold a pose (dof,) [rad or m]."""

    def rebuilt(self, gears: Gears, objects: Sequence[PlantObject]) -> PushedArm:
        """The same arm with other gears, among other objects."""

    def run(self, command: Command) -> PlantRun:
        """Follow a command to its end."""


def series_stiffness(arm: PushedArm, q: npt.ArrayLike, thing: PlantObject) -> float:
    """See :meth:`bumpstop.plant.Plant.series_stiffness`."""
    pose = as_float_array(q, "q", (arm.robot.dof,))
    n = np.array(thing.direction)
    # Where the links hang in their gears, or the first push might not get to the face; and a hair's breadth away, so
    # that no rounding begins inside. The difference of the pushes does not know it.
    touch = arm.robot.pose(arm.hanging(pose), *arm.contact)[:3, 3]
    x, y, z = (touch + 1e-6 * n).tolist()
    series = thing.stiffness if thing.spring is None else 1 / (1 / thing.stiffness + 1 / thing.spring)
    held = replace(thing, position=(x, y, z), stiffness=series, body_mass=None, spring=None)
    # What swings must have come to rest: damping changes when it does, not where.
    pushed = arm.rebuilt(replace(arm.gears, damping_ratio=1.0, damping=None), [held])
    ways, forces = [], []
    for force in _PUSHES_N:
        command = _push(arm, pose, n * force / thing.stiffness)
        run = pushed.run(command)
        end = arm.robot.pose(arm.hanging(command.q[-1]), *arm.contact)[:3, 3]
        ways.append(float(n @ (end - touch)))
        forces.append(float(run.trace.contact_force[-1, 0]))
    if not ways[1] - ways[0] > 1e-9:
        raise _immovable()
    return (forces[1] - forces[0]) / (ways[1] - ways[0])


def _push(arm: PushedArm, pose: FloatArray, way: FloatArray) -> Command:
    """A little way from rest to rest (3,) [m], and a while there."""
    try:
        return line(
            arm.robot,
            pose,
            tuple((way / _PUSH_S).tolist()),
            duration=_PUSH_S,
            start="rest",
            joint_acceleration=4.5,
            task="pose" if arm.robot.dof >= 6 else "position",
            hold=_HOLD_S,
        )
    except InputError:
        # Too few joints for a line, or none that is straight from here.
        return _by_joints(arm, pose, way)


def _by_joints(arm: PushedArm, pose: FloatArray, way: FloatArray) -> Command:
    """By those joints that move the contact point that way, as far as they do."""
    far = float(np.linalg.norm(way))
    lever = (way / far) @ arm.robot.jacobian(pose, *arm.contact)[:3]
    steepest = float(lever @ lever)
    if steepest < _MIN_LEVER**2:
        raise _immovable()
    t: FloatArray = np.arange(round((_PUSH_S + _HOLD_S) / COMMAND_STEP) + 1, dtype=np.float64) * COMMAND_STEP
    u = np.minimum(t / _PUSH_S, 1.0)[:, None]
    joints = lever * far / steepest

    def react(command: Command, knot: int, reaction: PlantReaction, limit: FloatArray, rest: float, /) -> Command:
        raise InputError("reaction", "has no meaning in a static push", "leave it out")

    return Command(pose + u * u * (3 - 2 * u) * joints, 6 * u * (1 - u) / _PUSH_S * joints, react)


def _immovable() -> InputError:
    return InputError("series_stiffness", "the arm does not move along the object's normal here")
