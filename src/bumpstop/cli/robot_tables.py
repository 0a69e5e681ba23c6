"""Tables of ``bumpstop robots show``: effective masses by their definitions, and the drive train."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from rich.console import Console

    from bumpstop.arrays import FloatArray
    from bumpstop.model import EffectiveMassDefinition, Robot

_DEFINITIONS: tuple[tuple[EffectiveMassDefinition, str], ...] = (
    ("links", "moving links, joints free"),
    ("links_and_rotors", "links and rotors, joints free"),
    ("composite_rigid_body", "one composite rigid body"),
)
_BENT_DEG = 45.0


def pose_from_text(robot: Robot, text: str | None) -> FloatArray:
    """Joint positions (dof,) [rad or m] that a person wrote in degrees and metres.

    Without any: every joint at 45 deg or the limit nearest to it, what slides in the middle.

    Raises:
        InputError: another number of joints, or one outside its limits.
    """
    import numpy as np

    from bumpstop.cli.numbers import numbers
    from bumpstop.model.pose_limits import check_pose

    turns = [joint.kind == "revolute" for joint in robot.joints]
    if text is None:
        middle = [
            math.radians(_BENT_DEG) if turn else (lower + upper) / 2 if math.isfinite(upper - lower) else 0.0
            for turn, lower, upper in zip(turns, robot.lower, robot.upper, strict=True)
        ]
        return np.clip(middle, robot.lower, robot.upper)
    pose = numbers(text, "--pose-deg", robot.dof)
    q = np.array([math.radians(value) if turn else value for value, turn in zip(pose, turns, strict=True)])
    check_pose(robot, q, "--pose-deg", in_degrees=True)
    return q


def print_effective_masses(robot: Robot, pose: FloatArray, console: Console) -> None:
    """What the tip weighs to a push along x, y and z of the base frame, by every definition of the field."""
    from rich.table import Table

    from bumpstop.model import effective_mass

    objection = robot.inertia_objection or " ".join(robot.length_doubts)
    if objection:
        console.print(f"effective mass: not told. {objection}")
        return
    shown = " ".join(
        f"{math.degrees(value):.4g}" if joint.kind == "revolute" else f"{value:.4g} m"
        for value, joint in zip(pose.tolist(), robot.joints, strict=True)
    )
    table = Table(box=None, pad_edge=False)
    table.add_column("")
    for axis in "xyz":
        table.add_column(axis, justify="right")
    for definition, words in _DEFINITIONS:
        try:
            masses = [
                float(effective_mass(robot, pose, axis, definition=definition))
                for axis in ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
            ]
        except InputError as error:
            table.add_row(words, *["-"] * 2, error.problem)
            continue
        table.add_row(words, *(f"{mass:.4g}" if math.isfinite(mass) else "does not move" for mass in masses))
    standard = float(effective_mass(robot, pose, (0.0, 0.0, 1.0), definition="ts15066"))
    table.add_row("ISO/TS 15066, M/2", *[f"{standard:.4g}"] * 3)
    if robot.payload_kg:
        table.add_row("ISO/TS 15066, M/2 and the rated payload", *[f"{standard + robot.payload_kg:.4g}"] * 3)
    console.print(f"effective mass [kg] of the tip at {shown} deg, along the axes of the base frame:")
    console.print(table)


def print_drive_train(robot: Robot, console: Console) -> None:
    """Rotors, gears and servos, a line each, with where the figures come from."""
    from bumpstop.model import unit_of
    from bumpstop.model.drive_train.entry import QUANTITIES

    if robot.length_doubts:  # a class of arms goes by how large they are
        console.print(f"drive train: not told. {robot.length_doubts[0]}")
        return
    found = robot.drive_train
    for name, (turning, sliding) in QUANTITIES.items():
        unit = unit_of(*robot.joints, turning=turning, sliding=sliding) if turning != sliding else turning
        values = " ".join("unknown" if math.isinf(value) else f"{value:.4g}" for value in getattr(found, name).tolist())
        if set(values.split()) == {"unknown"}:
            console.print(f"{name.replace('_', ' ')}: unknown")
            continue
        shown = values if unit == "1" else f"{values} {unit}"
        if name == "servo_bandwidth":  # scenarios give it in Hz
            in_hz = (getattr(found, name) / (2 * math.pi)).tolist()
            shown += f" ({' '.join('unknown' if math.isinf(value) else f'{value:.4g}' for value in in_hz)} Hz)"
        status = found.status[name].upper() if found.status[name] in ("assumed", "unverified") else found.status[name]
        console.print(f"{name.replace('_', ' ')}: {shown}; {status}: {found.source[name]}")
