"""The plant: an arm in MuJoCo with controller, motors, gears, sensors and things to hit."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.errors import InputError
from bumpstop.model import Robot, gravity_torque, inverse_dynamics, mass_matrix, with_rotors
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.plant.command import COMMAND_STEP, MAX_LATENCY_S, Command, PlantReaction
from bumpstop.plant.drive import Drives, Gears, per_joint
from bumpstop.plant.mjcf import import_mujoco, mjcf
from bumpstop.plant.objects import ObjectForces, PlantObject
from bumpstop.plant.run import PlantRun, PlantTrace, SampleLog, sensors_truth, truth_of
from bumpstop.plant.sample import OnSample, Sample
from bumpstop.plant.sensors import Channels, SamplePlan, Sensors
from bumpstop.plant.servo import PER_COMMAND, STEP, Servo, between
from bumpstop.plant.static_push import series_stiffness

if TYPE_CHECKING:
    from bumpstop.joint import JointTorqueModel

# A reaction may outlast its motion by so much, beyond its latency; samples are planned for it.
_AFTERWARDS_S = 5.0


class Plant:
    """An arm to experiment on.

    Args:
        robot: with the inertia of every link.
        joint_model: how current becomes torque; None: a current of 1 is 1 Nm, without friction.
        friction: what the gears do beyond it.
        sensors: of the controller.
        objects: to press on or to run into.
        seed: of everything random, 0 to 2^64 - 1: the same seed gives the same recording, to the last bit.
        servo: the position controller.
        contact_link, contact_point: where the arm touches; default: the tip.
        gravity: acceleration of free fall in the base frame [m/s2].

    Raises:
        InputError: something cannot be used; or mujoco is not installed.
    """

    def __init__(
        self,
        robot: Robot,
        joint_model: JointTorqueModel | None = None,
        *,
        friction: Gears | None = None,
        sensors: Sensors | None = None,
        objects: Sequence[PlantObject] = (),
        seed: int = 0,
        servo: Servo | None = None,
        contact_link: str | None = None,
        contact_point: Sequence[float] = (0.0, 0.0, 0.0),
        gravity: Sequence[float] = STANDARD_GRAVITY,
    ) -> None:
        self._mujoco = import_mujoco()
        self.robot, self.joint_model = robot, joint_model
        self.gears, self.sensors, self.servo = friction or Gears(), sensors or Sensors(), servo or Servo()
        self.objects = tuple(objects)
        names = [thing.name for thing in self.objects]
        if len(set(names)) < len(names):
            raise InputError("object.name", f"{names} has one twice", "name each object differently")
        if isinstance(seed, bool) or not isinstance(seed, int) or not 0 <= seed < 2**64:
            raise InputError("seed", f"is {seed!r}", "wanted a whole number from 0 to 2^64 - 1")
        self.seed = seed
        self.contact = (contact_link, tuple(float(x) for x in as_float_array(contact_point, "contact_point", (3,))))
        self.gravity = tuple(float(x) for x in as_float_array(gravity, "gravity", (3,)))
        self.drives = Drives(robot, joint_model, self.gears)
        self._channels = Channels(self.sensors, robot.dof)
        self._geared = with_rotors(robot, self.drives.inertia)
        self._check_gears()
        self._feedforward = per_joint(
            self.servo.acceleration_feedforward, robot.dof, "servo.acceleration_feedforward", 1.0
        )
        self._torque_limit = per_joint(self.servo.torque_limit, robot.dof, "servo.torque_limit", math.inf, least=1e-3)
        rotor = self.drives.inertia
        self.xml = mjcf(
            robot,
            rotor_inertia=rotor,
            joint_stiffness=self.drives.stiffness,
            joint_damping=self.drives.damping,
            objects=self.objects,
            gravity=self.gravity,
            step=STEP,
            contact_link=contact_link,
            contact_point=self.contact[1],
        )
        try:
            self.model = self._mujoco.MjModel.from_xml_string(self.xml)
        except ValueError as error:
            raise InputError("robot", f"MuJoCo cannot use {robot.name}: {' '.join(str(error).split())}") from None
        self.data = self._mujoco.MjData(self.model)
        self._forces = ObjectForces(self.model, self.data, self.objects)

    def _check_gears(self) -> None:
        for j, (stiffness, rotor) in enumerate(zip(self.drives.stiffness, self.drives.inertia, strict=True), start=1):
            if np.isfinite(stiffness) and rotor <= 0:
                raise InputError(f"friction.rotor_inertia[{j}]", "is zero", "a gear that gives needs a rotor behind it")

    @cached_property
    def _motor(self) -> Any:
        """Where the motors' coordinates are."""
        if not np.isfinite(self.drives.stiffness).any():
            return slice(0, self.robot.dof)
        return np.array([self.model.joint(joint.name).qposadr[0] for joint in self.robot.joints])

    @cached_property
    def _twist(self) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Joints whose gear gives, and where their twist is."""
        soft = np.flatnonzero(np.isfinite(self.drives.stiffness))
        names = [f"{self.robot.joints[j].name}:twist" for j in soft]
        return soft, np.array([self.model.joint(name).qposadr[0] for name in names], dtype=np.int64)

    def joint_positions(self) -> FloatArray:
        """Of the links, now (dof,) [rad or m]."""
        q: FloatArray = np.array(self.data.qpos[self._motor])
        soft, at = self._twist
        if len(soft):
            q[soft] += self.data.qpos[at]
        return q

    def _gains(self, q: FloatArray) -> tuple[FloatArray, FloatArray]:
        moved: FloatArray = np.diag(mass_matrix(self._geared, q)).copy()
        cascade = self.servo.cascade(moved)
        if cascade is not None:
            return cascade
        soft = self._twist[0]
        moved[soft] = self.drives.inertia[soft]
        return self.servo.gains(moved)

    def _controls(self, command: Command, kp: FloatArray, kv: FloatArray) -> FloatArray:
        """What the servo is told at every integration step (steps, dof)."""
        q, qd, qdd = between(command)
        needed = inverse_dynamics(self._geared, q, qd, qdd, gravity=self.gravity)
        if (self._feedforward < 1).any():
            weight = gravity_torque(self._geared, q, gravity=self.gravity)
            needed = weight + self._feedforward * (needed - weight)
        return np.asarray(q + (kv * qd + needed) / kp)

    def run(self, command: Command, *, on_sample: OnSample | None = None, to_end: bool = False) -> PlantRun:
        """Follow a command to its end.

        Args:
            command: of :func:`~bumpstop.plant.line` or :func:`~bumpstop.plant.along`.
            on_sample: called with every feedback sample that is not lost. The first :class:`PlantReaction` it returns
                turns the motion; after that it is not called any more, but with ``to_end``.
            to_end: go on calling ``on_sample`` behind the reaction.

        Returns:
            The recording, the truth behind it, and forces over time.

        Raises:
            InputError: the command is not for this robot, or the arm is inside an object at the start.
        """
        log, trace, plans, reacted, notes = self._follow(command, [(self.sensors, self.seed)], on_sample, to_end)
        return self._run((*command.notes, *notes), log, trace, self._channels, plans[0], reacted)

    def runs(self, command: Command, recorders: Sequence[tuple[Sensors, int]]) -> list[PlantRun]:
        """Follow a command once, recorded by several sensors with a seed each.

        All that is random lies in what the sensors report, so each run is, to the last bit, the one that a plant of its
        own with these sensors and this seed would have made; the arm is moved only once.

        Args:
            command: as in :meth:`run`.
            recorders: sensors and seed of each run.

        Raises:
            InputError: as :meth:`run`.
        """
        log, trace, plans, *_ = self._follow(command, recorders, None, to_end=False)
        done = []
        for (sensors, seed), plan in zip(recorders, plans, strict=True):
            run = self._run(command.notes, log, trace, Channels(sensors, self.robot.dof), plan, None)
            truth = run.truth | {"seed": seed, "sensors": sensors_truth(sensors)}
            done.append(replace(run, truth=truth))
        return done

    def _follow(
        self, command: Command, recorders: Sequence[tuple[Sensors, int]], on_sample: OnSample | None, to_end: bool
    ) -> tuple[SampleLog, PlantTrace, list[SamplePlan], float | None, tuple[str, ...]]:
        """Move the arm and note what every recorder will need, and when and how it reacted; a callback has one."""
        mj, model, data, drives = self._mujoco, self.model, self.data, self.drives
        n, motor = self.robot.dof, self._motor
        if command.q.shape[1] != n:
            raise InputError("command", f"is for {command.q.shape[1]} joints", f"{self.robot.name} has {n}")
        self._begin(command)
        kp, kv = self._gains(command.q[0])
        model.actuator_gainprm[:, 0] = kp
        model.actuator_biastype[:] = mj.mjtBias.mjBIAS_AFFINE
        model.actuator_biasprm[:, 1], model.actuator_biasprm[:, 2] = -kp, -kv
        most = self._torque_limit
        model.actuator_forcelimited[:] = np.isfinite(most)
        model.actuator_forcerange[:] = np.where(np.isfinite(most), [-most, most], 0.0).T
        model.dof_damping[motor] = 0.0
        controls = self._controls(command, kp, kv)
        damping, against, slope, base = drives.resist(
            np.array(data.qpos[motor]), command.qd[0], self._needed(command.q[0], command.qd[0])
        )
        afterwards = _AFTERWARDS_S + (0.0 if on_sample is None else MAX_LATENCY_S)
        longest = command.duration + afterwards
        plans = [SamplePlan.draw(sensors, n, longest, STEP, COMMAND_STEP, seed) for sensors, seed in recorders]
        sample_at = np.unique(np.concatenate([plan.step[plan.kept] for plan in plans]))
        next_sample: list[int] = [*sample_at.tolist(), np.iinfo(np.int64).max]
        log = SampleLog.empty(sample_at, n)
        trace = PlantTrace.empty(len(command.q) + round(afterwards / COMMAND_STEP), n, len(self.objects))
        sample = 0
        turn_at: int | None = None  # step at which the reaction begins
        answer: PlantReaction | None = None
        reacted: float | None = None
        first_control = 0
        step, last = 0, len(controls)
        mj_step, ctrl, qvel, qpos = mj.mj_step, data.ctrl, data.qvel, data.qpos
        given_now, applied, resisting = data.qfrc_actuator, data.qfrc_applied, model.dof_damping
        while step < last:
            # The gears resist anew every millisecond; their damping acts at every step.
            resisting[motor] = damping
            applied[motor] = -against
            end = step + PER_COMMAND
            while step < end:
                upto = min(end, next_sample[sample])
                for row in controls[step - first_control : upto - first_control]:
                    ctrl[:] = row
                    rate_before, q_before = np.array(qvel[motor]), np.array(qpos[motor])
                    mj_step(model, data)
                step = upto
                # A step's forces are those of the position in which it begins: encoders are read there. Read at its end
                # they would be a step late, and gravity torque would look like friction.
                # MuJoCo says what the motors give at the step's begin, and moves the arm by what they give at its end
                # (implicit in the rates).
                gained = qvel[motor] - rate_before
                begun = given_now[motor]
                # What is at its limit does not follow the rate.
                given = np.where(np.abs(begun) < most, np.clip(begun - kv * gained, -most, most), begun)
                if next_sample[sample] == step:
                    rate = qvel[motor]
                    log.note(sample, q_before, rate, given, base + slope * rate, data.sensordata)
                    if on_sample is not None and (to_end or turn_at is None):
                        said = on_sample(self._sample(log, plans[0], sample))
                        if said is not None and turn_at is None:
                            answer = said
                            late = (step * STEP + answer.latency_s) / COMMAND_STEP
                            turn_at = math.ceil(late - 1e-6) * PER_COMMAND
                            if turn_at > last:
                                command = command.until(turn_at // PER_COMMAND)
                                controls = self._controls(command, kp, kv)
                                last = len(controls)
                    sample += 1
            motor_q, motor_qd = np.array(qpos[motor]), np.array(qvel[motor])
            row_of_trace = step // PER_COMMAND - 1
            trace.note(row_of_trace, self.joint_positions(), motor_qd, gained / STEP, given, against, damping)
            if self.objects:
                forces = self._forces.contact()
                trace.contact_force[row_of_trace] = forces
                trace.measured_force[row_of_trace] = self._forces.measured(forces)
            if turn_at is not None and answer is not None and reacted is None and step >= turn_at:
                knot = step // PER_COMMAND
                turned = command.reaction(knot, answer)
                controls, first_control = self._controls(turned, kp, kv), step
                room = round(_AFTERWARDS_S / STEP)
                last = step + min(len(controls), room)
                reacted = step * STEP
            damping, against, slope, base = drives.resist(motor_q, motor_qd, given)
        self._refuse_unstable()
        t: FloatArray = np.arange(PER_COMMAND, step + 1, PER_COMMAND).astype(np.float64) * STEP
        notes = () if answer is None or reacted is None else answer.deceleration.notes
        return log.cut(sample), trace.cut(t), plans, reacted, notes

    def _refuse_unstable(self) -> None:
        """MuJoCo begins anew in its own pose where a motion blows up, and goes on."""
        kinds = self._mujoco.mjtWarning
        bad = (kinds.mjWARN_BADQPOS, kinds.mjWARN_BADQVEL, kinds.mjWARN_BADQACC)
        if any(self.data.warning[int(kind)].number for kind in bad):
            problem = f"the motion blows up: something swings too fast for steps of {1e3 * STEP:g} ms"
            raise InputError("friction", problem, "wanted softer gears, heavier rotors or gentler ripple")

    def _run(
        self,
        notes: tuple[str, ...],
        log: SampleLog,
        trace: PlantTrace,
        channels: Channels,
        plan: SamplePlan,
        reacted: float | None,
    ) -> PlantRun:
        """What one recorder made of a motion."""
        last = round(len(trace.t) * PER_COMMAND)
        reached = int(np.searchsorted(plan.step, last, side="right"))
        kept = np.flatnonzero(plan.kept[:reached])
        rows = np.searchsorted(log.step, plan.step[kept])
        t, q, current, wrench = self._reported(log, rows, channels, plan, kept)
        return PlantRun.of(
            self.robot,
            self.truth(),
            (*notes, *self.drives.notes),
            (t, q, current, wrench),
            trace,
            reacted,
            lost=reached - len(kept),
        )

    def _reported(
        self,
        log: SampleLog,
        rows: npt.NDArray[np.int64],
        channels: Channels,
        plan: SamplePlan,
        samples: npt.NDArray[np.int64],
    ) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray]:
        """What the sensors say at rows of the log, which are samples of the plan: t, q, current and wrench."""
        current = self.drives.current(log.given[rows], log.qd[rows], log.taken[rows])
        current = current + self.drives.scattered(plan.scatter, samples, log.qd[rows])
        return (
            log.step[rows].astype(np.float64) * STEP,
            channels.position(log.q[rows], plan.position[samples]),
            channels.current(current, plan.current[samples]),
            # MuJoCo's sensor has the sign of what the tool exerts on what it touches.
            channels.wrench(-log.wrench[rows], plan.wrench[samples]),
        )

    def hanging(self, q: FloatArray) -> FloatArray:
        """Where the links stand while the motors hold a pose: gears that give sag (dof,) [rad or m]."""
        return q - self._needed(q, np.zeros_like(q)) / self.drives.stiffness

    def _needed(self, q: FloatArray, qd: FloatArray) -> FloatArray:
        """Torque that keeps the arm at these rates (dof,) [Nm or N]."""
        return inverse_dynamics(self._geared, q, qd, np.zeros_like(q), gravity=self.gravity)

    def _begin(self, command: Command) -> None:
        mj, model, data = self._mujoco, self.model, self.data
        mj.mj_resetData(model, data)
        q, qd = command.q[0], command.qd[0]
        data.qpos[self._motor], data.qvel[self._motor] = q, qd
        soft, at = self._twist
        if len(soft):
            # The motors are where they are told to be, and the links hang in their gears.
            data.qpos[at] = -self._needed(q, qd)[soft] / self.drives.stiffness[soft]
        self.drives.reset(q, qd, self._needed(q, qd))
        mj.mj_forward(model, data)
        for thing, force in zip(self.objects, self._forces.contact(), strict=True):
            if force > 0:
                raise InputError(f"object {thing.name!r} position", "is inside the arm at the start", "move it away")

    def _sample(self, log: SampleLog, plan: SamplePlan, row: int) -> Sample:
        """What a callback learns of the row of the log that was just written."""
        at = np.array([row])
        samples = np.flatnonzero(plan.kept & (plan.step == log.step[row]))
        t, q, current, wrench = self._reported(log, at, self._channels, plan, samples)
        forces = self._forces.contact()
        torque = np.zeros(self.robot.dof)
        if forces.any():
            jacobian = self.robot.jacobian(self.joint_positions(), *self.contact)[:3]
            torque = jacobian.T @ sum(
                f * np.array(thing.direction) for f, thing in zip(forces, self.objects, strict=True)
            )
        return Sample(float(t[0]), q[0], log.qd[row].copy(), current[0], wrench[0], forces, torque)

    def rebuilt(self, gears: Gears, objects: Sequence[PlantObject]) -> Plant:
        """The same arm with other gears, among other objects."""
        return type(self)(
            self.robot,
            self.joint_model,
            friction=gears,
            objects=objects,
            servo=self.servo,
            contact_link=self.contact[0],
            contact_point=self.contact[1],
            gravity=self.gravity,
        )

    def series_stiffness(self, q: npt.ArrayLike, thing: PlantObject) -> float:
        """Stiffness of object, servo and gears in series, by two static pushes [N/m].

        The object is put before the contact point in the pose ``q``; the arm is told to go into it until 20 and 60 N
        are due, waits, and the difference of the forces over that of the ways commanded is the stiffness: object,
        contact, servo and gears in series. Friction holds the arm alike in both pushes.

        Args:
            q: pose at which the arm touches (dof,) [rad or m].
            thing: what is pushed, along its normal.

        Raises:
            InputError: the arm cannot move along the normal there.
        """
        return series_stiffness(self, q, thing)

    def truth(self) -> dict[str, Any]:
        """What the plant is made of, for a TOML file."""
        return truth_of(self)
