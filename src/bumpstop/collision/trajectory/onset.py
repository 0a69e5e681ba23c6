"""When contact begins in a joint trajectory: at a given time, or at any time of it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.trajectory.trajectory import Trajectory, point_motion, point_places
from bumpstop.errors import InputError

# A point slower than this toward the body stands still, as far as the direction of its motion can be told [m/s].
_STANDSTILL = 1e-6
# Nodes of the quadrature over the time of contact in a panel, and how many standard deviations of the noise a residual
# may grow by in one. There are no more nodes in all than this.
_ORDER = 4
_GROWTH = 3.0
_MAX_NODES = 60_000
# In half a panel the contact normal turns by no more than this, unless the panel is this narrow, in feedback periods.
_MIN_COSINE = math.cos(0.1)
_MIN_WIDTH = 1e-3
_FEW_PANELS = 1000  # whatever the length of a motion, so many may be added for that


@dataclass(frozen=True, eq=False)
class OnsetQuadrature:
    """Times at which contact may begin: the nodes of a quadrature over the motion, or one that is given.

    Attributes:
        begin: (nodes,) [s].
        weight: (nodes,) of the distribution of each; they sum to one.
        normal: (nodes, 3) unit vectors, base frame.
        low, high: (nodes,) the times each node stands for [s]; equal where the time is given.
        order: nodes in a panel; panels follow one another.
        still: share of the time in which no contact begins, as the point does not move toward the body.
    """

    begin: FloatArray
    weight: FloatArray
    normal: FloatArray
    low: FloatArray
    high: FloatArray
    order: int
    still: float


def onset_quadrature(problem: CollisionProblem, refinement: int = 1) -> OnsetQuadrature:
    """Where to look: Gauss-Legendre nodes in panels that end at every feedback tick, or the time that is given.

    Raises:
        InputError: the contact point does not move toward the body then, or at no time.
    """
    trajectory = trajectory_of(problem)
    given = problem.scenario.motion.contact_onset_s
    if given != "uniform":
        begin = np.array([float(given)])
        normal, speed = approach(problem, begin)
        if not speed[0] > _STANDSTILL:
            raise InputError(
                "motion.contact_onset_s",
                f"at {begin[0]:g} s the contact point does not move toward the body ({speed[0] * 1e3:.3g} mm/s)",
                "give a time at which it does, or another contact.normal",
            )
        return OnsetQuadrature(begin, np.ones(1), normal, begin, begin, 1, 0.0)
    order = _ORDER * refinement
    edges = _panels(problem, trajectory, order)
    node, weight = np.polynomial.legendre.leggauss(order)
    middle, half = (edges[1:] + edges[:-1]) / 2, np.diff(edges) / 2
    begin = (middle[:, None] + half[:, None] * node).ravel()
    # Each node stands for a part of its panel as wide as its weight.
    cell = np.concatenate([[-1.0], -1.0 + np.cumsum(weight)])
    low, high = ((middle[:, None] + half[:, None] * ends).ravel() for ends in (cell[:-1], cell[1:]))
    normal, speed = approach(problem, begin)
    moves = speed > _STANDSTILL
    share = np.where(moves, high - low, 0.0)
    if not share.any():
        where = "contact.normal" if problem.scenario.contact.normal is not None else "contact.link"
        raise InputError(
            where,
            "the contact point never moves toward the body",
            "give a point that moves, and a normal it moves along",
        )
    still = 1 - float(share.sum() / (high - low).sum())
    return OnsetQuadrature(begin, share / share.sum(), normal, low, high, order, max(0.0, still))


def trajectory_of(problem: CollisionProblem) -> Trajectory:
    """The trajectory of a problem whose motion is one."""
    assert problem.trajectory is not None
    return problem.trajectory


def approach(problem: CollisionProblem, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Contact normals (N, 3), base frame, at times (N,) [s] and the speed toward the body then (N,) [m/s]."""
    velocity, _ = point_motion(trajectory_of(problem), problem.robot, problem.contact_point, t)
    given = problem.scenario.contact.normal
    if given is not None:
        normal = np.tile(np.array(given) / np.linalg.norm(given), (len(t), 1))
        return normal, velocity @ normal[0]
    speed = np.linalg.norm(velocity, axis=1)
    return np.ascontiguousarray(velocity / np.maximum(speed, 1e-300)[:, None]), speed


def _panels(problem: CollisionProblem, trajectory: Trajectory, order: int) -> FloatArray:
    """Edges of the panels [s]: every tick, where the point turns, and more where the residual grows fast."""
    step, end = problem.scenario.simulation.step_s, trajectory.duration
    ticks = np.arange(1, math.ceil(end / step) + 1, problem.period_steps) * step
    turns = _turns(problem, trajectory, step)
    # A recorded arm that trembles in place turns at every row: there nothing is gained by a panel for each.
    turns = turns if turns.size <= ticks.size else np.zeros(0)
    edges = np.unique(np.concatenate([[0.0], ticks, turns]))
    edges = np.append(edges[edges < end - 1e-9 * step], end)
    edges = _bent(problem, edges[np.append(True, np.diff(edges) > 1e-9 * step)])
    middle, width = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
    normal, speed = approach(problem, middle)
    _, jacobian = point_motion(trajectory, problem.robot, problem.contact_point, middle)
    monitored = np.isfinite(problem.thresholds)
    with np.errstate(divide="ignore", invalid="ignore"):
        growth = np.abs(np.einsum("nij,ni->nj", jacobian, normal))[:, monitored] / problem.noise_sd[monitored]
    # A joint that contact does not load needs no panel, even without noise.
    growth = np.nan_to_num(growth, nan=0.0, posinf=1e6).max(axis=1, initial=0.0) * problem.stiffness
    wanted = np.maximum(np.ceil(growth * np.maximum(speed, 0.0) * width / _GROWTH), 1.0)
    # Where there would be too many nodes, the panels with the most parts get fewer.
    most = _MAX_NODES
    while most > 1 and order * np.minimum(wanted, most).sum() > _MAX_NODES:
        most = most * 9 // 10
    parts = np.minimum(wanted, most).astype(int)
    starts = np.repeat(edges[:-1], parts)
    place = np.arange(len(starts)) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(starts + np.repeat(width / parts, parts) * place, end)


def _bent(problem: CollisionProblem, edges: FloatArray) -> FloatArray:
    """Halves panels until the normal turns little in each: where the point is slow it may turn round in no time."""
    narrowest = _MIN_WIDTH * problem.period_steps * problem.scenario.simulation.step_s
    ends, most = _way(problem, edges), 2 * edges.size + _FEW_PANELS
    while True:
        between = (edges[1:] + edges[:-1]) / 2
        way = _way(problem, between)
        # A point that stands still has no direction: products with its NaN are below no cosine.
        turn = np.fmin(np.einsum("ni,ni->n", ends[:-1], way), np.einsum("ni,ni->n", way, ends[1:]))
        cut = np.flatnonzero((turn < _MIN_COSINE) & (np.diff(edges) > narrowest))
        if not cut.size or edges.size + cut.size > most:
            return edges
        edges, ends = np.insert(edges, cut + 1, between[cut]), np.insert(ends, cut + 1, way[cut], axis=0)


def _way(problem: CollisionProblem, t: FloatArray) -> FloatArray:
    """Contact normals at times [s], NaN where the point does not move toward the body (N, 3)."""
    normal, speed = approach(problem, t)
    return np.where(speed[:, None] > _STANDSTILL, normal, np.nan)


def _turns(problem: CollisionProblem, trajectory: Trajectory, step: float) -> FloatArray:
    """Times at which the contact point begins or ceases to move toward the body [s].

    So are those from which on it ceases too soon to touch anything at the end of a step. A panel across one would count
    the time of some node as a whole for one or the other.
    """
    t = np.unique(np.concatenate([np.arange(0.0, trajectory.duration, step), trajectory.time]))

    def moves(at: FloatArray) -> npt.NDArray[np.bool_]:
        found: npt.NDArray[np.bool_] = approach(problem, at)[1] > _STANDSTILL
        return found

    known = moves(t)
    before = np.flatnonzero(known[1:] != known[:-1])
    if not before.size:
        return np.zeros(0)
    turn = _bisected(lambda at: moves(at) == known[before], t[before], t[before + 1])
    last = turn[known[before]]
    if problem.scenario.contact.normal is None or not last.size:
        return turn
    normal, _ = approach(problem, last)
    begin = np.floor(last / step) * step

    def way_left(at: FloatArray) -> FloatArray:
        there = np.minimum(begin + step, trajectory.duration)
        ahead = point_places(trajectory, problem.robot, problem.contact_point, np.concatenate([there, at]))
        left: FloatArray = np.einsum("ni,ni->n", ahead[: there.size] - ahead[there.size :], normal)
        return left

    return np.concatenate([turn, _bisected(lambda at: way_left(at) > 0, begin, last)])


def _bisected(still: Callable[[FloatArray], npt.NDArray[np.bool_]], low: FloatArray, high: FloatArray) -> FloatArray:
    """Where something ceases that is so at ``low`` and no more at ``high``; ``low`` where it was not so at all."""
    for _ in range(40):
        middle = (low + high) / 2
        so = still(middle)
        low, high = np.where(so, middle, low), np.where(so, high, middle)
    return low


def sample_onsets(times: OnsetQuadrature, seed: int, samples: int) -> FloatArray:
    """Times of contact of runs (samples,) [s]: even over the time in which contact may begin."""
    even = _native.Contact().offset
    even.kind, even.size = _native.OffsetKind.uniform, 1.0
    share = _native.sample_offsets(even, seed, 0, samples)
    moving = times.weight > 0
    low, high = times.low[moving], times.high[moving]
    reached = np.concatenate([[0.0], np.cumsum(times.weight[moving])])
    cell = np.clip(np.searchsorted(reached, share, side="right") - 1, 0, low.size - 1)
    inside = (share - reached[cell]) / times.weight[moving][cell]
    return np.asarray(low[cell] + (high - low)[cell] * np.clip(inside, 0.0, 1.0))
