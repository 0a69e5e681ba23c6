"""Where a gauge stands in the way of a trajectory."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from bumpstop.collision.evaluation import evaluate
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.trajectory.onset import approach, trajectory_of
from bumpstop.collision.trajectory.trajectory import point_motion, point_places
from bumpstop.collision.trajectory.trajectory_evaluation import integrate_trajectory
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.arrays import FloatArray
    from bumpstop.collision.scenario.scenario import Scenario

_TIMES = 2000  # at which the way to the gauge is looked at
# The face of a gauge is passed where the contact point is so far beyond it and so near its middle [m].
_BEYOND, _BESIDE = 1e-3, 0.06


@dataclass(frozen=True, eq=False)
class TrajectoryPlace:
    """The place of a trajectory where contact is measured.

    Attributes:
        onset: time of the trajectory at which the contact point meets the gauge [s].
        q: joint positions then (dof,) [rad or m].
        contact_point: base frame (3,) [m].
        normal: into the gauge, base frame (3,) [1].
        speed: of the contact point then [m/s].
        start_point: contact point at the start of the trajectory, base frame (3,) [m].
        way: of the contact point from there to the gauge [m].
        passes: last time before the onset at which the contact point is where the gauge stands [s]; None: it never is.
    """

    onset: float
    q: FloatArray
    contact_point: FloatArray
    normal: FloatArray
    speed: float
    start_point: FloatArray
    way: float
    passes: float | None

    @classmethod
    def of(cls, scenario: Scenario, onset: float | None = None) -> TrajectoryPlace:
        """Find the place.

        Args:
            scenario: of a trajectory.
            onset: time of it [s]; None: that of the scenario, and where it says none that of the greatest mean force.

        Raises:
            InputError: the scenario cannot be computed, or the contact point stands still or goes backward then.
        """
        problem = CollisionProblem.from_scenario(scenario)
        trajectory, given = trajectory_of(problem), scenario.motion.contact_onset_s
        if onset is None:
            onset = integrate_trajectory(problem, evaluate).onset if given == "uniform" else given
        if not 0 <= onset < trajectory.duration:
            valid = f"wanted 0 to below {trajectory.duration:.6g} s"
            raise InputError("motion.contact_onset_s", f"{onset:g} s is not in the motion", valid)
        normal, toward = approach(problem, np.array([onset]))
        if not toward[0] > 0:
            raise InputError(
                "motion.contact_onset_s",
                f"at {onset:g} s the contact point does not move toward the gauge",
                "give a time at which it does",
            )
        time = np.linspace(0.0, onset, _TIMES)
        places = point_places(trajectory, problem.robot, problem.contact_point, time)
        away = places - places[-1]
        beyond = away @ normal[0]
        beside = np.linalg.norm(away - beyond[:, None] * normal[0], axis=1)
        passed = np.flatnonzero((beyond > _BEYOND) & (beside < _BESIDE))
        velocity, _ = point_motion(trajectory, problem.robot, problem.contact_point, time[-1:])
        return cls(
            onset=onset,
            q=trajectory.at(onset),
            contact_point=places[-1],
            normal=normal[0],
            speed=float(np.linalg.norm(velocity)),
            start_point=places[0],
            way=float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum()),
            passes=float(time[passed[-1]]) if passed.size else None,
        )

    def notes(self) -> list[str]:
        """What whoever measures should know."""
        found = [
            "Run the trajectory from its start, slowed down as a whole for lower speeds: at its own speed "
            f"it meets the gauge after {self.onset:.3f} s. Speeds are those of the contact point there."
        ]
        if self.passes is not None:
            found.append(
                f"The contact point passes the place of the gauge before, last at {self.passes:.3f} s: begin after "
                "that, or place the gauge while the arm is elsewhere."
            )
        return found
