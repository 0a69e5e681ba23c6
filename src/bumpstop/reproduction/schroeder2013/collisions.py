"""Schroeder's collisions of chapter 4 on the plant: its speeds, thresholds and objects, with our detector."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from importlib import resources
from typing import Any, Literal, get_args

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_number
from bumpstop.detection import (
    DetectionRun,
    Detector,
    DetectorSettings,
    Thresholds,
    largest_undetected_force,
    largest_undetected_torque,
)
from bumpstop.detection.detection_run import STATES
from bumpstop.errors import InputError, near_matches
from bumpstop.joint import JointTorqueModel, Parameter
from bumpstop.model import Robot
from bumpstop.plant.command import Command, PlantReaction, line
from bumpstop.plant.drive import Gears, ScatterPer
from bumpstop.plant.objects import PlantObject
from bumpstop.plant.plant import Plant
from bumpstop.plant.run import PlantRun
from bumpstop.plant.sample import Sample
from bumpstop.plant.sensors import Sensors

Where = Literal["hand", "elbow", "forearm"]
Residual = Literal["direct", "observer"]

# Schroeder's pose, in the joints of the public description.
POSE = np.radians([0, 30, 0, -20, 0, -40, 0])
# Nobody has published the rotors: of the order of a harmonic drive's motor behind its gear.
ROTORS = (1.0, 1.0, 0.5, 0.35, 0.15, 0.15, 0.05)
SENSORS = Sensors(rate_hz=250.0, position_step=1e-6)
PERIOD_S = 0.004
_WINDOW_S = 7 * PERIOD_S  # of the derivatives: short, as Schroeder (2013) differentiates
ARMING_S = 0.5
# Speeds of the hand [m/s].
MIN_SPEED, MAX_SPEED = 1e-3, 0.25
# Free way before contact: the motion is judged from ARMING_S on.
_FREE_S = 0.6
_FREE_M = 0.005
_DOWN = np.array([0.0, 0.0, -1.0])
_HELD = (7,)


@dataclass(frozen=True, kw_only=True)
class SourceRow:
    """One speed of a table, over the runs that Schroeder (2013) made at it; None: not given or not measurable.

    Attributes:
        speed_mm_s: of the hand.
        torque_Nm: of joint 2 at detection.
        force_N: at detection.
        peak_N: greatest force.
        false_alarms: runs that alarmed before contact.
        runs: how many.
    """

    speed_mm_s: float
    torque_Nm: float | None
    force_N: float | None
    peak_N: float | None
    false_alarms: int
    runs: int

    @property
    def detected(self) -> bool:
        """Whether Schroeder (2013) detected every contact at this speed."""
        return self.false_alarms == 0


def experiments() -> tuple[str, ...]:
    """Names of Schroeder's experiments."""
    return tuple(_tables())


@lru_cache(maxsize=1)
def _tables() -> dict[str, Any]:
    text = (resources.files("bumpstop.reproduction.schroeder2013") / "collisions.toml").read_text(encoding="utf-8")
    return tomllib.loads(text)


@dataclass(frozen=True, eq=False, kw_only=True)
class Collision:
    """One run into an object.

    Attributes:
        speed: of the hand [m/s].
        seed: of the run.
        run: of the plant.
        detection: of the detector over the recording, as it judged while the arm moved.
        contact_s: first contact [s], or None.
        alarm_s: sample at which the detector fired [s], or None.
        joints: over their threshold then, from 0.
        force: on the object at the alarm [N].
        torque: residual of joint 2 at the alarm [Nm].
        peak: greatest force [N].
    """

    speed: float
    seed: int
    run: PlantRun
    detection: DetectionRun
    contact_s: float | None
    alarm_s: float | None
    joints: tuple[int, ...]
    force: float | None
    torque: float | None
    peak: float

    @property
    def detected(self) -> bool:
        """An alarm while the arm touched."""
        return self.alarm_s is not None and self.contact_s is not None and self.alarm_s >= self.contact_s

    @property
    def false_alarm(self) -> bool:
        """An alarm before it touched."""
        return self.alarm_s is not None and not self.detected

    @property
    def delay(self) -> float | None:
        """From contact to alarm [s]."""
        return self.alarm_s - self.contact_s if self.detected and self.alarm_s and self.contact_s else None


@dataclass(frozen=True, kw_only=True)
class CollisionExperiment:
    """The arm of Schroeder (2013) runs into an object, detects, stops and goes back.

    The arm is the SIA5D with the friction of table 2.2 and rotors that are planted. The contact pose is Schroeder's;
    the hand moves down to it from rest. What a run draws from its seed: where within one feedback period of travel the
    object stands, the scatter of friction and the noise of sensors.

    Attributes:
        name: of a table of Schroeder (2013).
        at: what is hit. The elbow is the joint of the forearm; the forearm's point is half way to the wrist.
        stiffness: of the object [N/m]; None: that of the plant's object of this name.
        latency_s: from the sample that alarms to the reaction.
        residual: of the detector; Schroeder's is direct.
        reflected_inertia: whether the detector's joint model has the rotors. Schroeder (2013) left them out.
        joint_acceleration: of the reaction and of the start [rad/s2].
        loss: share of samples that get lost.
        scatter_per: how the friction of table 2.2 scatters: once for each ``"motion"``, as it was found there from one
            figure for each of 300 motions, or anew at every ``"sample"``.
    """

    name: str
    at: Where = "hand"
    stiffness: float | None = None
    latency_s: float = PERIOD_S
    residual: Residual = "direct"
    reflected_inertia: bool = True
    joint_acceleration: float = 4.5
    loss: float = 0.0
    scatter_per: ScatterPer = "motion"

    def __post_init__(self) -> None:
        if self.name not in _tables():
            raise InputError(
                "experiment",
                f"{self.name!r} is no experiment of Schroeder (2013)",
                near_matches(self.name, experiments()),
            )
        kinds_of = {"at": get_args(Where), "residual": get_args(Residual), "scatter_per": get_args(ScatterPer)}
        for field, kinds in kinds_of.items():
            if (value := getattr(self, field)) not in kinds:
                raise InputError(field, f"{value!r} is none", near_matches(str(value), kinds))
        for field, low, high in (("latency_s", 0, 1), ("joint_acceleration", 0.1, 1e3), ("loss", 0, 0.9)):
            if not low <= as_number(getattr(self, field), field) <= high:
                raise InputError(field, f"is {getattr(self, field)}", f"wanted {low:g} to {high:g}")
        if self.stiffness is not None and not 100 <= as_number(self.stiffness, "stiffness") <= 1e7:
            raise InputError("stiffness", f"is {self.stiffness}", "wanted 100 to 10000000")

    # --- What Schroeder (2013) has ------------------------------------------------------------------------------------

    @property
    def table(self) -> str:
        """Where Schroeder (2013) has it."""
        return str(_tables()[self.name]["source"])

    @property
    def thresholds(self) -> FloatArray:
        """(7,) [Nm]; infinite: not monitored."""
        return np.array(_tables()[self.name]["thresholds_Nm"], dtype=np.float64)

    def rows(self) -> tuple[SourceRow, ...]:
        """Schroeder's figures by speed; means where it repeated a speed."""
        table = _tables()[self.name]
        speeds = np.array(table["speed_mm_s"])
        found = []
        for speed in dict.fromkeys(table["speed_mm_s"]):
            which = speeds == speed
            means: dict[str, float | None] = {}
            for key in ("torque_Nm", "force_N", "peak_N"):
                values = np.array(table.get(key, [np.nan] * len(speeds)))[which]
                means[key] = float(values.mean()) if np.isfinite(values).all() else None
            alarms = int(np.array(table.get("false_alarm", [False] * len(speeds)))[which].sum())
            found.append(
                SourceRow(
                    speed_mm_s=float(speed),
                    torque_Nm=means["torque_Nm"],
                    force_N=means["force_N"],
                    peak_N=means["peak_N"],
                    false_alarms=alarms,
                    runs=int(which.sum()),
                )
            )
        return tuple(found)

    # --- Parts --------------------------------------------------------------------------------------------------

    @cached_property
    def robot(self) -> Robot:
        """The arm."""
        return Robot.load("sia5d")

    @cached_property
    def _place(self) -> tuple[str | None, tuple[float, float, float]]:
        """Link that is hit, and where in its frame [m]."""
        if self.at == "hand":
            return None, (0.0, 0.0, 0.0)
        if self.at == "elbow":
            return "link_u", (0.0, 0.0, 0.0)
        x, y, z = (0.5 * value for value in self.robot.joints[4].origin)
        return "link_u", (x, y, z)

    def detector(self) -> Detector:
        """Of Schroeder's thresholds and arming delay."""
        link, point = self._place
        model = JointTorqueModel.load("sia5d")
        if self.reflected_inertia:
            joints = [
                replace(joint, parameters={**joint.parameters, "inertia": Parameter(rotor)})
                for joint, rotor in zip(model.joints, ROTORS, strict=False)
            ]
            model = replace(model, joints=tuple(joints))
        settings = DetectorSettings(
            residual=self.residual,
            arming_delay_s=ARMING_S,
            period_s=PERIOD_S,
            window_s=_WINDOW_S,
            link=link,
            point=point,
            direction=(float(self._normal[0]), float(self._normal[1]), float(self._normal[2])),
        )
        return Detector(self.robot, model, Thresholds(self.thresholds), settings)

    @cached_property
    def _slide(self) -> FloatArray:
        """Velocity of what is hit per speed of the hand, in the contact pose (3,)."""
        free = [j for j in range(self.robot.dof) if j + 1 not in _HELD]
        target = np.concatenate([_DOWN, np.zeros(3)])
        rates = np.zeros(self.robot.dof)
        rates[free] = np.linalg.lstsq(self.robot.jacobian(POSE)[:, free], target, rcond=None)[0]
        velocity: FloatArray = self.robot.jacobian(POSE, *self._place)[:3] @ rates
        return velocity

    @property
    def _normal(self) -> FloatArray:
        normal: FloatArray = self._slide / np.linalg.norm(self._slide)
        return normal

    def lever(self) -> FloatArray:
        """(7,) torque of every joint per newton along the motion of what is hit, in the contact pose [Nm/N]."""
        lever: FloatArray = self.robot.jacobian(POSE, *self._place)[:3].T @ self._normal
        return lever

    def object(self, depth: float = 0.0) -> PlantObject:
        """What is hit, ``depth`` metres beyond where the contact pose is."""
        touch = self.robot.pose(POSE, *self._place)[:3, 3] + depth * self._normal
        return PlantObject.of(
            self.name, position=touch.tolist(), normal=self._normal.tolist(), stiffness=self.stiffness
        )

    def threshold_force(self) -> float:
        """Force at which the first joint reaches its threshold, without noise [N]."""
        return float(largest_undetected_force(self.thresholds, self.lever()).min())

    def force_bound(self, speed: float) -> float:
        """Largest force that may go undetected at a speed of the hand [m/s]: eqs 4.2 to 4.4 [N].

        The torque grows by the lever times stiffness times the speed of what is hit.
        """
        growth = self.lever() * self.object().stiffness * speed * float(np.linalg.norm(self._slide))
        torque = largest_undetected_torque(self.thresholds, growth, PERIOD_S)
        return float(largest_undetected_force(torque, self.lever()).min())

    # --- Running ------------------------------------------------------------------------------------------------

    def command(self, speed: float) -> Command:
        """From rest through the contact pose, far enough to pass the bound of the force; ``speed`` in m/s."""
        robot = self.robot
        free = _FREE_S * speed + _FREE_M
        back = line(robot, POSE, tuple((-speed * _DOWN).tolist()), duration=free / speed, held_joints=_HELD)
        into = 2.0 * self.force_bound(speed) / self.object().stiffness / float(np.linalg.norm(self._slide)) + 0.002
        begin = back.q[-1]
        # A tenth of a second more makes up for the distance that is missing while the arm gathers speed.
        duration = (free + into) / speed + 0.1
        return line(
            robot,
            begin,
            tuple((speed * _DOWN).tolist()),
            duration=duration,
            start="rest",
            joint_acceleration=self.joint_acceleration,
            held_joints=_HELD,
        )

    def _plant(self, seed: int, objects: list[PlantObject]) -> Plant:
        return Plant(
            self.robot,
            JointTorqueModel.load("sia5d"),
            friction=Gears(rotor_inertia=list(ROTORS), scatter_per=self.scatter_per),
            sensors=replace(SENSORS, loss=self.loss),
            objects=objects,
            seed=seed,
            contact_link=self._place[0],
            contact_point=self._place[1],
        )

    def free(self, speed: float, seeds: Sequence[int]) -> list[PlantRun]:
        """The same motion without object and reaction, for several seeds; ``speed`` of the hand in m/s."""
        plant = self._plant(0, [])
        return plant.runs(self.command(speed), [(plant.sensors, seed) for seed in seeds])

    def plant(self, speed: float, seed: int = 0) -> Plant:
        """The arm and the object, as :meth:`run` has them: where it stands is drawn within one period of travel.

        Args:
            speed: of the hand [m/s].
            seed: of everything random.

        Raises:
            InputError: the speed cannot be used, mujoco is not installed.
        """
        if not MIN_SPEED <= as_number(speed, "speed") <= MAX_SPEED:
            raise InputError("speed", f"is {speed:g} m/s", f"wanted {MIN_SPEED:g} to {MAX_SPEED:g}")
        rng = np.random.default_rng([6, seed])
        offset = float(rng.random()) * speed * PERIOD_S * float(np.linalg.norm(self._slide))
        return self._plant(seed, [self.object(offset)])

    def run(self, speed: float, seed: int = 0) -> Collision:
        """Run once.

        Args:
            speed: of the hand [m/s].
            seed: of everything random.

        Raises:
            InputError: the speed cannot be used, mujoco is not installed.
        """
        plant = self.plant(speed, seed)
        detector = self.detector()
        kernel = detector.kernel()
        alarm = _native.DetectorState(STATES.index("alarm"))
        answer = PlantReaction(joint_acceleration=self.joint_acceleration, latency_s=self.latency_s)
        still = np.zeros(self.robot.dof)
        fired: list[tuple[float, int, float]] = []

        def watch(sample: Sample) -> PlantReaction | None:
            found = kernel.update(sample.t, sample.q, sample.current, still)
            if found.state != alarm:
                return None
            fired.append((sample.t, found.over, found.residual[1]))
            return answer

        done = plant.run(self.command(speed), on_sample=watch)
        force = done.trace.contact_force[:, 0]
        touched = np.flatnonzero(force > 0)
        contact = float(done.trace.t[touched[0]]) if touched.size else None
        at = fired[0] if fired else None
        return Collision(
            speed=speed,
            seed=seed,
            run=done,
            detection=detector.run(done.recording),
            contact_s=contact,
            alarm_s=at[0] if at else None,
            joints=tuple(j for j in range(self.robot.dof) if at and at[1] >> j & 1),
            force=float(np.interp(at[0], done.trace.t, force)) if at else None,
            torque=at[2] if at else None,
            peak=float(force.max()),
        )
