"""An arm by name or URDF, its recordings, and what it carried in them."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import TYPE_CHECKING

from bumpstop.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification import Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording


def is_path(robot: str) -> bool:
    """Whether a robot is given by the path of its URDF."""
    return bool(Path(robot).suffix) or "/" in robot


def built_in_or_path(robot: str) -> str:
    """The name of a built-in robot, or the whole path of a URDF."""
    return str(Path(robot).resolve()) if is_path(robot) else robot


def arm_of(robot: str, base: str | None, tip: str | None) -> Robot:
    """The robot of ``--robot``, ``--base`` and ``--tip``."""
    from bumpstop.cli.robots import load_robot

    return load_robot(robot, base, tip)


def is_dynamics(model: Path) -> bool:
    """Whether a file holds fitted dynamics; a joint model has no ``kind``."""
    try:
        return "kind" in tomllib.loads(model.read_text(encoding="utf-8-sig"))
    except (OSError, ValueError, RecursionError):
        return False  # its reader says what is wrong


def load_parts(
    paths: Sequence[Path],
    columns: Path | None,
    arm: Robot,
    begin: float | None,
    until: float | None,
    topic: str | None,
    max_bad: float,
) -> list[Recording]:
    """Read recordings, and the part of each that is asked for."""
    return [part_of(path, columns, arm, begin, until, topic, max_bad) for path in paths]


def part_of(
    path: Path,
    columns: Path | None,
    arm: Robot,
    begin: float | None = None,
    until: float | None = None,
    topic: str | None = None,
    max_bad: float = 0.01,
) -> Recording:
    """A recording, or what lies between two times of it, counted from its beginning [s]."""
    from bumpstop.recording import Recording

    try:
        log = Recording.load(path, columns=columns, robot=arm, topic=topic, max_bad=max_bad)
    except InputError as error:
        if error.field in ("topic", "max_bad", "columns"):
            raise InputError(f"--{error.field.replace('_', '-')}", error.problem, error.valid) from None
        raise
    start, end = float(log.t[0]), float(log.t[-1])
    if begin is None and until is None:
        return log
    first = start if begin is None else start + begin
    last = end if until is None else start + until
    if not first < last:
        low, high = (f"{time - start:.6g}" for time in (first, last))
        raise InputError("--from", f"{low} leaves nothing before {high}", f"valid: 0 to {end - start:.6g} s")
    return log.between(first, last)


def carried_of(given: Sequence[str] | None, recordings: int) -> list[Payload | None]:
    """What was carried in each recording.

    Args:
        given: ``MASS[,X,Y,Z]`` for all recordings, or ``NUMBER:MASS[,X,Y,Z]`` for one, from 1.
        recordings: number of them.
    """
    from bumpstop.identification.payload import Payload
    from bumpstop.model.inertia import vector3

    found: list[Payload | None] = [None] * recordings
    for text in given or []:
        number, colon, figures = text.rpartition(":")
        try:
            which = range(recordings) if not colon else [int(number) - 1]
            mass, *center = (float(figure) for figure in figures.split(","))
            usable = len(center) in (0, 3) and all(0 <= place < recordings for place in which)
        except ValueError:
            usable = False
        if not usable:
            valid = f"for example 1.5,0,0,0.06, or 2:1.5; recordings are 1 to {recordings}"
            raise InputError("--payload", f"{text!r} cannot be used", valid)
        for place in which:
            found[place] = Payload(mass, vector3(center or (0.0, 0.0, 0.0)))
    return found


def payloads_of(given: Sequence[str] | None, arm: Robot, recordings: int) -> list[Robot]:
    """The arm with what it carried, for each recording; arguments as for :func:`carried_of`."""
    from bumpstop.identification.payload import with_payload

    carried = carried_of(given, recordings)
    return [arm if load is None else with_payload(arm, load.mass, load.center) for load in carried]


def known_of(given: Sequence[str] | None) -> dict[str, dict[str, float]]:
    """Parameters by joint from ``JOINT.NAME=VALUE``."""
    found: dict[str, dict[str, float]] = {}
    for text in given or []:
        name, equals, figure = text.partition("=")
        joint, dot, parameter = name.rpartition(".")
        try:
            value = float(figure)
        except ValueError:
            equals = ""
        if not (equals and dot):
            raise InputError("--known", f"{text!r} cannot be used", "for example --known elbow_joint.inertia=0.8")
        found.setdefault(joint, {})[parameter] = value
    return found
