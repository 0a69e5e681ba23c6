"""A detector's file in Python: what ``bumpstop detector`` wrote, read by the same code as a C++ loop reads it with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

import numpy as np

from bumpstop import _native
from bumpstop.detection.contact_place import contact_place
from bumpstop.errors import InputError
from bumpstop.text_files import as_path, read_text

if TYPE_CHECKING:
    import os

    from bumpstop.arrays import FloatArray


_MARK = "bumpstop-detector"  # begins a line of every file that the command wrote


@dataclass(frozen=True, eq=False, kw_only=True)
class LoadedDetector:
    """A detector for a running arm.

    Attributes:
        path: of its file.
        robot: name of the robot.
        joints: (n,) names.
        links: (n,) names, of the joint that moves each.
        units: (n,) of the joints' torques: ``"Nm"``, of a sliding joint ``"N"``.
        period_s: between samples [s].
        longest_interval_s: beyond it the detector has no data [s].
        takes_current: samples must have motor currents; else joint torques.
        measured_rates: samples must have measured rates.
        thresholds: (n,) constant part; infinite: not monitored [Nm or N].
        fast_thresholds: (n,) of the band-pass channel, likewise.
        fitted: its dynamics are fitted.
        force_at: where the forces of alarms are given: the tip, a link or a point of one [m], in words.
        direction: they are given along it, base frame.
    """

    path: str
    robot: str
    joints: tuple[str, ...]
    links: tuple[str, ...]
    units: tuple[str, ...]
    period_s: float
    longest_interval_s: float
    takes_current: bool
    measured_rates: bool
    thresholds: FloatArray
    fast_thresholds: FloatArray
    fitted: bool
    force_at: str
    direction: tuple[float, float, float]
    description: _native.DetectorDescription

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> LoadedDetector:
        """Read a file of ``bumpstop detector``.

        Raises:
            InputError: the file is absent, holds something else, or monitors no joint; says the line.
        """
        wanted = "wanted a file that 'bumpstop detector' wrote"
        name = str(as_path(path, "--detector"))
        text = read_text(path, wanted, field="--detector")
        found, why = _native.read_detector(text)
        if found is None:
            # The reader begins with the robot, and would ask for that in a file of thresholds.
            if not any(line.startswith(_MARK) for line in text.splitlines()):
                raise InputError("--detector", f"{name!r} is no file of a detector", wanted)
            raise InputError("--detector", f"{name!r}: {why}", wanted)
        settings = found.settings
        thresholds, fast = np.array(found.constant), np.array(settings.alarm.thresholds.fast[: len(found.joints)])
        return cls(
            path=name,
            robot=found.robot,
            joints=tuple(found.joints),
            links=tuple(found.links),
            units=tuple("N" if slides else "Nm" for slides in found.prismatic),
            period_s=settings.samples.period,
            longest_interval_s=settings.samples.longest_interval,
            takes_current=settings.source == _native.TorqueSource.current,
            measured_rates=settings.samples.measured_rates,
            thresholds=thresholds,
            fast_thresholds=fast,
            fitted=found.fitted,
            force_at=contact_place(
                found.links, found.contact_link, found.contact_point, found.tip_name, found.tip_origin
            ),
            direction=(settings.direction[0], settings.direction[1], settings.direction[2]),
            description=found,
        )

    @property
    def dof(self) -> int:
        """Number of joints."""
        return len(self.joints)

    @property
    def signal(self) -> Literal["current", "torque"]:
        """What samples must have: ``"current"`` or ``"torque"``."""
        return "current" if self.takes_current else "torque"

    @property
    def monitored(self) -> tuple[bool, ...]:
        """(n,) whether a joint has a threshold, of the residual or of the band-pass channel."""
        return tuple(bool(seen) for seen in np.isfinite(self.thresholds) | np.isfinite(self.fast_thresholds))

    def fast_thresholds_at(self, thresholds: FloatArray) -> FloatArray:
        """(n,) thresholds of the band-pass channel in a tick, of those of the residual (n,) in it [Nm or N].

        What motion and the model's errors add to the one, they add to the other. NaN where something is added and the
        residual itself has no threshold that says how much.
        """
        law = self.description.settings.alarm.thresholds
        parts = (law.speed, law.acceleration, law.rest)
        constant = law.model_errors == 0 and not any(any(part[: self.dof]) for part in parts)
        if constant:
            return self.fast_thresholds
        with np.errstate(invalid="ignore"):
            added = thresholds - self.thresholds
        return np.where(np.isfinite(self.fast_thresholds), self.fast_thresholds + added, np.inf)

    def kernel(self, *, latched: bool = False) -> _native.LoopDetector:
        """The detector of a control loop, new.

        Args:
            latched: the first alarm stands for good, so that nothing behind it is another event.
        """
        return self.description.detector(latched)
