"""Joint model files: TOML, read strictly and written back."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from typing import TYPE_CHECKING, Any, TypeVar

from bumpstop.arrays import as_float_array, as_number
from bumpstop.errors import InputError
from bumpstop.joint.friction_law import OF_FRICTION
from bumpstop.joint.parameters import COMMON, DEFAULT_REST_SPEED, MAX_FIGURE, OF_MAP, JointParameters, Parameter
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.text_files import check_keys, needed, parse_toml, toml_value

if TYPE_CHECKING:
    from bumpstop.joint.friction_law import FrictionLaw
    from bumpstop.joint.parameters import CurrentMap

Model = TypeVar("Model")

_UNKNOWN = "unknown"
_HEAD = ("robot", "created_from", "unit")
_TEXTS = ("note", "verdict")  # that may be left out
_RANGES = ("current_range", "speed_range")
_OPTIONAL = ("friction", "rest_speed", "friction_sd")


def model_from_toml(text: str, file: str, make: Callable[..., Model]) -> Model:
    """Build a model from a file (see docs/reference/robot/joint.md for its keys); ``make`` takes what is in it.

    Raises:
        InputError: damaged TOML; a key that is unknown, missing or has a value that cannot be used. Names file and key.
    """
    data = parse_toml(text, file)
    try:
        check_keys(data, (*_HEAD, *_TEXTS, "gravity", "joint"), "", "a joint model")
        head: dict[str, Any] = {key: _text(data, key, "") for key in _HEAD}
        joints = needed(data, "joint", "")
        if not isinstance(joints, list):
            raise InputError("joint", "is not a list of tables", "wanted one [[joint]] for every joint")
        return make(
            **head,
            **{key: _text(data, key, "") for key in _TEXTS if key in data},
            gravity=data.get("gravity", STANDARD_GRAVITY),
            joints=tuple(_joint(joint, number) for number, joint in enumerate(joints, start=1)),
        )
    except InputError as error:
        raise InputError(f"{file} {error.field}", error.problem, error.valid) from None


def model_to_toml(
    head: Mapping[str, str],
    note: str,
    joints: Iterable[JointParameters],
    gravity: tuple[float, float, float],
    verdict: str,
) -> str:
    """The file that :func:`model_from_toml` reads the same from."""
    lines = [f"{key} = {toml_value(head[key])}" for key in _HEAD]
    if note:
        lines.append(f"note = {toml_value(note)}")
    if verdict:
        lines.append(f"verdict = {toml_value(verdict)}")
    if gravity != STANDARD_GRAVITY:
        lines.append(f"gravity = {toml_value(gravity)}  # acceleration of free fall, base frame [m/s2]")
    for joint in joints:
        lines += [
            "",
            "[[joint]]",
            *(f"{key} = {toml_value(getattr(joint, key))}" for key in ("name", "map", "friction")),
        ]
        lines += [f"{name} = {_parameter_text(parameter)}" for name, parameter in joint.parameters.items()]
        for key in _RANGES:
            given = getattr(joint, key)
            lines.append(f"{key} = " + (toml_value(_UNKNOWN) if given is None else toml_value(given)))
        lines.append(f"rest_speed = {toml_value(float(joint.rest_speed))}")
        if joint.friction_sd is not None:
            lines.append(f"friction_sd = {toml_value(float(joint.friction_sd))}")
    return "\n".join(lines) + "\n"


def _joint(data: Any, number: int) -> JointParameters:
    if not isinstance(data, Mapping):
        raise InputError(f"joint[{number}]", "is not a table", "wanted [[joint]]")
    name = _text(data, "name", f"joint[{number}].")
    where = f"joint {name} "
    every = dict.fromkeys(key for keys in (*OF_MAP.values(), *OF_FRICTION.values(), COMMON) for key in keys)
    check_keys(data, ("name", "map", *_OPTIONAL, *_RANGES, *every), where, "a joint model")
    kind: CurrentMap = _text(data, "map", where)  # type: ignore[assignment]
    friction: FrictionLaw = _text({"friction": "power", **data}, "friction", where)  # type: ignore[assignment]
    return JointParameters(
        name=name,
        map=kind,
        friction=friction,
        parameters={key: _parameter(data[key], key, where) for key in every if key in data},
        current_range=_range(data, "current_range", where),
        speed_range=_range(data, "speed_range", where),
        rest_speed=data.get("rest_speed", DEFAULT_REST_SPEED),
        friction_sd=data.get("friction_sd"),
    )


def _parameter(data: Any, key: str, where: str) -> Parameter | None:
    if data == _UNKNOWN and key in (*COMMON, "B"):
        return None
    if not isinstance(data, Mapping):
        other = f' or "{_UNKNOWN}"' if key in COMMON else ""
        raise InputError(f"{where}{key}", f"{data!r} cannot be used", f"wanted {{ value, standard_error }}{other}")
    check_keys(data, ("value", "standard_error"), f"{where}{key}.", "a joint model")
    error = needed(data, "standard_error", f"{where}{key}.")
    return Parameter(
        _figure(needed(data, "value", f"{where}{key}."), f"{where}{key}.value"),
        None if error == _UNKNOWN else _figure(error, f"{where}{key}.standard_error"),
    )


def _figure(value: Any, field: str) -> float:
    figure = as_number(value, field)
    if abs(figure) > MAX_FIGURE:
        raise InputError(field, f"is {figure:g}", f"wanted up to {MAX_FIGURE:g}")
    return figure


def _range(data: Mapping[str, Any], key: str, where: str) -> tuple[float, float] | None:
    given = needed(data, key, where)
    if given == _UNKNOWN:
        return None
    low, high = as_float_array(given, f"{where}{key}", (2,))
    return float(low), float(high)


def _text(data: Mapping[str, Any], key: str, where: str) -> str:
    value = needed(data, key, where)
    if not isinstance(value, str) or not value.strip():
        raise InputError(f"{where}{key}", f"{value!r} cannot be used", "wanted text")
    return value


def _parameter_text(parameter: Parameter | None) -> str:
    if parameter is None:
        return toml_value(_UNKNOWN)
    error = toml_value(_UNKNOWN) if parameter.standard_error is None else repr(float(parameter.standard_error))
    return f"{{ value = {float(parameter.value)!r}, standard_error = {error} }}"
