"""The cell that segments are judged in: scenarios whose motion is replaced by theirs."""

from __future__ import annotations

import math
import tempfile
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from bumpstop.collision import CollisionProblem, evaluate
from bumpstop.collision.arm.other_arm_verdict import said_beside
from bumpstop.collision.scenario.keys import leave_out
from bumpstop.collision.scenario.scenario import Scenario
from bumpstop.collision.scenario.scenario_file import robot_of
from bumpstop.collision.trajectory.trajectory import (
    JointLimitError,
    Trajectory,
    checked_motion,
    point_motion,
    point_places,
)
from bumpstop.collision.trajectory.trajectory_file import Rows
from bumpstop.collision.verdict.finer_steps import STEPS_DECIDE, fails_with_finer_steps
from bumpstop.collision.verdict.verdict_notes import verdict_notes
from bumpstop.errors import InputError
from bumpstop.program.worst_onset import worst_onset
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.text_files import write_text

if TYPE_CHECKING:
    from collections.abc import Sequence

    from bumpstop.arrays import FloatArray
    from bumpstop.collision.verdict.verdict import Verdict
    from bumpstop.model import Robot

# Time of a motion at which contact with a body is hardest [s], and its peak force over the allowed one.
WorstOnset = tuple[float, float]
# Keys that say where the body is on a line; on a trajectory contact begins at any time.
_OFFSET = ("offset_law", "offset_sd_s", "offset_mm")
_PLACEHOLDER = "segment.csv"
# What is worse; a body that is not touched counts least.
_RANK = {"not_acceptable": 3, "inconclusive": 2, "acceptable": 1}


@dataclass(frozen=True, eq=False)
class Judgement:
    """A motion as ``bumpstop evaluate`` judges it.

    Attributes:
        verdict: None where there is none.
        why: there is none; else empty.
        force: peak force that is exceeded with the accepted probability [N]; NaN without a verdict.
        share: that force over the allowed one, as the search for speeds has it; NaN without a verdict.
        worst_s: time of the motion at which contact is hardest [s].
        worst_m: where the contact point is then, base frame (3,) [m].
        tool_speed: greatest of the tip [m/s].
        cell: whose body is hit; None without a verdict.
        warnings: what ``bumpstop evaluate`` says beside the verdict, of every body; of a verdict that is not acceptable
            without finer steps.
    """

    verdict: Verdict | None
    why: str = ""
    force: float = math.nan
    share: float = math.nan
    worst_s: float = math.nan
    worst_m: tuple[float, ...] = ()
    tool_speed: float = math.nan
    cell: Cell | None = None
    warnings: tuple[str, ...] = ()

    @property
    def conclusion(self) -> str:
        """``"acceptable"``, ``"not_acceptable"`` or ``"inconclusive"``, as in a register where the steps decide."""
        return "inconclusive" if self.verdict is None or self.fails_with_finer_steps else self.verdict.conclusion

    @property
    def fails_with_finer_steps(self) -> bool:
        """The verdict is acceptable, but not with finer simulation steps."""
        return self.verdict is not None and self.verdict.acceptable is True and fails_with_finer_steps(self.warnings)

    @property
    def reason(self) -> str:
        """Of the conclusion, in a sentence."""
        if self.verdict is None:
            return self.why
        return STEPS_DECIDE if self.fails_with_finer_steps else self.verdict.reason

    @property
    def over(self) -> float:
        """Probability of passing a limit; NaN without a verdict."""
        verdict = self.verdict
        return math.nan if verdict is None else max(verdict.p_over_force or 0.0, verdict.p_over_pressure or 0.0)


class Cell:
    """A scenario to judge motions in, or several: bodies beside one arm, and places of it that may hit them.

    Attributes:
        bodies: a cell for every scenario, this one first; a motion is judged by the hardest.

    Args:
        scenario: of a line or a trajectory, whose motion, pose and offset are not used, but for the start.
        others: of the same arm and start.
        threads: that share the times of contact; they do not change what is found.

    Raises:
        InputError: a scenario cannot judge trajectories, names no body region, or is of another arm or start.
    """

    def __init__(self, scenario: Scenario, *others: Scenario, threads: int = 1) -> None:
        self.threads = threads
        if scenario.uncertainty:
            problem = "is not taken into account for programs"
            raise InputError(
                "uncertainty", problem, "leave the table out; judge what is written with bumpstop evaluate"
            )
        data = scenario.model_dump(exclude_unset=True, exclude_none=True, mode="python", exclude={"folder"})
        self.start = self._start(scenario)
        leave_out(data, ("pose_deg", "pose_rad", "motion", *(f"contact.{key}" for key in _OFFSET)))
        data["motion"] = {"kind": "trajectory", "file": _PLACEHOLDER, "contact_onset_s": "uniform"}
        if "stiffness_N_m" in data["contact"]:
            data["contact"].pop("stiffness_N_mm", None)
        self.scenario = Scenario.from_dict(data, scenario.folder)
        self._check()
        self.bodies: tuple[Cell, ...] = (self, *(Cell(other, threads=threads) for other in others))
        for other in self.bodies[1:]:
            for what, same in (
                ("robot", _arm(other) == _arm(self)),
                ("start", np.array_equal(_or_empty(other.start), _or_empty(self.start))),
            ):
                if not same:
                    raise InputError("--scenario", f"two cells have another {what}", f"give cells of one {what}")

    def _check(self) -> None:
        scenario = self.scenario
        if scenario.contact.body is None:
            raise InputError("contact.body", "is missing", "a verdict needs limits: name a body region")
        if scenario.detector.residuals is not None:
            raise InputError("detector.residuals", "have no integrated distribution", "give detector.noise_sd_Nm")
        # The link that hits, and what an elastic arm needs to be known of it.
        for name in ("contact_point", "setup"):
            getattr(self.at_rest, name)
        for limits in (self.at_rest.limits, self.at_rest.transient_limits or self.at_rest.limits):
            if limits is None or not limits.permitted:
                reason = "there is none" if limits is None else limits.reason
                raise InputError("contact.body", f"no speed is safe: {reason}", "name another body region")

    @staticmethod
    def _start(scenario: Scenario) -> FloatArray | None:
        if scenario.pose_rad is not None:
            return np.array(scenario.pose_rad, dtype=np.float64)
        return None if scenario.pose_deg is None else np.radians(np.array(scenario.pose_deg, dtype=np.float64))

    @cached_property
    def robot(self) -> Robot:
        """The arm."""
        return self.at_rest.robot

    @cached_property
    def joint_acceleration(self) -> FloatArray:
        """Of the reaction, the least of all cells' (dof,) [rad/s2 or m/s2]."""
        return np.asarray(np.min([body.at_rest.joint_acceleration for body in self.bodies], axis=0))

    @cached_property
    def at_rest(self) -> CollisionProblem:
        """The problem of a motion that is next to none: what all segments share."""
        robot = robot_of(self.scenario)
        q = np.zeros(robot.dof) if self.start is None else self.start
        q = np.clip(q, robot.lower, robot.upper)
        still = Trajectory(np.array([0.0, 1.0]), np.stack([q, q]), np.zeros((2, robot.dof)))
        with tempfile.TemporaryDirectory() as folder:
            write_trajectory(Path(folder) / _PLACEHOLDER, still)
            return CollisionProblem.from_scenario(self.of(Path(folder) / _PLACEHOLDER))

    @cached_property
    def allowed_force(self) -> float:
        """Greatest peak force within the limits of the body [N]."""
        return allowed_force(self.at_rest)

    def of(self, file: Path | str, onset_s: float | None = None) -> Scenario:
        """The scenario of a trajectory file, with contact at a time of it, or at any."""
        at: float | str = "uniform" if onset_s is None else onset_s
        return self.scenario.with_values({"motion.file": str(file), "motion.contact_onset_s": at})

    def hardest(self, trajectory: Trajectory, place: float | None = None) -> list[WorstOnset]:
        """Of each body, the time of the motion at which contact is hardest [s], and how hard it is then.

        Args:
            trajectory: the motion.
            place: share of its duration at which contact is expected to be hard. Where it passes a limit there, that is
                the answer, though it may be harder elsewhere or for a later body.

        Raises:
            InputError: the motion passes a limit of the robot.
        """
        near = None if place is None else place * trajectory.duration
        found: list[WorstOnset] = []
        for body in self.bodies:
            found.append(worst_onset(body.problem(trajectory), threads=self.threads, near=near, enough=1.0))
            if place is not None and found[-1][1] > 1:
                break
        return found

    def tool_speed(self, trajectory: Trajectory) -> float:
        """Greatest of the tip [m/s]."""
        t = np.linspace(0, trajectory.duration, 400)
        velocity, _ = point_motion(trajectory, self.robot, self.robot.frame(None), t)
        return float(np.linalg.norm(velocity, axis=1).max())

    def problem(self, trajectory: Trajectory) -> CollisionProblem:
        """Of a trajectory, with every check that reading it from a file makes.

        Raises:
            InputError: the motion passes a limit of the robot.
        """
        dof = self.robot.dof
        names = [[f"{name}_{j + 1}" for j in range(dof)] for name in ("q", "qd")]
        rows = Rows(trajectory.time, trajectory.position, trajectory.velocity, "row", *names)
        step = self.scenario.simulation.step_s
        motion = checked_motion(Path(_PLACEHOLDER), rows, self.robot, step)
        return replace(self.at_rest, q=motion.position[0].copy(), trajectory=motion)

    def judge(self, trajectory: Trajectory, hardest: Sequence[WorstOnset] | None = None) -> Judgement:
        """A contact at the worst place with the worst body.

        Args:
            trajectory: the motion.
            hardest: of each body, where it is known already.
        """
        known = [None] * len(self.bodies) if hardest is None else hardest
        judged = [body._judge(trajectory, worst) for body, worst in zip(self.bodies, known, strict=True)]
        worst = max(judged, key=lambda one: (_RANK[one.conclusion] if one.share != 0 else 0, one.share))
        return replace(
            worst,
            share=max((one.share for one in judged if one.share > 0), default=worst.share),
            warnings=tuple(dict.fromkeys(warning for one in judged for warning in one.warnings)),
        )

    def _judge(self, trajectory: Trajectory, known: WorstOnset | None) -> Judgement:
        """Of this body alone, by the function that ``bumpstop evaluate`` uses, from the file it reads."""
        speed = self.tool_speed(trajectory)
        try:
            problem = self.problem(trajectory)
            worst, share = known or worst_onset(problem, threads=self.threads)
            if share == 0:
                return Judgement(None, "the contact point touches nothing on the way", share=0.0, tool_speed=speed)
            with tempfile.TemporaryDirectory() as folder:
                file = Path(folder) / _PLACEHOLDER
                write_trajectory(file, trajectory)
                result = evaluate(self.of(file, worst))
                verdict = result.verdict
                # What is not acceptable stays so: finer steps, which take another distribution, are of what is.
                warnings = said_beside(result) if verdict.acceptable else tuple(verdict_notes(result, verdict, None))
        except JointLimitError as error:
            return Judgement(None, error.passed, tool_speed=speed)
        except InputError as error:
            return Judgement(None, error.problem.removeprefix(f"{_PLACEHOLDER}: "), tool_speed=speed)
        where = point_places(trajectory, self.robot, problem.contact_point, np.array([worst]))[0]
        force = float(result.peak_force.quantile(1 - verdict.accepted_probability))
        return Judgement(verdict, "", force, share, worst, tuple(float(x) for x in where), speed, self, warnings)

    def to_json(self) -> dict[str, Any]:
        """Of this body alone, as ``--json`` prints it."""
        contact = self.scenario.contact
        return {"body": contact.body, "link": contact.link, "allowed_force_N": self.allowed_force}


def _arm(cell: Cell) -> tuple[str, ...]:
    """Where it is from, and the joints of the chain that was taken of it."""
    return (str(cell.scenario.robot_path or cell.scenario.robot), *(joint.name for joint in cell.robot.joints))


def _or_empty(q: FloatArray | None) -> FloatArray:
    return np.zeros(0) if q is None else q


def write_trajectory(path: Path, trajectory: Trajectory) -> None:
    """Columns t, q_1.. and qd_1.. where there are velocities, as a scenario's motion.file takes them; all digits."""
    dof = trajectory.position.shape[1]
    columns = [trajectory.time[:, None], trajectory.position]
    names = ["t", *(f"q_{j + 1}" for j in range(dof))]
    if trajectory.velocity is not None:
        columns.append(trajectory.velocity)
        names += [f"qd_{j + 1}" for j in range(dof)]
    lines = [",".join(names), *(",".join(map(repr, row)) for row in np.hstack(columns).tolist())]
    write_text(path, "\n".join(lines) + "\n")
