"""Static pushes: the stiffness of an object as the controller feels it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import as_float_array
from bumpstop.errors import InputError
from bumpstop.plant.command import line

if TYPE_CHECKING:
    from bumpstop.plant.objects import PlantObject
    from bumpstop.plant.plant import Plant

_PUSHES_N = (20.0, 60.0)


def series_stiffness(arm: Plant, q: npt.ArrayLike, thing: PlantObject) -> float:
    """See :meth:`bumpstop.plant.Plant.series_stiffness`."""
    from bumpstop.plant.plant import Plant

    pose = as_float_array(q, "q", (arm.robot.dof,))
    n = np.array(thing.direction)
    touch = arm.robot.pose(pose, *arm.contact)[:3, 3]
    # A hair's breadth away, so that no rounding begins inside; the difference of the pushes does not know it.
    x, y, z = (touch + 1e-6 * n).tolist()
    held = replace(thing, position=(x, y, z), body_mass=None)
    pushed = Plant(
        arm.robot,
        arm.joint_model,
        # What swings must have come to rest: damping changes when it does, not where.
        friction=replace(arm.gears, damping_ratio=1.0),
        objects=[held],
        servo=arm.servo,
        contact_link=arm.contact[0],
        contact_point=arm.contact[1],
        gravity=arm.gravity,
    )
    ways, forces = [], []
    for force in _PUSHES_N:
        way, seconds = force / thing.stiffness, 0.2
        begin = pose
        command = line(
            arm.robot,
            begin,
            tuple((n * way / seconds).tolist()),
            duration=seconds,
            start="rest",
            joint_acceleration=4.5,
            task="pose" if arm.robot.dof >= 6 else "position",
            hold=0.3,
        )
        run = pushed.run(command)
        end = arm.robot.pose(command.q[-1], *arm.contact)[:3, 3]
        ways.append(float(n @ (end - touch)))
        forces.append(float(run.trace.contact_force[-1, 0]))
    if not ways[1] - ways[0] > 1e-9:
        raise InputError("series_stiffness", "the arm does not move along the object's normal here")
    return (forces[1] - forces[0]) / (ways[1] - ways[0])
