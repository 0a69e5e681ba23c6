"""Thresholds of the detector: numbers, or a file of them."""

from __future__ import annotations

import json
import math
from dataclasses import InitVar, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.detection.settings import DetectorSettings, ResidualKind
from bumpstop.detection.tuning.found_with import SAME_GAIN, SETTINGS
from bumpstop.errors import InputError, near_matches
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.model.inertia import vector3
from bumpstop.text_files import list_items, parse_toml, read_text, toml_value, write_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy.typing as npt

# Keys of a file, and the fields they fill.
_KEYS = {
    "thresholds_Nm": "constant",
    "per_speed_Nm_s": "speed",
    "per_acceleration_Nm_s2": "acceleration",
    "at_rest_Nm": "rest",
    "fast_Nm": "fast",
}
_ONE_FOR_ALL = ("model_errors", "period_s", "per_hour", *SETTINGS)
_GROWING = ("speed", "acceleration", "model errors")
_SAME = 1e-6  # of numbers that are written with all their digits
_WANTED = "wanted one number above 0 for each joint; inf: not monitored"


@dataclass(frozen=True, eq=False)
class Thresholds:
    """Of the residual and of its band-pass channel, joint by joint.

    theta_j = constant_j + speed_j |qd_j| + acceleration_j |qdd_j| + rest_j f(qd_j) + model_errors sd_j, where f is 1 up
    to the joint's rest_speed and falls to 0 at twice that, and sd_j is the standard error of the torque estimated from
    the current. What motion adds to ``constant`` it adds to ``fast`` too. None of this adapts to what is measured: a
    slow clamp is not learned away.

    Attributes:
        constant: (n,) [Nm or N], above 0; infinite: the joint is not monitored.
        speed: (n,) [Nm s/rad], not negative; default: zero.
        acceleration: (n,) [Nm s2/rad], likewise.
        rest: (n,) at standstill [Nm], likewise.
        fast: (n,) of the band-passed channel [Nm], above 0; default: infinite, not monitored.
        model_errors: standard errors of the joint model's torque to add.
        period_s: between the samples they were found for [s]; None: not said.
        per_hour: false alarms an hour that they were tuned for; None: not said.
        residual: kind of residual they were found for; None: not said.
        observer_gain_1_s: of the observer, if that is the kind; None: not said.
        window_s, measured_rates, limit_margin, frozen_s, payload_kg, payload_center, gravity, causal: settings of
            the detector that they were found with; None: not said.
        joints: names of the joints, for errors; or empty.
    """

    constant: FloatArray
    speed: FloatArray | None = None
    acceleration: FloatArray | None = None
    rest: FloatArray | None = None
    fast: FloatArray | None = None
    model_errors: float = 0.0
    period_s: float | None = None
    per_hour: float | None = None
    residual: ResidualKind | None = None
    observer_gain_1_s: float | None = None
    window_s: float | None = None
    measured_rates: bool | None = None
    limit_margin: float | None = None
    frozen_s: float | None = None
    payload_kg: float | None = None
    payload_center: tuple[float, float, float] | None = None
    gravity: tuple[float, float, float] | None = None
    causal: bool | None = None
    joints: InitVar[Sequence[str]] = ()

    def __post_init__(self, joints: Sequence[str]) -> None:
        constant = as_float_array(self.constant, "thresholds_Nm", (None,), finite=False)
        object.__setattr__(self, "constant", constant)
        _check("thresholds_Nm", constant, constant > 0, _WANTED, joints)
        n = constant.size
        for key, name in list(_KEYS.items())[1:]:
            value = getattr(self, name)
            if value is None:
                value = np.full(n, math.inf if name == "fast" else 0.0)
            array = as_float_array(value, key, (n,), finite=False)
            if name == "fast":
                _check(key, array, array > 0, _WANTED, joints)
            else:
                _check(key, array, (array >= 0) & np.isfinite(array), "wanted zero or more", joints)
            object.__setattr__(self, name, array)
        if as_number(self.model_errors, "model_errors") < 0:
            raise InputError("model_errors", f"is {self.model_errors}", "wanted zero or more")
        for name in ("period_s", "per_hour"):
            value = getattr(self, name)
            if value is not None and not as_number(value, name) > 0:
                raise InputError(name, f"is {value}", "wanted more than zero")
        for name in ("gravity", "payload_center"):
            if (given := getattr(self, name)) is not None:
                object.__setattr__(self, name, vector3(as_float_array(given, name, (3,))))
        DetectorSettings(**self.settings)  # says what cannot be

    @property
    def settings(self) -> dict[str, Any]:
        """Settings that they were found with, as far as they say: arguments of ``DetectorSettings``."""
        return {name: value for name in SETTINGS if (value := getattr(self, name)) is not None}

    @property
    def settings_looking_ahead(self) -> dict[str, Any]:
        """Those of the settings that residuals of fitted dynamics have which look ahead."""
        return {name: value for name, value in self.settings.items() if name in ("residual", "frozen_s")}

    @property
    def beyond_constant(self) -> list[str]:
        """Names of what these thresholds have beside ``constant``."""
        parts = {
            "speed": self.speed,
            "acceleration": self.acceleration,
            "model errors": self.model_errors,
            "standstill": self.rest,
        }
        fast = np.isfinite(np.asarray(self.fast)).any()
        return [*(name for name, part in parts.items() if np.any(part)), *(["fast"] if fast else [])]

    @property
    def motion_note(self) -> str:
        """A sentence where forces told by what is constant are too small for a moving arm; empty: they are not."""
        grows = [name for name in self.beyond_constant if name in _GROWING]
        if not grows:
            return ""
        return (
            f"These thresholds grow with {', '.join(grows)}, which undetectable forces leave out: while the arm moves, "
            "more stays undetected."
        )

    def differences(self, settings: DetectorSettings) -> list[str]:
        """Settings that are others than those they were found with: sentences for a reader."""
        found = []
        # Without a word about gravity they were found with an upright arm, without one about a centre with the tip's.
        known = {"gravity": STANDARD_GRAVITY, "payload_center": None} | self.settings if self.settings else {}
        for name, tuned in known.items():
            ours = getattr(settings, name)
            if name == "gravity" and ours is None:  # the model's
                continue
            same = ours == tuned or (isinstance(tuned, float) and abs(ours - tuned) <= _SAME * abs(tuned))
            if not same and name not in ("residual", "observer_gain_1_s"):
                found.append(f"{name} = {_shown(ours)} (tuned with {_shown(tuned)})")
        if not found:
            return []
        rate = "" if self.per_hour is None else f" of {self.per_hour:.4g} false alarms an hour"
        what = f"Differs from what the thresholds were tuned with: {', '.join(found)}."
        return [f"{what} The tuned rate{rate} does not hold."]

    def check_residual(self, residual: str, observer_gain_1_s: float) -> None:
        """Refuse another residual than they were found for, where they say which.

        Raises:
            InputError: another kind, or an observer of another gain.
        """
        if self.residual is not None and residual != self.residual:
            raise InputError("residual", f"is {residual!r}", f"the thresholds were found for {self.residual!r}")
        gain = self.observer_gain_1_s
        if residual == "observer" and gain is not None and abs(gain - observer_gain_1_s) > SAME_GAIN * gain:
            raise InputError(
                "observer_gain_1_s", f"is {observer_gain_1_s:g}", f"the thresholds were found for {gain:g}"
            )

    @property
    def dof(self) -> int:
        """Number of joints."""
        return int(self.constant.size)

    @classmethod
    def of(cls, given: Thresholds | npt.ArrayLike, dof: int, joints: Sequence[str] = ()) -> Thresholds:
        """Thresholds, or numbers, for a robot of ``dof`` joints, whose names errors say.

        Raises:
            InputError: of another length, or none that can be used.
        """
        made = (
            given
            if isinstance(given, Thresholds)
            else cls(as_float_array(given, "thresholds", (None,), finite=False), joints=joints)
        )
        if made.dof != dof:
            raise InputError("thresholds", f"{made.dof} of them", f"the robot has {dof} joints: wanted {dof}")
        return made

    @classmethod
    def parse(cls, text: str, joints: Sequence[str] = ()) -> Thresholds:
        """Numbers with commas between them (``20,10,inf``), or the path of a file for :meth:`load`.

        ``joints``: of the robot, whose names errors say.
        """
        try:
            numbers = [float(part) for part in list_items(text)]
        except ValueError:
            return cls.load(text, joints)
        return cls(np.array(numbers), joints=joints)

    @classmethod
    def load(cls, path: str | Path, joints: Sequence[str] = ()) -> Thresholds:
        """Read a TOML file, or a JSON object as ``tune`` prints it.

        Keys: ``thresholds_Nm`` and, as wanted, ``per_speed_Nm_s``, ``per_acceleration_Nm_s2``, ``at_rest_Nm``,
        ``fast_Nm``, ``model_errors``, ``period_s``, ``per_hour``, and the settings of the detector that they were
        found with: ``residual``, ``observer_gain_1_s``, ``window_s``, ``measured_rates``, ``limit_margin``,
        ``frozen_s``, ``payload_kg``, ``payload_center``, ``gravity``, ``causal``. Others are refused in TOML and
        passed over in JSON, where null stands for infinity. ``joints``: of the robot, whose names errors say.

        Raises:
            InputError: the file cannot be read, or holds something else.
        """
        where = str(path)
        text = read_text(path, "wanted numbers or a file", field="thresholds")
        is_json = where.endswith(".json")
        data = _parse_json(text, where) if is_json else parse_toml(text, where)
        known = (*_KEYS, *_ONE_FOR_ALL)
        if not isinstance(data, dict) or "thresholds_Nm" not in data:
            raise InputError(where, "has no key 'thresholds_Nm'", _WANTED)
        unknown = [key for key in data if key not in known]
        if unknown and not is_json:
            raise InputError(where, f"{unknown[0]!r} is no key", near_matches(unknown[0], known))
        fields: dict[str, Any] = {}
        for key, value in data.items():
            if key in _KEYS:
                fields[_KEYS[key]] = _column(value, f"{where}: {key}")
            elif key in known and value is not None:
                fields[key] = value
            elif key == "frozen_s":
                fields[key] = math.inf
        return cls(**fields, joints=joints)

    def save(self, path: str | Path) -> None:
        """Write them as TOML, so that :meth:`load` gives equal ones.

        Raises:
            InputError: the file cannot be written.
        """
        lines = [f"{key} = {toml_value(getattr(self, name).tolist())}" for key, name in _KEYS.items()]
        lines.append(f"model_errors = {float(self.model_errors)!r}")
        for name in ("period_s", "per_hour"):
            if (value := getattr(self, name)) is not None:
                lines.append(f"{name} = {float(value)!r}")
        lines += [f"{key} = {toml_value(value)}" for key, value in self.settings.items()]
        write_text(path, "\n".join(lines) + "\n")

    @property
    def monitored(self) -> Sequence[bool]:
        """Whether any channel watches a joint."""
        assert self.fast is not None
        return [bool(seen) for seen in np.isfinite(self.constant) | np.isfinite(self.fast)]


def _check(key: str, values: FloatArray, usable: npt.NDArray[np.bool_], wanted: str, joints: Sequence[str]) -> None:
    """Refuse the first of ``values`` (n,) that cannot be used: joints count from 1, and are named where they can be."""
    bad = np.flatnonzero(~usable)
    if bad.size:
        j = int(bad[0])
        name = f" for {joints[j]}" if j < len(joints) else ""
        raise InputError(f"{key}[{j + 1}]", f"is {values[j]:g}{name}", wanted)


def _shown(value: Any) -> str:
    if value is None:  # of all settings only a centre
        return "the tip"
    return f"{value:.6g}" if isinstance(value, float) else str(value).lower()


def _parse_json(text: str, file: str) -> Any:
    try:
        return json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(file, f"is not valid JSON: {error}") from None


def _column(value: Any, where: str) -> FloatArray:
    if not isinstance(value, list):
        raise InputError(where, f"is {value!r}", "wanted a list")
    return np.array([math.inf if item is None else as_number(item, where, finite=False) for item in value])
