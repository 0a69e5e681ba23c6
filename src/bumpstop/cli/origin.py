"""What makes residuals of a recording: options that ``detect``, ``tune`` and ``score`` have in common."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass, fields
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from bumpstop.cli.option_names import as_options
from bumpstop.cli.robots import load_robot
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.detection import DetectorSettings, Thresholds
    from bumpstop.identification import DynamicsFit
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

ModelFile = Annotated[
    str | None,
    typer.Option("--model", help="Joint model (TOML or built-in name), or fitted dynamics; without: recorded torque."),
]
RobotName = Annotated[
    str | None, typer.Option("--robot", help="A built-in name, or the path of a URDF file; default: the model's.")
]
Base = Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")]
Tip = Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")]
Columns = Annotated[Path | None, typer.Option(help="Column file of the recording (TOML).")]
Topic = Annotated[str | None, typer.Option(help="Topic of a bag that has several with joint states.")]
MaxBad = Annotated[float, typer.Option(metavar="SHARE", help="Share of bad rows up to which they are dropped.")]
Begin = Annotated[float | None, typer.Option("--from", help="Begin at this time of the recording [s].")]
Until = Annotated[float | None, typer.Option("--until", help="End at this time of the recording [s].")]
GAIN = 50.0  # of an observer, where none is given
Kind = Annotated[str, typer.Option("--residual", help="direct or observer.")]
Gain = Annotated[float, typer.Option("--observer-gain", help="Gain of the observer [1/s].")]
Carried = Annotated[float, typer.Option("--payload", help="Mass at the tip that the robot does not include [kg].")]
MeasuredRates = Annotated[
    bool, typer.Option("--measured-rates", help="Take joint speeds from the recording, not from its positions.")
]
Margin = Annotated[
    float, typer.Option("--limit-margin", help="Positions this far outside their limits are impossible [rad or m].")
]
Arming = Annotated[float, typer.Option("--arming-delay", help="Nothing is judged so long after a motion begins [s].")]
# Fields that are not called as their options are.
_OPTIONS = {"begin": "from"}
# The same of a detector's settings.
DETECTOR_OPTIONS = {
    "residual": "--residual",
    "observer_gain_1_s": "--observer-gain",
    "limit_margin": "--limit-margin",
    "measured_rates": "--measured-rates",
    "arming_delay_s": "--arming-delay",
    "payload_kg": "--payload",
    "payload_change_kg": "--payload-change",
    "period_s": "--period",
    "rearm_s": "--rearm",
    "link": "--link",
}


@dataclass(frozen=True, kw_only=True)
class Origin:
    """The arm, the part of a recording, and the residual; each field is an option under its name.

    Attributes:
        model, robot, base, tip: as :func:`load_model` takes them.
        columns, topic, max_bad: of the recording.
        begin, until: the part that counts, from the recording's beginning [s].
        residual, observer_gain, payload, measured_rates, limit_margin: of the detector.
    """

    model: ModelFile = None
    robot: RobotName = None
    base: Base = None
    tip: Tip = None
    columns: Columns = None
    topic: Topic = None
    max_bad: MaxBad = 0.01
    begin: Begin = None
    until: Until = None
    residual: Kind = "direct"
    observer_gain: Gain = GAIN
    payload: Carried = 0.0
    measured_rates: MeasuredRates = False
    limit_margin: Margin = 0.1

    @cached_property
    def parts(self) -> tuple[JointTorqueModel | DynamicsFit | None, Robot]:
        """The model, if there is one, and the robot."""
        return load_model(self.model, self.robot, self.base, self.tip)

    @property
    def names(self) -> list[str]:
        """Of the robot's joints."""
        return [joint.name for joint in self.parts[1].joints]

    @property
    def settings(self) -> DetectorSettings:
        """Of the detector whose residuals they are."""
        from bumpstop.detection import DetectorSettings

        with as_options(DETECTOR_OPTIONS):
            settings = DetectorSettings(
                residual=self.residual,  # type: ignore[arg-type]
                observer_gain_1_s=self.observer_gain,
                payload_kg=self.payload,
                measured_rates=self.measured_rates,
                limit_margin=self.limit_margin,
            )
        refuse_gain(settings)
        return settings

    def recording(self, path: Path) -> Recording:
        """The part of a recording that counts."""
        from bumpstop.cli.arm_recordings import part_of

        return part_of(path, self.columns, self.parts[1], self.begin, self.until, self.topic, self.max_bad)

    def refuse(self, what: str, but: tuple[str, ...] = ()) -> None:
        """Refuse options that have no meaning with a file of another kind.

        Args:
            what: the file holds.
            but: fields that do have a meaning.

        Raises:
            InputError: one of the other options was given.
        """
        for field in fields(self):
            if field.name not in but and getattr(self, field.name) != field.default:
                option = "--" + _OPTIONS.get(field.name, field.name).replace("_", "-")
                raise InputError(option, f"has no meaning with {what}", "leave it out")


def takes_origin(command: Callable[..., None]) -> Callable[..., None]:
    """A command for typer whose keyword ``origin`` is made of the options of :class:`Origin`."""
    hints = get_type_hints(Origin, include_extras=True)
    options = {
        field.name: inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[field.name]
        )
        for field in fields(Origin)
    }
    signature = inspect.signature(command, eval_str=True)
    parameters: list[inspect.Parameter] = []
    for parameter in signature.parameters.values():
        parameters += options.values() if parameter.name == "origin" else [parameter]

    @wraps(command)
    def run(**given: Any) -> None:
        origin = Origin(**{name: given.pop(name) for name in options})
        command(origin=origin, **given)

    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return run


def refuse_gain(settings: DetectorSettings) -> None:
    """Refuse the gain of an observer where there is none."""
    if settings.residual == "direct" and settings.observer_gain_1_s != GAIN:
        raise InputError("--observer-gain", "has no meaning with --residual direct", "give --residual observer as well")


def load_model(
    model: str | None, robot: str | None, base: str | None, tip: str | None
) -> tuple[JointTorqueModel | DynamicsFit | None, Robot]:
    """What ``--model`` and ``--robot`` name; the robot of the model where none is named.

    Raises:
        InputError: neither says which robot, or a file is neither kind of model.
    """
    from bumpstop.cli.arm_recordings import is_dynamics
    from bumpstop.identification import load_fit
    from bumpstop.joint import JointTorqueModel

    named = None if robot is None else load_robot(robot, base, tip)
    if model is None:
        if named is None:
            raise InputError("--robot", "is missing", "give a robot, or a model that names one")
        return None, named
    if is_dynamics(model):
        for option, given in (("--base", base), ("--tip", tip)):
            if given is not None:
                raise InputError(option, "has no meaning with fitted dynamics, which know their robot", "leave it out")
        fit = load_fit(model)
        if named is not None and named.dof != fit.robot.dof:
            raise InputError("--robot", f"{named.name} has {named.dof} joints, the model {fit.robot.dof}")
        return fit, fit.robot
    joints = JointTorqueModel.load(model)
    return joints, named if named is not None else load_robot(joints.robot, base, tip)


def thresholds_of(text: str, joints: Robot | int) -> Thresholds:
    """What ``--thresholds`` says, numbers or a file, of a robot's joints or of so many."""
    from bumpstop.detection import Thresholds

    dof, names = (joints, []) if isinstance(joints, int) else (joints.dof, [joint.name for joint in joints.joints])
    with as_options({"thresholds": "--thresholds"}):
        return Thresholds.of(Thresholds.parse(text, names), dof)
