"""Scenarios: the tables a person writes, checked strictly."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import ConfigDict, Field, ValidationError, field_validator, model_validator

from bumpstop.collision.scenario.arm_table import ArmTable
from bumpstop.collision.scenario.contact_table import ContactTable, Direction, check_direction
from bumpstop.collision.scenario.keys import MADE_BY, set_keys
from bumpstop.collision.scenario.scenario_words import as_written, explain, explain_all, short, unknown_key, words
from bumpstop.collision.scenario.spellings import check_one_spelling
from bumpstop.collision.scenario.table import Table, between
from bumpstop.collision.scenario.uncertainty_table import check_uncertainty, flattened
from bumpstop.collision.scenario.unused_keys import given_without_effect, keys_without_effect
from bumpstop.collision.stopping.braking_keys import BrakingKeys
from bumpstop.errors import InputError
from bumpstop.text_files import is_path

Probability = Annotated[float, Field(gt=0, lt=1, allow_inf_nan=False)]
JointPosition = Annotated[float, between(-1e6, 1e6)]
Velocity = Annotated[list[Annotated[float, between(-1e5, 1e5)]], Field(min_length=3, max_length=3)]
NoiseSd = Annotated[float, between(0, 1e6)]
NoiseMean = Annotated[float, between(-1e6, 1e6)]
JointAcceleration = Annotated[float, between(0.1, 1e5)]
_MIN_SPEED_MM_S = 1e-3
_MIN_SUBSTEP_S = 1e-6
_MIN_THRESHOLD_NM, _MAX_THRESHOLD_NM = 1e-6, 1e9


# Keys of [motion] that belong to one kind of motion alone.
_OF_LINE = ("velocity_mm_s", "speed_mm_s", "direction", "start", "duration_s", "task", "held_joints", "damping")
_OF_TRAJECTORY = ("file", "contact_onset_s")
_SPEED = ("speed_mm_s", "direction")
# Where the body is, is how far the line still goes to it; in a trajectory it is when contact begins.
_OFFSET = ("offset_law", "offset_sd_s", "offset_mm")


class MotionTable(Table):
    """A straight line of the tip at constant speed, base frame, or a joint trajectory."""

    # Of the kind that is meant where none is given.
    model_config = ConfigDict(json_schema_extra={"required": ["velocity_mm_s"]})

    kind: Literal["line", "trajectory"] = "line"
    velocity_mm_s: Velocity | None = None
    speed_mm_s: Annotated[float, between(_MIN_SPEED_MM_S, 1e5)] | None = None
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
                raise InputError("motion.file", "is missing", f"wanted {words(Scenario, ('motion', 'file'))}")
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
                "motion.velocity_mm_s", "is missing", f"wanted {words(Scenario, ('motion', 'velocity_mm_s'))}"
            )
        if not any(self.velocity_mm_s):
            raise InputError(
                "motion.velocity_mm_s", "is zero", "an arm that does not move hits nothing: give a direction"
            )
        speed = math.hypot(*self.velocity_mm_s)
        if speed < _MIN_SPEED_MM_S:
            raise InputError(
                "motion.velocity_mm_s", f"is {speed:g} mm/s in all", f"wanted at least {_MIN_SPEED_MM_S:g}"
            )
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

    accepted_probability: Probability = 1e-3
    max_false_alarm: Probability = 1e-3
    clamped_limit: Literal["quasi_static", "two_phase"] = "quasi_static"
    confidence: Annotated[float, between(0.5, 0.999)] = 0.95


class Scenario(Table):
    """One collision: robot, pose, motion, contact, detector, reaction.

    The attributes are the keys of the scenario file, in the file's units (docs/reference/collision.md lists them).
    ``folder`` is where relative paths start.
    """

    robot: Annotated[str, Field(description="the name of a robot (bumpstop robots lists them), or the path of a URDF")]
    base: Annotated[str, Field(description="the name of a link of the URDF")] | None = None
    tip: Annotated[str, Field(description="the name of a link of the URDF")] | None = None
    pose_deg: list[JointPosition] | None = None
    pose_rad: list[JointPosition] | None = None
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

    @field_validator("uncertainty", mode="before")
    @classmethod
    def _dotted_keys(cls, value: Any) -> dict[str, Any]:
        return flattened(value)

    @model_validator(mode="after")
    def _links_of_urdf(self) -> Scenario:
        for key in ("base", "tip"):
            if getattr(self, key) is not None and self.robot_path is None:
                raise InputError(
                    key, f"has no meaning with the built-in robot {self.robot!r}", "give it with the path of a URDF"
                )
        return self

    @model_validator(mode="after")
    def _one_arm(self) -> Scenario:
        if self.arm.model == "elastic" and self.contact.arm == "two_mass":
            raise InputError(
                "contact.arm",
                "'two_mass' has no meaning with arm.model = \"elastic\"",
                "an elastic arm has its own masses",
            )
        return self

    @model_validator(mode="after")
    def _one_pose(self) -> Scenario:
        if self.motion.kind == "trajectory":
            for key in ("pose_deg", "pose_rad"):
                if getattr(self, key) is not None:
                    raise InputError(key, 'has no meaning with motion.kind = "trajectory"', "leave it out")
            for key in _OFFSET:
                if key in self.contact.model_fields_set:
                    raise InputError(
                        f"contact.{key}",
                        'has no meaning with motion.kind = "trajectory"',
                        "leave it out: motion.contact_onset_s says when contact begins",
                    )
            if self.contact.arm == "two_mass":
                problem = "'two_mass' is not available with motion.kind = \"trajectory\""
                raise InputError("contact.arm", problem, "valid: 'position_driven': the arm's mass changes on the way")
            if self.reaction.stop_category == 0:
                problem = '0 is not available with motion.kind = "trajectory"'
                raise InputError("reaction.stop_category", problem, "valid: 1 or 2, which keep to the path")
            return self
        if (self.pose_deg is None) == (self.pose_rad is None):
            problem = "is missing" if self.pose_deg is None else "and pose_rad are both given"
            raise InputError("pose_deg", problem, "give pose_deg or pose_rad, one of them")
        return self

    @model_validator(mode="after")
    def _possible_uncertainty(self) -> Scenario:
        if self.uncertainty:
            check_uncertainty(self)
        return self

    @classmethod
    def from_dict(cls, data: dict[str, Any], folder: Path | str = ".") -> Scenario:
        """Check a scenario given as nested dictionaries.

        Args:
            data: the tables and keys of the scenario file. The table ``made_by`` of a ``settings.toml`` is not read.
            folder: where relative paths in it start.

        Raises:
            InputError: a key is unknown, missing or has a value that cannot be used.
        """
        scenario, faults = cls.check(data, folder, all_faults=False)
        if scenario is None:
            raise faults[0]
        return scenario

    @classmethod
    def check(
        cls, data: dict[str, Any], folder: Path | str = ".", *, all_faults: bool = True
    ) -> tuple[Scenario | None, list[InputError]]:
        """The scenario of nested dictionaries, or what is wrong with it.

        Args:
            data: the tables and keys of the scenario file, as in :meth:`from_dict`.
            folder: where relative paths in it start.
            all_faults: find every key that cannot be used, not the first alone.
        """
        if not isinstance(data, Mapping):
            problem = f"{as_written(data)} cannot be used"
            return None, [InputError("scenario", problem, "wanted a dictionary of its tables and keys")]
        tables = _plain(data)
        if isinstance(tables.get(MADE_BY), dict):
            del tables[MADE_BY]
        if "folder" in tables:
            return None, [unknown_key(cls, ("folder",))]
        try:
            return cls.model_validate({**tables, "folder": Path(folder)}), []
        except ValidationError as error:
            # Only their words: pydantic's error holds that of a validator, and so the frames that lead there, where the
            # collector of cycles cannot see it. As context of a refusal that a caller keeps it would never be freed.
            return None, explain_all(cls, error) if all_faults else [explain(cls, error)]

    def with_values(self, changes: dict[str, Any]) -> Scenario:
        """A copy with some keys changed.

        Args:
            changes: dotted keys and their new values, e.g. ``{"motion.velocity_mm_s": [0, 50, 0]}``.
        """
        data = self.as_given()
        set_keys(data, changes)
        return Scenario.from_dict(data, self.folder)

    def without_uncertainty(self) -> Scenario:
        """The same collision, its numbers taken for known."""
        if not self.uncertainty:
            return self
        data = self.as_given()
        del data["uncertainty"]
        data.get("verdict", {}).pop("confidence", None)
        return Scenario.from_dict(data, self.folder)

    def as_given(self) -> dict[str, Any]:
        """The scenario as nested dictionaries, with the keys that were given and no default."""
        # What was not given stays so: a default must not count as given where a change takes its effect away.
        data = self.model_dump(exclude_unset=True, exclude_none=True, mode="python")
        # What a copy was given besides counts.
        if "velocity_mm_s" in data["motion"]:
            data["motion"] = {key: value for key, value in data["motion"].items() if key not in _SPEED}
        if "stiffness_N_m" in data["contact"]:
            data["contact"].pop("stiffness_N_mm", None)
        return data

    def to_dict(self) -> dict[str, Any]:
        """The scenario as nested dictionaries.

        Defaults are spelt out, but not a contact area that was assumed, nor those that have no effect. Of two spellings
        it has the velocity and N/m.
        """
        data = self.model_dump(exclude_none=True, mode="python")
        for key in (*self.motion.other_keys, *_SPEED):
            data["motion"].pop(key, None)
        data["contact"].pop("stiffness_N_mm", None)
        for key in _OFFSET if self.motion.kind == "trajectory" else ():
            data["contact"].pop(key, None)
        if "area_cm2" not in self.contact.model_fields_set:
            del data["contact"]["area_cm2"]
        if self.contact.kind == "clamped":
            del data["contact"]["arm"]
        if not self.uncertainty:
            del data["uncertainty"]
        for key in keys_without_effect(self).keys() - given_without_effect(self).keys():
            table, _, name = key.partition(".")
            data[table].pop(name, None)
        return data


def as_scenario(value: Any) -> Scenario:
    """What everything starts with; a path or a dictionary must be read first.

    Raises:
        InputError: it is something else.
    """
    if isinstance(value, Scenario):
        return value
    problem = f"a value of type {type(value).__name__} is no scenario"
    raise InputError("scenario", problem, "wanted load_scenario(path) or Scenario.from_dict(tables)")


def _plain(value: Any) -> Any:
    """Numbers and lists for those of numpy, and lists for tuples."""
    if isinstance(value, Mapping):
        return {key: _plain(inner) for key, inner in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(inner) for inner in value]
    return value.tolist() if type(value).__module__ == "numpy" else value
