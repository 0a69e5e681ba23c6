"""Files of fitted dynamics: TOML, read as strictly as it is written."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
from bumpstop.identification.dynamics.regressor_columns import checked_group, column_names
from bumpstop.identification.segments.seen_motion import SeenMotion
from bumpstop.joint.parameters import MAX_FIGURE
from bumpstop.model import Robot
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.model.inertia import vector3
from bumpstop.text_files import is_path, parse_toml, read_text, toml_value, write_text

Fit = TypeVar("Fit")

_KEYS = {"kind", "robot", "base", "tip", "created_from", "cutoff_hz"}
_KEYS |= {"rows_used", "sign_speed", "presliding", "top_speed", "loaded", "predicted_by_all", "couplings", "parameter"}
_KEYS |= {"gain", "gravity", "seen", "verdict"}
_SEEN = ("low", "high", "speed", "acceleration")


@dataclass(frozen=True, kw_only=True, eq=False)
class DynamicsEstimate:
    """What a file holds of a fit; :class:`bumpstop.identification.DynamicsFit` says what each is."""

    model: DynamicsModel
    names: tuple[str, ...]
    errors: FloatArray
    gain_errors: FloatArray | None = None
    rows_used: int
    seen: SeenMotion | None = None
    source: Mapping[str, str] = field(default_factory=dict)
    created_from: tuple[str, ...] = ()
    covariance: FloatArray | None = None

    @property
    def verdict(self) -> str:
        """On the fit, in the words of :attr:`FitVerdict.status`; empty: it was not judged. The model carries it."""
        return self.model.verdict


def save_fit(fit: DynamicsEstimate, path: str | os.PathLike[str]) -> None:
    """Write a fit.

    Raises:
        InputError: the file cannot be written.
    """
    model = fit.model
    source = fit.source or {"robot": model.robot.name}
    lines = ['kind = "dynamics"', *(f"{key} = {toml_value(value)}" for key, value in source.items())]
    lines += [
        f"created_from = {toml_value(list(fit.created_from))}",
        f"cutoff_hz = {toml_value(float(model.cutoff_hz))}  # of the zero-phase filter of the motion",
        f"rows_used = {fit.rows_used}",
        f"sign_speed = {toml_value(model.sign_speed.tolist())}  # rad/s or m/s, over which Coulomb friction turns",
        f"couplings = {toml_value([[[j + 1, share] for j, share in group] for group in model.couplings])}",
    ]
    if model.presliding is not None:
        travels = np.where(np.isfinite(model.presliding), model.presliding, 0.0).tolist()
        lines.append(f"presliding = {toml_value(travels)}  # rad or m, over which it turns instead; 0: by the speed")
    if model.top_speed is not None:
        tops = np.where(np.isfinite(model.top_speed), model.top_speed, 0.0).tolist()
        lines.append(f"top_speed = {toml_value(tops)}  # up to which friction bends; 0: it is straight")
    if model.loaded:
        lines.append(
            f"loaded = {toml_value([j + 1 for j in model.loaded])}  # joints whose friction grows with the load"
        )
    if model.gravity != STANDARD_GRAVITY:
        lines.append(f"gravity = {toml_value(list(model.gravity))}  # acceleration of free fall, base frame [m/s2]")
    if fit.verdict:
        lines.append(f"verdict = {toml_value(fit.verdict)}")
    if model.predicted_by_all:
        lines.append(
            f"predicted_by_all = {toml_value([j + 1 for j in model.predicted_by_all])}  # joints, by all values"
        )
    if fit.seen is not None:
        lines += ["", "[seen]  # motion of the fit: rad or m, and per second"]
        lines += [f"{name} = {toml_value(getattr(fit.seen, name).tolist())}" for name in _SEEN]
    if model.gains is not None and fit.gain_errors is not None:
        for joint, gain, error in zip(model.robot.joints, model.gains, fit.gain_errors, strict=True):
            seen = "" if np.isfinite(error) else "  # not seen: the scale of this joint's torque means nothing"
            lines += ["", "[[gain]]", f"joint = {toml_value(joint.name)}", f"value = {float(gain)!r}{seen}"]
            lines += [f"standard_error = {float(error)!r}"]
    names = model.column_names
    for place, (column, name) in enumerate(zip(model.columns, fit.names, strict=True)):
        lines += [
            "",
            "[[parameter]]",
            f"column = {toml_value(names[column])}",
            f"name = {toml_value(name)}",
            f"value = {float(model.values[place])!r}",
            f"standard_error = {float(fit.errors[place])!r}",
        ]
        if model.predicting is not None:
            lines.append(f"predicting = {float(model.predicting[place])!r}  # value in predictions; 0: left out")
        if fit.covariance is not None:
            size = np.maximum(fit.errors[: place + 1], 1e-300)
            shares = ", ".join(f"{x:.5g}" for x in fit.covariance[place, :place] / (size[:place] * size[place]))
            lines.append(f"correlation = [{shares}]  # of its error with those of the parameters above")
    write_text(path, "\n".join(lines) + "\n")


def load_fit(path: str | os.PathLike[str], make: Callable[..., Fit]) -> Fit:
    """Read a fit; ``make`` takes what is in the file.

    Raises:
        InputError: the file is absent, damaged, or not of this kind.
    """
    where = str(path)
    data = parse_toml(read_text(path, "wanted a file that identify wrote"), where)
    unknown = sorted(set(data) - _KEYS)
    if data.get("kind") != "dynamics" or unknown:
        problem = f"has an unknown key {unknown[0]!r}" if unknown else "is no file of fitted dynamics"
        raise InputError(where, problem, 'wanted kind = "dynamics", as identify writes it')
    robot = chain_of(data, Path(path).parent)
    try:
        couplings = tuple(
            checked_group([(int(j) - 1, float(share)) for j, share in group], robot.dof) for group in data["couplings"]
        )
        sign_speed, cutoff_hz = _finite(data["sign_speed"]), float(data["cutoff_hz"])
        if sign_speed.size not in (robot.dof, robot.dof + len(couplings)) or not (sign_speed > 0).all():
            raise ValueError("sign_speed is not one above 0 for each joint, or each joint and shared motor")
        if not 0 < cutoff_hz < math.inf:
            raise ValueError("cutoff_hz is no frequency above 0")
        top_speed = _finite(data["top_speed"]) if "top_speed" in data else None
        if top_speed is not None:
            if top_speed.size != robot.dof + len(couplings) or (top_speed < 0).any():
                raise ValueError("top_speed is not one of 0 or above for each joint and each shared motor")
            top_speed = np.where(top_speed > 0, top_speed, np.nan)
        presliding = _finite(data["presliding"]) if "presliding" in data else None
        if presliding is not None:
            if presliding.size != robot.dof + len(couplings) or (presliding < 0).any():
                raise ValueError("presliding is not one of 0 or above for each joint and each shared motor")
            presliding = np.where(presliding > 0, presliding, np.nan)
        loaded, by_all = (_joints(data.get(key, ()), key, robot.dof) for key in ("loaded", "predicted_by_all"))
        names = column_names(robot, couplings, top_speed, loaded)
        gravity = vector3(_possible(data.get("gravity", STANDARD_GRAVITY)))
        parameters = data["parameter"]
        gains, gain_errors = _gains(data.get("gain"), robot)
        errors = _finite([parameter["standard_error"] for parameter in parameters])
        predicting = [parameter["predicting"] for parameter in parameters if "predicting" in parameter]
        if predicting and len(predicting) < len(parameters):
            raise ValueError("only some parameters have a value in predictions")
        return make(
            model=DynamicsModel(
                robot=robot,
                columns=tuple(names.index(parameter["column"]) for parameter in parameters),
                values=_possible([parameter["value"] for parameter in parameters]),
                predicting=_possible(predicting) if predicting else None,
                predicted_by_all=by_all,
                sign_speed=sign_speed,
                presliding=presliding,
                top_speed=top_speed,
                couplings=couplings,
                loaded=loaded,
                cutoff_hz=cutoff_hz,
                gravity=gravity,
                gains=gains,
                unscaled=() if gain_errors is None else tuple(np.flatnonzero(np.isinf(gain_errors)).tolist()),
                verdict=str(data.get("verdict", "")),
            ),
            names=tuple(str(parameter["name"]) for parameter in parameters),
            errors=errors,
            covariance=_covariance([parameter.get("correlation") for parameter in parameters], errors),
            gain_errors=gain_errors,
            held_out={},
            unobservable=(),
            rows_used=int(data["rows_used"]),
            seen=_seen(data.get("seen"), robot),
            source={key: str(data[key]) for key in ("robot", "base", "tip") if key in data},
            created_from=tuple(str(name) for name in data.get("created_from", ())),
        )
    except KeyError as error:
        raise InputError(where, f"has no key {error.args[0]!r}", "wanted a file that identify wrote") from None
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(where, f"cannot be used ({error})", "wanted a file that identify wrote") from None


def _covariance(rows: list[Any], errors: FloatArray) -> FloatArray | None:
    """Of the parameters (p, p), from the correlations of each with those above; None: a file of an older version."""
    if any(row is None for row in rows):
        return None
    found = np.eye(errors.size)
    for place, row in enumerate(rows):
        below = _finite(row)
        if below.shape != (place,) or np.abs(below).max(initial=0.0) > 1 + 1e-3:
            raise ValueError("correlation is not one from -1 to 1 with each parameter above")
        found[place, :place] = found[:place, place] = below
    covariance: FloatArray = found * np.outer(errors, errors)
    return covariance


def _joints(numbers: Any, key: str, dof: int) -> tuple[int, ...]:
    """Joints from 0 out of numbers from 1, each once and in their order."""
    found = [int(number) for number in numbers]
    if found != sorted(set(found)) or not all(1 <= number <= dof for number in found):
        raise ValueError(f"{key} is no list of joints from 1 to {dof}")
    return tuple(number - 1 for number in found)


def _gains(tables: Any, robot: Robot) -> tuple[FloatArray | None, FloatArray | None]:
    """Gains and their standard errors (n,), which may be infinite; None where there are none."""
    if tables is None:
        return None, None
    if [table["joint"] for table in tables] != [joint.name for joint in robot.joints]:
        raise ValueError("the gains are not those of the robot's joints")
    errors = np.array([float(table["standard_error"]) for table in tables])
    if not (errors >= 0).all():
        raise ValueError("a standard error of a gain is no number")
    return _possible([table["value"] for table in tables]), errors


def _seen(table: Any, robot: Robot) -> SeenMotion | None:
    """The ranges of the fit's motion, (n,) each; None: a file that has none."""
    if table is None:
        return None
    ranges = [_finite(table[name]) for name in _SEEN]
    if any(one.shape != (robot.dof,) for one in ranges) or not (ranges[0] <= ranges[1]).all():
        raise ValueError("seen is not one range for each joint")
    return SeenMotion(*ranges)


def chain_of(data: dict[str, Any], folder: Path) -> Robot:
    """The robot that a file of this room names; relative paths start at the file's folder."""
    name = data.get("robot")
    if not isinstance(name, str):
        raise InputError("robot", "is missing", "wanted a built-in name or the path of a URDF")
    if is_path(name):
        return Robot.from_urdf(folder / name, data.get("base"), data.get("tip"))
    return Robot.load(name)


def _possible(values: Any) -> Any:
    array = _finite(values)
    if np.abs(array).max(initial=0.0) > MAX_FIGURE:
        raise ValueError(f"{array[np.abs(array).argmax()]:g} is beyond {MAX_FIGURE:g}")
    return array


def _finite(values: Any) -> Any:
    array = np.array([float(value) for value in values])
    if not np.isfinite(array).all():
        raise ValueError("a figure is not finite")
    return array
