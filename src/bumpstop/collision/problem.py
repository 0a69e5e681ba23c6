"""A scenario made ready to compute: robot found, lengths and limits checked, everything in SI."""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.collision.arm.arm_mass import arm_mass_at, reduced_mass
from bumpstop.collision.arm.compliance import check_inertia, compliance_of, drive_train_of
from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.collision.scenario.scenario_file import robot_of
from bumpstop.collision.scenario_values import (
    gives_way,
    mass_of_body,
    per_joint,
    sd_of_noise,
    start_pose,
    steps_of_period,
)
from bumpstop.collision.stopping.deceleration import Deceleration
from bumpstop.contact import ContactLimits, LimitTable
from bumpstop.detection import ResidualRecord
from bumpstop.detection.tuning.found_with import check_kind, of_another_robot
from bumpstop.errors import InputError
from bumpstop.model import DriveTrain, Robot

if TYPE_CHECKING:
    from bumpstop.collision.trajectory.trajectory import Trajectory

# A day of ticks at a kilohertz would exhaust memory long before anything is learned from it.
MAX_STEPS = 2_000_000


@dataclass(frozen=True)
class CollisionProblem:
    """A checked scenario in the kernels' terms.

    Attributes:
        scenario: as given.
        robot: the arm.
        limits: of the body region hit, or None where only a stiffness was given.
        stiffness: of the body, in series with the arm's padding if there is one [N/m].
        body_stiffness: of the body alone [N/m].
        body_mass: of free contact [kg]; None: the body is clamped.
        q: start pose (dof,) [rad or m].
        velocity: of the tip along a line, base frame (3,) [m/s]; zero with a trajectory.
        thresholds, noise_sd, noise_mean: per joint (dof,) [Nm or N].
        joint_acceleration: limits (dof,) [rad/s2 or m/s2].
        deceleration: how reactions slow down.
        period_steps, latency_steps: in simulation steps; the latency with the dead time.
        notes: what was assumed while reading the scenario.
        residuals: measured noise, or None for Gaussian noise; ``noise_sd`` is then its own.
        trajectory: the motion, where it is no line.
    """

    scenario: Scenario
    robot: Robot
    limits: ContactLimits | None
    stiffness: float
    q: FloatArray
    velocity: FloatArray
    thresholds: FloatArray
    noise_sd: FloatArray
    noise_mean: FloatArray
    joint_acceleration: FloatArray
    deceleration: Deceleration
    period_steps: int
    latency_steps: int
    notes: tuple[str, ...]
    residuals: ResidualRecord | None = None
    body_stiffness: float = 0.0
    body_mass: float | None = None
    trajectory: Trajectory | None = None

    @classmethod
    def from_scenario(cls, scenario: Scenario) -> CollisionProblem:
        """Check a scenario against its robot and its limit table.

        Raises:
            InputError: a length, a joint number, the pose or the start of the motion cannot be used.
        """
        robot = robot_of(scenario)
        notes = list(robot.warnings)
        contact, detector, reaction = scenario.contact, scenario.detector, scenario.reaction
        limits = None
        if contact.body is not None:
            table = LimitTable.load(contact.limits, relative_to=scenario.folder)
            limits = table.contact_limits(contact.body, contact.kind, contact.pressure_area)
            if "area_cm2" not in contact.model_fields_set:
                notes.append("Contact area not given: 1 cm² assumed.")
        stiffness = contact.stiffness_N_m
        if stiffness is None:
            assert limits is not None
            stiffness = limits.stiffness_N_m
        body_stiffness = stiffness
        if contact.gauge_spring_N_m is not None and contact.gauge_mass_kg is None:
            stiffness = 1 / (1 / stiffness + 1 / contact.gauge_spring_N_m)
            notes.append(
                f"A gauge with a spring of {contact.gauge_spring_N_m:g} N/m behind {body_stiffness:g} N/m, without a "
                f"mass of its own: {stiffness:.5g} N/m together."
            )
        if contact.padding_N_m is not None:
            stiffness = 1 / (1 / stiffness + 1 / contact.padding_N_m)
            notes.append(
                f"Padding of {contact.padding_N_m:g} N/m in series with the body: {stiffness:.5g} N/m together."
            )
        step = scenario.simulation.step_s
        residuals = None
        if detector.residuals is not None:
            residuals = ResidualRecord.load(scenario.folder / detector.residuals, robot.dof, detector.feedback_period_s)
            check_kind(residuals.found_with, detector.residual, detector.observer_gain_1_s, "detector.residuals")
            notes.extend([*residuals.notes, *of_another_robot(residuals.found_with, robot.name)])
        late = reaction.latency_s + reaction.dead_time_s
        latency = math.ceil(late / step - 1e-9)
        if abs(latency * step - late) > 1e-9 * step:
            what = "Reaction latency and dead time" if reaction.dead_time_s else "Reaction latency"
            notes.append(f"{what} rounded up to {latency * step * 1e3:g} ms, whole simulation steps.")
        deceleration = Deceleration.of(reaction, scenario.folder, robot)
        notes.extend(deceleration.notes)
        trajectory = None
        if scenario.motion.kind == "trajectory":
            from bumpstop.collision.trajectory.trajectory import load_trajectory

            trajectory = load_trajectory(scenario, robot)
        problem = cls(
            scenario=scenario,
            robot=robot,
            limits=limits,
            stiffness=stiffness,
            q=start_pose(scenario, robot) if trajectory is None else trajectory.position[0].copy(),
            velocity=np.array(scenario.motion.velocity) if trajectory is None else np.zeros(3),
            thresholds=per_joint(detector.thresholds_Nm, robot, "detector.thresholds_Nm", each=True),
            noise_sd=sd_of_noise(scenario, robot, residuals),
            noise_mean=per_joint(detector.noise_mean_Nm, robot, "detector.noise_mean_Nm"),
            joint_acceleration=per_joint(
                reaction.joint_acceleration_rad_s2, robot, "reaction.joint_acceleration_rad_s2"
            ),
            deceleration=deceleration,
            period_steps=steps_of_period(detector.feedback_period_s, step),
            latency_steps=latency,
            notes=tuple(notes),
            residuals=residuals,
            body_stiffness=body_stiffness,
            body_mass=mass_of_body(scenario, limits),
            trajectory=trajectory,
        )
        if trajectory is None:
            problem._check_motion()
        return problem

    @cached_property
    def held(self) -> list[int]:
        """Held joints, numbered from 0."""
        held = self.scenario.motion.held_joints
        for number in held:
            if not 1 <= number <= self.robot.dof:
                raise InputError(
                    "motion.held_joints", f"{number} is no joint of {self.robot.name}", self._joint_range()
                )
        if len(set(held)) != len(held):
            raise InputError("motion.held_joints", f"{held} names a joint twice")
        return [number - 1 for number in held]

    def _joint_range(self) -> str:
        return f"valid: 1 to {self.robot.dof}"

    @property
    def arm_in_words(self) -> str:
        """Which arm is judged, to follow its name: nothing for a rigid one."""
        return ", its gears and servos giving way," if self.elastic else ""

    @property
    def motion_in_words(self) -> str:
        """How the arm moves, to follow its name: ``at 50 mm/s``."""
        if self.trajectory is not None:
            return f"along a trajectory of {self.trajectory.duration:.4g} s"
        return f"at {1e3 * math.hypot(*self.scenario.motion.velocity):.4g} mm/s"

    @cached_property
    def contact_point(self) -> tuple[int, FloatArray]:
        """Number of the link that hits, from 0, and the contact point in its frame (3,) [m]."""
        contact = self.scenario.contact
        try:
            return self.robot.frame(contact.link, contact.point_m)
        except InputError as error:
            raise InputError(f"contact.{error.field}", error.problem, error.valid) from None

    @cached_property
    def setup(self) -> _native.CollisionSetup:
        """Arm, motion, contact point and reaction; of a trajectory without the line."""
        scenario, robot = self.scenario, self.robot
        setup = _native.CollisionSetup(robot.chain)
        motion, timing = setup.motion, setup.timing
        motion.step, motion.substeps = scenario.simulation.step_s, scenario.simulation.substeps
        motion.acceleration_limit = self.joint_acceleration
        motion.deceleration = self.deceleration.native
        link, point = self.contact_point
        setup.contact.point = robot.chain.link_point(link, point.tolist())
        tip_link, tip_point = robot.frame(None)
        motion.tip = robot.chain.link_point(tip_link, tip_point.tolist())
        timing.period, timing.latency = self.period_steps, self.latency_steps
        setup.reaction = _native.ReactionKind[scenario.reaction.kind]
        if self.elastic:
            check_inertia(robot)
            setup.arm = compliance_of(self.drive_train, robot)
        if self.trajectory is None:
            self._add_line(setup)
        return setup

    def _add_line(self, setup: _native.CollisionSetup) -> None:
        robot, motion, contact = self.robot, self.scenario.motion, self.scenario.contact
        step = self.scenario.simulation.step_s
        free = [j for j in range(robot.dof) if j not in self.held]
        rows = 6 if motion.task == "pose" else 3
        if len(free) < rows:
            if not free:
                raise InputError("motion.held_joints", "hold every joint", "at least one must move")
            if len(free) >= 3:
                valid = 'wanted task = "position"'
            elif robot.dof >= 3:
                valid = "wanted fewer held joints"
            else:
                valid = 'an arm with fewer than 3 joints follows no line: give motion.kind = "trajectory"'
            raise InputError("motion.task", f"{motion.task!r} needs {rows} free joints, {len(free)} are free", valid)
        steps = round(motion.duration_s / step)
        if not 1 <= steps <= MAX_STEPS:
            raise InputError(
                "motion.duration_s",
                f"{motion.duration_s} is {motion.duration_s / step:.7g} simulation steps",
                f"wanted 1 to {MAX_STEPS}",
            )
        if contact.normal is not None:
            setup.contact.along_motion = False
            setup.contact.normal = (np.array(contact.normal) / np.linalg.norm(contact.normal)).tolist()
        line = setup.motion
        line.task_rows, line.free_joints, line.damping = rows, free, motion.damping
        line.velocity_limit, line.lower, line.upper = robot.velocity, robot.lower, robot.upper
        setup.timing.steps, setup.timing.from_rest = steps, motion.start == "rest"

    @cached_property
    def detector(self) -> _native.GaussianThresholds:
        """Thresholds and noise."""
        detector = _native.GaussianThresholds(self.thresholds, self.noise_sd, self.noise_mean)
        detector.arming_delay = self.scenario.detector.arming_delay_s
        detector.correlation = self.scenario.detector.noise_correlation
        detector.filter = self.observer_memory
        return detector

    @property
    def elastic(self) -> bool:
        """Whether the arm gives way."""
        return self.scenario.arm.model == "elastic"

    @property
    def gets_away(self) -> bool:
        """Whether nothing holds the body."""
        return self.body_mass is not None

    @property
    def gives_way(self) -> bool:
        """Whether more than a clamped spring gives: the arm, a mass behind the spring, or damping."""
        return gives_way(self.scenario)

    @cached_property
    def drive_train(self) -> DriveTrain:
        """Rotors, gears and servos: the robot's own, then those of the scenario."""
        return drive_train_of(self.scenario, self.robot)

    @cached_property
    def contact(self) -> _native.Contact:
        """What is hit; of a trajectory its offset does not count."""
        contact, table = _native.Contact(), self.scenario.contact
        contact.body.stiffness, contact.body.mass = self.stiffness, self.moving_mass
        contact.body.damping = table.damping_Ns_m
        if table.gauge_mass_kg is not None:
            assert table.gauge_spring_N_m is not None
            contact.body.mass, contact.body.ground_stiffness = table.gauge_mass_kg, table.gauge_spring_N_m
        if self.trajectory is None:
            contact.offset.kind, contact.offset.size = _native.OffsetKind[self.offset_kind], self.offset_size
        return contact

    @cached_property
    def residual_record(self) -> _native.ResidualRecord | None:
        """The measured noise as runs draw it."""
        record = self.residuals
        return None if record is None else _native.ResidualRecord(record.rows, record.block_rows)

    @property
    def observer_memory(self) -> float:
        """Share of its old value that the observer's residual keeps from tick to tick; 0 for the direct residual.

        The momentum observer answers a torque as a first-order filter of its gain K: r' = K (tau - r), so over a
        feedback period T it keeps exp(-K T) of what it was and takes the rest from the mean torque.
        """
        detector = self.scenario.detector
        if detector.residual == "direct":
            return 0.0
        # Not zero, which is the direct residual: of the fastest observer the mean torque remains.
        memory = math.exp(-detector.observer_gain_1_s * self.period_steps * self.scenario.simulation.step_s)
        return max(memory, sys.float_info.min)

    @property
    def first_armed_tick(self) -> int:
        """Number of the first tick that may alarm, from 0."""
        step = self.scenario.simulation.step_s
        delay = (self.scenario.detector.arming_delay_s - 1e-12) / step
        return max(0, math.ceil((delay - 1) / self.period_steps))

    @cached_property
    def start(self) -> _native.LineStart:
        """Joint rates (``qd``, rad/s or m/s) and velocity of the contact point [m/s] at the start of the motion."""
        return _native.line_start(self.setup, self.q, self.velocity)

    @cached_property
    def approach_speed(self) -> float:
        """Speed of the contact point along the contact normal at the start of the motion [m/s]."""
        velocity = self.start.point_velocity
        normal = self.scenario.contact.normal
        if normal is None:
            return float(np.linalg.norm(velocity))
        return float(np.array(normal) @ velocity / np.linalg.norm(normal))

    @property
    def offset_kind(self) -> str:
        """``"half_normal"``, ``"uniform"`` or ``"fixed"``."""
        return self.scenario.contact.offset_law

    @property
    def offset_size(self) -> float:
        """Half-normal: sd; uniform: upper end; fixed: the offset itself [m]."""
        contact = self.scenario.contact
        if contact.offset_law == "half_normal":
            return contact.offset_sd_s * self.approach_speed
        if contact.offset_law == "uniform":
            return self.period_steps * self.scenario.simulation.step_s * self.approach_speed
        assert contact.offset_mm is not None
        return contact.offset_mm / 1e3

    @cached_property
    def transient_limits(self) -> ContactLimits | None:
        """Limits of the first half second of clamped contact; None where one set of limits judges all of it."""
        contact = self.scenario.contact
        if contact.body is None or contact.kind == "free" or self.scenario.verdict.clamped_limit == "quasi_static":
            return None
        table = LimitTable.load(contact.limits, relative_to=self.scenario.folder)
        return table.contact_limits(contact.body, "free", contact.pressure_area)

    @cached_property
    def arm_mass(self) -> float | None:
        """Effective mass of the arm along the normal at the start of a line [kg]; None: not known or implausible."""
        normal = self.scenario.contact.normal
        along = np.array(normal) if normal is not None else self.start.point_velocity
        return arm_mass_at(self.robot, self.scenario.contact, self.q, along)

    @cached_property
    def moving_mass(self) -> float:
        """Mass behind the spring of free contact [kg], 0 for clamped contact.

        The body's; with ``arm = "two_mass"`` that of body and arm reduced to one.
        """
        if self.body_mass is None:
            return 0.0
        if self.scenario.contact.arm == "position_driven":
            return self.body_mass
        if self.robot.inertia_objection:
            problem = f"'two_mass' needs a plausible inertia. {self.robot.inertia_objection.rstrip('.')}"
            raise InputError("contact.arm", problem, "valid: 'position_driven', or a robot with its real inertia")
        arm = self.arm_mass
        if arm is None:
            raise InputError(
                "contact.arm",
                f"'two_mass' needs an effective mass of {self.robot.name}: its mass matrix has no inverse at this pose",
                "valid: 'position_driven'",
            )
        return reduced_mass(self.body_mass, arm)

    def _check_motion(self) -> None:
        start = self.start
        if start.singular and self.scenario.motion.damping == 0:
            raise InputError(
                "pose_deg" if self.scenario.pose_deg is not None else "pose_rad",
                "is singular: no finite joint rates move the tip as motion.velocity_mm_s asks",
                "give another pose, or motion.damping",
            )
        if not self.approach_speed > 1e-9:
            where = self.scenario.contact.link or self.robot.tip_name
            raise InputError(
                "contact.normal" if self.scenario.contact.normal is not None else "contact.link",
                f"the contact point on {where} does not move toward the body "
                f"({self.approach_speed * 1e3:.3g} mm/s along the normal)",
                "give a point that moves, and a normal that points the way it goes",
            )
