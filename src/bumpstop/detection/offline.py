"""Residuals of a recording: by a joint model as the loop would have them, or by fitted dynamics afterwards."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from bumpstop import _native
from bumpstop.detection.detection_run import NO_DATA, STATES, DetectionRun, frozen_notes
from bumpstop.detection.detector import Detector
from bumpstop.detection.events import Event
from bumpstop.detection.loop.unknown_gains import force_thresholds, unknown_gains
from bumpstop.detection.offline_residual import OfflineResidual
from bumpstop.detection.rate import period_of
from bumpstop.detection.settings import DetectorSettings, check_rearm
from bumpstop.detection.standing import hidden_torques
from bumpstop.detection.thresholds import Thresholds
from bumpstop.detection.tuning.found_with import found_with
from bumpstop.detection.tuning.residual_record import ResidualRecord
from bumpstop.errors import InputError
from bumpstop.model import with_some_inertia
from bumpstop.recording.checks.stamps import stamped_by_a_pc

if TYPE_CHECKING:
    import numpy.typing as npt

    from bumpstop.arrays import FloatArray
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

_CAUSAL = "or the residual of a loop, which has it (--causal, or causal = true)"
_TOLERANCE = 0.01  # of a period: what ResidualRecord.load allows


def detect(
    recording: Recording,
    robot: Robot,
    model: JointTorqueModel | DynamicsModel | None,
    thresholds: Thresholds | npt.ArrayLike,
    settings: DetectorSettings | None = None,
    *,
    rearm_s: float = 0.5,
) -> DetectionRun:
    """Run a detector over a recording.

    With fitted dynamics the residual is recorded minus predicted torque. With ``causal`` settings a loop has the same
    residual, and this is a run of :class:`Detector`. Without, prediction uses zero-phase filters, which look
    ahead: it is an analysis of a recording, not what a loop would have seen. Such a residual is always direct. It has
    no data inside a gap, where rows are made up, and within a period of the cut-off beside one of more than 0.1 s and
    ten intervals, or beside an end at which the arm moves, where the filter knows one side of the motion only. Feedback
    that is frozen is such a gap.

    Args:
        recording: with currents for a joint model, with joint torque otherwise.
        robot: with inertia, unless dynamics are fitted.
        model: of currents; or a model of dynamics; or None, where the robot's own inertia predicts recorded torque.
        thresholds: by joint.
        settings: everything else; None: as the thresholds say they were found, else the defaults.
        rearm_s: as for :meth:`Detector.run`.

    Raises:
        InputError: parts that do not belong together, or another rate than what they are made for; with fitted
            dynamics that look ahead an observer, payloads, measured rates, a largest signal or a margin of limits.
    """
    # Fits are a tenth of the time that laws take to start, and these need none.
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.identification.fit_verdict import as_sentences, fit_faults

    law = Thresholds.of(thresholds, robot.dof, [joint.name for joint in robot.joints])
    causal = law.causal if settings is None else settings.causal
    if not isinstance(model, DynamicsModel) or causal:
        return Detector(robot, model, law, settings).run(recording, rearm_s=rearm_s)
    given = settings or DetectorSettings(**law.settings_looking_ahead)
    given = _checked_settings(given, model, robot, recording.q)
    check_rearm(rearm_s)
    if law.model_errors > 0:
        raise InputError("model_errors", "is not available with fitted dynamics", "they have no errors of currents")
    doubt = stamped_by_a_pc(recording)
    found = OfflineResidual.of(recording, model, given.frozen_s)
    detector = Detector(with_some_inertia(robot), None, law, given)
    period = period_of(found.motion.t, given, law)
    unknown = unknown_gains(robot, model)
    if unknown:
        # What is no torque in Nm says nothing of a force.
        noise = detector.noise_sd.copy()
        noise[unknown] = math.inf
        detector = Detector(detector.robot, None, law, replace(given, noise_sd=tuple(noise.tolist())))
    judged = _judge(detector, found, rearm_s)
    no_data, nothing = found.no_data, np.zeros(found.motion.t.size, dtype=bool)
    judged.fast[no_data] = math.nan
    judged.state[no_data] = NO_DATA
    return DetectionRun(
        t=found.motion.t,
        residual=found.residual,
        fast=judged.fast,
        threshold=judged.threshold,
        state=judged.state,
        fault=found.fault,
        stop=judged.state == STATES.index("alarm"),
        late=nothing,
        masked_while_arming=(judged.masked != 0) & ~no_data,
        payload_changed=nothing,
        events=judged.events,
        notes=(
            *recording.report.notes,
            *as_sentences(fit_faults(model)),
            *([doubt] if doubt else []),
            *found.notes,
            *force_thresholds(robot, model, law.constant)[1],
            *detector.notes,
            *frozen_notes(found.motion.t, found.frozen),
        ),
        settings={
            name: detector.summary(period)[name] for name in ("residual", "period_s", "frozen_s", "arming_delay_s")
        },
        monitored=tuple(law.monitored),
        found_with=found_with(robot, model, given),
        **detector.in_words,
    )


def _checked_settings(given: DetectorSettings, model: DynamicsModel, robot: Robot, q: FloatArray) -> DetectorSettings:
    """The settings, with what friction hides of joints that stand in poses (N, dof) where they leave it out.

    Raises:
        InputError: some are not for residuals that look ahead, or the model is of another robot.
    """
    if given.window_s != DetectorSettings.window_s:
        raise InputError(
            "window_s", "is not available with fitted dynamics: they filter both ways", f"leave it out, {_CAUSAL}"
        )
    if given.residual != "direct":
        raise InputError(
            "residual", f"{given.residual!r} is not available with fitted dynamics", f"valid: 'direct'; {_CAUSAL}"
        )
    for name in ("payload_kg", "payload_change_kg", "measured_rates", "largest_signal"):
        if getattr(given, name):
            # Not advised to be left out: the torque of a load would be in the residual.
            raise InputError(name, "is not available with fitted dynamics", f"wanted a joint model, {_CAUSAL}")
    if given.limit_margin != DetectorSettings.limit_margin:
        raise InputError(
            "limit_margin", "is not available with fitted dynamics: they know no limits", f"leave it out, {_CAUSAL}"
        )
    if model.robot.dof != robot.dof:
        raise InputError("model", f"is for {model.robot.dof} joints", f"{robot.name} has {robot.dof}")
    if given.stiction is not None:
        return given
    # A standing joint's motor shows nothing of what its friction holds.
    return replace(given, stiction=tuple(hidden_torques(robot, model, given, q).tolist()))


class _Judged(NamedTuple):
    """What the alarm logic says of all rows; of one without data what it said of the row before.

    Attributes:
        fast: (N, dof) of the band-pass channel [Nm or N].
        threshold: (N, dof) [Nm or N].
        state: (N,) by number in ``STATES``.
        masked: (N,) not zero: a residual over its threshold is no alarm, as the detector was arming.
        events: in the rows with data.
    """

    fast: FloatArray
    threshold: FloatArray
    state: npt.NDArray[np.uint8]
    masked: npt.NDArray[np.uint8]
    events: tuple[Event, ...]


def _judge(detector: Detector, found: OfflineResidual, rearm_s: float) -> _Judged:
    decision = _native.AlarmSettings()
    detector.fill_alarm_settings(decision)
    if math.isinf(rearm_s):
        decision.event_pause = math.inf
    motion, residual, known = found.motion, found.residual, ~found.no_data
    seen = np.flatnonzero(known)
    after_gap = np.diff(seen, prepend=-1) > 1
    *columns, rows, over, over_fast, spans = _native.run_alarm_logic(
        decision,
        motion.t[seen],
        residual[seen],
        motion.qd[seen],
        motion.qdd[seen],
        after_gap.astype(np.float64),
        rearm_s,
    )
    # The row before, by which those without data go: before the first there is none.
    before = np.cumsum(known)
    fast, threshold, state, masked = (
        np.concatenate([np.zeros_like(c, shape=(1, *c.shape[1:])), c])[before] for c in columns
    )
    events = tuple(
        Event.of(
            detector.links,
            detector.explain(motion.q[row], residual[row], motion.qd[row]),
            spans[k],
            hidden=detector.hidden(motion.qd[row]),
            t=float(motion.t[row]),
            joints=tuple(j for j in range(detector.robot.dof) if over[k] >> j & 1),
            fast_joints=tuple(j for j in range(detector.robot.dof) if over_fast[k] >> j & 1),
            residual=residual[row],
            threshold=threshold[row],
            q=motion.q[row],
        )
        for k, row in enumerate(seen[rows])
    )
    return _Judged(fast, threshold, state, masked, events)


def residual_record(
    recording: Recording,
    robot: Robot,
    model: JointTorqueModel | DynamicsModel | None,
    *,
    settings: DetectorSettings | None = None,
    feedback_period_s: float | None = None,
) -> ResidualRecord:
    """Residuals of a contact-free recording, to be resampled as a scenario's noise or to tune thresholds by.

    Args:
        recording: in which nothing is touched.
        robot: with inertia, unless dynamics are fitted.
        model: as for :func:`detect`.
        settings: of the detector whose residual it is.
        feedback_period_s: keep a row every so often, a whole number of the recording's periods [s]; None: all.

    Returns:
        Rows with their times; rows without data are left out, and a note counts them.

    Raises:
        InputError: as :func:`detect`; fewer than 100 rows with data; a feedback period that is no multiple of
            the recording's.
    """
    from bumpstop.identification.segments.torque_samples import STILL

    run = detect(recording, robot, model, np.full(robot.dof, math.inf), settings)
    seen = np.flatnonzero(~run.no_data)
    if not seen.size:
        why = ", ".join(f"{name} {rows}" for name, rows in run.no_data_rows().items())
        beyond = " ".join(note for note in run.notes if "beyond its limits" in note)
        problem = f"the detector has no data in all {run.t.size} rows ({why})"
        raise InputError(recording.source or "recording", problem, beyond)
    notes = tuple(note for note in run.notes if not note.startswith("No joint is monitored"))
    named = f"{recording.source}: " if recording.source else ""
    still = np.flatnonzero(np.ptp(recording.q, axis=0) < STILL)
    if still.size:
        names = ", ".join(robot.joints[j].name for j in still)
        notes = (
            *notes,
            f"{named}{names}: hardly moved in this recording; what motion adds to residuals is not in it.",
        )
    if seen.size < run.t.size:
        left = f"{run.t.size - seen.size} of {run.t.size} rows are left out: the detector had no data."
        notes = (*notes, named + left)
    if feedback_period_s is not None:
        period = float(np.median(np.diff(run.t)))
        stride = max(1, round(feedback_period_s / period))
        if abs(stride * period - feedback_period_s) > _TOLERANCE * feedback_period_s:
            raise InputError(
                "feedback_period_s",
                f"{feedback_period_s:g} is no multiple of the rows' period, {period:.6g} s",
                f"for example {stride * period:.6g}",
            )
        seen = seen[::stride]
    record = ResidualRecord.from_rows(np.ascontiguousarray(run.residual[seen]), notes, run.t[seen])
    return replace(record, found_with=run.found_with)
