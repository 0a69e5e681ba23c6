"""Inertial (base) parameters, friction and rotor inertia of an arm from recorded joint torques."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.dynamics.dynamics_model_selection import ENOUGH_TO_CHOOSE, best_friction, choose_cutoff
from bumpstop.identification.dynamics.dynamics_system import FIT_PER_CUTOFF
from bumpstop.identification.dynamics.regressor import inertial_torque
from bumpstop.identification.dynamics.regressor_columns import column_names, torque_of
from bumpstop.identification.segments.motion import GRAVITY
from bumpstop.identification.segments.seen_motion import SeenMotion
from bumpstop.identification.segments.torque_samples import TorqueRows, listed, recorded_motion, still_joints

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.identification.dynamics.dynamics_system import System
    from bumpstop.identification.payload.payload import Payload
    from bumpstop.identification.segments.motion import EvenMotion
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Rows behind the filter that a fit goes through; of more, blocks spread over the time.
ENOUGH_TO_FIT = 10_000
_ROUNDING = 1e-12  # of a filter, as a share of what passes it


@dataclass(frozen=True, kw_only=True)
class JointScore:
    """How well torques of one joint are predicted.

    Attributes:
        name: of the joint.
        r2: share of the torque's variance that is predicted, both filtered alike.
        r2_raw: the same against the unfiltered torque.
        mean, sd, rmse: of the error, predicted less measured, unfiltered [Nm or N].
    """

    name: str
    r2: float
    r2_raw: float
    mean: float
    sd: float
    rmse: float


@dataclass(frozen=True, kw_only=True, eq=False)
class DynamicsFit:
    """Parameters that a recording shows, and what they predict.

    Attributes:
        robot: the chain.
        columns: numbers of the independent columns of :func:`torque_columns`.
        names: of the base parameters: the column's own, with the others that move with it.
        values, standard_errors: of the base parameters; the errors hold under residuals correlated in time.
        sign_speed: (n + shared motors,) speed scale of Coulomb friction, of joints, then of shared motors; or (n,): a
            shared motor has the mean of its joints' [rad/s or m/s].
        couplings: groups of joints that share a motor, as (joint, factor) pairs.
        cutoff_hz: of the motion's filter, chosen by held-out error.
        held_out: mean over joints of 1 - R2 on held-out fifths, by the cut-off that was tried [Hz].
        unseen: inertial and friction parameters that the motion cannot show at all.
        still: joints that hardly moved: their friction, rotors and whatever only their motion shows are noise.
        rows_used: of the fit, behind the filter.
        rows_whole: rows that the filter leaves of the whole recordings; where these are more, blocks of ``rows_used``
            rows stand for them. 0: read from a file.
        top_speed: (n + shared motors,) fastest of the fit, up to which friction bends [rad/s or m/s]; None: friction is
            a straight line of the speed.
        covariance: of the base parameters, whose diagonal the standard errors are; None: read from a file.
        predicting: values that predictions use, fitted without the parameters that the recording cannot tell from zero,
            which are 0 here; None: predictions use ``values``.
        predicted_by_all: joints (from 0) whose predictions use ``values`` all the same.
        loaded: joints (from 0) whose friction grows with the torque that loads the gear.
        rows_left: recorded rows in stretches between gaps too short to use.
        rows_beside_gaps: recorded rows left away within a period of the cut-off of a gap.
        rows_at_ends: the same where recordings begin and end.
        rows_at_rest: (n,) rows of the fit at which a joint rests: they stay out of its own; None: read from a file.
        gravity: acceleration of free fall in the base frame, of the recordings and of predictions [m/s2].
        gains: (n,) torque per motor current that were found together with the parameters [Nm/A or N/A]; None: the
            recordings of the fit had torques.
        gain_errors: (n,) standard errors of ``gains``; 0: it was given, infinite: the recordings do not show it, and
            the scale of this joint's torque means nothing.
        fitted: motion and torque that it was fitted to; None: read from a file, or fitted to currents.
        condition: condition number of the columns of the fit, weighted and brought to length one; None: read from a
            file.
        unexplained: (n,) share of the filtered torque's (of gains: current's) variance that is left on held-out fifths;
            None: read from a file.
        usual_torque: (n,) root mean square of the torque of the fit, that of known loads included [Nm or N]; None: read
            from a file.
        seen: ranges of the fit's motion; None: a file of an older version.
        verdict: on the fit as the file that it was read from has it; else empty.
    """

    robot: Robot
    columns: tuple[int, ...]
    names: tuple[str, ...]
    values: FloatArray
    standard_errors: FloatArray
    sign_speed: FloatArray
    couplings: tuple[tuple[tuple[int, float], ...], ...]
    cutoff_hz: float
    held_out: dict[float, float]
    unseen: tuple[str, ...]
    rows_used: int
    top_speed: FloatArray | None = None
    covariance: FloatArray | None = None
    predicting: FloatArray | None = None
    rows_left: int = 0
    rows_beside_gaps: int = 0
    rows_whole: int = 0
    gains: FloatArray | None = None
    gain_errors: FloatArray | None = None
    fitted: TorqueRows | None = None
    still: tuple[str, ...] = ()
    condition: float | None = None
    unexplained: FloatArray | None = None
    usual_torque: FloatArray | None = None
    seen: SeenMotion | None = None
    verdict: str = ""
    predicted_by_all: tuple[int, ...] = ()
    loaded: tuple[int, ...] = ()
    rows_at_ends: int = 0
    gravity: tuple[float, float, float] = GRAVITY
    rows_at_rest: FloatArray | None = None

    def predict(self, motion: EvenMotion, carried: FloatArray | None = None) -> FloatArray:
        """Joint torques (N, n) of a motion [Nm or N].

        Args:
            motion: of the robot.
            carried: (N, n) torque of a payload, which loads the gears but is not in the result; default: none.
        """
        loads = self.loads(motion, carried)

        def torque(values: FloatArray) -> FloatArray:
            every = self._every(values)
            return torque_of(self.robot, motion, every, self.sign_speed, self.couplings, self.top_speed, loads)

        if self.predicting is None:
            return torque(self.values)
        found = torque(self.predicting)
        if self.predicted_by_all:
            own = list(self.predicted_by_all)
            found[:, own] = torque(self.values)[:, own]
        return found

    def loads(self, motion: EvenMotion, carried: FloatArray | None = None) -> dict[int, FloatArray]:
        """Torque (N,) that loads the gear, of joints whose friction grows with it [Nm or N]; as for :meth:`predict`."""
        if not self.loaded:
            return {}
        inertial = self._every(self.values)[: 10 * self.robot.dof]
        load = inertial_torque(self.robot, motion.q, motion.qd, motion.qdd, motion.gravity, inertial)
        load = load if carried is None else load + carried
        return {j: np.ascontiguousarray(load[:, j]) for j in self.loaded}

    def _every(self, values: FloatArray) -> FloatArray:
        """Values of all columns out of those of the base parameters."""
        every = np.zeros(len(column_names(self.robot, self.couplings, self.top_speed, self.loaded)))
        every[list(self.columns)] = values
        return every

    def residual(self, recording: Recording) -> tuple[EvenMotion, FloatArray]:
        """Recorded minus predicted torque, unfiltered, of the same robot.

        Returns:
            The motion on its even grid, and the residual (N, n) there [Nm or N].

        Raises:
            InputError: no torque, other joints, or too few rows.
        """
        recording.check_robot(self.robot)
        motion, torque = recorded_motion(recording, self.cutoff_hz, self.gains)
        motion = replace(motion, gravity=self.gravity)
        return motion, torque - self.predict(motion)

    def rows(
        self,
        recordings: Recording | Sequence[Recording],
        payloads: Sequence[Payload | None] = (),
        *,
        limit: int | None = None,
        ends: bool = True,
    ) -> TorqueRows:
        """Motion and torque of recordings as this fit filters them.

        Args:
            recordings: with torque, or with current where the fit has gains, of the same robot; one or more.
            payloads: what each of them carried beyond what the arm of the fit did; default: nothing.
            limit: rows that are enough, as for :meth:`TorqueRows.of`; ``ENOUGH_TO_FIT``: those of the fit.
            ends: keep the rows where recordings begin and end, which a fit leaves away.
        """
        filters = (FIT_PER_CUTOFF * self.cutoff_hz, self.cutoff_hz)
        return TorqueRows.of(
            listed(recordings),
            self.robot,
            self.cutoff_hz,
            payloads,
            gains=self.gains,
            limit=limit,
            filters_hz=filters,
            ends=ends,
            gravity=self.gravity,
        )

    def score(
        self,
        recordings: Recording | Sequence[Recording] | None = None,
        *,
        filter_hz: float | None = None,
        payloads: Sequence[Payload | None] = (),
    ) -> tuple[JointScore, ...]:
        """Compare predicted with recorded torque.

        Args:
            recordings: with torque, of the same robot; one or more, scored together; default: ``fitted``.
            filter_hz: cut-off of the zero-phase filter that both pass for ``r2``; default: that of the fit. Of
                ``fitted`` a lower one does not reach all it would in the whole of a long recording.
            payloads: what each of them carried beyond what the arm of the fit did; default: nothing.

        Raises:
            InputError: no recordings, and no rows of the fit; else as for :meth:`rows`.
        """
        if recordings is None and self.fitted is None:
            raise InputError("recordings", "there are none", "wanted one or more")
        rows = self.fitted if recordings is None else self.rows(recordings, payloads)
        assert rows is not None
        return self.score_rows(rows, filter_hz=filter_hz)

    def score_rows(self, rows: TorqueRows, *, filter_hz: float | None = None) -> tuple[JointScore, ...]:
        """The same of rows that :meth:`rows` has made."""
        around = self.predict(rows.reach.motion, rows.reach.carried) + rows.reach.carried
        predicted = rows.reach.within(around)
        cutoff = filter_hz or self.cutoff_hz
        smooth, smooth_predicted = rows.torque_below(cutoff), rows.reach.filtered(around, cutoff)
        error = predicted - rows.torque  # eq 3.1
        scores = []
        for j, joint in enumerate(self.robot.joints):
            scores.append(
                JointScore(
                    name=joint.name,
                    r2=share_predicted(smooth[:, j], smooth_predicted[:, j]),
                    r2_raw=share_predicted(rows.torque[:, j], predicted[:, j]),
                    mean=float(error[:, j].mean()),
                    sd=float(error[:, j].std()),
                    rmse=float(np.sqrt((error[:, j] ** 2).mean())),
                )
            )
        return tuple(scores)


def identify_dynamics(
    recordings: Recording | Sequence[Recording],
    robot: Robot,
    *,
    cutoff_hz: float | None = None,
    couplings: Sequence[Sequence[tuple[int, float]]] = (),
    payloads: Sequence[Payload | None] = (),
    gravity: tuple[float, float, float] = GRAVITY,
) -> DynamicsFit:
    """Fit base inertial parameters, Coulomb and viscous friction, offsets and rotor inertia to recorded torque.

    Weighted least squares on the columns that the motion can tell apart; joints weigh by their own residuals. Columns
    and torque pass the same zero-phase filter, which changes nothing in a model that is linear in its parameters.
    Predictions leave out what the recording cannot tell from zero, where held-out fifths are predicted no worse so.
    Of recordings with more than 10 000 rows behind the filter, blocks spread over the time are fitted, and cut-off and
    friction are chosen on 4 000.

    Args:
        recordings: with joint torques; one or more. Filters never reach from one into the next, nor across a gap of
            more than 0.1 s (and ten intervals).
        robot: its kinematic chain; inertia it may have is not used.
        cutoff_hz: of the filter; default: the best of eight by the error on held-out fifths of the rows.
        couplings: joints that share a motor, numbered from 0 with their share of its speed: its friction and rotor act
            on all of them.
        payloads: what each recording carried that is not to be part of the arm; default: nothing.
        gravity: acceleration of free fall in the base frame, of a base on a wall or a ceiling not along -z [m/s2].

    Raises:
        InputError: no torque, no motion, too few rows, a robot of another number of joints, or a shared motor of fewer
            than two.
    """
    logs = listed(recordings)
    groups = tuple(checked_group(group, robot.dof) for group in couplings)
    held_out: dict[float, float] = {}
    still = still_joints(logs, robot)
    if cutoff_hz is None:
        cutoff_hz, held_out = choose_cutoff(logs, robot, groups, payloads, gravity=gravity)
    fit_hz = FIT_PER_CUTOFF * cutoff_hz
    # Those of the fit are scored at the motion's cut-off, too.
    filters = (fit_hz, cutoff_hz)
    rows = TorqueRows.of(logs, robot, cutoff_hz, payloads, limit=ENOUGH_TO_FIT, filters_hz=filters, gravity=gravity)
    few = rows
    if rows.rows_whole > ENOUGH_TO_CHOOSE:
        few = TorqueRows.of(
            logs, robot, cutoff_hz, payloads, limit=ENOUGH_TO_CHOOSE, filters_hz=(fit_hz,), gravity=gravity
        )
    return replace(fit_of(best_friction(few, robot, cutoff_hz, groups, of=rows), held_out), still=still)


def checked_group(group: Sequence[tuple[int, float]], dof: int) -> tuple[tuple[int, float], ...]:
    """A shared motor: two joints or more, each once and with a share; (joint from 0, share) pairs.

    Raises:
        InputError: it is none of a robot with ``dof`` joints.
    """
    made = tuple((int(j), float(share)) for j, share in group)
    joints = [j for j, _ in made]
    usable = all(0 <= j < dof and share != 0 and math.isfinite(share) for j, share in made)
    if not usable or len(joints) < 2 or len(set(joints)) < len(joints):
        told = ",".join(f"{j + 1}:{share:g}" for j, share in made)
        valid = f"for example 5,6 or 5:1,6:-1, two joints or more; joints are 1 to {dof}"
        raise InputError("couplings", f"{told!r} cannot be used", valid)
    return made


def fit_of(system: System, held_out: dict[float, float]) -> DynamicsFit:
    """The fit that a system's solution is, with the values that predict held-out fifths no worse."""
    solution = system.solved()
    essential = system.essential(solution.columns, solution.values, solution.weight)
    predicting, takes = essential if essential is not None else (None, np.ones(system.robot.dof, dtype=bool))
    return DynamicsFit(
        robot=system.robot,
        columns=tuple(solution.columns),
        names=solution.names,
        values=solution.values,
        standard_errors=np.sqrt(np.maximum(np.diag(solution.covariance), 0.0)),
        sign_speed=system.sign_speed,
        couplings=system.couplings,
        cutoff_hz=system.cutoff_hz,
        held_out=held_out,
        unseen=solution.unseen,
        rows_used=system.wanted.shape[0],
        top_speed=system.top_speed,
        covariance=solution.covariance,
        predicting=predicting,
        predicted_by_all=tuple(np.flatnonzero(~takes).tolist()),
        loaded=tuple(sorted(system.loads)),
        rows_left=system.rows.rows_left,
        rows_beside_gaps=system.rows.rows_beside_gaps,
        rows_at_ends=system.rows.rows_at_ends,
        gravity=system.rows.reach.motion.gravity,
        rows_at_rest=(~system.rows.used).sum(axis=0),
        rows_whole=system.rows.rows_whole,
        fitted=system.rows,
        condition=solution.condition,
        unexplained=system.unexplained(),
        usual_torque=np.sqrt((system.rows.torque**2).mean(axis=0)),
        seen=SeenMotion.of(system.rows.motion),
    )


def share_predicted(measured: FloatArray, predicted: FloatArray) -> float:
    """R2: the share of a variance that is predicted; NaN where there is none but rounding."""
    spread = float(((measured - measured.mean()) ** 2).sum())
    rounding = measured.size * (_ROUNDING * float(np.abs(measured).max(initial=0.0))) ** 2
    return 1 - float(((measured - predicted) ** 2).sum()) / spread if spread > rounding else math.nan
