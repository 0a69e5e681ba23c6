"""The detector of collisions: robot, joint model, thresholds and settings, over a recording or tick by tick."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_float_array, as_number
from bumpstop.detection.drive_matching import MatchedDrives
from bumpstop.detection.events import FAULTS, DetectionRun, Event, bits, check_rearm, frozen_notes
from bumpstop.detection.rate import check_rates, period_of
from bumpstop.detection.settings import DetectorSettings
from bumpstop.detection.standing import checked_stiction
from bumpstop.detection.thresholds import Thresholds
from bumpstop.errors import InputError
from bumpstop.model import unit_of
from bumpstop.recording.checks.stamps import stamped_by_a_pc

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Of a period: samples closer together repeat each other.
_MIN_PERIOD_SHARE = 0.1
_NOISE_PER_THRESHOLD = 3.0
# Of the speed limits, and at least [rad/s or m/s].
_UNWATCHED_TIMES = 10.0
_UNWATCHED_SPEED = 30.0
# Range of a joint that turns twice around, a little less than that for figures that are rounded [rad].
_TWO_TURNS = 3.99 * math.pi


class Detector:
    """Residuals against thresholds. C++ has the same class under the same name; this one makes it and runs it.

    *Direct* residual (eq 4.1): torque estimated from the current minus Newton-Euler torque. A contact torque shows at
    once. Its noise is that of the estimated torque, and M(q) times that of the accelerations, which with degree 2 are
    half a window late (``signal.causal_derivatives`` gives their noise).

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

        Without settings they are those that the thresholds say they were found with, and else the defaults.

        Raises:
            InputError: joints of the model that the robot has not, joints without a model that are monitored,
                thresholds of another length or found for another residual or rate, no inertia, a link that does not
                exist.
        """
        self.robot = robot
        self.model = model
        self.thresholds = Thresholds.of(thresholds, robot.dof, [joint.name for joint in robot.joints])
        self.settings = settings or DetectorSettings(**self.thresholds.settings)
        self.thresholds.check_residual(self.settings.residual, self.settings.observer_gain_1_s)
        check_rates(self.settings, self.thresholds)
        self.notes: tuple[str, ...] = ()
        self._drives = MatchedDrives(robot, model, self.thresholds.monitored)
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
        rest_speed through the map's slope without current, plus T_H. What the settings state as stiction stands in its
        place. Zero without either.
        """
        stated = self.settings.stiction
        return self._drives.dead_zone() if stated is None else checked_stiction(stated, self.robot.dof)

    def smallest_torque(self, *, resting: bool = False) -> FloatArray:
        """(n,) external torque that passes the threshold for sure, without noise [Nm or N]; infinite: not monitored.

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

        min_j torque_j / |(J_v' n)_j| with the torques of :meth:`smallest_torque`; infinite where no monitored joint
        feels that direction.

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
        doubt = stamped_by_a_pc(recording)
        run = self.run_rows(
            recording.t, recording.q, self._signal(recording), qd=self._rates(recording), rearm_s=rearm_s
        )
        return replace(run, notes=(*recording.report.notes, *([doubt] if doubt else []), *run.notes))

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
        period = period_of(times, self.settings, self.thresholds)
        kernel = self.kernel(period, latched=math.isinf(rearm_s))
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
            masked_while_arming=(flags & 4) != 0,
            payload_changed=(flags & 8) != 0,
            events=tuple(self._event(event) for event in events),
            notes=(
                *self.notes,
                *window_notes(self.settings, period),
                *self._beyond_limits(rows),
                *frozen_notes(times, fault == FAULTS.index("frozen")),
            ),
            settings=self.summary(period),
            monitored=tuple(self.thresholds.monitored),
        )

    def _beyond_limits(self, rows: FloatArray) -> list[str]:
        """Joints that were where the detector takes no position for true, as they take its data away."""
        margin, notes = self.settings.limit_margin, []
        for j, joint in enumerate(self.robot.joints):
            if j not in self._limited:
                continue
            low, high = self.robot.lower[j], self.robot.upper[j]
            beyond = np.isfinite(rows[:, j]) & ((rows[:, j] < low - margin) | (rows[:, j] > high + margin))
            if beyond.any():
                notes.append(
                    f"{joint.name}: at {rows[beyond, j][0]:.4g}, beyond its limits {low:.4g} to {high:.4g} by more "
                    f"than limit_margin = {margin:g}, in {np.count_nonzero(beyond)} of {len(rows)} rows: no data there."
                )
        return notes

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
            settings.decision.event_pause = math.inf
        return _native.LoopDetector(
            self.robot.chain,
            np.array([link.mass for link, _ in links]),
            np.array([link.center for link, _ in links], dtype=np.float64),
            np.array([link.tensor for link, _ in links], dtype=np.float64),
            np.array([rotor for _, rotor in links]),
            joints,
            errors,
            settings,
        )

    # --- Parts --------------------------------------------------------------------------------------------------------

    def parts(self) -> tuple[list[Any], list[_native.JointTorqueParameters], list[_native.JointTorqueErrors]]:
        """Inertia and rotor of every link, and parameters and standard errors of every joint, in the robot's order."""
        return self._drives.links(), self._drives.parameters(), self._drives.errors()

    def kernel_settings(self, period: float) -> _native.DetectorSettings:
        """The settings in the kernels' form, for samples every ``period`` seconds."""
        given, robot, n = self.settings, self.robot, self.robot.dof
        out = _native.DetectorSettings()
        out.residual = getattr(_native.ResidualKind, given.residual)
        out.source = _native.TorqueSource.torque if self.model is None else _native.TorqueSource.current
        out.observer_gain = given.observer_gain_1_s
        out.window, out.degree = given.window_s, int(given.degree)
        out.gravity = list(given.gravity)
        out.max_no_data_time = given.max_no_data_s
        out.unknown = sum(1 << j for j in self._drives.unknown)
        out.noise_sd = padded(self.noise_sd, 1.0)
        out.dead_zone = padded(self.dead_zone)
        out.direction = list(given.direction)
        number, point = self._contact
        out.set_contact(robot.chain, number, point.tolist())
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
        self.fill_decision(out.decision)
        out.payload.mass = given.payload_kg
        out.payload.center = self.payload_center.tolist()
        out.payload_monitor.min_mass = given.payload_change_kg
        out.payload_monitor.window = given.payload_window_s
        return out

    def fill_decision(self, out: _native.DecisionSettings) -> None:
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

    def summary(self, period: float) -> dict[str, Any]:
        """What decides about residuals and alarms, by the names of the settings where they have one."""
        given = self.settings
        found = {
            "residual": given.residual,
            "period_s": float(f"{period:.6g}"),
            "window_s": given.window_s,
            "window_samples": given.window_samples(period),
            "frozen_s": None if math.isinf(given.frozen_s) else given.frozen_s,
            "limit_margin": given.limit_margin,
            "payload_kg": given.payload_kg,
            "measured_rates": given.measured_rates,
            "arming_delay_s": given.arming_delay_s,
        }
        return found | ({"observer_gain_1_s": given.observer_gain_1_s} if given.residual == "observer" else {})

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
        return np.where(monitored, noise, np.inf)

    @property
    def payload_center(self) -> FloatArray:
        """(3,) of the payload, in the frame of the last link [m]."""
        given = self.settings.payload_center
        return np.array(self.robot.tip_origin if given is None else given, dtype=np.float64)

    def hidden(self, qd: npt.ArrayLike) -> FloatArray:
        """(n,) torque that friction may hide at rates (n,): the dead zone up to rest_speed, none from twice that on."""
        share = np.clip(2 - np.abs(as_float_array(qd, "qd", (self.robot.dof,))) / self.rest_speed, 0.0, 1.0)
        found: FloatArray = self.dead_zone * share
        return found

    def explain(
        self, q: npt.ArrayLike, residual: npt.ArrayLike, qd: npt.ArrayLike | None = None
    ) -> _native.ContactEstimate:
        """What a residual (n,) at a pose (n,) says of a contact, as an event says it.

        A joint that stands still, as ``qd`` (n,) says, and whose friction hides more than its noise, says nothing where
        its residual is zero; where it is not, it is believed to within what friction hides. Without ``qd`` all move.
        """
        n = self.robot.dof
        hidden = np.zeros(n) if qd is None else self.hidden(qd)
        number, point = self._contact
        return _native.estimate_contact(
            self.robot.chain,
            as_float_array(q, "q", (n,)),
            as_float_array(residual, "residual", (n,)),
            self.noise_sd,
            hidden,
            number,
            np.ascontiguousarray(point),
            np.array(self.settings.direction),
        )

    def _event(self, found: _native.DetectorEvent) -> Event:
        n = self.robot.dof
        return self.event_of(
            found.contact,
            t=found.t,
            joints=bits(found.over),
            fast_joints=bits(found.over_fast),
            residual=np.array(found.residual[:n]),
            threshold=np.array(found.threshold[:n]),
            q=np.array(found.q[:n]),
            span=found.span,
            hidden=np.array(found.hidden[:n]),
            payload_change_kg=found.payload_change if found.payload_changed else None,
        )

    def event_of(self, contact: _native.ContactEstimate, span: _native.EventSpan, **fields: Any) -> Event:
        """An event from what its residual says of a contact, and how long it lasts."""
        names = [joint.link for joint in self.robot.joints]
        return Event(
            end=span.end,
            largest_residual=np.array(span.largest[: self.robot.dof]),
            largest_t=span.largest_time if span.largest_joint >= 0 else span.begin,
            largest_joint=span.largest_joint if span.largest_joint >= 0 else None,
            force_along=contact.force_along,
            force_along_sd=contact.force_along_sd,
            force=np.array(contact.force),
            leftover=contact.leftover,
            link=names[contact.link] if contact.link >= 0 else None,
            possible_links=tuple(names[i] for i in bits(contact.possible)),
            **fields,
        )

    def _note(self) -> None:
        notes = self.thresholds.differences(self.settings)
        if not any(self.thresholds.monitored):
            notes.append("No joint is monitored: no contact can be detected.")
        notes += self._drives.notes()
        if self.model is not None or self.settings.stiction is not None:
            hidden, unit = ", ".join(f"{value:.3g}" for value in self.dead_zone), unit_of(*self.robot.joints)
            notes.append(
                f"At standstill friction may hide up to {hidden} {unit} by joint: an arm at rest detects less."
            )
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


def window_notes(settings: DetectorSettings, period: float) -> list[str]:
    """What the rate makes of the window, where that is not what was asked for."""
    samples = settings.window_samples(period)
    spanned = (samples - 1) * period
    if abs(spanned - settings.window_s) <= max(0.51 * period, 0.01 * settings.window_s):
        return []
    return [
        f"The window is {samples} samples, {spanned:.4g} s, at a row every {period:.4g} s: not {settings.window_s:g} s."
    ]


def padded(values: npt.ArrayLike, rest: float = 0.0) -> list[float]:
    """As many numbers as the kernels' arrays hold."""
    numbers = [float(value) for value in np.asarray(values)]
    return numbers + [rest] * (_native.max_joints - len(numbers))
