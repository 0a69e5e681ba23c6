"""A trajectory slowed down to its limits, judged as ``bumpstop evaluate`` judges it."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision import evaluate
from bumpstop.collision.arm.other_arm_verdict import said_beside
from bumpstop.errors import InputError
from bumpstop.study.speed.trajectory.retiming import Retimed, retime
from bumpstop.study.speed.trajectory.trajectory_writing import write_csv

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision import CollisionProblem, Scenario
    from bumpstop.collision.trajectory.trajectory import Trajectory
    from bumpstop.collision.verdict.verdict import Verdict

# Rows look at single moments of straight lines. Where the distribution of the whole slowed motion still exceeds the
# accepted risk it is slowed by so much more, so many times at most, for as long as that helps.
_EASE, _ROUNDS, _HELPS = 0.95, 8, 0.97
_FILE = "retimed.csv"


@dataclass(frozen=True)
class Judged:
    """A motion as ``bumpstop evaluate`` judges it.

    Attributes:
        verdict: None where there is none.
        why: there is none; else empty.
        warnings: to be read beside an acceptable verdict.
    """

    verdict: Verdict | None
    why: str = ""
    warnings: tuple[str, ...] = ()

    @property
    def acceptable(self) -> bool | None:
        """The verdict's; None without one."""
        return None if self.verdict is None else self.verdict.acceptable

    @property
    def over(self) -> float:
        """Probability of passing a limit; 0 where it is not known."""
        verdict = self.verdict
        return 0.0 if verdict is None else max(verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0)

    def to_json(self) -> dict[str, Any]:
        """The verdict as ``bumpstop evaluate --json`` prints it, or why there is none."""
        if self.verdict is None:
            return {"acceptable": None, "reason": self.why}
        return self.verdict.to_json() | ({"warnings": list(self.warnings)} if self.acceptable else {})


@dataclass(frozen=True)
class Slowing:
    """What slowing down came to.

    Attributes:
        retimed: the slowed trajectory, None where there is none.
        why: there is none; else empty.
        judged: the slowed trajectory's law.
        eased: share by which its path speed had to be lowered beyond what the rows ask for, 0 to 1.
    """

    retimed: Retimed | None
    why: str = ""
    judged: Judged | None = None
    eased: float = 0.0


def judge_motion(scenario: Scenario) -> Judged:
    """The verdict of a trajectory's scenario, by the function that ``bumpstop evaluate`` uses.

    What is not acceptable is slowed further: the warnings, which take another distribution, are those of what is.
    """
    try:
        result = evaluate(scenario)
        return Judged(result.verdict, warnings=said_beside(result) if result.verdict.acceptable else ())
    except InputError as error:
        return Judged(None, error.problem)


def slow_down(problem: CollisionProblem, trajectory: Trajectory, path_speed: FloatArray) -> Slowing:
    """Slow a trajectory down to path speeds of its rows, and further where its own distribution asks for it.

    Args:
        problem: of the trajectory as given.
        trajectory: the same with a row for every path speed.
        path_speed: greatest share of its own speed at every row (rows,), 0 to 1.
    """
    limits = problem.robot.velocity, problem.joint_acceleration
    first: Slowing | None = None
    least, factor = float("inf"), 1.0
    for _ in range(_ROUNDS):
        try:
            retimed = retime(trajectory, factor * path_speed, *limits)
        except InputError as error:
            return first or Slowing(None, error.problem)
        slowing = Slowing(retimed, judged=_judged(problem.scenario, retimed), eased=1 - factor)
        assert slowing.judged is not None
        over = slowing.judged.over
        if over <= problem.scenario.verdict.accepted_probability:
            return slowing
        first = first or slowing
        if over > _HELPS * least:
            break  # what stays undetected however slow the arm is
        least, factor = over, factor * _EASE
    return first or Slowing(None, "nothing was tried")


def changes_to(scenario: Scenario, retimed: Retimed, file: Path) -> dict[str, Any]:
    """Keys of a scenario and their values for its slowed trajectory.

    Contact that begins at a time begins at the same place of the path, which is later.
    """
    onset = scenario.motion.contact_onset_s
    if onset == "uniform":
        return {"motion.file": str(file)}
    later = float(np.interp(onset, retimed.path_time, retimed.time))
    return {"motion.file": str(file), "motion.contact_onset_s": later}


def _judged(scenario: Scenario, retimed: Retimed) -> Judged:
    """From the file that is written, with every check that reading it makes."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / _FILE
        write_csv(file, retimed)
        judged = judge_motion(scenario.with_values(changes_to(scenario, retimed, file)))
        return replace(judged, why=judged.why.replace(str(file), _FILE))
