"""What a scenario says of the contact."""

from __future__ import annotations

import math
from typing import Annotated, Literal

from pydantic import Field, model_validator

from bumpstop.collision.scenario.scenario_words import as_written
from bumpstop.collision.scenario.spellings import check_one_spelling
from bumpstop.collision.scenario.table import Table, between
from bumpstop.errors import InputError
from bumpstop.model.serial_chain import MAX_POINT_M

Point = Annotated[list[Annotated[float, between(-MAX_POINT_M, MAX_POINT_M)]], Field(min_length=3, max_length=3)]
Direction = Annotated[list[Annotated[float, between(-1e6, 1e6)]], Field(min_length=3, max_length=3)]


def check_direction(field: str, direction: list[float]) -> None:
    """Raise an InputError that names ``field`` where three numbers point nowhere."""
    if math.hypot(*direction) < 1e-6:
        raise InputError(field, f"{as_written(direction)} is no direction", "wanted three numbers, not all zero")


class ContactTable(Table):
    """What is hit, where on the arm, and how far away it is."""

    body: Annotated[str, Field(description="the name of a body region (bumpstop bodies lists them)")] | None = None
    limits: Annotated[str, Field(description="the name of a limit table, or a path")] = "bgia2011"
    kind: Literal["clamped", "free"] = "clamped"
    area_cm2: Annotated[float, between(1e-4, 1e4)] = 1.0
    stiffness_N_m: Annotated[float, between(1, 1e9)] | None = None
    stiffness_N_mm: Annotated[float, between(1e-3, 1e6)] | None = None
    padding_N_m: Annotated[float, between(1, 1e9)] | None = None
    damping_Ns_m: Annotated[float, between(0, 1e6)] = 0.0
    gauge_spring_N_m: Annotated[float, between(1, 1e9)] | None = None
    gauge_mass_kg: Annotated[float, between(1e-3, 1e4)] | None = None
    body_mass_kg: Annotated[float, between(1e-3, 1e4)] | None = None
    pressure_area: Annotated[str, Field(description="the name of a pressure area")] | None = None
    peak_factor: Annotated[float, between(1, 1e3)] = 1.0
    link: Annotated[str, Field(description="the name of a link of the robot")] | None = None
    point_m: Point = Field([0.0, 0.0, 0.0])
    normal: Direction | None = None
    arm: Literal["position_driven", "two_mass"] = "position_driven"
    offset_law: Literal["half_normal", "uniform", "fixed"] = "uniform"
    offset_sd_s: Annotated[float, between(1e-6, 1e4)] = 0.1
    offset_mm: Annotated[float, between(0, 1e6)] | None = None

    @model_validator(mode="after")
    def _complete(self) -> ContactTable:
        check_one_spelling(f"contact.{key}" for key in self.model_fields_set if getattr(self, key) is not None)
        if self.stiffness_N_mm is not None:
            # As with the velocity: all others read N/m.
            self.__dict__["stiffness_N_m"] = 1e3 * self.stiffness_N_mm
        if self.body is None and self.stiffness_N_m is None:
            raise InputError(
                "contact.body", "is missing", "name a body region, or give contact.stiffness_N_m without one"
            )
        for key in ("body_mass_kg", "arm"):
            if self.kind == "clamped" and key in self.model_fields_set and getattr(self, key) != "position_driven":
                raise InputError(f"contact.{key}", "has no meaning in clamped contact", 'give contact.kind = "free"')
        if self.kind == "free" and self.body is None and self.body_mass_kg is None:
            raise InputError("contact.body_mass_kg", "is missing", "free contact needs the mass behind the stiffness")
        if self.gauge_mass_kg is not None and self.gauge_spring_N_m is None:
            raise InputError("contact.gauge_spring_N_m", "is missing", "contact.gauge_mass_kg is what moves on it")
        if self.gauge_spring_N_m is not None and self.stiffness_N_m is None:
            # The stiffness of the body region would count as the pad: two bodies one behind the other.
            raise InputError("contact.stiffness_N_m", "is missing", "give that of the pad before the gauge")
        if self.kind == "free" and self.gauge_spring_N_m is not None:
            raise InputError(
                "contact.gauge_spring_N_m",
                "has no meaning in free contact",
                'a gauge is clamped: leave out kind = "free"',
            )
        if self.normal is not None:
            check_direction("contact.normal", self.normal)
        if self.offset_law == "fixed" and self.offset_mm is None:
            raise InputError("contact.offset_mm", "is missing", 'offset_law = "fixed" needs it')
        if self.offset_law != "fixed" and self.offset_mm is not None:
            raise InputError(
                "contact.offset_mm",
                f'has no meaning with offset_law = "{self.offset_law}"',
                'leave it out, or give offset_law = "fixed"',
            )
        return self
