"""Column files: which columns of a file mean what, and in which unit."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.errors import InputError, near_matches
from bumpstop.text_files import parse_toml, read_text

FORMATS = ("csv", "parquet", "ros2bag", "mcap", "xlsx", "mat")
_DEG = np.pi / 180
UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "position": {"rad": 1.0, "deg": _DEG, "m": 1.0, "mm": 1e-3},
    "reference": {"rad": 1.0, "deg": _DEG, "m": 1.0, "mm": 1e-3},
    "velocity": {"rad/s": 1.0, "deg/s": _DEG, "rpm": np.pi / 30, "m/s": 1.0, "mm/s": 1e-3},
    "current": {"A": 1.0, "mA": 1e-3},
    "torque": {"Nm": 1.0, "mNm": 1e-3, "kNm": 1e3, "N": 1.0},
    "wrench": {"SI": 1.0},
}
# Whose axes a wrench may be along; the controllers of some makers call the first joint's frame at zero their base.
FRAMES = ("tip", "base", "first_joint")
# A coupling is given because positions are those of motors, unless the file says otherwise.
_SIDE = {"position": "motor", "reference": "motor", "velocity": "motor"}
QUANTITIES = ("position", "reference", "velocity", "current", "torque", "wrench")
_KEYS = ("format", "header", "time", *QUANTITIES, "topic", "effort", "joint_names", "axis", "coupling")


@dataclass(frozen=True, kw_only=True)
class Quantity:
    """Where one quantity stands.

    Attributes:
        columns: by number (from 1) or by name; empty: the reader's own.
        units: of :data:`UNITS`, one for all columns or one for each; empty: those of SI.
        scale: of those units in SI, as many.
        side: ``"motor"`` or ``"joint"``: where it was measured; matters with a coupling only.
        variable: dotted name in a MATLAB file.
        axis: ``"rows"`` (every joint is a row), ``"columns"``, or empty: found by the number of times.
        file: another file it stands in, row by row beside the recording's; None: the recording itself.
        rate_hz: time only: rows come at this rate and no column says so [Hz].
        frame: wrench only: of :data:`FRAMES`, the one along whose axes it is given.
    """

    columns: tuple[int | str, ...] = ()
    units: tuple[str, ...] = ()
    scale: tuple[float, ...] = (1.0,)
    side: str = "motor"
    variable: str = ""
    axis: str = ""
    file: Path | None = None
    rate_hz: float | None = None
    frame: str = "tip"

    def in_si(self, values: FloatArray, name: str) -> FloatArray:
        """Columns of the file (N, k) in SI.

        Raises:
            InputError: another number of units than columns.
        """
        if len(self.scale) not in (1, values.shape[1]):
            problem = f"{len(self.scale)} of them for {values.shape[1]} columns"
            raise InputError(f"columns.{name}.unit", problem, "wanted one for all columns, or one for each")
        return values if set(self.scale) == {1.0} else values * np.array(self.scale)


@dataclass(frozen=True, eq=False, kw_only=True)
class Coupling:
    """From motors to joints: q = inverse(ratio) q_motor + offset, tau = sign * transpose(ratio) tau_motor.

    Attributes:
        ratio: (n, n) motor angle by joint angle.
        offset: (n,) [rad or m].
        sign: (n,) of measured torque and current against the position's direction, +1 or -1.
    """

    ratio: FloatArray
    offset: FloatArray
    sign: FloatArray


@dataclass(frozen=True, eq=False, kw_only=True)
class Columns:
    """A column file; see docs/reference/robot/recording.md for every key.

    Attributes:
        format: of the file, or empty: by its name.
        header: whether a text file begins with names; None: found out.
        quantities: by ``time`` or one of :data:`QUANTITIES`; those not named are the reader's own when none is named,
            else left out.
        topic: of a ROS bag, or empty.
        effort: what a bag's effort means, ``"torque"`` or ``"current"``.
        joint_names: of a bag's joints in the order of the robot's, or names for columns.
        coupling: or None.
    """

    format: str = ""
    header: bool | None = None
    quantities: Mapping[str, Quantity] = field(default_factory=dict)
    topic: str = ""
    effort: str = "torque"
    joint_names: tuple[str, ...] = ()
    coupling: Coupling | None = None

    @classmethod
    def load(cls, source: str | Path | Mapping[str, Any] | None, folder: Path) -> Columns:
        """Read a column file, or take a dict of the same keys.

        Args:
            source: path, dict or None (every key at its default).
            folder: relative paths of a dict stand here; those of a file stand beside it.

        Raises:
            InputError: a key or value that means nothing.
        """
        if source is None:
            return cls()
        if isinstance(source, Mapping):
            return _from_dict(dict(source), folder)
        path = Path(source)
        text = read_text(path, "wanted a column file (TOML)", field="columns")
        return _from_dict(parse_toml(text, str(path)), path.parent)


def _from_dict(data: dict[str, Any], folder: Path) -> Columns:
    _known(data, _KEYS, "columns")
    effort = _choice(data.get("effort", "torque"), ("torque", "current"), "columns.effort")
    header = data.get("header")
    if header is not None and not isinstance(header, bool):
        raise InputError("columns.header", f"{header!r} is neither true nor false")
    axis = data.get("axis", "")
    quantities = {}
    for name in ("time", *QUANTITIES):
        if name in data:
            quantities[name] = _quantity(name, data[name], folder, axis)
            _check_side(name, data[name].get("side"), coupled="coupling" in data)
    return Columns(
        format=_choice(data["format"], FORMATS, "columns.format") if "format" in data else "",
        header=header,
        quantities=quantities,
        topic=_text(data.get("topic", ""), "columns.topic"),
        effort=effort,
        joint_names=_names(data.get("joint_names", [])),
        coupling=_coupling(data["coupling"]) if "coupling" in data else None,
    )


def _quantity(name: str, given: Any, folder: Path, axis: str) -> Quantity:
    where = f"columns.{name}"
    if not isinstance(given, Mapping):
        raise InputError(where, f"{given!r} is no table", 'for example { columns = [2, 3], unit = "rad" }')
    own = ("column", "rate_hz") if name == "time" else ("columns", "side")
    framed = ("frame",) if name == "wrench" else ()
    _known(given, (*own, *framed, "unit", "variable", "axis", "file"), where)
    units = UNITS[name]
    unit = given.get("unit", next(iter(units)))
    each = unit if isinstance(unit, list | tuple) and unit and name not in ("time", "wrench") else [unit]
    chosen_units = tuple(_choice(one, tuple(units), f"{where}.unit") for one in each)
    written = [given["column"]] if "column" in given else given.get("columns", [])
    if not isinstance(written, list | tuple):
        raise InputError(f"{where}.columns", f"{written!r} is no list", "wanted numbers from 1, or names")
    for column in written:
        number = isinstance(column, int) and not isinstance(column, bool) and column >= 1
        if not (number or isinstance(column, str)):
            raise InputError(f"{where}.columns", f"{column!r} is no column", "wanted numbers from 1, or names")
    if name == "wrench" and len(written) not in (0, 6):
        raise InputError(f"{where}.columns", f"{len(written)} of them", "wanted 6: fx fy fz tx ty tz")
    rate = given.get("rate_hz")
    if rate is not None:
        rate = as_number(rate, f"{where}.rate_hz")
        if rate <= 0:
            raise InputError(f"{where}.rate_hz", f"is {rate:g}", "wanted more than 0")
        for other in ("column", "variable", "file"):
            if other in given:
                raise InputError(f"{where}.{other}", "and rate_hz are both given", "give one of them")
    chosen = given.get("axis", axis)
    return Quantity(
        columns=tuple(written),
        units=chosen_units,
        scale=tuple(units[one] for one in chosen_units),
        side=_choice(given.get("side", _SIDE.get(name, "joint")), ("motor", "joint"), f"{where}.side"),
        variable=_text(given.get("variable", ""), f"{where}.variable"),
        axis=_choice(chosen, ("rows", "columns"), f"{where}.axis") if chosen else "",
        file=folder / _text(given["file"], f"{where}.file") if "file" in given else None,
        rate_hz=rate,
        frame=_choice(given.get("frame", "tip"), FRAMES, f"{where}.frame"),
    )


def _check_side(name: str, given: str | None, *, coupled: bool) -> None:
    """Refuse a side that was written and would not count; of torques the reader of the file says it."""
    where = f"columns.{name}.side"
    if name in ("position", "reference", "velocity") and given == "motor" and not coupled:
        raise InputError(where, '"motor" needs a [coupling]', 'give ratio, or side = "joint"')
    if name == "current" and given == "joint" and coupled:
        raise InputError(where, "'joint' cannot be used: currents are those of motors", "leave it out")


def _coupling(given: Any) -> Coupling:
    where = "columns.coupling"
    if not isinstance(given, Mapping):
        raise InputError(where, f"{given!r} is no table", "wanted ratio, offset_rad and sign")
    _known(given, ("ratio", "offset_rad", "sign"), where)
    if "ratio" not in given:
        raise InputError(f"{where}.ratio", "is missing", "wanted one row per joint")
    ratio = as_float_array(given["ratio"], f"{where}.ratio", (None, None))
    n = ratio.shape[0]
    if ratio.shape != (n, n) or n == 0 or np.linalg.cond(ratio) > 1e12:
        raise InputError(f"{where}.ratio", "cannot be inverted", "wanted a square matrix of full rank")
    offset = as_float_array(given.get("offset_rad", np.zeros(n)), f"{where}.offset_rad", (n,))
    sign = as_float_array(given.get("sign", np.ones(n)), f"{where}.sign", (n,))
    if not (np.abs(sign) == 1).all():
        raise InputError(f"{where}.sign", f"is {sign.tolist()}", "wanted 1 or -1 per joint")
    return Coupling(ratio=ratio, offset=offset, sign=sign)


def _known(given: Mapping[str, Any], keys: tuple[str, ...], where: str) -> None:
    for key in given:
        if key not in keys:
            raise InputError(f"{where}.{key}", "is no such key", near_matches(str(key), keys))


def _choice(value: Any, valid: tuple[str, ...], where: str) -> str:
    if value not in valid:
        raise InputError(where, f"{value!r} cannot be used", near_matches(str(value), valid))
    return str(value)


def _text(value: Any, where: str) -> str:
    if not isinstance(value, str):
        raise InputError(where, f"{value!r} is no text")
    return value


def _names(value: Any) -> tuple[str, ...]:
    if not isinstance(value, list | tuple) or not all(isinstance(name, str) for name in value):
        raise InputError("columns.joint_names", f"{value!r} is no list of names")
    if len(set(value)) != len(value):
        raise InputError("columns.joint_names", "a name occurs twice")
    return tuple(value)
