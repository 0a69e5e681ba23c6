"""The drive train of an arm: what is known of it, and what is assumed where nothing is."""

from __future__ import annotations

import math

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.model.drive_train.drive_train import DriveTrain
from bumpstop.model.drive_train.entry import DriveTrainStatus, least_known
from bumpstop.model.serial_chain import SerialChain

# Figures of the class; each is a round number about the middle of what is published:
# docs/reference/robot/drive_train.md.
ROTOR_INERTIA_PER_TORQUE = 0.01  # [kg m2 per Nm]
TWIST_AT_TORQUE = 0.01  # of the gear at the joint's torque [rad]
GEAR_DAMPING = 0.05
SERVO_BANDWIDTH = 100.0  # [rad/s]
SERVO_POSITION_GAIN = 25.0  # [1/s]: a quarter of the bandwidth, where a rigid joint is critically damped
ACCELERATION_FEEDFORWARD = 1.0
# Of a joint that slides: what screws and belts yield under the load that they carry [m], and a motor that is as heavy
# as what it moves.
_YIELD_AT_FORCE = 2e-4
# Of an arm whose masses are unknown or placeholders [kg/m2], spread evenly over its links; and the payload of one that
# names none, as a share of what moves.
_KG_PER_M2 = 20.0
_PAYLOAD_SHARE = 0.3
_GRAVITY = 9.80665
# Wrists hold their payload off the flange [m].
_PAYLOAD_OFFSET = 0.3
# Of the smallest joints [Nm or N].
_MIN_TORQUE = 2.0
# Limits below this share of what the weight of the links alone may take are none of that arm: a motor's before its gear
# are a hundredth of the joint's. Published ones are 1.3 times as much and more, springs may carry half of an arm.
_MIN_HOLDING_SHARE = 0.25
# A rotor before its gear is a thousandth of the reflected one and less; published and assumed ones differ by ten.
_MIN_ROTOR_SHARE = 1 / 500
# Gears below this share of the class twist by 0.2 rad and more under the joint's torque: no arm does, and those told by
# twists in degrees are a 57th.
_MIN_GEAR_SHARE = 1 / 20


def drive_train_of(robot: SerialChain) -> DriveTrain:
    """See :attr:`bumpstop.model.Robot.drive_train`."""
    found = assumed_drive_train(robot)
    for entry in robot.drive_train_entries:
        if entry.quantity == "torque_limit" and torque_limit_doubt(robot, entry.values):
            continue
        found = found.with_values(entry.quantity, entry.values, entry.status, entry.source)
    rotors = np.array([joint.rotor_inertia for joint in robot.joints])
    if (rotors > 0).any():
        words: list[DriveTrainStatus] = [
            robot.inertia_status if robot.inertia_status in ("published", "unverified") else "assumed"
        ]
        if not (rotors > 0).all():
            words.append(found.status["rotor_inertia"])
        values = np.where(rotors > 0, rotors, found.rotor_inertia)
        source = robot.inertia_source or "rotors of the robot's joints"
        found = found.with_values("rotor_inertia", values, least_known(words), source)
    return found


def assumed_drive_train(robot: SerialChain) -> DriveTrain:
    """What is assumed of a robot's drive train, from its masses and lengths and its torque limits where known.

    Rated torque T of each joint is its torque limit, where that is known and not doubted, else the
    :func:`holding_torque`. Rotors: 0.01 kg m2 per Nm of T. Gears: twisted by 0.01 rad under T; damped by 5 % of
    critical. Servo: 100 rad/s, with a position gain of 25 1/s, and the whole acceleration fed forward. Of joints that
    slide, rotors weigh what they move, and gears yield by 0.2 mm under T. The torque limit of the class itself is
    infinite: unknown.

    Returns:
        The drive train; the status of every quantity is ``"assumed"``.

    Raises:
        InputError: of an arm so large there is no such class: its lengths are in another unit.
    """
    try:
        return _of_class(robot)
    except InputError:
        if not robot.length_doubts:
            raise
        raise InputError("robot", robot.length_doubts[0], "wanted lengths in metres") from None


def _of_class(robot: SerialChain) -> DriveTrain:
    known = {entry.quantity: np.asarray(entry.values) for entry in robot.drive_train_entries}
    limit = known.get("torque_limit", np.full(robot.dof, math.inf))
    if torque_limit_doubt(robot, limit):
        limit = np.full(robot.dof, math.inf)
    held = holding_torque(robot)
    torque = np.where(np.isfinite(limit), limit, held)
    turns = np.array([joint.kind == "revolute" for joint in robot.joints])
    how = "a class of arms, by the rated torque of each joint"
    fixed = "a class of arms, the same for every joint"
    return DriveTrain(
        rotor_inertia=np.where(turns, ROTOR_INERTIA_PER_TORQUE * torque, held / _GRAVITY),
        gear_stiffness=np.where(turns, torque / TWIST_AT_TORQUE, torque / _YIELD_AT_FORCE),
        gear_damping=np.full(robot.dof, GEAR_DAMPING),
        servo_bandwidth=np.full(robot.dof, SERVO_BANDWIDTH),
        servo_position_gain=np.full(robot.dof, SERVO_POSITION_GAIN),
        torque_limit=np.full(robot.dof, math.inf),
        acceleration_feedforward=np.full(robot.dof, ACCELERATION_FEEDFORWARD),
        source={
            "rotor_inertia": how,
            "gear_stiffness": how,
            "gear_damping": fixed,
            "servo_bandwidth": fixed,
            "servo_position_gain": fixed,
            "torque_limit": "unknown",
            "acceleration_feedforward": fixed,
        },
    )


def holding_torque(robot: SerialChain) -> FloatArray:
    """Torque that would hold the arm, stretched out as far as its links are long, with its rated payload (dof,).

    It does not depend on the pose: every mass is as far from a joint as the offsets in between are long together, and
    the payload at least 0.3 m. Torque limits that makers publish are 0.8 to 2.5 times as much
    (docs/reference/robot/drive_train.md).

    Returns:
        [Nm], of joints that slide the weight they carry [N]; at least 2.
    """
    masses, centers = _masses(robot)
    payload = _PAYLOAD_SHARE * float(masses.sum()) if robot.payload_kg is None else robot.payload_kg
    return np.maximum(_stretched_torque(robot, masses, centers, payload), _MIN_TORQUE)


def torque_limit_doubt(robot: SerialChain, limits: npt.ArrayLike) -> str:
    """Why torque limits cannot be those of a robot's joints, in a sentence; empty: nothing is against them.

    A joint's limit is below a quarter of the torque that holds the links alone, without any payload, as far out as they
    are long: no arm is built like that. One such joint casts doubt on all limits, which have one source.

    Args:
        robot: without its masses nothing is known.
        limits: of the joints (dof,) [Nm or N]; infinite: unknown.
    """
    if robot.inertia_objection:
        return ""
    given, weight = np.asarray(limits, dtype=np.float64), _stretched_torque(robot, *_masses(robot), 0.0)
    # A joint that slides may lie level, whatever it carries.
    turns = np.array([joint.kind == "revolute" for joint in robot.joints])
    lacking = np.flatnonzero(turns & (given < _MIN_HOLDING_SHARE * weight))
    if not lacking.size:
        return ""
    # The first mostly stands upright: one that carries is the better witness.
    named = lacking[1:] if lacking.size > 1 else lacking
    joint = int(named[np.argmin(given[named] / weight[named])])
    return (
        f"The torque limits of {robot.name} cannot hold its own weight: joint {joint + 1} has {given[joint]:.4g} Nm, "
        f"and its links take up to {weight[joint]:.3g} Nm. They count as unknown; are they those of the motors, "
        "before the gears, or in another unit?"
    )


def rotor_doubt(robot: SerialChain, rotors: npt.ArrayLike) -> str:
    """Why rotor inertias are hardly those seen at the joints, in a sentence; empty: nothing is against them.

    A rotor is below a five-hundredth of what the class of arms has for that joint, as without the square of its gear
    ratio. Joints that slide are passed over.

    Args:
        robot: whose joints they are of.
        rotors: of the joints (dof,) [kg m2]; NaN: unknown.
    """
    given, usual = np.asarray(rotors, dtype=np.float64), assumed_drive_train(robot).rotor_inertia
    joint = _least_usual(robot, given, usual, _MIN_ROTOR_SHARE)
    if joint is None:
        return ""
    return (
        f"The rotor inertias of {robot.name} are hardly those seen at its joints: joint {joint + 1} has "
        f"{given[joint]:.2g} kg m2, arms like it {usual[joint]:.2g} kg m2; is the gear ratio missing?"
    )


def gear_doubt(robot: SerialChain, stiffness: npt.ArrayLike) -> str:
    """Why stiffnesses are too soft for gears, in a sentence; empty: nothing is against them.

    A gear has less than a twentieth of what the class of arms has for that joint. Joints that slide are passed over.

    Args:
        robot: whose gears they are of.
        stiffness: seen at the joints (dof,) [Nm/rad]; NaN: unknown.
    """
    given, usual = np.asarray(stiffness, dtype=np.float64), assumed_drive_train(robot).gear_stiffness
    joint = _least_usual(robot, given, usual, _MIN_GEAR_SHARE)
    if joint is None:
        return ""
    return (
        f"The gears of {robot.name} are hardly as soft as given: joint {joint + 1} has {given[joint]:.3g} Nm/rad, "
        f"arms like it {usual[joint]:.2g} Nm/rad; in another unit, or found from twists or displacements that were?"
    )


def stiff_gear_doubt(robot: SerialChain, stiffness: npt.ArrayLike) -> str:
    """Why stiffnesses that were measured are too stiff for gears, in a sentence; empty: nothing is against them.

    A gear has more than twenty times what the class of arms has for that joint. Joints that slide are passed over.

    Args:
        robot: whose gears they are of.
        stiffness: seen at the joints (dof,) [Nm/rad]; NaN: not measured.
    """
    given, usual = np.asarray(stiffness, dtype=np.float64), assumed_drive_train(robot).gear_stiffness
    joint = _least_usual(robot, usual, given, _MIN_GEAR_SHARE)
    if joint is None:
        return ""
    return (
        f"The gears of {robot.name} are hardly as stiff as found: joint {joint + 1} has {given[joint]:.3g} Nm/rad, "
        f"arms like it {usual[joint]:.2g} Nm/rad; are displacements in mm and forces in N, as their columns say?"
    )


def _least_usual(robot: SerialChain, given: FloatArray, usual: FloatArray, share: float) -> int | None:
    """The turning joint with the smallest share of what is usual, where any is below ``share``."""
    turns = np.array([joint.kind == "revolute" for joint in robot.joints])
    lacking = np.flatnonzero(turns & (given < share * usual))
    return int(lacking[np.argmin(given[lacking] / usual[lacking])]) if lacking.size else None


def _stretched_torque(robot: SerialChain, masses: FloatArray, centers: FloatArray, payload: float) -> FloatArray:
    """Torque of the weight of links and payload [kg], as far out as the links are long (dof,) [Nm or N]."""
    offsets = np.array([float(np.linalg.norm(joint.origin)) for joint in robot.joints])
    tip = float(np.linalg.norm(robot.tip_origin))
    torque = np.zeros(robot.dof)
    for j, joint in enumerate(robot.joints):
        # How far the frame of each later link may be from joint j.
        away = np.concatenate([[0.0], np.cumsum(offsets[j + 1 :])])
        if joint.kind == "prismatic":
            torque[j] = _GRAVITY * (masses[j:].sum() + payload)
        else:
            torque[j] = _GRAVITY * (masses[j:] @ (away + centers[j:]) + payload * max(away[-1] + tip, _PAYLOAD_OFFSET))
    return torque


def _masses(robot: SerialChain) -> tuple[FloatArray, FloatArray]:
    """Mass of each link [kg] and how far its centre is from its frame [m], assumed where unknown or implausible."""
    links = [joint.inertia for joint in robot.joints if joint.inertia is not None]
    if len(links) == robot.dof and not robot.inertia_doubts:
        return np.array([link.mass for link in links]), np.array([float(np.linalg.norm(link.center)) for link in links])
    # Of an arm that only slides, its travel is all that tells its size.
    known = robot.turning_reach or robot.reach
    reach = known if math.isfinite(known) else 1.0
    offsets = [joint.origin for joint in robot.joints[1:]] + [robot.tip_origin]
    halves = np.array([float(np.linalg.norm(offset)) / 2 for offset in offsets])
    return np.full(robot.dof, _KG_PER_M2 * reach**2 / robot.dof), halves
