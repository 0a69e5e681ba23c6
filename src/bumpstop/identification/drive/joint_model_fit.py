"""A joint torque model from motor currents on any motion, against the Newton-Euler torque of the robot."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

from bumpstop.display import Displayed, draw_parameters, parameter_frame
from bumpstop.errors import InputError, near_matches
from bumpstop.identification.drive.current_scores import compare_currents
from bumpstop.identification.drive.drive_model_selection import choose_settings
from bumpstop.identification.drive.drive_quantities import drive_errors, drive_quantities
from bumpstop.identification.drive.error_sources import INERTIA_UNCERTAINTY, inertia_changes
from bumpstop.identification.drive.joint_fit import JointFit, JointFitSettings, fit_joint
from bumpstop.identification.fit import Quantity
from bumpstop.identification.recording_consistency import inconsistent_joints
from bumpstop.identification.segments.drive_samples import DriveSamples, drive_samples
from bumpstop.identification.segments.torque_samples import as_list
from bumpstop.joint.friction_law import OF_FRICTION
from bumpstop.joint.model import JointTorqueModel
from bumpstop.joint.parameters import BOUNDS, OF_MAP
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.terminal import in_percent, share, table, text_of

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes
    from rich.console import Console

    from bumpstop.identification.comparison import Comparison, JointScore
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Samples that a joint is fitted to; of more, blocks spread over the time.
_ENOUGH_TO_FIT = 30_000
# No parameter that is given comes near these ends, and what is computed of them are numbers.
_MIN_GAIN, _MAX_VALUE = 1e-9, 1e9


@dataclass(frozen=True, kw_only=True, eq=False)
class JointModelFit(Displayed):
    """A joint torque model, and what it was fitted to.

    Attributes:
        model: the joint torque model.
        robot: whose inertia gave the torques; what it carried is not in it.
        joints: how each joint was fitted.
        rows: motion, torque and current of the fit.
        cutoff_hz: of the zero-phase filter that motion and current passed.
        held_out: mean over joints of 1 - R2 of held-out fifths, by the cut-off that was tried [Hz].
        rows_used: recorded rows that the fit used.
        rows_left: rows in segments between gaps too short to use.
        rows_at_ends: rows left out at the ends of segments, where the filter has one side only to go by.
        inconsistent: joints whose gain differs from recording to recording.
        gravity: acceleration of free fall in the base frame, of the recordings and of predictions [m/s2].
        inertia_uncertainty: relative, that the standard errors count with; see :func:`identify_joint_model`.
    """

    model: JointTorqueModel
    robot: Robot
    joints: tuple[JointFit, ...]
    rows: DriveSamples
    cutoff_hz: float
    held_out: Mapping[float, float]
    rows_used: int
    rows_left: int
    rows_at_ends: int
    inconsistent: tuple[str, ...] = ()
    gravity: tuple[float, float, float] = STANDARD_GRAVITY
    inertia_uncertainty: float = INERTIA_UNCERTAINTY

    def to_frame(self) -> pl.DataFrame:
        """Data frame with a row for each parameter: ``name``, ``value``, ``standard_error``."""
        return parameter_frame(self.parameters, self.standard_errors)

    def _draw(self, axes: Axes) -> None:
        """Draw how many standard errors each parameter is from zero."""
        draw_parameters(axes, self.parameters, self.standard_errors)

    def __str__(self) -> str:
        return text_of(self.show)

    def show(self, console: Console) -> None:
        """Print what ``bumpstop identify`` prints of a joint model: R2, parameters, what was tried, warnings."""
        unit = self.model.unit
        console.print(f"joint model from {self.rows_used} rows, filtered at {self.cutoff_hz:g} Hz, Huber's loss")
        if self.held_out:
            tried = ", ".join(f"{cutoff:g} Hz {in_percent(left)}" for cutoff, left in self.held_out.items())
            console.print(f"5-fold cross-validation error, by cut-off: {tried}")
        rows = [
            (joint.name, share(joint.r2), f"{joint.rmse:.4g}", joint.parameters.map, joint.parameters.friction)
            for joint in self.joints
        ]
        headings = ("joint", "R2", f"rmse, {unit}", "map", "friction")
        console.print(table(headings, rows, left=("joint", "map", "friction")))
        left = [
            f"{joint.name} {in_percent(joint.near_reversals / joint.measured.size)}"
            for joint in self.joints
            if joint.near_reversals
        ]
        if left:
            console.print(f"rows near reversals, left out of the fit: {', '.join(left)}")
        console.print("parameters, with their standard errors:")
        for joint in self.joints:
            figures = (
                f"{name} {found.value:.4g}"
                + ("" if found.standard_error is None else f" +- {found.standard_error:.2g}")
                for name, found in joint.parameters.parameters.items()
                if found is not None
            )
            console.print(f"  {joint.name}: {', '.join(figures) or 'none seen'}")
        console.print(
            f"standard errors know of noise, of an inertia known to {100 * self.inertia_uncertainty:g} % and, of B, of "
            "the choice of the model"
        )
        console.print(f"5-fold cross-validation error, rms {unit}, by current-to-torque model and friction:")
        for joint in self.joints:
            errors = (
                f"{one.map}/{one.friction} " + (f"{one.held_out:.4g}" if one.held_out is not None else "refused")
                for one in joint.candidates
            )
            console.print(f"  {joint.name}: {', '.join(errors) or 'none tried'}")
        for warning in self.warnings:
            console.print(f"warning: {warning}")

    @property
    def parameters(self) -> dict[str, Quantity]:
        """Parameters of the joints, ``JOINT.NAME``."""
        return drive_quantities(self.model, self.robot)

    @property
    def standard_errors(self) -> dict[str, float | None]:
        """Of :attr:`parameters`."""
        return drive_errors(self.model)

    def predict(self, recording: Recording | Sequence[Recording]) -> Comparison:
        """Motor currents that the model wants, beside measured ones; see :func:`compare_currents` for more."""
        found = compare_currents(self.model, recording, self.robot, cutoff_hz=self.cutoff_hz, gravity=self.gravity)
        return found.currents()

    def score(self, recording: Recording | Sequence[Recording]) -> tuple[JointScore, ...]:
        """Of motor currents; R2 of a joint whose gain is unknown is that up to a free gain."""
        return self.predict(recording).scores()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the joint torque model (:meth:`JointTorqueModel.save`)."""
        self.model.save(path)

    @property
    def warnings(self) -> tuple[str, ...]:
        """What the motion could not show, a sentence for each parameter, with the joint's name."""
        own = tuple(f"{joint.name}: {warning}" for joint in self.joints for warning in joint.warnings)
        if not self.inconsistent:
            return own
        which = ", ".join(self.inconsistent)
        return (f"{which}: the recordings want different gains: did the arm carry something in one (--payload)?", *own)


def identify_joint_model(
    recordings: Recording | Sequence[Recording],
    robot: Robot | Sequence[Robot],
    *,
    cutoff_hz: float | None = None,
    rest_speed: float | None = None,
    maps: Sequence[str] = tuple(OF_MAP),
    frictions: Sequence[str] = tuple(OF_FRICTION),
    known: Mapping[str, Mapping[str, float]] | None = None,
    unit: str = "A",
    gravity: tuple[float, float, float] = STANDARD_GRAVITY,
    joints: Sequence[int] | None = None,
    inertia_uncertainty: float = INERTIA_UNCERTAINTY,
    progress: Callable[[float], None] | None = None,
) -> JointModelFit:
    """Fit map, friction, hysteresis and reflected inertia of every joint to recorded currents.

    The current that a joint model wants for the recorded motion is compared with the current that was measured. Noise
    is on the current: taken as a regressor it would pull A and B towards zero, as a response it does not. Measured and
    predicted currents pass one zero-phase filter. Huber's loss, in robust standard deviations of the residuals;
    standard errors that hold where residuals are correlated in time, and that know of an uncertain inertia and, of B,
    of the choice among models. Of maps and friction laws the simplest within
    0.2 % of the least root mean square error on held-out fifths of the time is taken.

    Args:
        recordings: with currents; one or more.
        robot: with inertia; or one for each recording, with the payload it carried.
        cutoff_hz: of the filter; default: by held-out error.
        rest_speed: below it a joint rests and sgn(qd) is a line [rad/s or m/s]; default: by held-out error.
        maps: that may be chosen.
        frictions: friction laws that may be chosen.
        known: parameters that are not to be fitted, by joint name: ``{"shoulder": {"inertia": 0.4}}``.
        unit: of current.
        gravity: acceleration of free fall in the base frame, of a tilted base not along -z [m/s2].
        joints: numbers, from 0, of the joints to fit; default: all.
        inertia_uncertainty: relative standard uncertainty of every link's mass and, independently, of the distance of
            its centre along each axis, 0 to 1; it enters the standard errors. 0: the inertia is exact.
        progress: called with the share that is done, 0 to 1.

    Raises:
        InputError: no currents, too few rows, a robot of another number of joints or without inertia, names that do not
            exist; no joint of which anything could be fitted.
    """
    logs = as_list(recordings)
    robots = list(robot) if isinstance(robot, Sequence) else [robot] * len(logs)
    if len(robots) != len(logs):
        raise InputError("robot", f"{len(robots)} of them for {len(logs)} recordings", "wanted one for each")
    _check_choice("maps", maps, OF_MAP)
    _check_choice("frictions", frictions, OF_FRICTION)
    arm = robots[0]
    fixed = _known(known or {}, arm)
    if not 0 <= inertia_uncertainty < 1:
        raise InputError("inertia_uncertainty", f"is {inertia_uncertainty}", "wanted 0 or more, and below 1")
    report = progress or (lambda share: None)
    settings = choose_settings(logs, robots, cutoff_hz, rest_speed, gravity)
    report(0.2)
    rows = drive_samples(logs, robots, settings.cutoff_hz, gravity=gravity)
    found = []
    which = range(arm.dof) if joints is None else joints
    few = rows.spread(_ENOUGH_TO_FIT)
    changes = inertia_changes(few, arm, gravity, inertia_uncertainty)
    for j in which:
        wanted = JointFitSettings(
            rest_speed=settings.rest_speeds[j],
            maps=tuple(maps),
            frictions=tuple(frictions),
            known=fixed.get(arm.joints[j].name, {}),
        )
        found.append(fit_joint(few, j, arm, wanted, changes[:, j]))
        report(0.2 + 0.8 * len(found) / len(which))
    model = JointTorqueModel(
        robot=arm.name,
        created_from=", ".join(log.source or "a recording" for log in logs),
        unit=unit,  # type: ignore[arg-type]
        joints=tuple(joint.parameters for joint in found),
        gravity=gravity,
    )
    return JointModelFit(
        model=model,
        robot=arm,
        joints=tuple(found),
        rows=rows,
        cutoff_hz=settings.cutoff_hz,
        held_out=settings.held_out,
        rows_used=rows.rows_recorded - rows.rows_at_ends,
        rows_left=rows.rows_left,
        rows_at_ends=rows.rows_at_ends,
        inconsistent=tuple(inconsistent_joints(model, rows if joints is None else rows.of_joints(list(joints)))),
        gravity=gravity,
        inertia_uncertainty=inertia_uncertainty,
    )


def _check_choice(field: str, given: Sequence[str], valid: Mapping[str, object]) -> None:
    if not given:
        raise InputError(field, "is empty", "valid: " + ", ".join(valid))
    for name in given:
        if name not in valid:
            raise InputError(field, f"{name!r} is none", near_matches(name, valid))


def _known(known: Mapping[str, Mapping[str, float]], arm: Robot) -> dict[str, dict[str, float]]:
    names = [joint.name for joint in arm.joints]
    parameters = {*(name for own in (*OF_MAP.values(), *OF_FRICTION.values()) for name in own), "hysteresis", "inertia"}
    found: dict[str, dict[str, float]] = {}
    for joint, values in known.items():
        if joint not in names:
            raise InputError(f"known.{joint}", "is no joint", near_matches(joint, names))
        for name, value in values.items():
            if name not in parameters:
                raise InputError(f"known.{joint}.{name}", "is no parameter", near_matches(name, sorted(parameters)))
            if not math.isfinite(value):
                raise InputError(f"known.{joint}.{name}", f"is {value}", "wanted a finite number")
            low, high = BOUNDS.get(name, (-_MAX_VALUE, _MAX_VALUE))
            low, high = max(low, _MIN_GAIN) if name == "B" else low, min(high, _MAX_VALUE)
            if not low <= value <= high:
                raise InputError(f"known.{joint}.{name}", f"is {value:g}", f"wanted {low:g} to {high:g}")
        found[joint] = dict(values)
    return found
