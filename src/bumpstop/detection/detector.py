"""The detector of collisions: robot, joint model, thresholds and settings, over a recording or tick by tick."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_float_array
from bumpstop.detection.contact_place import contact_place
from bumpstop.detection.detection_run import FAULTS, DetectionRun, frozen_notes
from bumpstop.detection.events import Event
from bumpstop.detection.loop.loop_detector import LoopDetector
from bumpstop.detection.loop.unknown_gains import force_thresholds
from bumpstop.detection.rate import period_of
from bumpstop.detection.settings import DetectorSettings, check_rearm
from bumpstop.detection.tuning.found_with import found_with
from bumpstop.errors import InputError
from bumpstop.model import unit_of
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.recording.checks.stamps import stamped_by_a_pc

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.recording import Recording


class Detector(LoopDetector):
    """Residuals against thresholds. C++ has the same class under the same name; this one makes it and runs it.

    *Direct* residual (eq 4.1): torque estimated from the current minus Newton-Euler torque. A contact torque shows at
    once. Its noise is that of the estimated torque, and M(q) times that of the accelerations, which with degree 2 are
    half a window late (``signal.causal_derivatives`` gives their noise).

    *Observer*: minus the external torque of a momentum observer. It needs no acceleration. With a = exp(-K dt) a step
    of the torque shows as 1 - a^k (1 + a) / 2 of itself k samples after the first that has it: 1 - exp(-K t), half a
    sample late. White noise of standard deviation s in the torque leaves s sqrt((1 - a) / 2), in the momentum
    s (1 - a) / dt sqrt(2 / (1 + a)).

    The *band-pass channel* is the residual through a band-pass from low_hz to high_hz, with thresholds of its own. With
    a = exp(-2 pi high_hz dt) and b = exp(-2 pi low_hz dt) its delay is dt a / (1 - a), and white noise of standard
    deviation s leaves s b (1 - a) sqrt(2 / ((1 + a) (1 + b) (1 - a b))).

    Attributes:
        robot: with inertia. Where the joint model knows a reflected inertia, the robot's rotor does not count again.
        model: of currents, matched by joint names; None: recordings have joint torque.
        thresholds: by joint.
        settings: everything else.
        notes: what a reader of any result must know.
    """

    def smallest_torque(self, *, resting: bool = False) -> FloatArray:
        """(n,) external torque that passes the threshold for sure, without noise [Nm or N].

        Infinite of joints that are not monitored or of unknown gain. Moving: the constant threshold. Resting: the
        threshold at rest and the dead zone that may hide as much of the torque; below it no contact with a resting arm
        shows. What speed, acceleration and ``model_errors`` add to the threshold differs from tick to tick and is not
        counted.
        """
        assert self.thresholds.rest is not None
        counted, _ = force_thresholds(self.robot, self.model, self.thresholds.constant)
        if not resting:
            return counted
        hidden = np.nan_to_num(self.dead_zone, nan=math.inf)
        smallest: FloatArray = counted + self.thresholds.rest + hidden
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
        is loaded by that direction.

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
        pose = as_float_array(q, "q", (self.robot.dof,))
        lever = np.abs(self.robot.jacobian(pose, link, point)[:3].T @ n)
        with np.errstate(divide="ignore", invalid="ignore"):
            forces = np.where(lever > 1e-12, self.smallest_torque(resting=resting) / lever, np.inf)
        return float(forces.min())

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
        notes = recording.report.with_payload(self.settings.payload_kg, self.payload_at_tip.tolist()).notes
        return replace(run, notes=(*notes, *([doubt] if doubt else []), *run.notes))

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
            events=tuple(Event.of_loop(self.links, event) for event in events),
            notes=(
                *self.notes,
                *window_notes(self.settings, period),
                *self._beyond_limits(rows),
                *frozen_notes(times, fault == FAULTS.index("frozen")),
            ),
            settings=self.summary(period),
            found_with=found_with(self.robot, self.model, self.settings),
            monitored=tuple(self.thresholds.monitored),
            **self.in_words,
        )

    @property
    def links(self) -> list[str]:
        """(n,) names of the links, of the joint that moves each."""
        return [joint.link for joint in self.robot.joints]

    @property
    def in_words(self) -> dict[str, Any]:
        """Units of the joints' torques, and where and along what forces act: fields of a :class:`DetectionRun`."""
        at = contact_place(self.links, *self._contact, self.robot.tip_name, self.robot.tip_origin)
        along = " ".join(f"{x:.4g}" for x in self.settings.direction)
        return {
            "units": tuple(unit_of(joint) for joint in self.robot.joints),
            "force_at": f"at {at} along {along}",
        }

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

    def summary(self, period: float) -> dict[str, Any]:
        """What decides about residuals and alarms, by the names of the settings where they have one."""
        given = self.settings
        found: dict[str, Any] = {
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
        if given.payload_center is not None:
            found["payload_center"] = list(given.payload_center)
        if self._gravity != STANDARD_GRAVITY:
            found["gravity"] = list(self._gravity)
        return found | ({"observer_gain_1_s": given.observer_gain_1_s} if given.residual == "observer" else {})

    def hidden(self, qd: npt.ArrayLike) -> FloatArray:
        """(n,) torque that friction may hide at rates (n,): the dead zone up to rest_speed, none from twice that on.

        Zero of a joint that no drive is known of: it says nothing anyway.
        """
        share = np.clip(2 - np.abs(as_float_array(qd, "qd", (self.robot.dof,))) / self.rest_speed, 0.0, 1.0)
        found: FloatArray = np.nan_to_num(self.dead_zone) * share
        return found

    def explain(
        self, q: npt.ArrayLike, residual: npt.ArrayLike, qd: npt.ArrayLike | None = None
    ) -> _native.ContactEstimate:
        """What a residual (n,) at a pose (n,) says of a contact, as an event says it.

        A joint that stands still, as ``qd`` (n,) says, and whose friction hides more than its noise, says nothing where
        its residual is zero; where it is not, it counts with what friction hides as its uncertainty. Without ``qd`` all
        move.
        """
        n = self.robot.dof
        hidden = np.zeros(n) if qd is None else self.hidden(qd)
        settings = _native.DetectorSettings()
        self.fill_contact(settings)
        return _native.estimate_contact(
            self.robot.chain,
            settings,
            as_float_array(q, "q", (n,)),
            as_float_array(residual, "residual", (n,)),
            hidden,
        )

    def _signal(self, recording: Recording) -> FloatArray:
        where = recording.source or "the recording"
        if not self.takes_current:
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
