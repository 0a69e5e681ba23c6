"""From a scenario to its result: by quadrature, or by single collisions that are drawn."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from bumpstop import _native
from bumpstop.arrays import FloatArray, as_whole_number
from bumpstop.collision.arm.pressing_limit import presses_on, undetected_force
from bumpstop.collision.curve import AT_REST, StoppingCurve, stopping_curve
from bumpstop.collision.distribution.contact_distribution import ContactDistribution
from bumpstop.collision.distribution.contact_duration import first_passage_times
from bumpstop.collision.distribution.distribution import Distribution, ExactDistribution, SampledDistribution
from bumpstop.collision.distribution.monte_carlo_blocks import Progress, block_seed, in_blocks
from bumpstop.collision.problem import CollisionProblem
from bumpstop.collision.result import CollisionResult
from bumpstop.collision.retreats import retreats_in_memory
from bumpstop.collision.sampled_figures import kept_runs, sampled_figures
from bumpstop.collision.scenario.scenario import as_scenario
from bumpstop.collision.trajectory.trajectory_evaluation import integrate_trajectory, monte_carlo_trajectory
from bumpstop.errors import InputError

if TYPE_CHECKING:
    from bumpstop.collision.scenario.scenario import Scenario

# Runs of a scenario that can only be sampled, where their number is not given.
RESAMPLED_RUNS = 100_000


def evaluate(
    scenario: Scenario,
    *,
    samples: int | None = None,
    seed: int = 0,
    threads: int = 1,
    refinement: int = 1,
    progress: Progress | None = None,
) -> CollisionResult:
    """Compute the whole distribution of a collision.

    Args:
        scenario: what happens.
        samples: None to integrate; else the number of runs to draw. Measured residuals cannot be integrated: None then
            means 100 000 runs. Of more than a million runs only the first million are kept one by one.
        seed: of the runs, 0 to 2^64 - 1. The same seed gives the same runs, whatever the threads.
        threads: that draw runs, or integrate over the times of contact of a trajectory, 1 to 256.
        refinement: multiplies the order of the quadrature, 1 to 100. 2 shows that 1 is converged.
        progress: told the share of the runs that are done.

    Raises:
        InputError: the scenario cannot be computed.
    """
    problem = CollisionProblem.from_scenario(as_scenario(scenario))
    refinement = as_whole_number(refinement, "refinement", 1, 100)
    as_whole_number(threads, "threads", 1, 256)
    as_whole_number(seed, "seed", 0, 2**64 - 1, "0 to 2^64 - 1")
    if samples is not None:
        _check_sample(samples, seed, threads)
    elif problem.residuals is not None:
        samples = RESAMPLED_RUNS
    if problem.trajectory is not None:
        another = partial(evaluate, threads=threads)
        if samples is None:
            return integrate_trajectory(problem, another, refinement=refinement, threads=threads)
        return in_blocks(
            lambda first, size: monte_carlo_trajectory(
                problem, another, samples=size, seed=block_seed(seed, first), threads=threads
            ),
            samples,
            progress,
        )
    curve = stopping_curve(problem)
    if samples is None:
        return integrate(problem, curve, refinement=refinement)
    return in_blocks(
        lambda first, size: monte_carlo(problem, curve, samples=size, seed=seed, threads=threads, first=first),
        samples,
        progress,
    )


def integrate(problem: CollisionProblem, curve: StoppingCurve, *, refinement: int = 1) -> CollisionResult:
    """Integrate over contact offset and noise on a stopping curve of this problem's pose, motion and reaction.

    Args:
        problem: a checked scenario.
        curve: of :func:`stopping_curve`; traced whole it serves other bodies, offsets, thresholds and noise, too.
        refinement: multiplies the order of the quadrature.

    Raises:
        InputError: the noise is measured residuals, of which there are only samples.
    """
    if problem.residuals is not None:
        raise InputError(
            "detector.residuals", "measured residuals have no integrated distribution", "draw it: give samples"
        )
    with retreats_in_memory():
        law = curve.line.integrate(problem.detector, problem.contact, refinement)
    undetected = min(1.0, max(0.0, law.undetected))
    after_contact = law.total("force_at_detection")
    detected = after_contact + law.false_alarm
    with np.errstate(invalid="ignore"):
        triggers = np.minimum(1.0, law.trigger[: problem.robot.dof] / (detected if detected > 0 else math.nan))
    peak_force: Distribution
    force_at_detection: Distribution
    contact_duration: Distribution | None = None
    if problem.gives_way:
        quantity = _native.ContactQuantity
        peak_force = ContactDistribution.of(law, quantity.peak_force, lambda: undetected_force(problem, curve))
        force_at_detection = ContactDistribution.of(law, quantity.force_at_detection)
        if problem.gets_away or problem.scenario.reaction.kind == "reverse":
            lasts = math.inf if presses_on(problem, curve) else None
            contact_duration = ContactDistribution.of(law, quantity.duration, lambda: lasts)
    else:
        peak_force = ExactDistribution(
            law,
            "peak_force",
            undetected=0.0 if law.rests else undetected,
            far_tail=lambda force: curve.line.tail_without_interpolation(problem.detector, problem.contact, force),
        )
        force_at_detection = ExactDistribution(law, "force_at_detection", condition=after_contact)
    return CollisionResult(
        problem=problem,
        curve=curve,
        kind="exact",
        peak_force=peak_force,
        force_at_detection=force_at_detection,
        transient_contact_duration=contact_duration,
        detection_delay=ExactDistribution(law, "detection_delay", condition=after_contact),
        trigger_joint_probability=triggers,
        multi_joint_probability=min(1.0, law.multi_joint / detected) if detected > 0 else math.nan,
        false_alarm_probability=law.false_alarm,
        undetected_probability=undetected,
        no_contact_probability=max(0.0, law.no_contact),
        kernel=law,
        evaluate=evaluate,
    )


def monte_carlo(
    problem: CollisionProblem, curve: StoppingCurve, *, samples: int, seed: int = 0, threads: int = 1, first: int = 0
) -> CollisionResult:
    """Draw single collisions on a stopping curve of this problem's pose, motion and reaction.

    Args:
        problem: a checked scenario.
        curve: as for :func:`integrate`.
        samples: number of collisions.
        seed: 0 to 2^64 - 1. The same seed gives the same collisions, whatever the threads.
        threads: that share the work.
        first: number of the first of them.

    Raises:
        InputError: no samples, or a seed that is none.
    """
    _check_sample(samples, seed, threads)
    settings = _native.MonteCarloSettings()
    settings.seed, settings.first, settings.count, settings.threads = seed, first, samples, threads
    with retreats_in_memory():
        runs = curve.line.monte_carlo(problem.detector, problem.contact, settings, problem.residual_record)
    offset, tick = runs.offset, runs.tick
    detected = tick >= 0
    at = np.where(detected, tick, 0)
    K, step = problem.stiffness, problem.scenario.simulation.step_s

    def at_tick(values: FloatArray) -> FloatArray:
        # A motion that ends before the first tick has none to look up, and no detection.
        return values[at] if values.size else np.zeros(at.shape)

    peak = K * np.maximum(0.0, at_tick(curve.max_distance) - offset)
    # The path goes on for a latency beyond the end of the motion, for the reactions; the motion does not.
    motion = curve.distance[: _motion_steps(problem) + 1]
    braking = curve.line.braking if curve.end in ("joint_limit", "singularity") else np.zeros(0)
    if problem.gives_way:
        motion, braking = np.append(motion, braking), np.zeros(0)
    touches = offset < motion.max()
    # A body that the arm reaches only while it brakes at the end of its line is pressed as deep as any other.
    greatest = K * np.maximum(0.0, max(motion.max(), braking.max(initial=-math.inf)) - offset)
    missed = ~detected & touches
    peak = np.where(detected, peak, np.where(missed & (curve.end == "motion_end"), math.inf, greatest))
    force = K * np.maximum(0.0, at_tick(curve.tick_distance) - offset)
    transient_contact_duration = None
    # From the first tick in contact on, also where the arm falls back from the body again.
    after_contact = detected & (
        tick >= np.searchsorted(np.maximum.accumulate(curve.tick_distance), offset, side="right")
    )
    unbounded = missed & (curve.end not in AT_REST and not problem.gets_away)
    if problem.gives_way:
        never = undetected_force(problem, curve)
        peak = runs.peak_force if never is None else np.where(unbounded, never, runs.peak_force)
        force = np.where(detected, runs.force_at_detection, 0.0)
        if problem.gets_away:
            after_contact = detected & (force > 0)
        if problem.gets_away or problem.scenario.reaction.kind == "reverse":
            duration = np.where(unbounded, math.inf, runs.duration)
            transient_contact_duration = SampledDistribution(duration[duration > 0])
        pressed = unbounded
        if never is not None and math.isfinite(never):
            unbounded = np.zeros_like(unbounded)
    delay = at_tick(curve.tick_time) - first_passage_times(curve.distance, offset, step)
    kept = kept_runs(runs, offset=offset, peak=peak, force=force, after_contact=after_contact)
    if problem.gives_way:
        kept["duration"] = runs.duration
        kept["lasting_force"] = runs.lasting_force if never is None else np.where(pressed, never, runs.lasting_force)
    return CollisionResult(
        problem=problem,
        curve=curve,
        kind="sampled",
        peak_force=SampledDistribution(peak, unbounded if unbounded.any() else None),
        transient_contact_duration=transient_contact_duration,
        **sampled_figures(
            runs, problem.robot.dof, touches=touches, after_contact=after_contact, force=force, delay=delay
        ),
        samples=samples,
        seed=seed,
        runs=kept,
        evaluate=evaluate,
    )


def _check_sample(samples: int, seed: int, threads: int) -> None:
    as_whole_number(samples, "samples", 1, 100_000_000)
    as_whole_number(seed, "seed", 0, 2**64 - 1, "0 to 2^64 - 1")
    as_whole_number(threads, "threads", 1, 256)


def _motion_steps(problem: CollisionProblem) -> int:
    return round(problem.scenario.motion.duration_s / problem.scenario.simulation.step_s)
