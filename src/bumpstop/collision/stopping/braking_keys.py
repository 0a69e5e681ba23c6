"""Keys of ``[reaction]`` that say how the arm slows down, in scenarios and experiments alike."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator

from bumpstop.errors import InputError


def _between(low: float, high: float) -> Any:
    return Field(ge=low, le=high, allow_inf_nan=False)


# Keys that belong to one law of slowing down alone, and those that it needs.
OF_LAW = {
    "stopping_time_s": "constant_time",
    "ramp_time_s": "ramp",
    "stopping_table": "table",
    "payload_kg": "table",
    "payload_percent": "table",
}
_NEEDED = ("stopping_time_s", "ramp_time_s", "stopping_table")


class BrakingKeys(BaseModel):
    """The law of slowing down, and what drives and brakes do (IEC 60204-1)."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)

    kind: Literal["reverse", "stop"] = "reverse"
    deceleration: Literal["constant", "constant_time", "ramp", "table"] = "constant"
    dead_time_s: Annotated[float, _between(0, 10)] = 0.0
    stopping_time_s: Annotated[float, _between(1e-3, 60)] | None = None
    ramp_time_s: Annotated[float, _between(0, 60)] | None = None
    stopping_table: Annotated[str, Field(description="the path of a stopping table")] | None = None
    payload_kg: Annotated[float, _between(0, 1e4)] | None = None
    payload_percent: Annotated[float, _between(0, 100)] | None = None
    stop_category: Annotated[int, Field(ge=0, le=2)] | None = None

    @model_validator(mode="after")
    def _one_law(self) -> BrakingKeys:
        for key, law in OF_LAW.items():
            given = getattr(self, key) is not None
            if given and law != self.deceleration:
                problem = f'has no meaning with deceleration = "{self.deceleration}"'
                raise InputError(f"reaction.{key}", problem, f'leave it out, or give deceleration = "{law}"')
            if not given and law == self.deceleration and key in _NEEDED:
                raise InputError(f"reaction.{key}", "is missing", f'deceleration = "{law}" needs it')
        if self.payload_kg is not None and self.payload_percent is not None:
            raise InputError("reaction.payload_kg", "and payload_percent are both given", "give one of the two")
        return self

    @model_validator(mode="after")
    def _category(self) -> BrakingKeys:
        if self.stop_category in (0, 1) and self.kind == "reverse":
            raise InputError(
                "reaction.stop_category",
                f'{self.stop_category} takes the power from the drives, and kind = "reverse" needs it',
                'give kind = "stop", or stop_category = 2',
            )
        if self.stop_category == 0 and self.deceleration == "constant_time":
            raise InputError(
                "reaction.stop_category",
                '0 is a stop by brakes alone, and deceleration = "constant_time" one that drives control',
                'valid: 1 or 2, or deceleration = "constant", "ramp" or "table"',
            )
        return self
