"""Tables of an experiment file, each read strictly."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from bumpstop.collision.stopping.braking_keys import BrakingKeys
from bumpstop.errors import InputError
from bumpstop.plant.drive import ScatterPer


def between(low: float, high: float) -> Any:
    """A finite number within these limits."""
    return Field(ge=low, le=high, allow_inf_nan=False)


NotNegative = Annotated[float, between(0, 1e6)]
Each = NotNegative | list[NotNegative]
Three = Annotated[list[Annotated[float, between(-1e5, 1e5)]], Field(min_length=3, max_length=3)]


class ExperimentTable(BaseModel):
    """Keys of a table: no others, and no other types."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


# Keys of [motion] that a kind of motion needs, and those it has beside them.
_NEEDED = {"line": ("velocity_mm_s", "duration_s"), "press": ("velocity_mm_s", "way_mm"), "trajectory": ("file",)}
_ALLOWED = {
    "line": ("start", "task", "held_joints", "joint_acceleration_rad_s2", "hold_s"),
    "press": ("held_joints", "joint_acceleration_rad_s2"),
    "trajectory": ("hold_s",),
    "pick_and_place": ("offset_mm",),
}


class ExperimentMotion(ExperimentTable):
    """What the arm is told to do."""

    kind: Literal["line", "press", "trajectory", "pick_and_place", "workspace_1", "workspace_2"]
    velocity_mm_s: Three | None = None
    duration_s: Annotated[float, between(1e-3, 3600)] | None = None
    start: Literal["moving", "rest"] = "rest"
    task: Literal["pose", "position"] = "pose"
    held_joints: list[int] = []
    joint_acceleration_rad_s2: Annotated[float, between(0.1, 1e3)] = 4.5
    way_mm: Annotated[float, between(0.1, 1e4)] | None = None
    offset_mm: Three = [120.0, 0.0, -120.0]
    file: str | None = None
    hold_s: Annotated[float, between(0, 3600)] = 0.0

    @model_validator(mode="after")
    def _complete(self) -> ExperimentMotion:
        for key in _NEEDED.get(self.kind, ()):
            if getattr(self, key) is None:
                raise InputError(f"motion.{key}", "is missing", f'kind = "{self.kind}" needs it')
        if self.velocity_mm_s is not None and not any(self.velocity_mm_s):
            raise InputError("motion.velocity_mm_s", "is zero", "give a direction")
        allowed = {"kind", *_NEEDED.get(self.kind, ()), *_ALLOWED.get(self.kind, ())}
        for key in sorted(self.model_fields_set - allowed):
            raise InputError(f"motion.{key}", f'has no meaning with kind = "{self.kind}"', "leave it out")
        return self


class ExperimentFriction(ExperimentTable):
    """What the gears do beyond the joint model: as :class:`~bumpstop.plant.Gears`."""

    rotor_inertia_kg_m2: Each | None = None
    load_share: Each = 0.0
    stribeck_Nm: Each = 0.0
    stribeck_speed_rad_s: Each = 0.05
    ripple_Nm: Each = 0.0
    ripple_per_turn: Each = 200.0
    presliding_rad: Each = 0.0
    stiffness_Nm_rad: Annotated[float, Field(gt=0)] | list[Annotated[float, Field(gt=0)]] = float("inf")
    damping_ratio: Annotated[float, between(0, 2)] = 0.05
    damping_Nm_s_rad: Each | None = None
    scatter: Each | None = None
    scatter_per: ScatterPer = "sample"


class ExperimentSensors(ExperimentTable):
    """Feedback: as :class:`~bumpstop.plant.Sensors`."""

    rate_hz: Annotated[float, between(1, 1000)] = 250.0
    jitter_s: Annotated[float, between(0, 1)] = 0.0
    loss: Annotated[float, between(0, 0.9)] = 0.0
    position_noise_rad: Each = 0.0
    position_step_rad: Each = 0.0
    current_noise: Each = 0.0
    current_step: Each = 0.0
    force_noise_N: NotNegative = 0.0
    moment_noise_Nm: NotNegative = 0.0


class ExperimentServo(ExperimentTable):
    """The position controller: as :class:`~bumpstop.plant.Servo`."""

    bandwidth_hz: Annotated[float, between(1, 200)] = 100.0
    damping_ratio: Annotated[float, between(0.1, 5)] = 1.0
    velocity_bandwidth_rad_s: Each | None = None
    position_gain_1_s: Each | None = None
    torque_limit_Nm: Annotated[float, Field(gt=0)] | list[Annotated[float, Field(gt=0)]] = float("inf")
    acceleration_feedforward: Annotated[float, between(0, 1)] | list[Annotated[float, between(0, 1)]] = 1.0


class ExperimentObject(ExperimentTable):
    """Something to press on or to run into."""

    kind: str
    name: str = ""
    position_mm: Three | None = None
    ahead_mm: Annotated[float, between(0, 1e4)] | None = None
    normal: Three | None = None
    stiffness_N_m: Annotated[float, between(1, 1e7)] | None = None
    mass_kg: Annotated[float, between(1e-6, 1e4)] | None = None
    body_mass_kg: Annotated[float, between(1e-6, 1e4)] | None = None
    limits: str = "bgia2011"
    size_mm: Annotated[list[Annotated[float, between(1, 1e4)]], Field(min_length=2, max_length=2)] = [60.0, 60.0]


class ExperimentReaction(BrakingKeys, ExperimentTable):
    """When to react, and how: a threshold on the wrist's force."""

    force_N: Annotated[float, between(1e-3, 1e6)]
    joint_acceleration_rad_s2: Annotated[float, between(0.1, 1e5)] = 4.5
    latency_s: Annotated[float, between(0, 10)] = 0.0


# By the name of the table.
TABLES: dict[str, type[ExperimentTable]] = {
    "motion": ExperimentMotion,
    "friction": ExperimentFriction,
    "sensors": ExperimentSensors,
    "servo": ExperimentServo,
    "object": ExperimentObject,
    "reaction": ExperimentReaction,
}
