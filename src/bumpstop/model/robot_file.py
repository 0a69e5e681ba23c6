"""Robot files: the keys of a robot, read strictly."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any

from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.errors import InputError, near_matches
from bumpstop.model.drive_train.entry import DriveTrainEntry
from bumpstop.model.drive_train.entry_tables import entries_from_table
from bumpstop.model.inertia import LinkInertia, matrix3, vector3
from bumpstop.model.joint import Joint, rotation_from_rpy

_TEXTS = ("title", "source", "note", "inertia_status", "inertia_source")
_ROBOT_KEYS = ("name", *_TEXTS, "payload_kg", "tip", "joint", "drive_train")
_LIMITS = {
    "revolute": ("lower_deg", "upper_deg", "velocity_deg_s"),
    "prismatic": ("lower_m", "upper_m", "velocity_m_s"),
}
# Reflected inertia turns with a revolute joint and travels with a prismatic one.
_ROTOR = {"revolute": "rotor_inertia_kg_m2", "prismatic": "rotor_inertia_kg"}
_INERTIA = ("mass_kg", "center_m", "inertia_kg_m2")
_PLACE = ("name", "link", "kind", "origin_m", "rpy_deg", "axis")


def fields_of(data: Mapping[str, Any]) -> dict[str, Any]:
    """Fields of a robot, from the contents of a robot file (see docs/reference/robot/model.md for its keys).

    Raises:
        InputError: a key is unknown, missing or has a value that cannot be used.
    """
    _check_keys(data, _ROBOT_KEYS, "")
    texts: dict[str, Any] = {key: _text(data, key, "") for key in _TEXTS if key in data}
    tip = _table(data, "tip")
    _check_keys(tip, ("name", "origin_m"), "tip.")
    joints = _needed(data, "joint", "")
    if not isinstance(joints, list):
        raise InputError("joint", "is not a list of tables", "wanted one [[joint]] for every joint")
    payload = data.get("payload_kg")
    if payload is not None and as_number(payload, "payload_kg") < 0:
        raise InputError("payload_kg", f"is {payload}", "wanted zero or more")
    return {
        "name": _text(data, "name", ""),
        "payload_kg": payload,
        "tip_name": _text(tip, "name", "tip."),
        "tip_origin": vector3(_numbers(tip, "origin_m", "tip.", 3)),
        "joints": tuple(_joint(joint, f"joint[{number}].") for number, joint in enumerate(joints, start=1)),
        "drive_train_entries": _drive_train(data, joints),
        **texts,
    }


def _drive_train(data: Mapping[str, Any], joints: list[Any]) -> tuple[DriveTrainEntry, ...]:
    entries = entries_from_table(data["drive_train"], len(joints)) if "drive_train" in data else ()
    if any(entry.quantity == "rotor_inertia" for entry in entries):
        for joint in joints:
            if any(key in joint for key in _ROTOR.values()):
                problem = f"is given beside the rotor inertia of joint {joint.get('name')!r}"
                raise InputError("drive_train.rotor_inertia", problem, "give it once")
    return entries


def _joint(data: Any, where: str) -> Joint:
    if not isinstance(data, Mapping):
        raise InputError(where.rstrip("."), "is not a table", "wanted [[joint]]")
    kind: Any = data.get("kind", "revolute")
    if kind not in tuple(_LIMITS):  # the file may hold what has no hash
        raise InputError(f"{where}kind", f"{kind!r} is no kind of joint", "valid: revolute, prismatic")
    rotor = _ROTOR[kind]
    _check_keys(data, (*_PLACE, *_LIMITS[kind], *_INERTIA, rotor), where)
    lower, upper, velocity = (_number(data, key, where) for key in _LIMITS[kind])
    if kind == "revolute":
        lower, upper, velocity = (math.radians(angle) for angle in (lower, upper, velocity))
    roll, pitch, yaw = (math.radians(angle) for angle in _numbers({"rpy_deg": [0, 0, 0], **data}, "rpy_deg", where, 3))
    return Joint(
        name=_text(data, "name", where),
        link=_text(data, "link", where),
        kind=kind,
        origin=vector3(_numbers(data, "origin_m", where, 3)),
        rotation=matrix3(rotation_from_rpy(roll, pitch, yaw)),
        axis=vector3(_numbers(data, "axis", where, 3)),
        lower=lower,
        upper=upper,
        velocity=velocity,
        inertia=_inertia(data, where),
        rotor_inertia=_number(data, rotor, where) if rotor in data else 0.0,
    )


def _inertia(data: Mapping[str, Any], where: str) -> LinkInertia | None:
    if not any(key in data for key in _INERTIA):
        return None
    xx, yy, zz, xy, xz, yz = _numbers(data, "inertia_kg_m2", where, 6)
    try:
        return LinkInertia(
            mass=_number(data, "mass_kg", where),
            center=vector3(_numbers(data, "center_m", where, 3)),
            tensor=matrix3([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]),
        )
    except InputError as error:
        key = {"mass": "mass_kg", "tensor": "inertia_kg_m2"}.get(error.field)
        if key is None:
            raise
        raise InputError(f"{where}{key}", error.problem, error.valid) from None


def _check_keys(data: Mapping[str, Any], known: Iterable[str], where: str) -> None:
    for key in data:
        if key not in known:
            raise InputError(f"{where}{key}", "is not a key of a robot file", near_matches(str(key), known))


def _needed(data: Mapping[str, Any], key: str, where: str) -> Any:
    if key not in data:
        raise InputError(f"{where}{key}", "is missing")
    return data[key]


def _table(data: Mapping[str, Any], key: str) -> Mapping[str, Any]:
    value = _needed(data, key, "")
    if not isinstance(value, Mapping):
        raise InputError(key, f"{value!r} is not a table", f"wanted [{key}]")
    return value


def _text(data: Mapping[str, Any], key: str, where: str) -> str:
    value = _needed(data, key, where)
    if not isinstance(value, str):
        raise InputError(f"{where}{key}", f"{value!r} cannot be used", "wanted text")
    return value


def _number(data: Mapping[str, Any], key: str, where: str) -> float:
    return as_number(_needed(data, key, where), f"{where}{key}")


def _numbers(data: Mapping[str, Any], key: str, where: str, count: int) -> FloatArray:
    return as_float_array(_needed(data, key, where), f"{where}{key}", (count,))
