"""The way from any file to the fields of a recording."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.model import Robot
from bumpstop.recording.checks.checks import checked
from bumpstop.recording.checks.stamps import retimed
from bumpstop.recording.columns import Columns
from bumpstop.recording.formats.memory import check_memory
from bumpstop.recording.formats.table import RawRecording, Table
from bumpstop.recording.select_columns import choose
from bumpstop.terminal import named
from bumpstop.text_files import other_robot, shown

ENDINGS = {
    ".csv": "csv",
    ".txt": "csv",
    ".tsv": "csv",
    ".dat": "csv",
    ".parquet": "parquet",
    ".db3": "ros2bag",
    ".mcap": "mcap",
    ".xlsx": "xlsx",
    ".mat": "mat",
}
_FIELDS = {
    "position": "q",
    "reference": "q_ref",
    "velocity": "qd",
    "current": "current",
    "torque": "tau",
    "wrench": "wrench",
}
_NO_WRENCH = (
    "The wrench is along axes that stand still and is left out: it is turned into those of the tip only where the "
    "recording is read with its robot (--robot)."
)
# A current that has such a share of another joint's torque is not taken for its own joint's.
_MIXED_SHARE = 0.05
# Formats whose joints have names, which choose and order them.
_BAGS = ("ros2bag", "mcap")
# Units that a kind of joint cannot have, and what it may have instead.
_OTHER_UNIT: dict[str, dict[str, dict[str, str]]] = {
    "position": {"prismatic": {"deg": "mm"}, "revolute": {"mm": "deg"}},
    "reference": {"prismatic": {"deg": "mm"}, "revolute": {"mm": "deg"}},
    "velocity": {"prismatic": {"deg/s": "mm/s", "rpm": "mm/s"}, "revolute": {"mm/s": "deg/s"}},
    "torque": {"prismatic": {"mNm": "N", "kNm": "N"}, "revolute": {}},
}


def read(
    path: Path,
    columns: str | Path | Mapping[str, Any] | None,
    max_bad: float,
    robot: Robot | None,
    topic: str | None,
    joint_names: tuple[str, ...] = (),
    rate_hz: float | None = None,
) -> dict[str, Any]:
    """Fields of a ``Recording``; arguments and errors as ``Recording.load``."""
    if not 0 <= max_bad <= 1:
        raise InputError("max_bad", f"is {max_bad:g}", "wanted a share from 0 to 1")
    try:
        if not path.exists():
            raise InputError(str(path), "there is no such file")
        given = Columns.load(columns, path.parent)
        kind = _format(path, given)
        if kind in _BAGS and not given.joint_names:
            given = replace(given, joint_names=joint_names)
        _check_places(given, kind)
        notes = check_memory(path, kind)
        raw = _raw(path, kind, given, robot, topic)
    except OSError as error:
        raise InputError(str(path), f"cannot be read ({error.strerror or error})") from None
    # Before any use: numpy would spread one column over all joints, and fail at others.
    _check_widths(raw, given, robot, path)
    mixed = _mixed_currents(raw, given, robot)
    raw = _on_joint_side(raw, given)
    if robot is not None:
        # Whoever reads a bag has put its joints into the robot's order already.
        _check_units(raw, given, robot, in_order=kind in _BAGS)
    if kind not in _BAGS:
        raw = _in_order(raw, given, robot)
    if rate_hz is not None:
        raw = retimed(raw, rate_hz)
    told = () if robot is None else robot_notes(raw.robot, robot.name)
    values, report = checked(replace(raw, notes=(*told, *notes, *raw.notes)), robot, max_bad, path)
    if "current" in values:
        report = replace(report, faults=(*report.faults, *mixed))
    if "wrench" in values and raw.wrench_frame != "tip":
        if robot is None:
            del values["wrench"]
            report = replace(report, notes=(*report.notes, _NO_WRENCH))
        else:
            values["wrench"] = _in_tip_axes(values["wrench"], values["position"], robot, raw.wrench_frame)
    fields: dict[str, Any] = {_FIELDS[name]: value for name, value in values.items() if name != "t"}
    return fields | {
        "t": values["t"][:, 0],
        "joint_names": raw.joint_names,
        "robot": robot.name if robot is not None else raw.robot,
        "source": shown(path),
        "report": report,
    }


def robot_notes(said: str, robot: str) -> tuple[str, ...]:
    """A sentence where a recording says that it is of another robot than the one that it is taken for."""
    if not other_robot(said, robot):
        return ()
    return (f"The file names robot {said!r}, and is read as a recording of {robot!r}: is it the right robot?",)


def names_in_columns(path: Path, columns: str | Path | Mapping[str, Any] | None) -> tuple[tuple[str, ...], bool]:
    """Joint names of a column file, and whether ``path`` is a bag.

    Of a bag they are its names in the order of the robot's joints, whatever they are; of other files they are names for
    the columns.

    Raises:
        InputError: the column file cannot be used.
    """
    given = Columns.load(columns, path.parent)
    return given.joint_names, _format(path, given) in _BAGS


# What is no recording that can be read, and what helps.
_ADVICE = {
    ".bag": ("is a bag of ROS 1", "make one of ROS 2 of it, as rosbags-convert does, which comes with bumpstop"),
    ".zstd": ("is compressed", "give the bag's folder, with its metadata.yaml, or unpack it (zstd -d)"),
}


def _format(path: Path, columns: Columns) -> str:
    if columns.format:
        return columns.format
    if path.is_dir():
        return "ros2bag"
    kind = ENDINGS.get(path.suffix.lower())
    if kind is None:
        if path.suffix.lower() in _ADVICE:
            raise InputError(str(path), *_ADVICE[path.suffix.lower()])
        known = ", ".join(ENDINGS)
        raise InputError(
            str(path), f"{path.suffix!r} is no known ending", f"valid: {known}, or format in a column file"
        )
    return kind


def _check_places(columns: Columns, kind: str) -> None:
    """Refuse what was written of a quantity's place and would not count: the numbers read would be others."""
    bag = kind in _BAGS
    for name, quantity in columns.quantities.items():
        where = f"columns.{name}"
        if bag and (quantity.columns or quantity.variable or quantity.file or quantity.rate_hz is not None):
            problem = "says where it stands: a bag says that itself"
            raise InputError(where, problem, "joint_names choose and order joints")
        if bag and name in ("torque", "current") and name != columns.effort:
            problem = f"says nothing: the effort of the bag is taken for a {columns.effort}"
            raise InputError(where, problem, f'give effort = "{name}", or leave {name} out')
        if bag and name in ("time", "reference", "wrench"):
            problem = "says nothing: joint states have times of their own, and neither reference nor wrench"
            raise InputError(where, problem, f"leave {name} out")
        if kind == "mat" and quantity.file is not None:
            raise InputError(f"{where}.file", "cannot be used with a MATLAB file", "put all variables into one file")


def _raw(path: Path, kind: str, columns: Columns, robot: Robot | None, topic: str | None) -> RawRecording:
    if kind in _BAGS:
        from bumpstop.recording.formats.ros import read_bag

        return read_bag(path, columns, robot, topic)
    if topic is not None:
        raise InputError("topic", f"{str(path)!r} is no bag and has no topics")
    if path.is_dir():
        raise InputError(str(path), "is a folder", "wanted a file, or the folder of a bag")
    if kind == "mat":
        from bumpstop.recording.formats.matlab import read_matlab

        return read_matlab(path, columns)
    open_table = _opener(kind, columns.header)
    return choose(open_table(path), columns, path, open_table)


def _opener(kind: str, header: bool | None) -> Callable[[Path], Table]:
    def open_table(path: Path) -> Table:
        if not path.is_file():
            raise InputError(str(path), "there is no such file")
        if path.stat().st_size == 0:
            raise InputError(str(path), "is empty")
        if kind == "csv":
            from bumpstop.recording.formats.csv import read_delimited

            return read_delimited(path, header)
        from bumpstop.recording.formats.parquet_excel import read_excel, read_parquet

        return read_parquet(path) if kind == "parquet" else read_excel(path, header)

    return open_table


def _on_joint_side(raw: RawRecording, columns: Columns) -> RawRecording:
    """Apply the coupling to what was measured at the motors."""
    coupling = columns.coupling
    at_motor = {name for name, quantity in columns.quantities.items() if quantity.side == "motor"}
    if coupling is None:
        if "torque" in at_motor:
            raise InputError("columns.torque.side", '"motor" needs a [coupling]', 'give ratio, or side = "joint"')
        return raw
    values = dict(raw.values)
    with np.errstate(all="ignore"):  # garbage is still in there
        inverse: FloatArray = np.linalg.inv(coupling.ratio).T.astype(np.float64)
        for name in ("position", "reference"):
            if name not in values:
                continue
            if name in at_motor or name not in columns.quantities:
                values[name] = _times(values[name], inverse)
            values[name] = values[name] + coupling.offset
        if "velocity" in values and ("velocity" in at_motor or "velocity" not in columns.quantities):
            values["velocity"] = _times(values["velocity"], inverse)
        if "torque" in values:
            if "torque" in at_motor:
                values["torque"] = _times(values["torque"], coupling.ratio)
            values["torque"] = values["torque"] * coupling.sign
        if "current" in values:
            values["current"] = values["current"] * coupling.sign
    return replace(raw, values=values)


def _mixed_currents(raw: RawRecording, columns: Columns, robot: Robot | None) -> list[str]:
    """A sentence on the joints whose motor carries the torque of other joints, too; none: there is no such current."""
    if columns.coupling is None:
        return []
    share = np.abs(np.linalg.inv(columns.coupling.ratio).T)  # of a joint's torque (column) that a motor (row) carries
    own = np.diag(share).copy()
    np.fill_diagonal(share, 0.0)
    mixed = np.flatnonzero(share.max(axis=1) > _MIXED_SHARE * own)
    if not mixed.size:
        return []
    names = columns.joint_names or raw.joint_names
    if len(names) != own.size:
        names = tuple(f"joint {j + 1}" if robot is None else robot.joints[j].name for j in range(own.size))
    each = named([names[j] for j in mixed])
    return [
        f"by [coupling] ratio the current of {each} is of a motor that carries torque of other joints, too, and no "
        'gain makes it that joint\'s own torque: take motor torques (torque side = "motor"), and leave current out'
    ]


def _times(rows: FloatArray, matrix: FloatArray) -> FloatArray:
    """Rows times a matrix; zeros in it keep garbage of one joint out of the others' columns."""
    result = np.zeros_like(rows)
    for i, j in zip(*np.nonzero(matrix), strict=True):
        result[:, j] += rows[:, i] * matrix[i, j]
    return result


def _in_tip_axes(wrench: FloatArray, q: FloatArray, robot: Robot, frame: str) -> FloatArray:
    """A wrench (N, 6) along the axes of another frame, as a sensor at the tip would give it."""
    from_base = robot.pose(q)[:, :3, :3]
    axes = np.array(robot.joints[0].rotation) if frame == "first_joint" else np.eye(3)
    both = np.einsum("nji,jk,nbk->nbi", from_base, axes, wrench.reshape(-1, 2, 3), optimize=True)
    turned: FloatArray = both.reshape(wrench.shape)
    return turned


def _in_order(raw: RawRecording, columns: Columns, robot: Robot | None) -> RawRecording:
    """Name the joints, and put them into the robot's order where the names are the robot's."""
    n = raw.values["position"].shape[1]
    if columns.joint_names and len(columns.joint_names) != n:
        raise InputError("columns.joint_names", f"{len(columns.joint_names)} of them", f"the positions have {n}")
    names = columns.joint_names or raw.joint_names
    own = () if robot is None else tuple(joint.name for joint in robot.joints)
    if len(names) != n or names == own or robot is None:
        return replace(raw, joint_names=names if len(names) == n else own)
    if set(names) != set(own):
        note = f"The file calls the joints {', '.join(names)}; they are taken in the order of {robot.name}."
        return replace(raw, joint_names=names, notes=(*raw.notes, note))
    place = [names.index(name) for name in own]
    values = {name: x if name in ("t", "wrench") else x[:, place] for name, x in raw.values.items()}
    return replace(raw, values=values, joint_names=own)


def _check_units(raw: RawRecording, columns: Columns, robot: Robot, *, in_order: bool) -> None:
    """Refuse units of angles where a joint slides and of lengths where it turns: their scale would be a wrong one."""
    by_name = {joint.name: joint for joint in robot.joints}
    names = columns.joint_names or raw.joint_names
    as_given = not in_order and len(names) == robot.dof and set(names) == set(by_name)
    joints = tuple(by_name[name] for name in names) if as_given else robot.joints
    for name in _OTHER_UNIT:
        quantity = columns.quantities.get(name)
        if quantity is None or name not in raw.values or (columns.coupling is not None and quantity.side == "motor"):
            continue
        units = quantity.units * len(joints) if len(quantity.units) == 1 else quantity.units
        # Units of SI are harmless: m stands for rad, and N for Nm.
        other = [_OTHER_UNIT[name][joint.kind].get(unit) for unit, joint in zip(units, joints, strict=True)]
        wrong = next((j for j, unit in enumerate(other) if unit is not None), None)
        if wrong is None:
            continue
        what = "slides" if joints[wrong].kind == "prismatic" else "turns"
        each = ", ".join(f'"{instead or unit}"' for unit, instead in zip(units, other, strict=True))
        raise InputError(
            f"columns.{name}.unit",
            f"{units[wrong]!r} is none of joint {joints[wrong].name!r}, which {what}",
            f"give one for each column, for example [{each}]",
        )


def _check_widths(raw: RawRecording, columns: Columns, robot: Robot | None, path: Path) -> None:
    """Refuse quantities that have not one column for each joint."""
    n = raw.values["position"].shape[1]
    if robot is not None and robot.dof != n:
        raise InputError(str(path), f"holds {n} joints, {robot.name} has {robot.dof}", "is it the right robot?")
    if columns.coupling is not None and columns.coupling.ratio.shape[0] != n:
        problem = f"is for {columns.coupling.ratio.shape[0]} joints, positions have {n}"
        raise InputError("columns.coupling.ratio", problem, f"wanted {n} rows and columns")
    for name, value in raw.values.items():
        width = {"t": 1, "wrench": 6}.get(name, n)
        if value.shape[1] != width:
            raise InputError(f"columns.{name}", f"{value.shape[1]} columns, positions have {n}", f"wanted {width}")
