"""What measured peak forces may tell of a cell: keys of its scenarios, with what is believed of them beforehand."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from bumpstop.collision.problem import CollisionProblem
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision.scenario.scenario import Scenario

LATENCY = "reaction.latency_s"
DECELERATION = "reaction.joint_acceleration_rad_s2"
STOPPING_TIME = "reaction.stopping_time_s"
THRESHOLDS = "detector.thresholds_Nm"
GEARS = "arm.gear_stiffness_Nm_rad"
SERVO = "arm.servo_bandwidth_hz"
ROTORS = "arm.rotor_inertia_kg_m2"
CONTACT = "contact.stiffness_N_m"
_IN_N_MM = "contact.stiffness_N_mm"
PADDING = "contact.padding_N_m"

# What each key is, and the standard deviation of the logarithm of its factor before anything is measured. They are
# engineering choices: nothing published says how far an integrator's figure is off.
_KNOWN: dict[str, tuple[str, float]] = {
    LATENCY: ("latency", 0.0),
    DECELERATION: ("deceleration", 0.35),
    STOPPING_TIME: ("stopping time", 0.35),
    THRESHOLDS: ("threshold margin", 0.2),
    GEARS: ("stiffness of the gears", 0.4),
    SERVO: ("bandwidth of the servos", 0.5),
    ROTORS: ("rotor inertia", 0.35),
    CONTACT: ("stiffness of the contact", 0.25),
    PADDING: ("stiffness of the padding", 0.35),
}
KEYS = tuple(_KNOWN)
# What one factor stands for, and is off in each joint, pad or padding by itself.
_EACH_BY_ITSELF = (GEARS, SERVO, ROTORS, CONTACT, PADDING)
# Standard deviation of a latency: a share of it, and at least so many feedback periods.
_LATENCY_SHARE, _LATENCY_PERIODS = 0.5, 1.0


@dataclass(frozen=True)
class Parameter:
    """One key of the scenarios that measured forces may tell.

    With z a standard normal number, a ``"factor"`` multiplies every value of the key by ``exp(sd z)`` and a ``"shift"``
    adds ``sd z`` to it, but not below zero.

    Attributes:
        key: dotted key of a scenario.
        kind: ``"factor"`` of what is positive, ``"shift"`` of a time that may be zero.
        sd: of the logarithm of the factor [1], or of the shift [unit of the key].
    """

    key: str
    kind: Literal["factor", "shift"]
    sd: float

    @property
    def label(self) -> str:
        """What it is, in words."""
        return _KNOWN[self.key][0]

    def changed(self, value: Any, z: float) -> Any:
        """A value of the key, a number or a list of numbers, at z."""
        if self.kind == "shift":
            return max(0.0, float(value) + self.sd * z)
        factor = math.exp(self.sd * z)
        return [factor * each for each in value] if isinstance(value, list | tuple) else factor * float(value)


@dataclass(frozen=True)
class Parameters:
    """The parameters of a set of scenarios, in the order of their z.

    Attributes:
        each: the parameters.
    """

    each: tuple[Parameter, ...]

    @classmethod
    def of(
        cls, scenarios: Sequence[Scenario], spread: Mapping[str, float] | None = None, *, fixed: Sequence[str] = ()
    ) -> Parameters:
        """Those that the scenarios have.

        Their standard deviations are those of ``spread``, else what ``[uncertainty]`` of the scenarios says of a
        key, the widest of them, else what is assumed.

        Args:
            scenarios: with the gauge as what is hit.
            spread: by key, the standard deviation before anything is measured, in place of what is assumed: of the
                logarithm of a factor, or of a latency [s].
            fixed: keys that are known.

        Raises:
            InputError: a key that measured forces cannot tell, or a spread that is none.
        """
        given = dict(spread or {})
        for key in (*given, *fixed):
            if key not in _KNOWN:
                raise InputError(key, "is no key that measured forces tell", f"valid: {', '.join(_KNOWN)}")
        for key, sd in given.items():
            if not 0 < sd < 10:
                raise InputError(key, f"a spread of {sd:g} cannot be used", "wanted a number above 0 and below 10")
        found = []
        for key, (_, sd) in _KNOWN.items():
            if key in fixed or not any(has_key(scenario, key) for scenario in scenarios):
                continue
            if key == LATENCY:
                sd = max(_latency_sd(scenario) for scenario in scenarios)
            told = [each for scenario in scenarios if (each := _told(scenario, key)) is not None]
            sd = max(told) if told else sd
            found.append(Parameter(key, "shift" if key == LATENCY else "factor", given.get(key, sd)))
        if not found:
            raise InputError("fixed", "names every parameter", "leave one to be found")
        return cls(tuple(found))

    def __len__(self) -> int:
        """How many there are."""
        return len(self.each)

    @property
    def keys(self) -> tuple[str, ...]:
        """Their keys."""
        return tuple(parameter.key for parameter in self.each)

    def index(self, key: str) -> int:
        """Where a key stands in z."""
        return self.keys.index(key)

    def changes(self, scenario: Scenario, z: FloatArray) -> dict[str, Any]:
        """Dotted keys of a scenario and their values at z (parameters,); those it does not have are left out."""
        return {
            parameter.key: parameter.changed(nominal(scenario, parameter.key), float(z[i]))
            for i, parameter in enumerate(self.each)
            if has_key(scenario, parameter.key)
        }

    def at(self, scenario: Scenario, z: FloatArray) -> Scenario:
        """The scenario at z. Its values are those of a checked one, scaled: they are not checked again."""
        changes = self.changes(scenario, z)
        tables: dict[str, dict[str, Any]] = {}
        for key, value in changes.items():
            table, _, name = key.partition(".")
            tables.setdefault(table, {})[name] = value
        return scenario.model_copy(
            update={table: getattr(scenario, table).model_copy(update=values) for table, values in tables.items()}
        )

    def apart(self, scenario: Scenario, z: float) -> list[Scenario]:
        """The scenario with one joint, pad or padding at z after the other, the rest of it as it is."""
        found = []
        for parameter in self.each:
            if parameter.key not in _EACH_BY_ITSELF or not has_key(scenario, parameter.key):
                continue
            table, _, name = parameter.key.partition(".")
            value: Any = _by_joint(scenario, parameter.key) if table == "arm" else nominal(scenario, parameter.key)
            factor = math.exp(parameter.sd * z)
            of = getattr(scenario, table)
            joints = len(value) if isinstance(value, list | tuple) else 0
            values: list[Any] = [[*value[:j], factor * value[j], *value[j + 1 :]] for j in range(joints)]
            values = values or [factor * float(value)]
            found += [scenario.model_copy(update={table: of.model_copy(update={name: each})}) for each in values]
        return found

    def with_nominal(self, scenario: Scenario) -> Scenario:
        """The scenario with every key of a parameter spelt out, as :meth:`at` scales them."""
        return self.at(scenario, np.zeros(len(self)))

    def without(self, keys: Sequence[str]) -> Parameters:
        """Those whose key is none of these."""
        return replace(self, each=tuple(parameter for parameter in self.each if parameter.key not in keys))


def nominal(scenario: Scenario, key: str) -> Any:
    """Value of a key, as given or as the robot and the body region have it; by joint where it is one of the arm."""
    table, _, name = key.partition(".")
    value = getattr(getattr(scenario, table), name)
    if value is not None:
        return value
    return CollisionProblem.from_scenario(scenario).body_stiffness if key == CONTACT else _by_joint(scenario, key)


def _by_joint(scenario: Scenario, key: str) -> list[float]:
    """Value of a key of an elastic arm, also where the scenario gives one number for all joints."""
    train = CollisionProblem.from_scenario(scenario).drive_train
    values = {GEARS: train.gear_stiffness, SERVO: train.servo_bandwidth / (2 * math.pi), ROTORS: train.rotor_inertia}
    found: list[float] = values[key].tolist()
    return found


def has_key(scenario: Scenario, key: str) -> bool:
    """Whether a parameter is one of a scenario: rigid arms have no rotors, a stopping table no deceleration."""
    table, _, name = key.partition(".")
    law = scenario.reaction.deceleration
    if key == DECELERATION:
        return law in ("constant", "ramp")
    if key == STOPPING_TIME:
        return law == "constant_time"
    if table == "arm":
        return scenario.arm.model == "elastic"
    if key == PADDING:
        return getattr(scenario.contact, name) is not None
    return True


def _latency_sd(scenario: Scenario) -> float:
    period = scenario.detector.feedback_period_s
    return max(_LATENCY_SHARE * scenario.reaction.latency_s, _LATENCY_PERIODS * period)


def _told(scenario: Scenario, key: str) -> float | None:
    """Standard deviation that ``[uncertainty]`` of a scenario gives a key; None: it says nothing of it."""
    said = getattr(scenario, "uncertainty", None) or {}
    if key == CONTACT and _IN_N_MM in said:
        return told_spread(said[_IN_N_MM], nominal(scenario, key) / 1e3, shift=False)
    return None if key not in said else told_spread(said[key], nominal(scenario, key), shift=key == LATENCY)


def told_spread(spec: Mapping[str, Any], value: Any, *, shift: bool) -> float | None:
    """Standard deviation of an uncertain input.

    Args:
        spec: inline table of ``[uncertainty]``.
        value: that the scenario gives, a number or a list.
        shift: of the value itself; else of the logarithm of its factor.

    Returns:
        None where the table says it by a file, or by a range that begins at zero.
    """
    middle = float(np.mean(value))
    # Shares are those of what the table varies about.
    scale = float(spec.get("mean", spec.get("median", middle))) if shift else 1.0
    if "sigma" in spec:
        return float(spec["sigma"]) * scale
    if "relative_sd" in spec:
        return float(spec["relative_sd"]) * scale
    if "sd" in spec:
        return float(spec["sd"]) if shift else float(spec["sd"]) / abs(float(spec.get("mean", middle)))
    ends = spec.get("relative", spec.get("interval", [spec[key] for key in ("low", "mode", "high") if key in spec]))
    if len(ends) < 2 or (not shift and not min(ends) > 0):
        return None
    if shift:
        points = [float(end) * (middle if "relative" in spec else 1.0) for end in ends]
    else:
        points = [math.log(end) for end in ends]
    low, high = points[0], points[-1]
    if len(points) == 2:
        return (high - low) / math.sqrt(12)
    mode = points[1]
    # Of a triangular distribution.
    square = low**2 + mode**2 + high**2 - low * mode - low * high - mode * high
    return math.sqrt(square / 18)
