"""Recordings as Parquet, CSV and MCAP."""

from __future__ import annotations

import json
import shutil
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.errors import InputError
from bumpstop.output_files import replacing, write_csv, write_parquet
from bumpstop.recording.formats.joint_state import messages
from bumpstop.recording.signals import Signals

if TYPE_CHECKING:
    import polars as pl

_ENDINGS = (".parquet", ".csv", ".mcap")
_TOPIC = "/joint_states"


def write(recording: Signals, path: Path) -> None:
    """Write by the ending of the name; as ``Recording.save``."""
    if path.suffix not in _ENDINGS:
        raise InputError(str(path), f"{path.suffix!r} is no ending of a recording", "valid: " + ", ".join(_ENDINGS))
    try:
        if path.suffix == ".mcap":
            _write_mcap(recording, path)
        elif path.suffix == ".csv":
            write_csv(path, table_of(recording))
        else:
            said = {"joint_names": json.dumps(recording.joint_names), "robot": recording.robot}
            write_parquet(path, table_of(recording), said)
    except OSError as error:
        raise InputError(str(path), f"cannot be written ({error.strerror or error})") from None


def holds_current_as_effort(recording: Signals, path: Path) -> bool:
    """Whether the effort of a bag so written is motor current, and would be read as torque by default."""
    return path.suffix == ".mcap" and recording.tau is None and recording.current is not None


def left_out(recording: Signals, path: Path) -> tuple[str, ...]:
    """What a file with this ending does not hold of the recording."""
    lost = {
        "current": path.suffix == ".mcap" and recording.tau is not None and recording.current is not None,
        "wrench": path.suffix == ".mcap" and recording.wrench is not None,
        "q_ref": path.suffix == ".mcap" and recording.q_ref is not None,
        "joint names": path.suffix == ".csv" and bool(recording.joint_names),
        "robot": path.suffix != ".parquet" and bool(recording.robot),
    }
    return tuple(name for name, is_lost in lost.items() if is_lost)


def table_of(recording: Signals) -> pl.DataFrame:
    """Columns ``t``, ``q_1`` .. and what else there is, as in formats of Parquet recordings."""
    import polars as pl

    columns: dict[str, Any] = {"t": recording.t}
    for stem in ("q", "qd", "current", "tau", "q_ref"):
        value = getattr(recording, stem)
        if value is not None:
            columns |= {f"{stem}_{j + 1}": value[:, j] for j in range(value.shape[1])}
    if recording.wrench is not None:
        labels = ("fx", "fy", "fz", "tx", "ty", "tz")
        columns |= {f"wrench_{label}": recording.wrench[:, j] for j, label in enumerate(labels)}
    return pl.DataFrame(columns)


def arrays_of(table: pl.DataFrame) -> dict[str, Any]:
    """The arrays of a recording, from the columns that :func:`table_of` makes; other columns are left alone.

    Raises:
        InputError: no data frame of polars, or ``t`` or ``q_1`` is missing.
    """
    import polars as pl

    if not isinstance(table, pl.DataFrame):
        raise InputError("frame", f"is a {type(table).__name__}", "wanted a polars.DataFrame")
    for name in ("t", "q_1"):
        if name not in table.columns:
            raise InputError("frame", f"has no column {name!r}", "wanted t, q_1 .. q_n, in s and rad or m")
    found: dict[str, Any] = {"t": table["t"].to_numpy()}
    for stem in ("q", "qd", "current", "tau", "q_ref"):
        count = next(j for j in range(len(table.columns) + 1) if f"{stem}_{j + 1}" not in table.columns)
        if count:
            found[stem] = table.select([f"{stem}_{j + 1}" for j in range(count)]).to_numpy()
    labels = [f"wrench_{label}" for label in ("fx", "fy", "fz", "tx", "ty", "tz")]
    if set(labels) <= set(table.columns):
        found["wrench"] = table.select(labels).to_numpy()
    return found


def _write_mcap(recording: Signals, path: Path) -> None:
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    names = recording.joint_names or tuple(f"joint_{j + 1}" for j in range(recording.dof))
    effort = recording.tau if recording.tau is not None else recording.current
    parts = (recording.q, recording.qd, effort)
    store = get_typestore(Stores.ROS2_HUMBLE)
    types = store.types
    header = types["std_msgs/msg/Header"](stamp=types["builtin_interfaces/msg/Time"](sec=0, nanosec=0), frame_id="")
    first = [np.zeros(0) if part is None else part[0] for part in parts]
    joint_state = types["sensor_msgs/msg/JointState"]
    template = joint_state(header=header, name=list(names), position=first[0], velocity=first[1], effort=first[2])
    time = np.round(recording.t * 1e9).astype(np.int64)
    if time[0] < 0 or time[-1] >= 2**31 * 1_000_000_000:
        raise InputError(
            str(path), f"times from {recording.t[0]:g} s to {recording.t[-1]:g} s", "ROS counts 0 to 2^31 s"
        )
    bodies = messages(bytes(store.serialize_cdr(template, joint_state.__msgtype__)), time, parts)
    with replacing(path) as waiting, tempfile.TemporaryDirectory(dir=path.parent) as folder:
        bag = Path(folder) / "bag"
        with Writer(bag, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
            connection = writer.add_connection(_TOPIC, joint_state.__msgtype__, typestore=store)
            for stamp, body in zip(time.tolist(), bodies, strict=True):
                writer.write(connection, stamp, body.tobytes())
        (file,) = bag.glob("*.mcap")
        # Into what is no ordinary file, such as a device, it is copied; into a folder it is not.
        (shutil.copyfile if waiting.exists() else shutil.move)(file, waiting)
