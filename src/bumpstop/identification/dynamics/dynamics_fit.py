"""Inertial (base) parameters, friction and rotor inertia of an arm from recorded joint torques."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.display import Displayed, draw_parameters, parameter_frame
from bumpstop.errors import InputError
from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
from bumpstop.identification.dynamics.dynamics_model_selection import ENOUGH_TO_CHOOSE, best_friction, choose_cutoff
from bumpstop.identification.dynamics.dynamics_system import FIT_PER_CUTOFF
from bumpstop.identification.dynamics.fit_file import DynamicsEstimate, load_fit, save_fit
from bumpstop.identification.dynamics.regressor_columns import checked_group, column_unit
from bumpstop.identification.fit import Quantity
from bumpstop.identification.segments.seen_motion import SeenMotion
from bumpstop.identification.segments.torque_samples import TorqueSamples, as_list, joints_at_rest
from bumpstop.model import unit_of
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.terminal import counted, in_percent

if TYPE_CHECKING:
    import os
    from collections.abc import Sequence

    import polars as pl
    from matplotlib.axes import Axes

    from bumpstop.identification.comparison import Comparison, JointScore
    from bumpstop.identification.dynamics.dynamics_system import System
    from bumpstop.identification.payload.payload import Payload
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Rows behind the filter that a fit goes through; of more, blocks spread over the time.
ENOUGH_TO_FIT = 10_000


@dataclass(frozen=True, kw_only=True, eq=False)
class DynamicsFit(DynamicsEstimate, Displayed):
    """Dynamics that recordings show, with the errors of their parameters.

    Attributes:
        model: of the torques.
        names: of the base parameters, the columns of the model: the column's own, with the others that move with it.
        errors: (p,) standard errors of ``model.values``; they hold under residuals correlated in time.
        gain_errors: (n,) standard errors of ``model.gains``; 0: it was given, infinite: the recordings do not show it;
            None: the recordings of the fit had torques.
        held_out: mean over joints of 1 - R2 on held-out fifths, by the cut-off that was tried [Hz].
        unobservable: inertial and friction parameters that the motion cannot show at all.
        still: joints that hardly moved: their friction, rotors and whatever only their motion shows are noise.
        rows_used: of the fit, behind the filter.
        rows_whole: rows that the filter leaves of the whole recordings; where these are more, blocks of ``rows_used``
            rows stand for them. 0: read from a file.
        covariance: (p, p) of the base parameters, by the errors and their correlations; None: a file without them.
        rows_left: recorded rows in segments between gaps too short to use.
        rows_beside_gaps: recorded rows left out within a period of the cut-off of a gap.
        rows_at_ends: the same where recordings begin and end.
        rows_at_rest: (n,) rows of the fit at which a joint rests: they stay out of its own; None: read from a file.
        fitted: motion and torque that it was fitted to; None: read from a file, or fitted to currents.
        condition: condition number of the columns of the fit, weighted and brought to length one; None: read from a
            file.
        unexplained: (n,) share of the filtered torque's (of gains: current's) variance that is left on held-out fifths;
            None: read from a file.
        usual_torque: (n,) root mean square of the torque of the fit, that of known loads included [Nm or N]; None: read
            from a file.
        seen: ranges of the fit's motion; None: a file of an older version.
        source: how a scenario names the robot: ``robot``, with ``base`` and ``tip`` of a URDF; empty: by its own name.
        created_from: recordings of the fit.
    """

    held_out: dict[float, float]
    unobservable: tuple[str, ...]
    rows_left: int = 0
    rows_beside_gaps: int = 0
    rows_whole: int = 0
    fitted: TorqueSamples | None = None
    still: tuple[str, ...] = ()
    condition: float | None = None
    unexplained: FloatArray | None = None
    usual_torque: FloatArray | None = None
    rows_at_ends: int = 0
    rows_at_rest: FloatArray | None = None

    def to_frame(self) -> pl.DataFrame:
        """Data frame with a row for each parameter: ``name``, ``value``, ``standard_error``."""
        return parameter_frame(self.parameters, self.standard_errors)

    def _draw(self, axes: Axes) -> None:
        """Draw how many standard errors each parameter is from zero."""
        draw_parameters(axes, self.parameters, self.standard_errors)

    def __str__(self) -> str:
        """What ``bumpstop identify --model dynamics`` prints of a fit beside its scores."""
        lines = self._gain_lines()
        if self.held_out:
            tried = ", ".join(f"{cutoff:g} Hz {in_percent(left)}" for cutoff, left in self.held_out.items())
            lines.append(f"5-fold cross-validation error, by cut-off: {tried}")
        whole = "" if self.rows_whole <= self.rows_used else f" of {self.rows_whole}, in blocks spread over the time"
        lines.append(f"{len(self.model.values)} base parameters from {self.rows_used} rows{whole}")
        lines += left_out_notes(self.rows_left, self.rows_beside_gaps, self.model.cutoff_hz)
        for name, value, error in zip(self.names, self.model.values, self.errors, strict=True):
            unit = column_unit(name.split()[0], self.model.robot, self.model.couplings)
            weak = "" if abs(value) >= 2 * error else "  (not distinguishable from zero)"
            lines.append(f"  {value:12.4g} +- {error:.2g} {unit}  {name}{weak}")
        lines += self._friction_lines()
        lines += [f"note: {doubt}" for doubt in self.model.robot.doubts]
        if self.rows_at_ends:
            lines.append(f"note: left out at the ends of recordings: {counted(self.rows_at_ends, 'row')}")
        at_rest = () if self.rows_at_rest is None else self.rows_at_rest
        for joint, rows in zip(self.model.robot.joints, at_rest, strict=False):
            if rows:
                rests = f"rests in {rows} of the {self.rows_used} rows"
                lines.append(f"note: {joint.name} {rests}; they stay out of its fit")
        if self.unobservable:
            lines.append(f"not visible in this motion: {', '.join(self.unobservable)}")
        return "\n".join(lines)

    def _gain_lines(self) -> list[str]:
        if self.model.gains is None:
            return []
        lines = ["gains, torque per motor current:"]
        for j, joint in enumerate(self.model.robot.joints, start=1):
            (gain, unit), error = self.parameters[f"gain_{j}"], self.standard_errors[f"gain_{j}"]
            if gain is None:
                lines.append(f"  {joint.name}: not identifiable, the scale of its torque means nothing")
            else:
                lines.append(f"  {joint.name}: {gain:.4g} {f'+- {error:.2g}' if error else '(given)'} {unit}")
        return lines

    def _friction_lines(self) -> list[str]:
        """Joints whose friction is more than Coulomb's and viscous."""
        joints, top, travel = self.model.robot.joints, self.model.top_speed, self.model.presliding
        bent = [] if top is None else np.flatnonzero(np.isfinite(top[: len(joints)])).tolist()
        lines = [
            f"friction {what}: {', '.join(joints[j].name for j in which)}"
            for what, which in (("bends with the speed", bent), ("grows with the load", list(self.model.loaded)))
            if which
        ]
        gradual = [] if travel is None else np.flatnonzero(np.isfinite(travel[: len(joints)])).tolist()
        if travel is not None and gradual:
            names = ", ".join(
                f"{joints[j].name} over {travel[j]:g} {unit_of(joints[j], turning='rad', sliding='m')}" for j in gradual
            )
            lines.append(f"friction builds up after a reversal: {names}")
        return lines

    @property
    def parameters(self) -> dict[str, Quantity]:
        """Base parameters by their own column's name (``Izz_2``; see ``names``), then gains (``gain_2``)."""
        robot = self.model.robot
        found = {
            name.split()[0]: Quantity(float(value), column_unit(name.split()[0], robot, self.model.couplings))
            for name, value in zip(self.names, self.model.values, strict=True)
        }
        if self.model.gains is not None:
            for j, gain in enumerate(self.model.gains.tolist()):
                shown = None if j in self.model.unscaled else gain
                found[f"gain_{j + 1}"] = Quantity(shown, f"{unit_of(robot.joints[j])}/A")
        return found

    @property
    def standard_errors(self) -> dict[str, float | None]:
        """Of :attr:`parameters`."""
        errors = self.errors.tolist()
        if self.gain_errors is not None:
            errors += [error if math.isfinite(error) else None for error in self.gain_errors.tolist()]
        return dict(zip(self.parameters, errors, strict=True))

    def predict(
        self,
        recording: Recording | Sequence[Recording],
        *,
        filter_hz: float | None = None,
        payloads: Sequence[Payload | None] = (),
    ) -> Comparison:
        """:meth:`DynamicsModel.compare`."""
        return self.model.compare(recording, filter_hz=filter_hz, payloads=payloads)

    def score(
        self,
        recording: Recording | Sequence[Recording] | None = None,
        *,
        filter_hz: float | None = None,
        payloads: Sequence[Payload | None] = (),
    ) -> tuple[JointScore, ...]:
        """How well recorded torques are predicted, joint by joint.

        Args:
            recording: of the same robot, one or more; default: those of the fit, of which the rows of the fit are
                compared.
            filter_hz: cut-off of the zero-phase filter both pass before R2; default: that of the fit. Errors are of the
                whole unfiltered recording.
            payloads: what each of them carried beyond what the arm of the fit did; default: nothing.

        Raises:
            InputError: no recordings, and no rows of the fit; else as for :meth:`DynamicsModel.rows`.
        """
        if recording is not None:
            return self.predict(recording, filter_hz=filter_hz, payloads=payloads).scores()
        if self.fitted is None:
            raise InputError("recordings", "there are none", "wanted one or more")
        return self.model.compare_rows(self.fitted, filter_hz=filter_hz).scores()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the fit as TOML, so that :meth:`load` reads it.

        Raises:
            InputError: the file cannot be written.
        """
        save_fit(self, path)

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> DynamicsFit:
        """Read a fit.

        Raises:
            InputError: the file is absent, damaged, or not of this kind.
        """
        return load_fit(path, cls)


def left_out_notes(rows_left: int, rows_beside_gaps: int, cutoff_hz: float) -> list[str]:
    """What gaps cost a fit or a comparison, a line each."""
    lines = []
    if rows_left:
        lines.append(f"note: {counted(rows_left, 'row', 'lies')} in segments between gaps too short to use")
    if rows_beside_gaps:
        lines.append(f"note: left out within {1 / cutoff_hz:.2g} s of gaps: {counted(rows_beside_gaps, 'row')}")
    return lines


def identify_dynamics(
    recordings: Recording | Sequence[Recording],
    robot: Robot,
    *,
    cutoff_hz: float | None = None,
    couplings: Sequence[Sequence[tuple[int, float]]] = (),
    payloads: Sequence[Payload | None] = (),
    gravity: tuple[float, float, float] = STANDARD_GRAVITY,
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
    logs = as_list(recordings)
    groups = tuple(checked_group(group, robot.dof) for group in couplings)
    held_out: dict[float, float] = {}
    still = joints_at_rest(logs, robot)
    if cutoff_hz is None:
        cutoff_hz, held_out = choose_cutoff(logs, robot, groups, payloads, gravity=gravity)
    fit_hz = FIT_PER_CUTOFF * cutoff_hz
    # Those of the fit are scored at the motion's cut-off, too.
    filters = (fit_hz, cutoff_hz)
    rows = TorqueSamples.of(logs, robot, cutoff_hz, payloads, limit=ENOUGH_TO_FIT, filters_hz=filters, gravity=gravity)
    few = rows
    if rows.rows_whole > ENOUGH_TO_CHOOSE:
        few = TorqueSamples.of(
            logs, robot, cutoff_hz, payloads, limit=ENOUGH_TO_CHOOSE, filters_hz=(fit_hz,), gravity=gravity
        )
    fit = fit_of(best_friction(few, robot, cutoff_hz, groups, of=rows), held_out)
    return replace(fit, still=still, created_from=tuple(log.source for log in logs))


def fit_of(system: System, held_out: dict[float, float]) -> DynamicsFit:
    """The fit that a system's solution is, with the values that predict held-out fifths no worse."""
    solution = system.solved()
    essential = system.essential(solution.columns, solution.values, solution.weight)
    predicting, takes = essential if essential is not None else (None, np.ones(system.robot.dof, dtype=bool))
    return DynamicsFit(
        model=DynamicsModel(
            robot=system.robot,
            columns=tuple(solution.columns),
            values=solution.values,
            predicting=predicting,
            predicted_by_all=tuple(np.flatnonzero(~takes).tolist()),
            sign_speed=system.sign_speed,
            presliding=system.presliding,
            top_speed=system.top_speed,
            couplings=system.couplings,
            loaded=tuple(sorted(system.loads)),
            cutoff_hz=system.cutoff_hz,
            gravity=system.rows.reach.motion.gravity,
        ),
        names=solution.names,
        errors=np.sqrt(np.maximum(np.diag(solution.covariance), 0.0)),
        held_out=held_out,
        unobservable=solution.unobservable,
        rows_used=system.wanted.shape[0],
        covariance=solution.covariance,
        rows_left=system.rows.rows_left,
        rows_beside_gaps=system.rows.rows_beside_gaps,
        rows_at_ends=system.rows.rows_at_ends,
        rows_at_rest=(~system.rows.used).sum(axis=0),
        rows_whole=system.rows.rows_whole,
        fitted=system.rows,
        condition=solution.condition,
        unexplained=system.unexplained(),
        usual_torque=np.sqrt((system.rows.torque**2).mean(axis=0)),
        seen=SeenMotion.of(system.rows.motion),
    )
