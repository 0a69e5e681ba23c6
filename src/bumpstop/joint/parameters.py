"""Parameters of a joint's torque model: what they are, and what they may be."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from types import MappingProxyType
from typing import Any, Literal

from bumpstop.arrays import as_float_array, as_number
from bumpstop.errors import InputError, near_matches
from bumpstop.joint.friction_law import FRICTION_BOUNDS, OF_FRICTION, FrictionLaw

CurrentMap = Literal["odd", "load_dependent", "linear"]
"""``"odd"``: tau = B i_j + A i_j abs(i_j). ``"load_dependent"``: tau = B i_j - sgn(qd) A i_j^2 (eq 2.29).
``"linear"``: tau = B i_j."""

OF_MAP = {"odd": ("A", "B"), "load_dependent": ("A", "B"), "linear": ("B",)}
COMMON = ("hysteresis", "inertia")
# What a parameter may be; those not listed may be any finite number.
BOUNDS = {
    "B": (0.0, math.inf),
    **FRICTION_BOUNDS,
    "inertia": (0.0, math.inf),
}
DEFAULT_REST_SPEED = 0.01
# Speed up to which friction may still be turning over, in speeds of rest, of which the usual one is the least.
_TURNS_OVER = 4.0
MAX_FIGURE = 1e12
"""Of a model's file: no arm has a parameter beyond it, and torques made of such ones need not be finite."""


@dataclass(frozen=True, slots=True)
class Parameter:
    """A figure of a joint.

    Attributes:
        value: in the unit of the parameter.
        standard_error: of the fit, in the same unit; None: unknown.
    """

    value: float
    standard_error: float | None = None


@dataclass(frozen=True, kw_only=True)
class JointParameters:
    """One joint of a model.

    ``parameters`` holds, by name: A [Nm per squared current] and B [Nm per current] of the map; D [current at 1 rad/s]
    and F [1], or coulomb [current], viscous [current s/rad], stribeck [current], stribeck_speed [rad/s] and load [1] of
    the friction; hysteresis T_H [Nm] (eq 2.22, subtracted) and inertia [kg m2], all that is reflected to the joint. The
    last two are None where unknown, and then count as zero. B of a linear map may be None, too: the motion of the fit
    did not show it, and the torque of this joint is NaN.

    Attributes:
        name: of the joint.
        map: how the joint current becomes torque.
        friction: how the friction current depends on the rate.
        parameters: as above, no more and no fewer than map and friction take.
        current_range: lowest and highest joint current i_j of the fit; beyond, the map goes on along its tangent. None:
            unknown, and the map is used as it is.
        speed_range: slowest and fastest abs(qd) of the fit [rad/s]; None: unknown. The friction law goes on beyond.
        rest_speed: qd_thresh of eq 2.23 [rad/s]: below it the joint rests, hysteresis acts in full, and sgn(qd) runs
            linearly through zero; hysteresis has faded at twice this speed.
        friction_sd: standard deviation of measured friction about the law [current]; None: unknown.
    """

    name: str
    map: CurrentMap
    friction: FrictionLaw
    parameters: Mapping[str, Parameter | None]
    current_range: tuple[float, float] | None = None
    speed_range: tuple[float, float] | None = None
    rest_speed: float = DEFAULT_REST_SPEED
    friction_sd: float | None = None

    def __post_init__(self) -> None:
        where = f"joint {self.name}"
        if self.map not in tuple(OF_MAP):
            raise InputError(f"{where} map", f"{self.map!r} is no map", near_matches(str(self.map), OF_MAP))
        if self.friction not in tuple(OF_FRICTION):
            raise InputError(
                f"{where} friction",
                f"{self.friction!r} is no friction law",
                near_matches(str(self.friction), OF_FRICTION),
            )
        wanted = (*OF_MAP[self.map], *OF_FRICTION[self.friction], *COMMON)
        for name in self.parameters:
            if name not in wanted:
                raise InputError(
                    f"{where} {name}",
                    f"is no parameter of map {self.map!r} with friction {self.friction!r}",
                    near_matches(name, wanted),
                )
        for name in wanted:
            self._check_parameter(f"{where} {name}", name)
        object.__setattr__(self, "parameters", MappingProxyType({name: self.parameters[name] for name in wanted}))
        for name in ("current_range", "speed_range"):
            self._check_range(
                f"{where} {name}", getattr(self, name), lowest=0.0 if name == "speed_range" else -math.inf
            )
        if not as_number(self.rest_speed, f"{where} rest_speed") >= 1e-6:
            raise InputError(f"{where} rest_speed", f"is {self.rest_speed}", "wanted at least 1e-6 rad/s")
        if self.friction_sd is not None and as_number(self.friction_sd, f"{where} friction_sd") < 0:
            raise InputError(f"{where} friction_sd", f"is {self.friction_sd}", "wanted zero or more")
        self._check_monotone(where)

    def __reduce__(self) -> tuple[Any, ...]:
        """To be pickled or copied: a read-only view of a dictionary cannot be."""
        return remake, (type(self), fields_of(self) | {"parameters": dict(self.parameters)})

    @property
    def slowest_known(self) -> float:
        """Slowest speed that the friction of the fit is known at [rad/s or m/s]."""
        low = 0.0 if self.speed_range is None else self.speed_range[0]
        return max(low, turned_over(self.rest_speed))

    def value(self, name: str) -> float:
        """The value of a parameter; 0 where it is unknown or this joint has none of that name."""
        parameter = self.parameters.get(name)
        return 0.0 if parameter is None else parameter.value

    def _check_parameter(self, where: str, name: str) -> None:
        if name not in self.parameters:
            raise InputError(where, "is missing", "wanted { value, standard_error }")
        parameter = self.parameters[name]
        if parameter is None:
            if name not in COMMON and not (name == "B" and self.map == "linear"):
                raise InputError(where, "is unknown", f"only {' and '.join(COMMON)}, and B of a linear map, may be")
            return
        value = as_number(parameter.value, f"{where}.value")
        low, high = BOUNDS.get(name, (-math.inf, math.inf))
        if not low <= value <= high:
            limits = f"at least {low:g}" if high == math.inf else f"from {low:g} to {high:g}"
            raise InputError(f"{where}.value", f"is {parameter.value}", f"wanted {limits}")
        error = parameter.standard_error
        if error is not None and as_number(error, f"{where}.standard_error") < 0:
            raise InputError(f"{where}.standard_error", f"is {error}", "wanted zero or more")

    def _check_range(self, where: str, given: tuple[float, float] | None, lowest: float) -> None:
        if given is None:
            return
        low, high = (float(number) for number in as_float_array(given, where, (2,)))
        if not lowest <= low < high:
            raise InputError(where, f"is {list(given)}", "wanted the low end, then the high one, speeds not negative")

    def _check_monotone(self, where: str) -> None:
        """Refuse a map by which more current could mean less torque, as it then has no inverse."""
        if self.parameters["B"] is None:
            return
        A, B = self.value("A"), self.value("B")
        reach = math.inf if self.current_range is None else max(map(abs, self.current_range))
        # Schroeder's map bends down on one side or the other, whichever sign A has.
        bend = A if self.map == "odd" else -abs(A)
        least = B if bend >= 0 else B + 2 * bend * reach
        if least > 0:
            return
        peak = f"; its slope is zero at a joint current of {B / (2 * -bend):.6g}" if bend < 0 else ""
        extent = "of unknown range" if reach == math.inf else f"up to {reach:g}"
        raise InputError(
            f"{where} map",
            f"{self.map!r} with A = {A:g}, B = {B:g} is not monotone over joint currents {extent}{peak}",
            "wanted torque that rises with current over the fitted range",
        )


def turned_over(rest_speed: float) -> float:
    """Speed from which on friction has turned over after a reversal: fits leave slower rows out [rad/s or m/s].

    Args:
        rest_speed: of the joint [rad/s or m/s].
    """
    return _TURNS_OVER * max(rest_speed, DEFAULT_REST_SPEED)


def fields_of(made: Any) -> dict[str, Any]:
    """What a dataclass was made of."""
    return {each.name: getattr(made, each.name) for each in fields(made) if each.init}


def remake(kind: type[Any], given: dict[str, Any]) -> Any:
    """The same again, for pickling."""
    return kind(**given)
