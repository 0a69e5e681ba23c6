"""The worst of all directions of a cone: the one in which the arm must be slowest."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.study.directions import cone_directions, tilted
from bumpstop.study.pose_batch import PoseBatch
from bumpstop.study.prediction import predicted_speed_limit, stopping_time_per_speed, undetected_force
from bumpstop.study.requirement.risk import allowed_force
from bumpstop.study.speed.speed_limit import SpeedLimits, speed_limits
from bumpstop.study.speed.speed_risk import SpeedRisks, speed_risks
from bumpstop.study.speed.speed_search import CLOSE

if TYPE_CHECKING:
    from bumpstop.collision import CollisionProblem

Rows = npt.NDArray[np.int64]

# Directions the formula is asked about, all over the sphere; a narrower cone takes its share of them, but no fewer than
# the latter. It takes next to nothing, and finds the narrow cones in which contact loads no joint much.
_FORMULA, _MIN_DIRECTIONS = 3000, 200
# Directions whose distributions are computed beside those the formula picks.
_SAMPLED = 48
# So many of the worst are looked around in, none nearer to another than this [rad].
_STARTS, _APART = 6, math.radians(12)
# Places of less than this share of the greatest force are not gone on from.
_CLOSE_SECOND = 0.85
# Steps of the search about them, by the formula and by distributions: first, last [rad], and how they shrink.
_FORMULA_STEP, _LAW_STEP, _LAST, _SHRINK = 0.03, 0.02, 5e-4, 0.4
_AROUND = 4
_AT_ONCE = 40  # poses


def searched(angle: float) -> str:
    """Which directions of a cone of half angle ``angle`` [rad] a search looks at, in a sentence's words."""
    if angle <= 0:
        return "the motion's own"
    where = "all directions" if angle >= math.pi else f"a cone of {math.degrees(angle):.4g} deg about the motion's own"
    return (
        f"the worst found in {where}: {_formula_count(angle)} by a formula, {_SAMPLED + 1} and the formula's worst "
        f"{_STARTS} by integrated distributions, and from the worst of these on to where the force is greatest"
    )


def _formula_count(angle: float) -> int:
    return max(_MIN_DIRECTIONS, round(_FORMULA * (1 - math.cos(angle)) / 2))


@dataclass(frozen=True, eq=False)
class WorstDirections:
    """What a search found.

    Attributes:
        direction: unit vectors, base frame (N, 3).
        found: the highest speeds safe there, and so in every direction looked at; 0 where hardly anything is hit in
            any of them.
    """

    direction: FloatArray
    found: SpeedLimits


def worst_directions(
    problem: CollisionProblem, q: FloatArray, own: FloatArray, angle: float, max_speed: FloatArray
) -> WorstDirections:
    """Search the cones of directions about ``own`` for the worst one, and the highest safe speeds there.

    A formula ranks directions all over the cone and goes to the worst places between them. Integrated distributions at
    the safe speed of the worst decide, in a spiral of directions and in those places; then they go on from the worst of
    these to where the force is greatest. Where a distribution exceeds the accepted risk the safe speed is solved for
    anew there, until none does.

    Args:
        problem: a straight line of the tip; its pose and velocity are replaced.
        q: poses (N, dof) [rad or m].
        own: axes of the cones, unit vectors (N, 3).
        angle: half angle of the cones [rad].
        max_speed: no speed above it is looked at (N,) [m/s].
    """
    if angle <= 0:
        found = speed_limits(problem, q, own, max_speed)
        return WorstDirections(own, found.put_to_the_test(found.untouched))
    places = [
        _formula_worst(problem, q[rows], own[rows], angle)
        for rows in np.array_split(np.arange(len(q)), math.ceil(len(q) / _AT_ONCE))
    ]
    predicted = np.concatenate(places)  # (N, starts, 3), the worst first
    direction = predicted[:, 0].copy()
    found = speed_limits(problem, q, direction, max_speed)
    candidates = np.concatenate([np.stack(cone_directions(own, angle, _SAMPLED), axis=1), predicted], axis=1)
    search = _Search(problem, q, direction, found)
    force = search.settle(candidates)
    search.settle_between(own, angle, candidates, force)
    return WorstDirections(search.direction, search.found.put_to_the_test(~search.tested))


class _Search:
    """Speeds that come down wherever a distribution passes what is accepted.

    Attributes:
        tested: (N,) in some direction most cases hit something, or no speed is safe anyway.
    """

    def __init__(self, problem: CollisionProblem, q: FloatArray, direction: FloatArray, found: SpeedLimits) -> None:
        self.problem, self.q, self.direction, self.found = problem, q, direction, found
        self.tested = found.speed == 0
        self._accepted = problem.scenario.verdict.accepted_probability

    def settle(self, candidates: FloatArray) -> FloatArray:
        """Lower speeds until no candidate (N, M, 3) passes; the force of each (N, M) [N] at the accepted risk."""
        count = candidates.shape[1]
        force = np.full(candidates.shape[:2], -np.inf)
        open_ = np.flatnonzero(self.found.speed > 0)
        while open_.size:
            over, forces, untouched = self._laws(np.repeat(open_, count), candidates[open_].reshape(-1, 3))
            over, force[open_] = over.reshape(-1, count), forces.reshape(-1, count)
            self._face_what_is_hit(open_, candidates[open_], force[open_], ~untouched.reshape(-1, count))
            fails = over.max(axis=1) > self._accepted
            # Of those that pass by undetected collisions all have an infinite force: the risk tells them apart.
            worst = over.argmax(axis=1)[fails]
            open_ = open_[fails]
            if open_.size:
                self._lower(open_, candidates[open_, worst])
                open_ = open_[self.found.speed[open_] > 0]
        return force

    def _face_what_is_hit(
        self, rows: Rows, candidates: FloatArray, force: FloatArray, hit: npt.NDArray[np.bool_]
    ) -> None:
        """Replace directions in which nothing is hit by the worst candidate that hits something, if there is one."""
        self.tested[rows] = hit.any(axis=1)
        worst = np.where(hit, force, -np.inf).argmax(axis=1)
        other = hit.any(axis=1) & self.found.untouched[rows]
        self.direction[rows[other]] = candidates[np.flatnonzero(other), worst[other]]
        self.found.untouched[rows[other]] = False

    def settle_between(self, own: FloatArray, angle: float, candidates: FloatArray, force: FloatArray) -> None:
        """Go from the worst candidates to where the force is greatest about them, and lower speeds there."""
        alive = np.flatnonzero(self.found.speed > 0)
        if not alive.size:
            return
        places, lowest = _apart(candidates[alive], -force[alive])
        pose, start = np.nonzero(-lowest >= _CLOSE_SECOND * -lowest[:, :1])
        row, at, best = alive[pose], places[pose, start], -lowest[pose, start]
        step, turn = _LAW_STEP, 0.0
        while step > _LAST:
            going = np.flatnonzero(self.found.speed[row] > 0)
            if not going.size:
                return
            around = tilted(at[going], own[row[going]], angle, step, _AROUND, turn)
            over, forces, _ = self._laws(np.repeat(row[going], _AROUND), around.reshape(-1, 3))
            over, forces = over.reshape(-1, _AROUND), forces.reshape(-1, _AROUND)
            better = forces.max(axis=1) > best[going]
            at[going[better]] = around[better, forces[better].argmax(axis=1)]
            best[going[better]] = forces[better].max(axis=1)
            worst = over.max(axis=1)
            if (worst > self._accepted).any():
                lowered = self._lower_worst(row[going], worst, around[np.arange(len(around)), over.argmax(axis=1)])
                # Other speeds, other forces: those known are no measure any more.
                anew = np.flatnonzero(np.isin(row, lowered))
                best[anew] = self._laws(row[anew], at[anew]).force
            elif not better.any():
                step *= _SHRINK
            turn += math.pi / _AROUND

    def _lower_worst(self, row: Rows, over: FloatArray, direction: FloatArray) -> Rows:
        """Lower the speeds of rows that fail, each in its worst direction; returns these rows."""
        order = np.argsort(-over, kind="stable")
        order = order[over[order] > self._accepted]
        rows, first = np.unique(row[order], return_index=True)
        self._lower(rows, direction[order][first])
        return rows

    def _lower(self, rows: Rows, direction: FloatArray) -> None:
        """Solve for the safe speeds of rows in other directions, below those they have."""
        found = self.found
        self.direction[rows] = direction
        # A little slower in any case, so that rounding at the very limit cannot go on for ever.
        slower = speed_limits(self.problem, self.q[rows], direction, (1 - 0.1 * CLOSE) * found.speed[rows])
        found.speed[rows], found.risk[rows] = slower.speed, slower.risk
        found.untouched[rows] = slower.untouched
        found.limited_by[rows] = np.where(slower.speed > 0, "risk", "nothing_safe")
        self.found = replace(found, evaluations=found.evaluations + slower.evaluations)

    def _laws(self, rows: Rows, direction: FloatArray) -> SpeedRisks:
        """Risk, and force at the accepted risk [N], of directions (M, 3) of rows (M,) at their speeds."""
        speed = np.maximum(self.found.speed[rows], 1e-6)
        over, force, untouched = speed_risks(self.problem, self.q[rows], direction * speed[:, None])
        self.found = replace(self.found, evaluations=self.found.evaluations + len(rows))
        # Without a distribution, as at a singularity, no speed is safe either.
        return SpeedRisks(np.nan_to_num(over, nan=np.inf), np.nan_to_num(force, nan=np.inf, posinf=np.inf), untouched)


def _formula_worst(problem: CollisionProblem, q: FloatArray, own: FloatArray, angle: float) -> FloatArray:
    """Directions whose safe speed is the lowest by the formula (N, starts, 3), the lowest first, some way apart."""
    formula = _Formula(problem, q)
    directions = np.stack(cone_directions(own, angle, _formula_count(angle)), axis=1)
    at, best = _apart(directions, formula(directions))
    step, turn = _FORMULA_STEP, 0.0
    flat_own = np.repeat(own, at.shape[1], axis=0)
    while step > _LAST:
        around = tilted(at.reshape(-1, 3), flat_own, angle, step, _AROUND, turn).reshape(*at.shape[:2], _AROUND, 3)
        speed = formula(around.reshape(len(q), -1, 3)).reshape(*at.shape[:2], _AROUND)
        better = speed.min(axis=2) < best
        turn += math.pi / _AROUND
        if not better.any():
            step *= _SHRINK
            continue
        pose, start = np.nonzero(better)
        at[pose, start] = around[pose, start, speed[pose, start].argmin(axis=1)]
        best[pose, start] = speed[pose, start].min(axis=1)
    order = np.argsort(best, axis=1, kind="stable")
    return np.asarray(np.take_along_axis(at, order[:, :, None], axis=1))


class _Formula:
    """Predicted safe speeds of many directions of poses: rates and torques are linear in the direction."""

    def __init__(self, problem: CollisionProblem, q: FloatArray) -> None:
        self._problem = problem
        along = [np.tile(axis, (len(q), 1)) for axis in np.eye(3)]
        with np.errstate(invalid="ignore", over="ignore"):
            rates = [PoseBatch(problem, q, axis).joint_rates(q) for axis in along]
        self._rates = np.stack(rates, axis=1)  # (N, 3, dof)
        self._jacobian = PoseBatch(problem, q, along[0]).linear_jacobian(q)

    def __call__(self, directions: FloatArray) -> FloatArray:
        """Speeds (N, M) [m/s] in directions (N, M, 3)."""
        problem, shape = self._problem, directions.shape[:2]
        with np.errstate(invalid="ignore", over="ignore"):
            gain = stopping_time_per_speed(problem, (directions @ self._rates).reshape(-1, self._rates.shape[2]))
        torque = (directions @ self._jacobian).reshape(len(gain), -1)
        undetected = undetected_force(problem, torque, problem.scenario.verdict.accepted_probability)
        speed = predicted_speed_limit(problem, undetected, gain, allowed_force(problem))
        # Where the formula misses the limit itself the directions are told apart by how little they load the joints.
        undetectable = -1e-9 / np.maximum(_residual_per_newton(problem, torque), 1e-12)
        return np.asarray(np.nan_to_num(np.where(speed > 0, speed, undetectable), nan=-1.0).reshape(shape))


def _residual_per_newton(problem: CollisionProblem, torque: FloatArray) -> FloatArray:
    """Largest share of its threshold that a newton gives any joint (N,) [1/N]."""
    return np.asarray((np.abs(torque) / problem.thresholds).max(axis=1))


def _apart(directions: FloatArray, value: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The directions (N, starts, 3) of the lowest values (N, M), some way apart, and their values (N, starts)."""
    rows, value = np.arange(len(directions)), value.copy()
    chosen, values = [], []
    for _ in range(min(_STARTS, directions.shape[1])):
        lowest = value.argmin(axis=1)
        own = directions[rows, lowest]
        chosen.append(own)
        values.append(value[rows, lowest])
        near = np.einsum("nmi,ni->nm", directions, own) > math.cos(_APART)
        value[near] = np.inf
    return np.stack(chosen, axis=1), np.stack(values, axis=1)
