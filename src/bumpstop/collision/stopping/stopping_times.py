"""Times that the joints of a robot take to stop, from a table of stopping distances."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.collision.stopping.joint_names import TCP
from bumpstop.collision.stopping.stopping_table import StoppingTable
from bumpstop.collision.stopping.table_file import load_stopping_table
from bumpstop.errors import InputError
from bumpstop.model.reach import distance_from_axis

if TYPE_CHECKING:
    from pathlib import Path

    from bumpstop.collision.stopping.braking_keys import BrakingKeys
    from bumpstop.model import Robot

_FIELD = "reaction.stopping_table"
# A joint slower than the fastest by so much stands: its rate is rounding.
STANDING = 1e-9


@dataclass(frozen=True, eq=False, kw_only=True)
class StoppingTimes:
    """Twice the stopping distance over the rate it is from, at one payload.

    Attributes:
        extension: levels (E,), rising, share of the reach [1]; a single one where the table has none.
        rate: levels (R,), rising from 0 on, where times are extrapolated [rad/s or m/s].
        time: (dof, E, R) [s].
        reach: farthest the tip gets from the axis of joint 1 [m]; 1 where that is no matter.
        levels: lowest and highest extension of the table [1]; None where it has none, joint 1 slides, or the arm
            reaches without end.
        unlisted: joints, from 1, that the table does not list: they have the longest time that it has.
        category: the stop category of the table's rows; None where it says none.
        notes: what was assumed.
    """

    extension: FloatArray
    rate: FloatArray
    time: FloatArray
    reach: float
    levels: tuple[float, float] | None = None
    unlisted: tuple[int, ...] = ()
    category: int | None = None
    notes: tuple[str, ...] = ()

    @cached_property
    def native(self) -> _native.StoppingTimes:
        """The same for the kernels, which interpolate."""
        found = _native.StoppingTimes()
        found.extension = self.extension.tolist()
        found.rate = self.rate.tolist()
        found.time = self.time.ravel().tolist()
        found.reach = self.reach
        return found

    def extended(self, robot: Robot, q: FloatArray) -> FloatArray:
        """Extensions at poses (N, dof): distance of the tip from the axis of joint 1 over the reach (N,) [1]."""
        return distance_from_axis(robot.joints[0], robot.pose(q)[:, :3, 3]) / self.reach

    def by_joint(self, robot: Robot, q: FloatArray, rates: FloatArray) -> FloatArray:
        """What each joint takes, at poses (N, dof) from rates (N, dof): (N, dof) [s]; 0 where it stands."""
        extended = np.ones(len(q))
        if len(self.extension) > 1:
            extended = self.extended(robot, q)
        at, size = self.native.at, np.abs(np.nan_to_num(rates))
        moving = size > STANDING * size.max(axis=1, keepdims=True)
        return np.array(
            [
                [at(j, float(e), float(r)) if moves else 0.0 for j, (r, moves) in enumerate(zip(*row, strict=True))]
                for e, row in zip(extended, zip(size, moving, strict=True), strict=True)
            ]
        )


def stopping_times(reaction: BrakingKeys, folder: Path, robot: Robot) -> StoppingTimes:
    """The times of a reaction's stopping table, whose path starts at ``folder``, at its payload.

    Between payloads, extensions and rates they are interpolated linearly. Beyond the extensions the nearest counts, and
    so it is below the payloads. Without a payload every joint takes its longest time of any, and so it does of the
    extensions where joint 1 slides.

    Raises:
        InputError: the table is not of this robot's joints, or ends below the payload.
    """
    assert reaction.stopping_table is not None
    try:
        table = load_stopping_table(folder / reaction.stopping_table, category=reaction.stop_category)
    except InputError as error:
        if error.field == "category":
            raise InputError("reaction.stop_category", error.problem, error.valid) from None
        raise InputError(_FIELD, f"{error.field}: {error.problem}", error.valid) from None
    _check_joints(table, robot)
    notes = [f"Stopping table: {note}" for note in table.notes]
    extensions = np.unique(table.extension[np.isfinite(table.extension)].round(9))
    # How far an arm on a rail is stretched does not show in how far its tip is from the rail.
    on_rail = robot.joints[0].kind == "prismatic"
    known = len(extensions) > 0 and math.isfinite(robot.reach) and not on_rail
    levels = (float(extensions[0]), float(extensions[-1])) if known else None
    if not len(extensions):
        extensions = np.array([1.0])
    elif len(extensions) > 1 and not math.isfinite(robot.reach):
        raise InputError(_FIELD, f"goes by extension, and {robot.name} reaches without bound", "leave the column out")
    rates = np.unique(table.speed[table.known].round(12))
    # What is longest in the slowest row need not be below it, where times grow toward it: at rest all are extrapolated.
    nodes = np.concatenate([[0.0], rates])
    payloads, weights = _payload_weights(table, reaction, robot, notes)
    listed = np.stack(
        [
            np.stack([_times(table, k, payload, extensions, nodes) for k in range(len(table.joints))])
            for payload in payloads
        ]
    )
    if on_rail and len(extensions) > 1:
        listed, extensions = listed.max(axis=2, keepdims=True), extensions[-1:]
        told = "Joint 1 slides: of every joint the longest time of all extensions in the stopping table counts."
        if reaction.stop_category == 0:
            told += " In stop category 0 the tip may go farther, where some joint stops sooner."
        notes.append(told)
    with_payload = listed.max(axis=0) if weights is None else np.tensordot(weights, listed, axes=1)
    time = np.empty((robot.dof, len(extensions), len(nodes)))
    # A joint that the table leaves out takes as long as the slowest of those it has; one of another kind, whose speed
    # the table has no unit for, as the slowest at any speed.
    time[:] = with_payload.max(axis=0)
    other = [(joint.kind == "prismatic") != table.linear for joint in robot.joints]
    time[other] = with_payload[..., nodes > 0].max(axis=(0, 2))[:, None]
    for k, joint in enumerate(table.joints):
        if joint != TCP:
            time[joint - 1] = with_payload[k]
    unlisted = tuple(j for j in range(1, robot.dof + 1) if j not in table.joints)
    if unlisted and TCP not in table.joints:
        notes.append(
            f"Joint {', '.join(map(str, unlisted))} is not in the stopping table: takes the longest time of the others."
        )
    if table.category == 0 and reaction.stop_category is None:
        notes.append(
            "The stopping table is one of stop category 0, and reaction.stop_category is not given: joints keep their "
            "ratios, as with drives."
        )
    unit, factor = table.speed_unit
    notes.append(
        f"Below {rates[0] * factor:.3g} {unit}, the stopping table's slowest row, a joint takes at least as long as "
        f"there; above {rates[-1] * factor:.3g} {unit} it has the deceleration of the fastest."
    )
    return StoppingTimes(
        extension=extensions,
        rate=nodes,
        time=time,
        reach=robot.reach if levels is not None else 1.0,
        levels=levels,
        unlisted=unlisted,
        category=table.category,
        notes=tuple(notes),
    )


def _check_joints(table: StoppingTable, robot: Robot) -> None:
    for joint in table.joints:
        if joint > robot.dof:
            raise InputError(
                _FIELD, f"has joint {joint}, and {robot.name} has {robot.dof}", "give the table of this arm"
            )
    kinds = {robot.joints[joint - 1].kind for joint in table.joints if joint != TCP}
    if table.linear and (TCP in table.joints or "revolute" in kinds):
        raise InputError(
            _FIELD, "has lengths, and the robot's joints turn", "give reach_mm and the extension in the file"
        )
    if not table.linear and "prismatic" in kinds:
        raise InputError(_FIELD, "has angles of a joint that slides", "give the table of this arm")


def _payload_weights(
    table: StoppingTable, reaction: BrakingKeys, robot: Robot, notes: list[str]
) -> tuple[list[float], FloatArray | None]:
    """Levels of payload that count, and their weights; None: the slowest of them."""
    levels = np.unique(table.payload[np.isfinite(table.payload)].round(9))
    given: float | None = None
    field = "reaction.payload_kg"
    if reaction.payload_percent is not None:
        given, field = reaction.payload_percent / 100, "reaction.payload_percent"
        if table.payload_unit == "kg":
            raise InputError(field, "is a share, and the stopping table has kg", "give reaction.payload_kg")
    elif reaction.payload_kg is not None:
        given = reaction.payload_kg
        if table.payload_unit == "share":
            if robot.payload_kg is None:
                valid = "give reaction.payload_percent"
                raise InputError(field, f"{robot.name} has no rated payload, and the stopping table has shares", valid)
            given /= robot.payload_kg
    if not len(levels):
        if given is not None:
            raise InputError(field, "has no meaning with a stopping table without payload", "leave it out")
        return [math.nan], None
    if given is None:
        if len(levels) > 1:
            told = "Payload not given: of every joint the longest time of all payloads in the stopping table counts."
            if reaction.stop_category == 0:
                told += " In stop category 0 a known payload may go farther, where some joint stops sooner."
            notes.append(told)
        return levels.tolist(), None
    if given > levels[-1] * (1 + 1e-9):
        unit, factor = ("kg", 1.0) if table.payload_unit == "kg" else ("%", 100.0)
        problem = f"{given * factor:g} {unit} is above the stopping table's {levels[-1] * factor:g} {unit}"
        raise InputError(field, problem, "give a table that knows it")
    if given < levels[0]:
        notes.append("Payload below the stopping table's lowest: its lowest counts.")
    weights = np.array([np.interp(given, levels, np.eye(len(levels))[i]) for i in range(len(levels))])
    return levels.tolist(), weights


def _times(table: StoppingTable, k: int, payload: float, extensions: FloatArray, rates: FloatArray) -> FloatArray:
    """Of one listed joint at one level of payload (E, R) [s].

    Where a level of extension has no row of this payload, it takes the longest time of the others.
    """
    found = np.full((len(extensions), len(rates)), np.nan)
    same = table.known[:, k]
    if math.isfinite(payload):
        same = same & (np.abs(table.payload - payload) < 1e-8)
    for e, extension in enumerate(extensions):
        rows = same & ((np.abs(table.extension - extension) < 1e-8) | np.isnan(table.extension))
        if not rows.any():
            continue
        # Rows of other joints may say a speed of this one again.
        speed, first = np.unique(table.speed[rows, k].round(12), return_index=True)
        time = 2 * table.distance[rows, k][first] / speed
        one = _native.StoppingTimes()
        one.extension, one.rate, one.time = [1.0], speed.tolist(), time.tolist()
        found[e] = [one.at(0, 1.0, rate) for rate in rates]
    if np.isnan(found).all():
        raise InputError(
            _FIELD, f"has no row of {table.joint_name(k)} at one of its payloads", "leave that payload's rows out"
        )
    longest = np.nanmax(found, axis=0)
    return np.where(np.isnan(found), longest, found)
