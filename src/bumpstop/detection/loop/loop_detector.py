"""A detector's parts as a control loop takes them: robot, joint model, thresholds and settings in the kernels' form."""

from __future__ import annotations

import math
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.detection.loop.drive_matching import MatchedDrives
from bumpstop.detection.loop.fitted_dynamics import FittedDynamics
from bumpstop.detection.loop.unknown_gains import force_thresholds, unknown_gains
from bumpstop.detection.rate import check_rates
from bumpstop.detection.settings import DetectorSettings
from bumpstop.detection.standing import fitted_model, hidden_text, hidden_torques
from bumpstop.detection.thresholds import Thresholds
from bumpstop.errors import InputError
from bumpstop.model import unit_of, with_some_inertia
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.text_files import other_robot

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot

# Of a period: samples closer together repeat each other.
_MIN_PERIOD_SHARE = 0.1
_NOISE_PER_THRESHOLD = 3.0
# Of the speed limits, and at least [rad/s or m/s].
_UNWATCHED_TIMES = 10.0
_UNWATCHED_SPEED = 30.0
# Range of a joint that turns twice around, a little less than that for figures that are rounded [rad].
_TWO_TURNS = 3.99 * math.pi


class LoopDetector:
    """What a detector in a control loop is made of, checked to belong to one arm.

    Attributes:
        robot: with inertia. Where the joint model knows a reflected inertia, the robot's rotor does not count again.
        model: of currents, matched by joint names; or fitted dynamics, of torques or of currents; None: recordings
            have joint torque.
        thresholds: by joint.
        settings: everything else.
        notes: what a reader of any result must know.
    """

    def __init__(
        self,
        robot: Robot,
        model: JointTorqueModel | DynamicsModel | None,
        thresholds: Thresholds | npt.ArrayLike,
        settings: DetectorSettings | None = None,
    ) -> None:
        """Check that all parts belong to one arm.

        Without settings they are those that the thresholds say they were found with, and else the defaults.

        Raises:
            InputError: joints of the model that the robot has not, joints without a model that are monitored,
                thresholds of another length or found for another residual or rate, no inertia, a link that does not
                exist.
        """
        dynamics = fitted_model(model)
        if dynamics is not None and dynamics.robot.dof != robot.dof:
            raise InputError("model", f"is for {dynamics.robot.dof} joints", f"{robot.name} has {robot.dof}")
        # Of an arm whose dynamics are fitted only the geometry is used.
        robot = robot if dynamics is None else with_some_inertia(robot)
        self.robot = robot
        self.model = model
        self.fitted = None if dynamics is None else FittedDynamics(dynamics)
        self.thresholds = Thresholds.of(thresholds, robot.dof, [joint.name for joint in robot.joints])
        self.settings = settings or DetectorSettings(**self.thresholds.settings)
        self.thresholds.check_residual(self.settings.residual, self.settings.observer_gain_1_s)
        check_rates(self.settings, self.thresholds)
        self.notes: tuple[str, ...] = ()
        joint_model = None if self.fitted is not None else model
        self._drives = MatchedDrives(robot, joint_model, self.thresholds.monitored)  # type: ignore[arg-type]
        if self.fitted is not None and self.thresholds.model_errors > 0:
            raise InputError("model_errors", "is not available with fitted dynamics", "they have no errors of currents")
        _ = robot.dynamics  # says which link has no inertia
        number, point = robot.frame(self.settings.link, self.settings.point)
        self._contact = number, point
        for name, width in (("largest_signal", robot.dof), ("noise_sd", robot.dof)):
            if (value := getattr(self.settings, name)) is not None:
                given = as_float_array(value, name, (width,), finite=False)
                if not (given > 0).all():
                    raise InputError(name, f"is {given.tolist()}", "wanted numbers above 0")
        self._note()

    @cached_property
    def dead_zone(self) -> FloatArray:
        """(n,) torque that friction can hide at standstill, each way [Nm or N].

        While a joint sticks, its motor need not answer a torque below static friction and hysteresis: friction towards
        rest through the map's slope, plus T_H. A power law falls to nothing there, and counts as what it is where the
        fit knows it. Of fitted dynamics it is their friction without speed. Where it grows with the load it is that of
        the pose in which the joint holds most. What the settings state as stiction stands in its place. Zero without
        either. NaN of joints whose torque the model does not know, and where a load has no end.
        """
        return hidden_torques(self.robot, self.model, self.settings)

    def kernel(self, period_s: float | None = None, *, latched: bool = False) -> _native.LoopDetector:
        """The detector in the kernels' form, for one sample after another.

        Args:
            period_s: between samples [s]; None: that of the settings.
            latched: the first alarm stands for good, so that nothing behind it is another event.

        Raises:
            InputError: neither says how long a period is, or it is no time.
        """
        period = self.settings.period_s if period_s is None else period_s
        if period is None:
            raise InputError("period_s", "is not known", "give it in the settings")
        if not as_number(period, "period_s") > 0:
            raise InputError("period_s", f"is {period}", "wanted more than zero")
        links, joints, errors = self.parts()
        settings = self.kernel_settings(period)
        if latched:
            settings.alarm.event_pause = math.inf
        return _native.LoopDetector(
            self.robot.chain,
            [link.kernel(rotor) for link, rotor in links],
            joints,
            errors,
            settings,
            None if self.fitted is None else self.fitted.kernel(),
        )

    def parts(self) -> tuple[list[Any], list[_native.JointTorqueParameters], list[_native.JointTorqueErrors]]:
        """Inertia and rotor of every link, and parameters and standard errors of every joint, in the robot's order."""
        return self._drives.links(), self._drives.parameters(), self._drives.errors()

    @property
    def _gravity(self) -> tuple[float, float, float]:
        """Acceleration of free fall in the base frame [m/s2]."""
        if self.fitted is not None:
            return self.fitted.model.gravity
        if self.settings.gravity is not None:
            return self.settings.gravity
        return STANDARD_GRAVITY if self._drives.model is None else self._drives.model.gravity

    def kernel_settings(self, period: float) -> _native.DetectorSettings:
        """The settings in the kernels' form, for samples every ``period`` seconds."""
        given, robot, n = self.settings, self.robot, self.robot.dof
        out = _native.DetectorSettings()
        out.residual = getattr(_native.ResidualKind, given.residual)
        out.source = _native.TorqueSource.current if self.takes_current else _native.TorqueSource.torque
        out.observer_gain = given.observer_gain_1_s
        out.window, out.degree = given.window_s, int(given.degree)
        out.gravity = list(self._gravity)
        out.max_no_data_time = given.max_no_data_s
        out.unknown = sum(1 << j for j in self._drives.unknown)
        out.dead_zone = padded(np.nan_to_num(self.dead_zone))
        self.fill_contact(out)
        samples = out.samples
        samples.period = period
        samples.shortest_interval = _MIN_PERIOD_SHARE * period
        samples.late_interval = given.late_periods * period
        samples.longest_interval = given.longest_periods * period
        limited = np.isin(np.arange(n), self._limited)
        samples.lower = padded(np.where(limited, robot.lower - given.limit_margin, -math.inf))
        samples.upper = padded(np.where(limited, robot.upper + given.limit_margin, math.inf))
        # Of a joint that is not monitored only what would spoil the torques of others is impossible.
        fast = np.maximum(_UNWATCHED_TIMES * robot.velocity, _UNWATCHED_SPEED)
        samples.velocity = padded(np.where(self._counts, robot.velocity, fast))
        samples.signal = padded(np.full(n, math.inf) if given.largest_signal is None else given.largest_signal)
        samples.measured_rates = given.measured_rates
        samples.frozen_time = given.frozen_s
        samples.unmonitored = sum(1 << j for j in range(n) if not self._counts[j])
        samples.endless = sum(1 << j for j in self.endless)
        self.fill_alarm_settings(out.alarm)
        out.payload.mass = given.payload_kg
        out.payload.center = self.payload_center.tolist()
        out.payload_monitor.min_mass = given.payload_change_kg
        out.payload_monitor.window = given.payload_window_s
        return out

    def fill_contact(self, out: _native.DetectorSettings) -> None:
        """Put what tells the force of a contact into the kernels' form: noise, contact point and direction."""
        out.noise_sd = padded(self.noise_sd, 1.0)
        out.direction = list(self.settings.direction)
        number, point = self._contact
        out.set_contact(self.robot.chain, number, point.tolist())

    def fill_alarm_settings(self, out: _native.AlarmSettings) -> None:
        """Put thresholds and arming into the kernels' form."""
        given, law = self.settings, out.thresholds
        for name in ("constant", "speed", "acceleration", "rest", "fast"):
            setattr(law, name, padded(getattr(self.thresholds, name)))
        law.rest_speed = padded(self.rest_speed, 1.0)
        law.model_errors = self.thresholds.model_errors
        out.arming_delay = given.arming_delay_s
        out.rest_time = given.rest_time_s
        out.low_hz, out.high_hz = given.low_hz, given.high_hz
        out.event_pause = given.event_pause_s

    @property
    def takes_current(self) -> bool:
        """Samples have motor currents; else joint torques."""
        if self.fitted is not None:
            return self.fitted.model.gains is not None
        return self.model is not None

    @property
    def endless(self) -> list[int]:
        """Numbers from 0 of the joints that turn without end.

        Those without limits, and a last one that turns twice around: its limits guard cables at most.
        """
        robot, last = self.robot, self.robot.dof - 1
        turns = [joint.kind == "revolute" for joint in robot.joints]
        free = [j for j in range(robot.dof) if turns[j] and math.isinf(robot.upper[j] - robot.lower[j])]
        twice = turns[last] and last not in free and robot.upper[last] - robot.lower[last] >= _TWO_TURNS
        return [*free, *([last] if twice else [])]

    @property
    def _counts(self) -> list[bool]:
        """Joints whose samples must be believable: those monitored; all, where none is: residuals count then."""
        monitored = list(self.thresholds.monitored)
        return monitored if any(monitored) else [True] * self.robot.dof

    @property
    def _limited(self) -> list[int]:
        """Numbers from 0 of the joints whose positions have to be within their limits."""
        return [j for j in range(self.robot.dof) if self._counts[j] and j not in self.endless]

    @property
    def rest_speed(self) -> FloatArray:
        """(n,) speed below which a joint rests [rad/s or m/s]."""
        return self._drives.rest_speed(self.settings.rest_speed)

    @property
    def noise_sd(self) -> FloatArray:
        """(n,) of the residual [Nm or N]; infinite: the joint is not monitored and says nothing of contacts."""
        monitored = np.array(self.thresholds.monitored)
        assert self.thresholds.fast is not None
        level = np.minimum(self.thresholds.constant, self.thresholds.fast)
        noise = level / _NOISE_PER_THRESHOLD if self.settings.noise_sd is None else np.array(self.settings.noise_sd)
        # What is no torque in Nm says nothing of a force.
        monitored[unknown_gains(self.robot, self.model)] = False
        monitored &= ~np.isnan(self.dead_zone)
        return np.where(monitored, noise, np.inf)

    @property
    def payload_center(self) -> FloatArray:
        """(3,) of the payload, in the frame of the last link [m]."""
        given = self.settings.payload_center
        return np.array(self.robot.tip_origin if given is None else given, dtype=np.float64)

    @property
    def payload_at_tip(self) -> FloatArray:
        """(3,) the same in the frame of the tip, in which controllers and ``--payload`` have it [m]."""
        found: FloatArray = np.asarray(self.robot.tip_rotation).T @ (self.payload_center - self.robot.tip_origin)
        return found

    def _note(self) -> None:
        notes = [*self.robot.doubts]
        if self.model is not None:  # else fits need not be loaded, which takes its time
            from bumpstop.identification.fit_verdict import as_sentences, fit_faults

            notes += as_sentences(fit_faults(self.model))
            its = self.model.robot if isinstance(self.model.robot, str) else self.model.robot.name
            if other_robot(its, self.robot.name):
                notes.append(f"The model is of robot {its!r}, and the detector's is {self.robot.name!r}.")
        notes += self.thresholds.differences(self.settings)
        if not any(self.thresholds.monitored):
            notes.append("No joint is monitored: no contact can be detected.")
        notes += self._drives.notes()
        if self.fitted is not None:
            notes += force_thresholds(self.robot, self.model, self.thresholds.constant)[1]
        if self.model is not None or self.settings.stiction is not None:
            hidden, unit = hidden_text(self.dead_zone), unit_of(*self.robot.joints)
            notes.append(
                f"At standstill friction may hide up to {hidden} {unit} by joint: an arm at rest detects less."
            )
        fast = [joint.name for joint in self.robot.joints if not math.isfinite(joint.velocity)]
        if fast:
            notes.append(f"{', '.join(fast)}: without a speed limit, no jump is impossible.")
        self.notes = tuple(notes)


def padded(values: npt.ArrayLike, rest: float = 0.0) -> list[float]:
    """As many numbers as the kernels' arrays hold."""
    numbers = [float(value) for value in np.asarray(values)]
    return numbers + [rest] * (_native.max_joints - len(numbers))
