"""The scenario of a trajectory slowed down to its safe speeds."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from bumpstop.errors import InputError
from bumpstop.view.study_rows import study_rows

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

    from bumpstop.collision import Scenario


@dataclass(frozen=True)
class RetimedScenario:
    """What a scenario becomes with safe speeds.

    Attributes:
        changes: dotted keys of the scenario and their new values.
        file: the slowed trajectory.
        before_s: how long the trajectory takes as it is [s].
        after_s: how long it takes slowed down [s].
        acceptable: verdict of the slowed trajectory; None without one.
    """

    changes: dict[str, Any]
    file: Path
    before_s: float
    after_s: float
    acceptable: bool | None


def retimed_scenario(
    scenario: Scenario, folder: Path, stopped: Callable[[], bool] = lambda: False
) -> RetimedScenario | None:
    """Slow the trajectory of a scenario down as ``bumpstop study speed-limits`` does it; None where nobody waits.

    Args:
        scenario: with a trajectory.
        folder: the slowed trajectory is written into it, under a name of its own.
        stopped: asked between parts of the work.

    Raises:
        InputError: there is no trajectory, no speed is safe somewhere, or the file cannot be written.
    """
    from bumpstop.study import TrajectorySpeedLimits
    from bumpstop.study.speed.trajectory.slowing import changes_to
    from bumpstop.study.speed.trajectory.trajectory_writing import write_csv

    study = TrajectorySpeedLimits(scenario=scenario.without_uncertainty())
    rows = study_rows(study, stopped)
    if rows is None:
        return None
    slowing = study.slowed(rows)
    retimed = slowing.retimed
    if retimed is None:
        raise InputError("motion.file", f"cannot be slowed down: {slowing.why}", "change the path or the scenario")
    number = 1 + sum(1 for _ in folder.glob("retimed-*.csv"))
    file = folder / f"retimed-{number}.csv"
    write_csv(file, retimed)
    before = float(study.given.time[-1] - study.given.time[0])
    acceptable = None if slowing.judged is None else slowing.judged.acceptable
    return RetimedScenario(changes_to(scenario, retimed, file), file, before, float(retimed.time[-1]), acceptable)
