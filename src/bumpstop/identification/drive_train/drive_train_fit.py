"""What recordings and pushes tell of an arm's drive train, put together."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.errors import InputError
from bumpstop.identification.drive_train.gear_stiffness import Pushes, identify_gear_stiffness
from bumpstop.identification.drive_train.joint_values import JointValues
from bumpstop.identification.drive_train.rotors import identify_rotors
from bumpstop.identification.drive_train.servo_fit import identify_servo
from bumpstop.identification.segments.current_shift import tell_shifts
from bumpstop.model import unit_of
from bumpstop.model.drive_train.assumed import gear_doubt, rotor_doubt, stiff_gear_doubt
from bumpstop.model.drive_train.entry import QUANTITIES
from bumpstop.model.dynamics import STANDARD_GRAVITY

if TYPE_CHECKING:
    import os
    from collections.abc import Mapping

    from bumpstop.identification.payload.payload import Payload
    from bumpstop.model import DriveTrain, Robot
    from bumpstop.recording import Recording


@dataclass(frozen=True, eq=False)
class DriveTrainFit:
    """Drive train of a robot, with what was found of it.

    Attributes:
        robot: whose it is.
        found: figures by quantity, of those that were looked for.
        reasons: why a quantity was not looked for, by its name.
        drive_train: what was found; for joints and quantities that showed nothing, the robot's own.
        warnings: why figures are hardly those of the arm, as of a table in another unit: a sentence for each reason.
    """

    robot: Robot
    found: Mapping[str, JointValues]
    reasons: Mapping[str, str]
    drive_train: DriveTrain
    warnings: tuple[str, ...] = ()

    def __str__(self) -> str:
        """What ``bumpstop identify --model drive-train`` prints."""
        lines = []
        for name, values in self.found.items():
            lines.append(f"{name.replace('_', ' ')}:")
            turning, sliding = QUANTITIES[name]
            for j, (joint, reason) in enumerate(zip(self.robot.joints, values.reasons, strict=True)):
                unit = unit_of(joint, turning=turning, sliding=sliding)
                figure = f"{values.values[j]:.4g} +- {values.errors[j]:.2g}" + ("" if unit == "1" else f" {unit}")
                lines.append(f"  {joint.name}: {f'not identified: {reason}' if reason else figure}")
        lines += [f"{name.replace('_', ' ')}: not looked for: {reason}" for name, reason in self.reasons.items()]
        lines += [f"warning: {doubt}" for doubt in self.warnings]
        if not self.identified:
            lines.append("NOT USABLE  Nothing of the drive train was identified.")
        return "\n".join(lines)

    @property
    def identified(self) -> tuple[str, ...]:
        """Quantities of which any joint has a figure."""
        return tuple(name for name, values in self.found.items() if values.identified.any())

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the identified quantities as a drive train file.

        Raises:
            InputError: nothing was identified, or the file cannot be written.
        """
        if not self.identified:
            raise InputError("drive_train", "nothing of it was identified", "there is nothing to write")
        self.drive_train.save(path, self.robot, only=self.identified)


def identify_drive_train(
    recordings: Sequence[Recording],
    robot: Robot,
    *,
    pushes: Pushes | None = None,
    payloads: Sequence[Payload | None] = (),
    cutoff_hz: float | None = None,
    gravity: tuple[float, float, float] = STANDARD_GRAVITY,
) -> DriveTrainFit:
    """Find what recordings and static pushes tell of a drive train.

    Rotors come from torques or currents, bandwidth and gain of the servo from references, gears from pushes. A quantity
    of which all joints have a figure is ``"identified"``; where some have none, their figures are the robot's own, its
    status is that of the least known, and the source tells them apart.

    Args:
        recordings: of the robot; may be none where there are pushes.
        robot: whose drive train it is.
        pushes: static pushes.
        payloads: what each recording carried; default: nothing.
        cutoff_hz: of the filter for rotors.
        gravity: acceleration of free fall in the base frame [m/s2].

    Raises:
        InputError: neither recordings nor pushes, or some that do not fit the robot.
    """
    logs = list(recordings)
    if not logs and pushes is None:
        raise InputError("recordings", "there are none, and no pushes", "wanted one or more")
    found: dict[str, JointValues] = {}
    reasons: dict[str, str] = {}
    warnings: list[str] = []
    sources = ", ".join(log.source or "a recording" for log in logs)
    if not any(log.tau is not None or log.current is not None for log in logs):
        reasons["rotor_inertia"] = "no recording has torques or currents"
    elif robot.inertia_objection:
        reasons["rotor_inertia"] = robot.inertia_objection
    else:
        found["rotor_inertia"] = identify_rotors(logs, robot, payloads=payloads, cutoff_hz=cutoff_hz, gravity=gravity)
        quantity = "tau" if all(log.tau is not None for log in logs) else "current"
        faults: list[str] = []
        tell_shifts(logs, robot, quantity, faults, warnings, gravity=gravity)
        if faults:
            del found["rotor_inertia"]
            reasons["rotor_inertia"] = "; ".join(faults)
    if any(log.q_ref is not None for log in logs):
        servo = identify_servo(logs, robot)
        found |= {
            "servo_bandwidth": servo.bandwidth,
            "servo_position_gain": servo.position_gain,
            "acceleration_feedforward": servo.feedforward,
        }
    else:
        reasons["servo_bandwidth"] = "no recording has references (q_ref)"
    if pushes is not None:
        found["gear_stiffness"] = identify_gear_stiffness(pushes, robot)
    else:
        reasons["gear_stiffness"] = "there are no pushes"
    drive_train = robot.drive_train
    for name, values in found.items():
        if values.identified.any():
            drive_train = _with(drive_train, name, values, "static pushes" if name == "gear_stiffness" else sources)
    for name, doubt_of in (
        ("rotor_inertia", rotor_doubt),
        ("gear_stiffness", gear_doubt),
        ("gear_stiffness", stiff_gear_doubt),
    ):
        doubt = doubt_of(robot, found[name].values) if name in found else ""
        warnings += [doubt] if doubt else []
    return DriveTrainFit(robot, found, reasons, drive_train, tuple(warnings))


def _with(drive_train: DriveTrain, name: str, found: JointValues, source: str) -> DriveTrain:
    own = getattr(drive_train, name)
    told = found.identified
    values = np.where(told, np.nan_to_num(found.values), own)
    if told.all():
        return drive_train.with_values(name, values, "identified", f"identified from {source}")
    numbers = ", ".join(str(number) for number in 1 + np.flatnonzero(told))
    status = drive_train.status[name]
    # Published and unverified figures of other joints are no worse known than by their own word.
    words = f"identified from {source} for joint {numbers}; {drive_train.source[name]} for the others"
    return drive_train.with_values(name, values, "identified" if status == "published" else status, words)
