"""Peak forces that a gauge showed, and those of them that do not fit the others."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bumpstop.measure.planning.filled_shots import FilledShot


@dataclass(frozen=True)
class MeasuredShot:
    """A peak force that a gauge showed.

    Attributes:
        situation: name.
        speed_mm_s: of the tip [mm/s].
        force_N: peak force [N].
        number: of the shot in its plan or list.
        lasting_N: greatest force after the first half second of contact [N]; NaN: not known.
    """

    situation: str
    speed_mm_s: float
    force_N: float
    number: int
    lasting_N: float = math.nan


@dataclass(frozen=True)
class BadShot:
    """A shot that does not fit the others.

    Attributes:
        shot: as measured.
        ratio: of measured to expected force [1].
    """

    shot: MeasuredShot
    ratio: float

    def __str__(self) -> str:
        """What is wrong with it, in one sentence: several plans may number their shots alike."""
        shot = self.shot
        return (
            f"Shot {shot.number}, {shot.situation} at {shot.speed_mm_s:.4g} mm/s with {shot.force_N:.4g} N, shows "
            f"{self.ratio:.3g} times what the others make expected: it hardly counts."
        )

    def to_json(self) -> dict[str, Any]:
        """By name, with what tells it from others of its number."""
        shot = self.shot
        return {
            "shot": shot.number,
            "situation": shot.situation,
            "speed_mm_s": shot.speed_mm_s,
            "force_N": shot.force_N,
            "ratio": self.ratio,
        }


def is_of(situation: str, speed_mm_s: float, shot: MeasuredShot | FilledShot) -> bool:
    """Whether a shot is one of a situation at a speed."""
    return situation == shot.situation and math.isclose(speed_mm_s, shot.speed_mm_s, rel_tol=1e-3)
