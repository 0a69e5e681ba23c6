"""What stands in a field and what it means: numbers, and how well one is known as ``5 %`` or ``1.8 to 2.5``."""

from __future__ import annotations

import re
from typing import TYPE_CHECKING, Any

from bumpstop.collision.scenario.keys import value_of
from bumpstop.text_files import toml_value

if TYPE_CHECKING:
    from collections.abc import Mapping

PREFIX = "uncertainty."
# What a page offers; others of a scenario stand beside them.
OFFERED = {
    "contact.stiffness_N_m": "body stiffness",
    "contact.area_cm2": "contact area",
    "contact.body_mass_kg": "body mass",
    "detector.threshold_scale": "threshold scale",
    "detector.torque_gain": "torque gain",
    "detector.noise_sd_Nm": "noise sd",
    "reaction.joint_acceleration_rad_s2": "deceleration",
    "reaction.latency_s": "latency",
}
# Texts that are lists even of one number, and whose numbers are whole.
_LISTS = ("motion.held_joints", "contact.normal", "detector.thresholds_Nm")
_WHOLE = ("motion.held_joints",)
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_ONE = re.compile(rf"\s*({_NUMBER})\s*")
_SHARE = re.compile(rf"\s*({_NUMBER})\s*%\s*")
_RANGE = re.compile(rf"\s*({_NUMBER})\s+to\s+({_NUMBER})\s*")


def number_of(text: str) -> Any:
    """What a person means who types a number: more spellings than TOML has, as ``.5`` and ``5.``.

    Anything else is what it is on the command line: a list of numbers, or the text itself.
    """
    typed = _ONE.fullmatch(text)
    value = value_of(text)
    return float(typed[1]) if typed and isinstance(value, str) else value


def numbers_of(text: str) -> Any:
    """The same with whole numbers as numbers that need not be, also in a list."""
    value = number_of(text)
    return [_as_float(item) for item in value] if isinstance(value, list) else _as_float(value)


def _as_float(value: Any) -> Any:
    # Hundreds of digits are no float.
    return float(str(value)) if isinstance(value, int) and not isinstance(value, bool) else value


def value_at(key: str, text: str) -> Any:
    """What a text means at a dotted key; None where it is empty."""
    if not text.strip():
        return None
    value = number_of(text)
    if key in _LISTS and isinstance(value, float | int):
        value = [value]
    if key in _WHOLE and isinstance(value, list):
        value = [int(item) if isinstance(item, float) and item.is_integer() else item for item in value]
    return value


def field_text(value: Any) -> str:
    """A value of a scenario as it stands in a field."""
    if value is None:
        return ""
    if isinstance(value, list | tuple):
        return ", ".join(field_text(item) for item in value)
    return f"{value:.12g}" if isinstance(value, float | int) else str(value)


def spec_of(text: str) -> Any:
    """What a text means: the value of a key of ``[uncertainty]``; None where it is empty.

    ``5 %`` is a normal distribution about the value given, with that standard deviation; ``1.8 to 2.5`` an interval in
    the unit of the key. Anything else is a TOML value, which the scenario checks.
    """
    if not text.strip():
        return None
    if share := _SHARE.fullmatch(text):
        return {"distribution": "normal", "relative_sd": float(f"{float(share[1]) / 100:.12g}")}
    if ends := _RANGE.fullmatch(text):
        return {"interval": [float(ends[1]), float(ends[2])]}
    return value_of(text)


def text_of(spec: Mapping[str, Any] | None) -> str:
    """The shortest text that means the same."""
    if spec is None:
        return ""
    if set(spec) == {"distribution", "relative_sd"} and spec["distribution"] == "normal":
        return f"{100 * spec['relative_sd']:.12g} %"
    if set(spec) == {"interval"}:
        low, high = spec["interval"]
        return f"{low:.12g} to {high:.12g}"
    return "{ " + ", ".join(f"{key} = {toml_value(value)}" for key, value in spec.items()) + " }"
