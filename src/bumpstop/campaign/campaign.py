"""A campaign: every combination of robot, tool, body, detector and arm, at random poses, in directions, at speeds."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from itertools import product
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from bumpstop.arrays import FloatArray
from bumpstop.campaign.campaign_summary import summarise, summary_lines
from bumpstop.campaign.nearest_rows import NearestRows
from bumpstop.campaign.numbering import Numbering
from bumpstop.collision import CollisionProblem, Scenario, evaluate_batch
from bumpstop.collision.scenario.settings_file import files_of, scenario_data
from bumpstop.collision.verdict.as_given import doubts_as_given
from bumpstop.collision.verdict.finer_steps import fails_with_finer_steps
from bumpstop.collision.verdict.verdict_notes import MAX_UNTOUCHED
from bumpstop.errors import InputError
from bumpstop.shards import ShardedJob, code_digest, digest, to_jsonable, versions
from bumpstop.study.answer_warnings import AnswerWarnings, through_pose, told_once, warnings_of
from bumpstop.study.directions import spread_directions
from bumpstop.study.joint_ranges import joint_ranges
from bumpstop.study.parameters.effectiveness import DIRECTIONS

if TYPE_CHECKING:
    from pathlib import Path

    import polars as pl

AXES = ("robots", "tools", "bodies", "detectors", "arms")
QUANTILES = {"p50_N": 0.5, "p95_N": 0.95, "p99_N": 0.99, "p999_N": 0.999}
MAX_DISTRIBUTIONS = 10**12
MAX_SETUPS = 100_000
# Poses drawn at once: a block of poses is a pure function of seed, robot and block.
_BLOCK = 256
# Nominal cost of a distribution [us]: of a clamped body before a rigid arm, and where arm or body give way. They
# decide how many distributions a shard has, and nothing else.
_RIGID_US, _GIVING_US = 1000, 60_000
# Setups of which one distribution is computed again for its warnings: an elastic one takes a good part of a second.
_WARNED_SETUPS = 100
# Problems that a worker keeps; a shard rarely has more setups.
_KEPT_PROBLEMS = 8


@dataclass(frozen=True)
class Choice:
    """One choice of an axis.

    Attributes:
        name: that rows call it.
        keys: dotted keys of the scenario, and their values.
        scenario: of a robot: what its setups start from.
    """

    name: str
    keys: tuple[tuple[str, Any], ...] = ()
    scenario: Scenario | None = None


@dataclass(frozen=True)
class Campaign(ShardedJob):
    """One integrated distribution for every combination of choices, poses, directions and speeds.

    Attributes:
        robots: with their scenarios.
        tools, bodies, detectors, arms: choices that change keys of the scenarios; at least one each.
        poses: number of random poses of each robot, inside the limits of its joints.
        directions: names of :data:`~bumpstop.study.parameters.effectiveness.DIRECTIONS`, or a number: evenly spread
            over the sphere.
        speeds_mm_s: of the tip, ascending.
        seed: of the poses.
        shard_s: nominal time of a shard [s].
    """

    name: ClassVar[str] = "campaign"
    title: ClassVar[str] = "campaign"
    volume_shards: ClassVar[int] = 32

    robots: tuple[Choice, ...]
    tools: tuple[Choice, ...] = (Choice("any"),)
    bodies: tuple[Choice, ...] = (Choice("any"),)
    detectors: tuple[Choice, ...] = (Choice("any"),)
    arms: tuple[Choice, ...] = (Choice("any"),)
    poses: int = 1000
    directions: tuple[str, ...] | int = ("down", "left")
    speeds_mm_s: tuple[float, ...] = (50.0, 100.0, 250.0)
    seed: int = 0
    shard_s: float = 10.0

    def check(self) -> None:
        """Refuse what a shard would refuse, before any work.

        Raises:
            InputError: a setup cannot be used; names its choices.
        """
        distributions = self._motions * len(self.setups)
        if distributions > MAX_DISTRIBUTIONS:
            raise InputError("poses", f"make {distributions:.3g} distributions", "wanted at most 1e12")
        for number in range(len(self.setups)):
            try:
                problem = CollisionProblem.from_scenario(self.scenario_of(number))
                joint_ranges(problem)
                if problem.scenario.verdict.clamped_limit == "two_phase":
                    problem_text = "'two_phase' has two limits at once"
                    raise InputError("verdict.clamped_limit", problem_text, "wanted 'quasi_static' for a campaign")
                evaluate_batch(problem, np.empty((0, problem.robot.dof)), np.empty((0, 3)))
            except InputError as error:
                raise InputError(error.field, f"{self._name(number)}: {error.problem}", error.valid) from None

    # --- Setups and motions -------------------------------------------------------------------------------------

    @cached_property
    def setups(self) -> list[tuple[Choice, ...]]:
        """Every combination of choices, the last axis fastest."""
        return list(product(*(getattr(self, axis) for axis in AXES)))

    @cached_property
    def numbering(self) -> Numbering:
        """Which distributions a shard computes."""
        costs = [_RIGID_US if self._is_rigid(number) else _GIVING_US for number in range(len(self.setups))]
        # A shard of less than one distribution would have none.
        return Numbering(self._motions, costs, max(*costs, round(1e6 * self.shard_s)))

    @property
    def _motions(self) -> int:
        """Of each setup."""
        return self.poses * len(self.direction_vectors) * len(self.speeds_mm_s)

    @cached_property
    def direction_vectors(self) -> FloatArray:
        """Unit vectors, base frame (directions, 3)."""
        if isinstance(self.directions, int):
            return spread_directions("sphere", np.array([0.0, 0.0, -1.0]), self.directions)
        return np.array([DIRECTIONS[name] for name in self.directions])

    def _name(self, setup: int) -> str:
        return " ".join(choice.name for choice in self.setups[setup] if choice.name != "any")

    def scenario_of(self, setup: int) -> Scenario:
        """The scenario of a setup: the robot's, with the keys of all its choices."""
        choices = self.setups[setup]
        scenario = choices[0].scenario
        assert scenario is not None
        keys: dict[str, Any] = {}
        for choice in choices:
            keys |= dict(choice.keys)
        return scenario.with_values(keys) if keys else scenario

    def joint_positions(self, setup: int, poses: Any) -> FloatArray:
        """Poses of a setup by their numbers (N,): (N, dof) [rad or m]."""
        problem = self._problem(setup)
        robot = self.robots.index(self.setups[setup][0])
        blocks, inverse = np.unique(np.asarray(poses) // _BLOCK, return_inverse=True)
        shares = np.stack([self._block(robot, int(block), problem.robot.dof) for block in blocks])
        share = shares[inverse, np.asarray(poses) % _BLOCK]
        q = np.tile(problem.q, (len(share), 1))
        for joint, low, high in joint_ranges(problem):
            q[:, joint] = low + (high - low) * share[:, joint]
        return q

    def _block(self, robot: int, block: int, dof: int) -> FloatArray:
        rng = np.random.Generator(np.random.Philox(key=self.seed, counter=[0, 0, robot, block]))
        return rng.random((_BLOCK, dof))

    def _is_rigid(self, setup: int) -> bool:
        scenario = self.scenario_of(setup)
        return scenario.contact.kind == "clamped" and scenario.arm.model == "rigid"

    @cached_property
    def _problems(self) -> dict[int, CollisionProblem]:
        return {}

    def _problem(self, setup: int) -> CollisionProblem:
        problems = self._problems
        if setup not in problems:
            while len(problems) >= _KEPT_PROBLEMS:
                del problems[next(iter(problems))]
            problems[setup] = CollisionProblem.from_scenario(self.scenario_of(setup))
        return problems[setup]

    # --- Shards -------------------------------------------------------------------------------------------------

    @property
    def shards(self) -> int:  # noqa: D102
        return self.numbering.shards

    def shard(self, number: int) -> pl.DataFrame:  # noqa: D102
        import polars as pl

        return pl.concat([self.distributions(setup, motions) for setup, motions in self.numbering.slices(number)])

    def distributions(self, setup: int, motions: range) -> pl.DataFrame:
        """Rows of some motions of a setup, numbered poses first, then directions, then speeds."""
        import polars as pl

        problem, verdict = self._problem(setup), self.scenario_of(setup).verdict
        rest, speed = np.divmod(np.arange(motions.start, motions.stop), len(self.speeds_mm_s))
        pose, direction = np.divmod(rest, len(self.direction_vectors))
        speeds = np.array(self.speeds_mm_s)[speed]
        velocity = self.direction_vectors[direction] * speeds[:, None] / 1e3
        limits = _force_limits(problem)
        found = evaluate_batch(
            problem,
            self.joint_positions(setup, pose),
            velocity,
            probabilities=list(QUANTILES.values()),
            limits_N=[*limits, 0.0],
        )
        over = np.full((len(pose), 2), np.nan)
        over[:, : len(limits)] = found.exceedance[:, :-1]
        worst = np.fmax(over[:, 0], over[:, 1])
        missing = pl.Series([None], dtype=pl.Float64).new_from_index(0, len(pose))
        fails = (worst > verdict.accepted_probability) | (found.false_alarm_probability > verdict.max_false_alarm)
        # As in a verdict: what is hit too rarely has not been put to the test.
        judged = np.isfinite(worst) & (fails | (1 - found.exceedance[:, -1] <= MAX_UNTOUCHED))
        columns: dict[str, Any] = {"setup": np.full(len(pose), setup, dtype=np.uint32)}
        columns |= {
            axis: pl.Series([choice.name], dtype=pl.String).new_from_index(0, len(pose))
            for axis, choice in zip(("robot", "tool", "body", "detector", "arm"), self.setups[setup], strict=True)
        }
        columns |= {"pose": pose, "direction": direction.astype(np.int32), "speed_mm_s": speeds}
        columns |= {"mean_N": found.mean, "sd_N": found.sd}
        columns |= {name: np.ascontiguousarray(found.quantile[:, i]) for i, name in enumerate(QUANTILES)}
        for i, name in enumerate(("p_over_force", "p_over_pressure")):
            columns[name] = over[:, i].copy() if i < len(limits) else missing
        columns["acceptable"] = pl.Series(judged & ~fails).set(pl.Series(~judged), None)
        columns |= {"false_alarm": found.false_alarm_probability, "undetected": found.undetected_probability}
        columns |= {"no_contact": found.no_contact_probability}
        columns["end"] = pl.Series(values=found.end.tolist(), dtype=pl.String)
        return pl.DataFrame([pl.Series(name, column) for name, column in columns.items()])

    # --- What all jobs have -------------------------------------------------------------------------------------

    def summarise(self, volumes: Iterable[pl.DataFrame]) -> dict[str, Any]:  # noqa: D102
        names, nearest = [[choice.name for choice in choices] for choices in self.setups], NearestRows()
        found: dict[str, Any] = {"study": self.name, "poses": self.poses, "shards": self.shards}
        found |= summarise(nearest.passing(volumes), names, self.speeds_mm_s)
        looked_at = [self._warned(row) for _, row in sorted(nearest.of_setup.items())[:_WARNED_SETUPS]]
        found["fails_with_finer_steps"] = any(fails_with_finer_steps(each.warnings) for each in looked_at)
        notes, doubts = self._doubts(), {note for each in self._given for note in each.warnings}
        notes += told_once(looked_at, doubts)
        if len(nearest.of_setup) > _WARNED_SETUPS:
            notes.append(
                f"Warnings beside verdicts were looked for in the first {_WARNED_SETUPS} of {len(nearest.of_setup)} "
                "setups with acceptable poses."
            )
        return found | ({"notes": notes} if notes else {})

    @cached_property
    def _given(self) -> list[AnswerWarnings]:
        """Of each setup what is assumed and doubted: a choice may set what the robot's scenario only assumes."""
        return [AnswerWarnings(self._name(n), doubts_as_given(self.scenario_of(n))) for n in range(len(self.setups))]

    def _doubts(self) -> list[str]:
        """What is assumed and doubted of all setups of a robot, then of some."""
        notes, each = [], len(self.setups) // len(self.robots)
        for i, robot in enumerate(self.robots):
            given = self._given[i * each : (i + 1) * each]
            common = [note for note in given[0].warnings if all(note in told.warnings for told in given)]
            notes += [f"{robot.name}: {note}" for note in common] + told_once(given, common)
        return notes

    def _warned(self, row: Mapping[str, Any]) -> AnswerWarnings:
        """What ``bumpstop evaluate`` says beside the verdict of a row."""
        setup, direction = row["setup"], row["direction"]
        q = self.joint_positions(setup, [row["pose"]])[0]
        velocity = self.direction_vectors[direction] * row["speed_mm_s"] / 1e3
        found = warnings_of(lambda: through_pose(self.scenario_of(setup), q, velocity))
        answer = f"{self._name(setup)}, pose {row['pose']}, direction {direction} at {row['speed_mm_s']:g} mm/s"
        return AnswerWarnings(answer, found)

    def lines(self, summary: Mapping[str, Any]) -> list[str]:  # noqa: D102
        return summary_lines(summary)

    def settings(self) -> dict[str, Any]:  # noqa: D102
        return {}

    def document(self) -> tuple[str, dict[str, Any]]:
        """A campaign file with the robots' scenarios in full, their paths absolute, and where those of keys start."""
        tables: dict[str, Any] = {
            field.name: to_jsonable(getattr(self, field.name)) for field in fields(self) if field.name not in AXES
        }
        for axis in AXES:
            tables[axis] = [_choice_table(choice) for choice in getattr(self, axis)]
        return "A campaign", tables

    @cached_property
    def _files(self) -> list[Path]:
        """Files that the setups name, resolved, as in the settings file, from which merge and resume read it."""
        setups = range(len(self.setups))
        return sorted({path.resolve() for setup in setups for path in files_of(self.scenario_of(setup)).values()})

    def fingerprint(self) -> str:  # noqa: D102
        files = {str(path): hashlib.sha256(path.read_bytes()).hexdigest() for path in self._files}
        tables = self.document()[1]
        for robot in tables["robots"]:
            robot.pop("folder", None)  # what counts of it are the files
        return digest([self.name, tables, files, code_digest(), *versions().values()])

    def __getstate__(self) -> dict[str, Any]:
        """Its fields alone: what is kept besides cannot be sent, and is made again.

        Folders are absolute: a worker may run in another one.
        """
        state = {field.name: getattr(self, field.name) for field in fields(self)}
        return state | {"robots": tuple(map(_with_absolute_folder, self.robots))}


def _with_absolute_folder(robot: Choice) -> Choice:
    if robot.scenario is None:
        return robot
    folder = {"folder": robot.scenario.folder.absolute()}
    return replace(robot, scenario=robot.scenario.model_copy(update=folder))


def _choice_table(choice: Choice) -> dict[str, Any]:
    table: dict[str, Any] = {"name": choice.name, "keys": dict(choice.keys)}
    if choice.scenario is None:
        return table
    # The keys of all axes may name files, relative to the scenario of each robot.
    return table | {"folder": str(choice.scenario.folder.resolve()), "scenario": scenario_data(choice.scenario)}


def _force_limits(problem: CollisionProblem) -> list[float]:
    """Peak forces of the body's force and pressure limit [N]; none without a body, one without a pressure limit."""
    limits, contact = problem.limits, problem.scenario.contact
    if limits is None:
        return []
    if limits.pressure_N_cm2 is None:
        return [limits.force_N]
    force = limits.force_at_pressure_limit_N(contact.area_cm2, contact.peak_factor)
    return [limits.force_N, force if math.isfinite(force) else math.inf]
