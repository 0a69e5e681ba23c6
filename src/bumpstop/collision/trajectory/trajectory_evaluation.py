"""From a trajectory to the distribution of its collisions: by quadrature over the time of contact, or drawn."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from bumpstop import _native
from bumpstop.arrays import FloatArray
from bumpstop.collision.distribution.distribution import Distribution, SampledDistribution
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.sampled_figures import kept_runs, sampled_figures
from bumpstop.collision.trajectory.onset import approach, onset_quadrature, sample_onsets
from bumpstop.collision.trajectory.onset_mixture import DetectedCollisions, OnsetMixture
from bumpstop.collision.trajectory.trajectory_curve import trajectory_curve, trajectory_kernel
from bumpstop.collision.trajectory.trajectory_result import PhaseShares, TrajectoryCollisionResult
from bumpstop.collision.trajectory.undetected import undetected_forces
from bumpstop.collision.verdict.two_phase import greater_share
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision.result import CollisionResult
    from bumpstop.collision.scenario.scenario import Scenario

    Evaluate = Callable[[Scenario], CollisionResult]

# Every pair of a contact time and a tick that may detect it takes some 300 bytes of memory.
_MAX_DETECTIONS = 20_000_000
_CONTACTS_AT_ONCE = 500


def integrate_trajectory(
    problem: CollisionProblem, evaluate: Evaluate, *, refinement: int = 1, threads: int = 1
) -> TrajectoryCollisionResult:
    """Integrate over the time of contact and sensor noise; ``evaluate`` as :attr:`CollisionResult.evaluate`."""
    if problem.residuals is not None:
        raise InputError(
            "detector.residuals", "measured residuals have no integrated distribution", "draw it: give samples"
        )
    kernel, times = trajectory_kernel(problem), onset_quadrature(problem, refinement)
    used = np.flatnonzero(times.weight > 0)
    begin, weight, K = times.begin[used], times.weight[used], problem.stiffness
    normal = np.ascontiguousarray(times.normal[used])
    out = _onsets(problem, kernel, begin, normal, threads)
    contact, tick, probability = out["onset"], out["tick"], out["probability"]
    free = problem.gives_way
    mass = weight[contact] * probability
    peak, undetected_peak = (
        (out["peak"], out["undetected_peak"]) if free else (K * out["max_distance"], K * out["undetected_distance"])
    )
    after = out["distance"] >= 0
    never = weight * out["undetected"]
    missed = np.flatnonzero(never > 0)
    undetected = undetected_forces(problem, begin[missed], normal[missed])
    undetected_peak[missed] = undetected.of(undetected_peak[missed])
    out["undetected_lasting"][missed] = undetected.of(out["undetected_lasting"][missed])
    mixer = OnsetMixture(times, used[contact], tick)
    late = (tick * problem.period_steps + 1) * problem.scenario.simulation.step_s - begin[contact]
    false_alarm = float(weight @ out["false_alarm"])
    detected = float(mass[after].sum()) + false_alarm
    zero = float(weight @ out["zero_force"])
    contact_durations: Distribution | None = None
    undetected_force: Distribution | None = None
    # What goes undetected is like what one more tick detects.
    everything = OnsetMixture(
        times,
        used[np.append(contact, missed)],
        np.append(tick, np.full(missed.size, kernel.ticks, dtype=tick.dtype)),
    )
    all_mass = np.append(mass, never[missed])

    def of_all(value: FloatArray, of_undetected: FloatArray) -> Distribution:
        if problem.gets_away or undetected.bounded:
            return everything.distribution(np.append(value, of_undetected[missed]), all_mass, zero=zero)
        return mixer.distribution(value, mass, zero=zero, end=(of_undetected[missed], never[missed]))

    if undetected.bounded and missed.size:
        alone = OnsetMixture(times, used[missed], np.full(missed.size, kernel.ticks, dtype=tick.dtype))
        undetected_force = alone.distribution(undetected_peak[missed], never[missed])
    if free:
        if problem.gets_away:
            lasts = np.append(out["duration"], out["undetected_duration"][missed])
            contact_durations = everything.distribution(np.where(lasts > 0, lasts, math.nan), all_mass)
        elif problem.scenario.reaction.kind == "reverse":
            lasts = out["duration"]
            contact_durations = mixer.distribution(np.where(lasts > 0, lasts, math.nan), mass)
        force = out["force"]
    else:
        if problem.scenario.reaction.kind == "reverse":
            contact_durations = mixer.distribution(kernel.contact_durations(tick.tolist(), begin[contact]), mass)
        force = K * out["distance"]
    expected = np.bincount(contact, probability * peak, len(begin)) + out["undetected"] * undetected_peak
    worst_onset = float(begin[int(np.argmax(expected))])
    with np.errstate(invalid="ignore"):
        triggers = np.minimum(1.0, weight @ out["trigger"] / (detected if detected > 0 else math.nan))
    return TrajectoryCollisionResult(
        problem=problem,
        evaluate=evaluate,
        curve=trajectory_curve(problem, kernel, worst_onset),
        kind="exact",
        peak_force=of_all(peak, undetected_peak),
        force_at_detection=mixer.distribution(np.where(after, force, math.nan), mass),
        detection_delay=mixer.distribution(np.where(after, late, math.nan), mass),
        trigger_joint_probability=triggers,
        multi_joint_probability=min(1.0, float(weight @ out["multi_joint"]) / detected) if detected > 0 else math.nan,
        false_alarm_probability=false_alarm,
        undetected_probability=min(1.0, float(never.sum())),
        no_contact_probability=max(0.0, float(weight @ out["no_contact"])),
        kernel=kernel,
        times=times,
        onset=worst_onset,
        contact_durations=contact_durations,
        detections=DetectedCollisions(tick, contact, begin, normal, mass, mixer),
        max_undetected_force=float(undetected_peak.max(where=never > 0, initial=0.0)),
        undetected_force=undetected_force,
        pressing=undetected.limit,
        shares=_shares_of_nodes(out, of_all) if free else None,
    )


def _shares_of_nodes(
    out: dict[str, npt.NDArray[Any]], of_all: Callable[[FloatArray, FloatArray], Distribution]
) -> PhaseShares:
    """Of the detections and the missed collisions of onsets; ``of_all`` mixes the values of both."""
    # Not the other columns: a result keeps what it is told by.
    detected = out["peak"], out["lasting"]
    missed = out["undetected_peak"], out["undetected_lasting"]

    def shares(first: float, later: float) -> Distribution:
        return of_all(greater_share(*detected, (first, later)), greater_share(*missed, (first, later)))

    return shares


# Of onsets, then of their detections.
_COLUMNS = (
    *("false_alarm", "undetected", "no_contact", "multi_joint", "zero_force", "undetected_distance", "trigger"),
    *("undetected_peak", "undetected_lasting", "undetected_duration"),
    *("tick", "probability", "max_distance", "distance", "peak", "lasting", "duration", "force"),
)


def _onsets(
    problem: CollisionProblem, kernel: _native.Trajectory, begin: FloatArray, normal: FloatArray, threads: int
) -> dict[str, npt.NDArray[Any]]:
    """The distributions of onsets, some hundreds at a time: of slow motions each has thousands of detections."""
    parts: list[dict[str, npt.NDArray[Any]]] = []
    detections = 0
    for first in range(0, begin.size, _CONTACTS_AT_ONCE):
        own = slice(first, first + _CONTACTS_AT_ONCE)
        found = kernel.integrate(problem.detector, problem.contact, begin[own], normal[own], threads)
        part = {name: getattr(found, name) for name in _COLUMNS} | {"onset": found.onset + first}
        detections += found.onset.size
        if detections > _MAX_DETECTIONS:
            raise InputError(
                "motion.file",
                f"collisions stay undetected for so long that the integrated distribution has more than "
                f"{_MAX_DETECTIONS:,} pairs of a contact time and a control cycle that detects it",
                "draw it: give samples; or give motion.contact_onset_s, or a part of the motion",
            )
        parts.append(part)
    return {name: np.concatenate([part[name] for part in parts]) for name in parts[0]}


def monte_carlo_trajectory(
    problem: CollisionProblem, evaluate: Evaluate, *, samples: int, seed: int = 0, threads: int = 1
) -> TrajectoryCollisionResult:
    """Draw single collisions: a time of contact, then noise until a joint alarms; ``evaluate`` as above."""
    kernel, times = trajectory_kernel(problem), onset_quadrature(problem)
    begin = sample_onsets(times, seed, samples)
    normal, _ = approach(problem, begin)
    settings = _native.MonteCarloSettings()
    settings.seed, settings.count, settings.threads = seed, samples, threads
    runs = kernel.monte_carlo(problem.detector, problem.contact, begin, normal, settings, problem.residual_record)
    K, tick = problem.stiffness, runs.tick
    detected = tick >= 0
    touches = runs.undetected_distance > 0
    undetected = ~detected & touches
    peak = K * np.where(detected, runs.max_distance, runs.undetected_distance)
    tick_time = (tick * problem.period_steps + 1) * problem.scenario.simulation.step_s
    # From the first tick in contact on, also where the point falls back from the body again.
    after_contact = detected & (runs.distance >= 0)
    force = K * np.maximum(0.0, runs.distance)
    free = problem.gives_way
    if free:
        peak, force = runs.peak_force, np.where(detected, runs.force_at_detection, 0.0)
    contact_durations = None
    if problem.gets_away or (free and problem.scenario.reaction.kind == "reverse"):
        lasts = runs.duration[(runs.duration > 0) & (detected | problem.gets_away)]
        contact_durations = SampledDistribution(lasts)
    if problem.scenario.reaction.kind == "reverse" and not free:
        lasts = kernel.contact_durations(tick[detected].tolist(), begin[detected])
        contact_durations = SampledDistribution(lasts[np.isfinite(lasts)])
    near = (times.weight > 0) & undetected.any()
    missed = undetected_forces(problem, times.begin[near], times.normal[near]).at(times.begin[near], begin[undetected])

    def with_missed(path: FloatArray) -> FloatArray:
        out = np.array(path)
        out[undetected] = missed.of(path[undetected])
        return out

    peak = with_missed(peak)
    worst_onset = float(begin[int(np.argmax(peak))])
    # Of an arm that moves on at the end of its trajectory no force is the greatest, but for what its drives allow.
    unbounded = undetected if not (problem.gets_away or missed.bounded) else None

    def shares(first: float, later: float) -> Distribution:
        return SampledDistribution(greater_share(peak, with_missed(runs.lasting_force), (first, later)), unbounded)

    return TrajectoryCollisionResult(
        problem=problem,
        evaluate=evaluate,
        curve=trajectory_curve(problem, kernel, worst_onset),
        kind="sampled",
        peak_force=SampledDistribution(peak, unbounded),
        **sampled_figures(
            runs,
            problem.robot.dof,
            touches=touches,
            after_contact=after_contact,
            force=force,
            delay=tick_time - begin,
        ),
        samples=samples,
        seed=seed,
        runs={"onset": begin}
        | kept_runs(runs, offset=np.zeros(samples), peak=peak, force=force, after_contact=after_contact),
        kernel=kernel,
        times=times,
        onset=worst_onset,
        contact_durations=contact_durations,
        detections=DetectedCollisions(tick[detected].astype(np.int64), np.flatnonzero(detected), begin, normal),
        max_undetected_force=float(peak.max(where=undetected, initial=0.0)),
        pressing=missed.limit,
        shares=shares if free else None,
    )
