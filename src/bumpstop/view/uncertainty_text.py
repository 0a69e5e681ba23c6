"""How well a number is known, as a person writes it in one line: ``5 %``, ``1.8 to 2.5``, or an inline table."""

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
_NUMBER = r"[-+]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)(?:[eE][-+]?[0-9]+)?"
_SHARE = re.compile(rf"\s*({_NUMBER})\s*%\s*")
_RANGE = re.compile(rf"\s*({_NUMBER})\s+to\s+({_NUMBER})\s*")


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
