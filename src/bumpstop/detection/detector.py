"""The detector of collisions: robot, joint model, thresholds and settings, over a recording or tick by tick."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.detection.events import DetectionRun, Event, bits, check_rearm
from bumpstop.detection.matched_drives import MatchedDrives
from bumpstop.detection.rate import check_rates, period_of
from bumpstop.detection.settings import DetectorSettings
from bumpstop.detection.thresholds import Thresholds
from bumpstop.errors import InputError
from bumpstop.kernels import core
from bumpstop.model import unit_of

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Of a period: samples closer together repeat each other.
_SHORTEST = 0.1
_NOISE_PER_THRESHOLD = 3.0


class Detector:
    """Residuals against thresholds. C++ has the same class under the same name; this one makes it and runs it.

    *Direct* residual (eq 4.1): torque estimated from the current minus Newton-Euler torque. A contact torque shows at
    once. Its noise is that of the estimated torque, and M(q) times that of the accelerations, which with degree 2 are
    (window - 1) / 2 samples late (``signal.causal_derivatives`` gives their noise).

    *Observer*: minus the external torque of a momentum observer. It needs no acceleration. With a = exp(-K dt) a step
    of the torque shows as 1 - a^k (1 + a) / 2 of itself k samples after the first that has it: 1 - exp(-K t), half a
    sample late. White noise of standard deviation s in the torque leaves s sqrt((1 - a) / 2), in the momentum
    s (1 - a) / dt sqrt(2 / (1 + a)).

    The *fast channel* is the residual through a band-pass from low_hz to high_hz, with thresholds of its own. With
    a = exp(-2 pi high_hz dt) and b = exp(-2 pi low_hz dt) its delay is dt a / (1 - a), and white noise of standard
    deviation s leaves s b (1 - a) sqrt(2 / ((1 + a) (1 + b) (1 - a b))).

    Attributes:
        robot: with inertia. Where the joint model knows a reflected inertia, the robot's rotor does not count again.
        model: of currents, matched by joint names; None: recordings have joint torque.
        thresholds: by joint.
        settings: everything else.
        notes: what a reader of any result must know.
    """

    def __init__(
        self,
        robot: Robot,
        model: JointTorqueModel | None,
        thresholds: Thresholds | npt.ArrayLike,
        settings: DetectorSettings | None = None,
    ) -> None:
        """Check that all parts belong to one arm.

        Raises:
            InputError: joints of the model that the robot has not, joints without a model that are watched, thresholds
                of another length or found for another residual or rate, no inertia, a link that does not exist.
        """
        self.robot = robot
        self.model = model
        self.thresholds = Thresholds.of(thresholds, robot.dof, [joint.name for joint in robot.joints])
        self.settings = settings or DetectorSettings()
        self.thresholds.check_residual(self.settings.residual, self.settings.observer_gain_1_s)
        check_rates(self.settings, self.thresholds)
        self.notes: tuple[str, ...] = ()
        self._drives = MatchedDrives(robot, model, self.thresholds.watched)
        _ = robot.dynamics  # says which link has no inertia
        number, point = robot.frame(self.settings.link, self.settings.point)
        self._contact = number, point
        for name, width in (("largest_signal", robot.dof), ("noise_sd", robot.dof)):
            if (value := getattr(self.settings, name)) is not None:
                given = as_float_array(value, name, (width,), finite=False)
                if not (given > 0).all():
                    raise InputError(name, f"is {given.tolist()}", "wanted numbers above 0")
        self._note()

    # --- What it can feel -----------------------------------------------------------------------------------------

    @cached_property
    def dead_zone(self) -> FloatArray:
        """(n,) torque that friction can hide at standstill, each way [Nm or N].

        While a joint sticks, its motor need not answer a torque below static friction and hysteresis: friction at
        rest_speed through the map's slope without current, plus T_H. Zero without a joint model.
        """
        return self._drives.dead_zone()

    def smallest_torque(self, *, resting: bool = False) -> FloatArray:
        """(n,) external torque that passes the threshold for sure, without noise [Nm or N]; infinite: not watched.

        Moving: the constant threshold. Resting: the threshold at rest and the dead zone that may hide as much of the
        torque; a clamped arm that stands still feels nothing below. What speed, acceleration and ``model_errors`` add
        to the threshold differs from tick to tick and is not counted.
        """
        assert self.thresholds.rest is not None
        if not resting:
            return self.thresholds.constant.copy()
        smallest: FloatArray = self.thresholds.constant + self.thresholds.rest + self.dead_zone
        return smallest

    def smallest_force(
        self,
        q: npt.ArrayLike,
        direction: npt.ArrayLike,
        *,
        resting: bool = False,
        link: str | None = None,
        point: npt.ArrayLike = (0.0, 0.0, 0.0),
    ) -> float:
        """Force along a direction at a point that passes some threshold for sure, without noise [N].

        min_j torque_j / |(J_v' n)_j| with the torques of :meth:`smallest_torque`; infinite where no watched joint feels
        that direction.

        Args:
            q: (n,) pose [rad or m].
            direction: unit vector, base frame.
            resting: the arm stands still, and friction hides what it can.
            link: name of the link; default: the tip.
            point: in its frame [m].

        Raises:
            InputError: a direction that is no unit vector, or arrays of other shapes.
        """
        n = as_float_array(direction, "direction", (3,))
        if abs(np.linalg.norm(n) - 1) > 1e-9:
            raise InputError("direction", f"has length {np.linalg.norm(n):.6g}", "wanted a unit vector")
        lever = np.abs(self.robot.jacobian(q, link, point)[:3].T @ n)
        with np.errstate(divide="ignore", invalid="ignore"):
            forces = np.where(lever > 1e-12, self.smallest_torque(resting=resting) / lever, np.inf)
        return float(forces.min())

    # --- Running ------------------------------------------------------------------------------------------------------

    def run(self, recording: Recording, *, rearm_s: float = 0.5) -> DetectionRun:
        """Run over a recording as a control loop would, row by row.

        Args:
            recording: with currents (or with joint torque where there is no joint model).
            rearm_s: an alarm is taken as dealt with once everything was below its thresholds for so long [s]; infinite:
                never.

        Raises:
            InputError: other joints, nothing to make torque of, a rate that is not the detector's.
        """
        recording.check_robot(self.robot)
        run = self.run_rows(
            recording.t, recording.q, self._signal(recording), qd=self._rates(recording), rearm_s=rearm_s
        )
        return replace(run, notes=(*recording.report.notes, *run.notes))

    def run_rows(
        self,
        t: npt.ArrayLike,
        q: npt.ArrayLike,
        signal: npt.ArrayLike,
        *,
        qd: npt.ArrayLike | None = None,
        rearm_s: float = 0.5,
    ) -> DetectionRun:
        """Run over rows as they came in: NaN, repeated or disordered rows are for the detector to tell.

        Args:
            t: (N,) [s].
            q: (N, n) [rad or m].
            signal: (N, n) currents in the model's unit, or joint torques [Nm or N].
            qd: (N, n) measured rates, with ``measured_rates`` [rad/s or m/s].
            rearm_s: as for :meth:`run`.

        Raises:
            InputError: arrays of other shapes, rates without ``measured_rates`` or the reverse, or rows at another rate
                than the detector's.
        """
        n = self.robot.dof
        times = as_float_array(t, "t", (None,), finite=False)
        if times.size == 0:
            raise InputError("t", "has no rows", "wanted at least one")
        rows = as_float_array(q, "q", (times.size, n), finite=False)
        signals = as_float_array(signal, "signal", (times.size, n), finite=False)
        rates = None if qd is None else as_float_array(qd, "qd", (times.size, n), finite=False)
        if (rates is None) == self.settings.measured_rates:
            raise InputError("qd", "is needed with measured_rates, and only there")
        check_rearm(rearm_s)
        kernel = self.kernel(period_of(times, self.settings, self.thresholds))
        residual, fast, threshold, state, fault, flags, events = kernel.run(times, rows, signals, rates, rearm_s)
        return DetectionRun(
            t=times,
            residual=residual,
            fast=fast,
            threshold=threshold,
            state=state,
            fault=fault,
            stop=(flags & 1) != 0,
            late=(flags & 2) != 0,
            unseen=(flags & 4) != 0,
            payload_changed=(flags & 8) != 0,
            events=tuple(self._event(event) for event in events),
            notes=(*self.notes, *self._beyond_limits(rows)),
        )

    def _beyond_limits(self, rows: FloatArray) -> list[str]:
        """Joints that were where the detector takes no position for true, as they blind it."""
        margin, notes = self.settings.limit_margin, []
        for j, joint in enumerate(self.robot.joints):
            low, high = self.robot.lower[j], self.robot.upper[j]
            beyond = np.isfinite(rows[:, j]) & ((rows[:, j] < low - margin) | (rows[:, j] > high + margin))
            if beyond.any():
                notes.append(
                    f"{joint.name}: at {rows[beyond, j][0]:.4g}, beyond its limits {low:.4g} to {high:.4g} by more "
                    f"than limit_margin = {margin:g}, in {np.count_nonzero(beyond)} of {len(rows)} rows: blind there."
                )
        return notes

    def kernel(self, period_s: float | None = None) -> core.LoopDetector:
        """The detector in the kernels' form, for one sample after another.

        Args:
            period_s: between samples [s]; None: that of the settings.

        Raises:
            InputError: neither says how long a period is, or it is no time.
        """
        period = self.settings.period_s if period_s is None else period_s
        if period is None:
            raise InputError("period_s", "is not known", "give it in the settings")
        if not as_number(period, "period_s") > 0:
            raise InputError("period_s", f"is {period}", "wanted more than zero")
        links, joints, errors = self.parts()
        return core.LoopDetector(
            self.robot.chain,
            np.array([link.mass for link, _ in links]),
            np.array([link.center for link, _ in links], dtype=np.float64),
            np.array([link.tensor for link, _ in links], dtype=np.float64),
            np.array([rotor for _, rotor in links]),
            joints,
            errors,
            self.kernel_settings(period),
        )

    # --- Parts --------------------------------------------------------------------------------------------------------

    def parts(self) -> tuple[list[Any], list[core.JointTorqueParameters], list[core.JointTorqueErrors]]:
        """Inertia and rotor of every link, and parameters and standard errors of every joint, in the robot's order."""
        return self._drives.links(), self._drives.parameters(), self._drives.errors()

    def kernel_settings(self, period: float) -> core.DetectorSettings:
        """The settings in the kernels' form, for samples every ``period`` seconds."""
        given, robot, n = self.settings, self.robot, self.robot.dof
        out = core.DetectorSettings()
        out.residual = getattr(core.ResidualKind, given.residual)
        out.source = core.TorqueSource.torque if self.model is None else core.TorqueSource.current
        out.observer_gain = given.observer_gain_1_s
        out.window, out.degree = int(given.window), int(given.degree)
        out.gravity = list(given.gravity)
        out.grace = given.grace_s
        out.unknown = sum(1 << j for j in self._drives.unknown)
        out.noise_sd = padded(self.noise_sd, 1.0)
        out.direction = list(given.direction)
        number, point = self._contact
        out.set_contact(robot.chain, number, point.tolist())
        samples = out.samples
        samples.period = period
        samples.shortest_interval = _SHORTEST * period
        samples.late_interval = given.late_periods * period
        samples.longest_interval = given.longest_periods * period
        samples.lower = padded(robot.lower - given.limit_margin)
        samples.upper = padded(robot.upper + given.limit_margin)
        samples.velocity = padded(robot.velocity)
        samples.signal = padded(np.full(n, math.inf) if given.largest_signal is None else given.largest_signal)
        samples.measured_rates = given.measured_rates
        self.fill_decision(out.decision)
        out.payload.mass = given.payload_kg
        out.payload.center = self.payload_center.tolist()
        out.payload_watch.least_mass = given.payload_change_kg
        out.payload_watch.window = given.payload_window_s
        return out

    def fill_decision(self, out: core.DecisionSettings) -> None:
        """Put thresholds and arming into the kernels' form."""
        given, law = self.settings, out.thresholds
        for name in ("constant", "speed", "acceleration", "rest", "fast"):
            setattr(law, name, padded(getattr(self.thresholds, name)))
        law.rest_speed = padded(self.rest_speed, 1.0)
        law.model_errors = self.thresholds.model_errors
        out.arming_delay = given.arming_delay_s
        out.rest_time = given.rest_time_s
        out.low_hz, out.high_hz = given.low_hz, given.high_hz

    @property
    def rest_speed(self) -> FloatArray:
        """(n,) speed below which a joint rests [rad/s or m/s]."""
        return self._drives.rest_speed(self.settings.rest_speed)

    @property
    def noise_sd(self) -> FloatArray:
        """(n,) of the residual [Nm or N]; infinite: the joint is not watched and says nothing of contacts."""
        watched = np.array(self.thresholds.watched)
        assert self.thresholds.fast is not None
        level = np.minimum(self.thresholds.constant, self.thresholds.fast)
        noise = level / _NOISE_PER_THRESHOLD if self.settings.noise_sd is None else np.array(self.settings.noise_sd)
        return np.where(watched, noise, np.inf)

    @property
    def payload_center(self) -> FloatArray:
        """(3,) of the payload, in the frame of the last link [m]."""
        given = self.settings.payload_center
        return np.array(self.robot.tip_origin if given is None else given, dtype=np.float64)

    def explain(self, q: npt.ArrayLike, residual: npt.ArrayLike) -> core.ContactEstimate:
        """What a residual (n,) at a pose (n,) says of a contact, as an event says it."""
        n = self.robot.dof
        number, point = self._contact
        return core.estimate_contact(
            self.robot.chain,
            as_float_array(q, "q", (n,)),
            as_float_array(residual, "residual", (n,)),
            self.noise_sd,
            number,
            np.ascontiguousarray(point),
            np.array(self.settings.direction),
        )

    def _event(self, found: core.DetectorEvent) -> Event:
        n = self.robot.dof
        return self.event_of(
            found.contact,
            t=found.t,
            joints=bits(found.over),
            fast_joints=bits(found.over_fast),
            residual=np.array(found.residual[:n]),
            threshold=np.array(found.threshold[:n]),
            q=np.array(found.q[:n]),
            payload_change_kg=found.payload_change if found.payload_changed else None,
        )

    def event_of(self, contact: core.ContactEstimate, **fields: Any) -> Event:
        """An event from what its residual says of a contact."""
        names = [joint.link for joint in self.robot.joints]
        return Event(
            force_along=contact.force_along,
            force=np.array(contact.force),
            leftover=contact.leftover,
            link=names[contact.link] if contact.link >= 0 else None,
            possible_links=tuple(names[i] for i in bits(contact.possible)),
            **fields,
        )

    def _note(self) -> None:
        notes = []
        if not any(self.thresholds.watched):
            notes.append("No joint is watched: no contact can be noticed.")
        notes += self._drives.notes()
        if self.model is not None:
            hidden, unit = ", ".join(f"{value:.3g}" for value in self.dead_zone), unit_of(*self.robot.joints)
            notes.append(f"At standstill friction may hide up to {hidden} {unit} by joint: a resting arm feels less.")
        fast = [joint.name for joint in self.robot.joints if not math.isfinite(joint.velocity)]
        if fast:
            notes.append(f"{', '.join(fast)}: without a speed limit, no jump is impossible.")
        self.notes = tuple(notes)

    def _signal(self, recording: Recording) -> FloatArray:
        where = recording.source or "the recording"
        if self.model is None:
            if recording.tau is None:
                raise InputError("recording", f"{where} has no joint torque", "with currents a joint model is needed")
            return recording.tau
        if recording.current is None:
            raise InputError("recording", f"{where} has no current", "the joint model makes torque of motor current")
        return recording.current

    def _rates(self, recording: Recording) -> FloatArray | None:
        if not self.settings.measured_rates:
            return None
        if recording.qd is None:
            problem = f"{recording.source or 'it'} has no joint speeds"
            raise InputError("recording", problem, "wanted qd_1 .., or no measured rates")
        return recording.qd


def padded(values: npt.ArrayLike, rest: float = 0.0) -> list[float]:
    """As many numbers as the kernels' arrays hold."""
    numbers = [float(value) for value in np.asarray(values)]
    return numbers + [rest] * (core.max_joints - len(numbers))
