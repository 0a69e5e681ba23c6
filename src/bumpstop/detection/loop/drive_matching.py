"""A joint model matched to a robot by joint names: what the detector takes of it, in the robot's order."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError, near_matches

if TYPE_CHECKING:
    from bumpstop.joint import JointParameters, JointTorqueModel
    from bumpstop.model import Robot


class MatchedDrives:
    """The drives of a robot's joints, as far as a joint model knows them.

    Attributes:
        robot: the arm.
        model: of currents; None: recordings have joint torque, and no drive is known.
        joints: (dof,) of the model, None where it has none for a joint of the robot, or none with a gain.
        unknown: numbers from 0 of these joints; none without a model.
    """

    def __init__(self, robot: Robot, model: JointTorqueModel | None, monitored: Sequence[bool]) -> None:
        """Match by name.

        Args:
            robot: the arm.
            model: of currents, or None.
            monitored: (dof,) joints with a threshold.

        Raises:
            InputError: a joint of the model that the robot has not, or a monitored joint that the model has not, or has
                without a gain.
        """
        self.robot = robot
        self.model = model
        own = [joint.name for joint in robot.joints]
        known = {} if model is None else {joint.name: joint for joint in model.joints}
        for name in known:
            if name not in own:
                raise InputError(
                    "model", f"is for a joint {name!r}, which {robot.name} has not", near_matches(name, own)
                )
        kernels = {} if model is None else dict(zip(known, model.kernel, strict=True))
        # Recordings need not show how much torque a current is: then none can be told, as without a model.
        self._gainless = {name for name, joint in known.items() if joint.parameters["B"] is None}
        known = {name: joint for name, joint in known.items() if name not in self._gainless}
        kernels = {name: kernels[name] for name in known}
        self.joints: list[JointParameters | None] = [known.get(name) for name in own]
        self._kernels = [kernels.get(name) for name in own]
        self.unknown = [] if model is None else [j for j, joint in enumerate(self.joints) if joint is None]
        for j in self.unknown:
            if monitored[j]:
                lacks = "does not know the gain B of" if own[j] in self._gainless else "has no"
                raise InputError(
                    "model", f"{lacks} joint {own[j]!r}, which is monitored", "threshold inf leaves a joint unmonitored"
                )

    def links(self) -> list[tuple[Any, float]]:
        """Inertia of every link, and the rotor that the robot has of its own where the model knows none."""
        return [
            (joint.inertia, 0.0 if drive is not None and drive.inertia > 0 else joint.rotor_inertia)
            for joint, drive in zip(self.robot.joints, self._kernels, strict=True)
        ]

    def parameters(self) -> list[_native.JointTorqueParameters]:
        """In the kernels' form, (dof,); empty without a model."""
        if self.model is None:
            return []
        return [_native.JointTorqueParameters() if drive is None else drive for drive in self._kernels]

    def errors(self) -> list[_native.JointTorqueErrors]:
        """Standard errors in the kernels' form, (dof,); empty without a model."""
        return [] if self.model is None else [_errors(drive) for drive in self.joints]

    @property
    def load_dependent(self) -> list[int]:
        """Numbers from 0 of the joints whose dead zone grows with the torque that they hold."""
        return [j for j, drive in enumerate(self.joints) if drive is not None and _grows(drive)]

    def dead_zone(self, held: FloatArray) -> FloatArray:
        """(dof,) torque that friction can hide at standstill [Nm or N]; NaN where the model lacks a drive.

        Args:
            held: (dof,) absolute torque that the joints hold meanwhile [Nm or N]; NaN: not known.
        """
        nothing = 0.0 if self.model is None else math.nan
        drives = zip(self.joints, held.tolist(), strict=True)
        return np.array([nothing if drive is None else _dead_zone(drive, torque) for drive, torque in drives])

    def rest_speed(self, otherwise: float) -> FloatArray:
        """(dof,) speed below which a joint rests, or what holds where no drive is known [rad/s or m/s]."""
        return np.array([otherwise if drive is None else drive.rest_speed for drive in self.joints])

    def notes(self) -> list[str]:
        """Joints without a drive, and rotors that both robot and model have."""
        notes = []
        names = [self.robot.joints[j].name for j in self.unknown]
        for words, of_them in (
            ("without a joint model", [name for name in names if name not in self._gainless]),
            ("the joint model does not know its gain B", [name for name in names if name in self._gainless]),
        ):
            if of_them:
                notes.append(f"{', '.join(of_them)}: {words}, not monitored.")
        twice = [
            joint.name
            for joint, drive in zip(self.robot.joints, self.joints, strict=True)
            if drive is not None and joint.rotor_inertia > 0 and drive.value("inertia") > 0
        ]
        if twice:
            notes.append(f"{', '.join(twice)}: the joint model's inertia stands in place of the robot's rotor.")
        return notes


def _grows(drive: JointParameters) -> bool:
    return drive.value("load") > 0 or (drive.map == "odd" and drive.value("A") > 0)


def _dead_zone(drive: JointParameters, held: float) -> float:
    """Of one joint: friction under the current that holds a torque, through the map's slope, and hysteresis."""
    from bumpstop.identification.drive.drive_model import inverse_map
    from bumpstop.joint.model import kernel_of

    if not _grows(drive):
        held = 0.0
    if math.isnan(held):
        return math.nan
    A, load = drive.value("A"), drive.value("load")
    # Positive, with the sign of A, that is the most current that the map may need for it.
    current = float(inverse_map(drive.map, A, drive.value("B"), np.array([held]), math.copysign(1.0, A))[0][0])
    if load > 0:  # of the motor, which may hold against its friction as well
        current = (current + drive.value("coulomb")) / (1 - load)
    kernel = kernel_of(drive)
    if drive.friction == "power":
        kernel.D, kernel.F = _power_at_rest(drive), 0.0
    kernel.A = max(kernel.A, 0.0)  # a map that bends down is steepest without current
    kernel.current_high = max(abs(kernel.current_low), abs(kernel.current_high))
    return _native.dead_zone(kernel, current)


def _power_at_rest(drive: JointParameters) -> float:
    """Friction at rest where a power law stands for it, which falls to nothing there and friction does not [current].

    The larger of two: its value at the slowest speed that the fit knows; and that at rest of the straight line that
    touches it at half the fastest speed. The law is fitted to friction that is such a line, and is below it where slow.
    """
    D, F = drive.value("D"), drive.value("F")
    found = D * drive.slowest_known**F
    if drive.speed_range is not None:
        found = max(found, D * (1 - F) * (0.5 * drive.speed_range[1]) ** F)
    return float(found)


def _errors(drive: JointParameters | None) -> _native.JointTorqueErrors:
    out = _native.JointTorqueErrors()
    if drive is None:
        return out
    for name, parameter in drive.parameters.items():
        if parameter is not None and parameter.standard_error is not None:
            setattr(out, name, float(parameter.standard_error))
    out.friction = float(drive.friction_sd or 0.0)
    return out
