"""The tables of a scenario and their keys, each checked by itself."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, model_validator

from bumpstop.collision.scenario.arm_table import ArmTable
from bumpstop.collision.scenario.contact_table import ContactTable, Direction, check_direction
from bumpstop.collision.scenario.scenario_words import as_written, short, words
from bumpstop.collision.scenario.spellings import check_one_spelling
from bumpstop.collision.scenario.table import Table, between
from bumpstop.collision.stopping.braking_keys import BrakingKeys
from bumpstop.errors import InputError
from bumpstop.model.dynamics import STANDARD_GRAVITY
from bumpstop.text_files import is_path

Probability = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
# The quantile of what is left: 1 less a smaller one is 1.
AcceptedProbability = Annotated[float, Field(gt=1e-15, lt=1, allow_inf_nan=False)]
JointPosition = Annotated[float, between(-1e6, 1e6)]
FreeFall = Annotated[list[Annotated[float, between(-10, 10)]], Field(min_length=3, max_length=3)]
Velocity = Annotated[list[Annotated[float, between(-1e5, 1e5)]], Field(min_length=3, max_length=3)]
NoiseSd = Annotated[float, between(0, 1e6)]
NoiseMean = Annotated[float, between(-1e6, 1e6)]
JointAcceleration = Annotated[float, between(0.1, 1e5)]
MIN_SPEED_MM_S = 1e-3
_MIN_SUBSTEP_S = 1e-6
_MIN_THRESHOLD_NM, _MAX_THRESHOLD_NM = 1e-6, 1e9


# Keys of [motion] that belong to one kind of motion alone.
_OF_LINE = ("velocity_mm_s", "speed_mm_s", "direction", "start", "duration_s", "task", "held_joints", "damping")
_OF_TRAJECTORY = ("file", "contact_onset_s")


class MotionTable(Table):
    """A straight line of the tip at constant speed, base frame, or a joint trajectory."""

    # Of the kind that is meant where none is given.
    model_config = ConfigDict(json_schema_extra={"required": ["velocity_mm_s"]})

    kind: Literal["line", "trajectory"] = "line"
    velocity_mm_s: Velocity | None = None
    speed_mm_s: Annotated[float, between(MIN_SPEED_MM_S, 1e5)] | None = None
    direction: Direction | None = None
    start: Literal["moving", "rest"] = "moving"
    duration_s: Annotated[float, between(1e-5, 1e5)] = 5.0
    task: Literal["pose", "position"] = "pose"
    held_joints: list[int] = Field([])
    damping: Annotated[float, between(0, 10)] = 0.0
    file: Annotated[str, Field(description="the path of a .csv, .yaml, .yml or .json file")] | None = None
    contact_onset_s: Literal["uniform"] | Annotated[float, between(0, 1e5)] = "uniform"

    @property
    def velocity(self) -> tuple[float, float, float]:
        """Velocity of the tip along a line, base frame [m/s]."""
        assert self.velocity_mm_s is not None
        x, y, z = (v / 1e3 for v in self.velocity_mm_s)
        return x, y, z

    @property
    def other_keys(self) -> tuple[str, ...]:
        """Keys of the other kind of motion, which have no meaning with this one."""
        return _OF_TRAJECTORY if self.kind == "line" else _OF_LINE

    @model_validator(mode="after")
    def _complete(self) -> MotionTable:
        for key in self.other_keys:
            if key in self.model_fields_set:
                raise InputError(f"motion.{key}", f'has no meaning with kind = "{self.kind}"', "leave it out")
        if self.kind == "trajectory":
            if self.file is None:
                raise InputError("motion.file", "is missing", f"wanted {words(ScenarioTables, ('motion', 'file'))}")
            return self
        check_one_spelling(f"motion.{key}" for key in self.model_fields_set if getattr(self, key) is not None)
        if (self.speed_mm_s is None) != (self.direction is None):
            missing, given = ("direction", "speed_mm_s") if self.direction is None else ("speed_mm_s", "direction")
            raise InputError(
                f"motion.{missing}", "is missing", f"motion.{given} needs it, or give motion.velocity_mm_s alone"
            )
        if self.speed_mm_s is not None and self.direction is not None:
            check_direction("motion.direction", self.direction)
            along = self.speed_mm_s / math.hypot(*self.direction)
            # The table is frozen for others: from here on it has the velocity, however it was written.
            self.__dict__["velocity_mm_s"] = [along * part for part in self.direction]
        if self.velocity_mm_s is None:
            raise InputError(
                "motion.velocity_mm_s", "is missing", f"wanted {words(ScenarioTables, ('motion', 'velocity_mm_s'))}"
            )
        if not any(self.velocity_mm_s):
            raise InputError(
                "motion.velocity_mm_s", "is zero", "an arm that does not move hits nothing: give a direction"
            )
        speed = math.hypot(*self.velocity_mm_s)
        if speed < MIN_SPEED_MM_S:
            raise InputError("motion.velocity_mm_s", f"is {speed:g} mm/s in all", f"wanted at least {MIN_SPEED_MM_S:g}")
        named: set[int] = set()
        for number in self.held_joints:
            if number in named:
                raise InputError("motion.held_joints", f"joint {as_written(number)} is named twice", "name each once")
            named.add(number)
        return self


class DetectorTable(Table):
    """Thresholds and noise of the residual (estimated minus predicted motor torque), per joint.

    Noise is first-order correlated (``noise_correlation`` from tick to tick, ``noise_sd_Nm`` its stationary value), or
    resampled from measured ``residuals``.
    """

    thresholds_Nm: list[float]
    noise_sd_Nm: NoiseSd | list[NoiseSd] | None = None
    noise_mean_Nm: NoiseMean | list[NoiseMean] = 0.0
    noise_correlation: Annotated[float, between(-0.99, 0.995)] = 0.0
    residuals: Annotated[str, Field(description="the path of a Parquet file with measured residuals")] | None = None
    feedback_period_s: Annotated[float, between(1e-5, 1)] = 0.004
    residual: Literal["direct", "observer"] = "direct"
    observer_gain_1_s: Annotated[float, between(1e-3, 1e5)] = 50.0
    arming_delay_s: Annotated[float, between(0, 1e5)] = 0.0

    @model_validator(mode="after")
    def _thresholds(self) -> DetectorTable:
        for j, threshold in enumerate(self.thresholds_Nm, start=1):
            if not (_MIN_THRESHOLD_NM <= threshold <= _MAX_THRESHOLD_NM or threshold == math.inf):
                raise InputError(
                    f"detector.thresholds_Nm[{j}]",
                    f"{threshold:g} cannot be used",
                    f"wanted a number from {short(_MIN_THRESHOLD_NM)} to {short(_MAX_THRESHOLD_NM)}, or inf to "
                    "leave the joint unmonitored",
                )
        return self

    @model_validator(mode="after")
    def _one_noise(self) -> DetectorTable:
        if self.residuals is None:
            if self.noise_sd_Nm is None:
                raise InputError(
                    "detector.noise_sd_Nm", "is missing", "give it, or measured detector.residuals in its place"
                )
            return self
        for key in ("noise_mean_Nm", "noise_correlation"):
            value = getattr(self, key)
            if any(value) if isinstance(value, list) else value:
                raise InputError(
                    f"detector.{key}", "has no meaning with detector.residuals", "leave one of the two out"
                )
        return self


class ReactionTable(BrakingKeys):
    """What the arm does after detection."""

    joint_acceleration_rad_s2: JointAcceleration | list[JointAcceleration]
    latency_s: Annotated[float, between(0, 10)] = 0.0


class SimulationTable(Table):
    """Time steps of the simulated controller."""

    step_s: Annotated[float, between(1e-5, 0.1)] = 0.001
    substeps: Annotated[int, Field(ge=1, le=1000)] = 5

    @model_validator(mode="after")
    def _not_too_fine(self) -> SimulationTable:
        if self.step_s / self.substeps < _MIN_SUBSTEP_S * (1 - 1e-9):
            raise InputError(
                "simulation.substeps",
                f"{self.substeps} in a step of {self.step_s:g} s are {self.step_s / self.substeps:g} s each",
                f"wanted at least {short(_MIN_SUBSTEP_S)} s",
            )
        return self


class VerdictTable(Table):
    """What counts as acceptable."""

    accepted_probability: AcceptedProbability = 1e-3
    max_false_alarm: Probability = 1e-3
    clamped_limit: Literal["quasi_static", "two_phase"] = "quasi_static"
    confidence: Annotated[float, between(0.5, 0.999)] = 0.95


class ScenarioTables(Table):
    """All tables of a scenario; :class:`bumpstop.collision.Scenario` checks them against each other."""

    robot: Annotated[str, Field(description="the name of a robot (bumpstop robots lists them), or the path of a URDF")]
    base: Annotated[str, Field(description="the name of a link of the URDF")] | None = None
    tip: Annotated[str, Field(description="the name of a link of the URDF")] | None = None
    pose_deg: list[JointPosition] | None = None
    pose_rad: list[JointPosition] | None = None
    gravity_m_s2: FreeFall = Field(list(STANDARD_GRAVITY))
    assumed: list[Annotated[str, Field(description="a key of the scenario")]] = Field([])
    motion: MotionTable
    contact: ContactTable
    arm: ArmTable = ArmTable()
    detector: DetectorTable
    reaction: ReactionTable
    simulation: SimulationTable = SimulationTable()
    verdict: VerdictTable = VerdictTable()
    uncertainty: dict[str, Any] = Field({})
    folder: Annotated[Path, Field(exclude=True)] = Path()

    @property
    def robot_path(self) -> Path | None:
        """The URDF file, or None where the robot is a built-in one."""
        return self.folder / self.robot if is_path(self.robot) else None
