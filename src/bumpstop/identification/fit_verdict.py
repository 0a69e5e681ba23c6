"""The verdict on a fit or on its validation: usable, usable with warnings or not usable, and why."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bumpstop.terminal import in_percent, named

if TYPE_CHECKING:
    from bumpstop.identification.comparison import JointScore
    from bumpstop.identification.dynamics.dynamics_model import DynamicsModel
    from bumpstop.joint import JointTorqueModel
    from bumpstop.model import Robot
    from bumpstop.recording import Recording

# Behind the advice to give a current or torque of the opposite sign its sign.
OTHER_CAUSES = "unless its positions are reversed, it has an offset or it is the wrong column"
# Share of a current's or torque's variance that is left unexplained.
WORTHLESS, POOR = 1.0, 0.3
USABLE, WITH_WARNINGS, NOT_USABLE = "usable", "usable with warnings", "not usable"


@dataclass(frozen=True, kw_only=True)
class FitVerdict:
    """What was found of a fit, or of a model on other recordings.

    Attributes:
        faults: why it cannot be used, a sentence without its full stop each; any of them makes it not usable.
        warnings: what limits its use, likewise.
        condition: condition number of the columns that were fitted, each brought to length one; None: there is none.
        held_out: share of the variance, 0 to 1 and more, that is left unexplained on rows that were not fitted, the
            mean over joints; None: none were held out.
    """

    faults: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    condition: float | None = None
    held_out: float | None = None

    def __str__(self) -> str:
        return "\n".join([self.line(), *self.reasons()])

    @property
    def status(self) -> str:
        """``"usable"``, ``"usable with warnings"`` or ``"not usable"``."""
        if self.faults:
            return NOT_USABLE
        return WITH_WARNINGS if self.warnings else USABLE

    @property
    def usable(self) -> bool:
        """Whether nothing stands against using it."""
        return not self.faults

    def line(self) -> str:
        """The verdict with its figures in one line."""
        figures = []
        if self.condition is not None:
            figures.append(f"condition number {self.condition:.3g}")
        if self.held_out is not None:
            figures.append(f"{in_percent(self.held_out)} unexplained on held-out rows")
        return f"verdict: {self.status}" + (f" ({', '.join(figures)})" if figures else "")

    def reasons(self) -> list[str]:
        """Every reason in a line of its own, those that make it not usable first."""
        return [f"not usable: {fault}" for fault in self.faults] + [f"warning: {one}" for one in self.warnings]

    def to_json(self) -> dict[str, Any]:
        """For programs; what is infinite is null."""
        figures = {"condition_number": self.condition, "held_out_unexplained": self.held_out}
        return {
            "status": self.status,
            "faults": list(self.faults),
            "warnings": list(self.warnings),
            **{name: x if x is not None and math.isfinite(x) else None for name, x in figures.items()},
        }


def as_sentences(faults: Sequence[str]) -> list[str]:
    """Each with an end: a question has one."""
    return [fault if fault.endswith("?") else f"{fault}." for fault in faults]


def fit_faults(model: JointTorqueModel | DynamicsModel | None) -> list[str]:
    """What the file of a model says against the fit that gave it: nothing where it says nothing, as of no model."""
    if model is None or model.verdict != NOT_USABLE:
        return []
    return [f"the model comes of a fit that was judged {NOT_USABLE}: what it predicts is not to be relied on"]


def reading_faults(recordings: Sequence[Recording]) -> list[str]:
    """What recordings contradict themselves or their robot in, with their names: no fit to them can be used."""
    found = []
    for log in recordings:
        found += [f"{log.source}: {fault}" if log.source else fault for fault in log.report.contradictions]
    return found


def reading_warnings(recordings: Sequence[Recording], robot: Robot | None) -> list[str]:
    """What recordings say of themselves that limits a fit, with their names."""
    taken = "the model's robot" if robot is None else repr(robot.name)
    return [
        f"{log.source + ': ' if log.source else ''}the file names robot {log.report.other_robot!r}, and {taken} is "
        "taken: their lengths and masses differ"
        for log in recordings
        if log.report.other_robot
    ]


def gain_warnings(scores: Sequence[JointScore]) -> list[str]:
    """A sentence on the joints of a validation whose gain the model does not know; empty: it knows all."""
    hidden = [score.name for score in scores if score.free_gain]
    return [f"the gain of {named(hidden)} is not known: currents are judged up to a free gain"] if hidden else []


def tell_score(
    score: JointScore, word: str, dead: str, filter_hz: float, faults: list[str], warnings: list[str]
) -> None:
    """Add a sentence on a joint of which the model predicts little, or of which nothing is known.

    Args:
        score: of the joint.
        word: what is predicted.
        dead: what is said of a joint that moves, and of which nothing varies.
        filter_hz: cut-off of the comparison.
        faults: what says more than nothing against the joint is added.
        warnings: what is hardly predicted, or not judged, is added.
    """
    left = 1 - score.r2
    if score.rests:
        warnings.append(f"{score.name} rests: its {word} is not judged")
    elif not math.isfinite(left):
        (warnings if score.free_gain else faults).append(dead)
    elif left > POOR:
        (faults if left > WORTHLESS else warnings).append(
            f"{in_percent(left)} of the {word} of {score.name} is not predicted, below {filter_hz:g} Hz"
        )
