"""What an arm of known inertia carries, from its joint torques or from currents and a joint torque model."""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.display import Displayed, draw_parameters, parameter_frame
from bumpstop.errors import InputError
from bumpstop.identification.arm_of_fit import check_arm_of_fit
from bumpstop.identification.comparison import Comparison, JointScore, joint_score
from bumpstop.identification.drive.current_scores import compare_currents, outside_ranges
from bumpstop.identification.drive.error_sources import INERTIA_UNCERTAINTY
from bumpstop.identification.dynamics.fit_file import DynamicsEstimate
from bumpstop.identification.dynamics.regressor import INERTIAL
from bumpstop.identification.fit import Quantity
from bumpstop.identification.payload.model_errors import errors_of_model
from bumpstop.identification.payload.payload import with_payload
from bumpstop.identification.payload.payload_samples import FIT_PER_CUTOFF, PayloadSamples, PayloadSource
from bumpstop.identification.payload.tip_parameters import point_moments
from bumpstop.identification.statistics.held_out import held_out_share
from bumpstop.identification.statistics.independent_columns import condition_of
from bumpstop.identification.statistics.robust_fit import long_run_covariance, visible_share
from bumpstop.model import unit_of
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.model.inertia import vector3
from bumpstop.signal import correlation_time
from bumpstop.text_files import toml_value, write_text

if TYPE_CHECKING:
    import polars as pl
    from matplotlib.axes import Axes

    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Columns that the others make up to this share of their length are not seen.
_DEPENDENT = 1e-3
_ROUNDING = 1e-9  # of the longest column
_MAX_MASS = 10_000.0  # [kg]
# Nor are those known no better than to a kilogram, or the payload's own mass, at this distance from the tip [m].
_ARM = 0.1
_FARTHEST = 2.0  # [m] from the tip, that a centre of mass is
_ROUNDS = 4  # of the joints' weights, and of a point mass's second moments
_WINDOW = 4.0  # of the long-run covariance, in correlation times
_UNITS = {"m": "kg", "mx": "kg m", "my": "kg m", "mz": "kg m"}  # second moments: kg m2


@dataclass(frozen=True, kw_only=True, eq=False)
class PayloadFit(Displayed):
    """A payload at the tip; what the motion cannot show is None.

    Attributes:
        source: the arm without payload, and how torque is made of a recording.
        created_from: recording of the fit.
        moments: (10,) what predictions use, of what is not seen as well: about the origin of the tip, in its frame.
        friction: coefficients of friction, rotors and offsets that were fitted beside it.
        widths: (n,) speed over which that Coulomb friction turns [rad/s or m/s].
        parameters: by name: ``m`` [kg], ``mx my mz`` [kg m] and, if asked for, ``Ixx Iyy Izz Ixy Ixz Iyz`` [kg m2]
            about the origin of the tip, in its frame.
        standard_errors: likewise; they hold under residuals correlated in time and between joints, and know of errors
            of the arm's own model but those of :attr:`errors_unknown`.
        center: of mass in the frame of the tip [m], or None.
        center_errors: standard errors of ``center``, or None.
        unobservable: names of what the motion cannot show.
        joints_left_out: joints whose torque is unknown.
        rows_used: of the fit.
        rows_left: recorded rows left out: in segments between gaps too short to use, or within a period of the
            cut-off of their ends.
        joints: names of the others, by which the payload was found.
        t: (N,) of the rows that were compared [s].
        wanted: (N, joints) torque that the arm without payload does not explain, filtered [Nm or N].
        explained: (N, joints) what the payload explains of it; where torques were recorded, what friction, rotors and
            offsets explain is taken from ``wanted``.
        condition: condition number of the weighted columns that were fitted, each brought to length one.
        unexplained: share of the torque's variance beyond the arm's that is left on held-out fifths of the rows.
        verdict: on the fit, in the words of :attr:`FitVerdict.status`; empty: it was not judged.
        outside: what of the motion lies outside that of the dynamics' or the joint model's own fit, a sentence each.
    """

    source: PayloadSource
    created_from: str
    moments: FloatArray
    friction: FloatArray
    widths: FloatArray
    parameters: Mapping[str, Quantity]
    standard_errors: Mapping[str, float | None]
    center: tuple[float, float, float] | None
    center_errors: tuple[float, float, float] | None
    unobservable: tuple[str, ...]
    joints_left_out: tuple[str, ...]
    rows_used: int
    rows_left: int
    joints: tuple[str, ...]
    t: FloatArray
    wanted: FloatArray
    explained: FloatArray
    condition: float | None = None
    unexplained: float | None = None
    verdict: str = ""
    outside: tuple[str, ...] = ()

    @property
    def errors_known(self) -> str:
        """What the standard errors know of, in words."""
        source = self.source
        if source.dynamics is not None:
            return "noise" if source.fit is None else "noise and of the errors of the dynamics"
        gains = "" if source.model is None or self.errors_unknown else " and of the errors of the joint model's gains"
        known = f"noise, of an inertia of the arm known to {100 * source.inertia_uncertainty:g} %"
        return f"{known}{gains}" if gains else known.replace(", of", " and of")

    @property
    def errors_unknown(self) -> str:
        """The model whose errors nothing states, and the standard errors do not know of; empty: there is none."""
        source = self.source
        if source.dynamics is not None:
            return "the dynamics" if source.fit is None else ""
        gains = [] if source.model is None else [joint.parameters["B"] for joint in source.model.joints]
        return "the joint model" if any(gain and gain.standard_error is None for gain in gains) else ""

    def predict(self, recording: Recording) -> Comparison:
        """Torque of the arm with the payload, beside that of the recording; of joints whose torque is known.

        Friction, rotors and offsets are those of the fit, where none are taken from a joint model or dynamics.
        """
        samples = PayloadSamples.of(recording, self.source, self.widths)
        robot, cutoff = self.source.robot, FIT_PER_CUTOFF * self.source.cutoff_hz
        joints = [joint for joint, known in zip(robot.joints, samples.known, strict=True) if known]
        smooth = samples.smooth_arm + samples.payload @ self.moments + samples.others @ self.friction
        predicted = samples.arm + samples.unfiltered_payload @ self.moments
        predicted = predicted + samples.unfiltered_others @ self.friction
        # Rows at rest count: holding a load is what shows it.
        scores = tuple(
            joint_score(
                joint.name,
                (samples.torque[:, k], predicted[:, k]),
                (samples.smooth_torque[:, k], smooth[:, k]),
                unit_of(joint),
            )
            for k, joint in enumerate(joints)
        )
        return Comparison(
            names=tuple(joint.name for joint in joints),
            units=tuple(unit_of(joint) for joint in joints),
            t=samples.t,
            qd=samples.qd,
            qdd=samples.qdd,
            measured=samples.torque,
            predicted=predicted,
            rate_hz=samples.rate_hz,
            filter_hz=cutoff,
            given=scores,
        )

    def score(self, recording: Recording) -> tuple[JointScore, ...]:
        """How well the torque of the loaded arm is predicted, joint by joint."""
        return self.predict(recording).scores()

    def to_frame(self) -> pl.DataFrame:
        """Data frame with a row for each parameter: ``name``, ``value``, ``standard_error``."""
        return parameter_frame(self.parameters, self.standard_errors)

    def _draw(self, axes: Axes) -> None:
        """Draw how many standard errors each parameter is from zero."""
        draw_parameters(axes, self.parameters, self.standard_errors)

    def __str__(self) -> str:
        units = {joint.name: unit_of(joint) for joint in self.source.robot.joints}
        lines = [
            f"payload at the tip from {self.rows_used} rows; {self.rows_left} recorded ones are left out at the ends, "
            "beside gaps, or in segments too short to use"
        ]
        for name, (value, unit) in self.parameters.items():
            error = self.standard_errors[name]
            shown = "not visible in this motion"
            if value is not None and error is not None:
                shown = f"{value:.4g} {'(given)' if error == 0 else f'+- {error:.2g}'} {unit}"
            lines.append(f"  {name:<4}{shown}")
        if self.center is not None and self.center_errors is not None:
            at = ", ".join(f"{x:.4g} +- {e:.2g}" for x, e in zip(self.center, self.center_errors, strict=True))
            lines.append(f"centre of mass [m]: {at}")
            told = ",".join(f"{x:.4g}" for x in (self.parameters["m"].value, *self.center))
            lines.append(f"for --payload: {told}")
        for name, rmse, without in zip(self.joints, self.rmse, self.rmse_without, strict=True):
            lines.append(f"  {name}: {rmse:.3g} {units[name]} left, {without:.3g} {units[name]} without the payload")
        if self.joints_left_out:
            lines.append(f"left out, of unknown gain: {', '.join(self.joints_left_out)}")
        lines.append(f"standard errors know of {self.errors_known}")
        return "\n".join(lines)

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write what was seen with its errors as TOML; what was not is listed.

        Raises:
            InputError: the file cannot be written.
        """
        lines = [
            "# Payload at the tip, in its frame: kg, kg m, kg m2.",
            f"robot = {toml_value(self.source.robot.name)}",
            f"created_from = {toml_value(self.created_from)}",
            *([f"verdict = {toml_value(self.verdict)}"] if self.verdict else []),
        ]
        figures: list[tuple[str, Any, Any]] = [
            (name, found.value, self.standard_errors[name]) for name, found in self.parameters.items()
        ]
        figures.append(("center_m", self.center, self.center_errors))
        for name, value, error in figures:
            if value is not None and error is not None:
                lines.append(f"{name} = {{ value = {toml_value(value)}, standard_error = {toml_value(error)} }}")
        lines.append(f"unobservable = {toml_value(self.unobservable)}")
        write_text(path, "\n".join(lines) + "\n")

    @property
    def rmse(self) -> FloatArray:
        """Root mean square of what the payload leaves (joints,) [Nm or N]."""
        return np.asarray(np.sqrt(((self.wanted - self.explained) ** 2).mean(axis=0)))

    @property
    def rmse_without(self) -> FloatArray:
        """The same where nothing is carried (joints,) [Nm or N]."""
        return np.asarray(np.sqrt((self.wanted**2).mean(axis=0)))


def identify_payload(
    recording: Recording,
    robot: Robot,
    *,
    model: JointTorqueModel | None = None,
    dynamics: DynamicsEstimate | DynamicsModel | None = None,
    mass: float | None = None,
    inertia: bool = False,
    cutoff_hz: float | None = None,
    gravity: tuple[float, float, float] | None = None,
    inertia_uncertainty: float = INERTIA_UNCERTAINTY,
) -> PayloadFit:
    """Fit mass and first moments of a payload at the tip, by weighted least squares.

    From currents the joint model takes away friction. Fitted dynamics take away all that the arm makes without payload,
    its friction too, and need no inertia of the robot; an offset of every joint is fitted beside the payload. From
    recorded torques alone Coulomb and viscous friction, reflected rotor and an offset of every joint are fitted beside
    the payload: an inertia of links says nothing of rotors, and the offset takes what a pose that never changes would
    show. A mass that only slides feel can then not be told from their rotors.

    Args:
        recording: with currents, if a model is given, else with torques.
        robot: without payload, with inertia.
        model: joint torque model of this robot, fitted without payload or with the payload declared.
        dynamics: fit of this robot without payload, in place of its inertia and of a joint model; of its model alone
            it is not known what motion it was fitted to.
        mass: of the payload where it is known [kg]; then only its centre is looked for.
        inertia: fit second moments, too; without, those of a point mass are taken.
        cutoff_hz: of the motion's filter; default: 5, or a tenth of the recorded rate where that is less.
        gravity: acceleration of free fall in the base frame [m/s2]; default: that of the dynamics or of the model,
            else along -z.
        inertia_uncertainty: relative standard uncertainty of every link's mass and, independently, of the distance of
            its centre; without dynamics the standard errors count with it.

    Raises:
        InputError: both a model and dynamics, one of another arm, a mass that no payload has, no currents or torques,
            another number of joints, too few rows, no joint whose torque is known.
    """
    recording.check_robot(robot)
    if model is not None and dynamics is not None:
        raise InputError("model", "is given beside dynamics", "wanted one of them: both say the arm's friction")
    fit = dynamics if isinstance(dynamics, DynamicsEstimate) else None
    own = dynamics.model if isinstance(dynamics, DynamicsEstimate) else dynamics
    of_arm = model if own is None else own
    if of_arm is not None:
        check_arm_of_fit(of_arm, robot, "robot")
    if not 0 <= inertia_uncertainty < 1:
        raise InputError("inertia_uncertainty", f"is {inertia_uncertainty}", "wanted 0 or more, and below 1")
    if mass is not None and not 0 < mass < _MAX_MASS:
        raise InputError("mass", f"is {mass:g} kg", f"wanted above 0 and below {_MAX_MASS:g}")
    if gravity is None:
        gravity = STANDARD_GRAVITY if of_arm is None else of_arm.gravity
    cutoff = min(5.0, 0.1 * recording.rate_hz) if cutoff_hz is None else cutoff_hz
    source = PayloadSource(
        robot=robot,
        model=model,
        dynamics=own,
        cutoff_hz=cutoff,
        gravity=gravity,
        fit=fit,
        inertia_uncertainty=inertia_uncertainty,
    )
    samples = PayloadSamples.of(recording, source)
    wanted, seen_by, others = samples.smooth_torque - samples.smooth_arm, samples.payload, samples.others
    count = 10 if inertia else 4
    # A figure that loads no joint is rounding, and would become huge.
    size = np.linalg.norm(seen_by[:, :, :count].reshape(-1, count), axis=0)
    seen_by[:, :, :count][:, :, size < _ROUNDING * size.max()] = 0.0
    point = np.zeros(6)
    weight = 1 / np.maximum(wanted.std(axis=0), 1e-9)
    for _ in range(_ROUNDS):
        target = wanted - (0.0 if inertia else seen_by[:, :, 4:] @ point)
        columns = np.concatenate([seen_by[:, :, :count], others], axis=2) * weight[None, :, None]
        if mass is not None:  # its column is known: it goes to the other side
            target = target - seen_by[:, :, 0] * mass
            columns[:, :, 0] = 0.0
        flat = columns.reshape(-1, columns.shape[2])
        length = np.maximum(np.linalg.norm(flat, axis=0), 1e-300)
        solution = np.linalg.lstsq(flat / length, (target * weight).ravel(), rcond=1e-9)[0] / length
        residual = target * weight - columns @ solution
        if not inertia:
            first = np.where(visible_share(flat)[:4] > _DEPENDENT, solution[:4], 0.0)
            first[0] = first[0] if mass is None else mass
            # Of next to no mass errors of the first moments would put the centre far away, and turn with it.
            point = point_moments(first) if np.linalg.norm(first[1:]) <= _FARTHEST * first[0] else np.zeros(6)
        weight = weight / np.maximum(residual.std(axis=0), 1e-12)
    weight_columns = columns / np.maximum(residual.std(axis=0), 1e-12)[None, :, None]
    residual = residual / np.maximum(residual.std(axis=0), 1e-12)
    noise = _covariance(weight_columns, residual)
    # Noise says what the motion shows, errors of the model only how well.
    covariance = noise + errors_of_model(weight_columns, weight, samples, source)
    # A column of nothing but zeros, as that of a known mass, is not fitted.
    fitted = weight_columns.reshape(-1, weight_columns.shape[2])
    shares = visible_share(flat)[:count]
    if mass is not None:
        solution[0], shares[0], covariance[0], covariance[:, 0] = mass, 1.0, 0.0, 0.0
    names = INERTIAL[:count]
    spread, by_noise = (np.sqrt(np.maximum(np.diag(one), 0.0))[:count] for one in (covariance, noise))
    enough = max(1.0, float(solution[0])) * np.array([1.0] + [_ARM] * 3 + [_ARM**2] * 6)[:count]
    seen = (shares > _DEPENDENT) & (by_noise < enough)
    center, center_errors = _center(solution[:4], covariance[:4, :4]) if seen[:4].all() else (None, None)
    left_out = tuple(joint.name for joint, own in zip(robot.joints, samples.known, strict=True) if not own)
    moments = solution[:count] if inertia else np.concatenate([solution[:4], point])
    return PayloadFit(
        source=source,
        created_from=recording.source,
        moments=moments,
        friction=solution[count:],
        widths=samples.widths,
        parameters={
            name: Quantity(float(solution[i]) if seen[i] else None, _UNITS.get(name, "kg m2"))
            for i, name in enumerate(names)
        },
        standard_errors={name: float(spread[i]) if seen[i] else None for i, name in enumerate(names)},
        center=center,
        center_errors=center_errors,
        unobservable=tuple(name for i, name in enumerate(names) if not seen[i]),
        joints_left_out=left_out,
        rows_used=samples.t.size,
        rows_left=samples.rows_left,
        joints=tuple(joint.name for joint in robot.joints if joint.name not in left_out),
        t=samples.t,
        wanted=wanted - others @ solution[count:],
        explained=seen_by @ moments,
        condition=condition_of(fitted[:, fitted.any(axis=0)]),
        unexplained=held_out_share(weight_columns, residual + weight_columns @ solution),
        outside=samples.outside + _outside_ranges(source, recording, solution[0], center),
    )


def _outside_ranges(
    source: PayloadSource, recording: Recording, mass: float, center: tuple[float, float, float] | None
) -> tuple[str, ...]:
    """What of the motion lies outside the ranges of a joint model, of the arm with the payload that was found."""
    if source.model is None:
        return ()
    try:
        carried = source.robot if center is None else with_payload(source.robot, mass, center)
    except InputError:  # none that an arm carries, which its verdict says
        carried = source.robot
    found = compare_currents(source.model, recording, carried, cutoff_hz=source.cutoff_hz, gravity=source.gravity)
    return tuple(outside_ranges(source.model, found.outside_current, found.outside_speed))


def _covariance(columns: FloatArray, residual: FloatArray) -> FloatArray:
    """Covariance of a least-squares solution whose residuals (N, n) are correlated in time and between joints."""
    rows = residual.shape[0]
    flat = columns.reshape(-1, columns.shape[2])
    inverse = np.linalg.pinv(flat.T @ flat, hermitian=True)
    memory = max(correlation_time(residual[:, j]) for j in range(residual.shape[1]))
    window = min(math.ceil(_WINDOW * memory), rows // 3)
    scores = np.einsum("tjk,tj->tk", columns, residual)
    lost = (1 - 0.5 / _WINDOW) * (1 - window / rows)
    covariance: FloatArray = inverse @ long_run_covariance(scores, window) @ inverse / lost
    return covariance


def _center(
    first: FloatArray, covariance: FloatArray
) -> tuple[tuple[float, float, float], tuple[float, float, float]] | tuple[None, None]:
    """Centre of mass and its standard errors; none of a mass that could as well be nothing."""
    mass = float(first[0])
    if mass < 2 * math.sqrt(max(float(covariance[0, 0]), 0.0)):
        return None, None
    center = first[1:] / mass
    turn = np.concatenate([-center[:, None], np.eye(3)], axis=1) / mass
    errors = np.sqrt(np.maximum(np.diag(turn @ covariance @ turn.T), 0.0))
    return vector3(center), vector3(errors)
