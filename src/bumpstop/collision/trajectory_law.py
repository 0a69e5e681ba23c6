"""The law of a collision that begins at any time of a joint trajectory: a mixture over the time of contact."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from bumpstop.arrays import FloatArray
from bumpstop.collision.distribution import NEGLIGIBLE, Distribution, SampledDistribution, check_probability
from bumpstop.collision.law import ForceLaw, StoppingCurve
from bumpstop.collision.problem import Problem
from bumpstop.collision.trajectory import Trajectory, point_motion
from bumpstop.errors import InputError
from bumpstop.kernels import core

# A point slower than this toward the body stands still, as far as the direction of its motion can be told [m/s].
_STANDSTILL = 1e-6
# Nodes of the quadrature over the time of contact in a panel, and how many standard deviations of the noise a residual
# may grow by in one. There are no more nodes in all than this.
_ORDER = 4
_GROWTH = 3.0
_MOST_NODES = 60_000


@dataclass(frozen=True, eq=False)
class ContactTimes:
    """Times at which contact may begin: the nodes of a quadrature over the motion, or one that is given.

    Attributes:
        begin: (nodes,) [s].
        weight: (nodes,) of the law of each; they sum to one.
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


def contact_times(problem: Problem, refinement: int = 1) -> ContactTimes:
    """Where to look: Gauss-Legendre nodes in panels that end at every feedback tick, or the time that is given.

    Raises:
        InputError: the contact point does not move toward the body then, or at no time.
    """
    trajectory = _trajectory(problem)
    given = problem.scenario.motion.contact_time
    if given != "uniform":
        begin = np.array([float(given)])
        normal, speed = approach(problem, begin)
        if not speed[0] > _STANDSTILL:
            raise InputError(
                "motion.contact_time",
                f"at {begin[0]:g} s the contact point does not move toward the body ({speed[0] * 1e3:.3g} mm/s)",
                "give a time at which it does, or another contact.normal",
            )
        return ContactTimes(begin, np.ones(1), normal, begin, begin, 1, 0.0)
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
    return ContactTimes(begin, share / share.sum(), normal, low, high, order, max(0.0, still))


def _trajectory(problem: Problem) -> Trajectory:
    assert problem.trajectory is not None
    return problem.trajectory


def approach(problem: Problem, t: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Contact normals (N, 3), base frame, at times (N,) [s] and the speed toward the body then (N,) [m/s]."""
    velocity, _ = point_motion(_trajectory(problem), problem.robot, problem.contact_point, t)
    given = problem.scenario.contact.normal
    if given is not None:
        normal = np.tile(np.array(given) / np.linalg.norm(given), (len(t), 1))
        return normal, velocity @ normal[0]
    speed = np.linalg.norm(velocity, axis=1)
    return np.ascontiguousarray(velocity / np.maximum(speed, 1e-300)[:, None]), speed


def _panels(problem: Problem, trajectory: Trajectory, order: int) -> FloatArray:
    """Edges of the panels [s]: every tick, and more where the residual grows fast."""
    step, end = problem.scenario.simulation.step_s, trajectory.duration
    ticks = np.arange(1, math.ceil(end / step) + 1, problem.period_steps) * step
    edges = np.concatenate([[0.0], ticks[ticks < end - 1e-9 * step], [end]])
    middle, width = (edges[1:] + edges[:-1]) / 2, np.diff(edges)
    normal, speed = approach(problem, middle)
    _, jacobian = point_motion(trajectory, problem.robot, problem.contact_point, middle)
    watched = np.isfinite(problem.thresholds)
    with np.errstate(divide="ignore", invalid="ignore"):
        growth = np.abs(np.einsum("nij,ni->nj", jacobian, normal))[:, watched] / problem.noise_sd[watched]
    # A joint that feels nothing of the contact has no need of any panel, even without noise.
    growth = np.nan_to_num(growth, nan=0.0, posinf=1e6).max(axis=1, initial=0.0) * problem.stiffness
    most = max(1, _MOST_NODES // (order * len(middle)))
    parts = np.clip(np.ceil(growth * np.maximum(speed, 0.0) * width / _GROWTH), 1, most).astype(int)
    starts = np.repeat(edges[:-1], parts)
    place = np.arange(len(starts)) - np.repeat(np.cumsum(parts) - parts, parts)
    return np.append(starts + np.repeat(width / parts, parts) * place, end)


@dataclass(frozen=True, eq=False)
class MixtureDistribution(Distribution):
    """Probability spread evenly over cells, and in single values; some may lie at infinity.

    Attributes:
        low, high, mass: ends of the cells and their probabilities (cells,).
        atom, atom_mass: single values and their probabilities (atoms,).
        node, node_mass: values and probabilities (nodes,) of a quadrature for the moments; all there is.
        undetected: probability of never detecting; it counts as beyond every value.
    """

    low: FloatArray
    high: FloatArray
    mass: FloatArray
    atom: FloatArray
    atom_mass: FloatArray
    node: FloatArray
    node_mass: FloatArray
    undetected: float = 0.0

    @cached_property
    def _total(self) -> float:
        return float(self.mass.sum() + self.atom_mass.sum()) + self.undetected

    @cached_property
    def _moments(self) -> tuple[float, float]:
        if not self._total > 0:
            return math.nan, math.nan
        weight = self.node_mass / self.node_mass.sum()
        mean = float(weight @ self.node)
        return mean, math.sqrt(max(0.0, float(weight @ (self.node - mean) ** 2)))

    @property
    def mean(self) -> float:  # noqa: D102
        return self._moments[0]

    @property
    def sd(self) -> float:  # noqa: D102
        return self._moments[1]

    @cached_property
    def _tail(self) -> tuple[FloatArray, FloatArray]:
        """P(value in a cell > x) at every end of a cell, x descending; straight between them.

        Summed from the greatest value down, so that a small tail is a sum of small terms.
        """
        slope = self.mass / np.where(self.mass > 0, self.high - self.low, 1.0)
        ends = np.concatenate([self.high, self.low])
        order = np.argsort(-ends, kind="stable")
        x = ends[order]
        density = np.maximum(np.cumsum(np.concatenate([slope, -slope])[order])[:-1], 0.0)
        return x, np.concatenate([[0.0], np.cumsum(density * -np.diff(x))]) if x.size else x

    @cached_property
    def _atoms(self) -> tuple[FloatArray, FloatArray]:
        """Single values, descending, and P(one of them >= it)."""
        order = np.argsort(-self.atom, kind="stable")
        return self.atom[order], np.cumsum(self.atom_mass[order])

    def _above(self, x: FloatArray, *, at: bool) -> FloatArray:
        """P(value > x), or P(value >= x), for x of any order (N,)."""
        ends, tail = self._tail
        result: FloatArray = np.full(x.shape, self.undetected)
        if ends.size:
            result += np.interp(-x, -ends, tail)
        atoms, reached = self._atoms
        count = np.searchsorted(-atoms, -x, side="right" if at else "left")
        result += np.concatenate([[0.0], reached])[count]
        return result

    def exceedance(self, x: float) -> float:  # noqa: D102
        if not self._total > 0:
            return math.nan
        return min(1.0, float(self._above(np.array([x]), at=False)[0]) / self._total)

    def quantile(self, p: float) -> float:  # noqa: D102
        check_probability(p)
        if not self._total > 0:
            return math.nan
        allowed = (1 - p) * self._total
        if self.undetected > allowed:
            return math.inf
        x, above, reached = self._levels
        # The last place, from above, at which no more than allowed lies beyond.
        i = int(np.searchsorted(above, allowed, side="right")) - 1
        if i < 0 or i + 1 == x.size or reached[i] > allowed:
            return float(x[max(i, 0)])
        rise = above[i + 1] - reached[i]
        share = (allowed - reached[i]) / rise if rise > 0 else 1.0
        return float(x[i] + share * (x[i + 1] - x[i]))

    @cached_property
    def _levels(self) -> tuple[FloatArray, FloatArray, FloatArray]:
        """All places where the tail bends or jumps, descending, with P(> x) and P(>= x)."""
        x = np.unique(np.concatenate([self._tail[0], self.atom]))[::-1]
        return x, self._above(x, at=False), self._above(x, at=True)

    def scaled(self, factor: float) -> MixtureDistribution:  # noqa: D102
        return replace(
            self,
            low=self.low * factor,
            high=self.high * factor,
            atom=self.atom * factor,
            node=self.node * factor,
        )


class _Mixer:
    """Turns values at nodes of the time of contact into distributions.

    What is detected at one tick changes smoothly with the time of contact inside a panel. There each node's probability
    is spread evenly between the values at the ends of what the node stands for.
    """

    def __init__(self, times: ContactTimes, contact: npt.NDArray[np.int64], tick: npt.NDArray[np.int64]) -> None:
        self._order = times.order
        key = (contact // times.order) * (int(tick.max(initial=0)) + 1) + tick
        _, self._group = np.unique(key, return_inverse=True)
        self._place = contact % times.order
        node, weight = np.polynomial.legendre.leggauss(times.order)
        edge = np.concatenate([[-1.0], -1.0 + np.cumsum(weight)])
        # From values at the nodes to those at the ends of what they stand for: the polynomial through the nodes.
        vandermonde = np.polynomial.legendre.legvander
        self._to_edges = vandermonde(edge, times.order - 1) @ np.linalg.inv(vandermonde(node, times.order - 1))

    def distribution(
        self,
        value: FloatArray,
        mass: FloatArray,
        *,
        zero: float = 0.0,
        end: tuple[FloatArray, FloatArray] | None = None,
    ) -> MixtureDistribution:
        """Of values (detections,) with probabilities; NaN: there is none.

        Args:
            value: at each detection.
            mass: of each.
            zero: further probability at zero.
            end: values and probabilities of the collisions never detected, as they enter the moments.
        """
        groups = int(self._group.max(initial=-1)) + 1
        values = np.full((groups, self._order), math.nan)
        masses = np.zeros((groups, self._order))
        values[self._group, self._place] = value
        masses[self._group, self._place] = mass
        masses[np.isnan(values)] = 0.0
        ends = values @ self._to_edges.T
        low, high = np.minimum(ends[:, 1:], ends[:, :-1]), np.maximum(ends[:, 1:], ends[:, :-1])
        low, high = np.maximum(low, 0.0), np.maximum(high, 0.0)
        scale = float(np.nanmax(values, initial=0.0))
        wide = (high - low > 1e-9 * scale) & (masses > 0) if self._order > 1 else np.zeros(masses.shape, dtype=bool)
        single = ~wide & (masses > 0)
        never, never_mass = end if end is not None else (np.zeros(0), np.zeros(0))
        known = masses > 0
        return MixtureDistribution(
            low=low[wide],
            high=high[wide],
            mass=masses[wide],
            atom=np.append(values[single], 0.0),
            atom_mass=np.append(masses[single], zero),
            node=np.concatenate([values[known], never, [0.0]]),
            node_mass=np.concatenate([masses[known], never_mass, [zero]]),
            undetected=float(never_mass.sum()),
        )


@dataclass(frozen=True, eq=False)
class TrajectoryLaw(ForceLaw):
    """The distribution of one collision over the time of contact and sensor noise.

    ``curve`` is the stopping curve of the contact that is hardest on average, or of the hardest run; ``kernel`` is the
    kernels' trajectory. Runs have ``contact_time`` [s].

    Attributes:
        times: when contact may begin.
        contact_begin: of ``curve`` [s].
        spans: contact time of a reversing arm [s], or None where it stops.
        greatest_undetected: the greatest force of a collision never detected [N].
    """

    times: ContactTimes = field(kw_only=True)
    contact_begin: float = field(kw_only=True)
    spans: Distribution | None = field(kw_only=True)
    greatest_undetected: float = field(kw_only=True)

    @cached_property
    def contact_time(self) -> Distribution | None:
        """From contact until the reversing arm has let go [s], given that; None where the arm stops in contact."""
        return self.spans

    def curve_at(self, begin: float) -> StoppingCurve:
        """The stopping curve of a contact that begins at a time of the trajectory [s]."""
        return trajectory_curve(self.problem, self.kernel, begin)

    def motion_notes(self) -> list[str]:
        """What was assumed of the motion, and when contact begins."""
        motion, trajectory = self.scenario.motion, _trajectory(self.problem)
        joined = "cubic Hermite splines" if trajectory.velocity is not None else "a cubic spline"
        notes = [
            f"The arm follows a joint trajectory of {len(trajectory.time)} rows and {trajectory.duration:.4g} s; "
            f"{joined} between the rows. Once it reacts it slows down along that path."
        ]
        if motion.contact_time == "uniform":
            notes.append("Contact begins at any time of the motion with the same probability.")
        else:
            notes.append(f"Contact begins {motion.contact_time:g} s after the start of the motion.")
        if self.times.still > NEGLIGIBLE:
            notes.append(
                f"In {self.times.still:.2%} of the time the contact point does not move toward a body: no contact "
                "begins then, and that time does not count."
            )
        return notes

    def end_notes(self) -> list[str]:
        """How the motion ends, and what braking cannot keep."""
        notes = []
        if self.kernel.excess > 1 + 1e-6:
            notes.append(
                f"The trajectory's own joint accelerations are up to {self.kernel.excess:.3g} times those of the "
                "reaction: there the arm brakes as far as it can with the least excess."
            )
        if _stops_short(_trajectory(self.problem)):
            notes.append(
                "The trajectory ends while the arm still moves. It is taken to stand still there at once, so contact "
                "near the end is harder than it says."
            )
        if self.no_contact_probability > NEGLIGIBLE:
            notes.append(
                f"In {self.no_contact_probability:.2g} of cases the point turns back within a simulation step, and "
                "nothing is touched."
            )
        if self.undetected_probability > NEGLIGIBLE:
            notes.append(
                f"In {self.undetected_probability:.2g} of cases the motion ends without a detection. They count as "
                f"over every limit, whatever their force; the greatest of it is {self.greatest_undetected:.4g} N."
            )
        return notes


def _stops_short(trajectory: Trajectory) -> bool:
    """The last row is no place of rest: a joint is faster there than a hundredth of its greatest speed."""
    rates = np.abs(trajectory.at(np.linspace(0, trajectory.duration, 500), 1))
    return bool((rates[-1] > 0.01 * rates.max()).any())


class _Reactions:
    """The reactions of one contact, in the manner of the kernels' stopping curve."""

    def __init__(self, kernel: Any, begin: float, normal: FloatArray) -> None:
        self._kernel, self._begin, self._normal = kernel, begin, normal

    def reaction_paths(self, ticks: list[int], return_to: list[float]) -> list[FloatArray]:
        """Distances [m] after every simulation step of the reactions to ticks, until contact is over."""
        return [self._kernel.reaction_distances(tick, self._begin, self._normal) for tick in ticks]


def trajectory_kernel(problem: Problem) -> Any:
    """The motion and the reactions to every tick of it, for the kernels."""
    trajectory, scenario = _trajectory(problem), problem.scenario
    link, point = problem.contact_point
    return core.Trajectory(
        chain=problem.robot.chain,
        time=np.ascontiguousarray(trajectory.time),
        coefficient=trajectory.coefficients,
        contact_link=link,
        contact_point=np.ascontiguousarray(point),
        step=scenario.simulation.step_s,
        substeps=scenario.simulation.substeps,
        acceleration=problem.joint_acceleration,
        period=problem.period_steps,
        latency=problem.latency_steps,
        reverse=scenario.reaction.kind == "reverse",
    )


def trajectory_curve(problem: Problem, kernel: Any, begin: float) -> StoppingCurve:
    """The stopping curve of a contact that begins at a time of the trajectory [s].

    Distances are those from the place of contact and never above zero before it.
    """
    normal, speed = approach(problem, np.array([begin]))
    traced = kernel.curve(begin, normal[0])
    step = problem.scenario.simulation.step_s
    index = np.arange(kernel.ticks) * problem.period_steps + 1
    distance = traced["distance"]
    return StoppingCurve(
        kernel=_Reactions(kernel, begin, normal[0]),
        tick_time=index * step,
        tick_distance=distance[index],
        farthest=traced["farthest"],
        torque_per_newton=traced["torque_per_newton"],
        # A reaction may begin a latency after the end, where the arm stands.
        distance=np.append(distance, np.full(problem.latency_steps, distance[-1])),
        start=traced["start"],
        normal=normal[0],
        approach_speed=float(speed[0]),
        end="trajectory",
        end_joint=None,
    )


def exact_trajectory_law(problem: Problem, *, refinement: int = 1) -> TrajectoryLaw:
    """Integrate over the time of contact and sensor noise."""
    kernel, times = trajectory_kernel(problem), contact_times(problem, refinement)
    used = np.flatnonzero(times.weight > 0)
    begin, weight, K = times.begin[used], times.weight[used], problem.stiffness
    normal = np.ascontiguousarray(times.normal[used])
    out = kernel.laws(problem.detector, K, begin, normal)
    contact, tick, probability = out["contact"], out["tick"], out["probability"]
    mass, peak = weight[contact] * probability, K * out["farthest"]
    after = out["distance"] >= 0
    never = weight * out["undetected"]
    mixer = _Mixer(times, used[contact], tick)
    late = (tick * problem.period_steps + 1) * problem.scenario.simulation.step_s - begin[contact]
    false_alarm = float(weight @ out["false_alarm"])
    detected = float(mass[after].sum()) + false_alarm
    spans = None
    if problem.scenario.reaction.kind == "reverse":
        spans = mixer.distribution(kernel.contact_spans(tick.tolist(), begin[contact]), mass)
    expected = np.bincount(contact, probability * peak, len(begin)) + out["undetected"] * K * out["greatest"]
    hardest = float(begin[int(np.argmax(expected))])
    with np.errstate(invalid="ignore"):
        triggers = weight @ out["trigger"] / (detected if detected > 0 else math.nan)
    return TrajectoryLaw(
        problem=problem,
        curve=trajectory_curve(problem, kernel, hardest),
        kind="exact",
        peak_force=mixer.distribution(
            peak, mass, zero=float(weight @ out["harmless"]), end=(K * out["greatest"][never > 0], never[never > 0])
        ),
        force_at_detection=mixer.distribution(np.where(after, K * out["distance"], math.nan), mass),
        detection_delay=mixer.distribution(np.where(after, late, math.nan), mass),
        trigger_joint_probability=triggers,
        several_joints_probability=float(weight @ out["several"]) / detected if detected > 0 else math.nan,
        false_alarm_probability=false_alarm,
        undetected_probability=min(1.0, float(never.sum())),
        no_contact_probability=max(0.0, float(weight @ out["no_contact"])),
        kernel=kernel,
        times=times,
        contact_begin=hardest,
        spans=spans,
        greatest_undetected=K * float(out["greatest"].max(where=never > 0, initial=0.0)),
    )


def sampled_trajectory_law(problem: Problem, *, samples: int, seed: int = 0, threads: int = 1) -> TrajectoryLaw:
    """Draw single collisions: a time of contact, then noise until a joint alarms."""
    kernel, times = trajectory_kernel(problem), contact_times(problem)
    begin = _draw(times, seed, samples)
    normal, _ = approach(problem, begin)
    runs = kernel.sample(problem.detector, problem.stiffness, begin, normal, seed, threads)
    K, tick = problem.stiffness, runs["tick"]
    detected = tick >= 0
    undetected = ~detected & (runs["greatest"] > 0)
    peak = K * np.where(detected, runs["farthest"], runs["greatest"])
    tick_time = (tick * problem.period_steps + 1) * problem.scenario.simulation.step_s
    force = K * np.maximum(0.0, runs["distance"])
    felt = detected & (force > 0)
    fired = (runs["triggers"][:, None] >> np.arange(problem.robot.dof, dtype=np.uint32)) & 1
    some = bool(detected.any())
    spans = None
    if problem.scenario.reaction.kind == "reverse":
        lasts = kernel.contact_spans(tick[detected].tolist(), begin[detected])
        spans = SampledDistribution(lasts[np.isfinite(lasts)])
    hardest = float(begin[int(np.argmax(peak))])
    return TrajectoryLaw(
        problem=problem,
        curve=trajectory_curve(problem, kernel, hardest),
        kind="sampled",
        peak_force=SampledDistribution(peak, undetected=undetected),
        force_at_detection=SampledDistribution(force[felt]),
        detection_delay=SampledDistribution((tick_time - begin)[felt]),
        trigger_joint_probability=fired[detected].mean(axis=0) if some else np.full(problem.robot.dof, math.nan),
        several_joints_probability=float((fired[detected].sum(axis=1) > 1).mean()) if some else math.nan,
        false_alarm_probability=float((detected & ~felt).mean()),
        undetected_probability=float(undetected.mean()),
        no_contact_probability=float((~detected & ~undetected).mean()),
        samples=samples,
        seed=seed,
        runs={
            "contact_time": begin,
            "offset": np.zeros(samples),
            "tick": tick,
            "triggers": runs["triggers"],
            "noise": runs["noise"],
            "residual": runs["residual"],
            "peak_force": peak,
            "force_at_detection": force,
        },
        kernel=kernel,
        times=times,
        contact_begin=hardest,
        spans=spans,
        greatest_undetected=float(peak.max(where=undetected, initial=0.0)),
    )


def _draw(times: ContactTimes, seed: int, samples: int) -> FloatArray:
    """Times of contact of runs (samples,) [s]: even over the time in which contact may begin."""
    share: FloatArray = core.offsets(seed, 0, samples, "uniform", 1.0)
    moving = times.weight > 0
    low, high = times.low[moving], times.high[moving]
    reached = np.concatenate([[0.0], np.cumsum(times.weight[moving])])
    cell = np.clip(np.searchsorted(reached, share, side="right") - 1, 0, low.size - 1)
    inside = (share - reached[cell]) / times.weight[moving][cell]
    return np.asarray(low[cell] + (high - low)[cell] * np.clip(inside, 0.0, 1.0))
