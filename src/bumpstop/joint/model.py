"""The torque of a joint from the current of its motor: parameters, state and evaluation.

tau = f(i_j) - I qdd - T_H sgn(qd_H), with the joint current i_j = i - i_friction(qd): Schroeder 2013, eqs 2.18 to 2.30.
Currents, rates and torques are positive along the joint; tau is what the joint gives to the arm [Nm].
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array, as_number, as_rows
from bumpstop.errors import InputError, near_matches
from bumpstop.kernels import core

if TYPE_CHECKING:
    import numpy.typing as npt

CurrentMap = Literal["odd", "load_dependent", "linear"]
"""``"odd"``: tau = B i_j + A i_j abs(i_j). ``"load_dependent"``: tau = B i_j - sgn(qd) A i_j^2 (eq 2.29).
``"linear"``: tau = B i_j."""
FrictionLaw = Literal["power", "stribeck", "load_dependent"]
"""``"power"``: sgn(qd) D abs(qd)^F (eq 2.27). ``"stribeck"``: sgn(qd) (coulomb + stribeck exp(-(qd /
stribeck_speed)^2)) + viscous qd. ``"load_dependent"``: sgn(qd) (coulomb + load abs(i)) + viscous qd, i as
measured."""
CurrentUnit = Literal["A", "controller"]

OF_MAP = {"odd": ("A", "B"), "load_dependent": ("A", "B"), "linear": ("B",)}
OF_FRICTION = {
    "power": ("D", "F"),
    "stribeck": ("coulomb", "viscous", "stribeck", "stribeck_speed"),
    "load_dependent": ("coulomb", "viscous", "load"),
}
COMMON = ("hysteresis", "inertia")
# What a parameter may be; those not listed may be any finite number.
BOUNDS = {
    "B": (0.0, math.inf),
    "D": (0.0, math.inf),
    "F": (0.0, 3.0),
    "coulomb": (0.0, math.inf),
    "viscous": (0.0, math.inf),
    "stribeck": (0.0, math.inf),
    "stribeck_speed": (1e-6, math.inf),
    "load": (0.0, 0.99),
    "inertia": (0.0, math.inf),
}
DEFAULT_REST_SPEED = 0.01
_BUILTIN = ("sia5d",)


def joint_models() -> tuple[str, ...]:
    """Names of the models that come with bumpstop, each a valid argument of :meth:`JointTorqueModel.load`."""
    return _BUILTIN


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
        return _made_again, (type(self), _given(self) | {"parameters": dict(self.parameters)})

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


@dataclass(kw_only=True)
class TorqueState:
    """What joints remember from call to call, and what was counted; :meth:`JointTorqueModel.torque` updates it.

    Attributes:
        direction: (n,), sgn(qd_H) of eq 2.22: 1 or -1 by the last motion; 0 before the first, without hysteresis.
        outside_current: (n,), samples whose joint current was outside the fitted range.
        outside_speed: (n,), samples faster than the fitted range.
    """

    direction: FloatArray
    outside_current: FloatArray
    outside_speed: FloatArray

    @classmethod
    def at_rest(cls, joints: int) -> TorqueState:
        """The state of joints whose last motion is not known."""
        return cls(direction=np.zeros(joints), outside_current=np.zeros(joints), outside_speed=np.zeros(joints))


@dataclass(frozen=True, kw_only=True)
class JointTorqueModel:
    """Torques of an arm's joints from the currents of their motors. Immutable; what is remembered is in a state.

    Attributes:
        robot: whose joints these are: a built-in name, or the user's.
        created_from: recording or document the figures come from.
        unit: of current: ``"A"``, or ``"controller"`` for a controller's own.
        joints: in the order of the columns of ``torque``.
        note: what a reader of any result must know; may be empty.
    """

    robot: str
    created_from: str
    unit: CurrentUnit
    joints: tuple[JointParameters, ...]
    note: str = ""
    _kernel: list[core.JointTorqueParameters] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.unit not in get_args(CurrentUnit):
            raise InputError(
                "unit", f"{self.unit!r} is no unit of current", "valid: " + ", ".join(get_args(CurrentUnit))
            )
        if not self.joints:
            raise InputError("joint", "there is none", "wanted one [[joint]] for every joint")
        names = [joint.name for joint in self.joints]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"joint {name} name", "appears twice", "wanted a name for each joint")
        object.__setattr__(self, "_kernel", [_kernel(joint) for joint in self.joints])

    def __reduce__(self) -> tuple[Any, ...]:
        """To be pickled or copied: without what the kernels keep of it."""
        return _made_again, (type(self), _given(self))

    @property
    def kernel(self) -> list[core.JointTorqueParameters]:
        """The joints in the kernels' form."""
        return self._kernel

    @classmethod
    def load(cls, path_or_name: str | os.PathLike[str]) -> JointTorqueModel:
        """Load a built-in model by name, or a model from a TOML file.

        Args:
            path_or_name: a name from :func:`joint_models`; or a path, which as a string ends in ``.toml`` or contains a
                separator.

        Raises:
            InputError: an unknown name, an unreadable file, damaged TOML; a key that is unknown, missing or has a value
                that cannot be used; a map that is not monotone over its range. The message names joint and key.
        """
        from bumpstop.joint.model_file import model_from_toml

        if isinstance(path_or_name, str):
            if path_or_name in _BUILTIN:
                from importlib import resources

                data = resources.files("bumpstop.joint").joinpath("data", f"{path_or_name}.toml")
                return model_from_toml(data.read_text(encoding="utf-8"), data.name)
            if not (path_or_name.endswith(".toml") or "/" in path_or_name or os.sep in path_or_name):
                raise InputError(
                    "joint model", f"none is called {path_or_name!r}", near_matches(path_or_name, _BUILTIN)
                )
        from bumpstop.text_files import as_path, read_text

        path = as_path(path_or_name, "joint model")
        return model_from_toml(read_text(path, "wanted a joint model (TOML)", field="joint model"), str(path))

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model as TOML, so that :meth:`load` gives an equal one.

        Raises:
            InputError: the file cannot be written.
        """
        from bumpstop.joint.model_file import model_to_toml
        from bumpstop.text_files import write_text

        write_text(path, model_to_toml(self))

    def torque(
        self,
        current: npt.ArrayLike,
        qd: npt.ArrayLike,
        qdd: npt.ArrayLike | None = None,
        state: TorqueState | None = None,
    ) -> FloatArray:
        """Torques the joints give to the arm: tau = f(i - i_friction(qd)) - I qdd - T_H sgn(qd_H) (eqs 2.22 to 2.30).

        Rows follow each other in time, as hysteresis depends on the last motion.

        Args:
            current: of the motors, (N, n), or (n,) for one sample [``unit``].
            qd: joint rates, shape of ``current`` [rad/s].
            qdd: joint accelerations, likewise [rad/s2]; None: zero.
            state: what came before; updated. None: nothing, and forgotten afterwards.

        Returns:
            Shape of ``current`` [Nm], positive along the joints; NaN for a joint whose B is unknown.

        Raises:
            InputError: a shape or a value that cannot be used.
        """
        n = len(self.joints)
        currents, single = as_rows(current, "current", n)
        shape = (n,) if single else currents.shape
        rates = as_float_array(qd, "qd", shape).reshape(-1, n)
        accelerations = None if qdd is None else as_float_array(qdd, "qdd", shape).reshape(-1, n)
        state = TorqueState.at_rest(n) if state is None else state
        memory = np.stack(
            [
                as_float_array(getattr(state, name), f"state.{name}", (n,))
                for name in ("direction", "outside_current", "outside_speed")
            ]
        )
        tau: FloatArray = core.joint_torques(self._kernel, currents, rates, accelerations, memory)
        state.direction, state.outside_current, state.outside_speed = memory
        return tau.reshape(shape)

    def notes(self, state: TorqueState | None = None) -> tuple[str, ...]:
        """What is unknown about the model and, with a state, how often it was used outside its fitted range."""
        notes = [self.note] if self.note else []
        unknown = [joint.name for joint in self.joints if joint.parameters["B"] is None]
        if unknown:
            notes.append(f"{', '.join(unknown)}: no B: the torque is unknown (NaN)")
        for name, words in (
            *((name, f"no {name}: it counts as zero") for name in COMMON),
            ("current_range", "unknown fitted range of current: extrapolation cannot be told"),
            ("speed_range", "unknown fitted range of speed: extrapolation cannot be told"),
        ):
            lacking = [j.name for j in self.joints if (j.parameters if name in COMMON else vars(j))[name] is None]
            if lacking:
                notes.append(f"{', '.join(lacking)}: {words}")
        if state is not None:
            for counts, words in (
                (state.outside_current, "outside the fitted range of current, extrapolated linearly"),
                (state.outside_speed, "faster than the fitted range of speed"),
            ):
                notes += [
                    f"{joint.name}: {int(count)} samples {words}"
                    for joint, count in zip(self.joints, counts, strict=True)
                    if count
                ]
        return tuple(notes)


def _given(made: Any) -> dict[str, Any]:
    """What a dataclass was made of."""
    return {each.name: getattr(made, each.name) for each in fields(made) if each.init}


def _made_again(kind: type[Any], given: dict[str, Any]) -> Any:
    return kind(**given)


def _kernel(joint: JointParameters) -> core.JointTorqueParameters:
    out = core.JointTorqueParameters()
    # Without A both maps are the linear one, and without the Stribeck part that law is Coulomb and viscous friction.
    out.map = core.CurrentMap.load_dependent if joint.map == "load_dependent" else core.CurrentMap.odd
    out.friction = core.FrictionLaw.power if joint.friction == "power" else core.FrictionLaw.stribeck
    for name, parameter in joint.parameters.items():
        if parameter is not None:
            setattr(out, name, float(parameter.value))
        elif name == "B":
            out.B = math.nan
    out.rest_speed = float(joint.rest_speed)
    if joint.current_range is not None:
        out.current_low, out.current_high = map(float, joint.current_range)
    if joint.speed_range is not None:
        out.speed_high = float(joint.speed_range[1])
    return out
