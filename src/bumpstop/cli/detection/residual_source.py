"""What makes residuals of a recording: options that ``detect``, ``tune`` and ``score`` have in common."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import asdict, dataclass, fields
from functools import cached_property, wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from bumpstop.cli.completion import complete_robot
from bumpstop.cli.identification.arm_recordings import (
    gravity_of,
    model_files,
    payload_of,
    payload_settings,
    recording_files,
)
from bumpstop.cli.option_names import as_options
from bumpstop.cli.robots import load_robot
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.detection import DetectorSettings, Thresholds
    from bumpstop.identification import DynamicsModel, Payload
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

ModelFile = Annotated[
    str | None,
    typer.Option("--model", help="Joint model (TOML or built-in name), or fitted dynamics; without: recorded torque."),
]
RobotName = Annotated[
    str | None,
    typer.Option(
        "--robot",
        help="A built-in name, or the path of a URDF file; default: the model's.",
        autocompletion=complete_robot,
    ),
]
Base = Annotated[str | None, typer.Option(help="Link of the URDF where the chain begins.")]
Tip = Annotated[str | None, typer.Option(help="Link of the URDF where the chain ends.")]
Columns = Annotated[Path | None, typer.Option(help="Column file of the recording (TOML).")]
Topic = Annotated[str | None, typer.Option(help="Topic of a bag that has several with joint states.")]
MaxBad = Annotated[float, typer.Option(metavar="SHARE", help="Share of bad rows up to which they are dropped.")]
Rate = Annotated[
    float | None,
    typer.Option("--rate", help="Rows were sampled evenly at this rate; a PC stamped them later [Hz]."),
]
Begin = Annotated[float | None, typer.Option("--from", help="Begin at this time of the recording [s].")]
Until = Annotated[float | None, typer.Option("--until", help="End at this time of the recording [s].")]
# What a file of thresholds says of these holds where the option is not given: None is not given.
Kind = Annotated[
    str | None, typer.Option("--residual", help="direct or observer.", show_default="the thresholds' kind, or direct")
]
Gain = Annotated[
    float | None,
    typer.Option("--observer-gain", help="Gain of the observer [1/s].", show_default="the thresholds' gain, or 50"),
]
Carried = Annotated[
    str | None,
    typer.Option(
        "--payload",
        metavar="KG",
        help="What the robot lacks at its tip: MASS[,X,Y,Z] [kg, m].",
        show_default="the thresholds' load, or 0",
    ),
]
MeasuredRates = Annotated[
    bool | None,
    typer.Option(
        "--measured-rates",
        help="Take joint speeds from the recording.",
        show_default="the thresholds' way, or positions",
    ),
]
Margin = Annotated[
    float | None,
    typer.Option(
        "--limit-margin",
        help="Positions this far outside their limits are impossible [rad or m].",
        show_default="the thresholds' margin, or 0.1",
    ),
]
Window = Annotated[
    float | None,
    typer.Option(
        "--window",
        help="Time that rates and accelerations are fitted over [s].",
        show_default="the thresholds' window, or 0.07",
    ),
]
Gravity = Annotated[
    str | None,
    typer.Option(
        "--gravity",
        metavar="LIST",
        help="Free fall in the base frame [m/s2]: 0,0,9.80665 of an arm on the ceiling.",
        show_default="the thresholds', the joint model's, or 0,0,-9.80665",
    ),
]
Causal = Annotated[
    bool | None,
    typer.Option(
        "--causal",
        help="With fitted dynamics: the residual of a control loop, without looking ahead.",
        show_default="as the thresholds were found",
    ),
]
Frozen = Annotated[
    float | None,
    typer.Option(
        "--frozen",
        help="Feedback that repeats for longer is a fault [s]; inf: never.",
        show_default="the thresholds' time, or 0.1",
    ),
]
Arming = Annotated[float, typer.Option("--arming-delay", help="Nothing is judged so long after a motion begins [s].")]
# Fields that are not called as their options are.
_OPTIONS = {"begin": "from"}
# The same of a detector's settings.
DETECTOR_OPTIONS = {
    "residual": "--residual",
    "window_s": "--window",
    "frozen_s": "--frozen",
    "causal": "--causal",
    "observer_gain_1_s": "--observer-gain",
    "limit_margin": "--limit-margin",
    "measured_rates": "--measured-rates",
    "arming_delay_s": "--arming-delay",
    "payload_kg": "--payload",
    "gravity": "--gravity",
    "payload_change_kg": "--payload-change",
    "period_s": "--period",
    "rearm_s": "--rearm",
    "link": "--link",
    "point": "--point-m",
}


@dataclass(frozen=True, kw_only=True)
class Watcher:
    """The arm and the residual, of a recording or in a loop; each field is an option under its name.

    Attributes:
        model, robot, base, tip: as :func:`load_model` takes them.
        residual, observer_gain, window, payload, measured_rates, limit_margin, gravity, frozen, causal: of the
            detector; None: not given.
    """

    model: ModelFile = None
    robot: RobotName = None
    base: Base = None
    tip: Tip = None
    residual: Kind = None
    observer_gain: Gain = None
    window: Window = None
    payload: Carried = None
    measured_rates: MeasuredRates = None
    limit_margin: Margin = None
    gravity: Gravity = None
    frozen: Frozen = None
    causal: Causal = None

    @cached_property
    def parts(self) -> tuple[JointTorqueModel | DynamicsModel | None, Robot]:
        """The model, if there is one, and the robot."""
        return load_model(self.model, self.robot, self.base, self.tip)

    @property
    def files(self) -> list[str | Path | None]:
        """That are read to know the residual; None and names of what is built in are none."""
        return [self.robot, *model_files(self.model)]

    @property
    def arm(self) -> str:
        """The robot in words, for the head of a page; empty where neither a robot nor a model is named."""
        if self.model is None and self.robot is None:
            return ""
        robot = self.parts[1]
        return robot.title or robot.name

    @property
    def names(self) -> list[str]:
        """Of the robot's joints."""
        return [joint.name for joint in self.parts[1].joints]

    @property
    def settings(self) -> DetectorSettings:
        """Of the detector whose residuals they are."""
        return self.settings_for(None)

    def settings_for(self, thresholds: Thresholds | None, **more: Any) -> DetectorSettings:
        """Of a detector with these thresholds: options that were given, else what the thresholds were found with.

        Args:
            thresholds: or None, where there are none yet.
            more: settings that have options of their own.

        Raises:
            InputError: what no detector can have, or the gain of an observer where there is none.
        """
        from bumpstop.detection import DetectorSettings
        from bumpstop.identification import DynamicsModel

        given = {
            "residual": self.residual,
            "observer_gain_1_s": self.observer_gain,
            "window_s": self.window,
            "measured_rates": self.measured_rates,
            "limit_margin": self.limit_margin,
            "gravity": gravity_of(self.gravity),
            "frozen_s": self.frozen,
            "causal": self.causal,
        }
        load = {} if self.carried is None else payload_settings(self.carried, self.parts[1])
        tuned = {} if thresholds is None else thresholds.settings
        fitted = isinstance(self.parts[0], DynamicsModel)
        if self.causal and not fitted:
            raise InputError("--causal", "has no meaning without fitted dynamics", "such a residual is causal anyway")
        if self.gravity is not None and fitted:
            raise InputError("--gravity", "is for joint models", "dynamics know how they were mounted")
        causal = more.get("causal", tuned.get("causal", False) if self.causal is None else self.causal)
        if fitted and not causal:
            tuned = {} if thresholds is None else thresholds.settings_looking_ahead
        chosen = tuned | {name: value for name, value in given.items() if value is not None} | load | more
        with as_options(DETECTOR_OPTIONS):
            settings = DetectorSettings(**chosen)
        if settings.residual == "direct" and self.observer_gain is not None:
            valid = "give --residual observer as well"
            raise InputError("--observer-gain", "has no meaning with --residual direct", valid)
        return settings

    @property
    def carried(self) -> Payload | None:
        """What ``--payload`` says; None: nothing."""
        return None if self.payload is None else payload_of(self.payload)


@dataclass(frozen=True, kw_only=True)
class ResidualSource(Watcher):
    """The same, and the part of a recording.

    Attributes:
        columns, topic, max_bad, rate: of the recording.
        begin, until: the part that counts, from the recording's beginning [s].
    """

    columns: Columns = None
    topic: Topic = None
    max_bad: MaxBad = 0.01
    rate: Rate = None
    begin: Begin = None
    until: Until = None

    @property
    def reading(self) -> dict[str, str]:
        """How recordings were read, in words, for a page's table of settings."""
        first = "the beginning" if self.begin is None else f"{self.begin:g} s"
        last = "the end" if self.until is None else f"{self.until:g} s"
        found = {"model": self.model or "none: recorded torque", "part": f"from {first} to {last}"}
        named = {"columns": self.columns, "topic": self.topic, "rate, Hz": self.rate}
        found |= {name: str(value) for name, value in named.items() if value is not None}
        return found | {"share of bad rows that is dropped": f"{self.max_bad:g}"}

    def files_with(self, *recordings: Path) -> list[str | Path | None]:
        """That are read to know the residuals of recordings."""
        return [*self.files, *recording_files(recordings, self.columns)]

    def recording(self, path: Path) -> Recording:
        """The part of a recording that counts."""
        from bumpstop.cli.identification.arm_recordings import part_of

        return part_of(path, self.columns, self.parts[1], self.begin, self.until, self.topic, self.max_bad, self.rate)

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


def takes_residual_source(command: Callable[..., int | None]) -> Callable[..., int | None]:
    """A command for typer whose keyword ``residual_source``, a ResidualSource or a Watcher, is made of its options."""
    signature = inspect.signature(command, eval_str=True)
    kind = signature.parameters["residual_source"].annotation
    hints = get_type_hints(kind, include_extras=True)
    options = {
        field.name: inspect.Parameter(
            field.name, inspect.Parameter.KEYWORD_ONLY, default=field.default, annotation=hints[field.name]
        )
        for field in fields(kind)
    }
    parameters: list[inspect.Parameter] = []
    for parameter in signature.parameters.values():
        parameters += options.values() if parameter.name == "residual_source" else [parameter]

    @wraps(command)
    def run(**given: Any) -> int | None:
        residual_source = kind(**{name: given.pop(name) for name in options})
        return command(residual_source=residual_source, **given)

    run.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return run


def load_model(
    model: str | None, robot: str | None, base: str | None, tip: str | None
) -> tuple[JointTorqueModel | DynamicsModel | None, Robot]:
    """What ``--model`` and ``--robot`` name; the robot of the model where none is named.

    Raises:
        InputError: neither says which robot, or a file is neither kind of model.
    """
    from bumpstop.cli.identification.arm_recordings import is_dynamics
    from bumpstop.identification import DynamicsFit
    from bumpstop.identification.arm_of_fit import check_arm_of_fit
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
        dynamics = DynamicsFit.load(model).model
        if named is not None:
            check_arm_of_fit(dynamics, named, "--robot")
        return dynamics, dynamics.robot
    joints = JointTorqueModel.load(model)
    return joints, named if named is not None else load_robot(joints.robot, base, tip)


def thresholds_of(text: str, joints: Robot | int) -> Thresholds:
    """What ``--thresholds`` says, numbers or a file, of a robot's joints or of so many."""
    from bumpstop.detection import Thresholds

    dof, names = (joints, []) if isinstance(joints, int) else (joints.dof, [joint.name for joint in joints.joints])
    with as_options({"thresholds": "--thresholds"}):
        return Thresholds.of(Thresholds.parse(text, names), dof)


def detector_settings(residual_source: Watcher, thresholds: str | None) -> dict[str, Any]:
    """Settings of the detector by name, for a page: options, else what the thresholds were found with."""
    found = None if thresholds is None else thresholds_of(thresholds, residual_source.parts[1])
    return asdict(residual_source.settings_for(found))
