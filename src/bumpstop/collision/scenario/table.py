"""What the tables of a scenario have in common."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ConfigDict, Field


class Table(BaseModel):
    """Keys that a person writes: strictly typed, none unknown, none changed afterwards."""

    model_config = ConfigDict(extra="forbid", strict=True, frozen=True)


def between(low: float, high: float) -> Any:
    """A finite number in a range.

    Every number of a scenario has one: wide enough for any arm and any unit slip, narrow enough that no product of them
    overflows or vanishes and no simulation takes for ever.
    """
    return Field(ge=low, le=high, allow_inf_nan=False)
