"""The table of a scenario that says whether the arm gives way."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, model_validator

from bumpstop.collision.scenario.table import Table, between
from bumpstop.errors import InputError

Inertia = Annotated[float, between(1e-9, 1e6)]
Stiffness = Annotated[float, between(1e-3, 1e12)]
DampingShare = Annotated[float, between(1e-6, 10)]
Bandwidth = Annotated[float, between(1e-6, 1e6)]
PositionGain = Annotated[float, between(1e-6, 1e6)]
TorqueLimit = Annotated[float, between(1e-3, 1e6)]
Share = Annotated[float, between(0, 1)]
# Each key of the table, and what it is called in a drive train.
QUANTITY = {
    "rotor_inertia_kg_m2": "rotor_inertia",
    "gear_stiffness_Nm_rad": "gear_stiffness",
    "gear_damping": "gear_damping",
    "servo_bandwidth_hz": "servo_bandwidth",
    "servo_position_gain_1_s": "servo_position_gain",
    "torque_limit_Nm": "torque_limit",
    "acceleration_feedforward": "acceleration_feedforward",
}


class ArmTable(Table):
    """Whether the arm follows its path whatever it hits, or gives way; numbers by joint, or one for all."""

    model: Literal["rigid", "elastic"] = "rigid"
    file: Annotated[str, Field(description="the path of a drive train file")] | None = None
    rotor_inertia_kg_m2: Inertia | list[Inertia] | None = None
    gear_stiffness_Nm_rad: Stiffness | list[Stiffness] | None = None
    gear_damping: DampingShare | list[DampingShare] | None = None
    servo_bandwidth_hz: Bandwidth | list[Bandwidth] | None = None
    servo_position_gain_1_s: PositionGain | list[PositionGain] | None = None
    torque_limit_Nm: TorqueLimit | list[TorqueLimit] | None = None
    acceleration_feedforward: Share | list[Share] | None = None

    @model_validator(mode="after")
    def _of_elastic_arms(self) -> ArmTable:
        for key in ("file", *QUANTITY):
            if self.model == "rigid" and getattr(self, key) is not None:
                raise InputError(
                    f"arm.{key}", 'has no meaning with arm.model = "rigid"', 'leave it out, or give model = "elastic"'
                )
        return self
