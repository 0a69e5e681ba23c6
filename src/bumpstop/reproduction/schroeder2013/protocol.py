"""Schroeder's identification: recordings of a plan in, table 2.2 out."""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.errors import InputError
from bumpstop.identification.design.plan import MIN_SPEED_RATIO
from bumpstop.identification.drive.current_scores import compare_currents
from bumpstop.identification.drive.drive_quantities import drive_errors, drive_quantities
from bumpstop.identification.fit_verdict import OTHER_CAUSES
from bumpstop.joint import JointTorqueModel
from bumpstop.joint.parameters import JointParameters, Parameter
from bumpstop.model import gravity_torque
from bumpstop.reproduction.schroeder2013.constant_velocity import Cut, Segment, cut, prepare
from bumpstop.reproduction.schroeder2013.protocol_friction import LAWS, FrictionFit, fit_friction, held_out_by_law
from bumpstop.reproduction.schroeder2013.protocol_inertia import InertiaFit, fit_inertia
from bumpstop.reproduction.schroeder2013.protocol_steps import (
    MapFit,
    StrokeFit,
    fit_hysteresis,
    fit_map,
    held_out,
    joint_torque,
)

if TYPE_CHECKING:
    from bumpstop.identification.comparison import Comparison, JointScore
    from bumpstop.identification.design.plan import IdentificationPlan, JointExperiment
    from bumpstop.identification.fit import Quantity
    from bumpstop.recording import Recording

MAPS = ("odd", "load_dependent")
_MIN_STROKES = 4
# Joints that move less fast count as held [rad/s], and other joints are in the planned pose within this [rad].
_MIN_SPEED, _NEAR_POSE = 0.03, math.radians(3.0)
# Strokes show a law of friction where the fastest is so many times as fast as the slowest.
_SPEED_RATIO = 1.3
# Gravity's torque shows a map where it changes by this share of what a plan wants on one side of a stroke.
_MIN_SPAN = 0.5
_POSES = 40  # of a stroke
# A map is better than the first where its error is this share, and the gain so many of its standard errors.
_CLEARLY, _BEYOND_CHANCE = 0.98, 2.0
# A parameter is named as hardly seen where its standard error is more than this share of it.
_SEEN = 0.25


@dataclass(frozen=True, kw_only=True, eq=False)
class ProtocolJoint:
    """One joint of table 2.2, with what led there.

    Attributes:
        experiment: as planned.
        parameters: A, B, those of the law of friction, hysteresis and inertia; None where it could not be found.
        map: chosen by held-out error.
        held_out: root mean square error by map [Nm].
        friction_sd: of the strokes' friction about its law [current].
        friction: the law that was chosen, with its figures.
        friction_held_out: root mean square error of motor currents on strokes that were not fitted, by law [current].
        r2, rmse: of the torque at constant speed, estimated against predicted [1, Nm].
        cut: the segments.
        strokes: eq 2.25 stroke by stroke (figures 2.7, 2.8).
        joint_currents: eq 2.28, stroke by stroke (figure 2.9).
        map_fit: eq 2.29.
        hold_values: eq 2.31, hold by hold [Nm] (figure 2.10).
        inertia_fit: eq 2.33 (figure 2.11), or None.
        notes: what is missing or doubtful, a sentence each.
    """

    experiment: JointExperiment
    parameters: dict[str, Parameter | None]
    map: str
    held_out: dict[str, float]
    friction_sd: float
    friction: FrictionFit
    friction_held_out: dict[str, float]
    r2: float
    rmse: float
    cut: Cut
    strokes: tuple[StrokeFit, ...]
    joint_currents: tuple[FloatArray, ...]
    map_fit: MapFit
    hold_values: tuple[float, ...]
    inertia_fit: InertiaFit | None
    notes: tuple[str, ...]

    @property
    def hardly_seen(self) -> tuple[str, ...]:
        """Names of parameters known no better than to a quarter of themselves."""
        return _hardly_seen(self.parameters)

    def model(self) -> JointParameters:
        """This joint for a :class:`~bumpstop.joint.JointTorqueModel`."""
        speeds = [abs(stroke.speed) for stroke in self.strokes]
        return JointParameters(
            name=self.experiment.name,
            map=self.map,  # type: ignore[arg-type]
            friction=self.friction.law,  # type: ignore[arg-type]
            parameters=self.parameters,
            current_range=self.map_fit.reach,
            speed_range=(min(speeds), max(speeds)),
            friction_sd=self.friction_sd,
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class ProtocolFit:
    """What the protocol found.

    Attributes:
        plan: that was followed.
        joints: that were identified.
        missing: joint numbers from 0, with why, of joints that were planned and not identified.
        rows: of all recordings.
        sources: files they came from.
    """

    plan: IdentificationPlan
    joints: tuple[ProtocolJoint, ...]
    missing: tuple[tuple[int, str], ...]
    rows: int
    sources: tuple[str, ...]

    def model(self, unit: str = "A") -> JointTorqueModel:
        """Joint torque model of the joints that were identified, and of no others.

        Args:
            unit: of current: ``"A"`` or ``"controller"``.
        """
        return JointTorqueModel(
            robot=self.plan.robot.name,
            created_from=", ".join(self.sources) or "recordings",
            unit=unit,  # type: ignore[arg-type]
            joints=tuple(joint.model() for joint in self.joints),
            note=self._note(),
            gravity=self.plan.settings.gravity,
        )

    @property
    def parameters(self) -> dict[str, Quantity]:
        """Parameters of the joints, ``JOINT.NAME``."""
        return drive_quantities(self.model(), self.plan.robot)

    @property
    def standard_errors(self) -> dict[str, float | None]:
        """Of :attr:`parameters`."""
        return drive_errors(self.model())

    def predict(self, recording: Recording) -> Comparison:
        """Motor currents that the model wants of the arm with the plan's load and gravity, beside measured ones."""
        gravity = self.plan.settings.gravity
        return compare_currents(self.model(), recording, self.plan.loaded, gravity=gravity).currents()

    def score(self, recording: Recording) -> tuple[JointScore, ...]:
        """Of motor currents."""
        return self.predict(recording).scores()

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write the joint torque model (:meth:`JointTorqueModel.save`)."""
        self.model().save(path)

    def _note(self) -> str:
        lost = [lost.name for lost in self.plan.unobservable]
        lost += [self.plan.robot.joints[number].name for number, _ in self.missing]
        return f"Not identified by the protocol: {', '.join(lost)}." if lost else ""


def identify_protocol(
    plan: IdentificationPlan,
    recordings: Sequence[Recording],
    *,
    progress: Callable[[float], None] | None = None,
) -> ProtocolFit:
    """Cut the constant-velocity parts out of recordings and fit them step by step (eqs 2.25 to 2.33).

    Args:
        plan: whose trajectories were recorded, in any order and number of files.
        recordings: with motor currents.
        progress: called with the share that is done, 0 to 1.

    Raises:
        InputError: a recording that cannot be used; currents whose sign is opposite; no joint that was recorded.
    """
    report = progress or (lambda share: None)
    prepared = []
    for k, recording in enumerate(recordings):
        prepared.append(prepare(plan, recording))
        report(0.3 * (k + 1) / len(recordings))
    joints, missing = [], []
    for k, experiment in enumerate(plan.experiments):
        found = cut(experiment, prepared)
        why = _lacking(experiment, found, plan)
        if why:
            missing.append((experiment.joint, why))
        else:
            joints.append(_identify_joint(experiment, found))
        report(0.3 + 0.7 * (k + 1) / len(plan.experiments))
    if not joints:
        reasons = "; ".join(f"{plan.robot.joints[number].name}: {why}" for number, why in missing)
        raise InputError("recording", f"no joint of the plan can be identified ({reasons})", "run the plan's files")
    return ProtocolFit(
        plan=plan,
        joints=tuple(joints),
        missing=tuple(missing),
        rows=sum(log.t.size for log in prepared),
        sources=tuple(recording.source for recording in recordings if recording.source),
    )


def _lacking(experiment: JointExperiment, found: Cut, plan: IdentificationPlan) -> str:
    """Why these segments are not enough, or nothing."""
    if found.fastest_seen < _MIN_SPEED:
        why = "it never moves alone in its planned pose"
        if found.pose_missed > _NEAR_POSE:
            return (
                f"{why}: the other joints come no nearer to it than {math.degrees(found.pose_missed):.3g} deg, wanted "
                f"{math.degrees(_NEAR_POSE):.3g}"
            )
        return f"{why}: holds alone show no friction"
    if len(found.constant) < _MIN_STROKES:
        speeds = ", ".join(f"{math.degrees(speed):.3g}" for speed in experiment.speeds)
        return (
            f"{len(found.constant)} strokes at a planned speed ({speeds} deg/s), wanted at least {_MIN_STROKES}; the "
            f"fastest motion is {math.degrees(found.fastest_seen):.3g} deg/s"
        )
    if len({part.speed > 0 for part in found.constant}) < 2:
        return "all its strokes go one way"
    if single_speed(found.constant):
        speed = math.degrees(float(np.median([np.abs(part.qd).mean() for part in found.constant])))
        return (
            f"all its strokes run at one speed, {speed:.3g} deg/s, which shows no law of friction: wanted two at "
            f"least, the fastest {MIN_SPEED_RATIO:g} times the slowest"
        )
    poses = np.stack([experiment.at(position) for position in np.linspace(experiment.low, experiment.high, _POSES)])
    span = float(np.ptp(gravity_torque(plan.loaded, poses, gravity=plan.settings.gravity)[:, experiment.joint]))
    min_torque = plan.settings.min_torque
    if span < _MIN_SPAN * min_torque:
        return (
            f"gravity's torque changes by {span:.2g} Nm along its strokes, wanted {2 * min_torque:g}: give it a pose "
            "in which gravity acts about it, tilt the base or fix a known load to the tip"
        )
    return ""


def single_speed(strokes: Sequence[Segment]) -> bool:
    """Whether all strokes run so nearly at one speed that they show no law of friction."""
    speeds = [float(np.abs(part.qd).mean()) for part in strokes]
    return max(speeds) < MIN_SPEED_RATIO * min(speeds)


def _identify_joint(experiment: JointExperiment, found: Cut) -> ProtocolJoint:
    notes = []
    crossing = tuple(part for part in found.constant if part.torque.min() < 0 < part.torque.max())
    enough = len(crossing) >= _MIN_STROKES and len({part.speed > 0 for part in crossing}) == 2
    if enough and not single_speed(crossing):
        # Others are ways to a hold, or end before gravity torque changes its sign.
        found = Cut(crossing, found.ramps, found.holds, found.fastest_seen)
    else:
        notes.append("in most strokes gravity torque does not change its sign: friction is read off the curve's end")
    rises = [
        float(((part.torque - part.torque.mean()) * (part.current - part.current.mean())).sum())
        for part in found.constant
    ]
    if np.median(rises) <= 0:
        raise InputError(
            f"joint {experiment.name}",
            "its torque falls where its current rises",
            f"give the sign of its current in the column file ([coupling] sign), {OTHER_CAUSES}",
        )
    tried: dict[str, tuple[list[StrokeFit], FrictionFit, list[FloatArray], MapFit]] = {}
    squares: dict[str, FloatArray] = {}
    by_law = _errors_by_law(found)
    friction = _best(list(by_law), by_law)
    for kind in MAPS:
        strokes, law = fit_friction(friction, kind, found.constant)
        own = [part.current - law.current(part.qd, part.current) for part in found.constant]
        fitted = fit_map(kind, found.constant, own)
        tried[kind] = (strokes, law, own, fitted)
        squares[kind] = held_out(kind, found.constant, own)
    sound = [kind for kind in MAPS if tried[kind][3].monotone]
    kind = _best(sound, squares) if sound else "linear"
    chosen = kind if sound else MAPS[0]
    strokes, law, own, fitted = tried[chosen]
    if not sound:
        fitted = _straight(fitted)
        notes.append("neither quadratic map rises over the whole range: A is left out")
    parameters: dict[str, Parameter | None] = {} if kind == "linear" else {"A": fitted.A}
    parameters |= {"B": fitted.B, **law.parameters, "hysteresis": None, "inertia": None}
    held = fit_hysteresis(fitted, found.holds)
    if held is None:
        notes.append("no holds from both sides: hysteresis is not known")
    else:
        parameters["hysteresis"] = held[0]
    slowest = min(abs(stroke.speed) for stroke in strokes)
    inertia = fit_inertia(fitted, law, found.ramps, slowest)
    if inertia is None:
        notes.append("no ramp is long enough: reflected inertia is not known")
    elif inertia.inertia.value < 0:
        notes.append(f"reflected inertia came out as {inertia.inertia.value:.3g} kg m2, less than nothing: left out")
    else:
        parameters["inertia"] = inertia.inertia
    torque = np.concatenate([part.torque for part in found.constant])
    for name in _hardly_seen(parameters):
        notes.append(
            f"{name} is hardly seen: its standard error is above {100 * _SEEN:g} % of it, with "
            f"{np.abs(torque).max():.3g} Nm of gravity at most; a known load, a tilted base or more repeats show more"
        )
    sign = np.concatenate([np.sign(part.qd) for part in found.constant])
    estimate = joint_torque(fitted.kind, fitted.A.value, fitted.B.value, np.concatenate(own), sign)
    left = float(((torque - estimate) ** 2).mean())
    return ProtocolJoint(
        experiment=experiment,
        parameters=parameters,
        map=kind,
        held_out={kind: math.sqrt(own.mean()) for kind, own in squares.items()},
        friction_sd=law.sd,
        friction=law,
        friction_held_out={name: math.sqrt(own.mean()) for name, own in by_law.items()},
        r2=1 - left / float(torque.var()),
        rmse=math.sqrt(left),
        cut=found,
        strokes=tuple(strokes),
        joint_currents=tuple(own),
        map_fit=fitted,
        hold_values=() if held is None else tuple(held[1]),
        inertia_fit=inertia,
        notes=tuple(notes),
    )


def _errors_by_law(found: Cut) -> dict[str, FloatArray]:
    """Held-out errors of the strokes by law of friction, with the map that suits each best; Schroeder's law first."""
    errors: dict[str, FloatArray] = {}
    for law in LAWS:
        tried = [held_out_by_law(law, kind, found.constant) for kind in MAPS]
        able = [own for own in tried if np.isfinite(own).all()]
        if able:
            errors[law] = min(able, key=lambda own: float(own.mean()))
        elif law == next(iter(LAWS)):
            return {law: tried[0]}  # too few strokes to choose by
    return errors


def _hardly_seen(parameters: dict[str, Parameter | None]) -> tuple[str, ...]:
    return tuple(
        name
        for name, found in parameters.items()
        if found is not None and found.standard_error is not None and found.standard_error > _SEEN * abs(found.value)
    )


def _best(kinds: list[str], squares: dict[str, FloatArray]) -> str:
    """The first map, unless another is clearly better on strokes that it was not fitted to.

    Clearly: by a share, and by more than the strokes' own differences say by chance. Where gravity hardly bends the
    map, one that is wrong would else be taken now and then, and no standard error would know.
    """
    best = kinds[0]
    for kind in kinds[1:]:
        gain = squares[best] - squares[kind]
        by_chance = _BEYOND_CHANCE * float(gain.std(ddof=1)) / math.sqrt(gain.size)
        if squares[kind].mean() < _CLEARLY**2 * squares[best].mean() and gain.mean() > by_chance:
            best = kind
    return best


def _straight(fitted: MapFit) -> MapFit:
    """The same map without its quadratic part."""
    covariance = fitted.covariance.copy()
    covariance[0, :] = covariance[:, 0] = 0.0
    return replace(fitted, A=Parameter(0.0), covariance=covariance)
