"""The plan of a protocol: which joint moves, from where to where, how fast, how often, and where it is held."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.design.clearance import Clearance, usable_joint_range
from bumpstop.identification.design.gravity_pose import GravityPose, Unobservable, find_gravity_pose
from bumpstop.identification.design.timed_path import PathBuilder, TimedPath, top_speed
from bumpstop.identification.payload.payload import with_payload
from bumpstop.model import gravity_torque, with_rotors
from bumpstop.model.dynamics import STANDARD_GRAVITY, check_free_fall

if TYPE_CHECKING:
    from bumpstop.model import Robot

# Friction shows how it depends on the speed where the fastest strokes are this much faster than the slowest.
MIN_SPEED_RATIO = 1.3
SPEED_SHARES = tuple(tenth / 10 for tenth in range(1, 11))  # table 2.1
# A stroke is of use where its constant speed lasts for this share of the way.
_CONSTANT_SHARE = 0.25
_RAMP_SHARES = (1 / 3, 2 / 3, 1.0)  # of the acceleration
# Of a joint's speed: a curve through rows of a file that lie on the limit would pass it.
_MAX_SHARE = 0.999
_TRAVEL_SHARE = 0.3  # of the joints' speeds, between experiments
_APPROACH_SHARE, _MIN_APPROACH = 0.3, 0.1  # of the joint's speed, before a held pose and into it
_SWING_SHARE = 0.2  # of the speed of the joint that swings
_ROUTE_CHECKS = 60
_ROUTE_TRIES = 400
_SEED = 13


@dataclass(frozen=True, kw_only=True)
class ProtocolSettings:
    """What a plan is made for.

    Attributes:
        speed_shares: of a joint's largest speed (table 2.1: 10 % to 100 %); no motion of the plan is faster than the
            greatest.
        repeats: of every speed in both directions (table 2.1: 15).
        ramp_repeats: of every acceleration in both directions.
        holds: of the hold test from either side; 0: none.
        hold_s: how long a joint is held while another one swings [s].
        acceleration: peak of every ramp [rad/s2].
        half_stroke: most to go to each side of the pose without torque [rad].
        floor: height in the base frame [m], or None.
        radius: of the links' capsules [m].
        min_torque: of gravity at both ends of a stroke [Nm].
        gravity: acceleration of free fall in the base frame [m/s2]; of a tilted base not along -z.
        load_kg: mass fixed to the tip, taken as a point [kg].
        load_m: where, in the tip's frame [m].
    """

    speed_shares: tuple[float, ...] = SPEED_SHARES
    repeats: int = 15
    ramp_repeats: int = 3
    holds: int = 5
    hold_s: float = 50.0
    acceleration: float = 4.5
    half_stroke: float = math.pi / 2
    floor: float | None = 0.0
    radius: float = 0.08
    min_torque: float = 0.5
    gravity: tuple[float, float, float] = STANDARD_GRAVITY
    load_kg: float = 0.0
    load_m: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if not self.speed_shares or not all(0 < share <= 1 for share in self.speed_shares):
            raise InputError("speed_shares", f"{list(self.speed_shares)}", "wanted shares above 0, at most 1")
        for name, low, high in (
            ("repeats", 1, 1000),
            ("ramp_repeats", 0, 1000),
            ("holds", 0, 100),
            ("hold_s", 1, 3600),
            ("acceleration", 0.01, 1000),
            ("half_stroke", math.radians(5), math.pi / 2),
            ("radius", 0, 1),
            ("min_torque", 1e-6, 1e6),
            ("load_kg", 0, 1000),
        ):
            value = getattr(self, name)
            if not low <= value <= high:
                raise InputError(name, f"is {value}", f"wanted {low:g} to {high:g}")
        if self.floor is not None and not math.isfinite(self.floor):
            raise InputError("floor", f"is {self.floor}", "wanted a height [m]")
        if not np.isfinite(self.load_m).all():
            raise InputError("load_m", "is not finite")
        # It is gravity that shows what a current gives: its size becomes that of every gain.
        check_free_fall(self.gravity, "gravity")


@dataclass(frozen=True, kw_only=True, eq=False)
class JointExperiment:
    """What one joint does.

    Attributes:
        joint: its number, from 0.
        name: of the joint.
        pose: of all joints (n,), the moved one where gravity gives it no torque [rad or m].
        low, high: ends of the stroke [rad].
        torque_low, torque_high: of gravity there [Nm].
        clearance: least distance along the stroke to the floor or between parts of the arm [m].
        speeds: of the strokes [rad/s].
        too_fast: shares of the largest speed that this stroke has no room for.
        accelerations: of the strokes that only accelerate and brake [rad/s2].
        hold_joint: that swings while this one is held, from 0; None: there is no hold test.
        swing: of that joint, to one side [rad].
        route: poses (k, n) to go through from home to the start of the stroke, without both ends.
    """

    joint: int
    name: str
    pose: FloatArray
    low: float
    high: float
    torque_low: float
    torque_high: float
    clearance: float
    speeds: tuple[float, ...]
    too_fast: tuple[float, ...]
    accelerations: tuple[float, ...]
    hold_joint: int | None
    swing: float
    route: FloatArray

    def at(self, position: float) -> FloatArray:
        """The pose with the moved joint elsewhere (n,)."""
        pose = self.pose.copy()
        pose[self.joint] = position
        return pose


@dataclass(frozen=True, kw_only=True, eq=False)
class IdentificationPlan:
    """Experiments for the joints whose map gravity can show, and the joints for which it cannot.

    Attributes:
        robot: the bare arm.
        settings: as asked for.
        home: pose (n,) where every trajectory begins and ends [rad or m].
        experiments: by joint.
        unobservable: the other joints.
    """

    robot: Robot
    settings: ProtocolSettings
    home: FloatArray
    experiments: tuple[JointExperiment, ...]
    unobservable: tuple[Unobservable, ...] = field(default=())

    @cached_property
    def loaded(self) -> Robot:
        """The arm as it moves: with the load, without rotors, whose inertia is what the protocol looks for."""
        return loaded_robot(self.robot, self.settings.load_kg, self.settings.load_m)

    def path(self, experiment: JointExperiment) -> TimedPath:
        """From home through strokes, ramps and holds of one joint, and home again."""
        settings, joint = self.settings, experiment.joint
        # Nothing between strokes is faster than they are: whoever asks for slow ones means the whole motion.
        largest, most = self.robot.velocity, min(max(settings.speed_shares), _MAX_SHARE)
        travel = min(_TRAVEL_SHARE, most) * largest
        approach = min(_APPROACH_SHARE, most) * float(largest[joint])
        slow = min(_MIN_APPROACH, most) * float(largest[joint])
        path = PathBuilder(self.home)
        there = [*experiment.route, experiment.at(experiment.high)]
        path.rest(1.0)
        for pose in there:
            path.move_to(pose, travel, settings.acceleration)
        path.rest(1.0)
        for _ in range(settings.repeats):
            for speed in experiment.speeds:
                self._there_and_back(path, experiment, speed, settings.acceleration)
        for _ in range(settings.ramp_repeats):
            for acceleration in experiment.accelerations:
                # As fast as way and strokes allow: in the ideal all of it is ramps.
                self._there_and_back(path, experiment, most * float(largest[joint]), acceleration)
        if experiment.hold_joint is not None:
            middle, swing_speed = (
                float(experiment.pose[joint]),
                min(_SWING_SHARE, most) * largest[experiment.hold_joint],
            )
            for number in range(2 * settings.holds):
                path.stroke(joint, experiment.low if number % 2 else experiment.high, approach, settings.acceleration)
                path.stroke(joint, middle, slow, settings.acceleration)
                self._swing(path, experiment.hold_joint, experiment.swing, float(swing_speed))
        path.move_to(experiment.at(experiment.high), travel, settings.acceleration)
        for pose in [*reversed(there[:-1]), self.home]:
            path.move_to(pose, travel, settings.acceleration)
        path.rest(1.0)
        return path.build()

    def _there_and_back(
        self, path: PathBuilder, experiment: JointExperiment, speed: float, acceleration: float
    ) -> None:
        for end in (experiment.low, experiment.high):
            path.stroke(experiment.joint, end, speed, acceleration)
            path.rest(0.3)

    def _swing(self, path: PathBuilder, joint: int, swing: float, speed: float) -> None:
        begin = path.duration
        middle = float(path.q[joint])
        side = 1
        while path.duration - begin < self.settings.hold_s:
            path.stroke(joint, middle + side * swing, speed, self.settings.acceleration)
            side = -side
        path.stroke(joint, middle, speed, self.settings.acceleration)


def plan_identification(robot: Robot, settings: ProtocolSettings | None = None) -> IdentificationPlan:
    """Plan Schroeder's protocol for an arm: table 2.1, ramps for the reflected inertia, the hold test.

    Args:
        robot: with inertia, published or assumed: it decides where gravity loads a joint, not what is found.
        settings: default: those of Schroeder (2013).

    Raises:
        InputError: no inertia, a joint without a largest speed, speeds too much alike to show how friction depends on
            them, or no pose that is clear of the floor.
    """
    settings = settings or ProtocolSettings()
    if max(settings.speed_shares) < MIN_SPEED_RATIO * min(settings.speed_shares):
        shares = ", ".join(f"{100 * share:g} %" for share in settings.speed_shares)
        raise InputError(
            "speed_shares",
            f"{shares}: speeds so alike show no friction that depends on speed",
            f"wanted two at least, the fastest {MIN_SPEED_RATIO:g} times the slowest",
        )
    arm = loaded_robot(robot, settings.load_kg, settings.load_m)
    for joint in robot.joints:
        if not math.isfinite(joint.velocity):
            raise InputError(f"joint {joint.name!r} velocity", "is not stated", "the plan needs every joint's limit")
    clearance = Clearance(arm, settings.floor, settings.radius)
    home = _home(arm, clearance)
    experiments: list[JointExperiment] = []
    unobservable: list[Unobservable] = []
    for number in range(robot.dof):
        found = find_gravity_pose(
            arm,
            number,
            clearance,
            gravity=settings.gravity,
            half_stroke=settings.half_stroke,
            min_torque=settings.min_torque,
        )
        if isinstance(found, Unobservable):
            unobservable.append(found)
            continue
        experiment = _experiment(arm, found, settings, clearance, home)
        if isinstance(experiment, Unobservable):
            unobservable.append(experiment)
        else:
            experiments.append(experiment)
    return IdentificationPlan(
        robot=robot, settings=settings, home=home, experiments=tuple(experiments), unobservable=tuple(unobservable)
    )


def loaded_robot(robot: Robot, load_kg: float, load_m: tuple[float, float, float]) -> Robot:
    """The arm with a point mass at its tip and without rotors."""
    arm = with_rotors(robot, 0.0)
    return with_payload(arm, load_kg, load_m) if load_kg > 0 else arm


def _experiment(
    arm: Robot, found: GravityPose, settings: ProtocolSettings, clearance: Clearance, home: FloatArray
) -> JointExperiment | Unobservable:
    joint = found.joint
    name, largest = arm.joints[joint].name, arm.joints[joint].velocity
    top = top_speed(found.high - found.low, settings.acceleration, _CONSTANT_SHARE)
    speeds = tuple(min(share, _MAX_SHARE) * largest for share in settings.speed_shares if share * largest <= top)
    if len(speeds) < 2:
        return Unobservable(
            joint,
            name,
            f"its stroke of {math.degrees(found.high - found.low):.0f} deg has room for {len(speeds)} of the speeds",
            "slower speeds, or a higher acceleration",
        )
    start = found.pose.copy()
    start[joint] = found.high
    route = _route(arm, clearance, home, start)
    if route is None:
        return Unobservable(
            joint, name, "no way from home to its stroke is clear", "a higher base, or slimmer capsules"
        )
    hold_joint, swing = _hold_joint(arm, found, settings, clearance) if settings.holds else (None, 0.0)
    return JointExperiment(
        joint=joint,
        name=name,
        pose=found.pose,
        low=found.low,
        high=found.high,
        torque_low=found.torque_low,
        torque_high=found.torque_high,
        clearance=found.clearance,
        speeds=speeds,
        too_fast=tuple(share for share in settings.speed_shares if share * largest > top),
        accelerations=tuple(share * settings.acceleration for share in _RAMP_SHARES),
        hold_joint=hold_joint,
        swing=swing,
        route=route,
    )


def _hold_joint(
    arm: Robot, found: GravityPose, settings: ProtocolSettings, clearance: Clearance
) -> tuple[int | None, float]:
    """The joint whose swing changes the held joint's torque least; of equals the one nearest the tip."""
    low, high = usable_joint_range(arm, math.radians(5))
    best: tuple[float, int | None, float] = (math.inf, None, 0.0)
    for other in reversed(range(arm.dof)):
        if other == found.joint or arm.joints[other].kind == "prismatic":
            continue
        middle = found.pose[other]
        swing = min(math.radians(30), middle - low[other], high[other] - middle)
        if swing < math.radians(10):
            continue
        poses = np.repeat(found.pose[None], 21, axis=0)
        poses[:, other] = np.linspace(middle - swing, middle + swing, 21)
        if float(clearance.least(poses).min()) <= 0:
            continue
        change = float(np.ptp(gravity_torque(arm, poses, gravity=settings.gravity)[:, found.joint]))
        if change < best[0] - 1e-6:
            best = (change, other, swing)
    return best[1], best[2]


def _home(arm: Robot, clearance: Clearance) -> FloatArray:
    """The clearest of many poses; the zero pose where it is nearly as clear, as people know it."""
    low, high = usable_joint_range(arm, math.radians(10))
    rng = np.random.default_rng(_SEED)
    poses = rng.uniform(low, high, size=(_ROUTE_TRIES * 5, arm.dof))
    revolute = [joint.kind == "revolute" for joint in arm.joints]
    lattice = np.radians(15)
    poses = np.where(revolute, np.clip(np.round(poses / lattice) * lattice, low, high), poses)
    poses[0] = np.clip(0.0, low, high)
    least = np.minimum(clearance.least(poses), 0.25)
    if least.max() <= 0:
        raise InputError("floor", f"no pose of {arm.name} is clear of it", "a lower floor, or a smaller radius")
    # Among the clearest the one with the least turning from the middle of the joints.
    turned = np.abs(poses - (low + high) / 2).sum(axis=1)
    home: FloatArray = poses[0] if least[0] > 0.05 else poses[np.lexsort((turned, -np.round(least, 2)))[0]]
    return home


def _route(arm: Robot, clearance: Clearance, begin: FloatArray, end: FloatArray) -> FloatArray | None:
    """Poses between two poses such that straight moves in joint space keep clear; None: none was found."""

    def clear(a: FloatArray, b: FloatArray) -> bool:
        return float(clearance.least(np.linspace(a, b, _ROUTE_CHECKS)).min()) > 0

    if clear(begin, end):
        return np.empty((0, arm.dof))
    low, high = usable_joint_range(arm, math.radians(5))
    rng = np.random.default_rng(_SEED)
    middle = rng.uniform(low, high, size=(_ROUTE_TRIES, arm.dof))
    middle = middle[clearance.least(middle) > 0]
    longer = np.abs(middle - begin).max(axis=1) + np.abs(middle - end).max(axis=1)
    middle = middle[np.argsort(longer, kind="stable")]
    from_begin = [bool(clear(begin, pose)) for pose in middle]
    to_end = [bool(clear(pose, end)) for pose in middle]
    for first, second, pose in zip(from_begin, to_end, middle, strict=True):
        if first and second:
            return np.asarray(pose[None])
    starts, ends = middle[from_begin][:40], middle[to_end][:40]
    for a in starts:
        for b in ends:
            if clear(a, b):
                return np.stack([a, b])
    return None
