"""Plan files: TOML, read as strictly as it is written."""

from __future__ import annotations

import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.errors import InputError, near_matches
from bumpstop.identification.design.gravity_pose import Unobservable
from bumpstop.identification.design.plan import IdentificationPlan, JointExperiment, ProtocolSettings
from bumpstop.identification.dynamics.fit_file import chain_of
from bumpstop.model import Robot
from bumpstop.text_files import parse_toml, read_text, toml_value, write_text

# Of the file.
KIND = "identification_plan"
_TOP = {"kind", "robot", "base", "tip", "home", "settings", "experiment", "unobservable"}
_ANGLES = {"half_stroke"}
_EXPERIMENT = {
    "joint", "name", "pose", "low_deg", "high_deg", "torque_low_Nm", "torque_high_Nm", "clearance_m", "speeds_deg_s",
    "too_fast_percent", "accelerations_rad_s2", "hold_joint", "swing_deg", "route",
}  # fmt: skip


def save_plan(plan: IdentificationPlan, path: str | Path, *, robot: dict[str, str]) -> None:
    """Write a plan; angles in degrees, joints numbered from 1.

    Args:
        plan: what was planned.
        path: of the file.
        robot: ``robot`` as a scenario names it, with ``base`` and ``tip`` where a URDF needs them.
    """
    arm = plan.robot
    lines = [f'kind = "{KIND}"', *(f"{key} = {toml_value(value)}" for key, value in robot.items())]
    lines += [f"home = {_pose(arm, plan.home)}  # deg (m of sliding joints); where every trajectory begins and ends"]
    lines += ["", "[settings]"]
    for key, value in asdict(plan.settings).items():
        if value is None:
            lines.append(f'{key} = "none"')
        elif key in _ANGLES:
            lines.append(f"{key}_deg = {_degrees(value)}")
        else:
            lines.append(f"{key} = {toml_value(value)}")
    for one in plan.experiments:
        too_fast = [100 * share for share in one.too_fast]
        lines += [
            "",
            "[[experiment]]",
            f"joint = {one.joint + 1}",
            f"name = {toml_value(one.name)}",
            f"pose = {_pose(arm, one.pose)}  # the moved joint where gravity gives it no torque",
            f"low_deg = {_degrees(one.low)}",
            f"high_deg = {_degrees(one.high)}",
            f"torque_low_Nm = {toml_value(one.torque_low)}",
            f"torque_high_Nm = {toml_value(one.torque_high)}",
            f"clearance_m = {toml_value(one.clearance if math.isfinite(one.clearance) else 1e9)}",
            f"speeds_deg_s = {toml_value([_degrees(speed) for speed in one.speeds])}",
            f"too_fast_percent = {toml_value(too_fast)}  # no room for them in the stroke",
            f"accelerations_rad_s2 = {toml_value(one.accelerations)}",
            f"hold_joint = {0 if one.hold_joint is None else one.hold_joint + 1}  # swings while the joint is held",
            f"swing_deg = {_degrees(one.swing)}",
            f"route = [{', '.join(_pose(arm, pose) for pose in one.route)}]  # from home to the stroke",
        ]
    for lost in plan.unobservable:
        lines += [
            "",
            "[[unobservable]]",
            f"joint = {lost.joint + 1}",
            *(f"{key} = {toml_value(getattr(lost, key))}" for key in ("name", "reason", "remedy")),
        ]
    write_text(path, "\n".join(lines) + "\n")


def load_plan(path: str | Path) -> IdentificationPlan:
    """Read a plan.

    Raises:
        InputError: the file is absent, damaged, not of this kind, or has a key or a value that cannot be used.
    """
    where = str(path)
    data = parse_toml(read_text(path, "wanted a plan that bumpstop wrote"), where)
    if data.get("kind") != KIND:
        raise InputError(where, "is no plan", f'wanted kind = "{KIND}", as bumpstop plan identification writes it')
    _known(data, _TOP, where)
    robot = chain_of(data, Path(path).parent)
    try:
        settings = _settings(data["settings"], where)
        experiments = tuple(_experiment(robot, entry, where) for entry in data.get("experiment", []))
        unobservable = tuple(
            Unobservable(
                _joint(robot, entry["joint"], where), str(entry["name"]), str(entry["reason"]), str(entry["remedy"])
            )
            for entry in data.get("unobservable", [])
        )
        home = _rows(robot, [data["home"]], f"{where}: home")[0]
    except KeyError as error:
        raise InputError(where, f"has no key {error.args[0]!r}", "wanted a plan that bumpstop wrote") from None
    except (TypeError, AttributeError) as error:
        raise InputError(where, f"cannot be used ({error})", "wanted a plan that bumpstop wrote") from None
    return IdentificationPlan(
        robot=robot, settings=settings, home=home, experiments=experiments, unobservable=unobservable
    )


def _known(table: dict[str, Any], keys: set[str], where: str) -> None:
    for key in table:
        if key not in keys:
            raise InputError(where, f"has an unknown key {key!r}", near_matches(key, keys))


def _settings(table: dict[str, Any], where: str) -> ProtocolSettings:
    names = {f"{name}_deg" if name in _ANGLES else name for name in ProtocolSettings.__dataclass_fields__}
    _known(table, names, f"{where}: settings")
    values: dict[str, Any] = {}
    for name in sorted(names):
        value = table[name]
        own = name.removesuffix("_deg")
        if isinstance(value, list):
            values[own] = tuple(as_number(item, f"{where}: {name}") for item in value)
        elif own == "floor" and value == "none":
            values[own] = None
        else:
            number = as_number(value, f"{where}: {name}")
            values[own] = math.radians(number) if own in _ANGLES else number
    for name in ("gravity", "load_m"):
        if len(values[name]) != 3:
            raise InputError(f"{where}: {name}", f"has {len(values[name])} numbers", "wanted 3")
    for name in ("repeats", "ramp_repeats", "holds"):
        values[name] = int(values[name])
    return ProtocolSettings(**values)


def _experiment(robot: Robot, entry: dict[str, Any], where: str) -> JointExperiment:
    _known(entry, _EXPERIMENT, where)
    joint = _joint(robot, entry["joint"], where)
    place = f"{where}: experiment of joint {joint + 1}"
    number = {key: as_number(entry[key], f"{place}: {key}") for key in (
        "low_deg", "high_deg", "torque_low_Nm", "torque_high_Nm", "clearance_m", "swing_deg",
    )}  # fmt: skip
    low, high = math.radians(number["low_deg"]), math.radians(number["high_deg"])
    if not robot.lower[joint] - 1e-6 <= low < high <= robot.upper[joint] + 1e-6:
        limits = np.degrees([robot.lower[joint], robot.upper[joint]])
        raise InputError(
            f"{place}: low_deg", f"{number['low_deg']:g} to {number['high_deg']:g}", f"limits: {limits.tolist()}"
        )
    speeds = np.radians(as_float_array(entry["speeds_deg_s"], f"{place}: speeds_deg_s", (None,)))
    if not len(speeds) or not ((speeds > 0) & (speeds <= robot.velocity[joint] * (1 + 1e-9))).all():
        most = math.degrees(robot.velocity[joint])
        raise InputError(f"{place}: speeds_deg_s", f"{entry['speeds_deg_s']}", f"wanted above 0, at most {most:g}")
    too_fast = as_float_array(entry["too_fast_percent"], f"{place}: too_fast_percent", (None,))
    accelerations = as_float_array(entry["accelerations_rad_s2"] or [1.0], f"{place}: accelerations_rad_s2", (None,))
    if not (accelerations > 0).all():
        raise InputError(f"{place}: accelerations_rad_s2", f"{accelerations.tolist()}", "wanted above 0")
    return JointExperiment(
        joint=joint,
        name=robot.joints[joint].name,
        pose=_rows(robot, [entry["pose"]], f"{place}: pose")[0],
        low=low,
        high=high,
        torque_low=number["torque_low_Nm"],
        torque_high=number["torque_high_Nm"],
        clearance=number["clearance_m"],
        speeds=tuple(speeds.tolist()),
        too_fast=tuple((too_fast / 100).tolist()),
        accelerations=tuple(accelerations.tolist()) if entry["accelerations_rad_s2"] else (),
        hold_joint=_joint(robot, entry["hold_joint"], where) if entry["hold_joint"] else None,
        swing=math.radians(number["swing_deg"]),
        route=_rows(robot, entry["route"], f"{place}: route"),
    )


def _joint(robot: Robot, value: Any, where: str) -> int:
    if isinstance(value, bool) or not isinstance(value, int) or not 1 <= value <= robot.dof:
        raise InputError(f"{where}: joint", f"{value!r} is none of {robot.name}", f"wanted 1 to {robot.dof}")
    return value - 1


def _rows(robot: Robot, rows: list[Any], field: str) -> FloatArray:
    if not rows:
        return np.empty((0, robot.dof))
    poses = as_float_array(rows, field, (len(rows), robot.dof)) / _unit(robot)
    outside = (poses < robot.lower - 1e-6) | (poses > robot.upper + 1e-6)
    if outside.any():
        row, joint = np.argwhere(outside)[0]
        raise InputError(field, f"joint {joint + 1} at {rows[row][joint]:g} is outside its limits")
    return poses


def _pose(robot: Robot, pose: FloatArray) -> str:
    return str([round(float(x), 9) + 0.0 for x in pose * _unit(robot)])


def _degrees(angle: float) -> float:
    return round(math.degrees(angle), 9) + 0.0


def _unit(robot: Robot) -> FloatArray:
    return np.array([180 / math.pi if joint.kind == "revolute" else 1.0 for joint in robot.joints])
