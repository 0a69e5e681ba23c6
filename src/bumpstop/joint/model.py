"""The torque of a joint from the current of its motor: parameters, state and evaluation.

tau = f(i_j) - I qdd - T_H sgn(qd_H), with the joint current i_j = i - i_friction(qd): Schroeder 2013, eqs 2.18 to 2.30.
Currents, rates and torques are positive along the joint; tau is what the joint gives to the arm [Nm].
"""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_float_array, as_rows
from bumpstop.errors import InputError, near_matches
from bumpstop.joint.parameters import COMMON, JointParameters, fields_of, remake
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.model.inertia import vector3
from bumpstop.terminal import counted

if TYPE_CHECKING:
    import numpy.typing as npt

CurrentUnit = Literal["A", "controller"]
_BUILTIN = ("sia5d",)


def joint_models() -> tuple[str, ...]:
    """Names of the models that come with bumpstop, each a valid argument of :meth:`JointTorqueModel.load`."""
    return _BUILTIN


@dataclass(kw_only=True)
class TorqueState:
    """Hysteresis of the joints from call to call, and what was counted; :meth:`JointTorqueModel.torque` updates it.

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
    """Torques of an arm's joints from the currents of their motors. Immutable; the hysteresis is in a state.

    Attributes:
        robot: whose joints these are: a built-in name, or the user's.
        created_from: recording or document the figures come from.
        unit: of current: ``"A"``, or ``"controller"`` for a controller's own.
        joints: in the order of the columns of ``torque``.
        note: what a reader of any result must know; may be empty.
        gravity: acceleration of free fall in the base frame of the arm as it is mounted [m/s2]: what predictions of
            this arm's torque take.
        verdict: on the fit that gave it, in the words of :attr:`FitVerdict.status`; empty: it was not judged, or by a
            version that did not write it down.
    """

    robot: str
    created_from: str
    unit: CurrentUnit
    joints: tuple[JointParameters, ...]
    note: str = ""
    gravity: tuple[float, float, float] = STANDARD_GRAVITY
    verdict: str = ""
    _kernel: list[_native.JointTorqueParameters] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if self.unit not in get_args(CurrentUnit):
            raise InputError(
                "unit", f"{self.unit!r} is no unit of current", "valid: " + ", ".join(get_args(CurrentUnit))
            )
        object.__setattr__(self, "gravity", vector3(as_float_array(self.gravity, "gravity", (3,))))
        if not self.joints:
            raise InputError("joint", "there is none", "wanted one [[joint]] for every joint")
        names = [joint.name for joint in self.joints]
        for name in names:
            if names.count(name) > 1:
                raise InputError(f"joint {name} name", "appears twice", "wanted a name for each joint")
        object.__setattr__(self, "_kernel", [kernel_of(joint) for joint in self.joints])

    def __reduce__(self) -> tuple[Any, ...]:
        """To be pickled or copied: without what the kernels keep of it."""
        return remake, (type(self), fields_of(self))

    @property
    def kernel(self) -> list[_native.JointTorqueParameters]:
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
        from bumpstop.text_files import as_path, is_folder, read_text

        if isinstance(path_or_name, str):
            if path_or_name in _BUILTIN:
                from importlib import resources

                data = resources.files("bumpstop.joint").joinpath("data", f"{path_or_name}.toml")
                return model_from_toml(data.read_text(encoding="utf-8"), data.name, cls)
            is_path = path_or_name.endswith(".toml") or "/" in path_or_name or os.sep in path_or_name
            # Of a folder, as identify --out makes, reading says which file in it to give.
            if not is_path and not (path_or_name and is_folder(Path(path_or_name))):
                raise InputError(
                    "joint model", f"none is called {path_or_name!r}", near_matches(path_or_name, _BUILTIN)
                )
        path = as_path(path_or_name, "joint model")
        return model_from_toml(read_text(path, "wanted a joint model (TOML)", field="joint model"), str(path), cls)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the model as TOML, so that :meth:`load` gives an equal one.

        Raises:
            InputError: the file cannot be written.
        """
        from bumpstop.joint.model_file import model_to_toml
        from bumpstop.text_files import write_text

        head = {"robot": self.robot, "created_from": self.created_from, "unit": self.unit}
        write_text(path, model_to_toml(head, self.note, self.joints, self.gravity, self.verdict))

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
        tau: FloatArray = _native.joint_torques(self._kernel, currents, rates, accelerations, memory)
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
                    f"{joint.name}: {counted(int(count), 'sample')} {words}"
                    for joint, count in zip(self.joints, counts, strict=True)
                    if count
                ]
        return tuple(notes)


def kernel_of(joint: JointParameters) -> _native.JointTorqueParameters:
    """A joint in the kernels' form."""
    out = _native.JointTorqueParameters()
    # Without A both maps are the linear one, and without the Stribeck part that law is Coulomb and viscous friction.
    out.map = _native.CurrentMap.load_dependent if joint.map == "load_dependent" else _native.CurrentMap.odd
    out.friction = _native.FrictionLaw.power if joint.friction == "power" else _native.FrictionLaw.stribeck
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
