"""Experiments: the file a person writes, read strictly."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
from pydantic import Field, ValidationError, model_validator

from bumpstop.collision.scenario.scenario_words import as_written
from bumpstop.collision.stopping.deceleration import Deceleration
from bumpstop.errors import InputError, near_matches
from bumpstop.joint import JointTorqueModel
from bumpstop.model import Robot
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.plant.command import Command, PlantReaction, along, line
from bumpstop.plant.drive import Gears
from bumpstop.plant.experiment_tables import (
    TABLES,
    ExperimentFriction,
    ExperimentMotion,
    ExperimentObject,
    ExperimentReaction,
    ExperimentSensors,
    ExperimentServo,
    ExperimentTable,
    Three,
)
from bumpstop.plant.motions import pick_and_place, press, workspace
from bumpstop.plant.objects import PlantObject
from bumpstop.plant.plant import Plant
from bumpstop.plant.sample import Sample
from bumpstop.plant.sensors import Sensors
from bumpstop.plant.servo import Servo
from bumpstop.text_files import as_path, is_path, parse_toml, read_text

if TYPE_CHECKING:
    from bumpstop.plant.run import PlantRun

_MAX_BYTES = 1_000_000


class Experiment(ExperimentTable):
    """One experiment on the plant. The attributes are the keys of the file, in the file's units.

    The page docs/reference/robot/plant.md lists them.
    """

    robot: str
    base: str | None = None
    tip: str | None = None
    joint_model: str | None = None
    pose_deg: list[float] | None = None
    pose_rad: list[float] | None = None
    seed: Annotated[int, Field(ge=0, lt=2**63)] = 0
    gravity_m_s2: Three = Field(default=list(STANDARD_GRAVITY))
    contact_link: str | None = None
    contact_point_mm: Three = Field(default=[0.0, 0.0, 0.0])
    motion: ExperimentMotion | None = None
    friction: ExperimentFriction = ExperimentFriction()
    sensors: ExperimentSensors = ExperimentSensors()
    servo: ExperimentServo = ExperimentServo()
    object: list[ExperimentObject] = Field(default=[])
    reaction: ExperimentReaction | None = None
    folder: Annotated[Path, Field(exclude=True)] = Path()

    @model_validator(mode="after")
    def _pose(self) -> Experiment:
        given = [key for key in ("pose_deg", "pose_rad") if getattr(self, key) is not None]
        if self.motion is None:
            return self
        if self.motion.kind in ("line", "press", "pick_and_place"):
            if len(given) != 1:
                problem = "and pose_rad are both given" if given else "is missing"
                raise InputError("pose_deg", problem, "give pose_deg or pose_rad, one of them")
        elif given:
            raise InputError(given[0], f'has no meaning with motion.kind = "{self.motion.kind}"', "leave it out")
        return self

    @classmethod
    def load(cls, path: str | Path) -> Experiment:
        """Read an experiment file.

        Raises:
            InputError: the file is absent or damaged, or a key is unknown, missing or has an unusable value.
        """
        path = as_path(path, "path")
        data = parse_toml(read_text(path, "wanted an experiment file", max_bytes=_MAX_BYTES), str(path))
        return cls.from_dict(data, path.parent)

    @classmethod
    def from_dict(cls, data: dict[str, Any], folder: Path | str = ".") -> Experiment:
        """Check an experiment given as nested dictionaries; ``folder`` is where relative paths in it start.

        Raises:
            InputError: a key is unknown, missing or has a value that cannot be used.
        """
        if not isinstance(data, dict) or "folder" in data:
            raise InputError("folder" if isinstance(data, dict) else "experiment", "is not a key of an experiment")
        try:
            return cls.model_validate({**data, "folder": Path(folder)})
        except ValidationError as error:
            refusal = _explain(error)
        # Not while pydantic's error is handled, as in Scenario.from_dict: it would never be freed.
        raise refusal

    def files(self) -> list[Path]:
        """Those that are read with it; names of what is built in are among them, as if they were files."""
        reaction = self.reaction
        named = [self.robot, self.joint_model, *(thing.limits for thing in self.object)]
        named += [None if self.motion is None else self.motion.file]
        named += [None if reaction is None else reaction.stopping_table]
        return [self.folder / name for name in named if name is not None]

    def arm(self) -> Robot:
        """The robot.

        Raises:
            InputError: there is none of that name, or its file cannot be used.
        """
        if is_path(self.robot):
            return Robot.from_urdf(self.folder / self.robot, self.base, self.tip)
        return Robot.load(self.robot)

    def prepare(self) -> tuple[Plant, Command]:
        """The plant and what it is told to do.

        Raises:
            InputError: something cannot be used with this robot.
        """
        robot = self.arm()
        command = self._command(robot)
        objects = [self._object(robot, i) for i in range(len(self.object))]
        return self.plant(robot, gravity=self.gravity_m_s2, seed=self.seed, objects=objects), command

    def plant(self, robot: Robot, *, gravity: Sequence[float], seed: int, objects: Sequence[PlantObject] = ()) -> Plant:
        """The plant of another arm or gravity, with this joint model, friction, sensors and servo.

        Raises:
            InputError: something cannot be used with this robot.
        """
        model = None
        if self.joint_model is not None:
            path = self.folder / self.joint_model
            is_file = self.joint_model.endswith(".toml") or "/" in self.joint_model
            model = JointTorqueModel.load(path if is_file else self.joint_model)
        friction, sensors, servo = self.friction, self.sensors, self.servo
        return Plant(
            robot,
            model,
            friction=Gears(
                rotor_inertia=friction.rotor_inertia_kg_m2,
                load_share=friction.load_share,
                stribeck=friction.stribeck_Nm,
                stribeck_speed=friction.stribeck_speed_rad_s,
                ripple=friction.ripple_Nm,
                ripple_per_turn=friction.ripple_per_turn,
                presliding=friction.presliding_rad,
                stiffness=friction.stiffness_Nm_rad,
                damping_ratio=friction.damping_ratio,
                damping=friction.damping_Nm_s_rad,
                scatter=friction.scatter,
                scatter_per=friction.scatter_per,
            ),
            sensors=Sensors(
                rate_hz=sensors.rate_hz,
                jitter_s=sensors.jitter_s,
                loss=sensors.loss,
                position_noise=sensors.position_noise_rad,
                position_step=sensors.position_step_rad,
                current_noise=sensors.current_noise,
                current_step=sensors.current_step,
                force_noise=sensors.force_noise_N,
                moment_noise=sensors.moment_noise_Nm,
            ),
            objects=objects,
            seed=seed,
            servo=Servo(
                bandwidth_hz=servo.bandwidth_hz,
                damping_ratio=servo.damping_ratio,
                velocity_bandwidth=servo.velocity_bandwidth_rad_s,
                position_gain=servo.position_gain_1_s,
                torque_limit=servo.torque_limit_Nm,
                acceleration_feedforward=servo.acceleration_feedforward,
            ),
            contact_link=self.contact_link,
            contact_point=[x / 1e3 for x in self.contact_point_mm],
            gravity=gravity,
        )

    def run(self) -> PlantRun:
        """Prepare and run it.

        Raises:
            InputError: as :meth:`prepare`.
        """
        return self.run_on(*self.prepare())

    def run_on(self, plant: Plant, command: Command) -> PlantRun:
        """Run it on what :meth:`prepare` gave.

        Of every object that is touched the truth gets the series stiffness where that happened first.
        """
        reaction = self.reaction
        answer = self.reaction_of(plant.robot)

        def watch(sample: Sample) -> PlantReaction | None:
            if reaction is None or float(np.linalg.norm(sample.wrench[:3])) <= reaction.force_N:
                return None
            return answer

        run = plant.run(command, on_sample=None if reaction is None else watch)
        for i, thing in enumerate(plant.objects):
            touched = np.flatnonzero(run.trace.contact_force[:, i] > 0)
            if touched.size:
                stiffness = plant.series_stiffness(run.trace.q[touched[0]], thing)
                run.truth["object"][i]["series_stiffness_N_m"] = stiffness
        return run

    def reaction_of(self, robot: Robot) -> PlantReaction:
        """How the arm reacts once something asks it to; the default where the experiment has no ``[reaction]``.

        Raises:
            InputError: its table of decelerations cannot be used with this robot.
        """
        given = self.reaction
        if given is None:
            return PlantReaction()
        return PlantReaction(
            kind=given.kind,
            joint_acceleration=given.joint_acceleration_rad_s2,
            latency_s=given.latency_s + given.dead_time_s,
            deceleration=Deceleration.of(given, self.folder, robot),
        )

    def _start(self, robot: Robot) -> np.ndarray[Any, np.dtype[np.float64]]:
        given = self.pose_rad if self.pose_deg is None else self.pose_deg
        key = "pose_rad" if self.pose_deg is None else "pose_deg"
        assert given is not None
        if len(given) != robot.dof:
            raise InputError(key, f"has {len(given)} values", f"{robot.name} has {robot.dof} joints")
        pose = np.array(given, dtype=np.float64)
        if self.pose_deg is not None:
            turns = [joint.kind == "revolute" for joint in robot.joints]
            pose = np.where(turns, np.radians(pose), pose)
        return pose

    def _velocity(self) -> list[float]:
        assert self.motion is not None
        assert self.motion.velocity_mm_s is not None
        return [v / 1e3 for v in self.motion.velocity_mm_s]

    def _command(self, robot: Robot) -> Command:
        motion = self.motion
        if motion is None:
            raise InputError("motion", "is missing", "an experiment needs it, or a plan (--plan)")
        if motion.kind == "trajectory":
            from bumpstop.collision.trajectory.trajectory import load_motion

            assert motion.file is not None
            return along(load_motion(self.folder / motion.file, robot), robot, hold=motion.hold_s)
        if motion.kind in ("workspace_1", "workspace_2"):
            return workspace(robot, int(motion.kind[-1]))
        pose = self._start(robot)
        if motion.kind == "pick_and_place":
            return pick_and_place(robot, pose, [x / 1e3 for x in motion.offset_mm])
        if motion.kind == "press":
            assert motion.way_mm is not None
            return press(
                robot,
                pose,
                self._velocity(),
                way=motion.way_mm / 1e3,
                joint_acceleration=motion.joint_acceleration_rad_s2,
                held_joints=motion.held_joints,
            )
        assert motion.duration_s is not None
        return line(
            robot,
            pose,
            self._velocity(),
            duration=motion.duration_s,
            start=motion.start,
            task=motion.task,
            held_joints=motion.held_joints,
            joint_acceleration=motion.joint_acceleration_rad_s2,
            hold=motion.hold_s,
        )

    def _object(self, robot: Robot, i: int) -> PlantObject:
        thing, where = self.object[i], f"object[{i + 1}]"
        straight = self.motion is not None and self.motion.kind in ("line", "press")
        if (thing.position_mm is None) == (thing.ahead_mm is None):
            problem = "is missing" if thing.position_mm is None else "and ahead_mm are both given"
            raise InputError(f"{where}.position_mm", problem, "give position_mm, or ahead_mm along a line")
        if thing.ahead_mm is not None and not straight:
            raise InputError(f"{where}.ahead_mm", "needs a straight motion", "give position_mm and normal")
        normal = thing.normal
        if normal is None:
            if not straight:
                raise InputError(f"{where}.normal", "is missing", "wanted the direction the object yields in")
            normal = self._velocity()
        if thing.ahead_mm is not None:
            way = np.array(self._velocity())
            point = [x / 1e3 for x in self.contact_point_mm]
            begin = robot.pose(self._start(robot), self.contact_link, point)[:3, 3]
            position = begin + way / np.linalg.norm(way) * thing.ahead_mm / 1e3
        else:
            assert thing.position_mm is not None
            position = np.array(thing.position_mm) / 1e3
        limits = thing.limits if "limits" in thing.model_fields_set else None
        if limits is not None and (limits.endswith(".toml") or "/" in limits):
            limits = str(self.folder / limits)
        more: dict[str, Any] = {} if thing.mass_kg is None else {"mass": thing.mass_kg}
        more |= {} if thing.body_mass_kg is None else {"body_mass": thing.body_mass_kg}
        alone = sum(other.kind == thing.kind for other in self.object) == 1
        return PlantObject.of(
            thing.kind,
            name=thing.name or (thing.kind if alone else f"{thing.kind} {i + 1}"),
            position=position.tolist(),
            normal=normal,
            stiffness=thing.stiffness_N_m,
            limits=limits,
            size=(thing.size_mm[0] / 2e3, thing.size_mm[1] / 2e3),
            **more,
        )


def _explain(error: ValidationError) -> InputError:
    """Pydantic's first complaint as one sentence; an unknown key comes first, as it often explains a missing one."""
    details = error.errors()
    first = next((detail for detail in details if detail["type"] == "extra_forbidden"), details[0])
    keys = [part for part in first["loc"] if part == first["loc"][0] or (isinstance(part, str) and part.isidentifier())]
    number = next((part for part in first["loc"][1:2] if isinstance(part, int)), None)
    table = TABLES.get(str(keys[0])) if len(first["loc"]) > 1 else None
    # Behind the key pydantic names the branches of ``number | list``.
    depth = 1 if table is None else 2
    names = [str(key) for key in keys[:depth]]
    if number is not None and table is not None:
        names[0] += f"[{number + 1}]"
    field = ".".join(names)
    if first["type"] == "extra_forbidden":
        model: type[ExperimentTable] = Experiment if table is None else table
        known = [name for name in model.model_fields if name != "folder"]
        return InputError(field, "is not a key of an experiment", near_matches(names[-1].split("[")[0], known))
    if first["type"] == "value_error":
        cause: InputError = first["ctx"]["error"]
        return InputError(cause.field, cause.problem, cause.valid)
    if first["type"] == "missing":
        return InputError(field, "is missing", "an experiment needs it")
    wanted = first["msg"].replace("Input should be ", "wanted ")
    wanted = wanted.replace("a valid integer", "a whole number").replace("a valid ", "a ")
    wanted = wanted[0].lower() + wanted[1:]
    return InputError(field, f"{as_written(first['input'])} cannot be used", wanted)
