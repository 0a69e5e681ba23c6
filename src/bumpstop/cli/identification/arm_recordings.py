"""An arm by name or URDF, its recordings, and what it carried in them."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bumpstop.cli.option_names import as_options
from bumpstop.errors import InputError
from bumpstop.text_files import is_path, list_items

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification import Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

_OF_BAGS = (".mcap", ".db3", ".yaml", ".zstd")


def built_in_or_path(robot: str) -> str:
    """The name of a built-in robot, or the whole path of a URDF."""
    return str(Path(robot).resolve()) if is_path(robot) else robot


def arm_of(robot: str, base: str | None, tip: str | None) -> Robot:
    """The robot of ``--robot``, ``--base`` and ``--tip``."""
    from bumpstop.cli.robots import load_robot

    return load_robot(robot, base, tip)


def is_dynamics(model: str | Path) -> bool:
    """Whether a file holds fitted dynamics; a joint model has no ``kind``."""
    from bumpstop.text_files import parse_toml, read_text

    try:
        return "kind" in parse_toml(read_text(model, ""), "")
    except InputError:
        return False  # whoever reads it as a joint model says what is wrong


def span_of(begin: float | None, until: float | None, length: float, start: float = 0.0) -> tuple[float, float]:
    """What ``--from`` and ``--until`` leave of a recording of ``length`` seconds, counted from its beginning [s].

    ``start`` is the time of the beginning as the recording counts it.
    """
    valid = f"valid: 0 to {length:.6g} s"
    if start != 0:
        valid += f", counted from its beginning, which is {start:.6g} s of its own time"
    for option, value in (("--from", begin), ("--until", until)):
        if value is not None and not value >= 0:
            raise InputError(option, f"is {value:g}", valid)
    low, high = begin or 0.0, length if until is None else min(until, length)
    if not low < high:
        raise InputError("--from", f"{low:.6g} leaves nothing before {high:.6g}", valid)
    return low, high


def recording_files(paths: Sequence[Path], columns: Path | None = None) -> list[Path]:
    """Files that are read with recordings: they, those in the folders of bags, the column file and those it names."""
    from bumpstop.recording.columns import Columns

    found = list(paths)
    for path in paths:
        with suppress(OSError):  # is no folder, or none that may be looked into
            found += [file for file in path.iterdir() if file.suffix in _OF_BAGS]
    if columns is None:
        return found
    # Whoever reads it says what is wrong with it.
    with suppress(InputError, OSError):
        if columns.is_file():  # and no pipe, which can be read but once
            quantities = Columns.load(columns, columns.parent).quantities.values()
            found += [quantity.file for quantity in quantities if quantity.file is not None]
    return [*found, columns]


def model_files(model: str | Path | None) -> list[Path]:
    """The file of a joint model, of fitted dynamics or of a plan, and the URDF that it names."""
    from bumpstop.text_files import parse_toml, read_text

    if model is None:
        return []
    found = [Path(model)]
    with suppress(InputError, OSError):  # the name of a built-in one
        robot = parse_toml(read_text(model, ""), "").get("robot") if found[0].is_file() else None
        if isinstance(robot, str) and is_path(robot):
            found.append(found[0].parent / robot)
    return found


def fit_notes(model: str | Path | None, recordings: Sequence[Recording]) -> list[str]:
    """Sentences on recordings that the file of a model names as those of its fit: their rows may be the fit's own.

    Which rows of them these were the file does not say.
    """
    from bumpstop.text_files import parse_toml, read_text

    named: object = None
    with suppress(InputError, OSError):  # the name of a built-in one
        named = parse_toml(read_text(model, ""), "").get("created_from") if model and Path(model).is_file() else None
    names = named.split(", ") if isinstance(named, str) else named if isinstance(named, list) else []
    fitted = {Path(name).resolve() for name in names if isinstance(name, str) and name}
    return [
        f"{log.source}: the model was fitted to this recording, or to a part of it; rows that the fit had say nothing "
        "of other motion (--from and --until leave them out)."
        for log in recordings
        if log.source and Path(log.source).resolve() in fitted
    ]


def load_parts(
    paths: Sequence[Path],
    columns: Path | None,
    arm: Robot,
    begin: float | None,
    until: float | None,
    topic: str | None,
    max_bad: float,
    payload: Sequence[str] | None = None,
) -> list[Recording]:
    """Read recordings, and the part of each that is asked for.

    ``payload``, as :func:`carried_of` takes it: no note tells what it declares.
    """
    carried = carried_of(payload, len(paths))
    logs = [part_of(path, columns, arm, begin, until, topic, max_bad) for path in paths]
    return [
        log if load is None else replace(log, report=log.report.with_payload(load.mass, load.center))
        for log, load in zip(logs, carried, strict=True)
    ]


def part_of(
    path: Path,
    columns: Path | None,
    arm: Robot,
    begin: float | None = None,
    until: float | None = None,
    topic: str | None = None,
    max_bad: float = 0.01,
    rate_hz: float | None = None,
) -> Recording:
    """A recording, or what lies between two times of it, counted from its beginning [s]."""
    from bumpstop.recording import Recording

    try:
        log = Recording.load(path, columns=columns, robot=arm, topic=topic, max_bad=max_bad, rate_hz=rate_hz)
    except InputError as error:
        if error.field in ("topic", "max_bad", "columns", "rate_hz"):
            raise InputError(
                f"--{error.field.removesuffix('_hz').replace('_', '-')}", error.problem, error.valid
            ) from None
        raise
    start, end = float(log.t[0]), float(log.t[-1])
    if begin is None and until is None:
        return log
    low, high = span_of(begin, until, end - start, start)
    return log.between(start + low, end if high == end - start else start + high)


def carried_of(given: Sequence[str] | None, recordings: int) -> list[Payload | None]:
    """What was carried in each recording.

    Args:
        given: ``MASS[,X,Y,Z]`` for all recordings, or ``NUMBER:MASS[,X,Y,Z]`` for one, from 1.
        recordings: number of them.
    """
    found: list[Payload | None] = [None] * recordings
    for text in given or []:
        number, colon, figures = text.rpartition(":")
        valid = f"for example 1.5,0,0,0.06, or 2:1.5; recordings are 1 to {recordings}"
        try:
            which = range(recordings) if not colon else [int(number) - 1]
            usable = all(0 <= place < recordings for place in which)
        except ValueError:
            usable = False
        if not usable:
            raise InputError("--payload", f"{text!r} cannot be used", valid)
        load = payload_of(figures, valid)
        for place in which:
            found[place] = load
    return found


def payload_of(text: str, valid: str = "for example 1.5, or 1.5,0,0,0.06") -> Payload:
    """A payload from ``MASS[,X,Y,Z]`` [kg, m], in the frame of the tip; ``valid`` says what can be used."""
    from bumpstop.identification.payload.payload import Payload
    from bumpstop.model.inertia import vector3

    try:
        mass, *center = (float(figure) for figure in list_items(text))
    except ValueError:
        mass, center = math.nan, [math.nan]
    if len(center) not in (0, 3):
        raise InputError("--payload", f"{text!r} cannot be used", valid)
    with as_options({"payload.mass": "--payload", "payload.center": "--payload"}):
        return Payload(mass, vector3(center or (0.0, 0.0, 0.0)))


def payload_settings(load: Payload, robot: Robot) -> dict[str, Any]:
    """A payload as settings of a detector, whose centre is in the frame of the last link; None: the tip."""
    import numpy as np

    center = None
    if load.mass > 0 and any(load.center):
        turned = np.asarray(robot.tip_origin) + np.asarray(robot.tip_rotation) @ load.center
        center = tuple((np.round(turned, 12) + 0.0).tolist())
    return {"payload_kg": load.mass, "payload_center": center}


def gravity_of(given: str | None) -> tuple[float, float, float] | None:
    """Acceleration of free fall in the base frame from ``X,Y,Z`` [m/s2]; None: an upright base."""
    from bumpstop.model.dynamics import check_free_fall
    from bumpstop.model.inertia import vector3

    if given is None:
        return None
    try:
        found = [float(figure) for figure in list_items(given)]
    except ValueError:
        found = []
    if len(found) != 3:
        raise InputError("--gravity", f"{given!r} cannot be used", "wanted X,Y,Z [m/s2], as 0,0,-9.80665")
    check_free_fall(found, "--gravity")
    return vector3(found)


def payloads_of(given: Sequence[str] | None, arm: Robot, recordings: int) -> list[Robot]:
    """The arm with what it carried, for each recording; arguments as for :func:`carried_of`."""
    from bumpstop.identification.payload.payload import with_payload

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
