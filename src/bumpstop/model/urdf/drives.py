"""What a URDF says of motors: effort limits, transmissions with a rotor, and the armature of joints."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, TypeVar

import numpy as np

from bumpstop.model.drive_train.assumed import drive_train_of, rotor_doubt, torque_limit_doubt
from bumpstop.model.drive_train.entry import DriveTrainEntry, entry_of_some
from bumpstop.model.serial_chain import SerialChain
from bumpstop.model.urdf.xml_elements import children, local

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

Chain = TypeVar("Chain", bound=SerialChain)

_ROTOR = ("rotor_inertia", "rotorInertia", "motorInertia")  # the first is Drake's
_RATIO = ("gear_ratio", "mechanicalReduction", "mechanical_reduction")
# Programs that know of no limit write the greatest number there is, or one that no arm has.
_MAX_EFFORT = 1e5
_MAX_ROTOR = 1e4  # reflected [kg m2 or kg]
# One figure in so many joints or more is a placeholder.
_MIN_EQUAL = 3


def effort_limit(limit: Element | None) -> float:
    """``effort`` of a ``<limit>`` [Nm or N]; infinite where there is none, or none that can be meant."""
    value = _number(None if limit is None else limit.get("effort"))
    return value if 0 < value <= _MAX_EFFORT else math.inf


def armature(joint: Element) -> float:
    """``armature`` of the ``<dynamics>`` of a joint, as some programs write it [kg m2 or kg]; nan: none."""
    for dynamics in children(joint, "dynamics"):
        return _rotor(_number(dynamics.get("armature")))
    return math.nan


def transmission_rotors(robot: Element) -> dict[str, float]:
    """Reflected rotor inertia by the name of the joint, of transmissions that tell one [kg m2 or kg].

    The inertia of the rotor is an element of the ``<actuator>`` (``<drake:rotor_inertia value=>``, or
    ``<rotorInertia>`` and ``<motorInertia>`` with the number as text), the gear ratio one of the actuator, of the joint
    or of the transmission, and 1 where none has it. Transmissions that couple joints are passed over, and those
    with a number that cannot be read.
    """
    found = {}
    for transmission in children(robot, "transmission"):
        joints, actuators = children(transmission, "joint"), children(transmission, "actuator")
        if len(joints) != 1 or len(actuators) != 1:
            continue
        inertia = _value(actuators, _ROTOR, math.nan)
        ratio = _value([actuators[0], joints[0], transmission], _RATIO, 1.0)
        reflected = _rotor(inertia * ratio**2)
        if not math.isnan(reflected):
            found[joints[0].get("name", "")] = reflected
    return found


def with_drives(robot: Chain, efforts: Sequence[float], rotors: Sequence[float], file: str) -> Chain:
    """The robot with the entries of its drive train that a file has.

    Args:
        robot: as it was read.
        efforts: limit of each joint, infinite where the file has none.
        rotors: reflected rotor inertia of each joint, nan where the file has none.
        file: its name.

    Returns:
        The robot; its torque limits are ``"unverified"`` where any are told, its rotors where all are. A figure that is
        the same in all joints that have one, and these are three or more, is a placeholder and passed over. Limits that
        cannot hold the arm, and rotors before their gears, are named in a warning, and not used.
    """
    source = f"the URDF file {file}"
    limits, known = np.asarray(efforts, dtype=np.float64), np.asarray(rotors, dtype=np.float64)
    if np.isfinite(limits).any() and not _placeholder(limits[np.isfinite(limits)]):
        entry = DriveTrainEntry(
            quantity="torque_limit", values=tuple(limits.tolist()), status="unverified", source=source
        )
        doubt = torque_limit_doubt(robot, limits)
        robot = replace(
            robot,
            drive_train_entries=(*robot.drive_train_entries, entry),
        )
        robot = _doubted(robot, doubt)
    told = ~np.isnan(known)
    if told.any() and not _placeholder(known[told]):
        doubt = rotor_doubt(robot, known)
        if doubt:
            return _doubted(robot, f"{doubt} They count as unknown.")
        assumed = drive_train_of(robot)
        entry = entry_of_some("rotor_inertia", known, assumed.rotor_inertia, source, assumed.source["rotor_inertia"])
        robot = replace(robot, drive_train_entries=(*robot.drive_train_entries, entry))
    return robot


def _doubted(robot: Chain, doubt: str) -> Chain:
    if not doubt:
        return robot
    return replace(robot, warnings=(*robot.warnings, doubt), mass_warnings=(*robot.mass_warnings, doubt))


def _placeholder(values: np.ndarray) -> bool:
    return len(values) >= _MIN_EQUAL and bool((values == values[0]).all())


def _value(parents: Sequence[Element], tags: Sequence[str], absent: float) -> float:
    """The number of the first element of such a name, nan where it is none; ``absent`` where there is no element."""
    for parent in parents:
        for element in parent:
            if local(element) in tags:
                return _number(element.get("value", element.text))
    return absent


def _rotor(value: float) -> float:
    return value if 0 < value <= _MAX_ROTOR else math.nan


def _number(text: str | None) -> float:
    try:
        return float(text) if text is not None else math.nan
    except ValueError:
        return math.nan
