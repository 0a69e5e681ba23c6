"""Stopping curves: where the contact point is at every tick, and how far it gets if the arm reacts there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal, cast

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.collision.problem import CollisionProblem
from bumpstop.display import CURVE, EVENT, Displayed
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Ends of a line at which the arm comes to rest; at the others it would go on.
AT_REST = ("joint_limit", "singularity")


PathEnd = Literal["motion_end", "joint_limit", "singularity", "all_detected", "trajectory"]


class TrajectoryReactions:
    """The reactions of one contact of a trajectory, in the manner of the compiled curve of a line."""

    def __init__(self, trajectory: _native.Trajectory, onset: float, normal: FloatArray) -> None:
        """Of the contact that begins at a time [s], on a plane across ``normal`` (3,)."""
        self._trajectory, self.onset, self._normal = trajectory, onset, normal.tolist()

    def reaction_paths(self, ticks: Sequence[int], return_to: Sequence[float]) -> list[FloatArray]:
        """Distances [m] after every simulation step of the reactions to ticks, until contact is over."""
        return [self._trajectory.reaction_distances(tick, self.onset, self._normal) for tick in ticks]


@dataclass(frozen=True, eq=False, repr=False)
class StoppingCurve(Displayed):
    """Where the contact point is at every feedback tick, and the farthest it still gets if the arm reacts there.

    Attributes:
        kernel: the compiled curve, which simulates reactions.
        tick_time: (ticks,) [s] after the start of the motion.
        tick_distance: s(k), (ticks,) distance along the contact normal [m].
        max_distance: s_stop(k), (ticks,) [m].
        torque_per_newton: a(k) = J_v' n, (ticks, dof): residual per newton of contact force [Nm/N or 1].
        distance: (steps + 1,) distance after every simulation step [m]; entry 0 is the start.
        start, normal: contact point at the start [m] and contact normal, base frame (3,).
        approach_speed: of the contact point along the normal at full speed [m/s].
        end: why the curve ends: ``"motion_end"``, ``"joint_limit"``, ``"singularity"``, ``"all_detected"`` or
            ``"trajectory"``, with the trajectory.
        end_joint: the joint at its limit, from 1, or None.
    """

    kernel: _native.LineStoppingCurve | TrajectoryReactions
    tick_time: FloatArray
    tick_distance: FloatArray
    max_distance: FloatArray
    torque_per_newton: FloatArray
    distance: FloatArray
    start: FloatArray
    normal: FloatArray
    approach_speed: float
    end: PathEnd
    end_joint: int | None

    def __repr__(self) -> str:
        """How long it is, and why it ends."""
        return f"StoppingCurve({self.ticks} ticks, {1e3 * self.distance[-1]:.4g} mm, end={self.end!r})"

    def _draw(self, axes: Axes) -> None:
        """Draw where the contact point is at every control cycle, and how far it gets if the arm reacts then."""
        axes.plot(1e3 * self.tick_time, 1e3 * self.max_distance, color=CURVE, label="stopping distance")
        axes.plot(1e3 * self.tick_time, 1e3 * self.tick_distance, "--", color=EVENT, label="distance")
        axes.set(xlabel="time of the control cycle, ms", ylabel="along the normal, mm")
        axes.legend()

    @property
    def line(self) -> _native.LineStoppingCurve:
        """The compiled curve, of a line."""
        assert isinstance(self.kernel, _native.LineStoppingCurve)
        return self.kernel

    @property
    def ticks(self) -> int:
        """Number of feedback ticks."""
        return int(self.tick_time.size)


def stopping_curve(problem: CollisionProblem, *, whole: bool = False) -> StoppingCurve:
    """Trace the motion of a problem and the reaction to every feedback tick.

    Args:
        problem: a checked scenario.
        whole: trace to the end of the motion. By default the curve ends where even the farthest body would have been
            detected for certain, which is all that a distribution needs.

    Raises:
        InputError: what is given is no problem, or its motion is a trajectory, which has such a curve for every time of
            contact.
    """
    if not isinstance(problem, CollisionProblem):
        raise InputError(
            "problem", f"a {type(problem).__name__} is no checked one", "wanted CollisionProblem.from_scenario(...)"
        )
    if problem.trajectory is not None:
        raise InputError("motion.kind", "a trajectory has a stopping curve for every time of contact", "wanted 'line'")
    kernel = _native.stopping_curve(
        problem.setup, problem.q, problem.velocity, None if whole else _certain_detector(problem), problem.contact
    )
    period, step = problem.period_steps, problem.scenario.simulation.step_s
    distance = kernel.distance
    index = np.arange(kernel.ticks) * period + 1
    return StoppingCurve(
        kernel=kernel,
        tick_time=np.asarray(index * step, dtype=np.float64),
        tick_distance=distance[index],
        max_distance=kernel.max_distance,
        torque_per_newton=kernel.torque_per_newton,
        distance=distance,
        start=kernel.start,
        normal=kernel.normal,
        approach_speed=kernel.approach_speed,
        end=cast(PathEnd, kernel.end),
        end_joint=kernel.end_joint + 1 if kernel.end == "joint_limit" else None,
    )


def states_at_reactions(problem: CollisionProblem, curve: StoppingCurve) -> tuple[FloatArray, FloatArray]:
    """Joint positions and rates where the reaction to a tick begins, of a line.

    Returns:
        (ticks, dof) [rad or m] and the same [rad/s or m/s], with one row at least. Ticks after the last reaction have
        those of the start, and no rates.
    """
    states = curve.line.reaction_state
    q = np.tile(problem.q, (max(1, curve.ticks), 1))
    qd = np.zeros_like(q)
    free = [j for j in range(problem.robot.dof) if j not in problem.held]
    q[: len(states), free], qd[: len(states), free] = states[:, 0], states[:, 1]
    return q, qd


def _certain_detector(problem: CollisionProblem) -> _native.GaussianThresholds:
    """A detector that alarms for certain only where the problem's does.

    Measured noise is neither centred nor white nor Gaussian: a tick is certain to alarm where each row of the record
    does, and the number of ticks says nothing.
    """
    record = problem.residuals
    if record is None:
        return problem.detector
    low, high = record.rows.min(axis=0), record.rows.max(axis=0)
    detector = _native.GaussianThresholds(problem.thresholds + (high - low) / 2, np.zeros_like(low), (high + low) / 2)
    detector.arming_delay = problem.scenario.detector.arming_delay_s
    detector.filter = problem.observer_memory
    return detector
