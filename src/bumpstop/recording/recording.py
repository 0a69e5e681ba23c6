"""A recording: what an arm measured of itself, over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import as_number
from bumpstop.errors import InputError
from bumpstop.model import Robot
from bumpstop.recording.read_report import ReadReport
from bumpstop.recording.signals import Signals

if TYPE_CHECKING:
    import numpy.typing as npt
    import polars as pl

_NOTHING_READ = ReadReport()


@dataclass(frozen=True, eq=False, kw_only=True)
class Recording(Signals):
    """Positions of the joints over time, and what else was measured. Immutable; every number is finite.

    Attributes:
        t: (N,) time, strictly rising [s]; intervals may differ.
        q: (N, n) joint positions [rad or m].
        qd: (N, n) joint speeds [rad/s or m/s], or None.
        current: (N, n) motor currents, motor side, positive as the column file's sign says [A], or None.
        tau: (N, n) joint torques, joint side, positive along +q [Nm or N], or None.
        q_ref: (N, n) joint positions that the controller asked for, at the same times [rad or m], or None.
        wrench: (N, 6) force [N] and torque [Nm] that the environment exerts on the tip, along the tip's axes, or None.
        joint_names: n names, or empty.
        robot: its name, or empty.
        source: the file it was read from, as people are told of it.
        report: what reading found.
        cut_from: time at which the recording began that this is a part of [s]; None: it is the whole.
    """

    report: ReadReport = _NOTHING_READ
    cut_from: float | None = None

    @classmethod
    def load(
        cls,
        path: str | Path,
        *,
        columns: str | Path | Mapping[str, Any] | None = None,
        max_bad: float = 0.01,
        robot: Robot | None = None,
        topic: str | None = None,
        joint_names: tuple[str, ...] = (),
        rate_hz: float | None = None,
    ) -> Recording:
        """Read a file: CSV, Parquet, Excel, MATLAB, or a ROS 2 bag.

        Args:
            path: of the file, or of a bag's folder.
            columns: a column file or a dict of its keys; needed where names do not tell what the columns hold.
            max_bad: share of bad rows up to which they are dropped and reported, 0 to 1.
            robot: whose limits tell what is impossible and whose joint names order those of a bag.
            topic: of the bag; default: the column file's, else the only one with joint states.
            joint_names: chosen from a bag, in this order, unless the column file has some, else the robot's, else all.
            rate_hz: rows were sampled evenly at this rate; their times are those of a PC, which came later [Hz].

        Raises:
            InputError: the file, the column file or too many rows cannot be used.
        """
        from bumpstop.recording.reading import read
        from bumpstop.text_files import as_path

        share = as_number(max_bad, "max_bad")
        return cls(**read(as_path(path, "path"), columns, share, robot, topic, joint_names, rate_hz))

    @classmethod
    def from_frame(cls, frame: pl.DataFrame, *, joint_names: tuple[str, ...] = (), robot: str = "") -> Recording:
        """A recording of a polars data frame with the columns of Parquet recordings, in SI.

        Args:
            frame: ``t``, ``q_1`` .. ``q_n``; perhaps ``qd_j``, ``current_j``, ``tau_j``, ``q_ref_j``, ``wrench_fx`` ..
            joint_names: of the n joints.
            robot: its built-in name or the path of its URDF.

        Raises:
            InputError: ``t`` or ``q_1`` is missing, or what :class:`Recording` rejects.
        """
        from bumpstop.recording.formats.writing import arrays_of

        return cls(**arrays_of(frame), joint_names=joint_names, robot=robot)

    def to_frame(self) -> pl.DataFrame:
        """Polars data frame with the columns ``t``, ``q_1`` .. and what else there is, as in Parquet recordings."""
        from bumpstop.recording.formats.writing import table_of

        return table_of(self)

    def save(self, path: str | Path) -> None:
        """Write ``.parquet`` (everything), ``.csv`` (without names) or ``.mcap`` (``sensor_msgs/msg/JointState``).

        A bag's effort is ``tau``, or ``current`` where there is no ``tau``; a wrench is not written to it.

        Raises:
            InputError: another ending, or the file cannot be written.
        """
        from bumpstop.recording.formats.writing import write
        from bumpstop.text_files import as_path

        write(self, as_path(path, "path"))

    def check_robot(self, robot: Robot) -> None:
        """Refuse to be taken for a recording of an arm with other joints, or with the same in another order.

        Raises:
            InputError: another number of joints, or the robot's names in another order.
        """
        if self.dof != robot.dof:
            raise InputError("recording", f"has {self.dof} joints", f"{robot.name} has {robot.dof}: is it its own?")
        own = tuple(joint.name for joint in robot.joints)
        if self.joint_names != own and set(self.joint_names) == set(own):
            problem = f"are those of {robot.name} in another order: {', '.join(self.joint_names)}"
            raise InputError("recording.joint_names", problem, "Recording.load(..., robot=...) puts them in order")

    @property
    def duration(self) -> float:
        """From the first row to the last [s]."""
        return float(self.t[-1] - self.t[0])

    @property
    def dt(self) -> float:
        """Median interval [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def rate_hz(self) -> float:
        """Median rate [Hz]."""
        return 1.0 / self.dt

    def between(self, start_s: float, end_s: float) -> Recording:
        """The rows from ``start_s`` to ``end_s``, both included; times stay as they are [s].

        Raises:
            InputError: fewer than two rows lie there.
        """
        rows = slice(int(np.searchsorted(self.t, start_s, "left")), int(np.searchsorted(self.t, end_s, "right")))
        if rows.stop - rows.start < 2:
            problem = f"fewer than 2 rows lie between {start_s:g} s and {end_s:g} s"
            raise InputError("between", problem, f"it lasts from {self.t[0]:g} s to {self.t[-1]:g} s")
        gaps = tuple(gap for gap in self.report.gaps if start_s <= gap[0] and gap[0] + gap[1] <= end_s)
        moved = {
            name: span for name, span in self.report.base_motion.items() if span[0] <= end_s and span[1] >= start_s
        }
        begin = float(self.t[0]) if self.cut_from is None else self.cut_from
        return replace(self.rows(rows), report=replace(self.report, gaps=gaps, base_motion=moved), cut_from=begin)

    def rows(self, chosen: slice | npt.NDArray[np.bool_]) -> Recording:
        """The rows of a slice or a mask (N,); what was found while reading stays as it is."""
        cut: dict[str, Any] = {
            name: None if value is None else value[chosen]
            for name in ("t", "q", "qd", "current", "tau", "q_ref", "wrench")
            for value in (getattr(self, name),)
        }
        return replace(self, **cut)
